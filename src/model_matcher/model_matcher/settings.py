"""Numbers of the facade and of the nodes: how far a search goes, and how long messages are waited for."""

from __future__ import annotations

from typing import NamedTuple

# -- the search for candidates ---------------------------------------------------------------------------------------


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
# Parts of the ranked pairs, every so many-th, that are searched at once: cores that any machine has.
SIDE_BY_SIDE = 2
# So many times more candidates are kept when the list is full of poses nearly as good as the best, as of a grid.
PERIODIC = 2
# Hypotheses of a search, the best by their features, that are looked for in the images: of 514 right ones in real,
# path-traced and half hidden rendered pairs none was farther behind than the seventh.
LOOKED_AT = 8

# -- the nodes -------------------------------------------------------------------------------------------------------

# Messages that a node keeps by their stamps, while the rest of what belongs to them comes: a second of 30 Hz.
MESSAGES_KEPT = 30
# Seconds for which features wait for the images that they were recovered from, once images have come at all; also
# between two looks of a node at what it waits for.
WAIT_S = 0.1
# Models of an index that a node keeps topics for, those found last: each has a few publishers.
NAMED_MODELS = 100
# matcher_nodes whose answers one node puts together.
MOST_SHARDS = 64
