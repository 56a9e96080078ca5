"""Compiled ray tracing (thesis 4.2, 4.5): shadow feelers, mirrors and glass, for batches of rays in vectorised loops.

Pending rays wait on a stack with their weight in their pixel, so that nothing has to be unwound; they are taken from it
a batch at a time. A batch lives in one scratch array ``s``, like the rows of rows.py, at the fixed offsets below.
"""

from __future__ import annotations

import math

import numpy as np

from ..programs.program import BLOCK, CONE, CYLINDER, INTERSECT, SPHERE, TERRAIN
from ..settings import BLOCK_COLUMNS, NEVER, PARALLEL, TINY
from .packets import beams_from, bound, children_met, cut, in_boxes
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
    SPECULAR,
    SPECULAR_BASE,
    STRIDE,
    VX,
    block_span,
    cone_span,
    cylinder_span,
    kernel,
    plane_span,
    sphere_span,
)
from .shade import normals_run, raise_highlights
from .terrain import face_colour, terrain_normals, terrain_ray
from .tree import FACE_STEP, LEAF_STEP, NOTHING, child_list

INF = math.inf
# Rays that a loop does in one go once the compiler has unrolled it: four vectors of four.
VECTOR = np.uint64(16)
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
# Rays that meet the box of the child at hand, close together: origin and direction.
CLOSE, CLOSE_D = np.uint64(STRIDE * 49), np.uint64(STRIDE * 52)
# Where these rays are in that child: first and last place of two stretches, and the code of the face at the first.
IN, OUT, ENTRY_CODE = (np.uint64(STRIDE * k) for k in (55, 57, 59))
# The leaf whose surface a ray leaves, times LEAF_STEP; ANY_LEAF when it may meet that leaf again.
ANY_LEAF = -1.0
FROM = np.uint64(STRIDE * 61)
# The rays in the frame of the boxes: origin and direction; IX is one over the direction.
BOX_O, BOX_D = np.uint64(STRIDE * 62), np.uint64(STRIDE * 65)
BATCH_PARTS = 68
# A pending ray: origin, direction, weight, level, pixel, hit that it leaves.
RAY_PARTS = 10


@kernel
def leaf_rays(s, n, kind, leaf, inverse):
    """Boundaries of a leaf for the first n rays CLOSE of the scene frame, into LEAF_IN .. FACE_OUT."""
    j0, j1 = ZERO, n
    m00, m01, m02, m03 = inverse[leaf, 0, 0], inverse[leaf, 0, 1], inverse[leaf, 0, 2], inverse[leaf, 0, 3]
    m10, m11, m12, m13 = inverse[leaf, 1, 0], inverse[leaf, 1, 1], inverse[leaf, 1, 2], inverse[leaf, 1, 3]
    m20, m21, m22, m23 = inverse[leaf, 2, 0], inverse[leaf, 2, 1], inverse[leaf, 2, 2], inverse[leaf, 2, 3]
    lx = PARALLEL * (abs(m00) + abs(m01) + abs(m02))
    ly = PARALLEL * (abs(m10) + abs(m11) + abs(m12))
    lz = PARALLEL * (abs(m20) + abs(m21) + abs(m22))
    rx, ry, rz = PARALLEL * (1.0 + abs(m03)), PARALLEL * (1.0 + abs(m13)), PARALLEL * (1.0 + abs(m23))
    for j in range(j0, j1):
        wx, wy, wz = s[CLOSE_D + j], s[CLOSE_D + ONE + j], s[CLOSE_D + ONE + ONE + j]
        dx = m00 * wx + (m01 * wy + m02 * wz)
        dy = m10 * wx + (m11 * wy + m12 * wz)
        dz = m20 * wx + (m21 * wy + m22 * wz)
        wx, wy, wz = s[CLOSE + j], s[CLOSE + ONE + j], s[CLOSE + ONE + ONE + j]
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
def turn(s, n, part, frame, into):
    """Vectors ``part`` of the scene frame, in the frame of the boxes."""
    a0, a1, a2 = frame[0, 0], frame[0, 1], frame[0, 2]
    b0, b1, b2 = frame[1, 0], frame[1, 1], frame[1, 2]
    c0, c1, c2 = frame[2, 0], frame[2, 1], frame[2, 2]
    for j in range(ZERO, n):
        x, y, z = s[part + j], s[part + ONE + j], s[part + ONE + ONE + j]
        s[into + j] = a0 * x + a1 * y + a2 * z
        s[into + ONE + j] = b0 * x + b1 * y + b2 * z
        s[into + ONE + ONE + j] = c0 * x + c1 * y + c2 * z


@kernel
def begin_at(s, n, csg, secondary):
    """Make packets of a batch: the origins OX in the frame of the boxes, and their bounds."""
    batch = secondary.packets
    batch.many[0] = cut(s, n, batch.start)
    turn(s, n, OX, csg.hierarchy.frame, BOX_O)
    bound(s, BOX_O, batch, secondary.bounds, 0)


@kernel
def lead_along(s, n, csg):
    """The directions DX in the frame of the boxes, and one over them; zeros give something huge."""
    turn(s, n, DX, csg.hierarchy.frame, BOX_D)
    for j in range(ZERO, n):
        dx, dy, dz = s[BOX_D + j], s[BOX_D + ONE + j], s[BOX_D + ONE + ONE + j]
        s[IX + j] = 1.0 / (TINY if dx == 0.0 else dx)
        s[IX + ONE + j] = 1.0 / (TINY if dy == 0.0 else dy)
        s[IX + ONE + ONE + j] = 1.0 / (TINY if dz == 0.0 else dz)


@kernel
def meet_box(s, j0, j1, box, child, near, own):
    """Which rays j0 <= j < j1 pass a child's box between ``near`` and REACH, into INSIDE; how many.

    own : FROM of the rays that a child cannot meet, because it is one convex leaf and they begin on it
    """
    x0, y0, z0, x1, y1, z1 = box[0, child], box[1, child], box[2, child], box[3, child], box[4, child], box[5, child]
    met = 0
    for j in range(j0, j1):
        o, i = s[BOX_O + j], s[IX + j]
        a, b = (x0 - o) * i, (x1 - o) * i
        low, high = (a if a < b else b), (b if a < b else a)
        o, i = s[BOX_O + ONE + j], s[IX + ONE + j]
        a, b = (y0 - o) * i, (y1 - o) * i
        c, d = (a if a < b else b), (b if a < b else a)
        low, high = (c if c > low else low), (d if d < high else high)
        o, i = s[BOX_O + ONE + ONE + j], s[IX + ONE + ONE + j]
        a, b = (z0 - o) * i, (z1 - o) * i
        c, d = (a if a < b else b), (b if a < b else a)
        low, high = (c if c > low else low), (d if d < high else high)
        inside = (low <= high) & (low <= s[REACH + j]) & (high >= near) & (s[FROM + j] != own)
        s[INSIDE + j] = 1.0 if inside else 0.0
        met += 1 if inside else 0
    return met


@kernel
def rays_at(s, child, k, csg, secondary):
    """Rays of the packets that may meet the k-th child found and that pass its box: copied to CLOSE; how many.

    Their numbers in the batch are in secondary.lanes.
    """
    lanes, departure, place, open_until = secondary.lanes, secondary.departure, secondary.meeting.place, secondary.open
    count = np.int64(0)
    # A single leaf is convex, and what begins on its surface and does not lead into it leaves it for good; what leads
    # into it does not enter it. No leaf has this number where a child has several.
    own = csg.simple[child] * LEAF_STEP if csg.simple[child] >= 0 else -LEAF_STEP
    start = secondary.packets.start
    for p in range(secondary.packets.many[0]):
        if place[p, k] > open_until[p]:
            continue
        j0, j1 = np.uint64(start[p]), np.uint64(start[p + 1])
        if meet_box(s, j0, j1, csg.box, child, departure, own) == 0:
            continue
        for j in range(j0, j1):
            lanes[count] = j
            count += 1 if s[INSIDE + j] > 0.0 else 0
    end = np.uint64(count)
    for i in range(ZERO, end):
        ray = np.uint64(lanes[i])
        s[CLOSE + i], s[CLOSE + ONE + i], s[CLOSE + ONE + ONE + i] = (
            s[OX + ray],
            s[OX + ONE + ray],
            s[OX + ONE + ONE + ray],
        )
        s[CLOSE_D + i], s[CLOSE_D + ONE + i], s[CLOSE_D + ONE + ONE + i] = (
            s[DX + ray],
            s[DX + ONE + ray],
            s[DX + ONE + ONE + ray],
        )
    return end


@kernel
def cast_rays(s, n, csg, work, secondary, terrains):
    """The first entries of rays OX, DX beyond the departure: places into BEST, codes into MET (NOTHING on a miss)."""
    bounds, meeting = secondary.bounds, secondary.meeting
    begin_at(s, n, csg, secondary)
    lead_along(s, n, csg)
    for j in range(ZERO, n):
        s[BEST + j], s[MET + j], s[REACH + j] = INF, NOTHING, NEVER
    packets = secondary.packets.many[0]
    bound(s, BOX_D, secondary.packets, bounds, 6)
    for p in range(packets):
        secondary.open[p] = NEVER
    # From near to far: packets whose rays have all met something nearer are done with a child.
    for k in range(children_met(bounds, packets, NEVER, csg, meeting)):
        child = meeting.found[k]
        count = rays_at(s, child, k, csg, secondary)
        if count > ZERO and cast_at(s, count, child, csg, work, secondary) > 0:
            reach_of_packets(s, secondary.packets, k, meeting.place, secondary.open)
    if terrains is not None:
        cast_at_terrains(s, n, csg, secondary, terrains, secondary.departure)


@kernel
def reach_of_packets(s, batch, k, place, open_until):
    """The greatest REACH of each packet that may have met the k-th child found, into open_until."""
    for p in range(batch.many[0]):
        if place[p, k] > open_until[p]:
            continue
        reach = 0.0
        for j in range(np.uint64(batch.start[p]), np.uint64(batch.start[p + 1])):
            reach = max(reach, s[REACH + j])
        open_until[p] = reach


@kernel
def whole_vectors(n):
    """At least n rays, at most STRIDE: loops over as many have no rest that is done one by one."""
    return (n + VECTOR - np.uint64(1)) // VECTOR * VECTOR


@kernel
def leaf_stretch(s, n, leaf, csg, tolerance, counts):
    """Where the rays CLOSE are in a leaf, into IN, OUT and ENTRY_CODE; nowhere is from INF to -INF."""
    m = whole_vectors(n)
    leaf_rays(s, m, csg.kind[leaf], leaf, csg.inverse)
    counts[0] += np.int64(n) * csg.halfspaces[leaf]
    counts[1] += np.int64(n)
    code = leaf * LEAF_STEP
    inside = 0
    for k in range(ZERO, m):
        near, far = s[LEAF_IN + k], s[LEAF_OUT + k]
        # A touch is no hit: a span thinner than the tolerance is none.
        there = far - near > tolerance
        s[IN + k], s[OUT + k] = (near if there else INF), (far if there else -INF)
        s[ENTRY_CODE + k] = code + FACE_STEP * s[FACE_IN + k]
        inside += 1 if there & (k < n) else 0
    return inside


@kernel
def subtract_leaf(s, n, leaf, csg, tolerance, counts):
    """Take a leaf from the first stretches of rays CLOSE.

    Where something is left before it, what is left behind it is the second stretch. The rules are those of
    tree.combine: what is less than a tolerance apart is one place, of the lower leaf.
    """
    m = whole_vectors(n)
    leaf_rays(s, m, csg.kind[leaf], leaf, csg.inverse)
    counts[0] += np.int64(n) * csg.halfspaces[leaf]
    counts[1] += 2 * np.int64(n)
    counts[2] += np.int64(n)
    code = leaf * LEAF_STEP
    for k in range(ZERO, m):
        a, b, before = s[IN + k], s[OUT + k], s[ENTRY_CODE + k]
        near, far, behind = s[LEAF_IN + k], s[LEAF_OUT + k], code + FACE_STEP * s[FACE_OUT + k]
        there = far - near > tolerance
        covers = there & (near <= a + tolerance) & (far > a + tolerance)
        parts = there & (near > a + tolerance) & (near < b - tolerance)
        left = far < b - tolerance
        gone = covers & (not left)
        s[IN + k] = INF if gone else far if covers else a
        s[OUT + k] = -INF if gone else near if parts else b
        s[ENTRY_CODE + k] = behind if covers else before
        second = parts & left
        s[IN + ONE + k] = far if second else INF
        s[OUT + ONE + k] = b if second else -INF
        s[ENTRY_CODE + ONE + k] = behind


@kernel
def intersect_leaf(s, n, leaf, csg, tolerance, counts):
    """What a leaf has of the first stretches of rays CLOSE (see subtract_leaf)."""
    m = whole_vectors(n)
    leaf_rays(s, m, csg.kind[leaf], leaf, csg.inverse)
    counts[0] += np.int64(n) * csg.halfspaces[leaf]
    counts[1] += 2 * np.int64(n)
    counts[2] += np.int64(n)
    code = leaf * LEAF_STEP
    for k in range(ZERO, m):
        a, b, before = s[IN + k], s[OUT + k], s[ENTRY_CODE + k]
        near, far, here = s[LEAF_IN + k], s[LEAF_OUT + k], code + FACE_STEP * s[FACE_IN + k]
        common = (far - near > tolerance) & (far > a + tolerance) & (near < b - tolerance)
        later = near > a + tolerance
        s[IN + k] = (near if later else a) if common else INF
        s[OUT + k] = (far if far < b else b) if common else -INF
        s[ENTRY_CODE + k] = here if later else before


@kernel
def stretches(s, n, child, csg, tolerance, counts):
    """Where the rays CLOSE are in a child of one or two leaves, into IN, OUT, ENTRY_CODE: how many stretches, 0 to 2.

    -1 for a child of more leaves.
    """
    start, stop = csg.code_start[child], csg.code_start[child + 1]
    if stop - start > 3:
        return -1
    if leaf_stretch(s, n, csg.code[start], csg, tolerance, counts) == 0:
        return 0
    if stop - start == 1:
        return 1
    if csg.code[start + 2] == INTERSECT:
        intersect_leaf(s, n, csg.code[start + 1], csg, tolerance, counts)
        return 1
    subtract_leaf(s, n, csg.code[start + 1], csg, tolerance, counts)
    return 2


@kernel
def cast_at(s, n, child, csg, work, secondary):
    """Merge the first entries of the n rays CLOSE into one child, into BEST and MET; how many were nearer."""
    tolerance, departure = secondary.tolerance, secondary.departure
    nearer = 0
    count = stretches(s, n, child, csg, tolerance, work.counts)
    for k in range(ZERO, n):
        j = np.uint64(secondary.lanes[k])
        entry, here = INF, NOTHING
        if count < 0:
            boundaries = child_list(csg, csg.inverse, csg.sphere, child, ray_of(s, j), tolerance, work)
            for i in range(0, boundaries, 2):
                if work.times[i] > departure:
                    entry, here = work.times[i], work.hits[i]
                    break
        elif count > 0 and s[IN + k] > departure:
            entry, here = s[IN + k], s[ENTRY_CODE + k]
        elif count > 1 and s[IN + ONE + k] > departure:
            entry, here = s[IN + ONE + k], s[ENTRY_CODE + ONE + k]
        if entry < s[BEST + j] - tolerance or (entry <= s[BEST + j] + tolerance and here < s[MET + j]):
            s[BEST + j], s[MET + j], s[REACH + j] = entry, here, entry + tolerance
            nearer += 1
    return nearer


@kernel
def cast_at_terrains(s, n, csg, secondary, terrains, departure):
    """Merge the first places where rays meet terrains into BEST and MET."""
    tolerance = secondary.tolerance
    for g in range(terrains.leaf.shape[0]):
        leaf = terrains.leaf[g]
        here = leaf * LEAF_STEP
        for j in range(ZERO, n):
            entry = terrain_ray(terrains, g, csg.inverse[leaf], ray_of(s, j), departure, s[REACH + j])
            if entry < s[BEST + j] - tolerance or (entry <= s[BEST + j] + tolerance and here < s[MET + j]):
                s[BEST + j], s[MET + j], s[REACH + j] = entry, here, entry + tolerance


@kernel
def light_of_packets(s, batch, open_until):
    """Whether any light passes along a ray of each packet: INF or -1 into open_until; along how many rays of all."""
    total = 0
    for p in range(batch.many[0]):
        still = 0
        for j in range(np.uint64(batch.start[p]), np.uint64(batch.start[p + 1])):
            still += 1 if s[LIGHT + j] > 0.0 else 0
        open_until[p] = NEVER if still > 0 else -1.0
        total += still
    return total


@kernel
def arriving_light(s, n, csg, materials, work, secondary, terrains):
    """LIGHT *= transparencies of what rays OX, DX meet before their REACH (the distance less the departure)."""
    begin_at(s, n, csg, secondary)
    if light_of_packets(s, secondary.packets, secondary.open) == 0:
        return
    lead_along(s, n, csg)
    bound(s, BOX_D, secondary.packets, secondary.bounds, 6)
    dim(s, n, secondary.bounds, NEVER, csg, materials, work, secondary, terrains)


@kernel
def arriving_from(s, n, light, csg, materials, work, secondary, terrains):
    """As arriving_light, of a point of light, (3,): its rays diverge from there to where secondary.bounds says.

    The batch must have begun (``begin_at``).
    """
    if light_of_packets(s, secondary.packets, secondary.open) == 0:
        return
    lead_along(s, n, csg)
    beams_from(in_boxes(light, csg.hierarchy.frame), secondary.bounds, secondary.packets.many[0], secondary.beams)
    dim(s, n, secondary.beams, 1.0, csg, materials, work, secondary, terrains)


@kernel
def dim(s, n, bounds, far, csg, materials, work, secondary, terrains):
    """LIGHT *= transparencies of what rays OX, DX meet before their REACH.

    bounds : of their packets; far : the greatest t of the rays there
    """
    departure, meeting = secondary.departure, secondary.meeting
    for k in range(children_met(bounds, secondary.packets.many[0], far, csg, meeting)):
        child = meeting.found[k]
        count = rays_at(s, child, k, csg, secondary)
        if count > ZERO and dim_by(s, count, child, csg, materials, work, secondary) > 0:
            light_of_packets(s, secondary.packets, secondary.open)
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
def dim_by(s, n, child, csg, materials, work, secondary):
    """LIGHT of the n rays CLOSE times the transparency of one child for each time they enter it; how many are dark."""
    tolerance, departure = secondary.tolerance, secondary.departure
    clear = materials.coefficients
    dark = 0
    count = stretches(s, n, child, csg, tolerance, work.counts)
    for k in range(ZERO, n):
        j = np.uint64(secondary.lanes[k])
        reach, left = s[REACH + j], s[LIGHT + j]
        if count < 0:
            boundaries = child_list(csg, csg.inverse, csg.sphere, child, ray_of(s, j), tolerance, work)
            for i in range(0, boundaries, 2):
                if work.times[i] < reach and work.times[i + 1] > departure:
                    left *= clear[int(work.hits[i] / LEAF_STEP), 5]
        if count > 0 and s[IN + k] < reach and s[OUT + k] > departure:
            left *= clear[int(s[ENTRY_CODE + k] / LEAF_STEP), 5]
        if count > 1 and s[IN + ONE + k] < reach and s[OUT + ONE + k] > departure:
            left *= clear[int(s[ENTRY_CODE + ONE + k] / LEAF_STEP), 5]
        s[LIGHT + j] = left
        if left == 0.0:
            # Nothing more can be taken from it: its feeler reaches nowhere.
            s[REACH + j] = -INF
            dark += 1
    return dark


@kernel
def light_batch(s, n, csg, materials, work, secondary, terrains):
    """Add the light of a batch of surface points to the colours of their pixels.

    Places are in OX, viewing rays (unit) in VX, normals in NORMAL; WEIGHT is each ray's share of its pixel.
    """
    first = ZERO
    while first < n:
        last = end_of_run(s, first, n)
        begin_run(s, first, last, csg, materials, terrains)
        first = last
    if secondary.shadows:
        begin_at(s, n, csg, secondary)
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
            arriving_from(s, n, materials.lights[light], csg, materials, work, secondary, terrains)
        first = ZERO
        while first < n:
            last = end_of_run(s, first, n)
            light_run_of_batch(s, first, last, materials, light)
            first = last
    colours = secondary.colours
    for j in range(ZERO, n):
        k, weight = np.uint64(s[PIXEL + j]), s[WEIGHT + j]
        colours[0, k] += weight * s[RED + j]
        colours[1, k] += weight * s[GREEN + j]
        colours[2, k] += weight * s[BLUE + j]


@kernel
def end_of_run(s, first, n):
    """The end of the points from ``first`` on that lie on one face."""
    last, hit = first + np.uint64(1), s[HIT + first]
    while last < n and s[HIT + last] == hit:
        last += np.uint64(1)
    return last


@kernel
def begin_run(s, first, last, csg, materials, terrains):
    """The face's colour at points of one face into TINT, and what the ambient light makes of it into RED.. BLUE."""
    hit = s[HIT + first]
    leaf = int(hit / LEAF_STEP)
    face = int(hit - leaf * LEAF_STEP) // 2
    for channel in range(np.uint64(3)):
        step, paint = channel * ONE, materials.colours[leaf, face, channel]
        for j in range(first, last):
            s[TINT + step + j] = paint
    if terrains is not None:  # noqa: SIM102
        if csg.kind[leaf] == TERRAIN:
            for j in range(first, last):
                x, y, z = s[OX + j], s[OX + ONE + j], s[OX + ONE + ONE + j]
                s[TINT + j], s[TINT + ONE + j], s[TINT + ONE + ONE + j] = face_colour(
                    terrains, materials, csg.inverse, leaf, face, x, y, z
                )
    for channel in range(np.uint64(3)):
        step, ambient = channel * ONE, materials.coefficients[leaf, 0] * materials.ambient_light[channel]
        for j in range(first, last):
            s[RED + step + j] = ambient * s[TINT + step + j]


@kernel
def light_run_of_batch(s, first, last, materials, light):
    """Add what arrives of one light (LIGHT) at points of one leaf to RED, GREEN, BLUE."""
    leaf = int(s[HIT + first] / LEAF_STEP)
    diffuse, specular = materials.coefficients[leaf, 1], materials.coefficients[leaf, 2]
    lr, lg, lb = (
        materials.light_colours[light, 0],
        materials.light_colours[light, 1],
        materials.light_colours[light, 2],
    )
    for j in range(first, last):
        nx, ny, nz = s[NORMAL + j], s[NORMAL + ONE + j], s[NORMAL + ONE + ONE + j]
        vx, vy, vz = s[VX + j], s[VX + ONE + j], s[VX + ONE + ONE + j]
        dx, dy, dz = s[DX + j], s[DX + ONE + j], s[DX + ONE + ONE + j]
        slope = 2.0 * (vx * nx + vy * ny + vz * nz)
        towards = (vx - slope * nx) * dx + (vy - slope * ny) * dy + (vz - slope * nz) * dz
        lit = towards > 0.0
        s[SPECULAR_BASE + j] = towards if lit else 0.0
        s[SPECULAR + j] = specular * s[LIGHT + j] if lit else 0.0
    if specular > 0.0:
        raise_highlights(s, first, last, materials.coefficients[leaf, 3])
    for j in range(first, last):
        shade, highlight = diffuse * s[FACING + j] * s[LIGHT + j], s[SPECULAR + j]
        s[RED + j] += (shade * s[TINT + j] + highlight) * lr
        s[GREEN + j] += (shade * s[TINT + ONE + j] + highlight) * lg
        s[BLUE + j] += (shade * s[TINT + ONE + ONE + j] + highlight) * lb


@kernel
def note_leaves(s, n):
    """The leaves on which the places of a batch lie, or which its rays leave (HIT), into FROM."""
    for j in range(ZERO, n):
        hit = s[HIT + j]
        # Odd codes are walls seen from inside, from where rays lead through the solid.
        s[FROM + j] = np.floor(hit / LEAF_STEP) * LEAF_STEP if np.floor(0.5 * hit) * 2.0 == hit else ANY_LEAF


@kernel
def branch(s, n, materials, secondary):
    """Push the mirrored and transmitted rays of a batch, and take their share off its WEIGHT.

    Rays of one kind follow each other, so that packets of them lie close. Rays of higher levels lie higher on the
    stack, which bounds it (engine_native._secondary_workspace).
    """
    stack = secondary.stack
    pending = secondary.waiting[1]
    for way in range(2):
        for j in range(ZERO, n):
            if s[LEVEL + j] >= secondary.levels:
                continue
            leaf = int(s[HIT + j] / LEAF_STEP)
            mirror, clear = materials.coefficients[leaf, 4], materials.coefficients[leaf, 5]
            part = s[WEIGHT + j] * ((1.0 - clear) * mirror if way == 0 else clear)
            if part == 0.0:
                continue
            vx, vy, vz = s[VX + j], s[VX + ONE + j], s[VX + ONE + ONE + j]
            stack[pending, 0], stack[pending, 1], stack[pending, 2] = s[OX + j], s[OX + ONE + j], s[OX + ONE + ONE + j]
            slope = 0.0
            if way == 0:
                slope = 2.0 * (vx * s[NORMAL + j] + vy * s[NORMAL + ONE + j] + vz * s[NORMAL + ONE + ONE + j])
            stack[pending, 3] = vx - slope * s[NORMAL + j]
            stack[pending, 4] = vy - slope * s[NORMAL + ONE + j]
            stack[pending, 5] = vz - slope * s[NORMAL + ONE + ONE + j]
            stack[pending, 6], stack[pending, 7], stack[pending, 8] = part, s[LEVEL + j] + 1.0, s[PIXEL + j]
            stack[pending, 9] = s[HIT + j]
            pending += 1
            if way == 1:
                s[WEIGHT + j] *= 1.0 - clear
    secondary.waiting[1] = pending


@kernel
def normals_batch(s, n, csg, materials, terrains):
    """Unit normals, turned to the viewer, of the places of a batch (PX, VX, HIT), into NORMAL."""
    first = ZERO
    while first < n:
        last, hit = end_of_run(s, first, n), s[HIT + first]
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


@kernel
def next_batch(s, csg, materials, work, secondary, terrains):
    """Take rays from the stack and cast them; those that meet something become the batch. How many those are."""
    count = min(secondary.waiting[1], STRIDE)
    secondary.waiting[1] -= count
    pending = secondary.waiting[1]
    for i in range(count):
        slot, ray = np.uint64(i), secondary.stack[pending + i]
        s[OX + slot], s[OX + ONE + slot], s[OX + ONE + ONE + slot] = ray[0], ray[1], ray[2]
        s[DX + slot], s[DX + ONE + slot], s[DX + ONE + ONE + slot] = ray[3], ray[4], ray[5]
        s[WEIGHT + slot], s[LEVEL + slot], s[PIXEL + slot], s[HIT + slot] = ray[6], ray[7], ray[8], ray[9]
    note_leaves(s, np.uint64(count))
    cast_rays(s, np.uint64(count), csg, work, secondary, terrains)
    n = group_by_face(s, np.uint64(count), materials, secondary)
    normals_batch(s, n, csg, materials, terrains)
    return n


@kernel
def group(s, part, secondary, n):
    """The first n of secondary.lanes that have a hit in ``part``, those of one face together, in order; how many."""
    faces, lanes, given = secondary.faces, secondary.lanes, secondary.given
    found = np.int64(0)
    for i in range(n):
        given[i] = lanes[i]
        code = np.int64(s[part + np.uint64(lanes[i])])
        if code < 0:
            continue
        if faces.number[code] < 0:
            faces.number[code] = found
            faces.code[found], faces.place[found] = code, 0
            found += 1
        faces.place[faces.number[code]] += 1
    count = np.int64(0)
    for f in range(found):
        count, faces.place[f] = count + faces.place[f], count
    for i in range(n):
        code = np.int64(s[part + np.uint64(given[i])])
        if code >= 0:
            f = faces.number[code]
            lanes[faces.place[f]] = given[i]
            faces.place[f] += 1
    for f in range(found):
        faces.number[faces.code[f]] = -1
    return count


@kernel
def permute(s, part, n, lanes):
    """One part of a batch in the order of lanes."""
    for k in range(ZERO, n):
        s[CLOSE + k] = s[part + np.uint64(lanes[k])]
    for k in range(ZERO, n):
        s[part + k] = s[CLOSE + k]


@kernel
def arrange(s, n, width, secondary):
    """Bring visible places that lie close in an image of so many columns together: face by face, in blocks of pixels.

    Places of a batch come row by row; a packet of as many in one row would be wide and flat.
    """
    lanes, place, count = secondary.lanes, secondary.faces.place, np.int64(0)
    blocks = (width + BLOCK_COLUMNS - 1) // BLOCK_COLUMNS
    for b in range(blocks):
        place[b] = 0
    for j in range(ZERO, n):
        place[np.int64(s[PIXEL + j]) % width // BLOCK_COLUMNS] += 1
    for b in range(blocks):
        count, place[b] = count + place[b], count
    for j in range(ZERO, n):
        b = np.int64(s[PIXEL + j]) % width // BLOCK_COLUMNS
        lanes[place[b]] = j
        place[b] += 1
    group(s, HIT, secondary, np.int64(n))
    for axis in range(np.uint64(3)):
        step = axis * ONE
        permute(s, OX + step, n, lanes)
        permute(s, VX + step, n, lanes)
        permute(s, NORMAL + step, n, lanes)
    permute(s, PIXEL, n, lanes)
    permute(s, HIT, n, lanes)


@kernel
def group_by_face(s, count, materials, secondary):
    """Make points of the rays that met something, those of one face together; how many. The others see background.

    What lies on one face is lit and mirrored alike, in long loops, and its rays lie close in packets.
    """
    lanes = secondary.lanes
    for j in range(ZERO, count):
        lanes[j] = j
        if s[MET + j] < 0.0:
            pixel = np.uint64(s[PIXEL + j])
            for channel in range(3):
                secondary.colours[channel, pixel] += s[WEIGHT + j] * materials.background[channel]
    n = np.uint64(group(s, MET, secondary, np.int64(count)))
    for k in range(ZERO, n):
        ray = np.uint64(lanes[k])
        t = s[BEST + ray]
        s[HIT + k] = s[MET + ray]
        for axis in range(np.uint64(3)):
            step = axis * ONE
            s[PX + step + k] = s[OX + step + ray] + t * s[DX + step + ray]
            s[VX + step + k] = s[DX + step + ray]
        s[CLOSE + k], s[CLOSE + ONE + k], s[CLOSE + ONE + ONE + k] = s[WEIGHT + ray], s[LEVEL + ray], s[PIXEL + ray]
    for k in range(ZERO, n):
        s[OX + k], s[OX + ONE + k], s[OX + ONE + ONE + k] = s[PX + k], s[PX + ONE + k], s[PX + ONE + ONE + k]
        s[WEIGHT + k], s[LEVEL + k], s[PIXEL + k] = s[CLOSE + k], s[CLOSE + ONE + k], s[CLOSE + ONE + ONE + k]
    return n


@kernel
def follow(least, width, csg, materials, work, secondary, terrains):
    """Light the points of the batch, and follow rays of the stack as long as at least ``least`` are there.

    width : columns of the area of the image whose places are in secondary.colours
    """
    s = secondary.batch
    n = np.uint64(secondary.waiting[0])
    secondary.waiting[0] = 0
    arrange(s, n, width, secondary)
    while n > ZERO or secondary.waiting[1] >= least:
        if work.counts[3] != 0:
            break
        if n > ZERO:
            note_leaves(s, n)
            branch(s, n, materials, secondary)
            light_batch(s, n, csg, materials, work, secondary, terrains)
        if secondary.waiting[1] < least:
            break
        n = next_batch(s, csg, materials, work, secondary, terrains)


@kernel
def gather_row(row, m, first, csg, materials, work, secondary, terrains):
    """Take the visible points of a row (HIT, PX.., VX.., NX..) into the batch, which is followed whenever it is full.

    Its light will be in secondary.colours[:, first:first + m], once ``follow`` has been called with least = 1. RED,
    GREEN, BLUE must come in black for pixels that show something, as background for the others.
    """
    s = secondary.batch
    for pixel in range(ZERO, np.uint64(m)):
        place = np.uint64(first) + pixel
        secondary.colours[0, place] = row[RED + pixel]
        secondary.colours[1, place] = row[GREEN + pixel]
        secondary.colours[2, place] = row[BLUE + pixel]
        if row[HIT + pixel] < 0.0:
            continue
        n = np.uint64(secondary.waiting[0])
        for axis in range(np.uint64(3)):
            step = axis * ONE
            s[OX + step + n] = row[PX + step + pixel]
            s[VX + step + n] = row[VX + step + pixel]
            s[NORMAL + step + n] = row[NX + step + pixel]
        s[HIT + n], s[WEIGHT + n], s[LEVEL + n], s[PIXEL + n] = row[HIT + pixel], 1.0, 1.0, place
        secondary.waiting[0] += 1
        if secondary.waiting[0] == STRIDE:
            follow(STRIDE, m, csg, materials, work, secondary, terrains)


@kernel
def scatter_row(row, m, first, colours):
    """The light of a row's pixels, colours[:, first:first + m], into RED, GREEN, BLUE."""
    for pixel in range(ZERO, np.uint64(m)):
        place = np.uint64(first) + pixel
        row[RED + pixel], row[GREEN + pixel], row[BLUE + pixel] = (
            colours[0, place],
            colours[1, place],
            colours[2, place],
        )
