"""What was seen and found at one moment, and as the page takes it."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from msgs_py import FeatureSet, Interpretation, PinholeCamera, Pose
from msgs_py.numeric.typed import AnyArray, ByteArray, FloatArray

from ..image_pose.views import Views
from .settings import DECIMALS


@dataclass(frozen=True, eq=False)
class Placed:
    """An object where it was found.

    Attributes
    ----------
    name : str
        As the page calls it.
    model : str
        Whose lines are drawn.
    pose : Pose
        first_T_model, first being the first camera.
    covariance : (6, 6) float64, optional
        Of (x, y, z, rx, ry, rz) about the axes of the first camera, metres and radians.
    """

    name: str
    model: str
    pose: Pose
    covariance: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Moment:
    """What was seen and found at one moment.

    Attributes
    ----------
    stamp_s : float, optional
        Seconds; None of what has no place in time.
    views : Views, optional
        Images and their cameras.
    features : FeatureSet
        In the frame of the first camera, metres.
    placed : tuple of Placed
        Best first.
    words : str
        What is to be said of it, such as why nothing was found.
    """

    stamp_s: float | None = None
    views: Views | None = None
    features: FeatureSet = field(default_factory=FeatureSet.empty)
    placed: tuple[Placed, ...] = ()
    words: str = ''


def placed_objects(found: Iterable[Interpretation]) -> tuple[Placed, ...]:
    """Accepted interpretations as the page shows them; several of one model are numbered from 2 on."""
    counts: dict[str, int] = {}
    made = []
    for one in found:
        number = counts[one.model] = counts.get(one.model, 0) + 1
        name = one.model if number == 1 else f'{one.model} {number}'
        made.append(Placed(name, one.model, one.pose, one.covariance))
    return tuple(made)


def moment_record(moment: Moment) -> dict[str, Any]:
    """A moment as page.js takes it: JPEG images as text, lines as lists of points, metres."""
    views = moment.views
    features = moment.features
    return {
        'stamp': moment.stamp_s,
        'words': moment.words,
        'images': [] if views is None else [image_text(image) for image in views.images],
        'cameras': [] if views is None else [camera_record(*one) for one in zip(views.cameras, views.poses)],
        'kinds': features.kind.tolist(),
        'lines': line_records(features),
        'ellipsoids': _ellipsoids(features),
        'objects': [_object_record(one) for one in moment.placed],
    }


def model_lines(models: Mapping[str, FeatureSet]) -> dict[str, list[list[list[float]]]]:
    """The lines of models, each in its own frame, by their names."""
    return {name: line_records(features) for name, features in models.items()}


def line_records(features: FeatureSet) -> list[list[list[float]]]:
    """Each feature as a list of points, metres."""
    return [_rounded(features.polyline(k)) for k in range(len(features))]


def image_text(image: ByteArray) -> str:
    """An image (h, w) uint8 as the address of itself, which an ``img`` element takes."""
    encoded = cv2.imencode('.jpg', image)[1]
    return 'data:image/jpeg;base64,' + base64.b64encode(encoded.tobytes()).decode()


def camera_record(camera: PinholeCamera, first_T_camera: Pose) -> dict[str, Any]:
    """Size, pixels and place of a camera."""
    return {
        'size': [camera.width, camera.height],
        'focal': [camera.fx, camera.fy],
        'middle': [camera.cx, camera.cy],
        'first_T_camera': first_T_camera.matrix.tolist(),
    }


def _object_record(one: Placed) -> dict[str, Any]:
    spread = one.covariance if one.covariance is not None and np.isfinite(one.covariance).all() else None
    return {
        'name': one.name,
        'model': one.model,
        'first_T_model': one.pose.matrix.tolist(),
        'root': None if spread is None else _root(spread[:3, :3]),
        'sigma': None if spread is None else np.sqrt(np.maximum(np.diag(spread), 0.0)).tolist(),
    }


def _ellipsoids(features: FeatureSet) -> list[dict[str, Any]]:
    """Ends (of curves, centres) with a root of their covariance, where known; ``of`` is the number of the feature."""
    made = []
    for k in np.flatnonzero(features.has_covariance):
        ends = [(features.start[k], features.start_covariance[k])]
        if features.kind[k] != 1:
            ends.append((features.end[k], features.end_covariance[k]))
        made += [{'of': int(k), 'at': _rounded(at), 'root': _root(spread)} for at, spread in ends]
    return made


def _root(covariance: FloatArray) -> list[list[float]]:
    """(3, 3) whose columns are the axes of the ellipsoid of one sigma, metres."""
    values, axes = np.linalg.eigh(covariance)
    root: list[list[float]] = np.round(axes * np.sqrt(np.maximum(values, 0.0)), DECIMALS + 3).tolist()
    return root


def _rounded(points: AnyArray) -> Any:
    return np.round(points, DECIMALS).tolist()
