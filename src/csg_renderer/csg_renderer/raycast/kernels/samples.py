"""Compiled anti-aliasing: several rays in each of the pixels that need them. One call does one thread's share."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

from .image import begin_row, byte, finish_row, lit_row, on_boundary
from .records import PixelRun, Rays
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
        within = PixelRun(row, rays.column[first], rays.column[last - 1], row)
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


@njit(error_model='numpy', nogil=True)
def mark_rows(share, target, marks):
    """Mark the pixels where faces meet in some bands of rows: first band, step. All of the target is rendered."""
    for row in range(share[0], marks.shape[0], share[1]):
        for column in range(marks.shape[1]):
            if on_boundary(target, row, column):
                marks[row, column] = 1


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
