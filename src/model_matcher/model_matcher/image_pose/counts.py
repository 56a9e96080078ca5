"""Counts of what is one way or the other, whose share differs from one object to the next."""

from __future__ import annotations

import math

from msgs_py.numeric.compiled import njit


@njit(nogil=True)
def beta_binomial(k: float, n: float, shape: tuple[float, float]) -> float:
    """Log-likelihood of k of n in an order, of a share that has a beta distribution."""
    a, b = shape
    log_likelihood: float = _log_beta(k + a, n - k + b) - _log_beta(a, b)
    return log_likelihood


@njit(nogil=True)
def _log_beta(a: float, b: float) -> float:
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)
