"""Numbers of the proof. None decides what is proven: they steer the search for poses and for infeasible subsets."""

from __future__ import annotations

from typing import NamedTuple

# -- the tree --------------------------------------------------------------------------------------------------------

# Sine of the angle between two features above which they may fix a first pose.
STEEP = 0.3
# A data feature with more pairings than this excludes little; groups begin with others.
WIDE = 24
# Data features in a group that the tree branches on: three lines fix a pose, and one more makes it well determined.
GROUP = 4
# Radians: in a larger region of rotations linear bounds say nothing; another feature is taken first.
WIDEST_TURN = 0.5
# Data features that are revised between two looks at the clock.
AT_ONCE = 64
# Bins of pi/2 in the table of angles between model features.
ANGLES = 180

# -- minimax feasibility ---------------------------------------------------------------------------------------------


class MinimaxSteps(NamedTuple):
    """How a pose is sought under which the largest residual is least.

    Attributes
    ----------
    linearisations
        Times that the residuals are linearised anew.
    powers
        Of the sums that approach the maximum: 2, 4, 8, ..., 2 ** powers.
    newton
        Steps for each power at most, and Gauss-Newton steps of a least-squares pose of an assignment.
    shorter, shortest
        The first step of the line search is the whole Newton step; it is multiplied by ``shorter`` until the sum falls,
        but is not made shorter than ``shortest``.
    least_gain
        A power is left when a step lowers its sum by less than this part.
    below_one
        The residuals are linearised anew when the largest squared one is below this; below 1 the set is feasible.
    settled
        Radians and metres: after a smaller step they are not linearised anew.
    """

    linearisations: int
    powers: int
    newton: int
    shorter: float
    shortest: float
    least_gain: float
    below_one: float
    settled: float


MINIMAX = MinimaxSteps(4, 10, 8, 0.4, 0.02, 0.002, 0.999, 1e-4)

# -- regions of rotations --------------------------------------------------------------------------------------------


class RegionSteps(NamedTuple):
    """How a region of rotations is made smaller.

    Attributes
    ----------
    narrowings, worthwhile
        Times that it is shrunk to what the pairings leave, as long as its radius falls below this part of itself.
    slices
        Of a region's turn that are looked at one by one.
    mixed
        Weight of all blocks together that is added to that of the worst ones.
    widened, across
        Where a tolerance is widened more than so many times, a region is divided into so many parts along each axis.
    pairings
        Where all else has been tried it is divided into so many parts, times the pairings that are looked at in each.
    """

    narrowings: int
    worthwhile: float
    slices: int
    mixed: float
    widened: float
    across: int
    pairings: int


REGIONS = RegionSteps(12, 0.9, 16, 0.1, 1.3, 3, 5000)

# -- minimal infeasible subsets --------------------------------------------------------------------------------------


class SubsetSizes(NamedTuple):
    """In which steps an infeasible subset is sought; the heaviest pairings are tried first.

    Attributes
    ----------
    least, growth
        Pairings that are tried first; then one part in so many more at a time, or one.
    minimal
        A subset of at most so many pairings is made minimal; a larger one is used as it is.
    """

    least: int
    growth: int
    minimal: int


SUBSETS = SubsetSizes(3, 4, 12)
