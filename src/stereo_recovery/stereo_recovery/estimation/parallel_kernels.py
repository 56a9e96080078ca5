"""Compiled loops over edges that may run in one direction, for :mod:`.parallel_groups`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray
from msgs_py.settings import BOUND_SIGMA

from .settings import (
    CLEAR,
    DIRECTION_SIGMA,
    FALSE_GROUPS,
    GROUP_DOUBT,
    GROUP_SEEDS,
    LEAST_LEVER,
    LEAST_MEMBERS,
    MOST_GROUPS,
    SLOPE_SIGMA,
)


class Rows(NamedTuple):
    """What n edges say of their direction d (unit, left frame): image @ d = 0 and depth @ d = 0, each row (n, 3).

    middle, along : (n, 2), the lines in units of the focal length; sigma : (n, 2), of place and of direction; disparity
    : (n,) over the focal length; covariance : (n, 2, 2) of that and of its slope
    """

    image: FloatArray
    depth: FloatArray
    middle: FloatArray
    along: FloatArray
    sigma: FloatArray
    disparity: FloatArray
    covariance: FloatArray


@njit
def _lever(rows: Rows, i: int, d: FloatArray) -> float:
    """How much edge i's disparity slopes for a direction d, along its line."""
    u, v = d[0] - d[2] * rows.middle[i, 0], d[1] - d[2] * rows.middle[i, 1]
    return float(u * rows.along[i, 0] + v * rows.along[i, 1])


@njit
def _variances(rows: Rows, i: int, d: FloatArray) -> tuple[float, float]:
    """Of edge i's two rows' products with a direction d."""
    lever, w, c = _lever(rows, i, d), d[2], rows.covariance[i]
    image = (lever * rows.sigma[i, 1]) ** 2 + (w * rows.sigma[i, 0]) ** 2 + DIRECTION_SIGMA**2
    return image, w * (c[0, 0] * w + c[0, 1] * lever) + lever * (c[1, 0] * w + c[1, 1] * lever)


@njit
def _product(a: FloatArray, b: FloatArray) -> float:
    """Of two vectors (3,)."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@njit
def _form(matrix: FloatArray, a: FloatArray) -> float:
    """a^T M a, of a matrix (3, 3)."""
    total = 0.0
    for r in range(3):
        total += a[r] * (matrix[r, 0] * a[0] + matrix[r, 1] * a[1] + matrix[r, 2] * a[2])
    return total


@njit
def _add_squares(rows: Rows, i: int, d: FloatArray, to: FloatArray) -> None:
    """Add the squares of edge i's two rows by their weights to a normal matrix (3, 3)."""
    image, depth = _variances(rows, i, d)
    for r in range(3):
        for c in range(3):
            to[r, c] += rows.image[i, r] * rows.image[i, c] / image + rows.depth[i, r] * rows.depth[i, c] / depth


@njit
def direction(information: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Direction (3,) and covariance (3, 3) by least squares, given the rows' normal matrix (3, 3)."""
    values, vectors = np.linalg.eigh(information)
    spread = np.zeros((3, 3))
    for k in range(1, 3):
        weight = 1.0 / max(values[k], NOT_ZERO)
        for r in range(3):
            for c in range(3):
                spread[r, c] += vectors[r, k] * weight * vectors[c, k]
    return np.ascontiguousarray(vectors[:, 0]), spread


@njit
def squares_by_themselves(rows: Rows) -> FloatArray:
    """(n, 3, 3): the rows' squares by their weights, of each edge in its own direction."""
    squares = np.zeros((len(rows.image), 3, 3))
    own = np.empty(3)
    for i in range(len(squares)):
        a, b = rows.image[i], rows.depth[i]
        for c in range(3):
            own[c] = a[(c + 1) % 3] * b[(c + 2) % 3] - a[(c + 2) % 3] * b[(c + 1) % 3]
        own /= max(np.sqrt(_product(own, own)), NOT_ZERO)
        _add_squares(rows, i, own, squares[i])
    return squares


@njit
def grown(
    rows: Rows, bare: Rows, seed: FloatArray, axes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray, BoolArray]:
    """The group that a seed's normal matrix (3, 3) finds.

    rows, bare : by all that is known, which says who belongs to it, and without any group, which makes the direction
    axes : (k, 3, 3) normal matrices of axes of circles

    Returns its direction (3,), the normal matrix (3, 3) that its edges make in that direction, of each edge the chance
    (n,) to agree with it by accident, whether it fits (n,), and which axes do (k,).
    """
    n = len(rows.image)
    d, total, chance = np.zeros(3), seed, np.empty(n)
    fits, same = np.empty(n, np.bool_), np.empty(len(axes), np.bool_)
    for _ in range(2):
        d, spread = direction(total)
        total = np.zeros((3, 3))
        for i in range(n):
            image, depth = _variances(rows, i, d)
            image += _form(spread, rows.image[i])
            depth += _form(spread, rows.depth[i])
            chance[i] = _chance(image, _run(rows, i, d)) * _chance(depth, abs(rows.disparity[i]))
            fits[i] = _product(rows.image[i], d) ** 2 < BOUND_SIGMA**2 * image
            fits[i] &= _product(rows.depth[i], d) ** 2 < BOUND_SIGMA**2 * depth
            fits[i] &= chance[i] < CLEAR
            if fits[i]:
                _add_squares(bare, i, d, total)
        for k in range(len(axes)):
            product = 0.0
            for r in range(3):
                product += _product(axes[k, r], spread[:, r])
            same[k] = _form(axes[k], d) < BOUND_SIGMA**2 * (1.0 + product)
            if same[k]:
                total += axes[k]
    return d, total, chance, fits, same


@njit
def _poisson_tail(mean: float, least: int) -> float:
    """Probability of at least so many events of which the mean number is known."""
    term, total = np.exp(-mean), 0.0
    for k in range(least):
        total += term
        term *= mean / (k + 1)
    return max(1.0 - total, 0.0)


class Groups(NamedTuple):
    """g directions that edges share.

    direction : (g, 3), unit, left frame, in which a group's edges were added up; total : (g, 3, 3), normal matrices of
    them and of axes of circles; fits : (g, n), which of all edges belong to each; others : (g, n), how many it has
    beside each edge; share : (g,), of the edges that can tell, those that belong to it
    """

    direction: FloatArray
    total: FloatArray
    fits: BoolArray
    others: IntArray
    share: FloatArray


@njit(nogil=True)
def groups(rows: Rows, bare: Rows, order: IntArray, axes: FloatArray) -> Groups:
    """Directions that edges share.

    rows, bare : who is of a group is asked by all that is known, what it says is told by what no group has told
    order : seeds, the best known edge first; axes : (k, 3, 3) what axes of circles say, the best known first
    """
    n, found, tried = len(order), 0, 0
    alone = squares_by_themselves(bare)
    told_edges, told_axes = np.zeros(n, np.bool_), np.zeros(len(axes), np.bool_)
    out = Groups(
        np.empty((MOST_GROUPS, 3)),
        np.empty((MOST_GROUPS, 3, 3)),
        np.empty((MOST_GROUPS, n), np.bool_),
        np.empty((MOST_GROUPS, n), np.int64),
        np.empty(MOST_GROUPS),
    )
    for seed in range(len(axes) + n):
        k = seed if seed < len(axes) else order[seed - len(axes)]
        if told_axes[k] if seed < len(axes) else told_edges[k]:
            continue
        if found == MOST_GROUPS or tried == GROUP_SEEDS:
            break
        tried += 1
        d, total, chance, fits, same = grown(rows, bare, axes[k] if seed < len(axes) else alone[k], axes)
        members, clear, mean = fits.sum(), 0, 0.0
        others = members - fits + 2 * same.sum()
        for i in range(n):
            if chance[i] < CLEAR:
                clear += 1
                mean += chance[i]
        # So many edges of any directions would agree with one of all seeds by accident.
        false_alarms = min(GROUP_SEEDS, n) * _poisson_tail(mean, others.max())
        if members > 0 and others.max() >= LEAST_MEMBERS - 1 and false_alarms < FALSE_GROUPS:
            out.direction[found], out.total[found], out.fits[found], out.others[found] = d, total, fits, others
            out.share[found] = members / (GROUP_DOUBT + clear)
            told_edges |= fits
            told_axes |= same
            found += 1
    return Groups(out.direction[:found], out.total[:found], out.fits[:found], out.others[:found], out.share[:found])


@njit
def _run(rows: Rows, i: int, d: FloatArray) -> float:
    """How far the picture of a direction d is from edge i's middle."""
    return float(np.hypot(d[0] - d[2] * rows.middle[i, 0], d[1] - d[2] * rows.middle[i, 1]))


@njit
def _chance(variance: float, scale: float) -> float:
    """Probability that a row of any edge would agree as well, where its products reach this scale."""
    return float(min(2.0 / np.pi * BOUND_SIGMA * np.sqrt(variance) / max(scale, 1e-6), 1.0))


@njit
def told(
    rows: Rows, bare: Rows, total: FloatArray, before: FloatArray, member: BoolArray, others: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """What a group says of each edge: w and lever of its direction (n, 2), variance and chance (n,), and to whom (n,).

    total : (3, 3) of the group; before : (3,), the direction in which its edges were added; member : (n,) bool; others
    : (n,) how many the group has beside each edge. A member is told by the rest, and not by itself.
    """
    n = len(member)
    by, noise, chance, good = np.empty((n, 2)), np.empty(n), np.empty(n), np.empty(n, np.bool_)
    common, common_spread = direction(total)
    for i in range(n):
        d, spread = common, common_spread
        if member[i]:
            own = np.zeros((3, 3))
            _add_squares(bare, i, before, own)
            d, spread = direction(total - own)
        lever = _lever(rows, i, d)
        image = _variances(rows, i, d)[0] + _form(spread, rows.image[i])
        good[i] = _product(rows.image[i], d) ** 2 < BOUND_SIGMA**2 * image
        good[i] &= others[i] >= LEAST_MEMBERS - 1 and abs(lever) > LEAST_LEVER
        chance[i] = _chance(image, _run(rows, i, d))
        by[i, 0], by[i, 1] = d[2], lever if good[i] else 1.0
        noise[i] = _form(spread, rows.depth[i]) / by[i, 1] ** 2 + SLOPE_SIGMA**2
    return by, noise, chance, good
