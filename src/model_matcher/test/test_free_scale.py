"""Data of unknown scale, as structure from motion gives it: pose and scale come out together."""

import numpy as np
import pytest

from model_matcher import MatchParams, index_model, match
from model_matcher.closed_form.synthetic.scenes import MODELS, box, make_scene
from model_matcher.search.free_scale import likely_scales
from msgs_py import FeatureSet, Pose

NAMES = ('chipped_block', 'l_shape', 'chair', 'computer', 'cylinder_box', 'tubes')


def resized(features, factor):
    return features.transformed(Pose(np.eye(3), np.zeros(3), factor))


def is_right(best, truth, factor):
    near = any(pose.error_to(truth).rotation_deg < 2.5 for pose in (best.pose, *best.symmetric_poses))
    return near and abs(best.pose.scale / factor - 1.0) < 0.02


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('factor', [0.1, 1.0, 37.0])
def test_pose_and_scale_of_cluttered_data(name, factor):
    model = MODELS[name]()
    right = 0
    for seed in range(3):
        scene = make_scene(model, seed, clutter=0.4)
        best = match(model, resized(scene.data, factor), MatchParams(scale='free')).best
        right += best is not None and is_right(best, scene.poses[0], factor)
    assert right == 3


def test_ideal_data_gives_the_exact_scale_and_lands_on_the_model():
    model = MODELS['chipped_block']()
    scene = make_scene(model, 2, sigma=1e-9, visible=1.0)
    data = resized(scene.data, 5.0)
    best = match(model, data, MatchParams(scale='free')).best
    assert best.pose.scale == pytest.approx(5.0, rel=1e-6)
    landed = model.transformed(best.pose)
    for k, j in enumerate(best.assignment):
        gap = data.midpoints[k] - landed.midpoints[j]
        assert np.linalg.norm(np.cross(gap, landed.directions[j])) < 1e-5


@pytest.mark.parametrize('search', ['tree', 'subgraph', 'serial'])
def test_the_searches_of_the_thesis_match_directions_only(search):
    model = MODELS['chipped_block']()
    scene = make_scene(model, 3, sigma=1e-4, visible=0.8)
    best = match(model, resized(scene.data, 3.0), MatchParams(scale='free', search=search, time_limit_s=5.0)).best
    assert best is not None and is_right(best, scene.poses[0], 3.0)


def test_lines_through_one_point_leave_the_scale_open_and_nothing_fails():
    corner = FeatureSet.from_edges(np.zeros((3, 3)), np.eye(3) * [0.05, 0.06, 0.07])
    result = match(corner, resized(corner, 2.0), MatchParams(scale='free', min_matched=3, false_alarm_rate=1.0))
    assert result or result.reason


@pytest.mark.parametrize(
    'data',
    [
        FeatureSet.empty(),
        FeatureSet.from_edges(np.zeros((3, 3)), np.zeros((3, 3))),
        FeatureSet.from_edges(np.zeros((4, 3)), np.tile([[0.1, 0.0, 0.0]], (4, 1))),
    ],
)
@pytest.mark.parametrize('search', ['hypotheses', 'tree', 'serial'])
def test_data_without_an_answer_gives_a_reason(data, search):
    result = match(box((0.03, 0.05, 0.08)), data, MatchParams(scale='free', search=search))
    assert not result and result.reason


def test_the_true_scale_is_among_the_likeliest():
    for name in NAMES:
        model = MODELS[name]()
        scene = make_scene(model, 5, clutter=0.5)
        scales = [scale for scale, _ in zip(likely_scales(index_model(model), resized(scene.data, 8.0)), range(10))]
        assert np.abs(np.log(np.array(scales) / 8.0)).min() < 0.05, name


@pytest.mark.filterwarnings('error')
def test_data_at_angles_that_the_model_has_none_of_has_no_scale():
    """Two circles at an angle, where a box has right ones only."""
    circles = FeatureSet.from_curves([[0.0, 0.0, 1.0], [0.1, 0.05, 1.2]], [[0.0, 0.0, 1.0], [0.3, 0.0, 1.0]], 0.05)
    assert list(likely_scales(index_model(box((0.03, 0.05, 0.08))), circles)) == []
