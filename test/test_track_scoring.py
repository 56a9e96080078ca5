"""What the benchmark of trackers counts: frames lost, wrong poses held, losses noticed late; and what it feeds them."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).resolve().parent / 'benchmarks'))
from bench_tracking import found_anew, run, standing, tracks_of
from track_scoring import Step, run_lengths, score_track
from tracking_sequences import Track, TrackFrame, cube_tracks, rendered_track
from true_pairs import data_folder
from true_poses import Instance, tea_box

from msgs_py import CameraRig, PinholeCamera, Pose

POSE = Pose.from_rotation_vector([0.4, -0.7, 0.2], [0.05, -0.02, 0.7])
FAR = Pose(POSE.rotation, POSE.translation + [0.05, 0.0, 0.0])
NEAR = Pose(POSE.rotation, POSE.translation + [0.002, 0.0, 0.0])


def step(share: float, pose: Pose | None, milliseconds: float = 2.0) -> Step:
    return Step(Instance(tea_box(), POSE, share, None), pose, milliseconds, 0.5 * milliseconds)


def test_frames_are_lost_only_where_the_part_can_be_seen():
    steps = [step(1.0, NEAR, 50.0), step(1.0, None), step(0.2, None), step(0.0, None), step(0.8, NEAR), step(0.9, FAR)]
    row = score_track(steps)
    assert (row['frames'], row['to_hold'], row['lost'], row['gone'], row['wrong']) == (6, 4, 2, 1, 1)
    assert row['lost_share'] == 0.5 and row['late'] == 0 and row['held_wrong'] == 1
    assert row['mm'] == pytest.approx(2.0) and row['deg'] < 1e-5
    assert row['first_ms'] == 50.0 and row['ms'] == 2.0 and row['cpu_ms'] == 1.0


def test_a_loss_may_go_unnoticed_for_three_frames():
    """A pose of a part that is gone counts as one that is wrong, whether or not it happens to be right."""
    row = score_track(
        [step(1.0, NEAR), *[step(0.0, NEAR)] * 3, *[step(0.0, FAR)] * 2, step(0.0, None), step(1.0, NEAR)]
    )
    assert row['held_wrong'] == 5 and row['late'] == 2
    assert row['lost'] == 0 and row['gone'] == 6


def test_a_part_that_one_eye_sees_is_not_gone():
    steps = [step(1.0, NEAR), *[replace(step(0.0, NEAR), seen=0.3)] * 6, replace(step(0.0, None), seen=0.01)]
    row = score_track(steps)
    assert row['held_wrong'] == 0 and row['gone'] == 1 and row['to_hold'] == 1


@given(st.lists(st.booleans(), max_size=40))
def test_runs_add_up(flags):
    runs = run_lengths(np.array(flags, bool))
    assert sum(runs) == sum(flags) and all(run > 0 for run in runs)
    text = ''.join('x' if flag else ' ' for flag in flags)
    assert runs == [len(word) for word in text.split()]


def test_the_tracker_gets_the_first_pose_and_every_frame_once():
    camera = PinholeCamera.centred(64, 48, 60.0)
    instance = Instance(tea_box(), POSE, 1.0, None)
    images = [(np.full((48, 64), k, np.uint8),) for k in range(4)]
    track = Track(
        'made up', tea_box(), 4, lambda: (TrackFrame(k, image, camera, instance) for k, image in enumerate(images))
    )
    seen = []

    def make(part, first):
        assert part is tea_box() and first == POSE

        def step(images, rig):
            seen.append(int(images[0][0, 0]))
            assert rig is camera
            return None if seen[-1] == 2 else first

        return step

    row = run([track], make)[0]
    assert seen == [0, 1, 2, 3] and row['lost'] == 1
    assert run([track], standing)[0]['lost'] == 0
    assert 'rectified' in run([track], found_anew)[0]['absent']


def test_a_rendered_track_is_followed_by_finding_the_part_anew():
    row = run([rendered_track('plain', 3)])[0]
    assert row['lost'] == 0 and row['wrong'] == 0 and row['deg'] < 0.1
    assert [track.name for track in tracks_of(['pl'], 2, Path('/nowhere'))] == ['plain']


def test_two_frames_of_a_camera_are_a_rig_in_which_the_truth_holds():
    try:
        tracks = cube_tracks(data_folder())
    except FileNotFoundError as error:
        pytest.skip(str(error))
    if not tracks:
        pytest.skip('no sequence of the cube is here')
    one, two = tracks
    assert one.length == 40 and two.length > 10
    alone = {frame.images[0].tobytes(): frame.instance.pose for frame in one.frames()}
    for number, frame in enumerate(two.frames()):
        assert frame.number == number and isinstance(frame.rig, CameraRig)
        assert np.linalg.norm(frame.rig.poses[1].translation) >= 0.025
        # Seen from the second camera the cube stands where that frame has it.
        second = frame.rig.poses[1].inverse().compose(frame.instance.pose)
        there = alone[frame.images[1].tobytes()]
        assert second.error_to(there).rotation < 1e-6 and np.allclose(second.translation, there.translation, atol=1e-9)
