"""Certificate that no larger interpretation exists: pruning by cores, then a tree with a bound by domains.

Larger means: more data features matched, every two of them consistent under the pairwise constraints of the look-up
tables (direction signs left out, which only makes the claim stronger). What cannot be among K + 1 mutually supporting
data features is taken away first (thesis 7.4). In the tree that is left, a node is worth no more than its matched data
plus the unassigned data that still have a candidate: counting those instead of features in the bin ends the growth of
the tree with the number of spurious features.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from msgs_py import BIN, FeatureSet

from .model_index import ModelIndex
from .params import MatchParams, MatchResult
from .tables import Tables, build_tables
from .tree import core_numbers, largest_core

MOST_NODES = 200_000


@dataclass(frozen=True)
class Proof:
    """What an exhaustive search says.

    proven : no pairwise-consistent interpretation matches more data than was asked about
    assignment : (n,) int32, a larger one, or None; nodes : of the tree, 0 when pruning was enough
    reason : None when proven, otherwise why not
    seconds : tables, pruning and tree
    """

    proven: bool
    assignment: np.ndarray | None
    nodes: int
    reason: str | None
    seconds: float = 0.0


def prove(index: ModelIndex, data: FeatureSet, matched: int, params: MatchParams) -> Proof:
    """Whether no interpretation of usable data (no feature without length) matches more than ``matched`` features.

    With tables that do not fit into memory, or a tree that is too large, the answer is not proven, with the reason.
    """
    started = time.perf_counter()
    try:
        tables = build_tables(index, data, params)
    except ValueError as error:
        return Proof(False, None, 0, str(error))
    found = prove_tables(tables, matched)
    return Proof(found.proven, found.assignment, found.nodes, found.reason, time.perf_counter() - started)


def certify(index: ModelIndex, data: FeatureSet, result: MatchResult, params: MatchParams,
            started: float) -> MatchResult:
    """The result with its best interpretation marked as proven when it is; stats tell why it is not.

    data : the usable features that were searched; started : perf_counter() at the start of the match, which has
    params.time_limit_s altogether
    """
    best = result.best
    if best is None:
        return result
    if time.perf_counter() - started > params.time_limit_s:
        result.stats['unproven'] = 'time limit'
        return result
    proof = prove(index, data, best.matched, params)
    result.stats['proof_nodes'] = proof.nodes
    if not proof.proven:
        result.stats['unproven'] = proof.reason
        return result
    return replace(result, interpretations=(replace(best, proven=True), *result.interpretations[1:]))


def prove_tables(tables: Tables, matched: int, most_nodes: int = MOST_NODES) -> Proof:
    """As :func:`prove`, for tables that are there already."""
    n = tables.unary.shape[0]
    if matched >= n:
        return Proof(True, None, 0, None)
    core = core_numbers(tables)
    if largest_core(core) <= matched:
        return Proof(True, None, 0, None)
    alive = core > matched
    left = np.flatnonzero(alive.any(axis=1))
    assignment = np.full(n, BIN, np.int32)
    inner, nodes, outcome = _search(tables.code, alive[left], left, n, matched, most_nodes)
    if outcome == 0:
        return Proof(True, None, int(nodes), None)
    if outcome == 2:
        return Proof(False, None, int(nodes), f'the tree has more than {most_nodes} nodes')
    assignment[left] = inner
    size = int((assignment != BIN).sum())
    return Proof(False, assignment, int(nodes), f'{size} data features are pairwise consistent, {matched} are matched')


@njit(cache=True)
def _search(code, alive, left, n, matched, most_nodes):
    """Depth first for an assignment of more than ``matched`` of the m data features ``left``, smallest domain first.

    alive : (m, e) bool. Returns the assignment (m,), -1 for the bin; nodes; and 0: there is none, 1: found, 2: too many
    nodes.
    """
    m, e = alive.shape
    open_to = np.zeros((m + 1, m, e), np.bool_)
    open_to[0] = alive
    done = np.zeros((m + 1, m), np.bool_)
    chosen = np.zeros(m + 1, np.int64)
    candidate = np.zeros(m + 1, np.int64)
    counts = np.zeros(m + 1, np.int64)  # matched when a level is entered
    assignment = np.full(m, -1, np.int32)
    nodes = 0
    level = 0
    entering = True
    while level >= 0:
        if entering:
            nodes += 1
            if nodes > most_nodes:
                return assignment, nodes, 2
            smallest, which, hopeful = e + 1, -1, 0
            for k in range(m):
                if done[level, k]:
                    continue
                size = 0
                for j in range(e):
                    if open_to[level, k, j]:
                        size += 1
                if size > 0:
                    hopeful += 1
                    if size < smallest:
                        smallest, which = size, k
            if counts[level] > matched:
                return assignment, nodes, 1
            if counts[level] + hopeful <= matched:
                level -= 1
                entering = False
                continue
            chosen[level] = which
            candidate[level] = 0
        which = chosen[level]
        assignment[which] = -1
        j = candidate[level]
        while j < e and not open_to[level, which, j]:
            j += 1
        if j > e:
            level -= 1
            entering = False
            continue
        candidate[level] = j + 1
        done[level + 1] = done[level]
        done[level + 1, which] = True
        open_to[level + 1] = open_to[level]
        counts[level + 1] = counts[level]
        if j < e:
            assignment[which] = j
            counts[level + 1] += 1
            a = left[which]
            for k in range(m):
                if done[level + 1, k]:
                    continue
                b = left[k]
                lo, hi = min(a, b), max(a, b)
                table = code[lo * n - lo * (lo + 1) // 2 + hi - lo - 1]
                for i in range(e):
                    if open_to[level + 1, k, i] and not (table[j, i] if a < b else table[i, j]):
                        open_to[level + 1, k, i] = False
        level += 1
        entering = True
    return assignment, nodes, 0
