"""Where edges are in light: a picture that codes light by a power of it shows them on their dark side.

A camera blurs light and then codes it, most by about its root (IEC 61966-2-1), those of machines often not at all; a
bright side that is too bright for the picture spreads, too. The code of a blurred step is steepest beside the step, by
three quarters of the blur's sigma where the dark side is black. Two pictures that are blurred alike show that alike,
and no disparity comes of it; of two that are not, lines along the rows are off by a multiple of what they differ.

What a picture shows of it: where the bright side of one edge is the dark side of another on the same straight line, the
two lie beside each other, by both shifts. How much of the shift of a coded picture there is, is told by all such pairs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np

from msgs_py.numeric.settings import BOUND_SIGMA
from msgs_py.numeric.typed import FloatArray, IntArray

from .detection.edgels import blur_variance
from .detection.line_kernels import Lines
from .detection.segments import Segments
from .detection.settings import (
    CODED_LOG_ODDS,
    OUT_OF_LINE,
    OUT_OF_LINE_SIGMA,
    REVERSED_APART,
    SHARE_SIGMA,
    TONE,
    TONE_SAMPLES,
    WHITE,
)
from .detection.splitting_kernels import continuations
from .detection.view import View

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
    found = [reversals(view.segments) for view in views]
    told = [k for k, pairs in enumerate(found) if len(pairs.offset)]
    if not told:
        return list(views)
    shift = [shift_in_code(view, sigma) for view in views]
    odds = np.array([_odds(found[k], shift[k]) for k in told])
    share = dict.fromkeys(range(len(views)), _likeliest(odds.sum(axis=0)))
    if len(told) > 1:
        alone = odds + _believed()
        together = float((odds.sum(axis=0) + _believed()).max())
        if alone.max(axis=1).sum() - together > CODED_LOG_ODDS * (len(told) - 1):
            share |= {k: _likeliest(one) for k, one in zip(told, odds)}
    return [_moved(view, share[k] * shift[k]) for k, view in enumerate(views)]


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
        segments=replace(segments, centre=segments.centre + shift[:, None] * _bright(segments)),
    )


def _bright(segments: Segments) -> FloatArray:
    """(n, 2) float64: unit normals of segments, towards their bright sides."""
    return np.stack([-segments.direction[:, 1], segments.direction[:, 0]], axis=1)


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
    (here, one), (there, other) = (_at(segments, k, between) for k in (first, second))
    offset = np.einsum('kj,kj->k', there - here, _bright(segments)[first])
    return Reversals(first, second, offset, one + other)


def _at(segments: Segments, index: IntArray, point: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The places (k, 2) of lines nearest to points (k, 2), and the variances (k,) of the lines there."""
    centre, along, sigma = segments.centre[index], segments.direction[index], segments.sigma[index]
    abscissa = np.einsum('kj,kj->k', point - centre, along)
    return centre + abscissa[:, None] * along, sigma[:, 0] ** 2 + (abscissa * sigma[:, 1]) ** 2


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
    share = (np.arange(TONE_SAMPLES) + 0.5) / TONE_SAMPLES
    places = segments.start[:, None] + share[:, None] * (segments.end - segments.start)[:, None]
    u, v = np.moveaxis(places, 2, 0).astype(np.float32)
    middle = cv2.remap(view.grey, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).mean(axis=1)
    half = np.sqrt(0.5 * np.pi * total) * segments.magnitude
    dark, bright = np.maximum(middle - half, 0.0), np.minimum(middle + half, WHITE)
    ratio, of_ratio = _coded_steps()
    mean, variance, third = (np.interp(dark / np.maximum(bright, 1.0), ratio, one) for one in of_ratio)
    return np.asarray(0.5 * third * blur**3 / (variance * blur**2 + sigma**2) - mean * blur)


@cache
def _coded_steps() -> tuple[FloatArray, FloatArray]:
    """Ratios (k,) of dark to bright; mean, variance and third cumulant (3, k) of the slope of coded steps of blur 1."""
    x = np.linspace(-8.0, 8.0, 641)
    ratio = np.linspace(0.0, 1.0, 51)
    dark = ratio[:-1, None] ** TONE
    step = np.array([0.5 * math.erfc(-place / math.sqrt(2.0)) for place in x])
    code = (dark + (1.0 - dark) * step) ** (1.0 / TONE)
    weight, place = np.diff(code, axis=1), 0.5 * (x[1:] + x[:-1])
    weight /= weight.sum(axis=1, keepdims=True)
    mean = weight @ place
    away = place - mean[:, None]
    cumulants = np.stack([mean, (weight * away**2).sum(axis=1), (weight * away**3).sum(axis=1)])
    # Of hardly any contrast, a step is coded as it is.
    return ratio, np.column_stack([cumulants, [0.0, 1.0, 0.0]])


def share_of_code(found: Reversals, shift: FloatArray) -> float:
    """How much of the shift of coded pictures a picture shows; 0 where it might as well show none.

    Parameters
    ----------
    found : Reversals
    shift : (n,) float64
        See :func:`shift_in_code`, of all segments.
    """
    return _likeliest(_odds(found, shift))


def _odds(found: Reversals, shift: FloatArray) -> FloatArray:
    """Nats of pairs for each of SHARES; shift : see :func:`share_of_code`."""
    variance = found.variance + OUT_OF_LINE_SIGMA**2
    left = found.offset - SHARES[:, None] * (shift[found.first] + shift[found.second])
    on_line = np.exp(-0.5 * left**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    # Some lie on two lines, anywhere within REVERSED_APART of each other.
    chance = (1.0 - OUT_OF_LINE) * on_line + OUT_OF_LINE / (2.0 * REVERSED_APART)
    return np.asarray(np.log(chance).sum(axis=1))


def _believed() -> FloatArray:
    """Nats for each of SHARES beforehand."""
    return np.asarray(-0.5 * (SHARES / SHARE_SIGMA) ** 2)


def _likeliest(odds: FloatArray) -> float:
    """The share that is likeliest by nats of each; 0 where that is as likely."""
    all_told = odds + _believed()
    best = int(all_told.argmax())
    return float(SHARES[best]) if all_told[best] - all_told[0] > CODED_LOG_ODDS else 0.0
