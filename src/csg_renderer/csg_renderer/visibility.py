"""Exact hidden-line removal: which pieces of a model's features a camera sees.

Along a crease, visibility can change only where its image crosses the image of another crease or occluding contour,
or the image's border. Creases are split there, and one point of each piece asks the tree whether material stands
between it and the eye. No image is rendered and nothing is sampled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msgs_py import FeatureSet, PinholeCamera, Pose

from .model_features import boundary
from .occlusion import hidden
from .solid import Solid

# Pieces shorter than this, as a fraction of the edge, are rounding.
SHORTEST = 1e-9


@dataclass(frozen=True, eq=False)
class VisibleFeatures:
    """What a camera sees of a model.

    features : FeatureSet, camera frame, metres; a partly hidden feature gives one row a fragment
    model_index : (n,) int32: which feature of model_features(solid) each row is a fragment of
    """

    features: FeatureSet
    model_index: np.ndarray


def visible_features(solid: Solid, pose: Pose, camera: PinholeCamera, others: Sequence[tuple[Solid, Pose]] = ()
                     ) -> FeatureSet:
    """The features of a solid that a camera sees, camera frame, metres, clipped to the image, hidden parts removed.

    pose : camera_T_model; others : solids that may stand in front, each with its own camera_T_model.
    """
    return visible_fragments(solid, pose, camera, others).features


def visible_fragments(solid: Solid, pose: Pose, camera: PinholeCamera, others: Sequence[tuple[Solid, Pose]] = ()
                      ) -> VisibleFeatures:
    """As :func:`visible_features`, with the model feature that each fragment belongs to."""
    scene = [(solid, pose), *others]
    eye = np.zeros(3)
    creases = [np.stack([place.apply(boundary(item).edge_start), place.apply(boundary(item).edge_end)], axis=1)
               for item, place in scene]
    subjects, splitters = creases[0], np.concatenate(creases)
    edge, low, high = split(subjects, splitters, frustum(camera), eye)
    start, along = subjects[edge, 0], subjects[edge, 1] - subjects[edge, 0]
    middle = start + (0.5 * (low + high))[:, None] * along
    seen = ~occluded(scene, eye, middle)
    first, last = runs(edge, low, high, seen)
    fragments = FeatureSet.from_edges(start[first] + low[first, None] * along[first],
                                      start[first] + high[last, None] * along[first])
    return VisibleFeatures(fragments, edge[first].astype(np.int32))


def occluded(scene: Sequence[tuple[Solid, Pose]], eye: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n,) bool: any solid of the scene stands between the eye (3,) and points (n, 3), camera frame."""
    out = np.zeros(len(points), bool)
    for solid, pose in scene:
        back = pose.inverse()
        open_ = np.nonzero(~out)[0]
        out[open_] = hidden(boundary(solid).table, back.apply(eye), back.apply(points[open_]))
    return out


def frustum(camera: PinholeCamera) -> np.ndarray:
    """(5, 3): normals n of the planes through the eye with n.x >= 0 inside the image (its outer pixel borders)."""
    left, right = (-0.5 - camera.cx) / camera.fx, (camera.width - 0.5 - camera.cx) / camera.fx
    top, bottom = (-0.5 - camera.cy) / camera.fy, (camera.height - 0.5 - camera.cy) / camera.fy
    return np.array([[1.0, 0.0, -left], [-1.0, 0.0, right], [0.0, 1.0, -top], [0.0, -1.0, bottom], [0.0, 0.0, 1.0]])


def split(subjects: np.ndarray, splitters: np.ndarray, planes: np.ndarray, eye: np.ndarray
          ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pieces of subject segments (n, 2, 3) inside the frustum, cut where splitters (m, 2, 3) cross them in the image.

    Returns which subject (k,), and low, high (k,): the piece's range, in fractions of the segment; ordered.
    """
    a, b = subjects[:, 0] - eye, subjects[:, 1] - eye
    value_a, value_b = a @ planes.T, b @ planes.T
    with np.errstate(divide='ignore', invalid='ignore'):
        t = value_a / (value_a - value_b)
        enter = np.where(value_a < 0.0, np.where(value_b > 0.0, t, 2.0), 0.0).max(axis=1, initial=0.0)
        leave = np.where(value_b < 0.0, np.where(value_a > 0.0, t, -1.0), 1.0).min(axis=1, initial=1.0)
        crossing = _crossings(a, b, splitters[:, 0] - eye, splitters[:, 1] - eye)
    crossing = np.where((crossing > enter[:, None]) & (crossing < leave[:, None]), crossing, np.nan)
    cuts = np.sort(np.concatenate([enter[:, None], leave[:, None], crossing], axis=1), axis=1)
    cuts[enter >= leave] = np.nan
    row, column = np.nonzero(cuts[:, 1:] - cuts[:, :-1] > SHORTEST)
    return row, cuts[row, column], cuts[row, column + 1]


def _crossings(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(n, m): where segments a-b are crossed, seen from the origin, by segments c-d; NaN where they are not."""
    slack = 1e-9
    own, other = np.cross(a, b), np.cross(c, d)
    # Segment c-d meets the plane of the eye and a-b at s, and a-b the plane of the eye and c-d at t.
    c_side, d_side = own @ c.T, own @ d.T
    a_side, b_side = a @ other.T, b @ other.T
    s, t = c_side / (c_side - d_side), a_side / (a_side - b_side)
    met = (s >= -slack) & (s <= 1.0 + slack) & (t >= -slack) & (t <= 1.0 + slack)
    # Both on one ray, not one before and one behind the eye.
    base, slope = a @ c.T, (b - a) @ c.T
    base_d, slope_d = a @ d.T, (b - a) @ d.T
    same = (base + t * slope) * (1.0 - s) + (base_d + t * slope_d) * s > 0.0
    return np.where(met & same, t, np.nan)


def runs(curve: np.ndarray, low: np.ndarray, high: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and last piece of each run of wanted pieces that touch; pieces ordered along each curve."""
    index = np.nonzero(wanted)[0]
    before, after = index[:-1], index[1:]
    apart = (curve[after] != curve[before]) | (low[after] - high[before] > 2.0 * SHORTEST)
    edge = np.ones(min(len(index), 1), bool)
    return index[np.concatenate([edge, apart])], index[np.concatenate([apart, edge])]
