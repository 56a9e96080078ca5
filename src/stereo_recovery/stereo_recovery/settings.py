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
