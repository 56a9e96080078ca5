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

# Most that all clients together may store, have waiting and keep as results, bytes: eight clients with all that one may
# store.
TOTAL_BYTES = 8 * STORE_BYTES
# What a stored name takes beside its characters and its value, bytes: its place in two dictionaries and a numpy array's
# header (sys.getsizeof gives 48 to 112 each).
NAME_BYTES = 200

# Names of data and shapes of one client, together: an entry with more arguments is no program of a person.
MAX_NAMES = 1000
# Requests that may wait for one client.
MAX_WAITING = 32
# Calls of services that may wait for a run or for the compiler: the executor asks each of them in turn whether it is
# done, in about half a millisecond.
MAX_CALLS = 64
# Requests that may wait in all, of all clients.
MAX_WAITING_IN_ALL = 256
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

# Programs of clients run in processes of their own. Time that such a process may take to start, seconds: 0.3 on an idle
# machine.
PROCESS_START_S = 30.0
# Memory that a program may use beyond that of its process at the start, bytes: the largest store (64 MB, 610) holds
# bits that numpy spreads over bytes (x 8), and an operation has up to four such arrays at once.
PROCESS_BYTES = 2 << 30
# A program looks at its limits between operations. After this share of its time more, or this time, seconds, whichever
# is longer, it is inside one operation, and its process is ended; together they keep within 10 % or 50 ms.
LATE_SHARE = 0.05
LATE_S = 0.015
# The same after a cancellation, seconds.
CANCEL_GRACE_S = 0.015
# Time between two looks at whether a request was cancelled, seconds.
CANCEL_PERIOD_S = 0.005

# Time that a client waits for the emulator, seconds.
CLIENT_TIMEOUT_S = 30.0

# Smallest word, bits, of an INTEGER matrix that holds grey values 0..255 with their signs.
GREY_VALUE_BITS = 16
# Largest answer of an image program, bytes: all arguments of its entry, at most what the largest store spreads over
# bytes.
LARGEST_IMAGE_BYTES = 512_000_000
