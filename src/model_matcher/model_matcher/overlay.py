"""Features drawn over an image: what was found, where a model lies. Pure; images are arrays."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from msgs_py import FeatureKind, FeatureSet, PinholeCamera

Colour = tuple[int, int, int]  # blue, green, red, as OpenCV writes files

GREEN, RED, ORANGE, BLUE, GREY = (80, 220, 60), (60, 60, 255), (40, 160, 255), (255, 160, 60), (150, 150, 150)
KIND_COLOURS = {FeatureKind.EDGE: GREEN, FeatureKind.CURVE: BLUE, FeatureKind.AXIS: ORANGE}
# Lines are drawn on an enlarged image, so that sub-pixel differences show.
ENLARGE = 2
_SHIFT = 6  # fractional bits of OpenCV's fixed-point coordinates


def canvas(image: np.ndarray, enlarge: int = ENLARGE, dim: float = 1.0) -> np.ndarray:
    """(h, w) or (h, w, 3 BGR) uint8 enlarged to colour; dim < 1 darkens it, so that lines stand out."""
    colour = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
    big = cv2.resize(colour, None, fx=enlarge, fy=enlarge, interpolation=cv2.INTER_NEAREST)
    return (big * dim).astype(np.uint8)


def draw_features(
    picture: np.ndarray,
    features: FeatureSet,
    camera: PinholeCamera,
    colours: Sequence[Colour] | None = None,
    thickness: int = 2,
    enlarge: int = ENLARGE,
) -> np.ndarray:
    """Draw features given in the camera frame, in place; colours one a feature, by kind when not given."""
    for index in range(len(features)):
        colour = KIND_COLOURS[FeatureKind(features.kind[index])] if colours is None else colours[index]
        pixels = camera.project(features.polyline(index))
        if not np.isfinite(pixels).all():
            continue
        # A pixel's centre is an integer in the camera and the middle of a block of pixels on the canvas.
        placed = (pixels + 0.5) * enlarge - 0.5
        if np.abs(placed).max() > 1e5:
            continue  # beyond OpenCV's fixed-point range, and far outside the picture
        points = np.round(placed * (1 << _SHIFT)).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(picture, [points], False, colour, thickness, cv2.LINE_AA, _SHIFT)
    return picture


def side_by_side(*images: np.ndarray, gap: int = 8) -> np.ndarray:
    """Images of one height next to each other."""
    bar = np.full((images[0].shape[0], gap, 3), 255, np.uint8)
    parts: list[np.ndarray] = []
    for image in images:
        parts += [bar, image]
    return np.hstack(parts[1:])
