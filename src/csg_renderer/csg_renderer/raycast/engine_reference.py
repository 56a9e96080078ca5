"""The whole image with the reference engine: tiles, levels, shadows and anti-aliasing in plain numpy.

Slow and simple; :func:`csg_renderer.render` offers it as engine='reference'.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msgs_py import LensDistortion, PinholeCamera
from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, IntArray

from ..scene.scene import Scene
from .engines import ViewPose
from .frame import FACE_SLOTS, MISS, Frame, RenderOptions, RenderStats
from .frame_buffers import ImageHits
from .programs.program import View, program_of, view_of
from .programs.pruning import Tile, boundary, tiles, untiled
from .raw_view import box_samples, raw_view
from .reference import Hits, cast, normals, transmission
from .reference_surfaces import SurfaceTracer
from .settings import AT_ONCE, CROW_OFFSETS, CROW_WEIGHTS
from .shading import illuminate, reflect, unit
from .stop import Stop


def render_views(
    scene: Scene, views: Sequence[ViewPose], options: RenderOptions, stop: Stop | None = None
) -> list[Frame]:
    """See :func:`csg_renderer.render`."""
    return [render(scene, view, options, stop) for view in views]


def render(scene: Scene, seen_from: ViewPose, options: RenderOptions, stop: Stop | None = None) -> Frame:
    """One view; see :func:`csg_renderer.render`."""
    program = program_of(scene)
    camera, camera_T_scene, lens = seen_from
    view = view_of(program, camera_T_scene)
    tracer = _Tracer(view, camera, lens, options, stop or Stop())
    found = ImageHits(camera, program.background)
    lit: BoolArray = np.isfinite(tracer.rays(camera.pixel_grid())[..., 0])
    found.colours[~lit] = 0.0
    # Which primitives a tile may show is known of straight rows and columns.
    tiling = options.tiling and lens is None
    for tile in tiles(view, camera, options.tile_size) if tiling else untiled(view, camera, AT_ONCE):
        if not tile.children and not tile.terrains and program.surfaces is None:
            continue
        rows, columns = tile.area
        tracer.stats.tiles += 1
        v, u = (grid[lit[rows, columns]] for grid in np.mgrid[rows, columns])
        hits, colour, facing = tracer.trace(u, v, tile)
        seen = hits.hit != MISS
        found.codes[v, u] = hits.hit
        found.depth[v[seen], u[seen]] = hits.t[seen]
        found.normal[v[seen], u[seen]] = facing[seen]
        found.colours[v, u] = tracer.box_mean(u, v, tile) if options.box else colour
    if not tiling:
        tracer.stats.tiles = 1
    if options.adaptive:
        down, across = np.nonzero(boundary(found.codes) & lit)
        (whole,) = untiled(view, camera, max(camera.height, camera.width))
        for first in range(0, len(down), AT_ONCE**2):
            v, u = down[first : first + AT_ONCE**2], across[first : first + AT_ONCE**2]
            smooth = np.zeros((len(u), 3))
            for row, dv in zip(CROW_WEIGHTS, CROW_OFFSETS):
                for weight, du in zip(row, CROW_OFFSETS):
                    smooth += weight * np.clip(tracer.trace(u + du, v + dv, whole)[1], 0.0, 1.0)
            found.colours[v, u] = smooth
    frame = found.frame(program, camera, camera_T_scene, tracer.stats, options.radiance)
    frame.lens = lens
    return frame


class _Tracer:
    """Rays through pixels to colours."""

    def __init__(
        self, view: View, camera: PinholeCamera, lens: LensDistortion | None, options: RenderOptions, stop: Stop
    ) -> None:
        self.view, self.camera, self.lens, self.options, self.stop = view, camera, lens, options, stop
        self.stats = RenderStats()

    def rays(self, pixels: AnyArray) -> FloatArray:
        """Viewing directions (..., 3) of pixels (..., 2); NaN where the lens shows nothing."""
        return self.camera.rays(pixels) if self.lens is None else self.lens.rays(self.camera, pixels)

    def trace(self, u: AnyArray, v: AnyArray, tile: Tile) -> tuple[Hits, FloatArray, FloatArray]:
        """Pixels (n,) of a tile to the first hit, the colour (n, 3) and the normal (n, 3) there."""
        view = self.view
        rays = self.rays(np.stack([u, v], axis=1))
        if self.lens is not None:
            # A sample that the lens does not show is that of its pixel's centre.
            rays = np.where(np.isfinite(rays), rays, self.rays(np.rint(np.stack([u, v], axis=1))))
        first = cast(
            view, tile.children, tile.terrains, np.zeros((1, 3)), rays, view.local, view.tolerance, False, self.stats
        )
        if view.program.surfaces is not None:
            return (first, *self._surfaces(rays, first))
        rotation, centre = view.scene_T_camera[:3, :3], view.scene_T_camera[:3, 3]
        directions = rays @ rotation.T
        origins = np.broadcast_to(centre, directions.shape)
        colour = np.zeros((len(u), 3))
        facing = np.full((len(u), 3), np.nan)
        pending: list[tuple[IntArray, FloatArray, FloatArray, FloatArray, int, Hits | None]] = [
            (np.arange(len(u)), origins, directions, np.ones(len(u)), 1, first)
        ]
        while pending:
            self.stop.check()
            rays_of, origins, directions, weight, level, hits = pending.pop()
            if hits is None:
                hits = cast(
                    view,
                    view.program.children,
                    view.program.terrains,
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

    def _surfaces(self, rays: FloatArray, first: Hits) -> tuple[FloatArray, FloatArray]:
        """Colours and normals (n, 3) of camera rays in a scene with pictures and the like."""
        view, options = self.view, self.options
        assert view.program.surfaces is not None
        everything = view.program.children, view.program.terrains

        def cast_on(origin: FloatArray, direction: FloatArray) -> Hits:
            self.stop.check()
            frames = view.program.inverse[:, :3]
            return cast(view, *everything, origin, direction, frames, view.departure, True, self.stats)

        def feel(origin: FloatArray, towards: FloatArray, distance: FloatArray) -> FloatArray:
            self.stop.check()
            return transmission(view, origin, towards, distance, self.stats)

        tracer = SurfaceTracer(
            view, view.program.surfaces, options.levels, options.samples, cast_on, feel if options.shadows else None
        )
        ideal = self.camera if self.lens is None else raw_view(self.camera, self.lens).ideal
        size = 1.0 / ideal.fx / max(options.box, 1)
        directions = rays @ view.scene_T_camera[:3, :3].T
        return tracer.trace(rays[:, :2] * [ideal.fx, ideal.fy], directions, size, first)

    def box_mean(self, u: IntArray, v: IntArray, tile: Tile) -> FloatArray:
        """(n, 3): the mean of the colours of n x n samples in each pixel (options.box)."""
        offsets = box_samples(self.options.box)[:, :2].tolist()
        samples = (np.clip(self.trace(u + right, v + below, tile)[1], 0.0, 1.0) for right, below in offsets)
        return np.asarray(sum(samples) / len(offsets))

    def _transmitted(self, points: FloatArray) -> FloatArray | None:
        """(n, lights), or None when shadows are off."""
        if not self.options.shadows:
            return None
        arriving = []
        for position in self.view.program.lights:
            towards = position - points
            distance = np.linalg.norm(towards, axis=1)
            arriving.append(transmission(self.view, points, unit(towards), distance, self.stats))
        return np.stack(arriving, axis=1) if arriving else None
