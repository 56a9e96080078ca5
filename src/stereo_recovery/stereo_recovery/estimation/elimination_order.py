"""Compiled order of elimination in which the factor of a sparse symmetric matrix stays sparse: least degree first.

What a node that is eliminated ties together is kept as one element, the list of its neighbours, instead of all their
pairs; an element whose pivot is among the neighbours of another one is part of that one. So all fits where the graph
was. scipy.sparse's orders are as good; its import would be a tenth of a node's start.

References
----------
P. Amestoy, T. Davis and I. Duff, "An approximate minimum degree ordering algorithm", SIAM J. Matrix Anal. 17(4), 1996.
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import IntArray


@njit
def least_degree(count: int, e: IntArray, f: IntArray) -> IntArray:
    """Place of each node in an order of least degree.

    Parameters
    ----------
    count : int
        Nodes.
    e, f : (k,) int64
        The links between them; some may be there more than once.

    Returns
    -------
    (count,) int64
    """
    begin, beside = _adjacency(count, e, f)
    size = begin[1:] - begin[:-1]
    # Neighbours that are eliminated stand for their elements, until another one takes them in.
    element = np.zeros((count, 2), np.int64)
    members, end = np.empty(2 * len(e) + 16, np.int64), 0
    mark, degree, place = np.full(count, -1, np.int64), size.copy(), np.full(count, -1, np.int64)
    apart, noted = np.zeros(count, np.int64), np.full(count, -1, np.int64)
    queue = [(degree[i], i) for i in range(count)]
    heapify(queue)
    done = 0
    while done < count:
        least, p = heappop(queue)
        if place[p] >= 0 or least != degree[p]:
            continue
        place[p] = done
        done += 1
        while end + count > len(members):
            members = np.concatenate((members, np.empty_like(members)))
        first = end
        mark[p] = p
        for k in range(begin[p], begin[p] + size[p]):
            end = _take_in(beside[k], p, place, mark, element, members, end)
        element[p] = first, end
        # How many members other elements have that p's has not; one that has none is part of it.
        apart[p] = 0
        for i in members[first:end]:
            for j in beside[begin[i] : begin[i] + size[i]]:
                if place[j] >= 0 and j != p:
                    if noted[j] != p:
                        noted[j], apart[j] = p, element[j, 1] - element[j, 0]
                    apart[j] -= 1
        for i in members[first:end]:
            left, others = begin[i], end - first - 1
            for j in beside[begin[i] : begin[i] + size[i]]:
                if (apart[j] > 0) if place[j] >= 0 else (mark[j] != p):
                    beside[left] = j
                    left += 1
                    others += apart[j] if place[j] >= 0 else 1
            beside[left] = p
            size[i], degree[i] = left + 1 - begin[i], others
            heappush(queue, (others, i))
    return place


@njit
def _adjacency(count: int, e: IntArray, f: IntArray) -> tuple[IntArray, IntArray]:
    """Begin (count + 1,) of each node's neighbours in (m,), none twice."""
    begin = np.zeros(count + 1, np.int64)
    for k in range(len(e)):
        begin[e[k] + 1] += 1
        begin[f[k] + 1] += 1
    begin = np.cumsum(begin)
    at, every = begin.copy(), np.empty(2 * len(e), np.int64)
    for k in range(len(e)):
        for i, j in ((e[k], f[k]), (f[k], e[k])):
            every[at[i]] = j
            at[i] += 1
    once, mark, end = np.zeros(count + 1, np.int64), np.full(count, -1, np.int64), 0
    for i in range(count):
        mark[i] = i
        for k in range(begin[i], begin[i + 1]):
            if mark[every[k]] != i:
                mark[every[k]] = i
                every[end] = every[k]
                end += 1
        once[i + 1] = end
    return once, every[:end].copy()


@njit
def _take_in(j: int, p: int, place: IntArray, mark: IntArray, element: IntArray, members: IntArray, end: int) -> int:
    """Append the neighbour j of p, or the members of the element that it stands for, to p's; where they end then."""
    if place[j] < 0:
        if mark[j] != p:
            mark[j] = p
            members[end] = j
            end += 1
        return end
    for k in range(element[j, 0], element[j, 1]):
        i = members[k]
        if place[i] < 0 and mark[i] != p:
            mark[i] = p
            members[end] = i
            end += 1
    # Now p's.
    element[j, 1] = element[j, 0]
    return end
