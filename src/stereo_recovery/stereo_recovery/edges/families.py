"""Short edges take the direction of all that are parallel to them together: edges and axes of circles.

Depth tells the direction of a short edge badly, but where its line runs in the image is well known. The lines of
parallel edges meet in one point, the picture of their direction: a family of them tells it much better than the depth
of any one. An edge whose line runs to that point, and whose own depth allows it, is taken to be of the family.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import AnyArray

from ..curves.curve import Curve
from ..detection.segments import Segments
from .lines3d import Lines3D
from .parallels import FLAT, GATE, VAGUE

# How far, radians, edges of one direction miss it.
WANDER = 2e-3
# An edge tells its family when the chance that it had any other direction is below the first, and is told below the
# second. There have to be more of them than so many times what agrees by accident.
CLEAR, UNCLEAR, ACCIDENTS = 0.01, 0.05, 3.0
# At most so many families, from so many seeds, the best known first: texture has thousands of edges and no family. So
# many edges or axes are one at least.
MOST, SEEDS, LEAST = 12, 100, 3
# A family must know the slope in disparity this much better than the edge itself (sigma); how far, pixels a pixel, it
# misses that; an edge that recedes more steeply than this (of its direction, what is seen) is not told.
BETTER, SLOPE_WANDER, LEVER = 0.7, 2e-4, 0.1


@dataclass(frozen=True, eq=False)
class _Rows:
    """What n edges say of their direction d (unit, left frame): image @ d = 0 and depth @ d = 0, each row (n, 3).

    middle : (n, 2) and along : (n, 2), the lines in units of the focal length; sigma : (n, 2), of place and
    of direction; covariance : (n, 2, 2) of disparity over focal length and of its slope
    """

    image: AnyArray
    depth: AnyArray
    middle: AnyArray
    along: AnyArray
    sigma: AnyArray
    disparity: AnyArray
    covariance: AnyArray

    def variances(self, d: AnyArray) -> tuple[AnyArray, AnyArray]:
        """(n,) each: of the two rows' products with a direction (3,) or (n, 3)."""
        lever = ((d[..., :2] - d[..., 2:] * self.middle) * self.along).sum(axis=1)
        w = np.broadcast_to(d[..., 2], lever.shape)
        image = (lever * self.sigma[:, 1]) ** 2 + (w * self.sigma[:, 0]) ** 2 + WANDER**2
        by = np.stack([w, lever], axis=1)
        return image, np.einsum('ni,nij,nj->n', by, self.covariance, by)


def _rows(left: Segments, index: AnyArray, coefficient: AnyArray, covariance: AnyArray, rig: StereoRig) -> _Rows:
    focal = rig.left.fx
    middle = (left.centre[index] - [rig.left.cx, rig.left.cy]) / focal
    along = left.direction[index]
    scale = np.array([1.0 / focal, 1.0])
    disparity = (coefficient[:, 0] - (rig.left.cx - rig.right.cx)) / focal
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    image = np.column_stack([across, -(across * middle).sum(axis=1)])
    slope = coefficient[:, 1]
    depth = np.column_stack([slope[:, None] * along, disparity - slope * (middle * along).sum(axis=1)])
    return _Rows(image, depth, middle, along, left.sigma[index] * scale, disparity, covariance * np.outer(scale, scale))


def _direction(information: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Direction (..., 3) and covariance (..., 3, 3) by least squares, given the rows' normal matrix (..., 3, 3)."""
    values, vectors = np.linalg.eigh(information)
    spread = np.einsum(
        '...ik,...k,...jk->...ij', vectors[..., 1:], 1.0 / np.maximum(values[..., 1:], 1e-9), vectors[..., 1:]
    )
    return vectors[..., 0], spread


def _squares(rows: _Rows, d: AnyArray) -> AnyArray:
    """(n, 3, 3): the rows' squares by their weights."""
    image, depth = rows.variances(d)
    squares: AnyArray = (
        np.einsum('ni,nj->nij', rows.image, rows.image) / image[:, None, None]
        + np.einsum('ni,nj->nij', rows.depth, rows.depth) / depth[:, None, None]
    )
    return squares


def _fits(rows: _Rows, d: AnyArray, spread: AnyArray) -> tuple[AnyArray, AnyArray]:
    """(n,) bool: edges that may have a direction d of this covariance; (n,): chance that any edge might have it."""
    image, depth = rows.variances(d)
    spread = np.broadcast_to(spread, (len(image), 3, 3))
    good, chance = np.ones(len(image), bool), np.ones(len(image))
    scales = (np.hypot(*(d[..., :2] - d[..., 2:] * rows.middle).T), np.abs(rows.disparity))
    for row, variance, scale in zip((rows.image, rows.depth), (image, depth), scales):
        variance = variance + np.einsum('ni,nij,nj->n', row, spread, row)
        good &= (row * d).sum(axis=1) ** 2 < GATE**2 * variance
        chance *= np.minimum(2.0 / np.pi * GATE * np.sqrt(variance) / np.maximum(scale, 1e-6), 1.0)
    return good, chance


def _of_normal(curve: Curve) -> AnyArray:
    """(3, 3): what a curve's normal says of its own direction, as rows' squares by their weights."""
    flat = np.eye(3) - np.outer(curve.normal, curve.normal)
    return flat / (curve.tilt**2 + WANDER**2)


def _families(rows: _Rows, order: AnyArray, axes: AnyArray) -> list[tuple[AnyArray, AnyArray, AnyArray]]:
    """Directions that edges share: normal matrices of each edge (n, 3, 3) and of all (3, 3), others of each edge (n,).

    order : seeds, the best known edge first; axes : (k, 3, 3) what axes of circles say, the best known first
    """
    own = np.cross(rows.image, rows.depth)
    own /= np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-12)
    alone = _squares(rows, own)
    told = np.zeros(len(order), bool)
    told_axes = np.zeros(len(axes), bool)
    found: list[tuple[AnyArray, AnyArray, AnyArray]] = []
    tried = 0
    for seed, k in [(axes, k) for k in range(len(axes))] + [(alone, k) for k in order]:
        if told_axes[k] if seed is axes else told[k]:
            continue
        if len(found) == MOST or tried == SEEDS:
            break
        tried += 1
        total = seed[k]
        for _ in range(2):
            d, spread = _direction(total)
            fits, chance = _fits(rows, d, spread)
            fits &= chance < CLEAR
            same = np.array([d @ (axis @ d) < GATE**2 * (1.0 + np.trace(axis @ spread)) for axis in axes], bool)
            added = _squares(rows, d) * fits[:, None, None]
            total = added.sum(axis=0) + axes[same].sum(axis=0)
        others = fits.sum() - fits + 2 * same.sum()
        # More than so many edges of any directions would agree by accident.
        if others.max() >= max(LEAST - 1, ACCIDENTS * chance[chance < CLEAR].sum()):
            found.append((added, total, others))
            told |= fits
            told_axes |= same
    return found


def aligned(lines: Lines3D, left: Segments, curves: Sequence[Curve], rig: StereoRig) -> Lines3D:
    """The lines, vague ones among them turned into the direction of their families.

    left : the left image's segments; curves : whose normals are directions of the object as well
    """
    usable = np.flatnonzero((left.arc[lines.left] < 0) & np.isfinite(lines.covariance).all(axis=(1, 2)))
    slope_sigma = np.sqrt(np.maximum(lines.covariance[usable, 1, 1], 0.0))
    if len(usable) == 0 or not (slope_sigma > VAGUE).any():
        return lines
    coefficient, covariance = lines.coefficient[usable], lines.covariance[usable]
    rows = _rows(left, lines.left[usable], coefficient, covariance, rig)
    axes = np.array([_of_normal(c) for c in sorted(curves, key=lambda c: c.tilt)]).reshape(-1, 3, 3)
    families = _families(rows, np.argsort(slope_sigma), axes)
    if not families:
        return lines
    off, by, noise = (np.array(values) for values in zip(*(_told(rows, rig, *family) for family in families)))
    # The family that knows best, unless another one contradicts it.
    k = np.argmin(noise, axis=0)
    each = np.arange(len(usable))
    best, least, row = off[k, each], noise[k, each], by[k, each]
    with np.errstate(invalid='ignore'):
        contradicted = ((off - best) ** 2 > GATE**2 * (noise + least)) & np.isfinite(noise)
        own = np.einsum('ni,nij,nj->n', row, covariance, row)
        # What runs along the rows has hardly a depth of its own to say whose it is: see :mod:`.parallels`.
        turned = (
            np.isfinite(least)
            & ~contradicted.any(axis=0)
            & (slope_sigma > VAGUE)
            & (np.abs(rows.along[:, 1]) > FLAT)
            & (least < BETTER**2 * own)
            & (best**2 < GATE**2 * (own + least))
        )
    at, row = usable[turned], row[turned]
    gain = np.einsum('nij,nj->ni', covariance[turned], row) / (own + least)[turned, None]
    all_coefficient, all_covariance = lines.coefficient.copy(), lines.covariance.copy()
    all_coefficient[at] -= gain * best[turned, None]
    all_covariance[at] -= np.einsum('ni,nj->nij', gain, np.einsum('nij,nj->ni', covariance[turned], row))
    return replace(lines, coefficient=all_coefficient, covariance=all_covariance)


def _told(
    rows: _Rows, rig: StereoRig, added: AnyArray, total: AnyArray, others: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Residual (n,), its row (n, 2) and variance (n,) of a parallel group's direction, without each edge's share."""
    d, spread = _direction(total - added)
    lever = ((d[:, :2] - d[:, 2:] * rows.middle) * rows.along).sum(axis=1)
    good, chance = _fits(rows, d, spread)
    good &= (others >= LEAST - 1) & (np.abs(lever) > LEVER) & (chance < UNCLEAR)
    lever = np.where(good, lever, 1.0)
    off = (rows.depth * d).sum(axis=1) / lever
    by = np.stack([d[:, 2] / rig.left.fx / lever, np.ones_like(lever)], axis=1)
    noise = np.einsum('ni,nij,nj->n', rows.depth, spread, rows.depth) / lever**2 + SLOPE_WANDER**2
    return off, by, np.where(good, noise, np.inf)
