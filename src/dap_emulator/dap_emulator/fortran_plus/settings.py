"""Named numbers of the language room: limits of compiling and running a program."""

from __future__ import annotations

# Deepest nesting of calls of subroutines and functions; the limit stops a program that calls itself for ever.
MAX_DEPTH = 2000
# Python frames that one call of a subroutine or function may take: one closure for every level of its expressions.
FRAMES_PER_CALL = 8
# Python frames left for the caller and for numpy.
SPARE_FRAMES = 1000

# Steps of a program between two looks at its limits (time, cycles, cancellation); a power of two. Operations on arrays
# look at them every time, so these are steps of scalars: the longest expression that compiles takes 2 ms.
STEPS_PER_CHECK = 8
# Frames that CALL DISPLAY keeps, and their size in all, bytes; later ones are left out.
MAX_DISPLAYS = 500
MAX_DISPLAY_BYTES = 256_000_000

# Lines that PRINT keeps, and their characters in all; later ones are left out, and the last line says so.
MAX_PRINTED = 1000
MAX_PRINTED_CHARACTERS = 200_000
# Elements of an array that PRINT shows whole; of a larger one its corners.
PRINTED_ELEMENTS = 1024

# Compiled programs kept for reuse, by their text.
PROGRAMS_CACHED = 64
# Longest list of what was expected, in an error message; a longer one says nothing to a reader.
MAX_EXPECTED = 6
