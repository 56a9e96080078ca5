"""Named numbers of what all nodes share: periods, windows, and what is kept for the diagnostics."""

from __future__ import annotations

# Messages that a publisher or a subscription keeps: a result that is late is worth less than the next one.
QUEUE_DEPTH = 2
# Statuses that /diagnostics keeps, as diagnostic_updater does.
DIAGNOSTICS_DEPTH = 10
# Age, seconds, up to which another node's word that it compiles is believed: three periods of /diagnostics.
COMPILING_HEARD_S = 3.0
# Period of /diagnostics, seconds; aggregators call a status stale after five.
DIAGNOSTICS_PERIOD_S = 1.0
# Time without output after which a node says why, seconds; as long as an error counts as recent.
SILENCE_S = 5.0
# Time between two such warnings in the log, seconds.
SILENCE_LOG_S = 10.0
# Time between two log lines of one and the same problem, seconds; what comes between is counted.
REPEAT_LOG_S = 30.0

# Time over which the rate of outputs is measured, seconds.
RATE_WINDOW_S = 5.0
# Processed inputs whose latencies are kept for the percentiles; the 99th then has two above it.
LATENCY_SAMPLES = 200
# Different problems whose time is remembered: a flood of them (a fuzzer, a broken driver) must not grow memory.
REMEMBERED_PROBLEMS = 64
# Longest text in a log or a status, characters: what is wrong with a message may be its length.
LONGEST_TEXT = 1000

# Bounds that a descriptor shows where a parameter has one bound only, near the largest values of double and int64.
UNBOUNDED_FLOAT = 1e308
UNBOUNDED_INTEGER = 2**62

# Nanoseconds in a second.
NANOSECONDS = 1_000_000_000
# Sets of stereo messages that wait for their missing members.
PENDING_SETS = 5
# Half the time that images wait for camera_info of their stamp, seconds, before the last one counts; afterwards they do
# not wait. Of one stamp they are published within milliseconds.
INFO_WAIT_S = 0.1
# Cameras that one node listens to.
MOST_CAMERAS = 16
