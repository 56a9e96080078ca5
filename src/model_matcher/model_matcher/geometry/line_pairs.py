"""Pairs of lines: their relation, the table of a model's pairs, and which data pairs are worth a look first.

Rows of features as in features.py.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int32Array

from .settings import ANGLE_CELLS, MAX_ANGLE, NOT_ZERO, OFFSET_CELLS, PARALLEL_SINE, SHORTEST, SMALLEST_LENGTH


@njit
def pair_geometry(a: FloatArray, b: FloatArray) -> tuple[float, float, float, float, float, float]:
    """Relation of two lines.

    b's direction is reversed when that makes the cosine positive. A foot is where the common perpendicular meets the
    line.

    Parameters
    ----------
    a, b : (9,) float64
        Features.

    Returns
    -------
    cosine, sine : float
        Of the angle between the lines, both at least 0.
    distance : float
        Metres, signed: from a to b along the product of a's and b's (reversed) direction.
    foot_a, foot_b : float
        Metres from the mid points along the (reversed) directions; 0, as distance, for parallel lines.
    flip : float
        -1 when b's direction is reversed, 1 otherwise.

    Examples
    --------
    >>> a = np.array([0.0, 0, 0, 1, 0, 0, 0.5, 0, 0])
    >>> b = np.array([0.2, 0.3, 0.1, 0, -1, 0, 0.5, 0, 0])
    >>> [round(float(number), 12) for number in pair_geometry(a, b)]
    [0.0, 1.0, -0.1, 0.2, 0.3, 1.0]

    """
    wx, wy, wz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    ux, uy, uz = a[3], a[4], a[5]
    vx, vy, vz = b[3], b[4], b[5]
    c = ux * vx + uy * vy + uz * vz
    flip = 1.0
    if c < 0.0:
        flip = -1.0
        c, vx, vy, vz = -c, -vx, -vy, -vz
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    s = np.sqrt(nx * nx + ny * ny + nz * nz)
    if s < SMALLEST_LENGTH:
        return c, 0.0, 0.0, 0.0, 0.0, flip
    d = (wx * nx + wy * ny + wz * nz) / s
    wu = wx * ux + wy * uy + wz * uz
    wv = wx * vx + wy * vy + wz * vz
    return c, s, d, (wu - c * wv) / (s * s), (c * wu - wv) / (s * s), flip


# -- the model's pair table ------------------------------------------------------------------------------------------


@njit
def pair_cell(angle: float, d: float, reach: float) -> tuple[int, int]:
    """Cell of an angle (radians) and a signed distance (metres) in a table of that reach (metres): two numbers."""
    i = int(angle / MAX_ANGLE * ANGLE_CELLS)
    j = int((d / reach + 1.0) * 0.5 * OFFSET_CELLS)
    return min(max(i, 0), ANGLE_CELLS - 1), min(max(j, 0), OFFSET_CELLS - 1)


@njit
def build_pair_table(features: FloatArray, reach: float) -> tuple[Int32Array, Int32Array, FloatArray]:
    """All ordered, non-parallel pairs of model features, sorted into cells of (angle, signed distance).

    A pair near 90 degrees is entered twice, because noise may turn its angle beyond 90 degrees, where the other
    line counts as reversed. Within a cell pairs come by falling length, so that a search for a pair of long features
    ends at the first too short one.

    Parameters
    ----------
    features : (e, 9) float64
        The model's features.
    reach : float
        Metres, the largest signed distance.

    Returns
    -------
    starts, members, values
        As :class:`.features.PairTable` has them.

    """
    e = features.shape[0]
    shorter = np.empty(e * e)
    for i in range(e):
        for j in range(e):
            shorter[i * e + j] = min(features[i, 6], features[j, 6])
    order = np.argsort(-shorter, kind='mergesort')
    counts = np.zeros(ANGLE_CELLS * OFFSET_CELLS + 1, np.int32)
    members = np.zeros((0, 2), np.int32)
    values = np.zeros((0, 6))
    cursor = counts
    for sweep in range(2):
        if sweep == 1:
            for k in range(len(counts) - 1):
                counts[k + 1] += counts[k]
            members = np.zeros((counts[-1], 2), np.int32)
            values = np.zeros((counts[-1], 6))
            cursor = counts.copy()
        for k in order:
            i, j = k // e, k % e
            if i == j:
                continue
            c, s, d, fi, fj, flip = pair_geometry(features[i], features[j])
            if s < PARALLEL_SINE:
                continue
            angle = np.arctan2(s, c)
            for other in range(2):
                if other == 1:
                    if np.pi - angle > MAX_ANGLE:
                        continue
                    angle, d, fj, flip = np.pi - angle, -d, -fj, -flip
                p, q = pair_cell(angle, d, reach)
                cell = p * OFFSET_CELLS + q
                if sweep == 0:
                    counts[cell + 1] += 1
                    continue
                at = cursor[cell]
                cursor[cell] += 1
                members[at, 0], members[at, 1] = i, j
                values[at, 0], values[at, 1], values[at, 2], values[at, 3], values[at, 4] = angle, d, fi, fj, flip
                values[at, 5] = shorter[k]
    return counts, members, values


# -- ranking data pairs ----------------------------------------------------------------------------------------------


@njit
def _cost_of_pair(features: FloatArray, a: int, b: int, size: float) -> float:
    """Gap / (length x sine) of two features, infinite for those too far apart or too nearly parallel.

    As pair_geometry has it, but number by number: taking rows apart costs as much as the rest. size : metres
    """
    ha, hb = features[a, 6], features[b, 6]
    wx, wy, wz = features[b, 0] - features[a, 0], features[b, 1] - features[a, 1], features[b, 2] - features[a, 2]
    square = wx * wx + wy * wy + wz * wz
    if square > (size + ha + hb) ** 2:
        return np.inf
    ux, uy, uz = features[a, 3], features[a, 4], features[a, 5]
    vx, vy, vz = features[b, 3], features[b, 4], features[b, 5]
    c = ux * vx + uy * vy + uz * vz
    sine = 1.0 - c * c
    if sine < PARALLEL_SINE * PARALLEL_SINE:
        return np.inf
    wu, wv = wx * ux + wy * uy + wz * uz, wx * vx + wy * vy + wz * vz
    fa, fb = (wu - c * wv) / sine, (c * wu - wv) / sine
    over_a, over_b = max(0.0, abs(fa) - ha), max(0.0, abs(fb) - hb)
    # What is left of the gap of the mid points when both have gone to the common perpendicular.
    across = max(square - wu * fa + wv * fb, 0.0)
    gap = np.sqrt(across + over_a * over_a + over_b * over_b)
    # A curve's normal has no length, but its direction is as good as that of a long edge.
    la = ha if ha > 0.0 else SHORTEST * size
    lb = hb if hb > 0.0 else SHORTEST * size
    return float((gap + SHORTEST * size) / (min(la, lb) * np.sqrt(sine) + NOT_ZERO))


@njit
def _keep_best(best_cost: FloatArray, best_other: Int32Array, a: int, b: int, cost: float) -> None:
    """Insert b among the partners of a, (n, knn) by rising cost, when it is one of the best."""
    at = best_cost.shape[1] - 1
    if cost >= best_cost[a, at]:
        return
    while at > 0 and best_cost[a, at - 1] > cost:
        best_cost[a, at] = best_cost[a, at - 1]
        best_other[a, at] = best_other[a, at - 1]
        at -= 1
    best_cost[a, at] = cost
    best_other[a, at] = b


@njit
def rank_pairs(features: FloatArray, neighbours: Int32Array, size: float, knn: int) -> tuple[Int32Array, Int32Array]:
    """Data pairs, most promising first: near, long and far from parallel.

    A pair costs its gap / (length x sine). Each feature contributes the pairs with its best partners.

    Parameters
    ----------
    features : (n, 9) float64
        The data's features.
    neighbours : (n, m) int32
        Candidates for partners of each feature, -1 for none; (0, 0) means all.
    size : float
        Metres, the model's diameter: farther pairs cannot be of one object.
    knn : int
        Partners that each feature contributes.

    Returns
    -------
    pairs : (p, 2) int32
        Best first, each once.
    partners : (n, knn) int32
        The best partners of each feature, best first, -1 at the end.

    """
    n = features.shape[0]
    knn = min(knn, max(n - 1, 0))
    best_cost = np.full((n, max(knn, 1)), np.inf)
    best_other = np.full((n, max(knn, 1)), -1, np.int32)
    everyone = neighbours.shape[0] == 0
    for a in range(n):
        if everyone:
            for b in range(a + 1, n):
                cost = _cost_of_pair(features, a, b, size)
                if cost < np.inf:
                    _keep_best(best_cost, best_other, a, b, cost)
                    _keep_best(best_cost, best_other, b, a, cost)
        else:
            for k in range(neighbours.shape[1]):
                b = neighbours[a, k]
                if b >= 0 and b != a:
                    _keep_best(best_cost, best_other, a, b, _cost_of_pair(features, min(a, b), max(a, b), size))
    pairs = np.zeros((n * knn, 2), np.int32)
    costs = np.zeros(n * knn)
    count = 0
    for a in range(n):
        for k in range(knn):
            b = best_other[a, k]
            if b < 0:
                break
            if b < a:
                # Entered already when a is also among b's best.
                known = False
                for q in range(knn):
                    if best_other[b, q] == a:
                        known = True
                        break
                if known:
                    continue
            pairs[count, 0], pairs[count, 1] = a, b
            costs[count] = best_cost[a, k]
            count += 1
    order = np.argsort(costs[:count], kind='mergesort')
    return pairs[:count][order], best_other
