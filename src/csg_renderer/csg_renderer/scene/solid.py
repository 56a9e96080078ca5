"""Solids: four bounded primitives and the half-space, any affine placement, three set operators.

A solid is an immutable tree. Transforms and surfaces are pushed down to the leaves when they are applied, so that a
leaf alone says everything about itself. Thesis 4.7 (Table 4.1) and 4.8.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from msgs_py import Pose
from msgs_py.numeric.vectors import perpendicular

from .settings import AFFINE, SINGULAR

# Faces in the order of thesis Table 4.1, which is also the order of face_id in a rendered frame. Unit frames: the block
# is the unit cube of the positive octant; cylinder and cone have unit radius and length along +z, the cylinder with one
# end and the cone with its apex at the origin; the sphere has unit radius about it. PLANE (ours) is the half-space
# z <= 0, with outward normal +z.
FACES: dict[str, tuple[str, ...]] = {
    'BLOCK': ('x = 0', 'x = 1', 'y = 0', 'y = 1', 'z = 0', 'z = 1'),
    'CYLINDER': ('z = 0', 'z = 1', 'curved'),
    'CONE': ('z = 1', 'curved'),
    'SPHERE': ('curved',),
    'PLANE': ('z = 0',),
}
OPERATORS = ('UNION', 'INTERSECT', 'DIFFERENCE')


@dataclass(frozen=True)
class Surface:
    """How a surface answers light (thesis 4.5). All numbers in 0..1, linear; shininess >= 0.

    colour : (r, g, b); ambient, diffuse, specular : weights of the three terms; shininess : exponent of the highlight;
    reflection : 1 is a perfect mirror; transparency : 1 is invisible.
    Raises ValueError, naming the field.
    """

    colour: tuple[float, float, float] = (0.8, 0.8, 0.8)
    ambient: float = 1.0
    diffuse: float = 1.0
    specular: float = 0.0
    shininess: float = 20.0
    reflection: float = 0.0
    transparency: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, 'colour', colour(self.colour, 'colour'))
        for name in ('ambient', 'diffuse', 'specular', 'reflection', 'transparency'):
            value = float(getattr(self, name))
            if not 0.0 <= value <= 1.0:
                raise ValueError(f'{name}: expected a number in 0..1, got {value:g}')
            object.__setattr__(self, name, value)
        if not 0.0 <= self.shininess < np.inf:
            raise ValueError(f'shininess: expected a number >= 0, got {self.shininess:g}')


def colour(value: ArrayLike, name: str) -> tuple[float, float, float]:
    """Three numbers in 0..1, or a ValueError that starts with name."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (3,) or not ((array >= 0.0) & (array <= 1.0)).all():
        raise ValueError(f'{name}: expected red, green, blue in 0..1, got {value}')
    return (float(array[0]), float(array[1]), float(array[2]))


class Solid:
    """A set of points. Combine with ``|`` (union), ``&`` (intersection) and ``-`` (difference).

    Metres in every constructor. ``Solid.empty()`` is the language's NULL: neutral in a union, and a difference or
    intersection with it is what set algebra says.
    """

    def __or__(self, other: Solid) -> Solid:
        if isinstance(self, Empty):
            return other
        return self if isinstance(other, Empty) else Operation('UNION', self, other)

    def __and__(self, other: Solid) -> Solid:
        if isinstance(self, Empty) or isinstance(other, Empty):
            return Empty()
        return Operation('INTERSECT', self, other)

    def __sub__(self, other: Solid) -> Solid:
        if isinstance(self, Empty) or isinstance(other, Empty):
            return self
        return Operation('DIFFERENCE', self, other)

    def map_leaves(self, change: Callable[[Any], Solid]) -> Solid:
        """The same solid with ``change(leaf)`` in place of every leaf, called left to right."""
        return change(self)

    def transformed(self, placement: Pose | ArrayLike) -> Solid:
        """Moved by a Pose or any affine (4, 4) column-form matrix."""
        raise NotImplementedError

    def painted(self, surface: Surface) -> Solid:
        """With this surface on every face, whatever they had before."""
        raise NotImplementedError

    @property
    def primitives(self) -> tuple[Primitive, ...]:
        """The leaves, left to right; Frame.primitive_id counts in this order."""
        return tuple(self._leaves())

    @property
    def halfspaces(self) -> int:
        """Number of bounding surfaces: block 6, cylinder 3, cone 2, sphere 1 (thesis 4.13)."""
        return sum(len(FACES[leaf.kind]) for leaf in self._leaves())

    def _leaves(self) -> Iterator[Primitive]:
        raise NotImplementedError

    @staticmethod
    def empty() -> Solid:
        return Empty()

    @staticmethod
    def primitive(kind: str, matrix: ArrayLike | None = None) -> Primitive:
        """A primitive in its unit frame, moved by an affine (4, 4) column-form matrix."""
        return Primitive(kind, np.eye(4) if matrix is None else np.asarray(matrix, dtype=np.float64))

    @staticmethod
    def block(sx: float, sy: float, sz: float) -> Primitive:
        """A block with one vertex at the origin; the sign of each size says on which side it lies."""
        return Primitive('BLOCK', np.diag([sx, sy, sz, 1.0]))

    @staticmethod
    def cylinder(radius: float, axis: ArrayLike) -> Primitive:
        """A cylinder from the origin along ``axis`` (3,), whose length is the cylinder's."""
        return Primitive('CYLINDER', _along(radius, axis))

    @staticmethod
    def cone(radius: float, axis: ArrayLike) -> Primitive:
        """A cone with its apex at the origin and its base, of the given radius, centred at ``axis`` (3,)."""
        return Primitive('CONE', _along(radius, axis))

    @staticmethod
    def sphere(radius: float) -> Primitive:
        """A sphere about the origin."""
        return Primitive('SPHERE', np.diag([radius, radius, radius, 1.0]))

    @staticmethod
    def plane(normal: ArrayLike, offset: float) -> Primitive:
        """The half-space of points p with ``normal . p <= offset`` (normal need not be a unit vector)."""
        n = np.asarray(normal, dtype=np.float64)
        length = np.linalg.norm(n)
        if n.shape != (3,) or not length > 0.0:
            raise ValueError(f'normal: expected three numbers, not all zero, got {normal}')
        matrix = _along(1.0, n / length)
        matrix[:3, 3] = n * (offset / length**2)
        return Primitive('PLANE', matrix)


@dataclass(frozen=True, eq=False)
class Primitive(Solid):
    """A leaf: one primitive in its unit frame, placed by an affine matrix.

    kind : a key of FACES; matrix : (4, 4) float64, column form, unit frame to scene, metres
    surface : Surface of all its faces; face_colours : (faces, 3) float64 in 0..1, or None for the surface's colour
    Raises ValueError for an unknown kind, a singular or non-affine matrix.
    """

    kind: str
    matrix: np.ndarray
    surface: Surface = field(default_factory=Surface)
    face_colours: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.kind not in FACES:
            raise ValueError(f'kind: expected one of {", ".join(FACES)}, got {self.kind!r}')
        matrix = np.array(self.matrix, dtype=np.float64)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise ValueError('matrix: expected (4, 4) finite numbers')
        if np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > AFFINE:
            raise ValueError(f'matrix: last row is {matrix[3]}, expected 0 0 0 1 (an affine, column-form matrix)')
        largest = np.linalg.norm(matrix[:3, :3], axis=0).max()
        if largest == 0.0 or abs(np.linalg.det(matrix[:3, :3])) <= SINGULAR * largest**3:
            raise ValueError(f'matrix: flattens the {self.kind} to nothing (a size or scale is zero)')
        matrix.flags.writeable = False
        object.__setattr__(self, 'matrix', matrix)
        if self.face_colours is not None:
            colours = np.array(self.face_colours, dtype=np.float64)
            if colours.shape != (len(FACES[self.kind]), 3) or not ((colours >= 0) & (colours <= 1)).all():
                raise ValueError(f'face_colours: expected ({len(FACES[self.kind])}, 3) numbers in 0..1')
            object.__setattr__(self, 'face_colours', colours)

    def transformed(self, placement: Pose | ArrayLike) -> Primitive:
        return replace(self, matrix=as_matrix(placement) @ self.matrix)

    def painted(self, surface: Surface) -> Primitive:
        return replace(self, surface=surface, face_colours=None)

    def _leaves(self) -> Iterator[Primitive]:
        yield self

    def __repr__(self) -> str:
        return f'Solid.primitive({self.kind!r}, {self.matrix.tolist()})'


@dataclass(frozen=True, eq=False)
class Operation(Solid):
    """An inner node: left operator right."""

    operator: str
    left: Solid
    right: Solid

    def __post_init__(self) -> None:
        if self.operator not in OPERATORS:
            raise ValueError(f'operator: expected one of {", ".join(OPERATORS)}, got {self.operator!r}')
        for name in ('left', 'right'):
            if not isinstance(getattr(self, name), Solid):
                raise ValueError(f'{name}: expected a Solid, got {type(getattr(self, name)).__name__}')

    def transformed(self, placement: Pose | ArrayLike) -> Solid:
        matrix = as_matrix(placement)
        return self.map_leaves(lambda leaf: leaf.transformed(matrix))

    def painted(self, surface: Surface) -> Solid:
        return self.map_leaves(lambda leaf: leaf.painted(surface))

    def map_leaves(self, change: Callable[[Any], Solid]) -> Solid:
        # A stack instead of recursion, because unions grow thousands deep.
        done: list[Solid] = []
        pending: list[tuple[Solid, bool]] = [(self, False)]
        while pending:
            node, ready = pending.pop()
            if not isinstance(node, Operation):
                done.append(node.map_leaves(change))
            elif ready:
                right, left = done.pop(), done.pop()
                done.append(Operation(node.operator, left, right))
            else:
                pending += [(node, True), (node.right, False), (node.left, False)]
        return done[0]

    def _leaves(self) -> Iterator[Primitive]:
        pending: list[Solid] = [self]
        while pending:
            node = pending.pop()
            if isinstance(node, Operation):
                pending += [node.right, node.left]
            elif isinstance(node, Primitive):
                yield node

    def __repr__(self) -> str:
        return f'<{self.operator} of {sum(1 for _ in self._leaves())} primitives>'


@dataclass(frozen=True, eq=False)
class Empty(Solid):
    """No points at all: NULL."""

    def map_leaves(self, change: Callable[[Any], Solid]) -> Solid:
        return self

    def transformed(self, placement: Pose | ArrayLike) -> Solid:
        as_matrix(placement)
        return self

    def painted(self, surface: Surface) -> Solid:
        return self

    def _leaves(self) -> Iterator[Primitive]:
        return iter(())

    def __repr__(self) -> str:
        return 'Solid.empty()'


def as_matrix(placement: Pose | ArrayLike) -> np.ndarray:
    """A Pose or a (4, 4) affine column-form matrix, as the matrix."""
    if isinstance(placement, Pose):
        return placement.matrix
    matrix = np.asarray(placement, dtype=np.float64)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise ValueError(f'placement: expected a Pose or (4, 4) finite numbers, got shape {matrix.shape}')
    return matrix


def _along(radius: float, axis: ArrayLike) -> np.ndarray:
    """(4, 4): unit frame to a circular primitive of this radius along axis; x and y chosen right-handed."""
    a = np.asarray(axis, dtype=np.float64)
    if a.shape != (3,):
        raise ValueError(f'axis: expected three numbers, got {axis}')
    length = np.linalg.norm(a)
    if not length > 0.0:
        raise ValueError('axis: its length is zero')
    z = a / length
    x = perpendicular(z)
    matrix = np.eye(4)
    matrix[:3, 0] = radius * x
    matrix[:3, 1] = radius * np.cross(z, x)
    matrix[:3, 2] = a
    return matrix
