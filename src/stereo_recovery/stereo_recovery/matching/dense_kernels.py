"""Compiled loops over what dense disparity says of candidates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import Float32Array, FloatArray, Int32Array

from .settings import DENSE_TOLERANCE, DENSE_TRUE, DENSE_WRONG, LOOK_ALIKE

# What one sample says that agrees with a candidate, and one that does not.
AGREES = float(np.log(DENSE_TRUE / DENSE_WRONG))
DIFFERS = float(np.log((1.0 - DENSE_TRUE) / (1.0 - DENSE_WRONG)))


class Windows(NamedTuple):
    """The windows of an image, by their middles.

    image, mean : (h, w) float32, grey levels, of which the image's mean is taken off; contrast : (h, w) float32, root
    of the sum of squares about the window's mean; half : what a window has on either side of its middle, pixels
    """

    image: Float32Array
    mean: Float32Array
    contrast: Float32Array
    half: int


@njit
def look_alike(windows: Windows, row: int, one: int, other: int) -> bool:
    """Whether the window about a column correlates by more than LOOK_ALIKE with that about another, give or take one.

    row : of both; columns may lie outside of the image
    """
    image, half = windows.image, windows.half
    height, width = image.shape
    row = min(max(row, half), height - 1 - half)
    one, other = min(max(one, half), width - 1 - half), min(max(other, half + 1), width - 2 - half)
    # Three sums at a time, none of which waits for the others.
    before, at, behind = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for y in range(row - half, row + half + 1):
        for x in range(-half, half + 1):
            level = image[y, one + x]
            before += level * image[y, other + x - 1]
            at += level * image[y, other + x]
            behind += level * image[y, other + x + 1]
    mean, contrast = (2 * half + 1) ** 2 * windows.mean[row, one], LOOK_ALIKE * windows.contrast[row, one]
    return bool(
        before - mean * windows.mean[row, other - 1] > contrast * windows.contrast[row, other - 1]
        or at - mean * windows.mean[row, other] > contrast * windows.contrast[row, other]
        or behind - mean * windows.mean[row, other + 1] > contrast * windows.contrast[row, other + 1]
    )


@njit
def log_ratios(
    disparity: Float32Array, right: Windows, places: Int32Array, node: Int32Array, along: FloatArray
) -> FloatArray:
    """(k,) how much likelier the dense disparity beside candidates is if they are true, as logarithms.

    disparity : (h, w) reduced pixels, NaN where nothing is known; right : of the reduced right image; places : (n, 2,
    samples, offsets, 2) column and row beside the left segments; node : (k, 2); along : (k, samples) disparity of the
    candidates, reduced pixels.
    """
    ratio = np.empty(len(node))
    side = np.empty(2)
    samples, offsets = places.shape[2], places.shape[3]
    for k in range(len(node)):
        for s in range(2):
            side[s] = 0.0
            for m in range(samples):
                for o in range(offsets):
                    column, row = places[node[k, 0], s, m, o]
                    dense = disparity[row, column]
                    if np.isnan(dense):
                        continue
                    if abs(dense - along[k, m]) < DENSE_TOLERANCE:
                        side[s] += AGREES
                        continue
                    taken, own = int(np.rint(column - dense)), int(np.rint(column - along[k, m]))
                    # Where the picture repeats itself along the row, dense disparity is any of the repeats.
                    if not look_alike(right, row, taken, own):
                        side[s] += DIFFERS
            # Of each side one surface speaks, once.
            side[s] /= samples * offsets
        ratio[k] = np.logaddexp(side[0], side[1]) - np.log(2.0)
    return ratio
