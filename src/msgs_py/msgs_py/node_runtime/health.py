"""What a node knows of its own state: rates, latencies, drops, the last problem. Pure; time is passed in.

:mod:`msgs_py.node_runtime.runtime` publishes it on /diagnostics.
"""

from __future__ import annotations

from collections import OrderedDict, deque

import numpy as np

from .settings import LATENCY_SAMPLES, LONGEST_TEXT, RATE_WINDOW_S, REMEMBERED_PROBLEMS, REPEAT_LOG_S


class Health:
    """Counters of one node.

    Parameters
    ----------
    now : float
        Seconds of a steady clock, as all times here.

    Attributes
    ----------
    processed : int
        Inputs whose results are out.
    dropped : int
        Inputs that arrived and were refused.
    lost : int
        Inputs that were published and never reached a callback, because newer ones overtook them in the queue, or the
        network dropped or garbled them.
    passed_over : int
        Inputs that reached one while the node was at work, and were still waiting when a newer one came.
    problems : int
        Problems reported, repeats included.
    last_error : str
        Text of the last one.

    Examples
    --------
    >>> health = Health(now=0.0)
    >>> health.problem(1.0, 'image.data: truncated'), health.problem(2.0, 'image.data: truncated')
    ('image.data: truncated', None)
    >>> health.done(3.0, latency_s=0.02)
    >>> health.values(3.0)['latency_p50_ms']
    '20.0'
    """

    def __init__(self, now: float) -> None:
        self.started = now
        self.processed = 0
        self.dropped = 0
        self.lost = 0
        self.passed_over = 0
        self.problems = 0
        self.last_error = ''
        self.last_error_time: float | None = None
        self.last_output_time: float | None = None
        self._outputs: deque[float] = deque()
        self._latencies: deque[float] = deque(maxlen=LATENCY_SAMPLES)
        self._seen: OrderedDict[str, tuple[float, int]] = OrderedDict()

    def done(self, now: float, latency_s: float) -> None:
        """Count an input whose results are out, and that took so long."""
        self.processed += 1
        self.last_output_time = now
        self._outputs.append(now)
        self._latencies.append(latency_s)

    @property
    def last_latency_s(self) -> float:
        """Time the last processed input took; NaN before the first."""
        return self._latencies[-1] if self._latencies else float('nan')

    def problem(self, now: float, text: str) -> str | None:
        """Note a problem.

        Returns
        -------
        str or None
            What to log; None when the same was logged a moment ago.
        """
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
            'passed_over': self.passed_over,
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
    """Counts what one writer has published and a reader has not been given, from the writer's sequence numbers.

    Examples
    --------
    >>> gaps = SequenceGaps()
    >>> [gaps.missed(number) for number in (1, 2, 5, 1)]
    [0, 0, 2, 0]
    """

    def __init__(self) -> None:
        self._last: int | None = None

    def missed(self, number: int | None) -> int:
        """How many went missing just before this one. A number that goes back is a writer started anew."""
        last, self._last = self._last, number
        if number is None or last is None or number <= last:
            return 0
        return number - last - 1
