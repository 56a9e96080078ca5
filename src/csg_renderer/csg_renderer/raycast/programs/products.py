"""CSG trees as unions of products, which a ray caster need not merge lists for (Goldfeather et al. 1986).

A product is an intersection of leaves minus other leaves: P1 & P2 & ... - N1 - N2 .... The first entry into a union of
products is the nearest of their first entries, and a product's first entry takes only the latest entry into its P,
moved on through every N that covers it.
"""

from __future__ import annotations

import numpy as np

from ..settings import MOST_FACTORS, MOST_PRODUCTS
from .program import DIFFERENCE, INTERSECT

Product = tuple[frozenset[int], frozenset[int]]


class TooMany(Exception):
    """The tree does not fit into MOST_PRODUCTS of MOST_FACTORS."""


def products_of(code: np.ndarray) -> list[Product] | None:
    """The products of intersections whose union a tree is.

    Parameters
    ----------
    code : (m,) array of int64
        A postfix program, see :func:`postfix`.

    Returns
    -------
    list of (leaves, leaves taken away), or None
        None when there are too many (MOST_PRODUCTS, MOST_FACTORS).
    """
    stack: list[list[Product]] = []
    try:
        for op, inside in zip(code.tolist(), _sides(code.tolist())):
            if op >= 0:
                leaf: frozenset[int] = frozenset([op])
                stack.append([(leaf, frozenset())] if inside else [(frozenset(), leaf)])
                continue
            right, left = stack.pop(), stack.pop()
            # De Morgan: the outside of a union is the common outside, and so on. A difference is A & outside(B).
            meets = op in (INTERSECT, DIFFERENCE)
            stack.append(_meet(left, right) if meets == inside else left + right)
            if len(stack[-1]) > MOST_PRODUCTS:
                raise TooMany
    except TooMany:
        return None
    return stack[0]


def _sides(code: list[int]) -> list[bool]:
    """Whether the whole needs the inside (True) or the outside of every instruction of a postfix program."""
    sides = [True] * len(code)
    wanted = [True]
    for index in range(len(code) - 1, -1, -1):
        sides[index] = side = wanted.pop()
        if code[index] < 0:
            # Read backwards, the right operand comes first.
            wanted += [side, side != (code[index] == DIFFERENCE)]
    return sides


def _meet(left: list[Product], right: list[Product]) -> list[Product]:
    """Every product of the one with every product of the other."""
    if len(left) * len(right) > MOST_PRODUCTS:
        raise TooMany
    met = []
    for positive_1, negative_1 in left:
        for positive_2, negative_2 in right:
            positive, negative = positive_1 | positive_2, negative_1 | negative_2
            if len(positive) + len(negative) > MOST_FACTORS:
                raise TooMany
            if not positive & negative:
                met.append((positive, negative))
    return met
