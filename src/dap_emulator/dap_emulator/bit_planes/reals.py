"""Arithmetic of REALs on bit-planes: a sign, an exponent of base 16, a fraction of whole hexadecimal digits.

A word of n planes is, from the least significant: m = n - 8 planes of fraction F, seven of exponent E, one of sign s.
Its value is (-1)^s 16^(E - 64) F / 2^m, with a first digit of F that is not zero; zero is all planes zero. This is the
form of REALs on the family's host machines and of those of IBM, recalled as the DAP's (docs/dap.md says what is
sourced). There is neither infinity nor not-a-number: what is too large becomes the largest number, what has no value
becomes zero, both counted as faults; what is too small becomes zero.

The result of every operation here is the exact one, rounded once: to the nearest number, halves away from zero, or
with ``nearest=False`` cut off toward zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from . import integers
from .processors import Field, Processors
from .settings import GUARD

EXPONENT_PLANES = 7
BIAS = 64
DIGIT = 4
# Planes of an exponent while it is worked on: in two's complement, -256 to 255 holds sums and differences of two.
WIDE = 9


@dataclass(frozen=True)
class Format:
    """A REAL of so many bit-planes.

    Parameters
    ----------
    planes : int
        24 to 64.
    nearest : bool
        Round to nearest; otherwise cut off.
    """

    planes: int
    nearest: bool = True

    @property
    def fraction(self) -> int:
        """Planes of the fraction."""
        return self.planes - 8

    @property
    def largest(self) -> int:
        """The pattern of the largest number."""
        return (1 << (self.planes - 1)) - 1

    def parts(self, x: Sequence[int]) -> tuple[Field, Field, int]:
        """Fraction, exponent and sign of a word."""
        m = self.fraction
        return list(x[:m]), list(x[m : m + EXPONENT_PLANES]), x[m + EXPONENT_PLANES]


def wide(exponent: Sequence[int]) -> Field:
    """An exponent in the planes that it is worked on in; the new ones are zero and are not stored."""
    return [*exponent, *([0] * (WIDE - len(exponent)))]


def stages(planes: int) -> int:
    """Stages of doubling that shift a fraction of so many planes by any number of its digits but the last."""
    return (-(-planes // DIGIT) - 1).bit_length()


def normalised(pe: Processors, fraction: Field) -> tuple[Field, Field]:
    """A fraction shifted up until its first digit is not zero, and by how many digits it was."""
    counts: Field = []
    for stage in reversed(range(stages(len(fraction)))):
        places = DIGIT << stage
        zero = pe.inverse(pe.any_plane(fraction[-places:]))
        fraction = pe.up_where(fraction, places, zero)
        counts.append(zero)
    counts.reverse()
    return fraction, counts


def finished(pe: Processors, form: Format, sign: int, exponent: Field, fraction: Field) -> Field:
    """A word from a sign, an exponent of WIDE planes and a normalised fraction, which may have planes to be rounded."""
    m = form.fraction
    spare = len(fraction) - m
    if spare < 0:
        fraction = [0] * -spare + fraction
    elif spare:
        below, fraction = fraction[spare - 1], fraction[spare:]
        if form.nearest:
            # All ones round up to a one and zeros: the one belongs into the last bit of the first digit.
            fraction, over = pe.increment(fraction, below)
            fraction[m - DIGIT] = pe.either(fraction[m - DIGIT], over)
            exponent, _ = pe.increment(exponent, over)
    negative = exponent[-1]
    number = pe.any_plane(fraction[-DIGIT:])
    good = pe.both(number, pe.inverse(negative))
    word = pe.keep_where(good, [*fraction, *exponent[:EXPONENT_PLANES], sign])
    large = pe.both(good, pe.any_plane(exponent[EXPONENT_PLANES : WIDE - 1]))
    if pe.fault(large):
        most = [*pe.constant(form.largest, form.planes - 1), sign]
        word = pe.store_where(large, most, word)
    return word


def add(pe: Processors, form: Format, x: Field, y: Field, minus: bool = False) -> Field:
    """The sum x + y, or the difference x - y.

    The smaller in magnitude is shifted down to the exponent of the larger, added or subtracted, and the sum normalised.
    """
    m = form.fraction
    if minus:
        y = [*y[:-1], pe.inverse(y[-1])]
    swap = pe.carry_of(x[:-1], y[:-1], pe.full) ^ pe.full
    big, big_exponent, sign = form.parts(pe.select(swap, y, x))
    small, small_exponent, other = form.parts(pe.select(swap, x, y))
    distance, _ = pe.subtract(big_exponent, small_exponent)
    shifted = aligned(pe, [0] * GUARD + small, distance)
    minus_where = pe.differ(sign, other)
    total, carry = pe.add_or_subtract([0] * GUARD + big, shifted, minus_where)
    carry = pe.both(carry, pe.inverse(minus_where))
    total = pe.down_where([*total, carry, 0, 0, 0], DIGIT, carry)[: m + GUARD]
    total, lost = normalised(pe, total)
    exponent, _ = pe.increment(wide(big_exponent), carry)
    exponent, _ = pe.subtract(exponent, wide(lost))
    return finished(pe, form, sign, exponent, total)


def aligned(pe: Processors, fraction: Field, distance: Field) -> Field:
    """A fraction shifted down by so many digits; its lowest plane stays true where a true bit was shifted out."""
    used = stages(len(fraction))
    for stage in range(used):
        places = DIGIT << stage
        active = distance[stage]
        lost = pe.any_plane(fraction[: places + 1])
        fraction = pe.down_where(fraction, places, active)
        fraction[:1] = pe.store_where(active, [lost], fraction[:1])
    far = pe.any_plane(distance[used:])
    lost = pe.both(far, pe.any_plane(fraction))
    fraction = pe.keep_where(pe.inverse(far), fraction)
    fraction[0] = pe.either(fraction[0], lost)
    return fraction


def multiply(pe: Processors, form: Format, x: Field, y: Field) -> Field:
    """The product: the whole product of the fractions, of which the upper half is kept."""
    m = form.fraction
    (a, a_exponent, a_sign), (b, b_exponent, b_sign) = form.parts(x), form.parts(y)
    upper: Field = [0] * m
    lower: Field = []
    for bit in b:
        total, carry = pe.add_where(upper, a, bit)
        pe.cycles += 1  # the carry is stored above the sum
        lower.append(total[0])
        upper = [*total[1:], carry]
    exponent, _ = pe.add(wide(a_exponent), wide(b_exponent))
    exponent, _ = pe.add(exponent, pe.constant(-BIAS, WIDE))
    # Of the lower half only the digit that normalising may bring up matters, and the bit below it.
    product = [*lower[m - DIGIT - 1 :], *upper]
    small = pe.inverse(pe.any_plane(product[-DIGIT:]))
    product = pe.up_where(product, DIGIT, small)
    exponent, _ = pe.subtract(exponent, wide([small]))
    return finished(pe, form, pe.differ(a_sign, b_sign), exponent, product)


def divide(pe: Processors, form: Format, x: Field, y: Field) -> Field:
    """The quotient, by division without restoring. By zero: the largest number with the sign of x; 0 / 0: zero."""
    m = form.fraction
    (a, a_exponent, a_sign), (b, b_exponent, b_sign) = form.parts(x), form.parts(y)
    # The dividend is made smaller than the divisor, by a digit where it is not, and the exponent larger.
    large = pe.carry_of(a, b, pe.full)
    low = pe.select(large, [*a, 0, 0, 0, 0], [0, 0, 0, 0, *a])
    divisor = [*b, 0]
    rest = [*low[DIGIT:], 0]
    below = low[:DIGIT]
    minus = pe.full
    quotient: Field = []
    for _ in range(m + 1):
        coming = below.pop() if below else 0
        rest, _ = pe.add_or_subtract([coming, *rest[:-1]], divisor, minus)
        minus = pe.inverse(rest[-1])
        quotient.append(minus)
    quotient.reverse()
    exponent, _ = pe.subtract(wide(a_exponent), wide(b_exponent))
    exponent, _ = pe.add(exponent, pe.constant(BIAS, WIDE))
    exponent, _ = pe.increment(exponent, large)
    zero = pe.inverse(pe.any_plane(b[-DIGIT:]))
    by_zero = pe.fault(zero)
    if by_zero:
        quotient = pe.keep_where(pe.inverse(zero), quotient)
    word = finished(pe, form, pe.differ(a_sign, b_sign), exponent, quotient)
    if by_zero:
        number = pe.any_plane(a[-DIGIT:])
        most = pe.keep_where(number, [*pe.constant(form.largest, form.planes - 1), a_sign])
        word = pe.store_where(zero, most, word)
    return word


def square_root(pe: Processors, form: Format, x: Field) -> Field:
    """The square root, bit by bit without restoring. Of a negative number: zero, a fault."""
    m = form.fraction
    fraction, exponent, sign = form.parts(x)
    # An even power of 16 is halved; at an odd one the fraction goes down a digit.
    odd = exponent[0]
    radicand = pe.select(odd, [*fraction, 0, 0, 0, 0], [0, 0, 0, 0, *fraction])
    rest: Field = [0, 0, 0]
    root: Field = []
    minus = pe.full
    for step in range(m + 1):
        high, low = (radicand[-1 - 2 * step - k] if 2 * step + k < len(radicand) else 0 for k in (0, 1))
        trial = [pe.full, pe.inverse(minus), *root]
        rest = [low, high, *rest][: len(trial) + 1]
        trial.append(0)
        rest, _ = pe.add_or_subtract(rest, trial, minus)
        minus = pe.inverse(rest[-1])
        root.insert(0, minus)
    # (E - 64) / 2 + 64 is E / 2 + 32, rounded up where the power is odd.
    half, _ = pe.add(wide(exponent[1:]), pe.constant(BIAS // 2, WIDE))
    half, _ = pe.increment(half, odd)
    good = pe.inverse(sign)
    pe.fault(sign)
    return finished(pe, form, 0, half, pe.keep_where(good, root))


def less(pe: Processors, form: Format, x: Field, y: Field) -> int:
    """True where x < y. Where both are negative the magnitudes must be the other way round, and differ: C begins so."""
    negative = pe.both(x[-1], y[-1])
    carry = pe.carry_of(x[:-1], y[:-1], pe.inverse(negative))
    result = pe.differ(carry, pe.inverse(negative))
    one = pe.differ(x[-1], y[-1])
    return pe.select(one, [x[-1]], [result])[0]


def negate(pe: Processors, form: Format, x: Field) -> Field:
    """The negative; zero has no sign."""
    number = pe.any_plane(x[form.fraction - DIGIT : form.fraction])
    return [*pe.copy(x[:-1]), pe.differ(x[-1], number)]


def absolute(pe: Processors, form: Format, x: Field) -> Field:
    """The magnitude: the planes but the sign's."""
    return [*pe.copy(x[:-1]), 0]


def with_sign(pe: Processors, form: Format, x: Field, negative: int) -> Field:
    """The magnitude of x, negative where the plane is true and x is not zero."""
    number = pe.any_plane(x[form.fraction - DIGIT : form.fraction])
    return [*pe.copy(x[:-1]), pe.both(number, negative)]


def from_integer(pe: Processors, form: Format, x: Field, signed: bool) -> Field:
    """An INTEGER as a REAL."""
    sign = x[-1] if signed else 0
    magnitude = integers.absolute(pe, x) if signed else list(x)
    magnitude += [0] * (-len(magnitude) % DIGIT)
    fraction, lost = normalised(pe, magnitude)
    exponent, _ = pe.subtract(pe.constant(BIAS + len(magnitude) // DIGIT, WIDE), wide(lost))
    return finished(pe, form, sign, exponent, fraction)


def to_integer(pe: Processors, form: Format, x: Field, planes: int, signed: bool) -> Field:
    """A REAL as an INTEGER of so many planes, toward zero; what does not fit the word wraps."""
    fraction, exponent, sign = form.parts(x)
    m = len(fraction)
    # Digits before the point; none where that is negative.
    digits, not_below = pe.add(exponent, pe.constant(-BIAS, EXPONENT_PLANES))
    whole = pe.keep_where(not_below, fraction)
    word = [*whole, *([0] * planes)]
    used = (-(-len(word) // DIGIT) - 1).bit_length()
    for stage in range(used):
        word = pe.up_where(word, DIGIT << stage, digits[stage])
    far = pe.any_plane(digits[used:-1])
    out = word[m:]
    if pe.anywhere(pe.both(far, not_below)):
        out = pe.keep_where(pe.inverse(far), out)
    return pe.negate_where(out, sign) if signed else out


def resized(pe: Processors, before: Format, form: Format, x: Field) -> Field:
    """A REAL in a word of another length."""
    fraction, exponent, sign = before.parts(x)
    return finished(pe, form, sign, wide(exponent), fraction)


def power(pe: Processors, form: Format, x: Field, exponent: int) -> Field:
    """A whole power of at least 0, by repeated squaring: every multiplication rounds."""
    if exponent == 0:
        return pe.copy(pe.constant((BIAS + 1) << form.fraction | 1 << (form.fraction - DIGIT), form.planes))
    out: Field | None = None
    square = list(x)
    while True:
        if exponent & 1:
            out = square if out is None else multiply(pe, form, out, square)
        exponent >>= 1
        if not exponent:
            assert out is not None
            return out
        square = multiply(pe, form, square, square)


def remainder(pe: Processors, form: Format, x: Field, y: Field) -> Field:
    """What is left of x by division by y, with the sign of x: exact. A zero divisor gives zero, a fault.

    The fraction is divided digit by digit, as many as the exponents of any PE differ by; the quotient is not kept.
    """
    (a, a_exponent, a_sign), (b, b_exponent, _) = form.parts(x), form.parts(y)
    zero = pe.inverse(pe.any_plane(b[-DIGIT:]))
    smaller = pe.carry_of(x[:-1], y[:-1], pe.full) ^ pe.full
    distance, _ = pe.subtract(wide(a_exponent), wide(b_exponent))
    left = pe.keep_where(pe.inverse(pe.either(zero, smaller)), distance)
    divisor = [*b, 0, 0, 0, 0, 0]
    rest = [*a, 0, 0, 0, 0, 0]
    rest = _reduced(pe, rest, divisor, DIGIT)
    while True:
        running = pe.any_plane(left)
        if not pe.anywhere(running):
            break
        next_rest = _reduced(pe, [0, 0, 0, 0, *rest[:-DIGIT]], divisor, DIGIT)
        rest = pe.store_where(running, next_rest, rest)
        left, _ = pe.subtract(left, wide([running]))
    fraction, lost = normalised(pe, rest[: form.fraction])
    exponent, _ = pe.subtract(wide(b_exponent), wide(lost))
    word = finished(pe, form, a_sign, exponent, fraction)
    word = pe.store_where(smaller, x, word)
    if pe.fault(zero):
        word = pe.keep_where(pe.inverse(zero), word)
    return word


def _reduced(pe: Processors, rest: Field, divisor: Field, bits: int) -> Field:
    """The remainder of a field that is less than 2^bits divisors: each is subtracted where it is not larger."""
    for bit in reversed(range(bits)):
        shifted = [*([0] * bit), *divisor][: len(rest)]
        difference, fits = pe.subtract(rest, shifted)
        rest = pe.store_where(fits, difference, rest)
    return rest
