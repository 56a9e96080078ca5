"""Joins messages of several topics by their stamps. Pure: stamps are integers, messages anything.

Written because the usual filter freezes for good when a callback raises, and drops everything after the clock
has jumped back (a bag that loops, a simulator that restarts).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from .settings import NANOSECONDS, PENDING_SETS


def stamp_ns(header: Any) -> int:
    """The stamp of a message's header, nanoseconds."""
    return int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)


@dataclass
class SyncCounters:
    """What happened so far; all numbers of messages, except ``sets`` and ``clock_jumps``.

    ``borrowed`` are the messages of lasting topics that a set took though they have another stamp, ``spare`` those that
    came while sets borrow, and belong to no stamp of a set.
    """

    sets: int = 0
    unmatched: int = 0
    late: int = 0
    clock_jumps: int = 0
    borrowed: int = 0
    spare: int = 0
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
    lasting : sequence of str
        Topics whose last message holds until another comes: where they do not bear the stamps of the others (a driver
        that says once how its cameras are calibrated), sets take the last one.

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
        self,
        topics: Sequence[str],
        queue_size: int = PENDING_SETS,
        tolerance_ns: int = 0,
        jump_ns: int = NANOSECONDS,
        lasting: Sequence[str] = (),
    ) -> None:
        if len(set(topics)) != len(topics) or not topics:
            raise ValueError(f'topics: expected distinct names, got {list(topics)}')
        if queue_size < 1:
            raise ValueError(f'queue_size: expected at least 1, got {queue_size}')
        if tolerance_ns < 0 or jump_ns <= 0:
            raise ValueError('tolerance_ns: expected >= 0; jump_ns: expected > 0')
        if not set(lasting) < set(topics):
            raise ValueError(f'lasting: expected some of {list(topics)}, got {list(lasting)}')
        self.topics = tuple(topics)
        self.lasting = tuple(lasting)
        self.queue_size = queue_size
        self.tolerance_ns = tolerance_ns
        self.jump_ns = jump_ns
        self.counters = SyncCounters(received=dict.fromkeys(self.topics, 0))
        self._pending: list[tuple[int, dict[str, Any]]] = []  # (stamp of the first arrival, messages), by arrival
        self._newest_emitted: int | None = None
        self._late_run = dict.fromkeys(self.topics, 0)
        self._last: dict[str, Any] = {}  # of lasting topics
        self._borrows = False  # whether the last set has borrowed: then the next one need not wait
        self._overdue: dict[str, Any] | None = None  # what lacked only lasting topics at the last look

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
        if topic in self.lasting:
            self._last[topic] = message
            if self._borrows and not self._belongs(stamp_ns):
                self.counters.spare += 1
                return None
            self._borrows = False
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
        if len(messages) == len(self.topics):
            self._borrows = False
            self._emit(messages)
            return messages
        if self._borrows and self._lacks_lasting(messages):
            return self._borrowed(messages)
        return self._evict()

    def overdue(self) -> dict[str, Any] | None:
        """To be called now and then: a set that has lacked nothing but lasting topics since the call before.

        Returns
        -------
        dict of str to object, or None
            The newest such set, with the last messages of those topics.
        """
        before, self._overdue = self._overdue, self._lacking_lasting()
        if self._overdue is None or self._overdue is not before:
            return None
        return self._borrowed(self._overdue)

    @property
    def unheard(self) -> list[str]:
        """Lasting topics of which nothing was received."""
        return [topic for topic in self.lasting if topic not in self._last]

    def last(self, topic: str) -> Any:
        """The last message of a lasting topic; None before there is one."""
        return self._last.get(topic)

    def forget(self) -> None:
        """Drop everything pending, and the memory of what was emitted; what lasts is kept."""
        self.counters.unmatched += sum(len(messages) for _, messages in self._pending)
        self._pending.clear()
        self._newest_emitted, self._overdue = None, None
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

    def _belongs(self, stamp_ns: int) -> bool:
        """Whether a stamp is that of something pending, or of the newest set."""
        stamps = [stamp for stamp, _ in self._pending]
        if self._newest_emitted is not None:
            stamps.append(self._newest_emitted)
        return any(abs(stamp - stamp_ns) <= self.tolerance_ns for stamp in stamps)

    def _lacks_lasting(self, messages: dict[str, Any]) -> bool:
        """Whether a set lacks nothing but messages of lasting topics, of which there are earlier ones."""
        return all(topic in messages or topic in self._last for topic in self.topics)

    def _lacking_lasting(self) -> dict[str, Any] | None:
        """The pending set of the newest stamp that lacks nothing else."""
        found = [entry for entry in self._pending if self._lacks_lasting(entry[1])]
        return max(found, key=lambda entry: entry[0])[1] if found else None

    def _borrowed(self, messages: dict[str, Any]) -> dict[str, Any]:
        """The set, emitted, with the last messages of the lasting topics that it lacks."""
        missing = [topic for topic in self.lasting if topic not in messages]
        self._emit(messages)
        self.counters.borrowed += len(missing)
        self._borrows = True
        return messages | {topic: self._last[topic] for topic in missing}

    def _evict(self) -> dict[str, Any] | None:
        """Keep the queue within its size; what would be dropped for want of lasting topics alone is a set."""
        while len(self._pending) > self.queue_size:
            lacking = self._lacking_lasting() if self._lacks_lasting(self._pending[0][1]) else None
            if lacking is not None:
                return self._borrowed(lacking)
            self.counters.unmatched += len(self._pending.pop(0)[1])
        return None

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
