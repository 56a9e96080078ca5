"""Numbers of the facade: how far a search goes, how its time is shared out, and when a library is thinned first."""

from __future__ import annotations

from typing import NamedTuple

# -- the search for candidates ---------------------------------------------------------------------------------------

# Features that each data feature is paired with, those that it pairs with best.
NEIGHBOURS = 24


class Patience(NamedTuple):
    """Hypotheses without a better pose after which a search stops.

    Attributes
    ----------
    least
        Times the square of data per explained model feature.
    most
        Whatever that is.
    """

    least: float
    most: float


# When what was found could be chance, the search goes on without the first, with a new list of candidates: accidents
# that explain many features may have filled the first list, or ended it early.
PATIENCE = Patience(30.0, 8000.0)
# So many times more candidates are kept when the list is full of poses nearly as good as the best, as of a grid.
PERIODIC = 4
# Of a library of more models than this, only those that the prefilter lets through are searched.
LIBRARY = 20

# -- large data and the clock ----------------------------------------------------------------------------------------

# With more data features than this, each is paired with its nearest ones instead of all.
ALL_PAIRED = 600
# Data features whose neighbours are looked up between two looks at the clock.
BLOCK = 4096
# Seconds between two looks at the clock while pairs are tried: blocks of them begin with one, grow fourfold while a
# block takes less than a tenth of this, and shrink when it takes more.
LOOK_S = 0.02


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
# Hypotheses of a search, the best by their features, that are looked for in the images: of 61 right ones in real and
# path-traced pairs none was farther behind.
LOOKED_AT = 12
# Images that nodes keep by their stamps: a second of 30 Hz, within which features and poses of them come.
IMAGES_KEPT = 30
# Seconds for which features wait for the images that they were recovered from, once images have come at all.
WAIT_FOR_IMAGES_S = 0.1
# Chi squared of six degrees of freedom, which one sighting in a thousand of an object exceeds: beyond, it is another.
SAME_INSTANCE = 22.46
# Models of an index that a node keeps topics for, those found last: each has a few publishers.
NAMED_MODELS = 100
# matcher_nodes whose answers one node puts together; messages that it keeps while answers are missing, a second of 30
# Hz; and seconds between two looks at the clock for these.
MOST_SHARDS = 64
MERGED_AT_ONCE = 30
LOOK_FOR_SHARDS_S = 0.1
