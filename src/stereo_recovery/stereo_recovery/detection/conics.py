"""Ellipses in the image: which runs of segments are arcs, and the ellipse through them (thesis 3.10.3).

Where a chain follows a curve, its segments turn a little at every break. Runs of segments that turn one way are tried
as ellipses, the longest first; a run that one ellipse explains as well as lines would is an arc, and none of its
segments is a straight edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array

from . import conic_kernels
from .segments import Segments


@dataclass(frozen=True, eq=False)
class Ellipse:
    """An ellipse in the image.

    Attributes
    ----------
    conic : (3, 3) float64, symmetric
        x^T C x = 0 for points x = (u, v, 1), pixels; negative inside.
    rms : float
        Pixels. Distance of the edgels that it was fitted to.

    Examples
    --------
    >>> circle = Ellipse(np.array([[1.0, 0.0, -5.0], [0.0, 1.0, -3.0], [-5.0, -3.0, 30.0]]), 0.1)
    >>> circle.centre.tolist(), circle.radii.round(9).tolist()
    ([5.0, 3.0], [2.0, 2.0])
    """

    conic: FloatArray
    rms: float

    @property
    def centre(self) -> FloatArray:
        """(2,) float64, pixels."""
        return np.asarray(-np.linalg.solve(self.conic[:2, :2], self.conic[:2, 2]), np.float64)

    @property
    def radii(self) -> FloatArray:
        """(2,) float64, pixels, major first."""
        value = -np.linalg.det(self.conic) / np.linalg.det(self.conic[:2, :2])
        result: FloatArray = np.sqrt(value / np.linalg.eigvalsh(self.conic[:2, :2]))
        return result


def sampson(conic: FloatArray, points: FloatArray) -> FloatArray:
    """Signed distance of points from a conic, to first order.

    Parameters
    ----------
    conic : (3, 3) float64, symmetric
        For points (u, v, 1), pixels.
    points : (n, 2) float64, pixels

    Returns
    -------
    (n,) float64, pixels
        Positive outside, for a conic that is negative inside.

    References
    ----------
    P. D. Sampson, "Fitting conic sections to very scattered data", CGIP 18(1), 1982.

    Examples
    --------
    >>> sampson(np.diag([1.0, 1.0, -100.0]), np.array([[10.1, 0.0], [0.0, 9.9]])).round(2).tolist()
    [0.1, -0.1]
    """
    distance: FloatArray = conic_kernels.sampson(np.ascontiguousarray(conic), np.ascontiguousarray(points))
    return distance


def symmetric(numbers: FloatArray) -> FloatArray:
    """Symmetric matrix of a conic.

    Parameters
    ----------
    numbers : (6,) float64
        Coefficients of a u^2 + b u v + c v^2 + d u + e v + f.

    Returns
    -------
    (3, 3) float64

    Examples
    --------
    >>> symmetric(np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])).tolist()
    [[1.0, 1.0, 2.0], [1.0, 3.0, 2.5], [2.0, 2.5, 6.0]]
    """
    a, b, c, d, e, f = numbers
    return np.array([[a, b / 2, d / 2], [b / 2, c, e / 2], [d / 2, e / 2, f]])


def find_arcs(
    position: FloatArray, limit: FloatArray, segments: Segments, closed: BoolArray
) -> tuple[Int32Array, list[Ellipse]]:
    """Which segments are parts of arcs.

    Parameters
    ----------
    position : (n, 2) float64, pixels
        Edgels in the order of the segments.
    limit : (n,) float64, pixels
        Largest offset of each edgel from its curve.
    segments : Segments
        Chain after chain, in their order along the chains.
    closed : (m,) bool
        Of the chains.

    Returns
    -------
    arc : (k,) int32
        Index of the ellipse of each segment's arc, or -1.
    ellipses : list of Ellipse

    References
    ----------
    Thesis 3.10.3.
    """
    arc, conics, errors = conic_kernels.arcs(
        segments.chain, closed, segments.direction, segments.length, position, limit, segments.bounds, segments.sagitta
    )
    return arc, [Ellipse(symmetric(q), float(rms)) for q, rms in zip(conics, errors)]
