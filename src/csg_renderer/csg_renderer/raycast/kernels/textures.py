"""Compiled look-up of pictures: on surfaces under the footprint of a pixel, and around the scene.

A pixel's footprint on a slanted surface is long. It is looked up at a few places along its length, in the picture
reduced to about its width (mip map, Williams 1983), so that what is far or slanted neither flickers nor blurs.
"""

from __future__ import annotations

import math

import numpy as np

from ..programs.surface_data import CYLINDRICAL, NO_PICTURE, PLANAR, SIDES
from ..settings import MOST_PROBES
from .rows import kernel

TURN = 2.0 * math.pi


@kernel
def bilinear(maps, picture, level, u, v):
    """Red, green, blue of a level of a picture at u to the right and v up, 0..1, between the middles of its pixels."""
    at = maps.level_start[picture] + level
    columns, rows, start = maps.columns[at], maps.rows[at], maps.texel_start[at]
    x, y = u * columns - 0.5, (1.0 - v) * rows - 0.5
    left, top = math.floor(x), math.floor(y)
    fx, fy = x - left, y - top
    i, j = int(left), int(top)
    if maps.clamped[picture]:
        i0, i1 = min(max(i, 0), columns - 1), min(max(i + 1, 0), columns - 1)
    else:
        i0, i1 = i % columns, (i + 1) % columns
    if maps.clamped[picture] or picture == maps.environment:
        j0, j1 = min(max(j, 0), rows - 1), min(max(j + 1, 0), rows - 1)
    else:
        j0, j1 = j % rows, (j + 1) % rows
    a, b = maps.texels[start + j0 * columns + i0], maps.texels[start + j0 * columns + i1]
    c, d = maps.texels[start + j1 * columns + i0], maps.texels[start + j1 * columns + i1]
    wa, wb, wc, wd = (1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy
    return (
        wa * a[0] + wb * b[0] + wc * c[0] + wd * d[0],
        wa * a[1] + wb * b[1] + wc * c[1] + wd * d[1],
        wa * a[2] + wb * b[2] + wc * c[2] + wd * d[2],
    )


@kernel
def filtered(maps, picture, width, u, v):
    """Red, green, blue of a picture under a spot of ``width`` of its pixels, between two of its levels."""
    last = maps.level_start[picture + 1] - maps.level_start[picture] - 1
    level = min(np.log2(width), float(last)) if width > 1.0 else 0.0
    whole = int(level)
    part = level - whole
    red, green, blue = bilinear(maps, picture, whole, u, v)
    if part > 0.0:
        r, g, b = bilinear(maps, picture, whole + 1, u, v)
        red, green, blue = red + part * (r - red), green + part * (g - green), blue + part * (b - blue)
    return red, green, blue


@kernel
def side_of(mapping, gx, gy, gz):
    """Which side of a box a normal looks to: 0..2 along +x, +y, +z, 3..5 against; of a plane always +z."""
    ax, ay, az = abs(gx), abs(gy), abs(gz)
    if mapping == PLANAR or (az >= ax and az >= ay):
        return 2 if gz >= 0.0 or mapping == PLANAR else 5
    if ax >= ay:
        return 0 if gx >= 0.0 else 3
    return 1 if gy >= 0.0 else 4


@kernel
def backwards(side):
    """Whether the axis that is across a side of a box runs to the left there."""
    return side % 2 == 1


@kernel
def across_of(side, x, y, z):
    """Of a vector the part to the right on a side of a box, and the part up."""
    along = side % 3
    right = y if along == 0 else x
    up = y if along == 2 else z
    back = backwards(side)
    return (-right if back else right), up


@kernel
def sizes_of(maps, leaf, mapping, side):
    """By how much u and v grow by 1 to the right and up, metres."""
    size = maps.size[leaf]
    if mapping != SIDES:
        return size[0], size[1]
    along = side % 3
    return abs(size[1] if along == 0 else size[0]), abs(size[1] if along == 2 else size[2])


@kernel
def texture_colour(maps, leaf, px, py, pz, nx, ny, nz, vx, vy, vz, width):
    """The factors of red, green and blue at a place of a leaf, all in the scene frame; 1 without a texture.

    n : unit normal. v : unit viewing ray. width : of the pixel there, across the ray, metres.
    """
    picture = maps.picture[leaf]
    if picture == NO_PICTURE:
        return 1.0, 1.0, 1.0
    m, mapping = maps.to_texture[leaf], maps.mapping[leaf]
    x = m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3]
    y = m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3]
    z = m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3]
    g = maps.normal_to_texture[leaf]
    side = side_of(
        mapping,
        g[0, 0] * nx + g[0, 1] * ny + g[0, 2] * nz,
        g[1, 0] * nx + g[1, 1] * ny + g[1, 2] * nz,
        g[2, 0] * nx + g[2, 1] * ny + g[2, 2] * nz,
    )
    if mapping == CYLINDRICAL and side % 3 == 2:
        return 1.0, 1.0, 1.0
    # The footprint's axes: across the ray, and along it on the surface, where the slant makes it longer.
    ax, ay, az = ny * vz - nz * vy, nz * vx - nx * vz, nx * vy - ny * vx
    long = math.sqrt(ax * ax + ay * ay + az * az)
    if long < 1e-9:
        # Looked at straight: any two directions.
        ax, ay, az = (0.0, nz, -ny) if abs(nx) < 0.6 else (nz, 0.0, -nx)
        long = math.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / long, ay / long, az / long
    bx, by, bz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
    stretch = width / max(abs(nx * vx + ny * vy + nz * vz), 1e-6)
    ax, ay, az, bx, by, bz = ax * width, ay * width, az * width, bx * stretch, by * stretch, bz * stretch
    ax, ay, az = (
        m[0, 0] * ax + m[0, 1] * ay + m[0, 2] * az,
        m[1, 0] * ax + m[1, 1] * ay + m[1, 2] * az,
        m[2, 0] * ax + m[2, 1] * ay + m[2, 2] * az,
    )
    bx, by, bz = (
        m[0, 0] * bx + m[0, 1] * by + m[0, 2] * bz,
        m[1, 0] * bx + m[1, 1] * by + m[1, 2] * bz,
        m[2, 0] * bx + m[2, 1] * by + m[2, 2] * bz,
    )
    if mapping == CYLINDRICAL:
        tall, around = maps.size[leaf, 0], TURN * max(x * x + y * y, 1e-30)
        u, v = math.atan2(y, x) / TURN, z / tall
        au, av = (x * ay - y * ax) / around, az / tall
        bu, bv = (x * by - y * bx) / around, bz / tall
    else:
        wide, tall = sizes_of(maps, leaf, mapping, side)
        if mapping == SIDES:
            # From the lower corner of the box, or, where the picture runs backwards, from the upper one.
            x, y, z = (
                x - min(maps.size[leaf, 0], 0.0),
                y - min(maps.size[leaf, 1], 0.0),
                z - min(maps.size[leaf, 2], 0.0),
            )
        u, v = across_of(side, x, y, z)
        u, v = u / wide, v / tall
        if mapping == SIDES and backwards(side):
            u += 1.0
        au, av = across_of(side, ax, ay, az)
        bu, bv = across_of(side, bx, by, bz)
        au, av, bu, bv = au / wide, av / tall, bu / wide, bv / tall
    picture += side if mapping == SIDES else 0
    at = maps.level_start[picture]
    columns, rows = maps.columns[at], maps.rows[at]
    a = math.sqrt((au * columns) * (au * columns) + (av * rows) * (av * rows))
    b = math.sqrt((bu * columns) * (bu * columns) + (bv * rows) * (bv * rows))
    major, minor = (a, b) if a > b else (b, a)
    du, dv = (au, av) if a > b else (bu, bv)
    probes = int(min(math.ceil(major / max(minor, 1.0)), float(MOST_PROBES)))
    probes = max(probes, 1)
    spot = max(minor, major / probes)
    red, green, blue = 0.0, 0.0, 0.0
    for k in range(probes):
        step = (k + 0.5) / probes - 0.5
        r, g_, b_ = filtered(maps, picture, spot, u + step * du, v + step * dv)
        red, green, blue = red + r, green + g_, blue + b_
    return red / probes, green / probes, blue / probes


@kernel
def surroundings(maps, background, dx, dy, dz, spread):
    """What a ray sees that meets nothing: unit direction, scene frame; ``spread`` is its cone's angle, radians."""
    if maps.environment == NO_PICTURE:
        return background[0], background[1], background[2]
    a = maps.axes
    ahead = a[0, 0] * dx + a[0, 1] * dy + a[0, 2] * dz
    right = a[1, 0] * dx + a[1, 1] * dy + a[1, 2] * dz
    up = a[2, 0] * dx + a[2, 1] * dy + a[2, 2] * dz
    rows = maps.rows[maps.level_start[maps.environment]]
    return filtered(
        maps,
        maps.environment,
        spread * rows / math.pi,
        0.5 + math.atan2(right, ahead) / TURN,
        0.5 + math.asin(min(max(up, -1.0), 1.0)) / math.pi,
    )
