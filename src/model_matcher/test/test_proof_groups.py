"""What the proof counts and chooses, on cases that can be counted by hand."""

import numpy as np
import pytest

from model_matcher import MatchParams, index_model
from model_matcher.model.problem import make_problem
from model_matcher.proof.branch_and_bound import sample_of
from model_matcher.proof.feasibility import add_steadiest, first_variances
from model_matcher.proof.spares import Groups, left_out, spare_features
from msgs_py import FeatureSet

# Of eight data features: 0, 1, 2 are a group, and so are 5 and 6.
GROUPS = Groups(np.array([0, 0, 0, -1, -1, 1, 1, -1]), np.array([3, 2]))


@pytest.mark.parametrize(
    ('taken', 'free', 'least', 'spare', 'missing'),
    [
        ([], [0, 1, 2, 3, 4, 5, 6, 7], 4, 2, [0, 0]),  # eight of which four are needed, and each group loses one
        ([], [0, 0, 0, 1, 1, 2, 3, 3, 4, 5, 6, 7], 4, 2, [0, 0]),  # nodes of one feature count once
        ([], [0, 1, 3, 4, 5, 6, 7], 4, 2, [1, 0]),  # the one of the first group is gone already
        ([], [0, 3, 4, 7], 4, 0, [2, 2]),
        ([2], [0, 1, 3, 5, 6], 3, 0, [0, 0]),  # what is taken is of the group as well
        ([2, 5], [3, 4], 3, -1, [2, 1]),
        ([5, 6], [3, 4], 1, 0, [3, 0]),
        ([], [], 1, -1, [3, 2]),
        ([], [], 0, 0, [3, 2]),
    ],
)
def test_a_whole_group_takes_one_off_what_may_be_left_out(taken, free, least, spare, missing):
    found = np.empty(2, np.int64)
    assert spare_features(np.array(taken, int), np.array(free, int), least, GROUPS, found) == spare
    assert found.tolist() == missing


def test_the_first_that_a_whole_group_loses_was_counted_already():
    missing = np.array([0, 1])
    assert left_out(3, GROUPS, missing) == 1 and missing.tolist() == [0, 1]
    assert left_out(1, GROUPS, missing) == 0 and missing.tolist() == [1, 1]
    assert left_out(0, GROUPS, missing) == 1 and missing.tolist() == [2, 1]
    assert left_out(6, GROUPS, missing) == 1 and missing.tolist() == [2, 2]


def edges(*ends):
    """A problem of data features that are their own model."""
    ends = np.array(ends, float)
    features = FeatureSet.from_edges(ends[:, 0], ends[:, 1], 1e-3, 1e-3)
    return make_problem(index_model(features), features, MatchParams())


def test_one_edge_leaves_the_turn_about_itself_open_and_two_leave_none():
    problem = edges([[-0.1, 0, 1], [0.1, 0, 1]], [[0, 0.1, 1], [0, 0.3, 1]], [[-0.1, 0.01, 1], [0.1, 0.01, 1]])
    sample = sample_of(problem)
    (variance,) = first_variances(np.array([0]), 0.3, sample)
    turn = np.diag(variance)[:3]
    assert turn[0] == pytest.approx(1.0), 'about its own line, nothing but that it is about a radian'
    # Across, the ends tell a turn by their tolerance over the half length; and so does the tilt by its cone.
    across, cone = sample.tolerances[0, 0], np.sin(sample.tolerances[0, 2])
    expected = 1.0 / (1.0 + 2.0 * (0.1 / across) ** 2 + 1.0 / cone**2)
    assert turn[1] == pytest.approx(expected, rel=1e-3) and turn[2] == pytest.approx(expected, rel=1e-3)
    # The parallel edge near by says little of the turn about it, the one across and far off says much.
    before = variance.copy()
    assert add_steadiest(variance, 0, np.array([2, 1]), np.array([1, 1]), sample) == 1
    assert np.trace(variance[:3, :3]) < 0.01 * np.trace(before[:3, :3])
    assert np.linalg.eigvalsh(before - variance).min() > -1e-12, 'evidence never adds to a variance'
    np.testing.assert_allclose(variance, variance.T, atol=1e-12)


def test_many_nodes_outweigh_some_steadiness():
    problem = edges([[-0.1, 0, 1], [0.1, 0, 1]], [[0, 0.1, 1], [0, 0.3, 1]], [[0, 0.11, 1], [0, 0.29, 1]])
    sample, both = sample_of(problem), np.array([1, 2])
    (start,) = first_variances(np.array([0]), 0.3, sample)
    assert add_steadiest(start.copy(), 0, both, np.array([1, 1]), sample) == 0, 'the longer one'
    assert add_steadiest(start.copy(), 0, both, np.array([2, 1]), sample) == 1, 'half the branches'


@pytest.mark.parametrize('size', [0.3, 0.002])
def test_a_variance_is_the_inverse_of_what_its_features_say(size):
    rng = np.random.default_rng(3)
    problem = edges(*(rng.uniform(-0.2, 0.2, (4, 2, 3)) + [0, 0, 1]))
    sample = sample_of(problem)
    (variance,) = first_variances(np.array([2]), size, sample)
    chosen = [add_steadiest(variance, 2, np.array([k]), np.array([5]), sample) for k in (0, 1, 3)]
    assert chosen == [0, 0, 0], 'the only one there is'
    precision = np.diag([1.0] * 3 + [size**-2] * 3)
    centre = sample.data[2, :3]
    for row, (across, along, cone) in zip(sample.data, sample.tolerances):
        middle, direction, half = row[:3], row[3:6], row[6]
        plane = np.eye(3) - np.outer(direction, direction)
        cross = lambda v: np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])  # noqa: E731
        blocks = [(plane, middle + side * half * direction - centre, across) for side in (1, -1)]
        blocks.append((np.outer(direction, direction), middle - centre, along))
        for onto, arm, tolerance in blocks:
            jacobian = np.hstack([-onto @ cross(arm), onto]) / tolerance
            precision += jacobian.T @ jacobian
        tilt = np.hstack([-plane @ cross(direction), np.zeros((3, 3))]) / np.sin(cone)
        precision += tilt.T @ tilt
    np.testing.assert_allclose(np.linalg.inv(variance), precision, rtol=1e-4, atol=1e-4 * np.abs(precision).max())
