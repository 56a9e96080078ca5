"""The whole image with the reference engine: tiles, levels, shadows and anti-aliasing in plain numpy.

Slow and simple; :func:`csg_renderer.render` offers it as engine='reference'.
"""

from __future__ import annotations

import numpy as np

from msgs_py import PinholeCamera, Pose

from ..scene.scene import Scene
from .frame import FACE_SLOTS, MISS, Frame, RenderOptions, RenderStats
from .program import DIFFERENCE, INTERSECT, View, program_of, view_of
from .reference import Hits, cast, normals, transmission
from .shading import illuminate, quantise, reflect, unit

# Weights of the nine samples of a pixel on a boundary (thesis 4.6, after Crow 1981), and their places in the pixel.
CROW_WEIGHTS = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 16.0
CROW_OFFSETS = (-1.0 / 3.0, 0.0, 1.0 / 3.0)


def render(scene: Scene, camera: PinholeCamera, camera_T_scene: Pose, options: RenderOptions) -> Frame:
    """See :func:`csg_renderer.render`."""
    program = program_of(scene)
    view = view_of(program, camera_T_scene)
    h, w = camera.height, camera.width
    tracer = _Tracer(view, camera, options)
    colours = np.empty((h, w, 3))
    colours[:] = program.background
    codes = np.full((h, w), MISS, dtype=np.int64)
    depth = np.full((h, w), np.nan)
    normal = np.full((h, w, 3), np.nan)
    tiles = _tiles(view, camera, options.tile_size) if options.tiling else [(0, 0, w, h, list(program.children))]
    for left, top, right, bottom, children in tiles:
        if not children and not program.terrains:
            continue
        tracer.stats.tiles += 1
        v, u = (grid.ravel() for grid in np.mgrid[top:bottom, left:right])
        hits, colour, facing = tracer.trace(u, v, children)
        seen = hits.hit != MISS
        if not options.box:
            colours[v, u] = colour
        codes[v, u] = hits.hit
        depth[v[seen], u[seen]] = hits.t[seen]
        normal[v[seen], u[seen]] = facing[seen]
        if options.box:
            n = options.box
            colours[v, u] = (
                sum(
                    np.clip(tracer.trace(u + (i + 0.5) / n - 0.5, v + (j + 0.5) / n - 0.5, children)[1], 0.0, 1.0)
                    for j in range(n)
                    for i in range(n)
                )
                / n**2
            )
    if options.adaptive:
        v, u = np.nonzero(boundary(codes))
        smooth = np.zeros((len(u), 3))
        for row, dv in zip(CROW_WEIGHTS, CROW_OFFSETS):
            for weight, du in zip(row, CROW_OFFSETS):
                smooth += weight * np.clip(tracer.trace(u + du, v + dv, program.children)[1], 0.0, 1.0)
        colours[v, u] = smooth
    seen = codes != MISS
    leaf = np.where(seen, codes // FACE_SLOTS, 0)
    object_id = np.where(seen, program.object_of[leaf] if len(program.kind) else 0, MISS)
    return Frame(
        quantise(colours),
        depth.astype(np.float32),
        np.where(seen, leaf, MISS).astype(np.int32),
        np.where(seen, codes % FACE_SLOTS, MISS).astype(np.int32),
        object_id.astype(np.int32),
        normal.astype(np.float32),
        camera,
        camera_T_scene,
        tracer.stats,
    )


def boundary(codes: np.ndarray) -> np.ndarray:
    """(h, w) bool: pixels one of whose eight neighbours shows another face."""
    padded = np.pad(codes, 1, mode='edge')
    h, w = codes.shape
    different = np.zeros((h, w), bool)
    for dv in range(3):
        for du in range(3):
            different |= padded[dv : dv + h, du : du + w] != codes
    return different


class _Tracer:
    """Rays through pixels to colours."""

    def __init__(self, view: View, camera: PinholeCamera, options: RenderOptions) -> None:
        self.view, self.camera, self.options = view, camera, options
        self.stats = RenderStats()

    def trace(self, u: np.ndarray, v: np.ndarray, children) -> tuple[Hits, np.ndarray, np.ndarray]:
        """Pixels (n,) to the first hit, the colour (n, 3) and the normal (n, 3) there."""
        view = self.view
        rays = self.camera.rays(np.stack([u, v], axis=1))
        first = cast(view, children, np.zeros((1, 3)), rays, view.local, view.tolerance, False, self.stats)
        rotation, centre = view.scene_T_camera[:3, :3], view.scene_T_camera[:3, 3]
        directions = rays @ rotation.T
        origins = np.broadcast_to(centre, directions.shape)
        colour = np.zeros((len(u), 3))
        facing = np.full((len(u), 3), np.nan)
        pending: list[tuple] = [(np.arange(len(u)), origins, directions, np.ones(len(u)), 1, first)]
        while pending:
            rays_of, origins, directions, weight, level, hits = pending.pop()
            if hits is None:
                hits = cast(
                    view,
                    view.program.children,
                    origins,
                    directions,
                    view.program.inverse[:, :3],
                    view.departure,
                    True,
                    self.stats,
                )
            missed = hits.hit == MISS
            np.add.at(colour, rays_of[missed], weight[missed, None] * view.program.background)
            seen = ~missed
            if not seen.any():
                continue
            rays_of, directions, weight, code = rays_of[seen], directions[seen], weight[seen], hits.hit[seen]
            points = origins[seen] + hits.t[seen, None] * directions
            outward = normals(view.program, code, points, directions, hits.entering[seen])
            if level == 1:
                facing[rays_of] = outward
            # Seen from inside a solid, its far wall is lit as the viewer sees it.
            towards = np.where(hits.entering[seen, None], outward, -outward)
            local = illuminate(view.program, code, points, towards, directions, self._transmitted(points))
            mirror, clear = view.program.material[code // FACE_SLOTS, 4:].T
            if level == self.options.levels:
                mirror, clear = np.zeros_like(mirror), np.zeros_like(clear)
            np.add.at(colour, rays_of, (weight * (1.0 - clear))[:, None] * local)
            for share, onward in (
                (weight * (1.0 - clear) * mirror, reflect(directions, towards)),
                (weight * clear, unit(directions)),
            ):
                some = share > 0.0
                if some.any():
                    pending.append((rays_of[some], points[some], onward[some], share[some], level + 1, None))
        return first, colour, facing

    def _transmitted(self, points: np.ndarray) -> np.ndarray | None:
        """(n, lights), or None when shadows are off."""
        if not self.options.shadows:
            return None
        arriving = []
        for position in self.view.program.lights:
            towards = position - points
            distance = np.linalg.norm(towards, axis=1)
            arriving.append(transmission(self.view, points, unit(towards), distance, self.stats))
        return np.stack(arriving, axis=1) if arriving else None


def _tiles(view: View, camera: PinholeCamera, size: int):
    """(left, top, right, bottom, children) of every tile; a child that cannot be there is left out, one that can is
    pruned to the leaves that can."""
    boxes = _rectangles(view, camera)
    for top in range(0, camera.height, size):
        for left in range(0, camera.width, size):
            right, bottom = min(left + size, camera.width), min(top + size, camera.height)
            present = (
                (boxes[:, 0] <= right - 0.5)
                & (boxes[:, 2] >= left - 0.5)
                & (boxes[:, 1] <= bottom - 0.5)
                & (boxes[:, 3] >= top - 0.5)
            )
            pruned = (prune(code, present) for code in view.program.children)
            yield left, top, right, bottom, [code for code in pruned if len(code)]


def _rectangles(view: View, camera: PinholeCamera) -> np.ndarray:
    """(leaves, 4) float64: pixel bounds (u, v, u, v) of every leaf; everything where they are not known."""
    program = view.program
    boxes = np.tile([-np.inf, -np.inf, np.inf, np.inf], (len(program.kind), 1))
    camera_T_scene = np.linalg.inv(view.scene_T_camera)
    points = program.outline @ camera_T_scene[:3, :3].T + camera_T_scene[:3, 3]
    for leaf in range(len(boxes)):
        corners = points[program.outline_start[leaf] : program.outline_start[leaf + 1]]
        if len(corners) and corners[:, 2].min() > view.departure:
            pixels = camera.project(corners)
            # Room for the samples of anti-aliasing and for rounding.
            boxes[leaf] = [*(pixels.min(axis=0) - 1.0), *(pixels.max(axis=0) + 1.0)]
    return boxes


def prune(code: np.ndarray, present: np.ndarray) -> np.ndarray:
    """A postfix program without the leaves that are not present (thesis 4.9); empty when nothing can remain."""
    stack: list[list[int]] = []
    for op in code:
        if op >= 0:
            stack.append([int(op)] if present[op] else [])
            continue
        right, left = stack.pop(), stack.pop()
        if left and right:
            stack.append([*left, *right, int(op)])
        elif op == INTERSECT:
            stack.append([])
        else:
            stack.append(left if op == DIFFERENCE else left or right)
    return np.array(stack[0], dtype=np.int64)
