"""Poses from pairs of features, and the first quick test of one: whether a neighbour of the pair fits a third feature.

A pair of lines has a frame and a place: the orthonormal frame of its directions, and the middle of its two feet. A pose
takes the model pair's onto the data pair's. Neighbours of the data pair are brought into its frame once, and from there
into the model by each model pair's frame. Nothing is allocated for a hypothesis, and the first neighbour that fits a
third model feature decides. Rows, tolerances and motions as in features.py.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int32Array

from .back_projection import layers_within
from .features import CURVE, DataFeatures, ModelFeatures, PairTable
from .line_pairs import pair_cell, pair_geometry
from .rigid_motion import rotate
from .settings import FLIP_MARGIN, NEAR_LAYERS, OFFSET_CELLS, WIDEST_CONE


class PairWindow(NamedTuple):
    """A pair of data features, and how far off a model pair that it lies on may be.

    Attributes
    ----------
    angle, distance, foot_a, foot_b, flip
        As :func:`.line_pairs.pair_geometry` gives them, radians and metres.
    cone
        Radians, what the angle may be off.
    across
        Metres, what the distance may be off.
    slide_a, slide_b
        Metres along either line, what the feet may be off.
    """

    angle: float
    distance: float
    foot_a: float
    foot_b: float
    flip: float
    cone: float
    across: float
    slide_a: float
    slide_b: float


class Neighbourhood(NamedTuple):
    """Neighbours of a data pair in the pair's frame; rows are filled as far as :func:`into_frame` says.

    Attributes
    ----------
    features : (m,)
        Their numbers.
    places : (m, 6)
        Point and direction.
    limits : (m, 4)
        Squared distance across, slack along, half length (metres), squared cosine of the half cone angle.
    layers : (m,)
        Of a cell of the model's grid, how many hold what they may lie on.
    """

    features: Int32Array
    places: FloatArray
    limits: FloatArray
    layers: Int32Array


@njit
def room_for(most: int) -> Neighbourhood:
    """A neighbourhood of so many features at most, to be filled."""
    return Neighbourhood(np.empty(most, np.int32), np.empty((most, 6)), np.empty((most, 4)), np.empty(most, np.int32))


@njit
def pair_window(data: DataFeatures, a: int, b: int) -> PairWindow:
    """What a model pair may be that a data pair lies on.

    Parameters
    ----------
    data : DataFeatures
    a, b : int
        The data pair.

    Returns
    -------
    PairWindow

    """
    rows, tols = data.rows, data.tolerances
    c, s, d, foot_a, foot_b, flip = pair_geometry(rows[a], rows[b])
    over_a, over_b = max(0.0, abs(foot_a) - rows[a, 6]), max(0.0, abs(foot_b) - rows[b, 6])
    cone = min(tols[a, 2] + tols[b, 2], FLIP_MARGIN)
    across = tols[a, 0] + tols[b, 0] + tols[a, 2] * over_a + tols[b, 2] * over_b
    slide_a, slide_b = tols[a, 1] + across / s, tols[b, 1] + across / s
    return PairWindow(np.arctan2(s, c), d, foot_a, foot_b, flip, cone, across, slide_a, slide_b)


@njit
def matching_pairs(
    data: DataFeatures, model: ModelFeatures, table: PairTable, a: int, b: int, window: PairWindow, found: Int32Array
) -> int:
    """Model pairs that a data pair may lie on.

    Parameters
    ----------
    data : DataFeatures
    model : ModelFeatures
    table : PairTable
    a, b : int
        The data pair.
    window : PairWindow
        Of the data pair.
    found : (m,) int32
        Filled: twice the row of the pair in the table, plus 1 where both data directions are reversed. There is room
        for all when m is at least twice the table's length.

    Returns
    -------
    int
        How many there are.

    """
    half_a, half_b = data.rows[a, 6], data.rows[b, 6]
    shortest = min(half_a - window.slide_a, half_b - window.slide_b)
    angle_low, offset_low = pair_cell(window.angle - window.cone, window.distance - window.across, table.reach)
    angle_high, offset_high = pair_cell(window.angle + window.cone, window.distance + window.across, table.reach)
    values, members, lines = table.values, table.members, model.rows
    count = 0
    for angle_cell in range(angle_low, angle_high + 1):
        for offset_cell in range(offset_low, offset_high + 1):
            cell = angle_cell * OFFSET_CELLS + offset_cell
            for at in range(table.starts[cell], table.starts[cell + 1]):
                if values[at, 5] < shortest:
                    break
                if (
                    abs(values[at, 0] - window.angle) > window.cone
                    or abs(values[at, 1] - window.distance) > window.across
                ):
                    continue
                i, j = members[at, 0], members[at, 1]
                if data.kind[a] != model.kind[i] or data.kind[b] != model.kind[j]:
                    continue
                room_a = lines[i, 6] - half_a + window.slide_a
                room_b = lines[j, 6] - half_b + window.slide_b
                for turning in range(2):
                    turn = 1.0 - 2.0 * turning
                    if (
                        abs(values[at, 2] - turn * window.foot_a) <= room_a
                        and abs(values[at, 3] - turn * window.foot_b) <= room_b
                    ):
                        found[count] = 2 * at + turning
                        count += 1
    return count


@njit
def pair_frame(
    features: FloatArray, a: int, foot_a: float, b: int, flip_b: float, foot_b: float, out: FloatArray
) -> None:
    """Frame and place of a pair of features.

    The bisector of the two directions is as far from the one as from the other, so that the frame is symmetric in the
    errors of both.

    Parameters
    ----------
    features : (n, 9) float64
    a, b : int
        The pair.
    foot_a, foot_b, flip_b : float
        As :func:`.line_pairs.pair_geometry` gives them.
    out : (12,) float64
        Filled: the axes bisector, in-plane and common normal, row by row, then the middle of the feet (metres).

    """
    ux, uy, uz = features[a, 3], features[a, 4], features[a, 5]
    vx, vy, vz = flip_b * features[b, 3], flip_b * features[b, 4], flip_b * features[b, 5]
    ax, ay, az = ux + vx, uy + vy, uz + vz
    n = 1.0 / np.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = n * ax, n * ay, n * az
    cx, cy, cz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    n = 1.0 / np.sqrt(cx * cx + cy * cy + cz * cz)
    cx, cy, cz = n * cx, n * cy, n * cz
    out[0], out[1], out[2] = ax, ay, az
    out[3], out[4], out[5] = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
    out[6], out[7], out[8] = cx, cy, cz
    out[9] = 0.5 * (features[a, 0] + foot_a * ux + features[b, 0] + foot_b * vx)
    out[10] = 0.5 * (features[a, 1] + foot_a * uy + features[b, 1] + foot_b * vy)
    out[11] = 0.5 * (features[a, 2] + foot_a * uz + features[b, 2] + foot_b * vz)


@njit
def pair_pose(data_pair: FloatArray, model_pair: FloatArray, turn: float, motion: FloatArray) -> None:
    """The pose that lays a model pair on a data pair.

    Parameters
    ----------
    data_pair, model_pair : (12,) float64
        As :func:`pair_frame` gives them.
    turn : float
        1, or -1 to reverse both data directions, which is half a turn about the common normal.
    motion : (12,) float64
        Filled with the pose.

    """
    for p in range(3):
        for q in range(3):
            motion[3 * p + q] = (
                turn * (data_pair[p] * model_pair[q] + data_pair[3 + p] * model_pair[3 + q])
                + data_pair[6 + p] * model_pair[6 + q]
            )
    x, y, z = rotate(motion, model_pair[9], model_pair[10], model_pair[11])
    motion[9], motion[10], motion[11] = data_pair[9] - x, data_pair[10] - y, data_pair[11] - z


@njit
def into_frame(
    a: int,
    b: int,
    pair: FloatArray,
    data: DataFeatures,
    candidates: Int32Array,
    widen: float,
    per_metre: float,
    near: Neighbourhood,
) -> int:
    """Bring neighbours of a data pair into the pair's frame; the pair itself is left out.

    Parameters
    ----------
    a, b : int
        The data pair.
    pair : (12,) float64
        Its frame and place, see :func:`pair_frame`.
    data : DataFeatures
    candidates : (m,) int32
        Numbers of the neighbours, -1 ends them.
    widen : float
        Tolerances count this many times.
    per_metre : float
        Of the model's grid.
    near : Neighbourhood
        Filled.

    Returns
    -------
    int
        How many neighbours there are.

    """
    rows, tols, places, limits = data.rows, data.tolerances, near.places, near.limits
    count = 0
    for at in range(len(candidates)):
        k = candidates[at]
        if k < 0:
            break
        if k in (a, b):
            continue
        x, y, z = rotate(pair, rows[k, 0] - pair[9], rows[k, 1] - pair[10], rows[k, 2] - pair[11])
        u, v, w = rotate(pair, rows[k, 3], rows[k, 4], rows[k, 5])
        places[count, 0], places[count, 1], places[count, 2] = x, y, z
        places[count, 3], places[count, 4], places[count, 5] = u, v, w
        limits[count, 0] = (tols[k, 0] * widen) ** 2
        limits[count, 1] = tols[k, 1] * widen
        limits[count, 2] = rows[k, 6]
        limits[count, 3] = np.cos(min(tols[k, 2] * widen, WIDEST_CONE)) ** 2
        near.layers[count] = layers_within(k, data, widen, per_metre)
        near.features[count] = k
        count += 1
    return count


@njit
def fits_a_third(
    pair: FloatArray,
    turn: float,
    i: int,
    j: int,
    count: int,
    near: Neighbourhood,
    model: ModelFeatures,
    data: DataFeatures,
) -> bool:
    """Whether a neighbour of a data pair lies on a third model feature when the pair lies on a model pair.

    Parameters
    ----------
    pair : (12,) float64
        Frame and place of the model pair, see :func:`pair_frame`.
    turn : float
        1, or -1 when both data directions are reversed: the pair is then turned half about the common normal.
    i, j : int
        The model pair.
    count : int
    near : Neighbourhood
        The neighbours, and how many there are.
    model : ModelFeatures
    data : DataFeatures

    Returns
    -------
    bool

    """
    lines, grid, places, limits = model.rows, model.voxels, near.places, near.limits
    starts, items, inverse = grid.starts, grid.items, grid.inverse_cell
    nx, ny, nz = grid.shape
    lx, ly, lz = grid.low[0], grid.low[1], grid.low[2]
    a0, a1, a2 = turn * pair[0], turn * pair[1], turn * pair[2]
    b0, b1, b2 = turn * pair[3], turn * pair[4], turn * pair[5]
    c0, c1, c2 = pair[6], pair[7], pair[8]
    cx, cy, cz = pair[9], pair[10], pair[11]
    for at in range(count):
        p, q, r = places[at, 0], places[at, 1], places[at, 2]
        x = cx + p * a0 + q * b0 + r * c0
        gx = (x - lx) * inverse
        if gx < 0.0 or gx >= nx:
            continue
        y = cy + p * a1 + q * b1 + r * c1
        gy = (y - ly) * inverse
        if gy < 0.0 or gy >= ny:
            continue
        z = cz + p * a2 + q * b2 + r * c2
        gz = (z - lz) * inverse
        if gz < 0.0 or gz >= nz:
            continue
        cell = ((int(gx) * ny + int(gy)) * nz + int(gz)) * NEAR_LAYERS
        first, last = starts[cell], starts[cell + near.layers[at]]
        if first == last:
            continue
        p, q, r = places[at, 3], places[at, 4], places[at, 5]
        vx, vy, vz = p * a0 + q * b0 + r * c0, p * a1 + q * b1 + r * c1, p * a2 + q * b2 + r * c2
        k = near.features[at]
        across, slack, h, cone = limits[at, 0], limits[at, 1], limits[at, 2], limits[at, 3]
        for item in range(first, last):
            m = items[item]
            if m in (i, j) or data.kind[k] != model.kind[m]:
                continue
            ux, uy, uz = lines[m, 3], lines[m, 4], lines[m, 5]
            c = vx * ux + vy * uy + vz * uz
            if c * c < cone:
                continue
            dx, dy, dz = x - lines[m, 0], y - lines[m, 1], z - lines[m, 2]
            along = dx * ux + dy * uy + dz * uz
            if abs(along) + abs(c) * h > lines[m, 6] + slack:
                continue
            dx, dy, dz = dx - along * ux, dy - along * uy, dz - along * uz
            sx, sy, sz = h * (vx - c * ux), h * (vy - c * uy), h * (vz - c * uz)
            worst = dx * dx + dy * dy + dz * dz + sx * sx + sy * sy + sz * sz + 2.0 * abs(dx * sx + dy * sy + dz * sz)
            if worst > across:
                continue
            if data.kind[k] == CURVE:
                room = data.radius_tolerance + data.tolerances[k, 0]
                if abs(data.rows[k, 7] - lines[m, 7]) > room or abs(data.rows[k, 8] - lines[m, 8]) > room:
                    continue
            return True
    return False
