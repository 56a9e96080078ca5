"""The parsed statements, and their making from the grammar's rules.

Every node has a ``place`` relative to the start of its statement.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

from lark import Token, Transformer

from .errors import Place

TRANSFORMS = ('XROT', 'YROT', 'ZROT', 'SCALE', 'AT', 'MATRIX')
PROPERTIES = (
    'COLOUR',
    'AMBIENT',
    'DIFFUSE',
    'SPECULAR',
    'SHININESS',
    'REFLECT',
    'TRANSPARENT',
    'METAL',
    'PAINT',
    'TEXTURE',
)
STATEMENTS = (
    'DRAW',
    'FRAME',
    'LIGHT',
    'AMBIENT',
    'BACKGROUND',
    'ENVIRONMENT',
    'CAMERA',
    'STEREO',
    'DISPARITY',
    'UNITS',
    'INCLUDE',
)
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
        'TERRAIN',
        'BILINEAR',
        'FACETED',
        'NULL',
        'FACES',
        'HEIGHTS',
        'COLOR',
        'AS',
    )
)


@dataclass(frozen=True)
class Number:
    """A number as it was written; place : where."""

    place: Place
    value: float


@dataclass(frozen=True)
class Name:
    """A name that is used."""

    place: Place
    text: str


@dataclass(frozen=True)
class Null:
    """The word NULL: a solid without points."""

    place: Place


@dataclass(frozen=True)
class Call:
    """A primitive or a function of numbers."""

    place: Place
    word: str
    arguments: tuple[Expression, ...]


@dataclass(frozen=True)
class Sheet:
    """A TERRAIN: the path of its file without quotes, its sizes, and whether its cells are bilinear."""

    place: Place
    path: str
    arguments: tuple[Expression, ...]
    bilinear: bool = False


@dataclass(frozen=True)
class Arithmetic:
    """Two numbers and the sign between them: + - * / or ^."""

    place: Place
    sign: str
    left: Expression
    right: Expression


@dataclass(frozen=True)
class Negated:
    """An odd number of minus signs before an operand."""

    place: Place
    operand: Expression


@dataclass(frozen=True)
class Suffix:
    """A transform or a surface property; ``bare`` when it was written without parentheses.

    A TEXTURE has the path of its file without quotes, and the name of its mapping.
    """

    place: Place
    word: str
    arguments: tuple[Expression, ...]
    bare: bool = False
    path: str = ''
    mapping: Name | None = None


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


Expression: TypeAlias = Number | Name | Null | Call | Sheet | Arithmetic | Negated | Combination


@dataclass(frozen=True)
class Definition:
    """``name = value;``."""

    place: Place
    name: str
    value: Expression


@dataclass(frozen=True)
class Draw:
    """``DRAW value AS name;``; without AS the name is None."""

    place: Place
    value: Expression
    name: Name | None = None


@dataclass(frozen=True)
class Frame:
    """``FRAME name suffixes;``."""

    place: Place
    name: str
    suffixes: tuple[Suffix, ...]


@dataclass(frozen=True)
class Setting:
    """LIGHT, AMBIENT, BACKGROUND, STEREO or DISPARITY; ``properties`` are those of a light."""

    place: Place
    word: str
    arguments: tuple[Expression, ...]
    properties: tuple[Suffix, ...] = ()


@dataclass(frozen=True)
class Environment:
    """``ENVIRONMENT "path" (brightness, up)``, the path without its quotes."""

    place: Place
    path: str
    arguments: tuple[Expression, ...]


@dataclass(frozen=True)
class Camera:
    """``CAMERA``, with its clauses in the order of the text."""

    place: Place
    clauses: tuple[Suffix, ...]


@dataclass(frozen=True)
class Units:
    """``UNITS``: MM, CM or M."""

    place: Place
    unit: str


@dataclass(frozen=True)
class Include:
    """``INCLUDE "path";``, the path without its quotes."""

    place: Place
    path: str


Statement: TypeAlias = Definition | Draw | Frame | Setting | Environment | Camera | Units | Include


def _at(token: Token) -> Place:
    return Place(token.line, token.column, len(token))


# lark 0.12 has one type argument here, lark 1 has two.
class Build(Transformer):  # type: ignore[type-arg]
    """Grammar rules to nodes; runs inside the LALR parser, so its depth does not depend on the text.

    Each method has the name of a rule of grammar.lark and gets the rule's parts, tokens or nodes, in the order of the
    text.
    """

    def start(self, c: list[Any]) -> Any:
        """A statement."""
        return c[0]

    def definition(self, c: list[Any]) -> Definition:
        """A definition, from its name and value."""
        return Definition(_at(c[0]), str(c[0]), c[1])

    def draw(self, c: list[Any]) -> Draw:
        """A DRAW statement, from what is drawn and, perhaps, its name."""
        return Draw(c[0].place, c[0], self.name(c[1:]) if len(c) > 1 else None)

    def frame(self, c: list[Any]) -> Frame:
        """A frame on what is drawn, from its name and transforms."""
        return Frame(_at(c[0]), str(c[0]), tuple(c[1:]))

    def light(self, c: list[Any]) -> Setting:
        """A light, from its position and, perhaps, its colour and radius."""
        return Setting(c[0][0], 'LIGHT', c[0][1], tuple(c[1:]))

    def property(self, c: list[Any]) -> Suffix:
        """A property of a light: a word and its numbers; COLOR is COLOUR."""
        return Suffix(_at(c[0]), {'COLOR': 'COLOUR'}.get(str(c[0]), str(c[0])), c[1][1])

    def environment(self, c: list[Any]) -> Environment:
        """What surrounds the scene, from its file and, perhaps, its brightness."""
        return Environment(_at(c[0]), str(c[0])[1:-1], c[1][1] if len(c) > 1 else ())

    def ambient(self, c: list[Any]) -> Setting:
        """The light that comes from everywhere."""
        return Setting(_at(c[0]), 'AMBIENT', c[1][1])

    def background(self, c: list[Any]) -> Setting:
        """The colour where there is nothing."""
        return Setting(c[0][0], 'BACKGROUND', c[0][1])

    def stereo(self, c: list[Any]) -> Setting:
        """The distance of the second camera."""
        return Setting(c[0][0], 'STEREO', c[0][1])

    def disparity(self, c: list[Any]) -> Setting:
        """The distance of the second camera, from disparities."""
        return Setting(c[0][0], 'DISPARITY', c[0][1])

    def camera(self, c: list[Any]) -> Camera:
        """A camera, from its clauses."""
        return Camera(c[0].place, tuple(c))

    def clause(self, c: list[Any]) -> Suffix:
        """A clause of a camera: a word and its numbers."""
        return Suffix(_at(c[0]), str(c[0]), c[1][1])

    def units(self, c: list[Any]) -> Units:
        """The unit of all lengths that follow."""
        return Units(_at(c[0]), str(c[0]))

    def include(self, c: list[Any]) -> Include:
        """A file to include."""
        return Include(_at(c[0]), str(c[0])[1:-1])

    def expression(self, c: list[Any]) -> Expression:
        """Operands joined by set operators, with the suffixes of all of it."""
        steps = tuple(node for node in c if isinstance(node, Step))
        last, *suffixes = c[len(steps) :]
        if not steps and not suffixes:
            operand: Expression = last
            return operand
        place = steps[0].operand.place if steps else last.place
        return Combination(place, steps, last, tuple(suffixes))

    def step(self, c: list[Any]) -> Step:
        """An operand with its suffixes and the set operator that follows."""
        return Step(c[0], tuple(c[1:-1]), str(c[-1]))

    def suffix(self, c: list[Any]) -> Suffix:
        """A transform or a property; COLOR is COLOUR. PAINT has a second word."""
        words = [part for part in c if isinstance(part, Token)]
        arguments = c[len(words) :]
        name = {'COLOR': 'COLOUR'}.get(str(words[0]), ' '.join(words))
        return Suffix(_at(words[0]), name, arguments[0][1] if arguments else (), not arguments)

    def texture(self, c: list[Any]) -> Suffix:
        """A texture, from its file, the name of its mapping, and sizes."""
        mapping = Name(_at(c[2]), str(c[2]))
        return Suffix(_at(c[0]), 'TEXTURE', c[3][1], path=str(c[1])[1:-1], mapping=mapping)

    def arithmetic(self, c: list[Any]) -> Arithmetic:
        """Two operands and the sign between them."""
        return Arithmetic(c[0].place, str(c[1]), c[0], c[2])

    def sign(self, c: list[Any]) -> Expression:
        """An operand with signs before it; two minus signs are none."""
        *signs, operand = c
        negative = sum(str(sign) == '-' for sign in signs) % 2
        return Negated(_at(signs[0]), operand) if negative else operand

    def number(self, c: list[Any]) -> Number:
        """A number."""
        return Number(_at(c[0]), float(c[0]))

    def name(self, c: list[Any]) -> Name:
        """A name."""
        return Name(_at(c[0]), str(c[0]))

    def null(self, c: list[Any]) -> Null:
        """The empty solid."""
        return Null(_at(c[0]))

    def call(self, c: list[Any]) -> Call:
        """A primitive or a function, with its arguments."""
        return Call(_at(c[0]), str(c[0]), c[1][1])

    def terrain(self, c: list[Any]) -> Sheet:
        """A terrain, from its file, sizes and, perhaps, the shape of its cells."""
        shape = str(c[-1]) if isinstance(c[-1], Token) else ''
        sizes = [part for part in c[2:] if not isinstance(part, Token)]
        return Sheet(_at(c[0]), str(c[1])[1:-1], tuple(sizes), shape == 'BILINEAR')

    def group(self, c: list[Any]) -> Expression:
        """What stands in parentheses."""
        # Parentheses close a combination to the suffixes that follow; a single operand needs no closing.
        inside: Expression = c[0]
        return inside

    def arguments(self, c: list[Any]) -> tuple[Place, tuple[Expression, ...]]:
        """Arguments in parentheses, and where the first of them stands."""
        return (c[0].place if c else Place(1, 1), tuple(c))
