"""Which edgels belong to a curve, which of them measure it, and how much of it they show."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import BoolArray

from ..detection.edgels import Edgels
from . import inlier_kernels, settings
from .curve import CameraView, Curve, angles, image_conic
from .fit import distances, predicted_variance
from .observations import StereoEdgels


def inliers(
    curve: Curve, edgels: Edgels, view: CameraView, blur: float, wide: bool = False
) -> tuple[BoolArray, BoolArray]:
    """Edgels of one image that belong to a curve, and those of them that measure it.

    Parameters
    ----------
    curve : Curve
        Left optical frame, metres.
    edgels : Edgels
        All n edgels of the image, in the order of their chains.
    view : CameraView
        The camera of the image.
    blur : float
        Squared pixels. Variance of the smoothing, see :class:`.observations.StereoEdgels`.
    wide : bool
        The curve's own uncertainty adds to the distance that is allowed.

    Returns
    -------
    belongs : (n,) bool
        Within INLIER_DISTANCE of the image conic, with a gradient across it.
    measures : (n,) bool
        Within INLIER_SIGMA sigma of it, where sigma adds the edgel's own and the fit's; not at the end of a run. An
        occluding contour that starts on a rim is still near it where it is a contour already.
    """
    conic = image_conic(curve, view)
    belongs = inlier_kernels.on_conic(conic, edgels.position, edgels.direction, settings.INLIER_DISTANCE)
    index = inlier_kernels.without_ends(belongs, edgels.position)
    if len(index) == 0:
        return belongs, belongs
    distance = distances(curve, edgels.position[index], view, blur)
    of_fit = min(curve.rms, settings.MEDIAN_FACTOR * float(np.median(np.abs(distance))))
    own = np.hypot(edgels.sigma_position[index], np.minimum(edgels.bias[index], settings.MOST_BIAS))
    sigma = np.hypot(own, of_fit)
    if wide:
        sigma = np.hypot(sigma, np.sqrt(predicted_variance(curve, edgels.position[index], view, blur)))
    limit = np.clip(settings.INLIER_SIGMA * sigma, settings.LEAST_INLIER_DISTANCE, settings.INLIER_DISTANCE)
    measures = np.zeros(len(edgels), bool)
    measures[index[np.abs(distance) < limit]] = True
    return belongs, measures


def visible_arc(curve: Curve, edgels: StereoEdgels) -> tuple[tuple[float, float], float]:
    """The part of a curve that edgels of either image show.

    Parameters
    ----------
    curve : Curve
        Left optical frame, metres.
    edgels : StereoEdgels
        Those that measure it.

    Returns
    -------
    arc : (float, float), radians
        Start and extent: all but the longest gap between edgels. A gap of up to LONGEST_GAP_BINS bins is none.
    coverage : float
        Share of the bins of angle that hold an edgel.
    """
    bins = settings.ARC_BINS
    hit = np.zeros(bins, bool)
    for side, view in edgels.sides:
        angle = angles(curve, side.position, view)
        hit[np.floor(angle / (2.0 * np.pi) * bins).astype(int) % bins] = True
    if hit.all():
        return (0.0, 2.0 * np.pi), 1.0
    # Twice round, so that a gap over the start counts as one.
    last, longest, run = 0, 0, 0
    for k, seen in enumerate(np.concatenate([hit, hit])):
        run = 0 if seen else run + 1
        if run > longest:
            last, longest = k, run
    longest = min(longest, bins)
    if longest <= settings.LONGEST_GAP_BINS:
        return (0.0, 2.0 * np.pi), float(hit.mean())
    start = (last + 1) % bins
    return (2.0 * np.pi * start / bins, 2.0 * np.pi * (bins - longest) / bins), float(hit.mean())
