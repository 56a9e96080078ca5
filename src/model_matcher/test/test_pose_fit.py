"""The last fit of a pose: its covariance is that of its errors, and it is the best that the data allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from model_matcher import MatchParams, match
from model_matcher.closed_form.comparison import squared_deviation
from model_matcher.closed_form.synthetic.scenes import MODELS, chipped_block, measured, random_pose
from model_matcher.geometry.features import FeatureRows
from model_matcher.geometry.weighted_fit import weighted_fit
from model_matcher.model.index import feature_rows, index_model
from model_matcher.verification.settings import STATED_WORTH
from msgs_py import FeatureKind, FeatureSet, Pose
from msgs_py.numeric.robust import OUTLYING

POSES = 100


def deviations(name: str, count: int = POSES, **noise: float) -> np.ndarray:
    """Squared errors of poses of a model found in data that states its covariance, in units of theirs."""
    model = MODELS[name]()
    index, result = index_model(model, name), []
    for seed in range(count):
        rng = np.random.default_rng([seed, 5])
        truth = random_pose(rng, 0.03)
        best = match(index, measured(model, truth, rng, **noise)).best
        assert best is not None and best.pose is not None
        result.append(squared_deviation(best, truth))
    return np.array(result)


def test_stated_covariances_are_those_of_the_errors_for_every_model():
    """Noise of known covariance, worse along the line of sight, makes chi squared of six degrees of freedom."""
    found = {name: deviations(name) for name in MODELS}
    for name, values in found.items():
        assert kstest(values, chi2(6).cdf).pvalue > 0.01, name
        # Ten per cent, and two sigma of what the mean of so many may be off.
        assert values.mean() == pytest.approx(6.0, rel=0.1 + 2.0 * np.sqrt(12.0 / POSES) / 6.0), name
    pooled = np.concatenate(list(found.values()))
    assert pooled.mean() == pytest.approx(6.0, rel=0.05)
    assert np.mean(pooled < chi2(6).ppf(0.95)) == pytest.approx(0.95, abs=0.02)


def test_the_pose_is_better_than_by_bounds_alone_and_the_same_in_any_frame():
    """Features in the frame of a robot's base, where no eye is in the origin."""
    model, by_covariance, by_bounds = chipped_block(), [], []
    base_T_camera = Pose.from_rotation_vector([1.1, -0.4, 0.7], [0.5, -0.3, 1.2])
    for seed in range(12):
        rng = np.random.default_rng([seed, 8])
        truth = random_pose(rng, 0.03)
        data = measured(model, truth, rng, 1e-4, 1e-3)
        best = match(model, data).best
        moved = match(model, data.transformed(base_T_camera)).best
        error = base_T_camera.compose(best.pose).error_to(moved.pose)
        assert error.rotation < 1e-6 and error.translation < 1e-7
        turn = np.kron(np.eye(2), base_T_camera.rotation)
        assert np.allclose(
            moved.covariance, turn @ best.covariance @ turn.T, rtol=1e-3, atol=1e-3 * best.covariance.max()
        )
        by_covariance.append(best.pose.error_to(truth).rotation)
        by_bounds.append(match(model, replace(data, covariance=None)).best.pose.error_to(truth).rotation)
    assert np.median(by_covariance) < 0.6 * np.median(by_bounds)


def test_errors_of_another_size_are_found_out_and_a_gross_one_hardly_counts():
    model, rng = chipped_block(), np.random.default_rng(3)
    truth = random_pose(rng, 0.03)
    data = measured(model, truth, rng, 1e-4, 3e-4, visible=1.0)
    best = match(model, data).best
    for factor in (1 / 16, 16.0):
        other = match(model, replace(data, covariance=factor * data.covariance)).best
        assert np.trace(other.covariance) == pytest.approx(np.trace(best.covariance), rel=0.5)
    # One edge a millimetre beside its place, known as well as the others.
    start, end = data.start.copy(), data.end.copy()
    side = np.cross(data.directions[0], [0.0, 0.0, 1.0])
    start[0] += 1e-3 * side
    end[0] += 1e-3 * side
    off = match(model, replace(data, start=start, end=end)).best
    assert off.pose.error_to(truth).translation < best.pose.error_to(truth).translation + 2e-4


def test_a_fit_is_the_least_squares_of_whitened_residuals():
    """Against numbers worked out by matrices: the equations of an edge and of a curve about the true pose."""
    rng = np.random.default_rng(6)
    edges = FeatureSet.from_edges(rng.normal(size=(4, 3)), rng.normal(size=(4, 3)))
    model = FeatureSet.concatenate(
        [edges, FeatureSet.from_curves(rng.normal(size=(2, 3)), rng.normal(size=(2, 3)), 0.3)]
    )
    mix = 1e-3 * rng.normal(size=(6, 6, 6))
    covariance = mix @ mix.swapaxes(1, 2)
    off = np.einsum('nij,nj->ni', mix, rng.normal(size=(6, 6)))
    curve = model.kind == FeatureKind.CURVE
    start, end = model.start + off[:, :3], model.end + off[:, 3:]
    tilted = model.directions + off[:, 3:]
    end[curve] = (start + tilted / np.linalg.norm(tilted, axis=1, keepdims=True))[curve]
    data = FeatureSet(model.kind, start, end, model.radii, np.zeros(6), np.zeros(6))
    motion = np.append(np.eye(3).ravel(), np.zeros(3))
    features = FeatureRows(feature_rows(data), data.kind)
    assignment, sign = np.arange(6, dtype=np.int32), np.ones(6, np.int8)
    fit = weighted_fit(motion, feature_rows(model), features, covariance, assignment, sign, 3.0)
    turn, shift = motion[:9].reshape(3, 3), motion[9:]

    def squares(step: np.ndarray) -> float:
        """The sum of squares at the pose after a further small motion about the fit's centre."""
        more = Pose.from_rotation_vector(step[:3]).rotation
        total = 0.0
        for k in range(6):
            u = more @ turn @ model.directions[k]
            m = more @ (turn @ model.midpoints[k] + shift - fit.centre) + fit.centre + step[3:]
            flat = np.linalg.svd(u[None])[2][1:]
            if curve[k]:
                rows = np.zeros((5, 6))
                rows[:3, :3], rows[3:, 3:] = np.eye(3), flat
                residual = np.concatenate([data.start[k] - m, flat @ data.directions[k]])
            else:
                rows = np.kron(np.eye(2), flat)
                residual = rows @ np.concatenate([data.start[k] - m, data.end[k] - m])
            value = residual @ np.linalg.solve(rows @ covariance[k] @ rows.T, residual)
            assert value < OUTLYING[5 if curve[k] else 4] * fit.scale
            total += value
        return total

    least = squares(np.zeros(6))
    residuals = 4 * 4 + 2 * 5
    assert fit.scale == pytest.approx((3.0 + least) / (3.0 + residuals - 6), rel=1e-6)
    alone = weighted_fit(motion.copy(), feature_rows(model), features, covariance, assignment, sign, 0.0)
    assert alone.scale == pytest.approx(least / (residuals - 6), rel=1e-6)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 0.3 / np.sqrt(fit.normal[k, k])
        rise = [squares(sign * step) - least for sign in (1.0, -1.0)]
        assert min(rise) > 0.0
        assert np.mean(rise) == pytest.approx(0.09, rel=0.05)


def test_few_residuals_leave_the_covariances_their_word():
    """Of three edges six residuals are left over: what they show weighs against what two say for the stated errors."""
    model = chipped_block()
    truth = Pose.from_rotation_vector([0.3, -0.4, 0.2], [0.01, 0.0, 0.3])
    exact = replace(model.transformed(truth), covariance=np.tile(1e-8 * np.eye(6), (len(model), 1, 1)))
    features = FeatureRows(feature_rows(exact), exact.kind)
    motion = np.append(truth.rotation.ravel(), truth.translation)
    for count in (3, 8, len(model)):
        assignment = np.where(np.arange(len(model)) < count, np.arange(len(model)), -1).astype(np.int32)
        sign = np.ones(len(model), np.int8)
        fit = weighted_fit(
            motion.copy(), feature_rows(model), features, exact.covariance, assignment, sign, STATED_WORTH
        )
        assert fit.scale == pytest.approx(STATED_WORTH / (STATED_WORTH + 4 * count - 6), rel=1e-6)


def test_data_of_no_error_at_all_has_a_pose():
    model = chipped_block()
    truth = Pose.from_rotation_vector([0.3, -0.4, 0.2], [0.01, 0.0, 0.3])
    exact = replace(model.transformed(truth), covariance=np.zeros((len(model), 6, 6)))
    best = match(model, exact, MatchParams(fracdev=0.01)).best
    assert best.pose.error_to(truth).rotation < 1e-7 and np.trace(best.covariance) < 1e-9


def test_what_all_features_are_off_together_the_pose_is_off_as_well():
    """A shift that all data has in common is one of the pose, however many features there are."""
    rng = np.random.default_rng(8)
    model = FeatureSet.from_edges(rng.uniform(-0.1, 0.1, (30, 3)), rng.uniform(-0.1, 0.1, (30, 3)))
    index = index_model(model, 'frame')
    pose = Pose.from_rotation_vector([0.3, -0.2, 0.5], [0.02, 0.01, 0.7])
    alone = replace(model.transformed(pose), covariance=np.repeat(1e-8 * np.eye(6)[None], 30, axis=0))
    shift = np.array([0.001, -0.002, 0.005])
    together = alone.with_common(np.tile(shift, (30, 2)))
    one, other = match(index, alone).best, match(index, together).best
    assert one is not None and other is not None
    assert one.pose.error_to(other.pose).translation < 1e-9
    expected = one.covariance.copy()
    expected[:3, :3] += np.outer(shift, shift)
    np.testing.assert_allclose(other.covariance, expected, rtol=1e-3, atol=1e-11)
