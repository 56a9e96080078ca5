"""Numbers of verification. Evidence is in nats: natural logarithms of ratios of probabilities.

Those of the evidence were measured on the synthetic scenes of test/benchmarks/bench_matcher.py (presets clutter, absent
and false_alarms); test/benchmarks/calibrate_evidence.py fits those of them that searches tell, and says how true the
chances are that come of all. Change one only together with FALSE_ALARMS, the measured result of all.
"""

from __future__ import annotations

from typing import NamedTuple

# -- candidates and their refinement ---------------------------------------------------------------------------------

# Candidate poses that a search keeps, and that are refined; more where many are nearly as good as the best. Where
# little of a part is seen others explain as many features by chance, and only their evidence says which are right: with
# half as many candidates three of 340 right ones were lost.
CANDIDATES = 32
# Candidates within this part of the best score are refined, and all of them where that leaves doubt: one feature that
# belongs to another thing must not keep the right pose from being looked at.
KEEP = 0.6

# -- the line of sight -----------------------------------------------------------------------------------------------

# Error across over error along the line of sight of a pair whose baseline is a fifth of the distance.
STEREO_RATIO = 0.14
# Residuals more alike than this say that the line of sight plays no part.
ALIKE = 0.7
# Data features that a ratio can be read off, and fits that it is read off in turn.
FEWEST, FITS = 4, 4
# Sine of the angle between an edge and the line of sight below which the edge says nothing across it.
ALONG_SIGHT_SINE = 0.05

# -- the last fit ----------------------------------------------------------------------------------------------------

# Residuals that covariances' own word of how large errors are is worth. [P] The factor that f residuals show is then of
# Fisher's F distribution of f and so many degrees of freedom, most likely over the poses of rendered pairs
# (bench_covariances.py) and of those of cameras and a path tracer (bench_poses.py --images off), which count alike.
STATED_WORTH = 1.5

# -- coincidences ----------------------------------------------------------------------------------------------------

# Chance that an angle of a direction is what a direction of the model has, for each direction that the model has.
ANGLE = 0.05
# Largest radius of other objects over the smallest; a guess of what is on a bench, from a drill to a dish.
RADII = 30.0
# Nats of a feature that lies in no plane of the usual orientations: there are many of such.
PER_OFFSET = 0.5
# Radii and lengths that differ by less than this part are equal.
SAME_LENGTH = 0.05
# In tolerances: systematic error of a plane, which more data does not take away; ideal data is no infinite proof.
BIAS = 0.15
# Nats: a single plane off by the whole tolerance takes back no more than this, its coincidence included; nor does a
# further feature that another pose explains.
WORST = 4.0
# A normal fixes a feature, or places the pose, when this much of it (a sine) is outside the span of those before.
FIXING_SINE = 0.4

# -- coverage --------------------------------------------------------------------------------------------------------

# A model edge is found whole when this part of its length is covered.
COVERED = 0.75
# Chance of that where the model is; share of an outline that is confirmed where nothing of it is hidden.
WHOLE = 0.85
# Nats: no less for all lengths together; where all is broken, pieces say little.
FRAGMENTS = -1.0

# -- neighbours ------------------------------------------------------------------------------------------------------


class NeighbourCounts(NamedTuple):
    """How often unexplained data meets the data that a pose explains.

    Attributes
    ----------
    of_chance
        With a chance pose, on average.
    missed
        Of an instance's own edges, per matched feature, noise takes so many that meet the others.
    at_ends
        Of the pieces strewn about that meet, so many do so end to end.
    crowded
        Part of the real objects that have patterns at their edges, or stand on others.
    """

    of_chance: float
    missed: float
    at_ends: float
    crowded: float


NEIGHBOURS = NeighbourCounts(2.2, 0.03, 0.3, 0.03)
# Edges meet when their lines do within this part of their lengths beyond their ends.
REACH = 0.12
# In tolerances: the direction of a shorter edge is too poor to say that it is not the model's.
SHORT = 6.0
# In model sizes: radius about the model's middle in which unexplained data is counted for its density.
NEIGHBOURHOOD = 0.6

# -- what is in view -------------------------------------------------------------------------------------------------


class ChancesOfView(NamedTuple):
    """Chances that a model feature is explained, measured together.

    Attributes
    ----------
    by_chance
        By a pose at random, among objects as regular as the model.
    thinned
        Where the model is, when any feature may be missing.
    seen, hidden
        There, when it is in view, and when it is hidden.
    """

    by_chance: float
    thinned: float
    seen: float
    hidden: float


VIEW = ChancesOfView(0.28, 0.39, 0.47, 0.1)


# -- acceptance ------------------------------------------------------------------------------------------------------


class FalseAlarms(NamedTuple):
    """Evidence (nats) that the best pose of an absent model has by chance.

    Chance tries h hypotheses, and each has more than least + tail t nats in exp(-t) of the tries. What stands there is
    an object, perhaps one like the model, be the hypotheses ever so few: that is as good as so many more (alike). One
    of all has more in (h + alike) exp(-t) of the searches. See test/benchmarks/calibrate_evidence.py.
    """

    least: float
    tail: float
    alike: float


FALSE_ALARMS = FalseAlarms(-14.5, 1.9, 500.0)
# A candidate whose data is claimed to more than this part by a better interpretation competes with it.
CLAIMED = 0.34
# So large a part of the data of another pose, or of the most distinct model features of any, counts as nearly all.
NEARLY_ALL = 0.9
# A pose that explains nearly all data of another, and more, has its evidence, unless its own is less by more than WORST
# for each further model feature; features beyond these make no difference.
FURTHER = 2.0
# Places along a model edge that are looked at; parts of a model that are covered differ when they do by one of them.
PLACES = 64

# -- what images say -------------------------------------------------------------------------------------------------


class ImageEvidence(NamedTuple):
    """What a nat of features, outline and surface counts for: all come from the same pictures, and say partly the same.

    Fitted by test/benchmarks/calibrate_evidence.py, so that the best hypothesis of a model that is not there has more
    than t nats in less than exp(-t) of the searches.
    """

    features: float
    outline: float
    surface: float


IMAGE_EVIDENCE = ImageEvidence(0.35, 0.75, 1.27)
# Pixels of an object's diagonal, or from its axis to what is not round, above which poses are told apart
# in images of half the size: an outline of half of this still has some thirty points, REACH apart, in each view.
SEEN_LARGE = 125.0
# Hypotheses with a free turn, the best of a search, all turns of which are looked at, for many share one axis; and
# poses that are not worth a glance at each, before those that this does not tell from the best, at most so many, are
# drawn in.
TURNED, DRAWN = 2, 6
# Pixels: a curve no point of which moves farther stays where it is; noise moves steps by more.
STILL = 0.05
