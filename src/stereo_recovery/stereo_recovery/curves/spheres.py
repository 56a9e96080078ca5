"""Outlines of balls: they look like circles that face us, and are no curves of the object.

What one eye sees of a ball is a cone that touches it. Two such cones meet in a plane, so that there is a planar curve
with just these two pictures: nearly a circle, square to the line of sight. A ball explains the same edgels with four
numbers instead of six, and a disc that faces us is told from it by being seen slightly from the side by either eye.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from msgs_py import StereoRig

from ..detection.conics import sampson
from ..detection.edgels import Edgels
from .curve import Curve
from .recovery import distances

# Curves that face the eyes less squarely than this, cosine, are no outlines of balls; a fit to most of an outline, this
# share of it, faces them better.
FACING, WHOLE_FACING, WHOLE = 0.75, 0.98, 0.7
# A ball is believed when it leaves at most so much more than the curve does (truncated at so many sigma, squares).
AS_GOOD, TRUNCATED = 1.5, 4.0
# Curves of which more than this share of edgels lies this near to a ball's outlines, pixels, are segments of them.
MOST, NEAR = 0.6, 0.7
# An edgel's direction counts as across the outline from this cosine.
ACROSS = 0.94


def without_balls(curves: list[Curve], edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float) -> list[Curve]:
    """The curves that are no outlines of balls.

    edgels : of both images; blur : variance, px^2, of the smoothing, see :func:`.curve_fit.refine`.
    """
    balls = [ball for curve in curves if (ball := _ball(curve, edgels, rig, blur)) is not None]
    on = [_on_outline(ball, edgels, rig, blur) for ball in balls]
    return [
        c for c in curves if not any(left[c.left].mean() > MOST and right[c.right].mean() > MOST for left, right in on)
    ]


def _ball(curve: Curve, edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float) -> np.ndarray | None:
    """(4,) centre, left frame, and radius, metres, of the ball that explains a curve's edgels; None if none does."""
    middle = curve.centre - [0.5 * rig.baseline, 0.0, 0.0]
    facing = WHOLE_FACING if curve.coverage > WHOLE else FACING
    if curve.radii[1] < FACING * curve.radii[0] or abs(curve.normal @ middle) < facing * np.linalg.norm(middle):
        return None
    mine = edgels[0].select(curve.left), edgels[1].select(curve.right)
    if min(len(e) for e in mine) < 8:
        return None
    sigma = np.concatenate([e.sigma_position for e in mine])
    scale = float(curve.radii[0])

    def off(numbers: np.ndarray) -> np.ndarray:
        return np.concatenate(_distances(numbers * scale, mine, rig, blur)) / sigma

    start = np.append(curve.centre, curve.radii.mean()) / scale
    found = least_squares(off, start, loss='soft_l1', f_scale=2.0, max_nfev=12)
    ball = found.x * scale
    if not (ball[3] > 0.0 and np.linalg.norm(ball[:3]) > 1.5 * ball[3] and ball[2] > 0.0):
        return None
    left = np.minimum(off(found.x) ** 2, TRUNCATED**2).sum()
    usual = (
        np.concatenate([distances(curve, e.position, rig, eye, blur) for e, eye in zip(mine, (0.0, rig.baseline))])
        / sigma
    )
    return ball if left < AS_GOOD * np.minimum(usual**2, TRUNCATED**2).sum() else None


def _conic(ball: np.ndarray, matrix: np.ndarray, eye: float) -> np.ndarray:
    """(3, 3): the outline that a camera at (eye, 0, 0) sees, negative inside."""
    centre = ball[:3] - [eye, 0.0, 0.0]
    inverse = np.linalg.inv(matrix)
    cone = (centre @ centre - ball[3] ** 2) * np.eye(3) - np.outer(centre, centre)
    conic = inverse.T @ cone @ inverse
    return conic / np.abs(conic).max()


def _distances(ball: np.ndarray, edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float) -> list[np.ndarray]:
    """Of both images' edgels from the outlines, pixels, with the pull of the smoothing taken off."""
    result = []
    for e, camera, eye in zip(edgels, (rig.left, rig.right), (0.0, rig.baseline)):
        pixels = camera.fx * ball[3] / max(float(ball[2]), 1e-6)
        result.append(sampson(_conic(ball, camera.matrix, eye), e.position) + 0.5 * blur / max(pixels, 1.0))
    return result


def _on_outline(
    ball: np.ndarray, edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float
) -> tuple[np.ndarray, np.ndarray]:
    """Bool over the edgels of both images: those on the ball's outlines."""
    found = []
    for e, off, camera, eye in zip(
        edgels, _distances(ball, edgels, rig, blur), (rig.left, rig.right), (0.0, rig.baseline)
    ):
        conic = _conic(ball, camera.matrix, eye)
        slope = e.position @ conic[:2, :2] + conic[:2, 2]
        across = np.abs((slope * np.stack([np.cos(e.direction), np.sin(e.direction)], axis=1)).sum(axis=1))
        found.append((np.abs(off) < NEAR) & (across > ACROSS * np.hypot(slope[:, 0], slope[:, 1])))
    return found[0], found[1]
