"""Straight edges in space: disparity along the left line, linear, its covariance, and the points that follow.

Along a left line with points c + s t, disparity is d(s) = a + b s.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import AnyArray

from ..detection.segments import Segments


@dataclass(frozen=True, eq=False)
class Lines3D:
    """n straight edges seen in both images.

    Attributes
    ----------
    left, right : (n,) int32
        The segments.
    extent : (n, 2) float64
        Pixels along the left segment: the part both see.
    coefficient : (n, 2) float64
        Disparity a + b s.
    covariance : (n, 2, 2)
        Of them.
    end_sigma : (n, 2) float64
        Pixels, of the extent.
    fixed : (n, 2) bool
        The end is a corner.
    strut : (n,) bool
        The edge runs from one known corner to another, and one image shows it.
    reliability : (n,) float64
        Probability that all hold on which the edge's depth hangs.
    """

    left: AnyArray
    right: AnyArray
    extent: AnyArray
    coefficient: AnyArray
    covariance: AnyArray
    end_sigma: AnyArray
    fixed: AnyArray
    strut: AnyArray
    reliability: AnyArray

    def __len__(self) -> int:
        return len(self.left)

    @staticmethod
    def concatenate(parts: list[Lines3D]) -> Lines3D:
        """All of them."""
        return Lines3D(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Lines3D)))


@dataclass(frozen=True, eq=False)
class EdgesInSpace:
    """Straight edges in the left optical frame: end points (n, 2, 3), metres, and their 3 sigma bounds (n,), metres."""

    ends: AnyArray
    err_par: AnyArray
    err_per: AnyArray


def to_space(lines: Lines3D, left: Segments, rig: StereoRig) -> EdgesInSpace:
    """End points and 3 sigma bounds along and across (DESIGN section 8). Points beyond infinity give NaN."""
    c, t = left.centre[lines.left][:, None], left.direction[lines.left][:, None]
    s = lines.extent[..., None]
    pixel = c + s * t
    d = lines.coefficient[:, :1] + lines.coefficient[:, 1:] * lines.extent
    true_d = d - (rig.left.cx - rig.right.cx)
    points = rig.triangulate(pixel, pixel[..., 0] - d)
    with np.errstate(divide='ignore', invalid='ignore'):
        scale = points[..., 2] / rig.left.fx
        scale_v = points[..., 2] / rig.left.fy
        by_disparity = -points / true_d[..., None]
        zero = np.zeros_like(scale)
        along = (
            np.stack([t[..., 0] * scale, t[..., 1] * scale_v, zero], axis=-1)
            + lines.coefficient[:, 1:, None] * by_disparity
        )
        across = np.stack([-t[..., 1] * scale, t[..., 0] * scale_v, zero], axis=-1)
        length = np.linalg.norm(along, axis=-1, keepdims=True)
        direction = along / length
        h = np.stack([np.ones_like(lines.extent), lines.extent], axis=-1)
        sigma_d = np.sqrt(np.einsum('nei,nij,nej->ne', h, lines.covariance, h))
        # Along an edge that recedes its depth counts as much as its place in the picture.
        deep = (by_disparity * direction).sum(-1) * sigma_d
        err_par = 3.0 * np.sqrt(((lines.end_sigma * length[..., 0]) ** 2 + deep**2).mean(axis=1))
        sigma = left.sigma[lines.left]
        sigma_e = np.sqrt(sigma[:, :1] ** 2 + (sigma[:, 1:] * lines.extent) ** 2)
        spread = np.zeros(points.shape + (3,))
        for vector, size in ((across, sigma_e), (by_disparity, sigma_d)):
            v = (vector - (vector * direction).sum(-1, keepdims=True) * direction) * size[..., None]
            spread += v[..., :, None] * v[..., None, :]
        spread = np.where(np.isfinite(spread), spread, 0.0)
        # One bound for both ends: their quadratic mean, as the direction has it.
        err_per = 3.0 * np.sqrt(np.linalg.eigvalsh(spread)[..., -1].mean(axis=1))
    return EdgesInSpace(points, err_par, err_per)
