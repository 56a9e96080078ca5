"""Exact hidden-line removal: which pieces of a model's features a camera sees.

Along a crease, visibility can change only where its image crosses the image of another crease or occluding contour,
or the image's border. Creases are split there, and for one point of each piece the tree gives the material between it
and the viewpoint. No image is rendered and nothing is sampled. A terrain in front is the exception: where it begins
and ends to hide a crease is searched for between samples along it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from msgs_py import FeatureKind, FeatureSet, PinholeCamera, Pose, StereoRig
from msgs_py.numeric.steps import CompileStep
from msgs_py.numeric.typed import BoolArray, FloatArray

from ..brep.boundary import Boundary, arcs
from ..brep.conics import evaluate
from ..brep.model_features import boundary
from ..brep.settings import INSIDE, WHOLE_TURN
from ..scene.solid import Solid
from ..scene.terrain import Terrain, hidden_by_terrain
from .contours import contours
from .image_cuts import Wires, cut_conics, cut_segments, runs
from .occlusion import hidden
from .settings import (
    BEFORE_TERRAIN,
    CREASE_POINTS,
    RIM_DISTANCE,
    SHORTEST_PIECE,
    TERRAIN_HALVINGS,
    TERRAIN_SAMPLES,
    THIN,
    THIN_AT_SPACE_CURVE,
)

Placed = tuple[Solid, Pose]


@dataclass(frozen=True, eq=False)
class VisibleFeatures:
    """What a camera sees of a model; camera frame, metres.

    Parameters
    ----------
    features : FeatureSet
        A partly hidden feature gives one row for each fragment. An axis is seen when the rims of both its ends (for a
        cone's apex, the apex) are seen at least in part.
    model_index : (n,) int32
        Which feature of ``model_features(solid)`` each row is a fragment of.
    scene : Scenery
        The solids, as placed.
    camera : PinholeCamera
    """

    features: FeatureSet
    model_index: np.ndarray
    scene: Scenery
    camera: PinholeCamera

    @cached_property
    def contours(self) -> FeatureSet:
        """Occluding contours of curved surfaces, as edges and curves; they move with the camera and are no creases."""
        return self.scene.visible_contours(0, self.camera)

    @cached_property
    def others(self) -> tuple[np.ndarray, ...]:
        """Creases that are no matching features (in no plane, parabolas, hyperbolas), each as points (k, 3)."""
        return self.scene.visible_others(0, self.camera)


@dataclass(frozen=True, eq=False)
class Spans:
    """Visible pieces of curves: row (k,) int, which curve; low, high (k,) parameters; ordered along each curve."""

    row: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def __and__(self, other: Spans) -> Spans:
        """What lies in both."""
        one, two = np.nonzero(self.row[:, None] == other.row[None, :])
        low = np.maximum(self.low[one], other.low[two])
        high = np.minimum(self.high[one], other.high[two])
        keep = high - low > SHORTEST_PIECE
        order = np.lexsort((low[keep], self.row[one][keep]))
        return Spans(self.row[one][keep][order], low[keep][order], high[keep][order])


@dataclass(frozen=True, eq=False)
class Seen:
    """What is seen of one solid: spans of its edges (fractions of the length) and curves (angles), and which axes."""

    edges: Spans
    curves: Spans
    axes: np.ndarray

    def __and__(self, other: Seen) -> Seen:
        return Seen(self.edges & other.edges, self.curves & other.curves, self.axes & other.axes)


def visible_features(solid: Solid, pose: Pose, camera: PinholeCamera, others: Sequence[Placed] = ()) -> FeatureSet:
    """The features of a solid that a camera sees, clipped to the image, hidden parts removed.

    Parameters
    ----------
    solid : Solid
    pose : Pose
        camera_T_model.
    camera : PinholeCamera
    others : sequence of (Solid, Pose)
        Solids that may stand in front, each with its own camera_T_model.

    Returns
    -------
    FeatureSet
        Camera frame, metres, uncertainty zero; one row for each visible fragment.

    Examples
    --------
    >>> block = Solid.block(0.1, 0.1, 0.1)
    >>> pose = Pose(np.eye(3), np.array([0.2, 0.2, 1.0]))  # below and to the right of the line of sight
    >>> len(visible_features(block, pose, PinholeCamera.centred(640, 480, 500.0)))
    9
    """
    return visible_fragments(solid, pose, camera, others).features


def visible_fragments(
    solid: Solid, pose: Pose, camera: PinholeCamera, others: Sequence[Placed] = ()
) -> VisibleFeatures:
    """As :func:`visible_features`, with the model feature of each fragment, and the occluding contours.

    Parameters
    ----------
    solid, pose, camera, others
        As for :func:`visible_features`.

    Returns
    -------
    VisibleFeatures
    """
    scene = Scenery([(solid, pose), *others])
    features, index = fragments(solid, pose, scene.seen(0, camera))
    return VisibleFeatures(features, index, scene, camera)


def stereo_fragments(placed: Sequence[Placed], rig: StereoRig) -> list[tuple[FeatureSet, np.ndarray]]:
    """For every solid, the pieces of its features that both cameras of a rig see.

    Parameters
    ----------
    placed : sequence of (Solid, Pose)
        Solids with their left_T_model; each may hide the others.
    rig : StereoRig

    Returns
    -------
    list of (FeatureSet, (n,) int32)
        For each solid the pieces, left camera frame, metres, and the model feature of each.
    """
    right = [(solid, Pose(pose.rotation, pose.translation + rig.right_T_left, pose.scale)) for solid, pose in placed]
    sides = [(Scenery(placed), rig.left), (Scenery(right), rig.right)]
    return [
        fragments(solid, pose, sides[0][0].seen(k, sides[0][1]) & sides[1][0].seen(k, sides[1][1]))
        for k, (solid, pose) in enumerate(placed)
    ]


def fragments(solid: Solid, pose: Pose, seen: Seen) -> tuple[FeatureSet, np.ndarray]:
    """The seen pieces as features in the camera frame, and the model feature (n,) int32 of each."""
    if isinstance(solid, Terrain):
        return FeatureSet.concatenate([]), np.zeros(0, np.int32)
    found = boundary(solid)
    wires = wires_of(found).moved(pose.matrix)
    ends = ends_of(wires.segment, seen.edges)
    # Hyperbolas and parabolas hide what is behind them but are no matching features.
    curve = round_circles(wires, seen.curves)
    keep = found.ellipse[curve.row]
    curve = Spans(curve.row[keep], curve.low[keep], curve.high[keep])
    model = found.features.of_kind(FeatureKind.AXIS).transformed(pose)
    first_curve = len(found.edge_start)
    first_axis = first_curve + int(found.ellipse.sum())
    rank = np.cumsum(found.ellipse) - 1
    index = np.concatenate([seen.edges.row, first_curve + rank[curve.row], first_axis + np.nonzero(seen.axes)[0]])
    return FeatureSet.concatenate(
        [
            FeatureSet.from_edges(ends[:, 0], ends[:, 1]),
            arcs(wires.conic[curve.row], curve.low, curve.high, pose.rotate(found.curve_normal)[curve.row]),
            model.select(seen.axes),
        ]
    ), index.astype(np.int32)


def compile_steps() -> tuple[CompileStep, ...]:
    """What :func:`visible_features` needs compiled, as those of a small solid."""
    solid = Solid.block(0.1, 0.1, 0.1) | Solid.cylinder(0.02, (0.0, 0.0, 0.2))
    place, camera = Pose(np.eye(3), np.array([0.0, 0.0, 1.0])), PinholeCamera.centred(32, 32, 40.0)
    return (CompileStep('hidden lines', lambda: visible_features(solid, place, camera)),)


class Scenery:
    """Placed solids, and all curves that can hide one another in the view from the origin of their common frame.

    Parameters
    ----------
    placed : sequence of (Solid, Pose)
        Each with its camera_T_model.
    """

    def __init__(self, placed: Sequence[Placed]) -> None:
        self.placed = tuple(placed)
        self.creases, self.contours = [], []
        self.space_curves: list[list[np.ndarray]] = []
        for solid, pose in self.placed:
            if isinstance(solid, Terrain):  # hides others, and has no features of its own
                self.creases.append(Wires.of_segments(np.zeros((0, 2, 3))))
                self.contours.append(self.creases[-1])
                self.space_curves.append([])
                continue
            found = boundary(solid)
            self.creases.append(wires_of(found).moved(pose.matrix))
            self.contours.append(contours(found.table, pose.inverse().translation).moved(pose.matrix))
            self.space_curves.append([pose.apply(points) for points in found.space_curves])
        chords = [Wires.of_segments(_chords(points)) for item in self.space_curves for points in item]
        self.all = Wires.concatenate([*self.creases, *self.contours, *chords])

    def seen(self, index: int, camera: PinholeCamera) -> Seen:
        """What the camera sees of one of the solids."""
        if isinstance(self.placed[index][0], Terrain):
            none = Spans(np.zeros(0, int), np.zeros(0), np.zeros(0))
            return Seen(none, none, np.zeros(0, bool))
        edges, curves = self.spans(self.creases[index], camera)
        return Seen(edges, curves, self._axes(index, camera, np.unique(curves.row)))

    def spans(self, wires: Wires, camera: PinholeCamera) -> tuple[Spans, Spans]:
        """Visible pieces of the segments and of the conics of some wires."""
        planes = frustum(camera)
        row, low, high = self._cut_by_terrains(
            lambda k, t: wires.segment[k, 0] + t[:, None] * (wires.segment[k, 1] - wires.segment[k, 0]),
            *cut_segments(wires.segment, self.all, planes),
        )
        start, along = wires.segment[row, 0], wires.segment[row, 1] - wires.segment[row, 0]
        curve, first, last = self._cut_by_terrains(
            lambda k, t: evaluate(wires.conic[k], t), *cut_conics(wires, self.all, planes)
        )
        middle = np.concatenate(
            [
                start + (low + INSIDE * (high - low))[:, None] * along,
                evaluate(wires.conic[curve], first + INSIDE * (last - first)),
            ]
        )
        seen = ~self.hides(middle)
        return _joined(row, low, high, seen[: len(row)]), _joined(curve, first, last, seen[len(row) :])

    def hides(self, points: np.ndarray, thin: float = THIN) -> np.ndarray:
        """(n,) bool: some solid stands between the viewpoint and points (n, 3)."""
        out = np.zeros(len(points), bool)
        for solid, pose in self.placed:
            open_ = np.nonzero(~out)[0]
            if isinstance(solid, Terrain):
                out[open_] = _behind_terrain(solid, pose, points[open_])
                continue
            back = pose.inverse()
            out[open_] = hidden(boundary(solid).table, back.translation, back.apply(points[open_]), thin)
        return out

    def _cut_by_terrains(
        self, place: Callable[[np.ndarray, np.ndarray], np.ndarray], row: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pieces of curves cut where a terrain begins or ends to hide them.

        place : points (n, 3) of curves (n,) int at parameters (n,)
        """
        for terrain, pose in self.placed:
            if not isinstance(terrain, Terrain) or not len(row):
                continue
            t = np.linspace(low, high, TERRAIN_SAMPLES, axis=1)
            curve = np.repeat(row[:, None], TERRAIN_SAMPLES, axis=1)
            hidden = _behind_terrain(terrain, pose, place(curve.ravel(), t.ravel())).reshape(t.shape)
            piece, at = np.nonzero(hidden[:, 1:] != hidden[:, :-1])
            a, b, before = t[piece, at], t[piece, at + 1], hidden[piece, at]
            for _ in range(TERRAIN_HALVINGS if len(piece) else 0):
                middle = 0.5 * (a + b)
                same = _behind_terrain(terrain, pose, place(row[piece], middle)) == before
                a, b = np.where(same, middle, a), np.where(same, b, middle)
            owner = np.concatenate([np.arange(len(row)), piece])
            begin = np.concatenate([low, b])
            order = np.lexsort((begin, owner))
            owner, begin = owner[order], begin[order]
            last = np.append(owner[1:] != owner[:-1], True)
            row, high = row[owner], np.where(last, high[owner], np.append(begin[1:], 0.0))
            keep = high - begin > SHORTEST_PIECE
            row, low, high = row[keep], begin[keep], high[keep]
        return row, low, high

    def visible_contours(self, index: int, camera: PinholeCamera) -> FeatureSet:
        """Occluding contours of one solid that the camera sees, as edges and curves with normals towards it."""
        wires = self.contours[index]
        straight, curved = self.spans(wires, camera)
        curved = round_circles(wires, curved)
        ends, conic = ends_of(wires.segment, straight), wires.conic[curved.row]
        normal = np.cross(conic[:, :3, 0], conic[:, :3, 1])
        away = np.einsum('ni,ni->n', normal, conic[:, :3, 2]) > 0.0
        return FeatureSet.concatenate(
            [
                FeatureSet.from_edges(ends[:, 0], ends[:, 1]),
                arcs(conic, curved.low, curved.high, np.where(away[:, None], -normal, normal)),
            ]
        )

    def visible_others(self, index: int, camera: PinholeCamera) -> tuple[np.ndarray, ...]:
        """Visible creases of one solid that are no matching features, as points (k, 3) along each piece."""
        solid, _ = self.placed[index]
        wires, ellipse = self.creases[index], boundary(solid).ellipse
        _, curved = self.spans(Wires(wires.segment[:0], wires.conic, wires.low, wires.high), camera)
        out = [
            evaluate(np.repeat(wires.conic[k : k + 1], CREASE_POINTS, axis=0), np.linspace(low, high, CREASE_POINTS))
            for k, low, high in zip(curved.row, curved.low, curved.high)
            if not ellipse[k]
        ]
        for points in self.space_curves[index]:
            out += self._visible_chords(points, camera)
        return tuple(out)

    def _visible_chords(self, points: np.ndarray, camera: PinholeCamera) -> list[np.ndarray]:
        """Visible pieces of a curve of points (2 k + 1, 3), every second of which ends a chord."""
        row, low, high = cut_segments(_chords(points), self.all, frustum(camera))
        # The curve bulges from its chords: visibility is tested on the parabola through three of its samples.
        t = (low + INSIDE * (high - low))[:, None]
        first, middle, last = points[2 * row], points[2 * row + 1], points[2 * row + 2]
        at = first * (1 - t) * (1 - 2 * t) + middle * 4 * t * (1 - t) + last * t * (2 * t - 1)
        seen = ~self.hides(at, THIN_AT_SPACE_CURVE)
        begin, stop = runs(np.zeros(len(row), int), row + low, row + high, seen)
        ends = _chords(points)
        step = ends[:, 1] - ends[:, 0]
        start, end = ends[row, 0] + low[:, None] * step[row], ends[row, 0] + high[:, None] * step[row]
        return [np.concatenate([start[a : b + 1], end[b : b + 1]]) for a, b in zip(begin, stop)]

    def _axes(self, index: int, camera: PinholeCamera, seen_curves: np.ndarray) -> np.ndarray:
        """(a,) bool: axes of which both ends follow from what is seen (thesis Table 6.2)."""
        solid, pose = self.placed[index]
        found = boundary(solid)
        ends = np.stack([found.axis_start, found.axis_end], axis=1).reshape(-1, 3)
        rims = _rims(found, ends)
        seen = np.asarray(rims[:, seen_curves].any(axis=1))
        bare = np.nonzero(~rims.any(axis=1))[0]
        at = pose.apply(ends[bare])
        seen[bare] = (at @ frustum(camera).T >= 0.0).all(axis=1) & ~self.hides(at)
        return np.asarray(seen.reshape(-1, 2).all(axis=1))


def _behind_terrain(terrain: Terrain, pose: Pose, points: np.ndarray) -> np.ndarray:
    """(n,) bool: a terrain, at its camera_T_model, stands between the origin and points (n, 3)."""
    back = np.linalg.inv(pose.matrix @ terrain.matrix)
    return hidden_by_terrain(terrain, back[:3, 3], points @ back[:3, :3].T + back[:3, 3], BEFORE_TERRAIN)


def wires_of(found: Boundary) -> Wires:
    """The creases of a boundary, model frame: a segment an edge, a conic a curve, in their order."""
    return Wires(
        np.stack([found.edge_start, found.edge_end], axis=1),
        found.conic[found.curve],
        found.curve_low,
        found.curve_high,
    )


def ends_of(segment: np.ndarray, spans: Spans) -> np.ndarray:
    """(k, 2, 3): the end points of spans of segments (n, 2, 3)."""
    start, end = segment[spans.row, 0], segment[spans.row, 1]
    t = np.stack([spans.low, spans.high], axis=1)[..., None]
    ends: FloatArray = start[:, None] + t * (end - start)[:, None]
    return ends


def round_circles(wires: Wires, spans: Spans) -> Spans:
    """On a whole circle the last span is joined with the first one where both reach the start of the parameter."""
    keep, high = np.ones(len(spans.row), bool), spans.high.copy()
    for k in np.unique(spans.row):
        a, b = np.nonzero(spans.row == k)[0][[0, -1]]
        if (
            a != b
            and wires.high[k] - wires.low[k] > WHOLE_TURN
            and spans.low[a] - wires.low[k] <= SHORTEST_PIECE
            and wires.high[k] - high[b] <= SHORTEST_PIECE
        ):
            high[b], keep[a] = high[a] + 2.0 * np.pi, False
    return Spans(spans.row[keep], spans.low[keep], high[keep])


def frustum(camera: PinholeCamera) -> np.ndarray:
    """Normals (5, 3) n of the planes through the viewpoint with n.x >= 0 inside the outer borders of the image."""
    left, right = (-0.5 - camera.cx) / camera.fx, (camera.width - 0.5 - camera.cx) / camera.fx
    top, bottom = (-0.5 - camera.cy) / camera.fy, (camera.height - 0.5 - camera.cy) / camera.fy
    return np.array([[1.0, 0.0, -left], [-1.0, 0.0, right], [0.0, 1.0, -top], [0.0, -1.0, bottom], [0.0, 0.0, 1.0]])


def _chords(points: np.ndarray) -> np.ndarray:
    """(k, 2, 3) from points (2 k + 1, 3), every second of which ends a chord."""
    return np.stack([points[:-1:2], points[2::2]], axis=1)


def _joined(row: np.ndarray, low: np.ndarray, high: np.ndarray, seen: np.ndarray) -> Spans:
    """Seen pieces, joined where they touch."""
    first, last = runs(row, low, high, seen)
    return Spans(row[first], low[first], high[last])


def _rims(found: Boundary, ends: np.ndarray) -> np.ndarray:
    """(ends, curves) bool: the planar curves about each end of an axis; none about the apex of a cone."""
    centre, normal = found.conic[found.curve, :3, 2], found.curve_normal
    offset = ends[:, None] - centre
    slack = RIM_DISTANCE * found.table.size
    distance = np.linalg.norm(offset, axis=2)
    about = found.ellipse & (distance < slack)
    # An oblique section of a cone is not centred on the axis, but its plane meets the axis in the end.
    oblique = (
        found.ellipse
        & (np.abs((offset * normal).sum(axis=2)) < slack)
        & (distance < np.linalg.norm(found.conic[found.curve, :3, 0], axis=1))
    )
    owners: BoolArray = np.where(about.any(axis=1)[:, None], about, oblique)
    return owners
