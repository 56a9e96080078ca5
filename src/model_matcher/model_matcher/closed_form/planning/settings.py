"""Numbers of planning, each with its unit and its reason."""

from __future__ import annotations

import numpy as np

# -- what a camera does to a step of grey ------------------------------------------------------------------------------

# Grey levels are read so far to both sides of an edge, pixels, in a picture of point samples: the pixel there is
# beyond the edge however the grid lies.
BESIDE = 1.25

# -- the working volume ------------------------------------------------------------------------------------------------

# Tries to place several parts beside each other, of which none may stand in another.
PLACINGS = 200

# -- predictions -------------------------------------------------------------------------------------------------------

# Pixels, sigmas of what is off in drawn pictures besides noise, as test/benchmarks/bench_planning.py measures it: a
# line in all views (its offset and its slope); and in each besides, because shading is not even beside an edge and
# samples are not dense, which puts a point off its line by as much; and the contour of a curved surface, whose shade
# falls ever faster towards it.
DRAWN_LINE_PX = 0.002
DRAWN_VIEW_PX = 0.005
DRAWN_CONTOUR_PX = 0.05
# Radians by which the normal of a curve may turn in a piece that is off by one line: a sixth of a turn, along which a
# line and an arc differ by less than the sigmas.
PIECE_TURN = np.pi / 3.0
# Errors that nineteen of twenty poses stay below.
WORST = 0.95
# Standard normal deviates by which norms of six errors are spread: quantiles of so many are good to 3 %.
SAMPLES = np.random.default_rng(6).standard_normal((1000, 6))

# -- reasons -----------------------------------------------------------------------------------------------------------

# Curves without which features do not fix a pose: two tell one but for a choice, a third decides.
FEWEST_CURVES = 3
# Of an error ellipsoid: an axis so many times as long as the next is alone to blame; of an edge near the rows, its
# disparity is known so many times worse than an upright one's.
CLEARLY_WORST = 5.0

# -- the page ----------------------------------------------------------------------------------------------------------

# Places of the maps stand so many radii of the part from its middle.
MAP_RADIUS = 2.2
# Pictures of the worst views.
PICTURES = 6
