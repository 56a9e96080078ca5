"""Beside which curves shade grows towards an edge, and what fitted steps say when that is believed once a curve.

Most edges are of flat faces, on which shade hardly changes over a few pixels; beside some a round surface begins, and
shade changes there by many grey levels a pixel. One sigma for all is wrong for both: steps are fitted as if shade might
grow beside each, and each curve then is a mixture of the two, by what all of its points say of their slope.
"""

from __future__ import annotations

import math

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, IntArray

from .settings import SHADE_TURNS, SHADED, SHADED_WORTH


@njit(nogil=True)
def settle_slopes(group: IntArray, flat: float, shaded: float, fitted: FloatArray) -> None:
    """Take from steps what they owe to slopes of shade that their curves do not have, in place.

    What is believed of the slope beforehand enters a fit linearly, so that no step is fitted again. How many curves of
    an image are shaded is told by all of them (expectation-maximisation).

    Parameters
    ----------
    group : (n,) int
        The curve of each point; those of one are together.
    flat, shaded : float
        Grey levels a pixel, sigmas of the slopes beside flat faces, and of those with which the steps were fitted.
    fitted : (n, FITTED) float64
        See :func:`.profiles.fit_steps`; places and variances are changed.
    """
    tells, slope, wide = _slopes(group, shaded, fitted)
    share = _shares(tells, slope, (flat / shaded) ** 2, wide)
    c = -1
    for k in range(len(group)):
        c += k == 0 or group[k] != group[k - 1]
        if math.isnan(fitted[k, 0]):
            continue
        here, variance, common, count = fitted[k, 4], fitted[k, 5], fitted[k, 6], wide[c, 1]
        # Of a flat face the sigma is less, and with it what the step may owe to the slope.
        more = ((shaded / flat) ** 2 - 1.0) / (wide[c, 0] * count)
        gain = more / (1.0 + more * variance)
        shift, flatter = common * gain * here, 1.0 - share[c]
        fitted[k, 0] -= flatter * shift
        # Which of the two it is moves all points of a curve alike.
        fitted[k, 1] += share[c] * flatter * shift * shift * count - flatter * common * common * gain


@njit(nogil=True)
def _slopes(group: IntArray, shaded: float, fitted: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the points of each of c curves say of its slope together.

    Returns
    -------
    tells, slope : (c,) float64
        One over the variance of the slope, 0 where no step was fitted; the slope, both in light.
    wide : (c, 2) float64
        The variance believed of it beforehand, and its points.
    """
    n = len(group)
    tells, slope, wide = np.zeros(n), np.zeros(n), np.zeros((n, 2))
    c = -1
    for k in range(n):
        c += k == 0 or group[k] != group[k - 1]
        wide[c, 1] += 1.0
        if not math.isnan(fitted[k, 0]):
            wide[c, 0] = (shaded * fitted[k, 7]) ** 2
    c = -1
    for k in range(n):
        c += k == 0 or group[k] != group[k - 1]
        if not math.isnan(fitted[k, 0]):
            tells[c] += 1.0 / fitted[k, 5] - 1.0 / (wide[c, 0] * wide[c, 1])
            slope[c] += fitted[k, 4] / fitted[k, 5]
    for one in range(c + 1):
        if tells[one] > 0.0:
            slope[one] /= tells[one]
    return tells[: c + 1], slope[: c + 1], wide[: c + 1]


@njit(nogil=True)
def _shares(tells: FloatArray, slope: FloatArray, part: float, wide: FloatArray) -> FloatArray:
    """The probabilities that c curves are shaded; part : the variance of slopes of flat faces over that of others."""
    share = np.zeros(len(tells))
    known = np.flatnonzero(tells > 0.0)
    chance = SHADED
    for _ in range(SHADE_TURNS):
        for c in known:
            flat, shaded = 1.0 / tells[c] + part * wide[c, 0], 1.0 / tells[c] + wide[c, 0]
            nats = 0.5 * (math.log(flat / shaded) + slope[c] ** 2 * (1.0 / flat - 1.0 / shaded))
            share[c] = chance / (chance + (1.0 - chance) * math.exp(-nats))
        chance = (SHADED_WORTH * SHADED + share.sum()) / (SHADED_WORTH + len(known))
    return share
