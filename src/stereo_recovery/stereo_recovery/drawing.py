"""Pictures of what was recovered."""

from __future__ import annotations

import cv2
import numpy as np

from msgs_py import FeatureKind, FeatureSet, PinholeCamera
from msgs_py.numeric.typed import AnyArray, ByteArray, FloatArray

from . import settings
from .detection.edgels import as_grey


def draw_features(image: AnyArray, features: FeatureSet, camera: PinholeCamera, thickness: int = 2) -> ByteArray:
    """Draw features over a darkened image, near ones red and far ones blue, axes dashed, with a scale of depths.

    Parameters
    ----------
    image : (h, w) or (h, w, 3)
        The left image, as for :func:`.pipeline.recover`.
    features : FeatureSet
        Left optical frame, metres.
    camera : PinholeCamera
        The left camera.
    thickness : int
        Pixels. Of the lines.

    Returns
    -------
    (h, w, 3) uint8
        RGB.
    """
    grey = np.clip(as_grey(image), 0, 255).astype(np.uint8)
    canvas: ByteArray = np.asarray(cv2.cvtColor((grey * settings.DARKENED).astype(np.uint8), cv2.COLOR_GRAY2RGB))
    drawn = [(kind, features.polyline(i, settings.CURVE_POINTS)) for i, kind in enumerate(features.kind)]
    drawn = [(kind, line) for kind, line in drawn if (line[:, 2] > 0).all()]
    if not drawn:
        return canvas
    near, far = np.quantile(np.concatenate([line[:, 2] for _, line in drawn]), settings.DEPTH_QUANTILES)
    for kind, line in drawn:
        if kind == FeatureKind.CURVE:
            pixels, depth = camera.project(line), 0.5 * (line[:-1, 2] + line[1:, 2])
        else:
            pixels, depth = _straight(line, camera)
        colour = depth_colours(depth, near, far)
        fixed = np.round(
            np.clip(pixels, -settings.FARTHEST_DRAWN, settings.FARTHEST_DRAWN) * 2**settings.SUB_PIXEL_BITS
        ).astype(int)
        for k, (a, b) in enumerate(zip(fixed[:-1], fixed[1:])):
            if kind == FeatureKind.AXIS and k % 2:
                continue
            cv2.line(
                canvas,
                tuple(int(x) for x in a),
                tuple(int(x) for x in b),
                tuple(int(x) for x in colour[k]),
                thickness,
                cv2.LINE_AA,
                settings.SUB_PIXEL_BITS,
            )
    _legend(canvas, near, far)
    return canvas


def _straight(line: FloatArray, camera: PinholeCamera) -> tuple[FloatArray, FloatArray]:
    """Pixels (STRAIGHT_PARTS + 1, 2) along a straight feature (2, 3), metres, and the depth between each two.

    Along a straight line 1 / z is linear in the image.
    """
    ends = camera.project(line)
    steps = np.linspace(0.0, 1.0, settings.STRAIGHT_PARTS + 1)[:, None]
    inverse = 1.0 / line[0, 2] + steps[:, 0] * (1.0 / line[1, 2] - 1.0 / line[0, 2])
    return ends[0] + steps * (ends[1] - ends[0]), 1.0 / (0.5 * (inverse[:-1] + inverse[1:]))


def depth_colours(depth: FloatArray, near: float, far: float) -> ByteArray:
    """Colours of depths.

    Parameters
    ----------
    depth : (n,) float64, metres
    near, far : float
        Metres. Depths that are red and blue; what is beyond them has their colours.

    Returns
    -------
    (n, 3) uint8
        RGB.

    Examples
    --------
    >>> depth_colours(np.array([1.0, 2.0]), 1.0, 2.0).tolist()
    [[255, 35, 35], [35, 35, 255]]
    """
    share = np.clip((np.asarray(depth) - near) / max(far - near, settings.LEAST_DEPTH_RANGE), 0.0, 1.0)
    hue = np.round(share * settings.FAR_HUE).astype(np.uint8)
    hsv = np.stack([hue, np.full_like(hue, settings.SATURATION), np.full_like(hue, settings.VALUE)], axis=-1)
    return np.asarray(cv2.cvtColor(hsv.reshape(1, -1, 3), cv2.COLOR_HSV2RGB), dtype=np.uint8).reshape(-1, 3)


def _legend(canvas: ByteArray, near: float, far: float) -> None:
    """Draws the scale of depths into the lower left corner."""
    height, width = canvas.shape[:2]
    if width < settings.LEGEND_LEAST_WIDTH or height < settings.LEGEND_LEAST_HEIGHT:
        return
    bar = depth_colours(np.linspace(near, far, settings.LEGEND_LENGTH), near, far)
    top, left = height - 2 * settings.LEGEND_HEIGHT, settings.LEGEND_LEFT
    canvas[top : top + settings.LEGEND_HEIGHT, left : left + settings.LEGEND_LENGTH] = bar
    font = cv2.FONT_HERSHEY_SIMPLEX, settings.LEGEND_FONT, (255, 255, 255), 1, cv2.LINE_AA
    for depth, x in zip((near, far), settings.LEGEND_COLUMNS):
        cv2.putText(canvas, f'{depth:.3g} m', (x, height - settings.LEGEND_BASELINE), *font)
