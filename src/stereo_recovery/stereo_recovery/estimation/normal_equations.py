"""The normal equations of the estimate: sparse, solved with the covariances that its factors need."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from . import equation_kernels, sparse_kernels
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
    place : (n,) int, optional
        An order of elimination, of equations that tie much the same edges; by default one of least degree.
    """

    def __init__(
        self, information: FloatArray, vector: FloatArray, factors: Factors, place: IntArray | None = None
    ) -> None:
        self.information, self.vector, self.factors = information, vector, factors
        n = len(information)
        both = factors.other >= 0
        e, f = factors.edge, np.where(both, factors.other, factors.edge)
        self.place = _numbering(n, e[both], f[both]) if place is None else place
        low, high = np.minimum(self.place[e], self.place[f]), np.maximum(self.place[e], self.place[f])
        self.pattern = sparse_kernels.pattern(n, low[both], high[both])
        # Where the pattern has the block of a factor's two edges; -1 where it is about one.
        self.slot = np.full(len(factors), -1)
        self.slot[both] = sparse_kernels.slots(self.pattern, low[both], high[both])

    def solve(self, used: BoolArray) -> Solution:
        """Least squares with the factors that are used, (k,) bool."""
        factors, place = self.factors, self.place
        weight = np.where(used, factors.sigma**-2.0, 0.0)
        ties = equation_kernels.Ties(
            factors.edge, factors.other, factors.row, factors.other_row, factors.value, self.slot
        )
        system = equation_kernels.assembled(self.information, self.vector, ties, weight, place, len(self.pattern.row))
        x, diagonal, below = sparse_kernels.solve_sparse(self.pattern, *system)
        x, covariance = x[place], diagonal[place]
        return Solution(x, covariance, *equation_kernels.products(ties, place, x, covariance, below))


def _numbering(count: int, e: IntArray, f: IntArray) -> IntArray:
    """(count,) place of each node in an order of least degree, of a graph with links e - f, (k,) each."""
    node = np.arange(count)
    rows, columns = np.concatenate([node, e, f]), np.concatenate([node, f, e])
    # Entries of one place add up; a large diagonal keeps the factorisation from pivoting.
    entries = np.where(rows == columns, 4.0 * len(rows), 1.0)
    graph = csc_matrix((entries, (rows, columns)), (count, count))
    order = splu(graph, permc_spec='MMD_AT_PLUS_A', diag_pivot_thresh=0.0, options={'SymmetricMode': True}).perm_c
    return np.asarray(order, np.int64)
