"""Pictures of features and of matches: lines over the camera's image, or two orthographic views. Images are arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from msgs_py import BIN, FeatureKind, FeatureSet, Interpretation, PinholeCamera

Colour = tuple[int, int, int]  # blue, green, red, as OpenCV writes files


def _colour(rgb: str) -> Colour:
    """A colour written as on web pages, #rrggbb.

    Examples
    --------
    >>> _colour('#3cdc50')
    (80, 220, 60)
    """
    red, green, blue = bytes.fromhex(rgb[1:])
    return blue, green, red


GREEN, RED, ORANGE = _colour('#3cdc50'), _colour('#ff3c3c'), _colour('#ffa028')
BLUE, GREY, PURPLE = _colour('#3ca0ff'), _colour('#969696'), _colour('#dc50dc')
KIND_COLOURS = {FeatureKind.EDGE: GREEN, FeatureKind.CURVE: BLUE, FeatureKind.AXIS: ORANGE}
# Colours of interpretations, in the order of their rank, repeated after the last.
COLOURS = (GREEN, ORANGE, BLUE, PURPLE, RED)
# Lines are drawn on an enlarged image, so that sub-pixel differences show.
ENLARGE = 2
SHIFT = 6  # fractional bits of OpenCV's fixed-point coordinates


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
        # OpenCV draws with 16 bits before the point; what is beyond is far outside the picture.
        if np.abs(placed).max() > np.iinfo(np.int16).max:
            continue
        draw_line(picture, placed, colour, thickness)
    return picture


def draw_line(picture: np.ndarray, places: np.ndarray, colour: Colour, thickness: int = 1) -> None:
    """Draw a line through places (n, 2) float64, pixels, to a fraction of one."""
    points = np.rint(places * 2**SHIFT).astype(np.int32)
    cv2.polylines(picture, [points], False, colour, thickness, cv2.LINE_AA, SHIFT)


def side_by_side(*images: np.ndarray, gap: int = 8) -> np.ndarray:
    """Images of one height next to each other."""
    bar = np.full((images[0].shape[0], gap, 3), 255, np.uint8)
    parts: list[np.ndarray] = []
    for image in images:
        parts += [bar, image]
    return np.hstack(parts[1:])


def draw_overlay(
    path: Path,
    data: FeatureSet,
    models: Mapping[str, FeatureSet],
    found: Sequence[Interpretation],
    camera: PinholeCamera,
    image: np.ndarray | None = None,
) -> None:
    """Write a picture: data thick, in the colour of what explains it (grey: nothing), models thin.

    Parameters
    ----------
    path : Path
        The picture; its ending says of which kind.
    data : FeatureSet
        Camera frame, metres.
    models : mapping of str to FeatureSet
        By name, model frame, metres.
    found : sequence of Interpretation
        Of the data.
    camera : PinholeCamera
        Which sees it.
    image : (h, w) or (h, w, 3) uint8, optional
        Drawn on; black when not given.

    Raises
    ------
    ValueError
        The file cannot be written, or the image has another size than the camera.
    """
    if image is None:
        image = np.zeros((camera.height, camera.width), np.uint8)
    if image.shape[:2] != (camera.height, camera.width):
        raise ValueError(
            f'--image: {image.shape[1]} x {image.shape[0]} pixels, but the camera has {camera.width} x {camera.height}'
        )
    picture = draw_features(canvas(image, dim=0.6), data, camera, data_colours(len(data), found), 3)
    for number, item in enumerate(found):
        placed = models[item.model].transformed(item.pose)
        colour = COLOURS[number % len(COLOURS)]
        draw_features(picture, placed, camera, [colour] * len(placed), 1)
    try:
        written = cv2.imwrite(str(path), picture)
    except cv2.error:
        written = False
    if not written:
        raise ValueError(f'{path}: cannot be written as a picture')


def draw_views(path: Path, data: FeatureSet, models: Mapping[str, FeatureSet], found: Sequence[Interpretation]) -> None:
    """Write two orthographic views with matplotlib: from the camera (x, y) and from above (x, z), millimetres.

    Raises ValueError when the file cannot be written.
    """
    # Importing matplotlib takes half a second, and no other function here needs it.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 6), layout='constrained')
    for axes, second, title in zip(figure.subplots(1, 2), (1, 2), ('from the camera', 'from above')):
        _draw_view(axes, data, models, found, second)
        axes.set(title=title, xlabel='x [mm]', ylabel=f'{"xyz"[second]} [mm]', aspect='equal')
        if second == 1:
            axes.invert_yaxis()  # y points down in the camera frame
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise ValueError(f'{path}: cannot be written as a picture: {error}') from None


def _draw_view(
    axes: Any, data: FeatureSet, models: Mapping[str, FeatureSet], found: Sequence[Interpretation], second: int
) -> None:
    for index, colour in enumerate(data_colours(len(data), found)):
        line = 1e3 * data.polyline(index)
        axes.plot(line[:, 0], line[:, second], color=_rgb(colour), linewidth=2.5, alpha=0.6)
    for number, item in enumerate(found):
        placed = models[item.model].transformed(item.pose)
        for index in range(len(placed)):
            line = 1e3 * placed.polyline(index)
            axes.plot(line[:, 0], line[:, second], color=_rgb(COLOURS[number % len(COLOURS)]), linewidth=0.8)


def data_colours(n: int, found: Sequence[Interpretation]) -> list[Colour]:
    """The colour of each data feature: that of the interpretation that explains it, or grey."""
    colours: list[Colour] = [GREY] * n
    for number, item in enumerate(found):
        for index in np.flatnonzero(item.assignment != BIN):
            colours[index] = COLOURS[number % len(COLOURS)]
    return colours


def _rgb(colour: Colour) -> tuple[float, float, float]:
    return colour[2] / 255.0, colour[1] / 255.0, colour[0] / 255.0
