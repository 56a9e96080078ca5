"""Which pixels a primitive can touch: the convex hull of its outline in the image, row by row (thesis 4.9).

A tile's list of primitives and the pruned tree of thesis 4.9 follow from the rows: a leaf takes part where its span
and the tile's columns overlap. Hulls follow slanted beams closely, which bounding rectangles do not.
"""

from __future__ import annotations

import math

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int32Array, IntArray

from .programs.program import BLOCK, CONE, CYLINDER, SPHERE
from .settings import LEAST_CORNERS, MOST_CORNERS, ROUND_ERROR, SPAN_MARGIN

# No pixel of an image: beyond the last one of any row.
NOWHERE = 2**30


@njit(error_model='numpy', nogil=True)
def leaf_spans(
    points: FloatArray,
    starts: IntArray,
    near: float,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    width: int,
    spans: Int32Array,
    depths: FloatArray,
) -> None:
    """Fill spans (n, h, 2) int32, first and last pixel of each leaf in each image row, and its least depth (n,).

    points : (p, 3) float64 camera frame, corners of convex outlines; starts : (n + 1,) into points; a leaf without
    points is unbounded. near : depth of the clipping plane. An empty span has its first pixel beyond its last.
    """
    n, height = spans.shape[0], spans.shape[1]
    for leaf in range(n):
        begin, end = starts[leaf], starts[leaf + 1]
        depths[leaf] = 0.0
        if begin == end:
            for row in range(height):
                spans[leaf, row, 0], spans[leaf, row, 1] = 0, width - 1
            continue
        for row in range(height):
            spans[leaf, row, 0], spans[leaf, row, 1] = NOWHERE, -NOWHERE
        depths[leaf] = max(points[begin:end, 2].min(), 0.0)
        image = in_image(points[begin:end], near, fx, fy, cx, cy)
        if len(image) > 0:
            fill_hull(convex_hull(image), width, spans[leaf])


@njit(error_model='numpy', nogil=True)
def in_image(points: FloatArray, near: float, fx: float, fy: float, cx: float, cy: float) -> FloatArray:
    """(m, 3) pixels of the corners of a convex body, and one over their depth.

    Those behind the clipping plane are replaced by where the lines to those in front of it pierce it.
    """
    corners = len(points)
    image = np.empty((corners * (corners + 3) // 2 if points[:, 2].min() < near else corners, 3))
    count = 0
    for i in range(corners):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if z >= near:
            image[count, 0], image[count, 1], image[count, 2] = fx * x / z + cx, fy * y / z + cy, 1.0 / z
            count += 1
            continue
        for k in range(corners):
            if points[k, 2] >= near:
                f = (near - z) / (points[k, 2] - z)
                px, py = x + f * (points[k, 0] - x), y + f * (points[k, 1] - y)
                image[count, 0], image[count, 1] = fx * px / near + cx, fy * py / near + cy
                image[count, 2] = 1.0 / near
                count += 1
    return image[:count]


@njit(error_model='numpy', nogil=True)
def convex_hull(points: FloatArray) -> FloatArray:
    """(m, 3) corners of the convex hull of (k, 3) points, in order (Andrew's monotone chain): of their x and y."""
    count = points.shape[0]
    # Sorted by insertion: there are some eight points, and a general sort would have to be compiled.
    for i in range(1, count):
        x, y, w = points[i, 0], points[i, 1], points[i, 2]
        k = i - 1
        while k >= 0 and (points[k, 0] > x or (points[k, 0] == x and points[k, 1] > y)):
            points[k + 1, 0], points[k + 1, 1], points[k + 1, 2] = points[k, 0], points[k, 1], points[k, 2]
            k -= 1
        points[k + 1, 0], points[k + 1, 1], points[k + 1, 2] = x, y, w
    hull = np.empty((2 * count + 1, 3))
    size = 0
    for step in range(2):
        floor = size + (1 if step == 0 else 0)
        for i in range(count):
            p = points[i] if step == 0 else points[count - 1 - i]
            while size > floor and (
                (hull[size - 1, 0] - hull[size - 2, 0]) * (p[1] - hull[size - 2, 1])
                <= (hull[size - 1, 1] - hull[size - 2, 1]) * (p[0] - hull[size - 2, 0])
            ):
                size -= 1
            hull[size, 0], hull[size, 1], hull[size, 2] = p[0], p[1], p[2]
            size += 1
    return hull[:size]


@njit(error_model='numpy', nogil=True)
def fill_hull(hull: FloatArray, width: int, span: Int32Array) -> None:
    """Fill span (h, 2) with the pixels of each row that a convex polygon touches."""
    height = span.shape[0]
    size = hull.shape[0]
    for i in range(size):
        k = i + 1 if i + 1 < size else 0
        x0, y0, x1, y1 = hull[i, 0], hull[i, 1], hull[k, 0], hull[k, 1]
        if y0 > y1:
            x0, y0, x1, y1 = x1, y1, x0, y0
        first = int(max(0.0, math.ceil(y0 - SPAN_MARGIN)))
        last = int(min(height - 1.0, math.floor(y1 + SPAN_MARGIN)))
        slope = (x1 - x0) / (y1 - y0) if y1 > y0 else 0.0
        for row in range(first, last + 1):
            top, bottom = max(y0, row - SPAN_MARGIN), min(y1, row + SPAN_MARGIN)
            a, b = x0 + slope * (top - y0), x0 + slope * (bottom - y0)
            if y1 <= y0:
                a, b = x0, x1
            low = max(0.0, min(width + 0.0, math.ceil(min(a, b) - SPAN_MARGIN)))
            high = max(-1.0, min(width - 1.0, math.floor(max(a, b) + SPAN_MARGIN)))
            span[row, 0] = min(span[row, 0], int(low))
            span[row, 1] = max(span[row, 1], int(high))


@njit(error_model='numpy', nogil=True)
def silhouette(kind: int, m: FloatArray, origin: FloatArray, corners: int) -> FloatArray:
    """(k, 3) points of a leaf whose hull has its outline, camera frame: exact ones, so many about what is round.

    m : (3, 4) camera from unit frame; origin : (3,) the camera in the unit frame. None of what has no edge.
    """
    if kind == BLOCK:
        unit = np.empty((8, 3))
        for i in range(8):
            unit[i, 0], unit[i, 1], unit[i, 2] = float(i & 1), float(i >> 1 & 1), float(i >> 2)
    elif kind in (CYLINDER, CONE):
        unit = np.zeros((corners * (2 if kind == CYLINDER else 1) + (1 if kind == CONE else 0), 3))
        for i in range(corners):
            angle = 2.0 * math.pi * i / corners
            unit[i, 0], unit[i, 1], unit[i, 2] = math.cos(angle), math.sin(angle), 1.0
            if kind == CYLINDER:
                unit[corners + i, 0], unit[corners + i, 1] = unit[i, 0], unit[i, 1]
    elif kind == SPHERE and origin[0] ** 2 + origin[1] ** 2 + origin[2] ** 2 > 1.0:
        # Where rays touch it: a circle across the way to its centre.
        square = origin[0] ** 2 + origin[1] ** 2 + origin[2] ** 2
        distance = math.sqrt(square)
        x, y, z = origin[0] / distance, origin[1] / distance, origin[2] / distance
        # Two directions across (Duff et al. 2017).
        sign = math.copysign(1.0, z)
        a = -1.0 / (sign + z)
        b = x * y * a
        radius = math.sqrt(1.0 - 1.0 / square)
        unit = np.empty((corners, 3))
        for i in range(corners):
            angle = 2.0 * math.pi * i / corners
            u, v = radius * math.cos(angle), radius * math.sin(angle)
            unit[i, 0] = origin[0] / square + u * (1.0 + sign * x * x * a) + v * b
            unit[i, 1] = origin[1] / square + u * sign * b + v * (sign + y * y * a)
            unit[i, 2] = origin[2] / square - u * sign * x - v * y
    else:
        unit = np.zeros((0, 3))
    points = np.empty_like(unit)
    for i in range(len(unit)):
        for axis in range(3):
            points[i, axis] = m[axis, 0] * unit[i, 0] + m[axis, 1] * unit[i, 1] + m[axis, 2] * unit[i, 2] + m[axis, 3]
    return points


@njit(error_model='numpy', nogil=True)
def edge_lines(
    kind: IntArray,
    camera_T_unit: FloatArray,
    origin: FloatArray,
    near: float,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    bounds: FloatArray,
    start: IntArray,
) -> FloatArray:
    """(p, 6) edges and outlines of n leaves in the image: pixels and one over the depth of both ends.

    Fills bounds (n, 4), least and greatest column and row of each leaf, and start (n + 1,) into the edges. Circles are
    polygons whose corners are on them and whose sides are less than ROUND_ERROR pixels off them, as far as MOST_CORNERS
    allow.
    """
    n = len(kind)
    room = 0
    for leaf in range(n):
        room += 12 if kind[leaf] == BLOCK else 6 * MOST_CORNERS
    found = np.empty((room, 6))
    count = 0
    for leaf in range(n):
        start[leaf] = count
        m = camera_T_unit[leaf]
        points = silhouette(kind[leaf], m, origin[leaf], LEAST_CORNERS)
        if kind[leaf] == BLOCK:
            for i in range(8):
                for axis in range(3):
                    if i | 1 << axis > i:
                        count = add_line(found, count, points[i], points[i | 1 << axis], near, fx, fy, cx, cy)
        elif len(points) > 0:
            least, corners, size = points[:, 2].min(), LEAST_CORNERS, 0.0
            if least >= near:
                for axis in range(3):
                    size = max(size, math.sqrt(m[0, axis] ** 2 + m[1, axis] ** 2 + m[2, axis] ** 2))
                corners = int(math.pi / math.sqrt(2.0 * ROUND_ERROR / max(size * fx / least, 1.0)))
                corners = max(LEAST_CORNERS, min(MOST_CORNERS, corners))
                points = silhouette(kind[leaf], m, origin[leaf], corners)
            for first in range(0, len(points) - corners + 1, corners):
                for i in range(corners):
                    k = i + 1 if i + 1 < corners else 0
                    count = add_line(found, count, points[first + i], points[first + k], near, fx, fy, cx, cy)
            if kind[leaf] != SPHERE:
                # The sides between its circles, and to its apex, are in its outline.
                hull = convex_hull(in_image(points, near, fx, fy, cx, cy))
                for i in range(len(hull)):
                    found[count, :3], found[count, 3:] = hull[i], hull[i + 1 if i + 1 < len(hull) else 0]
                    count += 1
        ends = found[start[leaf] : count]
        bounds[leaf, 0], bounds[leaf, 1], bounds[leaf, 2], bounds[leaf, 3] = math.inf, -math.inf, math.inf, -math.inf
        for i in range(len(ends)):
            bounds[leaf, 0] = min(bounds[leaf, 0], ends[i, 0], ends[i, 3])
            bounds[leaf, 1] = max(bounds[leaf, 1], ends[i, 0], ends[i, 3])
            bounds[leaf, 2] = min(bounds[leaf, 2], ends[i, 1], ends[i, 4])
            bounds[leaf, 3] = max(bounds[leaf, 3], ends[i, 1], ends[i, 4])
    start[n] = count
    return found[:count]


@njit(error_model='numpy', nogil=True)
def add_line(
    found: FloatArray,
    count: int,
    first: FloatArray,
    last: FloatArray,
    near: float,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
) -> int:
    """Add what is in front of the clipping plane of a line between two places to the first ``count`` found."""
    if max(first[2], last[2]) < near:
        return count
    for end in range(2):
        here, there = (first, last) if end == 0 else (last, first)
        x, y, z = here[0], here[1], here[2]
        if z < near:
            f = (near - z) / (there[2] - z)
            x, y, z = x + f * (there[0] - x), y + f * (there[1] - y), near
        found[count, 3 * end] = fx * x / z + cx
        found[count, 3 * end + 1] = fy * y / z + cy
        found[count, 3 * end + 2] = 1.0 / z
    return count + 1
