"""Poses from parallel features: two on lines side by side, two about one axis, or one of a solid of revolution.

Two parallel lines a distance apart have a frame as two crossing ones do: their direction, and the way from one to the
other. Two features about one axis fix all of a pose but its turn about that axis, which is then taken at will. Where a
pose stands along the direction, a curve's centre says, or an edge or axis that is seen whole. Rows, tolerances and
motions as in features.py.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, ByteArray, FloatArray, Int32Array

from .features import CURVE, DataFeatures, ModelFeatures
from .rigid_motion import perpendiculars, rotate, transform
from .settings import PARALLEL_SINE, SMALLEST_LENGTH

# Kinds of features, each with a number below this.
KINDS = 3


class ParallelPairs(NamedTuple):
    """All ordered pairs of a model's parallel features.

    Attributes
    ----------
    starts : (10,) int32
        Where the pairs of each two kinds begin: of kinds p and q at KINDS p + q.
    members : (m, 2) int32
        Of two kinds by rising distance.
    apart, along : (m,) float64
        Metres: distance of the second's mid point from the line of the first, and its place along that line.
    """

    starts: Int32Array
    members: Int32Array
    apart: FloatArray
    along: FloatArray


@njit
def offsets(a: FloatArray, b: FloatArray) -> tuple[float, float, float]:
    """Distance of the mid point of feature b (9,) from the line of a, its place along it, and the sine of their angle.

    In metres.

    Examples
    --------
    >>> a, b = np.array([0.0, 0, 0, 0, 0, 1, 0.5, 0, 0]), np.array([3.0, 4, 2, 0, 0, -1, 0.5, 0, 0])
    >>> offsets(a, b)
    (5.0, 2.0, 0.0)
    """
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    along = x * a[3] + y * a[4] + z * a[5]
    x, y, z = x - along * a[3], y - along * a[4], z - along * a[5]
    p, q, r = a[4] * b[5] - a[5] * b[4], a[5] * b[3] - a[3] * b[5], a[3] * b[4] - a[4] * b[3]
    return np.sqrt(x * x + y * y + z * z), along, np.sqrt(p * p + q * q + r * r)


@njit
def parallel_pairs(rows: FloatArray, kind: ByteArray) -> ParallelPairs:
    """The parallel pairs of a model's features, rows (e, 9) and kind (e,)."""
    e = rows.shape[0]
    count = 0
    for i in range(e):
        for j in range(e):
            if i != j and offsets(rows[i], rows[j])[2] < PARALLEL_SINE:
                count += 1
    members = np.empty((count, 2), np.int32)
    apart, along, both = np.empty(count), np.empty(count), np.empty(count, np.int64)
    count = 0
    for i in range(e):
        for j in range(e):
            if i == j:
                continue
            distance, place, sine = offsets(rows[i], rows[j])
            if sine < PARALLEL_SINE:
                members[count, 0], members[count, 1] = i, j
                apart[count], along[count] = distance, place
                both[count] = KINDS * kind[i] + kind[j]
                count += 1
    starts = np.zeros(KINDS * KINDS + 1, np.int32)
    for k in range(count):
        starts[both[k] + 1] += 1
    for k in range(KINDS * KINDS):
        starts[k + 1] += starts[k]
    order = np.argsort(apart, kind='mergesort')
    order = order[np.argsort(both[order], kind='mergesort')]
    return ParallelPairs(starts, members[order], apart[order], along[order])


@njit
def lever(row: FloatArray, is_curve: bool) -> float:
    """Metres: over what length a feature (9,) shows its direction; an edge's half, a curve's radius."""
    return float(max(row[7] if is_curve else row[6], SMALLEST_LENGTH))


@njit
def _direction(rows: FloatArray, a: int, b: int, weights: tuple[float, float, float]) -> tuple[float, float, float]:
    """Common direction of two features, that of a: of their own and of the way between them, each with its weight."""
    ux, uy, uz = rows[a, 3], rows[a, 4], rows[a, 5]
    flip = 1.0 if ux * rows[b, 3] + uy * rows[b, 4] + uz * rows[b, 5] >= 0.0 else -1.0
    wx, wy, wz = rows[b, 0] - rows[a, 0], rows[b, 1] - rows[a, 1], rows[b, 2] - rows[a, 2]
    way = np.sqrt(wx * wx + wy * wy + wz * wz)
    turn = weights[2] / max(way, SMALLEST_LENGTH)
    if ux * wx + uy * wy + uz * wz < 0.0:
        turn = -turn
    own, other = weights[0], flip * weights[1]
    x = own * ux + other * rows[b, 3] + turn * wx
    y = own * uy + other * rows[b, 4] + turn * wy
    z = own * uz + other * rows[b, 5] + turn * wz
    length = max(np.sqrt(x * x + y * y + z * z), SMALLEST_LENGTH)
    return x / length, y / length, z / length


@njit
def _across(rows: FloatArray, a: int, b: int, u: tuple[float, float, float]) -> tuple[float, float, float]:
    """Unit vector from feature a towards b, square to a direction."""
    x, y, z = rows[b, 0] - rows[a, 0], rows[b, 1] - rows[a, 1], rows[b, 2] - rows[a, 2]
    along = x * u[0] + y * u[1] + z * u[2]
    x, y, z = x - along * u[0], y - along * u[1], z - along * u[2]
    length = np.sqrt(x * x + y * y + z * z)
    if length < SMALLEST_LENGTH:
        x, y, z, _, _, _ = perpendiculars(u[0], u[1], u[2])
        return x, y, z
    return x / length, y / length, z / length


@njit
def _turned(
    u: tuple[float, float, float],
    e: tuple[float, float, float],
    v: tuple[float, float, float],
    f: tuple[float, float, float],
    motion: FloatArray,
) -> None:
    """Fill the rotation of a motion (12,) that takes unit vectors v and f, square to each other, to u and e."""
    gx, gy, gz = u[1] * e[2] - u[2] * e[1], u[2] * e[0] - u[0] * e[2], u[0] * e[1] - u[1] * e[0]
    hx, hy, hz = v[1] * f[2] - v[2] * f[1], v[2] * f[0] - v[0] * f[2], v[0] * f[1] - v[1] * f[0]
    g, h = (gx, gy, gz), (hx, hy, hz)
    for p in range(3):
        for q in range(3):
            motion[3 * p + q] = u[p] * v[q] + e[p] * f[q] + g[p] * h[q]


@njit
def seen_whole(data: DataFeatures, model: ModelFeatures) -> BoolArray:
    """Which data features show where which model features end, (n, e): of two parallel edges both have to."""
    out = np.empty((len(data.kind), len(model.kind)), np.bool_)
    for a in range(out.shape[0]):
        for i in range(out.shape[1]):
            out[a, i] = _whole(data, a, model, i)
    return out


@njit
def _whole(data: DataFeatures, a: int, model: ModelFeatures, i: int) -> bool:
    """Whether data feature a shows where model feature i ends: a curve, or as long as it."""
    # An end that may lie anywhere on the edge is none.
    slack = min(data.tolerances[a, 1], 0.5 * model.rows[i, 6])
    return bool(data.kind[a] == CURVE or abs(data.rows[a, 6] - model.rows[i, 6]) <= slack)


@njit
def parallel_pose(
    data: DataFeatures,
    a: int,
    b: int,
    model: ModelFeatures,
    i: int,
    j: int,
    sense: float,
    about_one_axis: bool,
    motion: FloatArray,
) -> bool:
    """The pose that lays two parallel model features on two data features.

    Parameters
    ----------
    data : DataFeatures
    a, b : int
        The data pair.
    model : ModelFeatures
    i, j : int
        The model pair.
    sense : float
        1 when the directions of a and i agree, -1 when they are opposite.
    about_one_axis : bool
        The model pair lies on one line: the turn about it is taken at will.
    motion : (12,) float64
        Filled with the pose.

    Returns
    -------
    bool
        False when neither data feature says where the pose stands along their direction.

    """
    shown_a, shown_b = _whole(data, a, model, i), _whole(data, b, model, j)
    # One of two lines could be of any other length; that both are whole and side by side as the model's is no chance.
    if not shown_a and not shown_b or (data.kind[a] != CURVE and data.kind[b] != CURVE and not (shown_a and shown_b)):
        return False
    own, other = lever(data.rows[a], data.kind[a] == CURVE), lever(data.rows[b], data.kind[b] == CURVE)
    way = 0.0
    if about_one_axis:
        # What errs by the same across shows a direction by the square of its length.
        way = offsets(data.rows[a], data.rows[b])[1] ** 2
    weights = (own * own, other * other, way)
    u = _direction(data.rows, a, b, weights)
    v = _direction(model.rows, i, j, weights)
    v = (sense * v[0], sense * v[1], sense * v[2])
    if about_one_axis:
        x, y, z, _, _, _ = perpendiculars(u[0], u[1], u[2])
        p, q, r, _, _, _ = perpendiculars(v[0], v[1], v[2])
        _turned(u, (x, y, z), v, (p, q, r), motion)
    else:
        _turned(u, _across(data.rows, a, b, u), v, _across(model.rows, i, j, v), motion)
    m, n, d, e = model.rows[i], model.rows[j], data.rows[a], data.rows[b]
    x, y, z = rotate(motion, 0.5 * (m[0] + n[0]), 0.5 * (m[1] + n[1]), 0.5 * (m[2] + n[2]))
    motion[9], motion[10], motion[11] = 0.5 * (d[0] + e[0]) - x, 0.5 * (d[1] + e[1]) - y, 0.5 * (d[2] + e[2]) - z
    # A curve's centre is exact where an edge's ends are not.
    first = shown_a and (data.kind[a] == CURVE or data.kind[b] != CURVE or not shown_b)
    second = shown_b and (data.kind[b] == CURVE or data.kind[a] != CURVE or not shown_a)
    if first != second:
        seen, on = (d, m) if first else (e, n)
        x, y, z = transform(motion, on[0], on[1], on[2])
        shift = (seen[0] - x) * u[0] + (seen[1] - y) * u[1] + (seen[2] - z) * u[2]
        for axis in range(3):
            motion[9 + axis] += shift * u[axis]
    return True


@njit
def matching_parallel(
    data: DataFeatures, model: ModelFeatures, table: ParallelPairs, a: int, b: int, may: BoolArray, found: Int32Array
) -> int:
    """Model pairs that a parallel data pair may lie on.

    Parameters
    ----------
    data : DataFeatures
    model : ModelFeatures
    table : ParallelPairs
        Of the model.
    a, b : int
        The data pair.
    may : (n, e) bool
        Which model features a data feature may be on by itself.
    found : (m,) int32
        Filled: twice the row of the pair in the table, plus 1 where the data's direction is reversed. There is room for
        all when m is at least twice the table's length.

    Returns
    -------
    int
        How many there are.

    """
    kind, tols = data.kind, data.tolerances
    apart, along, _ = offsets(data.rows[a], data.rows[b])
    across = tols[a, 0] + tols[b, 0]
    cone = min(tols[a, 2], tols[b, 2])
    room = across + cone * abs(along)
    neither_curve = kind[a] != CURVE and kind[b] != CURVE
    low, high = table.starts[KINDS * kind[a] + kind[b]], table.starts[KINDS * kind[a] + kind[b] + 1]
    low += np.searchsorted(table.apart[low:high], apart - room)
    count = 0
    for at in range(low, high):
        if table.apart[at] > apart + room:
            break
        i, j = table.members[at, 0], table.members[at, 1]
        if not may[a, i] or not may[b, j]:
            continue
        for turning in range(2):
            # What a fragment may slide along its model feature, and a curve not.
            slides = across + cone * apart
            for k, on in ((a, i), (b, j)):
                if kind[k] != CURVE:
                    slides += tols[k, 1] + (0.0 if neither_curve else max(0.0, model.rows[on, 6] - data.rows[k, 6]))
            if abs(along - (1.0 - 2.0 * turning) * table.along[at]) <= slides:
                found[count] = 2 * at + turning
                count += 1
    return count


@njit
def single_pose(data: DataFeatures, a: int, model: ModelFeatures, i: int, sense: float, motion: FloatArray) -> bool:
    """The pose that lays one model feature on one data feature, its turn about their direction taken at will.

    Parameters and result as of :func:`parallel_pose`.
    """
    if not _whole(data, a, model, i):
        return False
    d, m = data.rows[a], model.rows[i]
    u, v = (d[3], d[4], d[5]), (sense * m[3], sense * m[4], sense * m[5])
    x, y, z, _, _, _ = perpendiculars(u[0], u[1], u[2])
    p, q, r, _, _, _ = perpendiculars(v[0], v[1], v[2])
    _turned(u, (x, y, z), v, (p, q, r), motion)
    x, y, z = rotate(motion, m[0], m[1], m[2])
    motion[9], motion[10], motion[11] = d[0] - x, d[1] - y, d[2] - z
    return True
