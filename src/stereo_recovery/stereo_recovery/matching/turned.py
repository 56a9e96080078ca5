"""What was detected in a picture, in the same picture turned about the camera's centre, which is a homography.

It takes lines to lines, conics to conics, and their errors with them, so that no picture has to be searched twice, nor
interpolated before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import BoolArray, Float32Array, FloatArray

from ..detection.conics import Ellipse
from ..detection.edgels import Edgels
from ..detection.segments import Segments
from ..detection.view import View
from .settings import NEAREST_RAY


@dataclass(frozen=True, eq=False)
class TurnedSegments:
    """n segments as a homography shows them.

    A point at s along a segment comes to lie at s' along its picture, s' = (p + q s) / w(s), w(s) = w0 + w1 s, and what
    is linear along the one is linear along the other when it is divided by w.

    Attributes
    ----------
    segments : Segments
        In the turned picture.
    along : (n, 2, 2) float64
        [[w0, p], [w1, q]]: takes the coefficients (a', b') of what is a' + b' s' to those of the same times w.
    scale : (n,) float64
        By how much a step across the segment is larger in the turned picture, times w.
    """

    segments: Segments
    along: FloatArray
    scale: FloatArray


def turned(segments: Segments, homography: FloatArray) -> TurnedSegments:
    """Segments in a turned picture, with the same error.

    Each keeps its edgels' order and its bright side. Its centre is where offset and slope of the turned line are
    uncorrelated.

    Parameters
    ----------
    segments : Segments
        n, all of them before the turned camera.
    homography : (3, 3) float64
        Turned pixels from pixels; of positive determinant, so that nothing is mirrored.
    """
    t = segments.direction
    normal = np.stack([-t[:, 1], t[:, 0]], axis=1)
    zero, one = np.zeros((len(t), 1)), np.ones((len(t), 1))
    c_image, t_image, n_image = (
        np.hstack(rows) @ homography.T for rows in ((segments.centre, one), (t, zero), (normal, zero))
    )
    w0, w1 = c_image[:, 2], t_image[:, 2]
    centre = c_image[:, :2] / w0[:, None]
    run = t_image[:, :2] - centre * w1[:, None]
    # The sign of w is that of the side of the camera, which all points share.
    direction = run / np.linalg.norm(run, axis=1, keepdims=True) * np.sign(w0)[:, None]
    across = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    # From the centre's picture s' = q s / w.
    q = (direction * run).sum(axis=1)
    scale = (across * n_image[:, :2]).sum(axis=1) - (across * centre).sum(axis=1) * n_image[:, 2]
    along = np.stack([np.stack([w0, np.zeros_like(w0)], axis=1), np.stack([w1, q], axis=1)], axis=1)
    jacobian = scale[:, None, None] * np.linalg.inv(along)
    covariance = np.einsum('nij,nj,nkj->nik', jacobian, segments.sigma**2, jacobian)
    shift = -covariance[:, 0, 1] / np.maximum(covariance[:, 1, 1], 1e-30)
    along[:, 0, 1] -= shift * w0
    along[:, 1, 1] -= shift * w1
    offset = covariance[:, 0, 0] + shift * covariance[:, 0, 1]
    sigma = np.sqrt(np.stack([np.maximum(offset, 0.0), covariance[:, 1, 1]], axis=1))
    s = segments.extent
    w = w0[:, None] + w1[:, None] * s
    extent = (along[:, :1, 1] + along[:, 1:, 1] * s) / w
    middle = scale / w0
    result = replace(
        segments,
        centre=centre + shift[:, None] * direction,
        direction=direction,
        extent=extent,
        rms=segments.rms * middle,
        sagitta=segments.sagitta * middle,
        sigma=sigma,
        magnitude=segments.magnitude / middle,
    )
    return TurnedSegments(result, along, scale)


def in_view(segments: Segments, homography: FloatArray, size: tuple[int, int]) -> BoolArray:
    """(n,) bool: segments that a turned picture shows, at least in part.

    Parameters
    ----------
    segments : Segments
        n, of the picture before.
    homography : (3, 3) float64
        Turned pixels from pixels.
    size : (int, int), pixels
        Width and height of the turned picture.
    """
    shown = np.ones(len(segments), bool)
    points = []
    for end in (segments.start, segments.end):
        image = np.hstack([end, np.ones((len(end), 1))]) @ homography.T
        shown &= image[:, 2] > NEAREST_RAY
        points.append(image[:, :2] / np.maximum(image[:, 2:], NEAREST_RAY))
    low, high = np.minimum(*points), np.maximum(*points)
    return np.asarray(shown & (high >= 0.0).all(axis=1) & (low <= np.array(size) - 1.0).all(axis=1))


def turned_edgels(edgels: Edgels, homography: FloatArray) -> Edgels:
    """Edgels in a turned picture.

    Parameters
    ----------
    edgels : Edgels
        n.
    homography : (3, 3) float64
        Turned pixels from pixels.
    """
    tangent = edgels.tangent
    gradient = np.stack([np.cos(edgels.direction), np.sin(edgels.direction)], axis=1)
    zero, one = np.zeros((len(edgels), 1)), np.ones((len(edgels), 1))
    point, along, across = (
        np.hstack(rows) @ homography.T for rows in ((edgels.position, one), (tangent, zero), (gradient, zero))
    )
    depth = np.where(np.abs(point[:, 2:]) > NEAREST_RAY, point[:, 2:], NEAREST_RAY)
    position = point[:, :2] / depth
    along, across = ((step[:, :2] - position * step[:, 2:]) / depth for step in (along, across))
    length = np.maximum(np.linalg.norm(along, axis=1), NOT_ZERO)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / length[:, None]
    scale = np.maximum(np.abs((across * normal).sum(axis=1)), NOT_ZERO)
    return Edgels(
        position,
        np.arctan2(normal[:, 1], normal[:, 0]),
        edgels.magnitude / scale,
        edgels.sigma_position * scale,
        edgels.sigma_direction * scale / length,
        edgels.width * scale,
        edgels.bias * scale,
        edgels.prominence,
    )


def turned_view(view: View, homography: FloatArray, grey: Float32Array) -> View:
    """What was detected in a picture, as the turned picture shows it; what that does not show is left out.

    Parameters
    ----------
    view : View
    homography : (3, 3) float64
        Turned pixels from pixels.
    grey : (h, w) float32, grey levels
        The turned picture.
    """
    shown = in_view(view.segments, homography, (grey.shape[1], grey.shape[0]))
    back = np.asarray(np.linalg.inv(homography), np.float64)
    return View(
        grey,
        turned_edgels(view.edgels, homography),
        turned(view.segments.select(shown), homography).segments,
        [Ellipse(*_turned_conic(ellipse, homography, back)) for ellipse in view.ellipses],
    )


def _turned_conic(ellipse: Ellipse, homography: FloatArray, back: FloatArray) -> tuple[FloatArray, float]:
    """Conic and misfit of an ellipse in the turned picture."""
    # Its size there, for the misfit, is that of what surrounds its centre.
    depth = float(homography[2, :2] @ ellipse.centre + homography[2, 2])
    scale = np.sqrt(np.abs(np.linalg.det(homography) / depth**3))
    return back.T @ ellipse.conic @ back, float(ellipse.rms * scale)
