"""Named numbers of the numeric room: cache of machine code, medians of normal noise, covariances, threads."""

from __future__ import annotations

# Bytes that the cache may take before the entries that were not used for longest are removed. All that the nodes need
# is about 5 MB, so this holds some two hundred versions of them.
CACHE_BYTES = 1 << 30
# Age, seconds, after which the time of an entry's use is written again: a day.
USE_NOTED_AFTER_S = 86400.0
# Time between two looks of one process at the size of the cache, seconds: an hour.
SIZE_CHECKED_EVERY_S = 3600.0
# Counted up when other machine code is made of the same function, so that the cache's entries are made anew.
FORM = 4
# Bits of the number by which functions of one name are told apart: that two draw the same is as good as impossible.
NUMBER_BITS = 63
# Characters of a function's name that an entry's file name begins with, for who lists the folder.
NAME_CHARACTERS = 40

# How many sigma what bounds an error is, such as err_par and err_per of a feature; beyond it is no noise.
BOUND_SIGMA = 3.0
# Nats, log odds that settle a matter: twenty to one.
DECISIVE = 3.0

# Halvings of an interval after which its ends are one number of 64 bits.
BISECTIONS = 60

# Exponent of light by grey level of pictures that are coded for screens: about that of sRGB (IEC 61966-2-1).
SRGB_EXPONENT = 2.2

# The median of |x| of a normal variable x of sigma 1 (its upper quartile).
NORMAL_QUARTILE = 0.6745
# Times the median of |x| gives sigma: 1 / NORMAL_QUARTILE, rounded as in most textbooks.
MAD_TO_SIGMA = 1.4826

# Lengths, squares of sines, variances and sums of weights are divided by at least this, in metres, radians or pixels.
NOT_ZERO = 1e-12

# By which a correlation may miss symmetry, and its least eigenvalue zero: what numbers of 32 bits round away.
PSD_TOLERANCE = 1e-6
# Stands for a sigma of zero where something is divided by it, in any unit.
LEAST_SIGMA = 1e-150

# Pairs of points that are compared in a tenth of the time that a library takes to be imported which compares fewer.
MOST_COMPARED = 1_000_000

# Seconds between two looks at the clock, and at what else may end a piece of work.
LOOK_S = 0.005

# Threads at most: more than a desktop's memory bandwidth feeds are no faster.
THREADS = 4
