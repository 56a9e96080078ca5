"""Compiled ray-primitive intersections: one ray at a time, and whole rows of pixels in loops that vectorise.

The arithmetic is that of reference.py, operation by operation, so that both engines give the same bits. It needs no
fast-math: minima and choices are written as selections, which the compiler turns into vector instructions, and
error_model='numpy' takes the zero-division branches away.

A row lives in one scratch array ``s`` at the fixed offsets below. One array instead of many lets the compiler see that
its parts do not overlap; with separate arrays it would give up vectorising.
"""

from __future__ import annotations

import math

import numpy as np

from msgs_py.numeric.compiled import njit

from ..programs.program import BLOCK, CONE, CYLINDER, SPHERE
from ..settings import FAR, LONGEST_ROW, TINY

INF = math.inf

# _nrt=False: no reference counting. These functions allocate nothing, and are called a million times an image with
# tuples of arrays, whose counts would otherwise be raised and lowered at every call: four times the whole run time.
kernel = njit(error_model='numpy', nogil=True, _nrt=False)
# Written into its callers, so that their loops vectorise.
part = njit(inline='always')

# Longest row, pixels, and the parts of the scratch array: ray x; near and far boundary of the leaf at hand with their
# faces; entry, end and code of the product at hand; depth and code of the nearest hit so far.
STRIDE = LONGEST_ROW
# Unsigned: for signed indices numba adds the handling of negative ones, and the loops would not vectorise.
X, LEAF_IN, LEAF_OUT, FACE_IN, FACE_OUT, ENTRY, END, CODE, DEPTH, HIT = (np.uint64(STRIDE * k) for k in range(10))
# Of the visible points: unit viewing ray, place, unit normal on the viewer's side, colour, two rows for the highlight.
VX, VY, VZ, PX, PY, PZ, NX, NY, NZ, RED, GREEN, BLUE, SPECULAR_BASE, SPECULAR, DIFFUSE = (
    np.uint64(STRIDE * k) for k in range(10, 25)
)
# Ray y, where rays are scattered over the image.
Y = np.uint64(STRIDE * 25)
SUBTRACTED = np.uint64(STRIDE * 26)
SUBTRACTED_PARTS = np.uint64(3 * STRIDE)


@part
def block_span(ox, oy, oz, dx, dy, dz):
    """near, far, face_in, face_out of a ray with the unit cube."""
    i = 1.0 / dx
    a, b = (0.0 - ox) * i, (1.0 - ox) * i
    up = dx > 0.0
    near = a if up else b
    far = b if up else a
    face_in = 0.0 if up else 1.0
    face_out = 1.0 if up else 0.0

    i = 1.0 / dy
    a, b = (0.0 - oy) * i, (1.0 - oy) * i
    up = dy > 0.0
    n, f = (a if up else b), (b if up else a)
    later, sooner = n > near, f < far
    face_in = (2.0 if up else 3.0) if later else face_in
    face_out = (3.0 if up else 2.0) if sooner else face_out
    near = n if later else near
    far = f if sooner else far

    i = 1.0 / dz
    a, b = (0.0 - oz) * i, (1.0 - oz) * i
    up = dz > 0.0
    n, f = (a if up else b), (b if up else a)
    later, sooner = n > near, f < far
    face_in = (4.0 if up else 5.0) if later else face_in
    face_out = (5.0 if up else 4.0) if sooner else face_out
    near = n if later else near
    far = f if sooner else far
    return near, far, face_in, face_out


@part
def between(a, b, c):
    """Where a t^2 + 2 b t + c <= 0, a >= 0; always or never when a is 0."""
    along = a < TINY
    safe = 1.0 if along else a
    discriminant = b * b - safe * c
    real = discriminant > 0.0
    root = math.sqrt(discriminant if real else 1.0)
    q = -(b + math.copysign(root, b))
    q = TINY if q == 0.0 else q
    first, second = q / safe, c / q
    low = first if first < second else second
    high = second if first < second else first
    inside = c < 0.0
    near = low if real else INF
    far = high if real else -INF
    near = (-FAR if inside else INF) if along else near
    far = (FAR if inside else -INF) if along else far
    return near, far


@part
def sphere_span(ox, oy, oz, dx, dy, dz):
    """near, far of a ray with the unit sphere."""
    a = dx * dx + dy * dy + dz * dz
    b = ox * dx + oy * dy + oz * dz
    c = ox * ox + oy * oy + oz * oz - 1.0
    return between(a, b, c)


@part
def cylinder_span(ox, oy, oz, dx, dy, dz):
    """near, far, face_in, face_out of a ray with the unit cylinder."""
    i = 1.0 / dz
    a, b = (0.0 - oz) * i, (1.0 - oz) * i
    up = dz > 0.0
    near = a if up else b
    far = b if up else a
    face_in = 0.0 if up else 1.0
    face_out = 1.0 if up else 0.0
    n, f = between(dx * dx + dy * dy, ox * dx + oy * dy, ox * ox + oy * oy - 1.0)
    later, sooner = n > near, f < far
    face_in = 2.0 if later else face_in
    face_out = 2.0 if sooner else face_out
    near = n if later else near
    far = f if sooner else far
    return near, far, face_in, face_out


@part
def cone_span(ox, oy, oz, dx, dy, dz):
    """near, far, face_in, face_out of a ray with the unit cone (reference._cone explains the cases)."""
    a = dx * dx + dy * dy - dz * dz
    b = ox * dx + oy * dy - oz * dz
    c = ox * ox + oy * oy - oz * oz
    discriminant = b * b - a * c
    real = discriminant > 0.0
    root = math.sqrt(discriminant if real else 1.0)
    q = -(b + math.copysign(root, b))
    q = TINY if q == 0.0 else q
    safe = TINY if abs(a) < TINY else a
    first, second = q / safe, c / q
    low = first if first < second else second
    high = second if first < second else first
    i = 1.0 / dz
    base, apex = (1.0 - oz) * i, (0.0 - oz) * i
    up = dz > 0.0
    steep = a < 0.0
    near = (high if up else -FAR) if steep else low
    far = (FAR if up else low) if steep else high
    through = steep and not real
    near = apex if (through and up) else near
    far = apex if (through and not up) else far
    face_in, face_out = 1.0, 1.0
    n = apex if up else base
    f = base if up else apex
    later, sooner = n > near, f < far
    face_in = (1.0 if up else 0.0) if later else face_in
    face_out = (0.0 if up else 1.0) if sooner else face_out
    near = n if later else near
    far = f if sooner else far
    missed = not real and not steep
    near = INF if missed else near
    far = -INF if missed else far
    return near, far, face_in, face_out


@part
def plane_span(oz, dz):
    """near, far of a ray with the half-space z <= 0."""
    t = -oz / dz
    falling = dz < 0.0
    return (t if falling else -FAR), (FAR if falling else t)


@kernel
def leaf_span(kind, ox, oy, oz, dx, dy, dz):
    """near, far, face_in, face_out of one ray with one primitive in its unit frame."""
    if kind == BLOCK:
        return block_span(ox, oy, oz, dx, dy, dz)
    if kind == CYLINDER:
        return cylinder_span(ox, oy, oz, dx, dy, dz)
    if kind == CONE:
        return cone_span(ox, oy, oz, dx, dy, dz)
    if kind == SPHERE:
        near, far = sphere_span(ox, oy, oz, dx, dy, dz)
        return near, far, 0.0, 0.0
    near, far = plane_span(oz, dz)
    return near, far, 0.0, 0.0


@part
def ray_y(s, j, y):
    """The y of ray j of a row, which all of it has; of rays that are scattered (None) each has its own."""
    return s[Y + j] if y is None else y


@kernel
def leaf_row(s, j0, j1, kind, leaf, matrices, origins, limits, y):
    """Boundaries of a leaf for the rays (s[X + j], y, 1) of the camera, j0 <= j < j1.

    They go into LEAF_IN, LEAF_OUT, FACE_IN and FACE_OUT. j0, j1 : uint64; matrices : (n, 3, 4) camera to unit frame;
    origins, limits : (n, 3) local origins, and below what a direction component is zero; y : see ray_y
    """
    m, o, limit = matrices[leaf], origins[leaf], limits[leaf]
    ax, ay, az = m[0, 0], m[1, 0], m[2, 0]
    bx, by, bz = m[0, 1], m[1, 1], m[2, 1]
    cx, cy, cz = m[0, 2], m[1, 2], m[2, 2]
    ox, oy, oz = o[0], o[1], o[2]
    lx, ly, lz = limit[0], limit[1], limit[2]
    if kind == BLOCK:
        for j in range(j0, j1):
            x, v = s[X + j], ray_y(s, j, y)
            dx, dy, dz = ax * x + (bx * v + cx), ay * x + (by * v + cy), az * x + (bz * v + cz)
            dx = TINY if abs(dx) < lx else dx
            dy = TINY if abs(dy) < ly else dy
            dz = TINY if abs(dz) < lz else dz
            near, far, face_in, face_out = block_span(ox, oy, oz, dx, dy, dz)
            s[LEAF_IN + j], s[LEAF_OUT + j], s[FACE_IN + j], s[FACE_OUT + j] = near, far, face_in, face_out
    elif kind == CYLINDER:
        for j in range(j0, j1):
            x, v = s[X + j], ray_y(s, j, y)
            dx, dy, dz = ax * x + (bx * v + cx), ay * x + (by * v + cy), az * x + (bz * v + cz)
            dx = TINY if abs(dx) < lx else dx
            dy = TINY if abs(dy) < ly else dy
            dz = TINY if abs(dz) < lz else dz
            near, far, face_in, face_out = cylinder_span(ox, oy, oz, dx, dy, dz)
            s[LEAF_IN + j], s[LEAF_OUT + j], s[FACE_IN + j], s[FACE_OUT + j] = near, far, face_in, face_out
    elif kind == SPHERE:
        for j in range(j0, j1):
            x, v = s[X + j], ray_y(s, j, y)
            dx, dy, dz = ax * x + (bx * v + cx), ay * x + (by * v + cy), az * x + (bz * v + cz)
            near, far = sphere_span(ox, oy, oz, dx, dy, dz)
            s[LEAF_IN + j], s[LEAF_OUT + j], s[FACE_IN + j], s[FACE_OUT + j] = near, far, 0.0, 0.0
    elif kind == CONE:
        for j in range(j0, j1):
            x, v = s[X + j], ray_y(s, j, y)
            dx, dy, dz = ax * x + (bx * v + cx), ay * x + (by * v + cy), az * x + (bz * v + cz)
            dx = TINY if abs(dx) < lx else dx
            dy = TINY if abs(dy) < ly else dy
            dz = TINY if abs(dz) < lz else dz
            near, far, face_in, face_out = cone_span(ox, oy, oz, dx, dy, dz)
            s[LEAF_IN + j], s[LEAF_OUT + j], s[FACE_IN + j], s[FACE_OUT + j] = near, far, face_in, face_out
    else:
        for j in range(j0, j1):
            dz = az * s[X + j] + (bz * ray_y(s, j, y) + cz)
            dz = TINY if abs(dz) < lz else dz
            near, far = plane_span(oz, dz)
            s[LEAF_IN + j], s[LEAF_OUT + j], s[FACE_IN + j], s[FACE_OUT + j] = near, far, 0.0, 0.0
