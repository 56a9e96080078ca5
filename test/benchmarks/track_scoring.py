"""What a tracker is worth: frames lost, wrong poses held, losses not noticed, errors, time a frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pose_scoring import WRONG_DEG, WRONG_M
from true_poses import Difference, Instance, difference

from msgs_py import Pose

# A tracker has to hold a part of which so much is seen, and to notice that one is gone of which so little is.
HELD_SHARE, GONE_SHARE = 0.4, 0.05
# Frames within which a loss has to be noticed, and for which a wrong pose may be held.
NOTICED = 3


@dataclass(frozen=True, eq=False)
class Step:
    """A frame's answer: the instance as it is, what was said of it, and the time, by the clock and of processors.

    seen : the share of it that the eye sees which sees most, where it is more than that of the instance
    """

    instance: Instance
    pose: Pose | None
    milliseconds: float
    cpu_milliseconds: float
    seen: float | None = None

    @property
    def off(self) -> Difference | None:
        return None if self.pose is None else difference(self.instance, self.pose)

    @property
    def right(self) -> bool:
        off = self.off
        return off is not None and off.within(WRONG_DEG, WRONG_M)

    @property
    def wrong(self) -> bool:
        return self.pose is not None and not self.right


def score_track(steps: list[Step]) -> dict[str, Any]:
    """One flat row of plain values.

    lost: of the frames in which the part has to be held, those without a right pose; wrong: frames with a wrong pose;
    held_wrong: the most of those in a row, late: frames beyond NOTICED of a row that a wrong pose was held, or one of a
    part that is gone; deg, mm: of right poses, median and p90; first_ms: what only the first frame costs.
    """
    shares = np.array([step.instance.share for step in steps])
    right = np.array([step.right for step in steps], bool)
    wrong = np.array([step.wrong for step in steps], bool)
    told = np.array([step.pose is not None for step in steps], bool)
    # Held is asked of what both eyes see; gone is what neither does.
    seen = np.array([step.instance.share if step.seen is None else step.seen for step in steps])
    held, gone = shares >= HELD_SHARE, seen < GONE_SHARE
    mistaken = wrong | (told & gone)
    runs = run_lengths(mistaken)
    offs = [step.off for step in steps if step.right]
    row: dict[str, Any] = {
        'frames': len(steps),
        'to_hold': int(held.sum()),
        'lost': int((held & ~right).sum()),
        'gone': int(gone.sum()),
        'wrong': int(wrong.sum()),
        'held_wrong': max(runs, default=0),
        'late': sum(max(0, run - NOTICED) for run in runs),
        'first_ms': steps[0].milliseconds if steps else None,
    }
    row['lost_share'] = row['lost'] / row['to_hold'] if row['to_hold'] else None
    times = [step.milliseconds for step in steps[1:]]
    for key, values, quantiles in (
        ('deg', [off.degrees for off in offs if off is not None], (0.5, 0.9)),
        ('mm', [1e3 * off.metres for off in offs if off is not None], (0.5, 0.9)),
        ('ms', times, (0.5, 0.99)),
        ('cpu_ms', [step.cpu_milliseconds for step in steps[1:]], (0.5,)),
    ):
        names = {0.5: key, 0.9: f'{key}_p90', 0.99: f'{key}_p99'}
        row |= {names[q]: float(np.quantile(values, q)) if values else None for q in quantiles}
    return row


def run_lengths(flags: np.ndarray) -> list[int]:
    """How many frames each run of true ones lasts.

    >>> run_lengths(np.array([True, False, True, True]))
    [1, 2]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(flags, int), [0]])))
    return [int(end - begin) for begin, end in zip(edges[::2], edges[1::2])]
