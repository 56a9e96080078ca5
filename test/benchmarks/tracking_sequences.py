"""Sequences with the true pose of every frame, as a tracker gets them: rendered ones, and a camera's."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from true_poses import Instance, Part, make_part, part_in, rigid_pose

from model_matcher.closed_form.case import Case
from model_matcher.closed_form.placement import load_case_scene
from model_matcher.closed_form.sequences.motion import Motion
from model_matcher.closed_form.sequences.sequence import Sequence, rendered_sequence
from msgs_py import CameraRig, PinholeCamera, Pose, StereoRig

Rig = PinholeCamera | StereoRig | CameraRig
# Two frames of one camera make a pair when it has moved by this in between, metres: a twentieth of the depth.
LEAST_BASELINE = 0.025


@dataclass(frozen=True, eq=False)
class TrackFrame:
    """One step of a tracker: pictures, cameras, and what is true in the first camera's frame.

    seen : the share of the part that the eye sees which sees most of it; None where that is not known
    """

    number: int
    images: tuple[np.ndarray, ...]
    rig: Rig
    instance: Instance
    seen: float | None = None


@dataclass(frozen=True, eq=False)
class Track:
    """A sequence: its name, the part to follow, and its frames, made one at a time."""

    name: str
    part: Part
    length: int
    frames: Callable[[], Iterator[TrackFrame]]


# What a rendered track shows: a case and a motion, of a part in a hand. Bars of 'occluded' leave 0.34 of the part in
# the worst of 240 frames, those of 'vanishes' none for a while.
_TURN = Motion('turn', turn_deg_s=45.0, shift_m_s=0.06)
_SIZE = {'width': 640, 'height': 480, 'focal': 600.0, 'antialias': 3}
RENDERED_TRACKS = {
    'plain': (Case('l_shape_v1', **_SIZE), _TURN),
    'tumbling': (Case('chipped_block_v1', **_SIZE), Motion('tumble', turn_deg_s=60.0, shift_m_s=0.08)),
    'clutter': (Case('chair_v1', **_SIZE, clutter=14), _TURN),
    'occluded': (
        Case('computer_v1', **_SIZE, clutter=14),
        Motion('turn', turn_deg_s=30.0, shift_m_s=0.04, occluders=2, occlusion=0.35),
    ),
    'blurred': (Case('wedge_v1', **_SIZE), Motion('tumble', turn_deg_s=60.0, shift_m_s=0.1, exposure=0.5)),
    'jumps': (Case('cylinder_box_v1', **_SIZE), Motion('turn', turn_deg_s=30.0, shift_m_s=0.04, jump=12)),
    'vanishes': (
        Case('l_shape_v2', **_SIZE),
        Motion('turn', turn_deg_s=20.0, shift_m_s=0.03, occluders=1, occlusion=2.0),
    ),
}


def rendered_track(name: str, frames: int) -> Track:
    """A rendered track of so many frames."""
    case, motion = RENDERED_TRACKS[name]
    motion = Motion(**{**motion.__dict__, 'frames': frames})
    sequence: Sequence = rendered_sequence(case, motion)
    part = make_part(case.name, load_case_scene(case).placements[0].model)

    def steps() -> Iterator[TrackFrame]:
        for frame in sequence:
            instance = Instance(part, frame.pose, frame.visible_share, part.axis)
            seen = None if sequence.eye_shares is None else float(sequence.eye_shares[frame.number].max())
            yield TrackFrame(frame.number, frame.images, sequence.rig, instance, seen)

    return Track(name, part, len(sequence), steps)


def cube_tracks(data: Path) -> list[Track]:
    """ViSP's printed cube by one moving camera, frame by frame, and by two of its frames at a time, a rig that differs
    from step to step. None where the data is not."""
    folder = data / 'real/visp_cube'
    if not (folder / 'sequence/truth.json').exists():
        return []
    truth = json.loads((folder / 'sequence/truth.json').read_text())
    given = truth['camera']
    camera = PinholeCamera(*(given[key] for key in ('width', 'height', 'fx', 'fy', 'cx', 'cy')))
    part = part_in(folder / 'cube.csg')
    poses = [rigid_pose(frame['R'], frame['t']) for frame in truth['frames']]
    paths = [folder / 'sequence' / f'frame_{frame["name"]}.png' for frame in truth['frames']]
    pairs = _pairs(poses)

    def alone() -> Iterator[TrackFrame]:
        for number, (path, pose) in enumerate(zip(paths, poses)):
            yield TrackFrame(number, (_grey(path),), camera, Instance(part, pose, 1.0, part.axis))

    def both() -> Iterator[TrackFrame]:
        for number, (first, second) in enumerate(pairs):
            first_T_second = poses[first].compose(poses[second].inverse())
            rig = CameraRig([camera, camera], [Pose.identity(), first_T_second])
            images = (_grey(paths[first]), _grey(paths[second]))
            yield TrackFrame(number, images, rig, Instance(part, poses[first], 1.0, part.axis))

    return [Track('cube, one camera', part, len(poses), alone), Track('cube, two cameras', part, len(pairs), both)]


def _pairs(poses: list[Pose]) -> list[tuple[int, int]]:
    """Every frame with the last one before it from which the camera has moved far enough."""
    eyes = np.array([pose.inverse().translation for pose in poses])
    found = []
    for number in range(len(poses)):
        far = np.flatnonzero(np.linalg.norm(eyes[:number] - eyes[number], axis=1) >= LEAST_BASELINE)
        if len(far):
            found.append((number, int(far[-1])))
    return found


def _grey(path: Path) -> np.ndarray:
    image: Any = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise OSError(f'{path}: not a readable image')
    return np.asarray(image)
