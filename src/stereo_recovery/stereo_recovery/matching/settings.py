"""Numbers of the labelling: probabilities, spreads of densities, and search radii.

[R] says that a value was set by trial on rendered scenes (bench_lines.py --seeds 100..119) and on the pairs of
test/benchmarks/bench_photoreal.py and bench_real.py that are not held out; [D] that it follows from what is said.
"""

from __future__ import annotations

# Probability that what the images show as one is one in space: adjacent segments a surface (less with their distance
# over the support radius), corners, level edges and strips of texture that both show at nearly one height a place, a
# corner that one image shows a corner, the ends of a pair a point, and two edges that continue each other an edge. [R]
SEEN_AS_ONE = 0.8

# -- geometry of a candidate -------------------------------------------------------------------------------------------

# Sine of a segment's slope below which rows say little about its disparity, and ends give it instead. [R]
LEVEL = 0.1
# px: by how much rows of one point may differ in the two images, where a level segment's ends are compared, which two
# segments at least have in common, or half of the shorter; and width of the Cauchy density of that difference. [R]
SAME_ROW, ROW_SCALE = 2.5, 0.4
# Largest disparity gradient along an edge; at 2 its direction would be reversed in one image. [D] Pollard, Mayhew and
# Frisby's limit for surfaces both eyes see is 1; edges seen almost end on exceed it.
STEEPEST = 1.9
# Width of the Cauchy density of the disparity gradient along true edges; along pairs at random it is even on -2..2. [R]
SLANT_SCALE = 0.2
# Probability that an end of a true pair is at one height in both images, to END_HEIGHT px. [R]
END_AGREEMENT, END_HEIGHT = 0.6, 3.0
# Probability that an end of another edge of the same object is at that height too. [R]
LIKE_ENDS = 0.25
# Log likelihood ratio of a level pair whose ends both are in the same rows, and of one end alone. [R]
LEVEL_BOTH, LEVEL_ONE = 0.5, -1.0
# px from the border of the image within which a segment ends because the picture does. [R]
BORDER = 5.0

# -- grey levels beside an edge ----------------------------------------------------------------------------------------

# px: smoothing of the images that grey levels are looked up in, one pixel each; about that of Sobel's difference.
PROFILE_SIGMA = 0.8
# Samples along a segment, and their distances from it, px.
PROFILE_SAMPLES, PROFILE_OFFSETS = 8, (2.0, 3.5, 5.0)
# Shares of edges beside which both sides, one side, and no side show the same surface to both eyes. [R] One: outlines
# before a background; none: outlines of narrow or mirror-like faces.
BOTH_SIDES, ONE_SIDE, NO_SIDE = 0.55, 0.38, 0.07
# Shares of them whose contrast changes its sign between the images: what lies beside them has changed. [R]
BOTH_SIDES_REVERSED, ONE_SIDE_REVERSED, NO_SIDE_REVERSED = 0.01, 0.2, 0.5
# Grey levels: width of the Cauchy density of the difference of one surface's two pictures; at first, and the range that
# the pair itself may set, from the quantisation to what exposure control leaves. [R]
FIRST_SCALE, LEAST_SCALE, MOST_SCALE = 8.0, 2.0, 16.0
# Grey levels: smoothing of the histogram of what lies beside edges, and matches from which the exposures are compared.
HISTOGRAM_SIGMA, FEW_MATCHES = 4.0, 6
# Standard deviation of the gain between the two cameras, and of the shift, grey levels, that one match outweighs. [R]
GAIN_SIGMA, SHIFT_SIGMA = 0.2, 7.0
# Rounds of the robust fit of one camera's exposure to the other's. [R] bounds the time
EXPOSURE_ROUNDS = 20

# -- dense disparity ---------------------------------------------------------------------------------------------------

# Pixels of the reduced image in which it is looked for. [R] bounds the time
DENSE_PIXELS = 120_000
# Samples along a segment, and their distances from it on either side, reduced px.
DENSE_SAMPLES, DENSE_OFFSETS = 6, (1.5, 3.0)
# Reduced px to which it agrees with a candidate; probability that it does, with a true one and with a wrong one. [R]
DENSE_TOLERANCE, DENSE_TRUE, DENSE_WRONG = 1.5, 0.85, 0.06
# Correlation of two windows of a row above which one may be taken for the other. [R]
LOOK_ALIKE = 0.8
# Slope of grey levels along the rows, in sigma of its noise, above which there is texture in the window. [R]
TEXTURE_NOISE = 3.0

# -- neighbours --------------------------------------------------------------------------------------------------------

# How many neighbours of a segment are heard, and how many independent ones they are worth: what one surface's edges say
# of each other is said many times. [R]
NEIGHBOURS, INDEPENDENT_NEIGHBOURS = 20, 4.0
# px: neighbours weigh by their length, up to the first, over their distance, plus the second. [R]
LONG_NEIGHBOUR, NEAR_NEIGHBOUR = 60.0, 8.0
# Width of the Cauchy density of the difference of disparity on one surface: px, and per px of distance. [R]
DISPARITY_SPREAD, DISPARITY_GRADIENT = 0.7, 0.12
# px: the same where two segments meet in both images. [R]
CORNER_SPREAD = 0.35
# Widths beyond which a neighbour's candidate is not asked. [R]
SUPPORT_REACH = 5.0
# Disparities at random are even on this share of the image's width. [R]
RANDOM_SHARE = 0.25

# -- labelling ---------------------------------------------------------------------------------------------------------

# Odds that a segment has a partner at all, over the number of pairs that chance offers it. [R]
PARTNER_ODDS = 4.0
# Candidates of a segment that stay in the game, and the least log odds that one has by itself. [R] bounds the time
MOST_CANDIDATES, LEAST_ODDS = 9, -6.0
# Belief nearer than this to 0 or 1 is settled: where the first pass settles all, dense disparity is not asked. [R]
# bounds the time
SETTLED = 0.02
# Rounds of belief propagation, in the first pass and in the second. [R]
FIRST_ROUNDS, ROUNDS = 3, 8
# Log odds beyond which nothing is more certain. [D] keeps the exponential finite
MOST_ODDS = 40.0
# Two partners of one segment are parts of one edge when, midway between them, their lines miss each other by less than
# this, px; pairs that have this share of the shorter one's rows in common claim the same part. [R]
ONE_LINE, SAME_PART = 2.0, 0.3
# An eye that sees past an object's side sees one edge more there, outside the one that both see: of two candidates the
# nearer is the true one. Log odds of that, when they are side by side; px over which it falls off; and px below which
# two candidates are one. [R]
NEARER_LOG_ODDS, BESIDE, LEAST_BESIDE = 3.5, 60.0, 1.0
# Share of matched ends left out at either end of the range of disparities, and the room beyond it: px, and as a share
# of the range. [R]
OUTLYING, ROOM, ROOM_SHARE = 0.02, 8.0, 0.25
# Candidates whose messages are worth another thread: one costs 0.4 us, to hand work over and to wait for it 100 us. [D]
LEAST_CANDIDATES = 1000

# -- segments of one edge, and of two that one eye sees as one ---------------------------------------------------------

# Two segments are parts of one edge when their directions differ by less than this (sine), when no end of theirs is off
# the line through both by more than so many px, and when the gap between them is at most this share of both. [R]
PARTS_SINE, PARTS_MISS, PARTS_GAP = 0.14, 1.0, 0.3
# px: two segments meet in a corner when their lines cross within this of the gap between their chains. A line is cut
# there when either part keeps so many edgels, and is fitted to them when that moves its ends by less than PARTS_MISS.
# [R]
AT_GAP, FEWEST = 4.0, 6

# -- rows --------------------------------------------------------------------------------------------------------------

# Sines below which a line is level, and px to which its disparity is known, for the heights that it shows. [R]
LEVEL_ROW, LEVEL_DISPARITY = 0.05, 1.0
# px: sigma of the rows' error in the middle of a rig's images, and of what it gains towards the border; the largest
# that a corner may show. [R] what real rigs have, in bench_real.py
ROW_OFFSET_SIGMA, ROW_TURN_SIGMA, ROW_SHIFT_MOST = 0.5, 0.4, 3.0
# px: what single rows of rigs disagree by: median, and standard deviation of its logarithm; the least that is tried,
# and how many are. [R]
ROW_SIGMA, ROW_SIGMA_SPREAD, ROW_LEAST_SIGMA, ROW_SIGMAS = 0.01, 1.5, 0.002, 30
# Rounds of the robust fit.
ROW_ROUNDS = 15

# px: what a calibration leaves the rows of a rig off by, in the middle, and from there to the border. A tenth is
# what is hoped of calibrating a pair; users know their own (the reprojection error), and it is a parameter.
CALIBRATION_ROW_SIGMA = 0.1
# px: side of the squares inside which single rows differ by the same. [R] with it the six boards of test/chessboards
# differ in what they say of their rig as they state (chi-squared a degree of freedom 1.2; at 64 px 2.7, at 256 px 0.5)
ROW_CELL = 128.0
# Share of checks in which a rig in order is said to have drifted: three sigma of one number.
DRIFT_FALSE_ALARM = 0.0027

# -- turned pictures ---------------------------------------------------------------------------------------------------

# Cosine, about, of the angle from straight ahead at which a turned picture still shows a pixel of the one before.
NEAREST_RAY = 0.1
