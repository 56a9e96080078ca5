"""Compiled anti-aliasing: several rays in each of the pixels that need them. One call does one thread's share."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

from .differences import PATCH_COLUMNS, PATCH_ROWS, mark_by_leaves, mark_by_sight, note_corners
from .image import begin_row, byte, finish_row, lit_row, on_boundary
from .records import Patch, PixelRun, Rays
from .rows import BLUE, DEPTH, FACE_IN, GREEN, HIT, LEAF_IN, LEAF_OUT, RED, STRIDE, X, kernel
from .tree import product_row

ZERO = np.uint64(0)


@kernel
def products_at(products, area, csg, camera, plan):
    """The products that may be seen in an area (top, bottom, left, right), front to back; how many."""
    top, bottom, left, right = area
    count = np.int64(0)
    for k in range(camera.chosen.shape[0]):
        q = camera.chosen[k]
        touches = plan.whole
        row = top
        while row < bottom and not touches:
            touches = plan.span[q, row, 0] < right and plan.span[q, row, 1] >= left
            row += 1
        if touches:
            products[count] = q
            count += 1
    return count


@kernel
def hit_samples(work, rays, m, row, y, products, csg, camera, plan, terrains):
    """As hit_row, for m rays that are not one a pixel but ascend along a row.

    rays : Rays, the first ray of every column and the columns of rays; products : which, and how many
    """
    s = work.row
    begin_row(s, np.uint64(m))
    ambiguous = False
    for k in range(products[1]):
        q = products[0][k]
        first, last = np.int64(0), np.int64(m)
        if not plan.whole:
            left, right = plan.span[q, row, 0], plan.span[q, row, 1]
            if left > right:
                continue
            first, last = rays.first[left], min(rays.first[right + 1], m)
        if first >= last:
            continue
        within = PixelRun(row, rays.column[first], rays.column[last - 1])
        j0, j1 = np.uint64(first), np.uint64(last)
        product_row(s, j0, j1, q, within, y, plan.tolerance, csg, camera, plan.whole, work.counts)
        ambiguous |= csg.ambiguity[q] > 0.0
    finish_row(work, m, y, ambiguous, csg, camera, plan, terrains)


@kernel
def group_by_face(s, m, rays):
    """Bring the hits of one face together (X, DEPTH, HIT); which ray each of them is, into rays.order.

    What lies on one face is lit in one loop.
    """
    start, order = rays.start, rays.order
    runs, end = np.int64(0), np.uint64(m)
    for j in range(ZERO, end):
        if j == ZERO or s[HIT + j] != s[HIT + j - np.uint64(1)]:
            start[runs] = j
            runs += 1
    start[runs] = m
    n = np.int64(0)
    for i in range(runs):
        if order[rays.taken + i] == 1:
            order[rays.taken + i] = 0
            continue
        hit = s[HIT + np.uint64(start[i])]
        for k in range(i, runs):
            if s[HIT + np.uint64(start[k])] == hit and order[rays.taken + k] == 0:
                for ray in range(start[k], start[k + 1]):
                    order[n] = ray
                    n += 1
                order[rays.taken + k] = 1 if k > i else 0
    for j in range(ZERO, end):
        hit_of = np.uint64(order[j])
        s[LEAF_IN + j], s[LEAF_OUT + j], s[FACE_IN + j] = s[X + hit_of], s[DEPTH + hit_of], s[HIT + hit_of]
    for j in range(ZERO, end):
        s[X + j], s[DEPTH + j], s[HIT + j] = s[LEAF_IN + j], s[LEAF_OUT + j], s[FACE_IN + j]


@kernel
def sample_pixels(work, rays, at, grid, products, csg, camera, materials, plan, target, tracing, terrains):
    """Weighted means of the samples in the first pixels of a row in rays.pixel, into the target.

    at : the row, and how many pixels; grid : offsets (n,) of samples from the centre along both axes, pixels, and their
    weights (n, n); tracing : secondary and surfaces of colour_row
    """
    s, columns, sums = work.row, rays.pixel, rays.sums
    row, count = at
    offsets, weights = grid
    n = offsets.shape[0]
    m = n * count
    sums[:, :count] = 0.0
    for v in range(n):
        y = plan.ys[row] + offsets[v] * plan.dy
        for pixel in range(count):
            for u in range(n):
                s[X + np.uint64(n * pixel + u)] = plan.xs[columns[pixel]] + offsets[u] * plan.dx
        hit_samples(work, rays, m, row, y, products, csg, camera, plan, terrains)
        group_by_face(s, m, rays)
        lit_row(work, m, y, csg, materials, plan, tracing[0], tracing[1], terrains)
        for k in range(m):
            j, ray = np.uint64(k), rays.order[k]
            pixel, weight = ray // n, weights[v, ray % n]
            sums[0, pixel] += weight * s[RED + j]
            sums[1, pixel] += weight * s[GREEN + j]
            sums[2, pixel] += weight * s[BLUE + j]
    for pixel in range(count):
        for channel in range(3):
            target.image[row, columns[pixel], channel] = byte(sums[channel, pixel])
            if target.radiance.shape[0] > 0:
                target.radiance[row, columns[pixel], channel] = sums[channel, pixel]


@kernel
def mark_boundaries(target, top, bottom, marks):
    """Mark the pixels where faces meet."""
    for row in range(top, bottom):
        for column in range(marks.shape[1]):
            if on_boundary(target, row, column):
                marks[row, column] = 1


@kernel
def mark_patch(work, patch, rays, area, csg, camera, materials, plan, target, marks):
    """Mark the pixels of a patch whose samples may differ; area : top, bottom, left, right."""
    s = work.row
    top, bottom, left, right = area
    height, width = marks.shape
    count = products_at(work.products, area, csg, camera, plan)
    if count == 0 and camera.listed.shape[0] == 0:
        return
    for j in range(PATCH_COLUMNS):
        s[X + np.uint64(j)] = plan.xs[0] + (left + j - 0.5) * plan.dx
        rays.column[j] = min(left + j, width - 1)
    # The corners left of a pixel belong to it, those right of the last one to that.
    for column in range(width + 1):
        rays.first[column] = min(max(column - left, 0), PATCH_COLUMNS)
    rays.first[width] = min(width - left + 1, PATCH_COLUMNS)
    for i in range(bottom - top + 1):
        # The corners above a row belong to it, those below the last one to that.
        row = min(top + i, height - 1)
        y = plan.ys[0] + (top + i - 0.5) * plan.dy
        hit_samples(work, rays, PATCH_COLUMNS, row, y, (work.products, count), csg, camera, plan, None)
        lit_row(work, PATCH_COLUMNS, y, csg, materials, plan, None, None, None)
        note_corners(s, patch, i)
    mark_by_sight(patch, area, target, marks)
    mark_by_leaves(s, patch, area, csg, camera, plan, marks)


@njit(error_model='numpy', nogil=True)
def mark_rows(share, faces_only, csg, camera, materials, plan, target, work, marks):
    """Mark the pixels that need more than one sample in some bands of rows. All of the target is rendered.

    share : first band, step; faces_only : only where faces meet, else wherever samples may differ; marks : (h, w)
    uint8, zeros
    """
    height, width = target.depth.shape
    patch = Patch(
        np.empty(PATCH_ROWS * PATCH_COLUMNS),
        np.empty(PATCH_ROWS * PATCH_COLUMNS),
        np.empty((3, PATCH_ROWS * PATCH_COLUMNS)),
        np.empty(2 * PATCH_COLUMNS, np.int32),
        np.empty(PATCH_COLUMNS, np.int32),
    )
    rays = new_rays(width)
    band = PATCH_ROWS - 1
    for top in range(share[0] * band, height, share[1] * band):
        bottom = min(top + band, height)
        if faces_only:
            mark_boundaries(target, top, bottom, marks)
            continue
        for left in range(0, width, PATCH_COLUMNS - 1):
            if work.counts[3] != 0:
                return
            right = min(left + PATCH_COLUMNS - 1, width)
            mark_patch(work, patch, rays, (top, bottom, left, right), csg, camera, materials, plan, target, marks)


@njit(error_model='numpy', nogil=True)
def new_rays(width):
    """Scratch memory of samples in rows of so many pixels."""
    return Rays(
        np.empty(width + 1, np.int64),
        np.empty(STRIDE, np.int64),
        np.empty(STRIDE, np.int64),
        np.zeros(2 * STRIDE, np.int64),
        STRIDE,
        np.empty(STRIDE + 1, np.int64),
        np.empty((3, STRIDE)),
    )


@njit(error_model='numpy', nogil=True)
def smooth_rows(share, grid, csg, camera, materials, plan, target, work, tracing, terrains, marks):
    """Anti-alias the marked pixels in some rows: first, step. See sample_pixels for the rest."""
    height, width = target.depth.shape
    n = grid[0].shape[0]
    most = STRIDE // n
    rays = new_rays(width)
    for row in range(share[0], height, share[1]):
        column = 0
        while column < width:
            if work.counts[3] != 0:
                return
            count, left = np.int64(0), column
            while column < width and count < most:
                rays.first[column] = n * count
                if marks[row, column] != 0:
                    rays.pixel[count] = column
                    for u in range(n):
                        rays.column[n * count + u] = column
                    count += 1
                column += 1
            if count > 0:
                rays.first[:left] = 0
                rays.first[column:] = n * count
                area = (row, row + 1, rays.pixel[0], rays.pixel[count - 1] + 1)
                products = (work.products, products_at(work.products, area, csg, camera, plan))
                sample_pixels(
                    work, rays, (row, count), grid, products, csg, camera, materials, plan, target, tracing, terrains
                )
