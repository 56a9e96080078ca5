"""Look-up tables: for every pair of data features, which pairs of model features it may be (thesis 5.7, 5.7.2, 6.6)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from msgs_py import FeatureKind, FeatureSet
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, ByteArray, FloatArray, Int32Array, IntArray

from ..geometry import constraints as c
from ..geometry.constraints import consistent_signs, corner_ranges, entry, pair_ranges
from ..geometry.settings import ROUNDING
from ..model.index import ModelIndex, data_tolerances, feature_rows
from ..params import MatchParams
from .settings import LARGEST_TABLES, RATES


@dataclass(eq=False)
class Tables:
    """The match list of n data features and e model features.

    Attributes
    ----------
    pairs : (P, 2) int32
        Data pairs a < b in the order 0-1, 0-2, ..., 1-2, ...
    code : (P, e, e) uint8
        [p, i, j] holds the sign bits (constraints.py) under which a on i agrees with b on j; 0: they do not. All bits
        are set where a constraint says nothing of signs.
    unary : (n, e) bool
        Which model features a data feature may be on by itself: type and length.
    curves : (n,) bool
        Which data features are curves.
    """

    pairs: Int32Array
    code: ByteArray
    unary: BoolArray
    curves: BoolArray

    @property
    def match(self) -> BoolArray:
        """(P, e, e) bool: the look-up tables of the thesis."""
        match: BoolArray = self.code != 0
        return match

    @cached_property
    def sums(self) -> IntArray:
        """(P,) int64: matches of each data pair, what the orderings sort by."""
        sums: IntArray = np.count_nonzero(self.code, axis=(1, 2))
        return sums

    def number(self, a: int, b: int) -> int:
        """The row of data pair a < b."""
        return int(pair_number(a, b, self.unary.shape[0]))


def pair_number(a: Any, b: Any, n: int) -> Any:
    """Row of data pair a < b among the n (n - 1) / 2, in the order 0-1, 0-2, ..., 1-2, ...; for arrays too.

    Examples
    --------
    >>> [pair_number(a, b, 4) for a, b in ((0, 1), (0, 3), (1, 2), (2, 3))]
    [0, 2, 3, 5]
    """
    return a * n - a * (a + 1) // 2 + b - a - 1


pair_row = njit(pair_number)  # the same, for kernels


def all_pairs(n: int) -> Int32Array:
    """(P, 2) int32: 0-1, 0-2, ..., 1-2, ..."""
    first, second = np.triu_indices(n, 1)
    return np.stack([first, second], axis=1).astype(np.int32)


def model_ranges(index: ModelIndex, corners: bool = False) -> FloatArray:
    """(e, e, 11) float64: the ranges of all ordered pairs of model features.

    Exact (constraints.pair_ranges), or of their end points alone (constraints.corner_ranges).
    """
    ranges: FloatArray = _model_ranges(index.rows, corners)
    return ranges


def position_errors(tolerances: FloatArray) -> FloatArray:
    """(n,) metres: how far an end point may be off, along and across together; of tolerances (n, 3)."""
    errors: FloatArray = np.hypot(tolerances[:, 0], tolerances[:, 1])
    return errors


def ranges_of_rows(rows: FloatArray, tolerances: FloatArray, corners: bool = False) -> FloatArray:
    """(P, 11) float64: the ranges of all pairs of data rows (n, 9), drawn inwards by their tolerances (n, 3).

    corners : of their end points alone, drawn in by the error across (thesis 5.4)
    """
    error = np.ascontiguousarray(tolerances[:, 0]) if corners else position_errors(tolerances)
    cone = np.ascontiguousarray(tolerances[:, 2])
    ranges: FloatArray = _data_ranges(rows, error, cone, all_pairs(len(rows)), corners)
    return ranges


def data_ranges(data: FeatureSet, size: float, params: MatchParams, tolerances: FloatArray | None = None) -> FloatArray:
    """The ranges of all data pairs, drawn inwards by their errors.

    Parameters
    ----------
    data : FeatureSet
        n features, camera frame, metres.
    size : float
        Size of the model, metres.
    params : MatchParams
        Tolerances.
    tolerances : (n, 3) float64, optional
        As model.index.data_tolerances gives them, the default.

    Returns
    -------
    (P, 11) float64
        Distances in metres and angles in radians (geometry.constraints.pair_ranges).
    """
    rows = feature_rows(data)
    tolerances = data_tolerances(data, rows, size, params) if tolerances is None else tolerances
    return ranges_of_rows(rows, tolerances, params.ranges == 'corners')


class PairTests(NamedTuple):
    """What the test of a data pair against a model pair (constraints.entry) needs.

    Attributes
    ----------
    data : (P, 11)
    model : (e, e, 11)
        Their ranges.
    lengths : (e,)
        Metres, of the model features.
    errors : (n,)
        Metres, of the data end points.
    use : (5,) bool
        The constraints that are tested.
    """

    data: FloatArray
    model: FloatArray
    lengths: FloatArray
    errors: FloatArray
    use: BoolArray


def pair_tests(index: ModelIndex, rows: FloatArray, tolerances: FloatArray, params: MatchParams) -> PairTests:
    """The tests of all pairs of data rows (n, 9) with tolerances (n, 3) against all pairs of model features."""
    corners = params.ranges == 'corners'
    return PairTests(
        ranges_of_rows(rows, tolerances, corners),
        model_ranges(index, corners),
        2.0 * index.rows[:, 6],
        position_errors(tolerances),
        constraints_used(params),
    )


def constraints_used(params: MatchParams) -> BoolArray:
    """(5,) bool: which constraints are tested; with a free scale the distance is not (thesis 5.5)."""
    use = np.array([name in params.constraints for name in c.NAMES])
    if params.scale == 'free':
        use[c.DISTANCE] = False
    return use


def unary_table(index: ModelIndex, data: FeatureSet, tolerances: FloatArray, params: MatchParams) -> BoolArray:
    """(n, e) bool: same type, and no longer than the model feature (the length counts with the distance constraint)."""
    possible: BoolArray = data.kind[:, None] == index.kind
    if 'distance' in params.constraints and params.scale == 'known':
        length = np.where(data.kind == FeatureKind.CURVE, 0.0, data.lengths)
        possible &= length[:, None] - 2.0 * tolerances[:, 1:2] <= 2.0 * index.rows[:, 6] + ROUNDING
    return possible


def build_tables(index: ModelIndex, data: FeatureSet, params: MatchParams) -> Tables:
    """All look-up tables of the data and the model.

    Parameters
    ----------
    index : ModelIndex
        The model, e features.
    data : FeatureSet
        n usable features (none without length), camera frame, metres.
    params : MatchParams
        constraints and signs; with scale='free' the distance constraint is left out (thesis 5.5).

    Returns
    -------
    Tables

    Raises
    ------
    ValueError
        When the tables would not fit into memory, or take longer to fill than the time limit.

    References
    ----------
    Thesis 5.7, 5.7.2, 6.6.
    """
    n, e = len(data), len(index)
    count = n * (n - 1) // 2
    if count * e * e > min(LARGEST_TABLES, params.time_limit_s * RATES.entries):
        raise ValueError(
            f'{count} data pairs x {e} x {e} model features are too many for look-up tables within '
            f'{params.time_limit_s:g} s; '
            "use search='hypotheses'"
        )
    pairs = all_pairs(n)
    rows = feature_rows(data)
    tolerances = data_tolerances(data, rows, index.size, params)
    unary = unary_table(index, data, tolerances, params)
    code: ByteArray = _fill(pair_tests(index, rows, tolerances, params), pairs, unary, params.signs)
    return Tables(pairs, code, unary, data.kind == FeatureKind.CURVE)


@njit
def _model_ranges(rows: FloatArray, corners: bool) -> FloatArray:
    """(e, e, 11) ranges of ordered pairs of model rows (e, 9); 0 for a feature with itself."""
    e = rows.shape[0]
    out = np.zeros((e, e, 11))
    for i in range(e):
        for j in range(e):
            if i == j:
                continue
            if corners:
                corner_ranges(rows[i], rows[j], 0.0, 0.0, 0.0, 0.0, out[i, j])
            else:
                pair_ranges(rows[i], rows[j], 0.0, 0.0, 0.0, 0.0, out[i, j])
    return out


@njit
def _data_ranges(rows: FloatArray, error: FloatArray, cone: FloatArray, pairs: Int32Array, corners: bool) -> FloatArray:
    """(P, 11) ranges of pairs (P, 2) of data rows (n, 9), with errors (n,) in metres and cones (n,) in radians."""
    out = np.zeros((pairs.shape[0], 11))
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        if corners:
            corner_ranges(rows[a], rows[b], error[a], error[b], cone[a], cone[b], out[p])
            continue
        pair_ranges(rows[a], rows[b], error[a], error[b], cone[a], cone[b], out[p])
    return out


@njit
def _fill(tests: PairTests, pairs: Int32Array, unary: BoolArray, signs: bool) -> ByteArray:
    """The tables (P, e, e) uint8 of data pairs (P, 2); unary : (n, e) bool; signs : test their consistency."""
    e = unary.shape[1]
    code = np.zeros((pairs.shape[0], e, e), np.uint8)
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        slack = tests.errors[a] + tests.errors[b]
        for i in range(e):
            if not unary[a, i]:
                continue
            for j in range(e):
                if not unary[b, j]:
                    continue
                bits = entry(tests.data[p], tests.model[i, j], i == j, tests.lengths[i], slack, tests.use)
                if bits != 0 and signs and not consistent_signs(bits):
                    bits = 0
                code[p, i, j] = bits
    return code
