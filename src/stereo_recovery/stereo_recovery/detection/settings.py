"""Thresholds of detection in one image: symbol, unit, meaning, source.

Sources: [D] derived as stated; [M] measured by the command named; [R] chosen on rendered views with
``test/benchmarks/bench_lines.py`` and ``bench_curves.py``, no command kept. Lengths are pixels (px) of the image,
sigma is one standard deviation. Compiled loops take these numbers when they are compiled; the cache of machine code
follows a change.
"""

from __future__ import annotations

import numpy as np

# -- several modules ---------------------------------------------------------------------------------------------------

# px: two curves within this distance of each other count as one line. [R]
ON_LINE = 1.0
# Cosine of the largest turn between consecutive edgels or joined segments: 60 degrees. [R]
TURN_COSINE = 0.5
# px: segments shorter than this have too vague a direction to decide about others. [R]
DIRECTED_LENGTH = 10.0
# Instead of 0 where a number of any size may divide. [D] nearly the smallest number that a float can hold
SMALLEST = 1e-300
# Least number of edgels in a chain, and in a part of one that is split. [R]
LEAST_EDGELS = 4
# px at each end of a segment that are left out of a fit, because smoothing pulls edgels beside a corner towards it, and
# the share of the segment's length that is left out at most. [R] Smoothing reaches about 3 sigma_total, sigma_total =
# 1.
CORNER_TRIM, CORNER_TRIM_SHARE = 3.0, 0.2

# -- sampling ----------------------------------------------------------------------------------------------------------

# px: bilinear interpolation needs the next pixel, so that the last position in a row or column is its length less this.
# [D] one pixel, and a little for rounding
LAST_POSITION = 1.001

# -- edgels ------------------------------------------------------------------------------------------------------------

# px: smaller images have no edgels, since two pixels on each side of an edgel are needed. [D]
SMALLEST_IMAGE = 5
# Grey levels of a 16-bit image over those of an 8-bit one. [D]
SIXTEEN_BIT_SCALE = 1.0 / 256.0
# Root of the sum of squares of the nine coefficients that measure noise, (1, -2, 1) by (1, -2, 1). [D]
KERNEL_NORM = 6.0
# sigma_e = sqrt(POSITION_FACTOR) (noise / contrast) (S / s)^3 of an edgel's position, see :func:`.edgels.detect`. [D]
POSITION_FACTOR = 3.0 / 8.0
# Radius of the sampled Gaussian in its sigmas; 6e-5 of the area lies beyond. [D]
KERNEL_RADIUS = 4.0
# px^2: variance that a camera's aperture (unit box, 1/12) and a sharp lens (0.5 px) add to the smoothing. Used where
# the picture cannot show it. [D]
CAMERA_BLUR_VARIANCE = 1.0 / 12.0 + 0.25
# Grey levels: least noise that is assumed; rounding to 8 bits has sigma 1/sqrt(12). [D]
QUANTISATION_NOISE = 0.3
# Grey level: full white. [D]
WHITE = 255.0
# px: position error that remains without noise, from sampling and uneven shading. [R]
POSITION_FLOOR = 0.015
# px: the same in pictures with one sample a pixel. [R] Such a picture is one whose steps have less variance beyond the
# smoothing than ALIASED_BLUR_VARIANCE, px^2: half of what the pixel's own area (1/12) blurs. [D]
ALIASED_POSITION_FLOOR = 0.13
ALIASED_BLUR_VARIANCE = 1.0 / 24.0
# Distance from an edgel, in widths of the blurred step, at which the gradient on its two flanks is looked up. [R]
FLANK_DISTANCE = 2.0
# Share of it at which the gradient on the way there is looked up. [R]
HALF_WAY = 0.65
# Difference of the two flanks' gradients, in sigma of the gradient, that noise explains. [R]
FLANK_NOISE = 2.5
# An edgel's prominence: by how many sigma its gradient exceeds that of both flanks, at least. [R] Chains decide; this
# keeps what is no maximum from linking.
PROMINENCE = 1.0
# Least curvature, per px^2, of the logarithm of the gradient across an edge: a step wider than 32 px is none. [D]
LEAST_CURVATURE = 1e-3
# A share of the squared threshold that is added to the squared gradient before its logarithm is taken. [R]
LOGARITHM_FLOOR = 1e-4
# Least share of the pixel's squared gradient that the interpolated gradient at the sub-pixel position has. [R]
LEAST_INTERPOLATED = 0.25

# Least magnitude of an edgel, in sigma of the derivatives' noise. [M] In noise alone one pixel in twenty is an edgel
# then; more would cost time, fewer would break faint edges. An edgel is clear when its direction has a sigma below
# CLEAR, radians: a seventh.
WEAKEST, CLEAR = 2.25, 1.0 / 7.0

# -- noise -------------------------------------------------------------------------------------------------------------

# px: side of the tiles in which noise is measured, and the distance of samples in them. [R]
NOISE_TILE, NOISE_STEP = 16, 4
# px: distance of the two places whose gradients are compared. [M] Noise that a Gaussian of a pixel has smoothed no
# longer agrees there (src/stereo_recovery/test/test_noise.py).
ALONG_EDGE = 5.0
# The quantile of their differences in a tile that counts [R], and its value for normal noise of sigma 1 [D].
NOISE_RANK, NOISE_RANK_SIGMA = 0.75, 1.1503

# -- border ------------------------------------------------------------------------------------------------------------

# A border that a rectification left empty is at most this share of the picture deep, and leans at most this much
# against its side, px/px, along the middle half. [R] Cameras turned by ten degrees against each other stay within.
DEEPEST_BORDER, STEEPEST_BORDER = 0.25, 0.25

# -- chains ------------------------------------------------------------------------------------------------------------

# A segment is an edge when the prominences of consecutive edgels, in sigma of the noise, exceed NOISE_MAXIMUM by
# SEGMENT_EXCESS in sum somewhere; a chain may have some when they do by CANDIDATE_EXCESS. [M] In a megapixel of noise
# one segment reaches 8, whether neighbouring pixels agree or not (src/stereo_recovery/test/test_chains.py).
NOISE_MAXIMUM, SEGMENT_EXCESS, CANDIDATE_EXCESS = 2.4, 10.0, 1.0
# px: an edgel of a coarser scale shows nothing new this near to one of the finer scale, along rows and columns. A
# doubtful chain goes when more than this share of it is as near to a clear one of the coarser scale. [R]
BESIDE_FINER, MOST_COVERED = 3, 0.5
# px, along rows and columns: farthest step from edgel to edgel. [D] One pixel may be missing.
LINK_RADIUS = 2
# px: least advance along the tangent. [R]
LEAST_ADVANCE = 0.05
# px: most that a step leaves the tangents of its two edgels, plus this share of its advance. [R]
SIDESTEP, SIDESTEP_SHARE = 1.2, 0.3
# Cost of a px beside the tangents over that of a px along them. [R]
SIDESTEP_COST = 2.0

# -- growing -----------------------------------------------------------------------------------------------------------

# Share of a segment's usual contrast that is looked for beyond its ends. [R] Shading changes it along an edge.
GROWN_SHARE = 0.5
# Contrast, in sigma of the gradient's noise, that chains do not lose: edgels have WEAKEST, to three sigma. [D] Where a
# segment would show more beyond its end, it has ended.
CHAINED = WEAKEST + 3.0
# Variance of the gradient less the mean of that on both flanks, over that of the gradient. [D] 1 + 2 / 4
FLANKED_VARIANCE = 1.5
# px^2: variance across a line to which it is followed. [D] Half a px beside its middle a step has nine tenths of its
# slope.
FOLLOWED_VARIANCE = 0.25
# Sine of the angle between a line and one that it runs into and that goes on with it. [R]
RUNS_INTO_SINE = 0.2
# So often segments are fitted again and followed farther. [R] bounds the time
GROWING_ROUNDS = 2

# -- splitting ---------------------------------------------------------------------------------------------------------

# Variance of an edgel's offset from the mean of two others, over that of one edgel. [D] 1 + 1/2
VARIANCE_OF_OFFSET = 1.5
# An edgel may stand off its line by this many of its own sigma. [R]
LINE_GATE = 4.5
# Localisation noise, px: least value, value where too few edgels tell, and how few these are. [R]
LEAST_LOCALISATION_NOISE, USUAL_LOCALISATION_NOISE, FEW_EDGELS = 0.01, 0.03, 16
# Edgels beside a break that are left out when it is moved to where the two lines cross, and how far it moves, edgels;
# segments of fewer than SHORTEST_MOVED edgels keep their break. [R]
BREAK_MARGIN, BREAK_RANGE, SHORTEST_MOVED = 3, 8, 6
# px: widest gap across which collinear segments are joined, and the widest overlap. [R]
WIDEST_GAP, WIDEST_OVERLAP = 15.0, 3.0
# The gap is at most this share of the two segments' common length. [R]
WIDEST_GAP_SHARE = 0.5
# Radians: largest angle between joined segments. [R]
LARGEST_BEND = np.radians(6.0)
# px: shortest segment that is joined with another. [R]
SHORTEST_JOINED = 4.0
# Offset of real edges from a straight line, as a share of the tolerance of splitting. [R]
STRAIGHTNESS_SHARE = 0.4
# Cost of a px of offset between joined segments over that of a px of gap. [R]
OFFSET_COST = 5.0
# Tolerances by which an end of a joined segment may stand off the common line; segments shorter than SHORT_PART, px,
# are exempt, since their ends are too vague. [R]
BENT_TOLERANCES, SHORT_PART = 3.0, 8.0
# Rounds of joining: what the first joins may continue with a third. [R]
JOINING_ROUNDS = 2

# -- segments ----------------------------------------------------------------------------------------------------------

# px per px of smoothing: length along an edge over which edgels' errors are one. [D] Smoothing correlates them over
# sqrt(4 pi) sigma; [M] three quarters of that gives lines whose stated sigma is true (src/stereo_recovery/test/
# test_bounds.py).
CORRELATION_LENGTH = 0.75 * np.sqrt(4.0 * np.pi)
# Edgels of a segment of which a median is taken, at least where there are as many; neighbours agree. [R]
MEDIAN_SAMPLES = 24
# Edgels a px along an edge, at most. [D] sqrt(2) on a diagonal, rounded up.
MOST_DENSE = 1.5
# Cauchy weights fall to a half at this many scales of the residual (2.385 has 95 % efficiency on normal noise; Huber
# 1981); the least scale, px. [R]
CAUCHY, LEAST_SCALE = 2.5, 0.02
# Sagitta that noise alone gives a straight line, in sigma of the line's offset. [D] 3.35 (3/2 of the sigma of the
# second Legendre coefficient), rounded up.
NOISE_SAGITTA = 4.0
# Sigma that a sagitta adds to its line: to the offset, as a share; to the slope, as a multiple of sagitta/length. [R]
SAGITTA_OFFSET, SAGITTA_SLOPE = 0.3, 2.0
# The median step width of a segment is unusual when it differs from the picture's by more than this share, and by more
# than this many times the median difference; segments of fewer edgels, and pictures where the median difference exceeds
# VARIED_WIDTH (out of focus, uneven light), say nothing. [R]
UNUSUAL_WIDTH, WIDTH_DEVIATIONS, WIDTH_EDGELS, VARIED_WIDTH = 0.05, 3.0, 10, 0.05
# px: sigma of the offset of a segment whose width is unusual, over the root of the excess. [R]
WIDTH_SIGMA = 1.0
# Sigma of a line whose edgels have a localisation bias: this share of the median bias beyond LEAST_BIAS, px, and at
# most MOST_BIAS_SIGMA, px. [R] Less bias is noise; with more the other edge is a segment of its own.
BIAS_SHARE, LEAST_BIAS, MOST_BIAS_SIGMA = 0.5, 0.05, 0.7
# Sine: segments flatter than this may run either way along the rows of the two images. [R]
LEVEL_SINE = 0.1

# -- junctions ---------------------------------------------------------------------------------------------------------

# px: largest gap between a segment's end and the line that it meets. [R]
JUNCTION_GAP = 18.0
# px: the gap at a square corner; it grows with 1 / sine, because two edges blur into one before a sharp corner. [R]
SQUARE_GAP = 4.0
# px: how far a chain may run around a corner before it ends, and the share of its length; SURE_OVERRUN, px: a neighbour
# that goes on this far beyond a junction makes it a T-junction. [R]
OVERRUN, OVERRUN_SHARE, SURE_OVERRUN = 4.0, 0.4, 6.0
# Sine of two lines that meet: below CORNER_SINE the crossing is too vague, unless it is above BLUNT_SINE, both chains
# end within BLUNT_GAP, px, and the crossing has a sigma below BLUNT_SIGMA, px. [R]
CORNER_SINE, BLUNT_SINE, BLUNT_GAP, BLUNT_SIGMA = 0.15, 0.06, 6.0, 3.0
# px: a neighbour costs as much as a gap of this over its length, so that long neighbours are preferred. [R]
SHORT_NEIGHBOUR_COST = 20.0
# px^2: variance of a junction beyond that of its two lines. [R]
ROUNDED_VARIANCE = 0.0001
# px: sigma of an end without a junction. [R]
LOOSE_END_SIGMA = 1.5
# Another segment continues a line beyond a junction when the sine between them is below COLLINEAR_SINE (at a crossing
# of two lines that both go on: CROSSING_SINE), the junction is within ON_CONTINUATION, px, of its line, and it has at
# least SHORTEST_CONTINUATION, px. [R]
COLLINEAR_SINE, CROSSING_SINE, ON_CONTINUATION, SHORTEST_CONTINUATION = 0.03, 0.2, 1.5, 5.0
# A chain is lost beside another one within MERGED_DISTANCE, px, that runs along with it (cosine above MERGED_COSINE);
# its line passes the junction of the other within AT_JUNCTION, px, plus two sigma, and at most twice that. [R]
MERGED_DISTANCE, MERGED_COSINE, AT_JUNCTION = 5.0, 0.94, 0.7
# A short segment is spurious when it is at most SPURIOUS_LENGTH long, px, when a segment of at least SPURIOUS_RATIO
# times its length has a direction within SPURIOUS_COSINE of its own, and when both its ends are within SPURIOUS_WIDTH,
# px, of that one's line and at most SPURIOUS_OVERHANG, px, beyond it. Segments below LEAST_LENGTH, px, always are: they
# have no usable direction. [R]
SPURIOUS_LENGTH, SPURIOUS_RATIO, SPURIOUS_COSINE = 16.0, 2.0, 0.8
SPURIOUS_WIDTH, SPURIOUS_OVERHANG, LEAST_LENGTH = 2.5, 16.0, 3.0

# -- conics ------------------------------------------------------------------------------------------------------------

# Radians: least turn of an arc in all, and the largest from segment to segment. [R]
LEAST_TURN, SHARPEST_BREAK = np.radians(20.0), np.radians(65.0)
# px: smallest semi-axis; edgels: shortest arc; breaks between the segments of the longest arc. [R]
LEAST_RADIUS, SHORTEST_ARC, MOST_ARC_BREAKS = 1.5, 14, 40
# Rounds of fits of an ellipse: to about FEW_POINTS of an arc's edgels, which spares most others, and to all. [R]
FEW_POINTS, FIRST_ROUNDS, FINAL_ROUNDS = 30, 2, 4
# Of an ellipse in the image. [D]
ELLIPSE_PARAMETERS = 5
# An ellipse's major radius is at most this many times the extent of its edgels. [R]
LARGEST_RADIUS_RATIO = 4.0
# Numerical floors of the fit: pivot; discriminant 4 a c - b^2 of an ellipse; weight, as a share of the mean. [R]
LEAST_PIVOT, LEAST_DISCRIMINANT, LEAST_WEIGHT_SHARE = 1e-13, 1e-9, 1e-3

# -- a view ------------------------------------------------------------------------------------------------------------

# Scales of detection: the picture, and the picture halved, in which noise is half as strong and steps are not. [R]
SCALES = 2
# Segments that are matched, the longest first. [R] An image of a room has a thousand; time grows with the square.
MOST_SEGMENTS = 6000
# Tolerance of straight segments: this many times the localisation noise, within limits, px. [R]
TOLERANCE_NOISE, LEAST_TOLERANCE, MOST_TOLERANCE = 6.0, 0.2, 0.5
