"""What an image is like, told by steps in it that stand alone: its blur, and what makes levels wander beside a step."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.special import polygamma

from msgs_py.numeric.typed import ByteArray, FloatArray

from ..geometry.settings import NOT_ZERO
from .profiles import Quality, Stretches, fit_steps
from .settings import BLUR_STEPS, FIRST_BLUR, FIRST_WALK, FLANK, LEAST_BLUR, MOST_BLUR, QUALITY_POINTS, STRONG, WALKS


class Look(NamedTuple):
    """What :class:`.profiles.Quality` holds besides tone curve and noise: see there."""

    blur: float
    walk: float
    own: float


def look_of(image: ByteArray, outline: Stretches, beside: FloatArray, tone: float, noise: float) -> Look:
    """What an image is like, by the steps of an outline that stand alone.

    The blur is that with which strong steps are explained best. The walk is that which leaves as much of them as
    noise and walk would. Where what is left differs more from step to step than it would by chance, the rest is their
    own (Smyth 2004, linear models and empirical Bayes methods: the prior of variances by their logarithms' dispersion).

    Parameters
    ----------
    image : (h, w) uint8
    outline : Stretches
        n of them.
    beside : (n, m) float64
        See :func:`.profiles.fit_steps`.
    tone, noise : float
        See :class:`.profiles.Quality`.
    """
    alone = np.flatnonzero((outline.flank == FLANK) & np.isnan(beside).all(axis=1))
    some = alone[:: max(1, -(-len(alone) // QUALITY_POINTS))]
    part = outline.some(some)
    nothing, out = beside[some], np.empty((len(some), 4))

    def left(blur: float, walk: float) -> FloatArray:
        fit_steps(image, part, nothing, Quality(tone, blur, noise, walk, 0.0), out)
        return out[:, 3]

    left(FIRST_BLUR, FIRST_WALK)
    strong = np.abs(out[:, 2]) > STRONG * noise
    if not strong.any():
        return Look(LEAST_BLUR, FIRST_WALK, 0.0)

    def unexplained(blur: float) -> float:
        return float(np.median(np.nan_to_num(left(blur, FIRST_WALK)[strong], nan=np.inf)))

    def told(first: float, step: float) -> float:
        least, most = (int(math.log(end / first) / math.log(step)) for end in (LEAST_BLUR, MOST_BLUR))
        return float(first * step ** _lowest(lambda k: unexplained(first * step**k), range(least, most + 1)))

    blur = FIRST_BLUR
    for step in BLUR_STEPS:
        blur = told(blur, step)
    # The more they may wander, the less is left: as much as was expected where the walk is right.
    most = bisect_left(WALKS, -1.0, key=lambda walk: -float(np.nanmean(left(blur, walk))))
    walk = WALKS[min(most, len(WALKS) - 1)]
    left(blur, walk)
    # What is left is of differences of neighbours, less the place and the height of a step; the logarithm of its mean
    # square varies by chance as trigamma says.
    differences = 2 * FLANK - 2
    dispersion = float(np.nanvar(np.log(out[:, 3])) - polygamma(1, 0.5 * differences))
    believed = (1.0 + np.sqrt(1.0 + 2.0 * dispersion)) / dispersion if dispersion > 0.0 else np.inf
    return Look(blur, walk, differences / (differences + believed))


def _lowest(cost: Callable[[int], float], places: range) -> float:
    """Where a cost of whole numbers is lowest, downhill from 0, a place; between them by a parabola through three."""
    known = cache(cost)
    best = 0
    while True:
        near = min((k for k in (best, best - 1, best + 1) if k in places), key=known)
        if near == best:
            break
        best = near
    if best - 1 not in places or best + 1 not in places:
        return float(best)
    before, here, after = known(best - 1), known(best), known(best + 1)
    if not np.isfinite(before + after):
        return float(best)
    return best + 0.5 * (before - after) / max(before - 2.0 * here + after, NOT_ZERO)
