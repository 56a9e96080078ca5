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
from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, IntArray

from ..curves.curve import Curve
from ..detection.segments import Segments
from . import parallel_kernels
from .factors import Factors
from .parallel_kernels import Rows
from .settings import (
    CLEAR,
    DIRECTION_SIGMA,
    FALSE_GROUPS,
    GROUP_DOUBT,
    GROUP_SEEDS,
    LEAST_MEMBERS,
    MOST_GROUPS,
    SLOPE_SPREAD,
)


@dataclass(frozen=True, eq=False)
class _Group:
    """Edges of one direction.

    Attributes
    ----------
    direction : (3,) float64
        Unit, left frame, in which its edges were added up.
    total : (3, 3) float64
        Normal matrix of them and of axes of circles.
    fits : (n,) bool
        Which of all edges belong to it.
    others : (n,) int
        How many it has beside each edge.
    share : float
        Of the edges that can tell, those that belong to it.
    """

    direction: FloatArray
    total: FloatArray
    fits: BoolArray
    others: IntArray
    share: float


def _rows(left: Segments, index: AnyArray, coefficient: AnyArray, covariance: AnyArray, rig: StereoRig) -> Rows:
    focal = rig.left.fx
    middle = (left.centre[index] - [rig.left.cx, rig.left.cy]) / focal
    along = left.direction[index]
    scale = np.array([1.0 / focal, 1.0])
    disparity = (coefficient[:, 0] - (rig.left.cx - rig.right.cx)) / focal
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    image = np.column_stack([across, -(across * middle).sum(axis=1)])
    slope = coefficient[:, 1]
    depth = np.column_stack([slope[:, None] * along, disparity - slope * (middle * along).sum(axis=1)])
    arrays = image, depth, middle, along, left.sigma[index] * scale, disparity, covariance * np.outer(scale, scale)
    return Rows(*(np.ascontiguousarray(a) for a in arrays))


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


def _groups(rows: Rows, bare: Rows, order: IntArray, axes: FloatArray) -> list[_Group]:
    """Directions that edges share.

    rows, bare : who is of a group is asked by all that is known, what it says is told by what no group has told
    order : seeds, the best known edge first; axes : (k, 3, 3) what axes of circles say, the best known first
    """
    alone = parallel_kernels.squares_by_themselves(bare)
    told = np.zeros(len(order), bool)
    told_axes = np.zeros(len(axes), bool)
    found: list[_Group] = []
    tried = 0
    for seed, k in [(axes, k) for k in range(len(axes))] + [(alone, k) for k in order]:
        if told_axes[k] if seed is axes else told[k]:
            continue
        if len(found) == MOST_GROUPS or tried == GROUP_SEEDS:
            break
        tried += 1
        direction, total, chance, fits, same = parallel_kernels.grown(rows, bare, seed[k], axes)
        others = fits.sum() - fits + 2 * same.sum()
        # So many edges of any directions would agree with one of all seeds by accident.
        false_alarms = min(GROUP_SEEDS, len(order)) * _poisson_tail(chance[chance < CLEAR].sum(), int(others.max()))
        if others.max() >= LEAST_MEMBERS - 1 and false_alarms < FALSE_GROUPS:
            share = fits.sum() / (GROUP_DOUBT + (chance < CLEAR).sum())
            found.append(_Group(direction, total, fits, others, float(share)))
            told |= fits
            told_axes |= same
    return found


def parallel_factors(
    left: Segments,
    index: AnyArray,
    known: tuple[AnyArray, AnyArray],
    alone: tuple[AnyArray, AnyArray],
    curves: Sequence[Curve],
    rig: StereoRig,
) -> Factors:
    """Statements that edges run in the direction of a parallel group.

    Parameters
    ----------
    left : Segments
        Of the left image.
    index : (n,) int
        The edges' segments.
    known : (n, 2), (n, 2, 2)
        Their disparities a + b s, and covariances, by all that is known.
    alone : (n, 2), (n, 2, 2)
        The same without any parallel group: else what a group told its edges would come back as their own.
    curves : sequence of Curve
        Their normals are directions of the object as well.
    rig : StereoRig
    """
    x, covariance = known
    usable = np.flatnonzero(left.arc[index] < 0)
    if len(usable) == 0:
        return Factors.none()
    rows, bare = (_rows(left, index[usable], a[usable], b[usable], rig) for a, b in (known, alone))
    axes = np.array([_of_normal(c) for c in sorted(curves, key=lambda c: c.tilt)]).reshape(-1, 3, 3)
    found = []
    length = left.length[index[usable]]
    for group in _groups(rows, bare, np.argsort(covariance[usable, 1, 1]), axes):
        by, noise, chance, good = parallel_kernels.told(
            rows, bare, group.total, group.direction, group.fits, group.others
        )
        k = np.flatnonzero(good)
        row = np.stack([by[:, 0] / rig.left.fx / by[:, 1], np.ones(len(by))], axis=1)
        at_infinity = row[k, 0] * (rig.left.cx - rig.right.cx)
        # A line that runs to the point where the group meets is of the group, or happens to run there.
        prior = group.share / (group.share + (1.0 - group.share) * chance[k])
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


def _without_repetition(factors: Factors, x: FloatArray) -> Factors:
    """The factors without what says the same of an edge as a better known one: groups of nearly one direction."""
    off = factors.value - (factors.row * x[factors.edge]).sum(axis=1)
    order = np.argsort(factors.sigma, kind='stable')
    return factors.select(parallel_kernels.without_repetition(factors.edge, off, factors.sigma, order, len(x)))
