"""Compiled CSG: first entries of products for rows of pixels, and merged lists of boundaries for single rays.

The rules are those of reference.py: boundaries within the tolerance are one place and belong to the lowest leaf there.
"""

from __future__ import annotations

import math

import numpy as np

from ..programs.program import INTERSECT, UNION
from ..settings import NEVER, PARALLEL, TINY
from .records import Ray
from .rows import (
    CODE,
    DEPTH,
    END,
    ENTRY,
    FACE_IN,
    FACE_OUT,
    HIT,
    LEAF_IN,
    LEAF_OUT,
    STRIDE,
    SUBTRACTED,
    SUBTRACTED_PARTS,
    X,
    kernel,
    leaf_row,
    leaf_span,
    ray_y,
)

INF = math.inf
# Hits are written leaf * LEAF_STEP + face * FACE_STEP + (1 when the ray leaves the solid there).
LEAF_STEP, FACE_STEP = 16.0, 2.0
NOTHING = -1.0


@kernel
def touches_run(span, leaf, run):
    """Whether a leaf may touch pixels of a PixelRun."""
    for row in range(run.row, run.bottom + 1):
        if span[leaf, row, 0] <= run.last and span[leaf, row, 1] >= run.first:
            return True
    return False


@kernel
def product_row(s, j0, j1, q, run, y, tolerance, csg, camera, whole, counts):
    """Merge the first entries of product q, on rays (s[X + j], y, 1) for j0 <= j < j1, into DEPTH and HIT.

    run : the PixelRun that the rays lie in, for the spans of subtracted primitives; whole : ignore the spans
    counts : (4,) int64: intersections, nodes, combines are added
    """
    begin, end = csg.product_start[q], csg.product_start[q + 1]
    split = begin + csg.positive[q]
    mark = csg.ambiguity[q]
    n = np.int64(j1 - j0)
    for j in range(j0, j1):
        s[ENTRY + j] = -INF
        s[END + j] = INF
        s[CODE + j] = NOTHING
    for f in range(begin, split):
        leaf = csg.factors[f]
        leaf_row(s, j0, j1, csg.kind[leaf], leaf, camera.local, camera.origin, camera.limit, y)
        counts[0] += n * csg.halfspaces[leaf]
        code = leaf * LEAF_STEP
        for j in range(j0, j1):
            near, entry, here = s[LEAF_IN + j], s[ENTRY + j], code + FACE_STEP * s[FACE_IN + j]
            # A touch is no hit: a span thinner than the tolerance is none.
            far = s[LEAF_OUT + j]
            far = far if far - near > tolerance else -INF
            before = s[CODE + j]
            later = near > entry + tolerance
            tied = (near >= entry - tolerance) & (not later)
            take = later | (tied & (here < before))
            s[ENTRY + j] = near if take else entry
            s[CODE + j] = (here if take else before) + (mark if tied else 0.0)
            so_far = s[END + j]
            s[END + j] = far if far < so_far else so_far
    alive = 0
    for j in range(j0, j1):
        entry = s[ENTRY + j]
        behind = entry <= tolerance
        s[CODE + j] = NOTHING if behind else s[CODE + j]
        entry = tolerance if behind else entry
        s[ENTRY + j] = entry
        alive += 1 if (entry < s[END + j] - tolerance) & (entry <= s[DEPTH + j] + tolerance) else 0
    counts[1] += n * (2 * (split - begin) - 1)
    counts[2] += n * (split - begin)
    if alive == 0:
        return
    slots = np.uint64(0)
    for f in range(split, end):
        leaf = csg.factors[f]
        if not (whole or touches_run(camera.span, leaf, run)):
            continue
        leaf_row(s, j0, j1, csg.kind[leaf], leaf, camera.local, camera.origin, camera.limit, y)
        counts[0] += n * csg.halfspaces[leaf]
        counts[1] += 2 * n
        counts[2] += n
        base = SUBTRACTED + slots * SUBTRACTED_PARTS
        slots += np.uint64(1)
        code = leaf * LEAF_STEP
        for j in range(j0, j1):
            near, far = s[LEAF_IN + j], s[LEAF_OUT + j]
            s[base + j] = near
            s[base + SUBTRACTED_OUT + j] = far if far - near > tolerance else -INF
            s[base + SUBTRACTED_CODE + j] = code + FACE_STEP * s[FACE_OUT + j]
    # Each pass moves an entry that a subtracted primitive covers to where the ray leaves that primitive.
    moved = 1
    while moved > 0:
        moved = 0
        for slot in range(np.uint64(0), slots):
            base = SUBTRACTED + slot * SUBTRACTED_PARTS
            for j in range(j0, j1):
                entry, code = s[ENTRY + j], s[CODE + j]
                near, far, here = s[base + j], s[base + SUBTRACTED_OUT + j], s[base + SUBTRACTED_CODE + j]
                covers = (near <= entry + tolerance) & (far > entry + tolerance)
                tied = (near < entry - tolerance) & (far >= entry - tolerance) & (not covers) & (code != here)
                s[ENTRY + j] = far if covers else entry
                s[CODE + j] = here if covers | (tied & (here < code)) else code + (mark if tied else 0.0)
                moved += 1 if covers else 0
        if slots < 2:
            break
    for j in range(j0, j1):
        entry, code, depth, hit = s[ENTRY + j], s[CODE + j], s[DEPTH + j], s[HIT + j]
        seen = (entry < s[END + j] - tolerance) & (code >= 0.0)
        nearer = entry < depth - tolerance
        tied = (entry <= depth + tolerance) & (not nearer)
        take = seen & (nearer | (tied & (code < hit)))
        s[DEPTH + j] = entry if take else depth
        s[HIT + j] = (code if take else hit) + (mark if seen & tied & (code != hit) else 0.0)


# Offsets of the second and third part of a subtracted primitive: one and two rows.
SUBTRACTED_OUT, SUBTRACTED_CODE = np.uint64(STRIDE), np.uint64(2 * STRIDE)


@kernel
def local_span(kind, m, ray):
    """near, far, face_in, face_out of one Ray, given in the frame that m (3, 4) takes to the leaf's unit frame."""
    ox, oy, oz, dx, dy, dz = ray
    lx = m[0, 0] * dx + (m[0, 1] * dy + m[0, 2] * dz)
    ly = m[1, 0] * dx + (m[1, 1] * dy + m[1, 2] * dz)
    lz = m[2, 0] * dx + (m[2, 1] * dy + m[2, 2] * dz)
    lx = TINY if abs(lx) < PARALLEL * (abs(m[0, 0]) + abs(m[0, 1]) + abs(m[0, 2])) else lx
    ly = TINY if abs(ly) < PARALLEL * (abs(m[1, 0]) + abs(m[1, 1]) + abs(m[1, 2])) else ly
    lz = TINY if abs(lz) < PARALLEL * (abs(m[2, 0]) + abs(m[2, 1]) + abs(m[2, 2])) else lz
    px = m[0, 0] * ox + m[0, 1] * oy + m[0, 2] * oz + m[0, 3]
    py = m[1, 0] * ox + m[1, 1] * oy + m[1, 2] * oz + m[1, 3]
    pz = m[2, 0] * ox + m[2, 1] * oy + m[2, 2] * oz + m[2, 3]
    nx, ny, nz = round(px), round(py), round(pz)
    px = nx if abs(px - nx) < PARALLEL * (1.0 + abs(m[0, 3])) else px
    py = ny if abs(py - ny) < PARALLEL * (1.0 + abs(m[1, 3])) else py
    pz = nz if abs(pz - nz) < PARALLEL * (1.0 + abs(m[2, 3])) else pz
    return leaf_span(kind, px, py, pz, lx, ly, lz)


@kernel
def combine(op, times, hits, start, middle, end, tolerance):
    """Merge the lists [start, middle) and [middle, end) into one at start; its end is returned.

    The room beyond ``end`` is used for the merging.
    """
    i, j, out = start, middle, end
    left, right, inside = False, False, False
    while i < middle or j < end:
        place = INF
        if i < middle:
            place = times[i]
        if j < end and times[j] < place:
            place = times[j]
        best_time, best_hit = INF, INF
        while True:
            take_left = i < middle and (j >= end or times[i] <= times[j])
            if not take_left and j >= end:
                break
            k = i if take_left else j
            if times[k] - place > tolerance:
                break
            if np.floor(hits[k] / LEAF_STEP) < np.floor(best_hit / LEAF_STEP):
                best_time, best_hit = times[k], hits[k]
            if take_left:
                left = not left
                i += 1
            else:
                right = not right
                j += 1
        if op == UNION:
            now = left or right
        elif op == INTERSECT:
            now = left and right
        else:
            now = left and not right
        if now != inside:
            times[out], hits[out] = best_time, best_hit
            out += 1
            inside = now
    count = out - end
    for k in range(count):
        times[start + k], hits[start + k] = times[end + k], hits[end + k]
    return start + count


@kernel
def child_list(csg, matrices, spheres, child, ray, tolerance, work):
    """All boundaries of a child along a Ray, into work.times and work.hits; how many is returned.

    matrices : (n, 3, 4) from the ray's frame to the unit frames; spheres : (n, 4) about the leaves in the ray's frame,
    centre and squared radius.
    """
    times, hits, starts, counts = work.times, work.hits, work.starts, work.counts
    ox, oy, oz, dx, dy, dz = ray
    depth = 0
    end = 0
    square = dx * dx + dy * dy + dz * dz
    i = csg.code_start[child]
    stop = csg.code_start[child + 1]
    while i < stop:
        op = csg.code[i]
        counts[1] += 1
        if op >= 0:
            starts[depth] = end
            depth += 1
            cx, cy, cz = spheres[op, 0] - ox, spheres[op, 1] - oy, spheres[op, 2] - oz
            along = cx * dx + cy * dy + cz * dz
            near, far, face_in, face_out = INF, -INF, 0.0, 0.0
            if (cx * cx + cy * cy + cz * cz - spheres[op, 3]) * square <= along * along:
                near, far, face_in, face_out = local_span(csg.kind[op], matrices[op], ray)
                counts[0] += csg.halfspaces[op]
            if far - near > tolerance:
                times[end], hits[end] = near, op * LEAF_STEP + FACE_STEP * face_in
                times[end + 1], hits[end + 1] = far, op * LEAF_STEP + FACE_STEP * face_out
                end += 2
        else:
            counts[2] += 1
            if starts[depth - 1] < end:
                end = combine(op, times, hits, starts[depth - 2], starts[depth - 1], end, tolerance)
            elif op == INTERSECT:
                end = starts[depth - 2]
            depth -= 1
        while csg.jump[i] > 0 and end == starts[depth - 1]:
            i = csg.jump[i] - 1
        i += 1
    return end


@kernel
def list_row(work, j0, j1, child, y, tolerance, csg, camera):
    """Merge the first boundary beyond the camera of a child, entry or exit, into DEPTH and HIT (see product_row)."""
    s, times, hits = work.row, work.times, work.hits
    for j in range(j0, j1):
        ray = Ray(0.0, 0.0, 0.0, s[X + j], ray_y(s, j, y), 1.0)
        count = child_list(csg, camera.local, camera.sphere, child, ray, tolerance, work)
        for k in range(count):
            if tolerance < times[k] < NEVER:
                entry, code, depth = times[k], hits[k] + (k % 2), s[DEPTH + j]
                if entry < depth - tolerance or (entry <= depth + tolerance and code < s[HIT + j]):
                    s[DEPTH + j], s[HIT + j] = entry, code
                break


@kernel
def settle_row(work, m, y, tolerance, csg, camera):
    """Ask the programs where products left open whose face it is.

    Where several faces coincide, the products of a tree may disagree with it on whose face bounds the solid: what
    bounds one product may be inside the next. The place is certain, and a list of boundaries names the face.
    """
    s, times, hits = work.row, work.times, work.hits
    for k in range(m):
        j = np.uint64(k)
        hit = s[HIT + j]
        if hit < 0.0 or hit == np.floor(hit):
            continue
        s[HIT + j] = np.floor(hit)
        child = csg.child_of[int(hit / LEAF_STEP)]
        ray = Ray(0.0, 0.0, 0.0, s[X + j], ray_y(s, j, y), 1.0)
        count = child_list(csg, camera.local, camera.sphere, child, ray, tolerance, work)
        for i in range(0, count, 2):
            if times[i] > tolerance:
                if abs(times[i] - s[DEPTH + j]) <= 2.0 * tolerance:
                    s[DEPTH + j], s[HIT + j] = times[i], hits[i]
                break
