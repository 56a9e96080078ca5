"""The motions that lay a model's features on themselves, as compiled loops find them; see model/symmetry.py.

Each pair of features that looks like one fixed pair gives a motion, by the frames of both; a motion counts when it lays
every feature on one that looks like it. Rows and motions as in features.py.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray

from .pair_pose import pair_frame, pair_pose
from .rigid_motion import rotate, transform
from .settings import NOT_ZERO, PARALLEL_SINE


class Lookalikes(NamedTuple):
    """A model's features, and which look alike.

    Attributes
    ----------
    rows : (e, 9) float64
    alike : (e, e) bool
        Of one kind and size.
    tolerance : float
        Metres: how near what is the same lies.
    same : float
        What cosines, and poses in sizes of the model, differ by less when they are the same.
    middle : (3,) float64
        Metres, of the model.
    size : float
        Metres, of the model.
    """

    rows: FloatArray
    alike: BoolArray
    tolerance: float
    same: float
    middle: FloatArray
    size: float


@njit
def _crosses(rows: FloatArray, i: int, j: int) -> bool:
    """Whether two features are far from parallel; nearer, their directions do not fix a motion well."""
    c = rows[i, 3] * rows[j, 3] + rows[i, 4] * rows[j, 4] + rows[i, 5] * rows[j, 5]
    return bool(abs(c) <= np.cos(np.arcsin(PARALLEL_SINE)))


@njit
def _fill_pair(rows: FloatArray, i: int, j: int, pair: FloatArray) -> None:
    """Fill (2, 9): two features; of parallel ones, the second has the direction of the way to it."""
    pair[0], pair[1] = rows[i], rows[j]
    if _crosses(rows, i, j):
        return
    x, y, z = rows[j, 0] - rows[i, 0], rows[j, 1] - rows[i, 1], rows[j, 2] - rows[i, 2]
    along = x * rows[i, 3] + y * rows[i, 4] + z * rows[i, 5]
    x, y, z = x - along * rows[i, 3], y - along * rows[i, 4], z - along * rows[i, 5]
    n = 1.0 / max(np.sqrt(x * x + y * y + z * z), NOT_ZERO)
    pair[1, 3], pair[1, 4], pair[1, 5] = n * x, n * y, n * z


@njit(nogil=True)
def lays_on_lookalikes(motion: FloatArray, model: Lookalikes) -> bool:
    """Whether a motion (12,) lays every feature on one that looks like it, but for their directions' signs."""
    rows, squared = model.rows, model.tolerance * model.tolerance
    for k in range(len(rows)):
        x, y, z = transform(motion, rows[k, 0], rows[k, 1], rows[k, 2])
        u, v, w = rotate(motion, rows[k, 3], rows[k, 4], rows[k, 5])
        # An edge's ends must come to lie as near as its middle; a curve's normal has no length, but a radius.
        lever = rows[k, 6] if np.isnan(rows[k, 7]) else max(rows[k, 6], rows[k, 7])
        found = False
        for m in range(len(rows)):
            if not model.alike[k, m]:
                continue
            dx, dy, dz = x - rows[m, 0], y - rows[m, 1], z - rows[m, 2]
            if dx * dx + dy * dy + dz * dz >= squared:
                continue
            cx, cy, cz = (
                v * rows[m, 5] - w * rows[m, 4],
                w * rows[m, 3] - u * rows[m, 5],
                u * rows[m, 4] - v * rows[m, 3],
            )
            if (cx * cx + cy * cy + cz * cz) * lever * lever < squared:
                found = True
                break
        if not found:
            return False
    return True


@njit
def _the_same(a: FloatArray, b: FloatArray, model: Lookalikes) -> bool:
    """Whether two motions (12,) differ by less than is told apart; see symmetry.moved."""
    trace = 0.0
    for k in range(9):
        trace += a[k] * b[k]
    ax, ay, az = transform(a, model.middle[0], model.middle[1], model.middle[2])
    bx, by, bz = transform(b, model.middle[0], model.middle[1], model.middle[2])
    gap = ((ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2) / (model.size * model.size)
    return bool(0.25 * max(3.0 - trace, 0.0) + gap < model.same * model.same)


@njit(nogil=True)
def self_motions(i: int, j: int, model: Lookalikes) -> FloatArray:
    """The proper rigid motions that lay a model on itself, as what they make of a pair of its features tells.

    Parameters
    ----------
    i, j : int
        The pair: far from parallel, or a way apart.
    model : Lookalikes

    Returns
    -------
    (m, 12) float64
        Each once, the one that moves nothing first.
    """
    rows, alike = model.rows, model.alike
    pair, other = np.empty((2, 9)), np.empty((2, 9))
    source, target, motion = np.empty(12), np.empty(12), np.empty(12)
    crossing, gap = _crosses(rows, i, j), _apart(rows, i, j)
    _fill_pair(rows, i, j, pair)
    cosine = _cosine(pair)
    pair_frame(pair, 0, 0.0, 1, 1.0, 0.0, source)
    found = np.zeros((4, 12))
    found[0, 0], found[0, 4], found[0, 8] = 1.0, 1.0, 1.0
    count = 1
    for k in range(len(rows)):
        for m in range(len(rows)):
            if k == m or not alike[i, k] or not alike[j, m] or crossing != _crosses(rows, k, m):
                continue
            if abs(_apart(rows, k, m) - gap) >= 2.0 * model.tolerance:
                continue
            _fill_pair(rows, k, m, other)
            # Either direction may be reversed, but the way from one feature to the other may not.
            for which in range(4 if crossing else 2):
                turn = 1.0 - 2.0 * (which // 2 if crossing else which)
                flip = turn * (1.0 - 2.0 * (which % 2) if crossing else 1.0)
                if abs(flip * _cosine(other) - cosine) > model.same:
                    continue
                pair_frame(other, 0, 0.0, 1, flip, 0.0, target)
                pair_pose(target, source, turn, motion)
                known = False
                for one in range(count):
                    known = known or _the_same(found[one], motion, model)
                if known or not lays_on_lookalikes(motion, model):
                    continue
                if count == len(found):
                    found = np.concatenate((found, np.empty_like(found)))
                found[count] = motion
                count += 1
    return found[:count]


@njit
def _cosine(pair: FloatArray) -> float:
    """Of the angle between the directions of a pair (2, 9)."""
    return float(pair[0, 3] * pair[1, 3] + pair[0, 4] * pair[1, 4] + pair[0, 5] * pair[1, 5])


@njit
def _apart(rows: FloatArray, i: int, j: int) -> float:
    """Metres between two features' middles."""
    return float(
        np.sqrt((rows[j, 0] - rows[i, 0]) ** 2 + (rows[j, 1] - rows[i, 1]) ** 2 + (rows[j, 2] - rows[i, 2]) ** 2)
    )
