"""Curves fitted to the edgels of both images, and whether a fit is known well enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from msgs_py.numeric.settings import BOUND_SIGMA
from msgs_py.numeric.typed import FloatArray, IntArray

from . import fit_kernels, settings
from .curve import Curve, CurveShape
from .fit_kernels import Fit, Recovered
from .observations import StereoEdgels
from .orientation import outward


def refine(curve: Curve, edgels: StereoEdgels, circle: bool = True, index: IntArray | None = None) -> Curve | None:
    """Move a curve until both image conics lie on given edgels (thesis 3.10.1).

    Parameters
    ----------
    curve : Curve
        Where to start; left optical frame, metres.
    edgels : StereoEdgels
        All of both images.
    circle : bool
        Fit six parameters of a circle; else eight of an ellipse.
    index : (k,) int64, optional
        Which of the edgels, by their numbers in ``edgels.seen``; all, where it is not given.

    Returns
    -------
    Curve or None
        With covariance, rms and misfit; None when there is no fit, or an ellipse cannot be told from a circle.
    """
    if index is None:
        index = np.arange(len(edgels.seen.points))
    found = fit_kernels.fit(curve.shape, circle, edgels.seen, index)
    return _with_fit(curve, found) if found.good else None


def of_fit(recovered: Recovered, edgels: StereoEdgels) -> Curve | None:
    """The curve of what :func:`.fit_kernels.recovered` returns; None where it is not good."""
    found, belongs, arc, evidence = recovered
    if not found.good:
        return None
    shape, covariance, rms, misfit = found[1:]
    left, right = edgels.masks(belongs)
    return outward(Curve(*shape, covariance, float(rms), left, right, arc[:2], arc[2], float(misfit), float(evidence)))


def distances(curve: Curve, edgels: StereoEdgels, index: IntArray) -> FloatArray:
    """(k,) float64, pixels: signed distances of edgels from a curve's image conics, positive outside.

    The bias that smoothing gives edgels is taken off.
    """
    distance, bias = np.empty(len(index)), np.empty(len(index))
    fit_kernels.residuals(curve.shape, edgels.seen, index, distance, bias, np.empty((0, 0)))
    return distance


def is_determined(curve: Curve) -> bool:
    """Whether a curve is known well enough to be a feature and to explain edgels."""
    return relative_sigma(curve) < settings.DETERMINED_SIGMA


def has_size(curve: Curve) -> bool:
    """Whether the size and the plane of a curve are known at all, up to three sigma."""
    return BOUND_SIGMA * relative_sigma(curve) < 1.0


def bounds_surface(curve: Curve) -> bool:
    """Whether a curve is known well enough to tell where the axis and the contours of a surface that it bounds are."""
    return relative_sigma(curve) < settings.SURFACE_SIGMA


def relative_sigma(curve: Curve) -> float:
    """Radii: what the uncertainty of a curve moves its points by, as far as its normal or its size are uncertain."""
    return max(curve.tilt, float(np.sqrt(curve.covariance[5, 5])) / float(curve.radii[0]))


def _with_fit(curve: Curve, found: Fit) -> Curve:
    """A curve as a fit has moved it."""
    shape, covariance, rms, misfit = found[1:]
    return replace(curve.with_shape(CurveShape(*shape)), covariance=covariance, rms=float(rms), misfit=float(misfit))
