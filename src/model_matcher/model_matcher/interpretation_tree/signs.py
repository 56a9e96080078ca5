"""Direction signs during a search (thesis 5.5, 5.7.2).

A data feature's sign relative to its model feature is one of five states: U (unknown), + or - (known), +b or -b (the
same as, or opposite to, that of feature b). Features whose signs are related form a group, named by its first feature.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import Int8Array, Int32Array

from ..geometry.constraints import A_MINUS, A_PLUS, B_MINUS, B_PLUS, DIFFERENT, SAME


class Signs(NamedTuple):
    """The states of n features, changed in place.

    Attributes
    ----------
    root : (n,) int32
        The first feature of each one's group.
    parity : (n,) int8
        +1 or -1, its sign relative to root's.
    known : (n,) int8
        +1, -1 or 0 (unknown), the sign of a root; of no meaning for other features.
    """

    root: Int32Array
    parity: Int8Array
    known: Int8Array


@njit
def unknown_signs(n: int) -> Signs:
    """The states of n features of which nothing is known."""
    return Signs(np.arange(n).astype(np.int32), np.ones(n, np.int8), np.zeros(n, np.int8))


@njit
def stacked_signs(depth: int, n: int) -> Signs:
    """Room for the states of n features at each of ``depth`` levels: Signs of (depth, n) arrays."""
    return Signs(np.zeros((depth, n), np.int32), np.zeros((depth, n), np.int8), np.zeros((depth, n), np.int8))


@njit
def save_signs(signs: Signs, stack: Signs, level: int) -> None:
    """Copy the states to a level of the stack."""
    stack.root[level], stack.parity[level], stack.known[level] = signs.root, signs.parity, signs.known


@njit
def restore_signs(signs: Signs, stack: Signs, level: int) -> None:
    """Copy the states back from a level of the stack."""
    signs.root[:], signs.parity[:], signs.known[:] = stack.root[level], stack.parity[level], stack.known[level]


@njit
def set_sign(k: int, sign: int, signs: Signs) -> bool:
    """Give feature k an absolute sign; False when it is known to have the other."""
    r = signs.root[k]
    wanted = sign * signs.parity[k]
    if signs.known[r] == 0:
        signs.known[r] = wanted
        return True
    agrees: bool = signs.known[r] == wanted
    return agrees


@njit
def relate(a: int, b: int, relation: int, signs: Signs) -> bool:
    """Make b's sign equal (relation 1) or opposite (-1) to a's; False when that contradicts what is known."""
    root, parity, known = signs
    ra, rb = root[a], root[b]
    factor = relation * parity[a] * parity[b]
    if ra == rb:
        agrees: bool = factor == 1
        return agrees
    if known[ra] != 0 and known[rb] != 0 and known[rb] != factor * known[ra]:
        return False
    if rb < ra:
        ra, rb = rb, ra
    if known[ra] == 0:
        known[ra] = factor * known[rb]
    for k in range(len(root)):
        if root[k] == rb:
            root[k] = ra
            parity[k] *= factor
    return True


@njit
def apply_code(code: int, a: int, b: int, signs: Signs) -> bool:
    """Take over the signs that a table entry (constraints.entry) allows a and b; False when they contradict the states.

    The direction constraints come first, because they give absolute signs.
    """
    plus, minus = code & A_PLUS, code & A_MINUS
    if not (plus and minus) and not set_sign(a, 1 if plus else -1, signs):
        return False
    plus, minus = code & B_PLUS, code & B_MINUS
    if not (plus and minus) and not set_sign(b, 1 if plus else -1, signs):
        return False
    same, different = code & SAME, code & DIFFERENT
    return bool(same and different) or relate(a, b, 1 if same else -1, signs)


@njit
def write_signs(signs: Signs, assignment: Int32Array, out: Int8Array) -> None:
    """Absolute signs into out (n,) int8, 0 where unknown or where the feature has no model feature."""
    for k in range(len(assignment)):
        out[k] = signs.known[signs.root[k]] * signs.parity[k] if assignment[k] >= 0 else 0
