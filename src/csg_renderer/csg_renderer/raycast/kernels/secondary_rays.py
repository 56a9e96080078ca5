"""Compiled ray tracing (thesis 4.2, 4.5): shadow feelers, mirrors and glass, for batches of rays in vectorised loops.

Pending rays wait on a stack with their weight in their pixel, so that nothing has to be unwound; they are taken from it
a batch at a time. A batch lives in one scratch array ``s``, like the rows of rows.py, at the fixed offsets below.
"""

from __future__ import annotations

import math

import numpy as np

from ..program import BLOCK, CONE, CYLINDER, SPHERE, TERRAIN
from ..settings import PARALLEL, TINY
from .records import Ray
from .rows import (
    BLUE,
    FACE_IN,
    FACE_OUT,
    GREEN,
    HIT,
    LEAF_IN,
    LEAF_OUT,
    NX,
    PX,
    RED,
    STRIDE,
    VX,
    block_span,
    cone_span,
    cylinder_span,
    kernel,
    plane_span,
    sphere_span,
)
from .shade import normals_run, power
from .terrain import face_colour, terrain_normals, terrain_ray
from .tree import FACE_STEP, LEAF_STEP, NOTHING, child_list

INF = math.inf
ZERO = np.uint64(0)
ONE = np.uint64(STRIDE)  # from x to y to z of a vector

# The batch uses the row's offsets for what a row has too: LEAF_IN..FACE_OUT, HIT, VX.. (ray), PX.. (place), NX..
# (normal), so that normals_run serves both. Its own: ray that is being cast, one over it, how far it reaches;
# what the ray met; weight, level and pixel; how much light arrives; whether the box of the child at hand
# is met; cosine to the light; and the normals again, because leaf_rays uses PX.. and NX.. for rays in a unit frame;
# the colour of the face.
OX, DX, IX = (np.uint64(STRIDE * k) for k in (25, 28, 31))
REACH, BEST, MET, WEIGHT, LEVEL, PIXEL, LIGHT, INSIDE, FACING = (np.uint64(STRIDE * k) for k in range(34, 43))
NORMAL, TINT = np.uint64(STRIDE * 43), np.uint64(STRIDE * 46)
BATCH_PARTS = 49
# A pending ray: origin, direction, weight, level, pixel.
RAY_PARTS = 9


@kernel
def leaf_rays(s, j0, j1, kind, leaf, inverse):
    """Boundaries of a leaf for rays OX, DX of the scene frame, j0 <= j < j1, into LEAF_IN .. FACE_OUT."""
    m00, m01, m02, m03 = inverse[leaf, 0, 0], inverse[leaf, 0, 1], inverse[leaf, 0, 2], inverse[leaf, 0, 3]
    m10, m11, m12, m13 = inverse[leaf, 1, 0], inverse[leaf, 1, 1], inverse[leaf, 1, 2], inverse[leaf, 1, 3]
    m20, m21, m22, m23 = inverse[leaf, 2, 0], inverse[leaf, 2, 1], inverse[leaf, 2, 2], inverse[leaf, 2, 3]
    lx = PARALLEL * (abs(m00) + abs(m01) + abs(m02))
    ly = PARALLEL * (abs(m10) + abs(m11) + abs(m12))
    lz = PARALLEL * (abs(m20) + abs(m21) + abs(m22))
    rx, ry, rz = PARALLEL * (1.0 + abs(m03)), PARALLEL * (1.0 + abs(m13)), PARALLEL * (1.0 + abs(m23))
    for j in range(j0, j1):
        wx, wy, wz = s[DX + j], s[DX + ONE + j], s[DX + ONE + ONE + j]
        dx = m00 * wx + (m01 * wy + m02 * wz)
        dy = m10 * wx + (m11 * wy + m12 * wz)
        dz = m20 * wx + (m21 * wy + m22 * wz)
        wx, wy, wz = s[OX + j], s[OX + ONE + j], s[OX + ONE + ONE + j]
        ox = m00 * wx + m01 * wy + m02 * wz + m03
        oy = m10 * wx + m11 * wy + m12 * wz + m13
        oz = m20 * wx + m21 * wy + m22 * wz + m23
        nx, ny, nz = np.rint(ox), np.rint(oy), np.rint(oz)
        s[NX + j] = TINY if abs(dx) < lx else dx
        s[NX + ONE + j] = TINY if abs(dy) < ly else dy
        s[NX + ONE + ONE + j] = TINY if abs(dz) < lz else dz
        s[PX + j] = nx if abs(ox - nx) < rx else ox
        s[PX + ONE + j] = ny if abs(oy - ny) < ry else oy
        s[PX + ONE + ONE + j] = nz if abs(oz - nz) < rz else oz
    if kind == BLOCK:
        for j in range(j0, j1):
            near, far, face_in, face_out = block_span(
                s[PX + j], s[PX + ONE + j], s[PX + ONE + ONE + j], s[NX + j], s[NX + ONE + j], s[NX + ONE + ONE + j]
            )
            s[LEAF_IN + j], s[LEAF_OUT + j], s[FACE_IN + j], s[FACE_OUT + j] = near, far, face_in, face_out
    elif kind == CYLINDER:
        for j in range(j0, j1):
            near, far, face_in, face_out = cylinder_span(
                s[PX + j], s[PX + ONE + j], s[PX + ONE + ONE + j], s[NX + j], s[NX + ONE + j], s[NX + ONE + ONE + j]
            )
            s[LEAF_IN + j], s[LEAF_OUT + j], s[FACE_IN + j], s[FACE_OUT + j] = near, far, face_in, face_out
    elif kind == SPHERE:
        for j in range(j0, j1):
            near, far = sphere_span(
                s[PX + j], s[PX + ONE + j], s[PX + ONE + ONE + j], s[NX + j], s[NX + ONE + j], s[NX + ONE + ONE + j]
            )
            s[LEAF_IN + j], s[LEAF_OUT + j], s[FACE_IN + j], s[FACE_OUT + j] = near, far, 0.0, 0.0
    elif kind == CONE:
        for j in range(j0, j1):
            near, far, face_in, face_out = cone_span(
                s[PX + j], s[PX + ONE + j], s[PX + ONE + ONE + j], s[NX + j], s[NX + ONE + j], s[NX + ONE + ONE + j]
            )
            s[LEAF_IN + j], s[LEAF_OUT + j], s[FACE_IN + j], s[FACE_OUT + j] = near, far, face_in, face_out
    else:
        for j in range(j0, j1):
            near, far = plane_span(s[PX + ONE + ONE + j], s[NX + ONE + ONE + j])
            s[LEAF_IN + j], s[LEAF_OUT + j], s[FACE_IN + j], s[FACE_OUT + j] = near, far, 0.0, 0.0


@kernel
def ray_of(s, j):
    """Ray j of a batch: OX, DX of the scene frame."""
    return Ray(s[OX + j], s[OX + ONE + j], s[OX + ONE + ONE + j], s[DX + j], s[DX + ONE + j], s[DX + ONE + ONE + j])


@kernel
def invert_rays(s, n):
    """One over the directions DX, into IX; zeros give something huge."""
    for j in range(ZERO, n):
        dx, dy, dz = s[DX + j], s[DX + ONE + j], s[DX + ONE + ONE + j]
        s[IX + j] = 1.0 / (TINY if dx == 0.0 else dx)
        s[IX + ONE + j] = 1.0 / (TINY if dy == 0.0 else dy)
        s[IX + ONE + ONE + j] = 1.0 / (TINY if dz == 0.0 else dz)


@kernel
def meet_box(s, n, box, child, near):
    """Which rays pass a child's bounding box between ``near`` and REACH, into INSIDE; how many."""
    x0, y0, z0, x1, y1, z1 = box[0, child], box[1, child], box[2, child], box[3, child], box[4, child], box[5, child]
    met = 0
    for j in range(ZERO, n):
        o, i = s[OX + j], s[IX + j]
        a, b = (x0 - o) * i, (x1 - o) * i
        low, high = (a if a < b else b), (b if a < b else a)
        o, i = s[OX + ONE + j], s[IX + ONE + j]
        a, b = (y0 - o) * i, (y1 - o) * i
        c, d = (a if a < b else b), (b if a < b else a)
        low, high = (c if c > low else low), (d if d < high else high)
        o, i = s[OX + ONE + ONE + j], s[IX + ONE + ONE + j]
        a, b = (z0 - o) * i, (z1 - o) * i
        c, d = (a if a < b else b), (b if a < b else a)
        low, high = (c if c > low else low), (d if d < high else high)
        inside = (low <= high) & (low <= s[REACH + j]) & (high >= near)
        s[INSIDE + j] = 1.0 if inside else 0.0
        met += 1 if inside else 0
    return met


@kernel
def cast_rays(s, n, csg, work, secondary, terrains):
    """The first entries of rays OX, DX beyond the departure: places into BEST, codes into MET (NOTHING on a miss)."""
    tolerance, departure = secondary.tolerance, secondary.departure
    invert_rays(s, n)
    for j in range(ZERO, n):
        s[BEST + j], s[MET + j], s[REACH + j] = INF, NOTHING, INF
    for child in range(csg.box.shape[1]):
        met = meet_box(s, n, csg.box, child, departure)
        if met == 0:
            continue
        leaf = csg.simple[child]
        if leaf >= 0:
            j0, j1 = ends(s, n)
            leaf_rays(s, j0, j1, csg.kind[leaf], leaf, csg.inverse)
            work.counts[0] += np.int64(j1 - j0) * csg.halfspaces[leaf]
            work.counts[1] += np.int64(j1 - j0)
            code = leaf * LEAF_STEP
            for j in range(j0, j1):
                entry, best, hit, here = s[LEAF_IN + j], s[BEST + j], s[MET + j], code + FACE_STEP * s[FACE_IN + j]
                seen = (s[LEAF_OUT + j] - entry > tolerance) & (entry > departure)
                better = (entry < best - tolerance) | ((entry <= best + tolerance) & (here < hit))
                take = seen & better
                s[BEST + j] = entry if take else best
                s[MET + j] = here if take else hit
                s[REACH + j] = s[BEST + j] + tolerance
            continue
        for j in range(ZERO, n):
            if s[INSIDE + j] == 0.0:
                continue
            count = child_list(csg, csg.inverse, csg.sphere, child, ray_of(s, j), tolerance, work)
            for i in range(0, count, 2):
                entry, here = work.times[i], work.hits[i]
                if entry > departure:
                    if entry < s[BEST + j] - tolerance or (entry <= s[BEST + j] + tolerance and here < s[MET + j]):
                        s[BEST + j], s[MET + j], s[REACH + j] = entry, here, entry + tolerance
                    break
    if terrains is not None:
        for g in range(terrains.leaf.shape[0]):
            leaf = terrains.leaf[g]
            here = leaf * LEAF_STEP
            for j in range(ZERO, n):
                entry = terrain_ray(terrains, g, csg.inverse[leaf], ray_of(s, j), departure, s[REACH + j])
                if entry < s[BEST + j] - tolerance or (entry <= s[BEST + j] + tolerance and here < s[MET + j]):
                    s[BEST + j], s[MET + j], s[REACH + j] = entry, here, entry + tolerance


@kernel
def ends(s, n):
    """First and last + 1 ray whose INSIDE is set; one is."""
    j0, j1 = ZERO, n
    while s[INSIDE + j0] == 0.0:
        j0 += np.uint64(1)
    while s[INSIDE + j1 - np.uint64(1)] == 0.0:
        j1 -= np.uint64(1)
    return j0, j1


@kernel
def arriving_light(s, n, csg, materials, work, secondary, terrains):
    """LIGHT *= transparencies of what rays OX, DX meet before their REACH (the distance less the departure)."""
    tolerance, departure = secondary.tolerance, secondary.departure
    invert_rays(s, n)
    for child in range(csg.box.shape[1]):
        met = meet_box(s, n, csg.box, child, departure)
        if met == 0:
            continue
        leaf = csg.simple[child]
        if leaf >= 0:
            j0, j1 = ends(s, n)
            leaf_rays(s, j0, j1, csg.kind[leaf], leaf, csg.inverse)
            work.counts[0] += np.int64(j1 - j0) * csg.halfspaces[leaf]
            work.counts[1] += np.int64(j1 - j0)
            clear = materials.coefficients[leaf, 5]
            for j in range(j0, j1):
                near, far = s[LEAF_IN + j], s[LEAF_OUT + j]
                blocked = (far - near > tolerance) & (near < s[REACH + j]) & (far > departure)
                s[LIGHT + j] *= clear if blocked else 1.0
            continue
        for j in range(ZERO, n):
            if s[INSIDE + j] == 0.0 or s[LIGHT + j] == 0.0:
                continue
            count = child_list(csg, csg.inverse, csg.sphere, child, ray_of(s, j), tolerance, work)
            for i in range(0, count, 2):
                if work.times[i] < s[REACH + j] and work.times[i + 1] > departure:
                    s[LIGHT + j] *= materials.coefficients[int(work.hits[i] / LEAF_STEP), 5]
    if terrains is not None:
        for g in range(terrains.leaf.shape[0]):
            leaf = terrains.leaf[g]
            for j in range(ZERO, n):
                if s[LIGHT + j] <= 0.0:
                    continue
                entry = terrain_ray(terrains, g, csg.inverse[leaf], ray_of(s, j), departure, s[REACH + j])
                if entry < INF:
                    s[LIGHT + j] *= materials.coefficients[leaf, 5]


@kernel
def light_batch(s, n, row, csg, materials, work, secondary, terrains):
    """Add the light of a batch of surface points to RED, GREEN, BLUE of their pixels in ``row``.

    Places are in OX, viewing rays (unit) in VX, normals in NORMAL; WEIGHT is each ray's share of its pixel.
    """
    for j in range(ZERO, n):
        leaf = int(s[HIT + j] / LEAF_STEP)
        face = int(s[HIT + j] - leaf * LEAF_STEP) // 2
        colours = materials.colours
        red, green, blue = colours[leaf, face, 0], colours[leaf, face, 1], colours[leaf, face, 2]
        if terrains is not None:
            x, y, z = s[OX + j], s[OX + ONE + j], s[OX + ONE + ONE + j]
            red, green, blue = face_colour(terrains, materials, csg.inverse, leaf, face, x, y, z)
        s[TINT + j], s[TINT + ONE + j], s[TINT + ONE + ONE + j] = red, green, blue
        k = np.uint64(s[PIXEL + j])
        share = s[WEIGHT + j] * materials.coefficients[leaf, 0]
        row[RED + k] += share * red * materials.ambient_light[0]
        row[GREEN + k] += share * green * materials.ambient_light[1]
        row[BLUE + k] += share * blue * materials.ambient_light[2]
    for light in range(materials.lights.shape[0]):
        lx, ly, lz = materials.lights[light, 0], materials.lights[light, 1], materials.lights[light, 2]
        for j in range(ZERO, n):
            dx, dy, dz = lx - s[OX + j], ly - s[OX + ONE + j], lz - s[OX + ONE + ONE + j]
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            scale = 1.0 / distance
            dx, dy, dz = dx * scale, dy * scale, dz * scale
            facing = s[NORMAL + j] * dx + s[NORMAL + ONE + j] * dy + s[NORMAL + ONE + ONE + j] * dz
            s[DX + j], s[DX + ONE + j], s[DX + ONE + ONE + j] = dx, dy, dz
            lit = facing > 0.0
            s[FACING + j] = facing if lit else 0.0
            s[LIGHT + j] = 1.0 if lit else 0.0
            # What faces away needs no feeler: one that reaches nowhere meets nothing.
            s[REACH + j] = distance - secondary.departure if lit else -INF
        if secondary.shadows:
            arriving_light(s, n, csg, materials, work, secondary, terrains)
        lr, lg, lb = (
            materials.light_colours[light, 0],
            materials.light_colours[light, 1],
            materials.light_colours[light, 2],
        )
        for j in range(ZERO, n):
            arriving = s[LIGHT + j] * s[WEIGHT + j]
            if arriving == 0.0:
                continue
            leaf = int(s[HIT + j] / LEAF_STEP)
            shade, highlight = arriving * materials.coefficients[leaf, 1] * s[FACING + j], 0.0
            specular = materials.coefficients[leaf, 2]
            if specular > 0.0:
                nx, ny, nz = s[NORMAL + j], s[NORMAL + ONE + j], s[NORMAL + ONE + ONE + j]
                vx, vy, vz = s[VX + j], s[VX + ONE + j], s[VX + ONE + ONE + j]
                slope = 2.0 * (vx * nx + vy * ny + vz * nz)
                towards = (
                    (vx - slope * nx) * s[DX + j]
                    + (vy - slope * ny) * s[DX + ONE + j]
                    + (vz - slope * nz) * s[DX + ONE + ONE + j]
                )
                if towards > 0.0:
                    highlight = arriving * specular * power(towards, materials.coefficients[leaf, 3])
            k = np.uint64(s[PIXEL + j])
            row[RED + k] += (shade * s[TINT + j] + highlight) * lr
            row[GREEN + k] += (shade * s[TINT + ONE + j] + highlight) * lg
            row[BLUE + k] += (shade * s[TINT + ONE + ONE + j] + highlight) * lb


@kernel
def branch(s, n, materials, secondary, pending):
    """Push the mirrored and transmitted rays of a batch, and take their share off its WEIGHT.

    Returns how many rays are pending. Rays of higher levels lie higher on the stack, which bounds it
    (engine_native._secondary_workspace).
    """
    stack = secondary.stack
    for j in range(ZERO, n):
        if s[LEVEL + j] >= secondary.levels:
            continue
        leaf = int(s[HIT + j] / LEAF_STEP)
        mirror, clear = materials.coefficients[leaf, 4], materials.coefficients[leaf, 5]
        if mirror == 0.0 and clear == 0.0:
            continue
        weight = s[WEIGHT + j]
        share = weight * (1.0 - clear)
        s[WEIGHT + j] = share
        vx, vy, vz = s[VX + j], s[VX + ONE + j], s[VX + ONE + ONE + j]
        for way in range(2):
            part = share * mirror if way == 0 else weight * clear
            if part == 0.0:
                continue
            stack[pending, 0], stack[pending, 1], stack[pending, 2] = s[OX + j], s[OX + ONE + j], s[OX + ONE + ONE + j]
            slope = 0.0
            if way == 0:
                slope = 2.0 * (vx * s[NORMAL + j] + vy * s[NORMAL + ONE + j] + vz * s[NORMAL + ONE + ONE + j])
            stack[pending, 3] = vx - slope * s[NORMAL + j]
            stack[pending, 4] = vy - slope * s[NORMAL + ONE + j]
            stack[pending, 5] = vz - slope * s[NORMAL + ONE + ONE + j]
            stack[pending, 6], stack[pending, 7], stack[pending, 8] = part, s[LEVEL + j] + 1.0, s[PIXEL + j]
            pending += 1
    return pending


@kernel
def secondary_row(row, j0, j1, csg, materials, work, secondary, terrains):
    """Colours, not clipped, of the visible points of a row (HIT, PX.., VX.., NX..), added to its RED, GREEN, BLUE.

    The pixels that show something must come in black, the others as background.
    """
    s = secondary.batch
    n = ZERO
    for pixel in range(j0, j1):
        if row[HIT + pixel] < 0.0:
            continue
        for axis in range(np.uint64(3)):
            step = axis * ONE
            s[OX + step + n] = row[PX + step + pixel]
            s[VX + step + n] = row[VX + step + pixel]
            s[NORMAL + step + n] = row[NX + step + pixel]
        s[HIT + n], s[WEIGHT + n], s[LEVEL + n], s[PIXEL + n] = row[HIT + pixel], 1.0, 1.0, pixel
        n += np.uint64(1)
    pending = 0
    while True:
        pending = branch(s, n, materials, secondary, pending)
        light_batch(s, n, row, csg, materials, work, secondary, terrains)
        if pending == 0 or work.counts[3] != 0:
            return
        count = min(pending, STRIDE)
        pending -= count
        for i in range(count):
            slot, ray = np.uint64(i), secondary.stack[pending + i]
            s[OX + slot], s[OX + ONE + slot], s[OX + ONE + ONE + slot] = ray[0], ray[1], ray[2]
            s[DX + slot], s[DX + ONE + slot], s[DX + ONE + ONE + slot] = ray[3], ray[4], ray[5]
            s[WEIGHT + slot], s[LEVEL + slot], s[PIXEL + slot] = ray[6], ray[7], ray[8]
        cast_rays(s, np.uint64(count), csg, work, secondary, terrains)
        n = ZERO
        for j in range(ZERO, np.uint64(count)):
            if s[MET + j] < 0.0:
                k = np.uint64(s[PIXEL + j])
                row[RED + k] += s[WEIGHT + j] * materials.background[0]
                row[GREEN + k] += s[WEIGHT + j] * materials.background[1]
                row[BLUE + k] += s[WEIGHT + j] * materials.background[2]
                continue
            # Those that met something close ranks.
            t = s[BEST + j]
            for axis in range(np.uint64(3)):
                step = axis * ONE
                s[OX + step + n] = s[OX + step + j] + t * s[DX + step + j]
                s[PX + step + n] = s[OX + step + n]
                s[VX + step + n] = s[DX + step + j]
            s[HIT + n], s[WEIGHT + n] = s[MET + j], s[WEIGHT + j]
            s[LEVEL + n], s[PIXEL + n] = s[LEVEL + j], s[PIXEL + j]
            n += np.uint64(1)
        first = ZERO
        while first < n:
            last, hit = first, s[HIT + first]
            while last < n and s[HIT + last] == hit:
                last += np.uint64(1)
            leaf = int(hit / LEAF_STEP)
            face = int(hit - leaf * LEAF_STEP) // 2
            normals_run(s, first, last, leaf, face, csg.kind[leaf], csg.inverse, materials.flat_normals)
            if terrains is not None:  # noqa: SIM102
                if csg.kind[leaf] == TERRAIN:
                    terrain_normals(s, first, last, leaf, terrains, csg.inverse)
            first = last
        for j in range(ZERO, n):
            s[NORMAL + j], s[NORMAL + ONE + j], s[NORMAL + ONE + ONE + j] = (
                s[NX + j],
                s[NX + ONE + j],
                s[NX + ONE + ONE + j],
            )
