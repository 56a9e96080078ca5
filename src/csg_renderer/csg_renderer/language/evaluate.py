"""Statements to a scene: definitions, includes, what is drawn, lit and looked from, and what can be wrong with them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path

from msgs_py import PinholeCamera, Pose

from ..scene.scene import Light, Placement, Scene
from ..scene.settings import DEFAULT_AMBIENT, DEFAULT_BACKGROUND
from ..scene.solid import Empty
from ..scene.textures import Environment
from . import ast
from .camera import CLAUSES, camera_of
from .errors import Place, SceneError, did_you_mean
from .expressions import Entry, Expressions
from .includes import Includes
from .parser import Broken, Source, Statement, parse_statements
from .settings import LARGEST, MAX_ERRORS, MAX_PRIMITIVES
from .values import CONSTANTS, FUNCTIONS, UNITS, Shape, colour_of, length

# What may stand behind the position of a LIGHT.
LIGHT_PROPERTIES = ('COLOUR', 'RADIUS')


@dataclass
class Drawing:
    """What the statements of the first file add up to."""

    placements: list[Placement] = field(default_factory=list)
    leaves: int = 0
    # Names of objects, each with the last number that was put behind it.
    taken: dict[str, int] = field(default_factory=dict)
    lights: list[Light] = field(default_factory=list)
    environment: Environment | None = None
    ambient: tuple[float, float, float] = DEFAULT_AMBIENT
    background: tuple[float, float, float] = DEFAULT_BACKGROUND
    camera: PinholeCamera | None = None
    camera_T_scene: Pose | None = None
    target_distance: float | None = None
    baseline: float | None = None
    disparity: tuple[float, float | None] | None = None


class Evaluator(Expressions):
    """Evaluates one file; included files have evaluators of their own that share errors, includes and the work done."""

    def __init__(
        self,
        source: Source,
        includes: Includes,
        path: Path | None = None,
        errors: list[SceneError] | None = None,
        work: list[int] | None = None,
    ) -> None:
        super().__init__(source, work if work is not None else [0], includes, path)
        self.errors = errors if errors is not None else []
        self.warnings: list[str] = []
        self.drawing = Drawing()
        self.once: dict[str, int] = {}

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
        """The scene that the statements add up to."""
        drawing = self.drawing
        definitions = {name: entry.value.solid for name, entry in self.names.items() if isinstance(entry.value, Shape)}
        return Scene(
            drawing.placements,
            drawing.lights,
            drawing.ambient,
            drawing.background,
            definitions=definitions,
            camera=drawing.camera,
            camera_T_scene=drawing.camera_T_scene,
            baseline=drawing.baseline,
            environment=drawing.environment,
        )

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
        elif isinstance(node, ast.Frame):
            self._frame(node, main)
        elif isinstance(node, ast.Camera):
            self._camera(node)
        elif isinstance(node, ast.Environment):
            self._environment(node)
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
            raise self._fail(
                node.place, f'unknown unit {node.unit!r}, expected {", ".join(UNITS)}', did_you_mean(node.unit, UNITS)
            )
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
                raise self._fail(
                    node.place,
                    f'this file defines {name!r}, which is defined already',
                    f'defined at {known.where} and {entry.where}',
                )

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

    def _frame(self, node: ast.Frame, main: bool) -> None:
        """A named frame of the object drawn last, in the frame of its model: where to grip it, say."""
        for suffix in node.suffixes:
            if suffix.word not in ast.TRANSFORMS or suffix.word == 'SCALE':
                raise self._fail(suffix.place, f'{suffix.word} is nothing that a FRAME has, it stands and is turned')
        matrix = self._suffixed(Shape(Empty(), 0), node.suffixes, separate=True)[0]
        try:
            frame = Pose(matrix[:3, :3], matrix[:3, 3])
        except ValueError as error:
            raise self._fail(node.suffixes[0].place, f'a FRAME is a rotation and a position: {error}') from None
        if not main:
            return
        placements = self.drawing.placements
        if not placements:
            raise self._fail(node.place, 'a FRAME is on the object drawn before it, and nothing is drawn yet')
        last = placements[-1]
        if node.name in last.frames:
            raise self._fail(node.place, f'{last.name} has another FRAME {node.name!r} already')
        placements[-1] = replace(last, frames={**last.frames, node.name: frame})

    def _setting(self, node: ast.Setting) -> None:
        numbers = [self._number(argument) for argument in node.arguments]
        drawing = self.drawing
        try:
            if node.word == 'LIGHT':
                drawing.lights.append(self._light(node, numbers))
            elif node.word == 'AMBIENT':
                self._only_once(node.word, node.place)
                drawing.ambient = colour_of(node.word, numbers)
            elif node.word == 'BACKGROUND':
                self._only_once(node.word, node.place)
                drawing.background = colour_of(node.word, numbers)
            elif node.word == 'STEREO':
                self._only_once('STEREO', node.place)
                if len(numbers) != 1 or not numbers[0] > 0.0:
                    raise ValueError('STEREO takes one number > 0, the distance of the two cameras')
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

    def _check_clause(
        self, statement: str, clause: ast.Suffix, known: Collection[str], said: Collection[str], between: str
    ) -> None:
        """That a statement knows a clause and has not had it; between : the known ones where they are listed."""
        if clause.word not in known:
            raise self._fail(
                clause.place,
                f'{statement} has no {clause.word!r}, expected {between.join(known)}',
                did_you_mean(clause.word, known),
            )
        if clause.word in said:
            raise self._fail(clause.place, f'{clause.word} stands twice in this {statement}')

    def _light(self, node: ast.Setting, numbers: list[float]) -> Light:
        """Raises ValueError with a message for the user."""
        if len(numbers) != 3:
            raise ValueError(f'LIGHT takes 3 numbers (position x, y, z), got {len(numbers)}')
        self.lengths_used = True
        x, y, z = (length(n, self.per_metre, 'position') for n in numbers)
        said: dict[str, list[float]] = {}
        for clause in node.properties:
            self._check_clause('LIGHT', clause, LIGHT_PROPERTIES, said, ' or ')
            said[clause.word] = [self._number(argument) for argument in clause.arguments]
        colour = colour_of('COLOUR', said['COLOUR']) if 'COLOUR' in said else (1.0, 1.0, 1.0)
        if 'RADIUS' not in said:
            return Light((x, y, z), colour)
        if len(said['RADIUS']) != 1:
            raise ValueError(f'RADIUS takes 1 number, got {len(said["RADIUS"])}')
        return Light((x, y, z), colour, length(said['RADIUS'][0], self.per_metre, 'radius'))

    def _environment(self, node: ast.Environment) -> None:
        self._only_once('ENVIRONMENT', node.place)
        numbers = [self._number(argument) for argument in node.arguments]
        try:
            if len(numbers) not in (0, 1, 4):
                raise ValueError(
                    f'ENVIRONMENT takes 1 or 4 numbers (brightness, and what is up x, y, z), got {len(numbers)}'
                )
            image, path = self.includes.picture(node.path, self.path, 'ENVIRONMENT')
            up = (numbers[1], numbers[2], numbers[3]) if len(numbers) == 4 else (0.0, -1.0, 0.0)
            if numbers and not numbers[0] <= LARGEST:
                raise ValueError(f'brightness: at most {LARGEST:g} makes sense, got {numbers[0]:g}')
            if max(map(abs, up)) > LARGEST:
                raise ValueError('up: the direction is too long')
            self.drawing.environment = Environment(image, numbers[0] if numbers else 1.0, up, file=path)
        except ValueError as error:
            raise self._fail(node.place, str(error)) from None

    def _camera(self, node: ast.Camera) -> None:
        self._only_once('CAMERA', node.place)
        clauses: dict[str, list[float]] = {}
        for clause in node.clauses:
            self._check_clause('CAMERA', clause, CLAUSES, clauses, ', ')
            counts, meaning = CLAUSES[clause.word]
            if len(clause.arguments) not in counts:
                raise self._fail(
                    clause.place,
                    f'{clause.word} takes {" or ".join(map(str, counts))} number'
                    f'{"s" * (counts != (1,))} ({meaning}), got {len(clause.arguments)}',
                )
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
