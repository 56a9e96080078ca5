"""What a node knows of its own state: rates, latencies, drops, the last problem. Pure; time is passed in.

:mod:`msgs_py.node_runtime.runtime` publishes it on /diagnostics.
"""

from __future__ import annotations

from collections import OrderedDict, deque

import numpy as np

RATE_WINDOW_S = 5.0
LATENCY_SAMPLES = 200
# A flood of different faults (a fuzzer, a broken driver) must not grow the memory of which were reported.
REMEMBERED_PROBLEMS = 64
REPEAT_LOG_S = 30.0
# What is wrong with a message may be its length.
LONGEST_TEXT = 1000


class Health:
    """Counters of one node. Times are seconds of a steady clock.

    dropped : inputs that arrived and were refused; lost : inputs that were published and never reached a callback,
    because newer ones overtook them in the queue, or the network dropped or garbled them.
    """

    def __init__(self, now: float) -> None:
        self.started = now
        self.processed = 0
        self.dropped = 0
        self.lost = 0
        self.problems = 0
        self.last_error = ''
        self.last_error_time: float | None = None
        self.last_output_time: float | None = None
        self._outputs: deque[float] = deque()
        self._latencies: deque[float] = deque(maxlen=LATENCY_SAMPLES)
        self._seen: OrderedDict[str, tuple[float, int]] = OrderedDict()

    def done(self, now: float, latency_s: float) -> None:
        """One input was processed and its results are out."""
        self.processed += 1
        self.last_output_time = now
        self._outputs.append(now)
        self._latencies.append(latency_s)

    @property
    def last_latency_s(self) -> float:
        """Time the last processed input took; NaN before the first."""
        return self._latencies[-1] if self._latencies else float('nan')

    def problem(self, now: float, text: str) -> str | None:
        """Note a problem; return what to log, or None when this was logged a moment ago."""
        text = shortened(text)
        self.problems += 1
        self.last_error, self.last_error_time = text, now
        if text not in self._seen:
            while len(self._seen) >= REMEMBERED_PROBLEMS:
                self._seen.popitem(last=False)
            self._seen[text] = (now, 0)
            return text
        logged, repeats = self._seen[text]
        self._seen.move_to_end(text)
        if now - logged < REPEAT_LOG_S:
            self._seen[text] = (logged, repeats + 1)
            return None
        self._seen[text] = (now, 0)
        return f'{text} (and {repeats} times more)' if repeats else text

    def rate_hz(self, now: float) -> float:
        """Outputs per second over the last few seconds."""
        while self._outputs and now - self._outputs[0] > RATE_WINDOW_S:
            self._outputs.popleft()
        return len(self._outputs) / min(RATE_WINDOW_S, max(now - self.started, 1.0))

    def values(self, now: float) -> dict[str, object]:
        """Key and value pairs for /diagnostics, in the order a person wants to read them."""
        latencies = 1e3 * np.asarray(self._latencies)
        p50, p99 = np.percentile(latencies, [50, 99]) if len(latencies) else (np.nan, np.nan)
        age = '' if self.last_error_time is None else f'{now - self.last_error_time:.1f}'
        return {
            'rate_hz': f'{self.rate_hz(now):.2f}',
            'processed': self.processed,
            'dropped': self.dropped,
            'lost_inputs': self.lost,
            'latency_p50_ms': f'{p50:.1f}',
            'latency_p99_ms': f'{p99:.1f}',
            'problems': self.problems,
            'last_error': self.last_error,
            'last_error_age_s': age,
        }


def shortened(text: str) -> str:
    """The text with its middle left out when it is too long for a log."""
    if len(text) <= LONGEST_TEXT:
        return text
    return f'{text[: LONGEST_TEXT // 2]} [...] {text[-LONGEST_TEXT // 4 :]}'


class SequenceGaps:
    """Counts what one writer has published and a reader has not been given, from the writer's sequence numbers."""

    def __init__(self) -> None:
        self._last: int | None = None

    def missed(self, number: int | None) -> int:
        """How many went missing just before this one. A number that goes back is a writer started anew."""
        last, self._last = self._last, number
        if number is None or last is None or number <= last:
            return 0
        return number - last - 1
