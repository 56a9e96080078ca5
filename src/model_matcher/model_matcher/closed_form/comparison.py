"""Found against true: the measures of closed-form testing (thesis 4.12).

Everything here compares plain values with a truth that is known because the image was rendered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from csg_renderer import Frame, Scene
from csg_renderer.scene.solid import FACES
from csg_renderer.scene.terrain import Terrain, gradient, height_at
from msgs_py import BIN, FeatureKind, FeatureSet, Interpretation, Pose, PoseError

from ..geometry.pose_rows import step_between
from .settings import SAME_DIRECTION_DEG, SAME_PLACE_M


@dataclass(frozen=True)
class EdgeComparison:
    """How well straight edges were recovered.

    Attributes
    ----------
    true_index : (m,) int
        Which true edge each found one belongs to, -1 for none.
    covered : (n,) float64
        The part of each true edge that found edges cover, 0..1.
    true_lengths : (n,) float64
        Metres.
    direction_deg : (m,) float64
        Degrees, angle of each found edge to its true one; NaN where it belongs to none.
    across_m : (m, 2) float64
        Metres, distances of its ends from the true line; NaN where it belongs to none.
    """

    true_index: np.ndarray
    covered: np.ndarray
    true_lengths: np.ndarray
    direction_deg: np.ndarray
    across_m: np.ndarray

    @property
    def edges_found(self) -> int:
        """True edges of which enough is covered."""
        return int((self.covered >= 1.0 - self.covered).sum())

    @property
    def recall(self) -> float:
        """The part of the true length that was found."""
        total = self.true_lengths.sum()
        return float((self.covered * self.true_lengths).sum() / total) if total > 0 else float('nan')

    @property
    def precision(self) -> float:
        """The part of the found edges that belong to a true one."""
        return float((self.true_index >= 0).mean()) if len(self.true_index) else float('nan')

    def summary(self) -> dict[str, float | int | None]:
        """The figures by name; None (JSON has no NaN) for those that nothing was found to compute from."""
        good = self.true_index >= 0
        figures: dict[str, float | int] = {
            'true_edges': len(self.covered),
            'found_edges': len(self.true_index),
            'true_edges_found': self.edges_found,
            'false_edges': int((~good).sum()),
            'recall_of_length': self.recall,
            'precision': self.precision,
            'direction_error_deg_median': _median(self.direction_deg[good]),
            'distance_from_line_m_median': _median(self.across_m[good]),
        }
        return {name: figure if np.isfinite(figure) else None for name, figure in figures.items()}


def compare_edges(
    true: FeatureSet,
    found: FeatureSet,
    same_direction_deg: float = SAME_DIRECTION_DEG,
    same_place_m: float = SAME_PLACE_M,
) -> EdgeComparison:
    """Compare straight edges found with the true visible ones.

    Parameters
    ----------
    true, found : FeatureSet
        In the same frame, metres; kinds other than edges are left out.
    same_direction_deg : float
        Degrees, largest angle between a found edge and its true one.
    same_place_m : float
        Metres, largest distance of a found edge's ends from its true one.

    Returns
    -------
    EdgeComparison

    Examples
    --------
    >>> edge = FeatureSet.from_edges([[0, 0, 1]], [[0.1, 0, 1]])
    >>> half = FeatureSet.from_edges([[0, 0, 1]], [[0.05, 0, 1]])
    >>> compare_edges(edge, half).recall
    0.5
    """
    true, found = true.of_kind(FeatureKind.EDGE), found.of_kind(FeatureKind.EDGE)
    n, m = len(true), len(found)
    if n == 0 or m == 0:
        return EdgeComparison(np.full(m, -1), np.zeros(n), true.lengths, np.full(m, np.nan), np.full((m, 2), np.nan))
    cosine = np.abs(found.directions @ true.directions.T)
    angle = np.degrees(np.arctan2(_sine(found.directions, true.directions), cosine))
    ends = np.stack([found.start, found.end], axis=1)
    offset = ends[:, None] - true.start[None, :, None]  # (m, n, 2, 3)
    along = np.einsum('mnek,nk->mne', offset, true.directions)
    beyond = along - np.clip(along, 0.0, true.lengths[None, :, None])
    across = np.linalg.norm(offset - along[..., None] * true.directions[None, :, None], axis=-1)
    distance = np.hypot(across, beyond).max(axis=2)
    distance[angle > same_direction_deg] = np.inf
    nearest = distance.argmin(axis=1)
    rows = np.arange(m)
    index = np.where(distance[rows, nearest] <= same_place_m, nearest, -1)
    good = index >= 0
    covered = np.array([_coverage(along[(index == edge), edge], true.lengths[edge]) for edge in range(n)])
    return EdgeComparison(
        index,
        covered,
        true.lengths,
        np.where(good, angle[rows, nearest], np.nan),
        np.where(good[:, None], across[rows, nearest], np.nan),
    )


def best_pose_error(found: Interpretation, truth: Pose, others: Sequence[Pose] = ()) -> PoseError:
    """The error of a found pose, or of the one equal to it that is nearest to the truth.

    Parameters
    ----------
    found : Interpretation
        Its pose and its symmetric poses are all tried.
    truth : Pose
        camera_T_model.
    others : sequence of Pose
        Further poses that are as true: the symmetries of the model applied to the truth.

    Returns
    -------
    PoseError
        The least by rotation, then translation.
    """
    errors = [
        truth_pose.error_to(pose) for truth_pose in (truth, *others) for pose in (found.pose, *found.symmetric_poses)
    ]
    return min(errors, key=lambda error: (round(error.rotation, 3), error.translation))


def squared_deviation(found: Interpretation, truth: Pose) -> float:
    """The error of a pose in units of its stated covariance, squared: of chi squared of six where that is true.

    Parameters
    ----------
    found : Interpretation
        With its covariance. Where an equal pose is nearer to the truth than its own, the truth is taken for that.
    truth : Pose
        camera_T_model.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        The interpretation states no covariance.

    Examples
    --------
    >>> spread = np.diag([1e-6] * 3 + [1e-4] * 3)
    >>> found = Interpretation('block', [0], [1], Pose.from_rotation_vector([0.02, 0, 0]), covariance=spread)
    >>> round(squared_deviation(found, Pose.identity()), 6)
    4.0
    """
    if found.covariance is None:
        raise ValueError('found: the interpretation states no covariance')
    poses = (found.pose, *found.symmetric_poses)
    near = min(poses, key=lambda pose: (round(pose.error_to(truth).rotation, 3), pose.error_to(truth).translation))
    # From an equal pose back to the stated one, by the model's symmetry.
    truth = truth.compose(near.inverse().compose(found.pose))
    error = step_between(truth, found.pose)
    return float(error @ np.linalg.solve(found.covariance, error))


@dataclass(frozen=True)
class AssignmentComparison:
    """How many pairings of an interpretation are right.

    Attributes
    ----------
    matched : int
        Data features that are paired.
    right : int
        Those paired with the model feature that they lie on.
    signs_right : int
        Of these, those with the direction that the true pose gives them.
    spurious : int
        Those paired with a model feature that they do not lie on.
    """

    matched: int
    right: int
    signs_right: int
    spurious: int


def compare_assignment(
    found: Interpretation, model: FeatureSet, data: FeatureSet, same_place_m: float = SAME_PLACE_M / 2
) -> AssignmentComparison:
    """Compare the pairings of an interpretation with where data and model lie.

    The interpretation's own pose is used, so that a symmetric answer is judged by its own symmetry.

    Parameters
    ----------
    found : Interpretation
        Of the data.
    model : FeatureSet
        Model frame, metres.
    data : FeatureSet
        Camera frame, metres.
    same_place_m : float
        Metres, largest distance of a data edge's ends from its model edge; more where the data edge states more.

    Returns
    -------
    AssignmentComparison
    """
    placed = model.transformed(found.pose)
    matched = right = signs = spurious = 0
    for index in np.flatnonzero(found.assignment != BIN):
        matched += 1
        target = int(found.assignment[index])
        if data.kind[index] != placed.kind[target]:
            spurious += 1
            continue
        # What states that an end may be centimetres off (an axis with a far apex, say) is no wrong pairing for that.
        allowed = max(same_place_m, float(np.hypot(data.err_par[index], data.err_per[index])))
        if data.kind[index] == FeatureKind.CURVE:
            close = np.linalg.norm(placed.start[target] - data.start[index]) <= allowed
        else:
            single = placed.select([target])
            # Both ends say it: the direction of an edge of a few millimetres says little.
            paired = compare_edges(_as_edges(single), _as_edges(data.select([index])), np.inf, allowed)
            close = paired.true_index[0] == 0
        if not close:
            spurious += 1
            continue
        right += 1
        direction = np.sign(data.directions[index] @ placed.directions[target])
        signs += int(found.sign[index] == direction)
    return AssignmentComparison(matched, right, signs, spurious)


def surface_residual(scene: Scene, frame: Frame) -> float:
    """The largest distance of a rendered point from the surface that its ids name: ray caster against closed form.

    To first order: the value of the surface's equation over the length of its gradient.

    Parameters
    ----------
    scene : Scene
        What was rendered.
    frame : Frame
        The picture of it.

    Returns
    -------
    float
        Metres; 0 for an empty picture.
    """
    scene_T_camera = frame.camera_T_scene.inverse()
    points = scene_T_camera.apply(frame.points)
    worst = 0.0
    for index, primitive in enumerate(scene.primitives):
        seen = frame.primitive_id == index
        if not seen.any():
            continue
        inverse = np.linalg.inv(primitive.matrix)
        local = points[seen] @ inverse[:3, :3].T + inverse[:3, 3]
        if isinstance(primitive, Terrain):
            value, normal = local[:, 2] - height_at(primitive, local), gradient(primitive, local)
        else:
            value, normal = _surface_value(primitive.kind, frame.face_id[seen], local)
        slope = np.linalg.norm(normal @ inverse[:3, :3], axis=1)
        worst = max(worst, float(np.max(np.abs(value) / np.maximum(slope, 1e-300))))
    return worst


def _surface_value(kind: str, face: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Value (n,) and gradient (n, 3) of each point's surface equation in the primitive's unit frame (Table 4.1)."""
    value, gradient = np.zeros(len(p)), np.zeros((len(p), 3))
    name = np.array(FACES[kind])[face]
    for text in np.unique(name):
        rows = name == text
        q = p[rows]
        if text == 'curved':
            bend = np.array({'CYLINDER': [1.0, 1.0, 0.0], 'CONE': [1.0, 1.0, -1.0], 'SPHERE': [1.0, 1.0, 1.0]}[kind])
            value[rows] = q**2 @ bend - (0.0 if kind == 'CONE' else 1.0)
            gradient[rows] = 2.0 * q * bend
        else:
            axis = 'xyz'.index(text[0])
            value[rows] = q[:, axis] - float(text[-1])
            gradient[rows, axis] = 1.0
    return value, gradient


def _as_edges(features: FeatureSet) -> FeatureSet:
    return FeatureSet.from_edges(features.start, features.end)


def _sine(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(m, n) sine of the angle between unit vectors a (m, 3) and b (n, 3)."""
    sines: np.ndarray = np.linalg.norm(np.cross(a[:, None], b[None]), axis=-1)
    return sines


def _coverage(spans: np.ndarray, length: float) -> float:
    """The part of 0..length that the spans (k, 2) cover together."""
    if not len(spans) or length <= 0.0:
        return 0.0
    spans = np.clip(np.sort(spans, axis=1), 0.0, length)
    spans = spans[np.argsort(spans[:, 0])]
    covered, reach = 0.0, 0.0
    for first, last in spans:
        covered += max(0.0, last - max(first, reach))
        reach = max(reach, last)
    return covered / length


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if values.size else float('nan')
