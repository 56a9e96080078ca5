"""All jobs of a plan, and what they say together: maps, rates, failing views, other cameras, one sentence."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...batches.jobs import Store, Workers, run_jobs
from ..run_library import be_ready
from .rates import Rate
from .task import EMPTY, TRIAL, VIEW, Job, Task, do_job
from .what_if import middle_errors

RESULTS = 'results.jsonl'
YES, NO, OPEN = 'yes', 'no', 'open'


@dataclass(frozen=True)
class Aims:
    """When a rig is good enough.

    Attributes
    ----------
    recognised : float
        Least share of parts that are found within the limits.
    false : float
        Greatest share of pictures without the part in which something is taken for it.
    """

    recognised: float = 0.95
    false: float = 0.05


@dataclass(frozen=True, eq=False)
class Findings:
    """What was found.

    Attributes
    ----------
    task : Task
    views, trials, empty : list of dict
        As :mod:`.task` has them, in the order of their numbers.
    """

    task: Task
    views: list[dict[str, Any]]
    trials: list[dict[str, Any]]
    empty: list[dict[str, Any]]

    @property
    def recognised(self) -> Rate:
        """Parts in the pictures that are found."""
        errors = [error for one in self.trials for error in one['errors']]
        return Rate(sum(error is not None for error in errors), len(errors))

    @property
    def within(self) -> Rate:
        """Those found within the limits."""
        errors = [error for one in self.trials for error in one['errors']]
        return Rate(sum(self._good(error) for error in errors), len(errors))

    @property
    def false_alarms(self) -> Rate:
        """Pictures without the part in which something is taken for it."""
        return Rate(sum(one['wrong'] > 0 for one in self.empty), len(self.empty))

    @property
    def wrong(self) -> Rate:
        """Pictures with the part in which something else, or another pose, is taken for it as well."""
        return Rate(sum(one['wrong'] > 0 for one in self.trials), len(self.trials))

    def _good(self, error: list[float] | None) -> bool:
        limits = self.task.limits
        return error is not None and error[0] <= limits.translation_m and error[1] <= limits.rotation_deg

    def agreement(self) -> tuple[float, float] | None:
        """Rendered over predicted error, the median of all parts found: position, rotation; None without any."""
        ratios = [
            np.divide(error, expected)
            for one in self.trials
            for error, expected in zip(one['errors'], one['expected'])
            if error is not None
        ]
        return None if not ratios else (float(np.median(ratios, axis=0)[0]), float(np.median(ratios, axis=0)[1]))

    def rendered(self) -> list[float] | None:
        """Median and 95 % of the errors of parts found: position, metres, rotation, degrees."""
        errors = [error for one in self.trials for error in one['errors'] if error is not None]
        if not errors:
            return None
        return [float(x) for column in np.array(errors).T for x in np.quantile(column, (0.5, 0.95))]

    def predicted(self) -> list[float]:
        """The same as it is predicted, over all views."""
        return middle_errors([[one['position'], one['rotation']] for one in self.views])

    def other_cameras(self) -> dict[str, list[float]]:
        """As :meth:`predicted`, of the rig as it is and of those that differ from it in one thing."""
        rows = {'as it is': self.predicted()}
        for name in self.views[0]['variants']:
            rows[name] = middle_errors([one['variants'][name] for one in self.views])
        return rows

    def failing(self) -> list[dict[str, Any]]:
        """Views that fail, by prediction or in a trial, with the reason; those that fail in trials first."""
        limits, found = self.task.limits, []
        for number, view in enumerate(self.views):
            tried = [(k, one) for k, one in enumerate(self.trials) if one['view'] == number and one['errors']]
            failed = [(k, one) for k, one in tried if not self._good(one['errors'][0])]
            predicted = view['position'][1] > limits.translation_m or view['rotation'][1] > limits.rotation_deg
            if not failed and not predicted:
                continue
            missed = [(k, one) for k, one in failed if one['errors'][0] is None]
            found.append(
                {
                    'view': number,
                    'trial': failed[0][0] if failed else None,
                    'trials': len(tried),
                    'missed': len(missed),
                    'outside': len(failed) - len(missed),
                    'predicted': predicted,
                    'why': _why(view, predicted, missed[0][1]['reason'] if missed else ''),
                    'report': missed[0][1]['reason'] if missed else '',
                }
            )
        return sorted(found, key=lambda one: -(one['missed'] + one['outside']) / max(one['trials'], 1))

    def worst(self, count: int) -> list[tuple[int, int]]:
        """Trials and their views to be shown: those that fail, then those of which least is expected."""
        shown = [(one['trial'], one['view']) for one in self.failing() if one['trial'] is not None][:count]
        limits = self.task.limits
        by_error = np.argsort(
            [
                -max(one['position'][1] / limits.translation_m, one['rotation'][1] / limits.rotation_deg)
                for one in self.views
            ]
        )
        for number in by_error.tolist():
            if len(shown) >= count:
                break
            if number not in [view for _, view in shown]:
                shown.append((number, number))
        return shown

    def answer(self, aims: Aims) -> str:
        """YES, NO, or OPEN where too few trials were made to tell."""
        if not self.trials:
            share = np.mean([not one['predicted'] for one in self.failing()] or [True])
            return OPEN if share else NO
        low, high = self.within.interval
        if self.empty and self.false_alarms.interval[0] > aims.false:
            return NO
        if low >= aims.recognised and (not self.empty or self.false_alarms.share <= aims.false):
            return YES
        return NO if high < aims.recognised else OPEN

    def verdict(self, aims: Aims) -> str:
        """One sentence."""
        task, name = self.task, self.task.part.name
        limits = task.limits
        head = {YES: 'Yes', NO: 'No', OPEN: 'Not decided'}[self.answer(aims)]
        close = f'{1e3 * limits.translation_m:g} mm and {limits.rotation_deg:g} degrees'
        failing = self.failing()
        most = Counter(one['why'] for one in failing).most_common(1)
        weak = f'; of {len(self.views)} views {len(failing)} fail, most: {most[0][0]}' if most else ''
        typical, worst, turned, most_turned = self.predicted()
        if not self.trials:
            return (
                f'{head}, as no picture was tried: half of the poses of {name} are expected within {1e3 * typical:.2g} '
                f'mm and {turned:.2g} degrees, 95 % within {1e3 * worst:.2g} mm and {most_turned:.2g} degrees{weak}.'
            )
        rendered = self.rendered()
        half = '' if rendered is None else f', half of those found to {1e3 * rendered[0]:.2g} mm, {rendered[2]:.2g} deg'
        false = f'; without it something is taken for it in {self.false_alarms}' if self.empty else ''
        return f'{head}: {name} is found within {close} in {self.within}{half}{false}{weak}.'

    def record(self, aims: Aims) -> dict[str, Any]:
        """All of it as plain values."""
        return {
            'verdict': self.verdict(aims),
            'answer': self.answer(aims),
            'recognised': self.recognised.record,
            'within_limits': self.within.record,
            'false_alarms': self.false_alarms.record,
            'wrong_beside': self.wrong.record,
            'predicted': self.predicted(),
            'rendered': self.rendered(),
            'rendered_over_predicted': self.agreement(),
            'other_cameras': self.other_cameras(),
            'failing': self.failing(),
            'arguments': self.task.arguments,
        }


def _why(view: dict[str, Any], predicted: bool, report: str) -> str:
    """Why a view fails: what is expected of it says so, else what the search says, else nothing does."""
    if predicted:
        return str(view['reason'])
    if not report:
        return 'a pose outside the limits was answered, which is not expected'
    return f'{report.split(":")[0].split(" (")[0]} ({view["curves"]} of its edges and curves are seen)'


def carry_out(task: Task, trials: int, empty: int, out: Path, workers: Workers, fresh: bool = False) -> Findings:
    """Do all jobs of a plan that have not been done before.

    Parameters
    ----------
    task : Task
    trials, empty : int
        Pictures with the part and without it. More of them than before is no other plan.
    out : Path
        Folder in which results are kept.
    workers : Workers
    fresh : bool
        Forget what was done.

    Returns
    -------
    Findings

    Raises
    ------
    ValueError
        The folder holds another plan, or dask is not installed.
    """
    store = Store(out / RESULTS, task.arguments, fresh)
    kinds = ((VIEW, task.views), (TRIAL, trials), (EMPTY, empty))
    jobs = {f'{kind} {k}': Job(task, kind, k) for kind, count in kinds for k in range(count)}
    done = run_jobs(do_job, jobs, workers, store, 'plan', be_ready)
    views, with_part, without = ([done[f'{kind} {k}'] for k in range(count)] for kind, count in kinds)
    return Findings(task, views, with_part, without)
