"""Statements to a scene: names, numbers, solids, and everything that can be wrong with them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from msgs_py import PinholeCamera, Pose

from ..scene import Light, Placement, Scene
from ..solid import Solid
from . import ast
from .camera import CLAUSES, camera_of
from .errors import Place, SceneError, did_you_mean
from .includes import Includes
from .paint import paint_work
from .parser import MAX_ERRORS, Broken, Source, Statement, parse_statements
from .values import (
    CONSTANTS,
    FUNCTIONS,
    MAX_PRIMITIVES,
    MAX_WORK,
    PRIMITIVES,
    UNITS,
    Shape,
    colour_of,
    length,
    paint,
    primitive,
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


@dataclass
class Drawing:
    """What the statements of the first file add up to."""

    placements: list[Placement] = field(default_factory=list)
    leaves: int = 0
    # Names of objects, each with the last number that was put behind it.
    taken: dict[str, int] = field(default_factory=dict)
    lights: list[Light] = field(default_factory=list)
    ambient: tuple[float, float, float] = (0.2, 0.2, 0.2)
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    camera: PinholeCamera | None = None
    camera_T_scene: Pose | None = None
    target_distance: float | None = None
    baseline: float | None = None
    disparity: tuple[float, float | None] | None = None


class Evaluator:
    """Evaluates one file; included files have evaluators of their own that share errors, includes and the work done."""

    def __init__(self, source: Source, includes: Includes, path: Path | None = None,
                 errors: list[SceneError] | None = None, work: list[int] | None = None) -> None:
        self.source = source
        self.path = path
        self.includes = includes
        self.errors = errors if errors is not None else []
        self.work = work if work is not None else [0]
        self.warnings: list[str] = []
        self.names: dict[str, Entry] = {}
        self.drawing = Drawing()
        self.per_metre = UNITS['MM']
        self.lengths_used = False
        self.once: dict[str, int] = {}
        self.statement = Statement(ast.Units(Place(1, 1), 'MM'), Place(1, 1))
        self.later: set[str] = set()

    # -- running ------------------------------------------------------------------------------------------------------

    def run(self, *, main: bool) -> None:
        """Evaluate all statements; errors are collected. main : DRAW, LIGHT, CAMERA, ... count (not in an include)."""
        statements, errors = parse_statements(self.source)
        self.errors += errors
        nodes = [statement.node for statement in statements if isinstance(statement, Statement)]
        self.later = {node.name for node in nodes if isinstance(node, ast.Definition)}
        for statement in statements:
            if isinstance(statement, Broken):
                for name in statement.names:
                    self.names.setdefault(name, Entry(None, '', used=True))
                continue
            self.statement = statement
            try:
                self._execute(statement.node, main)
            except SceneError as error:
                self.errors.append(error)
                if isinstance(statement.node, ast.Definition):
                    self.names.setdefault(statement.node.name, Entry(None, '', used=True))
            if len(self.errors) >= MAX_ERRORS:
                return
        if main and not self.errors:
            self._finish()

    def _finish(self) -> None:
        self._set_baseline()
        if not self.drawing.placements:
            if not self.names:
                self.warnings.append(f'{self.source.file or "scene"}: nothing is drawn')
            return
        for name, entry in self.names.items():
            if not entry.used and not entry.imported:
                self.warnings.append(f'{entry.where}: {name!r} is never used')

    def scene(self) -> Scene:
        drawing = self.drawing
        definitions = {name: entry.value.solid for name, entry in self.names.items() if isinstance(entry.value, Shape)}
        return Scene(drawing.placements, drawing.lights, drawing.ambient, drawing.background, definitions=definitions,
                     camera=drawing.camera, camera_T_scene=drawing.camera_T_scene, baseline=drawing.baseline)

    def _fail(self, place: Place, message: str, hint: str = '') -> SceneError:
        return self.source.error(self.statement.locate(place), message, hint)

    def _where(self, place: Place) -> str:
        at = self.statement.locate(place)
        return f'{self.source.file or "scene"}:{at.line}:{at.column}'

    # -- statements ---------------------------------------------------------------------------------------------------

    def _execute(self, node: ast.Statement, main: bool) -> None:
        if isinstance(node, ast.Definition):
            self._define(node)
        elif isinstance(node, ast.Include):
            self._include(node)
        elif isinstance(node, ast.Units):
            self._units(node)
        elif isinstance(node, ast.Draw):
            self._draw(node, main)
        elif isinstance(node, ast.Camera):
            self._camera(node)
        else:
            self._setting(node)

    def _define(self, node: ast.Definition) -> None:
        known = self.names.get(node.name)
        if known is not None and known.where:
            raise self._fail(node.place, f'{node.name!r} is defined already', f'first defined at {known.where}')
        if node.name in CONSTANTS or node.name in FUNCTIONS:
            raise self._fail(node.place, f'{node.name!r} is built in and cannot be defined')
        self.names[node.name] = Entry(self._value(node.value), self._where(node.place))

    def _units(self, node: ast.Units) -> None:
        self._only_once('UNITS', node.place)
        if node.unit not in UNITS:
            raise self._fail(node.place, f'unknown unit {node.unit!r}, expected {", ".join(UNITS)}',
                             did_you_mean(node.unit, UNITS))
        if self.lengths_used:
            raise self._fail(node.place, 'UNITS must stand before the first length of the file')
        self.per_metre = UNITS[node.unit]

    def _include(self, node: ast.Include) -> None:
        try:
            known = self.includes.known(node.path, self.path)
            if known is not None:
                self._import(node, known)
                return
            source, path = self.includes.open(node.path, self.path)
        except SceneError:
            raise
        except ValueError as error:
            raise self._fail(node.place, str(error)) from None
        inner = Evaluator(source, self.includes, path, self.errors, self.work)
        inner.run(main=False)
        self.includes.close(path, inner.names)
        self._import(node, inner.names)

    def _import(self, node: ast.Include, names: dict[str, Entry]) -> None:
        for name, entry in names.items():
            known = self.names.get(name)
            if known is None:
                self.names[name] = Entry(entry.value, entry.where, imported=True)
            elif known.where != entry.where and known.where and entry.where:
                raise self._fail(node.place, f'this file defines {name!r}, which is defined already',
                                 f'defined at {known.where} and {entry.where}')

    def _draw(self, node: ast.Draw, main: bool) -> None:
        value = node.value
        suffixes: tuple[ast.Suffix, ...] = ()
        if isinstance(value, ast.Combination):
            # The suffixes of the statement are the pose; what stands inside parentheses is the model.
            value, suffixes = ast.Combination(value.place, value.steps, value.last, ()), value.suffixes
        shape = self._solid(value)
        matrix, shape = self._suffixed(shape, suffixes, separate=True)
        if not main:
            return
        bare = value.last if isinstance(value, ast.Combination) and not value.steps else value
        name = bare.text if isinstance(bare, ast.Name) else 'object'
        drawing = self.drawing
        if node.name is not None:
            name = node.name.text
            if name in drawing.taken:
                raise self._fail(node.name.place, f'another object is drawn as {name!r} already')
        unique, number = name, drawing.taken.get(name, 1)
        while unique in drawing.taken:
            number += 1
            unique = f'{name}_{number}'
        drawing.taken.update({unique: 1, name: number})
        drawing.leaves += shape.leaves
        if drawing.leaves > MAX_PRIMITIVES:
            raise self._fail(node.place, f'the scene has more than {MAX_PRIMITIVES} primitives')
        drawing.placements.append(Placement(unique, shape.solid, matrix))

    def _setting(self, node: ast.Setting) -> None:
        numbers = [self._number(argument) for argument in node.arguments]
        drawing = self.drawing
        try:
            if node.word == 'LIGHT':
                if len(numbers) != 3:
                    raise ValueError(f'LIGHT takes 3 numbers (position x, y, z), got {len(numbers)}')
                colour = (1.0, 1.0, 1.0)
                if node.colour is not None:
                    colour = colour_of('COLOUR', [self._number(argument) for argument in node.colour])
                self.lengths_used = True
                x, y, z = (length(n, self.per_metre, 'position') for n in numbers)
                drawing.lights.append(Light((x, y, z), colour))
            elif node.word == 'AMBIENT':
                self._only_once(node.word, node.place)
                drawing.ambient = colour_of(node.word, numbers)
            elif node.word == 'BACKGROUND':
                self._only_once(node.word, node.place)
                drawing.background = colour_of(node.word, numbers)
            elif node.word == 'STEREO':
                self._only_once('STEREO', node.place)
                if len(numbers) != 1 or not numbers[0] > 0.0:
                    raise ValueError('STEREO takes one number > 0, the distance between the eyes')
                self.lengths_used = True
                drawing.baseline = length(numbers[0], self.per_metre, 'baseline')
            else:
                self._only_once('DISPARITY', node.place)
                if len(numbers) not in (1, 2) or not min(numbers) > 0.0:
                    raise ValueError('DISPARITY takes 1 or 2 numbers > 0 (pixels, and the depth they are seen at)')
                self.lengths_used = True
                depth = length(numbers[1], self.per_metre, 'depth') if len(numbers) == 2 else None
                drawing.disparity = (numbers[0], depth)
        except SceneError:
            raise
        except ValueError as error:
            raise self._fail(node.place, str(error)) from None

    def _camera(self, node: ast.Camera) -> None:
        self._only_once('CAMERA', node.place)
        clauses: dict[str, list[float]] = {}
        for clause in node.clauses:
            if clause.word not in CLAUSES:
                raise self._fail(clause.place, f'CAMERA has no {clause.word!r}, expected {", ".join(CLAUSES)}',
                                 did_you_mean(clause.word, CLAUSES))
            if clause.word in clauses:
                raise self._fail(clause.place, f'{clause.word} stands twice in this CAMERA')
            counts, meaning = CLAUSES[clause.word]
            if len(clause.arguments) not in counts:
                raise self._fail(clause.place, f'{clause.word} takes {" or ".join(map(str, counts))} number'
                                 f'{"s" * (counts != (1,))} ({meaning}), got {len(clause.arguments)}')
            clauses[clause.word] = [self._number(argument) for argument in clause.arguments]
        self.lengths_used = True
        try:
            camera, pose, distance = camera_of(clauses, self.per_metre)
        except ValueError as error:
            raise self._fail(node.place, str(error)) from None
        self.drawing.camera, self.drawing.camera_T_scene, self.drawing.target_distance = camera, pose, distance

    def _set_baseline(self) -> None:
        """DISPARITY is another way to say the baseline, once the camera is known."""
        drawing = self.drawing
        if drawing.disparity is None:
            return
        pixels, depth = drawing.disparity
        depth = depth if depth is not None else drawing.target_distance
        line = self.once['DISPARITY']
        message = ''
        if drawing.baseline is not None:
            message = 'STEREO and DISPARITY both give the baseline, use one'
        elif drawing.camera is None:
            message = 'DISPARITY needs a CAMERA, whose focal length relates pixels to distance'
        elif depth is None:
            message = 'DISPARITY needs a depth: DISPARITY(pixels, depth), or a CAMERA with TO(x, y, z)'
        else:
            drawing.baseline = pixels * depth / drawing.camera.fx
        if message:
            self.errors.append(self.source.error(Place(line, 1), message))

    def _only_once(self, word: str, place: Place) -> None:
        line = self.statement.locate(place).line
        if word in self.once:
            raise self._fail(place, f'{word} stands twice', f'first on line {self.once[word]}')
        self.once[word] = line

    # -- expressions --------------------------------------------------------------------------------------------------

    def _value(self, node: ast.Expression) -> Value:
        if isinstance(node, ast.Number):
            return self._finite(node.value, node.place)
        if isinstance(node, ast.Name):
            return self._named(node)
        if isinstance(node, ast.Null):
            return Shape(Solid.empty(), 0)
        if isinstance(node, ast.Call):
            return self._call(node)
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
                raise self._fail(node.place, f'{node.text!r} is used before it is defined',
                                 'names are defined from top to bottom')
            raise self._fail(node.place, f'{node.text!r} is not defined',
                             did_you_mean(node.text, [*self.names, *self.later, *CONSTANTS]))
        entry.used = True
        if entry.value is None:
            raise Skip(self._fail(node.place, f'{node.text!r} has an error in its definition'))
        return entry.value

    def _call(self, node: ast.Call) -> Value:
        if node.word not in PRIMITIVES and node.word not in FUNCTIONS:
            raise self._fail(node.place, f'{node.word!r} is no primitive and no function',
                             did_you_mean(node.word, [*PRIMITIVES, *FUNCTIONS]))
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
            total = {'+': total + other, '-': total - other, '*': total * other}[part.sign] if part.sign != '/' \
                else total / other
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
        if left.leaves + right.leaves > MAX_PRIMITIVES:
            raise self._fail(node.place, f'this solid has more than {MAX_PRIMITIVES} primitives')
        solid = {'UNION': left.solid.__or__, 'INTERSECT': left.solid.__and__,
                 'DIFFERENCE': left.solid.__sub__}[operator](right.solid)
        empty = operator == 'INTERSECT' and not (left.leaves and right.leaves)
        kept_left_only = operator == 'DIFFERENCE' and not left.leaves
        return Shape(solid, 0 if empty or kept_left_only else left.leaves + right.leaves)

    def _suffixed(self, shape: Shape, suffixes: Sequence[ast.Suffix],
                  separate: bool = False) -> tuple[np.ndarray, Shape]:
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
                else:
                    if suffix.word == 'PAINT' and not suffix.bare and not numbers:
                        raise ValueError('PAINT FACES takes no parentheses, or a colour for each face in them')
                    faces = suffix.word == 'PAINT' and suffix.bare
                    self._spend(paint_work(shape.leaves) if faces else shape.leaves, suffix)
                    solid = paint(solid, suffix.word, numbers)
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
        return matrix, Shape(solid, shape.leaves)

    @staticmethod
    def _check_matrix(matrix: np.ndarray) -> None:
        linear = matrix[:3, :3]
        largest = np.abs(linear).max()
        if not np.abs(matrix).max() <= 1e12:
            raise ValueError('these transforms together are too large')
        if not largest > 0.0 or abs(np.linalg.det(linear / largest)) <= 1e-12:
            raise ValueError('these transforms together flatten the solid to nothing')

    def _spend(self, work: int, suffix: ast.Suffix) -> None:
        self.work[0] += work
        if self.work[0] > MAX_WORK:
            raise self._fail(suffix.place, 'the file moves and paints too many primitives',
                             f'at most {MAX_WORK}, a PAINT FACES counts for up to 1000; does a name double itself?')


class Skip(SceneError):
    """A consequence of an error that is reported already."""

    def __init__(self, error: SceneError) -> None:
        super().__init__(error.line, error.column, error.message, error.hint, file=error.file, source=error.source,
                         length=error.length)
