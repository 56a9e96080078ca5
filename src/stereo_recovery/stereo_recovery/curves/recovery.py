"""Circles and ellipses in space: one curve fitted to the edgels of both images at once (thesis 3.10.1, 6.4).

A plane in space is a shear between the images: disparity is linear in the left image's u and v. Matched segments, or
the two image ellipses themselves, give it, and with the left ellipse a start. Then one curve in space is moved until
its two pictures lie on the edgels: six numbers for a circle, eight for an ellipse, and their covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from msgs_py import FeatureSet, StereoRig

from ..detection.conics import Ellipse, sampson
from ..detection.edgels import Edgels
from ..detection.segments import Segments
from ..edges.lines3d import Lines3D
from ..matching.matches import Matches
from . import fit_kernels
from .curve import Curve, angles, picture
from .fit import Axle, refine
from .initialisation import circles_of, edgels_of, followed, inner, lift, mirrored, pairs, parallel, shears
from .orientation import outward

# Edgels this near to the curve's picture (pixels), and pointing this nearly across it, belong to it.
CLAIM = 0.7
CLAIM_COSINE = 0.94
# Once the curve is known: within so many of its rms and of an edgel's own sigma, but never asked for less (pixels).
GATE = 3.5
LEAST_CLAIM = 0.12
# Edgels at the end of a run that a corner has displaced.
CORNER_EDGELS = 2
# A second fit is worth its time when more than this share of the edgels has changed.
SETTLED = 0.03
# A circle is an ellipse unless the ellipse lowers the sum of squares by this factor, and its radii differ by this much.
ELLIPSE_GAIN = 1.3
ELLIPSE_RATIO = 0.985
ELLIPSE_TURNS = 5
# A circle that fits this well, pixels rms and times what its edgels state, is one.
ROUND_RMS = 0.06
ROUND_MISFIT = 1.3
# A curve whose edgels stand off more than this, pixels rms, was never one.
WORST_RMS = 0.45
# Where a first fit stops trying, pixels rms, and what it leaves out at either end of arcs that fit worse.
GOOD_RMS = 0.1
TRIM = 0.15
# A curve seen to this share has no mirror image that fits. Normals this parallel (cosine) are one solution; another one
# is tried when it fits at most so many times worse. Between the two decide edgels that are off by less than so many of
# their sigma and these pixels.
WHOLE = 0.9
SAME_PLANE = 0.995
RIVAL = 4.0
RIVAL_SIGMA = 3.0
RIVAL_OFF = 0.1
# No other solution is looked for when a curve's normal is known this well, radians, and this share of its arcs' edgels
# are on it.
SURE_TILT = np.radians(0.4)
MOST_OF_ARC = 0.85
# A curve that only one eye sees as an arc: least share of the arc that is matched, and of both eyes' edgels that are
# the curve's; least number of edgels in either eye; least share of the curve that is seen; and how well it has to fit,
# pixels rms, and its radius to be known.
MATCHED, FOLLOWED, LEAST_FOLLOWED, FOLLOWED_COVERAGE = 0.2, 0.6, 12, 0.2
FOLLOWED_RMS, FOLLOWED_GROWTH = 0.12, 0.05
# A curve is reported when at least this share of it is seen and its normal (radians) and radius (share) are known this
# well, one sigma.
LEAST_COVERAGE = 0.08
MOST_TILT = np.radians(3.0)
MOST_GROWTH = 0.09
# A curve whose normal is known this well, radians, holds others on its axis. Axes of one turned part agree within
# this, radians and radii.
STEADY = np.radians(1.0)
TRUE_AXLE = 5e-4
# A curve whose normal is known worse than the first, radians, takes it from a better known curve that it may be
# parallel to; by how much they may differ, one sigma; chi squared beyond which they are not parallel; and the cosine
# from which two directions are one.
VAGUE_TILT, SLANT = np.radians(0.5), np.radians(0.2)
PARALLEL_GATE, SAME_DIRECTION = 9.0, 0.999
# Chi squared of four, and residuals over what the edgels state, beyond which a curve does not lie on an axis.
ON_AXLE = 20.0
WORST_MISFIT = 3.0


def claimed(
    curve: Curve, edgels: Edgels, rig: StereoRig, eye: float, blur: float, wide: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Edgels of the image seen from (eye, 0, 0) that are the curve's, (n,) bool, and those of them that measure it.

    The former lie on its picture and point across it. How near the latter have to be depends on how well the curve fits
    and on what each says of itself: a contour that leaves a rim leaves it slowly. Where a run ends, a corner has
    displaced the last few. wide : as far away as the curve's own uncertainty allows as well.
    """
    matrix = rig.left.matrix if eye == 0.0 else rig.right.matrix
    conic = picture(curve, matrix, eye)
    index = np.flatnonzero(np.abs(sampson(conic, edgels.position)) < CLAIM)
    h = edgels.position[index] @ conic[:2, :2] + conic[:2, 2]
    across = np.stack([np.cos(edgels.direction[index]), np.sin(edgels.direction[index])], axis=1)
    cosine = np.abs((h * across).sum(axis=1)) / np.maximum(np.hypot(h[:, 0], h[:, 1]), 1e-12)
    near = np.zeros(len(edgels), bool)
    near[index[cosine > CLAIM_COSINE]] = True
    index = np.flatnonzero(_without_ends(near, edgels.position))
    if len(index) == 0:
        return near, near
    distance = distances(curve, edgels.position[index], rig, eye, blur)
    usual = min(curve.rms, 1.5 * float(np.median(np.abs(distance))))
    own = np.hypot(edgels.sigma_position[index], np.minimum(edgels.bias[index], 0.1))
    expected = np.hypot(own, usual)
    if wide:
        expected = np.hypot(expected, np.sqrt(foreseen(curve, edgels.position[index], rig, eye, blur)))
    measures = np.zeros(len(edgels), bool)
    measures[index[np.abs(distance) < np.clip(GATE * expected, LEAST_CLAIM, CLAIM)]] = True
    return near, measures


def foreseen(curve: Curve, points: np.ndarray, rig: StereoRig, eye: float, blur: float) -> np.ndarray:
    """(n,) float64, px^2: variance that the curve's own uncertainty gives its picture at pixels (n, 2) near it."""
    camera = rig.left if eye == 0.0 else rig.right
    matrix = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    spare = np.empty(len(points)), np.empty(len(points))
    rows = fit_kernels.jacobian(
        curve.centre,
        curve.normal,
        curve.first,
        np.asarray(curve.radii, dtype=np.float64),
        True,
        np.ascontiguousarray(points),
        len(points) if eye == 0.0 else 0,
        matrix,
        matrix,
        float(eye),
        float(blur),
        *spare,
    )
    rows[:, 5] /= curve.radii[0]
    return np.einsum('ni,ij,nj->n', rows, curve.covariance, rows)


def distances(curve: Curve, points: np.ndarray, rig: StereoRig, eye: float, blur: float) -> np.ndarray:
    """(n,) float64, pixels: of pixels (n, 2) of the image seen from (eye, 0, 0) from the curve's picture, positive
    outside, with the pull of the smoothing taken off."""
    camera = rig.left if eye == 0.0 else rig.right
    matrix = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    distance, bend = np.empty(len(points)), np.empty(len(points))
    fit_kernels.residuals(
        curve.centre,
        curve.normal,
        curve.first,
        np.asarray(curve.radii, dtype=np.float64),
        np.ascontiguousarray(points),
        len(points) if eye == 0.0 else 0,
        matrix,
        matrix,
        float(eye),
        float(blur),
        distance,
        bend,
    )
    return distance


def _without_ends(near: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Runs of neighbours in chain order without their first and last few; short runs go altogether."""
    index = np.flatnonzero(near)
    if len(index) < 2:
        return np.zeros(len(near), bool)
    step = np.hypot(*(position[index[1:]] - position[index[:-1]]).T)
    breaks = (np.diff(index) > 1) | (step > 3.0)
    starts = np.concatenate([[0], np.flatnonzero(breaks) + 1])
    ends = np.concatenate([starts[1:], [len(index)]])
    kept = np.zeros(len(near), bool)
    for a, b in zip(starts, ends):
        # A closed chain begins somewhere; there is no corner there.
        closed = b - a > 8 and np.hypot(*(position[index[a]] - position[index[b - 1]])) < 3.0
        cut = 0 if closed else CORNER_EDGELS
        kept[index[a + cut : b - cut]] = True
    return kept


def _seen(curve: Curve, left: Edgels, right: Edgels, rig: StereoRig) -> tuple[tuple[float, float], float]:
    """Arc (start, extent) and share of the curve that edgels of either image cover; short gaps count as seen."""
    bins = 72
    hit = np.zeros(bins, bool)
    for edgels, eye in ((left, 0.0), (right, rig.baseline)):
        camera = rig.left if eye == 0.0 else rig.right
        angle = angles(curve.centre, curve.normal, curve.first, curve.radii, edgels.position, camera, eye)
        hit[np.floor(angle / (2.0 * np.pi) * bins).astype(int) % bins] = True
    if hit.all():
        return (0.0, 2.0 * np.pi), 1.0
    # The longest stretch without an edgel is what is hidden.
    doubled = np.concatenate([hit, hit])
    best, length, run = 0, 0, 0
    for k, seen in enumerate(doubled):
        run = 0 if seen else run + 1
        if run > length:
            best, length = k, run
    length = min(length, bins)
    if length <= 4:
        return (0.0, 2.0 * np.pi), float(hit.mean())
    start = (best + 1) % bins
    return (2.0 * np.pi * start / bins, 2.0 * np.pi * (bins - length) / bins), float(hit.mean())


def recover_curve(
    start: Curve,
    left: Edgels,
    right: Edgels,
    chosen: tuple[np.ndarray, np.ndarray],
    rig: StereoRig,
    blur: float,
    axle: Axle | None = None,
) -> Curve | None:
    """From a rough curve to the final one.

    left, right : all edgels of the images; chosen : bool over them, those that certainly belong to it; axle : holds it.
    """
    mine = (left.select(chosen[0]), right.select(chosen[1]))
    curve = refine(start, *mine, rig, blur, circle=True, axle=axle)
    if axle is None and (curve is None or curve.rms > 0.1):
        # Perhaps no circle.
        ellipse = refine(start, *mine, rig, blur, circle=False)
        if ellipse is not None and (curve is None or ellipse.rms * np.sqrt(ELLIPSE_GAIN) < curve.rms):
            curve = ellipse
    if curve is None or curve.rms > WORST_RMS or curve.centre[2] <= 0.0:
        return None
    fitted: tuple[np.ndarray, np.ndarray] = (np.zeros(0, bool), np.zeros(0, bool))
    # An ellipse, which has more to learn, picks up its edgels step by step.
    for turn in range(2 if curve.radii[0] == curve.radii[1] else ELLIPSE_TURNS):
        wide = turn == 0 or bool(curve.radii[0] != curve.radii[1])
        (on_left, fit_left), (on_right, fit_right) = (
            claimed(curve, edgels, rig, eye, blur, wide) for edgels, eye in ((left, 0.0), (right, rig.baseline))
        )
        if min(fit_left.sum(), fit_right.sum()) < 8:
            return None
        changed = sum(int((a != b).sum()) for a, b in zip(fitted, (fit_left, fit_right))) if turn else len(left)
        if changed < SETTLED * (fit_left.sum() + fit_right.sum()):
            break
        fitted = (fit_left, fit_right)
        mine = (left.select(fit_left), right.select(fit_right))
        again = refine(curve, *mine, rig, blur, circle=bool(curve.radii[0] == curve.radii[1]), rounds=6, axle=axle)
        if again is None:
            return None
        curve = replace(again, left=on_left, right=on_right)
        doubtful = curve.rms > ROUND_RMS or curve.misfit > ROUND_MISFIT
        if axle is None and curve.radii[0] == curve.radii[1] and doubtful:
            ellipse = refine(curve, *mine, rig, blur, circle=False, rounds=6)
            if (
                ellipse is not None
                and ellipse.rms**2 * ELLIPSE_GAIN < curve.rms**2
                and ellipse.radii[1] < ELLIPSE_RATIO * ellipse.radii[0]
            ):
                curve = ellipse
    if curve.rms > WORST_RMS:
        return None
    arc, coverage = _seen(curve, *mine, rig)
    return outward(replace(curve, arc=arc, coverage=coverage))


@dataclass(frozen=True, eq=False)
class _Arcs:
    """Arcs of the two images that show one curve: their edgels (bool over all), the ellipses, its planes."""

    left: np.ndarray
    right: np.ndarray
    ellipse: Ellipse
    right_ellipse: Ellipse
    samples: np.ndarray
    planes: list[np.ndarray]

    def shared_with(self, curve: Curve) -> bool:
        """Whether most of the edgels are another curve's."""
        return bool(curve.left[self.left].mean() > 0.5 and curve.right[self.right].mean() > 0.5)


def recover_curves(
    matches: Matches,
    left: Segments,
    right: Segments,
    ellipses: tuple[list[Ellipse], list[Ellipse]],
    edgels: tuple[Edgels, Edgels],
    rig: StereoRig,
    blur: float,
) -> list[Curve]:
    """All planar curves of a pair; none shares half of its edgels with a better one.

    Those that their own edgels determine come first, on most edgels first. What is left is tried on their axes, and
    what is known less well than another curve on its axis is held to that.
    """
    masks = [
        [edgels_of(segments, k, len(e)) for k in range(len(conics))]
        for segments, conics, e in zip((left, right), ellipses, edgels)
    ]
    arcs = [
        _Arcs(
            masks[0][a],
            masks[1][b],
            ellipses[0][a],
            ellipses[1][b],
            samples,
            shears(ellipses[0][a], ellipses[1][b], samples),
        )
        for a, b, samples in pairs(matches, left, right)
    ]
    found: list[Curve] = []
    rest: list[_Arcs] = []
    for item in sorted(arcs, key=lambda arc: -int(arc.left.sum())):
        if any(item.shared_with(c) for c in found):
            continue
        curve = _fitted(_starts(item, edgels, rig, blur), item, edgels, rig, blur)
        if curve is None or not _convincing(curve, item):
            # Arcs seen nearly edge-on, or in small parts, tell their plane better to one eye than by their disparities.
            one_eyed = [
                start
                for ellipse, is_right in ((item.ellipse, False), (item.right_ellipse, True))
                for start in circles_of(ellipse, item.samples, rig, is_right)
            ]
            other = _fitted(_rivals(one_eyed, item, edgels, rig, blur), item, edgels, rig, blur)
            curve = _best([curve, other], item, edgels, rig, blur)
        if curve and determined(curve):
            found.append(curve)
        else:
            rest.append(item)
    axles = [(c, axle_of(c)) for c in found if c.tilt < STEADY]
    for item in rest:
        if not any(item.shared_with(c) for c in found):
            held = [_held(item, axle, edgels, rig, blur) for _, axle in axles]
            good = [c for c in held if c is not None]
            found += [min(good, key=lambda c: c.rms)] if good else []
    for is_right, side in ((False, left), (True, right)):
        for arc in sorted(set(side.arc[side.arc >= 0].tolist())):
            curve = _followed(arc, is_right, ellipses[is_right][arc], matches, left, right, found, edgels, rig, blur)
            found += [] if curve is None else [curve]
    ways = _directions(found)
    for item in rest:
        if ways and not any(item.shared_with(c) for c in found):
            held = [_held(item, axle, edgels, rig, blur) for _, axle in ways]
            good = [
                c
                for c in held
                if c is not None
                and c.misfit < ROUND_MISFIT
                and c.rms < FOLLOWED_RMS
                and min(c.left[item.left].mean(), c.right[item.right].mean()) > MOST_OF_ARC
            ]
            found += [min(good, key=lambda c: c.rms)] if good else []
    steady = [_steadied(c, axles, edgels, rig, blur) for c in found]
    return [_parallel(c, ways) if c.tilt > VAGUE_TILT else c for c in steady]


def _directions(curves: list[Curve]) -> list[tuple[Curve, Axle]]:
    """The normals of the best known curves, to which others may be parallel: axles that lie anywhere."""
    result: list[tuple[Curve, Axle]] = []
    for curve in sorted(curves, key=lambda c: c.tilt):
        if curve.tilt < STEADY and all(abs(curve.normal @ c.normal) < SAME_DIRECTION for c, _ in result):
            result.append((curve, Axle(curve.centre, curve.normal, np.eye(3), float(np.hypot(curve.tilt, SLANT)))))
    return result


def _starts(item: _Arcs, edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float) -> list[Curve]:
    """The best circle from the arcs' planes and, unless it is beyond doubt, its mirror image.

    It is fitted to all edgels of the arcs and, when that fits badly, to their middle parts: where an arc runs into a
    contour or an edge, its ends may not be its own.
    """
    best, index = None, 0
    mine = [
        (edgels[0].select(inner(item.left, share)), edgels[1].select(inner(item.right, share))) for share in (0.0, TRIM)
    ]
    for k, some in enumerate(mine):
        for shear in item.planes:
            start = lift(item.ellipse, shear, rig)
            if start is None or (best is not None and best.rms < GOOD_RMS):
                continue
            curve = refine(start, *some, rig, blur, circle=True, rounds=8, rough=True) or start
            if best is None or curve.rms < best.rms:
                best, index = curve, k
    if best is None or not np.isfinite(best.rms):
        return [] if best is None else [best]
    if best.rms < GOOD_RMS and _seen(best, *mine[index], rig)[1] > WHOLE:
        return [best]
    other = refine(mirrored(best), *mine[index], rig, blur, circle=True, rounds=8, rough=True)
    if other is None or abs(other.normal @ best.normal) > SAME_PLANE or other.rms > RIVAL * (best.rms + 0.02):
        return [best]
    return [best, other]


def _rivals(
    starts: list[Curve], item: _Arcs, edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float
) -> list[Curve]:
    """The best circle from given starts, and the next in another plane when that fits nearly as well."""
    mine = edgels[0].select(item.left), edgels[1].select(item.right)
    tried = [refine(start, *mine, rig, blur, circle=True, rounds=8, rough=True) for start in starts]
    good = sorted((c for c in tried if c is not None), key=lambda c: c.rms)
    others = [
        c for c in good[1:] if abs(c.normal @ good[0].normal) < SAME_PLANE and c.rms < RIVAL * (good[0].rms + 0.02)
    ]
    return good[:1] + others[:1]


def _fitted(
    starts: list[Curve], item: _Arcs, edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float
) -> Curve | None:
    return _best(
        [recover_curve(start, *edgels, (item.left, item.right), rig, blur) for start in starts], item, edgels, rig, blur
    )


def _convincing(curve: Curve, item: _Arcs) -> bool:
    """Whether a curve is determined, fits as its edgels say, and is where nearly all of the arcs' edgels are."""
    return bool(
        determined(curve)
        and curve.misfit < ROUND_MISFIT
        and curve.tilt < SURE_TILT
        and min(curve.left[item.left].mean(), curve.right[item.right].mean()) > MOST_OF_ARC
    )


def _best(
    curves: list[Curve | None], item: _Arcs, edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float
) -> Curve | None:
    """The one that fits best to the edgels that any of them, or the arcs, claim."""
    good = [c for c in curves if c is not None]
    if len(good) < 2:
        return good[0] if good else None
    masks = (item.left | np.any([c.left for c in good], axis=0), item.right | np.any([c.right for c in good], axis=0))
    off = [
        np.concatenate(
            [
                np.abs(distances(c, edgels[0].position[masks[0]], rig, 0.0, blur)),
                np.abs(distances(c, edgels[1].position[masks[1]], rig, rig.baseline, blur)),
            ]
        )
        for c in good
    ]
    sigma = np.concatenate([np.hypot(e.sigma_position, e.bias)[mask] for e, mask in zip(edgels, masks)])
    return min(zip(good, off), key=lambda pair: np.minimum(pair[1] / (RIVAL_SIGMA * sigma + RIVAL_OFF), 1.0).sum())[0]


def _followed(
    arc: int,
    is_right: bool,
    ellipse: Ellipse,
    matches: Matches,
    left: Segments,
    right: Segments,
    found: list[Curve],
    edgels: tuple[Edgels, Edgels],
    rig: StereoRig,
    blur: float,
) -> Curve | None:
    """A circle that is an arc to one eye and something straight, or in segments, to the other; None if nothing is."""
    *masks, samples, share = followed(matches, left, right, arc, is_right, (len(edgels[0]), len(edgels[1])))
    known = [
        np.any([getattr(c, name) for c in found], axis=0) if found else np.zeros(len(e), bool)
        for name, e in zip(('left', 'right'), edgels)
    ]
    if (
        share < MATCHED
        or min(int(m.sum()) for m in masks) < LEAST_FOLLOWED
        or any(k[m].mean() > 0.5 for k, m in zip(known, masks))
    ):
        return None
    mine = edgels[0].select(masks[0]), edgels[1].select(masks[1])
    starts = [
        refine(start, *mine, rig, blur, circle=True, rounds=8, rough=True)
        for start in circles_of(ellipse, samples, rig, is_right)
    ]
    curves = [
        recover_curve(start, *edgels, (masks[0], masks[1]), rig, blur)
        for start in starts
        if start is not None and start.rms < WORST_RMS
    ]
    good = [
        c
        for c in curves
        if c is not None
        and determined(c)
        and c.misfit < ROUND_MISFIT
        and c.coverage > FOLLOWED_COVERAGE
        and c.rms < FOLLOWED_RMS
        and np.sqrt(c.covariance[5, 5]) < FOLLOWED_GROWTH * c.radii[0]
        and c.left[masks[0]].mean() > FOLLOWED
        and c.right[masks[1]].mean() > FOLLOWED
    ]
    return min(good, key=lambda c: c.rms) if good else None


def determined(curve: Curve) -> bool:
    """Whether the curve's own edgels say where it is."""
    return bool(
        curve.coverage > LEAST_COVERAGE
        and curve.tilt < MOST_TILT
        and np.sqrt(curve.covariance[5, 5]) < MOST_GROWTH * curve.radii[0]
    )


def axle_of(curve: Curve) -> Axle:
    return Axle(
        curve.centre,
        curve.normal,
        curve.covariance[:3, :3] + (TRUE_AXLE * curve.radii[0]) ** 2 * np.eye(3),
        float(np.hypot(curve.tilt, TRUE_AXLE)),
    )


def _held(item: _Arcs, axle: Axle, edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float) -> Curve | None:
    """A circle on an axle through arcs that do not determine one; None when they do not want to lie on it."""
    plane = parallel(axle.direction, item.samples, rig)
    start = None if plane is None else lift(item.ellipse, plane, rig)
    if start is None:
        return None
    mine = (edgels[0].select(inner(item.left, TRIM)), edgels[1].select(inner(item.right, TRIM)))
    start = refine(start, *mine, rig, blur, circle=True, rounds=8, axle=axle)
    if start is None or start.rms > WORST_RMS:
        return None
    curve = recover_curve(start, *edgels, (item.left, item.right), rig, blur, axle)
    if curve is None or not determined(curve) or curve.misfit > WORST_MISFIT:
        return None
    off = axle.residual(curve.centre, curve.normal)
    return curve if off @ np.linalg.solve(axle.covariance(curve.centre), off) < ON_AXLE else None


def _steadied(
    curve: Curve, axles: list[tuple[Curve, Axle]], edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float
) -> Curve:
    """The curve held to the axis of one that is known better, if its own edgels allow that."""
    if curve.radii[0] != curve.radii[1]:
        return curve
    best = curve
    for other, axle in axles:
        if other is curve or axle.tilt > 0.5 * curve.tilt:
            continue
        off = axle.residual(curve.centre, curve.normal)
        slope = axle.jacobian(curve.normal, curve.first)
        spread = axle.covariance(curve.centre) + slope @ curve.covariance[:5, :5] @ slope.T
        if off @ np.linalg.solve(spread, off) > ON_AXLE:
            continue
        (on_left, fit_left), (on_right, fit_right) = (
            claimed(curve, e, rig, eye, blur) for e, eye in ((edgels[0], 0.0), (edgels[1], rig.baseline))
        )
        held = refine(
            curve, edgels[0].select(fit_left), edgels[1].select(fit_right), rig, blur, circle=True, rounds=6, axle=axle
        )
        if held is not None and held.tilt < best.tilt and held.rms < 1.2 * curve.rms + 0.01:
            best = replace(held, left=on_left, right=on_right)
    return best


def _parallel(curve: Curve, ways: list[tuple[Curve, Axle]]) -> Curve:
    """A circle whose normal is vague, with that of a better known curve if its own edgels allow that.

    One Kalman step: what its edgels share moves all of them, so that their residuals alone would forbid what their
    covariance allows."""
    if curve.radii[0] != curve.radii[1]:
        return curve
    for other, axle in sorted(ways, key=lambda way: way[1].tilt):
        if other is curve or axle.tilt > 0.5 * curve.tilt:
            continue
        off, slope = axle.residual(curve.centre, curve.normal)[:2], np.zeros((2, 6))
        slope[:, :5] = axle.jacobian(curve.normal, curve.first)[:2]
        spread = slope @ curve.covariance @ slope.T + axle.tilt**2 * np.eye(2)
        if off @ np.linalg.solve(spread, off) > PARALLEL_GATE:
            continue
        gain = np.linalg.solve(spread, slope @ curve.covariance).T
        step = -gain @ off
        growth = float(np.log1p(max(step[5] / curve.radii[0], -0.5)))
        moved = fit_kernels.moved(
            curve.centre,
            curve.normal,
            curve.first,
            curve.radii.astype(float),
            np.array([*step[:5], growth, growth, 0.0]),
            True,
        )
        covariance = curve.covariance - gain @ slope @ curve.covariance
        return replace(
            curve,
            centre=moved[0],
            normal=moved[1],
            first=moved[2],
            radii=moved[3],
            covariance=0.5 * (covariance + covariance.T),
        )
    return curve


def on_curves(lines: Lines3D, segments: tuple[Segments, Segments], curves: list[Curve]) -> np.ndarray:
    """(n,) bool: matched segments of which most edgels in one of the images belong to a curve."""
    result = np.zeros(len(lines), bool)
    for side, index, of in ((0, lines.left, 'left'), (1, lines.right, 'right')):
        for curve in curves:
            total = np.concatenate([[0], np.cumsum(getattr(curve, of))])
            bounds = segments[side].bounds[index]
            result |= (total[bounds[:, 1]] - total[bounds[:, 0]]) > 0.5 * (bounds[:, 1] - bounds[:, 0])
    return result


def curve_features(curves: list[Curve]) -> FeatureSet:
    """As features: the errors are three sigma of the centre, along the normal and across it."""
    if not curves:
        return FeatureSet.empty()
    along, across = [], []
    for c in curves:
        spread = c.covariance[:3, :3]
        along.append(3.0 * np.sqrt(c.normal @ spread @ c.normal))
        flat = np.stack([c.first, c.second])
        across.append(3.0 * np.sqrt(np.linalg.eigvalsh(flat @ spread @ flat.T)[-1]))
    return FeatureSet.from_curves(
        [c.centre for c in curves],
        [c.normal for c in curves],
        [c.radii for c in curves],
        along,
        across,
        [c.first for c in curves],
        [c.arc for c in curves],
    )
