"""Numbers of the geometry of lines: resolutions of the look-up tables, and what counts as parallel, touching or equal.

Lengths in metres, angles in radians. None of them is fitted to data: tolerances of features come with the data.
"""

from __future__ import annotations

import math

from msgs_py.numeric.settings import NOT_ZERO as NOT_ZERO

# -- rounding --------------------------------------------------------------------------------------------------------

# Metres or radians: what rounding may do to a quantity of some metres in double precision, with room to spare. Bounds
# that must not refuse a true pairing are widened by it.
ROUNDING = 1e-9
# Shorter edges have no direction, and points that are closer have none between them.
SMALLEST_LENGTH = ROUNDING
# Variance of what is anywhere within one unit: of rounding to whole grey levels, and of a pixel's own width.
UNIFORM_VARIANCE = 1.0 / 12.0
# Radians: standard deviation of an angle of which nothing is known. [D] uniform within a turn
UNIFORM_ANGLE = math.tau * math.sqrt(UNIFORM_VARIANCE)

# -- parallel lines --------------------------------------------------------------------------------------------------

# Sine of the angle (10 degrees) below which a pair of lines is not used to fix a pose: the feet of the common
# perpendicular are uncertain by 1 / sine times the uncertainty of the lines.
PARALLEL_SINE = 0.17
# Sine below which the common normal of two model lines is not defined, and with it the constraint direction3.
NO_NORMAL_SINE = 1e-6
# Below it two model lines also count as parallel, so that their distance is the same everywhere. The relation of a pair
# holds for all larger ones; this only keeps its division by the sine finite.
EXACTLY_PARALLEL_SINE = NO_NORMAL_SINE
# Radians: half cone angles of directions count as this at most, so that their sine and tangent stay usable as scales.
WIDEST_CONE = 1.2

# -- the table of a model's pairs ------------------------------------------------------------------------------------

# Cells of the table in the angle between two lines, and in their signed distance.
ANGLE_CELLS = 36
OFFSET_CELLS = 64
# Radians beyond a right angle that the table's axis of angles reaches: noise may turn a pair that far, where the other
# line counts as reversed. It is also the most that the uncertainty of an angle counts.
FLIP_MARGIN = 0.27
RIGHT_ANGLE = math.pi / 2
# Radians: end of the table's axis of angles.
MAX_ANGLE = RIGHT_ANGLE + FLIP_MARGIN

# -- the table of what passes where ----------------------------------------------------------------------------------

# Layers of distance in which a cell of a voxel grid lists the features that pass near it: data that is accurate is only
# compared with the near ones. More of them save no more time.
NEAR_LAYERS = 8

# -- ranking data pairs ----------------------------------------------------------------------------------------------

# In model sizes: the length that a curve's normal, which has none, counts as; and the gap that is added to every gap
# between two features, so that touching features are ranked by length and angle.
SHORTEST = 0.05

# -- counting hypotheses ---------------------------------------------------------------------------------------------

# Data pairs that are looked at, and of these those near enough to be of one object: either is enough. The number of
# their hypotheses is then known to a third, the evidence that is needed to half a nat or so.
TRIED_PAIRS, COUNTED_PAIRS = 20000, 100

# -- the weighted fit ------------------------------------------------------------------------------------------------

# Steps of the fit, and the gain in the sum of squares below which one was the last: a thousandth of a sigma. [D]
MOST_STEPS, CONVERGED = 12, 1e-6
