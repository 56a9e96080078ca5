"""The parsed statements, and their making from the grammar's rules.

Every node has a ``place`` relative to the start of its statement.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

from lark import Token, Transformer

from .errors import Place

TRANSFORMS = ('XROT', 'YROT', 'ZROT', 'SCALE', 'AT', 'MATRIX')
PROPERTIES = ('COLOUR', 'AMBIENT', 'DIFFUSE', 'SPECULAR', 'SHININESS', 'REFLECT', 'TRANSPARENT', 'PAINT')
STATEMENTS = ('DRAW', 'LIGHT', 'AMBIENT', 'BACKGROUND', 'CAMERA', 'STEREO', 'DISPARITY', 'UNITS', 'INCLUDE')
KEYWORDS = frozenset(
    (
        *TRANSFORMS,
        *PROPERTIES,
        *STATEMENTS,
        'UNION',
        'INTERSECT',
        'DIFFERENCE',
        'BLOCK',
        'CYLINDER',
        'SPHERE',
        'CONE',
        'PLANE',
        'NULL',
        'FACES',
        'COLOR',
        'AS',
    )
)


@dataclass(frozen=True)
class Number:
    place: Place
    value: float


@dataclass(frozen=True)
class Name:
    place: Place
    text: str


@dataclass(frozen=True)
class Null:
    place: Place


@dataclass(frozen=True)
class Call:
    """A primitive or a function of numbers."""

    place: Place
    word: str
    arguments: tuple[Expression, ...]


@dataclass(frozen=True)
class Arithmetic:
    place: Place
    sign: str
    left: Expression
    right: Expression


@dataclass(frozen=True)
class Negated:
    place: Place
    operand: Expression


@dataclass(frozen=True)
class Suffix:
    """A transform or a surface property. bare : written without parentheses."""

    place: Place
    word: str
    arguments: tuple[Expression, ...]
    bare: bool = False


@dataclass(frozen=True)
class Step:
    """All but the last operand of a combination, with the operator that follows it."""

    operand: Expression
    suffixes: tuple[Suffix, ...]
    operator: str


@dataclass(frozen=True)
class Combination:
    """``steps`` then ``last``; ``suffixes`` belong to all of it. Without steps it is one operand with its suffixes."""

    place: Place
    steps: tuple[Step, ...]
    last: Expression
    suffixes: tuple[Suffix, ...]


Expression: TypeAlias = Number | Name | Null | Call | Arithmetic | Negated | Combination


@dataclass(frozen=True)
class Definition:
    place: Place
    name: str
    value: Expression


@dataclass(frozen=True)
class Draw:
    place: Place
    value: Expression
    name: Name | None = None


@dataclass(frozen=True)
class Setting:
    """LIGHT, AMBIENT, BACKGROUND, STEREO or DISPARITY; colour : the COLOUR of a light, or None."""

    place: Place
    word: str
    arguments: tuple[Expression, ...]
    colour: tuple[Expression, ...] | None = None


@dataclass(frozen=True)
class Camera:
    place: Place
    clauses: tuple[Suffix, ...]


@dataclass(frozen=True)
class Units:
    place: Place
    unit: str


@dataclass(frozen=True)
class Include:
    place: Place
    path: str


Statement: TypeAlias = Definition | Draw | Setting | Camera | Units | Include


def _at(token: Token) -> Place:
    return Place(token.line, token.column, len(token))


# lark 0.12 has one type argument here, lark 1 has two.
class Build(Transformer):  # type: ignore[type-arg]
    """Grammar rules to nodes; runs inside the LALR parser, so its depth does not depend on the text."""

    def start(self, c: list[Any]) -> Any:
        return c[0]

    def definition(self, c: list[Any]) -> Definition:
        return Definition(_at(c[0]), str(c[0]), c[1])

    def draw(self, c: list[Any]) -> Draw:
        return Draw(c[0].place, c[0], self.name(c[1:]) if len(c) > 1 else None)

    def light(self, c: list[Any]) -> Setting:
        colour = c[2][1] if len(c) == 3 else None
        return Setting(c[0][0], 'LIGHT', c[0][1], colour)

    def ambient(self, c: list[Any]) -> Setting:
        return Setting(_at(c[0]), 'AMBIENT', c[1][1])

    def background(self, c: list[Any]) -> Setting:
        return Setting(c[0][0], 'BACKGROUND', c[0][1])

    def stereo(self, c: list[Any]) -> Setting:
        return Setting(c[0][0], 'STEREO', c[0][1])

    def disparity(self, c: list[Any]) -> Setting:
        return Setting(c[0][0], 'DISPARITY', c[0][1])

    def camera(self, c: list[Any]) -> Camera:
        return Camera(c[0].place, tuple(c))

    def clause(self, c: list[Any]) -> Suffix:
        return Suffix(_at(c[0]), str(c[0]), c[1][1])

    def units(self, c: list[Any]) -> Units:
        return Units(_at(c[0]), str(c[0]))

    def include(self, c: list[Any]) -> Include:
        return Include(_at(c[0]), str(c[0])[1:-1])

    def expression(self, c: list[Any]) -> Expression:
        steps = tuple(node for node in c if isinstance(node, Step))
        last, *suffixes = c[len(steps) :]
        if not steps and not suffixes:
            operand: Expression = last
            return operand
        place = steps[0].operand.place if steps else last.place
        return Combination(place, steps, last, tuple(suffixes))

    def step(self, c: list[Any]) -> Step:
        return Step(c[0], tuple(c[1:-1]), str(c[-1]))

    def suffix(self, c: list[Any]) -> Suffix:
        word, bare = c[0], len(c) == 1
        return Suffix(_at(word), 'COLOUR' if word == 'COLOR' else str(word), () if bare else c[1][1], bare)

    def arithmetic(self, c: list[Any]) -> Arithmetic:
        return Arithmetic(c[0].place, str(c[1]), c[0], c[2])

    def sign(self, c: list[Any]) -> Expression:
        *signs, operand = c
        negative = sum(str(sign) == '-' for sign in signs) % 2
        return Negated(_at(signs[0]), operand) if negative else operand

    def number(self, c: list[Any]) -> Number:
        return Number(_at(c[0]), float(c[0]))

    def name(self, c: list[Any]) -> Name:
        return Name(_at(c[0]), str(c[0]))

    def null(self, c: list[Any]) -> Null:
        return Null(_at(c[0]))

    def call(self, c: list[Any]) -> Call:
        return Call(_at(c[0]), str(c[0]), c[1][1])

    def group(self, c: list[Any]) -> Expression:
        # Parentheses close a combination to the suffixes that follow; a single operand needs no closing.
        inside: Expression = c[0]
        return inside

    def arguments(self, c: list[Any]) -> tuple[Place, tuple[Expression, ...]]:
        return (c[0].place if c else Place(1, 1), tuple(c))
