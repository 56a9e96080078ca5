"""The production search: two non-parallel data features fix a pose; back-projection counts what it explains.

Ranked data pairs are looked up in the model's pair table by angle and signed line distance, tested exactly for a
common rigid motion, turned into a pose, and the pose is scored by the number of distinct model features that data lie
on. The best poses, near duplicates suppressed, are the candidates. Cost hardly depends on how much data is spurious.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int32Array, IntArray

from ..geometry.back_projection import count_matches
from ..geometry.features import DataFeatures, ModelFeatures, PairTable
from ..geometry.pair_pose import fits_a_third, into_frame, matching_pairs, pair_frame, pair_pose, pair_window, room_for
from ..geometry.rigid_motion import transform
from ..model.settings import SAME_POSE
from ..verification.settings import CANDIDATES, NEARLY_ALL
from .settings import LITTLE_EXPLAINED, LONGER, NEAR, NEEDED, REMEMBERED, WORTH_KEEPING


class Candidates(NamedTuple):
    """The best poses so far, best first: motions (c, 12) and scores (c,), 0 where there is none yet."""

    motions: FloatArray
    scores: FloatArray


@njit
def kept(scores: FloatArray) -> int:
    """How many candidates are kept: CANDIDATES, and all only where those are nearly as good as the best, as of a grid.

    Parameters
    ----------
    scores : (c,) float64
        Best first.

    Examples
    --------
    >>> kept(np.linspace(20.0, 1.0, 64)), kept(np.full(64, 20.0))
    (32, 64)
    """
    few = min(CANDIDATES, len(scores))
    return few if np.floor(scores[few - 1]) < NEARLY_ALL * np.floor(scores[0]) else len(scores)


@njit
def worth_keeping(scores: FloatArray, least: float) -> float:
    """The score from which on a pose is kept among candidates with these scores, and ``least`` in any case."""
    worth: float = max(scores[kept(scores) - 1], WORTH_KEEPING * np.floor(scores[0]), least)
    return worth


@njit
def keep_candidate(motion: FloatArray, score: float, model: ModelFeatures, candidates: Candidates) -> None:
    """Keep a pose among the best, unless a better one stands near it (SAME_POSE).

    Parameters
    ----------
    motion : (12,) float64
    score : float
    model : ModelFeatures
    candidates : Candidates
        Changed in place.

    """
    motions, scores, middle = candidates.motions, candidates.scores, model.middle
    twin = -1
    mx, my, mz = transform(motion, middle[0], middle[1], middle[2])
    for k in range(len(scores)):
        if scores[k] <= 0.0:
            break
        other = motions[k]
        trace = 0.0
        for i in range(9):
            trace += motion[i] * other[i]
        ox, oy, oz = transform(other, middle[0], middle[1], middle[2])
        dx, dy, dz = mx - ox, my - oy, mz - oz
        # 3 - trace of the turn between them is the squared chord of its angle.
        turned = (3.0 - trace) * (0.5 * model.size) ** 2
        if turned + dx * dx + dy * dy + dz * dz > (SAME_POSE * model.size) ** 2:
            continue
        if scores[k] >= score:
            return
        twin = k
        break
    at = len(scores) - 1 if twin < 0 else twin
    if twin < 0 and score <= scores[at]:
        return
    while at > 0 and scores[at - 1] < score:
        scores[at] = scores[at - 1]
        motions[at] = motions[at - 1]
        at -= 1
    scores[at] = score
    motions[at] = motion


@njit(nogil=True)
def gather(data: DataFeatures, a: int, reach: float, widen: float, around: DataFeatures) -> int:
    """Copy what can lie on a model that data feature a lies on: all within reach (metres) and its own tolerances.

    widen : tolerances count this many times; around : filled; returns how many there are
    """
    rows, tols = data.rows, data.tolerances
    count = 0
    for k in range(rows.shape[0]):
        x, y, z = rows[k, 0] - rows[a, 0], rows[k, 1] - rows[a, 1], rows[k, 2] - rows[a, 2]
        limit = reach + widen * (tols[k, 0] + tols[k, 1])
        if x * x + y * y + z * z <= limit * limit:
            for i in range(9):
                around.rows[count, i] = rows[k, i]
            for i in range(3):
                around.tolerances[count, i] = tols[k, i]
            around.kind[count] = data.kind[k]
            count += 1
    return count


@njit
def _partners_of_both(partners: Int32Array, a: int, b: int, p: int, entered: IntArray, near: Int32Array) -> None:
    """Numbers of the best partners of a data pair, number p, into near; -1 ends them. entered : (n,), scratch space."""
    knn = min(partners.shape[1], NEAR)
    count = 0
    for k in range(2 * knn):
        other = partners[a, k] if k < knn else partners[b, k - knn]
        if other >= 0 and entered[other] != p:
            entered[other] = p
            near[count] = other
            count += 1
    near[count] = -1


@njit
def _place_of(model_pair: FloatArray, turn: float, step: float, size: float, p: int) -> int:
    """A number for the pose that a model pair gives data pair p: the same for poses that differ by no more than a step.

    model_pair : (12,), its frame and place; turn : see :func:`.pair_pose.pair_pose`
    step, size : metres; what a turn moves is measured at half the model's size
    """
    number = p + 1
    turned = 0.5 * size / step
    for k in range(9):
        if k < 3:
            cell = np.floor(turned * turn * model_pair[k])
        elif k < 6:
            cell = np.floor(turned * model_pair[3 + k])
        else:
            cell = np.floor(model_pair[3 + k] / step)
        # Multiplied by a large odd number and folded, neighbouring cells are far apart (Knuth, vol. 3, 6.4).
        number = (number ^ int(cell)) * 0x5851F42D4C957F2D
        number ^= number >> 29
    return number


@njit(nogil=True)
def _has_waited(hypotheses: int, best: float, features: tuple[int, int], patience: tuple[float, float]) -> bool:
    """Whether so many hypotheses without a better pose than the best score are enough.

    features : of the data, and of the model; patience : see :func:`search_pairs`
    """
    n, of_model = features
    share = n / max(np.floor(best), NEEDED)
    longer = LONGER if max(best, NEEDED) < LITTLE_EXPLAINED * of_model else 1.0
    enough: bool = hypotheses > longer * min(patience[0] * share * share, patience[1]) or best >= n
    return enough


@njit(nogil=True)
def merge(more: Candidates, model: ModelFeatures, candidates: Candidates) -> None:
    """Keep of further candidates those that are worth it, as :func:`keep_candidate` does."""
    for k in range(len(more.scores)):
        if more.scores[k] <= 0.0:
            break
        keep_candidate(more.motions[k], more.scores[k], model, candidates)


@njit(nogil=True)
def search_pairs(
    pairs: Int32Array,
    partners: Int32Array,
    model: ModelFeatures,
    table: PairTable,
    data: DataFeatures,
    widen: float,
    first: int,
    last: int,
    patience: tuple[float, float],
    candidates: Candidates,
    state: IntArray,
) -> None:
    """Try the ranked data pairs from first to last - 1 and keep the best poses.

    A pair of data features is always finished, so that every pose which explains the same data is found.

    Parameters
    ----------
    pairs : (p, 2) int32
    partners : (n, knn) int32
        As :func:`.line_pairs.rank_pairs` gives them. With much data, a pose must explain one of the best partners of
        the pair's features besides the pair itself, or the rest of the data is not looked at.
    model : ModelFeatures
    table : PairTable
        Of the model.
    data : DataFeatures
    widen : float
        Tolerances count this many times: a pose from two short edges is off by more than the data's own error.
    first, last : int
    patience : tuple of 2 float
        Stopping rule (least, most): stop once the best is unchanged for so many hypotheses: least x the square of data
        per explained model feature, at most ``most``; LONGER times that while LITTLE_EXPLAINED.
    candidates : Candidates
        Changed in place.
    state : (4,) int64
        Carried between calls: hypotheses so far, hypothesis of the last improvement, pairs done, 1 when stopped by the
        stopping rule.

    """
    scores = candidates.scores
    stamp = np.zeros(model.rows.shape[0], np.int64)
    data_pair, model_pair, motion = np.empty(12), np.empty(12), np.empty(12)
    n = data.rows.shape[0]
    knn = min(partners.shape[1], NEAR)
    local = n > 2 * knn
    near = room_for(2 * knn + 1)
    entered = np.full(n, -1, np.int64)
    around = DataFeatures(data.rows.copy(), data.kind.copy(), data.tolerances.copy(), data.radius_tolerance)
    found = np.empty(2 * table.members.shape[0], np.int32)
    seen = np.zeros(REMEMBERED, np.int64)
    for p in range(first, last):
        a, b = pairs[p, 0], pairs[p, 1]
        window = pair_window(data, a, b)
        before = state[1]
        hypotheses = matching_pairs(data, model, table, a, b, window, found)
        # With little data all of it is looked at; otherwise what is near enough, gathered when it is needed first.
        n_around = -1 if local else n
        count = 0
        if hypotheses:
            pair_frame(data.rows, a, window.foot_a, b, window.flip, window.foot_b, data_pair)
            if local:
                _partners_of_both(partners, a, b, p, entered, near.features)
                count = into_frame(a, b, data_pair, data, near.features, widen, model.voxels.per_metre, near)
        placed = -1
        # Poses nearer to one another than what the pair itself may be off are one: the first is looked at.
        step = min(data.tolerances[a, 0], data.tolerances[b, 0])
        for hypothesis in range(hypotheses):
            at, turn = found[hypothesis] // 2, 1.0 - 2.0 * (found[hypothesis] % 2)
            i, j, values = table.members[at, 0], table.members[at, 1], table.values
            state[0] += 1
            if placed != at:
                pair_frame(model.rows, i, values[at, 2], j, values[at, 4], values[at, 3], model_pair)
                placed = at
            place = _place_of(model_pair, turn, step, model.size, p)
            if seen[place % REMEMBERED] == place:
                continue
            if local and not fits_a_third(model_pair, turn, i, j, count, near, model, data):
                continue
            seen[place % REMEMBERED] = place
            pair_pose(data_pair, model_pair, turn, motion)
            if n_around < 0:
                reach = model.size + window.slide_a + window.across + window.cone * abs(window.foot_a)
                n_around = gather(data, a, reach, widen, around)
            needed = worth_keeping(scores, NEEDED)
            some = DataFeatures(
                around.rows[:n_around], around.kind[:n_around], around.tolerances[:n_around], data.radius_tolerance
            )
            score = count_matches(motion, model, some, widen, stamp, state[0], needed)
            if score < needed:
                continue
            if np.floor(score) > np.floor(scores[0]):
                state[1] = state[0]
            keep_candidate(motion, score, model, candidates)
        state[2] = p + 1
        if before != state[1]:
            continue
        if _has_waited(state[0] - state[1], scores[0], (n, model.rows.shape[0]), patience):
            state[3] = 1
            return
