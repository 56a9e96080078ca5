"""Constants of the elementary functions as whole numbers of 2^-places, at most half a unit off.

The control unit broadcasts them bit by bit, so that they take no store.
"""

from __future__ import annotations

from functools import cache
from math import isqrt

from .settings import SERIES_SPARE


def _rounded(value: int) -> int:
    """A value with SERIES_SPARE places too many, to nearest."""
    return (value + (1 << (SERIES_SPARE - 1))) >> SERIES_SPARE


def _odd_series(divisor: int, places: int, alternating: bool) -> int:
    """Sum of z^k / k over odd k, z = 1 / divisor, signs alternating or not: arc tangent or its hyperbolic one."""
    term = (1 << places) // divisor
    total, k, sign = 0, 1, 1
    while term:
        total += sign * (term // k)
        term //= divisor * divisor
        k += 2
        sign = -sign if alternating else sign
    return total


@cache
def log_of_one_plus(power: int, places: int) -> int:
    """ln(1 + 2^-power): twice the hyperbolic arc tangent of 1 / (2^(power + 1) + 1)."""
    return _rounded(2 * _odd_series((2 << power) + 1, places + SERIES_SPARE, alternating=False))


@cache
def log_of_two(places: int) -> int:
    """Ln 2."""
    return log_of_one_plus(0, places)


@cache
def arc_tangent(power: int, places: int) -> int:
    """The arc tangent of 2^-power; that of 1 by Machin's formula."""
    if power:
        return _rounded(_odd_series(1 << power, places + SERIES_SPARE, alternating=True))
    return _rounded(
        4 * _odd_series(5, places + SERIES_SPARE, alternating=True)
        - _odd_series(239, places + SERIES_SPARE, alternating=True)
    )


def half_pi(places: int) -> int:
    """Pi / 2."""
    return arc_tangent(0, places + 1)


@cache
def rotation_gain(steps: int, places: int) -> int:
    """1 / K, where K is what rotations by the arc tangents of 2^0 to 2^-(steps - 1) lengthen a vector by."""
    work = places + SERIES_SPARE
    one = 1 << work
    square = one
    for step in range(steps):
        square += square >> (2 * step)
    return _rounded(isqrt((one << work << work) // square))
