"""The normal equations of the estimate: sparse, solved with the covariances that its factors need."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from .envelope_kernels import numbering, solve_envelope
from .factors import Factors


class Solution(NamedTuple):
    """Least squares of n edges with k factors, used or not.

    Attributes
    ----------
    x, covariance : (n, 2), (n, 2, 2)
    residual, variance : (k,)
        What each factor's product misses its value by, and the product's variance.
    with_first, with_second : (k, 2)
        Covariance of the product with the unknowns of the factor's first and of its second edge.
    """

    x: FloatArray
    covariance: FloatArray
    residual: FloatArray
    variance: FloatArray
    with_first: FloatArray
    with_second: FloatArray


class NormalEquations:
    """Least squares of n edges' unknowns, with any of k factors.

    Parameters
    ----------
    information, vector : (n, 2, 2), (n, 2)
        What each edge says of itself.
    factors : Factors
        Statements that may be used.
    """

    def __init__(self, information: FloatArray, vector: FloatArray, factors: Factors) -> None:
        self.information, self.vector, self.factors = information, vector, factors
        n = len(information)
        self.both = factors.other >= 0
        e, f = factors.edge, np.where(self.both, factors.other, factors.edge)
        self.e, self.f = e, f
        self.g = np.where(self.both[:, None], factors.other_row, 0.0)
        place = numbering(n, e[self.both], f[self.both])
        low, high = np.minimum(place[e], place[f]), np.maximum(place[e], place[f])
        least = np.arange(n)
        np.minimum.at(least, high, low)
        self.first = np.repeat(2 * least, 2)
        width = np.arange(2 * n) - self.first + 1
        self.start = np.concatenate([[0], np.cumsum(width)])
        self.place = place
        row = 2 * place[:, None, None] + np.array([[0, 0], [1, 1]])
        column = 2 * place[:, None, None] + np.array([[0, 0], [0, 1]])
        # The upper right element of a diagonal block is its lower left one.
        row[:, 0, 1], column[:, 0, 1] = row[:, 1, 0], column[:, 1, 0]
        self.diagonal = self._entry(row, column)
        # Blocks of pairs with rows of the later edge.
        self.later = place[e] > place[f]
        rows = 2 * high[:, None, None] + np.array([[0, 0], [1, 1]])
        columns = 2 * low[:, None, None] + np.array([[0, 1], [0, 1]])
        self.pair = self._entry(np.maximum(rows, columns), np.minimum(rows, columns))

    def _entry(self, row: IntArray, column: IntArray) -> IntArray:
        """Where the envelope keeps entries (row, column)."""
        return np.asarray(self.start[row] + column - self.first[row])

    def solve(self, used: BoolArray) -> Solution:
        """Least squares with the factors that are used, (k,) bool."""
        factors, e, f, h, g = self.factors, self.e, self.f, self.factors.row, self.g
        weight = np.where(used, factors.sigma**-2.0, 0.0)
        information, vector = self.information.copy(), self.vector.copy()
        np.add.at(information, e, weight[:, None, None] * h[:, :, None] * h[:, None])
        np.add.at(information, f, weight[:, None, None] * g[:, :, None] * g[:, None])
        np.add.at(vector, e, (weight * factors.value)[:, None] * h)
        np.add.at(vector, f, -(weight * factors.value)[:, None] * g)
        value = np.zeros(self.start[-1])
        value[self.diagonal] = information
        block = -weight[:, None, None] * h[:, :, None] * g[:, None]
        block = np.where(self.later[:, None, None], block, np.swapaxes(block, 1, 2))
        np.add.at(value, self.pair[self.both], block[self.both])
        right = np.empty(2 * len(vector))
        order = 2 * self.place[:, None] + [0, 1]
        right[order] = vector
        solution, inverse = solve_envelope(self.first, self.start, value, right)
        x, covariance = solution[order], inverse[self.diagonal]
        cross = inverse[self.pair]
        cross = np.where(self.later[:, None, None], cross, np.swapaxes(cross, 1, 2))
        cross[~self.both] = 0.0
        residual = factors.value - (h * x[e]).sum(axis=1) + (g * x[f]).sum(axis=1)
        with_first = np.einsum('kij,kj->ki', covariance[e], h) - np.einsum('kij,kj->ki', cross, g)
        with_second = np.einsum('kji,kj->ki', cross, h) - np.einsum('kij,kj->ki', covariance[f], g)
        variance = (h * with_first).sum(axis=1) - (g * with_second).sum(axis=1)
        return Solution(x, covariance, residual, variance, with_first, with_second)
