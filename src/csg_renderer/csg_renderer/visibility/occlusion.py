"""Points that a solid hides from a viewpoint, exactly: every leaf is convex, so a ray meets it in one interval."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import BoolArray

from ..brep.settings import ON_SURFACE
from ..brep.surfaces import SurfaceTable
from .settings import LEVEL_RAY, PARALLEL_RAY, RAY_CHUNK, THIN


def hidden(table: SurfaceTable, viewpoint: np.ndarray, targets: np.ndarray, thin: float = THIN) -> np.ndarray:
    """Points that a solid hides.

    Parameters
    ----------
    table : SurfaceTable
    viewpoint : (3,) or (n, 3) float64, metres, model frame
    targets : (n, 3) float64, metres, model frame
    thin : float
        Least thickness along the ray, in model sizes, of material that hides.

    Returns
    -------
    (n,) bool
        Material of the solid stands between the viewpoint and the target.
    """
    n, m = len(targets), len(table.leaves)
    if not m or not n:
        return np.zeros(n, bool)
    origin = np.broadcast_to(table.normalised(viewpoint), (n, 3))
    ray = table.normalised(targets) - origin
    step = max(1, RAY_CHUNK // (2 * m * m + 64))
    return np.concatenate([_hidden(table, origin[i : i + step], ray[i : i + step], thin) for i in range(0, n, step)])


def first_hit(table: SurfaceTable, viewpoint: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """How far along rays a solid begins.

    Parameters
    ----------
    table : SurfaceTable
    viewpoint : (3,) float64, metres, model frame
    ray : (n, 3) float64, model frame

    Returns
    -------
    (n,) float64
        In lengths of each ray; not a number where it meets nothing.
    """
    n = len(ray)
    if not n or not len(table.leaves):
        return np.full(n, np.nan)
    enter, leave = leaf_intervals(table, np.broadcast_to(table.normalised(viewpoint), (n, 3)), ray / table.size)
    # Beyond this lies nothing: a whole solid, and the viewpoint's distance from it.
    farthest = 2.0 * (np.linalg.norm(table.normalised(viewpoint)) + 1.0) * table.size
    far = np.maximum(farthest / np.linalg.norm(ray, axis=1), 1.0)[:, None]
    enter, leave = np.clip(enter, 0.0, far), np.clip(leave, 0.0, far)
    stops = np.sort(np.concatenate([enter, leave], axis=1), axis=1)
    middle = 0.5 * (stops[:, 1:] + stops[:, :-1])
    inside = (enter[:, None, :] < middle[..., None]) & (middle[..., None] < leave[:, None, :])
    solid = table.combine(inside) & (np.diff(stops, axis=1) > 0.0)
    first = solid.argmax(axis=1)
    return np.where(solid.any(axis=1), stops[np.arange(n), first], np.nan)


def _hidden(table: SurfaceTable, origin: np.ndarray, ray: np.ndarray, thin: float) -> np.ndarray:
    """As hidden, for normalised rays (n, 3) from origins (n, 3) to their targets, all at once."""
    enter, leave = leaf_intervals(table, origin, ray)
    enter, leave = np.clip(enter, 0.0, 1.0), np.clip(leave, 0.0, 1.0)
    stops = np.sort(np.concatenate([enter, leave, np.zeros((len(ray), 1)), np.ones((len(ray), 1))], axis=1), axis=1)
    middle = 0.5 * (stops[:, 1:] + stops[:, :-1])
    inside = (enter[:, None, :] < middle[..., None]) & (middle[..., None] < leave[:, None, :])
    solid = table.combine(inside)
    thickness = np.diff(stops, axis=1) * np.linalg.norm(ray, axis=1)[:, None]
    hidden: BoolArray = (solid & (thickness > thin)).any(axis=1)
    return hidden


def leaf_intervals(table: SurfaceTable, origin: np.ndarray, ray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where rays pass each leaf of a solid.

    Parameters
    ----------
    table : SurfaceTable
        Of m leaves.
    origin, ray : (n, 3) array of float64
        Normalised frame.

    Returns
    -------
    enter, leave : (n, m) float64
        Parameters along the rays; enter > leave where a ray misses a leaf.
    """
    n, g = len(origin), len(table.planes)
    slope, value = np.zeros((n, table.groups + 1)), np.full((n, table.groups + 1), -1.0)
    slope[:, :g] = ray @ table.planes[:, :3].T
    value[:, :g] = origin @ table.planes[:, :3].T + table.planes[:, 3]
    planar = table.slots < g
    slot_slope = np.where(planar, slope[:, table.slots] * table.slot_sign, 0.0)
    slot_value = np.where(planar, value[:, table.slots] * table.slot_sign, -1.0)
    length = np.linalg.norm(ray, axis=1)[:, None, None]
    level = np.abs(slot_slope) <= PARALLEL_RAY * length
    with np.errstate(divide='ignore', invalid='ignore'):
        at = -slot_value / slot_slope
    enter = np.where(level | (slot_slope > 0.0), -np.inf, at).max(axis=2)
    leave = np.where(level | (slot_slope < 0.0), np.inf, at).min(axis=2)
    # A ray inside a face's plane passes beside the leaf: the leaf is open there.
    miss = (level & (slot_value > -ON_SURFACE)).any(axis=2)
    if len(table.quadrics):
        _narrow(table, origin, ray, slot_slope, enter, leave, miss)
    enter[miss], leave[miss] = np.inf, -np.inf
    return enter, leave


def _narrow(
    table: SurfaceTable,
    origin: np.ndarray,
    ray: np.ndarray,
    slot_slope: np.ndarray,
    enter: np.ndarray,
    leave: np.ndarray,
    miss: np.ndarray,
) -> None:
    """Cut the intervals of curved leaves down to the inside of their quadrics, in place."""
    g = len(table.planes)
    for leaf, kind in enumerate(item.kind for item in table.leaves):
        slots = table.slots[leaf]
        curved = slots[(slots >= g) & (slots < table.groups)]
        if not len(curved):
            continue
        q = table.quadrics[curved[0] - g]
        half = ray @ q[:3, :3]
        a = (half * ray).sum(axis=1)
        b = (half * origin).sum(axis=1) + ray @ q[:3, 3]
        c = ((origin @ q[:3, :3]) * origin).sum(axis=1) + 2.0 * origin @ q[:3, 3] + q[3, 3]
        flat = np.abs(a) <= LEVEL_RAY
        root = b * b - a * c
        with np.errstate(divide='ignore', invalid='ignore'):
            # The root of larger magnitude first; the other from the product, which loses no digits.
            large = -(b + np.copysign(np.sqrt(np.maximum(root, 0.0)), b))
            one, two = large / a, c / large
            single = -0.5 * c / b
        low, high = np.fmin(one, two), np.fmax(one, two)
        if kind == 'CONE':
            # A ray steeper than the cone's side is inside before the first and after the last crossing. The sign of the
            # slope of the apex plane (slot 1) along it selects the real nappe.
            steep, up = a < 0.0, slot_slope[:, leaf, 1] < 0.0
            low, high = (
                np.where(steep, np.where(up, high, -np.inf), low),
                np.where(steep, np.where(up, np.inf, low), high),
            )
            miss[:, leaf] |= ~flat & ~steep & (root <= 0.0)
        else:
            miss[:, leaf] |= ~flat & (root <= 0.0)
        falling, level = flat & (b < 0.0), flat & (np.abs(b) <= LEVEL_RAY)
        low = np.where(flat, np.where(falling, single, -np.inf), low)
        high = np.where(flat, np.where(falling | level, np.inf, single), high)
        miss[:, leaf] |= level & (c >= 0.0)
        enter[:, leaf] = np.fmax(enter[:, leaf], low)
        leave[:, leaf] = np.fmin(leave[:, leaf], high)
