"""The last fit: depth errors of a camera pair do not turn the pose; other data keeps the plain fit."""

from __future__ import annotations

import numpy as np

from model_matcher import MatchParams, match
from model_matcher.closed_form.synthetic.scenes import chipped_block
from model_matcher.model.index import indexed
from model_matcher.model.problem import make_problem
from model_matcher.verification import acceptance
from model_matcher.verification.interpretations import covered
from model_matcher.verification.pose_fit import fitted_poses
from msgs_py import FeatureSet, Pose


def seen(model: FeatureSet, truth: Pose, across: float, along: float, rng: np.random.Generator) -> FeatureSet:
    """The model's edges as a pair sees them: end points off by sigma across and along the line of sight, metres."""
    placed = model.transformed(truth)
    ends = []
    for points in (placed.start, placed.end):
        ray = points / np.linalg.norm(points, axis=1, keepdims=True)
        noise = rng.normal(0.0, across, points.shape)
        noise += ((rng.normal(0.0, along, len(points)) - (noise * ray).sum(axis=1))[:, None]) * ray
        ends.append(points + noise)
    return FeatureSet.from_edges(*ends, err_par=1e-3, err_per=1e-3)


def errors(across: float, along: float, plain: bool, monkeypatch) -> np.ndarray:
    """Degrees and millimetres of 20 matches."""
    if plain:
        monkeypatch.setattr(
            acceptance, 'fitted_poses', lambda *arguments: fitted_poses(*arguments[:-1], np.zeros_like(arguments[-1]))
        )
    model, rng, result = chipped_block(), np.random.default_rng(8), []
    for _ in range(20):
        truth = Pose.from_rotation_vector(rng.normal(0.0, 1.0, 3), [*rng.uniform(-0.02, 0.02, 2), 0.3])
        best = match(model, seen(model, truth, across, along, rng), MatchParams()).best
        error = min((pose.error_to(truth) for pose in (best.pose, *best.symmetric_poses)), key=lambda e: e.rotation)
        result.append((error.rotation_deg, 1e3 * error.translation))
    monkeypatch.undo()
    return np.array(result)


def test_depth_errors_do_not_turn_the_pose(monkeypatch):
    plain = errors(5e-5, 5e-4, True, monkeypatch)
    settled = errors(5e-5, 5e-4, False, monkeypatch)
    assert (np.median(settled, axis=0) < 0.75 * np.median(plain, axis=0)).all()


def test_errors_alike_in_all_directions_are_fitted_about_as_well_as_before(monkeypatch):
    plain = errors(2e-4, 2e-4, True, monkeypatch)
    settled = errors(2e-4, 2e-4, False, monkeypatch)
    assert (np.median(settled, axis=0) < 1.35 * np.median(plain, axis=0)).all()


def test_exact_data_stays_exact():
    model = chipped_block()
    truth = Pose.from_rotation_vector([0.3, -0.4, 0.2], [0.01, 0.0, 0.3])
    best = match(model, model.transformed(truth)).best
    assert min(pose.error_to(truth).rotation for pose in (best.pose, *best.symmetric_poses)) < 1e-7


def test_a_grid_is_not_a_period_off_though_something_lies_along_each_of_its_lines():
    lines = [((x, -0.1, 0.0), (x, 0.1, 0.0)) for x in np.arange(-0.1, 0.11, 0.04)]
    lines += [((-0.12, y, 0.0), (0.12, y, 0.0)) for y in (-0.08, -0.03, 0.02, 0.09)]
    model = FeatureSet.from_edges(*np.array(lines).swapaxes(0, 1))
    truth = Pose.from_rotation_vector([0.3, -0.2, 0.1], [0.0, 0.0, 0.6])
    # A short edge outside, where the next line would be.
    stray = FeatureSet.from_edges([[0.14, -0.05, 0.0]], [[0.14, -0.01, 0.0]])
    noise = np.random.default_rng(1)
    data = FeatureSet.concatenate([model, stray]).transformed(truth)
    data = FeatureSet.from_edges(
        data.start + noise.normal(0, 2e-4, data.start.shape),
        data.end + noise.normal(0, 2e-4, data.end.shape),
        err_par=5e-4,
        err_per=5e-4,
    )
    best = match(model, data).best
    poses = (best.pose, *best.symmetric_poses)
    assert min(np.linalg.norm(pose.translation - truth.translation) for pose in poses) < 2e-3


def test_covered_length_counts_each_place_once():
    model = chipped_block()
    problem = make_problem(indexed(model, 'block'), model, MatchParams())
    whole = np.arange(len(model), dtype=np.int32)
    here = np.append(np.eye(3).ravel(), np.zeros(3))
    twice = FeatureSet.concatenate([model, model])
    again = make_problem(indexed(model, 'block'), twice, MatchParams())
    assert np.isclose(covered(problem, here, whole), model.lengths.sum())
    assert np.isclose(covered(again, here, np.tile(whole, 2)), model.lengths.sum())
