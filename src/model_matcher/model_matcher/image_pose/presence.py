"""Whether the images show an outline where a pose puts it: a likelihood ratio against what else may lie there.

A point of the outline is confirmed by a step within a pixel of it. Along a curve confirmations come in runs, for three
reasons: the curve is there, and most of its points are confirmed until something stands before it; another edge of the
scene lies along it, which all cameras see there; or edges lie along it by chance, in each image on their own. It is
curves that are counted, not pixels, and not images: a pose that was thought of from edges in space lies on edges of
other objects, too, and what lies on one in space does so in every view. How often chance confirms a point, and how
often a run of them, is counted in the same images, on the same outline moved along its normals (the a-contrario
principle; Desolneux, Moisan & Morel, From Gestalt theory to image analysis).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int8Array, Int32Array

from ..geometry.settings import NOT_ZERO
from .alignment import Placed, Steps
from .neighbours import begins, beside_box, curve_boxes, own_step
from .settings import (
    CONTROLS,
    HIDDEN,
    LEAST_RUN,
    ON_EDGE,
    PRIOR_ALIGNED,
    PRIOR_CHANCES,
    REVEALED,
    SCREEN_DIRECTIONS,
    SEEN_STEP,
    STOPS,
)

# A product below is taken the logarithm of, before it leaves the range of numbers with the next factors.
SMALLEST = float(np.finfo(np.float64).tiny / np.finfo(np.float64).eps)


class Chance(NamedTuple):
    """What chance confirms.

    Attributes
    ----------
    after_none, after_one, first : float
        Chances of a confirmation where no edge runs along the outline: after a point without one, after one, and where
        a curve begins.
    aligned : float
        Share of the outline along which, in one image, an edge runs that is not its own.
    in_space : tuple of float
        Share of its straight curves, and of its others, that lie on edges, in space, of what is not the object; all
        views show these.
    """

    after_none: float
    after_one: float
    first: float
    aligned: float
    in_space: tuple[float, float]


@njit(nogil=True)
def confirmations(offset: FloatArray, count: Int32Array, at: float) -> Int8Array:
    """Whether each profile has a step within ON_EDGE pixels of a place ``at``, (n,): 1, 0, or -1 outside the image."""
    out = np.empty(len(count), np.int8)
    for k in range(len(count)):
        out[k] = -1 if count[k] < 0 else 0
        for j in range(count[k]):
            if abs(offset[k, j] - at) <= ON_EDGE:
                out[k] = 1
    return out


@njit(nogil=True)
def chance_beside(steps: Steps, group: Int32Array, in_space: tuple[float, float]) -> Chance:
    """What chance confirms of an outline in these images: counted beside it, with what is believed beforehand.

    Parameters
    ----------
    steps : Steps
        Found along the normals of n points, to the farthest of CONTROLS and ON_EDGE beyond.
    group : (n,) int32
        Curve and view of each point, contiguous.
    in_space : tuple of float
        See :class:`Chance`; pictures do not tell it.
    """
    yes, all_, in_runs, points = _count_beside(steps.offset, steps.number, group)
    aligned = (in_runs + PRIOR_ALIGNED[0]) / (points + PRIOR_ALIGNED[1])
    chances = yes / all_
    return Chance(chances[0], min(chances[1], SEEN_STEP / 1.5), chances[2], aligned, in_space)


@njit(nogil=True)
def _count_beside(
    offset: FloatArray, count: Int32Array, group: Int32Array
) -> tuple[FloatArray, FloatArray, float, float]:
    """Confirmations and points (3,) after none, after one and at first; points in long runs, and all points."""
    yes, all_ = np.empty(3), np.empty(3)
    for i in range(3):
        yes[i], all_[i] = PRIOR_CHANCES[i][0], PRIOR_CHANCES[i][1]
    in_runs, points = 0.0, 0.0
    # Which of CONTROLS have a step near, a bit each: a point has few steps.
    beside = np.zeros(len(count), np.uint8)
    for k in range(len(count)):
        for j in range(count[k]):
            for bit in range(len(CONTROLS)):
                beside[k] |= np.uint8((abs(offset[k, j] - CONTROLS[bit]) <= ON_EDGE) << bit)
    found = np.empty(len(count), np.int8)
    for bit in range(len(CONTROLS)):
        for k in range(len(count)):
            found[k] = -1 if count[k] < 0 else (beside[k] >> bit) & 1
        run, length = 0, 0
        for k in range(len(found) + 1):
            ends = k == len(found) or (k > 0 and group[k] != group[k - 1])
            if ends or found[k] != 1:
                # The whole of a short curve is a run.
                if run >= LEAST_RUN or (ends and run > 1 and run == length):
                    in_runs += run
                run = 0
            length = 0 if ends else length
            if k == len(found) or found[k] < 0:
                continue
            length += 1
            linked = k > 0 and group[k] == group[k - 1] and found[k - 1] >= 0
            i = (1 if found[k - 1] else 0) if linked else 2
            all_[i] += 1.0
            yes[i] += found[k]
            points += 1.0
            run += found[k]
    return yes, all_, in_runs, points


@njit(nogil=True)
def crowded(placed: Placed) -> BoolArray:
    """Points, (n,) bool, that a curve before theirs passes so near that one step of the image would confirm both."""
    out, own = np.zeros(len(placed.eye), np.bool_), own_step()
    begin, box = curve_boxes(placed)
    near = np.empty(len(box), np.int32)
    for one in range(len(box)):
        # Curves whose boxes come near the box of this one; most do not.
        count = 0
        for other in range(one - 1, -1, -1):
            if placed.eye[begin[other]] != placed.eye[begin[one]]:
                break
            apart = max(box[one, 0] - box[other, 2], box[other, 0] - box[one, 2])
            apart = max(apart, box[one, 1] - box[other, 3], box[other, 1] - box[one, 3])
            if apart <= own:
                near[count] = other
                count += 1
        for k in range(begin[one], begin[one + 1]):
            u, v = placed.pixel[k, 0], placed.pixel[k, 1]
            for other in near[:count]:
                if out[k]:
                    break
                if beside_box(box, other, u, v, own):
                    continue
                for j in range(begin[other], begin[other + 1]):
                    du, dv = placed.pixel[j, 0] - u, placed.pixel[j, 1] - v
                    if du * du + dv * dv < own * own:
                        out[k] = True
                        break
    return out


@njit(nogil=True)
def overlap(mine: Placed, found: Int8Array, theirs: Placed, others: Int8Array, near: float) -> float:
    """Share of the confirmed points of an outline that lie on those of another, edges about as steep.

    Parameters
    ----------
    mine, theirs : Placed
        The two outlines, in the same views.
    found, others : (n,) int8
        Which of their points are confirmed: 1.
    near : float
        Pixels, in u and in v, within which one step confirms both.
    """
    begin, box = curve_boxes(theirs)
    total, shared = 0, 0
    for k in range(len(found)):
        if found[k] != 1:
            continue
        total += 1
        u, v, same = mine.pixel[k, 0], mine.pixel[k, 1], False
        for curve in range(len(box)):
            if same:
                break
            if theirs.eye[begin[curve]] != mine.eye[k] or beside_box(box, curve, u, v, near):
                continue
            for j in range(begin[curve], begin[curve + 1]):
                du, dv = abs(theirs.pixel[j, 0] - u), abs(theirs.pixel[j, 1] - v)
                cosine = mine.normal[k, 0] * theirs.normal[j, 0] + mine.normal[k, 1] * theirs.normal[j, 1]
                if others[j] == 1 and du < near and dv < near and cosine * cosine > 0.5:
                    same = True
                    break
        shared += same
    return shared / total if total else 0.0


@njit(nogil=True)
def bent(point: FloatArray, curve: Int32Array, limb: FloatArray) -> BoolArray:
    """Which curves are not straight in space or are contours, (c,) bool by the numbers of :class:`.alignment.Placed`.

    Parameters
    ----------
    point : (n, 3) float64
        Metres.
    curve : (n,) int32
    limb : (n,) float64
        See :class:`.sight.Sight`.
    """
    most = curve.max() + 1 if len(curve) else 0
    out, first, second = np.zeros(most, np.bool_), np.full(most, -1), np.full(most, -1)
    for k in range(len(curve)):
        c = curve[k]
        if limb[k] != 0.0:
            out[c] = True
        if out[c]:
            continue
        if first[c] < 0:
            first[c] = k
        elif second[c] < 0:
            second[c] = k
        else:
            i, j = first[c], second[c]
            ax, ay, az = point[j, 0] - point[i, 0], point[j, 1] - point[i, 1], point[j, 2] - point[i, 2]
            bx, by, bz = point[k, 0] - point[i, 0], point[k, 1] - point[i, 1], point[k, 2] - point[i, 2]
            x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            # Points that two views have in common are one but for rounding, and have no direction from each other.
            one, other = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz
            out[c] = x * x + y * y + z * z > NOT_ZERO * max(one, other) ** 2
            if other > one:
                second[c] = k
    return out


@njit(nogil=True)
def _along_curve(found: Int8Array, chance: Chance) -> tuple[float, float]:
    """Log-likelihoods of the confirmations along one curve in one view: an edge is there, though it may stop; none is.

    Both are 0 where nothing is in view.
    """
    runs, none, before = 0.0, 0.0, -1
    # Products of the likelihoods of points, of which logarithms are taken before they leave the range of numbers.
    by_runs, by_none = 1.0, 1.0
    seen = REVEALED / (REVEALED + STOPS)
    hidden = 1.0 - seen
    for one in found:
        if one < 0:
            continue
        by_chance = chance.first if before < 0 else chance.after_one if before else chance.after_none
        by_edge = SEEN_STEP
        if before >= 0:
            seen, hidden = seen * (1.0 - STOPS) + hidden * REVEALED, hidden * (1.0 - REVEALED) + seen * STOPS
        if not one:
            by_chance, by_edge = 1.0 - by_chance, 1.0 - by_edge
        by_none *= by_chance
        seen, hidden = seen * by_edge, hidden * by_chance
        here = seen + hidden
        by_runs *= here
        seen, hidden = seen / here, hidden / here
        before = one
        if by_none < SMALLEST or by_runs < SMALLEST:
            runs, none = runs + math.log(by_runs), none + math.log(by_none)
            by_runs, by_none = 1.0, 1.0
    runs, none = runs + math.log(by_runs), none + math.log(by_none)
    return runs, none


@njit(nogil=True)
def _either(share: float, one: float, other: float) -> float:
    """Logarithm of the mixture of two likelihoods (logarithms), the first with a share."""
    top = max(one, other)
    mixed: float = top + math.log(share * math.exp(one - top) + (1.0 - share) * math.exp(other - top))
    return mixed


@njit(nogil=True)
def over_views(found: Int8Array, group: Int32Array, curve: Int32Array, chance: Chance) -> tuple[FloatArray, FloatArray]:
    """Log-likelihoods of what is confirmed of each curve, (c,), over its views; see :func:`log_ratio`.

    Returns
    -------
    edge, apart
        An edge in space lies along it; in each view one lies along it by chance, or none.
    """
    most = curve.max() + 1 if len(curve) else 0
    edge, apart = np.zeros(most), np.zeros(most)
    begin = begins(group)
    for g in range(len(begin) - 1):
        runs, mixed = _in_view(found[begin[g] : begin[g + 1]], chance)
        edge[curve[begin[g]]] += runs
        apart[curve[begin[g]]] += mixed
    return edge, apart


@njit(nogil=True)
def _in_view(found: Int8Array, chance: Chance) -> tuple[float, float]:
    """Log-likelihoods of the confirmations along one curve in one view: its edge is there; one by chance, or none."""
    runs, none = _along_curve(found, chance)
    return runs, _either(chance.aligned, runs, none)


@njit(nogil=True)
def log_ratio(found: Int8Array, group: Int32Array, curve: Int32Array, is_bent: BoolArray, chance: Chance) -> float:
    """Log-likelihood ratio of confirmations: an outline that may be hidden in parts, against other edges.

    Parameters
    ----------
    found : (n,) int8
        See :func:`confirmations`; what is negative says nothing.
    group : (n,) int32
        Curve and view of each, contiguous.
    curve : (n,) int32
        One number for all views, see :class:`.alignment.Placed`.
    is_bent : (c,) bool
        See :func:`bent`.
    chance : Chance

    Returns
    -------
    float
        Nats; the mean over how much of the outline is hidden.
    """
    ratio: float = log_mean(by_hidden(found, group, curve, is_bent, chance))
    return ratio


@njit(nogil=True)
def by_hidden(found: Int8Array, group: Int32Array, curve: Int32Array, is_bent: BoolArray, chance: Chance) -> FloatArray:
    """As :func:`log_ratio`, for each share of HIDDEN that may be hidden, (h,): of several curves they add up."""
    edge, apart = over_views(found, group, curve, chance)
    parts = np.zeros(len(HIDDEN))
    for c in range(len(edge)):
        for p in range(len(HIDDEN)):
            parts[p] += _against_others(edge[c], apart[c], HIDDEN[p], is_bent[c], chance)
    return parts


@njit(nogil=True)
def _against_others(edge: float, apart: float, hidden: float, is_bent: bool, chance: Chance) -> float:
    """Log-likelihood ratio of one curve of :func:`over_views`, which may be hidden, against others' edges."""
    others = _either(chance.in_space[1 if is_bent else 0], edge, apart)
    ratio: float = _either(1.0 - hidden, edge, others) - others
    return ratio


@njit(nogil=True)
def log_mean(logarithms: FloatArray) -> float:
    """Logarithm of the mean of what has logarithms (n,)."""
    top = logarithms.max()
    mean: float = top + math.log(np.exp(logarithms - top).mean())
    return mean


@njit(nogil=True)
def _beyond(placed: Placed, views: Int32Array, angle: float, out: Int8Array) -> None:
    """Beyond how many screens of one direction each point lies, (n,), filled; views : where each begins.

    They hide as much of the outline's width as HIDDEN has, in every view, so that they follow the shift of what stands
    in front.
    """
    along, down = math.cos(angle), math.sin(angle)
    for view in range(len(views) - 1):
        low, high = math.inf, -math.inf
        for k in range(views[view], views[view + 1]):
            across = placed.pixel[k, 0] * along + placed.pixel[k, 1] * down
            low, high = min(low, across), max(high, across)
        size = max(high - low, NOT_ZERO)
        for k in range(views[view], views[view + 1]):
            across = (placed.pixel[k, 0] * along + placed.pixel[k, 1] * down - low) / size
            out[k] = 0
            for hidden in HIDDEN:
                out[k] += across > 1.0 - hidden


@njit(nogil=True)
def behind_screens(placed: Placed, found: Int8Array, is_bent: BoolArray, chance: Chance) -> float:
    """Log-likelihood ratio of confirmations as :func:`log_ratio` has it, where something straight stands in front.

    Of a curve that chance hides something has to be said by itself; what lies beyond the edge of another object is
    hidden together. Beyond it nothing is said, on this side little is hidden.

    Parameters
    ----------
    placed : Placed
        n points.
    found : (n,) int8
        See :func:`confirmations`; what is negative says nothing.
    is_bent : (c,) bool
        See :func:`bent`.
    chance : Chance

    Returns
    -------
    float
        Nats; the mean over where it stands.
    """
    begin, views = begins(placed.group), begins(placed.eye)
    groups, curves = len(begin) - 1, len(is_bent)
    curve, whole = placed.curve[begin[:-1]], np.empty((groups, 2))
    edge, apart, ratio = np.zeros(curves), np.zeros(curves), np.empty(curves)
    for g in range(groups):
        whole[g] = _in_view(found[begin[g] : begin[g + 1]], chance)
        edge[curve[g]] += whole[g, 0]
        apart[curve[g]] += whole[g, 1]
    for c in range(curves):
        ratio[c] = _against_others(edge[c], apart[c], HIDDEN[0], is_bent[c], chance)
    beyond, seen = np.empty(len(found), np.int8), found.copy()
    first, last = np.empty(groups, np.int8), np.empty(groups, np.int8)
    is_cut, is_seen = np.empty(curves, np.bool_), np.empty(curves, np.bool_)
    parts = np.empty((SCREEN_DIRECTIONS, len(HIDDEN)))
    for direction in range(SCREEN_DIRECTIONS):
        _beyond(placed, views, direction * 2.0 * math.pi / SCREEN_DIRECTIONS, beyond)
        for g in range(groups):
            first[g], last[g] = beyond[begin[g] : begin[g + 1]].min(), beyond[begin[g] : begin[g + 1]].max()
        for screen in range(len(HIDDEN)):
            is_cut[:], is_seen[:], edge[:], apart[:] = False, False, 0.0, 0.0
            for g in range(groups):
                is_cut[curve[g]] |= last[g] > screen
                is_seen[curve[g]] |= first[g] <= screen
            for g in range(groups):
                if not is_cut[curve[g]] or first[g] > screen:
                    continue
                both, by_chance = whole[g, 0], whole[g, 1]
                if last[g] > screen:
                    for k in range(begin[g], begin[g + 1]):
                        seen[k] = -1 if beyond[k] > screen else found[k]
                    both, by_chance = _in_view(seen[begin[g] : begin[g + 1]], chance)
                edge[curve[g]] += both
                apart[curve[g]] += by_chance
            total = 0.0
            for c in range(curves):
                if not is_cut[c]:
                    total += ratio[c]
                elif is_seen[c]:
                    total += _against_others(edge[c], apart[c], HIDDEN[0], is_bent[c], chance)
            parts[direction, screen] = total
    mean: float = log_mean(parts.ravel())
    return mean


@njit(nogil=True)
def shown_outline(
    placed: Placed, spacing: FloatArray, is_bent: BoolArray, steps: Steps, in_space: tuple[float, float], screened: bool
) -> tuple[float, float, Int8Array]:
    """What images show of an outline.

    Parameters
    ----------
    placed : Placed
        n points.
    spacing : (n,) float64
        See :class:`.sight.Sight`.
    is_bent : (c,) bool
        See :func:`bent`.
    steps : Steps
        Found along their normals, as :func:`chance_beside` needs them.
    in_space : tuple of float
        See :class:`Chance`.
    screened : bool
        Something straight may stand in front, by even chances.

    Returns
    -------
    log_ratio : float
        Nats.
    support : float
        Share of the length inside the images that is confirmed.
    found : (n,) int8
        1, 0, or -1 where nothing is said: outside, and where another curve is as near.
    """
    chance = chance_beside(steps, placed.group, in_space)
    found = confirmations(steps.offset, steps.number, 0.0)
    inside, confirmed = 0.0, 0.0
    for k in range(len(found)):
        if found[k] >= 0:
            inside += spacing[k]
            confirmed += found[k] * spacing[k]
    for k, other in enumerate(crowded(placed)):
        if other:
            found[k] = -1
    ratio = log_ratio(found, placed.group, placed.curve, is_bent, chance)
    if screened:
        ratio = _either(0.5, behind_screens(placed, found, is_bent, chance), ratio)
    return ratio, confirmed / inside if inside > 0.0 else 0.0, found
