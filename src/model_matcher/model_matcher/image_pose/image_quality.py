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
    BLUR_FACTOR,
    BLUR_SHARE,
    FEWEST_POINTS,
    FIRST_BLUR,
    FIRST_SLOPE,
    FIRST_WALK,
    FLANK,
    LEAST_BLUR,
    LEAST_SLOPE,
    MOST_BLUR,
    QUALITY_POINTS,
    STRONG,
    WALK_TURNS,
    WALKS,
)


class Look(NamedTuple):
    """What :class:`.profiles.Quality` holds besides tone curve and noise: see there."""

    blur: float
    walk: float
    slope: float


def look_of(image: ByteArray, outline: Stretches, beside: FloatArray, tone: float, noise: float) -> Look:
    """What an image is like, by the steps of an outline that stand alone.

    The blur is that with which strong steps are explained best; where few of them stand alone, with what runs beside
    them. The walk is that which leaves as much of steps as noise and walk would; the slope of shade is what the steps'
    own spread beyond that.

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
    with_room = outline.flank == FLANK

    def steps(told: BoolArray) -> _Steps:
        told_by = np.flatnonzero(told)
        some = told_by[:: max(1, -(-len(told_by) // QUALITY_POINTS))]
        each = outline.some(some)._replace(together=np.ones(len(some)))
        return _Steps(profiles_of(image, each, tone), each, beside[some], tone, noise)

    alone = steps(with_room & np.isnan(beside[:, :, 0]).all(axis=1))
    blur = _blur_of(alone, FEWEST_POINTS) or _blur_of(steps(with_room), 1) or FIRST_BLUR
    return Look(blur, *_beside_steps(alone, blur))


class _Steps(NamedTuple):
    """Steps that stand alone, and what is known of their image: see :func:`look_of`."""

    profiles: Profiles
    outline: Stretches
    beside: FloatArray
    tone: float
    noise: float


@njit(nogil=True)
def _blur_of(steps: _Steps, fewest: int) -> float:
    """The blur with which strong steps are explained best, see :func:`look_of`; 0 where fewer are strong."""
    out = np.full((len(steps.outline.spacing), FITTED), np.nan)
    _fit(steps, FIRST_BLUR, FIRST_WALK, out)
    # In light, as contrasts are.
    strong = np.abs(out[:, 2]) > STRONG * steps.noise * out[:, 7]
    return _told_blur(steps, strong, out) if strong.sum() >= fewest else 0.0


@njit(nogil=True)
def _beside_steps(steps: _Steps, blur: float) -> tuple[float, float]:
    """Walk and slope of the levels beside steps, see :func:`look_of`."""
    out = np.full((len(steps.outline.spacing), FITTED), np.nan)
    _fit(steps, blur, FIRST_WALK, out)
    if np.isnan(out[:, 0]).all():
        return FIRST_WALK, FIRST_SLOPE
    walk = _told_walk(steps, blur, out)
    # What the slopes spread beyond what noise and walk make of none.
    slope = float(np.nanmean(out[:, 4] ** 2 - out[:, 5]))
    return walk, math.sqrt(slope) if slope > LEAST_SLOPE**2 else LEAST_SLOPE


@njit(nogil=True)
def _fit(steps: _Steps, blur: float, walk: float, out: FloatArray) -> None:
    """Fit the steps, see :func:`.profiles.fit_profiles`; out : (n, FITTED), of the fit before and of this one."""
    quality = Quality(steps.tone, blur, steps.noise, walk, FIRST_SLOPE)
    fit_profiles(steps.profiles, steps.outline, steps.beside, quality, out)


@njit(nogil=True)
def _told_blur(steps: _Steps, strong: BoolArray, out: FloatArray) -> float:
    """The blur that leaves the least of strong steps.

    Downhill by factors from the first, with which ``out`` has been fitted; then by two parabolas, the second through
    the lowest point of the first.
    """
    least, most = math.log(LEAST_BLUR), math.log(MOST_BLUR)
    places, left = math.log(FIRST_BLUR) + math.log(BLUR_FACTOR) * np.arange(-1.0, 3.0), np.empty(4)
    left[1] = _left_of_most(out, strong)
    left[0], left[2] = _left_with(places[0], steps, strong, out), _left_with(places[2], steps, strong, out)
    way = -1 if left[0] < left[2] else 1
    while left[1 + way] < left[1] and least < places[1] < most:
        places += way * math.log(BLUR_FACTOR)
        left[1 - way], left[1] = left[1], left[1 + way]
        left[1 + way] = _left_with(places[1 + way], steps, strong, out)
    places[3] = _lowest(places, left)
    left[3] = _left_with(places[3], steps, strong, out)
    order = np.argsort(places)
    begin = min(max(int(np.argmin(left[order])) - 1, 0), 1)
    some = order[begin : begin + 3]
    return math.exp(min(max(_lowest(places[some], left[some]), least), most))


@njit(nogil=True)
def _lowest(x: FloatArray, y: FloatArray) -> float:
    """Where a parabola through three points (3,) is lowest, between them; the middle one where it is so nowhere."""
    before, after = x[1] - x[0], x[1] - x[2]
    down, up = before * (y[1] - y[2]), after * (y[1] - y[0])
    if not (math.isfinite(down - up) and down - up < 0.0):
        return float(x[1])
    return float(min(max(x[1] - 0.5 * (before * down - after * up) / (down - up), x[0]), x[2]))


@njit(nogil=True)
def _left_with(log_blur: float, steps: _Steps, strong: BoolArray, out: FloatArray) -> float:
    """What a blur leaves of most strong steps, which are fitted with it."""
    _fit(steps, math.exp(log_blur), FIRST_WALK, out)
    left: float = _left_of_most(out, strong)
    return left


@njit(nogil=True)
def _told_walk(steps: _Steps, blur: float, out: FloatArray) -> float:
    """The first of WALKS that leaves no more of the steps than noise and walk would; ``out`` is fitted with it.

    What is left is in units of a sum of variances, so that one over it grows evenly with that of the walk: by secants,
    the first of which takes noise for nothing.
    """
    walk, before, told = FIRST_WALK, 0.0, 0.0
    for _ in range(WALK_TURNS):
        _fit(steps, blur, walk, out)
        units = 1.0 / max(float(np.nanmean(out[:, 3])), NOT_ZERO)
        rise = (units - told) / (walk * walk - before)
        before, told = walk * walk, units
        if not rise > 0.0:
            break
        first = 0
        while first < len(WALKS) - 1 and WALKS[first] ** 2 < before + (1.0 - units) / rise:
            first += 1
        if WALKS[first] == walk:
            break
        walk = WALKS[first]
    return math.sqrt(before)


@njit(nogil=True)
def _left_of_most(out: FloatArray, strong: BoolArray) -> float:
    """Mean of what is left of most strong steps; one that has not been fitted counts as the worst."""
    left = out[strong, 3]
    left[np.isnan(left)] = np.inf
    left.sort()
    return float(left[: math.ceil(BLUR_SHARE * len(left))].mean())
