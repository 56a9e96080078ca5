"""Sequences of a moving part: the path is what was asked for, the pictures show the truth, folders keep it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from csg_renderer import model_features, scene_path
from model_matcher import match
from model_matcher.closed_form.case import Case
from model_matcher.closed_form.cli import main
from model_matcher.closed_form.comparison import best_pose_error
from model_matcher.closed_form.placement import load_case_scene
from model_matcher.closed_form.sequences.motion import PATHS, Course, Foreground, Motion, bars_at
from model_matcher.closed_form.sequences.sequence import read_sequence, rendered_sequence, write_sequence
from msgs_py import Pose
from stereo_recovery import recover

SMALL = Case('chair_v1', width=256, height=256, antialias=2)
START = Pose.from_rotation_vector([0.3, -0.8, 0.2], [0.02, -0.03, 0.5])
MIDDLE = np.array([-0.02, 0.03, -0.01])


@settings(deadline=None, max_examples=40)
@given(st.sampled_from(PATHS), st.floats(0.0, 200.0), st.floats(0.0, 0.5), st.floats(0.0, 10.0))
def test_a_path_starts_at_the_case_and_is_as_fast_as_asked(path, turn, shift, time):
    course = Course(Motion(path, turn_deg_s=turn, shift_m_s=shift), START, MIDDLE)
    first = course.pose(0.0)
    assert first.error_to(START).rotation < 1e-7 and np.allclose(first.translation, START.translation)
    step = 1e-4
    before, after = course.pose(time), course.pose(time + step)
    moved = (after.apply(MIDDLE) - before.apply(MIDDLE)) / step
    assert (np.abs(moved) <= shift * (1.0 + 1e-6) + 1e-9).all()
    speed = before.error_to(after).rotation_deg / step
    assert speed <= 3.0**0.5 * turn + 1e-3
    if path == 'turn':
        assert speed == pytest.approx(turn, abs=1e-3)
    assert np.linalg.norm(before.apply(MIDDLE) - START.apply(MIDDLE)) <= course.reach + 1e-12


def test_a_jump_is_one_and_stays():
    motion = Motion(jump=10, jump_m=0.02, jump_deg=5.0, turn_deg_s=0.0, shift_m_s=0.0, exposure=1.0)
    course = Course(motion, START, MIDDLE)
    before, after, later = (course.pose(float(motion.stamps[k])) for k in (9, 10, 60))
    assert before.error_to(START).rotation < 1e-7
    assert before.error_to(after).rotation_deg == pytest.approx(5.0)
    assert np.linalg.norm(after.apply(MIDDLE) - before.apply(MIDDLE)) == pytest.approx(0.02)
    assert after.error_to(later).rotation < 1e-7


def test_bars_take_turns_and_never_reach_the_part():
    motion = Motion(occluders=3, occlusion=0.5)
    view = Foreground(np.array([0.1, -0.05]), np.array([0.2, 0.3]), np.array([0.8, 0.6]), 0.4)
    nearest = []
    for time in np.linspace(0.0, 12.0, 400):
        bars = bars_at(motion, view, float(time))
        assert all(bar.centre[2] + 0.5 * bar.size[2] < view.depth for bar in bars)
        # How far each one's middle is from the part's, in units of the image.
        away = [abs(bar.centre[k % 2] / bar.centre[2] - view.middle[k % 2]) for k, bar in enumerate(bars)]
        nearest.append(sorted(away)[:2])
        assert bars[0].size[0] / bars[0].centre[2] == pytest.approx(0.5 * 0.2)
    first, second = np.array(nearest).T
    assert first.min() < 0.02 and second.min() > 0.4


@pytest.mark.parametrize(
    ('given', 'told'),
    [
        ({'path': 'zigzag'}, 'path'),
        ({'frames': 0}, 'frames'),
        ({'rate_hz': 0.0}, 'rate_hz'),
        ({'exposure': 1.5}, 'exposure'),
        ({'occlusion': -0.1}, 'occlusion'),
    ],
)
def test_a_motion_that_cannot_be_is_refused_by_name(given, told):
    with pytest.raises(ValueError, match=told):
        Motion(**given)


def test_a_short_sequence_shows_its_truth():
    case = Case('chair_v1', antialias=3, clutter=4)
    sequence = rendered_sequence(case, Motion(frames=3, rate_hz=10.0, turn_deg_s=90.0, shift_m_s=0.1))
    model = model_features(load_case_scene(case).placements[0].model)
    for frame in sequence:
        assert frame.visible_share == pytest.approx(1.0, abs=1e-9)
        best = match(model, recover(*frame.images, sequence.rig).features).best
        assert best is not None
        error = best_pose_error(best, frame.pose)
        assert error.rotation_deg < 0.1 and error.translation < 3e-4
    with pytest.raises(IndexError):
        sequence[3]


def test_the_same_seed_gives_the_same_frames_in_any_order():
    motion = Motion(frames=4, exposure=0.5, occluders=1)
    one, two = rendered_sequence(SMALL, motion), rendered_sequence(SMALL, motion)
    last = one[3].images
    assert all(np.array_equal(a, b) for a, b in zip(last, [frame.images for frame in two][3]))
    other = rendered_sequence(replace(SMALL, seed=1), motion)[3]
    assert not np.array_equal(other.images[0], last[0])


def test_motion_blurs_along_the_motion_and_the_truth_is_the_middle():
    clean = replace(SMALL, noise=0.0, psf=0.0, antialias=4)
    motion = Motion(frames=2, rate_hz=10.0, turn_deg_s=0.0, shift_m_s=0.06)
    sharp, blurred = (rendered_sequence(clean, replace(motion, exposure=share))[0] for share in (0.0, 0.8))
    assert sharp.pose == blurred.pose
    slopes = [np.abs(np.diff(frame.images[0].astype(float), axis=1)).max() for frame in (sharp, blurred)]
    assert slopes[1] < 0.6 * slopes[0]
    # What moves evenly while the shutter is open has its middle where it was in the middle of that time.
    rows, columns = np.mgrid[:256, :256]
    middles = [
        [float((frame.images[0] * place).sum() / frame.images[0].sum(dtype=float)) for place in (columns, rows)]
        for frame in (sharp, blurred)
    ]
    assert np.allclose(*middles, atol=0.1)


def test_what_a_bar_hides_is_missing_from_the_visible_share():
    motion = Motion(frames=40, rate_hz=10.0, turn_deg_s=0.0, shift_m_s=0.0, occluders=1, occlusion=2.5)
    sequence = rendered_sequence(SMALL, motion)
    shares = sequence.visible_share
    assert shares[0] > 0.99 and shares.min() < 0.02 and shares[-1] > 0.99
    # Where nothing is left, the pictures do not change with the part.
    frame = sequence[int(np.argmin(shares))]
    narrow = rendered_sequence(SMALL, replace(motion, occlusion=0.4)).visible_share
    assert 0.3 < narrow.min() < 0.9
    assert frame.visible_share == shares.min()
    assert np.array_equal(sequence.eye_shares.min(axis=1), shares)
    assert (sequence.eye_shares.max(axis=1) > shares + 0.2).any()


def test_a_part_that_leaves_the_picture_is_seen_in_part():
    pose = Pose.from_rotation_vector([0.4, 0.6, 0.0], [0.075, -0.03, 0.2])
    sequence = rendered_sequence(replace(SMALL, pose=tuple(pose.matrix.ravel())), Motion(frames=1))
    assert 0.05 < sequence.visible_share[0] < 0.95


def test_clutter_stays_behind_the_part():
    case = replace(SMALL, clutter=12, noise=0.0)
    motion = Motion(frames=30, rate_hz=5.0, turn_deg_s=60.0, shift_m_s=0.2)
    alone, among = (rendered_sequence(replace(case, clutter=n), motion) for n in (0, 12))
    for number in (0, 13, 29):
        plain, full = alone[number].images[0], among[number].images[0]
        # Every bright pixel of the part, away from its outline, is as it was; which samples of it are taken may change,
        # and with them half a grey level.
        part = cv2.erode((plain > 40).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        assert part.sum() > 500
        assert np.abs(plain[part].astype(int) - full[part]).max() <= 1
        assert (plain[part] == full[part]).mean() > 0.999
        assert (plain != full).sum() > 500


def test_a_folder_gives_the_sequence_back(tmp_path):
    motion = Motion('tumble', frames=3, occluders=1)
    sequence = rendered_sequence(SMALL, motion)
    write_sequence(tmp_path, sequence, SMALL, motion)
    again = read_sequence(tmp_path)
    assert (len(again), again.name) == (3, sequence.name)
    assert again.rig.baseline == pytest.approx(sequence.rig.baseline)
    assert np.allclose(again.visible_share, sequence.visible_share, atol=1e-4)
    for one, two in zip(sequence, again):
        assert all(np.array_equal(a, b) for a, b in zip(one.images, two.images))
        assert one.pose.error_to(two.pose).rotation < 1e-7
        assert np.allclose(one.pose.translation, two.pose.translation, atol=1e-8)
        assert one.stamp_s == pytest.approx(two.stamp_s, abs=1e-6)
    lines = (tmp_path / 'truth.tum').read_text().splitlines()
    numbers = np.array([line.split() for line in lines], float)
    assert numbers.shape == (3, 8) and np.allclose(np.linalg.norm(numbers[:, 4:], axis=1), 1.0, atol=1e-6)


def test_a_folder_that_is_no_sequence_is_refused_by_name(tmp_path):
    with pytest.raises(OSError, match=r'truth\.csv'):
        read_sequence(tmp_path)
    (tmp_path / 'truth.csv').write_text('frame,stamp\n0,0\n')
    with pytest.raises(ValueError, match='visible_share'):
        read_sequence(tmp_path)


def test_the_command_writes_a_sequence_and_plays_it_to_the_nodes(tmp_path, capsys):
    scene = str(scene_path('l_shape_v1'))
    arguments = [scene, '--path', 'turn', '--frames', '3', '--turn', '30', '--nodes', '-q', '-o', str(tmp_path)]
    assert main([*arguments, '--antialias', '2', '--min-success', '0.6']) == 0
    folder = tmp_path / 'l_shape_v1'
    assert len(list((folder / 'images').glob('*.png'))) == 6
    assert '3 of 3 within the limits' in capsys.readouterr().out
    assert len((folder / 'found.tum').read_text().splitlines()) == 3


def test_a_sequence_is_made_on_its_own(capsys):
    with pytest.raises(SystemExit):
        main(['l_shape_v1', '--path', 'turn', '--sweep', 'grid'])
    assert '--path' in capsys.readouterr().err
