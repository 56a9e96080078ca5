"""The bounding surfaces of a solid's primitives, grouped where they coincide, and the tree as a program.

Boundary evaluation and hidden-line removal both need the side of every surface on which a point lies. Two primitives
that share a plane or a quadric share one *group* here, so coincident faces are equal exactly and not just nearly. All
geometry is kept in a normalised frame: the solid's bounding box has its centre at the origin and its diagonal is 1.
Every tolerance is therefore a fraction of the model's size.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.grouping import cluster
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array

from ..scene.solid import Operation, Primitive, Solid
from ..scene.terrain import sheets
from .settings import APEX_SLOPE, GENERIC_DIRECTION, LEAST_QUADRIC_SLOPE, SAME_SURFACE

SLOTS = 6  # the block has the most faces; the others are padded

# Outward planes (normal, offset) of the unit primitives in FACES order; a cone's second is its apex plane, no face.
UNIT_PLANES = {
    'BLOCK': np.array([[-1.0, 0, 0, 0], [1, 0, 0, -1], [0, -1, 0, 0], [0, 1, 0, -1], [0, 0, -1, 0], [0, 0, 1, -1]]),
    'CYLINDER': np.array([[0.0, 0, -1, 0], [0, 0, 1, -1]]),
    'CONE': np.array([[0.0, 0, 1, -1], [0, 0, -1, 0]]),
    'SPHERE': np.zeros((0, 4)),
    'PLANE': np.array([[0.0, 0, 1, 0]]),
}
UNIT_QUADRICS = {
    'CYLINDER': np.diag([1.0, 1.0, 0.0, -1.0]),
    'CONE': np.diag([1.0, 1.0, -1.0, 0.0]),
    'SPHERE': np.diag([1.0, 1.0, 1.0, -1.0]),
}

# Operators in the program of compiled functions, where leaves are their numbers.
UNION, INTERSECT, DIFFERENCE = -1, -2, -3
OPERATOR_CODES = {'UNION': UNION, 'INTERSECT': INTERSECT, 'DIFFERENCE': DIFFERENCE}


class SurfaceRows(NamedTuple):
    """A :class:`SurfaceTable` as compiled functions take it.

    Attributes
    ----------
    centre : (3,) float64
    size : float
    planes : (g, 4) float64
    quadrics : (q, 4, 4) float64
    plane_slots : (m, 6) int32
        Plane of each face of each leaf, -1 for what is none.
    slot_sign : (m, 6) float64
    quadric_slot : (m,) int32
        Quadric of each leaf, -1 where it has none.
    cone : (m,) bool
        Whether a leaf is a cone, whose second plane goes through its apex.
    low, high : (m, 3) float64
    program : (p,) int32
        The tree in postfix form: numbers of leaves, and operators.
    """

    centre: FloatArray
    size: float
    planes: FloatArray
    quadrics: FloatArray
    plane_slots: Int32Array
    slot_sign: FloatArray
    quadric_slot: Int32Array
    cone: BoolArray
    low: FloatArray
    high: FloatArray
    program: Int32Array


@dataclass(frozen=True, eq=False)
class SurfaceTable:
    """A solid, compiled: g plane groups, then q quadric groups, then one dummy group that is always inside.

    Parameters
    ----------
    leaves : tuple of m Primitive
        The solid's primitives, left to right.
    centre, size : (3,) float64 and float, metres
        Of the normalised frame: normalised = (metres - centre) / size.
    planes : (g, 4) float64, normalised
        Unit normal n and offset e of each plane, n.x + e = 0.
    quadrics : (q, 4, 4) float64, normalised
        Symmetric, of unit Frobenius norm, negative inside.
    quadric_leaf : (q,) int
        A leaf that owns the quadric.
    frames : (m, 4, 4) float64
        From the unit frame of each leaf to the normalised frame.
    slots : (m, 6) int
        Group of each face of each leaf: planes first, then the quadric. A cone also has the plane through its apex,
        which cuts the second nappe away.
    slot_sign : (m, 6) float64
        A point is inside a face of a leaf where sign * value <= 0.
    slot_real : (m, 6) bool
        A face of the primitive: neither padding nor the cone's apex plane.
    low, high : (m, 3) float64, normalised
        Boxes of the leaves, infinite for a PLANE.
    program : tuple of int and str
        The tree in postfix form: indices of leaves and names of operators.
    """

    leaves: tuple[Primitive, ...]
    centre: np.ndarray
    size: float
    planes: np.ndarray
    quadrics: np.ndarray
    quadric_leaf: np.ndarray
    frames: np.ndarray
    slots: np.ndarray
    slot_sign: np.ndarray
    slot_real: np.ndarray
    low: np.ndarray
    high: np.ndarray
    program: tuple[int | str, ...]

    @property
    def groups(self) -> int:
        """Number of groups, the dummy not counted; it is also the dummy's index."""
        return len(self.planes) + len(self.quadrics)

    @property
    def bounded(self) -> bool:
        """Every leaf is bounded (none is a PLANE)."""
        return bool(np.isfinite(self.low).all())

    @property
    def metres_T_normalised(self) -> np.ndarray:
        """(4, 4): from the normalised frame to model-frame metres."""
        matrix = np.diag([self.size] * 3 + [1.0])
        matrix[:3, 3] = self.centre
        return matrix

    @cached_property
    def rows(self) -> SurfaceRows:
        """The same, as compiled functions take it."""
        g = len(self.planes)
        curved = (self.slots >= g) & (self.slots < self.groups)
        which = np.where(curved, self.slots - g, -1).max(axis=1, initial=-1)
        return SurfaceRows(
            np.asarray(self.centre, float),
            self.size,
            self.planes,
            self.quadrics,
            np.where(self.slots < g, self.slots, -1).astype(np.int32),
            self.slot_sign,
            which.astype(np.int32),
            np.array([leaf.kind == 'CONE' for leaf in self.leaves], bool),
            np.ascontiguousarray(self.low),
            np.ascontiguousarray(self.high),
            np.array([step if isinstance(step, int) else OPERATOR_CODES[step] for step in self.program], np.int32),
        )

    def metres(self, points: np.ndarray) -> np.ndarray:
        """Normalised points (..., 3) to model-frame metres."""
        metres: FloatArray = points * self.size + self.centre
        return metres

    def normalised(self, points: np.ndarray) -> np.ndarray:
        """Model-frame metres (..., 3) to normalised points."""
        normalised: FloatArray = (points - self.centre) / self.size
        return normalised

    def values(self, points: np.ndarray) -> np.ndarray:
        """(n, groups + 1): signed distance of (n, 3) normalised points to every group, first order for a quadric."""
        g = len(self.planes)
        out = np.empty((len(points), self.groups + 1))
        out[:, :g] = points @ self.planes[:, :3].T + self.planes[:, 3]
        for k, q in enumerate(self.quadrics):
            half = points @ q[:3, :3] + q[:3, 3]
            f = (half * points).sum(-1) + points @ q[:3, 3] + q[3, 3]
            # At a cone's apex and a sphere's centre the slope vanishes; only the sign of the value is needed there.
            out[:, g + k] = f / np.maximum(2.0 * np.linalg.norm(half, axis=-1), LEAST_QUADRIC_SLOPE)
        out[:, -1] = -1.0
        return out

    def value_of(self, points: np.ndarray, groups: np.ndarray) -> np.ndarray:
        """(n,): value of one group (n,) at each point (n, 3); as :meth:`values`, but a quadric's is not a distance."""
        g = len(self.planes)
        out = np.empty(len(points))
        flat = groups < g
        out[flat] = np.einsum('ni,ni->n', points[flat], self.planes[groups[flat], :3]) + self.planes[groups[flat], 3]
        x = np.concatenate([points[~flat], np.ones(((~flat).sum(), 1))], axis=1)
        out[~flat] = np.einsum('ni,nij,nj->n', x, self.quadrics[groups[~flat] - g], x)
        return out

    def gradients(self, points: np.ndarray, groups: np.ndarray) -> np.ndarray:
        """(n, k, 3): unit gradient of groups (n, k) at points (n, 3); zeros for the dummy and at an apex."""
        out = np.zeros(groups.shape + (3,))
        g = len(self.planes)
        plane = groups < g
        out[plane] = self.planes[groups[plane], :3]
        curved = ~plane & (groups < self.groups)
        if curved.any():
            row = np.nonzero(curved)[0]
            q = self.quadrics[groups[curved] - g]
            slope = np.einsum('nij,nj->ni', q[:, :3, :3], points[row]) + q[:, :3, 3]
            length = np.linalg.norm(slope, axis=1, keepdims=True)
            out[curved] = slope / np.where(length > APEX_SLOPE, length, np.inf)
        return out

    def leaf_values(self, values: np.ndarray) -> np.ndarray:
        """(n, m, 6): group values (n, groups + 1) with the sign that they have for each leaf, negative inside."""
        signed: FloatArray = values[..., self.slots] * self.slot_sign
        return signed

    def contains(self, points: np.ndarray) -> np.ndarray:
        """(n,) bool: normalised points (n, 3) inside the solid; points on its boundary may go either way."""
        return self.combine(np.asarray((self.leaf_values(self.values(points)) < 0.0).all(axis=-1)))

    def combine(self, inside: np.ndarray) -> np.ndarray:
        """(...,) bool: inside the solid, from the leaves' (..., m) bool."""
        stack: list[np.ndarray] = []
        for step in self.program:
            if isinstance(step, int):
                stack.append(inside[..., step])
                continue
            right = stack.pop()
            left = stack.pop()
            if step == 'UNION':
                stack.append(left | right)
            elif step == 'INTERSECT':
                stack.append(left & right)
            else:
                stack.append(left & ~right)
        return stack[0] if stack else np.zeros(inside.shape[:-1], bool)


def compile_surfaces(solid: Solid) -> SurfaceTable:
    """Compile a solid: its surfaces, grouped where they coincide, and its tree, in its normalised frame.

    Raises
    ------
    ValueError
        A terrain is part of it.

    Examples
    --------
    >>> step = Solid.block(2.0, 2.0, 1.0) | Solid.block(1.0, 2.0, 2.0)
    >>> table = compile_surfaces(step)
    >>> len(table.planes), round(table.size, 6)  # two of the twelve faces' planes are shared, and two more
    (8, 3.464102)
    """
    if sheets(solid):
        raise ValueError('solid: a TERRAIN is a sheet, which bounds no volume; it has no edges, curves and axes')
    leaves = solid.primitives
    program = _program(solid)
    boxes = np.array([_leaf_box(leaf) for leaf in leaves]).reshape(-1, 2, 3)
    low, high = bounding_box(program, boxes)
    finite = np.isfinite(low).all() and np.isfinite(high).all() and (high >= low).all()
    centre = 0.5 * (low + high) if finite else np.zeros(3)
    size = float(np.linalg.norm(high - low)) if finite else 1.0
    size = size if size > 0.0 else 1.0
    normal = np.diag([1.0 / size] * 3 + [1.0])
    normal[:3, 3] = -centre / size
    frames = np.array([normal @ leaf.matrix for leaf in leaves]).reshape(-1, 4, 4)
    m = len(leaves)

    rows: list[tuple[int, int, np.ndarray, bool]] = []  # leaf, slot, plane, is a face
    curved: list[tuple[int, int, np.ndarray]] = []
    for i, leaf in enumerate(leaves):
        inverse = np.linalg.inv(frames[i])
        unit = UNIT_PLANES[leaf.kind]
        for k, plane in enumerate(unit @ inverse):
            rows.append((i, k, plane / np.linalg.norm(plane[:3]), not (leaf.kind == 'CONE' and k == 1)))
        if leaf.kind in UNIT_QUADRICS:
            quadric = inverse.T @ UNIT_QUADRICS[leaf.kind] @ inverse
            curved.append((i, len(unit), 0.5 * (quadric + quadric.T) / np.linalg.norm(quadric)))

    planes = np.array([row[2] for row in rows]).reshape(-1, 4)
    flip = np.where(planes[:, :3] @ GENERIC_DIRECTION < 0.0, -1.0, 1.0)
    plane_group, first = cluster(planes * flip[:, None], SAME_SURFACE)
    quadrics = np.array([row[2] for row in curved]).reshape(-1, 4, 4)
    quadric_group, first_quadric = cluster(quadrics.reshape(-1, 16), SAME_SURFACE)
    g, q = len(first), len(first_quadric)

    slots = np.full((m, SLOTS), g + q)
    sign = np.ones((m, SLOTS))
    real = np.zeros((m, SLOTS), bool)
    for (i, k, _, face), group, s in zip(rows, plane_group, flip):
        slots[i, k], sign[i, k], real[i, k] = group, s, face
    for (i, k, _), group in zip(curved, quadric_group):
        slots[i, k], real[i, k] = g + group, True
    return SurfaceTable(
        leaves,
        centre,
        size,
        (planes * flip[:, None])[first],
        quadrics[first_quadric],
        np.array([curved[k][0] for k in first_quadric], int),
        frames,
        slots,
        sign,
        real,
        (boxes[:, 0] - centre) / size,
        (boxes[:, 1] - centre) / size,
        program,
    )


def bounding_box(program: tuple[int | str, ...], boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """low, high (3,) of a box that holds the solid, from its leaves' (m, 2, 3); high < low: it is certainly empty."""
    nothing = np.array([np.full(3, np.inf), np.full(3, -np.inf)])
    stack: list[np.ndarray] = []
    for step in program:
        if isinstance(step, int):
            stack.append(boxes[step])
            continue
        right = stack.pop()
        left = stack.pop()
        if step == 'UNION':
            stack.append(np.array([np.minimum(left[0], right[0]), np.maximum(left[1], right[1])]))
        elif step == 'INTERSECT':
            both = np.array([np.maximum(left[0], right[0]), np.minimum(left[1], right[1])])
            stack.append(both if (both[1] >= both[0]).all() else nothing)
        else:
            stack.append(left)
    box = stack[0] if stack else nothing
    return box[0], box[1]


def solid_box(solid: Solid) -> tuple[np.ndarray, np.ndarray]:
    """low, high (3,) of a box that holds a solid, metres; as :func:`bounding_box`.

    Examples
    --------
    >>> [corner.tolist() for corner in solid_box(Solid.sphere(1.0) - Solid.block(2.0, 2.0, 2.0))]
    [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]
    """
    boxes = np.array([_leaf_box(leaf) for leaf in solid.primitives]).reshape(-1, 2, 3)
    return bounding_box(_program(solid), boxes)


def _program(solid: Solid) -> tuple[int | str, ...]:
    """Postfix: an index for a leaf, an operator's name for a node. A stack, because trees grow deep."""
    out: list[int | str] = []
    pending: list[Solid | str] = [solid]
    leaf = 0
    while pending:
        node = pending.pop()
        if isinstance(node, str):
            out.append(node)
        elif isinstance(node, Operation):
            pending += [node.operator, node.right, node.left]
        elif isinstance(node, Primitive):
            out.append(leaf)
            leaf += 1
    return tuple(out)


def _leaf_box(leaf: Primitive) -> np.ndarray:
    """(2, 3): the exact axis-aligned box of a placed primitive, metres."""
    if leaf.kind == 'PLANE':
        return np.array([np.full(3, -np.inf), np.full(3, np.inf)])
    x, y, z, t = leaf.matrix[:3].T
    if leaf.kind == 'BLOCK':
        spread = np.stack([x, y, z])
        return np.stack([t + np.minimum(spread, 0.0).sum(0), t + np.maximum(spread, 0.0).sum(0)])
    if leaf.kind == 'SPHERE':
        reach = np.sqrt(x**2 + y**2 + z**2)
        return np.stack([t - reach, t + reach])
    reach = np.sqrt(x**2 + y**2)
    far = np.stack([t + z - reach, t + z + reach])
    near = np.stack([t, t]) if leaf.kind == 'CONE' else np.stack([t - reach, t + reach])
    return np.stack([np.minimum(near[0], far[0]), np.maximum(near[1], far[1])])
