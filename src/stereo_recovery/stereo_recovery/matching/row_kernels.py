"""Compiled robust fit of what rows, or columns, of two images are off by, for :mod:`.row_error`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray

from .settings import ROW_LEAST_SIGMA, ROW_ROUNDS, ROW_SHIFT_MOST, ROW_SIGMA, ROW_SIGMA_SPREAD, ROW_SIGMAS, SEEN_AS_ONE


@njit(nogil=True)
def single_sigma(left_over: FloatArray, sigma: FloatArray, least: float) -> float:
    """Sigma, pixels, of single rows: by the residuals of witnesses, and by what real rigs have; the mean of all.

    left_over, sigma : (k,) pixels; least : pixels, least sigma of single rows
    """
    low, high = np.log(max(least, ROW_LEAST_SIGMA)), np.log(ROW_SHIFT_MOST)
    tried, log_odds = np.empty(ROW_SIGMAS), np.empty(ROW_SIGMAS)
    wrong = (1.0 - SEEN_AS_ONE) / (2.0 * ROW_SHIFT_MOST)
    for m in range(ROW_SIGMAS):
        tried[m] = np.exp(low + (high - low) * m / (ROW_SIGMAS - 1))
        total, product = -0.5 * (np.log(tried[m] / ROW_SIGMA) / ROW_SIGMA_SPREAD) ** 2, 1.0
        for k in range(len(left_over)):
            variance = sigma[k] ** 2 + tried[m] ** 2
            right = SEEN_AS_ONE * np.exp(-0.5 * left_over[k] ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
            product *= right + wrong
            # The logarithm of several at once, as far as their product is a number.
            if k % 16 == 15:
                total += np.log(product)
                product = 1.0
        log_odds[m] = total + np.log(product)
    probability = np.exp(log_odds - log_odds.max())
    return float((probability * tried).sum() / probability.sum())


@njit(nogil=True)
def robust_fit(
    columns: FloatArray, off: FloatArray, sigma: FloatArray, prior: FloatArray, least: float
) -> tuple[FloatArray, float]:
    """Parameters (n,) of which witnesses are the columns, and the sigma of single rows about them, pixels.

    Parameters
    ----------
    columns : (k, n) float64
        What each parameter adds to the rows of each witness.
    off, sigma : (k,) float64, pixels
    prior : (n, n) float64
        Information.
    least : float, pixels
        Least sigma of single rows.
    """
    count, size = columns.shape
    value, single, left_over = np.zeros(size), least, np.empty(count)
    for _ in range(ROW_ROUNDS):
        for k in range(count):
            left_over[k] = off[k]
            for a in range(size):
                left_over[k] -= columns[k, a] * value[a]
        single = single_sigma(left_over, sigma, least)
        normal, told = prior.copy(), np.zeros(size)
        for k in range(count):
            # Student's weights: some corners are none, and some matches are wrong.
            weight = 2.0 / (sigma[k] ** 2 + single**2 + left_over[k] ** 2)
            for a in range(size):
                told[a] += weight * columns[k, a] * off[k]
                for b in range(size):
                    normal[a, b] += weight * columns[k, a] * columns[k, b]
        value[:] = np.linalg.solve(normal, told)
    return value, single
