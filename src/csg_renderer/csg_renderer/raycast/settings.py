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
# Digits to which the axes of two leaves are the same, so that their boxes may lie along both: rounding in a scene's
# transforms leaves far more.
AXES_DIGITS = 6
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
# Rays of a batch of secondary rays that are bounded together: the fewer, the closer they lie, and the more bounds there
# are to compare (with 16 the table of test/benchmarks/bench_renderer.py takes a tenth longer).
PACKET = 32
# Columns of the blocks of pixels in which visible places follow each other in a batch: with the rows of a batch about
# as many as make a packet that is as high as wide.
BLOCK_COLUMNS = 4
# Into how many parts for each thread the tiles of a view are divided when several views are rendered: a thread that
# is ready early takes one more.
PARTS_PER_THREAD = 2
# An image has at least this many rows for each thread.
LEAST_ROWS_PER_THREAD = 8
# How many frames' memory is kept to be used again.
MOST_FRAME_BUFFERS = 6
# Of how many raw cameras the rays are kept: 16 bytes a pixel, and a second to compute for a million.
MOST_RAW_CAMERAS = 4
# Samples of an ideal picture, for each that a raw one needs, up to which they cost less than single rays; both were
# measured on the L-shape: 0.02 and 3 microseconds of a core.
MOST_IDEAL_SAMPLES = 64
# Samples of an ideal picture that are rendered at once, 43 bytes each; rays of a raw one that are computed at once, in
# a fifth of a second.
STRIP_SAMPLES, BAND_RAYS = 2**20, 2**17
# Pixels of a finer picture, sigma of the lens' blur in it, and how many times finer it is at most: an edge anywhere in
# such pixels is then found to a thousandth of one of the picture, and what a blur is less than that the pixel hides.
FINE_PSF, MOST_FINER = 2.0, 8
# Whole exponents below this are raised by repeated squaring (measured on rendered views, no command kept: ten times as
# fast as the general power).
MOST_SQUARED_EXPONENT = 4096.0
# Added to the code of a hit when products cannot decide whose face it is. Codes are whole numbers, and it is added a
# few times at most, so that the sum stays below the next code; a power of 2, so that it is exact.
AMBIGUOUS = 1.0 / 1024.0

# -- anti-aliasing ----------------------------------------------------------------------------------------------------

# The samples of a pixel are taken as its centre where they cannot differ (kernels/differences.py). An outline that is
# this many pixels behind what is seen, along the ray, is hidden all over the pixel: surfaces may be as steep as one in
# so many.
HIDDEN_GAP_PIXELS = 8.0
# The most by which the mean colour of samples differs from what stands for them, of 1: half a grey level.
MOST_CURVED = 0.5 / 255.0
# The least sigma of a highlight that centres of pixels do not miss, pixels: half-way between them e^-1.5 of it is left.
NARROWEST = 0.4
# Corners of the polygon in place of a circle in an outline: as many as leave it within so many pixels, between these.
LEAST_CORNERS, MOST_CORNERS, ROUND_ERROR = 12, 128, 0.05
# Weights of the nine samples of a pixel where faces meet, and their places in the pixel, pixels (thesis 4.6, after
# Crow 1981).
CROW_WEIGHTS: FloatArray = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 16.0
CROW_OFFSETS = (-1.0 / 3.0, 0.0, 1.0 / 3.0)
# Multiples of it leave remainders that are spread as evenly as those of any number: the order of samples in a pixel.
GOLDEN = 0.6180339887498949

# -- what a caller may ask for ----------------------------------------------------------------------------------------

# Smallest and largest value of each whole-number option of RenderOptions. Tiles are no wider than LONGEST_ROW.
OPTION_LIMITS = {
    'tile_size': (4, LONGEST_ROW),
    'levels': (1, 64),
    'antialias': (0, 16),
    'threads': (0, 64),
    'samples': (1, 1024),
    'pinholes': (1, 4096),
}
# The camera when neither the caller nor the scene file names one: pixels a side, and the focal length in pixels at
# that size, which makes a field of view of 40 degrees.
DEFAULT_SIZE = 512
DEFAULT_FOCAL = 703.0
# Distance : baseline when nobody names a baseline (thesis: about 5 : 1).
DEFAULT_BASELINE_RATIO = 5.0

# -- pictures ---------------------------------------------------------------------------------------------------------

# Weights of red, green and blue in a grey value: ITU-R BT.601, which cv_bridge and OpenCV use too.
LUMA: FloatArray = np.array([0.299, 0.587, 0.114])
# The grey level of what is white, whatever the number of bits.
WHITE = 255.0
# The channel, of red, green and blue, of the four pixels of each mosaic, row by row (sensor_msgs/image_encodings).
BAYER_CHANNELS = {'rggb': (0, 1, 1, 2), 'bggr': (2, 1, 1, 0), 'gbrg': (1, 2, 0, 1), 'grbg': (1, 0, 2, 1)}
# Smallest and largest value of fields of SensorModel. The largest exposure and gain are 60 dB; beyond 16 bits there is
# no encoding; a lens that loses 99 of 100 in its corners shows none.
SENSOR_RANGES = {
    'vignetting': (0.0, 0.99),
    'exposure': (1e-3, 1e3),
    'gain': (1e-3, 1e3),
    'black_level': (0.0, 254.0),
    'gamma': (0.1, 10.0),
    'bits': (8, 16),
}
# sRGB: a straight line up to the toe, then a power of what is shifted by the offset (IEC 61966-2-1).
SRGB_TOE, SRGB_SLOPE, SRGB_POWER, SRGB_OFFSET = 0.0031308, 12.92, 2.4, 0.055
# Kinds of pictures that have 16 bits.
SIXTEEN_BITS = ('.png', '.tif', '.tiff')
# Grey values of 255 from the nearest to the farthest point of a picture of depths.
DEPTH_GREY_RANGE = 200.0
# The least range of depths that a picture of depths spreads over, metres: a plane across the view has none.
LEAST_DEPTH_RANGE = 1e-12
# Step around the colour circle from one id to the next, turns: the golden ratio keeps neighbouring ids apart.
HUE_STEP = 0.61803398875

# Side of the square of pixels whose rays the reference engine follows at once where there are no tiles: of so many, a
# kilobyte each, a step takes a few milliseconds, and a rendering is ended within one.
AT_ONCE = 128

# -- pictures on surfaces, rough metal, lights with a size -------------------------------------------------------------

# Directions of light that a place of the first surface on a ray samples when the caller names no number.
DEFAULT_SAMPLES = 16
# The least roughness of a metal: below, its highlights of a point of light are narrower than pixels and few rays meet
# them; REFLECT is the mirror.
LEAST_ROUGHNESS = 0.01
# Steps of the table of what rough metal returns, along each axis, and samples of each entry along a side.
ALBEDO_STEPS = 33
ALBEDO_SAMPLES = 32
# Most places at which a picture is looked up along the long axis of a pixel's footprint; beyond it is blurred.
MOST_PROBES = 8
# Fractions of a pixel that tell rays of one pixel apart for their random numbers; a power of 2 well above the samples
# of a pixel and well below rounding.
KEY_STEPS = 1024.0
# Added to whole numbers of such fractions to make them positive.
KEY_OFFSET = float(2**40)
# The steps of the sequence R2 (Roberts 2018): 1 / g and 1 / g^2 of g^3 = g + 1. Its points fill the square evenly
# however many there are.
R2 = (0.7548776662466927, 0.5698402909980532)

# -- aperture and exposure ---------------------------------------------------------------------------------------------

# Points of the lens and moments of the exposure whose pictures are averaged when the caller names no number: a disc of
# ten pixels has about one for each.
DEFAULT_PINHOLES = 64
# Steps of the sequence of Roberts (2018) in five dimensions, powers of 1 / g of g^6 = g + 1: two of the lens, the time,
# and two of the pixel.
PINHOLE_STEPS = tuple(1.1347241384015194**-k for k in range(1, 6))
