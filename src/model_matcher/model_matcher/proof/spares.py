"""How many data features a larger interpretation may leave out of those that a branch has.

Of each of some disjoint groups of data features it is known that one is left out. As long as a whole group is there, it
takes one off the number; the first of a group that drops out is the one that was counted.
"""

from __future__ import annotations

from typing import NamedTuple

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import IntArray


class Groups(NamedTuple):
    """Disjoint groups of data features of each of which one is left out.

    Attributes
    ----------
    of : (n,) int64
        The group of a data feature, or -1.
    sizes : (g,) int64
        How many features each group has.
    """

    of: IntArray
    sizes: IntArray


@njit
def spare_features(taken: IntArray, free: IntArray, least: int, groups: Groups, missing: IntArray) -> int:
    """How many of the free data features may drop out, so that ``least`` are left; negative when there are too few.

    taken : (t,) data features that are in; free : (m,) data features of free nodes, those of one together; missing :
    (g,) of each group, how many features are neither taken nor free, filled
    """
    spare = -least
    missing[:] = groups.sizes
    for a in taken:
        if groups.of[a] >= 0:
            missing[groups.of[a]] -= 1
    for k in range(len(free)):
        if k == 0 or free[k] != free[k - 1]:
            spare += 1
            if groups.of[free[k]] >= 0:
                missing[groups.of[free[k]]] -= 1
    for g in range(len(missing)):
        spare -= missing[g] == 0
    return spare


@njit
def left_out(b: int, groups: Groups, missing: IntArray) -> int:
    """What it takes off the spare features when data feature b drops out: nothing, if it is the first of a whole group.

    missing : (g,) of :func:`spare_features`, kept up to date
    """
    g = groups.of[b]
    if g < 0:
        return 1
    missing[g] += 1
    return 0 if missing[g] == 1 else 1
