"""The order in which data pairs are taken from the match list (thesis 5.7.1, appendix C)."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import AnyArray, BoolArray, IntArray

from ..params import ORDERINGS


def order_pairs(
    pairs: AnyArray, sums: IntArray, ordering: str = 'combined', curves: BoolArray | None = None
) -> IntArray:
    """Rows of the match list in the order of traversal; equal sums keep the order of the list.

    Parameters
    ----------
    pairs : (P, 2) int
        Data pairs a < b of n features, all of them.
    sums : (P,) int
        Matches of each pair: consistent pairs of model features.
    ordering : str
        - 'worst': most matches first
        - 'holder_buxton': fewest matches first (Holder and Buxton)
        - 'consistency': 0-1, 0-2, 1-2, 0-3, 1-3, 2-3, ...: only the first pair has both features unassigned
        - 'consistency_grouped': the same, and in each group (pairs with one second feature) the pair of fewest matches
          first
        - 'combined': the grouped order behind the pair of fewest matches of all
        - 'curves_first': the grouped order with curves as the first features, so that pairs of two curves come first,
          then those of an edge with a curve (thesis 6.10); each pair but the first still has an assigned feature
    curves : (n,) bool, optional
        Which features are curves, for 'curves_first'; none when not given.

    Returns
    -------
    (P,) int64

    Raises
    ------
    ValueError
        For another ordering.

    References
    ----------
    Thesis 5.7.1, 6.10 and appendix C.

    Examples
    --------
    >>> pairs = np.array([[0, 1], [0, 2], [1, 2]])
    >>> order_pairs(pairs, np.array([5, 3, 1]), 'holder_buxton').tolist()
    [2, 1, 0]
    >>> order_pairs(pairs, np.array([5, 3, 1]), 'consistency_grouped').tolist()
    [0, 2, 1]
    """
    if ordering not in ORDERINGS:
        raise ValueError(f'ordering: expected one of {", ".join(ORDERINGS)}; got {ordering!r}')
    sums = np.asarray(sums)
    if len(pairs) == 0:
        return np.zeros(0, np.int64)
    if ordering == 'worst':
        return np.argsort(-sums, kind='stable')
    if ordering == 'holder_buxton':
        return np.argsort(sums, kind='stable')
    if ordering == 'curves_first':
        listed, places = curves_before_others(np.asarray(pairs), curves)
        return listed[order_pairs(places, sums[listed], 'consistency_grouped')]
    first, second = np.asarray(pairs)[:, 0], np.asarray(pairs)[:, 1]
    if ordering == 'consistency':
        return np.lexsort((first, second))
    # Within a group the pair of fewest matches leads; the rest follow in order.
    leaders = np.ones(len(pairs), dtype=np.int64)
    start = int(np.argmin(sums))
    for group in np.unique(second):
        members = np.flatnonzero(second == group)
        if ordering == 'combined':
            members = members[members != start]
        if len(members):
            leaders[members[np.argmin(sums[members])]] = 0
    order = np.lexsort((first, leaders, second))
    if ordering == 'combined':
        order = np.concatenate([[start], order[order != start]])
    return order.astype(np.int64)


def curves_before_others(pairs: IntArray, curves: BoolArray | None) -> tuple[IntArray, IntArray]:
    """The match list as it would be with all curves numbered before the other features.

    Returns
    -------
    listed : (P,) int64
        Where each pair of that list stands in ``pairs``.
    places : (P, 2) int64
        The new numbers of its features, the smaller first.

    Examples
    --------
    >>> listed, places = curves_before_others(np.array([[0, 1], [0, 2], [1, 2]]), np.array([False, True, True]))
    >>> listed.tolist(), places.tolist()
    ([2, 0, 1], [[0, 1], [0, 2], [1, 2]])
    """
    n = int(pairs.max()) + 1
    is_curve = np.zeros(n, bool) if curves is None else np.asarray(curves)
    place = np.argsort(np.argsort(~is_curve, kind='stable'), kind='stable')
    places = np.sort(place[pairs], axis=1)
    listed = np.lexsort((places[:, 1], places[:, 0]))
    return listed, places[listed]
