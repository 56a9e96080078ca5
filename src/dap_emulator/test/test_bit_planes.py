"""Microprograms on bit-planes: integers against Python's, REALs against exact rational arithmetic, rounded once."""

import math
import operator
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dap_emulator.bit_planes import functions, integers, reals, tables
from dap_emulator.bit_planes.processors import Processors
from dap_emulator.machine.fields import from_field, real_cells, real_values, to_field
from dap_emulator.machine.kinds import bits, real

SOME = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def field(words, planes):
    """Planes of words, the least significant first."""
    return [sum((word >> bit & 1) << place for place, word in enumerate(words)) for bit in range(planes)]


def words(planes, count):
    return [sum((plane >> place & 1) << bit for bit, plane in enumerate(planes)) for place in range(count)]


# Whole numbers.


@st.composite
def whole_numbers(draw):
    planes = draw(st.integers(1, 64))
    pairs = draw(st.lists(st.tuples(*[st.integers(0, (1 << planes) - 1)] * 2), min_size=1, max_size=20))
    return planes, [a for a, _ in pairs], [b for _, b in pairs]


def signed_value(word, planes, signed):
    return word - (1 << planes) if signed and word >> (planes - 1) else word


def quotient(a, b):
    return 0 if b == 0 else abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)


@given(whole_numbers(), st.booleans())
@SOME
def test_whole_numbers_of_any_length_compute_modulo_the_word(given_numbers, signed):
    planes, a, b = given_numbers
    count, modulus = len(a), 1 << planes
    x, y = field(a, planes), field(b, planes)
    pe = Processors(count)
    pairs = [(signed_value(p, planes, signed), signed_value(q, planes, signed)) for p, q in zip(a, b)]
    divided, rest, zero = integers.divide(pe, x, y, signed)
    for found, expected in (
        (pe.add(x, y)[0], operator.add),
        (pe.subtract(x, y)[0], operator.sub),
        (integers.multiply(pe, x, y), operator.mul),
        (divided, quotient),
        (rest, lambda p, q: p - q * quotient(p, q) if q else 0),
        (integers.power(pe, x, 5), lambda p, q: p**5),
    ):
        assert words(found, count) == [expected(p, q) % modulus for p, q in pairs]
    assert words([integers.less(pe, x, y, signed)], count) == [p < q for p, q in pairs]
    assert words([pe.equal(x, y)], count) == [p == q for p, q in pairs]
    assert words([zero], count) == [q == 0 for _, q in pairs] and pe.faults == sum(q == 0 for _, q in pairs)
    assert words(integers.absolute(pe, x), count) == [abs(signed_value(p, planes, True)) % modulus for p in a]


def test_steps_count_their_instructions():
    pe = Processors(4)
    x, y = field([1, 2, 3, 4], 16), field([5, 6, 7, 8], 16)
    for step, instructions in (
        (lambda: pe.add(x, y), 3 * 16 + 1),
        (lambda: pe.subtract(x, y), 3 * 16 + 1),
        (lambda: integers.less(pe, x, y, True), 2 * 16 + 2),
        (lambda: pe.equal(x, y), 3 * 16 + 2),
        (lambda: pe.copy(x), 2 * 16),
        (lambda: pe.select(0b0101, x, y), 3 * 16 + 1),
        (lambda: pe.increment(x, 0b1111), 2 * 16 + 1),
        # The first partial product is stored, the others are added to ever fewer planes.
        (lambda: integers.multiply(pe, x, y), 2 * 16 + 1 + sum(3 * planes + 2 for planes in range(1, 16))),
        (lambda: integers.extended(pe, x, 32, True), 0),
    ):
        before = pe.cycles
        step()
        assert pe.cycles - before == instructions


# REALs. A pattern's value is a rational number; what an operation must give is that of the exact result.


def value(word, planes):
    m = planes - 8
    sign = -1 if word >> (planes - 1) else 1
    return sign * Fraction(16) ** ((word >> m & 127) - 64) * Fraction(word & ((1 << m) - 1), 1 << m)


def rounded(exact, planes, nearest):
    """The pattern of a rational number: halves away from zero, or cut off."""
    m = planes - 8
    if exact == 0:
        return 0
    size, power = abs(exact), 0
    while size >= 1:
        size, power = size / 16, power + 1
    while size < Fraction(1, 16):
        size, power = size * 16, power - 1
    fraction = math.floor(size * (1 << m) + (Fraction(1, 2) if nearest else 0))
    if fraction == 1 << m:
        fraction, power = fraction >> 4, power + 1
    sign = (exact < 0) << (planes - 1)
    if power + 64 < 0:
        return 0
    return sign | ((1 << (planes - 1)) - 1 if power + 64 > 127 else (power + 64) << m | fraction)


@st.composite
def patterns(draw, planes, exponents=(0, 127)):
    """A word: zero, any number, or one with a short or a nearly full fraction."""
    m = planes - 8
    if draw(st.integers(0, 15)) == 0:
        return 0
    fraction = draw(
        st.one_of(
            st.integers(1 << (m - 4), (1 << m) - 1),
            st.integers(0, 15).map(lambda few: (1 << m) - 1 - few),
            st.integers(1, 15).map(lambda digit: digit << (m - 4)),
        )
    )
    return draw(st.booleans()) << (planes - 1) | draw(st.integers(*exponents)) << m | fraction


@st.composite
def reals_given(draw, near=False):
    planes = 8 * draw(st.integers(3, 8))
    pattern = patterns(planes, (60, 68) if near else (0, 127))
    pairs = draw(st.lists(st.tuples(pattern, pattern), min_size=1, max_size=12))
    # Operands that nearly cancel, and equal ones.
    pairs += [(a, a ^ flip) for (a, _), flip in zip(pairs[:3], (0, 1, 5)) if a]
    return reals.Format(planes, draw(st.booleans())), [a for a, _ in pairs], [b for _, b in pairs]


def root(exact, planes, nearest):
    """The pattern of a square root, by whole numbers."""
    if exact <= 0:
        return 0
    scale = 1 << (planes + 600)
    whole = math.isqrt(math.floor(exact * scale**2))
    # A root is never half way between two patterns; one more bit stands for what was cut off.
    return rounded(Fraction(2 * whole + (Fraction(whole, scale) ** 2 != exact), 2 * scale), planes, nearest)


def remainder(a, b):
    if b == 0:
        return Fraction(0)
    rest = abs(a) - abs(a) // abs(b) * abs(b)
    return -rest if a < 0 else rest


@given(st.booleans().flatmap(reals_given))
@SOME
def test_reals_are_the_exact_result_rounded_once(given_reals):
    form, a, b = given_reals
    planes, count = form.planes, len(a)
    x, y = field(a, planes), field(b, planes)
    pairs = [(value(p, planes), value(q, planes)) for p, q in zip(a, b)]
    for operation, exact in (
        (reals.add, operator.add),
        (lambda pe, form, x, y: reals.add(pe, form, x, y, minus=True), operator.sub),
        (reals.multiply, operator.mul),
        (reals.remainder, remainder),
    ):
        found = words(operation(Processors(count), form, x, y), count)
        assert found == [rounded(exact(p, q), planes, form.nearest) for p, q in pairs]
    found = words(reals.divide(Processors(count), form, x, y), count)
    for got, (p, q), pattern in zip(found, pairs, a):
        if q:
            assert got == rounded(p / q, planes, form.nearest)
        else:
            assert got == ((pattern >> (planes - 1)) << (planes - 1) | form.largest if p else 0)
    found = words(reals.square_root(Processors(count), form, x), count)
    assert found == [root(p, planes, form.nearest) for p, _ in pairs]
    assert words([reals.less(Processors(count), form, x, y)], count) == [p < q for p, q in pairs]


@given(reals_given(), st.integers(1, 8), st.booleans())
@SOME
def test_conversions_between_integers_and_reals(given_reals, length, signed):
    form, a, _ = given_reals
    planes, count, size = form.planes, len(a), 8 * length
    x = field(a, planes)
    found = words(reals.to_integer(Processors(count), form, x, size, signed=True), count)
    assert found == [math.trunc(value(p, planes)) % (1 << size) for p in a]
    whole = [p % (1 << size) for p in a]
    found = words(reals.from_integer(Processors(count), form, field(whole, size), signed), count)
    assert found == [rounded(Fraction(signed_value(p, size, signed)), planes, form.nearest) for p in whole]
    for other in (24, 40, 64):
        target = reals.Format(other, form.nearest)
        found = words(reals.resized(Processors(count), form, target, x), count)
        assert found == [rounded(value(p, planes), other, form.nearest) for p in a]


@given(st.lists(st.floats(allow_nan=False), min_size=1, max_size=30), st.integers(3, 8), st.booleans())
@SOME
def test_floats_are_loaded_with_one_rounding(values, length, nearest):
    form = reals.Format(8 * length, nearest)
    found = real_cells(np.array(values), form)
    for cell, number in zip(found.tolist(), values):
        if math.isinf(number):
            assert cell == form.largest | (number < 0) << (form.planes - 1)
        else:
            assert cell == rounded(Fraction(number), form.planes, nearest)
    inside = [abs(float(number)) for number in real_values(found, real(length))]
    assert all(number >= 0 for number in inside)


def test_what_no_real_holds_is_a_fault():
    form = reals.Format(32)
    pe = Processors(3)
    x = field(real_cells(np.array([7e75, -4.0, 0.0]), form).tolist(), 32)
    zero = pe.constant(0, 32)
    assert real_values(np.array(words(reals.add(pe, form, x, x), 3), dtype=np.uint64), real(4))[0] == np.inf
    assert pe.faults == 1
    divided = np.array(words(reals.divide(pe, form, x, zero), 3), dtype=np.uint64)
    assert real_values(divided, real(8 // 2)).tolist() == [np.inf, -np.inf, 0.0] and pe.faults == 4
    roots = words(reals.square_root(pe, form, x), 3)
    assert roots[1:] == [0, 0] and pe.faults == 5
    with pytest.raises(ValueError, match=r'REAL\*4 on bit-planes: not-a-number'):
        real_cells(np.array([1.0, np.nan]), form)


# Elementary functions.


def last_place(exact, form):
    """What the last bit of the word stands for beside a number."""
    power = -(-math.frexp(abs(exact))[1] // 4)
    return 16.0**power * 2.0**-form.fraction


NUMBERS = np.concatenate(
    [
        np.random.default_rng(4).uniform(-4, 4, 150),
        np.random.default_rng(5).uniform(-150, 150, 100),
        np.random.default_rng(6).normal(size=100) * 10.0 ** np.random.default_rng(7).uniform(-25, 3, 100),
        1 + np.random.default_rng(8).normal(size=60) * 2.0 ** -np.random.default_rng(9).uniform(0, 30, 60),
        np.pi / 2 * np.arange(-20, 21),
        [0.0, 1.0, -1.0, 0.5],
    ]
)


@pytest.mark.parametrize('length', [3, 4, 5])
@pytest.mark.parametrize(
    ('name', 'exact', 'arguments'),
    [
        ('EXP', math.exp, (np.clip(NUMBERS, -160, 160),)),
        ('LOG', math.log, (abs(NUMBERS) + (NUMBERS == 0),)),
        ('SIN', math.sin, (NUMBERS,)),
        ('COS', math.cos, (NUMBERS,)),
        ('TAN', math.tan, (NUMBERS,)),
        ('ATAN', math.atan, (NUMBERS,)),
        ('ATAN2', math.atan2, (NUMBERS, NUMBERS[::-1].copy())),
        ('ASIN', math.asin, (np.sin(NUMBERS),)),
        ('ACOS', math.acos, (np.sin(NUMBERS),)),
        ('SQRT', math.sqrt, (abs(NUMBERS),)),
        ('POWER', math.pow, (abs(NUMBERS) + 1e-3, NUMBERS[::-1] / 10)),
        ('POWER', math.pow, (NUMBERS, np.arange(NUMBERS.size) % 7.0)),
    ],
)
def test_functions_are_right_to_six_tenths_of_the_last_place(length, name, exact, arguments):
    form, kind = reals.Format(8 * length), real(8)
    loaded = [real_cells(each, form) for each in arguments]
    # Patterns of the same numbers in the longest word: what they are worth, without another rounding.
    shift = np.uint64(64 - form.planes)
    given_values = [real_values(cells << shift, kind) for cells in loaded]
    count = NUMBERS.size
    operands = [to_field(cells, form.planes) for cells in loaded]
    found = words(functions.FUNCTIONS[name](Processors(count), form, *operands), count)
    results = real_values(np.array(found, dtype=np.uint64) << shift, kind)
    judged = 0
    for result, *numbers in zip(results.tolist(), *(each.tolist() for each in given_values)):
        expected = exact(*numbers)
        judged += not expected or 1e-70 < abs(expected) < 1e70
        if expected and 1e-70 < abs(expected) < 1e70:
            assert abs(result - expected) <= 0.6 * last_place(expected, form), (name, numbers)
        elif not expected:
            assert result == 0.0, (name, numbers)
    assert judged > 0.9 * count


def test_the_longest_word_is_as_exact():
    """Against decimal arithmetic of 40 digits: a float has too few bits to judge by."""
    form = reals.Format(64)
    numbers = [0.1, 1.5, 2.718281828459045, 100.25, 1e-20, 0.9999999999999999]
    operand = to_field(real_cells(np.array(numbers), form), 64)
    with localcontext() as context:
        context.prec = 40
        for name, exact in (('EXP', Decimal.exp), ('LOG', Decimal.ln), ('SQRT', Decimal.sqrt)):
            found = words(functions.FUNCTIONS[name](Processors(len(numbers)), form, operand), len(numbers))
            for number, pattern in zip(numbers, found):
                got, expected = value(pattern, 64), Fraction(exact(Decimal(number)))
                assert abs(got - expected) <= 0.6 * Fraction(last_place(float(expected), form))


def test_constants_of_functions():
    with localcontext() as context:
        context.prec = 60
        assert tables.log_of_two(150) == round(Fraction(Decimal(2).ln()) * 2**150)
    for power in (1, 3, 10):
        assert math.isclose(tables.log_of_one_plus(power, 80) / 2**80, math.log1p(2.0**-power), rel_tol=1e-15)
        assert math.isclose(tables.arc_tangent(power, 80) / 2**80, math.atan(2.0**-power), rel_tol=1e-15)
    assert math.isclose(tables.half_pi(80) / 2**80, math.pi / 2, rel_tol=1e-15)
    assert math.isclose(tables.rotation_gain(60, 80) / 2**80, 0.6072529350088813, rel_tol=1e-15)


def test_functions_outside_their_domain_are_zero_and_faults():
    form = reals.Format(32)

    def call(name, *numbers):
        pe = Processors(1)
        cells = [real_cells(np.array([number]), form) for number in numbers]
        found = words(functions.FUNCTIONS[name](pe, form, *(to_field(each, 32) for each in cells)), 1)
        return float(real_values(np.array(found, dtype=np.uint64), real(4))[0]), pe.faults > 0

    assert call('LOG', 0.0) == (-math.inf, True)
    assert call('EXP', 200.0) == call('POWER', 0.0, -1.0) == (math.inf, True)
    for name, numbers in (
        ('LOG', (-1.0,)),
        ('ASIN', (2.0,)),
        ('ACOS', (-2.0,)),
        ('SIN', (2e6,)),
        ('POWER', (-2.0, 0.5)),
    ):
        assert call(name, *numbers) == (0.0, True)
    assert call('EXP', -200.0) == (0.0, False) and call('ATAN2', 0.0, 0.0) == (0.0, False)
    assert call('POWER', 0.0, 3.0) == (0.0, False) and call('POWER', 0.0, 0.0) == (1.0, False)


@given(whole_numbers(), st.booleans())
@SOME
def test_cells_and_planes_are_each_others_inverse(given_numbers, signed):
    planes, numbers, _ = given_numbers
    kind = bits(planes, signed)
    cells = np.array([signed_value(word, planes, signed) for word in numbers], dtype=kind.dtype)
    found = to_field(cells, planes)
    assert found == field(numbers, planes)
    assert from_field(found, kind, cells.shape).tolist() == cells.tolist()
