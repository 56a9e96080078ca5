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
    return false_alarm_evidence(problem.hypotheses, params.false_alarm_rate)


def needed_with_images(params: MatchParams) -> float:
    """The evidence that an interpretation needs when the images are asked, too.

    Parameters
    ----------
    params : MatchParams
        Its false_alarm_rate; 1 turns the test off.

    Returns
    -------
    float
        Nats: see :class:`.settings.ImageEvidence`. It does not grow with the data: the images are asked about few
        hypotheses, however many were searched.
    """
    if params.false_alarm_rate >= 1.0:
        return -math.inf
    return -math.log(max(params.false_alarm_rate, 1e-12))


def chance_of(problem: Problem, evidence: float) -> float:
    """How often chance brings so much evidence of features alone.

    Parameters
    ----------
    problem : Problem
        Model and data.
    evidence : float
        Nats.

    Returns
    -------
    float
        Share of the scenes without the model: the rate whose :func:`false_alarm_evidence` this is, at most 1.
    """
    nats = false_alarm_evidence(problem.hypotheses, 1.0)
    return min(1.0, math.exp(min(0.0, (nats - evidence) / FALSE_ALARMS.tail)))


def chance_with_images(evidence: float) -> float:
    """How often chance brings so much evidence of features and images.

    Parameters
    ----------
    evidence : float
        Nats.

    Returns
    -------
    float
        Share of the searches for a model that is not there, at most 1: see :class:`.settings.ImageEvidence`.

    Examples
    --------
    >>> round(chance_with_images(needed_with_images(MatchParams(false_alarm_rate=0.01))), 4)
    0.01
    """
    return math.exp(min(0.0, -evidence))


def false_alarm_evidence(hypotheses: float, rate: float) -> float:
    """The evidence that chance reaches.

    Parameters
    ----------
    hypotheses : float
        That there are, see :attr:`.Problem.hypotheses`.
    rate : float
        Share of the scenes in which chance reaches as much; below 1e-12 counts as 1e-12.

    Returns
    -------
    float
        Nats.

    Examples
    --------
    >>> round(false_alarm_evidence(20000, 1e-3), 2)
    17.49
    """
    return FALSE_ALARMS.least + FALSE_ALARMS.tail * math.log((hypotheses + FALSE_ALARMS.alike) / max(rate, 1e-12))
