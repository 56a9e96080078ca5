"""The tree of a program: what the parser makes, the checker completes and the interpreter runs.

``at`` is the offset of a node in its statement's text. ``type`` is filled in by the checker.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Union

from ..machine.kinds import Kind
from .source import Statement


@dataclass(frozen=True)
class Type:
    """kind; rank : parallel dimensions 0..2; serial : serial dimensions"""

    kind: Kind
    rank: int = 0
    serial: int = 0

    def __str__(self) -> str:
        shape = ('scalar', 'vector', 'matrix')[self.rank]
        return f'{self.kind} {shape}' + (f' array ({self.serial} serial dimension(s))' if self.serial else '')


@dataclass
class Constant:
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
    meaning: str = ''  # 'variable', 'intrinsic' or 'function', from the checker


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
    operator: str
    operand: Any
    at: int
    type: Any = None


@dataclass
class Binary:
    operator: str
    left: Any
    right: Any
    at: int
    type: Any = None


Expression = Union[Constant, Reference, Unary, Binary]  # noqa: UP007  (evaluated at run time)


@dataclass
class Dimension:
    """parallel; extent : expression, or None when omitted"""

    parallel: bool
    extent: Any


@dataclass
class Entity:
    """A declared name. length : of NAME*n; dimensions : None when it has no brackets"""

    name: str
    length: int | None
    dimensions: list[Dimension] | None
    at: int


@dataclass
class Node:
    """A statement: what it is, its parts by name, its label and its source."""

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
    """A subroutine or function. entry : callable from the host; result : declared type text and rank of a function"""

    name: str
    arguments: list[str]
    entry: bool
    is_function: bool
    result_type: str | None
    result_rank: int
    header: Node
    body: list[Node] = field(default_factory=list)
