"""Edges that share corners: one linear least squares a connected wire frame.

Every edge is a disparity a + b s along its line, known by an information matrix. A joint is (edge, place along it,
edge, place along it): there the two have one disparity.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.grouping import linked_groups
from msgs_py.numeric.typed import AnyArray

# Disparity, pixels, by which two edges may miss each other at a corner they share (rounded corners, blur).
CORNER_SIGMA = 0.03
# Corners whose edges disagree by more than this many sigma are occlusions, not corners.
GATE = 3.5


def misses(joints: AnyArray, coefficient: AnyArray) -> AnyArray:
    """(k,) float64, pixels: by how much disparity two edges miss each other at their corners."""
    e, f = joints[:, 0].astype(int), joints[:, 2].astype(int)
    result: AnyArray = (
        coefficient[e, 0] + coefficient[e, 1] * joints[:, 1] - coefficient[f, 0] - coefficient[f, 1] * joints[:, 3]
    )
    return result


def agree(joints: AnyArray, coefficient: AnyArray, covariance: AnyArray) -> AnyArray:
    """(k,) bool: corners at which the edges' own measurements allow one disparity."""
    e, f = joints[:, 0].astype(int), joints[:, 2].astype(int)
    he = np.stack([np.ones(len(e)), joints[:, 1]], axis=1)
    hf = np.stack([np.ones(len(f)), joints[:, 3]], axis=1)
    variance = (
        np.einsum('ni,nij,nj->n', he, covariance[e], he)
        + np.einsum('ni,nij,nj->n', hf, covariance[f], hf)
        + CORNER_SIGMA**2
    )
    result: AnyArray = misses(joints, coefficient) ** 2 < GATE**2 * variance
    return result


def among(joints: AnyArray, kept: AnyArray) -> AnyArray:
    """The joints of edges that are kept, (n,) bool, by their new numbers."""
    number = np.cumsum(kept) - 1
    joints = joints[kept[joints[:, [0, 2]].astype(int)].all(axis=1)].copy()
    joints[:, [0, 2]] = number[joints[:, [0, 2]].astype(int)]
    return joints


def solve_measured(
    information: AnyArray, vector: AnyArray, joints: AnyArray, extent: AnyArray, least: float
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Edges that measure their own depth well, solved together at the corners where they agree.

    information (n, 2, 2), vector (n, 2) : what each edge's own lines say; joints : (k, 4); extent : (n, 2), pixels, the
    part of each edge that counts; least : sigma of disparity at its ends, pixels, up to which an edge is well measured.
    Returns coefficient (n, 2), covariance (n, 2, 2), of the others as they measure it themselves, and known (n,) bool.
    """
    covariance = np.linalg.inv(information)
    coefficient = np.einsum('nij,nj->ni', covariance, vector)
    ends = np.stack([np.ones_like(extent), extent], axis=-1)
    known = np.sqrt(np.einsum('nei,nij,nej->ne', ends, covariance, ends)).max(axis=1) < least
    both = joints[known[joints[:, 0].astype(int)] & known[joints[:, 2].astype(int)]]
    both = both[agree(both, coefficient, covariance)]
    coefficient, covariance = joined(information, vector, both)
    left_over = np.abs(misses(both, coefficient))
    if (left_over > 3.0 * CORNER_SIGMA).any():
        coefficient, covariance = joined(information, vector, both[left_over <= 3.0 * CORNER_SIGMA])
    return coefficient, covariance, known


def joined(information: AnyArray, vector: AnyArray, joints: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Least squares with these corners, one connected wire frame at a time."""
    n = len(information)
    e, f = joints[:, 0].astype(int), joints[:, 2].astype(int)
    label = linked_groups(n, np.column_stack([e, f]))
    coefficient, covariance = np.empty((n, 2)), np.empty((n, 2, 2))
    counts = np.bincount(label, minlength=1)
    alone = counts[label] == 1
    if alone.any():
        covariance[alone] = np.linalg.inv(information[alone])
        coefficient[alone] = np.einsum('nij,nj->ni', covariance[alone], vector[alone])
    # What a corner adds to the four unknowns of its two edges.
    ones = np.ones(len(joints))
    rows = np.column_stack([ones, joints[:, 1], -ones, -joints[:, 3]])
    added = rows[:, :, None] * rows[:, None] / CORNER_SIGMA**2
    place = np.empty(n, np.int64)
    for c in np.flatnonzero(counts > 1):
        members, here = np.flatnonzero(label == c), label[e] == c
        first = 2 * np.arange(len(members))
        place[members] = first
        matrix = np.zeros((2 * len(members), 2 * len(members)))
        blocks = first[:, None] + [0, 1]
        matrix[blocks[:, :, None], blocks[:, None]] = information[members]
        x, y = place[e[here]], place[f[here]]
        index = np.column_stack([x, x + 1, y, y + 1])
        np.add.at(matrix, (index[:, :, None], index[:, None]), added[here])
        inverse = np.linalg.inv(matrix)
        coefficient[members] = (inverse @ vector[members].ravel()).reshape(-1, 2)
        covariance[members] = inverse[blocks[:, :, None], blocks[:, None]]
    return coefficient, covariance
