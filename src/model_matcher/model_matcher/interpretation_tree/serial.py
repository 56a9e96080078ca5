"""The serial search of Grimson and Lozano-Perez, as a baseline (thesis 5.2, 5.11.3.2).

Data features are taken by decreasing length; each is tried on every model feature and tested against all assigned
before it, constraint by constraint, nothing tabulated beforehand but the ranges. The bin is the last branch.
"""

from __future__ import annotations

import numpy as np

from msgs_py import BIN, FeatureKind, FeatureSet
from msgs_py.numeric.compiled import njit

from ..geometry import constraints as c
from ..geometry.constraints import entry
from ..model.index import ModelIndex, data_tolerances, feature_rows
from ..params import MatchParams
from .signs import apply_code, write_signs
from .tables import _data_ranges, all_pairs, model_ranges, unary_table
from .tree import COUNTERS, TreeResult

LARGEST_PAIRS = 2_000_000  # of data features: 11 numbers each
TESTS_PER_SECOND = 10_000_000  # only to turn a time limit into a limit of pair tests


def serial_search(
    index: ModelIndex, data: FeatureSet, params: MatchParams, limit: int = 256, seconds: float | None = None
) -> TreeResult:
    """All feasible interpretations with the fewest features in the bin, at most ``limit``.

    data : usable features (none without length). The statistics count the nodes visited as levels.
    Raises ValueError when there are too many data pairs to keep the ranges of.
    """
    n = len(data)
    if n * (n - 1) // 2 > LARGEST_PAIRS:
        raise ValueError(f"{n * (n - 1) // 2} data pairs are too many for search='serial'; use search='hypotheses'")
    rows = feature_rows(data)
    tolerances = data_tolerances(data, rows, index.size, params)
    unary = unary_table(index, data, tolerances, params)
    error = np.hypot(tolerances[:, 0], tolerances[:, 1])
    use = np.array([name in params.constraints for name in c.NAMES])
    if params.scale == 'free':
        use[c.DISTANCE] = False
    length = np.where(data.kind == FeatureKind.CURVE, 0.0, data.lengths)
    order = np.argsort(-length, kind='stable')
    ranges = _data_ranges(rows[order], error[order], tolerances[order, 2], all_pairs(n))
    counters = np.zeros(len(COUNTERS) + 1, np.int64)  # the last counts the work done
    most = max(n - params.min_matched, 0) if params.max_bin is None else min(params.max_bin, n)
    budget = int((params.time_limit_s if seconds is None else seconds) * TESTS_PER_SECOND)
    impossible = int((~unary.any(axis=1)).sum())
    found = 0
    assignments, signs = np.zeros((0, n), np.int32), np.zeros((0, n), np.int8)
    for in_bin in range(impossible, most + 1):
        found, inner, inner_signs = _descend(
            ranges,
            model_ranges(index),
            2.0 * index.rows[:, 6],
            error[order],
            unary[order],
            use,
            params.signs,
            in_bin,
            limit,
            budget,
            counters,
        )
        if found or counters[4]:
            assignments = np.full((found, n), BIN, np.int32)
            signs = np.zeros((found, n), np.int8)
            assignments[:, order], signs[:, order] = inner[:found], inner_signs[:found]
            break
    stats = dict(zip(COUNTERS, counters.tolist()))
    return TreeResult(assignments, signs, not stats['truncated'], stats)


@njit
def _descend(data, model, lengths, error, unary, use, use_signs, bin_limit, limit, budget, counters):
    n, e = unary.shape
    out = np.full((limit, n), -1, np.int32)
    out_sign = np.zeros((limit, n), np.int8)
    assignment = np.full(n, -1, np.int32)
    cursor = np.zeros(n, np.int64)
    root = np.arange(n).astype(np.int32)
    parity = np.ones(n, np.int8)
    known = np.zeros(n, np.int8)
    saved_root = np.zeros((n, n), np.int32)
    saved_parity = np.zeros((n, n), np.int8)
    saved_known = np.zeros((n, n), np.int8)
    saved_bin = np.zeros(n, np.int64)
    in_bin = 0
    found = 0
    level = 0
    entering = True
    while level >= 0:
        if counters[5] > budget:
            counters[4] = 1
            return found, out, out_sign
        if entering:
            counters[5] += n // 8  # what a level keeps of the signs
            saved_root[level], saved_parity[level], saved_known[level] = root, parity, known
            saved_bin[level] = in_bin
            cursor[level] = 0
        advanced = False
        while cursor[level] <= e:
            j = cursor[level]
            cursor[level] += 1
            root[:], parity[:], known[:] = saved_root[level], saved_parity[level], saved_known[level]
            in_bin = saved_bin[level]
            if j == e:
                if in_bin >= bin_limit:
                    continue
                in_bin += 1
                assignment[level] = -1
                advanced = True
                break
            if not unary[level, j]:
                continue
            counters[0] += 1
            counters[5] += 1 + n // 8
            good = True
            for a in range(level):
                i = assignment[a]
                if i < 0:
                    continue
                counters[5] += 1
                row = a * n - a * (a + 1) // 2 + level - a - 1
                bits = entry(data[row], model[i, j], i == j, lengths[i], error[a] + error[level], use)
                if bits == 0:
                    good = False
                    break
                if use_signs and not apply_code(bits, a, level, root, parity, known):
                    counters[2] += 1
                    good = False
                    break
            if good:
                assignment[level] = j
                advanced = True
                break
        if not advanced:
            counters[1] += 1
            level -= 1
            entering = False
            continue
        if level + 1 < n:
            level += 1
            entering = True
            continue
        if in_bin == bin_limit:
            out[found] = assignment
            write_signs(root, parity, known, out_sign[found])
            for k in range(n):
                if assignment[k] < 0:
                    out_sign[found, k] = 0
            found += 1
            if found == limit:
                return found, out, out_sign
        entering = False
    return found, out, out_sign
