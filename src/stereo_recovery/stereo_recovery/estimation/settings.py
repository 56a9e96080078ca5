"""Numbers of the estimate of straight edges: sigmas and probabilities.

[P] says that a probability was counted, and [R] that a value was set by trial, on rendered scenes (bench_lines.py
--seeds 100..139) and on the pairs of test/benchmarks/bench_photoreal.py and bench_real.py that are not held out; [D]
that it follows from what is said.
"""

from __future__ import annotations

# -- factors -----------------------------------------------------------------------------------------------------------

# px: disparity by which two edges miss each other at a corner they share (rounded corners, blur). [P]
CORNER_SIGMA = 0.03
# px: the largest by which they do, at rounded ones. [R]
MOST_CORNER_SIGMA = 1.0
# px: where a chain stops without a corner, and by which heights of one corner in the two images differ. [P]
LOOSE_END_SIGMA, HEIGHT_SIGMA = 4.0, 0.3
# Probabilities that edges that meet in an image meet in space: the same two meet in the other image; there it meets a
# third, or both images show it beyond their chains alone; one of the two goes on beyond the crossing. [P]
# calibrate_factors.py, of the record's pairs and of as many of other seeds, which differ: .98 and .92, .71 and .83,
# .37 and .56. Where one image alone shows it, and that the ends of a pair of segments are one point: SEEN_AS_ONE.
JUNCTION_PRIOR, DOUBTFUL_PRIOR, T_PRIOR = 0.95, 0.77, 0.45
# px: by which two segments show one point or one line of an image at different places, at most. [R]
SAME_PLACE = 1.5
# Edges that continue each other and are one: px by which their disparities differ, sine between them, and the widest
# gap as a share of the shorter. [R]
COLLINEAR_SIGMA, COLLINEAR_SINE, COLLINEAR_GAP = 0.1, 0.06, 1.0
# Most of its length, as a share, by which an edge's chain may miss its end. [R]
END_SHARE = 0.5
# Lines cross beyond their chains at most so many px; and the least sine between them. [R]
ROUNDED_GAP, ROUNDED_SINE = 25.0, 0.15
# Sine of the slope above which lines know disparity better than their ends do. [R]
STEEP = 0.3
# px: range over which the disparity of an accident is even. [R]
SPREAD = 30.0

# -- parallel groups ---------------------------------------------------------------------------------------------------

# rad: how far edges of one direction miss it; and disparity a pixel, beyond that of their lines. [R]
DIRECTION_SIGMA, SLOPE_SIGMA = 2e-3, 2e-4
# An edge says what group it is of when the chance that it had any other direction is below this. [R]
CLEAR = 0.01
# There have to be so many members, and so many that accident makes less than this number of groups in a picture (A.
# Desolneux, L. Moisan and J.-M. Morel's a-contrario reasoning). [D] one picture in twenty
LEAST_MEMBERS, FALSE_GROUPS = 3, 0.05
# Edges of other directions that are taken to be there beside those that are known. [R]
GROUP_DOUBT = 10.0
# Most groups, and seeds from which they are grown, the best known first. [R] bounds the time
MOST_GROUPS, GROUP_SEEDS = 12, 100
# Share of an edge's direction that is seen, below which it recedes too steeply to be told its slope. [R]
LEAST_LEVER = 0.1
# So often groups are looked for and told. [R]
GROUP_ROUNDS = 2
# Slopes of disparity at random are even over this range, px a pixel. [R]
SLOPE_SPREAD = 1.0

# -- estimate ----------------------------------------------------------------------------------------------------------

# px: sigma of disparity about that of the match, of an edge that nothing tells; and of its slope, px a pixel. [R]
MATCH_SIGMA, MATCH_SLOPE = 20.0, 0.3
# px: an edge whose disparity is known better than the first at its ends tells others from the start; one that is known
# worse than the second is open. [R]
WELL_MEASURED, OPEN_SIGMA = 0.3, 1.0
# Chance that all that says where an open edge is came by accident, above which nothing does. [D] one in twenty
ACCIDENT = 0.05
# px a pixel: largest slope of disparity that is tried for an open edge. [R]
MOST_SLOPE = 0.5
# Open edges that are worth another thread: one costs 10 us, to hand work over and to wait for it 100 us. [D]
LEAST_OPEN = 40
# Rounds of the start, and of the least squares. [R] bounds the time
START_ROUNDS, ROUNDS = 3, 100
# Share of a factor's variance that all others leave it, at least, when it is taken out of a least squares. [D] rounding
LEAST_REST = 1e-6
# So often a factor may be taken out again. [D] more would not end
MOST_REMOVED = 2
# Residuals that the sigmas' own word is worth, and statements that a prior's is. [R]
REDUNDANCY = 10.0
# Rounds of expectation-maximisation in which a prior is told. [D] it changes by less than a hundredth after these
PRIOR_ROUNDS = 5

# -- sagitta -----------------------------------------------------------------------------------------------------------

# Two segments show the same part of an edge when their lengths agree to this share; of the square of a line's sigma so
# much at least is not its sagitta's. [R]
SAME_EXTENT, LEAST_SHARE = 0.15, 0.01

# -- texture beside edges ----------------------------------------------------------------------------------------------

# px of a level of the image pyramid: nearest and farthest line of a strip beside an edge; most samples along it. [R]
STRIP_NEAR, STRIP_FAR, STRIP_SAMPLES = 2, 12, 100
# Rounds of the alignment; by what share of its sigma it moves when it has ended, and px: the sigma that is sharp enough
# for that, and of rows for a strip to be a witness of them. [R]
STRIP_ROUNDS, STRIP_CONVERGED, STRIP_SHARP = 12, 0.05, 0.4
# Sigma of disparity's gradients on surfaces, px a pixel. [R]
STRIP_SLOPE_SIGMA = 0.15
# Share of a strip's variance that its alignment has to explain. [R]
STRIP_LEAST_SHARE = 0.5
# Sigma of the gain between the two strips, and of the shift, grey levels. [R]
STRIP_GAIN_SIGMA, STRIP_SHIFT_SIGMA = 0.5, 100.0
# Width of Cauchy's weights, in sigmas. [D] 95 % as efficient as least squares where nothing is wrong
CAUCHY = 2.385
# px: sigma of rows before any are known, and at least; share of a strip where dense disparity must be known; rounds of
# the line through it; and the coarsest level, over the size of the dense disparity.
STRIP_ROW_PRIOR, STRIP_LEAST_ROW, STRIP_LEAST_KNOWN, STRIP_FITS, STRIP_COARSEST = 1.0, 0.2, 0.15, 6, 0.75
# Levels of a pair that compiled functions are made for: enough for 500 megapixels.
MOST_LEVELS = 8
# Places along a strip, and reduced px from the edge, where dense disparity is asked.
STRIP_STARTS, STRIP_ASKED = 24, (2.0, 5.0, 8.0)
# px: by which a surface's disparity beside an edge misses the edge's, beyond what its alignment has. [R]
STRIP_SIGMA = 0.2
# Probability that an edge belongs to the surface on one of its sides. [P] Of known edges .83 do in rooms, .96 in
# path-traced pairs.
STRIP_PRIOR = 0.9
# Pixels of a strip that share one error: what smoothing makes of noise, and what no plane and no gain explain. [P]
STRIP_CORRELATION = 16.0
