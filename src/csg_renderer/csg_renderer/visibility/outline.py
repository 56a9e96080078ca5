"""What a camera sees of a shape, as points along it: creases and occluding contours, evenly spaced in the image.

Where exact hidden-line removal cuts curves at their crossings (``hidden_lines``), this looks at points of them one by
one. That is less than exact at the ends of what is hidden, by one spacing, and takes a fraction of a millisecond.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from msgs_py import PinholeCamera, Pose
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array

from ..brep.boundary import Boundary
from ..brep.model_features import boundary
from ..scene.solid import Solid
from .contours import polar_sections
from .occlusion import first_hit, hidden
from .settings import OFF_SURFACE, OUTLINE_KNOTS, THIN, THIN_AT_SPACE_CURVE


@dataclass(frozen=True, eq=False)
class OutlinePoints:
    """Points along what a camera sees of a shape.

    Parameters
    ----------
    point : (n, 3) float64
        Metres, model frame.
    tangent : (n, 3) float64
        Unit vectors along the curve, model frame.
    curve : (n,) int32
        Which crease or contour; points of one curve follow one another along it.
    feature : (n,) int32
        Row of ``model_features`` that the crease is, -1 for contours and creases that are no matching feature.
    outward : (n, 3) float64
        Unit vectors out of the surface at points of occluding contours, model frame; zero on creases.
    spacing : (n,) float64
        Pixels of the image that each point stands for.
    """

    point: FloatArray
    tangent: FloatArray
    curve: Int32Array
    feature: Int32Array
    outward: FloatArray
    spacing: FloatArray

    def __len__(self) -> int:
        return len(self.point)

    def select(self, keep: BoolArray) -> OutlinePoints:
        """Some of the points."""
        return OutlinePoints(
            self.point[keep],
            self.tangent[keep],
            self.curve[keep],
            self.feature[keep],
            self.outward[keep],
            self.spacing[keep],
        )


class SolidOutline:
    """The outline of a solid from any viewpoint.

    Parameters
    ----------
    solid : Solid

    Raises
    ------
    ValueError
        A terrain is part of it.

    Examples
    --------
    >>> outline = SolidOutline(Solid.block(0.1, 0.1, 0.1))
    >>> pose = Pose(np.eye(3), np.array([0.2, 0.2, 1.0]))  # below and to the right of the line of sight
    >>> seen = outline.visible(pose, PinholeCamera.centred(640, 480, 500.0), 4.0)
    >>> np.unique(seen.curve).size
    9
    """

    def __init__(self, solid: Solid) -> None:
        self._found: Boundary = boundary(solid)

    @cached_property
    def centre(self) -> FloatArray:
        """The middle of the bounding box, (3,) float64, metres, model frame."""
        return np.asarray(self._found.table.centre, float)

    @cached_property
    def size(self) -> float:
        """Diagonal of the bounding box, metres."""
        return self._found.table.size

    @cached_property
    def _curves(self) -> tuple[FloatArray, FloatArray, Int32Array]:
        """Creases: homogeneous matrices (c, 4, 3), ranges (c, 2) of their parameter, features (c,).

        An edge is a + t b, a conic H (cos t, sin t, 1): both are a matrix times three functions of t.
        """
        found = self._found
        edges, conics = len(found.edge_start), found.conic[found.curve]
        matrix = np.zeros((edges + len(conics), 4, 3))
        matrix[:edges, :3, 0] = found.edge_end - found.edge_start
        matrix[:edges, :3, 2] = found.edge_start
        matrix[:edges, 3, 2] = 1.0
        matrix[edges:] = conics
        span = np.zeros((len(matrix), 2))
        span[:edges, 1] = 1.0
        span[edges:] = np.stack([found.curve_low, found.curve_high], axis=1)
        feature = np.full(len(matrix), -1, np.int32)
        feature[:edges] = np.arange(edges)
        feature[edges:][found.ellipse] = edges + np.arange(int(found.ellipse.sum()))
        return matrix, span, feature

    def visible(self, pose: Pose, camera: PinholeCamera, spacing: float) -> OutlinePoints:
        """Points of the creases and contours that a camera sees.

        Parameters
        ----------
        pose : Pose
            camera_T_model.
        camera : PinholeCamera
        spacing : float
            Pixels between neighbouring points.

        Returns
        -------
        OutlinePoints
        """
        table = self._found.table
        viewpoint = pose.inverse().translation
        creases, span, feature = self._curves
        matrix, limits, quadric = self._contours(viewpoint)
        parts = [
            _spread(np.concatenate([creases, matrix]), np.concatenate([span, limits]), pose, camera, spacing),
            *(
                _spread_chain(points, len(creases) + len(matrix) + k, pose, camera, spacing)
                for k, points in enumerate(self._found.space_curves)
            ),
        ]
        point, tangent, curve, steps = (np.concatenate(part) for part in zip(*parts))
        of = np.full(len(creases) + len(matrix) + len(self._found.space_curves), -1, np.int32)
        of[: len(creases)] = feature
        keep, outward = np.ones(len(point), bool), np.zeros((len(point), 3))
        contour = np.flatnonzero((curve >= len(creases)) & (curve < len(creases) + len(matrix)))
        keep[contour], outward[contour] = self._on_boundary(point[contour], quadric[curve[contour] - len(creases)])
        found = OutlinePoints(point, tangent, curve, of[curve], outward, steps)
        in_space = curve >= len(creases) + len(matrix)
        for rows, thin in ((~in_space & keep, THIN), (in_space, THIN_AT_SPACE_CURVE)):
            some = np.flatnonzero(rows)
            keep[some] = ~hidden(table, viewpoint, point[some], thin)
        return found.select(keep)

    def surface(self, pose: Pose, camera: PinholeCamera, pixels: FloatArray) -> FloatArray:
        """Where the surface is seen.

        Parameters
        ----------
        pose : Pose
            camera_T_model.
        camera : PinholeCamera
        pixels : (n, 2) float64

        Returns
        -------
        (n, 3) float64
            Metres, model frame; not a number where there is none.
        """
        back = pose.inverse()
        out = np.full((len(pixels), 3), np.nan)
        depth = first_hit(self._found.table, back.translation, back.rotate(camera.rays(pixels)))
        hit = np.isfinite(depth)
        out[hit] = back.translation + depth[hit, None] * back.rotate(camera.rays(pixels[hit]))
        return out

    def _contours(self, viewpoint: FloatArray) -> tuple[FloatArray, FloatArray, Int32Array]:
        """Where rays touch the quadrics: matrices and ranges as of the creases, and the quadric of each.

        Parts of these lie in the air or inside material. They are conics or rulings, for the rays from a point that
        touch a quadric do so in one plane, the point's polar plane.
        """
        table = self._found.table
        matrices, limits, owner = [], [], []
        for k, conics, lines in polar_sections(table, viewpoint):
            matrices += conics
            limits += [(0.0, 2.0 * np.pi)] * len(conics)
            owner += [k] * (len(conics) + len(lines))
            for point, direction in lines:
                # The solid lies within half a size of the origin, so the ruling does within that of its nearest point.
                near = point - (point @ direction) * direction
                matrices.append(np.stack([np.append(direction, 0), np.zeros(4), np.append(near, 1)], axis=1))
                limits.append((-0.5, 0.5))
        matrix = table.metres_T_normalised @ np.array(matrices).reshape(-1, 4, 3)
        return matrix, np.array(limits).reshape(-1, 2), np.array(owner, np.int32)

    def _on_boundary(self, points: FloatArray, quadric: Int32Array) -> tuple[BoolArray, FloatArray]:
        """Where quadrics bound the solid at points: (n,) bool, material on one side only; (n, 3) normals out of it."""
        table = self._found.table
        at = table.normalised(points)
        normal = table.gradients(at, quadric[:, None] + len(table.planes))[:, 0]
        ahead: BoolArray = table.contains(at + OFF_SURFACE * normal)
        behind: BoolArray = table.contains(at - OFF_SURFACE * normal)
        bounds: BoolArray = ahead != behind
        outward: FloatArray = np.where(ahead, -1.0, 1.0).reshape(-1, 1) * normal
        return bounds, outward


def _basis(matrix: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Three functions of t (c, k) for each curve, and their derivatives, both (c, k, 3); a line has column 1 zero."""
    straight = (matrix[:, :, 1] == 0.0).all(axis=1).reshape(-1, 1)
    one = np.ones_like(t)
    value = np.stack([np.where(straight, t, np.cos(t)), np.where(straight, 0.0, np.sin(t)), one], axis=-1)
    slope = np.stack([np.where(straight, one, -np.sin(t)), np.where(straight, 0.0, np.cos(t)), 0 * one], axis=-1)
    return value, slope


def _spread(
    matrix: FloatArray, span: FloatArray, pose: Pose, camera: PinholeCamera, spacing: float
) -> tuple[FloatArray, FloatArray, Int32Array, FloatArray]:
    """Points (n, 3), tangents (n, 3), curves (n,) and pixels (n,) of points evenly spaced in the image along curves."""
    share = np.linspace(0.0, 1.0, OUTLINE_KNOTS)
    knots = span[:, :1] + share * (span[:, 1:] - span[:, :1])
    at = np.einsum('cij,ckj->cki', matrix, _basis(matrix, knots)[0])
    pixel = _pixels(at[..., :3] / at[..., 3:], pose, camera)
    row, t, steps = _even(pixel, knots, camera, spacing)
    value, slope = _basis(matrix[row], t[:, None])
    at = np.einsum('nij,nj->ni', matrix[row], value[:, 0])
    velocity = np.einsum('nij,nj->ni', matrix[row], slope[:, 0])
    point = at[:, :3] / at[:, 3:]
    tangent = velocity[:, :3] - point * velocity[:, 3:]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return point, tangent, row.astype(np.int32), steps


def _spread_chain(
    points: FloatArray, curve: int, pose: Pose, camera: PinholeCamera, spacing: float
) -> tuple[FloatArray, FloatArray, Int32Array, FloatArray]:
    """As :func:`_spread`, for one polyline of points (k, 3)."""
    knots = np.arange(len(points), dtype=float)[None]
    _, t, steps = _even(_pixels(points[None], pose, camera), knots, camera, spacing)
    low = np.minimum(t.astype(int), len(points) - 2)
    part = (t - low)[:, None]
    step = points[low + 1] - points[low]
    tangent = step / np.linalg.norm(step, axis=1, keepdims=True)
    return points[low] + part * step, tangent, np.full(len(t), curve, np.int32), steps


def _pixels(points: FloatArray, pose: Pose, camera: PinholeCamera) -> FloatArray:
    """(..., 2): where the camera sees points (..., 3) of the model frame; not a number behind it."""
    return camera.project(pose.apply(points))


def _even(
    pixel: FloatArray, knots: FloatArray, camera: PinholeCamera, spacing: float
) -> tuple[Int32Array, FloatArray, FloatArray]:
    """Curves (n,), parameters (n,) and pixels (n,) of points evenly spaced along the images (c, k, 2) of knots (c, k).

    Each point stands in the middle of a stretch of the image. What lies behind the camera or outside has none.
    """
    step = np.linalg.norm(np.diff(pixel, axis=1), axis=-1)
    near = camera.contains(pixel)
    step[np.isnan(step) | ~(near[:, 1:] | near[:, :-1])] = 0.0
    along = np.concatenate([np.zeros((len(pixel), 1)), np.cumsum(step, axis=1)], axis=1)
    total = along[:, -1]
    count = np.ceil(total / spacing).astype(int)
    row = np.repeat(np.arange(len(pixel)), count)
    steps = np.repeat(total / np.maximum(count, 1), count)
    rank = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    want = (rank + 0.5) * steps
    # One search for all curves: each one's distances are shifted past those of the one before.
    shift = np.concatenate([[0.0], np.cumsum(total + 1.0)[:-1]]) if len(total) else np.zeros(0)
    flat = (along + shift[:, None]).ravel()
    right = np.searchsorted(flat, want + shift[row], side='left')
    left = right - 1
    gap = flat[right] - flat[left]
    part = np.where(gap > 0.0, (want + shift[row] - flat[left]) / np.where(gap > 0.0, gap, 1.0), 0.0)
    values = knots.ravel()
    return row.astype(np.int32), values[left] + part * (values[right] - values[left]), steps
