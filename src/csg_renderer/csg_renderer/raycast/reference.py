"""The reference engine: plain vectorised numpy, written to be read. Tests hold the fast engines against it.

Every child of the scene (see program.py) is evaluated for a bundle of rays by walking its postfix program: a leaf
pushes its entry and exit along each ray, an operator merges the two lists on top of the stack (thesis 4.8,
appendix B; Roth 1982). Boundaries closer together than the view's tolerance count as one place: it is a boundary of
the result only if the result differs before and after it, and it belongs to the lowest leaf index there. So touching
blocks have no seam, a face removed exactly by a subtracted primitive leaves no skin, and a ray that only touches
a solid misses it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias
from typing import cast as cast_to

import numpy as np

from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from ..scene.terrain import Terrain, first_crossing
from ..scene.terrain import gradient as slope
from .frame import FACE_SLOTS, MISS, RenderStats
from .programs.program import BLOCK, CONE, CYLINDER, HALFSPACES, INTERSECT, PLANE, SPHERE, UNION, Program, View
from .settings import APEX, FAR, NEVER, PARALLEL, TINY

# One span of every ray: where it enters, where it leaves, the face there, each (n,).
Convex: TypeAlias = tuple[FloatArray, FloatArray, IntArray, IntArray]


@dataclass
class Spans:
    """Sorted boundaries along each of n rays: even columns enter, odd ones leave; padded with inf.

    Attributes
    ----------
    t : (n, k) float64
        Lengths along the rays.
    hit : (n, k) int64
        leaf * FACE_SLOTS + face.
    """

    t: np.ndarray
    hit: np.ndarray


@dataclass
class Hits:
    """The nearest boundary on each of n rays.

    Attributes
    ----------
    t : (n,) float64
        Length along the ray, inf on a miss.
    hit : (n,) int64
        leaf * FACE_SLOTS + face, or MISS.
    entering : (n,) bool
        The ray enters the solid there.
    """

    t: np.ndarray
    hit: np.ndarray
    entering: np.ndarray


def leaf_span(kind: int, leaf: int, origin: np.ndarray, direction: np.ndarray, transform: np.ndarray) -> Spans:
    """Entry and exit of rays with one primitive (thesis 4.7).

    Parameters
    ----------
    kind : int
        See KIND_CODES.
    leaf : int
        Its number, for the hits.
    origin, direction : (n, 3) array of float64
        Directions of length near 1, in the frame that ``transform`` takes to the unit frame.
    transform : (3, 4) array of float64

    Returns
    -------
    Spans
    """
    origin, direction = localise(origin, direction, transform)
    if kind == BLOCK:
        enter, leave, face_in, face_out = _slab(origin, direction, 0, 0)
        for axis in (1, 2):
            enter, leave, face_in, face_out = _meet(
                (enter, leave, face_in, face_out), _slab(origin, direction, axis, 2 * axis)
            )
    elif kind == CYLINDER:
        a, b, c = _quadratic(origin, direction, (1.0, 1.0, 0.0), 1.0)
        curved = _between(a, b, c, 2)
        enter, leave, face_in, face_out = _meet(_slab(origin, direction, 2, 0), curved)
    elif kind == SPHERE:
        a, b, c = _quadratic(origin, direction, (1.0, 1.0, 1.0), 1.0)
        enter, leave, face_in, face_out = _between(a, b, c, 0)
    elif kind == CONE:
        enter, leave, face_in, face_out = _cone(origin, direction)
    else:
        t = -origin[:, 2] / direction[:, 2]
        falling = direction[:, 2] < 0.0
        enter, leave = np.where(falling, t, -FAR), np.where(falling, FAR, t)
        face_in = face_out = np.zeros(len(t), dtype=np.int64)
    hit = leaf * FACE_SLOTS + np.stack([face_in, face_out], axis=1)
    empty = ~(leave > enter)
    return Spans(np.where(empty[:, None], np.inf, np.stack([enter, leave], axis=1)), hit)


def localise(origin: np.ndarray, direction: np.ndarray, transform: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rays in a unit frame, with what is zero but for rounding made exactly zero (origin) or TINY (direction).

    Parameters
    ----------
    origin, direction : (n, 3) array of float64
    transform : (3, 4) array of float64
        Unit frame from the rays' frame.

    Returns
    -------
    origin, direction : (n, 3) float64
        Unit frame.
    """
    m = transform
    local = np.stack(
        [m[i, 0] * direction[:, 0] + (m[i, 1] * direction[:, 1] + m[i, 2] * direction[:, 2]) for i in range(3)], axis=1
    )
    at = np.stack(
        [m[i, 0] * origin[:, 0] + m[i, 1] * origin[:, 1] + m[i, 2] * origin[:, 2] + m[i, 3] for i in range(3)], axis=1
    )
    local = np.where(np.abs(local) < PARALLEL * np.abs(m[:, :3]).sum(axis=1), TINY, local)
    nearest = np.round(at)
    reach = PARALLEL * (1.0 + np.abs(m[:, 3]))
    return np.where(np.abs(at - nearest) < reach, nearest, at), local


def _slab(origin: FloatArray, direction: FloatArray, axis: int, face: int) -> Convex:
    """The part of a ray with 0 <= coordinate <= 1; faces ``face`` (at 0) and ``face + 1`` (at 1)."""
    o, d = origin[:, axis], direction[:, axis]
    inverse = 1.0 / d
    at_0, at_1 = (0.0 - o) * inverse, (1.0 - o) * inverse
    rising = d > 0.0
    return (
        np.where(rising, at_0, at_1),
        np.where(rising, at_1, at_0),
        np.where(rising, face, face + 1),
        np.where(rising, face + 1, face),
    )


def _meet(first: Convex, second: Convex) -> Convex:
    """The common part of two convex spans. Equal ends keep the first's face."""
    enter_1, leave_1, in_1, out_1 = first
    enter_2, leave_2, in_2, out_2 = second
    later, sooner = enter_2 > enter_1, leave_2 < leave_1
    return (
        np.where(later, enter_2, enter_1),
        np.where(sooner, leave_2, leave_1),
        np.where(later, in_2, in_1),
        np.where(sooner, out_2, out_1),
    )


def _quadratic(
    origin: FloatArray, direction: FloatArray, signs: tuple[float, float, float], constant: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients of a t^2 + 2 b t + c for x^2 s0 + y^2 s1 + z^2 s2 - constant."""
    (ox, oy, oz), (dx, dy, dz) = origin.T, direction.T
    s0, s1, s2 = signs
    return (
        s0 * dx * dx + s1 * dy * dy + s2 * dz * dz,
        s0 * ox * dx + s1 * oy * dy + s2 * oz * dz,
        s0 * ox * ox + s1 * oy * oy + s2 * oz * oz - constant,
    )


def _roots(a: FloatArray, b: FloatArray, c: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Both roots of a t^2 + 2 b t + c without cancellation, and whether they are real and distinct."""
    discriminant = b * b - a * c
    real = discriminant > 0.0
    q = -(b + np.copysign(np.sqrt(np.where(real, discriminant, 1.0)), b))
    q = np.where(q == 0.0, TINY, q)
    return q / np.where(np.abs(a) < TINY, TINY, a), c / q, real


def _between(a: FloatArray, b: FloatArray, c: FloatArray, face: int) -> Convex:
    """Where a t^2 + 2 b t + c <= 0 with a >= 0; a ray along a cylinder's axis is inside it always or never."""
    along = a < TINY
    first, second, real = _roots(np.where(along, 1.0, a), b, c)
    enter = np.where(real, np.minimum(first, second), np.inf)
    leave = np.where(real, np.maximum(first, second), -np.inf)
    inside = c < 0.0
    enter = np.where(along, np.where(inside, -FAR, np.inf), enter)
    leave = np.where(along, np.where(inside, FAR, -np.inf), leave)
    faces = np.full(len(a), face, dtype=np.int64)
    return enter, leave, faces, faces


def _cone(origin: FloatArray, direction: FloatArray) -> Convex:
    """x^2 + y^2 <= z^2 and 0 <= z <= 1. Only the nappe above the apex counts, and in it a ray has one span."""
    a, b, c = _quadratic(origin, direction, (1.0, 1.0, -1.0), 0.0)
    first, second, real = _roots(a, b, c)
    low, high = np.minimum(first, second), np.maximum(first, second)
    oz, dz = origin[:, 2], direction[:, 2]
    rising = dz > 0.0
    at_base, at_apex = (1.0 - oz) / dz, (0.0 - oz) / dz
    # A steep ray (a < 0) is inside before one root and after the other: after it going up, before it going down.
    steep = a < 0.0
    enter = np.where(steep, np.where(rising, high, -FAR), low)
    leave = np.where(steep, np.where(rising, FAR, low), high)
    # A steep ray through the apex itself has no distinct roots; it is inside from there on.
    apex = steep & ~real
    enter = np.where(apex & rising, at_apex, enter)
    leave = np.where(apex & ~rising, at_apex, leave)
    missed = ~real & ~steep
    curved = np.ones(len(a), dtype=np.int64)
    base = np.zeros(len(a), dtype=np.int64)
    # The plane through the apex only chooses the nappe: no ray enters there, but rounding may say so.
    slab = (
        np.where(rising, at_apex, at_base),
        np.where(rising, at_base, at_apex),
        np.where(rising, curved, base),
        np.where(rising, base, curved),
    )
    enter, leave, face_in, face_out = _meet((enter, leave, curved, curved), slab)
    return np.where(missed, np.inf, enter), np.where(missed, -np.inf, leave), face_in, face_out


def combine(operator: int, left: Spans, right: Spans, tolerance: float) -> Spans:
    """Two lists of boundaries merged by a set operator (thesis Table 4.2).

    Parameters
    ----------
    operator : int
        UNION, INTERSECT or DIFFERENCE.
    left, right : Spans
        Of the same rays.
    tolerance : float
        Boundaries this close along a ray are one.

    Returns
    -------
    Spans
    """
    n = len(left.t)
    t = np.concatenate([left.t, right.t], axis=1)
    hit = np.concatenate([left.hit, right.hit], axis=1)
    is_left = np.concatenate([np.ones(left.t.shape, bool), np.zeros(right.t.shape, bool)], axis=1)
    order = np.argsort(t, axis=1, kind='stable')
    t, hit, is_left = (np.take_along_axis(array, order, axis=1) for array in (t, hit, is_left))
    width = max(2, int(np.isfinite(t).sum(axis=1).max(initial=0)))
    out = Spans(np.full((n, width), np.inf), np.zeros((n, width), dtype=np.int64))
    inside_left, inside_right, inside = (np.zeros(n, bool) for _ in range(3))
    count = np.zeros(n, dtype=np.int64)
    start = np.full(n, -np.inf)
    best_t, best_hit = np.zeros(n), np.zeros(n, dtype=np.int64)
    rows = np.arange(n)
    for column in range(min(width, t.shape[1])):
        here, code = t[:, column], hit[:, column]
        real = np.isfinite(here)
        fresh = real & ~(here - start <= tolerance)
        start = np.where(fresh, here, start)
        better = real & (fresh | (code // FACE_SLOTS < best_hit // FACE_SLOTS))
        best_t, best_hit = np.where(better, here, best_t), np.where(better, code, best_hit)
        inside_left ^= real & is_left[:, column]
        inside_right ^= real & ~is_left[:, column]
        following = t[:, column + 1] if column + 1 < t.shape[1] else np.full(n, np.inf)
        last = real & ~(following - start <= tolerance)
        if operator == UNION:
            now = inside_left | inside_right
        elif operator == INTERSECT:
            now = inside_left & inside_right
        else:
            now = inside_left & ~inside_right
        changed = last & (now != inside)
        out.t[rows[changed], count[changed]] = best_t[changed]
        out.hit[rows[changed], count[changed]] = best_hit[changed]
        count += changed
        inside = np.where(last, now, inside)
    used = max(2, int(count.max(initial=0)))
    return Spans(out.t[:, :used], out.hit[:, :used])


def child_spans(
    program: Program,
    code: np.ndarray,
    origin: np.ndarray,
    direction: np.ndarray,
    transforms: np.ndarray,
    tolerance: float,
    stats: RenderStats,
) -> Spans:
    """Boundaries of one child along rays.

    Parameters
    ----------
    program : Program
    code : (m,) array of int64
        The child's postfix program.
    origin, direction : (n, 3) array of float64
    transforms : (leaves, 3, 4) array of float64
        Unit frames from the rays' frame.
    tolerance : float
        Boundaries this close along a ray are one.
    stats : RenderStats
        What is done is counted here.

    Returns
    -------
    Spans
    """
    stack: list[Spans] = []
    for op in code:
        stats.nodes += len(direction)
        if op >= 0:
            kind = int(program.kind[op])
            stats.intersections += len(direction) * int(HALFSPACES[kind])
            stack.append(_regular(leaf_span(kind, int(op), origin, direction, transforms[op]), tolerance))
        else:
            stats.combines += len(direction)
            right, left = stack.pop(), stack.pop()
            stack.append(combine(int(op), left, right, tolerance))
    return stack[0]


def _regular(spans: Spans, tolerance: float) -> Spans:
    """Without the spans thinner than the tolerance."""
    with np.errstate(invalid='ignore'):
        thin = ~(spans.t[:, 1::2] - spans.t[:, 0::2] > tolerance)
    return Spans(np.where(np.repeat(thin, 2, axis=1), np.inf, spans.t), spans.hit)


def first_hits(spans: Spans, nearest: float, entries_only: bool) -> Hits:
    """The first boundary beyond some length on every ray. The end of what never ends is none.

    Parameters
    ----------
    spans : Spans
    nearest : float
        Length along the rays.
    entries_only : bool
        Exits do not count.

    Returns
    -------
    Hits
    """
    usable = (spans.t > nearest) & (spans.t < NEVER)
    if entries_only:
        usable[:, 1::2] = False
    t = np.where(usable, spans.t, np.inf)
    column = np.argmin(t, axis=1)
    rows = np.arange(len(t))
    t = t[rows, column]
    return Hits(t, np.where(np.isfinite(t), spans.hit[rows, column], MISS), column % 2 == 0)


def nearest_of(best: Hits, other: Hits, tolerance: float) -> Hits:
    """The nearer hit of two on every ray; within the tolerance, the lower leaf's.

    Parameters
    ----------
    best, other : Hits
        On the same rays.
    tolerance : float
        Lengths along the rays.

    Returns
    -------
    Hits
    """
    with np.errstate(invalid='ignore'):
        difference = other.t - best.t
    lower = other.hit // FACE_SLOTS < best.hit // FACE_SLOTS
    better = np.isfinite(other.t) & (
        ~np.isfinite(best.t) | (difference < -tolerance) | ((np.abs(difference) <= tolerance) & lower)
    )
    return Hits(
        np.where(better, other.t, best.t),
        np.where(better, other.hit, best.hit),
        np.where(better, other.entering, best.entering),
    )


def cast(
    view: View,
    children: Iterable[IntArray],
    terrains: Iterable[int],
    origin: np.ndarray,
    direction: np.ndarray,
    transforms: np.ndarray,
    nearest: float,
    entries_only: bool,
    stats: RenderStats,
) -> Hits:
    """The nearest boundary of some children and terrains along rays.

    Parameters
    ----------
    view : View
    children : iterable of (m,) array of int64
        Their postfix programs.
    terrains : iterable of int
        Their leaves.
    origin, direction : (n, 3) array of float64
    transforms : (leaves, 3, 4) array of float64
        Unit frames from the rays' frame.
    nearest : float
        Length along the rays beyond which boundaries count.
    entries_only : bool
        Exits do not count.
    stats : RenderStats
        What is done is counted here.

    Returns
    -------
    Hits
    """
    n = len(direction)
    best = Hits(np.full(n, np.inf), np.full(n, MISS, dtype=np.int64), np.ones(n, bool))
    for code in children:
        spans = child_spans(view.program, code, origin, direction, transforms, view.tolerance, stats)
        best = nearest_of(best, first_hits(spans, nearest, entries_only), view.tolerance)
    for leaf in terrains:
        t = _meet_terrain(view, leaf, origin, direction, transforms[leaf], nearest, np.inf)
        hit = np.where(np.isfinite(t), leaf * FACE_SLOTS, MISS)
        best = nearest_of(best, Hits(t, hit, np.ones(n, bool)), view.tolerance)
    return best


def _meet_terrain(
    view: View,
    leaf: int,
    origin: FloatArray,
    direction: FloatArray,
    transform: FloatArray,
    nearest: float,
    farthest: FloatArray | float,
) -> FloatArray:
    """(n,) where rays meet a terrain; transform (3, 4) takes their frame to the grid's."""
    terrain = cast_to(Terrain, view.program.leaves[leaf])
    at = np.broadcast_to(origin @ transform[:, :3].T + transform[:, 3], direction.shape)
    return first_crossing(terrain, at, direction @ transform[:, :3].T, nearest, farthest)


def transmission(
    view: View, origin: np.ndarray, direction: np.ndarray, distance: np.ndarray, stats: RenderStats
) -> np.ndarray:
    """How much light comes along rays: the product of the transparencies of what stands in the way.

    Parameters
    ----------
    view : View
    origin, direction : (n, 3) array of float64
        Scene frame; directions are unit vectors.
    distance : (n,) array of float64
        Lengths of the rays, metres.
    stats : RenderStats
        What is done is counted here.

    Returns
    -------
    (n,) float64
        0..1.
    """
    light = np.ones(len(direction))
    transparency = view.program.material[:, 5]
    for code in view.program.children:
        spans = child_spans(view.program, code, origin, direction, view.program.inverse[:, :3], view.tolerance, stats)
        for column in range(0, spans.t.shape[1], 2):
            # An empty place has inf for its entry, so it blocks nothing.
            blocked = (spans.t[:, column] < distance - view.departure) & (spans.t[:, column + 1] > view.departure)
            light = np.where(blocked, light * transparency[spans.hit[:, column] // FACE_SLOTS], light)
    for leaf in view.program.terrains:
        t = _meet_terrain(
            view, leaf, origin, direction, view.program.inverse[leaf, :3], view.departure, distance - view.departure
        )
        light = np.where(np.isfinite(t), light * transparency[leaf], light)
    return light


def normals(
    program: Program, hit: np.ndarray, points: np.ndarray, direction: np.ndarray, entering: np.ndarray
) -> np.ndarray:
    """Outward normals of the solid at boundaries.

    Where a ray enters, the outward normal faces it, whichever side of the leaf the boundary is: that turns the normals
    of cut faces the right way.

    Parameters
    ----------
    program : Program
    hit : (n,) array of int64
        leaf * FACE_SLOTS + face.
    points, direction : (n, 3) array of float64
        Places, metres, and viewing rays, scene frame.
    entering : (n,) array of bool
        The ray enters the solid there.

    Returns
    -------
    (n, 3) float64
        Unit, scene frame.
    """
    leaf, face = hit // FACE_SLOTS, hit % FACE_SLOTS
    inverse = program.inverse[leaf]
    local = np.einsum('nij,nj->ni', inverse[:, :3, :3], points) + inverse[:, :3, 3]
    gradient = np.zeros_like(local)
    kind = program.kind[leaf]
    rows = np.arange(len(leaf))
    block = kind == BLOCK
    gradient[rows[block], face[block] // 2] = 1.0
    flat = ((kind == CYLINDER) & (face < 2)) | ((kind == CONE) & (face == 0)) | (kind == PLANE)
    gradient[flat, 2] = 1.0
    gradient = np.where((kind == SPHERE)[:, None], local, gradient)
    gradient = np.where(((kind == CYLINDER) & (face == 2))[:, None], local * [1.0, 1.0, 0.0], gradient)
    gradient = np.where(((kind == CONE) & (face == 1))[:, None], local * [1.0, 1.0, -1.0], gradient)
    for terrain in program.terrains:
        mine = leaf == terrain
        gradient[mine] = slope(cast_to(Terrain, program.leaves[terrain]), local[mine])
    normal = np.einsum('nji,nj->ni', inverse[:, :3, :3], gradient)
    # At a cone's apex the gradient vanishes and its direction is rounding; the apex faces everybody.
    apex = (np.einsum('ni,ni->n', gradient, gradient) < APEX)[:, None]
    normal = np.where(apex, -direction, normal)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    facing = np.einsum('ni,ni->n', normal, direction) < 0.0
    return np.where((facing == entering)[:, None], normal, -normal)
