"""A part followed through sequences with the true pose of every frame: lost, wrong and held, errors, time a frame.

A tracker is made for a part and the pose to start from, ``make(part, first) -> step``; then every frame is a call
``step(images, rig) -> pose or None``, in the frame of the first camera. rig is a PinholeCamera for one image, else a
StereoRig or CameraRig, and may differ from step to step. None says that the part is lost. ``--tracker module:function``
names one; the default is model_matcher's Tracker, which asks recovery and matcher again when it has lost the part and
has a rectified pair; ``bench_tracking:found_anew`` finds the part anew in every frame, from features alone.

    python test/benchmarks/bench_tracking.py --frames 30
    python test/benchmarks/bench_tracking.py --tracks occluded cube --tracker mine:make --workers 2
    python test/benchmarks/bench_tracking.py --tracks clutter occluded vanishes --frames 1000 --record tracking
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from batches import add_batch_options, importable, run_batch
from bench_photoreal import function_named
from measure import Absent, Measurement
from results import add_record_option, keep
from tqdm import tqdm
from track_scoring import Step, score_track
from tracking_sequences import RENDERED_TRACKS, Rig, Track, cube_tracks, rendered_track
from true_pairs import data_folder
from true_poses import Part

from model_matcher.image_pose.views import Views
from model_matcher.pipeline import match, warm_up
from model_matcher.tracking.tracker import Tracker
from msgs_py import Pose, StereoRig
from stereo_recovery import recover
from stereo_recovery.pipeline import warm_up as warm_up_recovery

HERE = Path(__file__).resolve().parent
FRAMES, QUICK_FRAMES = 120, 20
TrackerStep = Callable[[tuple[np.ndarray, ...], Rig], Pose | None]
MakeTracker = Callable[[Part, Pose], TrackerStep]


class NeedsOther(Exception):
    """A tracker that cannot do with the cameras of a sequence."""


def found_anew(part: Part, first: Pose) -> TrackerStep:
    """No tracker: recovery and matcher, every frame for itself; equal poses are told by the one before."""
    last = [first]

    def step(images: tuple[np.ndarray, ...], rig: Rig) -> Pose | None:
        if not isinstance(rig, StereoRig):
            raise NeedsOther('features need a rectified pair')
        best = match(part.index, recover(images[0], images[1], rig).features).best
        if best is None:
            return None
        # Of poses that symmetry makes equal the one that moves least.
        last[0] = min((best.pose, *best.symmetric_poses), key=lambda pose: pose.error_to(last[0]).rotation)
        return last[0]

    return step


def tracked(part: Part, first: Pose) -> TrackerStep:
    """The Tracker from the first pose; where it is lost, recovery and matcher find the part again."""
    shape = part.index.shape
    assert shape is not None
    tracker = Tracker(shape, first)

    def step(images: tuple[np.ndarray, ...], rig: Rig) -> Pose | None:
        pose = tracker(images, rig)
        if pose is None and isinstance(rig, StereoRig):
            found = match(part.index, recover(images[0], images[1], rig).features, views=Views.of(images, rig)).best
            if found is not None:
                tracker.restart(found)
                pose = found.pose
        return pose

    return step


def standing(part: Part, first: Pose) -> TrackerStep:
    """The pose of the first frame for ever: what a score is where nothing is done."""
    return lambda images, rig: first


def run(tracks: list[Track], make: MakeTracker = tracked) -> list[dict[str, Any]]:
    """A row a track, see :func:`track_scoring.score_track`; ``absent`` where the tracker cannot do with the cameras."""
    return [_row(track, make) for track in tracks]


def _row(track: Track, make: MakeTracker) -> dict[str, Any]:
    row: dict[str, Any] = {'track': track.name, 'part': track.part.name}
    try:
        row |= score_track(_steps(track, make))
    except NeedsOther as why:
        row['absent'] = str(why)
    return row


class _TrackJob(NamedTuple):
    """A track, by what makes it, and who follows it."""

    name: str
    frames: int
    data: Path | None
    tracker: MakeTracker


def _of_track(job: _TrackJob) -> dict[str, Any]:
    (track,) = [one for one in tracks_of([job.name], job.frames, job.data) if one.name == job.name]
    return _row(track, job.tracker)


def _steps(track: Track, make: MakeTracker) -> list[Step]:
    steps: list[Step] = []
    tracker: TrackerStep | None = None
    shown = tqdm(track.frames(), desc=track.name, total=track.length, unit='', disable=not sys.stderr.isatty())
    for frame in shown:
        # The first pose is given; from then on the tracker is on its own.
        tracker = tracker or make(track.part, frame.instance.pose)
        since = np.array([time.perf_counter(), time.process_time()])
        pose = tracker(frame.images, frame.rig)
        taken = 1e3 * (np.array([time.perf_counter(), time.process_time()]) - since)
        steps.append(Step(frame.instance, pose, *taken.tolist(), seen=frame.seen))
    return steps


# Column, key, digits.
COLUMNS = (
    ('frames', 'frames', 0),
    ('to hold', 'to_hold', 0),
    ('lost', 'lost', 0),
    ('share', 'lost_share', 3),
    ('gone', 'gone', 0),
    ('wrong', 'wrong', 0),
    ('in a row', 'held_wrong', 0),
    ('late', 'late', 0),
    ('deg', 'deg', 3),
    ('p90', 'deg_p90', 3),
    ('mm', 'mm', 3),
    ('p90', 'mm_p90', 3),
    ('ms', 'ms', 1),
    ('p99', 'ms_p99', 1),
    ('cpu', 'cpu_ms', 1),
    ('first', 'first_ms', 0),
)
# What is recorded: all but times.
KEPT = tuple(key for _, key, _ in COLUMNS if not key.endswith('ms') and not key.startswith('ms'))
LEGEND = """\
to hold, lost, share: frames in which enough of the part is seen, and those of them without a right pose
gone: frames in which no eye sees more than a little; wrong: frames with a wrong pose
in a row: the most frames with a wrong pose, or one of a part that is gone, one after another
late: frames beyond three in a row with a wrong pose, or with one of a part that is gone
deg, mm: of right poses at the part's middle, median and p90; ms, cpu: a frame, without the first"""


def table(rows: list[dict[str, Any]]) -> str:
    """A line a track."""
    lines = [f'{"":<20}' + ''.join(f'{name:>9}' for name, _, _ in COLUMNS)]
    for row in rows:
        if 'absent' in row:
            lines.append(f'{row["track"]:<20} - {row["absent"]}')
            continue
        cells = (row.get(key) for _, key, _ in COLUMNS)
        shown = ('-' if x is None else f'{x:.{digits}f}' for x, (_, _, digits) in zip(cells, COLUMNS))
        lines.append(f'{row["track"]:<20}' + ''.join(f'{cell:>9}' for cell in shown))
    return '\n'.join(lines)


def tracks_of(names: list[str] | None, frames: int, data: Path | None = None) -> list[Track]:
    """Tracks whose names begin with one of these; all without any. The camera's where their data is."""
    try:
        cubes = cube_tracks(data_folder(data))
    except FileNotFoundError:
        cubes = []

    def wanted(name: str) -> bool:
        return not names or any(name.startswith(one) for one in names)

    return [
        *(rendered_track(name, frames) for name in RENDERED_TRACKS if wanted(name)),
        *(track for track in cubes if wanted(track.name)),
    ]


def measurements(quick: bool) -> Iterator[Measurement | Absent]:
    """For run.py: frames lost, errors and time of every track."""
    _ready()
    for row in run(tracks_of(None, QUICK_FRAMES if quick else FRAMES)):
        name = row['track']
        if 'absent' in row:
            yield Absent(name, row['absent'])
            continue
        if row['lost_share'] is not None:
            yield Measurement(f'{name}: frames lost', 100.0 * row['lost_share'], '%')
        for key, what in (('deg', 'rotation'), ('mm', 'translation'), ('ms', 'a frame')):
            if row[key] is not None:
                yield Measurement(f'{name}: {what}', row[key], key)


def _ready() -> None:
    warm_up_recovery()
    warm_up(images=True)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description='A part followed through sequences with truth.')
    parser.add_argument('--data', type=Path, help='folder with real/ (default: STEREO_DATA, ../shared)')
    parser.add_argument(
        '--tracks', nargs='+', help=f'names begin so: {", ".join(RENDERED_TRACKS)}, cube (default: all)'
    )
    parser.add_argument('--frames', type=int, default=FRAMES, metavar='N', help='of each rendered track')
    parser.add_argument('--tracker', type=function_named, default=tracked, metavar='MODULE:FUNCTION')
    add_batch_options(parser)
    add_record_option(parser)
    parser.add_argument('--json', type=Path, default=HERE.parents[1] / 'out' / 'tracking.json', help='the JSON file')
    options = parser.parse_args(arguments)
    tracks = tracks_of(options.tracks, options.frames, options.data)
    if not tracks:
        parser.error('--tracks: nothing begins so, or its data is not here')
    jobs = {
        track.name: _TrackJob(track.name, options.frames, options.data, importable(options.tracker)) for track in tracks
    }
    _ready()
    rows = list(run_batch(_of_track, jobs, options, 'tracks', _ready).values())
    print(table(rows))
    print(LEGEND)
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps(rows, indent=1))
    if options.record:
        keep(options.record, {row['track']: {key: row.get(key) for key in KEPT} for row in rows})
    return 0


if __name__ == '__main__':
    sys.exit(main())
