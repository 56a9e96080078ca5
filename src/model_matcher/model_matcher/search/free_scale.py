"""Matching data of unknown scale (structure from motion, thesis 5.5): directions come first, the scale is estimated.

Angles between features do not depend on the scale; the distances of the lines, pair by pair, do so all alike. On a
logarithmic axis the distances of a model's pairs stand among those of the data's, shifted by the scale: the correlation
of the two, angle by angle, ranks the scales worth a search. At one of them the data is searched as of known scale; the
scale that fits what was found best is then estimated with the pose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from msgs_py import BIN, FeatureKind, FeatureSet, Interpretation, Pose
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.typed import FloatArray, IntArray

from ..geometry.settings import ROUNDING, SMALLEST_LENGTH
from ..interpretation_tree.absolute_pose import validate
from ..interpretation_tree.match import feasible
from ..interpretation_tree.settings import FIRST_FRACDEV
from ..model.index import ModelIndex, feature_rows
from ..model.problem import make_problem
from ..params import MatchParams, MatchResult, no_match
from ..verification.acceptance import accept
from ..verification.refinement import refine_all
from ..verification.settings import CANDIDATES
from .settings import (
    ALL_PAIRED,
    ANGLE_CLASSES,
    SCALE_STEP,
    SCALE_SURROUNDINGS,
    SCALE_TIME,
    SCALES,
    SHARES,
    SHORTEST_DISTANCE,
    UNCHANGED_SCALES,
)

Search = Callable[[ModelIndex, FeatureSet, MatchParams], MatchResult]


def match_free(
    index: ModelIndex, data: FeatureSet, params: MatchParams, deadline: Deadline, search: Search
) -> MatchResult:
    """Find a model in data of unknown scale; poses carry it: data = scale R model + t.

    Parameters
    ----------
    index : ModelIndex
    data : FeatureSet
        Camera frame, any unit.
    params : MatchParams
    deadline : Deadline
    search : callable
        Finds the model in data of known scale. The searches of the thesis are run once, on directions only.

    Returns
    -------
    MatchResult

    References
    ----------
    Thesis 5.5.

    """
    if params.search != 'hypotheses':
        return _by_directions(index, data, params, deadline)
    known = params.replace(scale='known', prove=False, false_alarm_rate=params.false_alarm_rate / SCALES)
    best: MatchResult | None = None
    best_scale = 1.0
    tried = since = 0
    searching = deadline.share(SHARES.searching)
    for scale in likely_scales(index, data):
        if tried >= SCALES or (best and since >= UNCHANGED_SCALES) or (tried and searching.passed):
            break
        # No scale is to have all the time.
        seconds = max(min(deadline.left, SCALE_TIME * params.time_limit_s), 1e-3)
        found = search(index, resized(data, 1.0 / scale), known.replace(time_limit_s=seconds))
        tried += 1
        since += 1
        if _rank(found) > _rank(best):
            best, best_scale, since = found, scale, 0
    stats = {'data_features': len(data), 'scales': tried, 'search': params.search}
    if best is None:
        return no_match(data, 'the data holds no two features that would tell a scale', **stats)
    estimated: list[Interpretation] = []
    for k, found_one in enumerate(best.interpretations):
        if k == 0 or not deadline.passed:
            one = estimate_scale(index, data, found_one, best_scale, known, deadline)
            estimated += [] if one is None else [one]
    accepted = tuple(estimated)
    rejected = tuple(_with_scale(one, best_scale) for one in best.rejected)
    stats.update({name: value for name, value in best.stats.items() if name not in stats})
    return MatchResult(accepted, rejected, stats, best.reason if not accepted else None)


def _by_directions(index: ModelIndex, data: FeatureSet, params: MatchParams, deadline: Deadline) -> MatchResult:
    """A tree search without the constraints that need a scale; what it finds is validated with its own scale."""
    unit = next(likely_scales(index, data), 1.0)  # only to make the tolerances' floor comparable
    near = resized(data, 1.0 / unit)
    problem = make_problem(index, near, params)
    stats = {'data_features': len(data), 'search': params.search}
    if len(problem.rows) == 0:
        return no_match(data, 'the data holds no features with length', **stats)
    try:
        result = feasible(problem, params, deadline)
    except ValueError as error:
        return no_match(data, str(error), **stats)
    stats.update(feasible=len(result.assignments), complete=result.complete, **result.stats)
    if not len(result.assignments):
        return no_match(data, 'no feasible interpretation' + ('' if result.complete else ' in time'), **stats)
    checked = validate(
        index.features,
        problem.data,
        result.assignments,
        result.signs,
        FIRST_FRACDEV * params.fracdev,
        params.curvedev,
        index.size,
        scale_free=True,
    )
    order = np.lexsort((np.nan_to_num(checked.deviations).max(axis=1), -checked.passed.sum(axis=1)))[:CANDIDATES]
    known = params.replace(scale='known', prove=False)
    estimated: list[Interpretation] = []
    for k in order:
        pose = checked.poses[k]
        assignment, sign = np.full(len(data), BIN, np.int32), np.zeros(len(data), np.int8)
        matched = result.assignments[k] != BIN
        assignment[problem.keep[matched]] = index.source[result.assignments[k][matched]]
        sign[problem.keep[matched]] = checked.signs[k][matched]
        found = Interpretation(index.name, assignment, sign, Pose(pose.rotation, pose.translation / pose.scale))
        one = estimate_scale(index, near, found, pose.scale, known, deadline)
        if one is not None and not any((one.assignment == other.assignment).all() for other in estimated):
            estimated.append(one)
    estimated.sort(key=lambda one: (-len(np.unique(one.assignment)), one.residual_rms))
    accepted = tuple(_with_scale(one, unit) for one in estimated[: params.max_interpretations])
    return MatchResult(accepted, (), stats, None if accepted else 'no feasible interpretation is a similarity')


def _rank(result: MatchResult | None) -> tuple[int, int, float]:
    """Accepted before rejected, then by distinct model features, then by fit."""
    if result is None:
        return -1, 0, 0.0
    one = result.best or (result.rejected[0] if result.rejected else None)
    if one is None:
        return 0, 0, 0.0
    distinct = len(np.unique(one.assignment[one.assignment != BIN]))
    return int(bool(result)), distinct, -one.residual_rms


def resized(data: FeatureSet, factor: float) -> FeatureSet:
    """The data with all lengths and errors times a factor.

    Parameters
    ----------
    data : FeatureSet
    factor : float

    Returns
    -------
    FeatureSet

    Examples
    --------
    >>> edge = FeatureSet.from_edges([[0.0, 0.0, 1.0]], [[0.5, 0.0, 1.0]])
    >>> resized(edge, 2.0).lengths.tolist()
    [1.0]

    """
    return data.transformed(Pose(np.eye(3), np.zeros(3), factor))


def likely_scales(index: ModelIndex, data: FeatureSet) -> Iterator[float]:
    """Scales of the data, the likeliest first.

    Parameters
    ----------
    index : ModelIndex
    data : FeatureSet

    Yields
    ------
    float
        Lengths of the data over those of the model.

    """
    shortest = 3.0 * float(np.median(np.hypot(data.err_par, data.err_per))) if len(data) else 0.0
    mine, theirs = _distances(feature_rows(data), shortest), _distances(index.rows, 0.0)
    if not len(mine[0]) or not len(theirs[0]):
        return
    low, high = np.log(theirs[0].min()), np.log(theirs[0].max())
    first, last = np.log(mine[0].min()), np.log(mine[0].max())
    model_bins, data_bins = int((high - low) / SCALE_STEP) + 1, int((last - first) / SCALE_STEP) + 1
    total = np.zeros(model_bins + data_bins - 1)
    for angle in range(ANGLE_CLASSES):
        a, b = mine[1] == angle, theirs[1] == angle
        if not a.any() or not b.any():
            continue
        data_counts = _counts(mine[0][a], mine[2][a], first, data_bins)
        model_counts = _counts(theirs[0][b], np.ones(int(b.sum())), low, model_bins)
        total += np.correlate(data_counts, model_counts, mode='full') / model_counts.sum()
    if not total.any():
        return
    # What stands out above its surroundings is more than the plenty of some length.
    background = np.convolve(
        np.pad(total, SCALE_SURROUNDINGS),
        np.full(2 * SCALE_SURROUNDINGS + 1, 1.0 / (2 * SCALE_SURROUNDINGS + 1)),
        mode='valid',
    )
    merit = (total - background) / np.sqrt(background + 0.01 * total.max())
    shifts = (np.arange(len(total)) - (model_bins - 1)) * SCALE_STEP + first - low
    taken = np.zeros(len(total), bool)
    for at in np.argsort(-merit, kind='stable'):
        if not taken[at]:
            taken[max(at - 1, 0) : at + 2] = True
            yield float(np.exp(shifts[at]))


def _counts(lengths: FloatArray, weights: FloatArray, first: float, bins: int) -> FloatArray:
    """Smoothed histogram of logarithms; a length between two bins counts in both."""
    at = (np.log(lengths) - first) / SCALE_STEP
    low = np.minimum(at.astype(int), bins - 1)
    part = np.clip(at - low, 0.0, 1.0)
    counts = np.bincount(low, weights * (1.0 - part), bins)
    return np.asarray(counts + np.bincount(np.minimum(low + 1, bins - 1), weights * part, bins), np.float64)


def _distances(rows: FloatArray, shortest: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Distances between the lines of all pairs, their class of angle, and their weight: pairs near each other count."""
    rows = rows[np.argsort(-rows[:, 6], kind='stable')[:ALL_PAIRED]]
    i, j = np.triu_indices(len(rows), 1)
    u, v, w = rows[i, 3:6], rows[j, 3:6], rows[j, :3] - rows[i, :3]
    normal = np.cross(u, v)
    sine = np.linalg.norm(normal, axis=1)
    angle = np.arctan2(sine, np.abs((u * v).sum(axis=1)))
    group = np.minimum((angle / (0.5 * np.pi) * (ANGLE_CLASSES - 1) + 0.5).astype(int), ANGLE_CLASSES - 1)
    across = np.abs((w * normal).sum(axis=1)) / np.maximum(sine, 1e-12)
    apart = np.linalg.norm(w - (w * u).sum(axis=1)[:, None] * u, axis=1)
    lengths = np.where(group == 0, apart, across)
    reach = np.linalg.norm(w, axis=1)
    # Points, such as the centres of curves, have their distance; a line through the other has none.
    points = (rows[i, 6] == 0.0) & (rows[j, 6] == 0.0)
    lengths = np.where(points, reach, lengths)
    usual = np.median(reach) if len(reach) else 1.0
    weights = np.exp(-reach / max(float(usual), SMALLEST_LENGTH))
    # A feature's own length counts as well: most are seen whole.
    whole = 2.0 * rows[:, 6]
    lengths = np.concatenate([lengths, whole[whole > 0.0]])
    group = np.concatenate([group, np.full(int((whole > 0.0).sum()), ANGLE_CLASSES - 1)])
    weights = np.concatenate([weights, np.full(int((whole > 0.0).sum()), 0.5)])
    keep = lengths > max(SHORTEST_DISTANCE * float(lengths.max(initial=0.0)), shortest, SMALLEST_LENGTH)
    return lengths[keep], group[keep], weights[keep]


def estimate_scale(
    index: ModelIndex,
    data: FeatureSet,
    found: Interpretation,
    scale: float,
    params: MatchParams,
    deadline: Deadline | None = None,
) -> Interpretation | None:
    """Estimate scale and pose of an interpretation by turns.

    Parameters
    ----------
    index : ModelIndex
    data : FeatureSet
        As observed.
    found : Interpretation
        Of the data divided by ``scale``.
    scale : float
        About the right one: lengths of the data over those of the model.
    params : MatchParams
        Of known scale.
    deadline : Deadline, optional
        When it has passed, no turn begins but the first.

    Returns
    -------
    Interpretation or None
        Of the data as observed; None when at the better scale nothing is accepted any more.

    """
    current, factor = found, np.inf
    while True:
        before = abs(factor - 1.0)
        factor = _better_scale(index, resized(data, 1.0 / scale), current)
        scale *= factor
        problem = make_problem(index, resized(data, 1.0 / scale), params)
        # The old pose, shrunk with the data.
        motion = np.concatenate([current.pose.rotation.ravel(), current.pose.translation / factor])
        refined = refine_all(problem, motion[None], np.array([float(current.matched)]), params, keep=0.0)
        accepted, _ = accept(problem, refined, params)
        if not accepted:
            return None
        current = accepted[0]
        # Until the scale changes by rounding only.
        if not ROUNDING < abs(factor - 1.0) < before or (deadline is not None and deadline.passed):
            break
    return _with_scale(current, scale)


def _better_scale(index: ModelIndex, data: FeatureSet, found: Interpretation) -> float:
    """By how much the data is still too large; 1 when the matched features leave that open."""
    used = found.data_indices
    number = {int(source): k for k, source in enumerate(index.source)}
    chosen = np.array([number[int(j)] for j in found.assignment[used]])
    checked = validate(
        index.features, data.select(used), chosen[None], found.sign[None, used], 1.0, 1e6, index.size, scale_free=True
    )
    factor = checked.poses[0].scale
    return factor if 0.5 < factor < 2.0 and not _scale_is_open(index, chosen, found) else 1.0


def _scale_is_open(index: ModelIndex, chosen: FloatArray, found: Interpretation) -> bool:
    """Whether all matched lines meet in one point, or are parallel to one another in one line: any scale fits then."""
    rows = index.rows[chosen]
    lines = index.kind[chosen] != FeatureKind.CURVE
    u = rows[:, 3:6] * lines[:, None]
    across = np.eye(3) - u[:, :, None] * u[:, None, :]
    middle = rows[:, :3].mean(axis=0)
    gaps = np.einsum('kij,kj->ki', across, rows[:, :3] - middle)
    shift, *_ = np.linalg.lstsq(across.reshape(-1, 3), gaps.ravel(), rcond=None)
    left = gaps - across @ shift
    return bool((left**2).sum() < ROUNDING * index.size**2)


def _with_scale(one: Interpretation, scale: float) -> Interpretation:
    """An interpretation of data / scale as one of the data itself."""

    def scaled(pose: Pose) -> Pose:
        return Pose(pose.rotation, pose.translation * scale, pose.scale * scale)

    covariance = None
    if one.covariance is not None:
        units = np.array([scale] * 3 + [1.0] * 3)
        covariance = one.covariance * units[:, None] * units
    return replace(
        one,
        pose=scaled(one.pose),
        symmetric_poses=tuple(map(scaled, one.symmetric_poses)),
        ambiguous_poses=tuple(map(scaled, one.ambiguous_poses)),
        covariance=covariance,
        residual_rms=one.residual_rms * scale,
    )
