"""The certificate: whatever a pose explains is never proven impossible, and what is larger is found."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from model_matcher import MatchParams, index_model, match
from model_matcher.closed_form.synthetic import MODELS, fragment, make_scene, random_pose
from model_matcher.geometry.back_projection import assign
from model_matcher.model.problem import make_problem
from model_matcher.proof.branch_and_bound import sample_of
from model_matcher.proof.certificate import prove
from model_matcher.proof.feasibility import (
    FEASIBLE,
    INFEASIBLE,
    OPEN,
    all_fit,
    can_join,
    deviations,
    infeasible_subset,
    minimax_pose,
)
from msgs_py import BIN, Pose

SMALL = ('l_shape', 'wedge', 'chipped_block', 'cylinder_box', 'tubes')


def as_motion(pose):
    return np.concatenate([pose.rotation.ravel(), pose.translation])


def explained(problem, motion):
    """(n,) the model feature of every data feature under a pose, by back-projection."""
    assignment, sign = np.empty(len(problem.rows), np.int32), np.empty(len(problem.rows), np.int8)
    assign(motion, problem.model, problem.features, 1.0, assignment, sign)
    return assignment


def pairs_of(assignment):
    a = np.flatnonzero(assignment != BIN)
    return a, assignment[a].astype(np.int64)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(SMALL), st.floats(-4.5, -3.0), st.floats(0.0, 0.5))
def test_more_than_a_pose_explains_is_never_ruled_out(seed, name, log_sigma, clutter):
    scene = make_scene(MODELS[name](), seed, clutter=clutter, sigma=10**log_sigma)
    index, params = index_model(MODELS[name](), name), MatchParams()
    problem = make_problem(index, scene.data, params)
    size = int((explained(problem, as_motion(scene.poses[0])) != BIN).sum())
    assume(size >= 4)
    proof = prove(index, scene.data, size - 1, params, seconds=5.0)
    if proof.assignment is None:
        assert not proof.proven and proof.reason
    else:
        assert (proof.assignment != BIN).sum() >= size
        assert all_fit(proof.motion, *pairs_of(proof.assignment), sample_of(problem), index.kind, problem.radius_tol)


@pytest.mark.parametrize('name', ['l_shape', 'wedge', 'chair', 'computer', 'cylinder_box'])
def test_ideal_data_is_proven_largest_without_a_tree(name):
    model = MODELS[name]()
    proof = prove(index_model(model, name), model, len(model), MatchParams())
    assert proof.proven and proof.reason is None and proof.nodes == 0


@pytest.mark.parametrize('name', ['l_shape', 'wedge', 'chipped_block', 'chair', 'computer', 'plug'])
def test_match_is_proven_with_half_the_data_spurious(name):
    model = MODELS[name]()
    for seed in range(4):
        scene = make_scene(model, seed, clutter=0.5)
        plain = match(model, scene.data).best
        best = match(model, scene.data, MatchParams(prove=True)).best
        assert best.proven and not plain.proven
        assert best.matched >= plain.matched
        assert len(np.unique(best.assignment[best.assignment != BIN])) >= len(
            np.unique(plain.assignment[plain.assignment != BIN])
        )


@pytest.mark.parametrize('seed', range(3))
def test_the_plug_with_its_short_pins_is_proven_and_no_other_pose_explains_more(seed):
    model = MODELS['plug']()
    scene = make_scene(model, seed, clutter=0.5)
    best = match(model, scene.data, MatchParams(prove=True)).best
    assert best.proven
    problem = make_problem(index_model(model, 'plug'), scene.data, MatchParams())
    rng = np.random.default_rng(seed)
    for _ in range(3000):
        turn = Pose.from_rotation_vector(rng.normal(size=3) * 0.02, rng.normal(size=3) * 3e-4)
        motion = as_motion(Pose(turn.rotation @ best.pose.rotation, best.pose.translation + turn.translation))
        assert (explained(problem, motion) != BIN).sum() <= best.matched


def test_what_the_proof_adds_is_true():
    model = MODELS['chair']()
    added = right = 0
    for seed in range(8):
        scene = make_scene(model, seed, clutter=0.5)
        plain = match(model, scene.data).best
        proven = match(model, scene.data, MatchParams(prove=True)).best
        new = (proven.assignment != BIN) & (plain.assignment == BIN)
        added += int(new.sum())
        right += int((proven.assignment == scene.assignment)[new].sum())
    assert added > 0 and right >= 0.9 * added


def test_without_time_nothing_is_proven_and_the_reason_is_given():
    model = MODELS['chair']()
    scene = make_scene(model, 1, clutter=0.5)
    proof = prove(index_model(model, 'chair'), scene.data, 5, MatchParams(), seconds=0.0)
    assert not proof.proven and proof.reason == 'time limit'


def test_data_of_free_scale_is_not_proven():
    model = MODELS['l_shape']()
    proof = prove(index_model(model, 'l'), model, 3, MatchParams(scale='free'))
    assert not proof.proven and 'scale' in proof.reason


def some_pairings(seed, name='chair', scale=1.0):
    """Pairings with the truth's, their problem, and the true pose."""
    rng = np.random.default_rng(seed)
    model = MODELS[name]()
    pose = random_pose(rng)
    data, origin, _ = fragment(model.transformed(pose), rng, 0.6)
    problem = make_problem(index_model(model, name), data, MatchParams(err_scale=scale))
    return problem, np.arange(len(data)), origin.astype(np.int64), as_motion(pose)


def tight_pairings(seed, name):
    """The truth's pairings with errors stated too small, so that some sets have a common pose and some have none."""
    return some_pairings(seed, name, scale=0.4 + 0.05 * seed)


def test_the_sets_that_are_tried_are_feasible_and_infeasible():
    outcomes = []
    for name in ('chair', 'lamp'):
        for seed in range(12):
            problem, a, i, motion = tight_pairings(seed, name)
            outcomes.append(minimax_pose(motion, a, i, sample_of(problem), np.empty(len(a))))
    assert outcomes.count(FEASIBLE) >= 8 and outcomes.count(INFEASIBLE) >= 8


@pytest.mark.parametrize('seed', range(12))
@pytest.mark.parametrize('name', ['chair', 'lamp'])
def test_a_common_pose_is_found_or_ruled_out(seed, name):
    problem, a, i, motion = tight_pairings(seed, name)
    sample = sample_of(problem)
    pose, weights = motion.copy(), np.empty(len(a))
    found = minimax_pose(pose, a, i, sample, weights)
    assert found != OPEN
    if found == FEASIBLE:
        assert deviations(pose, a, i, sample).max() <= 1.0 + 1e-9
        return
    rng = np.random.default_rng(seed)
    for _ in range(300):  # no pose near the truth fits all
        turn = Pose.from_rotation_vector(rng.normal(size=3) * 0.02, rng.normal(size=3) * 1e-3)
        other = Pose(turn.rotation @ motion[:9].reshape(3, 3), motion[9:] + turn.translation)
        assert deviations(as_motion(other), a, i, sample).max() > 1.0
    few = infeasible_subset(motion, a, i, weights, sample)
    assert len(few) <= len(a)
    assert minimax_pose(motion.copy(), a[few], i[few], sample, np.empty(len(few))) == INFEASIBLE


@pytest.mark.parametrize('seed', range(6))
def test_what_may_join_a_set_is_what_shares_a_pose_with_it(seed):
    problem, a, i, motion = some_pairings(seed)
    sample = sample_of(problem)
    few = np.argsort(-problem.rows[:, 6])[:4]
    pose = motion.copy()
    assert minimax_pose(pose, a[few], i[few], sample, np.empty(4)) == FEASIBLE
    others_a = np.repeat(a, 5)
    others_i = np.random.default_rng(seed).integers(0, len(problem.index), len(others_a))
    allowed = can_join(pose, a[few], i[few], others_a, others_i, 0, sample)
    for k in range(len(others_a)):
        together = minimax_pose(
            pose.copy(), np.append(a[few], others_a[k]), np.append(i[few], others_i[k]), sample, np.empty(5)
        )
        assert allowed[k] == (together != INFEASIBLE) or (together == OPEN and not allowed[k])
