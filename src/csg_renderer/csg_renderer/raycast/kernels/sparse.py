"""Compiled anti-aliasing of the pixels in which samples differ, tile by tile. One call does one thread's share.

Rays of several pixels are cast together, whatever rows they lie in. Of the samples of a pixel that see one face only
one place is shaded, in their middle, where the shade hardly bends in a pixel (differences.changes).
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

from ..settings import MOST_CURVED
from .differences import ALL, DOUBT, STEADY, bent_about, changes, corner, flag_tile
from .image import begin_row, byte, finish_row, lit_row, products_in_tile
from .records import Cells, PixelRun
from .rows import BLUE, DEPTH, FACE_IN, FACE_OUT, GREEN, HIT, LEAF_IN, LEAF_OUT, RED, STRIDE, X, Y, kernel
from .tree import FACE_STEP, LEAF_STEP, NOTHING, product_row

ZERO, ONE = np.uint64(0), np.uint64(1)


@kernel
def hit_pixels(work, at, n, products, tile, csg, camera, plan):
    """As hit_row, for n rays (X, Y) in each of some pixels of a tile.

    at : places of the pixels in the tile, the first of them, and how many; products : how many of work.products
    """
    s, counts = work.row, work.counts
    places, begin, count = at
    top, height, left, right = tile
    columns = right - left
    begin_row(s, np.uint64(count * n))
    ambiguous = False
    for i in range(products):
        q = work.products[i]
        nearest = camera.near[q] - 2.0 * plan.tolerance
        k = np.int64(0)
        while k < count:
            # A run of pixels that the product may touch.
            first, low, high, upper, bottom = k, right, left, height, 0
            while k < count:
                place = places[begin + k]
                row, column = top + place // columns, left + place % columns
                if plan.span[q, row, 0] > column or plan.span[q, row, 1] < column:
                    break
                low, high, upper, bottom = min(low, column), max(high, column), min(upper, row), max(bottom, row)
                k += 1
            if k == first:
                k += 1
                continue
            j0, j1 = np.uint64(first * n), np.uint64(k * n)
            open_rays = 0
            for j in range(j0, j1):
                open_rays += 1 if s[DEPTH + j] > nearest else 0
            if open_rays == 0:
                continue
            run = PixelRun(upper, low, high, bottom)
            product_row(s, j0, j1, q, run, None, plan.tolerance, csg, camera, False, counts)
            ambiguous |= csg.ambiguity[q] > 0.0
    finish_row(work, count * n, None, ambiguous, csg, camera, plan, None)


@kernel
def code_at(target, row, column):
    """The hit of a pixel of the target, without the mark of walls seen from inside."""
    leaf = target.primitive[row, column]
    return leaf * LEAF_STEP + target.face[row, column] * FACE_STEP if leaf >= 0 else NOTHING


@kernel
def same_code(one, other):
    """Whether two hits are of one face."""
    return np.floor(0.5 * one) == np.floor(0.5 * other)


@kernel
def ask_corners(work, cells, most, products, tile, csg, camera, edges, materials, plan, target):
    """Add those of the first ``most`` doubtful pixels to the sampled ones whose samples may differ; how many are then.

    most : how many are doubtful, and how many sampled already
    """
    s = work.row
    top, _, left, right = tile
    columns = right - left
    doubtful, sampled = most
    for begin in range(0, doubtful, STRIDE // 4):
        count = min(doubtful - begin, STRIDE // 4)
        for k in range(count):
            place = cells.doubtful[begin + k]
            row, column = top + place // columns, left + place % columns
            aside = corner(plan.samples, bent_about(target.primitive, row, column, edges))
            x, y = plan.xs[column], plan.ys[row]
            for c in range(4):
                j = np.uint64(4 * k + c)
                s[X + j] = x + (aside if c & 1 else -aside) * plan.dx
                s[Y + j] = y + (aside if c & 2 else -aside) * plan.dy
        hit_pixels(work, (cells.doubtful, begin, count), 4, products, tile, csg, camera, plan)
        points, groups = np.int64(0), np.int64(0)
        for k in range(count):
            place = cells.doubtful[begin + k]
            row, column = top + place // columns, left + place % columns
            code = code_at(target, row, column)
            differ = False
            for c in range(4):
                differ |= not same_code(s[HIT + np.uint64(4 * k + c)], code)
            if differ or code < 0.0:
                differ |= cells.near[place] > 0.0
            else:
                z = target.depth[row, column]
                change, slope = changes(code, plan.xs[column], plan.ys[row], z, csg, camera, edges, plan)
                # An edge not hidden that the corners do not notice ends here, or another lies beside it.
                differ = cells.near[place] * z * (1.0 + slope) >= 1.0
                if change > STEADY and not differ:
                    g, groups = group_of(cells, groups, code)
                    for c in range(4):
                        j = np.uint64(4 * k + c)
                        # Opposite corners together.
                        pair = 2 * k + (1 if c in (1, 2) else 0)
                        points = add_point(s, cells, points, (s[X + j], s[Y + j], s[DEPTH + j]), (pair, g), 0.5)
            if differ:
                cells.sampled[sampled] = place
                sampled += 1
        light_points(work, cells, points, groups, 2 * count, csg, materials, plan)
        for p in range(0, points, 4):
            k = cells.pixel[p] // 2
            place = cells.doubtful[begin + k]
            row, column = top + place // columns, left + place % columns
            bent = False
            for channel in range(3):
                seen = target.radiance[row, 3 * column + channel]
                for way in range(2):
                    bent |= abs(work.colours[channel, 2 * k + way] - seen) > MOST_CURVED
            if bent:
                cells.sampled[sampled] = place
                sampled += 1
    return sampled


@kernel
def group_of(cells, groups, code):
    """The group of points of one face, of so many (cells.groups); how many there are with it."""
    g = 0
    while g < groups and cells.groups[g] != code:
        g += 1
    if g == groups:
        cells.groups[g], cells.members[g] = code, 0
        groups += 1
    return g, groups


@kernel
def add_point(s, cells, points, ray, place, weight):
    """Add a place that is shaded to the first ``points``; how many are then.

    ray : x, y and depth; place : pixel, and group of its face; weight : its share of the pixel
    """
    p = np.uint64(points)
    s[LEAF_IN + p], s[LEAF_OUT + p], s[FACE_IN + p] = ray
    cells.pixel[points], cells.group[points] = place
    cells.weight[points] = weight
    cells.members[place[1]] += 1
    return points + 1


@kernel
def light_points(work, cells, points, groups, pixels, csg, materials, plan):
    """The colours of pixels from their points, into work.colours."""
    s, place, order = work.row, cells.members, cells.order
    work.colours[:, :pixels] = 0.0
    if points == 0:
        return
    # What lies on one face is lit in one loop.
    count = np.int64(0)
    for g in range(groups):
        count, place[g] = count + place[g], count
    for point in range(points):
        g, p, j = cells.group[point], np.uint64(point), np.uint64(place[cells.group[point]])
        s[X + j], s[Y + j], s[DEPTH + j], s[HIT + j] = s[LEAF_IN + p], s[LEAF_OUT + p], s[FACE_IN + p], cells.groups[g]
        order[place[g]] = point
        place[g] += 1
    lit_row(work, points, None, csg, materials, plan, None, None, None)
    for point in range(points):
        p, k, weight = np.uint64(point), cells.pixel[order[point]], cells.weight[order[point]]
        work.colours[0, k] += weight * s[RED + p]
        work.colours[1, k] += weight * s[GREEN + p]
        work.colours[2, k] += weight * s[BLUE + p]


@kernel
def add_quarters(s, cells, place, n, points, code):
    """Add the middles of what the samples in each quarter of a pixel see of the face of a hit; how many points then.

    place : pixel and group; n : how many samples
    """
    quarters = cells.quarters
    quarters[:] = 0.0
    for i in range(n):
        j = np.uint64(place[0] * n + i)
        if s[HIT + j] == code:
            q = cells.quarter[i]
            quarters[0, q] += 1.0
            quarters[1, q] += s[X + j]
            quarters[2, q] += s[Y + j]
            quarters[3, q] += s[FACE_OUT + j]
    for q in range(4):
        many = quarters[0, q]
        if many > 0.0:
            ray = quarters[1, q] / many, quarters[2, q] / many, many / quarters[3, q]
            points = add_point(s, cells, points, ray, place, many / n)
    return points


@kernel
def gather_faces(work, cells, k, n, have, csg, camera, edges, plan):
    """Add the points that are shaded for n samples of the k-th pixel at hand; how many points and groups are then.

    have : how many there are. Points go where add_point says; FACE_OUT is one over DEPTH.
    """
    s, codes = work.row, cells.codes
    points, groups = have
    share = 1.0 / n
    begin, end = np.uint64(k * n), np.uint64(k * n + n)
    faces, left, first = 0, n, begin
    while left > 0:
        # The next face, and the middle of what is seen of it.
        f = 0
        while f < faces:
            f += 1
            if codes[f - 1] == s[HIT + first]:
                first += ONE
                f = 0
        code = s[HIT + first]
        codes[faces] = code
        faces += 1
        samples, x, y, nearness = 0, 0.0, 0.0, 0.0
        for ray in range(first, end):
            if s[HIT + ray] == code:
                samples += 1
                x += s[X + ray]
                y += s[Y + ray]
                nearness += s[FACE_OUT + ray]
        left -= samples
        many = 1.0 * samples
        x, y, depth = x / many, y / many, many / nearness
        g, groups = group_of(cells, groups, code)
        change = 0.0
        if code >= 0.0 and many > 1.0:
            change, _ = changes(code, x, y, depth, csg, camera, edges, plan)
        if change <= STEADY:
            points = add_point(s, cells, points, (x, y, depth), (k, g), many * share)
            continue
        if change <= 4.0 * STEADY:
            # In a quarter the shade changes half as much, and a line along which it bends passes through two of four.
            points = add_quarters(s, cells, (k, g), n, points, code)
            continue
        for i in range(n):
            j = np.uint64(k * n + i)
            if s[HIT + j] == code:
                points = add_point(s, cells, points, (s[X + j], s[Y + j], s[DEPTH + j]), (k, g), share)
    return points, groups


@kernel
def sample_tile(work, cells, sampled, products, tile, csg, camera, edges, materials, plan, target):
    """The means of all samples in the pixels of a tile that take them, into the target."""
    s, n = work.row, plan.samples
    top, _, left, right = tile
    columns = right - left
    at_once, square = STRIDE // (n * n), n * n
    for begin in range(0, sampled, at_once):
        count = min(sampled - begin, at_once)
        for k in range(count):
            place = cells.sampled[begin + k]
            x, y = plan.xs[left + place % columns], plan.ys[top + place // columns]
            for i in range(square):
                j = np.uint64(k * square + i)
                s[X + j], s[Y + j] = x + cells.aside[i], y + cells.down[i]
        hit_pixels(work, (cells.sampled, begin, count), square, products, tile, csg, camera, plan)
        for ray in range(ZERO, np.uint64(count * square)):
            s[FACE_OUT + ray] = 1.0 / s[DEPTH + ray]
        have = np.int64(0), np.int64(0)
        for k in range(count):
            have = gather_faces(work, cells, k, square, have, csg, camera, edges, plan)
        points, groups = have
        light_points(work, cells, points, groups, count, csg, materials, plan)
        for k in range(count):
            place = cells.sampled[begin + k]
            for channel in range(3):
                target.image[top + place // columns, left + place % columns, channel] = byte(work.colours[channel, k])


@njit(error_model='numpy', nogil=True)
def smooth_tiles(share, csg, camera, edges, materials, plan, target, work):
    """Anti-alias every share[1]-th tile from share[0] on, of a target that is rendered with its radiance."""
    height, width = target.depth.shape
    room = plan.size * plan.size
    cells = Cells(
        np.empty(room, np.uint8),
        np.empty(3 * plan.size, np.uint8),
        np.empty(room),
        np.empty(room, np.int64),
        np.empty(room, np.int64),
        np.empty(STRIDE, np.int64),
        np.empty(STRIDE, np.int64),
        np.empty(STRIDE, np.int64),
        np.empty(STRIDE),
        np.empty(STRIDE),
        np.empty(STRIDE, np.int64),
        np.empty(STRIDE),
        np.empty(STRIDE),
        np.empty(STRIDE),
        np.empty(STRIDE, np.int64),
        np.empty((4, 4)),
    )
    n = plan.samples
    for i in range(n * n):
        cells.aside[i], cells.down[i] = plan.places[i, 0] * plan.dx, plan.places[i, 1] * plan.dy
        cells.quarter[i] = (1 if 2 * (i % n) >= n else 0) + (2 if 2 * (i // n) >= n else 0)
    across = (width + plan.size - 1) // plan.size
    down = (height + plan.size - 1) // plan.size
    for number in range(share[0], across * down, share[1]):
        if work.counts[3] != 0:
            return
        left, top = (number % across) * plan.size, (number // across) * plan.size
        tile = (top, min(top + plan.size, height), left, min(left + plan.size, width))
        products = products_in_tile(work.products, tile, camera, plan)
        if products == 0 and camera.listed.shape[0] == 0:
            continue
        flag_tile(tile, csg, edges, plan, target, cells)
        doubtful, sampled = np.int64(0), np.int64(0)
        for place in range((tile[1] - top) * (tile[3] - left)):
            if cells.flag[place] == DOUBT:
                cells.doubtful[doubtful] = place
                doubtful += 1
            elif cells.flag[place] == ALL:
                cells.sampled[sampled] = place
                sampled += 1
        most = doubtful, sampled
        sampled = ask_corners(work, cells, most, products, tile, csg, camera, edges, materials, plan, target)
        sample_tile(work, cells, sampled, products, tile, csg, camera, edges, materials, plan, target)
