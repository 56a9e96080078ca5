"""Compiled image loops: tiles of rows to finished pixels. One call does one thread's share."""

from __future__ import annotations

import math

import numpy as np

from ..programs.program import TERRAIN
from ..tiling import NOWHERE
from .records import PixelRun
from .rows import BLUE, DEPTH, GREEN, HIT, NX, NY, NZ, RED, X, kernel
from .secondary_rays import follow, gather_row, scatter_row
from .shade import light_run, normals_run, points_row
from .surface_rays import surface_row
from .terrain import light_terrain, terrain_normals, terrain_row
from .tree import LEAF_STEP, NOTHING, list_row, product_row, settle_row

INF = math.inf
ZERO = np.uint64(0)


@kernel
def product_spans(chosen, csg, leaf_span, leaf_depth, size, span, band, near):
    """Spans, bands and least depths of products from those of their leaves: an intersection lies in all its parts."""
    height = leaf_span.shape[1]
    product_start, positive, factors = csg.product_start, csg.positive, csg.factors
    for k in range(chosen.shape[0]):
        q = chosen[k]
        begin = product_start[q]
        near[q] = 0.0
        for b in range(band.shape[1]):
            band[q, b, 0], band[q, b, 1] = NOWHERE, -1
        for f in range(begin, begin + positive[q]):
            near[q] = max(near[q], leaf_depth[factors[f]])
        for row in range(height):
            low, high = 0, NOWHERE
            for f in range(begin, begin + positive[q]):
                low = max(low, leaf_span[factors[f], row, 0])
                high = min(high, leaf_span[factors[f], row, 1])
            span[q, row, 0], span[q, row, 1] = low, high
            if low <= high:
                b = row // size
                band[q, b, 0] = min(band[q, b, 0], low)
                band[q, b, 1] = max(band[q, b, 1], high)


@kernel
def hit_row(work, m, run, y, offset, products, count, csg, camera, plan, terrains):
    """Nearest hits of the rays (s[X + j], y, 1), j < m, into DEPTH and HIT.

    run : the PixelRun that the rays lie in. offset : the pixel of ray 0 when rays are one a pixel, or -1 when they are
    scattered over the run. products[:count] are considered.
    terrains : the terrains, or None, which compiles without them
    """
    s = work.row
    begin_row(s, np.uint64(m))
    drawn, ambiguous = False, False
    for k in range(count):
        q = products[k]
        low, high = 0, m
        if not plan.whole:
            left, right = plan.span[q, run.row, 0], plan.span[q, run.row, 1]
            if left > run.last or right < run.first or left > right:
                continue
            if offset >= 0:
                low, high = max(left - offset, 0), min(right + 1 - offset, m)
                if low >= high:
                    continue
        j0, j1 = np.uint64(low), np.uint64(high)
        if drawn:
            # Front to back: a product all behind what is there already adds nothing.
            nearest = camera.near[q] - 2.0 * plan.tolerance
            open_pixels = 0
            for j in range(j0, j1):
                open_pixels += 1 if s[DEPTH + j] > nearest else 0
            if open_pixels == 0:
                continue
        first = run.first + low if offset >= 0 else run.first
        last = run.first + high - 1 if offset >= 0 else run.last
        within = PixelRun(run.row, first, last, run.bottom)
        product_row(s, j0, j1, q, within, y, plan.tolerance, csg, camera, plan.whole, work.counts)
        drawn = True
        ambiguous |= csg.ambiguity[q] > 0.0
    finish_row(work, m, y, ambiguous, csg, camera, plan, terrains)


@kernel
def begin_row(s, end):
    """Nothing is met yet by the rays of a row."""
    for j in range(ZERO, end):
        s[DEPTH + j] = INF
        s[HIT + j] = NOTHING


@kernel
def finish_row(work, m, y, ambiguous, csg, camera, plan, terrains):
    """Whose faces the products left open, and the hits of what is no product."""
    s, end = work.row, np.uint64(m)
    if ambiguous:
        settle_row(work, m, y, plan.tolerance, csg, camera)
    for k in range(camera.listed.shape[0]):
        list_row(work, ZERO, end, camera.listed[k], y, plan.tolerance, csg, camera)
    if terrains is not None:
        terrain_row(s, end, y, terrains, camera.local, plan.tolerance)


@kernel
def colour_row(work, m, place, y, csg, materials, plan, secondary, surfaces, terrains, coloured):
    """Normals of the hits of a row, and their colours, not clipped, if ``coloured``, into work.row.

    secondary : a SecondaryRayWorkspace for shadows and more levels, or None, which compiles without all that. With it
    the colours will be in secondary.colours[:, place:place + m] once the batch has been followed to its end.
    surfaces : a SurfaceRayWorkspace in place of it, for scenes with pictures and the like, or None
    """
    s = work.row
    # Nothing is worked out for the background at both ends.
    j, stop = 0, m
    while stop > 0 and s[HIT + np.uint64(stop - 1)] < 0.0:
        stop -= 1
    while j < stop and s[HIT + np.uint64(j)] < 0.0:
        j += 1
    for k in range(ZERO, np.uint64(m)):
        s[RED + k], s[GREEN + k], s[BLUE + k] = (
            materials.background[0],
            materials.background[1],
            materials.background[2],
        )
    begin = np.uint64(j)
    points_row(s, begin, np.uint64(stop), y, plan.rotation)
    while j < stop:
        # A run of pixels that show one face has one normal formula and one set of constants.
        first, hit = j, s[HIT + np.uint64(j)]
        while j < stop and s[HIT + np.uint64(j)] == hit:
            j += 1
        j0, j1 = np.uint64(first), np.uint64(j)
        if hit < 0.0:
            continue
        leaf = int(hit / LEAF_STEP)
        face = int(hit - leaf * LEAF_STEP) // 2
        normals_run(s, j0, j1, leaf, face, csg.kind[leaf], csg.inverse, materials.flat_normals)
        lit = False
        if terrains is not None:  # noqa: SIM102
            if csg.kind[leaf] == TERRAIN:
                terrain_normals(s, j0, j1, leaf, terrains, csg.inverse)
                if coloured and secondary is None and surfaces is None:
                    light_terrain(s, j0, j1, leaf, materials, terrains, csg.inverse)
                    lit = True
        if lit:
            continue
        if coloured and secondary is None and surfaces is None:
            colours = materials.colours
            colour = (colours[leaf, face, 0], colours[leaf, face, 1], colours[leaf, face, 2])
            light_run(s, j0, j1, leaf, colour, materials)
        else:
            for k in range(j0, j1):
                s[RED + k], s[GREEN + k], s[BLUE + k] = 0.0, 0.0, 0.0
    # Two conditions: the first is settled when compiling, and with None the rest is left out.
    if secondary is not None:  # noqa: SIM102
        if coloured:
            gather_row(s, m, place, csg, materials, work, secondary, terrains)
    if surfaces is not None:  # noqa: SIM102
        if coloured:
            surface_row(s, m, y, csg, materials, work, surfaces, terrains, plan)


@kernel
def lit_row(work, m, y, csg, materials, plan, secondary, surfaces, terrains):
    """Normals of the hits of a row, and their colours, 0..1, clipped, into work.row."""
    colour_row(work, m, 0, y, csg, materials, plan, secondary, surfaces, terrains, True)
    if secondary is not None:
        follow(1, m, csg, materials, work, secondary, terrains)
        scatter_row(work.row, m, 0, secondary.colours)
    clip_row(work.row, m)


@kernel
def clip_row(s, m):
    """RED, GREEN, BLUE to 0..1."""
    for k in range(ZERO, np.uint64(m)):
        s[RED + k] = min(max(s[RED + k], 0.0), 1.0)
        s[GREEN + k] = min(max(s[GREEN + k], 0.0), 1.0)
        s[BLUE + k] = min(max(s[BLUE + k], 0.0), 1.0)


@kernel
def write_truth(s, m, row, left, target, object_of):
    """Depth, ids and normals of a row of hits into the target, which holds background."""
    for j in range(m):
        k, column = np.uint64(j), left + j
        hit = s[HIT + k]
        if hit < 0.0:
            continue
        leaf = int(hit / LEAF_STEP)
        rest = int(hit - leaf * LEAF_STEP)
        # The outward normal faces the viewer, except on a wall seen from inside the solid (an odd code).
        sign = -1.0 if rest & 1 else 1.0
        target.depth[row, column] = s[DEPTH + k]
        target.primitive[row, column] = leaf
        target.face[row, column] = rest // 2
        target.object[row, column] = object_of[leaf]
        target.normal[row, column, 0] = sign * s[NX + k]
        target.normal[row, column, 1] = sign * s[NY + k]
        target.normal[row, column, 2] = sign * s[NZ + k]


@kernel
def byte(value):
    """Linear 0..1 to 0..255, rounded."""
    return np.uint8(min(max(value, 0.0), 1.0) * 255.0 + 0.5)


@kernel
def write_image(s, m, row, left, target):
    """RED, GREEN, BLUE of a row, 0..1, into the image, and into its radiance where that is wanted."""
    for j in range(m):
        k = np.uint64(j)
        target.image[row, left + j, 0] = byte(s[RED + k])
        target.image[row, left + j, 1] = byte(s[GREEN + k])
        target.image[row, left + j, 2] = byte(s[BLUE + k])
    if target.radiance.shape[0] > 0:
        for j in range(m):
            k = np.uint64(j)
            target.radiance[row, left + j, 0] = s[RED + k]
            target.radiance[row, left + j, 1] = s[GREEN + k]
            target.radiance[row, left + j, 2] = s[BLUE + k]


@kernel
def terrains_in_tile(terrains, camera, plan, top, bottom, left, right):
    """Whether the outline of a terrain touches a tile; the last row and column are exclusive."""
    if plan.whole:
        return True
    for g in range(terrains.leaf.shape[0]):
        for row in range(top, bottom):
            span = camera.span[terrains.leaf[g], row]
            if span[0] < right and span[1] >= left:
                return True
    return False


@kernel
def mean_row(work, m, run, left, products, count, csg, camera, materials, plan, tracing, terrains):
    """The means of n x n samples in the pixels of a row, into RED, GREEN, BLUE (Plan.box).

    tracing : secondary and surfaces of colour_row, which are settled when compiling
    """
    s, n = work.row, plan.box
    work.colours[:, :m] = 0.0
    for sample in range(n * n):
        if work.counts[3] != 0:
            return
        right = plan.places[sample, 0]
        y = plan.ys[run.row] + plan.places[sample, 1] * plan.dy
        for j in range(m):
            s[X + np.uint64(j)] = plan.xs[left + j] + right * plan.dx
        hit_row(work, m, run, y, left, products, count, csg, camera, plan, terrains)
        lit_row(work, m, y, csg, materials, plan, tracing[0], tracing[1], terrains)
        for j in range(ZERO, np.uint64(m)):
            work.colours[0, j] += s[RED + j]
            work.colours[1, j] += s[GREEN + j]
            work.colours[2, j] += s[BLUE + j]
    for j in range(ZERO, np.uint64(m)):
        s[RED + j] = work.colours[0, j] / (n * n)
        s[GREEN + j] = work.colours[1, j] / (n * n)
        s[BLUE + j] = work.colours[2, j] / (n * n)


@kernel
def products_in_tile(products, tile, camera, plan):
    """The products that may be seen in a tile (top, bottom, left, right), front to back; how many."""
    top, _, left, right = tile
    b = top // plan.size
    # A plain 0 would be a type of its own to begin with, for which hit_row would be compiled once more.
    count = np.int64(0)
    for i in range(camera.chosen.shape[0]):
        q = camera.chosen[i]
        if plan.whole or (plan.band[q, b, 0] < right and plan.band[q, b, 1] >= left):
            products[count] = q
            count += 1
    return count


@kernel
def render_tiles(thread, threads, csg, camera, materials, plan, target, work, secondary, surfaces, terrains, object_of):
    """Render every threads-th tile, starting with number ``thread``; the target holds background.

    Returns how many tiles were not empty.
    """
    s = work.row
    height, width = target.depth.shape
    across = (width + plan.size - 1) // plan.size
    down = (height + plan.size - 1) // plan.size
    products = work.products
    active = 0
    for tile in range(thread, across * down, threads):
        left, top = (tile % across) * plan.size, (tile // across) * plan.size
        right, bottom = min(left + plan.size, width), min(top + plan.size, height)
        count = products_in_tile(products, (top, bottom, left, right), camera, plan)
        # Where nothing stands the surroundings may be seen.
        idle = count == 0 and camera.listed.shape[0] == 0 and surfaces is None
        if terrains is not None:  # noqa: SIM102
            if idle:
                idle = not terrains_in_tile(terrains, camera, plan, top, bottom, left, right)
        if idle:
            continue  # the frame came filled with background
        active += 1
        m = right - left
        for row in range(top, bottom):
            if work.counts[3] != 0:
                return active
            y = plan.ys[row]
            run = PixelRun(row, left, right - 1, row)
            for j in range(m):
                s[X + np.uint64(j)] = plan.xs[left + j]
            hit_row(work, m, run, y, left, products, count, csg, camera, plan, terrains)
            place = (row - top) * m
            colour_row(work, m, place, y, csg, materials, plan, secondary, surfaces, terrains, plan.box == 0)
            write_truth(s, m, row, left, target, object_of)
            if plan.box > 0:
                tracing = (secondary, surfaces)
                mean_row(work, m, run, left, products, count, csg, camera, materials, plan, tracing, terrains)
            if secondary is None or plan.box > 0:
                clip_row(s, m)
                write_image(s, m, row, left, target)
        if secondary is not None:  # noqa: SIM102
            if plan.box == 0:
                follow(1, m, csg, materials, work, secondary, terrains)
                for row in range(top, bottom):
                    scatter_row(s, m, (row - top) * m, secondary.colours)
                    clip_row(s, m)
                    write_image(s, m, row, left, target)
    return active


@kernel
def on_boundary(target, row, column):
    """Whether one of the eight neighbours shows another face."""
    height, width = target.depth.shape
    primitive, face = target.primitive[row, column], target.face[row, column]
    for r in range(max(row - 1, 0), min(row + 2, height)):
        for c in range(max(column - 1, 0), min(column + 2, width)):
            if target.primitive[r, c] != primitive or target.face[r, c] != face:
                return True
    return False
