"""The fast engine: flattened scenes, compiled kernels, threads. Gives what the reference engine gives."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache, partial
from weakref import WeakKeyDictionary

import numpy as np

from msgs_py import PinholeCamera, Pose

from ..scene.scene import Scene
from .engines import ViewPose
from .flatten import FlatProgram, flatten
from .frame import Frame, RenderOptions, RenderStats
from .frame_buffers import new_frame
from .kernels.image import render_tiles, smooth_rows
from .kernels.records import CameraData, Plan, SecondaryRayWorkspace, Target, Workspace
from .kernels.rows import STRIDE, SUBTRACTED, SUBTRACTED_PARTS
from .kernels.secondary_rays import BATCH_PARTS, RAY_PARTS
from .program import Program, View, program_of, view_of
from .settings import CROW_OFFSETS, CROW_WEIGHTS, LEAST_ROWS_PER_THREAD, PARTS_PER_THREAD
from .stop import Stop
from .view_data import plan_of, view_data

_flattened: WeakKeyDictionary[Program, FlatProgram] = WeakKeyDictionary()


def render_views(
    scene: Scene, views: Sequence[ViewPose], options: RenderOptions, stop: Stop | None = None
) -> list[Frame]:
    """Several views of one scene: they share its preparation, and threads go from one on to the next without waiting.

    views : (camera, camera_T_scene) each
    """
    program = program_of(scene)
    flat = _flattened.get(program)
    if flat is None:
        flat = _flattened[program] = flatten(program)
    threads = min(
        options.threads or _cores(), max(1, min(camera.height for camera, _ in views) // LEAST_ROWS_PER_THREAD)
    )
    jobs = [_Job(flat, *view, options, threads) for view in views]
    stop = stop or Stop()
    for job in jobs:
        for work in job.works:
            stop.share(work.counts[3:])
    if len(jobs) == 1:
        jobs[0].begin()
    _each_thread(threads, _Queue(jobs, threads).work)
    if options.adaptive:
        for job in jobs:
            _each_thread(threads, partial(job.smooth, threads))
    stop.check()
    for job in jobs:
        counts = np.sum([work.counts for work in job.works], axis=0)
        job.frame.stats = RenderStats(
            int(counts[0]), int(counts[1]), int(counts[2]), sum(job.active) if options.tiling else 1
        )
    return [job.frame for job in jobs]


class _Job:
    """One view being rendered by several threads."""

    frame: Frame
    target: Target
    camera_data: CameraData
    plan: Plan

    def __init__(
        self, flat: FlatProgram, camera: PinholeCamera, camera_T_scene: Pose, options: RenderOptions, threads: int
    ) -> None:
        self.flat, self.camera, self.camera_T_scene, self.options = flat, camera, camera_T_scene, options
        self.view = view_of(flat.program, camera_T_scene)
        self.view_data = view_data(flat, self.view, camera_T_scene)
        self.works = [_workspace(flat) for _ in range(threads)]
        self.secondaries = [_secondary_workspace(self.view, options) for _ in range(threads)]
        self.active = [0] * threads

    def begin(self) -> None:
        """What takes long of getting ready and leaves other threads alone: clearing the frame, and the spans."""
        self.frame, self.target = new_frame(self.camera, self.camera_T_scene, self.flat.program.background)
        self.camera_data, self.plan = plan_of(self.flat, self.view, self.view_data, self.camera, self.options)

    def tiles(self, thread: int, part: int, parts: int) -> None:
        """One thread does one of several equal parts of the tiles, and counts those that were not empty."""
        flat = self.flat
        self.active[thread] += render_tiles(
            part,
            parts,
            flat.csg,
            self.camera_data,
            flat.materials,
            self.plan,
            self.target,
            self.works[thread],
            self.secondaries[thread],
            flat.terrains,
            flat.program.object_of,
        )

    def smooth(self, threads: int, thread: int) -> None:
        """One thread's rows, anti-aliased where faces meet; all tiles must be done."""
        flat = self.flat
        smooth_rows(
            thread,
            threads,
            flat.csg,
            self.camera_data,
            flat.materials,
            self.plan,
            self.target,
            self.works[thread],
            self.secondaries[thread],
            flat.terrains,
            CROW_WEIGHTS,
            np.array(CROW_OFFSETS),
        )


class _Queue:
    """The tiles of several views, dealt out to threads in parts.

    Each thread begins with a view of its own and goes on to its tiles while others still begin theirs. Nobody waits for
    anybody before all parts are taken.
    """

    def __init__(self, jobs: list[_Job], threads: int) -> None:
        self.jobs = jobs
        self.parts = threads * (PARTS_PER_THREAD if len(jobs) > 1 else 1)
        self.left = [list(range(self.parts)) for _ in jobs]
        self.waiting = set(range(len(jobs))) if len(jobs) > 1 else set()
        self.begun: list[Future[None]] = [Future() for _ in self.waiting]

    def work(self, thread: int) -> None:
        """One thread's share: its own view first."""
        for step in range(len(self.jobs)):
            view = (thread + step) % len(self.jobs)
            if self.begun:
                self._begin(view)
            # pop(), like remove() of a set, is one step that no other thread can break up.
            while self.left[view]:
                try:
                    part = self.left[view].pop()
                except IndexError:
                    break
                self.jobs[view].tiles(thread, part, self.parts)

    def _begin(self, view: int) -> None:
        """Begin a view, or wait until the thread that came to it first has. Raises what went wrong there."""
        try:
            self.waiting.remove(view)
        except KeyError:
            self.begun[view].result()
            return
        try:
            self.jobs[view].begin()
        except BaseException as error:
            self.begun[view].set_exception(error)
            raise
        self.begun[view].set_result(None)


def _workspace(flat: FlatProgram) -> Workspace:
    longest = max((len(code) for code in flat.program.children), default=1)
    room = np.empty(4 * longest + 4)
    return Workspace(
        np.empty(int(SUBTRACTED) + max(1, flat.most_subtracted) * int(SUBTRACTED_PARTS)),
        room,
        np.empty_like(room),
        np.empty(longest + 2, dtype=np.int64),
        np.empty(len(flat.csg.positive) + 1, dtype=np.int64),
        np.zeros((3, STRIDE)),
        np.zeros(4, dtype=np.int64),
    )


def _secondary_workspace(view: View, options: RenderOptions) -> SecondaryRayWorkspace | None:
    """Memory of ray tracing, or None when ray casting will do."""
    if options.levels == 1 and not options.shadows:
        return None
    # A batch leaves at most two rays for each of its own, and only so many batches are ever unfinished.
    stack = np.empty(((2 * options.levels + 2) * STRIDE, RAY_PARTS))
    return SecondaryRayWorkspace(
        np.empty(BATCH_PARTS * STRIDE), stack, options.levels, options.shadows, view.departure, view.tolerance
    )


def _cores() -> int:
    return max(1, len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1)


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=_cores(), thread_name_prefix='csg_renderer')


# A forked child has none of these threads.
if hasattr(os, 'register_at_fork'):
    os.register_at_fork(after_in_child=_pool.cache_clear)


def _each_thread(threads: int, task: Callable[[int], object]) -> None:
    """task(k) for every thread; the kernels let go of the interpreter lock. This thread does the first share."""
    others = [_pool().submit(task, k) for k in range(1, threads)]
    task(0)
    for other in others:
        other.result()
