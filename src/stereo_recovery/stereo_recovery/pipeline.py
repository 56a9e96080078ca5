"""From a rectified stereo pair to features in space: the facade of library users, the command line and the node."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from msgs_py import FeatureSet, PinholeCamera, StereoRig

from .curves.axes import axis_features, find_axes
from .curves.curve import Curve
from .curves.occluding_contours import contours
from .curves.opposite_rims import completed, counterparts, distinct
from .curves.orientation import on_faces
from .curves.recovery import curve_features, on_curves, recover_curves
from .curves.spheres import without_balls
from .detection import edgels as edgel_module
from .detection.chains import link, with_weak
from .detection.conics import Ellipse
from .detection.double_edges import fit_double_steps
from .detection.double_edges import warm_up as warm_up_profiles
from .detection.edgels import Edgels
from .detection.junctions import find_junctions, spurious
from .detection.low_contrast import track_low_contrast
from .detection.low_contrast import warm_up as warm_up_faint
from .detection.segments import Segments
from .detection.splitting import localisation_noise, split
from .edges.families import aligned
from .edges.hiding import hidden_ends
from .edges.lines3d import edges, to_space
from .edges.tangency import joined_ends
from .matching.merging import join_matched, split_matched
from .matching.relaxation import match
from .matching.relaxation_kernels import STEEPEST
from .params import RecoveryParams

# Edgels a pixel, and in all, above which the thresholds rise.
DENSEST = 0.03
MOST_EDGELS = 40000
# Texture without end: more than so many segments (a room has a thousand) would take minutes. The longest are kept.
MOST_SEGMENTS = 6000
# In a picture with fewer edgels a pixel than this, long chains of weak ones count too: least magnitude and least mean
# in units of the gradient's noise, and least number of edgels.
SPARSE = 0.01
WEAKEST, WEAK_MEAN, WEAK_COUNT = 2.7, 3.3, 14
# With more edgels a pixel than this a picture is cluttered: print and texture end near true edges everywhere.
CLUTTERED = 0.02
# A curve is reported when its normal is known this well, radians, one sigma, and its edgels are off by at most so many
# times what they state; less well, it explains edgels only. A short arc, of less than this share, has to be known
# better: a crease between two tubes may look like one.
MOST_TILT, MOST_TILT_OF_ARC = np.radians(2.0), np.radians(1.0)
ARC = 0.7
MOST_MISFIT = 2.0
# An edge is reported when its direction is known this well: three sigma bound of its ends across over its length.
# Where there are curves a doubtful one may well be a segment of a curve: it has to be known better, and only tells on
# which face a curve lies.
LEAST_DETERMINED = 0.25
BESIDE_CURVES = 0.16


@dataclass(frozen=True, eq=False)
class Recovery:
    """What was found in a pair.

    features : FeatureSet, left optical frame, metres; err_par and err_per are 3 sigma bounds
    edgels : (left, right) Edgels that belong to chains
    reason : why features is empty, else ''
    milliseconds : of each stage
    counts : of edgels, chains, segments and matches
    curves : the CURVE features in their order, with the covariance of centre, normal and radius
    """

    features: FeatureSet
    edgels: tuple[Edgels, Edgels]
    reason: str = ''
    milliseconds: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    curves: tuple[Curve, ...] = ()


@dataclass(frozen=True, eq=False)
class _View:
    """One image, segmented."""

    grey: np.ndarray
    edgels: Edgels
    segments: Segments
    ellipses: list[Ellipse]


def _detected(grey: np.ndarray, params: RecoveryParams) -> _View:
    noise = edgel_module.noise_level(grey)
    gradient_noise = noise / (np.sqrt(8.0 * np.pi) * params.sigma**2)
    low, high = max(params.low, 5.0 * gradient_noise), max(params.high, 7.0 * gradient_noise)
    slopes = edgel_module.gradient(grey, params.detector, params.sigma)
    found = edgel_module.detect(grey, params.detector, params.sigma, low, noise, slopes)
    # A picture full of texture would drown its edges: keep the strongest.
    most = min(int(DENSEST * grey.size), MOST_EDGELS)
    if len(found) > most:
        high = max(high, float(np.partition(found.magnitude, len(found) - most)[len(found) - most]))
        found = found.select(found.magnitude > max(low, 0.5 * high))
    chains = link(found, grey.shape, high)
    tolerance = float(np.clip(6.0 * localisation_noise(chains), 0.2, 0.5))
    weakest = max(params.low, WEAKEST * gradient_noise)
    sparse = len(found) < SPARSE * grey.size and weakest < low
    if sparse:
        every = edgel_module.detect(
            grey,
            params.detector,
            params.sigma,
            weakest,
            noise,
            slopes,
            float(np.median(found.width)) if len(found) else None,
        )
        chains = with_weak(chains, every, grey.shape, max(params.low, WEAK_MEAN * gradient_noise), WEAK_COUNT)
    ordered, segments, ellipses = split(chains, tolerance, params.sigma)
    if sparse:
        ordered, segments = track_low_contrast(ordered, segments, slopes, gradient_noise, params.sigma, tolerance)
    segments = fit_double_steps(slopes, ordered, segments, params.sigma)
    return _View(grey, ordered, segments, ellipses)


def _worth_while(segments: Segments) -> Segments:
    """Without scraps, and of too many the longest."""
    kept = segments.select(~spurious(segments))
    return kept.select(np.sort(np.argsort(-kept.length, kind='stable')[:MOST_SEGMENTS]))


def _well_known(curve: Curve) -> bool:
    most = MOST_TILT if curve.coverage > ARC else MOST_TILT_OF_ARC
    return bool(curve.tilt < most and curve.misfit < MOST_MISFIT)


def recover(left: np.ndarray, right: np.ndarray, rig: StereoRig, params: RecoveryParams | None = None) -> Recovery:
    """Straight edges, planar curves and axes of rotation in space.

    left, right : (h, w) or (h, w, 3) images of a rectified pair, of the rig's size; rig : StereoRig
    Raises ValueError or TypeError, naming the argument, for arrays that are no images or not of the rig's size.
    Pictures in which nothing is found give an empty FeatureSet and a reason.
    """
    if not isinstance(rig, StereoRig):
        raise TypeError(f'rig: expected a StereoRig, got {type(rig).__name__}')
    params = params or RecoveryParams()
    clock = [time.perf_counter()]
    stages: dict[str, float] = {}

    def lap(name: str) -> None:
        clock.append(time.perf_counter())
        stages[name] = 1e3 * (clock[-1] - clock[-2])

    greys = []
    for name, image, camera in (('left', left, rig.left), ('right', right, rig.right)):
        grey = edgel_module.as_grey(image, name)
        if grey.shape != (camera.height, camera.width):
            raise ValueError(
                f'{name}: image is {grey.shape[1]} x {grey.shape[0]} pixels, the rig expects '
                f'{camera.width} x {camera.height}'
            )
        greys.append(grey)
    views = [_detected(grey, params) for grey in greys]
    lap('segment')
    found = (views[0].edgels, views[1].edgels)
    counts = {
        'left edgels': len(found[0]),
        'right edgels': len(found[1]),
        'left segments': len(views[0].segments),
        'right segments': len(views[1].segments),
    }
    for name, view in zip(('left', 'right'), views):
        if len(view.segments) == 0:
            return Recovery(FeatureSet.empty(), found, f'no texture: no edges in the {name} image', stages, counts)
    if np.array_equal(greys[0], greys[1]):
        return Recovery(
            FeatureSet.empty(), found, 'left and right are the same picture, so nothing has a disparity', stages, counts
        )
    segments = _worth_while(views[0].segments), _worth_while(views[1].segments)
    offset = rig.left.cx - rig.right.cx
    lowest = params.min_disparity + offset
    highest = (0.9 * rig.left.width if params.max_disparity is None else params.max_disparity) + offset
    matches = match(
        greys[0],
        greys[1],
        segments[0],
        segments[1],
        lowest,
        highest,
        params.support_radius,
        least_belief=params.min_belief,
    )
    counts['matches'] = len(matches)
    lap('match')
    if len(matches) == 0:
        # Ordinary mistakes deserve their name.
        reason = 'no edge of the left image has a match in the right one'
        if len(match(greys[1], greys[0], segments[1], segments[0], lowest, highest, params.support_radius)) >= 3:
            reason = 'edges match only with left and right exchanged: are the images swapped?'
        return Recovery(FeatureSet.empty(), found, reason, stages, counts)
    matches, *joined = join_matched(matches, *segments)
    matches, *joined = split_matched(matches, joined[0], joined[1], found, params.sigma)
    segments = joined[0], joined[1]
    blur = edgel_module.blur_variance(found)
    curves = recover_curves(matches, segments[0], segments[1], (views[0].ellipses, views[1].ellipses), found, rig, blur)
    curves = distinct(completed(curves, segments, found, rig, blur))
    rims = without_balls(curves, found, rig, blur)
    told = [c for c in rims if _well_known(c)]
    axes, surfaces = find_axes(told, segments, rig)
    surfaces += [(c, np.append(c.normal, 0.0)) for c in rims if not _well_known(c)]
    lap('curves')
    # Outlines are no edges, and tell edges nothing; neither does an end that a curved surface hides.
    matches = matches.select(~contours(matches, segments, surfaces, rig))
    junctions = hidden_ends(
        matches, segments, (find_junctions(segments[0]), find_junctions(segments[1])), curves, surfaces, rig
    )
    cluttered = min(len(side) / grey.size for side, grey in zip(found, greys)) > CLUTTERED
    lines, *shown = edges(matches, *segments, *junctions, params.rectification_sigma, offset, cluttered)
    of_lines = shown[0], shown[1]
    lines = aligned(lines, of_lines[0], told, rig)
    lap('lines')
    in_space = to_space(lines, of_lines[0], rig)
    span = np.linalg.norm(in_space.ends[:, 1] - in_space.ends[:, 0], axis=1)
    keep = np.isfinite(span) & np.isfinite(in_space.err_par) & (in_space.err_per < LEAST_DETERMINED * span)
    keep &= lines.extent[:, 1] - lines.extent[:, 0] >= params.min_length
    # Corners that were none may tell more than any match was allowed to.
    run = of_lines[0].direction[lines.left]
    slope = lines.coefficient[:, 1]
    keep &= (np.abs(slope) < STEEPEST * np.hypot(run[:, 0] - 0.5 * slope, run[:, 1])) | lines.strut
    # A segment of an arc in both images is none, whether its curve was recovered or not; nor is one of an arc in one
    # image, unless it runs from corner to corner where nothing is curved.
    arcs = (of_lines[0].arc[lines.left] >= 0).astype(int) + (of_lines[1].arc[lines.right] >= 0)
    keep &= (arcs == 0) | ((arcs == 1) & lines.fixed.all(axis=1) & (len(curves) == 0))
    unseen = counterparts(told, found, rig, blur)
    keep &= ~on_curves(lines, of_lines, curves + unseen) & ~contours(lines, of_lines, surfaces, rig)
    curves = on_faces(told, in_space.ends[keep], in_space.err_per[keep])
    keep &= in_space.err_per < (BESIDE_CURVES if rims else LEAST_DETERMINED) * span
    err_per = in_space.err_per[keep]
    ends, err_par = joined_ends(in_space.ends[keep], in_space.err_par[keep], err_per, curves + unseen)
    features = FeatureSet.concatenate(
        [FeatureSet.from_edges(ends[:, 0], ends[:, 1], err_par, err_per), curve_features(curves), axis_features(axes)]
    )
    lap('features')
    reason = '' if len(features) else 'no matched edge is long enough'
    return Recovery(features, found, reason, stages, counts, tuple(curves))


def warm_up() -> None:
    """Compile, or load from numba's cache, what :func:`recover` needs, so that no first pair waits for it."""
    left = np.full((96, 128), 40, np.uint8)
    left[24:72, 40:92] = 200
    v, u = np.mgrid[0:96, 0:128]
    left[(u - 66) ** 2 + (v - 48) ** 2 < 15**2] = 90
    recover(left, np.roll(left, -12, axis=1), StereoRig.symmetric(PinholeCamera.centred(128, 96, 150.0), 0.05))
    warm_up_profiles()
    warm_up_faint()
