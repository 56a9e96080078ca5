"""Compiled packets: which children a bundle of rays may meet at all, from bounds of its origins and directions.

Origins and directions of a packet lie in boxes. A ray of it is in a child's box only where, along every axis, some
origin and some direction of these boxes are: each axis leaves two linear inequalities in t (Wald et al. 2001, Boulos et
al. 2006: interval arithmetic for packets). A child that fails them is met by no ray of the packet.
"""

from __future__ import annotations

import math

import numpy as np

from ..settings import PACKET, TINY
from .rows import STRIDE, kernel

INF = math.inf
ONE = np.uint64(STRIDE)
# Packets of a batch, and the place of the bounds of all of it.
PACKETS = STRIDE // PACKET
WHOLE = PACKETS
# Bounds of a packet: least and greatest origin, least and greatest direction, and one over these two.
BOUNDS = 18


@kernel
def packets_of(n):
    """How many packets n rays are."""
    return (np.int64(n) + PACKET - 1) // PACKET


@kernel
def bound(s, part, n, bounds, column):
    """Bounds of vectors ``part`` of every packet and of all, into columns column..column + 5 of bounds."""
    for k in range(3):
        bounds[WHOLE, column + k], bounds[WHOLE, column + 3 + k] = INF, -INF
    for p in range(packets_of(n)):
        j0, j1 = np.uint64(p * PACKET), min(np.uint64((p + 1) * PACKET), n)
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
def beams_from(x, y, z, bounds, packets, beams):
    """Bounds of the rays from one place to the places bounds[:, :6], which they reach at t = 1, into beams."""
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
def first_places(bounds, p, far, box, first, last, place):
    """The least t in 0..far at which a ray of packet p may be in a box, INF where none ever is, into place.

    Boxes first <= k < last are considered. Along every axis two statements have to hold, which bound t from below or
    above as the sign of the direction is: t * greatest >= low - origin, and t * least <= high - origin.

    bounds : (PACKETS + 1, BOUNDS); box : (6, boxes), low x y z, high x y z
    """
    ox, oy, oz, px, py, pz = bounds[p, 3], bounds[p, 4], bounds[p, 5], bounds[p, 0], bounds[p, 1], bounds[p, 2]
    gx, gy, gz, lx, ly, lz = bounds[p, 15], bounds[p, 16], bounds[p, 17], bounds[p, 12], bounds[p, 13], bounds[p, 14]
    up_x, up_y, up_z, down_x, down_y, down_z = gx > 0.0, gy > 0.0, gz > 0.0, lx < 0.0, ly < 0.0, lz < 0.0
    for k in range(first, last):
        low, high = 0.0, far
        t = (box[0, k] - ox) * gx
        low, high = (t if up_x and t > low else low), (t if not up_x and t < high else high)
        t = (box[1, k] - oy) * gy
        low, high = (t if up_y and t > low else low), (t if not up_y and t < high else high)
        t = (box[2, k] - oz) * gz
        low, high = (t if up_z and t > low else low), (t if not up_z and t < high else high)
        t = (box[3, k] - px) * lx
        low, high = (t if down_x and t > low else low), (t if not down_x and t < high else high)
        t = (box[4, k] - py) * ly
        low, high = (t if down_y and t > low else low), (t if not down_y and t < high else high)
        t = (box[5, k] - pz) * lz
        low, high = (t if down_z and t > low else low), (t if not down_z and t < high else high)
        place[k] = low if low <= high else INF


@kernel
def place_in_order(found, order, count, child, near):
    """Insert a child, met at ``near``, into the first ``count`` found."""
    k = count
    while k > 0 and (order[k - 1] > near or (order[k - 1] == near and found[k - 1] > child)):
        found[k], order[k] = found[k - 1], order[k - 1]
        k -= 1
    found[k], order[k] = child, near


@kernel
def children_met(bounds, packets, far, csg, meeting):
    """Children that a batch may meet, from near to far: how many. Meeting : see there, its arrays are filled.

    far : the greatest t of the rays; csg : CsgPrograms
    """
    hierarchy, found, order, box, place = csg.hierarchy, meeting.found, meeting.order, meeting.box, meeting.place
    invert_bounds(bounds, packets)
    count = np.int64(0)
    node = np.int64(0)
    nodes = hierarchy.child.shape[0]
    while node < nodes:
        first_places(bounds, WHOLE, far, hierarchy.box, node, node + 1, meeting.at)
        near = meeting.at[node]
        if near == INF:
            node = hierarchy.skip[node]
            continue
        child = hierarchy.child[node]
        if child >= 0:
            place_in_order(found, order, count, child, near)
            count += 1
        node += 1
    for side in range(6):
        for k in range(count):
            box[side, k] = csg.box[side, found[k]]
    for p in range(packets):
        first_places(bounds, p, far, box, 0, count, place[p])
    return count
