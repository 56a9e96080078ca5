"""The array-machine engine: tiles of one pixel a PE, cast and shaded as array programs on the emulated DAP.

The algorithm is that of the reference engine: the same stack of entry and exit lists, the same ties, the same shading
(thesis 4.3, 4.5, 4.8, appendices A and B); every operation is charged to the machine. Frame.stats.dap_cycles holds the
cycles, computed and not simulated. REAL*8 gives the other engines' image; shorter words give it but for rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias, cast

import numpy as np

from dap_emulator import Dap, DapArray
from dap_emulator.machine import intrinsics as f
from dap_emulator.machine.kinds import LOGICAL, real
from dap_emulator.machine.machine import OutOfStore
from msgs_py import PinholeCamera, Pose
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from ..scene.scene import Scene
from ..scene.solid import FACES
from ..scene.terrain import Terrain
from .array_machine.caster import CODES, INFINITE, Caster, Rays, Spans
from .array_machine.terrain import ArrayTerrain
from .engines import ViewPose
from .frame import FACE_SLOTS, MISS, Frame, RenderOptions, RenderStats
from .frame_buffers import ImageHits
from .programs.program import (
    CYLINDER,
    DIFFERENCE,
    HALFSPACES,
    INTERSECT,
    KIND_CODES,
    REVERSED_DIFFERENCE,
    SPHERE,
    TERRAIN,
    UNION,
    View,
    program_of,
    view_of,
)
from .programs.pruning import Tile, boundary, tiles, untiled
from .programs.tree_order import early_outs, left_heavy
from .raw_view import box_samples
from .settings import (
    CROW_OFFSETS,
    CROW_WEIGHTS,
    DEPARTURE,
    DEPARTURE_TOLERANCES,
    PARALLEL,
    SHORT_WORD_PARALLEL_ROUNDINGS,
    SHORT_WORD_ROUNDINGS,
)
from .stop import Stop

OPERATOR_NAMES = {UNION: 'UNION', INTERSECT: 'INTERSECT', DIFFERENCE: 'DIFFERENCE', REVERSED_DIFFERENCE: 'DIFFERENCE'}
KIND_NAMES = {code: name for name, code in KIND_CODES.items()}
# Each component is a number for all PEs or a plane with one for each; so are values of a material.
Vector: TypeAlias = tuple[Any, Any, Any]
Components: TypeAlias = Sequence[Any]
# The nearest boundary on every ray: t, code, and whether the ray enters there.
Hit: TypeAlias = tuple[DapArray, DapArray, DapArray]
# Rays still to be cast, with their weight in their pixel (None: all of it), level, hits if known, and leaves to meet.
Pending: TypeAlias = tuple[Rays, DapArray | None, int, Hit | None, list[int]]


def render_views(
    scene: Scene, views: Sequence[ViewPose], options: RenderOptions, stop: Stop | None = None
) -> list[Frame]:
    """See :func:`csg_renderer.render`. Every view is rendered by a new DAP 510."""
    frames = []
    for camera, camera_T_scene, _ in views:
        dap = Dap.model('510', tracing=False)
        dap.watch = None if stop is None else stop.check
        frames.append(render(scene, camera, camera_T_scene, options, dap))
    return frames


def render(
    scene: Scene,
    camera: PinholeCamera,
    camera_T_scene: Pose,
    options: RenderOptions,
    dap: Dap | None = None,
    length: int = 8,
) -> Frame:
    """See :func:`csg_renderer.render`. dap : a new DAP 510 by default; length : bytes of the REALs, 4 to 8."""
    dap = dap or Dap.model('510', tracing=False)
    with dap.measured() as so_far:
        view = view_of(program_of(scene), camera_T_scene)
        tracer = _Tracer(dap, view, camera, options, length)
        try:
            found = _image(tracer)
        except OutOfStore as error:
            raise ValueError(
                f"engine: 'dap' is {error}; tiles of {dap.es} pixels, fewer levels and left_heavy need least"
            ) from None
        used = so_far()
    tracer.stats.dap_cycles, tracer.stats.dap_planes = used.cycles, used.peak_planes
    return found.frame(view.program, camera, camera_T_scene, tracer.stats, options.radiance)


def _image(tracer: _Tracer) -> ImageHits:
    """All tiles of an image."""
    view, camera, options = tracer.view, tracer.camera, tracer.options
    found = ImageHits(camera, view.program.background)
    areas = list(tiles(view, camera, options.tile_size) if options.tiling else untiled(view, camera, tracer.dap.es))
    for tile in areas:
        area = tile.area
        if not tile.children and not tile.terrains:
            continue
        tracer.stats.tiles += 1
        colour, found.codes[area], found.depth[area], found.normal[area] = tracer.trace(
            tile, 0.0, 0.0, options.box == 0
        )
        if options.box:
            offsets = box_samples(options.box)[:, :2].tolist()
            samples = (np.clip(tracer.trace(tile, du, dv)[0], 0.0, 1.0) for du, dv in offsets)
            colour = np.asarray(sum(samples) / len(offsets))
        found.colours[area] = colour
    if not options.tiling:
        tracer.stats.tiles = 1
    if options.adaptive:
        _smooth(tracer, areas, found.colours, boundary(found.codes))
    return found


def _smooth(tracer: _Tracer, areas: list[Tile], colours: FloatArray, edge: BoolArray) -> None:
    """Nine weighted samples (thesis 4.6) wherever faces meet; a tile is sampled again as a whole."""
    for tile in areas:
        area = tile.area
        if not edge[area].any():
            continue
        total = np.zeros((*edge[area].shape, 3))
        for row, dv in zip(CROW_WEIGHTS, CROW_OFFSETS):
            for weight, du in zip(row, CROW_OFFSETS):
                total += weight * np.clip(tracer.trace(tile, du, dv)[0], 0.0, 1.0)
        colours[area] = np.where(edge[area][..., None], total, colours[area])


class _Tracer:
    """Rays through the pixels of a tile to colours, one PE a ray."""

    def __init__(self, dap: Dap, view: View, camera: PinholeCamera, options: RenderOptions, length: int) -> None:
        self.dap, self.view, self.camera, self.options = dap, view, camera, options
        self.kind = real(length)
        short = length < 8
        epsilon = 2.0**-self.kind.mantissa
        extent = view.departure / DEPARTURE
        self.tolerance = max(view.tolerance, SHORT_WORD_ROUNDINGS * epsilon * extent) if short else view.tolerance
        self.departure = max(view.departure, DEPARTURE_TOLERANCES * self.tolerance)
        self.parallel = max(PARALLEL, SHORT_WORD_PARALLEL_ROUNDINGS * epsilon) if short else PARALLEL
        self.caster = Caster(dap, self.kind, self.tolerance)
        leaves = view.program.leaves
        self.terrains = {leaf: ArrayTerrain(self.caster, cast(Terrain, leaves[leaf])) for leaf in view.program.terrains}
        self.stats = RenderStats()
        self.children = self.ordered(view.program.children)

    def ordered(self, children: Sequence[IntArray]) -> list[IntArray]:
        """Postfix programs in the order in which the options want them evaluated."""
        return [left_heavy(code) for code in children] if self.options.left_heavy else list(children)

    def trace(
        self, tile: Tile, du: float, dv: float, shaded: bool = True
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Colour (h, w, 3), code, depth (NaN on a miss) and outward normal of a tile's pixels."""
        rows, columns = tile.area
        u, v = np.arange(columns.start, columns.stop) + du, np.arange(rows.start, rows.stop) + dv
        height, width = len(v), len(u)
        dap, camera = self.dap, self.camera
        x = f.matr(dap.vector((u - camera.cx) / camera.fx, self.kind), height)
        y = f.matc(dap.vector((v - camera.cy) / camera.fy, self.kind), width)
        rays = Rays((0.0, 0.0, 0.0), (x, y, self.caster.filled(1.0, x.shape)))
        first = self._cast(self.ordered(tile.children), tile.terrains, rays, self.view.local, self.tolerance, False)
        t, hit, entering = first
        place = self.view.scene_T_camera
        scene = [place[i, 0] * x + (place[i, 1] * y + float(place[i, 2])) for i in range(3)]
        onward = Rays(tuple(float(place[i, 3]) for i in range(3)), tuple(scene))
        leaves = sorted({int(op) for code in tile.children for op in code if op >= 0} | set(tile.terrains))
        colour, facing = self._shade(onward, first, leaves, shaded)
        codes = hit.numpy().astype(np.int64)
        seen = codes != MISS
        normal = np.stack([component.numpy() for component in facing], axis=-1).astype(float)
        image = np.stack([channel.numpy() for channel in colour], axis=-1).astype(float)
        return (image, codes, np.where(seen, t.numpy(), np.nan), np.where(seen[..., None], normal, np.nan))

    # Finding the surface.

    def _cast(
        self,
        children: Sequence[np.ndarray],
        terrains: Sequence[int],
        rays: Rays,
        transforms: np.ndarray,
        nearest: float,
        entries_only: bool,
        active: DapArray | None = None,
    ) -> Hit:
        """t, code and "enters there" of the nearest boundary of some children and terrains on the active rays."""
        best: Hit | None = None
        for code in children:
            other = self.caster.first_hit(self._spans(code, rays, transforms), nearest, entries_only)
            best = other if best is None else self._nearer(best, other)
        for leaf in terrains:
            # What is behind the nearest so far need not be looked for.
            farthest = None if best is None else best[0] + self.tolerance
            other = self._sheet(
                leaf, self.terrains[leaf].first_crossing(rays, transforms[leaf], nearest, farthest, active)
            )
            best = other if best is None else self._nearer(best, other)
        if best is not None:
            return best
        dap, shape = self.dap, rays.shape
        return (
            self.caster.filled(INFINITE, shape),
            f.filled(dap, MISS, shape, CODES),
            f.filled(dap, True, shape, LOGICAL),
        )

    def _sheet(self, leaf: int, t: DapArray) -> Hit:
        """Hits of a terrain at t, infinite where there is none: a ray always enters."""
        hit = f.filled(self.dap, MISS, t.shape, CODES)
        hit.assign(leaf * FACE_SLOTS, t < INFINITE)
        return t, hit, f.filled(self.dap, True, t.shape, LOGICAL)

    def _spans(self, code: np.ndarray, rays: Rays, transforms: np.ndarray) -> Spans:
        """Walk a postfix tree with a stack of lists (appendix B)."""
        stack: list[Spans] = []
        count = int(np.prod(rays.shape))
        jumps = early_outs(code) if self.options.early_outs else [0] * len(code)
        index = 0
        while index < len(code):
            op = code[index]
            self.stats.nodes += count
            if op >= 0:
                kind = int(self.view.program.kind[op])
                self.stats.intersections += count * int(HALFSPACES[kind])
                local = self.caster.localise(rays, transforms[op], self.parallel)
                stack.append(self.caster.leaf(KIND_NAMES[kind], int(op) * FACE_SLOTS, local))
            else:
                self.stats.combines += count
                right, left = stack.pop(), stack.pop()
                if op == REVERSED_DIFFERENCE:
                    left, right = right, left
                stack.append(self.caster.combine(OPERATOR_NAMES[int(op)], left, right))
            # Where all rays are out of the left operand, what is on the stack is the operator's result already.
            while jumps[index] and not f.any_(stack[-1].t[0] < INFINITE):
                index = jumps[index] - 1
            index += 1
        return stack[0]

    def _nearer(self, best: Hit, other: Hit) -> Hit:
        """The nearer of two hits; within the tolerance, the lower code's."""
        (t, hit, entering), (new_t, new_hit, new_entering) = best, other
        found, empty = new_t < INFINITE, ~(t < INFINITE)
        close = abs(new_t - t) <= self.tolerance
        better = found & (empty | (new_t - t < -self.tolerance) | (close & (new_hit < hit)))
        return (f.merge(new_t, t, better), f.merge(new_hit, hit, better), f.merge(new_entering, entering, better))

    # Shading it.

    def _shade(
        self, first: Rays, first_hits: Hit, shown: list[int], shaded: bool = True
    ) -> tuple[list[DapArray], Vector]:
        """Colours and outward normals of the first hits, with what further levels add."""
        program, shape = self.view.program, first.shape
        colour = [self.caster.filled(0.0, shape) for _ in range(3)]
        facing: Vector | None = None
        pending: list[Pending] = [(first, None, 1, first_hits, shown)]
        every = sorted(range(len(program.kind)))
        while pending:
            rays, weight, level, hits, leaves = pending.pop()
            if hits is None:
                onwards = None if weight is None else weight > 0.0
                hits = self._cast(
                    self.children, program.terrains, rays, program.inverse[:, :3], self.departure, True, onwards
                )
            t, hit, entering = hits
            missed = hit.compare('eq', MISS)
            for channel, background in zip(colour, program.background):
                share = float(background) if weight is None else weight * float(background)
                channel.assign(channel + share, missed)
            seen = ~missed
            lit = shaded and f.any_(seen)
            if not lit and facing is not None:
                continue
            # A ray that meets nothing is given a point where numbers stay finite; its results are masked out.
            reach = f.merge(t, 1.0, seen)
            points = [o + reach * d for o, d in zip(rays.origin, rays.direction)]
            surfaces = self._surfaces(hit, leaves, points, rays.direction, entering)
            if facing is None:
                facing = surfaces['normal']
            if not lit:
                continue
            flip = ~entering
            towards = tuple(f.merge(-n, n, flip) for n in surfaces['normal'])
            view = self._unit(rays.direction)
            local, mirrored = self._illuminate(surfaces, points, towards, view, leaves)
            last = level == self.options.levels
            clear = 0.0 if last else surfaces['transparency']
            mirror = 0.0 if last else surfaces['reflection']
            through = 1.0 - clear
            share = through if weight is None else weight * through
            for channel, value in zip(colour, local):
                channel.assign(channel + value * share, seen)
            fade = 1.0 if weight is None else weight
            for portion, direction in ((share * mirror, mirrored), (fade * clear, view)):
                if not isinstance(portion, DapArray):
                    if portion == 0.0:
                        continue
                    portion = self.caster.filled(portion, shape)
                portion = f.merge(portion, 0.0, seen)
                if f.any_(portion > 0.0):
                    pending.append((Rays(tuple(points), tuple(direction)), portion, level + 1, None, every))
        assert facing is not None
        return colour, facing

    def _surfaces(
        self, hit: DapArray, leaves: list[int], points: Components, direction: Sequence[DapArray], entering: DapArray
    ) -> dict[str, Any]:
        """Outward normal, face colour and material at every hit: one masked assignment for each face that shows."""
        program, shape = self.view.program, hit.shape
        normal = [self.caster.filled(0.0, shape) for _ in range(3)]
        colours = [self.caster.filled(0.0, shape) for _ in range(3)]
        materials: dict[str, Any] = {}
        names = ('ambient', 'diffuse', 'specular', 'shininess', 'reflection', 'transparency')
        for index, name in enumerate(names):
            values = {float(program.material[leaf, index]) for leaf in leaves}
            materials[name] = values.pop() if len(values) == 1 else self.caster.filled(0.0, shape)
        for leaf in leaves:
            kind = int(program.kind[leaf])
            for face in range(len(FACES[KIND_NAMES[kind]])):
                here = hit.compare('eq', leaf * FACE_SLOTS + face)
                if not f.any_(here):
                    continue
                for plane, value in zip(colours, self._face_colour(leaf, face, points)):
                    plane.assign(value, here)
                for index, name in enumerate(names):
                    if isinstance(materials[name], DapArray):
                        materials[name].assign(float(program.material[leaf, index]), here)
                if kind == TERRAIN:
                    components = self._terrain_normal(leaf, points, here)
                else:
                    components = self._normal(leaf, kind, face, points, direction)
                for plane, component in zip(normal, components):
                    plane.assign(component, here)
        n, d = normal, direction
        along = n[0] * d[0] + n[1] * d[1] + n[2] * d[2]
        turn = (along < 0.0) ^ entering
        return {
            'normal': tuple(f.merge(-component, component, turn) for component in normal),
            'colour': colours,
            **materials,
        }

    def _face_colour(self, leaf: int, face: int, points: Components) -> Components:
        """Red, green, blue of a face: three numbers, or planes where a terrain is coloured by height."""
        program = self.view.program
        terrain = self.terrains.get(leaf)
        if terrain is None or terrain.terrain.tints is None:
            return [float(value) for value in program.colours[leaf, face]]
        return terrain.tinted(self._local(leaf, 2, points))

    def _local(self, leaf: int, axis: int, points: Components) -> Any:
        """One coordinate of points in a leaf's unit frame."""
        m = self.view.program.inverse[leaf, axis]
        return m[0] * points[0] + m[1] * points[1] + m[2] * points[2] + float(m[3])

    def _terrain_normal(self, leaf: int, points: Components, here: DapArray) -> Components:
        """Unit normal of a terrain, its sign not yet settled."""
        m = self.view.program.inverse[leaf]
        x, y = (self._local(leaf, axis, points) for axis in (0, 1))
        slope_x, slope_y = self.terrains[leaf].slopes(x, y, here)
        normal = [float(m[2, k]) - float(m[0, k]) * slope_x - float(m[1, k]) * slope_y for k in range(3)]
        length = f.sqrt(self._dot(normal, normal))
        return [component / length for component in normal]

    def _normal(self, leaf: int, kind: int, face: int, points: Components, direction: Sequence[DapArray]) -> Components:
        """Unit normal of a face, its sign not yet settled: three numbers, or planes for a curved face."""
        inverse = self.view.program.inverse[leaf]
        if face < len(FACES[KIND_NAMES[kind]]) - 1 or KIND_NAMES[kind] in ('BLOCK', 'PLANE'):
            row = inverse[face // 2 if KIND_NAMES[kind] == 'BLOCK' else 2, :3]
            return [float(value) for value in row / np.linalg.norm(row)]
        signs = (1.0, 1.0, 0.0 if kind == CYLINDER else 1.0 if kind == SPHERE else -1.0)
        gradient = [
            self._local(leaf, i, points) * sign if sign != 1.0 else self._local(leaf, i, points)
            for i, sign in enumerate(signs)
            if sign
        ]
        rows = [i for i, sign in enumerate(signs) if sign]
        normal = [self._sum([float(inverse[i, j]) * g for i, g in zip(rows, gradient)]) for j in range(3)]
        square = self._sum([component * component for component in normal])
        apex = square.compare('eq', 0.0)
        scale = 1.0 / f.sqrt(f.merge(1.0, square, apex))
        return [f.merge(-d, component * scale, apex) for component, d in zip(normal, direction)]

    def _sum(self, terms: Components) -> Any:
        total = terms[0]
        for term in terms[1:]:
            total = total + term
        return total

    def _dot(self, a: Components, b: Components) -> Any:
        return self._sum([p * q for p, q in zip(a, b)])

    def _unit(self, vectors: Components) -> Vector:
        length = f.sqrt(self._dot(vectors, vectors))
        length.assign(1.0, length.compare('eq', 0.0))
        return (vectors[0] / length, vectors[1] / length, vectors[2] / length)

    def _illuminate(
        self, surfaces: dict[str, Any], points: Components, normal: Components, view: Vector, leaves: list[int]
    ) -> tuple[list[Any], Vector]:
        """Linear colours and the mirrored viewing ray (thesis 4.5, shading.py)."""
        program = self.view.program
        slope = self._dot(view, normal) * 2.0
        mirrored = (view[0] - slope * normal[0], view[1] - slope * normal[1], view[2] - slope * normal[2])
        result = [
            surfaces['ambient'] * channel * float(light)
            for channel, light in zip(surfaces['colour'], program.ambient_light)
        ]
        glossy = any(program.material[leaf, 2] > 0.0 for leaf in leaves)
        for position, light in zip(program.lights, program.light_colours):
            towards = [float(p) - q for p, q in zip(position, points)]
            distance = f.sqrt(self._dot(towards, towards))
            distance.assign(1.0, distance.compare('eq', 0.0))
            to_light = (towards[0] / distance, towards[1] / distance, towards[2] / distance)
            facing = self._dot(normal, to_light)
            arriving = f.merge(facing, 0.0, facing > 0.0)
            lit = facing > 0.0
            if self.options.shadows and f.any_(lit):
                through = self._transmission(points, to_light, distance, lit)
                arriving = arriving * through
            shade = surfaces['diffuse'] * arriving
            highlight = None
            if glossy:
                along = self._dot(mirrored, to_light)
                shining = f.merge(
                    self._power(f.merge(along, 1.0, along > 0.0), surfaces['shininess'], leaves),
                    0.0,
                    (along > 0.0) & lit,
                )
                if self.options.shadows and f.any_(lit):
                    shining = shining * through
                highlight = surfaces['specular'] * shining
            for index, channel in enumerate(surfaces['colour']):
                value = shade * channel if highlight is None else shade * channel + highlight
                result[index] = result[index] + value * float(light[index])
        return result, mirrored

    def _power(self, base: DapArray, exponent: Any, leaves: list[int]) -> DapArray:
        """Raise to a power; one pass for each exponent that the leaves have."""
        if not isinstance(exponent, DapArray):
            return base.power(int(exponent) if float(exponent).is_integer() else float(exponent))
        result = self.caster.filled(1.0, base.shape)
        for value in sorted({float(self.view.program.material[leaf, 3]) for leaf in leaves}):
            raised = base.power(int(value) if value.is_integer() else value)
            result.assign(raised, exponent.compare('eq', value))
        return result

    def _transmission(self, points: Components, direction: Vector, distance: DapArray, active: DapArray) -> DapArray:
        """How much light comes along rays of some length: the product of transparencies in the way."""
        program = self.view.program
        light = self.caster.filled(1.0, distance.shape)
        rays = Rays(tuple(points), direction)
        for code in self.children:
            spans = self._spans(code, rays, program.inverse[:, :3])
            leaves = sorted({int(op) for op in code if op >= 0})
            for column in range(0, len(spans.t), 2):
                blocked = (spans.t[column] < distance - self.departure) & (spans.t[column + 1] > self.departure)
                if not f.any_(blocked):
                    continue
                for leaf in leaves:
                    first = leaf * FACE_SLOTS
                    here = blocked & (spans.hit[column] >= first) & (spans.hit[column] < first + FACE_SLOTS)
                    light.assign(light * float(program.material[leaf, 5]), here)
        for leaf, terrain in self.terrains.items():
            inverse = program.inverse[leaf, :3]
            t = terrain.first_crossing(rays, inverse, self.departure, distance - self.departure, active)
            light.assign(light * float(program.material[leaf, 5]), t < INFINITE)
        return light
