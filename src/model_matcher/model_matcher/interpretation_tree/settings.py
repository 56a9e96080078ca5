"""Limits and tolerances of the tree searches and of the poses fitted to what they find."""

from __future__ import annotations

from typing import NamedTuple

# -- how much a search may do --------------------------------------------------------------------------------------
# A search is limited in steps, so that its result is the same on every machine that is fast enough; on others the clock
# ends it. The rates turn a time limit in seconds into steps; they were measured on one core of the development machine,
# no command kept.


class Rates(NamedTuple):
    """Steps in a second.

    Attributes
    ----------
    entries
        Of the tables, filled.
    levels, level_size
        Levels of the tree visited, while a level has at most ``level_size`` data x model features; with more,
        proportionally fewer.
    tests
        Pairs tested by the serial search.
    signs_per_test
        Saving the signs of this many data features at a level counts as one test.
    """

    entries: int
    levels: int
    level_size: int
    tests: int
    signs_per_test: int


RATES = Rates(20_000_000, 1_000_000, 1000, 10_000_000, 8)
# Most entries of all tables together, one byte each: more is refused with a reason.
LARGEST_TABLES = 400_000_000
# Most data pairs of the serial search and of the array machine, which keep 11 numbers and more for each: more is
# refused with a reason.
LARGEST_PAIRS = 2_000_000

# -- what is done with feasible interpretations ----------------------------------------------------------------------

# Feasible interpretations that a search returns at most (the thesis' NOI); the best of them are refined.
INTERPRETATIONS = 256
# The closed-form pose is tested with this multiple of MatchParams.fracdev; the refined one with fracdev itself.
FIRST_FRACDEV = 4.0

# -- the array machine -----------------------------------------------------------------------------------------------

# Radians or metres: what rounding may do in REAL*4 to the ranges of a pair. Places of 0.1 m are known to 1e-8 m, which
# turns the line between two points 5 mm apart by 5e-6: lines at a smaller angle are parallel.
SHORT_WORD_ROUNDING = 1e-5
# Metres: points that REAL*4 cannot tell apart, a few roundings of a place some decimetres from the origin.
SHORT_WORD_LENGTH = 1e-7
# Rounds of plane rotations through a 4 x 4 matrix (Jacobi's process) at most. Convergence is quadratic: six suffice for
# a double.
SWEEPS = 10
# What is left beside the diagonal, as a part of the matrix, when the rotations end: in roundings of the word.
JACOBI_ROUNDINGS = 4.0
# A pivot of the normal equations below this many roundings of its matrix leaves a shift open.
PIVOT_ROUNDINGS = 64.0
