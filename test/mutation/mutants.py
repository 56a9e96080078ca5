"""What a mutant is: one small change of a module's syntax tree that a test ought to notice.

Left alone is what says nothing about behaviour: annotations, decorators, docstrings, texts for people (strings with a
space, and all that stands in a ``raise``), and arguments that guard or tune (``strict=``, ``stacklevel=``, ``copy=``).
A boundary (``<`` for ``<=``) is moved only where a whole number is compared: two floats are hardly ever equal, and such
a mutant could not be told from the original. Everything else that is compared is turned round.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

TURNED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
MOVED: dict[type[ast.cmpop], type[ast.cmpop]] = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
NAMES = {
    'min': 'max',
    'max': 'min',
    'any': 'all',
    'all': 'any',
    'minimum': 'maximum',
    'maximum': 'minimum',
    'argmin': 'argmax',
    'argmax': 'argmin',
    'floor': 'ceil',
    'ceil': 'floor',
    'sin': 'cos',
    'cos': 'sin',
}
GUARDS = ('strict', 'stacklevel', 'copy')
# Of the name of a sort numpy reads the first letter.
SORTS = ("kind='stable'", "kind='mergesort'")


@dataclass(frozen=True)
class Mutant:
    """One change.

    Attributes
    ----------
    line : int
        Where it stands, from 1.
    before, after : str
        The expression or statement, and what becomes of it.
    apply : callable
        Makes the change in the tree that was searched.
    """

    line: int
    before: str
    after: str
    apply: Callable[[], None]


def mutants_of(tree: ast.Module) -> list[Mutant]:
    """Every mutant of a module.

    Parameters
    ----------
    tree : ast.Module
        The module's syntax tree, as parsed.

    Returns
    -------
    list of Mutant
        In the order of the text.
    """
    found = [mutant for holder in _spoken(tree) for mutant in _changes(holder)]
    return sorted(found, key=lambda mutant: mutant.line)


def _spoken(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes that say what is done, parents before their children."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in ('annotation', 'returns', 'decorator_list', 'type_comment', 'bases', 'type_params'):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not _is_silent(child):
                yield from _spoken(child)


def _is_silent(node: ast.AST) -> bool:
    if isinstance(node, (ast.Import, ast.ImportFrom, ast.Raise, ast.JoinedStr)):
        return True
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return True  # a docstring, or the ... of an overload
    if isinstance(node, ast.keyword) and (node.arg in GUARDS or ast.unparse(node) in SORTS):
        return True
    if isinstance(node, (ast.Assign, ast.If)):
        words = ast.unparse(node.targets[0] if isinstance(node, ast.Assign) else node.test)
        return words in ('__all__', 'TYPE_CHECKING', "__name__ == '__main__'")
    return isinstance(node, ast.FunctionDef) and any(ast.unparse(one) == 'overload' for one in node.decorator_list)


def _changes(holder: ast.AST) -> Iterator[Mutant]:
    """The changes of what a node holds: its own operators, and its children where they are replaced whole."""
    yield from _of_operators(holder)
    for name, value in ast.iter_fields(holder):
        if name in ('annotation', 'returns', 'decorator_list'):
            continue
        if isinstance(value, list):
            for k, child in enumerate(value):
                yield from _replacements(child, holder, value, k)
        else:
            yield from _replacements(value, holder, holder, name)
    if isinstance(holder, (ast.If, ast.IfExp, ast.While)) and not isinstance(
        holder.test, (ast.Compare, ast.UnaryOp, ast.Constant, ast.BoolOp)
    ):
        yield _set(holder.test, holder, 'test', ast.UnaryOp(ast.Not(), holder.test))


def _of_operators(node: ast.AST) -> Iterator[Mutant]:
    if isinstance(node, ast.Compare):
        for k, op in enumerate(node.ops):
            sides = (node.left, *node.comparators)[k : k + 2]
            if type(op) in MOVED and any(_is_count(side) for side in sides):
                yield _set(node, node.ops, k, MOVED[type(op)]())
            yield _set(node, node.ops, k, TURNED[type(op)]())
    elif isinstance(node, (ast.BinOp, ast.AugAssign)):
        sides = (node.left, node.right) if isinstance(node, ast.BinOp) else (node.target, node.value)
        text = any(isinstance(side, ast.JoinedStr) or _is_text(side) for side in sides)
        if type(node.op) in OPERATORS and not text:
            yield _set(node, node, 'op', OPERATORS[type(node.op)]())
    elif isinstance(node, ast.BoolOp):
        yield _set(node, node, 'op', ast.Or() if isinstance(node.op, ast.And) else ast.And())
    elif isinstance(node, ast.Attribute) and node.attr in NAMES:
        yield _set(node, node, 'attr', NAMES[node.attr])
    elif isinstance(node, ast.Name) and node.id in NAMES:
        yield _set(node, node, 'id', NAMES[node.id])


def _replacements(node: Any, parent: ast.AST, holder: Any, place: int | str) -> Iterator[Mutant]:
    if not isinstance(node, ast.AST) or (_is_silent(node) and not isinstance(node, ast.Raise)):
        return
    new: ast.AST | None = None
    if isinstance(node, ast.Constant):
        new = _other_constant(node)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub)):
        new = node.operand
    elif isinstance(node, ast.Return) and node.value is not None and not _is_named(node.value):
        new = ast.Return(ast.Constant(None))
    elif isinstance(node, ast.Continue):
        new = ast.Break()
    elif _is_effect(node):
        new = ast.Pass()
    if new is not None:
        yield _set(node, holder, place, ast.copy_location(new, node))


def _is_effect(node: ast.AST) -> bool:
    """A statement that can be left out without a name going missing."""
    if isinstance(node, ast.Assign):
        return all(isinstance(target, (ast.Attribute, ast.Subscript)) for target in node.targets)
    return isinstance(node, ast.Raise) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Call))


def _other_constant(node: ast.Constant) -> ast.Constant | None:
    if isinstance(node.value, bool):
        return ast.Constant(not node.value)
    if isinstance(node.value, (int, float)):
        return ast.Constant(node.value + 1)
    if isinstance(node.value, str) and node.value and not any(c.isspace() for c in node.value):
        return ast.Constant(node.value + 'X')
    return None


def _is_named(node: ast.AST) -> bool:
    """None, True or False: the first changes nothing, and of the others None is as good as False."""
    return isinstance(node, ast.Constant) and (node.value is None or isinstance(node.value, bool))


def _is_count(node: ast.AST) -> bool:
    if isinstance(node, ast.Call):
        return ast.unparse(node.func) == 'len'
    return isinstance(node, ast.Constant) and isinstance(node.value, int)


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _set(shown: ast.AST, holder: Any, place: int | str, value: Any) -> Mutant:
    """The mutant in which the holder (a node, or a list of nodes) has another value at a place."""
    before = ast.unparse(shown)

    def put(what: Any) -> Any:
        if isinstance(holder, list):
            old, holder[int(place)] = holder[int(place)], what
        else:
            old = getattr(holder, str(place))
            setattr(holder, str(place), what)
        return old

    def apply() -> None:
        put(value)

    old = put(value)
    after = ast.unparse(ast.fix_missing_locations(value if old is shown else shown))
    put(old)
    return Mutant(getattr(shown, 'lineno', 0), before, after, apply)
