"""What a camera sees of a shape, as points along it: creases and occluding contours, evenly spaced in the image.

Where exact hidden-line removal cuts curves at their crossings (``hidden_lines``), this looks at points of them one by
one (``outline_points``, compiled). That is less than exact at the ends of what is hidden, by one spacing, and takes a
fraction of a millisecond.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from msgs_py import PinholeCamera, Pose
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array

from ..brep.boundary import Boundary
from ..brep.model_features import boundary
from ..brep.surfaces import solid_box
from ..scene.solid import Solid
from .contours import Quadrics
from .occlusion import first_hit
from .outline_points import Creases, seen_points


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

    Attributes
    ----------
    solid : Solid
        As it was given.

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
        self.solid = solid
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
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest corner of a box that holds the solid, each (3,) float64, metres, model frame."""
        low, high = solid_box(self.solid)
        return low, high

    @cached_property
    def _creases(self) -> Creases:
        """The creases, as compiled functions take them."""
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
        chain = np.concatenate([np.zeros((0, 3)), *found.space_curves])
        begin = np.cumsum([0, *(len(points) for points in found.space_curves)]).astype(np.int32)
        return Creases(matrix, span, feature, chain, begin)

    @cached_property
    def _quadrics(self) -> Quadrics:
        """The curved surfaces, whose contours depend on the viewpoint."""
        return Quadrics.of(self._found.table)

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
        row = camera_row(pose, camera)
        spacing = float(spacing)  # a whole number is another type, for which all would be compiled anew
        n, rows, numbers = seen_points(self._found.table.rows, self._quadrics, self._creases, row, spacing)
        return OutlinePoints(rows[:n, :3], rows[:n, 3:6], numbers[:n, 0], numbers[:n, 1], rows[:n, 6:9], rows[:n, 9])

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


def camera_row(pose: Pose, camera: PinholeCamera) -> FloatArray:
    """A camera at camera_T_model as compiled functions take it.

    Parameters
    ----------
    pose : Pose
    camera : PinholeCamera

    Returns
    -------
    (18,) float64
        camera_R_model by rows, times the scale of the model, camera_t_model, fx, fy, cx, cy, width, height.
    """
    c = camera
    return np.array(
        [
            *(pose.scale * pose.rotation).ravel().tolist(),
            *pose.translation.tolist(),
            *(c.fx, c.fy, c.cx, c.cy, c.width, c.height),
        ]
    )
