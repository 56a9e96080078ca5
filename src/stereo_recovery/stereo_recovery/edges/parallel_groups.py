"""Parallel edges: what a group of them, and axes of circles, say of the depth of each.

Depth tells the direction of a short edge badly, but where its line runs in the image is well known. The lines of
parallel edges meet in one point, the picture of their direction, which a group of them tells much better than the depth
of any one. A line that runs to that point is of the group, or happens to run there: how many edges do by chance, and
what share of those whose depth is known are of the group, makes the probability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import AnyArray

from ..curves.curve import Curve
from ..detection.segments import Segments
from .factors import Factors
from .settings import (
    CLEAR,
    DIRECTION_SIGMA,
    FALSE_GROUPS,
    GATE,
    GROUP_DOUBT,
    GROUP_SEEDS,
    LEAST_LEVER,
    LEAST_MEMBERS,
    MOST_GROUPS,
    SLOPE_SIGMA,
    SLOPE_SPREAD,
)


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
        image = (lever * self.sigma[:, 1]) ** 2 + (w * self.sigma[:, 0]) ** 2 + DIRECTION_SIGMA**2
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
    return flat / (curve.tilt**2 + DIRECTION_SIGMA**2)


def _poisson_tail(mean: float, least: int) -> float:
    """Probability of at least so many events of which the mean number is known."""
    term, total = float(np.exp(-mean)), 0.0
    for k in range(least):
        total += term
        term *= mean / (k + 1)
    return max(1.0 - total, 0.0)


def _groups(rows: _Rows, order: AnyArray, axes: AnyArray) -> list[tuple[AnyArray, AnyArray, AnyArray, float]]:
    """Directions that edges share: normal matrices of each edge (n, 3, 3) and of all (3, 3), others of each edge (n,).

    order : seeds, the best known edge first; axes : (k, 3, 3) what axes of circles say, the best known first
    """
    own = np.cross(rows.image, rows.depth)
    own /= np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-12)
    alone = _squares(rows, own)
    told = np.zeros(len(order), bool)
    told_axes = np.zeros(len(axes), bool)
    found: list[tuple[AnyArray, AnyArray, AnyArray, float]] = []
    tried = 0
    for seed, k in [(axes, k) for k in range(len(axes))] + [(alone, k) for k in order]:
        if told_axes[k] if seed is axes else told[k]:
            continue
        if len(found) == MOST_GROUPS or tried == GROUP_SEEDS:
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
        # So many edges of any directions would agree with one of all seeds by accident.
        false_alarms = min(GROUP_SEEDS, len(order)) * _poisson_tail(chance[chance < CLEAR].sum(), int(others.max()))
        if others.max() >= LEAST_MEMBERS - 1 and false_alarms < FALSE_GROUPS:
            found.append((added, total, others, fits.sum() / (GROUP_DOUBT + (chance < CLEAR).sum())))
            told |= fits
            told_axes |= same
    return found


def parallel_factors(
    left: Segments, index: AnyArray, known: tuple[AnyArray, AnyArray], curves: Sequence[Curve], rig: StereoRig
) -> Factors:
    """Statements that edges run in the direction of a parallel group.

    Parameters
    ----------
    left : Segments
        Of the left image.
    index : (n,) int
        The edges' segments.
    known : (n, 2), (n, 2, 2)
        Their disparities a + b s, and covariances.
    curves : sequence of Curve
        Their normals are directions of the object as well.
    rig : StereoRig
    """
    x, covariance = known
    usable = np.flatnonzero(left.arc[index] < 0)
    if len(usable) == 0:
        return Factors.none()
    rows = _rows(left, index[usable], x[usable], covariance[usable], rig)
    axes = np.array([_of_normal(c) for c in sorted(curves, key=lambda c: c.tilt)]).reshape(-1, 3, 3)
    found = []
    length = left.length[index[usable]]
    for *group, share in _groups(rows, np.argsort(covariance[usable, 1, 1]), axes):
        row, noise, chance, good = _told(rows, rig, *group)
        k = np.flatnonzero(good)
        at_infinity = row[k, 0] * (rig.left.cx - rig.right.cx)
        # A line that runs to the point where the group meets is of the group, or happens to run there.
        prior = share / (share + (1.0 - share) * chance[k])
        found.append(
            Factors.of_one(
                usable[k],
                row[k] * length[k, None],
                at_infinity * length[k],
                np.sqrt(noise[k]) * length[k],
                prior,
                SLOPE_SPREAD * length[k],
            )
        )
    return _without_repetition(Factors.concatenate(found), x) if found else Factors.none()


def _without_repetition(factors: Factors, x: AnyArray) -> Factors:
    """The factors without what says the same of an edge as a better known one: groups of nearly one direction."""
    kept: list[int] = []
    said: dict[int, list[int]] = {}
    off = factors.value - (factors.row * x[factors.edge]).sum(axis=1)
    for k in np.argsort(factors.sigma, kind='stable').tolist():
        before = said.setdefault(int(factors.edge[k]), [])
        if all(abs(off[k] - off[m]) >= GATE * np.hypot(factors.sigma[k], factors.sigma[m]) for m in before):
            before.append(k)
            kept.append(k)
    return factors.select(np.array(sorted(kept), np.int64))


def _told(
    rows: _Rows, rig: StereoRig, added: AnyArray, total: AnyArray, others: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray]:
    """Row (n, 2), variance (n,), chance (n,) of a statement of a group, without each edge's share, and who gets it."""
    d, spread = _direction(total - added)
    lever = ((d[:, :2] - d[:, 2:] * rows.middle) * rows.along).sum(axis=1)
    image, _ = rows.variances(d)
    image = image + np.einsum('ni,nij,nj->n', rows.image, np.broadcast_to(spread, (len(image), 3, 3)), rows.image)
    scale = np.hypot(*(d[:, :2] - d[:, 2:] * rows.middle).T)
    good = (rows.image * d).sum(axis=1) ** 2 < GATE**2 * image
    chance = np.minimum(2.0 / np.pi * GATE * np.sqrt(image) / np.maximum(scale, 1e-6), 1.0)
    good &= (others >= LEAST_MEMBERS - 1) & (np.abs(lever) > LEAST_LEVER)
    lever = np.where(good, lever, 1.0)
    by = np.stack([d[:, 2] / rig.left.fx / lever, np.ones_like(lever)], axis=1)
    noise = np.einsum('ni,nij,nj->n', rows.depth, spread, rows.depth) / lever**2 + SLOPE_SIGMA**2
    return by, noise, chance, good
