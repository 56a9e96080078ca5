"""Every limit and threshold of the modelling language, with its unit, its meaning and where it comes from.

A scene file may come from anybody. The limits of effort keep any text, also a hostile one, cheap to refuse; they were
chosen far above what the library's scenes need, and no command is kept.
"""

from __future__ import annotations

# -- text ---------------------------------------------------------------------------------------------------------

# Characters of a file, statements of a file, characters of a statement, depth of parentheses in a statement.
MAX_CHARACTERS = 400_000
MAX_STATEMENTS = 4_000
MAX_STATEMENT = 60_000
MAX_NESTING = 60
# Errors after which no more are looked for.
MAX_ERRORS = 20
# Characters of a source line that a report shows; a longer line is cut around the caret, so that a report is readable.
SHOWN = 150
# Names that a hint proposes, and how similar they are at least (difflib's ratio, 0..1).
PROPOSALS = 2
SIMILAR = 0.65
# Files of a scene, and how deep they include each other.
MAX_FILES = 100
MAX_DEPTH = 20

# -- values -------------------------------------------------------------------------------------------------------

# Leaves of the largest solid a file may build, and the most leaves it may move or paint doing so: names can be reused
# to double a solid again and again, and a typing error should not fill the memory.
MAX_PRIMITIVES = 10_000
MAX_WORK = 40_000
# Heights of all terrains of a scene, each as often as it is written, and colours by height of a terrain.
MAX_SCENE_HEIGHTS = 20_000_000
MAX_TINTS = 64
# Pixels of all pictures of a scene (256 MB with what they are reduced to), each file counted once.
MAX_SCENE_TEXELS = 2**24
# Sizes beyond these, metres, are typing errors, and would only overflow later.
SMALLEST, LARGEST = 1e-9, 1e9
# Largest element of transforms combined, metres or 1: sizes of LARGEST scaled a thousandfold.
LARGEST_ELEMENT = 1e12
# Determinant of combined transforms, relative to the cube of the largest element, that flattens a solid to nothing.
FLATTENED = 1e-12

# -- cameras ------------------------------------------------------------------------------------------------------

# Pixels a side of the largest image, and of an image whose SIZE is not given.
MAX_SIDE = 16384
DEFAULT_SIDE = 512
# Fields of view, degrees: below, focal lengths are beyond any lens; a plane cannot show 180 degrees.
LEAST_VIEW, LARGEST_VIEW = 0.1, 179.0
# Sine of the angle between UP and the viewing direction below which they are parallel.
PARALLEL_UP = 1e-6

# -- PAINT FACES --------------------------------------------------------------------------------------------------

# Shades are factors of the colour between these; the lower is still lighter than a black background.
DARKEST, LIGHTEST = 0.22, 1.0
# How much a difference in grey matters: between faces that meet, that look the same way, any others, and that look
# opposite ways, which are hardly ever seen together. Chosen on the library's scenes; no command is kept.
MEETING, ALIKE, OTHERS, OPPOSITE = 1.0, 0.7, 0.4, 0.1
# More faces than this are dealt their shades without looking at who meets whom.
MOST_DEALT = 40
# Starts of the search for a good deal, the first in the order of the faces.
STARTS = 4
# Directions closer than this, as unit vectors, are parallel.
SAME_DIRECTION = 1e-6
# A face is on the solid where a step of this size (fraction of the solid's) through it crosses the boundary.
STEP = 1e-5
# Samples of a face along one side at most, and a bound on samples times primitives, which is the time it takes.
MAX_SAMPLES = 30
WORK = 250_000

# -- printing -----------------------------------------------------------------------------------------------------

# A printed operand of more levels, or more characters, gets a name of its own (MAX_NESTING and MAX_STATEMENT are well
# above); characters of a printed line.
DEEPEST = 12
LONGEST = 2_000
WIDTH = 110
