"""Arithmetic of INTEGERs on bit-planes, by the microprograms that one-bit PEs need for it.

Fields are in two's complement where ``signed``, the least significant plane first. Results are modulo the word length.
"""

from __future__ import annotations

from collections.abc import Sequence

from .processors import Field, Processors


def extended(pe: Processors, x: Sequence[int], planes: int, signed: bool) -> Field:
    """The number in a word of another length: the plane of the sign is read again for further ones, at no cost.

    Planes beyond a shorter word are not addressed.
    """
    top = x[-1] if signed else 0
    return [*x[:planes], *([top] * (planes - len(x)))]


def multiply(pe: Processors, x: Sequence[int], y: Sequence[int]) -> Field:
    """The product modulo the word length: x, shifted up, is added where the bit of y is set.

    Only planes within the word are added, so that half of the square of partial products is never looked at.
    """
    out = pe.keep_where(y[0], x)
    for bit in range(1, len(y)):
        out[bit:], _ = pe.add_where(out[bit:], x[: len(x) - bit], y[bit])
    return out


def power(pe: Processors, x: Sequence[int], exponent: int) -> Field:
    """A whole power of at least 0, by repeated squaring."""
    if exponent == 0:
        return pe.copy(pe.constant(1, len(x)))
    out: Field | None = None
    square = list(x)
    while True:
        if exponent & 1:
            out = square if out is None else multiply(pe, out, square)
        exponent >>= 1
        if not exponent:
            assert out is not None
            return out
        square = multiply(pe, square, square)


def divide(pe: Processors, x: Sequence[int], y: Sequence[int], signed: bool) -> tuple[Field, Field, int]:
    """Quotient toward zero, remainder with the sign of x, and where y is zero; both are 0 there.

    Division without restoring: the divisor is subtracted where the remainder so far is not negative, added elsewhere.
    """
    n = len(x)
    a, b = (absolute(pe, side) if signed else list(side) for side in (x, y))
    b.append(0)
    rest: Field = [0] * (n + 1)
    minus = pe.full
    quotient: Field = []
    for bit in reversed(range(n)):
        rest, _ = pe.add_or_subtract([a[bit], *rest[:n]], b, minus)
        minus = pe.inverse(rest[n])
        quotient.append(minus)
    quotient.reverse()
    rest, _ = pe.add_where(rest, b, rest[n])
    rest = rest[:n]
    if signed:
        quotient = pe.negate_where(quotient, pe.differ(x[-1], y[-1]))
        rest = pe.negate_where(rest, x[-1])
    zero = pe.inverse(pe.any_plane(y))
    if pe.fault(zero):
        good = pe.inverse(zero)
        quotient, rest = pe.keep_where(good, quotient), pe.keep_where(good, rest)
    return quotient, rest, zero


def absolute(pe: Processors, x: Sequence[int]) -> Field:
    """The magnitude of a signed field; that of the most negative number is its own pattern, read as unsigned."""
    return pe.negate_where(x, x[-1])


def negate(pe: Processors, x: Sequence[int]) -> Field:
    """The negative, modulo the word length."""
    return pe.negate_where(x, pe.full)


def less(pe: Processors, x: Sequence[int], y: Sequence[int], signed: bool) -> int:
    """True where x < y: there is no carry from x - y. The planes of the signs change places."""
    if not signed:
        return pe.carry_of(x, y, pe.full) ^ pe.full
    return pe.carry_of([*x[:-1], y[-1]], [*y[:-1], x[-1]], pe.full) ^ pe.full
