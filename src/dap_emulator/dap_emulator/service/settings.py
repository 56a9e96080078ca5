"""Named numbers of the service room: what a client may store, and what is kept for it."""

from __future__ import annotations

# Longest program text accepted, characters; the longest library program, csg_combine, has 3800.
PROGRAM_BYTES = 200_000
# Most data that one client may store, bytes: 64 matrices of 512 x 512 REAL*4.
STORE_BYTES = 64_000_000
# Time after which a run is stopped, seconds on this computer.
RUN_SECONDS = 10.0
# Workspaces kept; the one that has been idle for longest makes room for a new one.
CLIENTS = 64

# Requests that may wait for one client.
MAX_WAITING = 32
# Finished requests whose results are kept for one client.
RESULTS_KEPT = 4
# Operations of a run that its result lists, the last ones.
TRACE_KEPT = 200
# Longest id of a client, and longest name of a variable, characters.
LONGEST_NAME = 64
# Most digits of a request's number, so that it fits a 64-bit integer.
MOST_DIGITS = 18
# Most dimensions of an array: Fortran has seven.
MAX_DIMENSIONS = 7

# Time that a client waits for the emulator, seconds.
CLIENT_TIMEOUT_S = 30.0

# Smallest word, bits, of an INTEGER matrix that holds grey values 0..255 with their signs.
GREY_VALUE_BITS = 16
