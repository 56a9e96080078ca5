"""One plan as plain values, and its two kinds of job: a view predicted, a picture rendered, searched and judged."""

from __future__ import annotations

import tempfile
import time
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from csg_renderer.features.library import FEATURE_SUFFIX
from csg_renderer.language import find_scene
from csg_renderer.mesh.files import MESH_SUFFIXES
from msgs_py import Pose
from msgs_py.numeric.typed import ByteArray
from stereo_recovery import recover
from stereo_recovery.pipeline import Recovery

from ...batches.jobs import digest
from ...image_pose.views import Views
from ...params import MatchParams, MatchResult
from ...pipeline import survey
from ..case import Limits
from ..run_library import be_ready
from ..scene_files import clutter_about, scene_files
from .judging import judged
from .part import PlannedPart, load_part
from .prediction import predict
from .reasons import reason, visible_curves
from .rig import PlannedRig
from .volume import Volume
from .what_if import variants

VIEW, TRIAL, EMPTY = 'view', 'trial', 'empty'


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked.

    Attributes
    ----------
    files : tuple of (str, bytes)
        The part's scene file and those that it includes, by where they lie to each other, the scene first: other
        machines have none of them.
    rig : PlannedRig
    volume : Volume
    limits : Limits
        The largest errors of a pose that is good enough.
    views : int
        Into how many the volume is divided.
    antialias : int
        Samples along each side of a pixel.
    seed : int
        Of noise, clutter and further parts.
    time_limit_s : float
        Seconds, of one search.
    """

    files: tuple[tuple[str, bytes], ...]
    rig: PlannedRig
    volume: Volume
    limits: Limits
    views: int
    antialias: int = 4
    seed: int = 0
    time_limit_s: float = 5.0

    @cached_property
    def part(self) -> PlannedPart:
        """Read once in each process."""
        return _part_of(self.files)

    def __getstate__(self) -> dict[str, Any]:
        """Without the part: each process reads it for itself."""
        return {name: value for name, value in self.__dict__.items() if name != 'part'}

    @property
    def arguments(self) -> dict[str, Any]:
        """All that results depend on, plain values."""
        pair, third = self.rig.pair, self.rig.third
        return {
            'part': [[name, digest(data)] for name, data in self.files],
            'left': asdict(pair.left),
            'right': asdict(pair.right),
            'baseline': pair.baseline,
            'third': None if third is None else third.tolist(),
            'sensor': asdict(self.rig.sensor),
            'outline_px': self.rig.outline_px,
            'calibration_px': self.rig.calibration_px,
            'walk': self.rig.walk,
            'volume': asdict(self.volume),
            'limits': asdict(self.limits),
            'views': self.views,
            'antialias': self.antialias,
            'seed': self.seed,
            'time_limit_s': self.time_limit_s,
        }

    def pose(self, number: int) -> Pose:
        """left_T_part of a view."""
        return _poses(self)[number % self.views]


@dataclass(frozen=True, eq=False)
class Job:
    """One of a task: kind is VIEW, TRIAL (with the part) or EMPTY (without it)."""

    task: Task
    kind: str
    number: int


@dataclass(frozen=True, eq=False)
class Shot:
    """What the cameras take: poses of the parts in it, left_T_part, and the images (h, w) uint8."""

    poses: list[Pose]
    images: list[ByteArray]


def files_of_part(path: str) -> tuple[tuple[str, bytes], ...]:
    """The files of a part for :class:`Task`. Raises OSError and ValueError for a scene that cannot be used."""
    if Path(path).suffix.lower() in (*MESH_SUFFIXES, FEATURE_SUFFIX):
        raise ValueError(f'{path}: cannot be rendered; expected a scene file (.csg) that draws the part')
    load_part(path)  # what is wrong with it is told by its own name
    (_, scene), *included = scene_files(find_scene(path)).items()
    return ((scene.name, scene.read_bytes()), *((name, file.read_bytes()) for name, file in included))


def do_job(job: Job) -> dict[str, Any]:
    """A view's prediction, or what a trial found; plain values."""
    be_ready()
    return predicted_view(job.task, job.number) if job.kind == VIEW else trial(job.task, job.kind, job.number)


def predicted_view(task: Task, number: int) -> dict[str, Any]:
    """What is expected at a view, with the cameras of the task and with others."""
    part, pose = task.part, task.pose(number)
    prediction = predict(part, pose, task.rig)
    way = pose.inverse().rotate(-pose.apply(part.ball[0])[None])[0]
    return {
        'direction': (way / np.linalg.norm(way)).tolist(),
        'distance': float(pose.apply(part.ball[0])[2]),
        'position': prediction.position.tolist(),
        'rotation': prediction.rotation.tolist(),
        'curves': visible_curves(prediction),
        'samples': prediction.measured,
        'reason': reason(prediction, part),
        'variants': {
            name: _errors(part, Pose(pose.rotation, pose.translation + rig.middle - task.rig.middle), rig)
            for name, rig in variants(task.rig).items()
        },
    }


def _errors(part: PlannedPart, pose: Pose, rig: PlannedRig) -> list[list[float]]:
    prediction = predict(part, pose, rig)
    return [prediction.position.tolist(), prediction.rotation.tolist()]


def shot(task: Task, kind: str, number: int) -> Shot:
    """The pictures of a trial; the same for the same task, kind and number."""
    rng = np.random.default_rng([task.seed, number, kind == EMPTY, 81])
    part, camera = task.part, task.rig.pair.left
    first = task.pose(number)
    poses = [] if kind == EMPTY else task.volume.beside(first, rng, task.rig, part.ball)
    middle, radius = part.ball
    # Without the part something else stands about where it would.
    kept = [(pose.apply(middle), radius) for pose in poses] or [(first.apply(middle), 1e-3 * radius)]
    count = task.volume.clutter + (0 if poses else task.volume.at_once)
    clutter = clutter_about(rng, kept, camera, count, 2.0 * radius)
    pictures = part.pictures(poses, task.rig, task.antialias, clutter)
    images = [
        np.asarray(task.rig.sensor.model((task.seed, number, eye, int(kind == EMPTY))).apply(picture), np.uint8)
        for eye, picture in enumerate(pictures)
    ]
    return Shot(poses, images)


def searched(task: Task, taken: Shot) -> tuple[Recovery, MatchResult]:
    """What the product makes of pictures: recovery, then the search by features and images."""
    rig = task.rig
    left, right = taken.images[:2]
    recovery = recover(left, right, rig.pair) if rig.third is None else recover(taken.images, rig.cameras)
    views = Views.of(taken.images, rig.cameras)
    params = MatchParams(time_limit_s=task.time_limit_s)
    return recovery, survey([task.part.index], recovery.features, params, views)


def trial(task: Task, kind: str, number: int) -> dict[str, Any]:
    """One picture rendered, searched and judged."""
    clock = [time.perf_counter()]
    taken = shot(task, kind, number)
    clock.append(time.perf_counter())
    recovery, result = searched(task, taken)
    clock.append(time.perf_counter())
    offs, wrong = judged(task.part, taken.poses, [one.pose for one in result.interpretations])
    rejected = result.rejected[0].rejected_reason if result.rejected else None
    expected = [predict(task.part, pose, task.rig) for pose in taken.poses]
    return {
        'view': number % task.views,
        'errors': [None if off is None else [off.position, off.rotation] for off in offs],
        'expected': [[float(one.position[0]), float(one.rotation[0])] for one in expected],
        'wrong': wrong,
        'reason': '' if all(offs) else recovery.reason or rejected or result.reason or 'another pose was answered',
        'features': len(recovery.features),
        'milliseconds': [round(1e3 * (after - before), 1) for before, after in zip(clock, clock[1:])],
    }


@lru_cache(maxsize=4)
def _part_of(files: tuple[tuple[str, bytes], ...]) -> PlannedPart:
    with tempfile.TemporaryDirectory() as folder:
        for name, data in files:
            (Path(folder) / name).parent.mkdir(parents=True, exist_ok=True)
            (Path(folder) / name).write_bytes(data)
        return load_part(str(Path(folder) / files[0][0]))


@lru_cache(maxsize=4)
def _poses(task: Task) -> list[Pose]:
    return task.volume.views(task.views, task.rig, task.part.ball)
