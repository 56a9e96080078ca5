"""Joins messages of several topics by their stamps. Pure: stamps are integers, messages anything.

Written because the usual filter freezes for good when a callback raises, and drops everything after the clock
has jumped back (a bag that loops, a simulator that restarts).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from .settings import NANOSECONDS, PENDING_SETS


@dataclass
class SyncCounters:
    """What happened so far; all numbers of messages, except ``sets`` and ``clock_jumps``."""

    sets: int = 0
    unmatched: int = 0
    late: int = 0
    clock_jumps: int = 0
    received: dict[str, int] = field(default_factory=dict)


class StampSync:
    """Collects one message of each topic with equal stamps (or within a tolerance).

    Parameters
    ----------
    topics : sequence of str
        Distinct names.
    queue_size : int
        Incomplete sets that are kept; the oldest arrival goes first.
    tolerance_ns : int
        Largest difference of stamps inside a set, nanoseconds.
    jump_ns : int
        A stamp this far behind the newest emitted set means that the clock jumped back, and everything pending is
        forgotten.

    Raises
    ------
    ValueError
        Names the argument.

    Examples
    --------
    >>> sync = StampSync(['left', 'right'])
    >>> sync.add('left', 100, 'a')
    >>> sync.add('right', 100, 'b')
    {'left': 'a', 'right': 'b'}
    >>> StampSync(['left', 'right']).explain()
    'nothing received on left, right'
    """

    def __init__(
        self, topics: Sequence[str], queue_size: int = PENDING_SETS, tolerance_ns: int = 0, jump_ns: int = NANOSECONDS
    ) -> None:
        if len(set(topics)) != len(topics) or not topics:
            raise ValueError(f'topics: expected distinct names, got {list(topics)}')
        if queue_size < 1:
            raise ValueError(f'queue_size: expected at least 1, got {queue_size}')
        if tolerance_ns < 0 or jump_ns <= 0:
            raise ValueError('tolerance_ns: expected >= 0; jump_ns: expected > 0')
        self.topics = tuple(topics)
        self.queue_size = queue_size
        self.tolerance_ns = tolerance_ns
        self.jump_ns = jump_ns
        self.counters = SyncCounters(received=dict.fromkeys(self.topics, 0))
        self._pending: list[tuple[int, dict[str, Any]]] = []  # (stamp of the first arrival, messages), by arrival
        self._newest_emitted: int | None = None
        self._late_run = dict.fromkeys(self.topics, 0)

    def add(self, topic: str, stamp_ns: int, message: Any) -> dict[str, Any] | None:
        """Take a message.

        Parameters
        ----------
        topic : str
        stamp_ns : int
            Nanoseconds.
        message : object

        Returns
        -------
        dict of str to object, or None
            The set that the message completes, by topic. It is already out of the queue: a caller that raises loses
            that set and nothing else.
        """
        if topic not in self.counters.received:
            raise ValueError(f'topic: expected one of {", ".join(self.topics)}, got {topic!r}')
        self.counters.received[topic] += 1
        if self._newest_emitted is not None and stamp_ns <= self._newest_emitted:
            if not self._clock_jumped(topic, stamp_ns):
                self.counters.late += 1
                return None
            self.forget()
            self.counters.clock_jumps += 1
        self._late_run[topic] = 0
        messages = self._group(topic, stamp_ns)
        self.counters.unmatched += topic in messages
        messages[topic] = message
        if len(messages) < len(self.topics):
            self._evict()
            return None
        self._emit(messages)
        return messages

    def forget(self) -> None:
        """Drop everything pending, and the memory of what was emitted."""
        self.counters.unmatched += sum(len(messages) for _, messages in self._pending)
        self._pending.clear()
        self._newest_emitted = None
        self._late_run = dict.fromkeys(self.topics, 0)

    def explain(self) -> str | None:
        """Why no set comes out, in words for a user; None when nothing is wrong or nothing has been received yet."""
        silent = [topic for topic, count in self.counters.received.items() if count == 0]
        if len(silent) == len(self.topics):
            return f'nothing received on {", ".join(silent)}'
        if silent:
            return f'nothing received on {", ".join(silent)} (other topics are alive)'
        if self.counters.unmatched and not self.counters.sets:
            return (
                f'stamps of {", ".join(self.topics)} do not match: {self.counters.unmatched} messages unmatched; '
                f'equal stamps are needed, or a tolerance (now {self.tolerance_ns / 1e6:g} ms)'
            )
        return None

    def _clock_jumped(self, topic: str, stamp_ns: int) -> bool:
        """Far behind means a jump at once; a little behind only when the topic stays there for a queue's length."""
        assert self._newest_emitted is not None
        self._late_run[topic] += 1
        return self._newest_emitted - stamp_ns >= self.jump_ns or self._late_run[topic] > self.queue_size

    def _group(self, topic: str, stamp_ns: int) -> dict[str, Any]:
        """The pending set of this stamp: the nearest within the tolerance that lacks the topic, or a new one.

        Of two messages of one topic with one and the same stamp the later counts: the first may be a stray of another
        time, from before a clock was set.
        """
        if self.tolerance_ns == 0:
            for stamp, pending in self._pending:
                if stamp == stamp_ns:
                    return pending
        candidates = [
            (abs(stamp - stamp_ns), index)
            for index, (stamp, messages) in enumerate(self._pending)
            if abs(stamp - stamp_ns) <= self.tolerance_ns and topic not in messages
        ]
        if candidates:
            return self._pending[min(candidates)[1]][1]
        messages: dict[str, Any] = {}
        self._pending.append((stamp_ns, messages))
        return messages

    def _evict(self) -> None:
        """Keep the queue within its size."""
        while len(self._pending) > self.queue_size:
            self.counters.unmatched += len(self._pending.pop(0)[1])

    def _emit(self, messages: dict[str, Any]) -> None:
        """Take the set out of the queue, and with it every older one: they would come out of order.

        Older is also what began earlier with a later stamp: that is a stray from a clock that was wrong, which would
        spoil the set that has its stamp by right.
        """
        place, stamp = next((k, stamp) for k, (stamp, other) in enumerate(self._pending) if other is messages)
        older = [other for k, (when, other) in enumerate(self._pending) if k < place or (k > place and when <= stamp)]
        self.counters.unmatched += sum(len(other) for other in older)
        self._pending = [entry for entry in self._pending[place + 1 :] if entry[0] > stamp]
        self._newest_emitted = stamp
        self.counters.sets += 1
