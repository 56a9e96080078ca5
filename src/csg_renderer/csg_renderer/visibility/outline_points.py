"""Points evenly spaced in the image along creases and contours, and which of them are seen: compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int32Array

from ..brep.settings import APEX_SLOPE
from ..brep.surfaces import SurfaceRows
from .contours import Quadrics, polar_sections
from .occlusion import RayWork, ahead_and_behind, hides, may_bound, ray_work
from .settings import OFF_SURFACE, OUTLINE_KNOTS, THIN, THIN_AT_SPACE_CURVE


class Creases(NamedTuple):
    """The creases of a solid, model frame, metres.

    Attributes
    ----------
    matrix : (c, 4, 3) float64
        An edge is a + t b, a conic H (cos t, sin t, 1): both are a homogeneous matrix times three functions of t. Of an
        edge column 1 is zero.
    span : (c, 2) float64
        Their ranges of t.
    feature : (c,) int32
        Row of ``model_features`` that each is, -1 for what is none.
    chain : (k, 3) float64
        Points along creases in no plane, those of each together.
    begin : (s + 1,) int32
        Where in ``chain`` each of them begins, and the end of the last.
    """

    matrix: FloatArray
    span: FloatArray
    feature: Int32Array
    chain: FloatArray
    begin: Int32Array


@njit(nogil=True)
def seen_points(
    surfaces: SurfaceRows, quadrics: Quadrics, creases: Creases, camera: FloatArray, spacing: float
) -> tuple[int, FloatArray, Int32Array]:
    """Points of the creases and contours that a camera sees.

    Parameters
    ----------
    surfaces : SurfaceRows
    quadrics : Quadrics
        Of the same solid.
    creases : Creases
    camera : (18,) float64
        camera_R_model by rows, times the scale of the model, camera_t_model, fx, fy, cx, cy, width, height.
    spacing : float
        Pixels between neighbouring points.

    Returns
    -------
    n : int
        How many there are.
    rows : (m, 10) float64
        Of the first n: point (metres), unit tangent, unit normal out of the surface (zero on creases), pixels that it
        stands for; model frame.
    numbers : (m, 2) int32
        Of the first n: curve (creases, then contours, then creases in no plane) and feature.
    """
    centre, size = surfaces.centre, surfaces.size
    eye = np.empty(3)
    scale = camera[0] * camera[0] + camera[1] * camera[1] + camera[2] * camera[2]
    for i in range(3):
        at = -(camera[i] * camera[9] + camera[3 + i] * camera[10] + camera[6 + i] * camera[11]) / scale
        eye[i] = (at - centre[i]) / size
    most = 2 * len(quadrics.kind)
    polar, quadric = np.empty((most, 4, 3)), np.empty(most, np.int32)
    contours = polar_sections(quadrics, eye, polar, quadric)
    planar = len(creases.matrix)
    smooth = planar + contours
    curves = smooth + len(creases.begin) - 1
    for k in range(contours):
        for j in range(3):
            for i in range(3):
                polar[k, i, j] = size * polar[k, i, j] + centre[i] * polar[k, 3, j]
    begin, parameter, along = _knots(creases, polar, contours, camera)
    room = 0
    for c in range(curves):
        room += math.ceil(along[begin[c + 1] - 1] / spacing)
    rows, numbers = np.empty((room, 10)), np.empty((room, 2), np.int32)
    work = ray_work(surfaces, eye)
    n = 0
    for c in range(curves):
        total, j = along[begin[c + 1] - 1], begin[c]
        count = math.ceil(total / spacing)
        for rank in range(count):
            want = (rank + 0.5) * total / count
            while j < begin[c + 1] - 2 and along[j + 1] < want:
                j += 1
            gap = along[j + 1] - along[j]
            part = (want - along[j]) / gap if gap > 0.0 else 0.0
            t = parameter[j] + part * (parameter[j + 1] - parameter[j])
            if c < planar:
                _on_curve(creases.matrix, c, t, rows, n)
            elif c < smooth:
                _on_curve(polar, c - planar, t, rows, n)
            else:
                _on_chain(creases, c - smooth, t, rows, n)
            x, y, z = (rows[n, 0] - centre[0]) / size, (rows[n, 1] - centre[1]) / size, (rows[n, 2] - centre[2]) / size
            nx, ny, nz = 0.0, 0.0, 0.0
            if planar <= c < smooth:
                nx, ny, nz = _outward(surfaces, work, quadric[c - planar], x, y, z)
                if nx == 0.0 and ny == 0.0 and nz == 0.0:
                    continue
            thin = THIN if c < smooth else THIN_AT_SPACE_CURVE
            if hides(surfaces, work, x - eye[0], y - eye[1], z - eye[2], thin):
                continue
            rows[n, 6], rows[n, 7], rows[n, 8], rows[n, 9] = nx, ny, nz, total / count
            numbers[n, 0], numbers[n, 1] = c, creases.feature[c] if c < planar else -1
            n += 1
    return n, rows, numbers


@njit(nogil=True)
def _outward(
    surfaces: SurfaceRows, work: RayWork, which: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """The unit normal at a point of a quadric, out of the solid; zero where the quadric does not bound it."""
    if not may_bound(surfaces, which, x, y, z):
        return 0.0, 0.0, 0.0
    q = surfaces.quadrics[which]
    nx = q[0, 0] * x + q[0, 1] * y + q[0, 2] * z + q[0, 3]
    ny = q[1, 0] * x + q[1, 1] * y + q[1, 2] * z + q[1, 3]
    nz = q[2, 0] * x + q[2, 1] * y + q[2, 2] * z + q[2, 3]
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if not length > APEX_SLOPE:
        return 0.0, 0.0, 0.0
    nx, ny, nz = nx / length, ny / length, nz / length
    ahead, behind = ahead_and_behind(surfaces, work, x, y, z, OFF_SURFACE * nx, OFF_SURFACE * ny, OFF_SURFACE * nz)
    if ahead == behind:
        return 0.0, 0.0, 0.0
    return (-nx, -ny, -nz) if ahead else (nx, ny, nz)


@njit(nogil=True)
def _straight(matrix: FloatArray, c: int) -> bool:
    """Whether a curve is a line."""
    line: bool = matrix[c, 0, 1] == 0.0 and matrix[c, 1, 1] == 0.0 and matrix[c, 2, 1] == 0.0 and matrix[c, 3, 1] == 0.0
    return line


@njit(nogil=True)
def _knots(
    creases: Creases, polar: FloatArray, contours: int, camera: FloatArray
) -> tuple[Int32Array, FloatArray, FloatArray]:
    """Knots along the image of each curve; what lies behind the camera or outside the image has no length.

    Returns
    -------
    begin : (curves + 1,) int32
        First knot of each curve, and the end of the last.
    parameter, along : (k,) float64
        Parameter of each knot, and pixels from the curve's first one.
    """
    planar, chains = len(creases.matrix), len(creases.begin) - 1
    smooth = planar + contours
    total = smooth * OUTLINE_KNOTS + len(creases.chain)
    begin, parameter, along = np.empty(smooth + chains + 1, np.int32), np.empty(total), np.empty(total)
    m = np.empty((4, 3))
    for c in range(smooth):
        begin[c] = c * OUTLINE_KNOTS
        matrix, row = (creases.matrix, c) if c < planar else (polar, c - planar)
        straight = _straight(matrix, row)
        low, high = 0.0, 1.0 if straight else 2.0 * math.pi
        if c < planar:
            low, high = creases.span[c, 0], creases.span[c, 1]
        # Homogeneous points of the curve in the camera's frame.
        for j in range(3):
            for i in range(3):
                m[i, j] = camera[9 + i] * matrix[row, 3, j]
                for k in range(3):
                    m[i, j] += camera[3 * i + k] * matrix[row, k, j]
            m[3, j] = matrix[row, 3, j]
        for k in range(OUTLINE_KNOTS):
            t = low + k / (OUTLINE_KNOTS - 1) * (high - low)
            parameter[begin[c] + k] = t
            a, b = (t, 0.0) if straight else (math.cos(t), math.sin(t))
            w = m[3, 0] * a + m[3, 1] * b + m[3, 2]
            x, y = m[0, 0] * a + m[0, 1] * b + m[0, 2], m[1, 0] * a + m[1, 1] * b + m[1, 2]
            z = m[2, 0] * a + m[2, 1] * b + m[2, 2]
            if k == 0:
                length, u, v = 0.0, math.nan, math.nan
            step, u, v = image_step(camera, x / w, y / w, z / w, u, v)
            length += step
            along[begin[c] + k] = length
    for s in range(chains):
        begin[smooth + s] = smooth * OUTLINE_KNOTS + creases.begin[s]
        length, u, v = 0.0, math.nan, math.nan
        for k in range(creases.begin[s], creases.begin[s + 1]):
            x, y, z = creases.chain[k, 0], creases.chain[k, 1], creases.chain[k, 2]
            step, u, v = image_step(
                camera,
                camera[0] * x + camera[1] * y + camera[2] * z + camera[9],
                camera[3] * x + camera[4] * y + camera[5] * z + camera[10],
                camera[6] * x + camera[7] * y + camera[8] * z + camera[11],
                u,
                v,
            )
            length += step
            parameter[smooth * OUTLINE_KNOTS + k], along[smooth * OUTLINE_KNOTS + k] = k - creases.begin[s], length
    begin[smooth + chains] = total
    return begin, parameter, along


@njit(nogil=True)
def image_step(
    camera: FloatArray, x: float, y: float, z: float, before_u: float, before_v: float
) -> tuple[float, float, float]:
    """Pixels from the one before to where a camera sees a point of its frame, and that pixel.

    The step is none where both lie outside the image or one of them behind the camera, which is no number.
    """
    if not z > 0.0:
        return 0.0, math.nan, math.nan
    u, v = camera[12] * x / z + camera[14], camera[13] * y / z + camera[15]
    if math.isnan(before_u) or not (_contains(camera, u, v) or _contains(camera, before_u, before_v)):
        return 0.0, u, v
    return math.sqrt((u - before_u) ** 2 + (v - before_v) ** 2), u, v


@njit(nogil=True)
def _contains(camera: FloatArray, u: float, v: float) -> bool:
    """Whether a pixel is in the image."""
    return u >= -0.5 and v >= -0.5 and u <= camera[16] - 0.5 and v <= camera[17] - 0.5


@njit(nogil=True)
def _on_curve(matrix: FloatArray, c: int, t: float, rows: FloatArray, n: int) -> None:
    """A point of curve c and the unit tangent there, into the first six places of row n."""
    if _straight(matrix, c):
        a, b, da, db = t, 0.0, 1.0, 0.0
    else:
        a, b = math.cos(t), math.sin(t)
        da, db = -b, a
    w = matrix[c, 3, 0] * a + matrix[c, 3, 1] * b + matrix[c, 3, 2]
    dw = matrix[c, 3, 0] * da + matrix[c, 3, 1] * db
    square = 0.0
    for i in range(3):
        rows[n, i] = (matrix[c, i, 0] * a + matrix[c, i, 1] * b + matrix[c, i, 2]) / w
        rows[n, 3 + i] = matrix[c, i, 0] * da + matrix[c, i, 1] * db - rows[n, i] * dw
        square += rows[n, 3 + i] * rows[n, 3 + i]
    for i in range(3, 6):
        rows[n, i] /= math.sqrt(square)


@njit(nogil=True)
def _on_chain(creases: Creases, s: int, t: float, rows: FloatArray, n: int) -> None:
    """A point of polyline s and the unit tangent there, into the first six places of row n."""
    low = creases.begin[s] + min(int(t), creases.begin[s + 1] - creases.begin[s] - 2)
    part = t - (low - creases.begin[s])
    square = 0.0
    for i in range(3):
        step = creases.chain[low + 1, i] - creases.chain[low, i]
        rows[n, i], rows[n, 3 + i] = creases.chain[low, i] + part * step, step
        square += step * step
    for i in range(3, 6):
        rows[n, i] /= math.sqrt(square)
