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
from .textures import Laid, Texture

# Faces in the order of thesis Table 4.1, which is also the order of face_id in a rendered frame. Unit frames: the block
# is the unit cube of the positive octant; cylinder and cone have unit radius and length along +z, the cylinder with one
# end and the cone with its apex at the origin; the sphere has unit radius about it. PLANE (ours) is the half-space
# z <= 0, with outward normal +z. TERRAIN (terrain.py) is a sheet and no Primitive.
FACES: dict[str, tuple[str, ...]] = {
    'BLOCK': ('x = 0', 'x = 1', 'y = 0', 'y = 1', 'z = 0', 'z = 1'),
    'CYLINDER': ('z = 0', 'z = 1', 'curved'),
    'CONE': ('z = 1', 'curved'),
    'SPHERE': ('curved',),
    'PLANE': ('z = 0',),
    'TERRAIN': ('sheet',),
}
PRIMITIVES = ('BLOCK', 'CYLINDER', 'CONE', 'SPHERE', 'PLANE')
OPERATORS = ('UNION', 'INTERSECT', 'DIFFERENCE')


@dataclass(frozen=True)
class Surface:
    """How a surface answers light (thesis 4.5).

    Parameters
    ----------
    colour : (3,) array_like of float64
        Red, green, blue in 0..1, linear.
    ambient, diffuse, specular : float
        Weights of the three terms of Phong's model, 0..1.
    shininess : float
        Exponent of the highlight, >= 0.
    reflection : float
        0..1; 1 is a perfect mirror.
    transparency : float
        0..1; 1 is invisible.
    roughness : float, optional
        Of a metal, 0..1: the alpha of GGX' distribution of facets. Its colour is what it reflects at right angles; it
        takes the place of ``diffuse``, ``specular``, ``shininess`` and ``reflection``. None is no metal.

    Raises
    ------
    ValueError
        A number is out of its range; the message begins with the field.

    Examples
    --------
    >>> glass = Surface((0.9, 0.9, 1.0), transparency=0.8)
    >>> glass.transparency, glass.ambient
    (0.8, 1.0)
    """

    colour: tuple[float, float, float] = (0.8, 0.8, 0.8)
    ambient: float = 1.0
    diffuse: float = 1.0
    specular: float = 0.0
    shininess: float = 20.0
    reflection: float = 0.0
    transparency: float = 0.0
    roughness: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, 'colour', colour(self.colour, 'colour'))
        for name in ('ambient', 'diffuse', 'specular', 'reflection', 'transparency', 'roughness'):
            if name == 'roughness' and self.roughness is None:
                continue
            value = float(getattr(self, name))
            if not 0.0 <= value <= 1.0:
                raise ValueError(f'{name}: expected a number in 0..1, got {value:g}')
            object.__setattr__(self, name, value)
        if not 0.0 <= self.shininess < np.inf:
            raise ValueError(f'shininess: expected a number >= 0, got {self.shininess:g}')


def colour(value: ArrayLike, name: str) -> tuple[float, float, float]:
    """Three numbers in 0..1.

    Parameters
    ----------
    value : (3,) array_like of float64
        Red, green, blue.
    name : str
        What they are, for the message.

    Returns
    -------
    tuple of three floats

    Raises
    ------
    ValueError
        They are no colour; the message begins with ``name``.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (3,) or not ((array >= 0.0) & (array <= 1.0)).all():
        raise ValueError(f'{name}: expected red, green, blue in 0..1, got {value}')
    return (float(array[0]), float(array[1]), float(array[2]))


class Solid:
    """A set of points. Combine with ``|`` (union), ``&`` (intersection) and ``-`` (difference).

    Metres in every constructor. ``Solid.empty()`` is the language's NULL: neutral in a union, and a difference or
    intersection with it is what set algebra says.

    Examples
    --------
    >>> plate = Solid.block(0.1, 0.1, 0.01)
    >>> drilled = plate - Solid.cylinder(0.02, (0, 0, 0.01)).transformed(Pose(np.eye(3), [0.05, 0.05, 0]))
    >>> drilled, drilled.halfspaces
    (<DIFFERENCE of 2 primitives>, 9)
    >>> (drilled | Solid.empty()) is drilled
    True
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
        """The same solid with another leaf in place of every leaf.

        Parameters
        ----------
        change : callable
            From a leaf to a solid; called from left to right.

        Returns
        -------
        Solid
        """
        return change(self)

    def transformed(self, placement: Pose | ArrayLike) -> Solid:
        """The solid moved.

        Parameters
        ----------
        placement : Pose or (4, 4) array_like of float64
            Any affine map, column form, metres.

        Returns
        -------
        Solid

        Raises
        ------
        ValueError
            The matrix is not affine, or flattens the solid to nothing.
        """
        raise NotImplementedError

    def painted(self, surface: Surface) -> Solid:
        """The solid with one surface on every face, whatever they had before, and no texture.

        Parameters
        ----------
        surface : Surface

        Returns
        -------
        Solid
        """
        raise NotImplementedError

    def textured(self, texture: Texture | None, placement: Pose | ArrayLike | None = None) -> Solid:
        """The solid with a picture on every face, which moves with it from now on.

        Parameters
        ----------
        texture : Texture or None
            None takes off what there is.
        placement : Pose or (4, 4) array_like of float64, optional
            The texture's frame from the one in which the solid stands now, metres; the same by default.

        Returns
        -------
        Solid
        """
        if texture is None:
            return self.map_leaves(lambda leaf: replace(leaf, laid=None))
        seen = np.eye(4) if placement is None else as_matrix(placement)
        return self.map_leaves(lambda leaf: replace(leaf, laid=Laid(texture, seen @ leaf.own_frame)))

    @property
    def primitives(self) -> tuple[Primitive, ...]:
        """The leaves, left to right; Frame.primitive_id counts in this order."""
        return tuple(self._leaves())

    @property
    def halfspaces(self) -> int:
        """Number of bounding surfaces: block 6, cylinder 3, cone 2, sphere 1 (thesis 4.13); a terrain's sheet is 1."""
        return sum(len(FACES[leaf.kind]) for leaf in self._leaves())

    def _leaves(self) -> Iterator[Primitive]:
        raise NotImplementedError

    @staticmethod
    def empty() -> Solid:
        """The solid without points: NULL of the language."""
        return Empty()

    @staticmethod
    def primitive(kind: str, matrix: ArrayLike | None = None) -> Primitive:
        """A primitive of any kind in its unit frame, moved.

        Parameters
        ----------
        kind : str
            BLOCK, CYLINDER, CONE, SPHERE or PLANE.
        matrix : (4, 4) array_like of float64, optional
            Any affine map, column form, metres; the unit frame is kept by default.

        Returns
        -------
        Primitive

        Raises
        ------
        ValueError
            There is no such kind, or the matrix is singular or not affine.
        """
        return Primitive(kind, np.eye(4) if matrix is None else np.asarray(matrix, dtype=np.float64))

    @staticmethod
    def block(sx: float, sy: float, sz: float) -> Primitive:
        """A block with one vertex at the origin.

        Parameters
        ----------
        sx, sy, sz : float
            Sizes, metres; the sign of each says on which side of the origin the block lies.

        Returns
        -------
        Primitive

        Examples
        --------
        >>> Solid.block(0.1, 0.2, 0.3).matrix.diagonal().tolist()
        [0.1, 0.2, 0.3, 1.0]
        """
        return Primitive('BLOCK', np.diag([sx, sy, sz, 1.0]))

    @staticmethod
    def cylinder(radius: float, axis: ArrayLike) -> Primitive:
        """A cylinder with one end about the origin.

        Parameters
        ----------
        radius : float
            Metres.
        axis : (3,) array_like of float64
            From the middle of the first end to that of the other, metres.

        Returns
        -------
        Primitive
        """
        return Primitive('CYLINDER', _along(radius, axis))

    @staticmethod
    def cone(radius: float, axis: ArrayLike) -> Primitive:
        """A cone with its apex at the origin.

        Parameters
        ----------
        radius : float
            Of the base, metres.
        axis : (3,) array_like of float64
            From the apex to the middle of the base, metres.

        Returns
        -------
        Primitive
        """
        return Primitive('CONE', _along(radius, axis))

    @staticmethod
    def sphere(radius: float) -> Primitive:
        """A sphere about the origin.

        Parameters
        ----------
        radius : float
            Metres.

        Returns
        -------
        Primitive
        """
        return Primitive('SPHERE', np.diag([radius, radius, radius, 1.0]))

    @staticmethod
    def plane(normal: ArrayLike, offset: float) -> Primitive:
        """The half-space of points p with ``normal . p <= offset``.

        Parameters
        ----------
        normal : (3,) array_like of float64
            Of any length but zero; outward.
        offset : float
            Metres times the length of ``normal``.

        Returns
        -------
        Primitive

        Raises
        ------
        ValueError
            ``normal`` is no direction.
        """
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

    Parameters
    ----------
    kind : str
        One of PRIMITIVES.
    matrix : (4, 4) array_like of float64
        Column form, scene from unit frame, metres.
    surface : Surface
        Of all its faces.
    face_colours : (faces, 3) array_like of float64, optional
        A colour in 0..1 for each face, instead of the surface's.
    laid : Laid, optional
        A picture on it (:meth:`Solid.textured`).

    Raises
    ------
    ValueError
        The kind is unknown, the matrix singular or not affine, or the colours are none.
    """

    kind: str
    matrix: np.ndarray
    surface: Surface = field(default_factory=Surface)
    face_colours: np.ndarray | None = None
    laid: Laid | None = None

    def __post_init__(self) -> None:
        if self.kind not in PRIMITIVES:
            raise ValueError(f'kind: expected one of {", ".join(PRIMITIVES)}, got {self.kind!r}')
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

    @property
    def own_frame(self) -> np.ndarray:
        """Scene from the primitive's unit frame, (4, 4)."""
        return self.matrix

    def transformed(self, placement: Pose | ArrayLike) -> Primitive:
        """See :meth:`Solid.transformed`."""
        return replace(self, matrix=as_matrix(placement) @ self.matrix)

    def painted(self, surface: Surface) -> Primitive:
        """See :meth:`Solid.painted`; colours of single faces and a texture go."""
        return replace(self, surface=surface, face_colours=None, laid=None)

    def _leaves(self) -> Iterator[Primitive]:
        yield self

    def __repr__(self) -> str:
        return f'Solid.primitive({self.kind!r}, {self.matrix.tolist()})'


@dataclass(frozen=True, eq=False)
class Operation(Solid):
    """An inner node of a tree: left operator right.

    Parameters
    ----------
    operator : str
        UNION, INTERSECT or DIFFERENCE.
    left, right : Solid
        Its operands.

    Raises
    ------
    ValueError
        The operator is unknown, or an operand is no solid.
    """

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
        """See :meth:`Solid.transformed`; every leaf is moved."""
        matrix = as_matrix(placement)
        return self.map_leaves(lambda leaf: leaf.transformed(matrix))

    def painted(self, surface: Surface) -> Solid:
        """See :meth:`Solid.painted`; every leaf is painted."""
        return self.map_leaves(lambda leaf: leaf.painted(surface))

    def map_leaves(self, change: Callable[[Any], Solid]) -> Solid:
        """See :meth:`Solid.map_leaves`."""
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
            else:
                yield from node._leaves()

    def __repr__(self) -> str:
        return f'<{self.operator} of {sum(1 for _ in self._leaves())} primitives>'


@dataclass(frozen=True, eq=False)
class Empty(Solid):
    """No points at all: NULL."""

    def map_leaves(self, change: Callable[[Any], Solid]) -> Solid:
        """See :meth:`Solid.map_leaves`; there are no leaves."""
        return self

    def transformed(self, placement: Pose | ArrayLike) -> Solid:
        """See :meth:`Solid.transformed`; the placement is only checked."""
        as_matrix(placement)
        return self

    def painted(self, surface: Surface) -> Solid:
        """See :meth:`Solid.painted`; there is nothing to paint."""
        return self

    def _leaves(self) -> Iterator[Primitive]:
        return iter(())

    def __repr__(self) -> str:
        return 'Solid.empty()'


def as_matrix(placement: Pose | ArrayLike) -> np.ndarray:
    """A placement as a matrix.

    Parameters
    ----------
    placement : Pose or (4, 4) array_like of float64
        Column form.

    Returns
    -------
    (4, 4) float64

    Raises
    ------
    ValueError
        It is neither.
    """
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
