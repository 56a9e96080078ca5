"""How much evidence chance reaches, and an interpretation therefore needs."""

from __future__ import annotations

import math

import numpy as np

from ..model.problem import Problem
from ..params import MatchParams
from .settings import FALSE_ALARMS


def needed_evidence(problem: Problem, params: MatchParams) -> float:
    """Nats below which an interpretation counts as chance. A rate of 1 turns the test off."""
    if params.false_alarm_rate >= 1.0:
        return -np.inf
    return false_alarm_evidence(len(problem.rows), params.false_alarm_rate)


def false_alarm_evidence(n: int, rate: float) -> float:
    """Nats that chance reaches in a share ``rate`` of the scenes of n data features."""
    nats = FALSE_ALARMS.least + FALSE_ALARMS.per_data * math.log(max(n, 1))
    return nats - FALSE_ALARMS.tail * math.log(max(rate, 1e-12))
