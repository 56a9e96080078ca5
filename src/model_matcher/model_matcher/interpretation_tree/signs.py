"""Direction signs during a search (thesis 5.5, 5.7.2).

A data feature's sign relative to its model feature is one of five states: U (unknown), + or - (known), +b or -b (the
same as, or opposite to, that of feature b). They are kept as groups: ``root`` is the group's first feature,
``parity`` the sign relative to it, and ``known[root]`` the root's own sign or 0.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

from ..geometry.constraints import A_MINUS, A_PLUS, B_MINUS, B_PLUS, DIFFERENT, SAME


@njit
def set_sign(k, sign, root, parity, known):
    """Give feature k an absolute sign; False when it is known to have the other."""
    r = root[k]
    wanted = sign * parity[k]
    if known[r] == 0:
        known[r] = wanted
        return True
    return known[r] == wanted


@njit
def relate(a, b, relation, root, parity, known):
    """Make b's sign equal (relation 1) or opposite (-1) to a's; False when that contradicts what is known."""
    ra, rb = root[a], root[b]
    factor = relation * parity[a] * parity[b]
    if ra == rb:
        return factor == 1
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
def apply_code(code, a, b, root, parity, known):
    """Learn from a table entry; False is a sign cut-off. The direction constraints come first: they are absolute."""
    plus, minus = code & A_PLUS, code & A_MINUS
    if not (plus and minus) and not set_sign(a, 1 if plus else -1, root, parity, known):
        return False
    plus, minus = code & B_PLUS, code & B_MINUS
    if not (plus and minus) and not set_sign(b, 1 if plus else -1, root, parity, known):
        return False
    same, different = code & SAME, code & DIFFERENT
    return bool(same and different) or relate(a, b, 1 if same else -1, root, parity, known)


@njit
def write_signs(root, parity, known, out):
    """Absolute signs (n,) int8, 0 where unknown."""
    for k in range(len(root)):
        out[k] = known[root[k]] * parity[k]


def initial(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All states U: root (n,) int32, parity (n,) int8, known (n,) int8."""
    return np.arange(n, dtype=np.int32), np.ones(n, np.int8), np.zeros(n, np.int8)


def states(root: np.ndarray, parity: np.ndarray, known: np.ndarray) -> list[str]:
    """The thesis' five states, by feature: 'U', '+', '-', '+3' (same sign as feature 3), '-3'."""
    names = []
    sizes = np.bincount(root, minlength=len(root))
    for k in range(len(root)):
        sign = '+' if parity[k] > 0 else '-'
        if known[root[k]]:
            names.append('+' if known[root[k]] * parity[k] > 0 else '-')
        elif sizes[root[k]] == 1 or root[k] == k:
            names.append('U')
        else:
            names.append(f'{sign}{root[k]}')
    return names
