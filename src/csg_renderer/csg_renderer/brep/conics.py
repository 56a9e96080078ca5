"""Candidate curves of curved solids: conics in which a plane cuts a quadric, and planes in which two quadrics meet.

A conic is kept as a (4, 3) matrix H: the point at angle t is H (cos t, sin t, 1), homogeneous, with a positive last
coordinate on the real nappe of a cone. An ellipse has last row (0, 0, 1). Everything is in the normalised frame of a
SurfaceTable.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import BoolArray, FloatArray
from msgs_py.numeric.vectors import perpendicular

from .settings import (
    AT_INFINITY,
    COSINE_MARGIN,
    CUT_MARGIN,
    ELLIPSE_ROW,
    LEAST_SLOPE,
    LONGEST_STEP,
    NEWTON_STEPS,
    NO_MEMBER,
    PARALLEL,
    PENCIL_TURN,
    PLANE_AT_INFINITY,
    RANK_TWO,
    ROOT_RESIDUAL,
    SCATTER,
    SCATTERED_IMAGINARY,
    SHARED_DIRECTION,
    SIGN_WEIGHTS,
    TOUCHING,
    UNIT_CIRCLE,
    VANISHING,
)
from .surfaces import SurfaceTable

Line = tuple[np.ndarray, np.ndarray]


def section(table: SurfaceTable, quadric: int, plane: np.ndarray) -> tuple[list[np.ndarray], list[Line]]:
    """The curves in which a plane cuts a quadric of the table.

    Parameters
    ----------
    table : SurfaceTable
    quadric : int
        Row of ``table.quadrics``.
    plane : (4,) float64, normalised
        Normal and offset.

    Returns
    -------
    conics : list of (4, 3) float64
    lines : list of (point (3,), unit direction (3,))
        Rulings, where the plane holds the direction of a cylinder or the apex of a cone.
    """
    leaf = table.quadric_leaf[quadric]
    frame, kind = table.frames[leaf], table.leaves[leaf].kind
    unit = frame.T @ plane
    normal, offset = unit[:3], unit[3]
    if kind == 'SPHERE':
        length = np.linalg.norm(normal)
        depth = -offset / length
        if abs(depth) >= 1.0 - TOUCHING:
            return [], []
        n = normal / length
        first = perpendicular(n)
        second = np.cross(n, first)
        radius = np.sqrt(1.0 - depth**2)
        return [frame @ _ellipse(depth * n, radius * first, radius * second)], []
    across = np.hypot(normal[0], normal[1])
    if kind == 'CYLINDER':
        axis = frame[:3, 2] / np.linalg.norm(frame[:3, 2])
        if abs(plane[:3] @ axis) > PARALLEL:
            slope, height = -normal[:2] / normal[2], -offset / normal[2]
            return [frame @ np.array([[1, 0, 0], [0, 1, 0], [slope[0], slope[1], height], [0, 0, 1.0]])], []
        angles = _angles(normal[0], normal[1], offset)
        return [], [_line(frame, np.array([np.cos(t), np.sin(t), 0.0]), np.array([0.0, 0.0, 1.0])) for t in angles]
    if abs(offset) <= TOUCHING * np.linalg.norm(normal):
        angles = _angles(normal[0], normal[1], normal[2])
        return [], [_line(frame, np.zeros(3), np.array([np.cos(t), np.sin(t), 1.0])) for t in angles]
    if abs(normal[2]) <= across * (1.0 + PARALLEL):
        if across - abs(normal[2]) <= PARALLEL * across and normal[2] * offset > 0.0:
            return [], []
        s = -np.sign(offset)
        return [s * frame @ np.array([[-offset, 0, 0], [0, -offset, 0], [0, 0, -offset], normal])], []
    if -offset / normal[2] < 0.0:
        return [], []
    # The highest and lowest points of the ellipse lie in the plane of symmetry; its other half-axis is level.
    u = normal[:2] / across if across > 0.0 else np.array([1.0, 0.0])
    near, far = -offset / (normal[2] + across), -offset / (normal[2] - across)
    one = np.array([u[0] * near, u[1] * near, near])
    two = np.array([-u[0] * far, -u[1] * far, far])
    centre = 0.5 * (one + two)
    half = np.sqrt(max(centre[2] ** 2 - centre[0] ** 2 - centre[1] ** 2, 0.0))
    return [frame @ _ellipse(centre, 0.5 * (one - two), half * np.array([-u[1], u[0], 0.0]))], []


def common_planes(table: SurfaceTable, one: int, two: int) -> tuple[list[np.ndarray], bool]:
    """Planes that hold all of the intersection of two quadrics.

    The quadrics Q1 + x Q2, a pencil, all pass through the intersection; one of rank 2 is a pair of planes.

    Parameters
    ----------
    table : SurfaceTable
    one, two : int
        Rows of ``table.quadrics``.

    Returns
    -------
    planes : list of (4,) float64, normalised
        Unit normal and offset.
    planar : bool
        The intersection lies in planes. It may be empty: then there are none.

    References
    ----------
    Levin, A parametric algorithm for drawing pictures of solid objects composed of quadric surfaces, 1976.
    """
    frame = table.frames[table.quadric_leaf[one]]
    a = frame.T @ table.quadrics[one] @ frame
    b = frame.T @ table.quadrics[two] @ frame
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    # A direction or apex that both quadrics share is left out: two parallel cylinders meet as two conics do.
    _, s, v = np.linalg.svd(np.concatenate([a, b]))
    basis = v[s > SHARED_DIRECTION].T
    a2, b2 = basis.T @ a @ basis, basis.T @ b @ basis
    best: tuple[float, np.ndarray] | None = None
    for weights in _degenerate(a2, b2):
        member = weights[0] * a2 + weights[1] * b2
        value, vector = np.linalg.eigh(member)
        order = np.argsort(-np.abs(value))
        value, vector = value[order], vector[:, order]
        if abs(value[0]) < NO_MEMBER or (len(value) > 2 and abs(value[2]) > RANK_TWO * abs(value[0])):
            continue
        ratio = value[1] / value[0]
        if best is None or ratio < best[0]:
            best = (ratio, np.stack([vector[:, 0] * np.sqrt(abs(value[0])), vector[:, 1] * np.sqrt(abs(value[1]))]))
        if ratio < -RANK_TWO:
            break
    if best is None:
        return [], False
    ratio, (p, q) = best
    if ratio > RANK_TWO:
        return [], True
    pair = [p] if abs(ratio) <= RANK_TWO else [p + q, p - q]
    back = np.linalg.inv(frame)
    planes = []
    for plane in (basis @ item @ back for item in pair):
        length = np.linalg.norm(plane[:3])
        if length > PLANE_AT_INFINITY * np.linalg.norm(plane):  # else the plane at infinity
            planes.append(plane / length)
    return planes, True


def conic_cuts(table: SurfaceTable, conic: np.ndarray, extra: np.ndarray) -> list[np.ndarray]:
    """The angles at which conics meet faces of leaves.

    Parameters
    ----------
    table : SurfaceTable
    conic : (n, 4, 3) float64, normalised
    extra : (k, 4) float64, normalised
        Further planes that cut every conic. Where two conics of one pair of quadrics cross there is no face that cuts
        them.

    Returns
    -------
    list of n (c,) float64
        Increasing angles in [0, 2 pi).
    """
    n, g = len(conic), len(table.planes)
    planes = np.concatenate([table.planes, extra, [[0.0, 0.0, 0.0, 1.0]]])  # the last: where a hyperbola ends
    roots, owner = [], []
    if n:
        linear = np.einsum('nij,gi->ngj', conic, planes)
        size = np.hypot(linear[..., 0], linear[..., 1])
        scale = np.linalg.norm(conic, axis=(1, 2))[:, None]
        with np.errstate(divide='ignore', invalid='ignore'):
            cosine = -linear[..., 2] / size
        met = (size > VANISHING * scale) & (np.abs(cosine) <= 1.0 + COSINE_MARGIN)
        half = np.arccos(np.clip(np.where(met, cosine, 1.0), -1.0, 1.0))
        phase = np.arctan2(linear[..., 1], linear[..., 0])
        for sign in (1.0, -1.0):
            roots.append(np.where(met, phase + sign * half, np.nan))
            owner.append(np.broadcast_to(np.append(np.arange(g), np.full(len(extra) + 1, -1)), met.shape))
    if n and len(table.quadrics):
        form = np.einsum('nia,qij,njb->nqab', conic, table.quadrics, conic)
        found = quadric_angles(form, (np.linalg.norm(conic, axis=(1, 2)) ** 2)[:, None])
        roots.append(found.reshape(n, -1))
        owner.append(np.broadcast_to(np.repeat(g + np.arange(len(table.quadrics)), 4), (n, found.shape[1] * 4)))
    if not n:
        return []
    angle = np.concatenate(roots, axis=1) % (2.0 * np.pi)
    groups = np.concatenate(owner, axis=1)
    keep = _on_leaf(table, conic, angle, groups)
    return [np.sort(angle[k][keep[k]]) for k in range(n)]


def _on_leaf(table: SurfaceTable, conic: np.ndarray, angle: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """(n, r) bool: at this angle the conic is on a leaf that owns the group (or the group is -1: no leaf needed)."""
    keep = np.zeros(angle.shape, bool)
    row, column = np.nonzero(np.isfinite(angle))
    at = evaluate(conic[row], angle[row, column])
    group = groups[row, column]
    values = table.leaf_values(table.values(at)) <= CUT_MARGIN
    owns = (table.slots[None] == group[:, None, None]).any(axis=2)
    keep[row, column] = (values.all(axis=2) & owns).any(axis=1) | (group < 0)
    return keep


def quadric_angles(form: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """The real angles t with (cos t, sin t, 1) F (cos t, sin t, 1)^T = 0.

    Parameters
    ----------
    form : (..., 3, 3) float64
        Symmetric matrices F.
    scale : (...,) float64
        Size of the terms of each form, to which zero is relative.

    Returns
    -------
    (..., 4) float64
        Angles in radians, NaN where there are fewer than four. A form that vanishes has none.

    Examples
    --------
    >>> angles = quadric_angles(np.diag([1.0, 0.0, -0.25]), np.array(1.0))  # cos(t)^2 = 1/4
    >>> np.sort(np.degrees(angles)).round(6).tolist()
    [-120.0, -60.0, 60.0, 120.0]
    """
    out = np.full(form.shape[:-2] + (4,), np.nan)
    scale = np.broadcast_to(scale, form.shape[:-2])
    top = 0.25 * (form[..., 0, 0] - form[..., 1, 1]) - 0.5j * form[..., 0, 1]
    side = form[..., 0, 2] - 1j * form[..., 1, 2]
    middle = 0.5 * (form[..., 0, 0] + form[..., 1, 1]) + form[..., 2, 2]
    second = np.abs(top) > VANISHING * scale
    if second.any():
        # In z = exp(i t) the form is a quartic; a root on the unit circle is a real angle.
        lead = top[second]
        companion = np.zeros((len(lead), 4, 4), complex)
        companion[:, 1:, :3] = np.eye(3)
        companion[:, 0, 3] = -np.conj(top[second]) / lead
        companion[:, 1, 3] = -np.conj(side[second]) / lead
        companion[:, 2, 3] = -middle[second] / lead
        companion[:, 3, 3] = -side[second] / lead
        z = np.linalg.eigvals(companion)
        out[second] = np.where(np.abs(np.abs(z) - 1.0) < UNIT_CIRCLE, np.angle(z), np.nan)
    first = ~second & (np.abs(side) > VANISHING * scale)
    with np.errstate(divide='ignore', invalid='ignore'):
        cosine = np.where(first, -middle / (2.0 * np.abs(side)), np.nan)
    half = np.arccos(np.clip(cosine, -1.0, 1.0))
    half = np.where(np.abs(cosine) <= 1.0 + COSINE_MARGIN, half, np.nan)
    out[first, 0] = (-np.angle(side) + half)[first]
    out[first, 1] = (-np.angle(side) - half)[first]
    for _ in range(NEWTON_STEPS):
        value, slope = _trigonometric(form, out)
        step = np.where(np.abs(slope) > LEAST_SLOPE * scale[..., None], value / np.where(slope == 0.0, 1.0, slope), 0.0)
        out = out - np.clip(step, -LONGEST_STEP, LONGEST_STEP)
    value, _ = _trigonometric(form, out)
    with np.errstate(invalid='ignore'):
        return np.where(np.abs(value) <= ROOT_RESIDUAL * scale[..., None], out, np.nan)


def _trigonometric(form: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Value and derivative of the form at angles (..., k)."""
    x = np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle)], axis=-1)
    dx = np.stack([-x[..., 1], x[..., 0], np.zeros_like(angle)], axis=-1)
    half = np.einsum('...ij,...kj->...ki', form, x)
    return (half * x).sum(-1), 2.0 * (half * dx).sum(-1)


def evaluate(conic: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Points on conics.

    Parameters
    ----------
    conic : (n, 4, 3) array of float64
        Columns multiply cos, sin and 1; homogeneous.
    angle : (n,) array of float64
        Radians.

    Returns
    -------
    (n, 3) float64
    """
    return positions(conic, angle)[0]


def positions(conic: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on conics with their tangents.

    Parameters
    ----------
    conic : (n, 4, 3) array of float64
    angle : (n,) array of float64
        Radians.

    Returns
    -------
    point : (n, 3) float64
        NaN at infinity.
    tangent : (n, 3) float64
        Unit, towards larger angles.
    weight : (n,) float64
        The last homogeneous coordinate.
    """
    x = np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle)], axis=-1)
    dx = np.stack([-x[..., 1], x[..., 0], np.zeros_like(angle)], axis=-1)
    p, dp = (np.einsum('nij,nj->ni', conic, v) for v in (x, dx))
    w = p[:, 3:]
    safe = np.where(np.abs(w) > AT_INFINITY, w, np.nan)
    tangent = dp[:, :3] * safe - p[:, :3] * dp[:, 3:]
    return p[:, :3] / safe, tangent / np.linalg.norm(tangent, axis=1, keepdims=True), w[:, 0]


def identity(conic: np.ndarray) -> np.ndarray:
    """What is equal for equal conics, however they are parametrised: the normalised dual conic.

    Parameters
    ----------
    conic : (n, 4, 3) array of float64

    Returns
    -------
    (n, 16) float64
    """
    dual = conic @ np.diag([1.0, 1.0, -1.0]) @ np.swapaxes(conic, 1, 2)
    dual = dual.reshape(len(conic), 16)
    dual = dual / np.linalg.norm(dual, axis=1, keepdims=True)
    sign = dual[:, :1] * SIGN_WEIGHTS[0] + dual[:, 5:6] * SIGN_WEIGHTS[1] + dual[:, 10:11] * SIGN_WEIGHTS[2]
    signed: FloatArray = dual * np.where(sign < 0.0, -1.0, 1.0)
    return signed


def is_ellipse(conic: np.ndarray) -> np.ndarray:
    """Which conics are closed and parametrised by conjugate diameters.

    Parameters
    ----------
    conic : (n, 4, 3) array of float64

    Returns
    -------
    (n,) bool
    """
    ellipse: BoolArray = (np.abs(conic[:, 3, :2]) <= ELLIPSE_ROW).all(axis=1)
    return ellipse


def _degenerate(a: np.ndarray, b: np.ndarray) -> list[tuple[float, float]]:
    """Weights of the members of the pencil that may be of rank 2: zeros of the determinant, doubled ones averaged."""
    if len(a) < 3:
        return [(1.0, 0.0)]
    # After a turn of the weights no member of interest is at infinity in general.
    c, s = np.cos(PENCIL_TURN), np.sin(PENCIL_TURN)
    a2, b2 = c * a + s * b, -s * a + c * b
    try:
        values = np.linalg.eigvals(np.linalg.solve(b2, a2))
    except np.linalg.LinAlgError:
        return []
    # (a2 - x b2) = (c + x s) a + (s - x c) b
    # A multiple zero is scattered by rounding, but the mean of its scattered copies is accurate.
    found = []
    for x in [
        values[np.abs(values - x) <= reach * (1.0 + np.abs(x))].mean().real
        for reach in SCATTER
        for x in values
        if abs(x.imag) < SCATTERED_IMAGINARY * (1.0 + abs(x))
    ]:
        weights = np.array([c + x * s, s - x * c])
        weights /= np.linalg.norm(weights)
        found.append((float(weights[0]), float(weights[1])))
    return found


def _angles(a: float, b: float, c: float) -> list[float]:
    """Angles with a cos t + b sin t + c = 0: two, one where they touch, or none."""
    size = np.hypot(a, b)
    if size <= 0.0 or abs(c) > size * (1.0 + TOUCHING):
        return []
    phase = np.arctan2(b, a)
    if abs(c) >= size * (1.0 - TOUCHING):
        return [phase if c < 0.0 else phase + np.pi]
    half = np.arccos(-c / size)
    return [phase + half, phase - half]


def _line(frame: np.ndarray, point: np.ndarray, direction: np.ndarray) -> Line:
    """A line of the unit frame, moved by frame (4, 4)."""
    d = frame[:3, :3] @ direction
    return frame[:3, :3] @ point + frame[:3, 3], d / np.linalg.norm(d)


def _ellipse(centre: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(4, 3): the ellipse about a centre with these conjugate half-diameters."""
    return np.concatenate([np.stack([first, second, centre], axis=1), [[0.0, 0.0, 1.0]]])
