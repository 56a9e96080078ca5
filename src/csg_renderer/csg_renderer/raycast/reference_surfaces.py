"""Pictures, metals, lights with a size and surroundings in plain numpy, by the formulas of the compiled kernels.

Slow and simple, for the reference engine; kernels/textures.py, kernels/lobes.py and kernels/surface_rays.py say why.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from .frame import FACE_SLOTS, MISS
from .programs.program import View
from .programs.surface_data import CYLINDRICAL, NO_PICTURE, PLANAR, SIDES, SurfaceData
from .reference import Hits, normals
from .settings import ALBEDO_STEPS, KEY_OFFSET, KEY_STEPS, MOST_PROBES, R2
from .shading import face_colours, reflect, unit

TURN = 2.0 * np.pi
# As in kernels/surface_rays.py.
MATT_STREAM, METAL_STREAM, MIRROR_STREAM, GLASS_STREAM, FACET_STREAM, LIGHT_STREAM = 0, 1, 10, 11, 1 << 20, 1 << 10
GAMMA, FIRST, SECOND = (np.uint64(c) for c in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))


@dataclass
class Bundle:
    """n rays that lie in pixels of an image.

    Attributes
    ----------
    pixel : (n,)
    origin, direction : (n, 3)
        Scene frame; directions of camera rays are of any length, others unit.
    weight : (n, 3)
        In their pixels.
    width, spread : (n,)
        Of their cones at the origin, metres, and their angles.
    key : (n,)
        Of their random numbers.
    count : (n,)
        How many directions of light their places sample.
    """

    pixel: IntArray
    origin: FloatArray
    direction: FloatArray
    weight: FloatArray
    width: FloatArray
    spread: FloatArray
    key: FloatArray
    count: IntArray

    def some(self, chosen: BoolArray) -> Bundle:
        """Those of the rays."""
        return Bundle(
            self.pixel[chosen],
            self.origin[chosen],
            self.direction[chosen],
            self.weight[chosen],
            self.width[chosen],
            self.spread[chosen],
            self.key[chosen],
            self.count[chosen],
        )


# First hits of rays of the scene frame, and how much light comes along rays of some length.
Cast = Callable[[FloatArray, FloatArray], Hits]
Feel = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class SurfaceTracer:
    """Bundles of rays to light.

    Attributes
    ----------
    view : View
    data : SurfaceData
    levels, samples : int
        See RenderOptions.
    cast : Cast
    feel : Feel or None
        None without shadows.
    """

    view: View
    data: SurfaceData
    levels: int
    samples: int
    cast: Cast
    feel: Feel | None

    def trace(self, pixels: FloatArray, rays: FloatArray, size: float, first: Hits) -> tuple[FloatArray, FloatArray]:
        """Camera rays to their light and to the outward normals at their first hits, (n, 3) both.

        pixels : (n, 2) places in the image from its principal point, pixels. rays : (n, 3) scene frame, 1 long along z
        of the camera. size : what a sample covers at the depth of 1.
        """
        n = len(rays)
        light, facing = np.zeros((n, 3)), np.full((n, 3), np.nan)
        centre = np.broadcast_to(self.view.scene_T_camera[:3, 3], rays.shape)
        steps = np.rint(pixels * KEY_STEPS) + KEY_OFFSET
        key = mixed(mixed(steps[:, 0], 0), steps[:, 1])
        width, spread = np.zeros(n), np.full(n, size)
        bundle = Bundle(np.arange(n), centre, rays, np.ones((n, 3)), width, spread, key, np.full(n, self.samples))
        pending: list[tuple[Bundle, int, Hits | None]] = [(bundle, 1, first)]
        while pending:
            bundle, level, hits = pending.pop()
            hits = self.cast(bundle.origin, bundle.direction) if hits is None else hits
            missed = hits.hit == MISS
            lost = bundle.some(missed)
            np.add.at(light, lost.pixel, lost.weight * self.surroundings(unit(lost.direction), lost.spread))
            if missed.all():
                continue
            bundle, code, t = bundle.some(~missed), hits.hit[~missed], hits.t[~missed]
            entering = hits.entering[~missed]
            points = bundle.origin + t[:, None] * bundle.direction
            outward = normals(self.view.program, code, points, bundle.direction, entering)
            if level == 1:
                facing[bundle.pixel] = outward
            there = replace(
                bundle, origin=points, direction=unit(bundle.direction), width=bundle.width + t * bundle.spread
            )
            surface = self._surface(there, code, np.where(entering[:, None], outward, -outward), level)
            pending += [(rays, level + 1, None) for rays in surface.onward(light)]
            surface.shine(light)
        return light, facing

    def _surface(self, there: Bundle, code: IntArray, normal: FloatArray, level: int) -> _Surface:
        program = self.view.program
        leaf = code // FACE_SLOTS
        tint = face_colours(program, code, there.origin)
        tint = tint * texture_colours(self.data, leaf, there.origin, normal, there.direction, there.width)
        return _Surface(self, there, leaf, normal, tint, level == self.levels)

    def surroundings(self, direction: FloatArray, spread: FloatArray) -> FloatArray:
        """(n, 3): what rays see that meet nothing; unit directions."""
        data = self.data
        if data.environment == NO_PICTURE:
            return np.broadcast_to(self.view.program.background, direction.shape)
        ahead, right, up = (direction @ data.axes.T).T
        rows = data.rows[data.level_start[data.environment]]
        u, v = 0.5 + np.arctan2(right, ahead) / TURN, 0.5 + np.arcsin(np.clip(up, -1.0, 1.0)) / np.pi
        picture = np.full(len(direction), data.environment)
        return filtered(data, picture, spread * rows / np.pi, u, v)


@dataclass
class _Surface:
    """Places on surfaces, where rays ``there`` meet them: leaf (n,), normal (n, 3) to the viewer, tint (n, 3)."""

    tracer: SurfaceTracer
    there: Bundle
    leaf: IntArray
    normal: FloatArray
    tint: FloatArray
    last: bool

    @property
    def alpha(self) -> FloatArray:
        """Roughness of metals, (n,), -1 of others."""
        return self.tracer.data.roughness[self.leaf]

    def onward(self, light: FloatArray) -> list[Bundle]:
        """The mirrored and transmitted rays; at the last level what metals mirror is added to the light of pixels."""
        there, metal = self.there, self.alpha >= 0.0
        mirror, clear = self.tracer.view.program.material[self.leaf, 4:].T
        if self.last:
            mirror, clear = np.zeros_like(mirror), np.zeros_like(clear)
        rays = [self._onward(clear > 0.0, there.direction, clear[:, None], GLASS_STREAM)]
        there.weight = there.weight * (1.0 - clear)[:, None]
        mirrored = reflect(there.direction, self.normal)
        rays.append(self._onward((mirror > 0.0) & ~metal, mirrored, mirror[:, None], MIRROR_STREAM))
        for k in range(int(there.count[metal].max(initial=0))):
            some = metal & (k < there.count)
            direction, share, along, density = from_metal(
                self.normal, there.direction, self.alpha, *sample(there.key, METAL_STREAM, k)
            )
            some &= share > 0.0
            back = self._metal_colour(along) * (share / there.count)[:, None]
            spread = np.maximum(there.spread, np.sqrt(1.0 / (there.count * density)))
            if self.last:
                seen = self.tracer.surroundings(direction, spread)
                np.add.at(light, there.pixel[some], (there.weight * back * seen)[some])
            else:
                facets = self._onward(some, direction, back, FACET_STREAM + k)
                rays.append(replace(facets, spread=spread[some], count=np.ones_like(facets.count)))
        return [bundle for bundle in rays if len(bundle.pixel)]

    def _onward(self, some: BoolArray, direction: FloatArray, share: FloatArray, stream: int) -> Bundle:
        there = self.there
        key = mixed(there.key, stream)
        return replace(there, direction=direction, weight=there.weight * share, key=key).some(some)

    def _metal_colour(self, along: FloatArray) -> FloatArray:
        """(n, 3): what a metal returns of white light under these cosines on the facets."""
        seen = -np.einsum('ni,ni->n', self.normal, self.there.direction)
        returned = albedo(self.tracer.data.albedo, seen, self.alpha)
        schlick = (1.0 - np.clip(along, 0.0, 1.0))[:, None] ** 5
        return (self.tint + (1.0 - self.tint) * schlick) * (1.0 + self.tint * ((1.0 - returned) / returned)[:, None])

    def shine(self, light: FloatArray) -> None:
        """Add the light of the places to their pixels."""
        there, tracer = self.there, self.tracer
        program, data = tracer.view.program, tracer.data
        arriving: FloatArray = np.zeros_like(self.tint)
        if data.environment == NO_PICTURE:
            arriving += program.material[self.leaf, :1] * self.tint * program.ambient_light
        else:
            arriving += self._from_around()
        for index, (position, colour) in enumerate(zip(program.lights, program.light_colours)):
            radius = data.radius[index]
            for k in range(int(there.count.max()) if radius > 0.0 else 1):
                towards = position - there.origin
                distance = np.linalg.norm(towards, axis=1)
                towards = unit(towards)
                share = np.ones(len(distance))
                if radius > 0.0:
                    towards, distance = to_ball(towards, distance, radius, *sample(there.key, LIGHT_STREAM + index, k))
                    share = np.where(k < there.count, 1.0 / there.count, 0.0)
                cosine = np.einsum('ni,ni->n', self.normal, towards)
                share = np.where(cosine > 0.0, share, 0.0) * self._felt(towards, distance)
                arriving += share[:, None] * self._returned(towards, np.maximum(cosine, 0.0)) * colour
        np.add.at(light, there.pixel, there.weight * arriving)

    def _felt(self, towards: FloatArray, distance: FloatArray) -> FloatArray:
        """(n,): how much light comes along rays of these lengths."""
        feel = self.tracer.feel
        return np.ones(len(distance)) if feel is None else feel(self.there.origin, towards, distance)

    def _from_around(self) -> FloatArray:
        """(n, 3): what matt surfaces return of the surroundings."""
        there, tracer = self.there, self.tracer
        diffuse = np.where(self.alpha >= 0.0, 0.0, tracer.view.program.material[self.leaf, 1])
        total: FloatArray = np.zeros_like(self.tint)
        for k in range(int(there.count.max())):
            direction, cosine = from_matt(self.normal, *sample(there.key, MATT_STREAM, k))
            spread = np.sqrt(np.pi / (there.count * np.maximum(cosine, 1e-3)))
            share = np.where(k < there.count, diffuse / there.count, 0.0)
            share = share * self._felt(direction, np.full(len(share), np.inf))
            total += share[:, None] * self.tint * tracer.surroundings(direction, spread)
        return total

    def _returned(self, towards: FloatArray, cosine: FloatArray) -> FloatArray:
        """(n, 3): what comes of a white light from these directions."""
        material, view = self.tracer.view.program.material[self.leaf], self.there.direction
        highlight = np.einsum('ni,ni->n', reflect(view, self.normal), towards)
        highlight = np.where(highlight > 0.0, np.maximum(highlight, 0.0) ** material[:, 3], 0.0)
        plain = (material[:, 1] * cosine)[:, None] * self.tint + (material[:, 2] * highlight)[:, None]
        metal = self.alpha >= 0.0
        if not metal.any():
            return np.asarray(plain)
        half = unit(towards - view)
        seen = -np.einsum('ni,ni->n', self.normal, view)
        slant = np.einsum('ni,ni->n', self.normal, half)
        colour = self._metal_colour(np.einsum('ni,ni->n', half, towards))
        return np.where(metal[:, None], glint(cosine, seen, slant, self.alpha)[:, None] * colour, plain)


# -- random numbers and directions ------------------------------------------------------------------------------------


def mixed(key: FloatArray, stream: FloatArray | int) -> FloatArray:
    """(n,): other whole numbers below 2^53 (SplitMix64)."""
    # One number wraps with a warning, an array without.
    z = key.astype(np.uint64) + (np.atleast_1d(stream).astype(np.uint64) + np.uint64(1)) * GAMMA
    z = (z ^ (z >> np.uint64(30))) * FIRST
    z = (z ^ (z >> np.uint64(27))) * SECOND
    z = z ^ (z >> np.uint64(31))
    return np.asarray((z >> np.uint64(11)).astype(np.float64))


def sample(key: FloatArray, stream: int, k: int) -> tuple[FloatArray, FloatArray]:
    """The k-th pairs of numbers in [0, 1), (n,) each."""
    u, v = (mixed(key, 2 * stream + i) * 2.0**-53 + k * R2[i] for i in (0, 1))
    return u - np.floor(u), v - np.floor(v)


def _turned(normal: FloatArray, local: FloatArray) -> FloatArray:
    """Directions (n, 3) from frames whose z are the normals."""
    across, along = _basis(normal)
    return across * local[:, :1] + along * local[:, 1:2] + normal * local[:, 2:]


def _basis(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    x, y, z = normal.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return (
        np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1),
        np.stack([b, sign + y * y * a, -y], axis=1),
    )


def _polar(cosine: FloatArray, turn: FloatArray) -> FloatArray:
    across = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
    return np.stack([across * np.cos(TURN * turn), across * np.sin(TURN * turn), cosine], axis=1)


def to_ball(
    towards: FloatArray, distance: FloatArray, radius: float, u: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Directions (n, 3) evenly over the cone that a ball fills, and how far its surface is, (n,)."""
    least = np.sqrt(1.0 - np.minimum(radius / distance, 1.0) ** 2)
    cosine = 1.0 - u * (1.0 - least)
    half = radius**2 - distance**2 * np.maximum(1.0 - cosine * cosine, 0.0)
    return _turned(towards, _polar(cosine, v)), distance * cosine - np.sqrt(np.maximum(half, 0.0))


def from_matt(normal: FloatArray, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions (n, 3) as often as their cosines, and these."""
    cosine = np.sqrt(1.0 - u)
    return _turned(normal, _polar(cosine, v)), cosine


def _masking(cosine: FloatArray, alpha: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (np.sqrt(1.0 + alpha * alpha * (1.0 / (cosine * cosine) - 1.0)) - 1.0))


def _facets(cosine: FloatArray, alpha: FloatArray) -> FloatArray:
    return np.asarray(alpha * alpha / (np.pi * (cosine * cosine * (alpha * alpha - 1.0) + 1.0) ** 2))


def albedo(table: FloatArray, cosine: FloatArray, alpha: FloatArray) -> FloatArray:
    """(n,): how much rough white metals return at one reflection, between the entries of the table."""
    last = ALBEDO_STEPS - 1
    y, x = np.clip(alpha, 0.0, 1.0) * last, np.clip(cosine, 0.0, 1.0) * last
    i, j = np.minimum(y.astype(int), last - 1), np.minimum(x.astype(int), last - 1)
    fy, fx = y - i, x - j
    upper = (1.0 - fx) * table[i, j] + fx * table[i, j + 1]
    lower = (1.0 - fx) * table[i + 1, j] + fx * table[i + 1, j + 1]
    return np.asarray((1.0 - fy) * upper + fy * lower)


def glint(light: FloatArray, seen: FloatArray, slant: FloatArray, alpha: FloatArray) -> FloatArray:
    """(n,): what white metals return of lights, by the cosines of light, viewer and facet to the normal."""
    there = (light > 0.0) & (seen > 0.0)
    light, seen = np.where(there, light, 1.0), np.where(there, seen, 1.0)
    masked = 1.0 + _masking(light, alpha) + _masking(seen, alpha)
    return np.where(there, np.pi * _facets(slant, alpha) / (4.0 * seen * masked), 0.0)


def from_metal(
    normal: FloatArray, view: FloatArray, alpha: FloatArray, u: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Directions (n, 3) that facets mirror viewing rays in; their shares, cosines on the facet, and densities (n,)."""
    across, along = _basis(normal)
    local = -np.stack([np.einsum('ni,ni->n', axis, view) for axis in (across, along, normal)], axis=1)
    local[:, 2] = np.maximum(local[:, 2], 1e-6)
    stretch = np.stack([alpha, alpha, np.ones_like(alpha)], axis=1)
    stretched = unit(local * stretch)
    up = (1.0 - v) * (1.0 + stretched[:, 2]) - stretched[:, 2]
    facet = unit((_polar(up, u) + stretched) * stretch)
    cosine = np.einsum('ni,ni->n', local, facet)
    out = 2.0 * cosine[:, None] * facet - local
    above = out[:, 2] > 0.0
    seen = 1.0 + _masking(local[:, 2], alpha)
    share = np.where(above, seen / (seen + _masking(np.where(above, out[:, 2], 1.0), alpha)), 0.0)
    return _turned(normal, out), share, cosine, _facets(facet[:, 2], alpha) / (4.0 * local[:, 2] * seen)


# -- pictures ---------------------------------------------------------------------------------------------------------


def _bilinear(data: SurfaceData, picture: IntArray, level: IntArray, u: FloatArray, v: FloatArray) -> FloatArray:
    at = data.level_start[picture] + level
    columns, rows, start = data.columns[at], data.rows[at], data.texel_start[at]
    x, y = u * columns - 0.5, (1.0 - v) * rows - 0.5
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - i)[:, None], (y - j)[:, None]
    ends = data.clamped[picture]
    below = ends | (picture == data.environment)

    def column(k: IntArray) -> IntArray:
        return np.where(ends, np.clip(k, 0, columns - 1), k % columns)

    def row(k: IntArray) -> IntArray:
        return np.where(below, np.clip(k, 0, rows - 1), k % rows)

    a, b, c, d = (
        data.texels[start + row(j + dj) * columns + column(i + di)].astype(np.float64) for dj in (0, 1) for di in (0, 1)
    )
    return np.asarray((1 - fx) * (1 - fy) * a + fx * (1 - fy) * b + (1 - fx) * fy * c + fx * fy * d)


def filtered(data: SurfaceData, picture: IntArray, width: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """(n, 3): pictures (n,) under spots of so many of their pixels, at u to the right and v up, 0..1."""
    last = data.level_start[picture + 1] - data.level_start[picture] - 1
    level = np.minimum(np.log2(np.maximum(width, 1.0)), last)
    whole = level.astype(int)
    lower = _bilinear(data, picture, whole, u, v)
    upper = _bilinear(data, picture, np.minimum(whole + 1, last), u, v)
    return np.asarray(lower + (level - whole)[:, None] * (upper - lower))


def texture_colours(
    data: SurfaceData, leaf: IntArray, points: FloatArray, normal: FloatArray, view: FloatArray, width: FloatArray
) -> FloatArray:
    """(n, 3): the factors of the colours at places of leaves; 1 without a texture.

    points : (n, 3) metres; normal, view : (n, 3) unit, scene frame; width : (n,) of the pixels there, metres.
    """
    factors = np.ones((len(leaf), 3))
    textured = np.flatnonzero(data.picture[leaf] != NO_PICTURE)
    for k in np.unique(leaf[textured]):
        mine = textured[leaf[textured] == k]
        factors[mine] = _on_leaf(data, int(k), points[mine], normal[mine], view[mine], width[mine])
    return factors


def _on_leaf(
    data: SurfaceData, leaf: int, points: FloatArray, normal: FloatArray, view: FloatArray, width: FloatArray
) -> FloatArray:
    mapping, matrix, size = data.mapping[leaf], data.to_texture[leaf], data.size[leaf]
    place = points @ matrix[:, :3].T + matrix[:, 3]
    side = _sides(mapping, normal @ data.normal_to_texture[leaf].T)
    across = np.cross(normal, view)
    straight = np.linalg.norm(across, axis=1) < 1e-9
    x, y, z = normal.T
    zero = np.zeros_like(x)
    other = np.where((np.abs(x) < 0.6)[:, None], np.stack([zero, z, -y], axis=1), np.stack([z, zero, -x], axis=1))
    across = unit(np.where(straight[:, None], other, across))
    stretch = width / np.maximum(np.abs(np.einsum('ni,ni->n', normal, view)), 1e-6)
    steps = [
        vectors @ matrix[:, :3].T for vectors in (across * width[:, None], np.cross(normal, across) * stretch[:, None])
    ]
    if mapping == CYLINDRICAL:
        around = TURN * np.maximum(place[:, 0] ** 2 + place[:, 1] ** 2, 1e-30)
        uv = np.stack([np.arctan2(place[:, 1], place[:, 0]) / TURN, place[:, 2] / size[0]], axis=1)
        steps = [
            np.stack([(place[:, 0] * s[:, 1] - place[:, 1] * s[:, 0]) / around, s[:, 2] / size[0]], axis=1)
            for s in steps
        ]
    else:
        scale = np.broadcast_to(size[:2], (len(side), 2))
        if mapping == SIDES:
            along = side % 3
            scale = np.abs(np.stack([size[np.where(along == 0, 1, 0)], size[np.where(along == 2, 1, 2)]], axis=1))
            place = place - np.minimum(size, 0.0)
        uv = _across(side, place) / scale
        if mapping == SIDES:
            uv[:, 0] += side % 2 == 1
        steps = [_across(side, s) / scale for s in steps]
    picture = data.picture[leaf] + (side if mapping == SIDES else np.zeros_like(side))
    at = data.level_start[picture]
    pixels = np.stack([data.columns[at], data.rows[at]], axis=1)
    first, second = (np.linalg.norm(s * pixels, axis=1) for s in steps)
    major, minor = np.maximum(first, second), np.minimum(first, second)
    long = np.where((first > second)[:, None], *steps)
    probes = np.clip(np.ceil(major / np.maximum(minor, 1.0)), 1, MOST_PROBES)
    spot = np.maximum(minor, major / probes)
    total: FloatArray = np.zeros((len(side), 3))
    for k in range(MOST_PROBES):
        step = (k + 0.5) / probes - 0.5
        looked = filtered(data, picture, spot, uv[:, 0] + step * long[:, 0], uv[:, 1] + step * long[:, 1])
        total += np.where((k < probes)[:, None], looked, 0.0)
    total /= probes[:, None]
    # The ends of what a picture goes around are left as they are.
    return np.asarray(np.where(((mapping == CYLINDRICAL) & (side % 3 == 2))[:, None], 1.0, total))


def _sides(mapping: int, normal: FloatArray) -> IntArray:
    """(n,): which sides of a box normals look to: 0..2 along +x, +y, +z, 3..5 against; of a plane always +z."""
    if mapping == PLANAR:
        return np.full(len(normal), 2)
    x, y, z = np.abs(normal).T
    along = np.where((z >= x) & (z >= y), 2, np.where(x >= y, 0, 1))
    return np.asarray(along + 3 * (normal[np.arange(len(normal)), along] < 0.0))


def _across(side: IntArray, vectors: FloatArray) -> FloatArray:
    """(n, 2): of vectors the parts to the right and up on sides of a box."""
    rows, along = np.arange(len(side)), side % 3
    right = vectors[rows, np.where(along == 0, 1, 0)] * np.where(side % 2 == 1, -1.0, 1.0)
    return np.stack([right, vectors[rows, np.where(along == 2, 1, 2)]], axis=1)
