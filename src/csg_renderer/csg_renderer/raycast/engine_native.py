"""The fast engine: flattened scenes, compiled kernels, threads. Gives what the reference engine gives."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial
from threading import Lock
from typing import NamedTuple, cast
from weakref import WeakKeyDictionary

import numpy as np

from msgs_py import PinholeCamera, Pose

from ..scene.scene import Scene
from ..scene.terrain import Terrain
from .engine_reference import CROW_OFFSETS, CROW_WEIGHTS
from .frame import Frame, RenderOptions, RenderStats
from .kernels.image import Plan, Target, product_spans, render_tiles, smooth_rows
from .kernels.rows import STRIDE, SUBTRACTED, SUBTRACTED_PARTS
from .kernels.secondary_rays import BATCH_PARTS, RAY_PARTS, SecondaryRayWorkspace
from .kernels.shade import Materials, Workspace
from .kernels.terrain import TerrainGrids
from .kernels.tree import DOUBT, CameraData, CsgPrograms
from .products import products_of
from .program import BLOCK, DIFFERENCE, HALFSPACES, INTERSECT, PLANE, Program, View, program_of, view_of
from .reference import PARALLEL
from .tiling import leaf_spans

# Far outside any scene, and finite, so that a bounding box test makes no NaN of it.
UNBOUNDED = 1e30


@dataclass(frozen=True, eq=False)
class Prepared:
    """What of a program the kernels need and no camera changes.

    child_products : first and last + 1 product of every child, equal when it must be evaluated by lists
    listed, chosen : the children to evaluate by lists, and the products, for a camera outside all of them
    most_subtracted : the largest number of subtracted primitives of a product
    """

    program: Program
    csg: CsgPrograms
    materials: Materials
    terrains: TerrainGrids | None
    child_products: np.ndarray
    listed: np.ndarray
    chosen: np.ndarray
    most_subtracted: int


_prepared: WeakKeyDictionary[Program, Prepared] = WeakKeyDictionary()


def render(scene: Scene, camera: PinholeCamera, camera_T_scene: Pose, options: RenderOptions) -> Frame:
    """See :func:`csg_renderer.render`."""
    return render_views(scene, [(camera, camera_T_scene)], options)[0]


def render_views(scene: Scene, views: Sequence[tuple[PinholeCamera, Pose]], options: RenderOptions) -> list[Frame]:
    """Several views of one scene: they share its preparation, and threads go from one on to the next without waiting.

    views : (camera, camera_T_scene) each
    """
    program = program_of(scene)
    ready = _prepared.get(program)
    if ready is None:
        ready = _prepared[program] = prepare(program)
    threads = min(options.threads or _cores(), max(1, min(camera.height for camera, _ in views) // 8))
    jobs = [_Job(ready, *view, options, threads) for view in views]
    if len(jobs) == 1:
        jobs[0].begin()
    _each_thread(threads, _Queue(jobs, threads).work)
    if options.adaptive:
        for job in jobs:
            _each_thread(threads, partial(job.smooth, threads))
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
        self, ready: Prepared, camera: PinholeCamera, camera_T_scene: Pose, options: RenderOptions, threads: int
    ) -> None:
        self.ready, self.camera, self.camera_T_scene, self.options = ready, camera, camera_T_scene, options
        self.view = view_of(ready.program, camera_T_scene)
        self.view_data = look_through(ready, self.view, camera_T_scene)
        self.works = [_workspace(ready) for _ in range(threads)]
        self.secondaries = [_secondary_workspace(self.view, options) for _ in range(threads)]
        self.active = [0] * threads

    def begin(self) -> None:
        """What takes long of getting ready and leaves other threads alone: clearing the frame, and the spans."""
        self.frame, self.target = _new_frame(self.camera, self.camera_T_scene, self.ready.program.background)
        self.camera_data, self.plan = plan_of(self.ready, self.view, self.view_data, self.camera, self.options)

    def tiles(self, thread: int, part: int, parts: int) -> None:
        """This thread does one of several equal parts of the tiles, and counts those that were not empty."""
        ready = self.ready
        self.active[thread] += render_tiles(
            part,
            parts,
            ready.csg,
            self.camera_data,
            ready.materials,
            self.plan,
            self.target,
            self.works[thread],
            self.secondaries[thread],
            ready.terrains,
            ready.program.object_of,
        )

    def smooth(self, threads: int, thread: int) -> None:
        """This thread's rows, anti-aliased where faces meet; all tiles must be done."""
        ready = self.ready
        smooth_rows(
            thread,
            threads,
            ready.csg,
            self.camera_data,
            ready.materials,
            self.plan,
            self.target,
            self.works[thread],
            self.secondaries[thread],
            ready.terrains,
            CROW_WEIGHTS,
            np.array(CROW_OFFSETS),
        )


# Into how many parts for each thread a view among several is divided: who is done early takes one more.
PARTS = 2


class _Queue:
    """The tiles of several views, dealt out to threads in parts.

    Each thread begins with a view of its own and goes on to its tiles while others still begin theirs. Nobody waits for
    anybody before all parts are taken.
    """

    def __init__(self, jobs: list[_Job], threads: int) -> None:
        self.jobs = jobs
        self.parts = threads * (PARTS if len(jobs) > 1 else 1)
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


def prepare(program: Program) -> Prepared:
    """Flatten a program for the kernels."""
    starts: list[int] = [0]
    positive: list[int] = []
    factors: list[int] = []
    child_products = np.zeros((len(program.children), 2), dtype=np.int64)
    codes: list[int] = []
    jumps: list[int] = []
    code_starts: list[int] = [0]
    simple = np.full(len(program.children), -1, dtype=np.int64)
    box = np.empty((6, len(program.children)))
    subtracted = [0]
    doubt: list[float] = []
    child_of = np.zeros(len(program.kind), dtype=np.int64)
    bounds = _leaf_boxes(program)
    for child, code in enumerate(program.children):
        child_products[child] = len(positive)
        for inside, outside in products_of(code) or ():
            factors += sorted(inside) + sorted(outside)
            starts.append(len(factors))
            positive.append(len(inside))
            subtracted.append(len(outside))
        child_products[child, 1] = len(positive)
        several = len(positive) - child_products[child, 0] > 1
        doubt += [DOUBT if several else 0.0] * (len(positive) - len(doubt))
        child_of[code[code >= 0]] = child
        jumps += [jump + len(codes) if jump else 0 for jump in _jumps(code)]
        codes += code.tolist()
        code_starts.append(len(codes))
        if len(code) == 1:
            simple[child] = code[0]
        box[:, child] = _child_box(code, bounds)
    csg = CsgPrograms(
        _whole(starts),
        _whole(positive),
        np.array(doubt),
        _whole(factors),
        _whole(code_starts),
        _whole(codes),
        _whole(jumps),
        simple,
        child_of,
        box,
        program.kind,
        np.ascontiguousarray(program.inverse[:, :3]),
        _spheres(program),
        HALFSPACES[program.kind],
    )
    materials = Materials(
        program.colours,
        program.material,
        _flat_normals(program),
        program.lights,
        program.light_colours,
        program.ambient_light,
        program.background,
    )
    listed = np.flatnonzero(child_products[:, 0] == child_products[:, 1])
    return Prepared(
        program,
        csg,
        materials,
        _terrain_grids(program),
        child_products,
        listed,
        np.arange(len(positive), dtype=np.int64),
        max(subtracted),
    )


def _terrain_grids(program: Program) -> TerrainGrids | None:
    if not program.terrains:
        return None
    grids = [cast(Terrain, program.leaves[leaf]) for leaf in program.terrains]
    sizes = [grid.heights.size for grid in grids]
    return TerrainGrids(
        np.array(program.terrains),
        np.concatenate([grid.heights.ravel() for grid in grids]),
        np.cumsum([0, *sizes[:-1]]),
        np.array([grid.heights.shape[0] for grid in grids]),
        np.array([grid.heights.shape[1] for grid in grids]),
        np.array([grid.bilinear for grid in grids]),
        np.array([grid.heights.min() for grid in grids]),
        np.array([grid.heights.max() for grid in grids]),
    )


def _whole(numbers: list[int]) -> np.ndarray:
    return np.array(numbers, dtype=np.int64)


class ViewData(NamedTuple):
    """What a view sees of the leaves, small arrays. n leaves, p outline points.

    origin, limit : as in CameraData; points : (p, 3) outlines and sphere : (n, 4), camera frame
    listed : children to evaluate by lists; chosen : products to evaluate
    """

    origin: np.ndarray
    limit: np.ndarray
    points: np.ndarray
    sphere: np.ndarray
    listed: np.ndarray
    chosen: np.ndarray


def look_through(ready: Prepared, view: View, camera_T_scene: Pose) -> ViewData:
    """What depends on the camera and is no work."""
    program, csg, local = ready.program, ready.csg, view.local
    home = local[:, :, 3]
    nearest = np.round(home)
    origin = np.where(np.abs(home - nearest) < PARALLEL * (1.0 + np.abs(home)), nearest, home)
    limit = PARALLEL * np.abs(local[:, :, :3]).sum(axis=2)
    listed, chosen = ready.listed, ready.chosen
    inside = _contains_origin(program, origin)
    if any(inside):
        # From inside a solid its far wall is seen, which lists know about and products do not.
        spans = ready.child_products.tolist()
        listed = _whole([child for child, (first, last) in enumerate(spans) if first == last or inside[child]])
        chosen = _whole(
            [q for child, (first, last) in enumerate(spans) if not inside[child] for q in range(first, last)]
        )
    sphere = np.empty_like(csg.sphere)
    sphere[:, :3] = camera_T_scene.apply(csg.sphere[:, :3])
    sphere[:, 3] = csg.sphere[:, 3] * camera_T_scene.scale**2
    return ViewData(np.ascontiguousarray(origin), limit, camera_T_scene.apply(program.outline), sphere, listed, chosen)


def plan_of(
    ready: Prepared, view: View, view_data: ViewData, camera: PinholeCamera, options: RenderOptions
) -> tuple[CameraData, Plan]:
    """Spans of rows, and the order front to back."""
    program, csg = ready.program, ready.csg
    h, w = camera.height, camera.width
    whole = not options.tiling
    size = options.tile_size if options.tiling else STRIDE
    products, bands = len(csg.positive), -(-h // size)
    chosen = view_data.chosen
    near = np.zeros(products)
    if whole:
        leaf_span, span, band = (np.zeros((1, 1, 2), dtype=np.int32) for _ in range(3))
    else:
        leaf_span = np.empty((len(program.kind), h, 2), dtype=np.int32)
        leaf_depth = np.empty(len(program.kind))
        leaf_spans(
            view_data.points,
            program.outline_start,
            view.departure or 1e-9,
            camera.fx,
            camera.fy,
            camera.cx,
            camera.cy,
            w,
            leaf_span,
            leaf_depth,
        )
        span = np.empty((products, h, 2), dtype=np.int32)
        band = np.empty((products, bands, 2), dtype=np.int32)
        product_spans(
            chosen, csg.product_start, csg.positive, csg.factors, leaf_span, leaf_depth, size, span, band, near
        )
        chosen = chosen[np.argsort(near[chosen], kind='stable')]
    camera_data = CameraData(
        view.local, view_data.origin, view_data.limit, view_data.sphere, leaf_span, near, view_data.listed, chosen
    )
    plan = Plan(
        (np.arange(w) - camera.cx) / camera.fx,
        (np.arange(h) - camera.cy) / camera.fy,
        1.0 / camera.fx,
        1.0 / camera.fy,
        np.ascontiguousarray(view.scene_T_camera[:3]),
        view.tolerance,
        span,
        band,
        size,
        whole,
        options.box,
    )
    return camera_data, plan


def _jumps(code: np.ndarray) -> list[int]:
    """For every instruction that ends the left operand of an INTERSECT or DIFFERENCE: that operator's index + 1."""
    jumps = [0] * len(code)
    ends: list[int] = []
    for index, op in enumerate(code):
        if op < 0:
            ends.pop()
            left_end = ends.pop()
            if op in (INTERSECT, DIFFERENCE):
                jumps[left_end] = index + 1
        ends.append(index)
    return jumps


def _leaf_boxes(program: Program) -> np.ndarray:
    """(n, 2, 3): bounds of the leaves along the scene's axes."""
    boxes = np.empty((len(program.kind), 2, 3))
    for leaf, (first, last) in enumerate(zip(program.outline_start[:-1], program.outline_start[1:])):
        if program.kind[leaf] == PLANE:
            boxes[leaf] = [[-UNBOUNDED] * 3, [UNBOUNDED] * 3]
        else:
            points = program.outline[first:last]
            # A little larger, for rounding.
            slack = 1e-9 * (1.0 + np.abs(points).max())
            boxes[leaf] = points.min(axis=0) - slack, points.max(axis=0) + slack
    return boxes


def _spheres(program: Program) -> np.ndarray:
    """(n, 4): a sphere about each leaf in the scene frame, centre and squared radius."""
    spheres = np.zeros((len(program.kind), 4))
    for leaf, (first, last) in enumerate(zip(program.outline_start[:-1], program.outline_start[1:])):
        spheres[leaf, 3] = UNBOUNDED
        if program.kind[leaf] != PLANE:
            points = program.outline[first:last]
            spheres[leaf, :3] = points.mean(axis=0)
            # A little larger, for rounding.
            spheres[leaf, 3] = 1.01 * ((points - spheres[leaf, :3]) ** 2).sum(axis=1).max()
    return spheres


def _child_box(code: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """(6,): bounds of a tree."""
    stack: list[np.ndarray] = []
    for op in code:
        if op >= 0:
            stack.append(boxes[op])
            continue
        right, left = stack.pop(), stack.pop()
        if op == INTERSECT:
            stack.append(np.stack([np.maximum(left[0], right[0]), np.minimum(left[1], right[1])]))
        elif op == DIFFERENCE:
            stack.append(left)
        else:
            stack.append(np.stack([np.minimum(left[0], right[0]), np.maximum(left[1], right[1])]))
    return stack[0].ravel()


def _flat_normals(program: Program) -> np.ndarray:
    """(n, 6, 3): outward unit normals of flat faces, scene frame (the sign is settled by the ray)."""
    normals = np.zeros((len(program.kind), 6, 3))
    rows = program.inverse[:, :3, :3]
    for face in range(6):
        normals[:, face] = np.where((program.kind == BLOCK)[:, None], rows[:, face // 2], rows[:, 2])
    return normals / np.linalg.norm(normals, axis=2, keepdims=True) if len(normals) else normals


def _contains_origin(program: Program, origin: np.ndarray) -> list[bool]:
    """For each child: is the camera, at these (n, 3) local origins, inside it (or on its surface)?"""
    x, y, z = origin.T if len(origin) else np.zeros((3, 0))
    slab = (z >= 0.0) & (z <= 1.0)
    round_ = x * x + y * y
    per_kind = np.stack(
        [
            (x >= 0) & (x <= 1) & (y >= 0) & (y <= 1) & slab,
            (round_ <= 1.0) & slab,
            (round_ <= z * z) & slab,
            round_ + z * z <= 1.0,
            z <= 0.0,
            z < z,
        ]
    )
    inside = per_kind[program.kind, np.arange(len(program.kind))]
    if not inside.any():
        return [False] * len(program.children)
    answers = []
    for code in program.children:
        stack: list[bool] = []
        for op in code:
            if op >= 0:
                stack.append(bool(inside[op]))
            else:
                # A subtracted primitive whose surface the camera touches is not counted: the child is then evaluated by
                # lists, which is slower and right in either case.
                right, left = stack.pop(), stack.pop()
                stack.append(left and right if op == INTERSECT else left if op == DIFFERENCE else left or right)
        answers.append(stack[0])
    return answers


def _workspace(ready: Prepared) -> Workspace:
    longest = max((len(code) for code in ready.program.children), default=1)
    room = np.empty(4 * longest + 4)
    return Workspace(
        np.empty(int(SUBTRACTED) + max(1, ready.most_subtracted) * int(SUBTRACTED_PARTS)),
        room,
        np.empty_like(room),
        np.empty(longest + 2, dtype=np.int64),
        np.empty(len(ready.csg.positive) + 1, dtype=np.int64),
        np.zeros((3, STRIDE)),
        np.zeros(3, dtype=np.int64),
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


def _new_frame(camera: PinholeCamera, camera_T_scene: Pose, background: np.ndarray) -> tuple[Frame, Target]:
    """A frame that shows nothing but background, all its arrays in one piece of memory."""
    h, w = camera.height, camera.width
    n = h * w
    memory = _memory(31 * n + 3)
    # All bits set are -1 as an integer and NaN as a float: one fill at the speed of memory for ids, depth and normals.
    memory[: 28 * n].fill(0xFF)
    words = memory[: 28 * n].view(np.int32)
    ids = [words[k * n : (k + 1) * n].reshape(h, w) for k in range(3)]
    depth = words[3 * n : 4 * n].view(np.float32).reshape(h, w)
    normal = words[4 * n : 7 * n].view(np.float32).reshape(h, w, 3)
    image = memory[28 * n : 31 * n].reshape(h, w, 3)
    image[0] = (np.clip(background, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    image[1:] = image[0]
    frame = Frame(image, depth, ids[0], ids[1], ids[2], normal, camera, camera_T_scene)
    return frame, Target(image, depth, ids[0], ids[1], ids[2], normal)


# Memory of frames that may be handed out again. Fresh pages cost more than rendering into them does.
_memories: list[np.ndarray] = []
MOST_MEMORIES = 6
_memories_lock = Lock()


def _references(memories: list[np.ndarray]) -> list[int]:
    return [sys.getrefcount(memory) for memory in memories]


# How many references are counted for memory that only the list holds; it depends on the Python version.
_IDLE = _references([np.empty(0, dtype=np.uint8)])[0]


def _memory(size: int) -> np.ndarray:
    """(size,) uint8, not initialised: memory of a frame nobody has any array of any more, else new memory."""
    with _memories_lock:
        for index, references in enumerate(_references(_memories)):
            # Every view of an array holds a reference to it.
            if references == _IDLE and _memories[index].size == size:
                return _memories[index]
        memory = np.empty(size, dtype=np.uint8)
        _memories.append(memory)
        del _memories[:-MOST_MEMORIES]
        return memory


def _cores() -> int:
    return max(1, len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1)


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=_cores(), thread_name_prefix='csg_renderer')


# A forked child has none of these threads.
if hasattr(os, 'register_at_fork'):
    os.register_at_fork(after_in_child=_pool.cache_clear)


def _each_thread(threads: int, task) -> list:
    """task(k) for every thread; the kernels let go of the interpreter lock. This thread does the first share."""
    if threads == 1:
        return [task(0)]
    others = [_pool().submit(task, k) for k in range(1, threads)]
    return [task(0), *(other.result() for other in others)]
