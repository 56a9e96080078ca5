"""Poses from pairs of features, and what the search leaves out because it cannot fit."""

import numpy as np
from scipy.spatial.transform import Rotation

from model_matcher import index_model
from model_matcher.closed_form.synthetic.scenes import chair, plug, random_pose
from model_matcher.geometry.line_pairs import _cost_of_pair, pair_geometry
from model_matcher.geometry.pair_pose import pair_frame, pair_pose
from model_matcher.model.index import feature_rows
from model_matcher.search.pair_search import _place_of


def test_a_pair_laid_on_its_own_image_gives_the_motion():
    rng = np.random.default_rng(4)
    pose = random_pose(rng)
    model = chair()
    rows, moved = feature_rows(model), feature_rows(model.transformed(pose))
    checked = 0
    for _ in range(200):
        a, b = rng.integers(len(rows), size=2)
        _, sine, _, foot_a, foot_b, flip = pair_geometry(rows[a], rows[b])
        if sine < 0.2:
            continue
        # At right angles rounding decides the flip, in the model and the data apart: the model's serves both.
        feet = (foot_a, flip, foot_b)
        data_pair, model_pair, motion = np.empty(12), np.empty(12), np.empty(12)
        pair_frame(rows, a, feet[0], b, feet[1], feet[2], model_pair)
        pair_frame(moved, a, feet[0], b, feet[1], feet[2], data_pair)
        pair_pose(data_pair, model_pair, 1.0, motion)
        np.testing.assert_allclose(motion[:9].reshape(3, 3), pose.rotation, atol=1e-9)
        np.testing.assert_allclose(motion[9:], pose.translation, atol=1e-9)
        pair_pose(data_pair, model_pair, -1.0, motion)
        turned = motion[:9].reshape(3, 3) @ rows[a, 3:6]
        np.testing.assert_allclose(turned, -moved[a, 3:6], atol=1e-9)
        checked += 1
    assert checked > 50


def test_short_pairs_come_last_in_every_cell_of_the_pair_table():
    index = index_model(plug())
    for first, last in zip(index.pair_starts[:-1], index.pair_starts[1:]):
        assert (np.diff(index.pair_values[first:last, 5]) <= 0.0).all()
    members = index.pair_members
    np.testing.assert_array_equal(index.pair_values[:, 5], index.rows[members, 6].min(axis=1))


def test_the_cost_of_a_pair_is_gap_over_length_and_sine():
    rows = feature_rows(plug())
    size = 0.1
    for a, b in ((0, 1), (0, 12), (3, 20), (30, 40)):
        _, sine, offset, foot_a, foot_b, _ = pair_geometry(rows[a], rows[b])
        over = [max(0.0, abs(foot) - rows[k, 6]) for foot, k in ((foot_a, a), (foot_b, b))]
        wanted = np.inf
        if sine > 0.17:
            wanted = (np.sqrt(offset**2 + over[0] ** 2 + over[1] ** 2) + 0.05 * size) / (min(rows[[a, b], 6]) * sine)
        np.testing.assert_allclose(_cost_of_pair(rows, a, b, size), wanted, rtol=1e-6)


def test_poses_of_a_pair_are_told_apart_by_a_step_and_no_less():
    """A turn counts by what it moves at half the model's size; the other sense and another pair give other poses."""
    size, step, rng = 2.0, 0.05, np.random.default_rng(3)
    for _ in range(200):
        turn = Rotation.random(random_state=rng).as_matrix()
        # In the middle of a cell, so that a small motion does not leave it.
        place = (np.floor(rng.uniform(-1.0, 1.0, 3) / step) + 0.5) * step
        number = _place_of(np.r_[turn.ravel(), place], 1.0, step, size, 7)
        assert number == _place_of(np.r_[turn.ravel(), place + rng.uniform(-0.49, 0.49, 3) * step], 1.0, step, size, 7)
        beyond = place + 1.01 * step * np.eye(3)[rng.integers(3)]
        turned = Rotation.from_rotvec([0.0, 0.0, 4.0 * step / (0.5 * size)]).as_matrix() @ turn
        for other in (
            _place_of(np.r_[turn.ravel(), beyond], 1.0, step, size, 7),
            _place_of(np.r_[turned.ravel(), place], 1.0, step, size, 7),
            _place_of(np.r_[turn.ravel(), place], -1.0, step, size, 7),
            _place_of(np.r_[turn.ravel(), place], 1.0, step, size, 8),
        ):
            assert number != other
