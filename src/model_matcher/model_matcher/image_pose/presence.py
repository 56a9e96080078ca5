"""Whether the images show an outline where a pose puts it: a likelihood ratio against the same images beside it.

A point of the outline is confirmed by a step within a pixel of it. Along a curve confirmations come in runs, for two
reasons: the curve is there, and all but a few of its points are confirmed until something stands before it; or some
other edge of the scene lies there by chance. Both are hidden Markov chains. They differ in how often a curve is of the
first kind, which is nearly the same for a short curve and a long one: it is curves that are counted, not pixels. How
often chance confirms a point, and how often a run of them, is counted in the same images, on the same outline moved
along its normals (the a-contrario principle; Desolneux, Moisan & Morel, From Gestalt theory to image analysis).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int8Array, Int32Array

from .alignment import Placed, Steps
from .settings import (
    CONTROLS,
    HIDDEN,
    LEAST_RUN,
    ON_EDGE,
    OWN_STEP,
    PLACES_TRIED,
    PRIOR_ALIGNED,
    PRIOR_CHANCES,
    REVEALED,
    RUN_ENDS,
    SEEN_STEP,
    STOPS,
)


class Chance(NamedTuple):
    """What chance confirms.

    Attributes
    ----------
    after_none, after_one, first : float
        Chances of a confirmation where no edge runs along the outline: after a point without one, after one, and where
        a curve begins.
    aligned : float
        Share of the outline along which an edge runs that is not its own.
    """

    after_none: float
    after_one: float
    first: float
    aligned: float


@njit(nogil=True)
def confirmations(offset: FloatArray, count: Int32Array, at: float) -> Int8Array:
    """Whether each profile has a step within ON_EDGE pixels of a place ``at``, (n,): 1, 0, or -1 outside the image."""
    out = np.empty(len(count), np.int8)
    for k in range(len(count)):
        out[k] = -1 if count[k] < 0 else 0
        for j in range(count[k]):
            if abs(offset[k, j] - at) <= ON_EDGE:
                out[k] = 1
    return out


def chance_beside(steps: Steps, group: Int32Array) -> Chance:
    """What chance confirms of an outline in these images: counted beside it, with what is believed beforehand.

    Parameters
    ----------
    steps : Steps
        Found along the normals of n points, to the farthest of CONTROLS and ON_EDGE beyond.
    group : (n,) int32
        Curve and view of each point, contiguous.
    """
    yes, all_, in_runs, points = _count_beside(steps.offset, steps.number, group)
    once = (in_runs + PRIOR_ALIGNED[0]) / (points + PRIOR_ALIGNED[1])
    chances = yes / all_
    return Chance(chances[0], min(chances[1], SEEN_STEP / 1.5), chances[2], 1.0 - (1.0 - once) ** PLACES_TRIED)


@njit(nogil=True)
def _count_beside(
    offset: FloatArray, count: Int32Array, group: Int32Array
) -> tuple[FloatArray, FloatArray, float, float]:
    """Confirmations and points (3,) after none, after one and at first; points in long runs, and all points."""
    yes, all_ = np.empty(3), np.empty(3)
    for i in range(3):
        yes[i], all_[i] = PRIOR_CHANCES[i][0], PRIOR_CHANCES[i][1]
    in_runs, points = 0.0, 0.0
    for at in CONTROLS:
        found = confirmations(offset, count, at)
        run, length = 0, 0
        for k in range(len(found) + 1):
            ends = k == len(found) or (k > 0 and group[k] != group[k - 1])
            if ends or found[k] != 1:
                # The whole of a short curve is a run.
                if run >= LEAST_RUN or (ends and run > 1 and run == length):
                    in_runs += run
                run = 0
            length = 0 if ends else length
            if k == len(found) or found[k] < 0:
                continue
            length += 1
            linked = k > 0 and group[k] == group[k - 1] and found[k - 1] >= 0
            i = (1 if found[k - 1] else 0) if linked else 2
            all_[i] += 1.0
            yes[i] += found[k]
            points += 1.0
            run += found[k]
    return yes, all_, in_runs, points


@njit(nogil=True)
def crowded(placed: Placed) -> BoolArray:
    """Points, (n,) bool, that a curve before theirs passes so near that one step of the image would confirm both."""
    n = len(placed.eye)
    out = np.zeros(n, np.bool_)
    for k in range(n):
        for j in range(k - 1, -1, -1):
            if placed.eye[j] != placed.eye[k]:
                break
            if placed.group[j] == placed.group[k]:
                continue
            du, dv = placed.pixel[j, 0] - placed.pixel[k, 0], placed.pixel[j, 1] - placed.pixel[k, 1]
            if du * du + dv * dv < OWN_STEP * OWN_STEP:
                out[k] = True
                break
    return out


@njit(nogil=True)
def _log_chain(found: Int8Array, group: Int32Array, chance: Chance, hidden: float) -> float:
    """Log-likelihood of confirmations when a share of the outline is hidden; 1: all of it, and chance alone speaks."""
    enter = RUN_ENDS * chance.aligned / (1.0 - chance.aligned)
    back = min(STOPS * (1.0 - hidden) / hidden, REVEALED)
    loose, aligned, seen, total = 0.0, 0.0, 0.0, 0.0
    for k in range(len(found)):
        if found[k] < 0:
            continue
        one = chance.first
        if k > 0 and group[k] == group[k - 1] and found[k - 1] >= 0:
            stays = loose + aligned
            loose, aligned = loose * (1.0 - enter) + aligned * RUN_ENDS, loose * enter + aligned * (1.0 - RUN_ENDS)
            stops = seen * STOPS
            loose = loose * (1.0 - back) + stops * (1.0 - chance.aligned)
            aligned = aligned * (1.0 - back) + stops * chance.aligned
            seen = seen - stops + stays * back
            one = chance.after_one if found[k - 1] else chance.after_none
        else:
            loose, aligned, seen = hidden * (1.0 - chance.aligned), hidden * chance.aligned, 1.0 - hidden
        run = SEEN_STEP
        if not found[k]:
            one, run = 1.0 - one, 1.0 - run
        loose, aligned, seen = loose * one, aligned * run, seen * run
        here = loose + aligned + seen
        total += math.log(here)
        loose, aligned, seen = loose / here, aligned / here, seen / here
    return total


@njit(nogil=True)
def log_ratio(found: Int8Array, group: Int32Array, chance: Chance) -> float:
    """Log-likelihood ratio of confirmations: an outline that may be hidden in parts, against chance.

    Parameters
    ----------
    found : (n,) int8
        See :func:`confirmations`; what is negative says nothing.
    group : (n,) int32
        Curve and view of each, contiguous.
    chance : Chance

    Returns
    -------
    float
        Nats; the mean over how much of the outline is hidden.
    """
    nothing = _log_chain(found, group, chance, 1.0)
    parts = np.empty(len(HIDDEN))
    for p in range(len(HIDDEN)):
        parts[p] = _log_chain(found, group, chance, HIDDEN[p]) - nothing
    top = parts.max()
    ratio: float = top + math.log(np.exp(parts - top).mean())
    return ratio
