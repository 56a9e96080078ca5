"""Direction signs on the array machine (thesis 5.7.2): vectors over the data features, a whole group in one step."""

from __future__ import annotations

from typing import Any

import numpy as np

from dap_emulator import Dap, DapArray
from msgs_py.numeric.typed import Int8Array, Int32Array


class ArraySigns:
    """The states of n data features, as signs.Signs has them.

    Parameters
    ----------
    dap : Dap
    n : int
    """

    def __init__(self, dap: Dap, n: int) -> None:
        self.dap = dap
        self.root = dap.vector(np.arange(n, dtype=np.int16))
        self.parity = dap.vector(np.ones(n, dtype=np.int8))
        self.known = dap.vector(np.zeros(n, dtype=np.int8))

    def saved(self) -> tuple[DapArray, ...]:
        """A copy of the states, for a level of the search."""
        return self.root.copy(), self.parity.copy(), self.known.copy()

    def restore(self, saved: tuple[DapArray, ...]) -> None:
        """Return to the states of a level."""
        self.root, self.parity, self.known = (vector.copy() for vector in saved)

    def apply(self, planes: tuple[DapArray, ...], a: int, b: int, at: tuple[int, int]) -> bool:
        """Take over the signs of a table entry (signs.apply_code): absolute signs first, then the relation.

        planes : those of array_tables.SIGN_BITS; at : row and column of the entry
        """
        same, different, *ends = (bool(plane[at]) for plane in planes)
        for k, (plus, minus) in ((a, ends[:2]), (b, ends[2:])):
            if plus != minus and not self._set(k, 1 if plus else -1):
                return False
        return same == different or self._relate(a, b, 1 if same else -1)

    def _set(self, k: int, sign: int) -> bool:
        """Give feature k an absolute sign; False when it is known to have the other."""
        root = int(self.root[k])
        wanted, now = sign * int(self.parity[k]), int(self.known[root])
        if now == 0:
            self.known[root] = wanted
        return now in (0, wanted)

    def _relate(self, a: int, b: int, relation: int) -> bool:
        """Make b's sign equal (1) or opposite (-1) to a's; False when that contradicts what is known."""
        root_a, root_b = int(self.root[a]), int(self.root[b])
        factor = relation * int(self.parity[a]) * int(self.parity[b])
        if root_a == root_b:
            return factor == 1
        known_a, known_b = int(self.known[root_a]), int(self.known[root_b])
        if known_a and known_b and known_b != factor * known_a:
            return False
        keep, give = min(root_a, root_b), max(root_a, root_b)
        if int(self.known[keep]) == 0:
            self.known[keep] = factor * int(self.known[give])
        group = self.root.compare('eq', give)
        self.root.assign(keep, group)
        if factor < 0:
            self.parity.assign(-self.parity, group)
        return True

    def written(self, assignment: Int32Array) -> Int8Array:
        """(n,) int8: absolute signs, 0 where unknown or in the bin."""
        root: Any = self.root.values.astype(np.int64)
        signs = self.known.values[root] * self.parity.values
        return np.where(assignment < 0, 0, signs).astype(np.int8)
