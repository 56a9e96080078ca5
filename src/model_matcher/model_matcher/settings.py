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
# Data pairs times data features that are tried before the first look at the clock (8 pairs at least), and data features
# whose neighbours are looked up between two looks.
BLOCK = 4096
# Seconds between two looks at the clock: blocks grow while it is less than a tenth of this, and shrink when it is more.
LOOK_S = 0.02


class LargeData(NamedTuple):
    """How the time limit is shared out when there is much data; with less no step but the search takes long.

    Attributes
    ----------
    features
        With more than this.
    ranking, searching
        Parts of the time limit until which pairs are ranked and searched, the rest being for the refinement.
    """

    features: int
    ranking: float
    searching: float


LARGE = LargeData(5000, 0.3, 0.75)
