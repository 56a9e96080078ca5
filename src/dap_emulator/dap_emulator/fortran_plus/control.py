"""From blocks and labels to a flat list of steps with jumps, so that GOTO needs no special care."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .parser import located
from .syntax import Node


@dataclass
class Step:
    """One step of a unit.

    Parameters
    ----------
    what : {'plain', 'jump', 'jump_unless', 'choose', 'do_start', 'do_next'}
    node : Node
        The statement.
    target : int
        Position of the step to jump to.
    condition : expression, optional
        Of a jump_unless: the jump is taken when it is false.
    loop : int
        Number of the DO loop, of a do_start or do_next.
    targets : list of int
        Positions of the steps that a choose may jump to.
    """

    what: str
    node: Node
    target: int = 0
    condition: Any = None
    loop: int = 0
    targets: list[int] = field(default_factory=list)


@dataclass
class _Open:
    """A block that is not closed yet: its node, the steps that must jump past it, the next ELSE's jump."""

    node: Node
    exits: list[Step] = field(default_factory=list)
    pending: Step | None = None
    start: int = 0
    loop: int = 0


def flatten(body: list[Node]) -> tuple[list[Step], int]:
    """Turn the statements of a checked unit into steps.

    Parameters
    ----------
    body : list of Node

    Returns
    -------
    steps : list of Step
    loops : int
        Number of DO loops.

    Raises
    ------
    FortranError
        For blocks that are not closed, or closed twice.
    """
    return _Flattener(body).run()


class _Flattener:
    """Steps, open blocks, labels and jumps of one unit; each kind of statement has a method of its name."""

    def __init__(self, body: list[Node]) -> None:
        self.body = body
        self.steps: list[Step] = []
        self.stack: list[_Open] = []
        self.labels: dict[int, int] = {}
        self.gotos: list[tuple[Step, int]] = []
        self.choices: list[tuple[Step, list[int]]] = []
        self.loops = 0

    def run(self) -> tuple[list[Step], int]:
        for node in self.body:
            if node.label is not None:
                self.labels[node.label] = len(self.steps)
            getattr(self, '_' + node.what, self._plain)(node)
            while node.label is not None and self.stack and self._ends_here(node):
                self._close_do(self.stack.pop(), node)
        if self.stack:
            node = self.stack[-1].node
            label = node.parts.get('end_label')
            closing = f'label {label}' if label else 'END DO'
            what, missing = ('IF', 'END IF') if node.what == 'block_if' else ('DO', closing)
            raise located(node.source, node.at, f'this {what} is never closed ({missing} is missing)')
        for step, label in self.gotos:
            step.target = self.labels[label]
        for step, labels in self.choices:
            step.targets = [self.labels[label] for label in labels]
        return self.steps, self.loops

    def _ends_here(self, node: Node) -> bool:
        top = self.stack[-1].node
        return top.what == 'do' and top.end_label == node.label

    def _add(self, step: Step) -> Step:
        self.steps.append(step)
        return step

    def _plain(self, node: Node) -> None:
        self._add(Step('plain', node))

    def _continue(self, node: Node) -> None:
        """Nothing to run; the label points at what follows."""

    def _goto(self, node: Node) -> None:
        self.gotos.append((self._add(Step('jump', node)), node.target))

    def _arithmetic_if(self, node: Node) -> None:
        self.choices.append((self._add(Step('choose', node)), node.targets))

    _computed_goto = _arithmetic_if

    def _if(self, node: Node) -> None:
        skip = self._add(Step('jump_unless', node, condition=node.condition))
        getattr(self, '_' + node.then.what, self._plain)(node.then)
        skip.target = len(self.steps)

    def _block_if(self, node: Node) -> None:
        skip = self._add(Step('jump_unless', node, condition=node.condition))
        self.stack.append(_Open(node, pending=skip))

    def _innermost_if(self, node: Node, word: str) -> _Open:
        if not self.stack or self.stack[-1].node.what != 'block_if':
            raise located(node.source, node.at, f'{word} without an IF (...) THEN')
        return self.stack[-1]

    def _else_if(self, node: Node) -> None:
        block = self._innermost_if(node, 'ELSE IF')
        if block.pending is None:
            raise located(node.source, node.at, 'ELSE IF after ELSE')
        block.exits.append(self._add(Step('jump', node)))
        block.pending.target = len(self.steps)
        block.pending = self._add(Step('jump_unless', node, condition=node.condition))

    def _else(self, node: Node) -> None:
        block = self._innermost_if(node, 'ELSE')
        if block.pending is None:
            raise located(node.source, node.at, 'a second ELSE')
        block.exits.append(self._add(Step('jump', node)))
        block.pending.target = len(self.steps)
        block.pending = None

    def _end_if(self, node: Node) -> None:
        block = self._innermost_if(node, 'END IF')
        self.stack.pop()
        for step in block.exits + ([block.pending] if block.pending else []):
            step.target = len(self.steps)

    def _do(self, node: Node) -> None:
        start = self._add(Step('do_start', node, loop=self.loops))
        self.stack.append(_Open(node, exits=[start], start=len(self.steps), loop=self.loops))
        self.loops += 1

    def _do_while(self, node: Node) -> None:
        start = len(self.steps)
        leave = self._add(Step('jump_unless', node, condition=node.condition))
        self.stack.append(_Open(node, exits=[leave], start=start))

    def _end_do(self, node: Node) -> None:
        if (
            not self.stack
            or self.stack[-1].node.what not in ('do', 'do_while')
            or self.stack[-1].node.parts.get('end_label')
        ):
            raise located(node.source, node.at, 'END DO without a DO that it could close')
        self._close_do(self.stack.pop(), node)

    def _close_do(self, block: _Open, node: Node) -> None:
        what = 'do_next' if block.node.what == 'do' else 'jump'
        closing = self._add(Step(what, block.node, target=block.start, loop=block.loop))
        closing.node = Node(block.node.what, block.node.parts, block.node.at, source=node.source)
        for step in block.exits:
            step.target = len(self.steps)
