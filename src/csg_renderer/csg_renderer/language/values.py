"""What expressions mean: numbers, solids, transforms and surface properties.

Transforms compose left to right on row vectors, as the thesis writes them; matrices here are their column form.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..scene.height_files import HeightGrid
from ..scene.solid import FACES, Primitive, Solid, Surface, colour
from ..scene.terrain import Terrain, TerrainFile, checked_tints
from ..scene.textures import MAPPINGS
from .paint import paint_faces
from .settings import DARKEST, LARGEST, LIGHTEST, MAX_TINTS, SMALLEST

UNITS = {'MM': 1000.0, 'CM': 100.0, 'M': 1.0}

FUNCTIONS: dict[str, tuple[int, Callable[..., float]]] = {
    'SIN': (1, lambda a: math.sin(math.radians(a))),
    'COS': (1, lambda a: math.cos(math.radians(a))),
    'TAN': (1, lambda a: math.tan(math.radians(a))),
    'ASIN': (1, lambda x: math.degrees(math.asin(x))),
    'ACOS': (1, lambda x: math.degrees(math.acos(x))),
    'ATAN2': (2, lambda y, x: math.degrees(math.atan2(y, x))),
    'SQRT': (1, math.sqrt),
    'ABS': (1, abs),
    'MIN': (2, min),
    'MAX': (2, max),
}
CONSTANTS = {'PI': math.pi}

PRIMITIVES = {
    'BLOCK': 'sizes dx, dy, dz',
    'CYLINDER': 'radius and axis x, y, z',
    'SPHERE': 'radius',
    'CONE': 'radius of the base and axis x, y, z',
    'PLANE': 'normal x, y, z and offset',
}


@dataclass(frozen=True)
class Shape:
    """A solid, its number of leaves, and whether a TERRAIN is among them."""

    solid: Solid
    leaves: int
    sheet: bool = False


def length(value: float, per_metre: float, what: str) -> float:
    """A number of the file's unit in metres, refused when it is absurd. Division, so that 35 mm is the float 0.035."""
    metres = value / per_metre
    if not abs(metres) <= LARGEST:
        raise ValueError(f'{what} is {metres:g} m, at most {LARGEST:g} m make sense')
    return metres


def size(value: float, per_metre: float, what: str) -> float:
    """A length that may be negative but not zero."""
    if value == 0.0:
        raise ValueError(f'{what} is zero: the solid has no volume')
    metres = length(value, per_metre, what)
    if abs(metres) < SMALLEST:
        raise ValueError(f'{what} is {abs(metres):g} m, less than {SMALLEST:g} m')
    return metres


def radius(value: float, per_metre: float) -> float:
    """A radius in metres. Raises ValueError with a message for the user."""
    if value < 0.0:
        raise ValueError(f'radius is {value:g}, expected a number > 0')
    return size(value, per_metre, 'radius')


def primitive(word: str, numbers: list[float], per_metre: float) -> Primitive:
    """The solid of a primitive's arguments. Raises ValueError with a message for the user."""
    wanted = {'BLOCK': 3, 'SPHERE': 1}.get(word, 4)
    if len(numbers) != wanted:
        raise ValueError(f'{word} takes {wanted} number{"s" * (wanted > 1)} ({PRIMITIVES[word]}), got {len(numbers)}')
    if word == 'BLOCK':
        sx, sy, sz = (size(n, per_metre, f'd{axis}') for n, axis in zip(numbers, 'xyz'))
        return Solid.block(sx, sy, sz)
    if word == 'SPHERE':
        return Solid.sphere(radius(numbers[0], per_metre))
    if word == 'PLANE':
        normal = np.asarray(numbers[:3])
        if not np.linalg.norm(normal) > SMALLEST:
            raise ValueError('the normal of this PLANE has no length')
        if np.abs(normal).max() > LARGEST:
            raise ValueError('the normal of this PLANE is too long')
        unit = np.linalg.norm(normal)
        return Solid.plane(normal / unit, length(numbers[3], per_metre, 'offset') / float(unit))
    r = radius(numbers[0], per_metre)
    axis = np.array([length(n, per_metre, 'axis') for n in numbers[1:]])
    if not np.linalg.norm(axis) >= SMALLEST:
        raise ValueError(f'the axis of this {word} has no length')
    return Solid.cylinder(r, axis) if word == 'CYLINDER' else Solid.cone(r, axis)


def terrain(grid: HeightGrid, path: str, numbers: list[float], bilinear: bool, per_metre: float) -> Terrain:
    """The sheet over a file's heights. path : as it will be printed. Raises ValueError with a message for the user."""
    meaning = 'sizes dx, dy and what a height of 1 stands for'
    if grid.cell is not None and not numbers:
        sizes, spacing, scale = None, (grid.cell, grid.cell), 1.0
    elif len(numbers) == 3:
        rows, columns = grid.heights.shape
        dx, dy = (size(n, per_metre, name) for n, name in zip(numbers, ('dx', 'dy')))
        if dx < 0.0 or dy < 0.0:
            raise ValueError('dx and dy of a TERRAIN are numbers > 0')
        scale = length(numbers[2], per_metre, 'height')
        sizes, spacing = (dx, dy, scale), (dx / (columns - 1), dy / (rows - 1))
    elif grid.cell is not None:
        raise ValueError(f'TERRAIN takes 3 numbers ({meaning}) after an .asc file, or none, got {len(numbers)}')
    else:
        raise ValueError(f'TERRAIN takes 3 numbers ({meaning}) after this file, got {len(numbers)}')
    heights = grid.heights * scale
    greatest = float(np.nanmax(np.abs(heights)))
    if not greatest <= LARGEST:
        raise ValueError(f'the greatest height is {greatest:g} m, at most {LARGEST:g} m make sense')
    return Terrain(heights, spacing, 'bilinear' if bilinear else 'triangles', file=TerrainFile(path, sizes))


def transform(word: str, numbers: list[float], per_metre: float) -> np.ndarray:
    """(4, 4) column form of one transform. Raises ValueError with a message for the user."""
    if word in ('XROT', 'YROT', 'ZROT'):
        (angle,) = _count(word, numbers, (1,), 'an angle in degrees')
        return rotation(word[0], angle)
    matrix = np.eye(4)
    if word == 'SCALE':
        factors = _count(word, numbers, (1, 3), 'one factor, or one for x, y and z')
        if 0.0 in factors:
            raise ValueError('SCALE by zero: the solid has no volume')
        if max(abs(f) for f in factors) > LARGEST or min(abs(f) for f in factors) < SMALLEST:
            raise ValueError(f'SCALE takes factors between {SMALLEST:g} and {LARGEST:g}')
        matrix[[0, 1, 2], [0, 1, 2]] = factors
    elif word == 'AT':
        matrix[:3, 3] = [length(n, per_metre, 'position') for n in _count(word, numbers, (3,), 'x, y, z')]
    else:
        _count(word, numbers, (12,), 'three rows of a row-form matrix, then the position x, y, z')
        if max(abs(n) for n in numbers[:9]) > LARGEST:
            raise ValueError(f'MATRIX has an element beyond {LARGEST:g}')
        matrix[:3, :3] = np.reshape(numbers[:9], (3, 3)).T
        matrix[:3, 3] = [length(n, per_metre, 'position') for n in numbers[9:]]
    return matrix


# Numbers of a MATRIX.
_MATRIX = 12


def texture_numbers(word: str, numbers: list[float], per_metre: float) -> tuple[tuple[float, ...], np.ndarray]:
    """Sizes (metres) of a TEXTURE of a mapping, and where it is placed, (4, 4). Raises ValueError for the user."""
    counts = MAPPINGS[word.lower()]
    count = len(numbers) if len(numbers) < _MATRIX else len(numbers) - _MATRIX
    if count not in counts:
        wanted = ' or '.join(f'{n} number{"s" * (n > 1)} ({meaning})' for n, meaning in counts.items())
        raise ValueError(
            f'TEXTURE {word} takes {wanted}, and perhaps the {_MATRIX} of a MATRIX, got {len(numbers)} numbers'
        )
    sizes = tuple(size(n, per_metre, 'a size') for n in numbers[:count])
    if count != 3 and min(sizes) < 0.0:
        raise ValueError(f'sizes of TEXTURE {word} are numbers > 0')
    placed = numbers[count:]
    return sizes, transform('MATRIX', placed, per_metre) if placed else np.eye(4)


def rotation(axis: str, degrees: float) -> np.ndarray:
    """(4, 4) column form of XROT, YROT or ZROT; multiples of 90 degrees are exact."""
    quarter, rest = divmod(degrees, 90.0)
    if rest == 0.0:
        c, s = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarter % 4)]
    else:
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    matrix = np.eye(4)
    i, j = {'X': (1, 2), 'Y': (2, 0), 'Z': (0, 1)}[axis]
    matrix[i, i] = matrix[j, j] = c
    matrix[j, i], matrix[i, j] = s, -s
    return matrix


def paint(solid: Solid, word: str, numbers: list[float], per_metre: float) -> Solid:
    """The solid with one surface property changed on every leaf. Raises ValueError with a message for the user."""
    if word == 'PAINT FACES':
        return _paint_faces(solid, numbers)
    if word == 'PAINT HEIGHTS':
        return _paint_heights(solid, numbers, per_metre)
    if word == 'COLOUR':
        rgb = colour_of(word, numbers)
        return solid.map_leaves(lambda leaf: leaf.painted(replace(leaf.surface, colour=rgb)))
    (value,) = _count(word, numbers, (1,), 'one number')
    name = {'REFLECT': 'reflection', 'TRANSPARENT': 'transparency', 'METAL': 'roughness'}.get(word, word.lower())
    change_to: dict[str, Any] = {name: value}
    replace(Surface(), **change_to)  # refuses a value out of range also when there is no leaf

    def change(leaf: Primitive) -> Primitive:
        return replace(leaf, surface=replace(leaf.surface, **change_to))

    return solid.map_leaves(change)


def colour_of(word: str, numbers: list[float]) -> tuple[float, float, float]:
    """Red, green, blue from three numbers, or a grey from one."""
    _count(word, numbers, (1, 3), 'red, green, blue in 0..1, or one grey')
    return colour(numbers * 3 if len(numbers) == 1 else numbers, word)


# Of the lowest and of the highest point.
SHADES = (DARKEST, LIGHTEST)


def _paint_heights(solid: Solid, numbers: list[float], per_metre: float) -> Solid:
    """Colours by height on every TERRAIN: those given, or shades of its own from the lowest point to the highest."""
    if not any(isinstance(leaf, Terrain) for leaf in solid.primitives):
        raise ValueError('PAINT HEIGHTS paints a TERRAIN, there is none here')
    if numbers and (len(numbers) % 4 or len(numbers) > 4 * MAX_TINTS):
        raise ValueError(f'PAINT HEIGHTS takes a height, red, green, blue up to {MAX_TINTS} times, got {len(numbers)}')
    rows = [[length(row[0], per_metre, 'height'), *row[1:]] for row in np.reshape(numbers, (-1, 4)).tolist()]
    try:
        given = checked_tints(rows) if rows else None
    except ValueError as error:
        raise ValueError(str(error).replace('tints', 'PAINT HEIGHTS')) from None

    def change(leaf: Solid) -> Solid:
        if not isinstance(leaf, Terrain):
            return leaf
        if given is not None:
            return replace(leaf, tints=given)
        # Of one height, if the whole sheet has only one.
        shades = {height: shade * np.asarray(leaf.surface.colour) for height, shade in zip(leaf.range, SHADES)}
        return replace(leaf, tints=np.array([[height, *shade] for height, shade in shades.items()]))

    return solid.map_leaves(change)


def _paint_faces(solid: Solid, numbers: list[float]) -> Solid:
    if any(isinstance(leaf, Terrain) for leaf in solid.primitives):
        raise ValueError('PAINT FACES does not paint a TERRAIN, PAINT HEIGHTS does')
    if not numbers:
        return paint_faces(solid)
    if not isinstance(solid, Primitive):
        raise ValueError('PAINT FACES with colours paints one primitive, this is a combination')
    faces = len(FACES[solid.kind])
    _count('PAINT FACES', numbers, (3 * faces,), f'red, green, blue for each of the {faces} faces of a {solid.kind}')
    for face in range(faces):
        colour(numbers[3 * face : 3 * face + 3], f'face {face + 1}')
    return replace(solid, face_colours=np.reshape(numbers, (faces, 3)))


def _count(word: str, numbers: list[float], allowed: tuple[int, ...], meaning: str) -> list[float]:
    if len(numbers) not in allowed:
        raise ValueError(
            f'{word} takes {" or ".join(map(str, allowed))} number{"s" * (allowed != (1,))} ({meaning}), '
            f'got {len(numbers)}'
        )
    return numbers
