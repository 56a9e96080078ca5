"""Pictures of what was recovered."""

from __future__ import annotations

import cv2
import numpy as np

from msgs_py import FeatureKind, FeatureSet, PinholeCamera

from .detection.edgels import as_grey

# Sub-pixel bits of OpenCV's drawing functions.
SHIFT = 4


def draw_features(image: np.ndarray, features: FeatureSet, camera: PinholeCamera, thickness: int = 2) -> np.ndarray:
    """Features over a darkened picture, near red, far blue; axes dashed, with a scale of depths.

    image : as for recover(), the left image; features : left optical frame. Returns (h, w, 3) uint8, RGB.
    """
    grey = np.clip(as_grey(image), 0, 255).astype(np.uint8)
    canvas = cv2.cvtColor((grey * 0.6).astype(np.uint8), cv2.COLOR_GRAY2RGB)
    drawn = [(kind, features.polyline(i, 72)) for i, kind in enumerate(features.kind)]
    drawn = [(kind, line) for kind, line in drawn if (line[:, 2] > 0).all()]
    if not drawn:
        return canvas
    near, far = np.quantile(np.concatenate([line[:, 2] for _, line in drawn]), [0.02, 0.98])
    for kind, line in drawn:
        colour = depth_colours(0.5 * (line[:-1, 2] + line[1:, 2]), near, far)
        pixels = camera.project(line)
        if kind != FeatureKind.CURVE:
            steps = np.linspace(0.0, 1.0, 17)[:, None]
            pixels = pixels[0] + steps * (pixels[1] - pixels[0])
            # Linear in the picture means linear in 1 / z.
            inverse = 1.0 / line[0, 2] + steps[:, 0] * (1.0 / line[1, 2] - 1.0 / line[0, 2])
            colour = depth_colours(1.0 / (0.5 * (inverse[:-1] + inverse[1:])), near, far)
        fixed = np.round(np.clip(pixels, -1e4, 1e4) * 2**SHIFT).astype(int)
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
                SHIFT,
            )
    _legend(canvas, near, far)
    return canvas


def depth_colours(depth: np.ndarray, near: float, far: float) -> np.ndarray:
    """(n, 3) uint8 RGB, red for near, blue for far."""
    share = np.clip((np.asarray(depth) - near) / max(far - near, 1e-9), 0.0, 1.0)
    hue = np.round(share * 120).astype(np.uint8)
    hsv = np.stack([hue, np.full_like(hue, 220), np.full_like(hue, 255)], axis=-1)
    return cv2.cvtColor(hsv.reshape(1, -1, 3), cv2.COLOR_HSV2RGB).reshape(-1, 3)


def _legend(canvas: np.ndarray, near: float, far: float) -> None:
    height, width = canvas.shape[:2]
    if width < 160 or height < 60:
        return
    bar = depth_colours(np.linspace(near, far, 100), near, far)
    canvas[height - 16 : height - 8, 10:110] = bar
    for text, x in ((f'{near:.3g} m', 10), (f'{far:.3g} m', 80)):
        cv2.putText(canvas, text, (x, height - 20), cv2.FONT_HERSHEY_SIMPLEX, 0.35, (255, 255, 255), 1, cv2.LINE_AA)
