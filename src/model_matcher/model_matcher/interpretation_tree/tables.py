"""Look-up tables: for every pair of data features, which pairs of model features it may be (thesis 5.7, 5.7.2, 6.6)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from msgs_py import FeatureKind, FeatureSet
from msgs_py.numeric.compiled import njit

from ..geometry import constraints as c
from ..geometry.constraints import consistent_signs, entry, pair_ranges
from ..model.index import ModelIndex, data_tolerances, feature_rows
from ..params import MatchParams

# A table set larger than this is refused with a reason; the hypothesis search needs no tables.
LARGEST_TABLES = 400_000_000
ENTRIES_PER_SECOND = 20_000_000  # only to turn a time limit into a limit of entries


@dataclass(eq=False)
class Tables:
    """The match list of n data features and e model features.

    pairs : (P, 2) int32, data pairs a < b in the order 0-1, 0-2, ..., 1-2, ...
    code : (P, e, e) uint8, [p, i, j] the sign bits (constraints.py) under which a on i agrees with b on j; 0: they
        do not. All bits are set where a constraint says nothing of signs
    unary : (n, e) bool, which model features a data feature may be on its own: type and length
    """

    pairs: np.ndarray
    code: np.ndarray
    unary: np.ndarray

    @property
    def match(self) -> np.ndarray:
        """(P, e, e) bool: the look-up tables of the thesis."""
        return self.code != 0

    @cached_property
    def sums(self) -> np.ndarray:
        """(P,) int64: matches of each data pair, what the orderings sort by."""
        return np.count_nonzero(self.code, axis=(1, 2))

    def number(self, a: int, b: int) -> int:
        """The row of data pair a < b."""
        return pair_number(a, b, self.unary.shape[0])


def pair_number(a: int, b: int, n: int) -> int:
    """Row of data pair a < b among the n (n - 1) / 2."""
    return a * n - a * (a + 1) // 2 + b - a - 1


def all_pairs(n: int) -> np.ndarray:
    """(P, 2) int32: 0-1, 0-2, ..., 1-2, ..."""
    first, second = np.triu_indices(n, 1)
    return np.stack([first, second], axis=1).astype(np.int32)


def model_ranges(index: ModelIndex) -> np.ndarray:
    """(e, e, 11) float64: the exact ranges of all ordered pairs of model features (constraints.pair_ranges)."""
    return _model_ranges(index.rows)


def data_ranges(data: FeatureSet, size: float, params: MatchParams, tolerances: np.ndarray | None = None) -> np.ndarray:
    """(P, 11) float64: the ranges of all data pairs, drawn inwards by their errors.

    size : metres, the model's; tolerances : (n, 3) as model_index.data_tolerances gives them (the default)
    """
    rows = feature_rows(data)
    if tolerances is None:
        tolerances = data_tolerances(data, rows, size, params)
    error = np.hypot(tolerances[:, 0], tolerances[:, 1])
    return _data_ranges(rows, error, tolerances[:, 2], all_pairs(len(data)))


def unary_table(index: ModelIndex, data: FeatureSet, tolerances: np.ndarray, params: MatchParams) -> np.ndarray:
    """(n, e) bool: same type, and no longer than the model feature (the length counts with the distance constraint)."""
    possible = data.kind[:, None] == index.kind
    if 'distance' in params.constraints and params.scale == 'known':
        length = np.where(data.kind == FeatureKind.CURVE, 0.0, data.lengths)
        possible &= length[:, None] - 2.0 * tolerances[:, 1:2] <= 2.0 * index.rows[:, 6] + c.ROUNDING
    return possible


def build_tables(index: ModelIndex, data: FeatureSet, params: MatchParams) -> Tables:
    """All look-up tables of usable data (no feature without length).

    The constraints are those of params; with scale 'free' the distance constraint is left out (thesis 5.5).
    Raises ValueError when the tables would not fit into memory.
    """
    n, e = len(data), len(index)
    count = n * (n - 1) // 2
    if count * e * e > min(LARGEST_TABLES, params.time_limit_s * ENTRIES_PER_SECOND):
        raise ValueError(
            f'{count} data pairs x {e} x {e} model features are too many for look-up tables within '
            f'{params.time_limit_s:g} s; '
            "use search='hypotheses'"
        )
    pairs = all_pairs(n)
    rows = feature_rows(data)
    tolerances = data_tolerances(data, rows, index.size, params)
    unary = unary_table(index, data, tolerances, params)
    use = np.array([name in params.constraints for name in c.NAMES])
    if params.scale == 'free':
        use[c.DISTANCE] = False
    error = np.hypot(tolerances[:, 0], tolerances[:, 1])
    ranges = _data_ranges(rows, error, tolerances[:, 2], pairs)
    code = _fill(ranges, _model_ranges(index.rows), pairs, unary, 2.0 * index.rows[:, 6], error, use, params.signs)
    return Tables(pairs, code, unary)


@njit
def _model_ranges(rows):
    e = rows.shape[0]
    out = np.zeros((e, e, 11))
    for i in range(e):
        for j in range(e):
            if i != j:
                pair_ranges(rows[i], rows[j], 0.0, 0.0, 0.0, 0.0, out[i, j])
    return out


@njit
def _data_ranges(rows, error, cone, pairs):
    out = np.zeros((pairs.shape[0], 11))
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        pair_ranges(rows[a], rows[b], error[a], error[b], cone[a], cone[b], out[p])
    return out


@njit
def _fill(data, model, pairs, unary, lengths, error, use, signs):
    e = unary.shape[1]
    code = np.zeros((pairs.shape[0], e, e), np.uint8)
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        slack = error[a] + error[b]
        for i in range(e):
            if not unary[a, i]:
                continue
            for j in range(e):
                if not unary[b, j]:
                    continue
                bits = entry(data[p], model[i, j], i == j, lengths[i], slack, use)
                if bits != 0 and signs and not consistent_signs(bits):
                    bits = 0
                code[p, i, j] = bits
    return code
