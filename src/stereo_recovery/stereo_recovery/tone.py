"""Where edges are in light: a picture that codes light by a power of it shows them on their dark side.

A camera blurs light and then codes it, most by about its root (IEC 61966-2-1), those of machines often not at all; a
bright side that is too bright for the picture spreads, too. The code of a blurred step is steepest beside the step, by
three quarters of the blur's sigma where the dark side is black. Two pictures that are blurred alike show that alike,
and no disparity comes of it; of two that are not, lines along the rows are off by a multiple of what they differ.

What a picture shows of it: where the bright side of one edge is the dark side of another on the same straight line, the
two lie beside each other, by both shifts. How much of the shift of a coded picture there is, is told by all such pairs.
And the noise of a coded picture is that of one: see :mod:`.noise_levels`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np

from msgs_py.numeric.settings import BOUND_SIGMA, SRGB_EXPONENT
from msgs_py.numeric.threads import spread
from msgs_py.numeric.typed import Float32Array, FloatArray, IntArray

from .detection.edgels import blur_variance
from .detection.line_kernels import Lines
from .detection.segments import Segments
from .detection.splitting_kernels import continuations
from .detection.view import View
from .noise_levels import nats_of_code, noise_by_level
from .settings import (
    CODED_LOG_ODDS,
    CODED_SHARE_SIGMA,
    OUT_OF_LINE,
    OUT_OF_LINE_SIGMA,
    REVERSED_APART,
    SHARE_SIGMA,
    STEP_ENDS,
    TONE_SAMPLES,
)

# Of the shift of a coded picture, from none on.
SHARES = np.linspace(0.0, 2.0, 101)


class Reversals(NamedTuple):
    """k pairs of segments that continue each other, the bright side of one on the dark side of the other.

    Attributes
    ----------
    first, second : (k,) int
        Which segments.
    offset : (k,) float64, pixels
        Of the second line from the first, towards the bright side of the first.
    variance : (k,) float64
        Squared pixels. Of the offset.
    """

    first: IntArray
    second: IntArray
    offset: FloatArray
    variance: FloatArray


def in_light(views: Sequence[View], sigma: float) -> list[View]:
    """Views with their edges where light has them, as far as they show that these are elsewhere in a picture's code.

    All pictures show one share of the shift of coded ones, unless they say otherwise: they are of cameras of one kind,
    but what blurs them after they are coded, as turning them does, moves nothing.

    Parameters
    ----------
    views : sequence of View
    sigma : float
        Pixels. Smoothing of the detector.

    Returns
    -------
    list of View
        Their ellipses stay, with which fits of curves begin.
    """
    told = spread(lambda view: (reversals(view.segments), nats_of_code(noise_by_level(view.grey))), views)
    found, noise = zip(*told)
    if sum(noise) <= CODED_LOG_ODDS and not any(len(pairs.offset) for pairs in found):
        return list(views)
    shift = spread(lambda view: shift_in_code(view, sigma), views)
    shares = shares_of_code(found, shift, sum(noise))
    return spread(lambda k: _moved(views[k], shares[k] * shift[k]), range(len(views)))


def _moved(view: View, shift: FloatArray) -> View:
    """A view with its edges moved towards their bright sides, by (n,) pixels for the edgels of each segment."""
    edgels, segments = view.edgels, view.segments
    if not shift.any():
        return view
    way = np.stack([np.cos(edgels.direction), np.sin(edgels.direction)], axis=1)
    each = np.repeat(shift, segments.bounds[:, 1] - segments.bounds[:, 0])[:, None]
    return replace(
        view,
        edgels=replace(edgels, position=edgels.position + each * way),
        segments=replace(segments, centre=segments.centre + shift[:, None] * segments.normal),
    )


def reversals(segments: Segments) -> Reversals:
    """Pairs of straight segments on one line that are bright on different sides of it.

    Those that a tone curve shows beside each other pass for being on one line, too.
    """
    straight = np.flatnonzero(segments.arc < 0)
    some, count = segments.select(straight), len(straight)
    # Each once more the other way round: what one of these continues has its bright side on the other hand.
    both = Lines(
        np.concatenate([some.centre, some.centre]),
        np.concatenate([some.direction, -some.direction]),
        np.concatenate([some.extent, -some.extent[:, ::-1]]),
        np.concatenate([some.sigma, some.sigma]),
    )
    following = continuations(both, REVERSED_APART / BOUND_SIGMA, REVERSED_APART)[:count]
    before = np.flatnonzero(following >= count)
    first, second = straight[before], straight[following[before] - count]
    between = 0.5 * (segments.end[first] + segments.end[second])
    (here, one), (there, other) = (_at(segments.select(k), between) for k in (first, second))
    offset = np.einsum('kj,kj->k', there - here, segments.normal[first])
    return Reversals(first, second, offset, one + other)


def _at(segments: Segments, point: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The places (k, 2) of lines nearest to points (k, 2), and the variances (k,) of the lines there."""
    abscissa = np.einsum('kj,kj->k', point - segments.centre, segments.direction)
    return segments.centre + abscissa[:, None] * segments.direction, segments.variance_at(abscissa)


def shift_in_code(view: View, sigma: float) -> FloatArray:
    """How far from where a coded picture shows edges these are in light.

    Parameters
    ----------
    view : View
        With n segments.
    sigma : float
        Pixels. Smoothing of the detector.

    Returns
    -------
    (n,) float64
        Pixels, towards the bright side.

    References
    ----------
    The steepest place of a smoothed step is its mean less half of its third cumulant over its variance, by the first
    terms of Edgeworth's series (Cramer 1946, 17.6).
    """
    segments = view.segments
    if len(segments) == 0:
        return np.zeros(0)
    total = blur_variance([view.edgels])
    blur = np.sqrt(max(total - sigma**2, 0.0))
    places, beside = segments.places(TONE_SAMPLES), STEP_ENDS * blur * segments.normal[:, None]
    dark, bright = (_mean_level(view.grey, places + side * beside) for side in (-1.0, 1.0))
    ratio, of_ratio = _coded_steps()
    mean, variance, third = (np.interp(dark / np.maximum(bright, 1.0), ratio, one) for one in of_ratio)
    return np.asarray(0.5 * third * blur**3 / (variance * blur**2 + sigma**2) - mean * blur)


def _mean_level(grey: Float32Array, places: FloatArray) -> FloatArray:
    """Mean grey levels (n,) of a picture at places (n, k, 2)."""
    u, v = np.moveaxis(places, 2, 0).astype(np.float32)
    return np.asarray(cv2.remap(grey, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).mean(axis=1))


@cache
def _coded_steps() -> tuple[FloatArray, FloatArray]:
    """Ratios (k,) of dark to bright; mean, variance and third cumulant (3, k) of the slope of coded steps of blur 1."""
    x = np.linspace(-8.0, 8.0, 641)
    ratio = np.linspace(0.0, 1.0, 51)
    dark = ratio[:-1, None] ** SRGB_EXPONENT
    step = np.array([0.5 * math.erfc(-place / math.sqrt(2.0)) for place in x])
    code = (dark + (1.0 - dark) * step) ** (1.0 / SRGB_EXPONENT)
    weight, place = np.diff(code, axis=1), 0.5 * (x[1:] + x[:-1])
    weight /= weight.sum(axis=1, keepdims=True)
    mean = weight @ place
    away = place - mean[:, None]
    cumulants = np.stack([mean, (weight * away**2).sum(axis=1), (weight * away**3).sum(axis=1)])
    # Of hardly any contrast, a step is coded as it is.
    return ratio, np.column_stack([cumulants, [0.0, 1.0, 0.0]])


def shares_of_code(found: Sequence[Reversals], shift: Sequence[FloatArray], noise: float = -math.inf) -> list[float]:
    """How much of the shift of coded pictures each picture shows; 0 where they might as well show none.

    Parameters
    ----------
    found : sequence of Reversals
    shift : sequence of (n,) float64
        See :func:`shift_in_code`, of all segments of each picture.
    noise : float
        Nats for coded light from the noise of all pictures, which are of cameras of one kind.
    """
    odds = np.array([_odds(pairs, one) for pairs, one in zip(found, shift)])
    told = [k for k, pairs in enumerate(found) if len(pairs.offset)]
    together, alone = _believed(odds.sum(axis=0), noise), _believed(odds)
    shares = [_likeliest(together)] * len(found)
    if len(told) > 1 and alone.max(axis=1).sum() - together.max() > CODED_LOG_ODDS * (len(told) - 1):
        for k in told:
            shares[k] = _likeliest(alone[k])
    return shares


def _odds(found: Reversals, shift: FloatArray) -> FloatArray:
    """Nats of pairs for each of SHARES; shift : of one picture, see :func:`shares_of_code`."""
    variance = found.variance + OUT_OF_LINE_SIGMA**2
    left = found.offset - SHARES[:, None] * (shift[found.first] + shift[found.second])
    on_line = np.exp(-0.5 * left**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    # Some lie on two lines, anywhere within REVERSED_APART of each other.
    chance = (1.0 - OUT_OF_LINE) * on_line + OUT_OF_LINE / (2.0 * REVERSED_APART)
    return np.asarray(np.log(chance).sum(axis=1))


def _believed(odds: FloatArray, noise: float = -math.inf) -> FloatArray:
    """Nats (..., k) of pairs for each of SHARES, with what is believed beforehand and what noise says."""
    coded = noise - 0.5 * ((SHARES - 1.0) / CODED_SHARE_SIGMA) ** 2
    return np.asarray(odds + np.logaddexp(-0.5 * (SHARES / SHARE_SIGMA) ** 2, coded))


def _likeliest(odds: FloatArray) -> float:
    """The likeliest of SHARES by their nats; 0 where that is as likely."""
    best = int(odds.argmax())
    return float(SHARES[best]) if odds[best] - odds[0] > CODED_LOG_ODDS else 0.0
