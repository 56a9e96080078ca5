"""Pictures of what was recovered."""

from __future__ import annotations

import cv2
import numpy as np

from msgs_py import FeatureKind, FeatureSet, PinholeCamera
from msgs_py.numeric.typed import AnyArray, ByteArray, FloatArray

from .detection.edgels import as_grey
from .settings import DARKENED, DEPTH_QUANTILES, FARTHEST_DRAWN, LEGEND_FONT, PARTS, SUB_PIXEL_BITS


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
    canvas: ByteArray = np.asarray(cv2.cvtColor((grey * DARKENED).astype(np.uint8), cv2.COLOR_GRAY2RGB))
    lines = [(kind, features.polyline(i)) for i, kind in enumerate(features.kind)]
    lines = [
        (kind, line if kind == FeatureKind.CURVE else _parts(line)) for kind, line in lines if (line[:, 2] > 0).all()
    ]
    if not lines:
        return canvas
    near, far = np.quantile(np.concatenate([line[:, 2] for _, line in lines]), DEPTH_QUANTILES)
    for kind, line in lines:
        pixels = np.clip(camera.project(line), -FARTHEST_DRAWN, FARTHEST_DRAWN)
        fixed = np.round(pixels * 2**SUB_PIXEL_BITS).astype(int).tolist()
        colours = depth_colours(0.5 * (line[:-1, 2] + line[1:, 2]), near, far).tolist()
        # Every other part of an axis is left out.
        for k in range(0, len(line) - 1, 2 if kind == FeatureKind.AXIS else 1):
            cv2.line(canvas, fixed[k], fixed[k + 1], colours[k], thickness, cv2.LINE_AA, SUB_PIXEL_BITS)
    _legend(canvas, near, far)
    return canvas


def _parts(ends: FloatArray) -> FloatArray:
    """(PARTS + 1, 3) points along a straight feature (2, 3), metres, even in the image: there 1 / z is linear."""
    share = np.linspace(0.0, 1.0, PARTS + 1)[:, None]
    inverse = (1.0 - share) / ends[0, 2] + share / ends[1, 2]
    return np.asarray(((1.0 - share) * ends[0] / ends[0, 2] + share * ends[1] / ends[1, 2]) / inverse)


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
    >>> red, blue = depth_colours(np.array([1.0, 2.0]), 1.0, 2.0).astype(int)
    >>> bool(red[0] > red[2]), bool(blue[2] > blue[0])
    (True, True)
    """
    level = np.interp(depth, (near, far), (255, 0)).astype(np.uint8)
    colours = cv2.cvtColor(cv2.applyColorMap(level[:, None], cv2.COLORMAP_JET), cv2.COLOR_BGR2RGB)
    return np.asarray(colours, np.uint8)[:, 0]


def _legend(canvas: ByteArray, near: float, far: float) -> None:
    """Draws the scale of depths into the lower left corner, where the picture has room for it."""
    font = cv2.FONT_HERSHEY_SIMPLEX, LEGEND_FONT
    labels = f'{near:.3g} m', f'{far:.3g} m'
    (width, height), margin = cv2.getTextSize('   '.join(labels), *font, 1)
    bottom = canvas.shape[0] - margin
    if canvas.shape[1] < width + 2 * margin or bottom < 4 * height:
        return
    canvas[bottom - height : bottom, margin : margin + width] = depth_colours(np.linspace(near, far, width), near, far)
    for label, right in zip(labels, (margin + cv2.getTextSize(labels[0], *font, 1)[0][0], margin + width)):
        left = right - cv2.getTextSize(label, *font, 1)[0][0]
        cv2.putText(canvas, label, (left, bottom - height - margin), *font, (255, 255, 255), 1, cv2.LINE_AA)
