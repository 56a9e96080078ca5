"""Numbers of the searches: how much is looked at before the data, the time or the patience is used up.

They decide what is searched, never what is accepted. Where a command is named, it measured the value: it shows what is
missed and how long it takes (test/benchmarks).
"""

from __future__ import annotations

from typing import NamedTuple

# -- pair search (bench_matcher.py --presets clutter,low_visible,absent) ---------------------------------------------

# Distinct model features that a pose must explain: two fix it, so a third is the first to say that it is none of
# chance.
NEEDED = 3.0
# A pose is kept when it explains this share of what the best does: a decoy may explain more features than a model that
# is half hidden.
WORTH_KEEPING = 0.35
# Poses that are remembered of a data pair, a power of two: equal ones are looked at once, for large models repeat
# themselves; what has no room is looked at again.
REMEMBERED = 2**14
# Neighbours of a pair on which a pose is tried first: the best partners, so many, of each of the two. Where these are
# all there is, nothing is gained.
NEAR = 12
# While the best explains less than this share of a model, the stopping rule waits so many times longer: each data pair
# has more hypotheses in a large model, and those that the rule allows are soon used up.
LITTLE_EXPLAINED = 0.08
LONGER = 6.0

# Hypotheses of parallel edges, the longest first: whole ones are many in a room.
EDGE_HYPOTHESES = 2000

# -- large data and the clock ----------------------------------------------------------------------------------------

# With more data features than this, each is paired with its nearest ones instead of all; of those that are not near
# each other, so many of the longest are.
ALL_PAIRED = 600


class TimeShares(NamedTuple):
    """How the time limit is shared out: the part of it until which each step may go on.

    Attributes
    ----------
    ranking, searching, refining
        Pairs are ranked and searched, candidates are refined; the rest is for the last fits.
    """

    ranking: float
    searching: float
    refining: float


SHARES = TimeShares(0.3, 0.75, 0.95)

# -- prefilter of a library (bench_matcher.py --presets library,prefilter) -------------------------------------------

# Pairs of each data feature to choose from, and how many of the chosen a feature is in at most.
PARTNERS = 4
EACH = 3
# Models that tell how often a pair fits by chance.
SAMPLE = 8
# Hypotheses for one model, and the pairs that are used however many hypotheses they make.
BUDGET = 350.0
LEAST_PAIRS = 16
# Poses of a model that are kept, and models, best first, whose poses are refined.
POSES = 3
JUDGED = 400
# Models that are searched: at most, of those whose best pose does not miss what is needed decisively; and at least,
# while none exceeds it decisively.
MOST_CANDIDATES = 24
LEAST_CANDIDATES = 3

# -- unknown scale (test_free_scale.py) ------------------------------------------------------------------------------

# Step of the logarithm of scale: a search at one scale finds what is a little larger or smaller.
SCALE_STEP = 0.025
# Steps to either side that a scale has to stand out from.
SCALE_SURROUNDINGS = 20
# Classes of angles from 0 to 90 degrees.
ANGLE_CLASSES = 12
# In parts of the largest distance: shorter ones say little of the scale.
SHORTEST_DISTANCE = 0.03
# Scales that are searched at most, and how many without a better interpretation once there is one.
SCALES = 40
UNCHANGED_SCALES = 8
# Part of the time limit that one scale has at most.
SCALE_TIME = 0.25
