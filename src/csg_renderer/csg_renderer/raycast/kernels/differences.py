"""Compiled search for the pixels in which samples may differ: all others are what their centre is.

The samples of a pixel lie between its four corners. Where the rays through these see the face that its centre sees,
another can only be seen between them if a primitive comes into the pixel in front of that face or cuts it there.
Primitives are convex: one that all four rays meet is met everywhere between them. So a pixel is marked when

* a corner sees another face than the centre; or
* some primitive, in front of what is seen or at it, is met at some of the corners and not at others, or lies in front
  of what is seen at some and behind it at others; or
* a primitive that no corner meets may touch the pixel (its outline says so), nearer than what is seen; or
* the colour is so curved that the mean of the samples is not the centre's.

The last follows from the second order of the colour f in a pixel: the mean of n x n samples is
f + (f_xx + f_yy) (1 - 1 / n^2) / 24, and the mean of two opposite corners f + (f_xx + f_yy +- 2 f_xy) / 8. What is left
out are folds between two removed primitives and bumps of curved ones that are smaller than a pixel.
"""

from __future__ import annotations

import numpy as np

from ..programs.program import TERRAIN
from ..settings import HIDDEN_GAP_PIXELS, MOST_CURVED
from .rows import BLUE, DEPTH, GREEN, HIT, LEAF_IN, LEAF_OUT, RED, kernel, leaf_row
from .tree import FACE_STEP, LEAF_STEP, NOTHING

ZERO, ONE = np.uint64(0), np.uint64(1)
# Corners of a patch of pixels, of which there are one less each way.
PATCH_ROWS, PATCH_COLUMNS = 32, 64
ACROSS = np.uint64(PATCH_COLUMNS)
# How a primitive lies to what is seen: not met, behind it, at it, about it, ending at it, or all in front of it.
MISSED, BEHIND, HERE, ABOUT, ENDING, BEFORE = range(6)


@kernel
def mark_by_leaves(s, patch, area, csg, camera, plan, marks):
    """Mark pixels into which a leaf may come, or in which it may begin to matter.

    s : row scratch of rows.py, with X of the corners; patch : Patch; area : top, bottom, left, right
    """
    top, bottom, left, right = area
    for leaf in range(csg.kind.shape[0]):
        if csg.kind[leaf] == TERRAIN:
            continue
        first, last, begin, end = right, left - 1, bottom, top - 1
        for row in range(top, bottom):
            a, b = max(camera.span[leaf, row, 0], left), min(camera.span[leaf, row, 1], right - 1)
            if a <= b:
                first, last = min(first, a), max(last, b)
                begin, end = min(begin, row), row
        if end < begin:
            continue
        # Corners beyond those of the pixels that it touches: it is not met there.
        j0, j1 = np.uint64(first - left), np.uint64(last - left + 2)
        for row in range(begin, end + 2):
            states_at(s, patch, row - top, row, leaf, (j0, j1), csg, camera, plan)
            if row > begin:
                mark_between(patch, row - 1 - top, row - 1, leaf, (j0, j1), left, camera, plan, marks)


@kernel
def states_at(s, patch, i, row, leaf, columns, csg, camera, plan):
    """How a leaf lies to what is seen at the i-th corners of a patch, those above an image row."""
    y = (row - 0.5) * plan.dy + plan.ys[0]
    j0, j1 = columns
    leaf_row(s, j0, j1, csg.kind[leaf], leaf, camera.local, camera.origin, camera.limit, y)
    state, depth = patch.state, patch.depth
    place, here = np.uint64(i) * ACROSS, np.uint64(i % 2) * ACROSS
    gap, tolerance = 1.0 + HIDDEN_GAP_PIXELS * plan.dx, 2.0 * plan.tolerance
    for j in range(j0, j1):
        near, far, seen = s[LEAF_IN + j], s[LEAF_OUT + j], depth[place + j]
        met = (far - near > tolerance) & (far > tolerance)
        front = BEFORE if far < seen - tolerance else ENDING if far <= seen + tolerance else ABOUT
        behind = BEHIND if near > seen * gap else HERE
        state[here + j] = (front if near < seen - tolerance else behind) if met else MISSED


@kernel
def mark_between(patch, i, row, leaf, columns, left, camera, plan, marks):
    """Mark the pixels of a row between corners that a leaf lies to in different ways, or between which it may be."""
    state, flags, depth = patch.state, patch.flags, patch.depth
    up, down = np.uint64(i % 2) * ACROSS, np.uint64((i + 1) % 2) * ACROSS
    place = np.uint64(i) * ACROSS
    thin, near, gap = np.int32(camera.thin[leaf]), camera.least[leaf], 1.0 + HIDDEN_GAP_PIXELS * plan.dx
    first, last = camera.span[leaf, row, 0] - left, camera.span[leaf, row, 1] - left
    for j in range(columns[0], columns[1] - ONE):
        a, b, c, d = state[up + j], state[up + j + ONE], state[down + j], state[down + j + ONE]
        most, least = max(max(a, b), max(c, d)), min(min(a, b), min(c, d))
        changes = max(most, BEHIND) != max(least, BEHIND)
        unseen = (thin > 0) & (most == MISSED) & (near <= depth[place + j] * gap)
        flags[j] = 1 if changes | unseen else 0
    for j in range(max(np.int64(columns[0]), first), min(np.int64(columns[1]) - 1, last + 1)):
        if flags[j] > 0:
            marks[row, left + j] = 1


@kernel
def mark_by_sight(patch, area, target, marks):
    """Mark pixels whose corners see another face than their centres, or where the colour is curved too much."""
    top, bottom, left, right = area
    codes, flags, colours = patch.codes, patch.flags, patch.colours
    for row in range(top, bottom):
        above = np.uint64(row - top) * ACROSS
        below = above + ACROSS
        for k in range(right - left):
            j = np.uint64(k)
            code = target.primitive[row, left + k] * LEAF_STEP + FACE_STEP * target.face[row, left + k]
            seen = code if code >= 0.0 else 2.0 * NOTHING
            a, b, c, d = codes[above + j], codes[above + j + ONE], codes[below + j], codes[below + j + ONE]
            flags[j] = 1 if (a != seen) | (b != seen) | (c != seen) | (d != seen) else 0
        for channel in range(3):
            for k in range(right - left):
                j, seen = np.uint64(k), target.image[row, left + k, channel] / 255.0
                a, b = colours[channel, above + j], colours[channel, above + j + ONE]
                c, d = colours[channel, below + j], colours[channel, below + j + ONE]
                one, other = 0.5 * (a + d) - seen, 0.5 * (b + c) - seen
                flags[j] |= 1 if (abs(one) > MOST_CURVED) | (abs(other) > MOST_CURVED) else 0
        for k in range(right - left):
            if flags[k] > 0:
                marks[row, left + k] = 1


@kernel
def note_corners(s, patch, i):
    """What the i-th row of corners of a patch sees, of work.row."""
    place = np.uint64(i) * ACROSS
    for j in range(ZERO, ACROSS):
        patch.depth[place + j] = s[DEPTH + j]
        # Without the mark of walls seen from inside.
        patch.codes[place + j] = 2.0 * np.floor(0.5 * s[HIT + j])
        patch.colours[0, place + j], patch.colours[1, place + j], patch.colours[2, place + j] = (
            s[RED + j],
            s[GREEN + j],
            s[BLUE + j],
        )
