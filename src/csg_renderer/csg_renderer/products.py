"""CSG trees as unions of products, which a ray caster need not merge lists for (Goldfeather et al. 1986).

A product is an intersection of leaves minus other leaves: P1 & P2 & ... - N1 - N2 .... The first entry into a union of
products is the nearest of their first entries, and a product's first entry takes only the latest entry into its P,
moved on through every N that covers it.
"""

from __future__ import annotations

import numpy as np

from .program import DIFFERENCE, INTERSECT

# A tree that needs more products or longer ones is cheaper to evaluate with lists of boundaries.
MOST_PRODUCTS = 32
MOST_FACTORS = 64
# So is a deeper one, which holds more leaves than its products may; it also must not use up the stack.
DEEPEST = 256

Product = tuple[frozenset[int], frozenset[int]]


class TooMany(Exception):
    """The tree does not fit into MOST_PRODUCTS."""


def products_of(code: np.ndarray) -> list[Product] | None:
    """The products, (leaves, leaves taken away), of a postfix program; None when there are too many."""
    # Every subtree as a pair of functions would be worked out twice; a stack of (inside, outside) thunks is not needed
    # because outsides are cheap to build once asked for.
    stack: list[_Node] = []
    for op in code:
        if op >= 0:
            stack.append(_Node(int(op)))
        else:
            right, left = stack.pop(), stack.pop()
            stack.append(_Node(int(op), left, right))
            if stack[-1].depth > DEEPEST:
                return None
    try:
        return stack[0].products(True)
    except TooMany:
        return None


class _Node:
    """A tree node that knows the products of its inside and of its outside."""

    def __init__(self, op: int, left: _Node | None = None, right: _Node | None = None) -> None:
        self.op, self.left, self.right = op, left, right
        self.depth: int = 0 if left is None or right is None else 1 + max(left.depth, right.depth)

    def products(self, inside: bool) -> list[Product]:
        if self.left is None or self.right is None:
            leaf: frozenset[int] = frozenset([self.op])
            return [(leaf, frozenset())] if inside else [(frozenset(), leaf)]
        # De Morgan: the outside of a union is the common outside, and so on. A difference is A & outside(B).
        left = self.left.products(inside)
        right = self.right.products(inside != (self.op == DIFFERENCE))
        meets = self.op in (INTERSECT, DIFFERENCE)
        return _meet(left, right) if meets == inside else _join(left, right)


def _join(left: list[Product], right: list[Product]) -> list[Product]:
    if len(left) + len(right) > MOST_PRODUCTS:
        raise TooMany
    return left + right


def _meet(left: list[Product], right: list[Product]) -> list[Product]:
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
