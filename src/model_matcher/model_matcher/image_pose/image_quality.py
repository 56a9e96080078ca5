"""What an image is like, told by steps in it that stand alone: its blur, and what makes levels wander beside a step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, ByteArray, FloatArray

from ..geometry.settings import NOT_ZERO
from .profiles import FITTED, Profiles, Quality, Stretches, fit_profiles, profiles_of
from .settings import (
    BLUR_SHARE,
    BLUR_STEPS,
    FIRST_BLUR,
    FIRST_SLOPE,
    FIRST_WALK,
    FLANK,
    LEAST_BLUR,
    LEAST_SLOPE,
    MOST_BLUR,
    QUALITY_POINTS,
    STRONG,
    WALKS,
)


class Look(NamedTuple):
    """What :class:`.profiles.Quality` holds besides tone curve and noise: see there."""

    blur: float
    walk: float
    slope: float


def look_of(image: ByteArray, outline: Stretches, beside: FloatArray, tone: float, noise: float) -> Look:
    """What an image is like, by the steps of an outline that stand alone.

    The blur is that with which strong steps are explained best. The walk is that which leaves as much of them as
    noise and walk would; the slope of shade is what the steps' own spread beyond that.

    Parameters
    ----------
    image : (h, w) uint8
    outline : Stretches
        n of them.
    beside : (n, m, 2) float64
        See :func:`.profiles.fit_profiles`.
    tone, noise : float
        See :class:`.profiles.Quality`.
    """
    alone = np.flatnonzero((outline.flank == FLANK) & np.isnan(beside[:, :, 0]).all(axis=1))
    some = alone[:: max(1, -(-len(alone) // QUALITY_POINTS))]
    each = outline.some(some)._replace(together=np.ones(len(some)))
    return Look(*_look_of(_Steps(profiles_of(image, each, tone), each, beside[some], tone, noise)))


class _Steps(NamedTuple):
    """Steps that stand alone, and what is known of their image: see :func:`look_of`."""

    profiles: Profiles
    outline: Stretches
    beside: FloatArray
    tone: float
    noise: float


@njit(nogil=True)
def _look_of(steps: _Steps) -> tuple[float, float, float]:
    """As :func:`look_of`."""
    out = np.full((len(steps.outline.spacing), FITTED), np.nan)
    _fit(steps, FIRST_BLUR, FIRST_WALK, out)
    if np.isnan(out[:, 0]).all():
        return FIRST_BLUR, FIRST_WALK, FIRST_SLOPE
    strong = np.abs(out[:, 2]) > STRONG * steps.noise
    blur = FIRST_BLUR
    if strong.any():
        for step in BLUR_STEPS:
            blur = _told_blur(steps, blur, step, strong, out)
    # The more they may wander, the less is left: as much as was expected where the walk is right.
    low, high = 0, len(WALKS) - 1
    while low < high:
        middle = (low + high) // 2
        _fit(steps, blur, WALKS[middle], out)
        low, high = (middle + 1, high) if np.nanmean(out[:, 3]) > 1.0 else (low, middle)
    walk = float(WALKS[low])
    _fit(steps, blur, walk, out)
    # What the slopes spread beyond what noise and walk make of none.
    slope = float(np.nanmean(out[:, 4] ** 2 - out[:, 5]))
    return blur, walk, math.sqrt(max(slope, LEAST_SLOPE**2))


@njit(nogil=True)
def _fit(steps: _Steps, blur: float, walk: float, out: FloatArray) -> None:
    """Fit the steps, see :func:`.profiles.fit_profiles`; out : (n, FITTED), of the fit before and of this one."""
    quality = Quality(steps.tone, blur, steps.noise, walk, FIRST_SLOPE)
    fit_profiles(steps.profiles, steps.outline, steps.beside, quality, out)


@njit(nogil=True)
def _told_blur(steps: _Steps, first: float, step: float, strong: BoolArray, out: FloatArray) -> float:
    """The blur that leaves the least of strong steps, of ``first`` times powers of ``step``.

    Downhill from the first; between the best and those beside it by a parabola.
    """
    least = int(math.log(LEAST_BLUR / first) / math.log(step))
    most = int(math.log(MOST_BLUR / first) / math.log(step))
    left = np.full(most - least + 1, np.nan)
    best, near = 0, 0
    while True:
        for k in (best, best - 1, best + 1):
            if least <= k <= most:
                if math.isnan(left[k - least]):
                    _fit(steps, first * step**k, FIRST_WALK, out)
                    left[k - least] = _left_of_most(out, strong)
                if left[k - least] < left[near - least]:
                    near = k
        if near == best:
            break
        best = near
    place = float(best)
    if least < best < most:
        before, here, after = left[best - 1 - least], left[best - least], left[best + 1 - least]
        if math.isfinite(before + after):
            place += 0.5 * (before - after) / max(before - 2.0 * here + after, NOT_ZERO)
    return float(first * step**place)


@njit(nogil=True)
def _left_of_most(out: FloatArray, strong: BoolArray) -> float:
    """Mean of what is left of most strong steps; one that has not been fitted counts as the worst."""
    left = out[strong, 3]
    left[np.isnan(left)] = np.inf
    left.sort()
    return float(left[: math.ceil(BLUR_SHARE * len(left))].mean())
