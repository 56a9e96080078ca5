"""merger_node: what several matcher_nodes answer, each with a share of the models, as one answer."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Header

from msgs_py import Interpretation
from msgs_py.codecs import interpretations_from_report
from msgs_py.node_runtime.config import parameter
from msgs_py.node_runtime.runtime import run_node
from msgs_py.node_runtime.settings import NANOSECONDS
from msgs_py.node_runtime.stamp_sync import stamp_ns

from .answering_node import TOPIC, AnsweringConfig, AnsweringNode
from .catalogue.merging import merged
from .params import MatchResult
from .settings import MESSAGES_KEPT, MOST_SHARDS, WAIT_S


@dataclass(frozen=True)
class MergerConfig(AnsweringConfig):
    """Parameters of merger_node."""

    shards: int = parameter(
        2,
        'How many matcher_nodes there are; of the second, whose shard is 2/N, shard_2/interpretations/report is heard',
        minimum=1,
        maximum=MOST_SHARDS,
        read_only=True,
    )
    wait: float = parameter(
        3.0,
        'Time from the first answer about a message until those that are missing are given up',
        unit='s',
        minimum=0.01,
        maximum=3600.0,
    )


@dataclass(eq=False)
class _Pending:
    """Answers about one message, by the number of the shard, and when the first of them came (monotonic seconds)."""

    header: Header
    since: float
    answers: dict[int, list[Interpretation]] = field(default_factory=dict)


class MergerNode(AnsweringNode[MergerConfig]):
    """Publishes for each message what all shards answered; the best explanation of each piece of data wins."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('merger_node', MergerConfig, **kwargs)
        self._pending: OrderedDict[int, _Pending] = OrderedDict()
        self._answered = -1
        self._given_up: list[int] = []
        self._missed = 0
        self.start()

    # -- its life ----------------------------------------------------------------------------------------------

    def configure(self) -> None:
        """Make the outputs, and read the models."""
        self._make_outputs()
        self._load()
        self._start_transforms()

    def activate(self) -> None:
        """Subscribe, and say what is latched."""
        self._answers.tell_symmetries()
        for number in range(1, self.config.shards + 1):
            self.listen(DiagnosticArray, f'shard_{number}/{TOPIC}/report', self._heard(number))
        self.every(WAIT_S, self._wait_no_longer, clock=self._steady_clock)

    def deactivate(self) -> None:
        """Forget what is not answered yet."""
        self._pending.clear()
        self._instances.clear()
        self._answered, self._given_up = -1, []

    def on_config(self, old: MergerConfig, new: MergerConfig) -> None:
        """Take over what was changed."""
        super().on_config(old, new)
        if (new.models, new.mesh_units) != (old.models, old.mesh_units):
            self._load()

    def reset(self) -> str:
        """Read the models again, and forget what is not answered yet."""
        self.deactivate()
        self._missed = 0
        self._load()
        return 'counters, answers that waited for others, and the models read again'

    # -- work --------------------------------------------------------------------------------------------------

    def _heard(self, number: int) -> Callable[[DiagnosticArray], None]:
        return partial(self._on_report, number)

    def _on_report(self, number: int, report: DiagnosticArray) -> None:
        """An answer of a shard; when it is the last that was missing, all of them."""
        answers = interpretations_from_report(report)
        stamp = stamp_ns(report.header)
        late = stamp < self._answered and self._answered - stamp < self.config.wait * NANOSECONDS
        if late or (stamp == self._answered and number in self._given_up):
            return  # it was waited for long enough; a stamp that is much older is of a clock that was set back
        pending = self._pending.setdefault(stamp, _Pending(report.header, time.monotonic()))
        pending.answers[number] = answers
        if len(pending.answers) == self.config.shards:
            # What is older will not be complete: shards answer in the order of the messages.
            for earlier in [one for one in self._pending if one < stamp]:
                self._answer(earlier)
            self._answer(stamp)
        while len(self._pending) > MESSAGES_KEPT:
            self._answer(next(iter(self._pending)))

    def _wait_no_longer(self) -> None:
        self._look_for_changes()
        for stamp, pending in list(self._pending.items()):
            if time.monotonic() - pending.since > self.config.wait:
                self.attempt('shards', self._answer, stamp)

    def _answer(self, stamp: int) -> None:
        """Publish what there is about a message; who has not answered is named."""
        pending = self._pending.pop(stamp)
        self._answered = stamp
        self._given_up = [k for k in range(1, self.config.shards + 1) if k not in pending.answers]
        if self._given_up:
            self._missed += 1
            missing = ', '.join(map(str, self._given_up))
            self.problem(f'shards: no answer of shard {missing} within {self.config.wait:g} s')
        accepted, rejected = merged([pending.answers[k] for k in sorted(pending.answers)])
        try:
            self._models_of({one.model for one in accepted})
        except KeyError as error:
            raise ValueError(f'a shard has found {error.args[0]}, which parameter models does not have') from None
        self._publish(MatchResult(accepted, rejected), pending.header)
        self.done(pending.header)

    # -- health ------------------------------------------------------------------------------------------------

    def why_silent(self) -> str | None:
        """What keeps the node from answering; None when nothing does."""
        return self._no_model() or None

    def report_values(self) -> dict[str, object]:
        """What diagnostics say besides the counters."""
        return {**super().report_values(), 'waiting': len(self._pending), 'incomplete': self._missed}


def main(args: list[str] | None = None) -> int:
    """Run the node until it is told to stop; the exit status."""
    return run_node(MergerNode, args)


if __name__ == '__main__':
    raise SystemExit(main())
