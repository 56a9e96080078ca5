"""Beside which curves shade grows towards an edge, and what fitted steps say when that is believed once a curve.

Most edges are of flat faces, on which shade hardly changes over a few pixels; beside some a round surface begins, and
shade changes there by many grey levels a pixel. One sigma for all is wrong for both: steps are fitted as if shade might
grow beside each, and each curve then is a mixture of the two, by what all of its points say of their slope.
"""

from __future__ import annotations

import math

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int32Array

from .neighbours import begins
from .settings import SHADE_TURNS, SHADED, SHADED_WORTH


@njit(nogil=True)
def settle_slopes(group: Int32Array, flat: float, shaded: float, fitted: FloatArray) -> None:
    """Take from steps what they owe to slopes of shade that their curves do not have, in place.

    What is believed of the slope beforehand enters a fit linearly, so that no step is fitted again. How many curves of
    an image are shaded is told by all of them (expectation-maximisation).

    Parameters
    ----------
    group : (n,) int32
        The curve of each point; those of one are together.
    flat, shaded : float
        Grey levels a pixel, sigmas of the slopes beside flat faces, and of those with which the steps were fitted.
    fitted : (n, FITTED) float64
        See :func:`.profiles.fit_profiles`; places and variances are changed.
    """
    begin = begins(group)
    tells, slope, wide = _slopes(begin, shaded, fitted)
    share = _shares(tells, slope, (flat / shaded) ** 2, wide)
    for c in np.flatnonzero(wide > 0.0):
        count, flatter = begin[c + 1] - begin[c], 1.0 - share[c]
        # Of a flat face the sigma is less, and with it what the step may owe to the slope.
        more = ((shaded / flat) ** 2 - 1.0) / (wide[c] * count)
        for k in range(begin[c], begin[c + 1]):
            if math.isnan(fitted[k, 0]):
                continue
            here, variance, common = fitted[k, 4], fitted[k, 5], fitted[k, 6]
            gain = more / (1.0 + more * variance)
            shift = common * gain * here
            fitted[k, 0] -= flatter * shift
            # Which of the two it is moves all points of a curve alike. By how much is each point's word, not that of
            # the whole curve: shade of real surfaces has no one slope along it.
            fitted[k, 1] += share[c] * flatter * shift * shift * count - flatter * common * common * gain


@njit(nogil=True)
def _slopes(begin: Int32Array, shaded: float, fitted: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the points of each of c curves say of its slope together; begin : (c + 1,), see :func:`.neighbours.begins`.

    Returns
    -------
    tells, slope, wide : (c,) float64
        One over the variance of the slope, 0 where no step was fitted; the slope, in light; the variance that was
        believed of it beforehand, 0 there too.
    """
    curves = len(begin) - 1
    tells, slope, wide = np.zeros(curves), np.zeros(curves), np.zeros(curves)
    for c in range(curves):
        count = 0
        for k in range(begin[c], begin[c + 1]):
            if not math.isnan(fitted[k, 0]):
                tells[c] += 1.0 / fitted[k, 5]
                slope[c] += fitted[k, 4] / fitted[k, 5]
                wide[c] = (shaded * fitted[k, 7]) ** 2
                count += 1
        if count > 0:
            tells[c] -= count / (wide[c] * (begin[c + 1] - begin[c]))
        if tells[c] > 0.0:
            slope[c] /= tells[c]
    return tells, slope, wide


@njit(nogil=True)
def _shares(tells: FloatArray, slope: FloatArray, part: float, wide: FloatArray) -> FloatArray:
    """The probabilities that c curves are shaded; part : the variance of slopes of flat faces over that of others."""
    share = np.zeros(len(tells))
    known = np.flatnonzero(tells > 0.0)
    chance = SHADED
    for _ in range(SHADE_TURNS):
        for c in known:
            flat, shaded = 1.0 / tells[c] + part * wide[c], 1.0 / tells[c] + wide[c]
            nats = 0.5 * (math.log(flat / shaded) + slope[c] ** 2 * (1.0 / flat - 1.0 / shaded))
            share[c] = chance / (chance + (1.0 - chance) * math.exp(-nats))
        chance = (SHADED_WORTH * SHADED + share.sum()) / (SHADED_WORTH + len(known))
    return share
