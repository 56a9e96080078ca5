"""From a rectified stereo pair to features in space: the facade of library users, the command line and the node."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, overload

import numpy as np

from msgs_py import CameraRig, FeatureSet, PinholeCamera, Pose, StereoRig
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.steps import CompileStep, run_all
from msgs_py.numeric.threads import together
from msgs_py.numeric.typed import AnyArray, Float32Array

from .cameras.pairs import CameraPair, camera_pair, main_pairs
from .common_error import with_columns_off
from .curves import fit_kernels
from .curves.axes import axis_features
from .curves.axis_constraint import off_axis_and_plane
from .curves.coaxial_starts import agreed, around
from .curves.curve import Curve, CurveShape, curve_features
from .curves.curved_shapes import CurvedShapes, recover_curved_shapes
from .curves.observations import StereoEdgels
from .curves.occluding_contours import contours_of, on_contours
from .curves.orientation import oriented_by_faces
from .detection.conics import sampson
from .detection.edgel_kernels import position_factor
from .detection.edgels import Edgels, as_grey, blur_variance
from .detection.segments import Segments
from .detection.view import View, detect_view, detect_views
from .edges.all_views import all_views
from .edges.further_views import ViewLines
from .edges.hiding import hidden_ends
from .edges.joining import join_parts
from .edges.joining_kernels import contrast_across, same_contrast
from .edges.lines3d import EdgesInSpace, Lines3D, to_space, with_rig_error
from .edges.selection import is_edge, on_curves
from .edges.straight_edges import Beside, edges
from .edges.tangency import joined_ends
from .edges.texture_matching import seen_by_texture
from .estimation.texture import AlignedStrips, Texture, texture_rows
from .matching.arc_rows import arc_rows
from .matching.dense import DenseDisparity
from .matching.further_views import FurtherView, further_view
from .matching.labelling import match
from .matching.matches import Matches
from .matching.merging import join_matched, split_matched
from .matching.rig_error import PairRows, RigError, rig_error
from .matching.row_error import fitted_error, row_witnesses
from .matching.stereo_segments import StereoSegments
from .matching.turned import turned_view
from .params import RecoveryParams
from .settings import (
    COLUMNS_OVER_ROWS,
    CURVES_SHARE,
    EDGES_SHARE,
    LABELLING_SHARE,
    MATCHED_SHARE,
    MOST_DISPARITY_SHARE,
    SWAPPED_MATCHES,
)
from .stopwatch import Late, Stopwatch, never
from .tone import in_light


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
    left_out : tuple of str
        What was not done to keep to the time limit.
    rows : PairRows, optional
        What the pair shows of its rows; None when nothing is matched.
    """

    features: FeatureSet
    edgels: tuple[Edgels, Edgels] = field(repr=False)
    reason: str = ''
    milliseconds: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    curves: tuple[Curve, ...] = ()
    left_out: tuple[str, ...] = ()
    rows: PairRows | None = field(default=None, repr=False)

    @cached_property
    def rig_error(self) -> RigError | None:
        """How far the right camera of the pair has turned since it was calibrated; None when nothing is matched.

        Computed when it is asked for.
        """
        return None if self.rows is None else rig_error(*self.rows)


@overload
def recover(
    left: AnyArray,
    right: AnyArray,
    rig: StereoRig,
    params: RecoveryParams | None = None,
    *,
    deadline: Deadline | None = None,
) -> Recovery: ...


@overload
def recover(
    left: Sequence[AnyArray],
    right: CameraRig | StereoRig,
    rig: RecoveryParams | None = None,
    params: RecoveryParams | None = None,
    *,
    deadline: Deadline | None = None,
) -> Recovery: ...


def recover(
    left: Any, right: Any, rig: Any = None, params: RecoveryParams | None = None, *, deadline: Deadline | None = None
) -> Recovery:
    """Straight edges, planar curves and axes of rotation in space.

    ``recover(left, right, rig, params)`` takes a rectified pair, ``recover(images, cameras, params)`` the pictures of
    any number of calibrated cameras, wherever these stand. Of three cameras and more, the pair that shows most gives
    edges, curves and axes, and the others measure its edges, give depth to those that the pair shows along its rows,
    and vote on its matches. A camera that is covered, or sees something else, changes nothing.

    Parameters
    ----------
    left, right : (h, w) or (h, w, 3) uint8, uint16 or float
        Images of a rectified pair, of the rig's size. Or, as the first two arguments, ``images``, a sequence of such
        without distortion, and ``cameras``, a CameraRig with as many cameras (or a StereoRig).
    rig : StereoRig
        The two calibrated cameras.
    params : RecoveryParams, optional
        Thresholds that a user may change.
    deadline : Deadline, optional
        When it has passed, what has not begun is left out where it can be, as at the time limit of the parameters.

    Returns
    -------
    Recovery
        Features in the optical frame of the left or first camera, metres. Images in which nothing is found give an
        empty FeatureSet and a reason.

    Raises
    ------
    TypeError, ValueError
        For arrays that are no images or not of the rig's size, and for another number of images than of cameras; the
        message names the argument.

    Examples
    --------
    Two images of one grey level show no edges:

    >>> rig = StereoRig.symmetric(PinholeCamera.centred(64, 48, 100.0), 0.1)
    >>> plain = np.full((48, 64), 128, np.uint8)
    >>> recover(plain, plain, rig).reason
    'no texture: no edges in the left image'
    >>> recover([plain, plain], CameraRig.from_stereo(rig)).reason
    'no texture: no edges in the left image'
    """
    if isinstance(right, StereoRig):
        right = CameraRig.from_stereo(right)
    many = isinstance(right, CameraRig)
    params = rig if many and isinstance(rig, RecoveryParams) else params
    params = params or RecoveryParams()
    watch = Stopwatch(params.time_limit, deadline=deadline)
    if many:
        return _of_many(left, right, params, watch)
    greys = _grey_images(left, right, rig)
    views = _detected(greys, params, watch)
    return _features(_matched_pair(views[0], views[1], rig, params, watch), (), params, watch)


@dataclass(frozen=True, eq=False)
class _MatchedPair:
    """A pair of pictures with their matched segments; a reason where there are none."""

    rig: StereoRig
    views: tuple[View, View]
    counts: dict[str, int]
    segments: tuple[Segments, Segments]
    matches: Matches
    dense: DenseDisparity | None = None
    reason: str = ''

    @property
    def greys(self) -> tuple[Float32Array, Float32Array]:
        """(h, w) each, grey levels: the left and the right picture."""
        return self.views[0].grey, self.views[1].grey

    @property
    def edgels(self) -> tuple[Edgels, Edgels]:
        """Of the left and of the right picture."""
        return self.views[0].edgels, self.views[1].edgels

    @property
    def share(self) -> float:
        """Matched share of the left picture's length of segments."""
        return self.matched_length / max(float(self.segments[0].length.sum()), NOT_ZERO)

    @property
    def matched_length(self) -> float:
        """Of the left picture's segments, pixels."""
        return float(self.segments[0].length[np.unique(self.matches.left)].sum())


def matched_length(left: AnyArray, right: AnyArray, rig: StereoRig, params: RecoveryParams | None = None) -> float:
    """Length of the left image's edges that have a match in the right one, pixels: what speaks for a pair being one.

    Parameters
    ----------
    left, right : (h, w) or (h, w, 3) uint8, uint16 or float
    rig : StereoRig
    params : RecoveryParams, optional
    """
    params = params or RecoveryParams()
    watch = Stopwatch(params.time_limit)
    views = _detected(_grey_images(left, right, rig), params, watch)
    return _matched_pair(views[0], views[1], rig, params, watch).matched_length


def _detected(greys: Sequence[Float32Array], params: RecoveryParams, watch: Stopwatch) -> list[View]:
    """What there is in each picture."""
    views = in_light(detect_views(greys, params.detector, params.sigma, params.low, params.high), params.sigma)
    watch.stage('segment')
    return views


def _matched_pair(left: View, right: View, rig: StereoRig, params: RecoveryParams, watch: Stopwatch) -> _MatchedPair:
    """Which segment is which in a rectified pair of pictures."""
    views, greys = (left, right), (left.grey, right.grey)
    edgels = left.edgels, right.edgels
    counts = {
        'left edgels': len(edgels[0]),
        'right edgels': len(edgels[1]),
        'left segments': len(views[0].segments),
        'right segments': len(views[1].segments),
    }
    segments = views[0].matchable, views[1].matchable

    def nothing(reason: str) -> _MatchedPair:
        return _MatchedPair(rig, views, counts, segments, Matches.empty(), reason=reason)

    for name, view in zip(('left', 'right'), views):
        if len(view.segments) == 0:
            return nothing(f'no texture: no edges in the {name} image')
    if np.array_equal(greys[0], greys[1]):
        return nothing('left and right are the same picture, so nothing has a disparity')
    late = watch.late_after(LABELLING_SHARE, 'matching: second pass, with dense disparity')
    matches, dense = _matched(greys, segments, rig, params, late)
    counts['matches'] = len(matches)
    watch.stage('match')
    if len(matches) == 0:
        return nothing(_why_no_match(greys, segments, rig, params))
    matches, *merged = join_matched(matches, *segments)
    matches, *merged = split_matched(matches, merged[0], merged[1], edgels, params.sigma)
    return _MatchedPair(rig, views, counts, (merged[0], merged[1]), matches, dense)


def _features(pair: _MatchedPair, further: Sequence[FurtherView], params: RecoveryParams, watch: Stopwatch) -> Recovery:
    """What follows in space from a matched pair, and from what further cameras show of it."""
    if pair.reason:
        left_out = tuple(watch.left_out)
        return Recovery(
            FeatureSet.empty(), pair.edgels, pair.reason, watch.milliseconds, pair.counts, left_out=left_out
        )
    rig, matches, segments = pair.rig, pair.matches, pair.segments
    seen = StereoSegments.of(matches, segments)
    texture = None if pair.dense is None else Texture.of(pair.greys, pair.dense)
    strips = None if texture is None else AlignedStrips(segments[0], texture)
    beside_edges = None if strips is None else texture_rows(seen, strips)
    of_arcs = arc_rows(matches, segments, (pair.views[0].ellipses, pair.views[1].ellipses), pair.edgels)
    witnesses = row_witnesses(seen, beside_edges, of_arcs)
    rows = fitted_error(witnesses, (rig.right.width, rig.right.height), params.rectification_sigma)
    seen = rows.aligned(seen)
    segments = seen.segments
    ellipses = pair.views[0].ellipses, rows.aligned_ellipses(pair.views[1].ellipses)
    aligned = rows.aligned_edgels(pair.edgels[1])
    stereo_edgels = StereoEdgels(pair.edgels[0], aligned, rig, blur_variance(pair.edgels))
    late = watch.late_after(CURVES_SHARE, 'curves: arcs that were not looked at')
    if strips is not None:
        strips.rows = rows
    shapes, (views, shown) = together(
        lambda: recover_curved_shapes(matches, segments, ellipses, stereo_edgels, late),
        lambda: _all_shown(seen, rows.sigma, further, rig, strips),
    )
    watch.stage('curves')
    late = watch.late_after(EDGES_SHARE, 'edges: parallel groups')
    beside = Beside(rig, pair.greys, rows.sigma, shapes.reported, strips, views, late)
    lines, line_segments = _straight_lines(shown, shapes, beside)
    watch.stage('lines')
    in_space = to_space(lines, line_segments[0], rig)
    kept = is_edge(lines, in_space, line_segments, shapes.curves, params.min_length)
    late = watch.late_after(EDGES_SHARE, 'curves: faces that they lie in')
    curves = shapes.reported
    if shapes.vague and not late():
        curves = shapes.in_faces((in_space.ends[kept], in_space.covariance[kept]))
        kept &= ~on_curves(lines, line_segments, curves)
    curves = oriented_by_faces(curves, in_space.ends[kept], in_space.err_per[kept])
    in_space = with_rig_error(in_space, COLUMNS_OVER_ROWS * rows.sigma, rig)
    parts = EdgesInSpace(*join_parts(in_space.ends[kept], in_space.covariance[kept], rig, pair.greys[0]))
    features = FeatureSet.concatenate(
        [_edge_features(parts, curves), curve_features(curves), axis_features(shapes.axes)]
    )
    features = with_columns_off(features, rows.rms, rig)
    watch.stage('features')
    reason = '' if len(features) else 'no matched edge is long enough'
    pair_rows = PairRows(witnesses, rig, params.rectification_sigma)
    return Recovery(
        features, pair.edgels, reason, watch.milliseconds, pair.counts, tuple(curves), tuple(watch.left_out), pair_rows
    )


def _grey_images(left: AnyArray, right: AnyArray, rig: StereoRig) -> tuple[Float32Array, Float32Array]:
    """(h, w) float32 each: the images as grey levels. Raises as :func:`recover` does."""
    if not isinstance(rig, StereoRig):
        raise TypeError(f'rig: expected a StereoRig, got {type(rig).__name__}')
    return _grey_image('left', left, rig.left), _grey_image('right', right, rig.right)


def _grey_image(name: str, image: AnyArray, camera: PinholeCamera) -> Float32Array:
    """(h, w) float32: one image as grey levels; name is for messages."""
    grey = as_grey(image, name)
    if grey.shape != (camera.height, camera.width):
        raise ValueError(
            f'{name}: image is {grey.shape[1]} x {grey.shape[0]} pixels, the rig expects '
            f'{camera.width} x {camera.height}'
        )
    return grey


def _disparity_range(rig: StereoRig, params: RecoveryParams, scale: float = 1.0) -> tuple[float, float]:
    """Least and largest disparity, pixels; at infinity it is the difference of the principal points.

    scale : pixels of disparity to one of the pair that the parameters are about
    """
    at_infinity = rig.left.cx - rig.right.cx
    # No pixel of one image is farther from one of the other than they are wide, whatever is asked for.
    width = float(rig.left.width)
    most = MOST_DISPARITY_SHARE * width if params.max_disparity is None else scale * params.max_disparity
    least = scale * params.min_disparity
    return max(least + at_infinity, -width), min(most + at_infinity, width)


def _matched(
    greys: tuple[Float32Array, Float32Array],
    segments: tuple[Segments, Segments],
    rig: StereoRig,
    params: RecoveryParams,
    late: Late = never,
) -> tuple[Matches, DenseDisparity | None]:
    """The segments of the two images that show one edge, and dense disparity."""
    return match(greys, segments, _disparity_range(rig, params), params.support_radius, params.min_belief, late)


def _why_no_match(
    greys: tuple[Float32Array, Float32Array],
    segments: tuple[Segments, Segments],
    rig: StereoRig,
    params: RecoveryParams,
) -> str:
    """The reason when no segment has a match: the images may be exchanged."""
    swapped, _ = _matched((greys[1], greys[0]), (segments[1], segments[0]), rig, params)
    if len(swapped) >= SWAPPED_MATCHES:
        return 'edges match only with left and right exchanged: are the images swapped?'
    return 'no edge of the left image has a match in the right one'


def _all_shown(
    seen: StereoSegments, row_sigma: float, further: Sequence[FurtherView], rig: StereoRig, strips: AlignedStrips | None
) -> tuple[Sequence[ViewLines], StereoSegments]:
    """What further cameras say of a pair's edges, and the pair with edges that one of its images alone shows."""
    every = all_views(seen, row_sigma, further, rig)
    return every.views, every.seen if every.views or strips is None else seen_by_texture(every.seen, strips)


def _straight_lines(
    seen: StereoSegments, shapes: CurvedShapes, beside: Beside
) -> tuple[Lines3D, tuple[Segments, Segments]]:
    """Straight edges by their disparities, and the segments that they refer to.

    Occluding contours are left out, and ends that a curved surface hides count as T-junctions: neither gives depth.
    """
    contours = contours_of(shapes.surfaces, seen.segments, beside.rig)
    matches = seen.matches.select(~on_contours(seen.index, contours))
    junctions = hidden_ends(matches, seen.segments, seen.junctions, shapes.curves, contours, beside.rig)
    return edges(replace(seen, matches=matches, junctions=junctions), beside)


def _of_many(images: Any, cameras: CameraRig, params: RecoveryParams, watch: Stopwatch) -> Recovery:
    """:func:`recover` of any number of cameras."""
    greys = _greys_of_many(images, cameras)
    views = _detected(greys, params, watch)
    best: tuple[CameraPair, _MatchedPair] | None = None
    late = watch.late_after(LABELLING_SHARE, 'other pairs of cameras')
    for pair in main_pairs(cameras):
        found = _matched_pair(*_pair_views(pair, views), pair.rig, params, watch)
        if best is None or found.share > best[1].share:
            best = pair, found
        if best[1].share > MATCHED_SHARE or late():
            break
    if best is None:
        raise ValueError('cameras: no two of them are side by side and see the same rows, so nothing has a depth')
    pair, found = best
    further = [] if found.reason else _further_views(views, cameras, pair, found, params, watch)
    result = _features(found, [view for _, view in further], params, watch)
    if len(cameras) > 2:
        used = {f'matches of camera {k}': len(view.seen.matches) for k, view in further}
        result.counts.update({'left camera': pair.cameras[0], 'right camera': pair.cameras[1], **used})
    if pair.first_T_pair == Pose.identity():
        return result
    return replace(
        result,
        features=result.features.transformed(pair.first_T_pair),
        curves=tuple(curve.transformed(pair.first_T_pair) for curve in result.curves),
    )


def _greys_of_many(images: Any, cameras: CameraRig) -> tuple[Float32Array, ...]:
    """(h, w) float32 each: the images as grey levels. Raises as :func:`recover` does."""
    if not isinstance(images, Sequence | np.ndarray):
        raise TypeError(f'images: expected a sequence of pictures, got {type(images).__name__}')
    if len(images) != len(cameras):
        raise ValueError(f'images: expected one of each of {len(cameras)} cameras, got {len(images)}')
    return tuple(
        _grey_image(f'images[{k}]', image, camera) for k, (image, camera) in enumerate(zip(images, cameras.cameras))
    )


def _pair_views(pair: CameraPair, views: Sequence[View]) -> tuple[View, View]:
    """What a pair's two pictures show, of what all cameras' do."""
    own = views[pair.cameras[0]], views[pair.cameras[1]]
    if pair.as_it_comes:
        return own
    greys = pair.pictures((own[0].grey, own[1].grey))
    left, right = (turned_view(*each) for each in zip(own, pair.homographies, greys))
    return left, right


def _further_views(
    views: Sequence[View],
    cameras: CameraRig,
    main: CameraPair,
    found: _MatchedPair,
    params: RecoveryParams,
    watch: Stopwatch,
) -> list[tuple[int, FurtherView]]:
    """The cameras beyond the main pair that form a pair with its left one, and what they show of its segments."""
    left = main.cameras[0]
    result = []
    late = watch.late_after(LABELLING_SHARE, 'further cameras')
    for k in range(len(cameras)):
        pair = None if k in main.cameras else camera_pair(cameras, left, k)
        if pair is None or late():
            continue
        view = views[k]
        # The main pair's left picture may be turned already.
        turn = pair.homographies[0] @ np.linalg.inv(main.homographies[0])
        window = _disparity_range(
            pair.rig, params, pair.rig.baseline * pair.rig.left.fx / main.rig.baseline / main.rig.left.fx
        )
        args = (
            found.segments[0],
            view.matchable,
            pair,
            turn,
            pair.pictures((views[left].grey, view.grey)),
            window,
            params,
        )
        result.append((k, further_view(*args)))
    watch.stage('further cameras')
    return result


def _edge_features(in_space: EdgesInSpace, curves: list[Curve]) -> FeatureSet:
    """Edges as features, ends that touch a curve put to the touching point."""
    ends, covariance = joined_ends(in_space.ends, in_space.covariance, in_space.err_per, curves)
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

    def not_for_every_pair() -> None:
        grey = as_grey(disc, 'left')
        view = detect_view(grey, params.detector, params.sigma, params.low, params.high)
        DenseDisparity(grey, grey, 0.0, 16.0).log_ratio(np.zeros((1, 2), np.int32), np.zeros((1, 9)), view.segments)
        position_factor(1.0, 1.0)
        sampson(np.diag([1.0, 1.0, -1.0]), np.zeros((1, 2)))
        same_contrast(contrast_across(grey, np.zeros(2), np.ones(2)), 1.0)
        seen = StereoEdgels(view.edgels, view.edgels, rig, 1.0).seen
        x, _, z = np.eye(3)
        agreed(np.zeros((2, 2)), np.ones((2, 2)), np.array([False, True]), 1.0)
        circle = fit_kernels.moved(CurveShape(z, z, x, np.ones(2)), np.zeros(8), True)
        first = np.zeros(1, np.int64)
        fit_kernels.residuals(circle, seen, first, np.empty(1), np.empty(1), np.empty((0, 0)))
        fit_kernels.recovered(circle, seen, first)
        around(circle, seen)
        off_axis_and_plane(Curve.unfitted(circle), Curve.unfitted(circle))

    return (
        CompileStep('edges of one image', one_image),
        CompileStep('straight edges in space', lambda: recover(square, np.roll(square, -12, axis=1), rig)),
        CompileStep('curves in space', lambda: recover(disc, np.roll(disc, -12, axis=1), rig)),
        CompileStep('what not every pair needs', not_for_every_pair),
    )


def warm_up() -> None:
    """Compile, or load from the cache, what :func:`recover` needs, so that no first pair waits for it."""
    run_all(compile_steps())
