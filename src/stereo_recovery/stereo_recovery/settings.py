"""Numbers at the root of the package: symbol, unit, meaning, source; each room has settings of its own."""

from __future__ import annotations

# -- pipeline ----------------------------------------------------------------------------------------------------------

# Largest disparity that is looked for unless a parameter limits it, as a share of the image's width: at more, less than
# a tenth of either image shows what both see.
MOST_DISPARITY_SHARE = 0.9
# Matches of the exchanged images from which the two are taken to be swapped; fewer may be chance.
SWAPPED_MATCHES = 3
# Share of a left picture's segments, by length, that have a match when both cameras see; at less other pairs of a rig
# are tried as well, and the one with most is the main pair. [P] Of the pairs of bench_real.py and bench_photoreal.py at
# least 0.54; of the left picture of one and the right picture of the next at most 0.45.
MATCHED_SHARE = 0.45

# What a rig's columns are off by, over what its rows disagree by. [P] median over the pairs of bench_real.py is 1.4;
# with 2, 95 % of ends lie within the bounds that hold 99.7 % of normal errors
COLUMNS_OVER_ROWS = 2.0

# Shares of the time limit after which no second labelling begins, nor the look into a further camera; no search for
# another curve; no further estimate of straight edges. The rest is for what comes then.
LABELLING_SHARE, CURVES_SHARE, EDGES_SHARE = 0.4, 0.6, 0.8

# -- tone --------------------------------------------------------------------------------------------------------------

# Places along a segment where the grey levels beside it are looked up; and how far beside, sigmas of its blur:
# there light is within a hundredth of a step's contrast of its level. [D]
TONE_SAMPLES, STEP_ENDS = 8, 2.5
# px: farthest that a tone curve shows two edges of one line beside each other. [D] Two shifts of edges of black, at a
# blur of 1.3 px.
REVERSED_APART = 2.0
# px, sigma by which edges on one line lie beside each other; share of those that only seem to be on one. [R]
OUT_OF_LINE_SIGMA, OUT_OF_LINE = 0.1, 0.15
# Sigma of the share of a coded picture's shift that is believed beforehand: none to all of it; and nats from which
# there is some: twenty to one. [D]
SHARE_SIGMA, CODED_LOG_ODDS = 0.5, 3.0
# Sigma of that share about all of it where noise says that light is coded: of the blur that is told. [D]
CODED_SHARE_SIGMA = 0.2

# px: side of the tiles whose noise is told. [D] One value of a variance is told to a fifth by 64 pixels.
PLAIN_TILE = 8
# Tiles that are enough, bins of grey levels whose noise is told, and the fewest tiles of one. [D]
MOST_TILES, TONE_LEVELS, FEWEST_TILES = 5000, 16, 30
# Rank of the tiles of a level whose noise is that of the level; the rest has texture. [R]
PLAINEST = 0.1
# Sigma by which the logarithm of the noise of a level is told; share of levels that have texture everywhere; and mean
# of its logarithm over that of noise. [P] calibrate_noise_levels.py
NOISE_TOLD_SIGMA, TEXTURED_SHARE, MEAN_TEXTURE = 0.05, 0.3, 0.2

# -- drawing -----------------------------------------------------------------------------------------------------------

# Sub-pixel bits of OpenCV's drawing functions; pixels: what is farther out is drawn there, so that no coordinate
# overflows.
SUB_PIXEL_BITS, FARTHEST_DRAWN = 4, 1e4
# The image behind the features keeps this share of its brightness.
DARKENED = 0.6
# Straight features are drawn in so many parts, each in the colour of its depth.
PARTS = 16
# Quantiles of depth that get the first and the last colour of the scale.
DEPTH_QUANTILES = (0.02, 0.98)
# Factor of OpenCV's font in the scale of depths.
LEGEND_FONT = 0.4

# -- files -------------------------------------------------------------------------------------------------------------

# Endings of files that are pictures, by which a file in the wrong place of a command is named.
PICTURES = ('.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.pgm', '.ppm', '.webp')
# Pixels. An image without edges is looked at smaller and smaller, down to this side: what fills it can be no more than
# a few edges.
LEAST_SIDE = 32
# Pairs whose word on the drift of the rig is kept, and the time from one to the next, seconds: those between show the
# same scene and say the same.
RIG_PAIRS, RIG_PERIOD_S = 30, 1.0

# -- measuring a camera ------------------------------------------------------------------------------------------------

# Grey level at which noise is stated; share of the variance there below which its error has to be for gain and read
# noise to be told apart.
MIDDLE_GREY, TOLD_APART = 127.5, 0.25
# px: shift between two pictures that is more than noise makes of a picture with edges.
MEASURED_SHIFT = 0.05
# Rows and columns, in the upper left 2 x 2, of the green pixels of mosaics (sensor_msgs/image_encodings).
GREEN_PIXELS = {'rggb': ((0, 1), (1, 0)), 'bggr': ((0, 1), (1, 0)), 'gbrg': ((0, 0), (1, 1)), 'grbg': ((0, 0), (1, 1))}
# Edges whose profile is fitted: px, at least EDGE_LENGTH long within what is looked at, on EDGE_REACH to either side;
# bent by at most EDGE_SAGITTA, and slanted so far that they cross EDGE_PHASES rows or columns; the strongest MOST_EDGES
# of them, and at least FEWEST_EDGES.
EDGE_LENGTH, EDGE_REACH, EDGE_SAGITTA, EDGE_PHASES, MOST_EDGES, FEWEST_EDGES = 12.0, 6.0, 0.3, 1.0, 60, 3
# Least step: grey levels, and in sigmas of a pixel. What a fitted profile may leave besides noise, share of the step.
EDGE_CONTRAST, EDGE_CONTRAST_NOISE, PROFILE_ERROR = 20.0, 8.0, 0.02
# px: least blur that a profile is fitted with; nodes along each side of a pixel at which the profile is averaged.
LEAST_PSF, PIXEL_NODES = 0.02, 4
