"""Numbers of the facade: how far a search goes, how its time is shared out, and when a library is thinned first."""

from __future__ import annotations

# -- the search for candidates ---------------------------------------------------------------------------------------

# Features that each data feature is paired with, those that it pairs with best.
NEIGHBOURS = 24
# A search stops after this many hypotheses without a better pose: the first number times the square of data per
# explained model feature, the second at most. When what was found could be chance, it goes on without the first, with
# a new list of candidates: accidents that explain many features may have filled the first list, or ended it early.
LEAST_PATIENCE = 30.0
MOST_PATIENCE = 8000.0
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
AT_ONCE = 2048
# Seconds between two looks at the clock: blocks grow while it is less than a tenth of this, and shrink when it is more.
LOOK_S = 0.02
# With more data features than this the time limit is shared out: pairs are ranked until the first part of it is over,
# and searched until the second, the rest being for the refinement. With fewer no step but the search takes long.
LARGE = 5000
RANKING_PART, SEARCHING_PART = 0.3, 0.75
