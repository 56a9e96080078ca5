"""Elementary functions of REALs on bit-planes, bit by bit: sums of tabulated constants and shifted operands.

Exponential and logarithm multiply by factors 1 + 2^-i, the others rotate by arc tangents of 2^-i; a factor or a
rotation is an addition of planes read at another significance. They work on fixed-point fields: fractions of ``below``
planes under the point. The result is within 0.6 of the last place of the word (tests hold it); what is outside a
function's domain gives zero, a fault.

References
----------
Volder 1959 (rotations); Specker 1965, Chen 1972 (logarithm and exponential).
"""

from __future__ import annotations

from collections.abc import Callable

from . import reals
from .processors import Field, Processors
from .reals import BIAS, DIGIT, EXPONENT_PLANES, WIDE, Format
from .settings import ANGLE_DIGITS, LONGER, SPARE
from .tables import arc_tangent, half_pi, log_of_one_plus, log_of_two, rotation_gain

# Powers of 2 that are added to an exponent of the exponential to make it positive: 65 digits.
OFFSET = 260


def fixed(pe: Processors, form: Format, x: Field, above: int, below: int) -> tuple[Field, int]:
    """The magnitude of a REAL in fixed point, ``above`` digits before the point, and where it is too large for that."""
    fraction, exponent, _ = form.parts(x)
    planes = DIGIT * above + below
    distance, fits = pe.subtract(pe.constant(BIAS + above, EXPONENT_PLANES), exponent)
    placed = [*([0] * (planes - len(fraction))), *fraction]
    return reals.aligned(pe, placed, distance), pe.inverse(fits)


def from_fixed(pe: Processors, form: Format, x: Field, above: int, sign: int) -> Field:
    """An unsigned fixed-point field with ``above`` digits before the point as a REAL."""
    padded = [*([0] * (-len(x) % DIGIT)), *x]
    fraction, lost = reals.normalised(pe, padded)
    exponent, _ = pe.subtract(pe.constant(BIAS + above, WIDE), reals.wide(lost))
    return reals.finished(pe, form, sign, exponent, fraction)


def lowered(x: Field, places: int) -> Field:
    """A field in two's complement shifted down: its planes are read at another significance."""
    return [*x[places:], *([x[-1]] * min(places, len(x)))]


def take_where_it_fits(pe: Processors, rest: Field, constant: int) -> tuple[Field, int]:
    """A remainder less a constant, where that is not larger, and where it was not."""
    difference, fits = pe.subtract(rest, pe.constant(constant, len(rest)))
    return pe.store_where(fits, difference, rest), fits


def one_of(pe: Processors, form: Format) -> Field:
    """The number 1."""
    return pe.constant((BIAS + 1) << form.fraction | 1 << (form.fraction - DIGIT), form.planes)


def exponential(pe: Processors, form: Format, x: Field) -> Field:
    """EXP: x = q ln 2 + r; e^r is the product of the factors 1 + 2^-i whose logarithms r is the sum of."""
    below = form.fraction + SPARE
    size, far = fixed(pe, form, x, 2, below)
    rest, _ = pe.add_or_subtract(
        pe.constant(OFFSET * log_of_two(below), len(size) + DIGIT), [*size, *([0] * DIGIT)], x[-1]
    )
    small = rest[-1]
    powers: Field = []
    for bit in reversed(range(10)):
        rest, fits = take_where_it_fits(pe, rest, log_of_two(below + bit))
        powers.insert(0, fits)
    product = pe.constant(1 << below, below + 1)
    half = below // 2
    for step in range(1, below + 1):
        if step <= half:
            rest, active = take_where_it_fits(pe, rest[: below - step + 2], log_of_one_plus(step, below))
        else:
            active = rest[below - step]  # the logarithm of such a factor is its last bit
        product, _ = pe.add_where(product, [*product[step:], *([0] * step)], active)
    product = pe.up_where([*product, 0, 0, 0], 1, powers[0])
    product = pe.up_where(product, 2, powers[1])
    # What is out of range has no exponent that means anything.
    powers = pe.keep_where(pe.inverse(pe.either(small, far)), powers)
    word = reals.finished(pe, form, 0, reals.wide(powers[2:]), product)
    large = pe.both(far, pe.inverse(x[-1]))
    word = pe.keep_where(pe.inverse(pe.either(small, far)), word)
    if pe.fault(large):
        word = pe.store_where(large, pe.constant(form.largest, form.planes), word)
    return word


def logarithm(pe: Processors, form: Format, x: Field) -> Field:
    """LOG: the significand is multiplied by factors 1 + 2^-i up to 2. Of zero: the largest negative number, a fault."""
    m = form.fraction
    below = 2 * m + SPARE
    fraction, exponent, sign = form.parts(x)
    bits: Field = []
    for places in (2, 1):
        zero = pe.inverse(pe.any_plane(fraction[-places:]))
        fraction = pe.up_where(fraction, places, zero)
        bits.insert(0, pe.inverse(zero))
    product = [*([0] * (below + 1 - m)), *fraction, 0]
    total = pe.constant(log_of_two(below), below + 1)
    for step in range(1, below // 2 + 2):
        trial, _ = pe.add(product, lowered(product, step))
        active = pe.inverse(trial[-1])
        product = pe.store_where(active, trial, product)
        total, _ = pe.add_where(total, pe.constant(-log_of_one_plus(step, below), below + 1), active)
    missing, _ = pe.subtract(pe.constant(2 << below, below + 2), product)
    total, _ = pe.subtract(total, missing[1:])
    # The rounding of the constants may leave the logarithm of 1 a little below zero.
    total, _ = pe.add([*total, *([total[-1]] * 11)], pe.constant(-OFFSET * log_of_two(below), below + 12))
    for place, bit in enumerate([*bits, *exponent]):
        total, _ = pe.add_where(total, pe.constant(log_of_two(below + place), below + 12), bit)
    word = from_fixed(pe, form, pe.negate_where(total, total[-1]), 3, total[-1])
    word = pe.keep_where(pe.inverse(pe.equal(x, one_of(pe, form))), word)
    none = pe.inverse(pe.any_plane(x[m - DIGIT : m]))
    refused = pe.either(sign, none)
    if pe.fault(refused):
        word = pe.keep_where(pe.inverse(refused), word)
        word = pe.store_where(none, pe.constant((1 << form.planes) - 1, form.planes), word)
    return word


def sine_and_cosine(pe: Processors, form: Format, x: Field) -> tuple[Field, Field]:
    """SIN and COS: the angle less its quarter turns is rotated away, while a unit vector is rotated the other way."""
    m = form.fraction
    below = 2 * m + SPARE
    rest, far = fixed(pe, form, x, ANGLE_DIGITS, below)
    turns: Field = []
    for bit in reversed(range(DIGIT * ANGLE_DIGITS)):
        rest, fits = take_where_it_fits(pe, rest, half_pi(below + bit))
        turns.insert(0, fits)
    angle = [*rest[: below + 1], 0, 0]
    along = pe.constant(rotation_gain(below, below), below + 3)
    across = pe.constant(0, below + 3)
    for step in range(below):
        negative = angle[-1]
        positive = pe.inverse(negative)
        along, across = (
            pe.add_or_subtract(along, lowered(across, step), positive)[0],
            pe.add_or_subtract(across, lowered(along, step), negative)[0],
        )
        angle, _ = pe.add_or_subtract(angle, pe.constant(arc_tangent(step, below), below + 3), positive)
    odd, half = turns[0], turns[1]
    results = []
    for first, second, sign in ((across, along, pe.differ(half, x[-1])), (along, across, pe.differ(half, odd))):
        value = pe.select(odd, second, first)
        below_zero = value[-1]
        value = pe.negate_where(value, below_zero)
        results.append(from_fixed(pe, form, [*value[: below + 1], 0, 0, 0], 1, pe.differ(sign, below_zero)))
    sine, cosine = results
    # Of an angle whose square is lost beside 1 the sine is the angle.
    tiny = pe.carry_of(x[m : m + EXPONENT_PLANES], pe.constant(BIAS - m // 8 - 1, EXPONENT_PLANES), pe.full)
    sine = pe.store_where(pe.inverse(tiny), x, sine)
    if pe.fault(far):
        near = pe.inverse(far)
        sine, cosine = pe.keep_where(near, sine), pe.keep_where(near, cosine)
    return sine, cosine


def sine(pe: Processors, form: Format, x: Field) -> Field:
    """SIN, of less than 16^5 radians."""
    return sine_and_cosine(pe, form, x)[0]


def cosine(pe: Processors, form: Format, x: Field) -> Field:
    """COS, of less than 16^5 radians."""
    return sine_and_cosine(pe, form, x)[1]


def longer(form: Format) -> Format:
    """The form that intermediate results have."""
    return Format(form.planes + LONGER, True)


def lengthened(x: Field) -> Field:
    """A word in the longer form: the new planes are zero and are not stored."""
    return [*([0] * LONGER), *x]


def tangent(pe: Processors, form: Format, x: Field) -> Field:
    """TAN, of less than 16^5 radians."""
    work = longer(form)
    quotient = reals.divide(pe, work, *sine_and_cosine(pe, work, lengthened(x)))
    return reals.resized(pe, work, form, quotient)


def square_root(pe: Processors, form: Format, x: Field) -> Field:
    """SQRT."""
    return reals.square_root(pe, form, x)


def arc_tangent_2(pe: Processors, form: Format, y: Field, x: Field) -> Field:
    """ATAN2: the quotient of the smaller and the larger is rotated to the axis; the octant is put right afterwards."""
    work = longer(form)
    result = _angle(pe, work, lengthened(y), lengthened(x))
    return reals.resized(pe, work, form, result)


def _angle(pe: Processors, form: Format, y: Field, x: Field) -> Field:
    """The angle of (x, y) in -pi to pi."""
    m = form.fraction
    below = m + m // 2 + SPARE
    steep = pe.carry_of(x[:-1], y[:-1], pe.full) ^ pe.full
    large = [*pe.select(steep, y[:-1], x[:-1]), 0]
    small = [*pe.select(steep, x[:-1], y[:-1]), 0]
    none = pe.inverse(pe.any_plane(large[m - DIGIT : m]))
    large = pe.store_where(none, one_of(pe, form), large)
    ratio = reals.divide(pe, form, small, large)
    size, _ = fixed(pe, form, ratio, 1, below)
    across = size
    along = pe.constant(1 << below, len(size))
    angle = pe.constant(0, len(size))
    for step in range(1, below + 1):
        below_zero = across[-1]
        above_zero = pe.inverse(below_zero)
        along, across = (
            pe.add_or_subtract(along, lowered(across, step), below_zero)[0],
            pe.add_or_subtract(across, lowered(along, step), above_zero)[0],
        )
        angle, _ = pe.add_or_subtract(angle, pe.constant(arc_tangent(step, below), len(angle)), below_zero)
    angle = pe.negate_where(angle, angle[-1])  # of zero it may be a unit below
    quarter, _ = pe.subtract(pe.constant(half_pi(below), len(angle)), angle)
    angle = pe.select(steep, quarter, angle)
    half, _ = pe.subtract(pe.constant(half_pi(below + 1), len(angle)), angle)
    angle = pe.select(x[-1], half, angle)
    word = from_fixed(pe, form, angle, 1, y[-1])
    # Of a quotient whose square is lost beside 1 the arc tangent is the quotient.
    seen = pe.carry_of(ratio[m : m + EXPONENT_PLANES], pe.constant(BIAS - m // 8 - 1, EXPONENT_PLANES), pe.full)
    plain = pe.both(pe.inverse(seen), pe.inverse(pe.either(steep, x[-1])))
    return pe.store_where(plain, reals.with_sign(pe, form, ratio, y[-1]), word)


def arc_tangent_1(pe: Processors, form: Format, x: Field) -> Field:
    """ATAN."""
    return arc_tangent_2(pe, form, x, one_of(pe, form))


def _with_cosine(pe: Processors, form: Format, x: Field) -> tuple[Format, Field, Field]:
    """The longer form, x in it, and the square root of (1 - x) (1 + x); a fault where x is beyond -1 and 1."""
    work = longer(form)
    long, one = lengthened(x), one_of(pe, work)
    product = reals.multiply(pe, work, reals.add(pe, work, one, long, minus=True), reals.add(pe, work, one, long))
    return work, long, reals.square_root(pe, work, product)


def arc_sine(pe: Processors, form: Format, x: Field) -> Field:
    """ASIN."""
    work, long, other = _with_cosine(pe, form, x)
    return _in_domain(pe, form, x, reals.resized(pe, work, form, _angle(pe, work, long, other)))


def arc_cosine(pe: Processors, form: Format, x: Field) -> Field:
    """ACOS."""
    work, long, other = _with_cosine(pe, form, x)
    return _in_domain(pe, form, x, reals.resized(pe, work, form, _angle(pe, work, other, long)))


def _in_domain(pe: Processors, form: Format, x: Field, result: Field) -> Field:
    """The result, zero where x is beyond -1 and 1."""
    outside = pe.carry_of(one_of(pe, form)[:-1], x[:-1], pe.full) ^ pe.full
    return pe.keep_where(pe.inverse(outside), result) if pe.anywhere(outside) else result


def power(pe: Processors, form: Format, x: Field, y: Field) -> Field:
    """The power x ** y, by EXP and LOG. A negative x has one where y is whole; elsewhere the result is zero, a fault.

    Zero has the power zero, 1 where y is zero, and where y is negative the largest number, a fault.
    """
    m = form.fraction
    work = longer(form)
    none = pe.inverse(pe.any_plane(x[m - DIGIT : m]))
    magnitude = pe.store_where(none, one_of(pe, form), [*x[:-1], 0])
    logarithms = logarithm(pe, work, lengthened(magnitude))
    product = reals.multiply(pe, work, logarithms, lengthened(y))
    word = reals.resized(pe, work, form, exponential(pe, work, product))
    whole = reals.to_integer(pe, form, y, form.planes, True)
    is_whole = pe.equal(reals.from_integer(pe, form, whole, True), y)
    odd = pe.both(x[-1], pe.both(is_whole, whole[0]))
    word = [*word[:-1], odd]
    refused = pe.both(x[-1], pe.inverse(is_whole))
    large = pe.both(none, y[-1])
    pe.fault(refused)
    zero = pe.either(refused, pe.both(none, pe.any_plane(y[m - DIGIT : m])))
    word = pe.keep_where(pe.inverse(zero), word)
    return pe.store_where(large, pe.constant(form.largest, form.planes), word) if pe.fault(large) else word


FUNCTIONS: dict[str, Callable[..., Field]] = {
    'SQRT': square_root,
    'EXP': exponential,
    'LOG': logarithm,
    'SIN': sine,
    'COS': cosine,
    'TAN': tangent,
    'ASIN': arc_sine,
    'ACOS': arc_cosine,
    'ATAN': arc_tangent_1,
    'ATAN2': arc_tangent_2,
    'POWER': power,
}
