"""Expressions of the language to numbers and solids, in the setting of the file they stand in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from msgs_py.numeric.typed import FloatArray

from ..scene.solid import Solid
from ..scene.textures import MAPPINGS, Texture
from . import ast
from .errors import Place, SceneError, did_you_mean
from .includes import Includes
from .paint import paint_work
from .parser import Source, Statement
from .settings import FLATTENED, LARGEST_ELEMENT, MAX_PRIMITIVES, MAX_WORK
from .values import (
    CONSTANTS,
    FUNCTIONS,
    PRIMITIVES,
    UNITS,
    Shape,
    paint,
    primitive,
    terrain,
    texture_numbers,
    transform,
)

Value = float | Shape


@dataclass
class Entry:
    """A defined name. value is None when its definition was wrong, which is reported only once."""

    value: Value | None
    where: str
    imported: bool = False
    used: bool = False


class Skip(SceneError):
    """A consequence of an error that is reported already."""

    def __init__(self, error: SceneError) -> None:
        super().__init__(
            error.line,
            error.column,
            error.message,
            error.hint,
            file=error.file,
            source=error.source,
            length=error.length,
        )


class Expressions:
    """What an expression means, given the names, unit and place of the statement it stands in.

    work : a list of one number, shared by all files of a scene: primitives moved and painted so far
    includes, path : the files of the scene, and which of them this is
    """

    def __init__(self, source: Source, work: list[int], includes: Includes, path: Path | None) -> None:
        self.source = source
        self.work = work
        self.includes = includes
        self.path = path
        self.names: dict[str, Entry] = {}
        self.later: set[str] = set()
        self.per_metre = UNITS['MM']
        self.lengths_used = False
        self.statement = Statement(ast.Units(Place(1, 1), 'MM'), Place(1, 1))

    def _fail(self, place: Place, message: str, hint: str = '') -> SceneError:
        return self.source.error(self.statement.locate(place), message, hint)

    def _where(self, place: Place) -> str:
        at = self.statement.locate(place)
        return f'{self.source.file or "scene"}:{at.line}:{at.column}'

    def _value(self, node: ast.Expression) -> Value:
        if isinstance(node, ast.Number):
            return self._finite(node.value, node.place)
        if isinstance(node, ast.Name):
            return self._named(node)
        if isinstance(node, ast.Null):
            return Shape(Solid.empty(), 0)
        if isinstance(node, ast.Call):
            return self._call(node)
        if isinstance(node, ast.Sheet):
            return self._terrain(node)
        if isinstance(node, ast.Negated):
            return -self._number(node.operand, 'a sign')
        if isinstance(node, ast.Arithmetic):
            return self._arithmetic(node)
        return self._combination(node)

    def _number(self, node: ast.Expression, user: str = '') -> float:
        value = self._value(node)
        if isinstance(value, Shape):
            hint = 'solids are combined with UNION, INTERSECT and DIFFERENCE' if user else ''
            raise self._fail(node.place, 'expected a number, this is a solid', hint)
        return value

    def _solid(self, node: ast.Expression) -> Shape:
        value = self._value(node)
        if not isinstance(value, Shape):
            raise self._fail(node.place, 'expected a solid, this is a number')
        return value

    def _named(self, node: ast.Name) -> Value:
        if node.text in CONSTANTS:
            return CONSTANTS[node.text]
        entry = self.names.get(node.text)
        if entry is None:
            if node.text in self.later:
                raise self._fail(
                    node.place, f'{node.text!r} is used before it is defined', 'names are defined from top to bottom'
                )
            raise self._fail(
                node.place,
                f'{node.text!r} is not defined',
                did_you_mean(node.text, [*self.names, *self.later, *CONSTANTS]),
            )
        entry.used = True
        if entry.value is None:
            raise Skip(self._fail(node.place, f'{node.text!r} has an error in its definition'))
        return entry.value

    def _call(self, node: ast.Call) -> Value:
        if node.word not in PRIMITIVES and node.word not in FUNCTIONS:
            raise self._fail(
                node.place,
                f'{node.word!r} is no primitive and no function',
                did_you_mean(node.word, [*PRIMITIVES, *FUNCTIONS]),
            )
        numbers = [self._number(argument) for argument in node.arguments]
        try:
            if node.word in PRIMITIVES:
                self.lengths_used = True
                return Shape(primitive(node.word, numbers, self.per_metre), 1)
            count, function = FUNCTIONS[node.word]
            if len(numbers) != count:
                raise ValueError(f'{node.word} takes {count} number{"s" * (count > 1)}, got {len(numbers)}')
            return self._finite(float(function(*numbers)), node.place)
        except SceneError:
            raise
        except ValueError as error:
            message = str(error)
            if node.word in FUNCTIONS and not message.startswith(node.word):
                message = f'{node.word} is not defined for {", ".join(f"{n:g}" for n in numbers)}'
            raise self._fail(node.place, message) from None

    def _terrain(self, node: ast.Sheet) -> Shape:
        numbers = [self._number(argument) for argument in node.arguments]
        self.lengths_used = self.lengths_used or bool(numbers)
        try:
            grid, path = self.includes.heights(node.path, self.path)
            return Shape(terrain(grid, path, numbers, node.bilinear, self.per_metre), 1, sheet=True)
        except ValueError as error:
            raise self._fail(node.place, str(error)) from None

    def _arithmetic(self, node: ast.Arithmetic) -> float:
        # Long sums lean to the left: unrolled, so that their length costs no stack.
        chain: list[ast.Arithmetic] = []
        first: ast.Expression = node
        while isinstance(first, ast.Arithmetic):
            chain.append(first)
            first = first.left
        total = self._number(first, 'a sign')
        for part in reversed(chain):
            other = self._number(part.right, 'a sign')
            if part.sign == '/' and other == 0.0:
                raise self._fail(part.right.place, 'division by zero')
            total = (
                {'+': total + other, '-': total - other, '*': total * other}[part.sign]
                if part.sign != '/'
                else total / other
            )
            self._finite(total, part.place)
        return total

    def _finite(self, value: float, place: Place) -> float:
        if not math.isfinite(value):
            raise self._fail(place, 'this number is too large')
        return value

    def _combination(self, node: ast.Combination) -> Value:
        if not node.steps and not node.suffixes:
            return self._value(node.last)
        operators = [step.operator for step in node.steps]
        shapes = []
        for operand, suffixes in [*((step.operand, step.suffixes) for step in node.steps), (node.last, ())]:
            shapes.append(self._suffixed(self._solid(operand), suffixes)[1])
        # INTERSECT binds tighter than UNION and DIFFERENCE, which go from left to right.
        terms, between = [shapes[0]], []
        for operator, shape in zip(operators, shapes[1:]):
            if operator == 'INTERSECT':
                terms[-1] = self._combined(operator, terms[-1], shape, node)
            else:
                terms.append(shape)
                between.append(operator)
        result = terms[0]
        for operator, shape in zip(between, terms[1:]):
            result = self._combined(operator, result, shape, node)
        return self._suffixed(result, node.suffixes)[1]

    def _combined(self, operator: str, left: Shape, right: Shape, node: ast.Combination) -> Shape:
        sheet = left.sheet or right.sheet
        if sheet and operator != 'UNION':
            raise self._fail(
                node.place,
                f'a TERRAIN is a sheet without volume and takes no part in {operator}',
                'UNION it with what is finished, or DRAW it as an object of its own',
            )
        if left.leaves + right.leaves > MAX_PRIMITIVES:
            raise self._fail(node.place, f'this solid has more than {MAX_PRIMITIVES} primitives')
        solid = {'UNION': left.solid.__or__, 'INTERSECT': left.solid.__and__, 'DIFFERENCE': left.solid.__sub__}[
            operator
        ](right.solid)
        empty = operator == 'INTERSECT' and not (left.leaves and right.leaves)
        kept_left_only = operator == 'DIFFERENCE' and not left.leaves
        return Shape(solid, 0 if empty or kept_left_only else left.leaves + right.leaves, sheet)

    def _suffixed(
        self, shape: Shape, suffixes: Sequence[ast.Suffix], separate: bool = False
    ) -> tuple[np.ndarray, Shape]:
        """The suffixes applied in order. separate : return the transforms as a matrix instead of applying them.

        Paint does not depend on place, so all transforms of a list can be applied as one.
        """
        matrix = np.eye(4)
        solid = shape.solid
        moved = False
        for suffix in suffixes:
            numbers = [self._number(argument) for argument in suffix.arguments]
            try:
                if suffix.word in ast.TRANSFORMS:
                    self.lengths_used |= suffix.word in ('AT', 'MATRIX')
                    matrix = transform(suffix.word, numbers, self.per_metre) @ matrix
                    moved = True
                    self._check_matrix(matrix)
                elif suffix.mapping is not None:
                    self._spend(shape.leaves, suffix)
                    solid = self._textured(solid, suffix, suffix.mapping, numbers, matrix)
                else:
                    if suffix.word.startswith('PAINT') and not suffix.bare and not numbers:
                        what = (
                            'a colour for each face' if suffix.word == 'PAINT FACES' else 'heights with their colours'
                        )
                        raise ValueError(f'{suffix.word} takes no parentheses, or {what} in them')
                    self.lengths_used |= suffix.word == 'PAINT HEIGHTS' and not suffix.bare
                    faces = suffix.word == 'PAINT FACES' and suffix.bare
                    self._spend(paint_work(shape.leaves) if faces else shape.leaves, suffix)
                    solid = paint(solid, suffix.word, numbers, self.per_metre)
            except SceneError:
                raise
            except ValueError as error:
                raise self._fail(suffix.place, str(error)) from None
        if moved and not separate:
            self._spend(shape.leaves, suffixes[0])
            try:
                solid = solid.transformed(matrix)
            except ValueError as error:
                raise self._fail(suffixes[0].place, str(error)) from None
        return matrix, Shape(solid, shape.leaves, shape.sheet)

    def _textured(
        self, solid: Solid, suffix: ast.Suffix, mapping: ast.Name, numbers: list[float], matrix: FloatArray
    ) -> Solid:
        """A solid that ``matrix`` will have moved, with a TEXTURE. Raises ValueError with a message for the user."""
        if mapping.text.lower() not in MAPPINGS or not mapping.text.isupper():
            words = [word.upper() for word in MAPPINGS]
            raise self._fail(
                mapping.place,
                f'TEXTURE has no mapping {mapping.text!r}, expected {", ".join(words)}',
                did_you_mean(mapping.text, words),
            )
        self.lengths_used = True
        sizes, placement = texture_numbers(mapping.text, numbers, self.per_metre)
        image, path = self.includes.picture(suffix.path, self.path, 'TEXTURE')
        return solid.textured(Texture(image, mapping.text.lower(), sizes, path), placement @ matrix)

    @staticmethod
    def _check_matrix(matrix: np.ndarray) -> None:
        linear = matrix[:3, :3]
        largest = np.abs(linear).max()
        if not np.abs(matrix).max() <= LARGEST_ELEMENT:
            raise ValueError('these transforms together are too large')
        if not largest > 0.0 or abs(np.linalg.det(linear / largest)) <= FLATTENED:
            raise ValueError('these transforms together flatten the solid to nothing')

    def _spend(self, work: int, suffix: ast.Suffix) -> None:
        self.work[0] += work
        if self.work[0] > MAX_WORK:
            raise self._fail(
                suffix.place,
                'the file moves and paints too many primitives',
                f'at most {MAX_WORK}, a PAINT FACES counts for up to 2000; does a name double itself?',
            )
