"""Tiles of an image with the pruned trees that can be seen in them (thesis 4.9), for the engines in plain numpy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from msgs_py import PinholeCamera
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from ..settings import RECTANGLE_MARGIN
from .program import DIFFERENCE, INTERSECT, View


class Tile(NamedTuple):
    """A part of an image and what can be seen there.

    Attributes
    ----------
    area
        Its rows and columns.
    children
        Postfix programs.
    terrains
        Leaves that are height grids.
    """

    area: tuple[slice, slice]
    children: list[IntArray]
    terrains: list[int]


def tiles(view: View, camera: PinholeCamera, size: int) -> Iterator[Tile]:
    """Every tile, row by row; a child that cannot be there is left out, another is pruned to the leaves that can.

    size : pixels a side
    """
    boxes = leaf_rectangles(view, camera)
    for top in range(0, camera.height, size):
        for left in range(0, camera.width, size):
            right, bottom = min(left + size, camera.width), min(top + size, camera.height)
            present = (
                (boxes[:, 0] <= right - 0.5)
                & (boxes[:, 2] >= left - 0.5)
                & (boxes[:, 1] <= bottom - 0.5)
                & (boxes[:, 3] >= top - 0.5)
            )
            pruned = (prune(code, present) for code in view.program.children)
            yield Tile(
                (slice(top, bottom), slice(left, right)),
                [code for code in pruned if len(code)],
                [leaf for leaf in view.program.terrains if present[leaf]],
            )


def untiled(view: View, camera: PinholeCamera, size: int) -> Iterator[Tile]:
    """The same tiles, each with all children, unpruned."""
    for top in range(0, camera.height, size):
        for left in range(0, camera.width, size):
            right, bottom = min(left + size, camera.width), min(top + size, camera.height)
            area = slice(top, bottom), slice(left, right)
            yield Tile(area, list(view.program.children), list(view.program.terrains))


def leaf_rectangles(view: View, camera: PinholeCamera) -> FloatArray:
    """(leaves, 4) float64: pixel bounds (u, v, u, v) of every leaf; the whole plane where they are not known."""
    program = view.program
    boxes: FloatArray = np.tile([-np.inf, -np.inf, np.inf, np.inf], (len(program.kind), 1))
    camera_T_scene = np.linalg.inv(view.scene_T_camera)
    points = program.outline @ camera_T_scene[:3, :3].T + camera_T_scene[:3, 3]
    for leaf in range(len(boxes)):
        corners = points[program.outline_start[leaf] : program.outline_start[leaf + 1]]
        if len(corners) and corners[:, 2].min() > view.departure:
            pixels = camera.project(corners)
            boxes[leaf] = [*(pixels.min(axis=0) - RECTANGLE_MARGIN), *(pixels.max(axis=0) + RECTANGLE_MARGIN)]
    return boxes


def prune(code: IntArray, present: BoolArray) -> IntArray:
    """A postfix program without the leaves that are not present (thesis 4.9); empty when nothing can remain.

    Parameters
    ----------
    code : (m,) int64
        A postfix program of leaf indices and operator codes (program.py).
    present : (n,) bool
        Which leaves there are.

    Returns
    -------
    (k,) int64

    Examples
    --------
    >>> from csg_renderer.raycast.programs.program import DIFFERENCE, UNION
    >>> code = np.array([0, 1, DIFFERENCE, 2, UNION])
    >>> prune(code, np.array([True, False, False])).tolist()
    [0]
    >>> prune(code, np.array([False, True, True])).tolist()
    [2]
    """
    stack: list[list[int]] = []
    for op in code:
        if op >= 0:
            stack.append([int(op)] if present[op] else [])
            continue
        right, left = stack.pop(), stack.pop()
        if left and right:
            stack.append([*left, *right, int(op)])
        elif op == INTERSECT:
            stack.append([])
        else:
            stack.append(left if op == DIFFERENCE else left or right)
    return np.array(stack[0], dtype=np.int64)


def boundary(codes: IntArray) -> BoolArray:
    """(h, w) bool: pixels one of whose eight neighbours shows another face. codes : (h, w), hits.

    Examples
    --------
    >>> boundary(np.array([[1, 1, 1, 2, 2]])).astype(int).tolist()
    [[0, 0, 1, 1, 0]]
    """
    padded = np.pad(codes, 1, mode='edge')
    h, w = codes.shape
    different: BoolArray = np.zeros((h, w), bool)
    for dv in range(3):
        for du in range(3):
            different |= padded[dv : dv + h, du : du + w] != codes
    return different
