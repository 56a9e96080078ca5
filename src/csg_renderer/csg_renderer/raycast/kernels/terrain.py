"""Compiled terrain: rays walked cell by cell over height grids (see terrain.py)."""

from __future__ import annotations

import math

import numpy as np

from ...scene.settings import CELL_SLACK
from ..settings import HEIGHT_SLACK
from .records import Ray
from .rows import DEPTH, HIT, NX, PX, STRIDE, VX, X, kernel
from .shade import light_run
from .tree import LEAF_STEP, NOTHING

INF = math.inf
ZERO, ONE = np.uint64(0), np.uint64(STRIDE)


@kernel
def crossing_in_cell(corners, bilinear, ray, length):
    """Smallest s in 0..length where a ray meets the terrain of a cell, else inf.

    corners : heights at (0, 0), (1, 0), (0, 1) and (1, 1) of the cell, metres; ray : a Ray of the cell's frame, whose
    x and y are fractions of the cell
    """
    a, b, c, d = corners
    fx, fy, z, u, v, w = ray
    start = z - a - (b - a) * fx - (c - a) * fy
    if bilinear:
        k = a - b - c + d
        start -= k * fx * fy
        square = -k * u * v
        linear = w - (b - a) * u - (c - a) * v - k * (fx * v + fy * u)
        stop = start + length * (linear + length * square)
        # Both ends on one side: the ray may only dip through in between, where the slope changes its sign.
        if start * stop > 0.0 and (square == 0.0 or linear * (linear + 2.0 * square * length) >= 0.0):
            return INF
        root = linear * linear - 4.0 * square * start
        if root < 0.0:
            return INF
        q = -0.5 * (linear + math.copysign(math.sqrt(root), linear))
        first = start / q if q != 0.0 else 0.0
        second = q / square if square != 0.0 else INF
        if second < first:
            first, second = second, first
        slack = CELL_SLACK * (1.0 + length)
        if -slack <= first <= length + slack:
            return first
        return second if -slack <= second <= length + slack else INF
    # Two planes that meet on the diagonal: the height above the terrain is linear up to it and linear beyond it.
    k = a - b - c + d
    above = fx + fy > 1.0
    begin, value = 0.0, start - (k * (fx + fy - 1.0) if above else 0.0)
    rate = u + v
    middle = (1.0 - fx - fy) / rate if rate != 0.0 else -1.0
    for step in range(2):
        end = middle if step == 0 and 0.0 < middle < length else length
        x, y = fx + end * u, fy + end * v
        following = z + end * w - a - (b - a) * x - (c - a) * y
        following -= k * (x + y - 1.0) if x + y > 1.0 else 0.0
        if value == 0.0:
            return begin
        if (value < 0.0) != (following < 0.0) or following == 0.0:
            return begin + (end - begin) * value / (value - following)
        if end == length:
            return INF
        begin, value = end, following
    return INF


@kernel
def walk(terrains, g, ray, nearest, farthest):
    """Where a Ray of the grid frame first meets the terrain between nearest and farthest, inf if nowhere."""
    ox, oy, oz, u, v, w = ray
    rows, columns, base = terrains.rows[g], terrains.columns[g], terrains.start[g]
    enter, leave = nearest, farthest
    for axis in range(3):
        o = ox if axis == 0 else oy if axis == 1 else oz
        d = u if axis == 0 else v if axis == 1 else w
        low = 0.0 if axis < 2 else terrains.low[g]
        high = columns - 1.0 if axis == 0 else rows - 1.0 if axis == 1 else terrains.high[g]
        slack = HEIGHT_SLACK * (1.0 + abs(low) + abs(high)) if axis == 2 else 0.0
        if d == 0.0:
            if o < low - slack or o > high + slack:
                return INF
            continue
        p, q = (low - slack - o) / d, (high + slack - o) / d
        enter, leave = max(enter, min(p, q)), min(leave, max(p, q))
    if not enter <= leave:
        return INF
    i = int(min(max(math.floor(ox + enter * u), 0.0), columns - 2.0))
    j = int(min(max(math.floor(oy + enter * v), 0.0), rows - 2.0))
    t = enter
    while True:
        # Where the ray leaves this cell, through a column line or a row line.
        to_x = ((i + 1 if u > 0.0 else i) - ox) / u if u != 0.0 else INF
        to_y = ((j + 1 if v > 0.0 else j) - oy) / v if v != 0.0 else INF
        stop = min(to_x, to_y, leave)
        if stop >= t:
            k = base + j * columns + i
            if terrains.there[k]:
                corners = (
                    terrains.heights[k],
                    terrains.heights[k + 1],
                    terrains.heights[k + columns],
                    terrains.heights[k + columns + 1],
                )
                within = Ray(ox + t * u - i, oy + t * v - j, oz + t * w, u, v, w)
                found = crossing_in_cell(corners, terrains.bilinear[g], within, stop - t)
                if found < INF:
                    return t + found
            t = stop
        if stop >= leave:
            return INF
        if to_x <= to_y:
            i += 1 if u > 0.0 else -1
        else:
            j += 1 if v > 0.0 else -1
        if i < 0 or j < 0 or i > columns - 2 or j > rows - 2:
            return INF


@kernel
def terrain_ray(terrains, g, m, ray, nearest, farthest):
    """As walk, for a Ray of the frame that m (3, 4) takes to the grid frame."""
    ox, oy, oz, dx, dy, dz = ray
    local = Ray(
        m[0, 0] * ox + m[0, 1] * oy + m[0, 2] * oz + m[0, 3],
        m[1, 0] * ox + m[1, 1] * oy + m[1, 2] * oz + m[1, 3],
        m[2, 0] * ox + m[2, 1] * oy + m[2, 2] * oz + m[2, 3],
        m[0, 0] * dx + (m[0, 1] * dy + m[0, 2] * dz),
        m[1, 0] * dx + (m[1, 1] * dy + m[1, 2] * dz),
        m[2, 0] * dx + (m[2, 1] * dy + m[2, 2] * dz),
    )
    return walk(terrains, g, local, nearest, farthest)


@kernel
def terrain_row(s, end, y, terrains, local, tolerance):
    """Merge the terrains into DEPTH and HIT of a row of camera rays."""
    for g in range(terrains.leaf.shape[0]):
        leaf = terrains.leaf[g]
        code = leaf * LEAF_STEP
        for j in range(ZERO, end):
            depth, ray = s[DEPTH + j], Ray(0.0, 0.0, 0.0, s[X + j], y, 1.0)
            t = terrain_ray(terrains, g, local[leaf], ray, tolerance, depth + tolerance)
            if (
                t < depth - tolerance
                or (t <= depth + tolerance and code < s[HIT + j])
                or (t < INF and s[HIT + j] == NOTHING)
            ):
                s[DEPTH + j], s[HIT + j] = t, code


@kernel
def grid_of(terrains, leaf):
    """Which of the terrains a leaf is."""
    g = 0
    while terrains.leaf[g] != leaf:
        g += 1
    return g


@kernel
def tint_at(terrains, g, height):
    """Red, green, blue of a terrain that is coloured by height, at a height of its own frame (scene.terrain.tint)."""
    tints = terrains.tints
    first, last = terrains.tint_start[g], terrains.tint_start[g + 1]
    k = first
    while k < last and tints[k, 0] <= height:
        k += 1
    if k == first:
        return tints[first, 1], tints[first, 2], tints[first, 3]
    if k == last:
        return tints[last - 1, 1], tints[last - 1, 2], tints[last - 1, 3]
    above, run = height - tints[k - 1, 0], tints[k, 0] - tints[k - 1, 0]
    return (
        (tints[k, 1] - tints[k - 1, 1]) / run * above + tints[k - 1, 1],
        (tints[k, 2] - tints[k - 1, 2]) / run * above + tints[k - 1, 2],
        (tints[k, 3] - tints[k - 1, 3]) / run * above + tints[k - 1, 3],
    )


@kernel
def face_colour(terrains, materials, inverse, leaf, face, x, y, z):
    """Red, green, blue of a place (scene frame) on a face; terrains may be coloured by height."""
    g = 0
    while g < terrains.leaf.shape[0] and terrains.leaf[g] != leaf:
        g += 1
    if g < terrains.leaf.shape[0] and terrains.tint_start[g] < terrains.tint_start[g + 1]:
        m = inverse[leaf]
        return tint_at(terrains, g, m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3])
    colours = materials.colours
    return colours[leaf, face, 0], colours[leaf, face, 1], colours[leaf, face, 2]


@kernel
def light_terrain(s, j0, j1, leaf, materials, terrains, inverse):
    """As light_run, for a run of pixels that show a terrain."""
    for k in range(j0, j1):
        colour = face_colour(terrains, materials, inverse, leaf, 0, s[PX + k], s[PX + ONE + k], s[PX + ONE + ONE + k])
        light_run(s, k, k + np.uint64(1), leaf, colour, materials)


@kernel
def terrain_normals(s, j0, j1, leaf, terrains, inverse):
    """As normals_run, for a run of pixels that show a terrain."""
    m = inverse[leaf]
    g = grid_of(terrains, leaf)
    columns, rows = terrains.columns[g], terrains.rows[g]
    for k in range(j0, j1):
        px, py, pz = s[PX + k], s[PX + ONE + k], s[PX + ONE + ONE + k]
        x = m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3]
        y = m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3]
        i, j = int(min(max(math.floor(x), 0.0), columns - 2.0)), int(min(max(math.floor(y), 0.0), rows - 2.0))
        fx, fy = x - i, y - j
        at = terrains.start[g] + j * columns + i
        a, b = terrains.heights[at], terrains.heights[at + 1]
        c, d = terrains.heights[at + columns], terrains.heights[at + columns + 1]
        if terrains.bilinear[g]:
            sx, sy = (b - a) + (a - b - c + d) * fy, (c - a) + (a - b - c + d) * fx
        elif fx + fy <= 1.0:
            sx, sy = b - a, c - a
        else:
            sx, sy = d - c, d - b
        nx = -m[0, 0] * sx - m[1, 0] * sy + m[2, 0]
        ny = -m[0, 1] * sx - m[1, 1] * sy + m[2, 1]
        nz = -m[0, 2] * sx - m[1, 2] * sy + m[2, 2]
        scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
        if nx * s[VX + k] + ny * s[VX + ONE + k] + nz * s[VX + ONE + ONE + k] > 0.0:
            scale = -scale
        s[NX + k], s[NX + ONE + k], s[NX + ONE + ONE + k] = scale * nx, scale * ny, scale * nz
