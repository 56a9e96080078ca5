"""Scalar arithmetic of the control unit, in the word length of the operands."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from ..machine.kinds import Kind


def _integer_divide(a: int, b: int) -> int:
    """Quotient toward zero."""
    if b == 0:
        raise ZeroDivisionError('division of an INTEGER by zero')
    quotient = abs(a) // abs(b)
    return quotient if (a < 0) == (b < 0) else -quotient


def _real_divide(a: float, b: float) -> float:
    """IEEE quotient, also by zero."""
    if b == 0:
        return math.nan if a == 0 or math.isnan(a) else math.copysign(math.inf, a) * math.copysign(1.0, b)
    return a / b


def _integer_power(a: int, b: int) -> int:
    """Modulo the longest word: the true power may have more digits than there is memory."""
    if b < 0:
        return _integer_divide(1, a if abs(a) != 1 else a ** (b % 2))
    return pow(a, b, 1 << 64)


def _real_power(a: float, b: float) -> float:
    """Power of reals: infinite on overflow, not a number where it would be complex."""
    try:
        result = a**b
    except (OverflowError, ZeroDivisionError):
        return math.inf
    return result if isinstance(result, (int, float)) else math.nan


def scalar_operation(symbol: str, kind: Kind) -> Callable[[Any, Any], Any]:
    """Make an operation on two scalars.

    Parameters
    ----------
    symbol : {'+', '-', '*', '/', '**'}
    kind : Kind
        INTEGER or REAL; the result is cut to its word.

    Returns
    -------
    callable
        Of two numbers. Division of integers by zero raises ZeroDivisionError.

    Examples
    --------
    >>> from dap_emulator.machine.kinds import integer
    >>> scalar_operation('/', integer(2))(-7, 2)
    -3
    >>> scalar_operation('*', integer(2))(300, 300)
    24464
    """
    whole = kind.name == 'INTEGER'
    raw: Callable[[Any, Any], Any] = {
        '+': operator.add,
        '-': operator.sub,
        '*': operator.mul,
        '/': _integer_divide if whole else _real_divide,
        '**': _integer_power if whole else _real_power,
    }[symbol]
    if not whole:
        fit = kind.scalar
        return lambda a, b: fit(raw(float(a), b))
    low, high = kind.range
    size = 1 << kind.bits

    def run(a: int, b: int) -> int:
        result: int = raw(a, b)
        return result if low <= result <= high else (result - low) % size + low

    return run
