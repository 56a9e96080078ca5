"""Straight edges in space: disparity along the left line, linear, its covariance, and the points that follow.

Along a left line with points c + s t, disparity is d(s) = a + b s.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.covariances import pair_variances, semidefinite
from msgs_py.numeric.typed import AnyArray, FloatArray
from msgs_py.settings import BOUND_SIGMA

from ..detection.segments import Segments


@dataclass(frozen=True, eq=False)
class Lines3D:
    """n straight edges seen in both images.

    Attributes
    ----------
    left, right : (n,) int32
        The segments.
    extent : (n, 2) float64
        Pixels along the left segment: where the edges begin and end.
    coefficient : (n, 2) float64
        Disparity a + b s.
    covariance : (n, 2, 2)
        Of them.
    line_covariance, with_line : (n, 2, 2)
        Of offset (pixels) and direction (radians) of the left line; of a and b with these two.
    end_sigma : (n, 2) float64
        Pixels, of the extent.
    """

    left: AnyArray
    right: AnyArray
    extent: AnyArray
    coefficient: AnyArray
    covariance: AnyArray
    line_covariance: AnyArray
    with_line: AnyArray
    end_sigma: AnyArray

    def __len__(self) -> int:
        return len(self.left)

    @staticmethod
    def concatenate(parts: list[Lines3D]) -> Lines3D:
        """All of them."""
        return Lines3D(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Lines3D)))


def line_covariance(segments: Segments, index: AnyArray) -> FloatArray:
    """(n, 2, 2) of offset (pixels) and direction (radians) of the lines of some segments (n,)."""
    return np.asarray(segments.sigma[index][:, :, None] ** 2 * np.eye(2))


@dataclass(frozen=True, eq=False)
class EdgesInSpace:
    """Straight edges in the left optical frame.

    Attributes
    ----------
    ends : (n, 2, 3) float64, metres
        NaN beyond infinity.
    covariance : (n, 6, 6) float64, square metres
        Of both ends together.
    """

    ends: FloatArray
    covariance: FloatArray

    @property
    def err_par(self) -> FloatArray:
        """(n,) metres: three sigma along, the quadratic mean of both ends (DESIGN section 8)."""
        return np.asarray(BOUND_SIGMA * np.sqrt(self._variances[0].mean(axis=1)))

    @property
    def err_per(self) -> FloatArray:
        """(n,) metres: three sigma across, where that is largest."""
        return np.asarray(BOUND_SIGMA * np.sqrt(self._variances[1].mean(axis=1)))

    @cached_property
    def _variances(self) -> tuple[FloatArray, FloatArray]:
        return pair_variances(self.ends[:, 0], self.ends[:, 1], self.covariance)


def to_space(lines: Lines3D, left: Segments, rig: StereoRig) -> EdgesInSpace:
    """End points and their covariance, by the derivatives of triangulation.

    An end is off by where it is along the left line, by the line itself, and by disparity; the last two go together,
    and both ends have them in common.
    """
    c, t = left.centre[lines.left][:, None], left.direction[lines.left][:, None]
    s = lines.extent[..., None]
    pixel = c + s * t
    d = lines.coefficient[:, :1] + lines.coefficient[:, 1:] * lines.extent
    true_d = d - (rig.left.cx - rig.right.cx)
    points = rig.triangulate(pixel, pixel[..., 0] - d)
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        scale = points[..., 2] / rig.left.fx
        scale_v = points[..., 2] / rig.left.fy
        by_disparity = -points / true_d[..., None]
        zero = np.zeros_like(scale)
        by_place = (
            np.stack([t[..., 0] * scale, t[..., 1] * scale_v, zero], axis=-1)
            + lines.coefficient[:, 1:, None] * by_disparity
        )
        across = np.stack([-t[..., 1] * scale, t[..., 0] * scale_v, zero], axis=-1)
        h = np.stack([np.ones_like(lines.extent), lines.extent], axis=-1)[..., None, :]
        # (n, 2, 3, 2) of each end by offset and direction of the line, and by a and b.
        by_line, by_coefficient = across[..., None] * h, by_disparity[..., None] * h
        both = np.concatenate([by_line, by_coefficient], axis=-1).reshape(-1, 6, 4)
        of_line = np.empty((len(lines), 4, 4))
        of_line[:, :2, :2], of_line[:, 2:, 2:] = lines.line_covariance, lines.covariance
        of_line[:, 2:, :2], of_line[:, :2, 2:] = lines.with_line, lines.with_line.swapaxes(1, 2)
        covariance = both @ of_line @ both.swapaxes(1, 2)
        for end in range(2):
            shift = by_place[:, end] * lines.end_sigma[:, end, None]
            covariance[:, 3 * end : 3 * end + 3, 3 * end : 3 * end + 3] += shift[:, :, None] * shift[:, None, :]
    known = np.isfinite(covariance).all(axis=(1, 2))
    covariance[known] = semidefinite(covariance[known])
    covariance[~known] = np.nan
    return EdgesInSpace(points, covariance)


def with_rig_error(edges: EdgesInSpace, sigma: float, rig: StereoRig) -> EdgesInSpace:
    """Edges with what calibration leaves in the places of their ends in either image.

    sigma : pixels, of the difference between the two images; each has half of the variance, in columns as in rows
    """
    z = edges.ends[..., 2]
    zero = np.zeros_like(z)
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        by_disparity = -edges.ends * (z / (rig.left.fx * rig.baseline))[..., None]
        by_column = np.stack([z / rig.left.fx, zero, zero], axis=-1)
        by_row = np.stack([zero, z / rig.left.fy, zero], axis=-1)
        covariance = edges.covariance.copy()
        for end in range(2):
            block = slice(3 * end, 3 * end + 3)
            for each in (by_column + by_disparity, by_disparity, by_row):
                covariance[:, block, block] += 0.5 * sigma**2 * each[:, end, :, None] * each[:, end, None, :]
    return EdgesInSpace(edges.ends, covariance)
