"""In which order a postfix program is evaluated, and what of it need not be (thesis 4.8)."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import IntArray

from .program import DIFFERENCE, INTERSECT, REVERSED_DIFFERENCE


def left_heavy(code: IntArray) -> IntArray:
    """The same tree with the operand first, at every operator, that needs the deeper stack.

    It then needs the least stack that any order does; of a chain of operators two places.

    Parameters
    ----------
    code : (m,) array of int64
        A postfix program, see :func:`postfix`.

    Returns
    -------
    (m,) int64
        REVERSED_DIFFERENCE stands for a DIFFERENCE whose operands are exchanged.

    References
    ----------
    Thesis 4.8. Sethi & Ullman, The generation of optimal code for arithmetic expressions, 1970.

    Examples
    --------
    >>> from csg_renderer.raycast.programs.program import UNION
    >>> left_heavy(np.array([0, 1, 2, 3, UNION, DIFFERENCE, UNION])).tolist()
    [2, 3, -1, 1, -4, 0, -1]
    """
    stack: list[tuple[list[int], int]] = []
    for op in code.tolist():
        if op >= 0:
            stack.append(([op], 1))
            continue
        (right, right_depth), (left, left_depth) = stack.pop(), stack.pop()
        if right_depth > left_depth:
            exchanged = {DIFFERENCE: REVERSED_DIFFERENCE, REVERSED_DIFFERENCE: DIFFERENCE}.get(op, op)
            right += left
            right.append(exchanged)
            stack.append((right, max(right_depth, left_depth + 1)))
        else:
            left += right
            left.append(op)
            stack.append((left, max(left_depth, right_depth + 1)))
    return np.array(stack[0][0], dtype=np.int64)


def stack_depth(code: IntArray) -> int:
    """The most lists that are on the stack at one time.

    Parameters
    ----------
    code : (m,) array of int64
        A postfix program.

    Examples
    --------
    >>> stack_depth(np.array([0, 1, 2, 3, -1, -3, -1])), stack_depth(np.array([2, 3, -1, 1, -4, 0, -1]))
    (4, 2)
    """
    return int(np.cumsum(np.where(code >= 0, 1, -1)).max(initial=0))


def early_outs(code: IntArray) -> list[int]:
    """Where a program may go on when nothing of a left operand is on any ray.

    Parameters
    ----------
    code : (m,) array of int64
        A postfix program.

    Returns
    -------
    list of m int
        For an instruction that ends the left operand of an INTERSECT or DIFFERENCE the index of that operator + 1, else
        0. Nothing is then the operator's result as well.

    References
    ----------
    Thesis 4.8. Roth, Ray casting for modeling solids, 1982.

    Examples
    --------
    >>> early_outs(np.array([0, 1, DIFFERENCE, 2, INTERSECT]))
    [3, 0, 5, 0, 0]
    """
    jumps = [0] * len(code)
    ends: list[int] = []
    for index, op in enumerate(code.tolist()):
        if op < 0:
            ends.pop()
            first_end = ends.pop()
            if op in (INTERSECT, DIFFERENCE):
                jumps[first_end] = index + 1
        ends.append(index)
    return jumps
