"""Sorts of the match list on the array machine, as appendix C has them: means, minima and their first position."""

from __future__ import annotations

import numpy as np

from dap_emulator import Dap
from dap_emulator.machine import intrinsics as f
from dap_emulator.machine.kinds import integer
from msgs_py.numeric.typed import BoolArray, IntArray

from .ordering import curves_before_others, order_pairs

# The largest INTEGER: what a pair's number of matches becomes once the ascending sort has taken the pair.
TAKEN = max(integer().range)


def sort_pairs(dap: Dap, pairs: IntArray, sums: IntArray, ordering: str, curves: BoolArray | None = None) -> IntArray:
    """Rows of the match list in the order of traversal, found and charged by the machine.

    Parameters
    ----------
    dap : Dap
    pairs : (P, 2) int
        Data pairs a < b of n features, all of them.
    sums : (P,) int
        Matches of each pair.
    ordering : str
        As for ordering.order_pairs, whose answer this is.
    curves : (n,) bool, optional
        Which features are curves, for 'curves_first'.

    Returns
    -------
    (P,) int64

    References
    ----------
    Thesis 5.7.1 and appendix C.
    """
    pairs, sums = np.asarray(pairs), np.asarray(sums)
    if ordering == 'curves_first':
        listed, places = curves_before_others(pairs, curves)
        dap.charge_mcu('scalar', len(pairs) * dap.costs.mcu())
        return listed[sort_pairs(dap, places, sums[listed], 'consistency_grouped')]
    if ordering == 'consistency':
        # Two loops of the control unit write this order down.
        dap.charge_mcu('scalar', len(pairs) * dap.costs.mcu())
        return order_pairs(pairs, sums, ordering)
    if ordering in ('holder_buxton', 'worst'):
        return _by_count(dap, sums, ordering == 'holder_buxton')
    return _by_groups(dap, pairs, sums, ordering == 'combined')


def _by_count(dap: Dap, sums: IntArray, ascending: bool) -> IntArray:
    """Holder and Buxton's sort, or the opposite: the extreme of what is left, one after the other."""
    count = dap.vector(sums, integer())
    order = []
    for _ in range(len(sums)):
        position = f.eln(f.minp(count) if ascending else f.maxp(count))
        order.append(position - 1)
        count[position - 1] = TAKEN if ascending else -1
    return np.array(order, dtype=np.int64)


def _by_groups(dap: Dap, pairs: IntArray, sums: IntArray, combined: bool) -> IntArray:
    """Group by group, the pair of fewest matches first in each; Combined puts the fewest of all before them."""
    count, second = dap.vector(sums, integer()), dap.vector(pairs[:, 1].astype(np.int64), integer())
    order = []
    start = f.eln(f.minp(count)) if combined else 0
    if start:
        order.append(start - 1)
    for group in range(1, int(pairs[:, 1].max()) + 1):
        members = second.compare('eq', group)
        if start:
            members[start - 1] = False
        if not f.any_(members):
            continue
        position = f.eln(f.minp(f.merge(count, TAKEN, members)))
        while position:
            order.append(position - 1)
            members[position - 1] = False
            position = f.eln(members)
    return np.array(order, dtype=np.int64)
