"""Compiled search for the pixels in which samples may differ: all others are what their centre is.

Where two faces meet in a pixel, a line passes through it that has the centre of one of the four pixels beside it, or
its own, on its other side. So samples may differ where

* the pixel beside, above or below shows another face; or
* an edge of a primitive passes among the samples, no deeper than what is seen; or
* the colour is bent, or a highlight may be narrower than a pixel.

Of the first two kinds the rays through four places near the corners are asked what they see. When it is what the centre
sees, a face between them can only be a tip or thin: an edge ends in the pixel, or passes beside another. So where one
passes, and where the shade changes much across the pixel, it takes all samples too.

The mean of n x n samples is f + (f_xx + f_yy) (1 - 1 / n^2) / 24 to second order of the colour f in a pixel. What is
left out are bumps and folds where surfaces intersect that are smaller than a pixel.
"""

from __future__ import annotations

import math

import numpy as np

from ..programs.program import BLOCK, CONE, CYLINDER, SPHERE
from ..settings import HIDDEN_GAP_PIXELS, MOST_CURVED
from .rows import kernel
from .tree import LEAF_STEP

INF = math.inf
ONE, THREE = np.uint64(1), np.uint64(3)
# What is known of a pixel: its centre stands for all samples; corners are to be asked; it takes all samples.
SAME, DOUBT, ALL = range(3)
# Several of the pixels beside it show another face, or only one beside a corner does.
SEVERAL, SLANTED = 3, 4
# Bends of less than this many times MOST_CURVED move the mean of a pixel by less than it: a kink in the middle by an
# eighth of the change of slope, a curve by a twenty-fourth of its second derivatives. A shade that changes by less than
# twice as much in all is taken in the middle of what is seen of its face: most of it does not bend.
BENT, STEADY = 8.0 * MOST_CURVED, 16.0 * MOST_CURVED


@kernel
def corner(samples, bent):
    """How far from the centre of a pixel its corners are asked, along each axis, pixels.

    At the outermost samples, see :func:`..raw_view.box_samples`; of what may be round close to the border, between
    which a circle of a few pixels rises by less than it takes to reach the samples.
    """
    outermost = 0.5 - 0.5 / (samples * samples)
    return max(outermost, 0.5 - 0.125 / samples) if bent else outermost


@kernel
def flag_tile(tile, csg, edges, plan, target, cells):
    """What is known of the pixels of a tile (top, bottom, left, right), into cells.flag.

    edges : Differences; cells : Cells
    """
    top, bottom, left, right = tile
    for row in range(top, bottom):
        flag_row(row, tile, edges, target, cells)
    for leaf in range(csg.kind.shape[0]):
        bounds = edges.bounds[leaf]
        if bounds[0] < right and bounds[1] > left - 1.0 and bounds[2] < bottom and bounds[3] > top - 1.0:
            for i in range(edges.start[leaf], edges.start[leaf + 1]):
                follow_line(edges.lines[i], edges.error[leaf], edges.products[leaf], tile, plan, target, cells)


@kernel
def flag_row(row, tile, edges, target, cells):
    """Flag the pixels of one row of a tile by what is seen there and beside it."""
    top, _, left, right = tile
    height, width = target.depth.shape
    primitive, face, flag, bent = target.primitive, target.face, cells.flag, cells.bent
    here, above, below = np.uint64(row), np.uint64(max(row - 1, 0)), np.uint64(min(row + 1, height - 1))
    # At the border of the image there is nothing to compare with.
    first, end = np.uint64(max(left, 1)), np.uint64(min(right, width - 1))
    place = np.uint64((row - top) * (right - left))
    from_left = np.uint64(left)
    for k in range(place, place + np.uint64(right - left)):
        flag[k] = DOUBT
        cells.near[k] = 0.0
    for k in range(first, end):
        p, f = primitive[here, k], face[here, k]
        others = 1 if ((primitive[here, k - ONE] ^ p) | (face[here, k - ONE] ^ f)) != 0 else 0
        others += 1 if ((primitive[here, k + ONE] ^ p) | (face[here, k + ONE] ^ f)) != 0 else 0
        others += 1 if ((primitive[above, k] ^ p) | (face[above, k] ^ f)) != 0 else 0
        others += 1 if ((primitive[below, k] ^ p) | (face[below, k] ^ f)) != 0 else 0
        aside = (primitive[above, k - ONE] ^ p) | (face[above, k - ONE] ^ f)
        aside |= (primitive[above, k + ONE] ^ p) | (face[above, k + ONE] ^ f)
        aside |= (primitive[below, k - ONE] ^ p) | (face[below, k - ONE] ^ f)
        aside |= (primitive[below, k + ONE] ^ p) | (face[below, k + ONE] ^ f)
        alone = SAME if aside == 0 else SLANTED
        flag[place + k - from_left] = alone if others == 0 else DOUBT if others == 1 else SEVERAL
    # Second differences of the three colours, one after another.
    c = target.radiance
    for k in range(THREE * first, THREE * end):
        twice = 2.0 * c[here, k]
        across, down = c[here, k - THREE] + c[here, k + THREE] - twice, c[above, k] + c[below, k] - twice
        bent[k - THREE * from_left] = 1 if abs(across) + abs(down) > BENT else 0
    for k in range(first, end):
        p, j = primitive[here, k], place + k - from_left
        if flag[j] == SEVERAL:
            # Most of these have corners that differ, where those are close to the border.
            flag[j] = ALL if bent_about(primitive, row, np.int64(k), edges) else DOUBT
        if flag[j] != SAME and flag[j] != SLANTED:
            continue
        b = THREE * (k - from_left)
        if p < 0:
            flag[j] = SAME
        elif bent[b] | bent[b + ONE] | bent[b + ONE + ONE]:
            flag[j] = ALL
        elif flag[j] == SLANTED and edges.bent[p]:
            # Where surfaces intersect, what is seen there may have a tip.
            flag[j] = DOUBT
        else:
            narrow = edges.narrow[p]
            flag[j] = DOUBT if narrow < INF and turns(target.normal, row, k) > narrow else SAME


@kernel
def bent_about(primitive, row, column, edges):
    """Whether what is seen in a pixel, or beside it, may end in a curve."""
    height, width = primitive.shape
    for side in range(5):
        r = row + (side == 1) - (side == 2)
        c = column + (side == 3) - (side == 4)
        if 0 <= r < height and 0 <= c < width:
            leaf = primitive[r, c]
            if leaf >= 0 and edges.bent[leaf]:
                return True
    return False


@kernel
def turns(normal, row, column):
    """Square of the most that normals differ from those of the pixels beside, radians."""
    height = normal.shape[0]
    above, below = max(row - 1, 0), min(row + 1, height - 1)
    most = 0.0
    for side in range(2):
        first, last = 0.0, 0.0
        for axis in range(3):
            n = normal[row, column, axis]
            before = normal[row, column - ONE, axis] if side == 0 else normal[above, column, axis]
            behind = normal[row, column + ONE, axis] if side == 0 else normal[below, column, axis]
            first += (before - n) ** 2
            last += (behind - n) ** 2
        most = max(most, first, last)
    return most


@kernel
def follow_line(line, error, products, tile, plan, target, cells):
    """Flag the pixels of a tile among whose samples a line passes, unless something hides it there.

    products : the first of those that the line's leaf is part of, and behind the last; it matters where they are
    """
    top, bottom, left, right = tile
    x0, y0, w0, x1, y1, w1 = line[0], line[1], line[2], line[3], line[4], line[5]
    half = corner(plan.samples, False) + error
    low, high, near, far = min(y0, y1), max(y0, y1), min(x0, x1), max(x0, x1)
    if high < top - half or low > bottom - 1 + half or far < left - half or near > right - 1 + half:
        return
    gap = 1.0 + HIDDEN_GAP_PIXELS * plan.dx
    dx, dy = x1 - x0, y1 - y0
    for row in range(max(top, math.ceil(low - half)), min(bottom, math.floor(high + half) + 1)):
        # The stretch of the line within the row.
        a, b = (row - half - y0) / dy if dy != 0.0 else 0.0, (row + half - y0) / dy if dy != 0.0 else 1.0
        a, b = max(0.0, min(1.0, a)), max(0.0, min(1.0, b))
        xa, xb = x0 + a * dx, x0 + b * dx
        closest = max(w0 + a * (w1 - w0), w0 + b * (w1 - w0))
        begin = max(left, math.ceil(min(xa, xb) - half))
        end = min(right, math.floor(max(xa, xb) + half) + 1)
        if products[0] < products[1]:
            low_column, high_column = right, left
            for q in range(products[0], products[1]):
                low_column, high_column = min(low_column, plan.span[q, row, 0]), max(high_column, plan.span[q, row, 1])
            begin, end = max(begin, low_column), min(end, high_column + 1)
        for column in range(begin, end):
            # Depth is NaN in the background.
            if closest * target.depth[row, column] * gap < 1.0:
                continue
            place = (row - top) * (right - left) + column - left
            cells.flag[place] = max(cells.flag[place], DOUBT)
            cells.near[place] = max(cells.near[place], closest)


@kernel
def changes(code, x, y, z, csg, camera, edges, plan):
    """How much the shade of a face changes across a pixel at most, and its depth, of 1.

    The face of the hit ``code`` is seen at depth z along the ray (x, y, 1). While the place on the surface moves by a
    pixel, directions to the lights and to the camera turn, and so does the normal: by no more than the curvature of the
    surface, which is at most that of the quadric's matrix over the length of its gradient.
    """
    leaf = int(code / LEAF_STEP)
    face = int(code - leaf * LEAF_STEP) // 2
    kind, m = csg.kind[leaf], camera.local
    gx, gy, gz, bend = 0.0, 0.0, 0.0, 0.0
    if kind == SPHERE or (kind == CYLINDER and face == 2) or (kind == CONE and face == 1):
        gx = z * (m[leaf, 0, 0] * x + m[leaf, 0, 1] * y + m[leaf, 0, 2]) + m[leaf, 0, 3]
        gy = z * (m[leaf, 1, 0] * x + m[leaf, 1, 1] * y + m[leaf, 1, 2]) + m[leaf, 1, 3]
        gz = z * (m[leaf, 2, 0] * x + m[leaf, 2, 1] * y + m[leaf, 2, 2]) + m[leaf, 2, 3]
        gz = 0.0 if kind == CYLINDER else -gz if kind == CONE else gz
        bend = edges.bend[leaf]
    elif kind == BLOCK and face < 2:
        gx = 1.0
    elif kind == BLOCK and face < 4:
        gy = 1.0
    else:
        gz = 1.0
    nx = m[leaf, 0, 0] * gx + m[leaf, 1, 0] * gy + m[leaf, 2, 0] * gz
    ny = m[leaf, 0, 1] * gx + m[leaf, 1, 1] * gy + m[leaf, 2, 1] * gz
    nz = m[leaf, 0, 2] * gx + m[leaf, 1, 2] * gy + m[leaf, 2, 2] * gz
    square = nx * nx + ny * ny + nz * nz
    facing, ray = abs(nx * x + ny * y + nz), x * x + y * y + 1.0
    if facing == 0.0:
        return INF, INF
    # Metres on the surface that a pixel covers: depth times its angle, over the cosine between ray and normal.
    moved = z * plan.dx * ray * math.sqrt(square) / facing
    turn, near = moved * bend / math.sqrt(square), INF
    for light in range(edges.lights.shape[0]):
        dx, dy, dz = edges.lights[light, 0] - z * x, edges.lights[light, 1] - z * y, edges.lights[light, 2] - z
        near = min(near, dx * dx + dy * dy + dz * dz)
    light = moved / math.sqrt(near)
    # The mirrored ray turns with that to the camera, and twice with the normal.
    matt, shine = edges.matt[leaf] * (turn + light), edges.shine[leaf] * (2.0 * turn + plan.dx + light)
    slope = moved / z * math.sqrt(max(0.0, 1.0 - facing * facing / (square * ray)))
    return matt + shine, slope + 0.1 * plan.dx
