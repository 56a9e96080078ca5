"""A model's symmetry is found in closed form and applied to poses."""

import numpy as np
import pytest

from model_matcher import index_model, match
from model_matcher.closed_form.synthetic.scenes import box, chipped_block, l_shape, lattice, prism, random_pose, tubes
from model_matcher.geometry.pose_rows import as_motion
from model_matcher.model.symmetry import all_near, distinct_pairs, near, symmetric_poses, symmetries
from msgs_py import FeatureSet, Pose


def regular(sides, radius=0.05, depth=0.03):
    angle = 2 * np.pi * np.arange(sides) / sides
    return prism(radius * np.column_stack([np.cos(angle), np.sin(angle)]), depth)


@pytest.mark.parametrize(
    ('model', 'order'),
    [
        (box((0.05, 0.05, 0.05)), 24),
        (box((0.05, 0.05, 0.08)), 8),
        (box((0.03, 0.05, 0.08)), 4),
        (regular(3), 6),
        (regular(5), 10),
        (chipped_block(), 1),
        (lattice(), 1),
        (tubes(), 1),
    ],
)
def test_the_order_of_the_group(model, order):
    assert len(symmetries(index_model(model))) + 1 == order


@pytest.mark.parametrize(
    ('model', 'order'),
    [(box((0.05, 0.05, 0.05)), 24), (box((0.05, 0.05, 0.08)), 8), (box((0.03, 0.05, 0.08)), 4), (l_shape(), 1)],
)
def test_of_the_pairs_that_a_symmetry_makes_equal_one_is_searched(model, order):
    index = index_model(model)
    some, table = distinct_pairs(index), index.pair_table
    assert order * len(some.members) == len(table.members)
    assert some.starts[-1] == len(some.members)
    np.testing.assert_allclose(
        np.unique(some.values[:, :2].round(9), axis=0), np.unique(table.values[:, :2].round(9), axis=0)
    )


def test_mirror_symmetry_is_no_symmetry_but_the_turn_of_a_mirrored_outline_is():
    # The L-shape's outline is not symmetric; as a prism it is its own mirror image, which no motion brings about.
    assert symmetries(index_model(l_shape())) == ()


def test_every_symmetry_lays_the_features_on_themselves():
    model = regular(4)
    points = np.concatenate([model.start, model.end])
    found = symmetries(index_model(model))
    assert len(found) == 7, 'a square prism has eight, with the one that moves nothing'
    for motion in found:
        assert np.linalg.det(motion.rotation) == pytest.approx(1.0)
        gaps = np.linalg.norm(motion.apply(points)[:, None] - points, axis=2).min(axis=1)
        assert gaps.max() < 1e-9


def test_symmetric_poses_are_the_group_about_the_pose_each_once():
    index = index_model(box((0.03, 0.05, 0.08)))
    pose = random_pose(np.random.default_rng(1))
    others = symmetric_poses(index, pose)
    assert len(others) == 3
    assert symmetric_poses(index, pose, others) == others
    assert symmetric_poses(index, others[0], ()) != ()


def test_parallel_features_apart_have_a_finite_group():
    """Two equal edges side by side: three half turns."""
    edges = FeatureSet.from_edges([[0, 0, 0], [0.01, 0, 0]], [[0, 0, 0.1], [0.01, 0, 0.1]])
    assert len(symmetries(index_model(edges))) == 3
    assert len(symmetric_poses(index_model(edges), Pose.identity())) == 3


def test_a_solid_of_revolution_counts_end_for_end_only():
    rims = FeatureSet.from_curves([[0, 0, 0], [0, 0, 0.1]], [[0, 0, -1], [0, 0, 1]], [0.03, 0.03])
    (half,) = symmetries(index_model(rims))
    np.testing.assert_allclose(half.apply(rims.start), rims.start[::-1], atol=1e-12)
    cone = FeatureSet.from_curves([[0, 0, 0], [0, 0, 0.1]], [[0, 0, -1], [0, 0, 1]], [0.03, 0.02])
    assert symmetries(index_model(cone)) == ()


def test_a_pattern_of_holes_has_the_turns_of_the_pattern():
    angle = np.arange(4) * np.pi / 2
    centres = 0.04 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    holes = FeatureSet.from_curves([[0, 0, 0.02], *centres], [[0, 0, 1]] * 5, [0.02] + 4 * [0.005])
    assert len(symmetries(index_model(holes))) == 3


def test_match_lists_all_poses_of_a_symmetric_model():
    cube = box((0.05, 0.05, 0.05))
    best = match(cube, cube.transformed(random_pose(np.random.default_rng(2)))).best
    assert len(best.symmetric_poses) == 23


def test_all_near_says_of_each_two_poses_what_near_says():
    rng, index = np.random.default_rng(5), index_model(l_shape())
    first = random_pose(rng)
    turns = rng.normal(scale=0.01, size=(20, 3)) * rng.integers(0, 2, (20, 1))
    shifts = rng.normal(scale=0.01 * index.size, size=(20, 3)) * rng.integers(0, 2, (20, 1))
    poses = [first.compose(Pose.from_rotation_vector(turn, shift)) for turn, shift in zip(turns, shifts)]
    expected = [[near(index, one, other) for other in poses] for one in poses]
    assert 40 < np.sum(expected) < 360, 'some are, some are not'
    np.testing.assert_array_equal(all_near(index, np.array([as_motion(pose) for pose in poses])), expected)
