"""Compiled walk along edges in space beyond what both images' segments show, as far as the pictures go on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.settings import DECISIVE
from msgs_py.numeric.typed import BoolArray, Float32Array, FloatArray, Int32Array, IntArray
from msgs_py.settings import BOUND_SIGMA

from ..detection.line_kernels import Lines, point_at
from ..detection.settings import RUNS_INTO_SINE
from ..estimation.settings import OPEN_SIGMA
from .settings import COURSE_OFFSET, GOES_ON

# The pictures of the left and the right eye, grey levels.
Pictures = tuple[Float32Array, Float32Array]
# In which pixels of both segments are, see :func:`_marked`.
Marks = tuple[Int32Array, Int32Array]


class Courses(NamedTuple):
    """n edges along their left lines; abscissas are pixels along these.

    Attributes
    ----------
    lines : (Lines, Lines)
        All segments of the left and of the right image.
    own : (2, n) int64
        The edges' segments in the left and the right image.
    x : (n, 2) float64
        Disparity a + b s at abscissa s.
    covariance : (n, 2, 2) float64
        Of a and b.
    stop : (2, n, 2) float64
        Where the left and the right image's segment begins and ends.
    shut : (2, n, 2) bool
        The edge does not go on beyond this stop, whatever the image shows there.
    corner : (2, n, 2) bool
        Of the left and the right image: the stop is a corner, where edges end as a rule.
    taken : (k,) bool, (m,) bool
        Which of all segments of the left and of the right image show an edge.
    """

    lines: tuple[Lines, Lines]
    own: IntArray
    x: FloatArray
    covariance: FloatArray
    stop: FloatArray
    shut: BoolArray
    corner: BoolArray
    taken: tuple[BoolArray, BoolArray]


@njit
def _seen_at(courses: Courses, e: int, s: float, eye: int) -> tuple[float, float, float, float]:
    """Column and row of edge e at an abscissa in one eye's picture, and its direction there, not of unit length."""
    left, i = courses.lines[0], courses.own[0, e]
    (u, v), (du, dv) = point_at(left, i, s), left.direction[i]
    if eye == 1:
        a, b = courses.x[e]
        u, du = u - a - b * s, du - b
    return u, v, du, dv


@njit
def _marked(shape: tuple[int, int], lines: Lines) -> Int32Array:
    """(h, w) int32: one more than the segment that is in a pixel of a picture, 0 where none is."""
    result = np.zeros(shape, np.int32)
    for k in range(len(lines.centre)):
        s = lines.extent[k, 0]
        while s <= lines.extent[k, 1]:
            u, v = point_at(lines, k, s)
            if u >= 0.0 and v >= 0.0 and u < shape[1] - 1 and v < shape[0] - 1:
                result[int(v + 0.5), int(u + 0.5)] = k + 1
            s += 1.0
    return result


@njit
def _runs_into(marked: Int32Array, courses: Courses, e: int, s: float, eye: int) -> bool:
    """Whether edge e comes to another segment that goes on with it, at an abscissa inside the picture.

    A segment that no other edge has, and whose direction may be the edge's, is a part of it.
    """
    lines = courses.lines[eye]
    u, v, du, dv = _seen_at(courses, e, s, eye)
    length = np.hypot(du, dv)
    for row in range(int(v + 0.5) - 1, int(v + 0.5) + 2):
        for column in range(int(u + 0.5) - 1, int(u + 0.5) + 2):
            k = marked[row, column] - 1
            if k >= 0 and k != courses.own[eye, e]:
                apart = abs(du * lines.direction[k, 1] - dv * lines.direction[k, 0])
                turned = apart > BOUND_SIGMA * lines.sigma[k, 1] * length
                if apart < RUNS_INTO_SINE * length and (turned or courses.taken[eye][k]):
                    return True
    return False


@njit
def _across(grey: Float32Array, courses: Courses, e: int, s: float, eye: int) -> float:
    """Difference of grey levels across edge e at an abscissa in one eye's picture (h, w); NaN at its border."""
    u, v, du, dv = _seen_at(courses, e, s, eye)
    h, w = grey.shape
    if not (u >= COURSE_OFFSET and v >= COURSE_OFFSET and u < w - 1 - COURSE_OFFSET and v < h - 1 - COURSE_OFFSET):
        return np.nan
    scale = COURSE_OFFSET / max(np.hypot(du, dv), COURSE_OFFSET / w)
    one = grey[int(v + scale * du + 0.5), int(u - scale * dv + 0.5)]
    return float(one - grey[int(v - scale * du + 0.5), int(u + scale * dv + 0.5)])


@njit
def _usual(pictures: Pictures, courses: Courses, e: int, ends: FloatArray, eye: int) -> float:
    """Mean contrast of edge e between its ends (2,) in one eye's picture; 0 where it cannot be told."""
    count, total, s = 0, 0.0, ends[0] + 0.5
    while s < ends[1]:
        here = _across(pictures[eye], courses, e, s, eye)
        if not np.isnan(here):
            count, total = count + 1, total + here
        s += 1.0
    return total / count if count > 0 else 0.0


@njit
def _goes_on(
    pictures: Pictures, marked: Marks, courses: Courses, usual: tuple[float, float], e: int, end: int, s: float
) -> float:
    """What the pictures say for edge e at an abscissa beyond one of its ends; -infinity where it ends in any case.

    It is what the eye says that shows least of it; one whose segment reaches so far is not asked.
    """
    c = courses.covariance[e]
    # At two sigma its depth is open.
    if 4.0 * (c[0, 0] + 2.0 * s * c[0, 1] + s * s * c[1, 1]) > OPEN_SIGMA**2:
        return -np.inf
    least = 1.0
    for eye in range(2):
        beyond = s - courses.stop[eye, e, end]
        if (beyond if end == 1 else -beyond) <= 0.0:
            continue
        if courses.shut[eye, e, end] or usual[eye] == 0.0:
            return -np.inf
        shown = _across(pictures[eye], courses, e, s, eye)
        if np.isnan(shown) or _runs_into(marked[eye], courses, e, s, eye):
            return -np.inf
        least = min(least, max(shown / usual[eye], -1.0))
    return least - GOES_ON


@njit
def _at_corner(courses: Courses, e: int, end: int, s: float) -> float:
    """What speaks for an end of edge e at an abscissa because it is a corner there, to half a pixel."""
    for eye in range(2):
        if courses.corner[eye, e, end] and abs(courses.stop[eye, e, end] - s) <= 0.5:
            return DECISIVE
    return 0.0


@njit(nogil=True)
def follow(pictures: Pictures, courses: Courses, ends: FloatArray) -> FloatArray:
    """Where edges end if they go on as far as the pictures do.

    The sum of what both pictures show beyond an end, against an edge that has stopped, is largest where it stops.

    Parameters
    ----------
    pictures : (h, w) float32, (h, w) float32
    courses : Courses
    ends : (n, 2) float64, pixels
        Of what both images' segments show.

    Returns
    -------
    (n, 2) float64, pixels
        No end is nearer to the middle than it was.
    """
    marked = _marked(pictures[0].shape, courses.lines[0]), _marked(pictures[1].shape, courses.lines[1])
    result = ends.copy()
    for e in range(len(ends)):
        usual = _usual(pictures, courses, e, ends[e], 0), _usual(pictures, courses, e, ends[e], 1)
        for end in range(2):
            way = 1.0 if end == 1 else -1.0
            total, peak, step = 0.0, 0.0, 0
            most = _at_corner(courses, e, end, ends[e, end])
            while total > peak - DECISIVE:
                total += _goes_on(pictures, marked, courses, usual, e, end, ends[e, end] + way * (step + 0.5))
                step, peak = step + 1, max(peak, total)
                here = ends[e, end] + way * step
                likely = total + _at_corner(courses, e, end, here)
                if likely > most:
                    most, result[e, end] = likely, here
    return result
