"""What else of an outline is near each of its points, compiled."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int32Array

from .alignment import Placed
from .settings import BESIDE, FLANK, LEAST_FLANK, PARALLEL


@njit(nogil=True)
def neighbours(placed: Placed, spacing: FloatArray) -> tuple[FloatArray, Int32Array]:
    """Curves that run beside each point, and how far its normal is free of others.

    Parameters
    ----------
    placed : Placed
        n points, those of one view together.
    spacing : (n,) float64
        Pixels between them.

    Returns
    -------
    beside : (n, BESIDE) float64
        Pixels along the normal of curves about parallel, the nearest; not a number where there are fewer.
    flank : (n,) int32
        Pixels that no curve across it reaches, at most FLANK; 0 where these are too few.
    """
    n = len(placed.eye)
    beside, flank = np.full((n, BESIDE), np.nan), np.full(n, FLANK, np.int32)
    group, gap = np.full((n, BESIDE), -1, np.int32), np.full((n, BESIDE), np.inf)
    for k in range(n):
        for j in range(k + 1, n):
            if placed.eye[j] != placed.eye[k]:
                break
            du, dv = placed.pixel[j, 0] - placed.pixel[k, 0], placed.pixel[j, 1] - placed.pixel[k, 1]
            reach = FLANK + max(spacing[k], spacing[j])
            if placed.group[j] == placed.group[k] or abs(du) > reach or abs(dv) > reach:
                continue
            cosine = placed.normal[k, 0] * placed.normal[j, 0] + placed.normal[k, 1] * placed.normal[j, 1]
            if abs(cosine) < PARALLEL:
                free = np.int32(np.sqrt(du * du + dv * dv) - 0.5 * max(spacing[k], spacing[j]))
                free = free if free >= LEAST_FLANK else np.int32(0)
                flank[k], flank[j] = min(flank[k], free), min(flank[j], free)
                continue
            ahead = placed.normal[j, 0] * du + placed.normal[j, 1] * dv
            back = -(placed.normal[k, 0] * du + placed.normal[k, 1] * dv)
            _note(beside, group, gap, k, placed.group[j], ahead / cosine, du, dv, placed, spacing[j])
            _note(beside, group, gap, j, placed.group[k], back / cosine, du, dv, placed, spacing[k])
    return beside, flank


@njit(nogil=True)
def _note(
    beside: FloatArray,
    group: Int32Array,
    gap: FloatArray,
    k: int,
    other: int,
    offset: float,
    du: float,
    dv: float,
    placed: Placed,
    spacing: float,
) -> None:
    """Note a curve ``other`` that crosses the normal of point k at an offset, by its point nearest to the normal."""
    along = abs(placed.normal[k, 0] * dv - placed.normal[k, 1] * du)
    if along > 0.75 * spacing or abs(offset) > FLANK + 2.0:
        return
    at = -1
    for i in range(BESIDE):
        if group[k, i] == other:
            if along < gap[k, i]:
                beside[k, i], gap[k, i] = offset, along
            return
        if at < 0 and group[k, i] < 0:
            at = i
    if at < 0:  # all taken: instead of the farthest
        at = 0
        for i in range(1, BESIDE):
            if abs(beside[k, i]) > abs(beside[k, at]):
                at = i
        if abs(beside[k, at]) <= abs(offset):
            return
    beside[k, at], group[k, at], gap[k, at] = offset, other, along
