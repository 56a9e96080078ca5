"""Numbers of the index of models. Where a command is named, it measured the value (test/benchmarks)."""

from __future__ import annotations

from typing import NamedTuple

# -- the file --------------------------------------------------------------------------------------------------------

# First bytes of the file, and the version of what follows: a change of any cell below is another version.
MAGIC, VERSION = b'PARTSIDX', 1
# Bytes: arrays begin at multiples of a page.
ALIGNMENT = 4096
# The file's name in the folder whose models it holds, when no other is given.
FILE_NAME = 'models.index'

# -- cells of invariants, in errors (records.py) ---------------------------------------------------------------------

# Cells of the angle between two lines from 0 to 90 degrees.
ANGLES = 18
# Cells of lengths and radii, and how many errors each is wide; of the distance of lines as many as reach as far. Edges
# are seen in part, so their cells are wide.
LENGTH_CELLS, LENGTH_STEP, CURVE_STEP = 16, 8, 4
APART_STEP = 2
APART_CELLS = LENGTH_CELLS * LENGTH_STEP // APART_STEP

# -- pairs of a model ------------------------------------------------------------------------------------------------

# Partners of a feature whose pairs are in the index, those it pairs with best. A scene asks for the best few of what it
# shows; where a third of a model is in view, those are among three times as many of the model.
PARTNERS = 16

# -- votes of a scene (bench_catalogue.py) ---------------------------------------------------------------------------

# Share of an edge that the data of a pair shows at least: pairs of which less is seen are not found by it. Edges are
# often recovered in pieces. With 0.6 the right one of 10,000 parts is behind 400 others in one scene of 20 by what the
# pairs agree on, with 0.25 behind 7, though fewer pairs are looked up for the same READ.
SHOWN = 0.25
# Pairs that a data feature is in at most, and pairs of models that are read for a scene, the rarest data pairs first.
# The time that a scene takes goes with it.
EACH = 8
READ = 12_000_000
# Models that classes of sizes put together: their tolerances differ by no more.
CLASS_RATIO = 1.15


class Round(NamedTuple):
    """Of how many models poses are made.

    A part that repeats itself has many pairs that look alike, and may have wrong poses at first, while others that look
    like it have good ones by chance: the more the pairs agree on a part, the more of its poses are tried, whatever has
    come of them so far.

    Attributes
    ----------
    models : int
        Those that the pairs agree on best.
    poses : int
        Of each model, of pairs that fix a pose and of pairs about one axis, besides those that were tried before.
    each : int
        Of each of them from one data pair; a part that repeats itself has many that look alike.
    """

    models: int
    poses: int
    each: int


ROUNDS = (Round(10_000, 8, 3), Round(500, 24, 8), Round(100, 128, 64))
# Models by their poses, the best of all, that are looked at for what data they explain; objects that are told apart by
# it; and how many models are weighed for each.
LOOKED_AT = 512
OBJECTS = 6
WEIGHED = 96
# Models that are ready for matching and kept for the next scene.
KEPT_MODELS = 400
