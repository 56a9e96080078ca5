"""Occluding contours of the round surfaces that facets stand for: compiled.

An edge of a facet is bent to the cubic that leaves its ends at right angles to the normals there; a circle is met to
the sixth power of the angle between two facets. Along it the surface turns away from the eye at one place, and from
such place to place across the facets the contour is bent in the same way. So it is smooth where the facets' own border
between front and back is a zigzag.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array

from ..mesh.normals import RoundFacets
from .settings import CLEAR_OF_FACET, CROSSING_TURNS, LEAST_LENGTH


class Wires(NamedTuple):
    """Curves from vertex to vertex, model frame, metres.

    Attributes
    ----------
    flat : (k, 3) float64
        Vertices where the triangles have them: between two of them the curve, straightened, lies in the mesh.
    point : (k, 3) float64
        Where the surface has them.
    leave, arrive : (k, 3) float64
        Derivatives at both ends of the piece from each vertex to the next, which is a cubic from 0 to 1.
    away : (k, 3) float64
        By how much a point of that piece is moved before it is asked what hides it; zero on creases, which facets
        meet and do not cover.
    normal : (k, 3) float64
        Unit normals of the surface at vertices of contours; zero on creases.
    begin : (c + 1,) int32
        First vertex of each curve, and the end of the last.
    """

    flat: FloatArray
    point: FloatArray
    leave: FloatArray
    arrive: FloatArray
    away: FloatArray
    normal: FloatArray
    begin: Int32Array


@njit(nogil=True)
def mesh_contours(surface: RoundFacets, eye: FloatArray, clearance: float) -> Wires:
    """The occluding contours as one eye sees them; hidden parts are not removed.

    Parameters
    ----------
    surface : RoundFacets
    eye : (3,) float64, metres, model frame
    clearance : float
        Metres above the surface from which a point of it is seen.

    Returns
    -------
    Wires
    """
    facing = np.empty(len(surface.point))
    for k in range(len(facing)):
        p, n = surface.point[k], surface.normal[k]
        facing[k] = n[0] * (p[0] - eye[0]) + n[1] * (p[1] - eye[1]) + n[2] * (p[2] - eye[2])
    crosses = np.zeros(len(surface.edge), np.bool_)
    crossed = np.empty(len(surface.edge), np.int32)
    crossings = 0
    for e in range(len(surface.edge)):
        a, b = surface.edge[e, 0], surface.edge[e, 1]
        if (facing[a] < 0.0) != (facing[b] < 0.0) and not (surface.sharp[a] or surface.sharp[b]):
            crosses[e] = True
            crossed[crossings] = e
            crossings += 1
    # Two facets at most at each edge, and a point more for each chain of them.
    room = 4 * crossings
    wires = Wires(
        np.empty((room, 3)),
        np.empty((room, 3)),
        np.zeros((room, 3)),
        np.zeros((room, 3)),
        np.zeros((room, 3)),
        np.empty((room, 3)),
        np.zeros(room + 1, np.int32),
    )
    passed = np.zeros(len(surface.facet), np.bool_)
    n, curves = 0, 0
    # From sharp points, then from where a surface ends, then what is closed.
    for turn in range(3):
        for e in crossed[:crossings]:
            facet, other = surface.side[e, 0], surface.side[e, 1]
            if turn == 0:
                if _sharp_corner(surface, facet) < 0:
                    facet, other = other, facet
                if facet < 0 or _sharp_corner(surface, facet) < 0:
                    continue
            elif turn == 1 and other >= 0:
                continue
            if passed[facet]:
                continue
            _crossing(surface, e, facing, eye, wires, n)
            if turn == 0:
                # The point comes first, and then what lies beyond the edge.
                _copy(wires, n, n + 1)
                _to_point(surface, facet, wires, n)
                passed[facet] = True
                wires.away[n, 0] = surface.bulge[facet]
                facet = other
                n += 1
            n = _followed(surface, e, facet, crosses, passed, facing, eye, wires, n)
            curves += 1
            wires.begin[curves] = n
    for c in range(curves):
        for k in range(wires.begin[c], wires.begin[c + 1] - 1):
            bend(wires.point, k, k + 1, wires.normal[k], wires.normal[k + 1], wires.leave[k], wires.arrive[k])
            up = clearance + CLEAR_OF_FACET * wires.away[k, 0]
            for i in range(3):
                wires.away[k, i] = up * 0.5 * (wires.normal[k, i] + wires.normal[k + 1, i])
    return Wires(
        wires.flat[:n],
        wires.point[:n],
        wires.leave[:n],
        wires.arrive[:n],
        wires.away[:n],
        wires.normal[:n],
        wires.begin[: curves + 1],
    )


@njit(nogil=True)
def _followed(
    surface: RoundFacets,
    edge: int,
    facet: int,
    crosses: BoolArray,
    passed: BoolArray,
    facing: FloatArray,
    eye: FloatArray,
    wires: Wires,
    n: int,
) -> int:
    """Go on with a contour from vertex n, on an edge, into a facet: the number of vertices then.

    crosses : edges that contours cross; passed : facets that have been, filled in; facing : see :func:`mesh_contours`.
    The bulge of each facet is left in the first place of ``away``.
    """
    while facet >= 0 and not passed[facet]:
        passed[facet] = True
        wires.away[n, 0] = surface.bulge[facet]
        out = -1
        for k in range(3):
            if surface.border[facet, k] != edge and crosses[surface.border[facet, k]]:
                out = surface.border[facet, k]
        n += 1
        if out < 0:
            _copy(wires, n - 1, n)
            _to_point(surface, facet, wires, n)
            break
        edge = out
        _crossing(surface, edge, facing, eye, wires, n)
        facet = surface.side[edge, 1] if surface.side[edge, 0] == facet else surface.side[edge, 0]
    return n + 1


@njit(nogil=True)
def _copy(wires: Wires, row: int, to: int) -> None:
    """Put the vertex of one row into another."""
    for i in range(3):
        wires.flat[to, i], wires.point[to, i] = wires.flat[row, i], wires.point[row, i]
        wires.normal[to, i] = wires.normal[row, i]


@njit(nogil=True)
def _sharp_corner(surface: RoundFacets, facet: int) -> int:
    """The sharp corner of a facet, -1 of one that has none."""
    for k in range(3):
        if surface.sharp[surface.facet[facet, k]]:
            return int(surface.facet[facet, k])
    return -1


@njit(nogil=True)
def _to_point(surface: RoundFacets, facet: int, wires: Wires, row: int) -> None:
    """Put the sharp corner of a facet into a row of wires: a ruling goes straight up to it, its normal with it."""
    corner = max(_sharp_corner(surface, facet), 0)
    for i in range(3):
        wires.flat[row, i] = wires.point[row, i] = surface.point[corner, i]


@njit(nogil=True)
def bend(
    point: FloatArray, a: int, b: int, normal_a: FloatArray, normal_b: FloatArray, leave: FloatArray, arrive: FloatArray
) -> None:
    """Derivatives (3,), filled in, of the cubic between two rows of points that is at right angles to two normals."""
    chord = 0.0
    along_a = along_b = 0.0
    for i in range(3):
        step = point[b, i] - point[a, i]
        chord += step * step
        along_a += step * normal_a[i]
        along_b += step * normal_b[i]
    for i in range(3):
        step = point[b, i] - point[a, i]
        leave[i], arrive[i] = step - along_a * normal_a[i], step - along_b * normal_b[i]
    lengthen(leave, arrive, math.sqrt(chord))


@njit(nogil=True)
def lengthen(leave: FloatArray, arrive: FloatArray, chord: float) -> None:
    """Give two directions (3,) the lengths with which a cubic over a chord (metres) is an arc, as nearly as it can."""
    one = two = both = 0.0
    for i in range(3):
        one += leave[i] * leave[i]
        two += arrive[i] * arrive[i]
        both += leave[i] * arrive[i]
    one, two = math.sqrt(max(one, LEAST_LENGTH**2)), math.sqrt(max(two, LEAST_LENGTH**2))
    half = math.sqrt(max(0.5 + 0.5 * both / (one * two), 0.0))
    length = chord / (0.5 + 0.5 * half)
    for i in range(3):
        leave[i] *= length / one
        arrive[i] *= length / two


@njit(nogil=True)
def _crossing(surface: RoundFacets, e: int, facing: FloatArray, eye: FloatArray, wires: Wires, row: int) -> None:
    """Put where the surface turns away along an edge into a row of wires."""
    a, b = surface.edge[e, 0], surface.edge[e, 1]
    pa, pb, na, nb = surface.point[a], surface.point[b], surface.normal[a], surface.normal[b]
    leave, arrive = np.empty(3), np.empty(3)
    bend(surface.point, a, b, na, nb, leave, arrive)
    low, high, at_low, at_high = 0.0, 1.0, facing[a], facing[b]
    s, kept = 0.5, 0
    for _ in range(CROSSING_TURNS):
        # Regula falsi; an end that stays twice counts half (Illinois).
        s = (low * at_high - high * at_low) / (at_high - at_low)
        value = 0.0
        _on_edge(pa, pb, leave, arrive, na, nb, s, wires.point[row], wires.normal[row])
        for i in range(3):
            value += wires.normal[row, i] * (wires.point[row, i] - eye[i])
        if (value < 0.0) == (at_low < 0.0):
            low, at_low = s, value
            if kept == 1:
                at_high *= 0.5
            kept = 1
        else:
            high, at_high = s, value
            if kept == -1:
                at_low *= 0.5
            kept = -1
    for i in range(3):
        wires.flat[row, i] = pa[i] + s * (pb[i] - pa[i])


@njit(nogil=True)
def _on_edge(
    pa: FloatArray,
    pb: FloatArray,
    leave: FloatArray,
    arrive: FloatArray,
    na: FloatArray,
    nb: FloatArray,
    s: float,
    point: FloatArray,
    normal: FloatArray,
) -> None:
    """A point at s on a bent edge, and the unit normal there, filled in."""
    h0, h1, h2, h3 = cubic(s)
    d0, d1, d2, d3 = cubic_slope(s)
    square = along = length = 0.0
    for i in range(3):
        point[i] = h0 * pa[i] + h1 * leave[i] + h2 * pb[i] + h3 * arrive[i]
        slope = d0 * pa[i] + d1 * leave[i] + d2 * pb[i] + d3 * arrive[i]
        square += slope * slope
        along += slope * ((1.0 - s) * na[i] + s * nb[i])
    for i in range(3):
        slope = d0 * pa[i] + d1 * leave[i] + d2 * pb[i] + d3 * arrive[i]
        normal[i] = (1.0 - s) * na[i] + s * nb[i] - along / max(square, LEAST_LENGTH**2) * slope
        length += normal[i] * normal[i]
    length = math.sqrt(max(length, LEAST_LENGTH**2))
    for i in range(3):
        normal[i] /= length


@njit(nogil=True)
def cubic(s: float) -> tuple[float, float, float, float]:
    """What the first point, its derivative, the second point and its derivative count at s of a cubic."""
    t = 1.0 - s
    return t * t * (1.0 + 2.0 * s), s * t * t, s * s * (3.0 - 2.0 * s), -s * s * t


@njit(nogil=True)
def cubic_slope(s: float) -> tuple[float, float, float, float]:
    """What they count in its derivative."""
    t = 1.0 - s
    return -6.0 * s * t, t * (1.0 - 3.0 * s), 6.0 * s * t, s * (3.0 * s - 2.0)
