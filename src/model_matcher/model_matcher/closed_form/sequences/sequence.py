"""Sequences of stereo pairs of a moving part whose pose is known in every frame: rendered, written, and read again.

A frame is the mean of pictures taken while the shutter is open, as a camera's is; its truth is the pose in the middle
of that time. Nothing is random but by the case's seed, and a frame does not depend on those before it.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from csg_renderer import Placement, Scene, Solid, model_features, parse_scene, render_stereo, visible_fragments
from csg_renderer.language import find_scene
from csg_renderer.raycast.sensor import SensorModel, grey
from msgs_py import FeatureKind, FeatureSet, PinholeCamera, Pose, StereoRig
from msgs_py.files import check_image
from stereo_recovery.cameras.calibration import load_rig
from stereo_recovery.recover_cli import camera_record

from ..case import Case
from ..placement import case_lights, case_pose, case_rig, load_case_scene, model_centre
from ..scene_files import clutter_of, copy_scene
from ..settings import SUBFRAMES
from .motion import Course, Foreground, Motion, bars_at

TRUTH_COLUMNS = ('frame', 'stamp_s', 'x_m', 'y_m', 'z_m', 'qx', 'qy', 'qz', 'qw', 'visible_share')


@dataclass(frozen=True, eq=False)
class SequenceFrame:
    """One frame.

    Attributes
    ----------
    number : int
    stamp_s : float
        Seconds since the first frame.
    images : tuple of two (h, w) uint8 arrays
        Left and right.
    pose : Pose
        left_T_part.
    visible_share : float
        Of the length of what a camera would see of the part's edges and contours, were nothing in front of it and its
        picture without end, the share that it sees; of the two eyes the lesser.
    """

    number: int
    stamp_s: float
    images: tuple[np.ndarray, np.ndarray]
    pose: Pose
    visible_share: float


@dataclass(frozen=True, eq=False)
class Sequence:
    """Stereo pairs of a moving part, with their truth; pictures are made, or read, one at a time.

    Attributes
    ----------
    name : str
        Of the part.
    rig : StereoRig
        The cameras.
    stamps_s : (n,) float64
        Seconds.
    poses : tuple of Pose
        left_T_part of each frame.
    visible_share : (n,) float64
        See :class:`SequenceFrame`.
    images : callable
        The pictures of a frame, by its number.
    eye_shares : (n, 2) float64, optional
        The share that either eye sees; None where it is not known.
    """

    name: str
    rig: StereoRig
    stamps_s: np.ndarray
    poses: tuple[Pose, ...]
    visible_share: np.ndarray
    images: Callable[[int], tuple[np.ndarray, np.ndarray]]
    eye_shares: np.ndarray | None = None

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.poses)

    def __getitem__(self, number: int) -> SequenceFrame:
        """A frame. Raises IndexError, naming it, for one that there is not."""
        if not 0 <= number < len(self):
            raise IndexError(f'frame {number}: there are {len(self)}')
        return SequenceFrame(
            number,
            float(self.stamps_s[number]),
            self.images(number),
            self.poses[number],
            float(self.visible_share[number]),
        )

    def __iter__(self) -> Iterator[SequenceFrame]:
        """Frame by frame, each rendered or read when its turn comes."""
        return (self[number] for number in range(len(self)))


def rendered_sequence(case: Case, motion: Motion) -> Sequence:
    """The sequence of a case whose part moves.

    Parameters
    ----------
    case : Case
        Scene, cameras, sensor, clutter (all of it behind the part) and the pose to start from.
    motion : Motion
        The path, and what passes in front.

    Returns
    -------
    Sequence
        Its pictures are rendered when they are asked for.

    Raises
    ------
    ValueError, OSError
        For a scene that cannot be used.
    """
    stage = _Stage(case, motion)
    poses = tuple(stage.course.pose(float(stamp)) for stamp in motion.stamps)
    shares = np.array([stage.visible_shares(float(stamp)) for stamp in motion.stamps])
    return Sequence(stage.name, stage.rig, motion.stamps, poses, shares.min(axis=1), stage.images, shares)


class _Stage:
    """What a sequence is filmed on: part, course, lights, clutter and cameras."""

    def __init__(self, case: Case, motion: Motion) -> None:
        scene = load_case_scene(case)
        start = case_pose(case, scene)
        middle, radius = model_centre(scene)
        first = scene.placements[0]
        self.case, self.motion, self.rig = case, motion, case_rig(case)
        self.name, self.model, self.radius = first.name, first.model, radius
        self.course = Course(motion, start, middle)
        camera_T_scene = scene.camera_T_scene
        self.lights = [
            type(light)(tuple(camera_T_scene.apply(np.asarray(light.position))), light.colour)
            for light in case_lights(scene, start)
        ]
        self.ambient, self.background = scene.ambient_light, scene.background
        self.still = [
            Placement(other.name, other.model, camera_T_scene.matrix @ other.matrix) for other in scene.placements[1:]
        ]
        self.foreground = self._foreground(start)
        self.still += [self._behind(k, *one) for k, one in enumerate(clutter_of(case, scene, start, self.rig))]

    def _behind(self, number: int, text: str, place: Pose) -> Placement:
        """A solid of the clutter, pushed along its line of sight to where the part never is."""
        solid = parse_scene(f'UNITS M;\nDRAW {text} COLOUR (1, 0.97, 0.9) PAINT FACES;').placements[0].solid
        leaves = np.concatenate([np.abs(leaf.matrix[:3, :3]).sum(axis=1) for leaf in solid.primitives])
        clear = self.course.centre[2] + self.radius + self.course.reach + float(leaves.max()) * 2.0
        factor = max(1.0, clear / float(place.translation[2]))
        return Placement(f'clutter{number}', solid, Pose(place.rotation, place.translation * factor).matrix)

    def _foreground(self, start: Pose) -> Foreground:
        camera = self.rig.left
        features = model_features(self.model).transformed(start)
        points = np.concatenate([features.polyline(k, 16) for k in range(len(features))])
        seen = points[:, :2] / points[:, 2:]
        low, high = seen.min(axis=0), seen.max(axis=0)
        view = np.array([camera.width / camera.fx, camera.height / camera.fy])
        nearest = self.course.centre[2] - self.radius - self.course.reach
        return Foreground(0.5 * (low + high), high - low, view, float(nearest))

    def _in_front(self, time: float) -> list[Solid]:
        return [
            _block(bar.size).transformed(Pose(np.eye(3), bar.corner))
            for bar in bars_at(self.motion, self.foreground, time)
        ]

    def images(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """The pair of a frame behind the sensor."""
        if not 0 <= number < self.motion.frames:
            raise IndexError(f'frame {number}: there are {self.motion.frames}')
        times = self.exposures(float(self.motion.stamps[number]))
        # A pixel is sampled as often as without blur, by all pictures together.
        antialias = self.case.antialias if len(times) == 1 else max(2, round(self.case.antialias / len(times) ** 0.5))
        sums = [np.zeros((self.rig.left.height, self.rig.left.width)) for _ in range(2)]
        for time in times:
            part = Placement(self.name, self.model, self.course.pose(time).matrix)
            scene = Scene([part, *self.still, *self._in_front(time)], self.lights, self.ambient, self.background)
            for total, frame in zip(sums, render_stereo(scene, self.rig, antialias=antialias, psf=self.case.psf)):
                total += grey(frame.image)
        left, right = (
            SensorModel(noise_sigma=self.case.noise, seed=(self.case.seed, number, eye)).apply(total / len(times))
            for eye, total in enumerate(sums)
        )
        return left, right

    def exposures(self, stamp: float) -> np.ndarray:
        """(k,) float64, seconds: when the pictures are taken whose mean is a frame."""
        motion = self.motion
        open_s = motion.exposure / motion.rate_hz
        begin, end = (self.course.pose(stamp + side * open_s) for side in (-0.5, 0.5))
        around = self.course.middle + self.radius * np.concatenate([np.eye(3), -np.eye(3)])
        moved = np.linalg.norm(
            self.rig.left.project(begin.apply(around)) - self.rig.left.project(end.apply(around)), axis=1
        )
        count = int(np.clip(np.ceil(moved.max()), 1, SUBFRAMES)) if open_s > 0.0 else 1
        return np.asarray(stamp + open_s * ((np.arange(count) + 0.5) / count - 0.5))

    def visible_shares(self, time: float) -> list[float]:
        """Of either eye, see :class:`SequenceFrame`."""
        pose = self.course.pose(time)
        front = self._in_front(time)
        shares = []
        for camera, shift in ((self.rig.left, np.zeros(3)), (self.rig.right, self.rig.right_T_left)):
            eye_T_left = Pose(np.eye(3), shift)
            placed = eye_T_left.compose(pose)
            whole = _seen_length(self.model, placed, _without_end(camera), [])
            seen = _seen_length(self.model, placed, camera, [(solid, eye_T_left) for solid in front])
            shares.append(min(seen / whole, 1.0) if whole > 0.0 else 0.0)
        return shares


def _without_end(camera: PinholeCamera) -> PinholeCamera:
    """A camera with the same view and a much larger picture."""
    width, height = 5 * camera.width, 5 * camera.height
    return PinholeCamera(
        width, height, camera.fx, camera.fy, camera.cx + 2 * camera.width, camera.cy + 2 * camera.height
    )


@lru_cache(maxsize=16)
def _block(size: tuple[float, float, float]) -> Solid:
    """A bar of this size, metres, a corner at the origin, its faces of different greys."""
    numbers = ', '.join(f'{value:.17g}' for value in size)
    return parse_scene(f'UNITS M;\nDRAW (BLOCK ({numbers})) COLOUR (0.7, 0.75, 0.8) PAINT FACES;').placements[0].solid


def _seen_length(solid: Solid, pose: Pose, camera: PinholeCamera, others: list[tuple[Solid, Pose]]) -> float:
    """Pixels of a solid's edges, curves and contours that a camera sees."""
    seen = visible_fragments(solid, pose, camera, others)
    total = 0.0
    for features in (seen.features.select(seen.features.kind != FeatureKind.AXIS), seen.contours):
        total += sum(_length(features, k, camera) for k in range(len(features)))
    return total


def _length(features: FeatureSet, number: int, camera: PinholeCamera) -> float:
    pixels = camera.project(features.polyline(number, 33))
    return float(np.linalg.norm(np.diff(pixels, axis=0), axis=1).sum())


# -- folders -----------------------------------------------------------------------------------------------------------


def write_sequence(
    folder: Path, sequence: Sequence, case: Case, motion: Motion, progress: Callable[[str], None] = lambda stage: None
) -> None:
    """Write a sequence: images/, camera.json, truth.csv, truth.tum, the scene, and how it was made (sequence.json).

    Parameters
    ----------
    folder : Path
        Made when missing.
    sequence : Sequence
        Rendered frame by frame.
    case, motion : Case, Motion
        What it is made of.
    progress : callable
        Called after every frame.
    """
    (folder / 'images').mkdir(parents=True, exist_ok=True)
    (folder / 'camera.json').write_text(json.dumps(camera_record(sequence.rig), indent=2) + '\n', encoding='utf-8')
    scene = copy_scene(find_scene(case.scene), folder)
    record = {'part': sequence.name, 'case': asdict(case) | {'scene': scene}, 'motion': asdict(motion)}
    (folder / 'sequence.json').write_text(json.dumps(record, indent=2) + '\n', encoding='utf-8')
    for frame in sequence:
        for side, image in zip(('left', 'right'), frame.images):
            cv2.imwrite(str(folder / 'images' / f'{frame.number:06d}_{side}.png'), image)
        progress('frame')
    write_truth(folder / 'truth', sequence.stamps_s, sequence.poses, sequence.visible_share)


def write_truth(
    stem: Path, stamps_s: np.ndarray, poses: tuple[Pose, ...], visible_share: np.ndarray | None = None
) -> None:
    """Poses as a table with a head (stem.csv) and as TUM's trajectory files are (stem.tum: stamp x y z qx qy qz qw)."""
    with stem.with_suffix('.csv').open('w', newline='', encoding='utf-8') as file:
        table = csv.writer(file)
        table.writerow(TRUTH_COLUMNS)
        for number, (stamp, pose) in enumerate(zip(stamps_s, poses)):
            share = 1.0 if visible_share is None else visible_share[number]
            table.writerow([number, f'{stamp:.6f}', *_pose_cells(pose), f'{share:.4f}'])
    lines = [f'{stamp:.6f} {" ".join(_pose_cells(pose))}\n' for stamp, pose in zip(stamps_s, poses)]
    stem.with_suffix('.tum').write_text(''.join(lines), encoding='utf-8')


def write_found(folder: Path, sequence: Sequence, found: list[Pose | None]) -> None:
    """Poses that were found in a sequence, as found.tum beside the truth: frames without one have no line."""
    answered = [(stamp, pose) for stamp, pose in zip(sequence.stamps_s, found) if pose is not None]
    lines = [f'{stamp:.6f} {" ".join(_pose_cells(pose))}\n' for stamp, pose in answered]
    (folder / 'found.tum').write_text(''.join(lines), encoding='utf-8')


def _pose_cells(pose: Pose) -> list[str]:
    return [f'{value:.9f}' for value in (*pose.translation, *pose.quaternion)]


def read_sequence(folder: str | Path) -> Sequence:
    """A written sequence; its pictures are read when they are asked for.

    Raises
    ------
    OSError, ValueError
        A file is missing, or is not what it should be.
    """
    folder = Path(folder)
    with (folder / 'truth.csv').open(newline='', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    if not rows or tuple(rows[0]) != TRUTH_COLUMNS:
        raise ValueError(f'{folder / "truth.csv"}: expected rows of {", ".join(TRUTH_COLUMNS)}')

    def images(number: int) -> tuple[np.ndarray, np.ndarray]:
        left, right = (_read(folder / 'images' / f'{number:06d}_{side}.png') for side in ('left', 'right'))
        return left, right

    height, width = images(0)[0].shape
    poses = [
        Pose.from_quaternion(
            [float(row[key]) for key in TRUTH_COLUMNS[5:9]], [float(row[key]) for key in TRUTH_COLUMNS[2:5]]
        )
        for row in rows
    ]
    return Sequence(
        json.loads((folder / 'sequence.json').read_text(encoding='utf-8'))['part'],
        load_rig(folder / 'camera.json', (width, height)),
        np.array([float(row['stamp_s']) for row in rows]),
        tuple(poses),
        np.array([float(row['visible_share']) for row in rows]),
        images,
    )


def _read(path: Path) -> np.ndarray:
    image = cv2.imread(str(check_image(path)), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise OSError(f'{path}: not a readable image')
    return np.asarray(image)
