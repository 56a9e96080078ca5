"""Exact hidden-line removal: which pieces of a model's features a camera sees.

Along a crease, visibility can change only where its image crosses the image of another crease or occluding contour,
or the image's border. Creases are split there, and one point of each piece asks the tree whether material stands
between it and the eye. No image is rendered and nothing is sampled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msgs_py import FeatureKind, FeatureSet, PinholeCamera, Pose

from .boundary import Boundary, arcs
from .conics import evaluate
from .contours import contours
from .image_cuts import Wires, cut_conics, cut_segments, runs
from .model_features import boundary
from .occlusion import hidden
from .solid import Solid

Placed = tuple[Solid, Pose]


@dataclass(frozen=True, eq=False)
class VisibleFeatures:
    """What a camera sees of a model; camera frame, metres.

    features : a partly hidden feature gives one row a fragment; an axis is seen when the rims of both its ends (for a
        cone's apex, the apex) are seen at least in part
    model_index : (n,) int32: which feature of model_features(solid) each row is a fragment of
    contours : occluding contours of curved surfaces; they move with the eye and are no creases
    """

    features: FeatureSet
    model_index: np.ndarray
    contours: FeatureSet


def visible_features(solid: Solid, pose: Pose, camera: PinholeCamera, others: Sequence[Placed] = ()) -> FeatureSet:
    """The features of a solid that a camera sees, camera frame, metres, clipped to the image, hidden parts removed.

    pose : camera_T_model; others : solids that may stand in front, each with its own camera_T_model.
    """
    return visible_fragments(solid, pose, camera, others).features


def visible_fragments(solid: Solid, pose: Pose, camera: PinholeCamera, others: Sequence[Placed] = ()) -> VisibleFeatures:
    """As :func:`visible_features`, with the model feature of each fragment, and the occluding contours."""
    scene = Scenery([(solid, pose), *others])
    wires = scene.creases[0]
    edges, edge_index = scene.seen_segments(wires.segment, camera)
    curves, curve_index = scene.seen_arcs(wires, camera)
    found = boundary(solid)
    first_curve, first_axis = len(found.edge_start), len(found.edge_start) + int(found.ellipse.sum())
    normal = pose.rotate(found.curve_normal)
    # Hyperbolas and parabolas hide what is behind them but are no matching features.
    curve = found.ellipse[curve_index]
    rank = np.cumsum(found.ellipse) - 1
    features = [FeatureSet.from_edges(edges[:, 0], edges[:, 1]),
                arcs(curves.conic[curve], curves.low[curve], curves.high[curve], normal[curve_index[curve]])]
    axis = _seen_axes(found, scene, camera, np.unique(curve_index))
    model = boundary(solid).features.of_kind(FeatureKind.AXIS).transformed(pose)
    features.append(model.select(axis))
    index = np.concatenate([edge_index, first_curve + rank[curve_index[curve]], first_axis + np.nonzero(axis)[0]])
    return VisibleFeatures(FeatureSet.concatenate(features), index.astype(np.int32),
                           scene.visible_contours(0, camera))


class Scenery:
    """Placed solids as an eye at the origin of their common frame sees them."""

    def __init__(self, placed: Sequence[Placed]) -> None:
        self.placed = tuple(placed)
        self.creases = [wires_of(boundary(solid)).moved(pose.matrix) for solid, pose in self.placed]
        self.contours = [contours(boundary(solid).table, pose.inverse().translation).moved(pose.matrix)
                         for solid, pose in self.placed]
        self.all = Wires.concatenate([*self.creases, *self.contours])

    def seen_segments(self, segment: np.ndarray, camera: PinholeCamera) -> tuple[np.ndarray, np.ndarray]:
        """Visible pieces (k, 2, 3) of segments (n, 2, 3), and which segment each is a piece of."""
        row, low, high = cut_segments(segment, self.all, frustum(camera))
        start, along = segment[row, 0], segment[row, 1] - segment[row, 0]
        first, last = runs(row, low, high, ~self.hides(start + (0.5 * (low + high))[:, None] * along))
        ends = start[first, None] + np.stack([low[first], high[last]], axis=1)[..., None] * along[first, None]
        return ends, row[first]

    def seen_arcs(self, wires: Wires, camera: PinholeCamera) -> tuple[Wires, np.ndarray]:
        """Visible pieces of conics, and which conic each is a piece of."""
        row, low, high = cut_conics(wires, self.all, frustum(camera))
        seen = ~self.hides(evaluate(wires.conic[row], 0.5 * (low + high)))
        first, last = runs(row, low, high, seen)
        row, low, high = row[first], low[first], high[last].copy()
        keep = np.ones(len(row), bool)
        for k in np.unique(row):
            # On a whole circle the last piece goes on into the first.
            a, b = np.nonzero(row == k)[0][[0, -1]]
            if a != b and wires.high[k] - wires.low[k] > 2.0 * np.pi - 1e-6 and \
                    low[a] - wires.low[k] < 1e-9 and wires.high[k] - high[b] < 1e-9:
                high[b], keep[a] = high[a] + 2.0 * np.pi, False
        row, low, high = row[keep], low[keep], high[keep]
        return Wires(np.zeros((0, 2, 3)), wires.conic[row], low, high), row

    def hides(self, points: np.ndarray) -> np.ndarray:
        """(n,) bool: some solid stands between the eye and points (n, 3)."""
        out = np.zeros(len(points), bool)
        for solid, pose in self.placed:
            back = pose.inverse()
            open_ = np.nonzero(~out)[0]
            out[open_] = hidden(boundary(solid).table, back.translation, back.apply(points[open_]))
        return out

    def visible_contours(self, index: int, camera: PinholeCamera) -> FeatureSet:
        """Occluding contours of one solid that the camera sees, as edges and curves with normals towards the eye."""
        wires = self.contours[index]
        ends, _ = self.seen_segments(wires.segment, camera)
        conics, _ = self.seen_arcs(wires, camera)
        normal = np.cross(conics.conic[:, :3, 0], conics.conic[:, :3, 1])
        towards = -np.einsum('ni,ni->n', normal, conics.conic[:, :3, 2])
        return FeatureSet.concatenate([FeatureSet.from_edges(ends[:, 0], ends[:, 1]),
                                       arcs(conics.conic, conics.low, conics.high,
                                            normal * np.where(towards < 0.0, -1.0, 1.0)[:, None])])


def wires_of(found: Boundary) -> Wires:
    """The creases of a boundary, model frame: a segment an edge, a conic a curve, in their order."""
    return Wires(np.stack([found.edge_start, found.edge_end], axis=1), found.conic[found.curve], found.curve_low,
                 found.curve_high)


def frustum(camera: PinholeCamera) -> np.ndarray:
    """(5, 3): normals n of the planes through the eye with n.x >= 0 inside the image (its outer pixel borders)."""
    left, right = (-0.5 - camera.cx) / camera.fx, (camera.width - 0.5 - camera.cx) / camera.fx
    top, bottom = (-0.5 - camera.cy) / camera.fy, (camera.height - 0.5 - camera.cy) / camera.fy
    return np.array([[1.0, 0.0, -left], [-1.0, 0.0, right], [0.0, 1.0, -top], [0.0, -1.0, bottom], [0.0, 0.0, 1.0]])


def _seen_axes(found: Boundary, scene: Scenery, camera: PinholeCamera, seen_curves: np.ndarray) -> np.ndarray:
    """(a,) bool: axes of which both ends can be told from what is seen (thesis Table 6.2)."""
    ends = np.stack([found.axis_start, found.axis_end], axis=1)
    seen = np.zeros(ends.shape[:2], bool)
    size = found.table.size
    centre, normal = found.conic[found.curve, :3, 2], found.curve_normal
    for row, pair in enumerate(ends):
        for side, end in enumerate(pair):
            rims = found.ellipse & (np.linalg.norm(centre - end, axis=1) < 1e-6 * size)
            if not rims.any():
                # An oblique section of a cone is not centred on the axis, but its plane meets the axis in the end.
                in_plane = np.abs(np.einsum('ni,ni->n', normal, end - centre)) < 1e-6 * size
                rims = found.ellipse & in_plane & (np.linalg.norm(centre - end, axis=1) < np.linalg.norm(
                    found.conic[found.curve, :3, 0], axis=1))
            if rims.any():
                seen[row, side] = np.isin(np.nonzero(rims)[0], seen_curves).any()
            else:
                at = scene.placed[0][1].apply(end)[None]
                inside = (at @ frustum(camera).T >= 0.0).all()
                seen[row, side] = inside and not scene.hides(at)[0]
    return seen.all(axis=1)
