"""Numbers of the searches: how much is looked at before the data, the time or the patience is used up.

They decide what is searched, never what is accepted. Where a command is named, it measured the value: it shows what is
missed and how long it takes (test/benchmarks).
"""

from __future__ import annotations

# -- pair search (bench_matcher.py --presets clutter,low_visible,absent) ---------------------------------------------

# Two poses count as one when the trace of the rotation between them exceeds this, 1 + 2 cos(6 degrees), and they put
# the model's middle within this part of the model's size.
SAME_TURN_TRACE = 2.989
SAME_PLACE = 0.06
# Distinct model features that a pose must explain: two fix it, so a third is the first to say that it is none of
# chance.
NEEDED = 3.0
# A pose is kept when it explains this share of what the best does: a decoy may explain more features than a model that
# is half hidden.
WORTH_KEEPING = 0.35
# Where a data pair fits more model pairs than this, most of the poses are equal within its tolerance, for large models
# repeat themselves: each is looked at once. With fewer, remembering them takes as long. Poses that are remembered of a
# pair, a power of two: what has no room is looked at again.
MANY = 500
REMEMBERED = 2**14
# With more data features than this, a pose is first tried on the pair's neighbours: the best partners, so many, of each
# of the two.
LOCAL_TEST = 50
LOCAL_PARTNERS = 12
# While the best explains less than this share of a model, the stopping rule waits so many times longer: each data pair
# has more hypotheses in a large model, and those that the rule allows are soon used up.
LITTLE_EXPLAINED = 0.08
LONGER = 6.0

# Parallel data pairs that are tried between two looks at the clock.
PARALLEL_BLOCK = 16
# Edges of which pairs are made, the longest, and hypotheses of such pairs: whole parallel edges are many in a room.
LONGEST_EDGES = 300
EDGE_HYPOTHESES = 2000

# -- prefilter of a library (bench_matcher.py --presets library,prefilter) -------------------------------------------

# Pairs of each data feature to choose from, and how many of the chosen a feature is in at most.
PARTNERS = 4
EACH = 3
# Models that tell how often a pair fits by chance, and pairs that are counted between two looks at the clock.
SAMPLE = 8
COUNTED = 1000
# Hypotheses for one model, and the pairs that are used however many hypotheses they make.
BUDGET = 350.0
LEAST_PAIRS = 16
# Neighbours of a pair that its pose is tried on first.
NEAR = 12
# Poses of a model that are kept, and models, best first, whose poses are refined.
POSES = 3
JUDGED = 400
# Nats within which the evidence of these poses, less what is needed, is not decided. A model is searched when its best
# pose misses what is needed by no more; and when none exceeds it by more, LEAST_CANDIDATES models are searched.
UNDECIDED = 3.0
LEAST_CANDIDATES = 3
MOST_CANDIDATES = 24

# -- unknown scale (test_free_scale.py) ------------------------------------------------------------------------------

# Step of the logarithm of scale: a search at one scale finds what is a little larger or smaller.
SCALE_STEP = 0.025
# Steps to either side that a scale has to stand out from.
SCALE_SURROUNDINGS = 20
# Longest features of which the pairs are looked at.
LONGEST_FEATURES = 400
# Classes of angles from 0 to 90 degrees.
ANGLE_CLASSES = 12
# In parts of the largest distance: shorter ones say little of the scale.
SHORTEST_DISTANCE = 0.03
# Scales that are searched at most, and how many without a better interpretation once there is one.
SCALES = 40
UNCHANGED_SCALES = 8
# Parts of the time limit: what one scale has at most, and what is left for the estimate.
SCALE_TIME = 0.25
ESTIMATE_TIME = 0.3
# Alternations of pose and scale.
SCALE_TURNS = 6
# Interpretations of directions alone whose scale and pose are estimated, best first.
ESTIMATED = 8
# Squared, in the model's size: matched lines that come this near to one point leave the scale open.
OPEN_SCALE = 1e-9
