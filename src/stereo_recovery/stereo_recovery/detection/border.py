"""What a rectification leaves empty beside the picture: no edge there belongs to the scene."""

from __future__ import annotations

import cv2
import numpy as np

from msgs_py.numeric.typed import BoolArray, Float32Array, IntArray

from .settings import DEEPEST_BORDER, STEEPEST_BORDER


def beside_border(grey: Float32Array, reach: int) -> BoolArray | None:
    """Pixels that a rectification left at 0, and those beside them.

    Such a border runs nearly along each side that it is on, and is nowhere deep; the outline of something before a
    black ground is neither.

    Parameters
    ----------
    grey : (h, w) float32, grey levels
    reach : int
        Pixels. How far from the border smoothing carries it.

    Returns
    -------
    (h, w) bool
        Or None where there is no such border.

    Examples
    --------
    >>> picture = np.full((60, 80), 90.0, np.float32)
    >>> beside_border(picture, 3) is None
    True
    >>> picture[:, :5] = 0.0
    >>> beside_border(picture, 3)[30, 6:10].tolist()
    [True, True, False, False]
    """
    if min(side.min() for side in (grey[0], grey[-1], grey[:, 0], grey[:, -1])) > 0.0:
        return None
    empty = np.zeros(grey.shape, bool)
    for turns in range(4):
        # Each side in turn is the left one.
        picture, own = np.rot90(grey, turns), np.rot90(empty, turns)
        deepest = int(DEEPEST_BORDER * picture.shape[1])
        depth = _depth(picture[:, : deepest + 1])
        if not depth.any():
            continue
        middle = depth[len(depth) // 4 : len(depth) - len(depth) // 4]
        lean = abs(float(middle[-1] - middle[0])) / len(middle)
        if middle.max() > deepest or np.abs(np.diff(middle)).max(initial=0) > 1 or lean > STEEPEST_BORDER:
            return None
        shallow = np.where(depth <= deepest, depth, 0)
        own[:, :deepest] |= np.arange(deepest) < shallow[:, None]
    if not empty.any():
        return None
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.dilate(empty.astype(np.uint8), square) > 0)


def _depth(picture: Float32Array) -> IntArray:
    """(h,) int, pixels: how many are 0 in each row before the first that is not."""
    filled = picture > 0.0
    depth: IntArray = np.where(filled.any(axis=1), filled.argmax(axis=1), picture.shape[1])
    return depth
