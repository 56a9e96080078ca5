"""What is certified of a match whose answer is known: five edges, and data that few or all of them explain."""

from functools import cache

import numpy as np
import pytest

from model_matcher import MatchParams, index_model
from model_matcher.geometry.pose_rows import as_motion
from model_matcher.model.problem import make_problem
from model_matcher.params import MatchResult
from model_matcher.proof.certificate import certify, prove, prove_problem
from model_matcher.proof.warm_up import compile_kernels
from msgs_py import BIN, FeatureSet, Interpretation, Pose
from msgs_py.numeric.deadline import Deadline

PARAMS = MatchParams(fracdev=1e-3, min_matched=4)
STATS = {'proof_branches', 'proof_pairings', 'proof_seconds'}
POSE = Pose.from_rotation_vector([0.2, -0.1, 0.4], [0.01, 0.02, 0.5])
ELSEWHERE = Pose.from_rotation_vector([-0.5, 0.3, 0.1], [0.6, -0.3, 0.8])


@pytest.fixture(scope='module', autouse=True)
def _compiled():
    """What is compiled anew takes longer than these deadlines on a machine that does other work."""
    compile_kernels()


@cache
def five_edges():
    """No two of one length, of one direction, or in one plane."""
    rng = np.random.default_rng(5)
    start = rng.uniform(-0.1, 0.1, (5, 3))
    return FeatureSet.from_edges(start, start + rng.normal(size=(5, 3)) * 0.08)


@cache
def model():
    return index_model(five_edges(), 'five')


def seen(some, pose=POSE):
    return five_edges().select(np.array(some)).transformed(pose)


def clutter():
    return FeatureSet.from_edges([[2.0, 0, 1], [3.0, 0, 1]], [[2.0, 0.07, 1], [3.0, 0, 1.08]])


def found(assignment, pose=POSE, **more):
    return Interpretation('five', assignment, np.ones(len(assignment)), pose, **more)


def certified(data, interpretations, deadline_s=60.0, params=PARAMS, rejected=(), reason=None):
    result = MatchResult(tuple(interpretations), tuple(rejected), {'tried': 7}, reason)
    return certify(make_problem(model(), data, params), result, params, Deadline(deadline_s))


def test_the_largest_is_proven_as_it_is():
    data = FeatureSet.concatenate([seen(range(5)), clutter()])
    best, other = found([0, 1, 2, 3, 4, BIN, BIN]), found([BIN] * 7)
    result = certified(data, [best, other])
    assert result.best.proven and result.best.assignment.tolist() == best.assignment.tolist()
    assert result.best.pose is best.pose and result.interpretations[1] is other
    assert set(result.stats) == {'tried', *STATS} and 0.0 < result.stats['proof_seconds'] < 60.0


def test_what_is_larger_takes_its_place():
    data = FeatureSet.concatenate([clutter(), seen(range(5))])
    result = certified(data, [found([BIN, BIN, 0, 1, 2, 3, BIN])])
    assert result.best.proven and result.best.assignment.tolist() == [BIN, BIN, 0, 1, 2, 3, 4]
    assert result.best.matched == 5 and result.best.sign.tolist() == [0, 0, 1, 1, 1, 1, 1]
    assert result.best.pose.error_to(POSE).rotation < 1e-6 and result.best.model == 'five'


def halves(some, pose):
    """Both thirds at the ends of edges."""
    whole = seen(some, pose)
    pieces = [
        FeatureSet.from_edges(whole.start + low * whole.vectors, whole.start + (low + 0.3) * whole.vectors)
        for low in (0.0, 0.7)
    ]
    return FeatureSet.concatenate(pieces)


def test_a_larger_one_of_fewer_model_features_is_named_and_nothing_proven():
    """Three whole edges at one pose, and four pieces of two edges at another."""
    data = FeatureSet.concatenate([seen([0, 1, 2]), halves([3, 4], ELSEWHERE)])
    best = found([0, 1, 2] + [BIN] * 4)
    result = certified(data, [best], params=PARAMS.replace(min_matched=3))
    assert result.best is best and not result.best.proven
    assert result.stats['unproven'] == (
        'another interpretation matches 4 data features, but only 2 distinct model features; the best matches 3 and 3'
    )
    whole = FeatureSet.concatenate([seen([0, 1]), halves([3, 4], ELSEWHERE)])
    as_many = certified(whole, [found([0, 1] + [BIN] * 4)], params=PARAMS.replace(min_matched=2))
    assert as_many.best.proven and as_many.best.matched == 4, 'as many distinct ones are enough'


def test_without_time_nothing_is_proven():
    best = found([0, 1, 2, 3, 4])
    result = certified(seen(range(5)), [best], deadline_s=0.0)
    assert result.best is best and not best.proven
    assert result.stats == {'tried': 7, 'unproven': 'time limit'}


def test_absence_is_proven_of_what_shows_too_little():
    data = FeatureSet.concatenate([seen([0, 1, 2]), clutter()])
    result = certified(data, [], reason='nothing found')
    assert result.absent and not result
    assert result.reason == 'nothing found; proven: no pose explains 4 data features within the tolerances'
    assert set(result.stats) == {'tried', *STATS} and result.stats['proof_seconds'] > 0.0


def test_absence_is_not_proven_where_a_pose_explains_enough():
    data = FeatureSet.concatenate([seen([0, 1, 2, 3]), clutter()])
    result = certified(data, [], reason='nothing found')
    assert not result.absent and result.reason == 'nothing found'
    assert result.stats['unproven'] == 'a pose explains 4 data features'
    rejected = found([0, 1, 2, 3, BIN, BIN], rejected_reason='too little evidence')
    result = certified(data, [], rejected=[found([BIN] * 6), rejected], reason='nothing found')
    assert result.stats['unproven'] == 'a rejected pose explains 4 data features'
    assert result.stats['proof_branches'] == result.stats['proof_pairings'] == 0 and not result.absent


def test_a_rejected_pose_of_one_less_than_enough_does_not_stand_in_the_way():
    data = FeatureSet.concatenate([seen([0, 1, 2]), clutter()])
    assert certified(data, [], rejected=[found([0, 1, 2, BIN, BIN], rejected_reason='doubtful')]).absent


def test_the_answer_counts_features_that_cannot_be_used():
    """The second has no length, and takes no part."""
    points = FeatureSet.from_edges([[0, 0, 1]], [[0, 0, 1]])
    data = FeatureSet.concatenate([seen([0]), points, seen([1, 2, 3])])
    proof = prove(model(), data, 3, PARAMS, Deadline(60.0))
    assert proof.proven and proof.assignment.tolist() == [0, BIN, 1, 2, 3] and proof.assignment.dtype == np.int32
    assert proof.pairings >= 4 and proof.nodes >= 1 and proof.reason is None and 0.0 < proof.seconds < 60.0
    nothing_larger = prove(model(), data, 4, PARAMS, Deadline(60.0))
    assert nothing_larger.proven and nothing_larger.assignment is None and nothing_larger.motion is None


def test_a_pose_that_is_known_finds_what_it_explains_before_any_tree():
    problem = make_problem(model(), seen(range(5)), PARAMS)
    proof = prove_problem(problem, 4, PARAMS, Deadline(60.0), as_motion(POSE))
    assert proof.proven and proof.nodes == 0 and proof.assignment.tolist() == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(proof.motion, as_motion(POSE), atol=1e-6)


def test_whether_there_is_a_larger_one_is_answered_by_the_first():
    problem = make_problem(model(), seen(range(5)), PARAMS)
    proof = prove_problem(problem, 2, PARAMS, Deadline(60.0), only_whether=True)
    assert not proof.proven and proof.reason.startswith('a pose explains ')
    assert (proof.assignment != BIN).sum() >= 3


@pytest.mark.parametrize('scale', ['free'])
def test_only_data_of_known_scale_is_proven(scale):
    proof = prove_problem(make_problem(model(), seen(range(5)), PARAMS), 2, PARAMS.replace(scale=scale))
    assert not proof.proven and proof.reason == "only data of known scale can be proven, not scale='free'"
    assert proof.assignment is None and proof.nodes == proof.pairings == 0 and proof.seconds == 0.0
