"""Ideal data for the matcher: the features of a scene that both cameras of a rig see, with the truth about them.

The thesis calls data without sensing errors ideal (5.11.3.1). The same data can be degraded, by a seed, in the four
ways in which real data differs: edges in fragments, end points displaced within a stated error (5.4, 5.11.3.4),
features missing, and features of objects that are not looked for (5.11.6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msgs_py import BIN, FeatureKind, FeatureSet, Interpretation, Pose, StereoRig
from msgs_py.numeric.typed import FloatArray
from msgs_py.renaming import renamed_arguments

from ..brep.model_features import model_features
from ..scene.scene import Placement, Scene
from ..scene.terrain import Terrain
from ..visibility.hidden_lines import stereo_fragments
from .settings import LEAST_LENGTH


@dataclass(frozen=True)
class Degradation:
    """How data departs from the ideal; the default changes nothing.

    Parameters
    ----------
    pieces : int
        An edge is broken into up to this many fragments.
    gap : float
        From 0 to 1. The part of an edge's length that is lost in breaking it.
    err_par, err_per : float
        Metres. End points are moved inside an ellipsoid with these half-axes, along and across the feature (uniformly),
        and the data states these errors. A curve's or axis' centres move in the same way.
    normal_cone : float
        Radians. A curve's normal is tilted by up to this angle.
    keep : float
        From 0 to 1. The probability that a feature is kept.
    shortest : float
        Metres. Shorter fragments of edges are lost.

    Raises
    ------
    ValueError
        A field is out of its range; the message names it.

    References
    ----------
    Thesis 5.4 for the ellipsoid, 5.11.3.4.
    """

    pieces: int = 1
    gap: float = 0.1
    err_par: float = 0.0
    err_per: float = 0.0
    normal_cone: float = 0.0
    keep: float = 1.0
    shortest: float = 0.0

    def __post_init__(self) -> None:
        if self.pieces < 1:
            raise ValueError(f'pieces: expected a whole number >= 1, got {self.pieces}')
        for name in ('err_par', 'err_per', 'normal_cone', 'shortest'):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ValueError(f'{name}: expected a number >= 0, got {getattr(self, name)}')
        for name in ('gap', 'keep'):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f'{name}: expected a number in 0..1, got {getattr(self, name)}')


@dataclass(frozen=True, eq=False)
class IdealData:
    """Features with their true interpretation; left camera frame, metres.

    Parameters
    ----------
    features : FeatureSet
        n features.
    object_index : (n,) int32
        Which placed object each feature belongs to; BIN (-1) for clutter.
    model_index : (n,) int32
        Which feature of that object's model it is a fragment of.
    sign : (n,) int8
        +1 where a feature has the direction of its model feature, -1 where it has the opposite one; +1 for a curve.
    names : tuple of str
        Of the placed objects.
    poses : tuple of Pose
        left_T_model of the placed objects.
    """

    features: FeatureSet
    object_index: np.ndarray
    model_index: np.ndarray
    sign: np.ndarray
    names: tuple[str, ...]
    poses: tuple[Pose, ...]

    def truth(self, index: int = 0) -> Interpretation:
        """The true interpretation of one of the placed objects: its features paired, all others in the bin."""
        mine = self.object_index == index
        return Interpretation(
            self.names[index],
            np.where(mine, self.model_index, BIN),
            np.where(mine, self.sign, 0),
            self.poses[index],
            residual_rms=0.0,
        )


@renamed_arguments(wear='degradation')
def ideal_data(
    scene: Scene,
    rig: StereoRig,
    left_T_scene: Pose | None = None,
    *,
    degradation: Degradation | None = None,
    clutter: Sequence[Placement] = (),
    seed: int = 0,
) -> IdealData:
    """The features of a scene's objects that both cameras see, with the true assignment, sign and pose.

    A terrain hides what is behind it, and has none itself.

    Parameters
    ----------
    scene : Scene
    rig : StereoRig
    left_T_scene : Pose, optional
        Place of the left camera; by default that of the scene file.
    degradation : Degradation, optional
        How the data departs from the ideal; by default not at all.
    clutter : sequence of Placement
        Further objects, scene frame, which hide what is behind them and whose features belong to no model.
    seed : int
        Of everything random, the direction of edges included.

    Returns
    -------
    IdealData

    Raises
    ------
    ValueError
        An object is placed with shear or unequal scales, and so has no pose.

    Examples
    --------
    >>> from csg_renderer import default_rig, load_scene
    >>> scene = load_scene('l_shape_v1')
    >>> data = ideal_data(scene, default_rig(scene))
    >>> len(data.features), data.names, int((data.truth().assignment >= 0).sum())
    (15, ('l_shape',), 15)
    """
    rng = np.random.default_rng(seed)
    camera = left_T_scene if left_T_scene is not None else scene.camera_T_scene
    placements = [*scene.placements, *clutter]
    placed = [(item.model, camera.compose(item.pose)) for item in placements]
    degradation = degradation if degradation is not None else Degradation()
    sets, objects, models, signs = [], [], [], []
    for k, ((solid, pose), (seen, index)) in enumerate(zip(placed, stereo_fragments(placed, rig))):
        if isinstance(solid, Terrain):
            continue
        model = model_features(solid).transformed(pose)
        seen, index = _broken(seen, index, degradation, rng)
        seen = _reversed(seen, rng)
        along = np.einsum('ni,ni->n', seen.directions, model.directions[index])
        sets.append(_displaced(seen, degradation, rng))
        objects.append(np.full(len(seen), k if k < len(scene.placements) else BIN))
        models.append(index)
        signs.append(np.where(along >= 0.0, 1, -1))
    features = FeatureSet.concatenate(sets)
    keep = rng.random(len(features)) < degradation.keep
    count = len(scene.placements)
    object_index, model_index, sign = (
        np.concatenate([np.zeros(0, int), *part])[keep] for part in (objects, models, signs)
    )
    return IdealData(
        features.select(keep),
        object_index.astype(np.int32),
        model_index.astype(np.int32),
        sign.astype(np.int8),
        tuple(item.name for item in placements[:count]),
        tuple(pose for _, pose in placed[:count]),
    )


def _broken(
    features: FeatureSet, index: np.ndarray, degradation: Degradation, rng: np.random.Generator
) -> tuple[FeatureSet, np.ndarray]:
    """Edges in fragments with gaps between them; curves and axes stay whole. Short fragments are dropped."""
    start, end, row = [], [], []
    for k in range(len(features)):
        count = int(rng.integers(1, degradation.pieces + 1)) if features.kind[k] == FeatureKind.EDGE else 1
        cuts = np.sort(rng.random(count - 1))
        low, high = np.concatenate([[0.0], cuts]), np.concatenate([cuts, [1.0]])
        # Each fragment loses its share of the gap at the ends where it was broken.
        loss = 0.5 * degradation.gap * (high - low)
        low, high = low + loss * (low > 0.0), high - loss * (high < 1.0)
        vector = features.end[k] - features.start[k]
        start.append(features.start[k] + low[:, None] * vector)
        end.append(features.start[k] + high[:, None] * vector)
        row.append(np.full(count, k))
    if not row:
        return features, index
    rows = np.concatenate(row)
    whole = features.select(rows)
    out = FeatureSet(
        whole.kind,
        np.concatenate(start),
        np.concatenate(end),
        whole.radii,
        whole.err_par,
        whole.err_per,
        whole.major_axis,
        whole.arc,
    )
    keep = (out.kind != FeatureKind.EDGE) | (out.lengths >= degradation.shortest)
    return out.select(keep), index[rows][keep]


def _reversed(features: FeatureSet, rng: np.random.Generator) -> FeatureSet:
    """Half of the edges and axes with the opposite direction: recovered lines have no direction of their own."""
    turn = ((rng.random(len(features)) < 0.5) & (features.kind != FeatureKind.CURVE))[:, None]
    return FeatureSet(
        features.kind,
        np.where(turn, features.end, features.start),
        np.where(turn, features.start, features.end),
        features.radii,
        features.err_par,
        features.err_per,
        features.major_axis,
        features.arc,
    )


def _displaced(features: FeatureSet, degradation: Degradation, rng: np.random.Generator) -> FeatureSet:
    """End points moved inside their ellipsoids, normals inside their cone; the errors stated."""
    n = len(features)
    direction = features.directions
    start = features.start + _in_ellipsoid(direction, degradation, rng)
    end = features.end + _in_ellipsoid(direction, degradation, rng)
    curve = (features.kind == FeatureKind.CURVE)[:, None]
    axis = rng.normal(size=(n, 3))
    axis -= direction * (axis * direction).sum(axis=1, keepdims=True)
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), LEAST_LENGTH)
    tilt = (degradation.normal_cone * np.sqrt(rng.random(n)))[:, None]
    tilted = np.cos(tilt) * direction + np.sin(tilt) * axis
    major = features.major_axis - tilted * (features.major_axis * tilted).sum(axis=1, keepdims=True)
    major = major / np.linalg.norm(major, axis=1, keepdims=True)
    return FeatureSet(
        features.kind,
        start,
        np.where(curve, start + tilted, end),
        features.radii,
        np.full(n, degradation.err_par),
        np.full(n, degradation.err_per),
        major,
        features.arc,
    )


def _in_ellipsoid(direction: np.ndarray, degradation: Degradation, rng: np.random.Generator) -> np.ndarray:
    """(n, 3): uniform in the ellipsoid with half-axis err_par along each direction and err_per across."""
    n = len(direction)
    ball = rng.normal(size=(n, 3))
    ball *= (rng.random(n) ** (1.0 / 3.0) / np.maximum(np.linalg.norm(ball, axis=1), LEAST_LENGTH))[:, None]
    along = (ball * direction).sum(axis=1, keepdims=True) * direction
    errors: FloatArray = degradation.err_par * along + degradation.err_per * (ball - along)
    return errors
