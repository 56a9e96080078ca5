"""Data at its limits: a pose explains all of it, and nearly nothing is to spare.

Whoever says that fewer features are the most that any pose explains is wrong, so such scenes referee certificates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import BIN, FeatureKind, FeatureSet, Pose
from msgs_py.numeric.typed import FloatArray, Int32Array

from ...geometry.back_projection import fit_one
from ...geometry.features import FeatureRows
from ...geometry.pose_rows import as_motion, as_pose
from ...model.index import ModelIndex, index_model
from ...model.problem import make_problem
from ...params import MatchParams
from ...proof.branch_and_bound import sample_of
from ...proof.feasibility import all_fit, common_pose
from .scenes import MODELS, random_polyhedron, random_pose


@dataclass(frozen=True)
class StrainedScene:
    """Data with a pose that explains so many of its features.

    Attributes
    ----------
    index : ModelIndex
        The model.
    data : FeatureSet
        Camera frame, metres.
    params : MatchParams
        With which the pose explains them.
    pose : Pose
        camera_T_model.
    assignment : (n,) int32
        The model feature of each data feature under the pose, BIN for none.
    """

    index: ModelIndex
    data: FeatureSet
    params: MatchParams
    pose: Pose
    assignment: Int32Array

    @property
    def explained(self) -> int:
        """How many data features the pose explains."""
        return int((self.assignment >= 0).sum())


def strained_scene(
    seed: int, names: tuple[str, ...] = tuple(MODELS), most: int = 9, spurious: int = 4
) -> StrainedScene:
    """A seeded scene, of data at 0.90 to 0.999 of every tolerance.

    Cones are 1 to 60 degrees, stated errors 0.1 to 10 % of the model's size. Data is off in one of three ways: every
    end for itself, as a small motion of all would have it, or the one upon the other. In half of the scenes the errors
    are then stated so small that hardly any pose is left that explains it.

    Parameters
    ----------
    seed : int
    names : tuple of str
        Models, of MODELS.
    most : int
        Features of the model that are seen, at most.
    spurious : int
        Features of other objects, at most.

    Returns
    -------
    StrainedScene

    Examples
    --------
    >>> scene = strained_scene(3)
    >>> 3 <= scene.explained <= len(scene.data) <= 9 + 4
    True
    """
    rng = np.random.default_rng([seed, 41])
    while True:
        index = _index(names[int(rng.integers(len(names)))])
        cone = float(np.exp(rng.uniform(np.log(1.0), np.log(60.0))))
        error = index.size * float(np.exp(rng.uniform(np.log(1e-3), np.log(0.1))))
        params = MatchParams(
            max_cone_deg=cone,
            curve_cone_deg=cone,
            fracdev=float(rng.choice([1e-4, 0.004, 0.012])),
            overhang=float(rng.choice([0.0, 0.04])),
            curvedev=float(rng.choice([0.01, 0.1])),
            min_matched=3,
        )
        pose = random_pose(rng)
        seen = rng.permutation(len(index))[: int(rng.integers(3, most + 1))]
        share = rng.uniform(0.90, 0.999, len(seen))
        off = _misses(rng, index.features.select(seen))
        pieces = [_piece(rng, index, int(i), params, error, s, offs) for i, s, offs in zip(seen, share, off)]
        own = FeatureSet.concatenate([piece for piece in pieces if piece is not None] or [index.features.select([])])
        others = [_spurious(rng, index, error) for _ in range(int(rng.integers(spurious + 1)))]
        data = FeatureSet.concatenate([own.transformed(pose), *(one.transformed(pose) for one in others)])
        scene = _explained(index, data.select(rng.permutation(len(data))), params, pose)
        if scene.explained >= 3 and rng.random() < 0.5:
            scene = tightened(scene, 1.0 + float(rng.uniform(1e-3, 0.1)))
        if scene.explained >= 3:
            return scene


def tightened(scene: StrainedScene, loosely: float) -> StrainedScene:
    """The scene with errors stated so small that with less a pose of all its explained data is not found any more.

    Parameters
    ----------
    scene : StrainedScene
    loosely : float
        How many times that the errors are stated, from 1 on.

    Returns
    -------
    StrainedScene
    """

    def with_errors(scale: float) -> tuple[MatchParams, FloatArray, bool]:
        params = scene.params.replace(err_scale=scale)
        problem = make_problem(scene.index, scene.data, params)
        a = np.flatnonzero(scene.assignment[problem.keep] != BIN)
        motion = as_motion(scene.pose)
        pairings = a, scene.assignment[problem.keep][a].astype(np.int64), sample_of(problem)
        found = common_pose(motion, *pairings)
        return params, motion, found and all_fit(motion, *pairings, scene.index.kind, problem.radius_tol)

    low, high = 0.0, 1.0
    while high - low > 1e-3 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if with_errors(middle)[2] else (middle, high)
    params, motion, found = with_errors(min(high * loosely, 1.0))
    return _explained(scene.index, scene.data, params, as_pose(motion)) if found else scene


def _explained(index: ModelIndex, data: FeatureSet, params: MatchParams, pose: Pose) -> StrainedScene:
    """The scene with what the pose explains."""
    return StrainedScene(index, data, params, pose, explained_by(index, data, params, pose))


def explained_by(index: ModelIndex, data: FeatureSet, params: MatchParams, pose: Pose) -> Int32Array:
    """(n,) int32 the model feature of every data feature under a pose, BIN for none."""
    problem = make_problem(index, data, params)
    back = pose.inverse()
    points, directions = back.apply(problem.rows[:, :3]), problem.rows[:, 3:6] @ pose.rotation
    lines = FeatureRows(index.rows, index.kind)
    assignment = np.full(problem.n_data, BIN, np.int32)
    for k, (point, direction) in enumerate(zip(points, directions)):
        for i in range(len(index)):
            if fit_one(k, problem.features, i, lines, tuple(point), tuple(direction), 1.0) >= 0.0:
                assignment[problem.keep[k]] = i
    return assignment


_INDEXES: dict[str, ModelIndex] = {}


def _index(name: str) -> ModelIndex:
    """The model of that name, made ready once."""
    if name not in _INDEXES:
        _INDEXES[name] = index_model(MODELS[name](), name)
    return _INDEXES[name]


def _misses(rng: np.random.Generator, features: FeatureSet) -> FloatArray:
    """(m, 2, 3) directions in which the ends of features are off; their lengths, at most 1, are shares."""
    m = len(features)
    how = int(rng.integers(3))
    off = rng.normal(size=(m, 2, 3))
    if how == 1:  # a turn about the middle, and a shift
        ends = np.stack([features.start, features.end], axis=1)
        turn, shift = rng.normal(size=3), rng.normal(size=3)
        off = np.cross(turn, ends - ends.mean(axis=(0, 1))) + shift * rng.uniform(0.0, 0.03)
        return np.asarray(off / np.linalg.norm(off, axis=2).max())
    if how == 2:  # opposite ends
        off[:, 1] = -off[:, 0] * rng.choice([1.0, 0.3, -1.0], m)[:, None]
    return np.asarray(off / np.linalg.norm(off, axis=2, keepdims=True))


def _piece(
    rng: np.random.Generator,
    index: ModelIndex,
    i: int,
    params: MatchParams,
    error: float,
    share: float,
    off: FloatArray,
) -> FeatureSet | None:
    """A fragment of model feature i, model frame, off by a share of its tolerances; None when there is no room."""
    m, kind = index.rows[i], int(index.kind[i])
    error = error * float(rng.choice([0.2, 1.0, 1.0]))
    middle, along, half = m[:3], m[3:6], m[6]
    across = np.hypot(error, params.fracdev * index.size)
    flat = off - (off @ along)[:, None] * along
    if kind == FeatureKind.CURVE:
        tilt = share * np.radians(params.curve_cone_deg)
        side = flat[1] / max(np.linalg.norm(flat[1]), 1e-12)
        centre = middle + share * across * (flat[0] + rng.choice([-1.0, 0.0, 1.0]) * along)
        radii = m[7:9] + share * (params.curvedev * index.max_radius + across) * rng.choice([-1.0, 0.0, 1.0], 2)
        normal = np.cos(tilt) * along + np.sin(tilt) * side
        return FeatureSet.from_curves([centre], [normal], np.maximum(radii, 1e-4)[None], [error], [error])
    h = half * rng.uniform(0.05, 1.02)
    ends = share * across * flat * np.minimum(1.0, 1.0 / np.maximum(np.linalg.norm(flat, axis=1), 1e-12))[:, None]
    cone = min(np.arctan2(2.0 * across, max(2.0 * h - 2.0 * error, 1e-12)), np.radians(params.max_cone_deg))
    sine = np.linalg.norm(ends[1] - ends[0]) / (2.0 * h)
    if sine > share * np.sin(cone):
        centre = ends.mean(axis=0)
        ends = centre + (ends - centre) * share * np.sin(cone) / sine
        sine = share * np.sin(cone)
    cosine = np.sqrt(1.0 - sine * sine)
    room = share * (half + across + 2.0 * params.overhang * h) - cosine * h
    if room < 0.0:
        return None
    place = middle + room * float(rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)])) * along
    start, end = place - cosine * h * along + ends[0], place + cosine * h * along + ends[1]
    if rng.random() < 0.5:
        start, end = end, start
    one = FeatureSet.from_edges([start], [end], [error], [error])
    return FeatureSet(np.array([kind], np.uint8), one.start, one.end, one.radii, one.err_par, one.err_per)


def _spurious(rng: np.random.Generator, index: ModelIndex, error: float) -> FeatureSet:
    """An edge of another object near the model, model frame."""
    other = random_polyhedron(int(rng.integers(1 << 30)))
    edge = other.select([int(rng.integers(len(other)))])
    shift = index.middle - edge.midpoints[0] + rng.uniform(-0.5, 0.5, 3) * index.size
    return FeatureSet.from_edges(edge.start + shift, edge.end + shift, [error], [error])
