"""The tree of a program: the parser makes it, the checker completes it, the interpreter compiles it.

``at`` is the offset of a node in its statement's text. ``type`` is filled in by the checker.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ..machine.kinds import Kind
from .source import Statement


@dataclass(frozen=True)
class Type:
    """Type of an expression: a kind, the number of parallel dimensions (rank, 0 to 2) and of serial ones."""

    kind: Kind
    rank: int = 0
    serial: int = 0

    def __str__(self) -> str:
        shape = ('scalar', 'vector', 'matrix')[self.rank]
        return f'{self.kind} {shape}' + (f' array ({self.serial} serial dimension(s))' if self.serial else '')


@dataclass
class Constant:
    """A number, truth or text."""

    value: Any
    kind: Kind
    at: int
    type: Any = None


@dataclass
class Reference:
    """A name, alone or with items in brackets: a variable, an indexed array, or a function's value."""

    name: str
    items: list[Any] | None
    at: int
    type: Any = None
    # From the checker: 'variable', 'intrinsic', 'function' or 'procedure', and the functions a procedure may stand for.
    meaning: str = ''
    candidates: list[str] = field(default_factory=list)


@dataclass
class Whole:
    """An empty index: every element along this dimension."""

    at: int = 0


@dataclass
class Step:
    """+ or - as an index: the next or previous element along this dimension."""

    step: int
    at: int = 0


@dataclass
class Unary:
    """A sign or .NOT. and its operand."""

    operator: str
    operand: Any
    at: int
    type: Any = None


@dataclass
class Binary:
    """An operation on two operands."""

    operator: str
    left: Any
    right: Any
    at: int
    type: Any = None


@dataclass
class Dimension:
    """One dimension of an array: parallel or serial, and its extent as an expression (None when omitted)."""

    parallel: bool
    extent: Any


@dataclass
class Entity:
    """A declared name, the word length of NAME*n, and its dimensions (None when it has no brackets)."""

    name: str
    length: int | None
    dimensions: list[Dimension] | None
    at: int


@dataclass
class DataTarget:
    """What a DATA statement gives values to: a name, one element of it, or the elements of an implied DO.

    ``loop`` has the variable, its first and last value, and its step or None.
    """

    name: str
    at: int
    items: list[Any] | None = None
    loop: tuple[str, Any, Any, Any] | None = None


@dataclass
class Node:
    """A statement: its class (for example 'assign'), its parts by name, its label and its source.

    Parts are read as attributes: ``node.target`` is ``node.parts['target']``.
    """

    what: str
    parts: dict[str, Any]
    at: int = 0
    label: int | None = None
    source: Statement = field(default_factory=lambda: Statement('', [(0, 0, 0)]))

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__['parts'][name]
        except KeyError:
            raise AttributeError(name) from None


@dataclass
class Unit:
    """A subroutine or function.

    Parameters
    ----------
    name : str
    arguments : list of str
    entry : bool
        Whether the host may call it.
    is_function : bool
    result_type : str, optional
        Declared type of a function, for example 'REAL*4'.
    result_rank : int
        Rank of a function's value.
    header : Node
        Its first statement.
    body : list of Node
        Declarations and statements.
    """

    name: str
    arguments: list[str]
    entry: bool
    is_function: bool
    result_type: str | None
    result_rank: int
    header: Node
    body: list[Node] = field(default_factory=list)
