"""How much evidence chance reaches, and an interpretation therefore needs."""

from __future__ import annotations

import math

import numpy as np

from ..model.problem import Problem
from ..params import MatchParams
from .settings import FALSE_ALARM_LEAST, FALSE_ALARM_PER_DATA, FALSE_ALARM_TAIL


def needed_evidence(problem: Problem, params: MatchParams) -> float:
    """Nats below which an interpretation counts as chance. A rate of 1 turns the test off."""
    if params.false_alarm_rate >= 1.0:
        return -np.inf
    return false_alarm_evidence(len(problem.rows), params.false_alarm_rate)


def false_alarm_evidence(n: int, rate: float) -> float:
    """Nats that chance reaches in a share ``rate`` of the scenes of n data features."""
    return (
        FALSE_ALARM_LEAST + FALSE_ALARM_PER_DATA * math.log(max(n, 1)) - FALSE_ALARM_TAIL * math.log(max(rate, 1e-12))
    )
