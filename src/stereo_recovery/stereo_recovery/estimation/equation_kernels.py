"""Compiled: the normal equations that factors make, what the solution makes of each, and which of them hold."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from .settings import LEAST_REST, MOST_REMOVED, ROUNDS
from .sparse_kernels import Pattern, Workspace, solve_sparse, workspace


class System(NamedTuple):
    """n edges and k factors, see :class:`.factors.Factors`.

    Attributes
    ----------
    information, vector : (n, 2, 2), (n, 2)
        Of the edges by themselves.
    place : (n,) int64
        The order in which edges are eliminated.
    slot : (k,) int64
        Where the pattern has the block of a factor's two edges, or -1.
    """

    information: FloatArray
    vector: FloatArray
    place: IntArray
    pattern: Pattern
    slot: IntArray
    edge: IntArray
    other: IntArray
    row: FloatArray
    other_row: FloatArray
    value: FloatArray
    sigma: FloatArray
    prior: FloatArray
    spread: FloatArray
    with_next: BoolArray


class Solution(NamedTuple):
    """Least squares of n edges with k factors, used or not.

    Attributes
    ----------
    x, covariance : (n, 2), (n, 2, 2)
    residual, variance : (k,)
        What each factor's product misses its value by, and the product's variance.
    shared : (k,)
        Covariance of the products of each and the next one, where they hold together.
    """

    x: FloatArray
    covariance: FloatArray
    residual: FloatArray
    variance: FloatArray
    shared: FloatArray


class Parts(NamedTuple):
    """Edges (n,) and factors (k,) in parts that nothing ties to each other, and where the parts begin in either."""

    edges: IntArray
    first_edge: IntArray
    factors: IntArray
    first_factor: IntArray


@njit
def empty_solution(s: System) -> Solution:
    """Room for a solution."""
    n, k = len(s.place), len(s.edge)
    return Solution(np.empty((n, 2)), np.empty((n, 2, 2)), np.empty(k), np.empty(k), np.zeros(k))


@njit
def solve(
    s: System,
    used: BoolArray,
    edges: IntArray,
    factors: IntArray,
    out: Solution,
    blocks: tuple[FloatArray, FloatArray, FloatArray],
    room: Workspace,
) -> None:
    """Least squares of some edges (e,) with those of some factors (f,) that are used; fills their parts of ``out``.

    blocks : room for blocks on the diagonal (n, 2, 2), below it (m, 2, 2), and the right side (n, 2)
    """
    diagonal, below, right = blocks
    columns = np.sort(s.place[edges])
    for e in edges:
        diagonal[s.place[e]], right[s.place[e]] = s.information[e], s.vector[e]
    for j in columns:
        below[s.pattern.begin[j] : s.pattern.begin[j + 1]] = 0.0
    for k in factors:
        if not used[k]:
            continue
        i, q, h, w = s.place[s.edge[k]], s.slot[k], s.row[k], s.sigma[k] ** -2.0
        _add_statement(diagonal[i], right[i], h, w, w * s.value[k])
        if q < 0:
            continue
        j, g = s.place[s.other[k]], s.other_row[k]
        _add_statement(diagonal[j], right[j], g, w, -w * s.value[k])
        # Rows of the block are those of the later edge.
        upper, lower = (g, h) if i > j else (h, g)
        for r in range(2):
            for c in range(2):
                below[q, r, c] -= w * lower[r] * upper[c]
    solve_sparse(s.pattern, columns, diagonal, below, right, room)
    for e in edges:
        out.x[e], out.covariance[e] = right[s.place[e]], diagonal[s.place[e]]
    for k in factors:
        _product(s, k, below, out)


@njit
def _add_statement(block: FloatArray, right: FloatArray, h: FloatArray, weight: float, value: float) -> None:
    """Add what one row h says with a weight, and a weighted value, to an edge's block (2, 2) and right side (2,)."""
    for r in range(2):
        right[r] += value * h[r]
        for c in range(2):
            block[r, c] += weight * h[r] * h[c]


@njit
def _product(s: System, k: int, below: FloatArray, out: Solution) -> None:
    """What the solution makes of a factor; below : (m, 2, 2) of the inverse."""
    e, f, h, g = s.edge[k], s.other[k], s.row[k], s.other_row[k]
    out.residual[k] = s.value[k] - (h[0] * out.x[e, 0] + h[1] * out.x[e, 1])
    if f >= 0:
        out.residual[k] += g[0] * out.x[f, 0] + g[1] * out.x[f, 1]
    out.variance[k] = _covariance(s, k, k, below, out)
    if s.with_next[k]:
        out.shared[k] = _covariance(s, k, k + 1, below, out)


@njit
def _covariance(s: System, k: int, other: int, below: FloatArray, out: Solution) -> float:
    """Of the products of two factors about the same edges."""
    e, f, q, total = s.edge[k], s.other[k], s.slot[k], 0.0
    turned = q >= 0 and s.place[e] < s.place[f]
    for r in range(2):
        for c in range(2):
            total += s.row[k, r] * out.covariance[e, r, c] * s.row[other, c]
            if q >= 0:
                shared = below[q, c, r] if turned else below[q, r, c]
                total += s.other_row[k, r] * out.covariance[f, r, c] * s.other_row[other, c]
                total -= shared * (s.row[k, r] * s.other_row[other, c] + s.row[other, r] * s.other_row[k, c])
    return float(total)


@njit
def probability(s: System, out: Solution, k: int, used: bool) -> float:
    """That a factor holds, by what all but itself say: an accident is even over a range, and what the others leave."""
    # Taking a used factor out of a least squares.
    share = max(1.0 - out.variance[k] / s.sigma[k] ** 2, LEAST_REST) if used else 1.0
    off, variance = out.residual[k] / share, out.variance[k] / share
    total = variance + s.sigma[k] ** 2
    inlier = s.prior[k] * np.exp(-0.5 * off * off / total) / np.sqrt(2.0 * np.pi * total)
    outlier = (1.0 - s.prior[k]) / np.sqrt(s.spread[k] ** 2 + 2.0 * np.pi * variance)
    return float(inlier / (inlier + outlier))


@njit
def probability_of_two(s: System, out: Solution, k: int, used: bool) -> float:
    """The same of factor k and the next one, which hold together."""
    a, b, shared = out.variance[k], out.variance[k + 1], out.shared[k]
    off_a, off_b = out.residual[k], out.residual[k + 1]
    noise_a, noise_b = s.sigma[k] ** 2, s.sigma[k + 1] ** 2
    if used:
        # Both are taken out of the least squares: the inverse of one less variance over noise, from the left.
        rest_a, rest_b = 1.0 - a / noise_a, 1.0 - b / noise_b
        rest = rest_a * rest_b - shared**2 / (noise_a * noise_b)
        if rest < LEAST_REST**2:
            return float(s.prior[k])  # the others say nothing
        off_a, off_b = (
            (rest_b * off_a + shared / noise_b * off_b) / rest,
            (rest_a * off_b + shared / noise_a * off_a) / rest,
        )
        a, b = (rest_b * a + shared**2 / noise_b) / rest, (rest_a * b + shared**2 / noise_a) / rest
        shared /= rest
    total_a, total_b = a + noise_a, b + noise_b
    size = total_a * total_b - shared**2
    square = (total_b * off_a**2 - 2.0 * shared * off_a * off_b + total_a * off_b**2) / size
    inlier = s.prior[k] * np.exp(-0.5 * square) / (2.0 * np.pi * np.sqrt(size))
    outlier = (1.0 - s.prior[k]) / np.sqrt(
        (s.spread[k] ** 2 + 2.0 * np.pi * a) * (s.spread[k + 1] ** 2 + 2.0 * np.pi * b)
    )
    return float(inlier / (inlier + outlier))


@njit
def first_of_edges(edge: IntArray, other: IntArray, chosen: IntArray, value: FloatArray, best: IntArray) -> IntArray:
    """Chosen factors (c,) than which none has a smaller value (k,) at either of their edges, of equals the first.

    One wrong statement makes all those around it look wrong, and several that each fit may not fit together; so the
    clearest goes first. edge, other : (k,) the edges of each, other -1 where it is about one; best : (n,) scratch
    """
    for k in chosen:
        best[edge[k]] = -1
        if other[k] >= 0:
            best[other[k]] = -1
    for k in chosen:
        for e in (edge[k], other[k]):
            if e >= 0 and (best[e] < 0 or value[k] < value[best[e]]):
                best[e] = k
    first = np.empty(len(chosen), np.int64)
    count = 0
    for k in chosen:
        if best[edge[k]] == k and (other[k] < 0 or best[other[k]] == k):
            first[count] = k
            count += 1
    return first[:count]


@njit
def _root(parent: IntArray, e: int) -> int:
    """The first edge of the tree that edge e is in; the way there gets shorter."""
    while parent[e] != e:
        parent[e] = parent[parent[e]]
        e = parent[e]
    return e


@njit
def _by_label(label: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """(k,) things by their labels, of which there are ``count``, and (count + 1,) where each begins."""
    first = np.zeros(count + 1, np.int64)
    for k in label:
        first[k + 1] += 1
    first = np.cumsum(first)
    order, at = np.empty(len(label), np.int64), first.copy()
    for k in range(len(label)):
        order[at[label[k]]] = k
        at[label[k]] += 1
    return order, first


@njit
def _parts(s: System) -> Parts:
    """What no factor ties to each other, even by others."""
    n = len(s.place)
    parent, label, count = np.arange(n), np.empty(n, np.int64), 0
    for k in range(len(s.edge)):
        if s.other[k] >= 0:
            a, b = _root(parent, s.edge[k]), _root(parent, s.other[k])
            parent[max(a, b)] = min(a, b)
    for e in range(n):
        root = _root(parent, e)
        label[e] = count if root == e else label[root]
        count += root == e
    edges, factors = _by_label(label, count), _by_label(label[s.edge], count)
    return Parts(edges[0], edges[1], factors[0], factors[1])


@njit(nogil=True)
def decide(s: System, used: BoolArray) -> tuple[Solution, FloatArray]:
    """Which factors hold: of each part the least likely goes, then the likeliest comes, until none does.

    used : (k,) bool, changed; returns the solution and the probability (k,) of each factor
    """
    out, room, parts = empty_solution(s), workspace(s.pattern), _parts(s)
    n, k = len(s.place), len(s.edge)
    blocks = np.empty((n, 2, 2)), np.empty((len(s.pattern.row), 2, 2)), np.empty((n, 2))
    holds, value, removed, best = np.empty(k), np.empty(k), np.zeros(k, np.int64), np.empty(n, np.int64)
    for part in range(len(parts.first_edge) - 1):
        edges = parts.edges[parts.first_edge[part] : parts.first_edge[part + 1]]
        factors = parts.factors[parts.first_factor[part] : parts.first_factor[part + 1]]
        wrong, fresh = np.empty(len(factors), np.int64), np.empty(len(factors), np.int64)
        for turn in range(ROUNDS + 1):
            solve(s, used, edges, factors, out, blocks, room)
            wrongs = freshes = 0
            for f in factors:
                if f > 0 and s.with_next[f - 1]:
                    holds[f] = holds[f - 1]
                    continue
                two = s.with_next[f]
                holds[f] = probability_of_two(s, out, f, used[f]) if two else probability(s, out, f, used[f])
                value[f] = holds[f] if used[f] else -holds[f]
                if used[f] and holds[f] < 0.5:
                    wrong[wrongs] = f
                    wrongs += 1
                elif not used[f] and holds[f] > 0.5 and removed[f] < MOST_REMOVED:
                    fresh[freshes] = f
                    freshes += 1
            if turn == ROUNDS or wrongs + freshes == 0:
                break
            for f in first_of_edges(s.edge, s.other, wrong[:wrongs] if wrongs else fresh[:freshes], value, best):
                removed[f] += used[f]
                used[f] = not used[f]
                if s.with_next[f]:
                    used[f + 1] = used[f]
    return out, holds
