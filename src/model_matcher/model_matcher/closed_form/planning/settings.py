"""Numbers of planning, each with its unit and its reason."""

from __future__ import annotations

import numpy as np

# -- what a camera does to a step of grey ------------------------------------------------------------------------------

# Variance of a pixel's own width, pixels^2: a box of one pixel, projected on any direction.
BOX_VARIANCE = 1.0 / 12.0
# Variance of rounding to whole grey levels.
ROUNDING_VARIANCE = 1.0 / 12.0
# Grey levels are read so far to both sides of an edge, pixels, in a picture of point samples: the pixel there is
# beyond the edge however the grid lies.
BESIDE = 1.25
# Grey levels: the least contrast of an edge that tells of anything, a tenth of the step of rounding.
LEAST_CONTRAST = 0.1

# -- the working volume ------------------------------------------------------------------------------------------------

# Ratios of the most evenly spread sequence in three dimensions (Roberts 2018): powers of 1 / 1.2207440846.
SPREAD = (0.8191725133961645, 0.6710436067037893, 0.5497004779019703)
# Azimuths of neighbouring views differ by this share of a turn.
GOLDEN = 0.6180339887498949
# Tries to place several parts beside each other, of which none may stand in another.
PLACINGS = 200

# -- rates -------------------------------------------------------------------------------------------------------------

# Standard deviations to either side of a rate that its interval spans: 95 %.
INTERVAL = 1.959963984540054

# -- predictions -------------------------------------------------------------------------------------------------------

# Pixels, sigmas of what is off in drawn pictures besides noise, as test/benchmarks/bench_planning.py measures it: a
# line in all views (its offset and its slope), and in each besides, because shading is not even beside an edge and
# samples are not dense; the contour of a curved surface, whose shade falls ever faster towards it; and a point on its
# line.
DRAWN_LINE_PX = 0.004
DRAWN_VIEW_PX = 0.0135
DRAWN_CONTOUR_PX = 0.025
DRAWN_POINT_PX = 0.012
# Radians by which the normal of a curve may turn in a piece that is off by one line: a sixth of a turn, along which a
# line and an arc differ by less than the sigmas.
PIECE_TURN = np.pi / 3.0
# Information on what nothing tells, in units of the part's radius: known to about its own size.
FREE = 1.0
# Errors that nineteen of twenty poses stay below.
WORST = 0.95
# Standard normal deviates by which norms of six errors are spread: quantiles of so many are good to 3 %.
SAMPLES = np.random.default_rng(6).standard_normal((1000, 6))

# -- reasons -----------------------------------------------------------------------------------------------------------

# Pixels of a crease or contour in one image without which it is not recovered: the shortest segment that is.
SEEN_CURVE_PX = 12.0
# Curves without which features do not fix a pose: two tell one but for a choice, a third decides.
FEWEST_CURVES = 3
# Of an error ellipsoid: an axis so many times as long as the next is alone to blame.
CLEARLY_WORST = 5.0
# Sine of the angle to the rows under which an edge's disparity is known five times worse than an upright one's.
ALONG_ROWS = 0.2
# What most of a whole is.
MOSTLY = 0.5

# -- judgement ---------------------------------------------------------------------------------------------------------

# An answer farther from a part than this share of its size, or turned by more degrees, is wrong: another pose, and no
# error of this one.
WRONG_SHARE = 0.1
WRONG_TURN_DEG = 6.0
# Solids in a picture without the part and without clutter: else there would be nothing to take for it.
STRANGERS = 3

# -- the page ----------------------------------------------------------------------------------------------------------

# Places of the maps stand so many radii of the part from its middle.
MAP_RADIUS = 2.2
# Rows of the table of failing views; pictures of the worst.
MOST_FAILING = 30
PICTURES = 6
