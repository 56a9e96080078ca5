"""How much evidence chance reaches, and an interpretation therefore needs."""

from __future__ import annotations

import math

from ..model.problem import Problem
from ..params import MatchParams
from .settings import FALSE_ALARMS


def needed_evidence(problem: Problem, params: MatchParams) -> float:
    """The evidence that an interpretation needs.

    Parameters
    ----------
    problem : Problem
        Model and data.
    params : MatchParams
        Its false_alarm_rate; 1 turns the test off.

    Returns
    -------
    float
        Nats; with less, an interpretation counts as chance.
    """
    if params.false_alarm_rate >= 1.0:
        return -math.inf
    return false_alarm_evidence(problem.of_its_kinds, params.false_alarm_rate)


def false_alarm_evidence(n: int, rate: float) -> float:
    """The evidence that chance reaches.

    Parameters
    ----------
    n : int
        Data features of a scene.
    rate : float
        Share of the scenes in which chance reaches as much; below 1e-12 counts as 1e-12.

    Returns
    -------
    float
        Nats.

    Examples
    --------
    >>> round(false_alarm_evidence(100, 1e-3), 2)
    15.29
    """
    nats = FALSE_ALARMS.least + FALSE_ALARMS.per_data * math.log(max(n, 1))
    return nats - FALSE_ALARMS.tail * math.log(max(rate, 1e-12))
