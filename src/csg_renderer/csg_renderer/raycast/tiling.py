"""Which pixels a primitive can touch: the convex hull of its outline in the image, row by row (thesis 4.9).

A tile's list of primitives and the pruned tree of thesis 4.9 follow from the rows: a leaf takes part where its span
and the tile's columns overlap. Hulls follow slanted beams closely, which bounding rectangles do not.
"""

from __future__ import annotations

import math

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int32Array, IntArray

from .settings import SPAN_MARGIN

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
        image = np.empty(((end - begin) * (end - begin + 3) // 2, 2))
        count = 0
        least = math.inf
        for i in range(begin, end):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            least = min(least, z)
            if z >= near:
                image[count, 0], image[count, 1] = fx * x / z + cx, fy * y / z + cy
                count += 1
                continue
            # Behind the clipping plane: where the lines to the points in front of it pierce it.
            for k in range(begin, end):
                if points[k, 2] >= near:
                    f = (near - z) / (points[k, 2] - z)
                    px, py = x + f * (points[k, 0] - x), y + f * (points[k, 1] - y)
                    image[count, 0], image[count, 1] = fx * px / near + cx, fy * py / near + cy
                    count += 1
        depths[leaf] = max(least, 0.0)
        if count > 0:
            fill_hull(convex_hull(image[:count]), width, spans[leaf])


@njit(error_model='numpy', nogil=True)
def convex_hull(points: FloatArray) -> FloatArray:
    """(m, 2) corners of the convex hull of (k, 2) points, in order (Andrew's monotone chain)."""
    count = points.shape[0]
    # Sorted by insertion: there are some eight points, and a general sort would have to be compiled.
    for i in range(1, count):
        x, y = points[i, 0], points[i, 1]
        k = i - 1
        while k >= 0 and (points[k, 0] > x or (points[k, 0] == x and points[k, 1] > y)):
            points[k + 1, 0], points[k + 1, 1] = points[k, 0], points[k, 1]
            k -= 1
        points[k + 1, 0], points[k + 1, 1] = x, y
    hull = np.empty((2 * count + 1, 2))
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
            hull[size, 0], hull[size, 1] = p[0], p[1]
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
