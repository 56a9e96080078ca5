"""The least error of a pose that any method could have on given pictures: the Cramer-Rao bound of the visible edges.

What a step of grey tells of its place is :func:`model_matcher.closed_form.planning.steps.edge_information`. The normal
displacement of a point X of the part is linear in the six errors of a pose; so the information on the pose is the sum
over all that is seen, in all views. A point where a line of sight touches a curved surface moves along its normal as a
fixed point of the part does: what it slides on the surface it slides along the line of sight.

Grey levels beside the edges are taken as known, which to estimate has a price. Left out, too: shading that turns with
the part, and edges so near that one profile has two.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from csg_renderer import Solid, visible_fragments
from model_matcher.closed_form.planning.steps import edge_information, step_heights
from model_matcher.geometry.pose_rows import step_between
from model_matcher.geometry.settings import UNIFORM_VARIANCE
from msgs_py import FeatureKind, PinholeCamera, Pose

# Samples stand so far apart, pixels; a curve is followed in so many chords.
STEP, CHORDS = 1.0, 257
# Directions of the pose with less information than this share of the most are free, turns in units of the part's size:
# what chords in place of a curve pretend to know is less.
FREE = 1e-6


@dataclass(frozen=True, eq=False)
class View:
    """A camera, eye_T_left, and a picture (h, w) float64 of point samples: no blur, no noise."""

    camera: PinholeCamera
    eye_T_left: Pose
    image: np.ndarray


@dataclass(frozen=True, eq=False)
class EdgeSamples:
    """Places along what one view sees of a part.

    points : (n, 3) float64, metres, left frame
    pixels, normals : (n, 2) float64, in the view's image
    lengths : (n,) float64, pixels of edge that each stands for
    contrasts : (n,) float64, grey levels from one side to the other
    """

    points: np.ndarray
    pixels: np.ndarray
    normals: np.ndarray
    lengths: np.ndarray
    contrasts: np.ndarray


@dataclass(frozen=True, eq=False)
class PoseBound:
    """information : (6, 6) float64 on (x, y, z, rx, ry, rz), metres and radians, left frame, turns about the part's
    origin (as Interpretation.covariance); size : metres, what is seen farthest from it, by which turns and shifts are
    compared."""

    information: np.ndarray
    size: float

    @property
    def covariance(self) -> np.ndarray:
        """(6, 6) float64: the least covariance of what is not free; zero along directions that the edges leave free."""
        units = np.array([1.0, 1.0, 1.0, *[self.size] * 3])
        values, vectors = np.linalg.eigh(self.information / np.outer(units, units))
        kept = values > FREE * values.max()
        inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
        return np.asarray(inverse / np.outer(units, units))

    @property
    def degrees(self) -> float:
        """Root mean square of the rotation's error at the bound."""
        return float(np.degrees(np.sqrt(np.trace(self.covariance[3:, 3:]))))

    def metres(self, lever: np.ndarray) -> float:
        """Root mean square of the displacement of a point at the bound; lever (3,): from the part's origin to it,
        metres, left frame."""
        moves = np.hstack([np.eye(3), -cross_matrix(lever)])
        return float(np.sqrt(np.trace(moves @ self.covariance @ moves.T)))

    def squared(self, true: Pose, found: Pose) -> float:
        """The squared error of a pose in units of the bound: six on average where a method reaches it."""
        error = step_between(true, found)
        return float(error @ self.information @ error)


def pose_bound(
    solid: Solid,
    left_T_part: Pose,
    views: Sequence[View],
    blur: float,
    noise: float,
    others: Sequence[tuple[Solid, Pose]] = (),
) -> PoseBound:
    """The information that the visible edges and occluding contours of a part hold on its pose.

    blur : pixels, of lens and pixel together, see :func:`sensor_blur`
    noise : grey levels, independent in every pixel; rounding is added
    others : solids that may stand in front, with their left_T_solid
    """
    sigma = float(np.sqrt(noise**2 + UNIFORM_VARIANCE))
    information, size = np.zeros((6, 6)), 0.0
    for view in views:
        samples = edge_samples(solid, left_T_part, view, others)
        if len(samples.points):
            rows = normal_jacobian(samples, view, left_T_part.translation)
            weight = samples.lengths * edge_information(samples.contrasts, blur, sigma)
            information += (rows * weight[:, None]).T @ rows
            size = max(size, float(np.linalg.norm(samples.points - left_T_part.translation, axis=1).max()))
    return PoseBound(information, size)


def edge_samples(solid: Solid, left_T_part: Pose, view: View, others: Sequence[tuple[Solid, Pose]] = ()) -> EdgeSamples:
    """What a view sees of a part's creases and occluding contours, a pixel apart, with the step of grey at each."""
    placed = [(other, view.eye_T_left.compose(pose)) for other, pose in others]
    seen = visible_fragments(solid, view.eye_T_left.compose(left_T_part), view.camera, placed)
    features, contours = seen.features, seen.contours
    lines = [features.polyline(int(k), CHORDS) for k in np.flatnonzero(features.kind != FeatureKind.AXIS)]
    lines += [contours.polyline(k, CHORDS) for k in range(len(contours))]
    parts = [part for line in (*lines, *seen.others) for part in _spaced(line, view.camera)]
    if not parts:
        return EdgeSamples(np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    points, pixels, normals, lengths = (np.concatenate(column) for column in zip(*parts))
    contrasts = step_heights(view.image, pixels, normals)
    return EdgeSamples(view.eye_T_left.inverse().apply(points), pixels, normals, lengths, contrasts)


def _spaced(line: np.ndarray, camera: PinholeCamera) -> Iterator[tuple[np.ndarray, ...]]:
    """Points (n, 3), pixels, normals and lengths evenly along the image of a polyline (m, 3), eye's frame."""
    corners = camera.project(line)
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    if run[-1] < 1e-6:
        return
    count = max(1, round(run[-1] / STEP))
    places = (np.arange(count) + 0.5) / count * run[-1]
    chord = np.clip(np.searchsorted(run, places, side='right') - 1, 0, len(line) - 2)
    t = ((places - run[chord]) / np.maximum(run[chord + 1] - run[chord], 1e-12))[:, None]
    pixels = (1.0 - t) * corners[chord] + t * corners[chord + 1]
    # Along a chord it is 1 / Z that is linear in the image.
    inverse = (1.0 - t) / line[chord, 2:] + t / line[chord + 1, 2:]
    # Of a curve the direction turns along a chord as it does between its ends.
    turning = np.gradient(corners, run, axis=0, edge_order=2) if len(line) > 2 else np.diff(corners, axis=0)[[0, 0]]
    along = (1.0 - t) * turning[chord] + t * turning[chord + 1]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    normals = np.column_stack([-along[:, 1], along[:, 0]])
    yield camera.rays(pixels) / inverse, pixels, normals, np.full(count, run[-1] / count)


def normal_jacobian(samples: EdgeSamples, view: View, origin: np.ndarray) -> np.ndarray:
    """(n, 6) float64: pixels along each normal by the errors of a pose; origin (3,): the part's, metres, left frame."""
    rotation = view.eye_T_left.rotation
    seen = view.eye_T_left.apply(samples.points)
    x, y, z = seen.T
    camera = view.camera
    across, down = samples.normals.T
    by_point = np.column_stack(
        [across * camera.fx / z, down * camera.fy / z, -(across * camera.fx * x + down * camera.fy * y) / z**2]
    )
    by_point = by_point @ rotation
    lever = samples.points - origin
    # A turn w moves the point by w x lever, and g . (w x lever) = w . (lever x g).
    return np.hstack([by_point, np.cross(lever, by_point)])


def cross_matrix(vector: np.ndarray) -> np.ndarray:
    """(3, 3) float64: M with M w = vector x w."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
