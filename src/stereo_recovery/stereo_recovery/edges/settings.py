"""Numbers of straight edges after their estimate: where they end, what corners say, and what is reported.

[P] says that a probability was counted, and [R] that a value was set by trial, on rendered scenes (bench_lines.py
--seeds 100..139) and on the pairs of test/benchmarks/bench_photoreal.py and bench_real.py that are not held out; [D]
that it follows from what is said.
"""

from __future__ import annotations

import math

# -- what is reported --------------------------------------------------------------------------------------------------

# Largest three sigma bound across an edge, as a share of its length. [D] With it at both ends the edge's direction is
# known to 45 degrees.
MOST_ERR_PER = math.sqrt(0.5)

# -- where edges end ---------------------------------------------------------------------------------------------------

# Share of its contrast, in the mean, above which an edge goes on beyond a chain's end. [D] Of edges with any share up
# to the whole, and none, forty pixels of texture of a third of the contrast show as much of either.
GOES_ON = 0.1
# px from the line where it is looked for. [R] Another edge, or a bend, is soon as far away.
COURSE_OFFSET = 1.0

# -- edges between corners ---------------------------------------------------------------------------------------------

# px: a segment runs into a corner on its line that is this far beyond or before its end. [R]
BEYOND, BEFORE = 10.0, 5.0
# px: what corners of straight segments miss each other by in an image. [R]
ROUNDED = 0.25
# px: the shortest segment that makes an edge between two corners, or by its texture alone. [R]
SHORTEST = 8.0

# -- cameras beyond the main pair --------------------------------------------------------------------------------------

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

# -- parts of one edge -------------------------------------------------------------------------------------------------

# px: by which the disparities of parts of one edge miss the line through them. [R] folds of cards
JOINED_SIGMA = 0.2
# px: the widest gap between them. [R]
JOINED_REACH = 60.0
# px from the line where grey levels are compared, and share of the parts' contrast that the gap between them has. [R]
GAP_OFFSET, GAP_SHARE = 2.0, 0.4
