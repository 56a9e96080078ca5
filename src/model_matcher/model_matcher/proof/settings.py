"""Numbers of the proof. None decides what is proven: they steer the search for poses and for infeasible subsets."""

from __future__ import annotations

# -- the tree --------------------------------------------------------------------------------------------------------

# Sine of the angle between two features above which they may fix a first pose.
STEEP = 0.3
# A data feature with more pairings than this excludes little; the tree branches on it last.
WIDE = 24
# Data features in a group that the tree branches on: three lines fix a pose, and one more makes it well determined.
GROUP = 4
# Radians: cones of directions are at least this wide where the worth of a pair of features is divided by them.
NARROWEST_CONE = 1e-6
# Bins of pi/2 in the table of angles between model features.
ANGLES = 180

# -- minimax feasibility ---------------------------------------------------------------------------------------------

# Times that the residuals are linearised anew.
LINEARISATIONS = 4
# Powers of the sums that approach the maximum: 2, 4, 8, ..., 2 ** POWERS.
POWERS = 10
# Newton steps for each power at most, and Gauss-Newton steps of a least-squares pose of an assignment.
NEWTON_STEPS = 8
# The first step of the line search is the whole Newton step; it is multiplied by this until the sum falls, but is not
# made shorter than the second number.
SHORTER, SHORTEST = 0.4, 0.02
# A power is left when a step lowers its sum by less than this part.
LEAST_GAIN = 0.002
# The residuals are linearised anew when the largest squared one is below this; below 1 the set is feasible.
BELOW_ONE = 0.999
# Radians: linearised residuals are trusted for turns smaller than this; their second order is added to the bound.
SMALL_TURN = 0.3
# A residual whose weight is below this part of the heaviest one's is left out of a normal matrix.
LIGHT = 1e-9
# Room along a model feature (metres), and the squared residuals that others are compared with, are at least these.
LEAST_ROOM, LEAST_SQUARE = 1e-9, 1e-12
# Rounding allowed where a pairing is at its tolerance, as a part of it.
AT_TOLERANCE = 1e-9

# -- minimal infeasible subsets --------------------------------------------------------------------------------------

# The heaviest pairings are tried first: one more at a time up to FEW, then SEVERAL_MORE at a time up to MANY, then all.
FEW, MANY, SEVERAL_MORE = 8, 24, 4
# A subset of at most so many pairings is made minimal; a larger one is used as it is.
MADE_MINIMAL = 12
