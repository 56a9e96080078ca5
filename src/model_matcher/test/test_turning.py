"""A pulley is round but for its keyway: the turn that shows most of it in the images."""

from dataclasses import replace

import numpy as np
import pytest

from csg_renderer import Light, Scene, SolidOutline, model_features, parse_scene, render_stereo
from csg_renderer.raycast.sensor import SensorModel
from model_matcher import MatchParams, index_model, match
from model_matcher.geometry.pose_rows import as_motion, as_pose
from model_matcher.image_pose.measurement import elsewhere, fitted, laid_on_steps, presence, searched
from model_matcher.image_pose.presence import bent, chance_beside, confirmations, crowded, log_ratio
from model_matcher.image_pose.settings import FLANK, OTHERS_EDGES, REACH, SPACING, TONES
from model_matcher.image_pose.sight import look
from model_matcher.image_pose.views import Views
from model_matcher.model.problem import make_problem
from model_matcher.model.symmetry import Axis, about_axis, symmetries
from model_matcher.verification import image_evidence
from model_matcher.verification.settings import STILL
from model_matcher.verification.turning import _moves, best_turn, laid_without_turn, likeliest_turns, ratios
from msgs_py import PinholeCamera, Pose, StereoRig
from msgs_py.numeric.deadline import Deadline

PULLEY = """
UNITS MM;
pulley = CYLINDER (44, 0, 0, 24) DIFFERENCE (CYLINDER (12, 0, 0, 80) AT (0, 0, -10))
         DIFFERENCE (BLOCK (17, 7, 80) AT (0, -3.5, -10));
DRAW pulley;
"""
AXIS = Axis(np.zeros(3), np.array([0.0, 0.0, 1.0]))
# Degrees, by which a corner of the keyway moves by a pixel and a half: nearer one look does not tell.
NEAR = np.degrees(1.5 / (0.017 * 800.0 / 0.6))
RIG = StereoRig.symmetric(PinholeCamera.centred(640, 480, 800.0), 0.1)


def pictures(solid):
    """Two pictures of a solid in the model's frame, and its pose in them."""
    pose = Pose.from_rotation_vector([2.6, 0.4, 0.3])
    pose = Pose(pose.rotation, np.array([0.05, 0.0, 0.6]))
    lights = [Light((0.3, -0.5, 0.2), (0.8,) * 3), Light((-0.5, -0.2, -0.3), (0.3,) * 3)]
    scene = Scene([solid.transformed(pose)], lights, (0.2,) * 3, (0.4,) * 3)
    frames = render_stereo(scene, RIG, antialias=4, psf=0.5)
    images = [SensorModel(0.5, 2.0, (1, eye)).picture(frame, monochrome=True) for eye, frame in enumerate(frames)]
    return Views.of(images, RIG), pose


@pytest.fixture(scope='module')
def pulley():
    """The model, its outline, its pose, and two pictures of it."""
    solid = parse_scene(PULLEY).solids[0]
    views, pose = pictures(solid)
    return index_model(model_features(solid), 'pulley'), SolidOutline(solid), pose, views


@pytest.mark.parametrize('degrees', [10.0, 77.0, 180.0, 231.0, 303.0])
def test_the_turn_is_where_the_keyway_is(pulley, degrees):
    index, shape, pose, views = pulley
    found = likeliest_turns(index, shape, AXIS, pose.compose(AXIS.turn(np.radians(degrees))), views, Deadline())
    assert pose.error_to(found[0]).rotation_deg < NEAR


def test_a_turn_is_found_within_reach_and_not_beyond(pulley):
    _, shape, pose, views = pulley
    start = pose.compose(AXIS.turn(0.2))
    near, turned = best_turn(shape, start, AXIS, 0.25, views, SPACING)
    far, _ = best_turn(shape, start, AXIS, 0.1, views, SPACING)
    assert pose.error_to(turned).rotation_deg < NEAR
    assert near > far + 3.0


@pytest.mark.parametrize('degrees', [77.0, 180.0])
def test_the_axis_is_laid_on_what_no_turn_moves(pulley, degrees):
    """At a wrong turn the keyway stands beside its steps, or on others' ones."""
    _, shape, pose, views = pulley
    start = pose.compose(AXIS.turn(np.radians(degrees)))
    # Two pixels aside, and a degree.
    aside = Pose(Pose.from_rotation_vector([0.012, 0.012, 0.0]).rotation @ start.rotation, start.translation + 0.0015)
    found = as_pose(laid_without_turn(shape, AXIS, aside, views)[0])
    off = pose.inverse().compose(found)
    assert np.linalg.norm(found.translation - pose.translation) < 0.0006
    assert np.degrees(np.arccos(min(off.rotation[2, 2], 1.0))) < 0.4


def test_a_turn_that_hardly_anything_tells_of_stays_where_the_outline_was_drawn_in(pulley):
    """A step a fifth of a pixel off, beside the middle of the keyway's end, asks for a turn by many degrees."""
    _, shape, pose, views = pulley
    views = views.coded(TONES[0])
    sight = look(shape, pose, views)
    lever = _moves(sight, shape, pose, AXIS)
    moving = np.isin(sight.placed.curve, sight.placed.curve[np.abs(lever) > STILL])
    steps = fitted(sight, views).without(moving)
    told = int(np.argmin(np.where(moving & (np.abs(lever) > 0.5), np.abs(lever), np.inf)))
    steps.number[told], steps.offset[told], steps.variance[told] = 1, 0.2, 0.01
    assert 1.0 / np.radians(NEAR) > 4.0 * abs(lever[told])
    density = elsewhere(searched(sight, views, FLANK), FLANK)
    found = laid_on_steps(shape, as_motion(pose), views, sight, steps, density)
    assert pose.error_to(as_pose(found.motion)).rotation_deg < 0.5 * NEAR


@pytest.mark.parametrize(('features_say', 'looks'), [(0.0, 1), (-50.0, 0)])
def test_no_turn_is_looked_for_of_what_features_and_images_speak_against(pulley, monkeypatch, features_say, looks):
    """Rims leave a turn free; no turn makes what is not there."""
    index, shape, pose, views = pulley
    index = index_model(index.features, 'pulley', shape)
    rims = index.features.select(np.flatnonzero(~np.isnan(index.rows[:, 7]) & about_axis(index.rows, AXIS, index.size)))
    calls, own, weigh = [], image_evidence.weigh_turned, image_evidence.weigh

    def weighed(*given):
        one = weigh(*given)
        return replace(one, hypothesis=replace(one.hypothesis, evidence=one.hypothesis.evidence + features_say))

    monkeypatch.setattr(image_evidence, 'weigh', weighed)
    monkeypatch.setattr(image_evidence, 'weigh_turned', lambda *given: calls.append(given) or own(*given))
    match(index, rims.transformed(pose), views=views)
    assert len(calls) == looks


@pytest.mark.parametrize('degrees', [0.0, 40.0])
def test_a_turn_that_one_feature_tells_is_asked_of_the_images(pulley, degrees):
    """An edge of another object, beside a round one, may be where one of its own would be at another turn."""
    index, shape, pose, views = pulley
    index = index_model(index.features, 'pulley', shape)
    round_ones = about_axis(index.rows, AXIS, index.size)
    rims = index.features.select(np.flatnonzero(~np.isnan(index.rows[:, 7]) & round_ones))
    edge = index.features.select(np.flatnonzero(np.isnan(index.rows[:, 7]) & ~round_ones)[:1])
    turned = edge.transformed(pose.compose(AXIS.turn(np.radians(degrees))))
    data = type(edge).concatenate([rims.transformed(pose), turned])
    by_features = match(index, data).interpretations[0]
    assert by_features.matched == len(data)
    problem = make_problem(index, data, MatchParams())
    found = image_evidence.accepted_by_images(problem, shape, [by_features], views, 0.0, Deadline()).accepted
    assert len(found) == 1
    assert pose.error_to(found[0].pose).rotation_deg < NEAR


def test_one_rim_is_enough_where_images_tell_the_rest(pulley):
    """Of a dark part often no more is found."""
    index, shape, pose, views = pulley
    index = index_model(index.features, 'pulley', shape)
    rims = index.features.select(np.flatnonzero(~np.isnan(index.rows[:, 7]) & about_axis(index.rows, AXIS, index.size)))
    facing = rims.start[:, 2] > 0.02
    for one in np.flatnonzero(facing):
        data = rims.select([one]).transformed(pose)
        assert not match(index, data).interpretations
        found = match(index, data, views=views).interpretations
        assert len(found) == 1
        # Turned over it is the same.
        equal = [pose, *(pose.compose(motion) for motion in symmetries(index))]
        assert min(one.error_to(found[0].pose).rotation_deg for one in equal) < NEAR


def test_a_rim_alone_is_none_of_the_model(pulley):
    """It is seen where it was found, whatever it is the rim of."""
    index, shape, pose, _ = pulley
    ring = parse_scene('UNITS MM; ring = CYLINDER (44, 0, 0, 24) DIFFERENCE CYLINDER (40, 0, 0, 23); DRAW ring;')
    views, _ = pictures(ring.solids[0])
    index = index_model(index.features, 'pulley', shape)
    rims = index.features.select(np.flatnonzero(index.features.radii[:, 0] > 0.04))
    for one in range(len(rims)):
        assert not match(index, rims.select([one]).transformed(pose), views=views).interpretations


def test_a_rim_is_no_second_witness_of_itself(pulley):
    index, shape, pose, views = pulley
    index = index_model(index.features, 'pulley', shape)
    rims = index.features.select(np.flatnonzero(index.features.radii[:, 0] > 0.04)).transformed(pose)
    for some in (rims.select([0]), rims):
        found = match(index, some, views=views).interpretations[0]
        one = image_evidence.Weighed(found, as_motion(found.pose), presence(shape, found.pose, views))
        told = image_evidence._told_once(index, one, views, 0.0)
        assert (told.evidence < one.evidence) == (len(some) == 1)


def test_what_images_speak_against_stays_where_it_is_whatever_turn_it_leaves(pulley):
    """Far from what it needs; with all of it, it is drawn in from where features have it."""
    index, shape, pose, views = pulley
    index = index_model(index.features, 'pulley', shape)
    rims = index.features.select(np.flatnonzero(index.features.radii[:, 0] > 0.04)).transformed(pose)
    problem = make_problem(index, rims, MatchParams())
    found = replace(match(index, rims).rejected[0], symmetric_poses=())
    assert found.free_turn is not None
    for shift, stays in ((0.03, True), (0.0005, False)):
        one = replace(found, pose=Pose(np.eye(3), [shift, 0.0, 0.0]).compose(found.pose), evidence=0.0)
        seen = image_evidence.weigh(problem, shape, one, views, needed=7.0)
        assert np.array_equal(seen.motion, as_motion(one.pose)) == stays
        assert (seen.evidence > 0.0) != stays


def test_what_is_turned_keeps_the_poses_that_no_turn_tells_it_from(pulley):
    """Two rims are the same the other way up, where the hub that tells is out of the pictures."""
    index, shape, pose, views = pulley
    index = index_model(index.features, 'pulley', shape)
    rims = index.features.select(np.flatnonzero(index.features.radii[:, 0] > 0.04)).transformed(pose)
    problem = make_problem(index, rims, MatchParams())
    found = match(index, rims).rejected[0]
    over = pose.compose(Pose(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 0.024]))
    rival = image_evidence.Weighed(found, as_motion(over), presence(shape, over, views))
    one = replace(image_evidence.weigh(problem, shape, found, views), rivals=(rival,))
    turned = image_evidence.weigh_turned(problem, shape, one, AXIS, views, Deadline())
    assert turned is not one
    assert rival in turned.rivals


def test_no_turn_is_the_outline_as_it_is(pulley):
    _, shape, pose, views = pulley
    sight = look(shape, pose, views)
    placed, steps = sight.placed, searched(sight, views, REACH + 1)
    found = confirmations(steps.offset, steps.number, 0.0)
    found[crowded(placed)] = -1
    is_bent, chance = bent(placed.point, placed.curve, sight.limb), chance_beside(steps, placed.group, OTHERS_EDGES)
    expected = log_ratio(found, placed.group, placed.curve, is_bent, chance)
    assert ratios(placed, sight.limb, steps, np.ones(len(sight)), np.zeros(1)) == pytest.approx([expected])


def test_when_no_time_is_left_there_is_no_turn(pulley):
    index, shape, pose, views = pulley
    assert likeliest_turns(index, shape, AXIS, pose, views, Deadline(1e-9)) == []
