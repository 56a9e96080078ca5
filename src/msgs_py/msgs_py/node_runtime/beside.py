"""Work of a node beside its executor: parameters, services and diagnostics answer while it goes on.

One input is worked on at a time, in a thread. Of those that come meanwhile the newest is kept, and the others are
counted as passed over. What an input's result is made from is fixed when
work on it begins; when that holds no longer, the work is ended and the input, unless a newer one waits, is begun anew.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, Generic, TypeVar

from ..numeric.deadline import Deadline
from .background import Background
from .runtime import GraphNode

# Seconds that work has left when parameters change: what is nearly done is not lost, and nobody waits.
CHANGED_GRACE_S = 0.25
# Seconds that work which is told to end may take for it while its node is taken down.
ENDING_S = 2.0
# Seconds between two looks of a timer at whether work is done.
LOOK_S = 0.1

Given = TypeVar('Given')
Made = TypeVar('Made')


class _Job(Generic[Given, Made]):
    """An input that is worked on."""

    def __init__(self, given: Given) -> None:
        self.given = given
        self.begun = time.monotonic()
        self.deadline = Deadline()
        self.anew = self.outdated = self.dropped = self.cut = False
        self.background: Background[Made] | None = None


class Beside(Generic[Given, Made]):
    """A node's work on its inputs, in a thread of its own.

    Parameters
    ----------
    node : GraphNode
    source : str
        Of the inputs: under this name problems are reported.
    begin : callable
        Takes an input and a Deadline, and returns the work: called without arguments, in the thread, it makes the
        result, and soon after the deadline ends with what it has. What it needs of the node is taken over before.
    finish : callable
        Takes the input and the result, in the node's turn.
    """

    def __init__(
        self,
        node: GraphNode[Any],
        source: str,
        begin: Callable[[Given, Deadline], Callable[[], Made]],
        finish: Callable[[Given, Made], None],
    ) -> None:
        self._node, self._source, self._begin_work, self._finish = node, source, begin, finish
        self._job: _Job[Given, Made] | None = None
        self._newest: Given | None = None

    @property
    def seconds(self) -> float:
        """Since the work that is under way began; 0 when none is."""
        job = self._job
        return 0.0 if job is None else time.monotonic() - job.begun

    @property
    def busy(self) -> bool:
        """Whether work is under way."""
        return self._job is not None

    def take(self, given: Given) -> None:
        """Work on an input, or keep it until the one before it is done."""
        if self._job is not None:
            self._node.health.passed_over += self._newest is not None
            self._newest = given
        else:
            self._begin(given)

    def begin_anew(self, grace_s: float) -> None:
        """What is under way goes by what holds no longer: it is begun anew, unless so many seconds suffice to end it.

        With 0 it is begun anew in any case.
        """
        if self._job is not None:
            self._job.outdated = self._job.outdated or grace_s <= 0.0
            self._job.anew = True
            self._job.deadline.bring_forward(grace_s)

    def drop(self) -> None:
        """End what is under way and forget what waits; nothing comes of either."""
        self._newest = None
        if self._job is not None:
            self._job.dropped = True
            self._job.deadline.bring_forward(0.0)

    def close(self, wait_s: float) -> None:
        """End it, and wait so many seconds at most until it has ended."""
        self.drop()
        if self._job is not None and self._job.background is not None:
            self._job.background.wait(wait_s)

    def look(self) -> None:
        """Take over what is done: called at the thread's end, and by a timer should that have been overheard."""
        job = self._job
        if job is None or job.background is None or not job.background.done:
            return
        self._job = None
        if (job.outdated or (job.anew and job.cut)) and not job.dropped:
            self._newest = job.given if self._newest is None else self._newest
        elif not job.dropped:
            self._node.attempt(self._source, self._hand_over, job, job.background, begun=job.begun)
        given, self._newest = self._newest, None
        if given is not None:
            self._node.attempt(self._source, self._begin, given)

    def _hand_over(self, job: _Job[Given, Made], background: Background[Made]) -> None:
        """Finish an input; raises what its work has raised."""
        self._finish(job.given, background.result())

    def _begin(self, given: Given) -> None:
        job: _Job[Given, Made] = _Job(given)
        work = self._begin_work(given, job.deadline)

        def worked() -> Made:
            made = work()
            job.cut = job.deadline.passed
            return made

        self._job = job
        job.background = Background(worked, partial(self._node.inbox.put, self.look))
