"""Compiled packets: which children a bundle of rays may meet at all, from bounds of its origins and directions.

Origins and directions of a packet lie in boxes. A ray of it is in a child's box only where, along every axis, some
origin and some direction of these boxes are: each axis leaves two linear inequalities in t (Wald et al. 2001, Boulos et
al. 2006: interval arithmetic for packets). A child that fails them is met by no ray of the packet.
"""

from __future__ import annotations

import math

import numpy as np

from ..settings import PACKET, TINY
from .rows import HIT, STRIDE, kernel

INF = math.inf
ONE, ZERO = np.uint64(STRIDE), np.uint64(0)
FULL, HALF = np.uint64(PACKET), np.uint64(PACKET // 2)
# Packets of a batch at most: all but the last have at least half of PACKET rays. And the place of the bounds of all.
PACKETS = 2 * STRIDE // PACKET
WHOLE = PACKETS
# Bounds of a packet: least and greatest origin, least and greatest direction, and one over these two.
BOUNDS = 18
# Parts of Meeting.work, one after another: boxes, low x y z, high x y z, and where each is met first.
LOW_Y, LOW_Z, HIGH_X, HIGH_Y, HIGH_Z, FIRST = (np.uint64(STRIDE * k) for k in range(1, 7))
MEETING_PARTS = 7


@kernel
def cut(s, n, start):
    """Where packets of n rays begin, into start, with n behind the last one; how many.

    What leaves one face (HIT) in one way is close together; a packet that spans two faces spans all that lies between
    the ways of their rays.
    """
    packets, first = np.int64(0), ZERO
    while first < n:
        start[packets] = first
        packets += 1
        last, most = first + HALF, min(first + FULL, n)
        while last < most and s[HIT + last] == s[HIT + last - np.uint64(1)]:
            last += np.uint64(1)
        first = min(last, n)
    start[packets] = n
    return packets


@kernel
def bound(s, part, batch, bounds, column):
    """Bounds of vectors ``part`` of every packet and of all, into columns column..column + 5 of bounds.

    batch : Packets
    """
    for k in range(3):
        bounds[WHOLE, column + k], bounds[WHOLE, column + 3 + k] = INF, -INF
    for p in range(batch.many[0]):
        j0, j1 = np.uint64(batch.start[p]), np.uint64(batch.start[p + 1])
        x0, y0, z0, x1, y1, z1 = INF, INF, INF, -INF, -INF, -INF
        for j in range(j0, j1):
            x, y, z = s[part + j], s[part + ONE + j], s[part + ONE + ONE + j]
            x0, x1 = (x if x < x0 else x0), (x if x > x1 else x1)
            y0, y1 = (y if y < y0 else y0), (y if y > y1 else y1)
            z0, z1 = (z if z < z0 else z0), (z if z > z1 else z1)
        bounds[p, column], bounds[p, column + 1], bounds[p, column + 2] = x0, y0, z0
        bounds[p, column + 3], bounds[p, column + 4], bounds[p, column + 5] = x1, y1, z1
        for k in range(3):
            bounds[WHOLE, column + k] = min(bounds[WHOLE, column + k], bounds[p, column + k])
            bounds[WHOLE, column + 3 + k] = max(bounds[WHOLE, column + 3 + k], bounds[p, column + 3 + k])


@kernel
def in_boxes(place, frame):
    """A place (3,) of the scene frame, in the frame of the boxes."""
    x, y, z = place[0], place[1], place[2]
    return (
        frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z,
        frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z,
        frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z,
    )


@kernel
def beams_from(place, bounds, packets, beams):
    """Bounds of the rays from one place to the places bounds[:, :6], which they reach at t = 1, into beams."""
    x, y, z = place
    for i in range(packets + 1):
        p = i if i < packets else WHOLE
        beams[p, 0], beams[p, 1], beams[p, 2] = x, y, z
        beams[p, 3], beams[p, 4], beams[p, 5] = x, y, z
        beams[p, 6], beams[p, 7], beams[p, 8] = bounds[p, 0] - x, bounds[p, 1] - y, bounds[p, 2] - z
        beams[p, 9], beams[p, 10], beams[p, 11] = bounds[p, 3] - x, bounds[p, 4] - y, bounds[p, 5] - z


@kernel
def invert_bounds(bounds, packets):
    """One over the directions of bounds; zeros give something huge."""
    for i in range(packets + 1):
        p = i if i < packets else WHOLE
        for k in range(6, 12):
            bounds[p, k + 6] = 1.0 / (TINY if bounds[p, k] == 0.0 else bounds[p, k])


@kernel
def first_places(bounds, p, far, work, n):
    """The least t in 0..far at which a ray of packet p may be in each of n boxes, INF where none ever is.

    Along every axis two statements have to hold, which bound t from below or above as the sign of the direction is:
    t * greatest >= low - origin, and t * least <= high - origin.

    bounds : (PACKETS + 1, BOUNDS); work : parts of length STRIDE, six of the boxes and one for the answer
    """
    ox, oy, oz, px, py, pz = bounds[p, 3], bounds[p, 4], bounds[p, 5], bounds[p, 0], bounds[p, 1], bounds[p, 2]
    gx, gy, gz, lx, ly, lz = bounds[p, 15], bounds[p, 16], bounds[p, 17], bounds[p, 12], bounds[p, 13], bounds[p, 14]
    up_x, up_y, up_z, down_x, down_y, down_z = gx > 0.0, gy > 0.0, gz > 0.0, lx < 0.0, ly < 0.0, lz < 0.0
    for k in range(ZERO, n):
        low, high = 0.0, far
        t = (work[k] - ox) * gx
        after, before = (t if up_x else -INF), (INF if up_x else t)
        low, high = (after if after > low else low), (before if before < high else high)
        t = (work[LOW_Y + k] - oy) * gy
        after, before = (t if up_y else -INF), (INF if up_y else t)
        low, high = (after if after > low else low), (before if before < high else high)
        t = (work[LOW_Z + k] - oz) * gz
        after, before = (t if up_z else -INF), (INF if up_z else t)
        low, high = (after if after > low else low), (before if before < high else high)
        t = (work[HIGH_X + k] - px) * lx
        after, before = (t if down_x else -INF), (INF if down_x else t)
        low, high = (after if after > low else low), (before if before < high else high)
        t = (work[HIGH_Y + k] - py) * ly
        after, before = (t if down_y else -INF), (INF if down_y else t)
        low, high = (after if after > low else low), (before if before < high else high)
        t = (work[HIGH_Z + k] - pz) * lz
        after, before = (t if down_z else -INF), (INF if down_z else t)
        low, high = (after if after > low else low), (before if before < high else high)
        work[FIRST + k] = low if low <= high else INF


@kernel
def load_boxes(box, chosen, start, n, work):
    """Boxes chosen[start:start + n] of ``box`` (6, boxes), into the parts of work."""
    for side in range(np.uint64(6)):
        for k in range(ZERO, n):
            work[side * ONE + k] = box[side, chosen[start + np.int64(k)]]


@kernel
def place_in_order(found, order, count, child, near):
    """Insert a child, met at ``near``, into the first ``count`` found."""
    k = count
    while k > 0 and (order[k - 1] > near or (order[k - 1] == near and found[k - 1] > child)):
        found[k], order[k] = found[k - 1], order[k - 1]
        k -= 1
    found[k], order[k] = child, near


@kernel
def may_meet(bounds, node, far, box):
    """As first_places, of one box of the hierarchy and all packets."""
    low, high = 0.0, far
    for axis in range(3):
        t = (box[axis, node] - bounds[WHOLE, 3 + axis]) * bounds[WHOLE, 15 + axis]
        if bounds[WHOLE, 15 + axis] > 0.0:
            low = max(low, t)
        else:
            high = min(high, t)
        t = (box[3 + axis, node] - bounds[WHOLE, axis]) * bounds[WHOLE, 12 + axis]
        if bounds[WHOLE, 12 + axis] < 0.0:
            low = max(low, t)
        else:
            high = min(high, t)
        if low > high:
            return INF
    return low


@kernel
def children_met(bounds, packets, far, csg, meeting):
    """Children that a batch may meet, from near to far: how many. Meeting : see there, its arrays are filled.

    far : the greatest t of the rays; csg : CsgPrograms
    """
    hierarchy, found, order, work, place = csg.hierarchy, meeting.found, meeting.order, meeting.work, meeting.place
    invert_bounds(bounds, packets)
    count = np.int64(0)
    node = np.int64(0)
    nodes = hierarchy.child.shape[0]
    while node < nodes:
        near = may_meet(bounds, node, far, hierarchy.box)
        if near == INF:
            node = hierarchy.skip[node]
            continue
        child = hierarchy.child[node]
        if child >= 0:
            place_in_order(found, order, count, child, near)
            count += 1
        node += 1
    for start in range(0, count, STRIDE):
        rest = count - start
        n = np.uint64(rest if rest < STRIDE else STRIDE)
        load_boxes(csg.box, found, start, n, work)
        for p in range(packets):
            first_places(bounds, p, far, work, n)
            for k in range(ZERO, n):
                place[p, start + np.int64(k)] = work[FIRST + k]
    return count
