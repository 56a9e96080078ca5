"""The canonical pose of a symmetric model, and objects that are known again."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model_matcher import MatchParams, index_model, match
from model_matcher.closed_form.synthetic.scenes import box, l_shape, prism, random_pose
from model_matcher.instances import Instances, deviation
from model_matcher.model.equal_poses import apart, at_point, canonical, canonical_motion, symmetry_group
from model_matcher.model.problem import make_problem
from model_matcher.model.symmetry import symmetries
from model_matcher.verification.false_alarms import chance_of, chance_with_images, needed_evidence, needed_with_images
from msgs_py import BIN, FeatureSet, Interpretation, Pose

TRIANGLE = prism(0.05 * np.array([[1, 0], [-0.5, np.sqrt(0.75)], [-0.5, -np.sqrt(0.75)]]), 0.03)
TUBE = FeatureSet.from_curves([[0, 0.01, 0], [0, 0.01, 0.1]], [[0, 0, -1], [0, 0, 1]], [0.03, 0.03])
CONE = FeatureSet.from_curves([[0, 0.01, 0], [0, 0.01, 0.1]], [[0, 0, -1], [0, 0, 1]], [0.03, 0.02])
MODELS = {
    'cube': index_model(box((0.05, 0.05, 0.05)), 'cube'),
    'slab': index_model(box((0.03, 0.05, 0.08)), 'slab'),
    'triangle': index_model(TRIANGLE, 'triangle'),
    'tube': index_model(TUBE, 'tube'),
    'cone': index_model(CONE, 'cone'),
    'l_shape': index_model(l_shape(), 'l_shape'),
}
names = st.sampled_from(sorted(MODELS))
seeds = st.integers(0, 10**6)
few = settings(max_examples=60, deadline=None)


def found(name: str, pose: Pose, covariance: np.ndarray | None = None) -> Interpretation:
    """Every feature of a model seen at a pose."""
    n = len(MODELS[name])
    return Interpretation(name, np.arange(n), np.ones(n, np.int8), pose, covariance=covariance)


def some_symmetry(name: str, rng: np.random.Generator) -> Pose:
    """A motion that lays the model on itself, with any turn about its axis."""
    index = MODELS[name]
    motions = [Pose.identity(), *symmetries(index)]
    motion = motions[rng.integers(len(motions))]
    axis = symmetry_group(index)['axis']
    if axis is None:
        return motion
    turn = Pose.from_rotation_vector(rng.uniform(-np.pi, np.pi) * np.array(axis['direction']))
    return motion.compose(Pose(turn.rotation, np.array(axis['point']) - turn.rotation @ axis['point']))


@few
@given(names, seeds)
def test_all_equal_poses_have_one_canonical_pose(name, seed):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng)
    first = canonical(MODELS[name], found(name, pose)).pose
    second = canonical(MODELS[name], found(name, pose.compose(some_symmetry(name, rng)))).pose
    assert first.error_to(second).rotation < 1e-6 and first.error_to(second).translation < 1e-7


@few
@given(names, seeds)
def test_equal_poses_are_not_apart_and_others_by_what_they_are_moved(name, seed):
    rng = np.random.default_rng(seed)
    index, pose = MODELS[name], random_pose(rng)
    assert apart(index, pose, pose.compose(some_symmetry(name, rng))) < 1e-6
    shift = rng.normal(size=3) * 1e-3
    moved = Pose(pose.rotation, pose.translation + shift)
    assert abs(apart(index, pose, moved) - np.linalg.norm(shift) / index.size) < 1e-9


@few
@given(names, seeds)
def test_none_of_the_equal_poses_is_turned_less(name, seed):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng)
    least = canonical(MODELS[name], found(name, pose)).pose.error_to(Pose.identity()).rotation
    for _ in range(20):
        other = pose.compose(some_symmetry(name, rng))
        assert least <= other.error_to(Pose(np.eye(3), other.translation)).rotation + 1e-7


@few
@given(names, seeds)
def test_data_lies_on_its_features_at_the_canonical_pose_too(name, seed):
    index, rng = MODELS[name], np.random.default_rng(seed)
    before = found(name, random_pose(rng))
    after = canonical(index, before)
    rows = index.rows[after.assignment]
    at, along = after.pose.apply(rows[:, :3]), after.sign[:, None] * after.pose.rotate(rows[:, 3:6])
    np.testing.assert_allclose(at, before.pose.apply(index.rows[:, :3]), atol=1e-6)
    np.testing.assert_allclose(along, before.pose.rotate(index.rows[:, 3:6]), atol=1e-6)
    assert len(np.unique(after.assignment)) == len(index)


def test_the_covariance_goes_with_the_pose():
    """Poses drawn from a covariance, each taken to the equal pose, have the covariance that is stated there."""
    rng = np.random.default_rng(5)
    index, pose = MODELS['slab'], Pose.from_rotation_vector([2.5, 0.6, -0.4], [0.1, -0.05, 0.6])
    root = rng.normal(size=(6, 6)) * np.repeat([1e-3, 3e-3], 3)[:, None]
    before = found('slab', pose, root @ root.T)
    after = canonical(index, before)
    motion = canonical_motion(index, pose)
    assert motion.error_to(Pose.identity()).rotation > 1.0
    errors = []
    for drawn in rng.normal(size=(4000, 6)) @ root.T:
        other = Pose(Pose.from_rotation_vector(drawn[3:]).rotation @ pose.rotation, pose.translation + drawn[:3])
        moved = other.compose(motion)
        turn = Pose(moved.rotation @ after.pose.rotation.T).rotation_vector
        errors.append([*(moved.translation - after.pose.translation), *turn])
    ratio = np.linalg.solve(after.covariance, np.cov(np.array(errors).T))
    assert np.linalg.eigvals(ratio).real == pytest.approx(np.ones(6), abs=0.12)
    back = at_point(after.covariance, pose.translation - after.pose.translation)
    np.testing.assert_allclose(back, before.covariance, rtol=1e-9, atol=1e-15)


def test_a_found_cube_keeps_all_its_equal_poses():
    cube = MODELS['cube']
    best = match(cube, cube.features.transformed(random_pose(np.random.default_rng(2)))).best
    after = canonical(cube, best)
    assert len(after.symmetric_poses) == 23
    assert (after.assignment != BIN).sum() == best.matched
    assert canonical(cube, after).pose == after.pose


def test_the_group_as_json():
    groups = {name: json.loads(json.dumps(symmetry_group(index))) for name, index in MODELS.items()}
    assert {name: one['order'] for name, one in groups.items()} == {
        'cube': 24,
        'slab': 4,
        'triangle': 6,
        'tube': None,
        'cone': None,
        'l_shape': 1,
    }
    assert all(len(one['motions']) == one['order'] - 1 for one in groups.values() if one['order'])
    assert len(groups['tube']['motions']) == 1 and groups['cone']['motions'] == []
    assert groups['cone']['axis']['point'] == pytest.approx([0.0, 0.01, 0.05])
    assert np.abs(groups['cone']['axis']['direction']) == pytest.approx([0.0, 0.0, 1.0])


SPREAD = np.diag([1e-8] * 3 + [1e-6] * 3)  # 0.1 mm, a milliradian
SECOND = 10**9


@few
@given(names, seeds)
def test_an_object_is_known_again_at_any_of_its_equal_poses(name, seed):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng)
    other = pose.compose(some_symmetry(name, rng))
    nudged = Pose(other.rotation, other.translation + 1e-4)
    carried = at_point(SPREAD, other.translation - pose.translation)
    assert deviation(MODELS[name], found(name, nudged, carried), found(name, pose, SPREAD), 0.0) < 3.0


def test_the_distance_is_in_sigmas_of_both_and_of_the_motion():
    index, pose = MODELS['l_shape'], Pose.from_rotation_vector([0.1, 0.2, 0.3], [0, 0, 0.5])
    off = Pose(pose.rotation, pose.translation + [0.003, 0, 0])
    two = found('l_shape', off, 1e-2 * SPREAD), found('l_shape', pose, 1e-2 * SPREAD)
    assert deviation(index, *two, 0.01) == pytest.approx(0.09, rel=0.01)
    wide = np.diag([1e-6] * 3 + [1e-12] * 3)
    two = found('l_shape', off, wide), found('l_shape', pose, wide)
    assert deviation(index, *two, 0.0) == pytest.approx(4.5, rel=0.01)


def test_names_stay_while_objects_swap_places_in_the_list_and_drift():
    rng = np.random.default_rng(3)
    poses = [Pose(random_pose(rng).rotation, [x, 0.0, 0.5]) for x in (-0.1, 0.0, 0.1)]
    seen = Instances()
    first = seen.names(0, [found('l_shape', pose, SPREAD) for pose in poses], MODELS, 0.1)
    assert first == ['l_shape/1', 'l_shape/2', 'l_shape/3']
    for frame in range(1, 30):
        drifted = [Pose(pose.rotation, pose.translation + [0.0, 0.003 * frame, 0.0]) for pose in poses]
        order = rng.permutation(3)
        got = seen.names(frame * SECOND // 30, [found('l_shape', drifted[k], SPREAD) for k in order], MODELS, 0.1)
        assert got == [first[k] for k in order]


def test_another_place_is_another_object_and_a_number_is_given_once():
    here, there = (found('l_shape', Pose(np.eye(3), [x, 0, 0.5]), SPREAD) for x in (0.0, 0.2))
    seen = Instances()
    assert seen.names(SECOND, [here], MODELS, 0.1) == ['l_shape/1']
    assert seen.names(SECOND + SECOND // 10, [there], MODELS, 0.1) == ['l_shape/2']
    assert seen.names(SECOND + SECOND // 5, [here], MODELS, 0.1) == ['l_shape/1'], 'not seen once'
    assert seen.names(100 * SECOND, [], MODELS, 0.1) == []
    assert seen.names(100 * SECOND, [here], MODELS, 0.1) == ['l_shape/3'], 'long gone'
    assert seen.names(200 * SECOND, [here], MODELS, 0.0) == ['l_shape/3'], 'nothing moves'
    assert seen.names(SECOND, [here], MODELS, 0.0) == ['l_shape/4'], 'the clock was set back'
    seen.clear()
    assert seen.names(SECOND, [here], MODELS, 0.0) == ['l_shape/5']
    other = Interpretation('cube', here.assignment[:1], here.sign[:1], here.pose, covariance=SPREAD)
    assert seen.names(SECOND, [other], MODELS, 0.0) == ['cube/1'], 'another model'


def test_an_object_keeps_its_name_when_another_of_its_poses_is_reported():
    rng = np.random.default_rng(4)
    here = random_pose(rng)
    there = here.compose(Pose.from_rotation_vector([0.0, 0.0, np.pi]))
    alone, other = found('l_shape', here, np.eye(6) * 1e-8), found('l_shape', there, np.eye(6) * 1e-8)
    both = replace(other, ambiguous_poses=(here,), symmetric_poses=(here,))
    for frames, name in (((alone, both, alone), 'l_shape/1'), ((alone, other, alone), 'l_shape/2')):
        seen = Instances()
        names = [seen.names(k * 10**7, [one], MODELS, 0.01)[0] for k, one in enumerate(frames)]
        assert names == ['l_shape/1', name, 'l_shape/1']


def test_the_chance_is_the_rate_whose_evidence_is_needed():
    """With images and without; what is accepted by match has less than the rate that it is asked for."""
    data = MODELS['l_shape'].features.transformed(random_pose(np.random.default_rng(6)))
    problem = make_problem(MODELS['l_shape'], data, MatchParams())
    for rate in (1e-6, 1e-3, 0.2):
        params = MatchParams(false_alarm_rate=rate)
        assert chance_of(problem, needed_evidence(problem, params)) == pytest.approx(rate)
        assert chance_with_images(needed_with_images(params)) == pytest.approx(rate)
    assert chance_of(problem, -5.0) == chance_with_images(-5.0) == 1.0
    assert match(MODELS['l_shape'], data).best.chance < MatchParams().false_alarm_rate
