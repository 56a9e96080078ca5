"""Parallel edges: what a group of them, and axes of circles, say of the depth of each.

Depth tells the direction of a short edge badly, but where its line runs in the image is well known. The lines of
parallel edges meet in one point, the picture of their direction, which a group of them tells much better than the depth
of any one. A line that runs to that point is of the group, or happens to run there: how many edges do by chance, and
what share of those whose depth is known are of the group, makes the probability.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import AnyArray, FloatArray

from ..curves.curve import Curve
from ..detection.segments import Segments
from . import parallel_kernels
from .factors import Factors
from .parallel_kernels import Rows
from .settings import DIRECTION_SIGMA, SLOPE_SPREAD


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
    usable = np.flatnonzero(left.arc[index] < 0)
    if len(usable) == 0:
        return Factors.none()
    rows, bare = (_rows(left, index[usable], a[usable], b[usable], rig) for a, b in (known, alone))
    axes = np.array([_of_normal(c) for c in sorted(curves, key=lambda c: c.tilt)]).reshape(-1, 3, 3)
    found, odds = [], []
    length = left.length[index[usable]]
    for direction, total, fits, others, share in zip(
        *parallel_kernels.groups(rows, bare, np.argsort(known[1][usable, 1, 1]), axes)
    ):
        by, noise, chance, good = parallel_kernels.told(rows, bare, total, direction, fits, others)
        k = np.flatnonzero(good)
        row = np.stack([by[:, 0] / rig.left.fx / by[:, 1], np.ones(len(by))], axis=1)
        at_infinity = row[k, 0] * (rig.left.cx - rig.right.cx)
        # A line that runs to the point where the group meets is of the group, or happens to run there.
        odds.append(share / ((1.0 - share) * chance[k]))
        found.append(
            Factors.of_one(
                usable[k],
                row[k] * length[k, None],
                at_infinity * length[k],
                np.sqrt(noise[k]) * length[k],
                odds[-1] / (1.0 + odds[-1]),
                SLOPE_SPREAD * length[k],
            )
        )
    return _likeliest(Factors.concatenate(found), np.concatenate(odds), alone) if found else Factors.none()


def _likeliest(factors: Factors, odds: FloatArray, alone: tuple[AnyArray, AnyArray]) -> Factors:
    """Of what groups say of an edge that of the one it most likely belongs to: an edge has one direction.

    odds : (k,) by its line that it is of the group; alone : see :func:`parallel_factors`
    """
    off, variance = factors.misses(*alone)
    likelihood = np.log(odds) - 0.5 * (off**2 / variance + np.log(variance))
    order = np.lexsort((-likelihood, factors.edge))
    return factors.select(order[np.unique(factors.edge[order], return_index=True)[1]])
