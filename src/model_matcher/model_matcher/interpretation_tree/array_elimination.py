"""Leaving out beforehand what cannot belong (thesis 7.4), on the array machine: core numbers by counting planes.

A pairing stays for size K while at least K - 1 other data features have a model feature that agrees with it. Each
pair's table gives one count to each pairing of its two features, for all model features at once; the counts of all
pairs are added, what has too few is removed, until nothing changes.
"""

from __future__ import annotations

import numpy as np

from dap_emulator import DapArray
from dap_emulator.machine import intrinsics as f
from dap_emulator.machine.kinds import integer
from msgs_py.numeric.typed import BoolArray

from .array_tables import ArrayTables, Phase


def alive_for(tables: ArrayTables, size: int) -> BoolArray:
    """The pairings that may be in an interpretation of a size; none when fewer features than that have one.

    Parameters
    ----------
    tables : ArrayTables
        Of n data and e model features.
    size : int
        Data features in the interpretation.

    Returns
    -------
    (n, e) bool
        cores.core_numbers(...) >= size.

    References
    ----------
    Thesis 7.4.
    """
    with tables.dap.at_line(Phase.ELIMINATION):
        alive = [vector.copy() for vector in tables.possible]
        while True:
            left = [k for k, vector in enumerate(alive) if f.any_(vector)]
            if len(left) < size:
                return np.zeros((tables.n, tables.e), bool)
            changed = False
            support = _supports(tables, alive, left)
            for k in left:
                kept = alive[k] & (support[k] >= size - 1)
                changed |= f.any_(alive[k] ^ kept)
                alive[k] = kept
            if not changed:
                return np.array([vector.values for vector in alive])


def _supports(tables: ArrayTables, alive: list[DapArray], left: list[int]) -> list[DapArray]:
    """For each data feature a vector: how many others have a model feature that agrees with each of its pairings."""
    dap, e = tables.dap, tables.e
    # INTEGER*2: no more than the data features are counted.
    support = [f.filled(dap, 0, (e,), integer(2)) for _ in range(tables.n)]
    still = set(left)
    for p, (a, b) in enumerate(tables.pairs):
        if a not in still or b not in still:
            continue
        agree_a, agree_b = np.zeros(e, bool), np.zeros(e, bool)
        for part, plane in zip(tables.parts, tables.match[p]):
            if plane is None:
                continue
            columns, rows = (slice(begin, min(end, e)) for begin, end in (part.columns, part.rows))
            possible_a = f.matr(dap.vector(alive[a].values[columns]), plane.shape[0])
            possible_b = f.matc(dap.vector(alive[b].values[rows]), plane.shape[1])
            both = plane & possible_a & possible_b
            agree_a[columns] |= (f.sumr(both) > 0).values
            agree_b[rows] |= (f.sumc(both) > 0).values
        for k, agree in ((a, agree_a), (b, agree_b)):
            support[k].assign(support[k] + 1, dap.vector(agree))
    return support
