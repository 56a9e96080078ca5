"""Numbers of the geometry of lines: resolutions of the look-up tables, and what counts as parallel, touching or equal.

Lengths in metres, angles in radians. None of them is fitted to data: tolerances of features come with the data.
"""

from __future__ import annotations

import math

# -- rounding --------------------------------------------------------------------------------------------------------

# Metres or radians: what rounding may do to a quantity of some metres in double precision, with room to spare. Bounds
# that must not refuse a true pairing are widened by it.
ROUNDING = 1e-9
# Metres: shorter edges have no direction, and points that are closer have none between them.
SMALLEST_LENGTH = 1e-9
# Lengths, squares of sines and sums of weights are divided by at least this.
NOT_ZERO = 1e-12
# Added to the diagonal of a 6 x 6 normal matrix, as a part of its trace: a motion that the data leaves free stays zero.
DAMPING = 1e-9
# An eigenvalue of a normal matrix below this part of the largest belongs to a motion that the data leaves free. It is
# larger than DAMPING, so that a damped free motion is still seen to be free.
FREE_EIGENVALUE = 1e-7
# Radians: standard deviation of an angle of which nothing is known. [D] uniform from -pi to pi
UNIFORM_ANGLE = math.pi / math.sqrt(3.0)

# -- parallel lines --------------------------------------------------------------------------------------------------

# Sine of the angle (10 degrees) below which a pair of lines is not used to fix a pose: the feet of the common
# perpendicular are uncertain by 1 / sine times the uncertainty of the lines.
PARALLEL_SINE = 0.17
# Sine below which the common normal of two model lines is not defined, and with it the constraint direction3.
NO_NORMAL_SINE = 1e-6
# Sine below which two model lines count as parallel, so that their distance is the same everywhere. The relation of a
# pair holds for all larger ones; this only keeps its division by the sine finite.
EXACTLY_PARALLEL_SINE = 1e-7
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

# -- ranking data pairs ----------------------------------------------------------------------------------------------

# In model sizes: the length that a curve's normal, which has none, counts as; and the gap between two features that
# is added to every gap, so that touching features are ranked by length and angle.
NORMAL_LENGTH = 0.1
LEAST_GAP = 0.05

# -- counting hypotheses ---------------------------------------------------------------------------------------------

# Data pairs that are looked at, of these those near enough to be of one object, and the hypotheses of these; of the
# last two either is enough. Their number is then known to a third, the evidence that is needed to half a nat or so.
TRIED_PAIRS, COUNTED_PAIRS, ENOUGH_HITS = 20000, 100, 4000

# -- back-projection -------------------------------------------------------------------------------------------------

# Weight of the mean quality of fit, in [0, 1], in a score whose whole part is the number of distinct model features: it
# is below 1, so that one feature more always counts more.
QUALITY_WEIGHT = 0.9

# -- the weighted fit ------------------------------------------------------------------------------------------------

# Squared residuals of a line and of a curve in sigmas beyond which it counts as an outlier: one in a thousand of chi
# squared of four and of five degrees of freedom. [D]
OUTLYING_LINE, OUTLYING_CURVE = 18.47, 20.52
# Steps of the fit, the first of them with Huber's weights, and the gain in the sum of squares below which one was the
# last: a thousandth of a sigma. [D]
MOST_STEPS, HUBER_STEPS, CONVERGED = 12, 3, 1e-6
