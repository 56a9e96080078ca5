"""From a rectified stereo pair to features in space: the facade of library users, the command line and the node."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from msgs_py import FeatureSet, PinholeCamera, StereoRig
from msgs_py.numeric.steps import CompileStep, run_all
from msgs_py.numeric.typed import AnyArray, Float32Array

from .curves.axes import axis_features
from .curves.curve import Curve, curve_features
from .curves.curved_shapes import CurvedShapes, recover_curved_shapes
from .curves.observations import StereoEdgels
from .curves.occluding_contours import on_contours
from .curves.opposite_rims import hidden_opposite_rims
from .curves.orientation import oriented_by_faces
from .detection.edgels import Edgels, as_grey, blur_variance
from .detection.junctions import find_junctions
from .detection.segments import Segments
from .detection.view import detect_view, detect_views
from .edges.hiding import hidden_ends
from .edges.lines3d import EdgesInSpace, Lines3D, to_space
from .edges.selection import is_certain_beside_rims, is_edge
from .edges.straight_edges import edges
from .edges.tangency import joined_ends
from .matching.labelling import match
from .matching.matches import Matches
from .matching.merging import join_matched, split_matched
from .matching.row_error import row_error
from .matching.stereo_segments import StereoSegments
from .params import RecoveryParams
from .settings import MOST_DISPARITY_SHARE, SWAPPED_MATCHES


@dataclass(frozen=True, eq=False)
class Recovery:
    """What was found in a pair.

    Parameters
    ----------
    features : FeatureSet
        Left optical frame, metres, each with its covariance; err_par and err_per are three sigma bounds.
    edgels : (Edgels, Edgels)
        Edgels of the left and of the right image that belong to chains.
    reason : str
        Why features is empty, else ''.
    milliseconds : dict of str to float
        Time that each stage took.
    counts : dict of str to int
        Of edgels, segments and matches.
    curves : tuple of Curve
        The CURVE features in their order, with the covariance of centre, normal and radius.
    """

    features: FeatureSet
    edgels: tuple[Edgels, Edgels]
    reason: str = ''
    milliseconds: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    curves: tuple[Curve, ...] = ()


class _Stopwatch:
    """Milliseconds of the stages that have ended, by name."""

    def __init__(self) -> None:
        self.milliseconds: dict[str, float] = {}
        self._since = time.perf_counter()

    def stage(self, name: str) -> None:
        """A stage ends now; the next begins."""
        now = time.perf_counter()
        self.milliseconds[name] = 1e3 * (now - self._since)
        self._since = now


def recover(left: AnyArray, right: AnyArray, rig: StereoRig, params: RecoveryParams | None = None) -> Recovery:
    """Straight edges, planar curves and axes of rotation in space.

    Parameters
    ----------
    left, right : (h, w) or (h, w, 3) uint8, uint16 or float
        Images of a rectified pair, of the rig's size.
    rig : StereoRig
        The two calibrated cameras.
    params : RecoveryParams, optional
        Thresholds that a user may change.

    Returns
    -------
    Recovery
        Features in the left optical frame, metres. Images in which nothing is found give an empty FeatureSet and a
        reason.

    Raises
    ------
    TypeError, ValueError
        For arrays that are no images or not of the rig's size; the message names the argument.

    Examples
    --------
    Two images of one grey level show no edges:

    >>> rig = StereoRig.symmetric(PinholeCamera.centred(64, 48, 100.0), 0.1)
    >>> plain = np.full((48, 64), 128, np.uint8)
    >>> recover(plain, plain, rig).reason
    'no texture: no edges in the left image'
    """
    params = params or RecoveryParams()
    watch = _Stopwatch()
    greys = _grey_images(left, right, rig)
    views = detect_views(greys, params.detector, params.sigma, params.low, params.high)
    watch.stage('segment')
    edgels = views[0].edgels, views[1].edgels
    counts = {
        'left edgels': len(edgels[0]),
        'right edgels': len(edgels[1]),
        'left segments': len(views[0].segments),
        'right segments': len(views[1].segments),
    }

    def nothing(reason: str) -> Recovery:
        return Recovery(FeatureSet.empty(), edgels, reason, watch.milliseconds, counts)

    for name, view in zip(('left', 'right'), views):
        if len(view.segments) == 0:
            return nothing(f'no texture: no edges in the {name} image')
    if np.array_equal(greys[0], greys[1]):
        return nothing('left and right are the same picture, so nothing has a disparity')
    segments = views[0].matchable, views[1].matchable
    matches = _matched(greys, segments, rig, params)
    counts['matches'] = len(matches)
    watch.stage('match')
    if len(matches) == 0:
        return nothing(_why_no_match(greys, segments, rig, params))
    matches, *merged = join_matched(matches, *segments)
    matches, *merged = split_matched(matches, merged[0], merged[1], edgels, params.sigma)
    segments = merged[0], merged[1]
    junctions = find_junctions(segments[0]), find_junctions(segments[1])
    seen = StereoSegments(matches, segments, junctions)
    rows = row_error(seen, (rig.right.width, rig.right.height), params.rectification_sigma)
    segments = segments[0], rows.aligned_segments(segments[1])
    seen = StereoSegments(matches, segments, (junctions[0], find_junctions(segments[1])))
    ellipses = views[0].ellipses, rows.aligned_ellipses(views[1].ellipses)
    stereo_edgels = StereoEdgels(edgels[0], rows.aligned_edgels(edgels[1]), rig, blur_variance(edgels))
    shapes = recover_curved_shapes(matches, segments, ellipses, stereo_edgels)
    watch.stage('curves')
    lines, line_segments = _straight_lines(seen, shapes, rows.sigma, rig)
    watch.stage('lines')
    in_space = to_space(lines, line_segments[0], rig)
    hidden_rims = hidden_opposite_rims(shapes.reported, stereo_edgels)
    kept = is_edge(lines, in_space, line_segments, shapes, hidden_rims, params.min_length, rig)
    curves = oriented_by_faces(shapes.reported, in_space.ends[kept], in_space.err_per[kept])
    if shapes.rims:
        kept &= is_certain_beside_rims(in_space)
    features = FeatureSet.concatenate(
        [_edge_features(in_space, kept, [*curves, *hidden_rims]), curve_features(curves), axis_features(shapes.axes)]
    )
    watch.stage('features')
    reason = '' if len(features) else 'no matched edge is long enough'
    return Recovery(features, edgels, reason, watch.milliseconds, counts, tuple(curves))


def _grey_images(left: AnyArray, right: AnyArray, rig: StereoRig) -> tuple[Float32Array, Float32Array]:
    """(h, w) float32 each: the images as grey levels. Raises as :func:`recover` does."""
    if not isinstance(rig, StereoRig):
        raise TypeError(f'rig: expected a StereoRig, got {type(rig).__name__}')
    greys = []
    for name, image, camera in (('left', left, rig.left), ('right', right, rig.right)):
        grey = as_grey(image, name)
        if grey.shape != (camera.height, camera.width):
            raise ValueError(
                f'{name}: image is {grey.shape[1]} x {grey.shape[0]} pixels, the rig expects '
                f'{camera.width} x {camera.height}'
            )
        greys.append(grey)
    return greys[0], greys[1]


def _disparity_range(rig: StereoRig, params: RecoveryParams) -> tuple[float, float]:
    """Least and largest disparity, pixels; at infinity it is the difference of the principal points."""
    at_infinity = rig.left.cx - rig.right.cx
    most = MOST_DISPARITY_SHARE * rig.left.width if params.max_disparity is None else params.max_disparity
    return params.min_disparity + at_infinity, most + at_infinity


def _matched(
    greys: tuple[Float32Array, Float32Array],
    segments: tuple[Segments, Segments],
    rig: StereoRig,
    params: RecoveryParams,
) -> Matches:
    """The segments of the two images that show one edge."""
    return match(greys, segments, _disparity_range(rig, params), params.support_radius, params.min_belief)


def _why_no_match(
    greys: tuple[Float32Array, Float32Array],
    segments: tuple[Segments, Segments],
    rig: StereoRig,
    params: RecoveryParams,
) -> str:
    """The reason when no segment has a match: the images may be exchanged."""
    swapped = _matched((greys[1], greys[0]), (segments[1], segments[0]), rig, params)
    if len(swapped) >= SWAPPED_MATCHES:
        return 'edges match only with left and right exchanged: are the images swapped?'
    return 'no edge of the left image has a match in the right one'


def _straight_lines(
    seen: StereoSegments, shapes: CurvedShapes, row_sigma: float, rig: StereoRig
) -> tuple[Lines3D, tuple[Segments, Segments]]:
    """Straight edges by their disparities, and the segments that they refer to.

    Occluding contours are left out, and ends that a curved surface hides count as T-junctions: neither gives depth.
    """
    matches = seen.matches.select(~on_contours(seen.index, seen.segments, shapes.surfaces, rig))
    junctions = hidden_ends(matches, seen.segments, seen.junctions, shapes.curves, shapes.surfaces, rig)
    return edges(StereoSegments(matches, seen.segments, junctions), row_sigma, shapes.reported, rig)


def _edge_features(in_space: EdgesInSpace, kept: AnyArray, curves: list[Curve]) -> FeatureSet:
    """The kept (n,) bool edges as features, ends that touch a curve put to the touching point."""
    ends, covariance = joined_ends(in_space.ends[kept], in_space.covariance[kept], in_space.err_per[kept], curves)
    return FeatureSet.from_edges(ends[:, 0], ends[:, 1], covariance=covariance)


def compile_steps() -> tuple[CompileStep, ...]:
    """What :func:`recover` needs compiled, as small computations that use it all."""
    square = np.full((96, 128), 40, np.uint8)
    square[24:72, 40:92] = 200
    v, u = np.mgrid[0:96, 0:128]
    disc = square.copy()
    disc[(u - 66) ** 2 + (v - 48) ** 2 < 15**2] = 90
    rig = StereoRig.symmetric(PinholeCamera.centred(128, 96, 150.0), 0.05)
    params = RecoveryParams()

    def one_image() -> None:
        detect_view(as_grey(disc, 'left'), params.detector, params.sigma, params.low, params.high)

    return (
        CompileStep('edges of one image', one_image),
        CompileStep('straight edges in space', lambda: recover(square, np.roll(square, -12, axis=1), rig)),
        CompileStep('curves in space', lambda: recover(disc, np.roll(disc, -12, axis=1), rig)),
    )


def warm_up() -> None:
    """Compile, or load from the cache, what :func:`recover` needs, so that no first pair waits for it."""
    run_all(compile_steps())
