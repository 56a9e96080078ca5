"""The ranges of all pairs of features at once, one pair a PE (thesis 5.5): array programs for geometry.constraints.

Both the exact ranges and those of the end points alone, for a model (a matrix of all pairs) and for data (a vector of
pairs, the data look-up tables of thesis 5.7). The numbers are those of ``constraints.pair_ranges`` and
``constraints.corner_ranges``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dap_emulator import Dap, DapArray
from dap_emulator.machine import intrinsics as f
from dap_emulator.machine.kinds import Kind, real
from msgs_py.numeric.typed import FloatArray

from ..geometry.settings import NO_NORMAL_SINE, NOT_ZERO, ROUNDING, SMALLEST_LENGTH
from .settings import SHORT_WORD_LENGTH, SHORT_WORD_ROUNDING

Components = Sequence[DapArray]


@dataclass(frozen=True)
class Word:
    """The REAL of the machine, and what its rounding may do.

    Attributes
    ----------
    kind
    rounding
        Radians or metres, by which bounds are widened.
    length
        Metres: points nearer than this are one.
    sine
        Of the angle below which two lines are parallel.
    """

    kind: Kind
    rounding: float
    length: float
    sine: float

    @classmethod
    def of(cls, real_bytes: int) -> Word:
        """The word of so many bytes."""
        if real_bytes < 8:
            return cls(real(real_bytes), SHORT_WORD_ROUNDING, SHORT_WORD_LENGTH, SHORT_WORD_ROUNDING)
        return cls(real(real_bytes), ROUNDING, SMALLEST_LENGTH, NO_NORMAL_SINE)

    @property
    def epsilon(self) -> float:
        """Relative rounding."""
        return float(2.0**-self.kind.mantissa)


class Segments(NamedTuple):
    """The first or the second features of pairs: mid point (3), unit direction (3), half length, of one shape."""

    middle: Components
    direction: Components
    half: DapArray


class Errors(NamedTuple):
    """Of data pairs: the errors of both features' points together (metres) and the cones of both (radians)."""

    points: DapArray
    cone_a: DapArray
    cone_b: DapArray


class Ranges(NamedTuple):
    """Low and high of the distance, the angle and the three directions, and where direction3 is defined."""

    bounds: list[DapArray]
    defined: DapArray


def model_segments(dap: Dap, word: Word, first: FloatArray, second: FloatArray) -> tuple[Segments, Segments]:
    """All pairs of model rows (c, 9) and (r, 9): matrices (r, c), the second feature's number along the rows."""
    columns, rows = len(first), len(second)
    one = [f.matr(dap.vector(first[:, k], word.kind), rows) for k in range(7)]
    other = [f.matc(dap.vector(second[:, k], word.kind), columns) for k in range(7)]
    return Segments(one[:3], one[3:6], one[6]), Segments(other[:3], other[3:6], other[6])


def data_segments(dap: Dap, word: Word, first: FloatArray, second: FloatArray) -> tuple[Segments, Segments]:
    """Pairs of data rows (P, 9), one after the other: vectors (P,)."""
    one, other = ([dap.vector(rows[:, k], word.kind) for k in range(7)] for rows in (first, second))
    return Segments(one[:3], one[3:6], one[6]), Segments(other[:3], other[3:6], other[6])


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """The scalar product of vectors of arrays or numbers."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Components, b: Components) -> list[DapArray]:
    """The vector product."""
    return [a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3] for k in range(3)]


class _Pairs:
    """What all ranges of some pairs need, computed once."""

    def __init__(self, dap: Dap, word: Word, a: Segments, b: Segments, errors: Errors | None) -> None:
        self.dap, self.word, self.a, self.b, self.errors = dap, word, a, b, errors
        self.shape = a.half.shape
        self.apart = [q - p for p, q in zip(a.middle, b.middle)]
        self.cosine = dot(a.direction, b.direction)
        self.normal = cross(a.direction, b.direction)
        self.sine = f.sqrt(dot(self.normal, self.normal))
        self.skew = self.sine > word.sine
        self._scale_normal(self.skew)
        self.angle = f.atan2(self.sine, self.cosine)

    def _scale_normal(self, skew: DapArray) -> None:
        """The common normal: a unit vector where the lines are skew, zero elsewhere."""
        scale = f.merge(1.0 / f.maximum(self.sine, self.word.sine), 0.0, skew)
        self.normal = [component * scale for component in self.normal]

    def without_uncertain_normals(self, cone: DapArray) -> None:
        """Lines that may be parallel within their cones (radians, together) have no normal."""
        self.skew = self.skew & (self.sine > f.sin(f.minimum(cone, 0.5 * np.pi)))
        self.normal = [f.merge(n, 0.0, self.skew) for n in self.normal]

    def filled(self, value: float) -> DapArray:
        return f.filled(self.dap, value, self.shape, self.word.kind)

    def between(self, s: DapArray, t: DapArray) -> list[DapArray]:
        """From the point at s on the first feature to the point at t on the second."""
        return [w + t * v - s * u for w, u, v in zip(self.apart, self.a.direction, self.b.direction)]

    def corners(self, ends: Segments, others: Segments) -> list[tuple[DapArray, DapArray]]:
        """The four pairs of end points, as abscissas."""
        return [(x, y) for x in (ends.half, -ends.half) for y in (others.half, -others.half)]


def corner_ranges(dap: Dap, word: Word, a: Segments, b: Segments, errors: Errors | None = None) -> Ranges:
    """The thesis' ranges, from the four vectors between end points (constraints.corner_ranges).

    Parameters
    ----------
    dap : Dap
    word : Word
    a, b : Segments
        First and second features of the pairs; data already drawn in by its errors.
    errors : Errors, optional
        Of data pairs; None for a model.

    Returns
    -------
    Ranges

    References
    ----------
    Thesis 5.4, 5.5.
    """
    pairs = _Pairs(dap, word, a, b, errors)
    if errors is not None:
        pairs.without_uncertain_normals(errors.cone_a + errors.cone_b)
    lows: list[DapArray] = [pairs.filled(np.inf) for _ in range(4)]
    highs: list[DapArray] = [pairs.filled(-np.inf) for _ in range(4)]
    for s, t in pairs.corners(a, b):
        vector = pairs.between(s, t)
        far = f.sqrt(dot(vector, vector))
        apart = far > word.length
        over = f.merge(1.0 / f.maximum(far, word.length), 0.0, apart)
        values = [far]
        for axis in (a.direction, b.direction, pairs.normal):
            values.append(f.acos(f.minimum(f.maximum(over * dot(vector, axis), -1.0), 1.0)))
        for k, value in enumerate(values):
            lows[k], highs[k] = f.minimum(lows[k], value), f.maximum(highs[k], value)
    angle = [pairs.angle, pairs.angle]
    if errors is not None:
        both = errors.cone_a + errors.cone_b
        angle = [pairs.angle + both, pairs.angle - both]
        lows[0], highs[0] = lows[0] + errors.points, highs[0] - errors.points
        for k, cone in ((1, errors.cone_a), (2, errors.cone_b), (3, both)):
            lows[k], highs[k] = lows[k] + cone, highs[k] - cone
    bounds = [lows[0], highs[0], *angle]
    for k in (1, 2, 3):
        bounds += [lows[k], highs[k]]
    return Ranges(bounds, pairs.skew)


def exact_ranges(dap: Dap, word: Word, a: Segments, b: Segments, errors: Errors | None = None) -> Ranges:
    """Exact ranges of model pairs; of data pairs those drawn inwards by their errors (constraints.pair_ranges).

    Parameters are those of :func:`corner_ranges`; data is not drawn in.
    """
    pairs = _Pairs(dap, word, a, b, errors)
    s, t, nearest = _closest(pairs)
    far_s, far_t, farthest = _farthest(pairs)
    touching = nearest < word.length
    inner = touching & (abs(s) < a.half - word.length) & (abs(t) < b.half - word.length)
    first = _direction_range(pairs, inner)
    turned = _Pairs(dap, word, b, a, None if errors is None else Errors(errors.points, errors.cone_b, errors.cone_a))
    second = _direction_range(turned, inner)
    third, defined = _direction3(pairs, (s, t, nearest), (far_s, far_t, farthest))
    distance, angle = [nearest, farthest], [pairs.angle, pairs.angle]
    if errors is not None:
        both = errors.cone_a + errors.cone_b
        distance = [nearest + errors.points, farthest - errors.points]
        angle = [pairs.angle + both, pairs.angle - both]
    low, high = second
    return Ranges([*distance, *angle, *first, np.pi - high, np.pi - low, *third], defined)


def _length(vector: Components) -> DapArray:
    length: DapArray = f.sqrt(dot(vector, vector))
    return length


def _closest(pairs: _Pairs) -> tuple[DapArray, DapArray, DapArray]:
    """Where the segments come closest, and how close: inside both, or at an end of one."""
    a, b, c = pairs.a, pairs.b, pairs.cosine
    along_a, along_b = dot(pairs.apart, a.direction), dot(pairs.apart, b.direction)
    square = 1.0 - c * c
    turned = square > max(NOT_ZERO, 8.0 * pairs.word.epsilon)
    over = 1.0 / f.merge(square, 1.0, turned)
    s, t = (along_a - c * along_b) * over, (c * along_a - along_b) * over
    inside = turned & (abs(s) <= a.half) & (abs(t) <= b.half)
    places = [(s, t, inside)]
    for end in (a.half, -a.half):
        places.append((end, f.minimum(f.maximum(c * end - along_b, -b.half), b.half), None))
    for end in (b.half, -b.half):
        places.append((f.minimum(f.maximum(along_a + c * end, -a.half), a.half), end, None))
    best: tuple[DapArray, DapArray, DapArray] | None = None
    for at_s, at_t, usable in places:
        far = _length(pairs.between(at_s, at_t))
        if best is None:
            assert usable is not None
            best = at_s, at_t, f.merge(far, np.inf, usable)
            continue
        nearer = far < best[2]
        best = (f.merge(at_s, best[0], nearer), f.merge(at_t, best[1], nearer), f.merge(far, best[2], nearer))
    assert best is not None
    return best


def _farthest(pairs: _Pairs) -> tuple[DapArray, DapArray, DapArray]:
    """The end points that are farthest from each other."""
    best: tuple[DapArray, DapArray, DapArray] | None = None
    for s, t in pairs.corners(pairs.a, pairs.b):
        far = _length(pairs.between(s, t))
        if best is None:
            best = s, t, far
            continue
        farther = far > best[2]
        best = f.merge(s, best[0], farther), f.merge(t, best[1], farther), f.merge(far, best[2], farther)
    assert best is not None
    return best


def _stationary(pairs: _Pairs, s: DapArray) -> tuple[DapArray, DapArray]:
    """Where on the second feature the angle with the first is stationary (constraints.stationary), and if it is."""
    w, c = pairs.apart, pairs.cosine
    along_a = dot(w, pairs.a.direction)
    big_a = along_a - s
    big_c = dot(w, w) - along_a * along_a
    big_d = dot(w, pairs.b.direction) - c * along_a
    below = c * big_d - big_a * (1.0 - c * c)
    there = abs(below) >= 1e-15
    t = (big_a * big_d - c * big_c) / f.merge(below, 1.0, there)
    return t, there & (abs(t) <= pairs.b.half)


def _direction_range(pairs: _Pairs, inner: DapArray) -> tuple[DapArray, DapArray]:
    """Range of the angle with the first feature's direction; inner : where the segments cross each other."""
    low, high = pairs.filled(np.inf), pairs.filled(-np.inf)
    u, half, errors = pairs.a.direction, pairs.b.half, pairs.errors
    for s in (pairs.a.half, -pairs.a.half):
        between, exists = _stationary(pairs, s)
        for t, usable in ((half, None), (-half, None), (between, exists)):
            vector = pairs.between(s, t)
            angle = f.atan2(_length(cross(vector, u)), dot(vector, u))
            far = _length(vector)
            apart = far >= pairs.word.length if errors is None else far > errors.points
            usable = apart if usable is None else usable & apart
            one, other = angle, angle
            if errors is not None:
                slack = f.asin(f.merge(errors.points, 0.0, apart) / f.merge(far, 1.0, apart)) + errors.cone_a
                one, other = angle + slack, angle - slack
            low, high = f.merge(f.minimum(low, one), low, usable), f.merge(f.maximum(high, other), high, usable)
    if errors is None:
        any_direction = inner | (high < low)
        low, high = f.merge(0.0, low, any_direction), f.merge(np.pi, high, any_direction)
    return low, high


def _direction3(
    pairs: _Pairs, near: tuple[DapArray, DapArray, DapArray], far: tuple[DapArray, DapArray, DapArray]
) -> tuple[list[DapArray], DapArray]:
    """Range of the angle with the common normal, from the nearest and the farthest points; and where it is defined."""
    n, errors, word = pairs.normal, pairs.errors, pairs.word
    angles = []
    for s, t, _ in (near, far):
        vector = pairs.between(s, t)
        angles.append(f.atan2(_length(cross(vector, n)), dot(vector, n)))
    if errors is None:
        touching = near[2] < word.length
        low, high = f.minimum(*angles), f.maximum(*angles)
        return [f.merge(0.5 * np.pi, bound, touching) for bound in (low, high)], pairs.skew
    tilt = (2.0 * (f.sin(0.5 * errors.cone_a) + f.sin(0.5 * errors.cone_b))) / f.maximum(pairs.sine, NOT_ZERO)
    defined = tilt < 1.0
    turn = f.asin(f.merge(tilt, 0.0, defined))
    low, high = pairs.filled(np.inf), pairs.filled(-np.inf)
    for angle, (_, _, distance) in zip(angles, (near, far)):
        apart = distance > errors.points
        slack = f.asin(f.merge(errors.points, 0.0, apart) / f.merge(distance, 1.0, apart)) + turn
        low = f.merge(f.minimum(low, angle + slack), low, apart)
        high = f.merge(f.maximum(high, angle - slack), high, apart)
    return [low, high], defined
