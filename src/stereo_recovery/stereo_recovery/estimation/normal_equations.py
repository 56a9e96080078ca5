"""The normal equations of the estimate: sparse, solved with the covariances that its factors need."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from . import equation_kernels, sparse_kernels
from .elimination_order import least_degree
from .equation_kernels import Solution, System
from .factors import Factors


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
        self.factors = factors
        n = len(information)
        both = factors.other >= 0
        e, f = factors.edge, np.where(both, factors.other, factors.edge)
        self.place = least_degree(n, e[both], f[both]) if place is None else place
        low, high = np.minimum(self.place[e], self.place[f]), np.maximum(self.place[e], self.place[f])
        self.pattern = sparse_kernels.pattern(n, low[both], high[both])
        slot = np.full(len(factors), -1)
        slot[both] = sparse_kernels.slots(self.pattern, low[both], high[both])
        arrays = (np.ascontiguousarray(getattr(factors, field.name)) for field in fields(Factors))
        self._system = System(information, vector, self.place, self.pattern, slot, *arrays)

    def solve(self, used: BoolArray) -> Solution:
        """Least squares with the factors that are used, (k,) bool."""
        s = self._system
        out: Solution = equation_kernels.empty_solution(s)
        n = len(s.place)
        blocks = np.empty((n, 2, 2)), np.empty((len(s.pattern.row), 2, 2)), np.empty((n, 2))
        room = sparse_kernels.workspace(s.pattern)
        equation_kernels.solve(s, used, np.arange(n), np.arange(len(used)), out, blocks, room)
        return out

    def decided(self, used: BoolArray) -> tuple[BoolArray, Solution, FloatArray]:
        """Which factors hold, (k,) bool, from those taken to do so; the solution; and the probability of each."""
        used = used.copy()
        solution, holds = equation_kernels.decide(self._system, used)
        return used, solution, holds
