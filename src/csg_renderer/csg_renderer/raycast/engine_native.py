"""The fast engine: flattened scenes, compiled kernels, threads. Gives what the reference engine gives."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from msgs_py.numeric.threads import cores, spread
from msgs_py.numeric.typed import ByteArray, FloatArray

from ..scene.scene import Scene
from .engines import ViewPose, spares
from .flatten import FlatProgram, flatten
from .frame import Frame, RenderOptions, RenderStats
from .frame_buffers import new_frame
from .kernels.image import render_tiles
from .kernels.packets import BOUNDS, MEETING_PARTS, PACKETS
from .kernels.raw_image import render_raw_rows, smooth_raw_rows
from .kernels.records import (
    CameraData,
    Differences,
    Faces,
    Meeting,
    Packets,
    Plan,
    RawRays,
    SecondaryRayWorkspace,
    SurfaceRayWorkspace,
    Target,
    Workspace,
)
from .kernels.rows import STRIDE, SUBTRACTED, SUBTRACTED_PARTS
from .kernels.samples import mark_rows, smooth_rows
from .kernels.secondary_rays import BATCH_PARTS, RAY_PARTS
from .kernels.sparse import smooth_tiles
from .kernels.surface_rays import SURFACE_BATCH_PARTS, SURFACE_RAY_PARTS
from .kernels.tree import LEAF_STEP
from .programs.program import Program, View, program_of, view_of
from .raw_view import box_samples, crow_samples, raw_view
from .settings import CROW_OFFSETS, CROW_WEIGHTS, LEAST_ROWS_PER_THREAD, PARTS_PER_THREAD
from .stop import Stop
from .view_data import differences, plan_of, view_data

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
        options.threads or cores(), max(1, min(view.camera.height for view in views) // LEAST_ROWS_PER_THREAD)
    )
    stop = stop or Stop()
    jobs = [_Job(flat, view, options, threads, stop) for view in views]
    for job in jobs:
        for work in job.works:
            stop.share(work.counts[3:])
    if len(jobs) == 1:
        jobs[0].begin()
    every = range(threads)
    spread(_Queue(jobs, threads).work, every, threads)
    for job in jobs:
        if job.sparse:
            spread(partial(job.refine, threads), every, threads)
        if options.adaptive:
            # Colours are not changed before all is decided.
            spread(partial(job.mark, threads), every, threads)
            spread(partial(job.smooth, threads), every, threads)
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
    differences: Differences
    raw: RawRays

    def __init__(self, flat: FlatProgram, seen: ViewPose, options: RenderOptions, threads: int, stop: Stop) -> None:
        self.flat, self.options, self.stop = flat, options, stop
        self.camera, self.camera_T_scene, self.lens = seen
        self.view = view_of(flat.program, self.camera_T_scene)
        self.view_data = view_data(flat, self.view, self.camera_T_scene)
        self.works = [_workspace(flat) for _ in range(threads)]
        self.secondaries = [_secondary_workspace(flat, self.view, options) for _ in range(threads)]
        self.surfaces = [_surface_workspace(flat, self.view, options) for _ in range(threads)]
        self.active = [0] * threads
        self.marks: ByteArray = np.zeros((0, 0), dtype=np.uint8)
        self.sparse = spares(options, flat.program, seen)

    def begin(self) -> None:
        """What takes long of getting ready and leaves other threads alone: clearing the frame, and the spans."""
        self.frame, self.target = new_frame(
            self.camera, self.camera_T_scene, self.flat.program.background, self.options.radiance, self.sparse
        )
        culled = self.camera
        if self.lens is not None:
            self.frame.lens = self.lens
            view = raw_view(self.camera, self.lens, self.stop)
            self.raw, culled = view.rays, view.ideal
        self.camera_data, self.plan = plan_of(self.flat, self.view, self.view_data, culled, self.options)
        if self.sparse:
            self.differences = differences(self.flat, self.view, self.view_data, culled, self.camera_T_scene)
        elif self.options.sparse:
            self.plan = self.plan._replace(box=self.options.box)
        if self.options.adaptive:
            self.marks = np.zeros((self.camera.height, self.camera.width), dtype=np.uint8)

    def tiles(self, thread: int, part: int, parts: int) -> None:
        """One thread does one of several equal parts of the tiles, and counts those that were not empty."""
        flat = self.flat
        if self.lens is not None:
            self.active[0] = 1
            render_raw_rows(
                (part, parts),
                box_samples(self.options.box),
                *self._taken(thread),
                (self.secondaries[thread], self.surfaces[thread]),
                flat.terrains,
                flat.program.object_of,
                self.raw,
            )
            return
        self.active[thread] += render_tiles(
            part,
            parts,
            *self._taken(thread),
            self.secondaries[thread],
            self.surfaces[thread],
            flat.terrains,
            flat.program.object_of,
        )

    def _taken(self, thread: int) -> tuple[Any, ...]:
        """What every kernel takes: scene, camera, materials, plan, picture, and the memory of a thread."""
        return self.flat.csg, self.camera_data, self.flat.materials, self.plan, self.target, self.works[thread]

    def mark(self, threads: int, thread: int) -> None:
        """One thread's rows: where faces meet; all tiles must be done."""
        if self.lens is None:
            mark_rows((thread, threads), self.target, self.marks)

    def refine(self, threads: int, thread: int) -> None:
        """One thread's tiles: all samples where they differ; all tiles must be done."""
        smooth_tiles(
            (thread, threads),
            self.flat.csg,
            self.camera_data,
            self.differences,
            self.flat.materials,
            self.plan,
            self.target._replace(radiance=self.target.radiance.reshape(self.camera.height, -1)),
            self.works[thread],
        )

    def smooth(self, threads: int, thread: int) -> None:
        """One thread's rows, anti-aliased where that is marked; all must be."""
        flat, tracing = self.flat, (self.secondaries[thread], self.surfaces[thread])
        if self.lens is not None:
            smooth_raw_rows((thread, threads), crow_samples(), *self._taken(thread), tracing, flat.terrains, self.raw)
            return
        grid = np.array(CROW_OFFSETS), CROW_WEIGHTS
        smooth_rows((thread, threads), grid, *self._taken(thread), tracing, flat.terrains, self.marks)


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


def _secondary_workspace(flat: FlatProgram, view: View, options: RenderOptions) -> SecondaryRayWorkspace | None:
    """Memory of ray tracing, or None when ray casting will do."""
    if (options.levels == 1 and not options.shadows) or view.program.surfaces is not None:
        return None
    side = options.tile_size if options.tiling else STRIDE
    # A batch leaves at most two rays for each of its own, and only so many batches are ever unfinished.
    stack = np.empty(((2 * options.levels + 2) * STRIDE, RAY_PARTS))
    return _casting_workspace(flat, view, options, BATCH_PARTS, stack, max(STRIDE, side**2))


def _casting_workspace(
    flat: FlatProgram, view: View, options: RenderOptions, parts: int, stack: FloatArray, pixels: int
) -> SecondaryRayWorkspace:
    """Memory for casting batches of so many parts, and for the colours of so many pixels."""
    children = len(flat.csg.simple)
    return SecondaryRayWorkspace(
        np.empty(parts * STRIDE),
        stack,
        np.zeros(2, dtype=np.int64),
        np.empty((3, pixels)),
        np.empty((PACKETS + 1, BOUNDS)),
        np.empty((PACKETS + 1, BOUNDS)),
        np.empty(PACKETS),
        np.empty(STRIDE, dtype=np.int64),
        np.empty(STRIDE, dtype=np.int64),
        Packets(np.empty(PACKETS + 1, dtype=np.int64), np.zeros(1, dtype=np.int64)),
        Faces(
            np.full(max(1, len(flat.csg.kind)) * int(LEAF_STEP), -1),
            np.empty(STRIDE, dtype=np.int64),
            np.empty(STRIDE, dtype=np.int64),
        ),
        Meeting(
            np.empty(children, dtype=np.int64),
            np.empty(children),
            np.empty((PACKETS, children)),
            np.empty(MEETING_PARTS * STRIDE),
        ),
        options.levels,
        options.shadows,
        view.departure,
        view.tolerance,
    )


def _surface_workspace(flat: FlatProgram, view: View, options: RenderOptions) -> SurfaceRayWorkspace | None:
    """Memory of what a scene's pictures, metals, lights with a size and surroundings need; None without any."""
    surfaces = view.program.surfaces
    if surfaces is None:
        return None
    # A batch of metal leaves as many rays for each of its own as there are samples, and each of those, like a mirror of
    # glass, two at a level. No second such batch begins before they are gone.
    rays = options.samples + 4 * options.levels + 4
    casting = _casting_workspace(flat, view, options, SURFACE_BATCH_PARTS, np.empty((1, RAY_PARTS)), 1)
    return SurfaceRayWorkspace(casting, np.empty((rays * STRIDE, SURFACE_RAY_PARTS)), options.samples, surfaces)
