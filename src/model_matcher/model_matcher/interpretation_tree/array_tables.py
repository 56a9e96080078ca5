"""The look-up tables on the array machine: a bit-plane a data pair, a pair of model features a PE (thesis 5.7, 5.8).

Everything is made by the machine and charged: the ranges of the model and of the data, the constraints, the counts of
matches. A table is kept in one part, or, for subgraph matching, in quadrants that fit the PEs. The last row and column
stand for the bin (thesis 5.10).

Matrices are laid with the second data feature's model feature along the rows, because ELN counts down the columns and
the native search takes the first feature's model feature as its outer loop.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from dap_emulator import Dap, DapArray
from dap_emulator.machine import intrinsics as f
from dap_emulator.machine.kinds import LOGICAL, integer
from msgs_py import FeatureKind, FeatureSet
from msgs_py.numeric.typed import BoolArray, FloatArray

from ..geometry import constraints as c
from ..model.index import ModelIndex, data_tolerances, feature_rows
from ..params import MatchParams
from .array_ranges import Errors, Ranges, Segments, Word, corner_ranges, data_segments, exact_ranges, model_segments
from .tables import Tables, all_pairs, constraints_used

SIGN_BITS = (c.SAME, c.DIFFERENT, c.A_PLUS, c.A_MINUS, c.B_PLUS, c.B_MINUS)


class Phase(IntEnum):
    """What the machine's cycles are charged to: a line number of no program."""

    SET_UP = 1
    MODEL_RANGES = 2
    DATA_RANGES = 3
    TABLES = 4
    ELIMINATION = 5
    SORT = 6
    TRAVERSAL = 7
    SIGNS = 8
    VALIDATION_SET_UP = 9
    ROTATION = 10
    JACOBI = 11
    TRANSLATION_AND_SCALE = 12
    TEST = 13


class Part(NamedTuple):
    """A quadrant of all tables, or the whole of them.

    Attributes
    ----------
    columns, rows
        First and one past the last model feature of the first and of the second data feature; e is the bin.
    one_edge : (r, c)
        LOGICAL, where both are one model feature. None where the part holds nothing but the bin.
    """

    columns: tuple[int, int]
    rows: tuple[int, int]
    one_edge: DapArray | None


class _Bounds(NamedTuple):
    """The model's ranges of a part, widened by the rounding that a test allows: low, high, angle, lengths, defined."""

    low: dict[int, DapArray]
    high: dict[int, DapArray]
    angle: DapArray
    lengths: DapArray
    defined: DapArray


class ArrayTables:
    """The match list on the machine.

    Parameters
    ----------
    dap : Dap
    index : ModelIndex
        e features.
    data : FeatureSet
        n features.
    params : MatchParams
        constraints, signs, ranges, real_bytes; search='subgraph' keeps quadrants of ``quadrant`` model features.

    Attributes
    ----------
    parts : list of Part
        Of every table.
    match : list of list of DapArray
        [pair][part] LOGICAL (r, c), without the bin; None where a part holds nothing but the bin.
    signs : list of list of tuple of DapArray
        [pair][part]: the planes of SIGN_BITS.
    sums : list of int
        Matches of each pair.
    unary : (n, e) bool
        As Tables.unary.
    """

    def __init__(self, dap: Dap, index: ModelIndex, data: FeatureSet, params: MatchParams) -> None:
        self.dap, self.params, self.word = dap, params, Word.of(params.real_bytes)
        self.n, self.e = len(data), len(index)
        self.pairs = all_pairs(self.n)
        self.use = constraints_used(params).tolist()
        self.curves: BoolArray = data.kind == FeatureKind.CURVE
        rows = feature_rows(data)
        tolerances = data_tolerances(data, rows, index.size, params)
        with dap.at_line(Phase.SET_UP):
            kinds, lengths = dap.vector(index.kind.astype(np.int32)), dap.vector(2.0 * index.rows[:, 6], self.word.kind)
            self.possible = [self._possible(kinds, lengths, data, tolerances, a) for a in range(self.n)]
            self.unary: BoolArray = np.array([possible.values for possible in self.possible]).reshape(self.n, self.e)
            self.parts = self._parts()
        with dap.at_line(Phase.MODEL_RANGES):
            self._bounds = [self._model_bounds(index, part) for part in self.parts]
        with dap.at_line(Phase.DATA_RANGES):
            data_ranges, self._points = self._data_ranges(rows, tolerances)
        self.match: list[list[DapArray | None]] = []
        self.signs: list[list[tuple[DapArray, ...]]] = []
        with dap.at_line(Phase.TABLES):
            for p in range(len(self.pairs)):
                self._make(p, data_ranges)
        with dap.at_line(Phase.SORT):
            self.sums = [sum(int(f.sum_(plane)) for plane in planes if plane is not None) for planes in self.match]
        self._padded: dict[tuple[int, int], DapArray] = {}
        self._labels: dict[int, tuple[DapArray, DapArray]] = {}

    # Set-up.

    def _possible(
        self, kinds: DapArray, lengths: DapArray, data: FeatureSet, tolerances: FloatArray, a: int
    ) -> DapArray:
        """Which model features a data feature may be on by itself: of its type, and no shorter (thesis 5.5, 6.6)."""
        possible = kinds.compare('eq', int(data.kind[a]))
        if self.use[c.DISTANCE]:
            length = 0.0 if self.curves[a] else float(data.lengths[a])
            self.dap.charge_mcu('REAL in the control unit', 2 * self.dap.costs.mcu(real=True))
            possible = possible & (lengths >= length - 2.0 * float(tolerances[a, 1]) - self.word.rounding)
        return possible

    def _parts(self) -> list[Part]:
        e = self.e
        side = self.params.quadrant if self.params.search == 'subgraph' else e + 1
        starts = range(0, e + 1, side)
        parts = []
        for column in starts:
            for row in starts:
                columns, rows = (column, min(column + side, e + 1)), (row, min(row + side, e + 1))
                inner = min(rows[1], e) - row, min(columns[1], e) - column
                one_edge = None
                if min(inner) > 0:
                    same = np.arange(row, row + inner[0])[:, None] == np.arange(column, column + inner[1])
                    one_edge = self.dap.matrix(same)
                    one_edge.charge('pattern', LOGICAL)
                parts.append(Part(columns, rows, one_edge))
        return parts

    def _ranges(self, a: Segments, b: Segments, errors: Errors | None) -> Ranges:
        """The ranges that the parameters ask for."""
        make = corner_ranges if self.params.ranges == 'corners' else exact_ranges
        return make(self.dap, self.word, a, b, errors)

    def _model_bounds(self, index: ModelIndex, part: Part) -> _Bounds | None:
        if part.one_edge is None:
            return None
        first, second = (index.rows[begin : min(end, self.e)] for begin, end in (part.columns, part.rows))
        a, b = model_segments(self.dap, self.word, first, second)
        bounds, defined = self._ranges(a, b, None)
        places = (0, 4, 6, 8)
        return _Bounds(
            {k: bounds[k] - self.word.rounding for k in places},
            {k: bounds[k + 1] + self.word.rounding for k in places},
            bounds[2],
            a.half + a.half,
            defined,
        )

    def _data_ranges(self, rows: FloatArray, tolerances: FloatArray) -> tuple[Ranges | None, DapArray | None]:
        """The data look-up tables, vectors over the pairs, and the errors of the points of each pair."""
        if not len(self.pairs):
            return None, None
        first, second = self.pairs.T
        a, b = data_segments(self.dap, self.word, rows[first], rows[second])
        kind = self.word.kind
        across, along, cone = (
            [self.dap.vector(tolerances[side, k], kind) for side in (first, second)] for k in range(3)
        )
        exact = [f.sqrt(x * x + y * y) for x, y in zip(across, along)]
        points = exact[0] + exact[1]
        if self.params.ranges == 'corners':
            a, b = (side._replace(half=f.maximum(side.half - error, 0.0)) for side, error in zip((a, b), across))
            errors = Errors(across[0] + across[1], cone[0], cone[1])
            return self._ranges(a, b, errors), points
        errors = Errors(points, cone[0], cone[1])
        return self._ranges(a, b, errors), points

    # The constraints.

    def _make(self, p: int, ranges: Ranges | None) -> None:
        """The planes of data pair p: its bounds are fetched once, then compared with the model's in every part."""
        assert ranges is not None and self._points is not None
        a, b = self.pairs[p]
        numbers = [float(bound[p]) for bound in ranges.bounds]
        defined, slack = bool(ranges.defined[p]), float(self._points[p])
        match: list[DapArray | None] = []
        signs: list[tuple[DapArray, ...]] = []
        for part, bounds in zip(self.parts, self._bounds):
            if bounds is None or part.one_edge is None:
                match.append(None)
                signs.append(())
                continue
            plane, six = self._constrain(part.one_edge, bounds, numbers, defined, slack)
            possible = self._between(self.possible[a], part.columns), self._between(self.possible[b], part.rows)
            plane = plane & f.matr(possible[0], plane.shape[0]) & f.matc(possible[1], plane.shape[1])
            match.append(plane)
            signs.append(six)
        self.match.append(match)
        self.signs.append(signs)

    def _between(self, vector: DapArray, places: tuple[int, int]) -> DapArray:
        """The model features of a part, of a vector of all."""
        begin, end = places[0], min(places[1], self.e)
        return vector if (begin, end) == (0, self.e) else self.dap.vector(vector.values[begin:end])

    def _constrain(
        self, one_edge: DapArray, model: _Bounds, data: list[float], defined: bool, slack: float
    ) -> tuple[DapArray, tuple[DapArray, ...]]:
        """The constraints of one data pair on all model pairs: which agree, and the six sign planes."""
        pi, rounding = np.pi, self.word.rounding

        def inside(low: float, high: float, k: int) -> DapArray:
            return (model.low[k] <= low) & (model.high[k] >= high)

        yes = f.filled(self.dap, True, one_edge.shape, LOGICAL)
        match = same = different = yes
        ends = [[yes, yes], [yes, yes]]
        if self.use[c.DISTANCE]:
            match = f.merge(model.lengths + slack >= data[1] - rounding, inside(data[0], data[1], 0), one_edge)
        if self.use[c.ANGLE]:
            same = (model.angle >= data[3] - rounding) & (model.angle <= data[2] + rounding)
            different = (model.angle >= pi - data[2] - rounding) & (model.angle <= pi - data[3] + rounding)
        for k in range(2):
            if not self.use[c.DIRECTION1 + k]:
                continue
            low, high = data[4 + 2 * k], data[5 + 2 * k]
            if data[0] > 2.0 * slack and low < pi and high > 0.0:
                # Two pieces of one edge, clear of each other, would have to lie on one line.
                match = match & ~one_edge
            ends[k] = [inside(low, high, 4 + 2 * k) | one_edge, inside(pi - high, pi - low, 4 + 2 * k) | one_edge]
        if self.use[c.DIRECTION3] and defined:
            same = same & ((inside(data[8], data[9], 8) & model.defined) | one_edge)
            different = different & ((inside(pi - data[9], pi - data[8], 8) & model.defined) | one_edge)
        elif self.use[c.DIRECTION3] and self.params.ranges == 'corners':
            # The thesis lets a pair without a common normal be such a pair only.
            match = match & (~model.defined | one_edge)
        (a_plus, a_minus), (b_plus, b_minus) = ends
        match = match & (same | different) & (a_plus | a_minus) & (b_plus | b_minus)
        if self.params.signs:
            match = match & (
                (same & ((a_plus & b_plus) | (a_minus & b_minus)))
                | (different & ((a_plus & b_minus) | (a_minus & b_plus)))
            )
        return match, (same, different, a_plus, a_minus, b_plus, b_minus)

    # What the searches read.

    def extents(self, part: int, with_bin: bool) -> tuple[int, int]:
        """Rows and columns of a part, with those of the bin or without."""
        last = self.e + (1 if with_bin else 0)
        (first_column, columns), (first_row, rows) = self.parts[part].columns, self.parts[part].rows
        return min(rows, last) - first_row, min(columns, last) - first_column

    def table(self, p: int, part: int, with_bin: bool) -> DapArray | None:
        """A part of a pair's table; with the bin, a row and a column more. None when it is empty.

        While one feature is in the bin, the other may be whatever it may be by itself.
        """
        plane = self.match[p][part]
        if not with_bin:
            return plane
        if (p, part) not in self._padded:
            (column, _), (row, _) = self.parts[part].columns, self.parts[part].rows
            rows, columns = self.extents(part, True)
            a, b = self.pairs[p]
            to_bin = np.append(self.unary[a], True)[column : column + columns]
            from_bin = np.append(self.unary[b], True)[row : row + rows]
            padded = np.zeros((rows, columns), bool)
            if row + rows > self.e:
                padded[-1] = to_bin
            if column + columns > self.e:
                padded[:, -1] = from_bin
            if plane is not None:
                padded[: plane.shape[0], : plane.shape[1]] = plane.values
            self._padded[p, part] = whole = self.dap.matrix(padded)
            whole.charge('copy', LOGICAL)
            whole.charge('pattern', LOGICAL, times=2)
        return self._padded[p, part]

    def labels(self, part: int, with_bin: bool) -> tuple[DapArray, DapArray]:
        """Appendix C's edge1 and edge2: the model features of a part's columns and rows, from 1; e + 1 is the bin."""
        shape = self.extents(part, with_bin)
        if part not in self._labels or self._labels[part][0].shape != shape:
            (columns, _), (rows, _) = self.parts[part].columns, self.parts[part].rows
            first = self.dap.vector(np.arange(columns + 1, columns + 1 + shape[1]), integer())
            second = self.dap.vector(np.arange(rows + 1, rows + 1 + shape[0]), integer())
            self._labels[part] = f.matr(first, shape[0]), f.matc(second, shape[1])
        return self._labels[part]

    def line(self, p: int, feature: int, of_first: bool) -> BoolArray:
        """Which model features of the other data feature agree with one of the first (or second): a column (row)."""
        out = np.zeros(self.e, bool)
        for part, plane in zip(self.parts, self.match[p]):
            if plane is None:
                continue
            here, there = (part.columns, part.rows) if of_first else (part.rows, part.columns)
            if not here[0] <= feature < here[1]:
                continue
            values = plane.values[:, feature - here[0]] if of_first else plane.values[feature - here[0]]
            out[there[0] : there[0] + len(values)] = values
            plane.charge('broadcast', LOGICAL)
        return out

    def on_host(self) -> Tables:
        """The same tables as the native search has them. Charges nothing: no search reads it."""
        code = np.zeros((len(self.pairs), self.e, self.e), np.uint8)
        for p, planes in enumerate(self.match):
            for part, plane, six in zip(self.parts, planes, self.signs[p]):
                if plane is None:
                    continue
                (column, _), (row, _) = part.columns, part.rows
                here = code[p, column : column + plane.shape[1], row : row + plane.shape[0]]
                for sign, bit in zip(six, SIGN_BITS):
                    here |= np.where(sign.values & plane.values, np.uint8(bit), np.uint8(0)).T
        return Tables(self.pairs, code, self.unary, self.curves)
