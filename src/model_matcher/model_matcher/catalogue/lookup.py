"""The compiled lookup: pairs of a scene in the index, and what the poses explain that follow from what is found.

A data pair is looked up in all cells that its errors reach. Each model pair that it may lie on gives a pose; the pose
is tried on the neighbours of the pair, and then on all data. Rows, tolerances and motions as in geometry/features.py.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import ByteArray, Float32Array, FloatArray, Int32Array, Int64Array, UInt32Array

from ..geometry.back_projection import fit_one
from ..geometry.features import CURVE, DataFeatures, FeatureRows
from ..geometry.line_pairs import pair_geometry
from ..geometry.pair_pose import pair_frame, pair_pose
from ..geometry.parallel_pairs import offsets, parallel_pose
from ..geometry.rigid_motion import inverse_rotate, inverse_transform
from ..geometry.settings import FLIP_MARGIN
from .pair_table import feature_size
from .records import Models, Postings, Scale, angle_cell, apart_cell, cell_of, group_of, on_scale, size_cell
from .settings import ANGLES, CURVE_STEP, SHOWN, Round


class Scene(NamedTuple):
    """A scene's features, and what they may be off for models of several sizes.

    Attributes
    ----------
    rows : (n, 9) float64
        Camera frame.
    kind : (n,) uint8
    tolerances : (c, n, 3) float64
        For each class of sizes, see :func:`.index.data_tolerances`.
    classes : (m,) uint8
        The class of each model.
    curvedev : float
        In largest radii of a model: what a radius may be off besides.
    """

    rows: FloatArray
    kind: ByteArray
    tolerances: FloatArray
    classes: ByteArray
    curvedev: float


class ScenePairs(NamedTuple):
    """Pairs of a scene that are looked up.

    Attributes
    ----------
    members : (p, 2) int32
        Of crossing pairs the lower kind first, of parallel ones the curve.
    parallel : (p,) uint8
    near : (p, k) int32
        Data features near each pair, -1 at the end.
    """

    members: Int32Array
    parallel: ByteArray
    near: Int32Array


class Hits(NamedTuple):
    """What the data pairs hit, one model after the other; in a model one data pair after the other.

    Attributes
    ----------
    starts : (m + 1,) int64
        Where those of each model begin.
    hits : (h,) int64
        Twice the number of the posting, plus 1 where its features come in the other order than the pair's.
    pair : (h,) int32
        The data pair of each.
    """

    starts: Int64Array
    hits: Int64Array
    pair: Int32Array


class Votes(NamedTuple):
    """What the best pose of each model explains.

    Attributes
    ----------
    nats : (m,) float32
        -inf where no pose explains a third feature.
    motions : (m, 12) float32
    """

    nats: Float32Array
    motions: Float32Array


class Window(NamedTuple):
    """What a model pair may be that a data pair lies on: radians and metres.

    Attributes
    ----------
    angle, distance, foot_a, foot_b
        Of the data pair; of a parallel one the angle is 0, the distance that of the lines, and foot_a the place of b's
        mid point along a.
    cone, across, slide_a, slide_b
        What they may be off. Errors of the two features are independent: the roots of sums of squares.
    """

    angle: float
    distance: float
    foot_a: float
    foot_b: float
    cone: float
    across: float
    slide_a: float
    slide_b: float


@njit
def window_of(data: DataFeatures, a: int, b: int, parallel: bool) -> Window:
    """What a model pair may be that data features a and b lie on."""
    rows, tols = data.rows, data.tolerances
    cone = min(np.hypot(tols[a, 2], tols[b, 2]), FLIP_MARGIN)
    across = np.hypot(tols[a, 0], tols[b, 0])
    if parallel:
        apart, along, _ = offsets(rows[a], rows[b])
        # The direction is that of the first, a curve's normal.
        tilt = min(tols[a, 2], tols[b, 2])
        slide = np.hypot(across, tilt * apart)
        return Window(
            0.0,
            apart,
            along,
            0.0,
            cone,
            np.hypot(across, tilt * along),
            slide,
            slide if kind_is_curve(data, b) else np.hypot(slide, tols[b, 1]),
        )
    c, s, d, foot_a, foot_b, _ = pair_geometry(rows[a], rows[b])
    over_a, over_b = max(0.0, abs(foot_a) - rows[a, 6]), max(0.0, abs(foot_b) - rows[b, 6])
    across = np.sqrt(across * across + (tols[a, 2] * over_a) ** 2 + (tols[b, 2] * over_b) ** 2)
    return Window(
        np.arctan2(s, c),
        d,
        foot_a,
        foot_b,
        cone,
        across,
        np.hypot(tols[a, 1], across / s),
        np.hypot(tols[b, 1], across / s),
    )


@njit
def kind_is_curve(data: DataFeatures, a: int) -> bool:
    """Whether a data feature is a curve."""
    return bool(data.kind[a] == CURVE)


@njit
def _of_class(scene: Scene, number: int, radius: float) -> DataFeatures:
    """A scene's features against models of one class; radius : metres, the largest of the model."""
    return DataFeatures(scene.rows, scene.kind, scene.tolerances[number], scene.curvedev * radius)


@njit
def _sizes(data: DataFeatures, a: int, slide: float, scale: Scale, curvedev: float) -> tuple[int, int]:
    """Cells of the sizes, first and last, of a model feature that data feature a shows enough of."""
    size = feature_size(data.rows, data.kind, a)
    if data.kind[a] == CURVE:
        off = np.hypot(data.tolerances[a, 0], curvedev * size)
        low, high = size - off, size + off
    else:
        low, high = size - 2.0 * slide, size / SHOWN
    curve = data.kind[a] == CURVE
    return size_cell(low, curve, scale.floor, scale.share), size_cell(high, curve, scale.floor, scale.share)


@njit
def _angles(window: Window, both_curves: bool, parallel: bool, scale: Scale) -> tuple[int, int]:
    """Cells of the angle, first and last; of two parallel curves those of their distance along the axis."""
    if not parallel:
        # What lies beyond a right angle is found on this side of it.
        high = window.angle + window.cone
        if high > 0.5 * np.pi:
            return angle_cell(min(window.angle - window.cone, np.pi - high)), ANGLES - 1
        return angle_cell(window.angle - window.cone), angle_cell(high)
    if not both_curves:
        return 0, 0
    along = abs(window.foot_a)
    low = on_scale(along - window.slide_a, scale.floor, scale.share) / CURVE_STEP
    high = on_scale(along + window.slide_a, scale.floor, scale.share) / CURVE_STEP
    return min(int(low), ANGLES - 1), min(int(high), ANGLES - 1)


@njit
def _cells(
    data: DataFeatures, a: int, b: int, parallel: bool, window: Window, scale: Scale, curvedev: float, out: Int64Array
) -> None:
    """Fill (10,): the group, and the first and last cell of angle, distance and the two sizes."""
    out[0] = group_of(data.kind[a], data.kind[b], parallel)
    both = data.kind[a] == CURVE and data.kind[b] == CURVE
    out[1], out[2] = _angles(window, both, parallel, scale)
    distance = abs(window.distance)
    out[3] = apart_cell(distance - window.across, scale.floor, scale.share)
    out[4] = apart_cell(distance + window.across, scale.floor, scale.share)
    out[5], out[6] = _sizes(data, a, window.slide_a, scale, curvedev)
    out[7], out[8] = _sizes(data, b, window.slide_b, scale, curvedev)


@njit(nogil=True)
def count_postings(scene: Scene, pairs: ScenePairs, starts: Int64Array, scale: Scale, counts: Int64Array) -> None:
    """How many pairs of models stand in the cells that each data pair reaches; counts : (p,), filled."""
    cells = np.empty(10, np.int64)
    data = _of_class(scene, len(scene.tolerances) - 1, 0.0)
    for p in range(len(pairs.members)):
        counts[p] = 0
        for order in range(2):
            a, b = pairs.members[p, order], pairs.members[p, 1 - order]
            parallel = pairs.parallel[p] == 1
            if order == 1 and scene.kind[a] != scene.kind[b]:
                break
            window = window_of(data, a, b, parallel)
            _cells(data, a, b, parallel, window, scale, scene.curvedev, cells)
            for angle in range(cells[1], cells[2] + 1):
                for apart in range(cells[3], cells[4] + 1):
                    for size in range(cells[5], cells[6] + 1):
                        cell = cell_of(cells[0], angle, apart, size, 0)
                        counts[p] += starts[cell + cells[8] + 1] - starts[cell + cells[7]]


@njit
def _inside(low: float, high: float, first: float, last: float, slide: float) -> bool:
    """Whether a piece from low to high lies on an edge from first to last, but for a slide."""
    return low >= first - slide and high <= last + slide


@njit
def _possible(span: Float32Array, data: DataFeatures, a: int, b: int, parallel: bool, window: Window) -> bool:
    """Whether a data pair may lie on a model pair of these spans, whichever way their directions run."""
    if abs(span[0] - abs(window.distance)) > window.across:
        return False
    half_a, half_b = data.rows[a, 6], data.rows[b, 6]
    slide = window.slide_a
    if parallel and data.kind[b] != CURVE:
        # A piece of an edge lies anywhere along it.
        slide += window.slide_b + max(0.0, 0.5 * (span[4] - span[3]) - half_b)
    on_a = _inside(-half_a - window.foot_a, half_a - window.foot_a, span[1], span[2], slide) or _inside(
        -half_a + window.foot_a, half_a + window.foot_a, span[1], span[2], slide
    )
    if parallel or not on_a:
        return bool(on_a)
    return bool(
        _inside(-half_b - window.foot_b, half_b - window.foot_b, span[3], span[4], window.slide_b)
        or _inside(-half_b + window.foot_b, half_b + window.foot_b, span[3], span[4], window.slide_b)
    )


@njit(nogil=True)
def gather(
    scene: Scene,
    pairs: ScenePairs,
    p: int,
    models: Models,
    postings: Postings,
    scale: Scale,
    share: tuple[int, int],
    hits: Int64Array,
) -> int:
    """Look up a data pair: the model pairs that it may lie on.

    Parameters
    ----------
    scene, pairs, models, postings, scale
    p : int
        The data pair.
    share : tuple of int
        The models first to last - 1 of which are asked for.
    hits : (h,) int64
        Filled, see :class:`Hits`.

    Returns
    -------
    int
        How many there are.

    """
    cells = np.empty(10, np.int64)
    classes = len(scene.tolerances)
    parallel = pairs.parallel[p] == 1
    widest = _of_class(scene, classes - 1, 0.0)
    count = 0
    for order in range(2):
        a, b = pairs.members[p, order], pairs.members[p, 1 - order]
        if order == 1 and scene.kind[a] != scene.kind[b]:
            break
        _cells(widest, a, b, parallel, window_of(widest, a, b, parallel), scale, scene.curvedev, cells)
        windows = [window_of(_of_class(scene, c, 0.0), a, b, parallel) for c in range(classes)]
        for angle in range(cells[1], cells[2] + 1):
            for apart in range(cells[3], cells[4] + 1):
                for size in range(cells[5], cells[6] + 1):
                    row = cell_of(cells[0], angle, apart, size, 0)
                    for cell in range(row + cells[7], row + cells[8] + 1):
                        low, high = postings.starts[cell], postings.starts[cell + 1]
                        if share[0] > 0:
                            low += np.searchsorted(postings.owner[low:high], share[0])
                        for at in range(low, high):
                            model = postings.owner[at]
                            if model >= share[1]:
                                break
                            # Only a damaged index names features that a model does not have.
                            features = models.starts[model + 1] - models.starts[model]
                            if max(postings.members[at, 0], postings.members[at, 1]) >= features:
                                continue
                            size_class = scene.classes[model]
                            data = _of_class(scene, size_class, 0.0)
                            if _possible(postings.spans[at], data, a, b, parallel, windows[size_class]):
                                hits[count] = 2 * at + order
                                count += 1
    return count


@njit(nogil=True)
def by_model(found: Int64Array, limits: Int64Array, owner: UInt32Array, hits: Hits) -> None:
    """Sort what data pairs hit by models.

    Parameters
    ----------
    found : (h,) int64
        As :func:`gather` fills it, one data pair after the other.
    limits : (p + 1,) int64
        Where those of each data pair begin.
    owner : (q,) uint32
        The model of each posting.
    hits : Hits
        Filled; its starts are zeros before.

    """
    starts = hits.starts
    for hit in found:
        starts[owner[hit // 2] + 1] += 1
    for model in range(len(starts) - 1):
        starts[model + 1] += starts[model]
    cursor = starts[:-1].copy()
    for p in range(len(limits) - 1):
        for h in range(limits[p], limits[p + 1]):
            at = cursor[owner[found[h] // 2]]
            cursor[owner[found[h] // 2]] += 1
            hits.hits[at], hits.pair[at] = found[h], p


@njit(nogil=True)
def models_hit(hits: Hits, counts: Int64Array) -> None:
    """How many models each data pair hits; counts : (p,), zeros, filled."""
    for model in range(len(hits.starts) - 1):
        before = -1
        for h in range(hits.starts[model], hits.starts[model + 1]):
            if hits.pair[h] != before:
                before = hits.pair[h]
                counts[before] += 1


@njit(nogil=True)
def agreement(
    pairs: ScenePairs,
    hits: Hits,
    rarity: FloatArray,
    models: Models,
    postings: Postings,
    first: int,
    last: int,
    support: Float32Array,
    nats: Float32Array,
) -> None:
    """How well the pairs agree, for each model, on which of its features the data lies.

    Pairs that share a data feature vote for the model feature that it lies on. The first vote for one is no agreement;
    the others count as much as they are rare. Of n hits of one data pair in a model one is right at most, for which the
    support of each is less by ln n.

    Parameters
    ----------
    pairs : ScenePairs
    hits : Hits
    rarity : (p,) float64
        Nats: the logarithm of one over the share of the models that a pair hits.
    models, postings
    first, last : int
        The models first to last - 1 are looked at.
    support : (h,) float32
        Nats, filled: what the votes agree on for both features of each hit.
    nats : (m,) float32
        Filled: over the data features, what the model feature has that most votes agree on.

    """
    features, widest = 0, 0
    for p in range(len(pairs.members)):
        features = max(features, pairs.members[p, 0] + 1, pairs.members[p, 1] + 1)
    for model in range(first, last):
        widest = max(widest, models.starts[model + 1] - models.starts[model])
    # For each data feature (row) and model feature: sum of its votes, the largest, and the last pair that voted.
    total, largest = np.zeros((features, widest), np.float32), np.zeros((features, widest), np.float32)
    voted = np.full((features, widest), -1, np.int32)
    best = np.zeros(features, np.float32)
    for model in range(first, last):
        begin, end = hits.starts[model], hits.starts[model + 1]
        for h in range(begin, end):
            p = hits.pair[h]
            weight = np.float32(rarity[p])
            for side in range(2):
                k, on = pairs.members[p, side], _member(postings, hits.hits[h], side)
                if voted[k, on] != p:
                    voted[k, on] = p
                    total[k, on] += weight
                    largest[k, on] = max(largest[k, on], weight)
        alike = 0
        for h in range(begin, end):
            if h >= alike:  # the first hit of a data pair: where those of the next begin
                run, alike = h, h + 1
                while alike < end and hits.pair[alike] == hits.pair[run]:
                    alike += 1
                share = np.float32(np.log(alike - run))
            support[h] = -share
            for side in range(2):
                k, on = pairs.members[hits.pair[h], side], _member(postings, hits.hits[h], side)
                more = total[k, on] - largest[k, on]
                support[h] += more
                if more > best[k]:
                    nats[model] += more - best[k]
                    best[k] = more
        for h in range(begin, end):
            for side in range(2):
                k, on = pairs.members[hits.pair[h], side], _member(postings, hits.hits[h], side)
                voted[k, on], total[k, on], largest[k, on], best[k] = -1, 0.0, 0.0, 0.0


@njit
def _member(postings: Postings, hit: int, side: int) -> int:
    """The model feature that the first (side 0) or second feature of a data pair lies on in a hit."""
    return int(postings.members[hit // 2, side ^ (hit & 1)])


@njit(nogil=True)
def vote(
    scene: Scene,
    pairs: ScenePairs,
    hits: Hits,
    support: Float32Array,
    chosen: Int64Array,
    effort: Round,
    models: Models,
    postings: Postings,
    floor: float,
    gains: FloatArray,
    widen: float,
    votes: Votes,
) -> None:
    """Make poses of the best hits of some models, and keep what the best pose of each explains.

    Parameters
    ----------
    scene, pairs, hits
    support : (h,) float32
        Nats of each hit; -inf for those that have been tried, which they are in the end.
    chosen : (c,) int64
        The models.
    effort : Round
    models, postings
    floor : float
        Metres: features nearer than that are about one axis.
    gains : (3, 2) float64
        By kind: nats of a feature explained exactly, and what they lose by the square of a fit.
    widen : float
        Tolerances count this many times when features are tried on a pose.
    votes : Votes
        Changed in place.

    """
    best = np.empty(len(scene.rows))
    data_pair, model_pair, motion = np.empty(12), np.empty(12), np.empty(12)
    kept = np.empty((2, effort.poses), np.int64)
    for model in chosen:
        data = _of_class(scene, scene.classes[model], models.radii[model])
        begin, end = models.starts[model], models.starts[model + 1]
        lines = FeatureRows(models.rows[begin:end], models.kind[begin:end])
        _best_hits(pairs, hits, support, model, effort.each, postings, floor, kept)
        for h in kept.ravel():
            if h < 0:
                continue
            support[h] = -np.inf
            p, at, order = hits.pair[h], hits.hits[h] // 2, hits.hits[h] % 2
            a, b = pairs.members[p, order], pairs.members[p, 1 - order]
            parallel = pairs.parallel[p] == 1
            window = window_of(data, a, b, parallel)
            i, j = np.int64(postings.members[at, 0]), np.int64(postings.members[at, 1])
            span = postings.spans[at]
            for hypothesis in range(2 if parallel else 4):
                if parallel:
                    sense = 1.0 - 2.0 * hypothesis
                    made = _same_side(span, data, b, sense, window) and parallel_pose(
                        data, a, b, lines, i, j, sense, span[0] <= window.across, motion
                    )
                else:
                    made = _crossing_pose(data, a, b, lines, i, j, hypothesis, window, data_pair, model_pair, motion)
                if not made or not _two_more(data, a, b, lines, i, j, pairs.near[p], motion, widen):
                    continue
                nats = _explained(data, lines, models.centres[model], models.sizes[model], motion, widen, gains, best)
                if nats > votes.nats[model]:
                    votes.nats[model] = nats
                    for k in range(12):
                        votes.motions[model, k] = motion[k]


@njit
def _best_hits(
    pairs: ScenePairs,
    hits: Hits,
    support: Float32Array,
    model: int,
    each: int,
    postings: Postings,
    floor: float,
    kept: Int64Array,
) -> None:
    """The hits of a model that have most support, of those that were not tried.

    Those of two features about one axis, whose poses leave the turn about it open, have places of their own: a part may
    have nothing else, and where it has, they have most support and say least. A data pair has few of them: one true
    pair has the pose, and many are true.

    kept : (2, k), filled with numbers of hits, most support first, -1 for none; those about one axis at 1
    """
    kept[:] = -1
    most = kept.shape[1]
    for h in range(hits.starts[model], hits.starts[model + 1]):
        if support[h] == -np.inf:
            continue
        p = hits.pair[h]
        mine = kept[1 if pairs.parallel[p] == 1 and postings.spans[hits.hits[h] // 2, 0] <= floor else 0]
        # What gives way: the worst of this pair when it has its share, the worst of all otherwise.
        last, of_pair = most - 1, 0
        for k in range(most):
            if mine[k] < 0:
                break
            if hits.pair[mine[k]] == p:
                of_pair += 1
                if of_pair == each:
                    last = k
                    break
        if mine[last] >= 0 and support[mine[last]] >= support[h]:
            continue
        while last > 0 and (mine[last - 1] < 0 or support[mine[last - 1]] < support[h]):
            mine[last] = mine[last - 1]
            last -= 1
        mine[last] = h


@njit
def _same_side(span: Float32Array, data: DataFeatures, b: int, sense: float, window: Window) -> bool:
    """Whether the second of two parallel features stands as far along the first as in the model, in this sense."""
    slide = window.slide_a
    if data.kind[b] != CURVE:
        slide += window.slide_b + max(0.0, 0.5 * (span[4] - span[3]) - data.rows[b, 6])
    return bool(abs(-0.5 * (span[1] + span[2]) - sense * window.foot_a) <= slide)


@njit
def _crossing_pose(
    data: DataFeatures,
    a: int,
    b: int,
    model: FeatureRows,
    i: int,
    j: int,
    hypothesis: int,
    window: Window,
    data_pair: FloatArray,
    model_pair: FloatArray,
    motion: FloatArray,
) -> bool:
    """The pose that lays model features i and j on data features a and b, one of four; False when they do not fit.

    hypothesis : its lowest bit says whether both directions are reversed, the next which side of a right angle the
    model's angle counts on; data_pair, model_pair : (12,), scratch space; motion : (12,), filled
    """
    c, s, d, foot_i, foot_j, flip = pair_geometry(model.rows[i], model.rows[j])
    angle = np.arctan2(s, c)
    if hypothesis >= 2:
        angle, d, foot_j, flip = np.pi - angle, -d, -foot_j, -flip
    if abs(angle - window.angle) > window.cone or abs(d - window.distance) > window.across:
        return False
    turn = 1.0 - 2.0 * (hypothesis % 2)
    if abs(foot_i - turn * window.foot_a) > model.rows[i, 6] - data.rows[a, 6] + window.slide_a:
        return False
    if abs(foot_j - turn * window.foot_b) > model.rows[j, 6] - data.rows[b, 6] + window.slide_b:
        return False
    _, _, _, foot_a, foot_b, flip_b = pair_geometry(data.rows[a], data.rows[b])
    pair_frame(data.rows, a, foot_a, b, flip_b, foot_b, data_pair)
    pair_frame(model.rows, i, foot_i, j, flip, foot_j, model_pair)
    pair_pose(data_pair, model_pair, turn, motion)
    return True


@njit
def _two_more(
    data: DataFeatures,
    a: int,
    b: int,
    model: FeatureRows,
    i: int,
    j: int,
    near: Int32Array,
    motion: FloatArray,
    widen: float,
) -> bool:
    """Whether neighbours of the data pair lie on so many further model features under a pose as an answer needs."""
    first = -1
    for at in range(len(near)):
        k = near[at]
        if k < 0:
            break
        if k in (a, b):
            continue
        point = inverse_transform(motion, data.rows[k, 0], data.rows[k, 1], data.rows[k, 2])
        direction = inverse_rotate(motion, data.rows[k, 3], data.rows[k, 4], data.rows[k, 5])
        for m in range(len(model.rows)):
            if m in (i, j, first):
                continue
            if fit_one(k, data, m, model, point, direction, widen) >= 0.0:
                if first >= 0:
                    return True
                first = m
                break
    return False


@njit
def _explained(
    data: DataFeatures,
    model: FeatureRows,
    centre: FloatArray,
    size: float,
    motion: FloatArray,
    widen: float,
    gains: FloatArray,
    best: FloatArray,
) -> float:
    """Nats by which a pose explains the data better than chance: of each model feature that data lies on.

    best : (>= e,), scratch space
    """
    e = len(model.rows)
    if len(best) < e:
        best = np.empty(e)
    best[:e] = -1.0
    reach = (0.5 * size + widen * data.tolerances[:, 0].max()) ** 2 * 3.0
    for k in range(len(data.rows)):
        x, y, z = inverse_transform(motion, data.rows[k, 0], data.rows[k, 1], data.rows[k, 2])
        dx, dy, dz = x - centre[0], y - centre[1], z - centre[2]
        if dx * dx + dy * dy + dz * dz > reach:
            continue
        direction = inverse_rotate(motion, data.rows[k, 3], data.rows[k, 4], data.rows[k, 5])
        nearest, which = 2.0, -1
        for m in range(e):
            fit = fit_one(k, data, m, model, (x, y, z), direction, widen)
            if 0.0 <= fit < nearest:
                nearest, which = fit, m
        if which >= 0:
            gain = max(gains[data.kind[k], 0] - gains[data.kind[k], 1] * nearest * nearest, 0.0)
            best[which] = max(best[which], gain)
    nats = 0.0
    for m in range(e):
        nats += best[m] if best[m] >= 0.0 else 0.0
    return float(nats - e * np.log(2.0))


@njit(nogil=True)
def explained_data(scene: Scene, models: Models, model: int, motion: FloatArray, widen: float, on: Int32Array) -> None:
    """Which model feature each data feature lies on under a pose of one model; on : (n,), filled, -1 for none."""
    data = _of_class(scene, scene.classes[model], models.radii[model])
    begin, end = models.starts[model], models.starts[model + 1]
    lines = FeatureRows(models.rows[begin:end], models.kind[begin:end])
    for k in range(len(data.rows)):
        point = inverse_transform(motion, data.rows[k, 0], data.rows[k, 1], data.rows[k, 2])
        direction = inverse_rotate(motion, data.rows[k, 3], data.rows[k, 4], data.rows[k, 5])
        nearest = 2.0
        on[k] = -1
        for m in range(end - begin):
            fit = fit_one(k, data, m, lines, point, direction, widen)
            if 0.0 <= fit < nearest:
                nearest, on[k] = fit, m
