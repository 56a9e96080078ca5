"""What the benchmark of poses calls right: equal poses are equal, a free turn is free, the witness sees a shift."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

sys.path.insert(0, str(Path(__file__).resolve().parent / 'benchmarks'))
from pose_bounds import PoseBound
from pose_scoring import score_search, step_offsets
from true_poses import Instance, PosedPair, difference, make_part, tea_box

from csg_renderer import Solid
from model_matcher import MatchResult
from msgs_py import Interpretation, Pose

PEG = make_part('peg', Solid.cylinder(0.015, (0.0, 0.0, 0.06)))
POSE = Pose.from_rotation_vector([0.4, -0.7, 0.2], [0.05, -0.02, 0.7])


def turned(pose: Pose, axis: tuple[float, float, float], angle: float, about: np.ndarray) -> Pose:
    """A pose after a turn of the model about a point of its own."""
    turn = Pose.from_rotation_vector(angle * np.array(axis))
    return pose.compose(Pose(turn.rotation, about - turn.rotate(about)))


@settings(deadline=None, max_examples=30)
@given(st.floats(-3.1, 3.1), st.booleans())
def test_a_peg_is_the_same_at_any_turn_and_end_for_end(angle, over):
    instance = Instance(PEG, POSE, 1.0, PEG.axis)
    pose = turned(POSE, (0.0, 0.0, 1.0), angle, PEG.middle)
    if over:
        pose = turned(pose, (1.0, 0.0, 0.0), np.pi, PEG.middle)
    off = difference(instance, pose)
    assert off.degrees < 1e-5 and off.metres < 1e-12


def test_a_peg_that_leans_or_is_moved_is_off_by_that():
    instance = Instance(PEG, POSE, 1.0, PEG.axis)
    off = difference(instance, turned(POSE, (0.0, 1.0, 0.0), np.radians(2.0), PEG.middle))
    assert off.degrees == pytest.approx(2.0) and off.metres < 1e-12
    away = Pose(POSE.rotation, POSE.translation + [0.0, 0.0, 0.007])
    off = difference(instance, away)
    assert off.degrees < 1e-5 and off.metres == pytest.approx(0.007)
    assert off.depth_share == pytest.approx(0.007 / instance.place[2])


def test_a_box_has_four_equal_poses_and_no_free_turn():
    box = tea_box()
    assert len(box.motions) == 4 and box.axis is None
    instance = Instance(box, POSE, 1.0, None)
    for motion in box.motions:
        off = difference(instance, POSE.compose(motion))
        assert off.degrees < 1e-5 and off.metres < 1e-12
    assert difference(instance, turned(POSE, (1.0, 0.0, 0.0), np.radians(90.0), box.middle)).degrees > 80.0


def test_a_turn_that_the_picture_does_not_show_is_free():
    hole = Solid.cylinder(0.003, (0.0, 0.0, 0.08)).transformed(Pose(np.eye(3), np.array([0.009, 0.0, -0.01])))
    part = make_part('drilled', Solid.cylinder(0.015, (0.0, 0.0, 0.06)) - hole)
    assert part.axis is None
    pose = turned(POSE, (0.0, 0.0, 1.0), 1.0, np.zeros(3))
    assert difference(Instance(part, POSE, 1.0, None), pose).degrees > 50.0
    hidden = difference(Instance(part, POSE, 1.0, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])), pose)
    assert hidden.degrees < 1e-5 and hidden.metres < 1e-12


def test_each_instance_is_found_once_and_a_right_pose_refused_is_told():
    box = tea_box()
    there = [Pose(POSE.rotation, POSE.translation + [0.3 * k, 0.0, 0.0]) for k in range(3)]
    posed = PosedPair(None, tuple(Instance(box, pose, 0.6, None) for pose in there), (box,))  # type: ignore[arg-type]

    def found(pose: Pose, reason: str | None = None) -> Interpretation:
        return Interpretation('tea_box', [], [], pose, rejected_reason=reason)

    near = Pose(there[0].rotation, there[0].translation + 1e-3)
    far = Pose(there[0].rotation, there[0].translation + [0.0, 0.2, 0.0])
    result = MatchResult(
        (found(near), found(there[0]), found(far), replace(found(there[1]), model='another')),
        (found(far, 'chance'), found(there[1], 'chance')),
    )
    search = score_search(posed, box, result, 1.0, 1.0)
    assert [answer.verdict for answer in search.answers] == ['twice', 'right', 'wrong']
    assert search.missed == [1, 2] and search.refused == {1: 1, 2: None}


def test_an_answer_that_names_the_right_pose_beside_its_own_is_ambiguous():
    box = tea_box()
    posed = PosedPair(None, (Instance(box, POSE, 0.6, None),), (box,))  # type: ignore[arg-type]
    far = Pose(POSE.rotation, POSE.translation + [0.0, 0.2, 0.0])
    for named, verdict in (((), 'wrong'), ((far,), 'wrong'), ((far, POSE), 'ambiguous')):
        one = Interpretation('tea_box', [], [], far, ambiguous_poses=named)
        search = score_search(posed, box, MatchResult((one,)), 1.0, 1.0)
        assert [answer.verdict for answer in search.answers] == [verdict]
        assert search.missed == [0]  # what is found is the pose that is reported


@pytest.mark.parametrize(('moved', 'verdict'), [(0.0, 'ambiguous'), (0.05, 'wrong')])
def test_an_answer_that_leaves_a_turn_open_is_judged_but_for_that(moved, verdict):
    box = tea_box()
    posed = PosedPair(None, (Instance(box, POSE, 0.6, None),), (box,))  # type: ignore[arg-type]
    axis, point = np.array([0.0, 0.6, 0.8]), np.array([0.02, 0.07, -0.03])
    pose = turned(POSE, (0.0, 0.6, 0.8), 1.0, point)
    direction, arm = pose.rotate(axis), pose.translation - pose.apply(point)
    turn = np.concatenate([np.cross(direction, arm), direction])
    covariance = np.pi**2 / 3.0 * np.outer(turn, turn) + 1e-8 * np.eye(6)
    pose = Pose(pose.rotation, pose.translation + moved * direction)
    open_turn = Interpretation('tea_box', [], [], pose, covariance=covariance, free_turn=direction)
    for one, expected in ((open_turn, verdict), (replace(open_turn, free_turn=None), 'wrong')):
        search = score_search(posed, box, MatchResult((one,)), 1.0, 1.0)
        assert [answer.verdict for answer in search.answers] == [expected]


@pytest.mark.parametrize('shift', [-1.6, -0.3, 0.0, 0.45, 1.2])
def test_the_witness_measures_by_how_much_an_edge_is_off(shift):
    columns = np.arange(80.0)
    image = np.tile(np.rint(60.0 + 120.0 * ndtr((columns - 40.0 - shift) / 0.8)), (60, 1)).astype(np.uint8)
    points = np.column_stack([np.full(40, 40.0), np.arange(10.0, 50.0)])
    off = step_offsets(image, points, np.tile([1.0, 0.0], (40, 1)))
    assert np.allclose(off, shift, atol=0.05)
    assert np.isnan(step_offsets(np.full_like(image, 90), points, np.tile([1.0, 0.0], (40, 1)))).all()


def test_an_error_in_units_of_its_covariance_and_of_the_bound():
    box = tea_box()
    bound = PoseBound(np.diag([1e8] * 3 + [1e6] * 3), 0.1)
    posed = PosedPair(None, (Instance(box, POSE, 1.0, None),), (box,), (bound,))  # type: ignore[arg-type]
    # Named by an equal pose of the box: 1 mm and 0.01 rad off that.
    equal = POSE.compose(box.motions[2])
    off = Pose.from_rotation_vector([0.0, 0.01, 0.0])
    pose = Pose(off.rotation @ equal.rotation, equal.translation + [1e-3, 0.0, 0.0])
    one = Interpretation('tea_box', [], [], pose, covariance=np.diag([1e-6] * 3 + [1e-4] * 3))
    answer = score_search(posed, box, MatchResult((one,)), 1.0, 1.0).answers[0]
    median = 5.348120627447119
    assert answer.stated == pytest.approx(2.0 / median)
    assert answer.bounded == pytest.approx((1e-6 * 1e8 + 1e-4 * 1e6) / median)
