"""The exact test of a data pair against a model pair: whether one rigid motion could lay both on the model features.

Two lines in space have an angle, a signed distance and two feet, where their common perpendicular meets them. A rigid
motion keeps all four, so they must agree; and between the feet each data feature must have room on its model feature.
Every number is widened by what features that :func:`.back_projection.fit_one` still accepts may differ by: what this
test refuses, no pose explains. Nearly parallel lines have no certain feet; of parallel ones the distance counts.

A relation is a row of ten numbers (distances in metres, angles in radians):
angle in [0, pi/2], its sine, signed distance, foot on a, foot on b, distance of the mid points, distance of b's mid
point from line a, of a's from line b, shift of the mid points along a, flip of b that makes the angle acute.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, ByteArray, FloatArray

from .features import CURVE
from .line_pairs import pair_geometry
from .settings import EXACTLY_PARALLEL_SINE, NOT_ZERO, ROUNDING, WIDEST_CONE

# Columns of a relation, and how many there are.
ANGLE, SINE, OFFSET, FOOT_A, FOOT_B, MIDS, FROM_A, FROM_B, SHIFT, FLIP, RELATION = range(11)


@njit
def relation(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """The relation of two features.

    Parameters
    ----------
    a, b : (9,) float64
        Features, see features.py.
    out : (10,) float64
        Filled with the relation.

    """
    c, s, d, fa, fb, flip = pair_geometry(a, b)
    wx, wy, wz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    square = wx * wx + wy * wy + wz * wz
    along_a = wx * a[3] + wy * a[4] + wz * a[5]
    along_b = wx * b[3] + wy * b[4] + wz * b[5]
    out[ANGLE], out[SINE] = np.arctan2(s, c), s
    out[OFFSET], out[FOOT_A], out[FOOT_B] = d, fa, fb
    out[MIDS] = np.sqrt(square)
    out[FROM_A] = np.sqrt(max(square - along_a * along_a, 0.0))
    out[FROM_B] = np.sqrt(max(square - along_b * along_b, 0.0))
    out[SHIFT], out[FLIP] = along_a, flip


@njit
def model_relations(rows: FloatArray) -> FloatArray:
    """Relations of all ordered pairs of model features.

    Parameters
    ----------
    rows : (e, 9) float64
        Features, see features.py.

    Returns
    -------
    (e, e, 10) float64

    """
    e = rows.shape[0]
    out = np.zeros((e, e, RELATION))
    for i in range(e):
        for j in range(e):
            relation(rows[i], rows[j], out[i, j])
    return out


@njit
def possible(
    data: FloatArray, kind_d: ByteArray, tols: FloatArray, model: FloatArray, kind_m: ByteArray, radius_tol: float
) -> BoolArray:
    """Which model features a data feature may lie on by itself: kind, length, radii.

    Parameters
    ----------
    data : (n, 9) float64
    kind_d : (n,) uint8
    tols : (n, 3) float64
        Data features and their tolerances, see features.py.
    model : (e, 9) float64
    kind_m : (e,) uint8
        Model features.
    radius_tol : float
        Metres, of curves, added to the tolerance across.

    Returns
    -------
    (n, e) bool

    """
    n, e = data.shape[0], model.shape[0]
    out = np.zeros((n, e), np.bool_)
    for a in range(n):
        for i in range(e):
            if kind_d[a] != kind_m[i]:
                continue
            if data[a, 6] * np.cos(min(tols[a, 2], WIDEST_CONE)) > model[i, 6] + tols[a, 1] + ROUNDING:
                continue
            if kind_d[a] == CURVE and (
                abs(data[a, 7] - model[i, 7]) > radius_tol + tols[a, 0] + ROUNDING
                or abs(data[a, 8] - model[i, 8]) > radius_tol + tols[a, 0] + ROUNDING
            ):
                continue
            out[a, i] = True
    return out


@njit
def margins_of(data: FloatArray, tols: FloatArray) -> FloatArray:
    """What the pair test needs to know of each data feature.

    Parameters
    ----------
    data : (n, 9) float64
    tols : (n, 3) float64
        Data features and their tolerances, see features.py.

    Returns
    -------
    (n, 8) float64
        Half length, half length that is left when tilted by the cone, tolerances across and along (metres), half cone
        angle (radians), its sine, its cosine, and its chord: the distance of two unit vectors that are so far apart.

    """
    out = np.empty((data.shape[0], 8))
    for k in range(data.shape[0]):
        half, cone = data[k, 6], min(tols[k, 2], WIDEST_CONE)
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = half, half * np.cos(cone), tols[k, 0], tols[k, 1]
        out[k, 4], out[k, 5], out[k, 6], out[k, 7] = cone, np.sin(cone), np.cos(cone), 2.0 * np.sin(0.5 * cone)
    return out


@njit
def _strays(margins: FloatArray, a: int, foot: float) -> float:
    """How far a data line may be from its model line where a foot is, beyond the feature's end."""
    return float(margins[a, 2] + margins[a, 5] * max(0.0, abs(foot) - margins[a, 0]))


@njit
def offset_slack(rel: FloatArray, margins: FloatArray, a: int, b: int) -> float:
    """By how much the distance of two crossing model lines may differ from that of the data lines (lemma 4), metres.

    Parameters
    ----------
    rel : (10,) float64
        The relation of a and b.
    margins : (n, 8) float64
        As :func:`margins_of` gives them.
    a, b : int
        The data features.

    Returns
    -------
    float
        Infinite, where the lines may be parallel.

    """
    tilt = (margins[a, 7] + margins[b, 7]) / max(rel[SINE], NOT_ZERO)
    if tilt >= 1.0:
        return np.inf
    strays = _strays(margins, a, rel[FOOT_A]) + _strays(margins, b, rel[FOOT_B])
    return float(strays + abs(rel[OFFSET]) * (1.0 - np.sqrt(1.0 - tilt * tilt)) + ROUNDING)


@njit
def pair_fits(
    rels: FloatArray,
    k: int,
    margins: FloatArray,
    a: int,
    b: int,
    halves: FloatArray,
    model_rel: FloatArray,
    i: int,
    j: int,
) -> bool:
    """Whether two data features can lie on two model features at once.

    Parameters
    ----------
    rels : (m, 10) float64
        Relations of data features.
    k : int
        The row that is the relation of a and b.
    margins : (n, 8) float64
        As :func:`margins_of` gives them.
    a, b : int
        The data features.
    halves : (e,) float64
        Metres, half lengths of the model features.
    model_rel : (e, e, 10) float64
        As :func:`model_relations` gives them.
    i, j : int
        The model features; they may be the same one.

    Returns
    -------
    bool
        False only when no rigid motion lays a on i and b on j within their tolerances (docs/proof.md, lemmas 1 to 4).

    """
    room = halves[i] - margins[a, 1] + margins[a, 3] + halves[j] - margins[b, 1] + margins[b, 3] + ROUNDING
    apart = margins[a, 2] + margins[b, 2]
    mids, model_mids = rels[k, MIDS], model_rel[i, j, MIDS]
    if abs(mids - model_mids) > room + apart:
        return False
    cone = margins[a, 4] + margins[b, 4] + ROUNDING
    angle, model_sine = rels[k, ANGLE], model_rel[i, j, SINE]
    straight = abs(angle - model_rel[i, j, ANGLE]) <= cone
    crossed = abs(np.pi - angle - model_rel[i, j, ANGLE]) <= cone
    if not straight and not crossed:
        return False
    if model_sine < EXACTLY_PARALLEL_SINE:
        # The model lines are parallel, or one line: their distance is the same everywhere.
        loose = ROUNDING + EXACTLY_PARALLEL_SINE * 4.0 * (mids + model_mids + halves[i] + halves[j] + apart)
        between = model_rel[i, j, FROM_A]
        strays_a = _strays(margins, a, rels[k, SHIFT]) + margins[b, 2] + loose
        strays_b = _strays(margins, b, mids) + margins[a, 2] + loose
        from_a, from_b = rels[k, FROM_A], rels[k, FROM_B]
        return bool(
            from_a * margins[a, 6] <= between + strays_a
            and from_b * margins[b, 6] <= between + strays_b
            and between <= min(from_a + strays_a, from_b + strays_b)
        )
    # How far the common normals of the data lines and of the model lines may be from each other: the sine.
    tilt = (margins[a, 7] + margins[b, 7]) / max(rels[k, SINE], NOT_ZERO)
    if tilt >= 1.0:
        return True
    offset, model_offset = rels[k, OFFSET], model_rel[i, j, OFFSET]
    foot_a, foot_b = rels[k, FOOT_A], rels[k, FOOT_B]
    strays = _strays(margins, a, foot_a) + _strays(margins, b, foot_b)
    slides = (strays + abs(offset) * tilt) / model_sine + ROUNDING
    room_a = halves[i] - margins[a, 1] + margins[a, 3] + (1.0 - margins[a, 6]) * abs(foot_a) + slides
    room_b = halves[j] - margins[b, 1] + margins[b, 3] + (1.0 - margins[b, 6]) * abs(foot_b) + slides
    strays += abs(offset) * (1.0 - np.sqrt(1.0 - tilt * tilt)) + ROUNDING
    model_a, model_b = model_rel[i, j, FOOT_A], model_rel[i, j, FOOT_B]
    if (
        straight
        and abs(offset - model_offset) <= strays
        and (
            (abs(model_a - foot_a) <= room_a and abs(model_b - foot_b) <= room_b)
            or (abs(model_a + foot_a) <= room_a and abs(model_b + foot_b) <= room_b)
        )
    ):
        return True
    return bool(
        crossed
        and abs(offset + model_offset) <= strays
        and (
            (abs(model_a - foot_a) <= room_a and abs(model_b + foot_b) <= room_b)
            or (abs(model_a + foot_a) <= room_a and abs(model_b - foot_b) <= room_b)
        )
    )
