"""Wire frames: what is seen drawn solid, what is hidden dashed, axes dash-dotted. For PNG, SVG, PDF files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from msgs_py import FeatureKind, FeatureSet, PinholeCamera, Pose

from ..brep.boundary import Boundary
from ..brep.model_features import boundary
from ..scene.solid import Solid
from ..visibility.hidden_lines import visible_fragments
from ..visibility.settings import CREASE_POINTS
from .settings import BEFORE_CREASE, VIEW_DISTANCE, VIEW_FILL, VIEW_NEARER, VIEW_UPRIGHT


@dataclass(frozen=True)
class Drawing:
    """A wire frame, in pixels.

    Attributes
    ----------
    seen, hidden, contours, axes : list of (k, 2) float64
        Polylines. ``hidden`` holds all creases; those of ``seen`` are drawn over them.
    width, height : int
        Of the image.
    """

    seen: list[np.ndarray]
    hidden: list[np.ndarray]
    contours: list[np.ndarray]
    axes: list[np.ndarray]
    width: int
    height: int


def view_from(
    direction: ArrayLike, low: np.ndarray, high: np.ndarray, width: int = 900, height: int = 700
) -> tuple[Pose, PinholeCamera]:
    """A camera that looks at a box, with z upwards in the picture.

    Parameters
    ----------
    direction : (3,) array_like
        From the box to the camera, model frame, any length but zero.
    low, high : (3,) float64, metres, model frame
        The box.
    width, height : int
        Pixels.

    Returns
    -------
    Pose, PinholeCamera
        camera_T_model and the camera.

    Raises
    ------
    ValueError
        The direction is zero.
    """
    back = np.asarray(direction, dtype=np.float64)
    if back.shape != (3,) or not np.linalg.norm(back) > 0.0:
        raise ValueError(f'direction: expected three numbers, not all zero, got {direction}')
    back = back / np.linalg.norm(back)
    up = np.array([0.0, 0.0, 1.0]) if abs(back[2]) < VIEW_UPRIGHT else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(right, back), -back])
    size = float(np.linalg.norm(high - low)) or 1.0
    middle = 0.5 * (low + high)
    focal = VIEW_FILL * min(width, height) * (VIEW_DISTANCE - VIEW_NEARER)
    return (
        Pose(rotation, -rotation @ middle + [0.0, 0.0, VIEW_DISTANCE * size]),
        PinholeCamera.centred(width, height, focal),
    )


def draw_solid(solid: Solid, pose: Pose, camera: PinholeCamera) -> Drawing:
    """The wire frame of a solid, hidden lines removed exactly and drawn apart.

    Parameters
    ----------
    solid : Solid
    pose : Pose
        camera_T_model.
    camera : PinholeCamera

    Returns
    -------
    Drawing
    """
    found, seen = boundary(solid), visible_fragments(solid, pose, camera)
    everything = polylines(found.features.transformed(pose), (FeatureKind.EDGE, FeatureKind.CURVE))
    everything += [pose.apply(points) for points in other_creases(found)]
    visible = polylines(seen.features, (FeatureKind.EDGE, FeatureKind.CURVE)) + list(seen.others)
    return Drawing(
        [camera.project(p) for p in visible],
        [camera.project(p) for p in everything],
        [camera.project(p) for p in polylines(seen.contours, (FeatureKind.EDGE, FeatureKind.CURVE))],
        [camera.project(p) for p in polylines(found.features.transformed(pose), (FeatureKind.AXIS,))],
        camera.width,
        camera.height,
    )


def draw_mesh(
    features: FeatureSet,
    vertices: np.ndarray,
    triangles: np.ndarray,
    pose: Pose,
    camera: PinholeCamera,
    samples: int = 64,
) -> Drawing:
    """The wire frame of a mesh's features; hidden pieces are found by sampling each feature.

    Parameters
    ----------
    features : FeatureSet
        Of the mesh, model frame, metres.
    vertices : (n, 3) array of float64
        Model frame, metres.
    triangles : (m, 3) array of int
    pose : Pose
        camera_T_model.
    camera : PinholeCamera
    samples : int
        Points along each feature.

    Returns
    -------
    Drawing
    """
    corners = pose.apply(vertices)[triangles]
    seen = []
    lines = polylines(features.transformed(pose), (FeatureKind.EDGE, FeatureKind.CURVE), samples)
    for line in lines:
        along = np.linspace(0.0, len(line) - 1.0, samples)
        points = np.stack([np.interp(along, np.arange(len(line)), line[:, k]) for k in range(3)], axis=1)
        clear = ~_behind_triangles(points * (1.0 - BEFORE_CREASE), corners)
        starts = np.nonzero(clear & ~np.concatenate([[False], clear[:-1]]))[0]
        ends = np.nonzero(clear & ~np.concatenate([clear[1:], [False]]))[0]
        seen += [points[a : b + 1] for a, b in zip(starts, ends) if b > a]
    axes = polylines(features.transformed(pose), (FeatureKind.AXIS,))
    return Drawing(
        [camera.project(p) for p in seen],
        [camera.project(p) for p in lines],
        [],
        [camera.project(p) for p in axes],
        camera.width,
        camera.height,
    )


def save_drawing(drawing: Drawing, path: str | Path, title: str = '') -> None:
    """Write a drawing.

    Parameters
    ----------
    drawing : Drawing
    path : str or Path
        A PNG, SVG or PDF file, by its suffix.
    title : str
        Text above it.

    Raises
    ------
    ValueError
        The suffix is another.
    """
    if Path(path).suffix.lower() not in ('.png', '.svg', '.pdf'):
        raise ValueError(f'{path}: expected .png, .svg or .pdf')
    # matplotlib takes half a second to import, and only drawing needs it.
    from matplotlib import collections, figure

    page = figure.Figure(figsize=(drawing.width / 100.0, drawing.height / 100.0), dpi=100)
    axes = page.add_axes((0.0, 0.0, 1.0, 1.0))
    styles: tuple[tuple[list[np.ndarray], dict[str, Any]], ...] = (
        (drawing.hidden, {'color': '0.6', 'linewidth': 0.8, 'linestyle': (0, (4, 3))}),
        (drawing.axes, {'color': 'tab:red', 'linewidth': 0.8, 'linestyle': '-.'}),
        (drawing.contours, {'color': '0.35', 'linewidth': 0.9}),
        (drawing.seen, {'color': 'black', 'linewidth': 1.6, 'capstyle': 'round'}),
    )
    for lines, style in styles:
        axes.add_collection(collections.LineCollection(lines, **style))
    axes.set_xlim(0, drawing.width)
    axes.set_ylim(drawing.height, 0)
    axes.set_aspect('equal')
    axes.axis('off')
    if title:
        axes.text(10, 20, title, fontsize=9)
    page.savefig(path)


def polylines(features: FeatureSet, kinds: tuple[FeatureKind, ...], samples: int = 64) -> list[np.ndarray]:
    """Points along features.

    Parameters
    ----------
    features : FeatureSet
    kinds : tuple of FeatureKind
        Which of them.
    samples : int
        Points along a curve.

    Returns
    -------
    list of (k, 3) float64
        In the features' frame, metres.
    """
    return [features.polyline(k, samples) for k in range(len(features)) if features.kind[k] in kinds]


def other_creases(found: Boundary) -> list[np.ndarray]:
    """Points along the creases of a solid that are no matching features.

    Parameters
    ----------
    found : Boundary

    Returns
    -------
    list of (k, 3) float64
        Model frame, metres.
    """
    lines = list(found.space_curves)
    for curve, low, high, ellipse in zip(found.curve, found.curve_low, found.curve_high, found.ellipse):
        if not ellipse:
            t = np.linspace(low, high, CREASE_POINTS)
            x = np.stack([np.cos(t), np.sin(t), np.ones_like(t)], axis=1) @ found.conic[curve].T
            lines.append(x[:, :3] / x[:, 3:])
    return lines


def _behind_triangles(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(n,) bool: a triangle (m, 3, 3) stands between the origin and points (n, 3) (Moeller & Trumbore 1997)."""
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    out = np.zeros(len(points), bool)
    with np.errstate(divide='ignore', invalid='ignore'):
        for k, ray in enumerate(points):
            across = np.cross(ray, two)
            inverse = 1.0 / (one * across).sum(axis=1)
            u = -(corners[:, 0] * across).sum(axis=1) * inverse
            q = np.cross(-corners[:, 0], one)
            v = (q @ ray) * inverse
            t = (two * q).sum(axis=1) * inverse
            out[k] = ((u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0) & (t < 1.0)).any()
    return out
