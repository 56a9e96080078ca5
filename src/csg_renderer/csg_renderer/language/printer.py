"""Scenes to text. What is printed parses to the same scene, to the last bit.

Every operand that has a suffix or is a combination stands in parentheses, so the text does not lean on the rules of
precedence. Chains of one operator stay flat; whatever would nest too deep or grow too long gets a name of its own.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from ..scene.scene import Placement, Scene
from ..scene.solid import Empty, Operation, Primitive, Solid, Surface
from ..scene.terrain import Terrain
from ..scene.textures import Environment, Laid
from .ast import KEYWORDS
from .settings import DEEPEST, LONGEST, WIDTH
from .values import CONSTANTS, FUNCTIONS

_PROPERTIES = (
    ('ambient', 'AMBIENT'),
    ('diffuse', 'DIFFUSE'),
    ('specular', 'SPECULAR'),
    ('shininess', 'SHININESS'),
    ('reflection', 'REFLECT'),
    ('transparency', 'TRANSPARENT'),
    ('roughness', 'METAL'),
)
_UNIT_CALLS = {
    'BLOCK': ('BLOCK', '{0}, {0}, {0}'),
    'CYLINDER': ('CYLINDER', '{0}, 0, 0, {0}'),
    'CONE': ('CONE', '{0}, 0, 0, {0}'),
    'SPHERE': ('SPHERE', '{0}'),
    'PLANE': ('PLANE', '0, 0, 1, 0'),
}


def format_scene(scene: Scene) -> str:
    """A scene as one file without includes, in millimetres where that is exact and in metres otherwise.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    str
        Parses to the same scene, to the last bit.

    Raises
    ------
    ValueError
        The language cannot say it: a camera pose with a scale, or without a camera, or a terrain without a file.
    """
    try:
        return _Printer('MM', 1000.0).scene(scene)
    except _Inexact:
        return _Printer('M', 1.0).scene(scene)


class _Inexact(Exception):
    """A length has no decimal in this unit that is read back as the same float."""


@dataclass(frozen=True)
class _Text:
    """A printed solid. operator : of a combination that is not in parentheses, else ''; bare : a name or NULL."""

    text: str
    operator: str = ''
    depth: int = 0

    @property
    def operand(self) -> str:
        return self.text if re.fullmatch(r'\w+', self.text) else f'({self.text})'


class _Printer:
    def __init__(self, unit: str, per_metre: float) -> None:
        self.unit = unit
        self.per_metre = per_metre
        self.lines: list[str] = []
        self.names: dict[int, str] = {}
        self.taken: set[str] = set()
        self.drawn: set[str] = set()
        self.alive: list[Solid] = []

    def scene(self, scene: Scene) -> str:
        self.lines = [f'UNITS {self.unit};', '']
        self._view(scene)
        self.taken = {identifier(name) for name in scene.definitions}
        written: set[str] = set()
        for name, solid in scene.definitions.items():
            plain = identifier(name)
            written.add(self._define(self._fresh(plain) if plain in written else plain, solid))
        self.lines.append('')
        for placement in scene.placements:
            self._draw(placement)
        return '\n'.join(self.lines).rstrip() + '\n'

    def _view(self, scene: Scene) -> None:
        pose = scene.camera_T_scene
        if scene.camera is not None:
            if pose.scale != 1.0:
                raise ValueError(f'scene: its camera pose has the scale {pose.scale:g}, which CAMERA cannot say')
            camera = scene.camera
            rows = [*(numbers(row) + ', ' + self.length(t) for row, t in zip(pose.rotation, pose.translation))]
            self.lines.append(f'CAMERA SIZE ({camera.width}, {camera.height})')
            self.lines.append(f'       K ({numbers(camera.matrix.ravel())})')
            self.lines.append('       RT (' + ',\n           '.join(rows) + ');')
        elif not np.array_equal(pose.matrix, np.eye(4)):
            raise ValueError('scene: it says where the camera is but has no camera, which CAMERA cannot say')
        if scene.baseline is not None:
            self.lines.append(f'STEREO ({self.length(scene.baseline)});')
        self.lines.append(f'AMBIENT ({numbers(scene.ambient_light)});')
        self.lines.append(f'BACKGROUND ({numbers(scene.background)});')
        self._environment(scene.environment)
        for light in scene.lights:
            text = f'LIGHT ({", ".join(self.length(x) for x in light.position)}) COLOUR ({numbers(light.colour)})'
            radius = f' RADIUS ({self.length(light.radius)})' if light.radius else ''
            self.lines.append(text + radius + ';')
        self.lines.append('')

    def _environment(self, environment: Environment | None) -> None:
        if environment is None:
            return
        if not environment.file:
            raise ValueError('scene: it has an environment that comes from no file, which ENVIRONMENT cannot say')
        said = numbers((environment.brightness, *environment.up))
        self.lines.append(f'ENVIRONMENT "{environment.file}" ({said});')

    def _draw(self, placement: Placement) -> None:
        name = self.names.get(id(placement.model)) or self._define(self._fresh(placement.name), placement.model)
        moves = self._moves(placement.matrix)
        shown = unique(identifier(placement.name), self.drawn)
        self.drawn.add(shown)
        self.lines.append(f'DRAW {name}{moves and " " + moves} AS {shown};')
        named: set[str] = set()
        for frame, pose in placement.frames.items():
            plain = unique(identifier(frame), named)
            named.add(plain)
            self.lines.append(f'FRAME {plain} {self._moves(pose.matrix)}'.rstrip() + ';')

    def _define(self, name: str, solid: Solid) -> str:
        self._statement(name, self._solid(solid).text)
        self._remember(solid, name)
        return name

    def _statement(self, name: str, text: str) -> None:
        self.lines.append(wrap(f'{name} = {text};'))

    def _remember(self, solid: Solid, name: str) -> None:
        self.names.setdefault(id(solid), name)
        # Identities are only unique among the living.
        self.alive.append(solid)

    def _fresh(self, name: str) -> str:
        fresh = unique(identifier(name), self.taken)
        self.taken.add(fresh)
        return fresh

    def _solid(self, solid: Solid) -> _Text:
        """Printed without recursion; parts that were named before are called by their names."""
        done: list[_Text] = []
        pending: list[tuple[Solid, bool]] = [(solid, False)]
        while pending:
            node, ready = pending.pop()
            known = self.names.get(id(node))
            if known is not None and not ready:
                done.append(_Text(known))
            elif isinstance(node, Operation) and not ready:
                pending += [(node, True), (node.right, False), (node.left, False)]
            elif isinstance(node, Operation):
                right, left = done.pop(), done.pop()
                done.append(self._combined(node, left, right))
            elif isinstance(node, Primitive | Terrain):
                done.append(_Text(self._leaf(node)))
            elif isinstance(node, Empty):
                done.append(_Text('NULL'))
        return done[0]

    def _combined(self, node: Operation, left: _Text, right: _Text) -> _Text:
        flat = left.operator == node.operator
        if max(left.depth, right.depth) >= DEEPEST or len(left.text) + len(right.text) > LONGEST:
            left, right = (self._named(part, text) for part, text in ((node.left, left), (node.right, right)))
            flat = False
        first = left.text if flat else left.operand
        depth = max(left.depth if flat else left.depth + 1, right.depth + 1)
        return _Text(f'{first} {node.operator} {right.operand}', node.operator, depth)

    def _named(self, solid: Solid, text: _Text) -> _Text:
        if not text.operator:
            return text
        name = self._fresh('part')
        self._statement(name, text.text)
        self._remember(solid, name)
        return _Text(name)

    def _sheet(self, leaf: Terrain) -> str:
        if leaf.file is None:
            raise ValueError('scene: it has a terrain that comes from no file, which TERRAIN cannot say')
        sizes = ''.join(f', {self.length(x)}' for x in leaf.file.size or ())
        call = f'TERRAIN ("{leaf.file.path}"{sizes}{", BILINEAR" if leaf.bilinear else ""})'
        text = f'{call} {self._moves(leaf.placement)}'.rstrip() + self._surface(leaf)
        if leaf.tints is not None:
            rows = [f'{self.length(row[0])}, {numbers(row[1:])}' for row in leaf.tints]
            text += f' PAINT HEIGHTS ({",  ".join(rows)})'
        if leaf.laid is None:
            return text
        if np.array_equal(leaf.laid.frame, leaf.own_frame):
            return text + self._texture(leaf.laid)
        # In its own frame the sheet is textured, and then it moves.
        moves = self._moves(leaf.placement)
        return f'{text.replace(f"{call} {moves}", call, 1)}{self._texture(leaf.laid, leaf.laid.frame)} {moves}'.rstrip()

    def _leaf(self, leaf: Primitive | Terrain) -> str:
        if isinstance(leaf, Terrain):
            return self._sheet(leaf)
        laid, surface = leaf.laid, self._surface(leaf)
        # A picture that lies where the primitive stands is put on when it has been moved.
        stays = laid is not None and not np.array_equal(laid.frame, leaf.matrix)
        call = None if stays else self._sized(leaf)
        if call is not None:
            return call + surface + (self._texture(laid) if laid else '')
        word, pattern = _UNIT_CALLS[leaf.kind]
        # A cylinder along z has its own x and y; undoing them is a change of signs and columns, hence exact.
        undone = np.linalg.inv(np.eye(4) if leaf.kind in ('BLOCK', 'SPHERE') else UPRIGHT)
        call, moves = f'{word} ({pattern.format(number(self.per_metre))})', self._matrix(leaf.matrix @ undone)
        if laid is None:
            return f'{call} {moves}{surface}'
        if stays:
            return f'{call}{surface}{self._texture(laid, laid.frame @ undone)} {moves}'
        return f'{call} {moves}{surface}{self._texture(laid)}'

    def _texture(self, laid: Laid, placement: np.ndarray | None = None) -> str:
        texture = laid.texture
        if not texture.file:
            raise ValueError('scene: it has a texture that comes from no file, which TEXTURE cannot say')
        sizes = ', '.join(self.length(x) for x in texture.size)
        placed = '' if placement is None else f',  {self._matrix(placement)[len("MATRIX (") : -1]}'
        return f' TEXTURE "{texture.file}" {texture.mapping.upper()} ({sizes}{placed})'

    def _sized(self, leaf: Primitive) -> str | None:
        """The primitive by its sizes and AT, when that gives exactly this matrix."""
        linear = leaf.matrix[:3, :3]
        if leaf.kind == 'BLOCK' and np.count_nonzero(linear) == 3 and np.diag(linear).all():
            call = f'BLOCK ({", ".join(self.length(x) for x in np.diag(linear))})'
        elif leaf.kind == 'SPHERE' and np.array_equal(linear, linear[0, 0] * np.eye(3)) and linear[0, 0] > 0.0:
            call = f'SPHERE ({self.length(linear[0, 0])})'
        elif leaf.kind in ('CYLINDER', 'CONE'):
            axis = linear[:, 2]
            make = Solid.cylinder if leaf.kind == 'CYLINDER' else Solid.cone
            radius = float(np.abs(linear[:, :2]).max()) if np.count_nonzero(axis) == 1 else 0.0
            if not radius or not np.array_equal(make(radius, axis).matrix[:3, :3], linear):
                return None
            call = f'{leaf.kind} ({self.length(radius)}, {", ".join(self.length(x) for x in axis)})'
        else:
            return None
        moves = self._moves(np.block([[np.eye(3), leaf.matrix[:3, 3:]], [np.zeros((1, 3)), 1.0]]))
        return f'{call} {moves}'.rstrip()

    def _moves(self, matrix: np.ndarray) -> str:
        if np.array_equal(matrix, np.eye(4)):
            return ''
        if np.array_equal(matrix[:3, :3], np.eye(3)):
            return f'AT ({", ".join(self.length(x) for x in matrix[:3, 3])})'
        return self._matrix(matrix)

    def _matrix(self, matrix: np.ndarray) -> str:
        return f'MATRIX ({numbers(matrix[:3, :3].T.ravel())}, {", ".join(self.length(x) for x in matrix[:3, 3])})'

    def _surface(self, leaf: Primitive | Terrain) -> str:
        plain, surface, text = Surface(), leaf.surface, ''
        if surface.colour != plain.colour:
            text += f' COLOUR ({numbers(surface.colour)})'
        for name, word in _PROPERTIES:
            if getattr(surface, name) != getattr(plain, name):
                text += f' {word} ({number(getattr(surface, name))})'
        if leaf.face_colours is not None:
            text += f' PAINT FACES ({numbers(leaf.face_colours.ravel())})'
        return text

    def length(self, metres: float) -> str:
        """A length in the file's unit that is read back as exactly this float. Raises _Inexact when there is none."""
        value = float(metres) * self.per_metre
        for candidate in (round(value, 6), value, math.nextafter(value, math.inf), math.nextafter(value, -math.inf)):
            if candidate / self.per_metre == metres:
                return number(candidate)
        raise _Inexact


# The orientation that CYLINDER and CONE along z, and a PLANE with normal z, are born with.
UPRIGHT = Solid.cylinder(1.0, (0.0, 0.0, 1.0)).matrix


def number(value: float) -> str:
    """The shortest text that is read back as this float, without exponent and point where they are not needed.

    Parameters
    ----------
    value : float

    Returns
    -------
    str

    Examples
    --------
    >>> number(2.0), number(0.1)
    ('2', '0.1')
    """
    text = repr(float(value) + 0.0)
    return text[:-2] if text.endswith('.0') else text


def numbers(values: np.ndarray | tuple[float, ...]) -> str:
    """Numbers as the language writes them, with commas between."""
    return ', '.join(number(value) for value in values)


def identifier(name: str) -> str:
    """A name as the language allows it: letters, digits and underscores, no keyword."""
    plain = re.sub(r'[^A-Za-z0-9_]', '_', name) or 'object'
    reserved = plain in KEYWORDS or plain in CONSTANTS or plain in FUNCTIONS
    return f'_{plain}' if plain[0].isdigit() or reserved else plain


def unique(name: str, taken: set[str]) -> str:
    """The name itself, or with the first number behind it that is free."""
    free, k = name, 2
    while free in taken:
        free, k = f'{name}_{k}', k + 1
    return free


def wrap(statement: str) -> str:
    """Break a long statement before its operators."""
    if len(statement) <= WIDTH:
        return statement
    return re.sub(r' (UNION|INTERSECT|DIFFERENCE) \(', r'\n    \1 (', statement)
