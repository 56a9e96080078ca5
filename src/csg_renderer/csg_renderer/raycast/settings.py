"""Every threshold and default of the room raycast, with its unit, its meaning and where it comes from.

Lengths along a ray are multiples of its direction's length; a camera ray (x, y, 1) has its depth in metres there.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import FloatArray

# -- rounding ---------------------------------------------------------------------------------------------------------

# A boundary that never comes: the end of a ray in a half-space, the extent of an unbounded primitive. Metres, or
# lengths along a ray. Far beyond any scene and finite, so that no arithmetic on it gives NaN.
FAR = 1e30
# Boundaries beyond this are no places: the end of what never ends is not drawn. Half of FAR, because differences with
# places of the scene change FAR by rounding only.
NEVER = 0.5 * FAR
# A ray whose local direction has a component below this fraction of its possible size is parallel to the faces across
# that axis; a local origin this close to a whole number is on it, because the unit frames have their faces there.
# Some hundred times the rounding of double precision (1.1e-16) in a transform.
PARALLEL = 1e-13
# The component that such a direction gets instead of 0: a ray in a face plane drifts in the positive direction. It is
# also the divisor in place of 0. Its reciprocal is still a finite number in double precision.
TINY = 1e-300
# The same for REALs of the array machine shorter than 8 bytes.
SHORT_WORD_TINY = 1e-30
# Square of the radius, in the unit frame, within which a point of a cone has the viewing direction for its normal:
# there the gradient of the cone vanishes and its direction is rounding.
APEX = 1e-18
# Surfaces closer together along a ray than this fraction of the scene's extent are one surface. Rounding leaves
# coincident faces some 1e-15 apart, more where a ray grazes them; nothing real is that thin.
COINCIDENT = 1e-10
# Secondary rays ignore what lies nearer to their origin than this fraction of the scene's extent: the surface that
# they leave.
DEPARTURE = 1e-7
# The departure of REALs shorter than 8 bytes is at least this many tolerances.
DEPARTURE_TOLERANCES = 4.0
# REALs shorter than 8 bytes leave coincident faces this many roundings (2^-mantissa) of the scene's extent apart.
SHORT_WORD_ROUNDINGS = 16.0
# With them a direction is parallel to a face within this many roundings.
SHORT_WORD_PARALLEL_ROUNDINGS = 4.0

# -- bounds of primitives ---------------------------------------------------------------------------------------------

# Bounding boxes are larger than their corners by this, metres, and by this fraction of the largest coordinate.
BOX_SLACK = 1e-9
# Squared radii of bounding spheres are larger by this factor, for rounding.
SPHERE_SLACK = 1.01
# The range of heights of a terrain is larger by this, metres, and by this fraction of its limits, for rounding.
HEIGHT_SLACK = 1e-9
# Depth of the clipping plane of outlines, metres, in a scene of no extent; in others it is the departure.
LEAST_CLIP_DEPTH = 1e-9
# Pixels by which a row's span of a primitive is widened: half a pixel for the samples of anti-aliasing, the rest for
# rounding.
SPAN_MARGIN = 0.51
# Pixels by which the rectangle about a primitive is widened, for the same two reasons.
RECTANGLE_MARGIN = 1.0

# -- effort -----------------------------------------------------------------------------------------------------------

# A tree is evaluated as a union of products when it has at most this many, of at most this many leaves each; else with
# lists of boundaries along each ray. The limits bound memory and time of the conversion.
MOST_PRODUCTS = 32
MOST_FACTORS = 4096
# Longest row of pixels that is worked on at once. Every part of the scratch memory of a row has this length.
LONGEST_ROW = 256
# Boundary pixels of a row that are anti-aliased at once, nine samples each in three rows of rays.
MOST_BOUNDARY_PIXELS = 64
# Into how many parts for each thread the tiles of a view are divided when several views are rendered: a thread that
# is ready early takes one more.
PARTS_PER_THREAD = 2
# An image has at least this many rows for each thread.
LEAST_ROWS_PER_THREAD = 8
# How many frames' memory is kept to be used again.
MOST_FRAME_BUFFERS = 6
# Whole exponents below this are raised by repeated squaring (measured on rendered views, no command kept: ten times as
# fast as the general power).
MOST_SQUARED_EXPONENT = 4096.0
# Added to the code of a hit when products cannot decide whose face it is. Codes are whole numbers, and it is added a
# few times at most, so that the sum stays below the next code; a power of 2, so that it is exact.
AMBIGUOUS = 1.0 / 1024.0

# -- anti-aliasing ----------------------------------------------------------------------------------------------------

# Weights of the nine samples of a pixel where faces meet, and their places in the pixel, pixels (thesis 4.6, after
# Crow 1981).
CROW_WEIGHTS: FloatArray = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 16.0
CROW_OFFSETS = (-1.0 / 3.0, 0.0, 1.0 / 3.0)

# -- what a caller may ask for ----------------------------------------------------------------------------------------

# Smallest and largest value of each whole-number option of RenderOptions. Tiles are no wider than LONGEST_ROW.
OPTION_LIMITS = {'tile_size': (4, LONGEST_ROW), 'levels': (1, 64), 'antialias': (0, 16), 'threads': (0, 64)}
# The camera when neither the caller nor the scene file names one: pixels a side, and the focal length in pixels at
# that size, which makes a field of view of 40 degrees.
DEFAULT_SIZE = 512
DEFAULT_FOCAL = 703.0
# Distance : baseline when nobody names a baseline (thesis: about 5 : 1).
DEFAULT_BASELINE_RATIO = 5.0

# -- pictures ---------------------------------------------------------------------------------------------------------

# Weights of red, green and blue in a grey value: ITU-R BT.601, which cv_bridge and OpenCV use too.
LUMA: FloatArray = np.array([0.299, 0.587, 0.114])
# Grey values of 255 from the nearest to the farthest point of a picture of depths.
DEPTH_GREY_RANGE = 200.0
# The least range of depths that a picture of depths spreads over, metres: a plane across the view has none.
LEAST_DEPTH_RANGE = 1e-12
# Step around the colour circle from one id to the next, turns: the golden ratio keeps neighbouring ids apart.
HUE_STEP = 0.61803398875

# Side of the square of pixels whose rays the reference engine follows at once where there are no tiles: of so many, a
# kilobyte each, a step takes a few milliseconds, and a rendering is ended within one.
AT_ONCE = 128
