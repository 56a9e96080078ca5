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
# Probabilities that edges that meet in an image meet in space: the same two meet in the other image; there the end is
# loose; there it meets a third; one of the two goes on beyond the crossing. [P]
JUNCTION_PRIOR, SEEN_ONCE_PRIOR, OTHER_CORNER_PRIOR, T_PRIOR = 0.98, 0.75, 0.65, 0.4
# Probability that the ends of a pair of segments are one point. [P]
END_PRIOR = 0.8
# Probability that two edges that continue each other are one, and px by which their disparities differ; px by which the
# end of either misses the other's line, sine between them, and the widest gap as a share of the shorter. [R]
COLLINEAR_PRIOR, COLLINEAR_SIGMA = 0.8, 0.1
COLLINEAR_MISS, COLLINEAR_SINE, COLLINEAR_GAP = 1.5, 0.06, 1.0
# Probability that lines meet that cross beyond their chains, at most so many px and this share of their lengths; by how
# much, px, chains may overrun the crossing; and the least sine between the lines. [R]
ROUNDED_PRIOR, ROUNDED_GAP, ROUNDED_SHARE = 0.6, 25.0, 0.5
ROUNDED_OVERRUN, ROUNDED_SINE = 4.0, 0.15
# Sine of the slope above which lines know disparity better than their ends do. [R]
STEEP = 0.3
# px: range over which the disparity of an accident is even. [R]
SPREAD = 30.0

# -- parallel groups ---------------------------------------------------------------------------------------------------

# Residuals up to this many sigma count as noise. [D] three sigma
GATE = 3.0
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
# px a pixel: largest slope of disparity that is tried for an open edge. [R]
MOST_SLOPE = 0.5
# Rounds of the start, of the least squares, and links of a chain of edges that hang on each other. [R] bounds the time
START_ROUNDS, ROUNDS, CHAIN = 3, 100, 4
# So often a factor may be taken out again. [D] more would not end
MOST_REMOVED = 2
# Residuals that the sigmas' own word is worth. [R]
REDUNDANCY = 10.0

# -- what is reported --------------------------------------------------------------------------------------------------

# Least probability that all holds on which the depth of a reported edge hangs. [D] more likely than not
LEAST_RELIABILITY = 0.5
# Largest three sigma bound across an edge, as a share of its length. [R]
MOST_ERR_PER = 0.25

# -- where edges end ---------------------------------------------------------------------------------------------------

# px: two corners that are no farther apart are one. [R]
ONE_CORNER = 1.5
# px, and share of what both images show: a chain that stops this far before a corner of the other image is lost, not
# hidden. [R]
LOST, LOST_SHARE = 20.0, 0.5
# What makes corners doubtful, and how much, px, one sigma: an edge that goes on behind or before the other; edges
# shorter than SHORT_EDGE; a chain that ends FAR_GAP px from the corner. [R]
T_SIGMA = 0.3
SHORT_EDGE, SHORT_SIGMA = 15.0, 0.15
FAR_GAP, FAR_SIGMA = 6.0, 0.3

# -- edges between corners ---------------------------------------------------------------------------------------------

# px: a segment runs into a corner that is this near to its line, and this far beyond or before its end; the latter also
# as a share of its length. [R]
BESIDE, BEYOND, BEFORE, END_SHARE = 1.5, 10.0, 5.0, 0.5
# px, and sigma: edges of one corner differ by no more in disparity. [R]
CORNER_MISS, CORNER_GATE = 1.2, 3.5
# px: what corners of straight segments miss each other by in an image. [R]
ROUNDED = 0.25
# px: a line that misses a corner must come this near to it, along itself. [R]
ABSENT = 7.0
# px: heights of one corner in the two images, and of ends that are none, differ by less; and the shortest segment that
# corners match. [R]
SAME_HEIGHT, ENDS_HEIGHT, SHORTEST_MATCH = 1.0, 3.0, 4.0
# So often corners that edges add add edges. [R]
CORNER_ROUNDS = 2
# px: the shortest segment that makes an edge between two corners, and how far inside its ends another one that runs
# into it says that it is more than one edge. [R]
SHORTEST, INSIDE = 8.0, 4.0

# -- sagitta -----------------------------------------------------------------------------------------------------------

# Two segments show the same part of an edge when their lengths agree to this share; of the square of a line's sigma so
# much at least is not its sagitta's. [R]
SAME_EXTENT, LEAST_SHARE = 0.15, 0.01

# -- cameras beyond the main pair --------------------------------------------------------------------------------------

# Square of the difference of what two cameras say of an edge's two unknowns, in its covariance, up to which they agree:
# chi-squared of two degrees of freedom. [D] three sigma
VIEW_GATE = 11.8
# Belief above which a match is no more certain. [D] one in a thousand is wrong
BELIEF_MOST = 0.999
# Probability that a camera is blind (covered, blinded, moved since its calibration), and that it agrees on a segment
# whose depth it and the main pair know, if it sees and if it is blind. [R]
BLIND_PRIOR, SIGHTED_AGREEMENT, BLIND_AGREEMENT = 0.05, 0.85, 0.2
# px: sigma of single rows or columns above which a camera is not where its calibration says; of rows that have nothing
# to do with each other half a dozen witnesses give 1.4. [R]
LOST_SIGMA = 0.8
# px: sigma of a prediction's place in another picture beyond that of the lines; share of it that a segment there has to
# cover. [R] Of matches that contradict each other, the probability that a right one is confirmed so, and that a wrong
# one is. [P]
PREDICTION_SIGMA, PREDICTION_SHARE = 0.3, 0.5
CONFIRMED_RIGHT, CONFIRMED_WRONG = 0.6, 0.12
# Of a left line's variance so much is not shared by the pairs it is in: its turned pictures are not quite one.
LEAST_LEFT_SHARE = 1e-3

# -- texture beside edges ----------------------------------------------------------------------------------------------

# px of a level of the image pyramid: nearest and farthest line of a strip beside an edge; most samples along it. [R]
STRIP_NEAR, STRIP_FAR, STRIP_SAMPLES = 2, 12, 100
# Rounds of the alignment, and px that it moves by when it has ended.
STRIP_ROUNDS, STRIP_CONVERGED = 12, 0.02
# Sigma of disparity's gradients on surfaces, px a pixel. [R]
STRIP_SLOPE_SIGMA = 0.15
# Share of a strip's variance that its alignment has to explain. [R]
STRIP_LEAST_SHARE = 0.5
# Sigma of the gain between the two strips, and of the shift, grey levels; grey levels: what residuals differ by at
# least. [R]
STRIP_GAIN_SIGMA, STRIP_SHIFT_SIGMA, STRIP_LEAST_SCALE = 0.5, 100.0, 0.3
# Width of Cauchy's weights, in sigmas. [D] 95 % as efficient as least squares where nothing is wrong
CAUCHY = 2.385
# px: sigma of rows at least; share of a strip where dense disparity must be known; rounds of the line through it; and
# the coarsest level, over the size of the dense disparity.
STRIP_LEAST_ROW, STRIP_LEAST_KNOWN, STRIP_FITS, STRIP_COARSEST = 0.2, 0.15, 6, 0.75
# px: smoothing of each level of the pyramid.
STRIP_LEVEL_SIGMA = 0.8
# Places along a strip, and reduced px from the edge, where dense disparity is asked.
STRIP_STARTS, STRIP_ASKED = 24, (2.0, 5.0, 8.0)
# px: by which a surface's disparity beside an edge misses the edge's, beyond what its alignment has. [R]
STRIP_SIGMA = 0.2
# px: sigma of rows up to which a strip is a witness of them. [R]
STRIP_ROW_SIGMA = 0.4
# px: the shortest segment that texture alone matches. [R]
STRIP_SHORTEST = 12.0
# Probability that an edge belongs to the surface on one of its sides. [R]
STRIP_PRIOR = 0.7
# Pixels of a strip that share one error: what smoothing makes of noise, and what no plane and no gain explain. [P]
STRIP_CORRELATION = 16.0

# -- parts of one edge -------------------------------------------------------------------------------------------------

# px: by which parts of one edge miss the line through all of them in an image, and their disparities the line through
# them. [R] folds of cards
JOINED_MISS, JOINED_SIGMA = 1.0, 0.2
# px, and share of both parts' lengths: the widest gap between them; and px below which it is none. [R]
JOINED_REACH, JOINED_SHARE, SMALL_GAP = 60.0, 0.3, 4.0
# px from the line where grey levels are compared, and share of the parts' contrast that the gap between them has. [R]
GAP_OFFSET, GAP_SHARE = 2.0, 0.4
