"""Back-projection: which data lies on which model feature under a pose.

Rows of features, tolerances and motions as in features.py.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int8Array, Int32Array, IntArray

from .features import CURVE, DataFeatures, FeatureRows, ModelFeatures
from .rigid_motion import inverse_rotate, inverse_transform, unpacked
from .settings import NEAR_LAYERS, WIDEST_CONE

# -- the model's voxel grid ------------------------------------------------------------------------------------------


@njit
def build_voxels(
    features: FloatArray, low: FloatArray, cell: float, shape: tuple[int, int, int], reach: float
) -> tuple[Int32Array, Int32Array]:
    """Which model features pass near each cell of a grid.

    A feature is listed where its distance from the cell's centre is within reach plus half the cell's diagonal, in the
    layer of what it is at least away from the cell.

    Parameters
    ----------
    features : (e, 9) float64
        The model's features.
    low : (3,) float64
        Metres, model frame, corner of the first cell.
    cell : float
        Metres, edge of a cell.
    shape : tuple of 3 int
        Cells along each axis.
    reach : float
        Metres.

    Returns
    -------
    starts, items
        As :class:`.features.VoxelGrid` has them.

    """
    nx, ny, nz = shape
    counts = np.zeros(nx * ny * nz * NEAR_LAYERS + 1, np.int32)
    items = np.zeros(0, np.int32)
    cursor = counts
    inside = 0.8661 * cell  # half of a cube's diagonal is 0.8660 edges
    margin = reach + cell
    for sweep in range(2):
        if sweep == 1:
            for k in range(len(counts) - 1):
                counts[k + 1] += counts[k]
            items = np.zeros(counts[-1], np.int32)
            cursor = counts.copy()
        for i in range(features.shape[0]):
            f = features[i]
            h = f[6]
            lo = np.zeros(3, np.int64)
            hi = np.zeros(3, np.int64)
            for axis in range(3):
                extent = h * abs(f[3 + axis]) + margin
                lo[axis] = max(0, int(np.floor((f[axis] - extent - low[axis]) / cell)))
                hi[axis] = min(shape[axis] - 1, int(np.floor((f[axis] + extent - low[axis]) / cell)))
            for x in range(lo[0], hi[0] + 1):
                for y in range(lo[1], hi[1] + 1):
                    for z in range(lo[2], hi[2] + 1):
                        rx = low[0] + (x + 0.5) * cell - f[0]
                        ry = low[1] + (y + 0.5) * cell - f[1]
                        rz = low[2] + (z + 0.5) * cell - f[2]
                        s = rx * f[3] + ry * f[4] + rz * f[5]
                        s = min(max(s, -h), h)
                        rx, ry, rz = rx - s * f[3], ry - s * f[4], rz - s * f[5]
                        away = np.sqrt(rx * rx + ry * ry + rz * rz) - inside
                        if away > reach:
                            continue
                        layer = max(0, min(int(away * NEAR_LAYERS / reach), NEAR_LAYERS - 1))
                        k = ((x * ny + y) * nz + z) * NEAR_LAYERS + layer
                        if sweep == 0:
                            counts[k + 1] += 1
                        else:
                            items[cursor[k]] = i
                            cursor[k] += 1
    return counts, items


@njit(inline='always')
def layers_within(k: int, data: DataFeatures, widen: float, per_metre: float) -> int:
    """How many layers of the cell that a data feature's middle is in hold what it may lie on.

    Parameters
    ----------
    k : int
        Number of the data feature.
    data : DataFeatures
    widen : float
        Tolerances count this many times.
    per_metre : float
        Of the :class:`.features.VoxelGrid`.

    """
    across, slack, cone = data.tolerances[k, 0] * widen, data.tolerances[k, 1] * widen, data.tolerances[k, 2] * widen
    # Its middle lies past an end by no more than this, for the cosine of an angle is at least 1 - angle^2 / 2.
    past = max(0.0, slack - data.rows[k, 6] * (1.0 - 0.5 * cone * cone))
    return min(int(np.sqrt(across * across + past * past) * per_metre) + 1, NEAR_LAYERS)


# -- back-projection -------------------------------------------------------------------------------------------------


@njit(inline='always')  # as a call it would cost more than what it does
def fit_one(
    k: int,
    data: DataFeatures,
    j: int,
    model: ModelFeatures | FeatureRows,
    point: tuple[float, float, float],
    direction: tuple[float, float, float],
    widen: float,
) -> float:
    """How well data feature k lies on model feature j.

    Parameters
    ----------
    k, j : int
        Numbers of the data feature and the model feature.
    data : DataFeatures
    model : ModelFeatures or FeatureRows
    point, direction : tuple of 3 float
        The data feature's mid point (metres) and direction in the model frame.
    widen : float
        Tolerances count this many times.

    Returns
    -------
    float
        The largest end point distance across the line over its tolerance, in [0, 1], or -1 when it does not fit.

    """
    if data.kind[k] != model.kind[j]:
        return -1.0
    vx, vy, vz = direction
    rx, ry, rz = point[0] - model.rows[j, 0], point[1] - model.rows[j, 1], point[2] - model.rows[j, 2]
    mx, my, mz = model.rows[j, 3], model.rows[j, 4], model.rows[j, 5]
    along = rx * mx + ry * my + rz * mz
    across = data.tolerances[k, 0] * widen
    qx, qy, qz = rx - along * mx, ry - along * my, rz - along * mz
    middle = qx * qx + qy * qy + qz * qz
    if middle > across * across:
        return -1.0
    c = vx * mx + vy * my + vz * mz
    h = data.rows[k, 6]
    if abs(along) + abs(c) * h > model.rows[j, 6] + data.tolerances[k, 1] * widen:
        return -1.0
    # sin(x)^2 lies between x^2 - x^4 / 3 and x^2: the sine itself is hardly ever needed.
    cone = min(data.tolerances[k, 2] * widen, WIDEST_CONE)
    square = cone * cone
    away = 1.0 - c * c
    if away > square or (away > square * (1.0 - square / 3.0) and away > np.sin(cone) ** 2):
        return -1.0
    if data.kind[k] == CURVE:
        room = data.radius_tolerance + data.tolerances[k, 0]
        if abs(data.rows[k, 7] - model.rows[j, 7]) > room or abs(data.rows[k, 8] - model.rows[j, 8]) > room:
            return -1.0
        return float(min(1.0, np.sqrt(middle + along * along) / across))
    sx, sy, sz = h * (vx - c * mx), h * (vy - c * my), h * (vz - c * mz)
    cross = qx * sx + qy * sy + qz * sz
    worst = middle + sx * sx + sy * sy + sz * sz + 2.0 * abs(cross)
    if worst > across * across:
        return -1.0
    return float(np.sqrt(worst) / across)


@njit
def count_matches(
    motion: FloatArray,
    model: ModelFeatures,
    data: DataFeatures,
    widen: float,
    stamp: IntArray,
    mark: int,
    needed: float,
) -> float:
    """Distinct model features with data on them under a pose.

    Parameters
    ----------
    motion : (12,) float64
    model : ModelFeatures
    data : DataFeatures
    widen : float
        Tolerances count this many times.
    stamp : (e,) int64
        Scratch space; a model feature is marked as found by ``mark``, which must differ from call to call.
    mark : int
    needed : float
        The count is given up as soon as so many distinct features are out of reach.

    Returns
    -------
    float
        The number of distinct model features, plus the mean quality of fit, in [0, 1], with one fit of none added, so
        that one feature more always counts more; 0 when it was given up.

    """
    pose = unpacked(motion)
    rows = data.rows
    grid = model.voxels
    starts, items, inverse = grid.starts, grid.items, grid.inverse_cell
    nx, ny, nz = grid.shape
    lx, ly, lz = grid.low[0], grid.low[1], grid.low[2]
    n = rows.shape[0]
    distinct = 0
    fits = 0
    quality = 0.0
    for k in range(n):
        if distinct + n - k < needed:
            return 0.0
        # One axis after the other, by hand: most data is outside the grid along the first that is looked at.
        x, y, z = rows[k, 0] - pose[9], rows[k, 1] - pose[10], rows[k, 2] - pose[11]
        px = pose[0] * x + pose[3] * y + pose[6] * z
        gx = (px - lx) * inverse
        if gx < 0.0 or gx >= nx:
            continue
        py = pose[1] * x + pose[4] * y + pose[7] * z
        gy = (py - ly) * inverse
        if gy < 0.0 or gy >= ny:
            continue
        pz = pose[2] * x + pose[5] * y + pose[8] * z
        gz = (pz - lz) * inverse
        if gz < 0.0 or gz >= nz:
            continue
        at = ((int(gx) * ny + int(gy)) * nz + int(gz)) * NEAR_LAYERS
        first, last = starts[at], starts[at + layers_within(k, data, widen, grid.per_metre)]
        if first == last:
            continue
        direction = inverse_rotate(pose, rows[k, 3], rows[k, 4], rows[k, 5])
        best = 2.0
        which = -1
        for q in range(first, last):
            j = items[q]
            fit = fit_one(k, data, j, model, (px, py, pz), direction, widen)
            if 0.0 <= fit < best:
                best = fit
                which = j
        if which >= 0:
            fits += 1
            quality += 1.0 - best * best
            if stamp[which] != mark:
                stamp[which] = mark
                distinct += 1
    if fits == 0:
        return 0.0
    return distinct + quality / (fits + 1.0)


@njit
def assign(
    motion: FloatArray, model: ModelFeatures, data: DataFeatures, widen: float, assignment: Int32Array, sign: Int8Array
) -> int:
    """Best model feature of every data feature under a pose.

    Parameters
    ----------
    motion : (12,) float64
    model : ModelFeatures
    data : DataFeatures
    widen : float
        Tolerances count this many times.
    assignment : (n,) int32
        Filled: the model feature of each data feature, or -1.
    sign : (n,) int8
        Filled: 1 when the directions agree, -1 when they are opposite, 0 without a model feature.

    Returns
    -------
    int
        How many data features have a model feature.

    """
    pose = unpacked(motion)
    rows = data.rows
    grid = model.voxels
    low, cell = grid.low, grid.cell
    nx, ny, nz = grid.shape
    count = 0
    for k in range(rows.shape[0]):
        assignment[k] = -1
        sign[k] = 0
        px, py, pz = inverse_transform(pose, rows[k, 0], rows[k, 1], rows[k, 2])
        gx, gy, gz = (px - low[0]) / cell, (py - low[1]) / cell, (pz - low[2]) / cell
        if not (0.0 <= gx < nx and 0.0 <= gy < ny and 0.0 <= gz < nz):
            continue
        at = ((int(gx) * ny + int(gy)) * nz + int(gz)) * NEAR_LAYERS
        vx, vy, vz = inverse_rotate(pose, rows[k, 3], rows[k, 4], rows[k, 5])
        best = 2.0
        for q in range(grid.starts[at], grid.starts[at + layers_within(k, data, widen, grid.per_metre)]):
            j = grid.items[q]
            fit = fit_one(k, data, j, model, (px, py, pz), (vx, vy, vz), widen)
            if 0.0 <= fit < best:
                best = fit
                assignment[k] = j
                line = model.rows
                sign[k] = 1 if vx * line[j, 3] + vy * line[j, 4] + vz * line[j, 5] >= 0.0 else -1
        if assignment[k] >= 0:
            count += 1
    return count
