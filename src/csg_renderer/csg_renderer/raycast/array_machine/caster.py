"""Array programs for ray casting solids: entry and exit of a ray in every PE, and appendix B's COMBINE.

Each PE holds one ray. A primitive gives one entry and one exit plane; lists of such planes are merged by the set
operators with masks, so that all rays of a tile take the same instructions (thesis 4.7, 4.8, appendix B). Boundaries
within a tolerance are one place and belong to the lowest code there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dap_emulator.machine import intrinsics as f
from dap_emulator.machine.arrays import DapArray, Operand
from dap_emulator.machine.dap import Dap
from dap_emulator.machine.kinds import LOGICAL, Kind, integer

from ..settings import FAR, NEVER, SHORT_WORD_ROUNDINGS, SHORT_WORD_TINY, TINY

CODES = integer(4)
INFINITE = float('inf')


@dataclass
class Spans:
    """Sorted boundaries of every ray, alternately entering and leaving; infinity where there are fewer.

    Attributes
    ----------
    t
        REAL planes.
    hit
        INTEGER*4 planes, whose boundary it is.
    """

    t: list[DapArray]
    hit: list[DapArray]


@dataclass
class Rays:
    """One ray a PE in some frame. origin : three numbers or REAL planes; direction : three REAL planes."""

    origin: tuple[Operand, ...]
    direction: tuple[DapArray, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows and columns of PEs."""
        return self.direction[0].shape


Boundary = tuple[DapArray, DapArray, Any, Any]  # enter, leave, face entered, face left


class Caster:
    """Intersections on one machine.

    Parameters
    ----------
    dap : Dap
        The machine that the work is charged to.
    kind : Kind
        Of the REALs, 4 to 8 bytes.
    tolerance : float
        Boundaries this close along a ray are one, metres.
    """

    def __init__(self, dap: Dap, kind: Kind, tolerance: float) -> None:
        self.dap, self.kind, self.tolerance = dap, kind, tolerance
        # The smallest direction component; its reciprocal must still be a number.
        self.tiny = TINY if kind.bits == 64 else SHORT_WORD_TINY
        # What rounding does to places, as a fraction of them; of the longest words the room's tolerances are larger.
        self.rounding = 0.0 if kind.bits == 64 else SHORT_WORD_ROUNDINGS * 2.0**-kind.mantissa

    def filled(self, value: float, shape: tuple[int, ...]) -> DapArray:
        """A REAL plane of one value."""
        return f.filled(self.dap, value, shape, self.kind)

    def localise(self, rays: Rays, m: Any, parallel: float) -> Rays:
        """Rays in the unit frame that m (3, 4) leads to; what is zero but for rounding becomes exactly so."""
        direction, origin = [], []
        for i in range(3):
            dx, dy, dz = rays.direction
            along: Any = m[i, 0] * dx + (m[i, 1] * dy + m[i, 2] * dz)
            limit = parallel * float(abs(m[i, :3]).sum())
            along.assign(self.tiny, abs(along) < limit)
            direction.append(along)
            reach = parallel * (1.0 + abs(float(m[i, 3])))
            ox, oy, oz = rays.origin
            at: Any = m[i, 0] * ox + m[i, 1] * oy + m[i, 2] * oz + m[i, 3]
            if isinstance(at, DapArray):
                for face in (0.0, 1.0):
                    at.assign(face, abs(at - face) < reach)
            else:
                at = float(round(at)) if abs(at - round(at)) < reach else float(at)
            origin.append(at)
        return Rays(tuple(origin), tuple(direction))

    def leaf(self, kind: str, first_code: int, rays: Rays) -> Spans:
        """Entry and exit with a primitive in its unit frame (thesis Table 4.1); codes are first_code + face."""
        if kind == 'BLOCK':
            found = self._slab(rays, 0, 0)
            for axis in (1, 2):
                found = self._meet(found, self._slab(rays, axis, 2 * axis))
        elif kind == 'CYLINDER':
            found = self._meet(self._slab(rays, 2, 0), self._between(*self._quadratic(rays, (1, 1, 0), 1.0), 2))
        elif kind == 'SPHERE':
            found = self._between(*self._quadratic(rays, (1, 1, 1), 1.0), 0)
        elif kind == 'CONE':
            found = self._cone(rays)
        elif kind != 'PLANE':
            raise ValueError(f"engine: 'dap' has no array program for a {kind}")
        else:
            t = -rays.origin[2] / rays.direction[2]
            falling = rays.direction[2] < 0.0
            found = (f.merge(t, -FAR, falling), f.merge(FAR, t, falling), 0, 0)
        enter, leave, face_in, face_out = found
        present = leave - enter > self.tolerance
        planes = [self._code(face, first_code, present.shape) for face in (face_in, face_out)]
        return Spans([f.merge(enter, INFINITE, present), f.merge(leave, INFINITE, present)], planes)

    def _code(self, face: Any, first_code: int, shape: tuple[int, ...]) -> DapArray:
        if isinstance(face, DapArray):
            return face + first_code
        return f.filled(self.dap, face + first_code, shape, CODES)

    def _faces(self, one: Any, other: Any, mask: DapArray) -> DapArray:
        """Face numbers: those of ``one`` where the mask is true, else of ``other``."""
        if not isinstance(one, DapArray) and not isinstance(other, DapArray):
            one = f.filled(self.dap, one, mask.shape, CODES)
        merged: DapArray = f.merge(one, other, mask)
        return merged

    def _slab(self, rays: Rays, axis: int, face: int) -> Boundary:
        """0 <= coordinate <= 1: faces ``face`` (at 0) and ``face + 1`` (at 1)."""
        o, d = rays.origin[axis], rays.direction[axis]
        inverse = 1.0 / d
        at_0, at_1 = (0.0 - o) * inverse, (1.0 - o) * inverse
        rising = d > 0.0
        return (
            f.merge(at_0, at_1, rising),
            f.merge(at_1, at_0, rising),
            self._faces(face, face + 1, rising),
            self._faces(face + 1, face, rising),
        )

    def _meet(self, first: Boundary, second: Boundary) -> Boundary:
        """The common part of two convex spans. Equal ends keep the first's face."""
        later, sooner = second[0] > first[0], second[1] < first[1]
        return (
            f.merge(second[0], first[0], later),
            f.merge(second[1], first[1], sooner),
            self._faces(second[2], first[2], later),
            self._faces(second[3], first[3], sooner),
        )

    def _quadratic(self, rays: Rays, signs: tuple[int, int, int], constant: float) -> tuple[Any, Any, Any]:
        """a, b, c of a t^2 + 2 b t + c for x^2 s0 + y^2 s1 + z^2 s2 - constant."""

        def total(pairs: list[tuple[int, Any]]) -> Any:
            result: Any = None
            for sign, product in pairs:
                if sign:
                    result = product * sign if result is None else result + product if sign > 0 else result - product
            return result

        o, d = rays.origin, rays.direction
        a = total([(s, d[k] * d[k]) for k, s in enumerate(signs) if s])
        b = total([(s, o[k] * d[k]) for k, s in enumerate(signs) if s])
        c = total([(s, o[k] * o[k]) for k, s in enumerate(signs) if s]) - constant
        return a, b, c

    def _roots(self, a: DapArray, b: DapArray, c: Any) -> tuple[DapArray, DapArray, DapArray]:
        """Both roots without cancellation, and where they are real and distinct."""
        discriminant = b * b - a * c
        real = discriminant > 0.0
        root = f.sqrt(f.merge(discriminant, 1.0, real))
        q = -(b + f.sign(root, b))
        q.assign(self.tiny, q.compare('eq', 0.0))
        safe = f.merge(self.tiny, a, abs(a) < self.tiny)
        return q / safe, c / q, real

    def _between(self, a: DapArray, b: DapArray, c: Any, face: int) -> Boundary:
        """Where a t^2 + 2 b t + c <= 0, a >= 0; a ray along a cylinder's axis is inside it always or never."""
        along = a < self.tiny
        first, second, real = self._roots(f.merge(1.0, a, along), b, c)
        enter = f.merge(f.minimum(first, second), INFINITE, real)
        leave = f.merge(f.maximum(first, second), -INFINITE, real)
        if f.any_(along):
            inside = c < 0.0
            if isinstance(inside, DapArray):
                enter.assign(f.merge(self.filled(-FAR, a.shape), INFINITE, inside), along)
                leave.assign(f.merge(self.filled(FAR, a.shape), -INFINITE, inside), along)
            else:
                enter.assign(-FAR if inside else INFINITE, along)
                leave.assign(FAR if inside else -INFINITE, along)
        return enter, leave, face, face

    def _cone(self, rays: Rays) -> Boundary:
        """x^2 + y^2 <= z^2 and 0 <= z <= 1: of the double cone only the upper nappe, in which a ray has one span."""
        a, b, c = self._quadratic(rays, (1, 1, -1), 0.0)
        first, second, real = self._roots(a, b, c)
        low, high = f.minimum(first, second), f.maximum(first, second)
        oz, dz = rays.origin[2], rays.direction[2]
        rising = dz > 0.0
        at_base, at_apex = (1.0 - oz) / dz, (0.0 - oz) / dz
        # A steep ray is inside before one root and after the other; going up only the second part is in the nappe.
        steep = a < 0.0
        enter = f.merge(f.merge(high, -FAR, rising), low, steep)
        leave = f.merge(f.merge(FAR, low, rising), high, steep)
        apex = steep & ~real
        enter.assign(at_apex, apex & rising)
        leave.assign(at_apex, apex & ~rising)
        missed = ~(real | steep)
        slab = (
            f.merge(at_apex, at_base, rising),
            f.merge(at_base, at_apex, rising),
            self._faces(1, 0, rising),
            self._faces(0, 1, rising),
        )
        enter, leave, face_in, face_out = self._meet((enter, leave, 1, 1), slab)
        enter.assign(INFINITE, missed)
        leave.assign(-INFINITE, missed)
        return enter, leave, face_in, face_out

    def combine(self, operator: str, left: Spans, right: Spans) -> Spans:
        """UNION, INTERSECT or DIFFERENCE of two lists (thesis Table 4.2)."""
        t, hit, is_left = self._merged(left, right)
        shape = t[0].shape
        no = f.filled(self.dap, False, shape, LOGICAL)
        inside_left = inside_right = inside = no
        count = f.filled(self.dap, 0, shape, CODES)
        start, best_t = self.filled(-INFINITE, shape), self.filled(0.0, shape)
        best_hit = f.filled(self.dap, 0, shape, CODES)
        out = Spans([], [])
        for column in range(len(t)):
            real = t[column] < INFINITE
            if not f.any_(real):
                break
            fresh = real & (t[column] - start > self.tolerance)
            start.assign(t[column], fresh)
            better = real & (fresh | (hit[column] < best_hit))
            best_t.assign(t[column], better)
            best_hit.assign(hit[column], better)
            inside_left = inside_left ^ (real & is_left[column])
            inside_right = inside_right ^ (real & ~is_left[column])
            last = real
            if column + 1 < len(t):
                last = real & (t[column + 1] - start > self.tolerance)
            if operator == 'UNION':
                now = inside_left | inside_right
            else:
                now = inside_left & (inside_right if operator == 'INTERSECT' else ~inside_right)
            changed = last & (now ^ inside)
            inside = inside ^ changed
            self._append(out, count, best_t, best_hit, changed)
        while len(out.t) < 2:
            out.t.append(self.filled(INFINITE, shape))
            out.hit.append(f.filled(self.dap, 0, shape, CODES))
        return out

    def _append(self, out: Spans, count: DapArray, t: DapArray, hit: DapArray, where: DapArray) -> None:
        """Push a boundary onto the list of every PE where the mask is true; lists grow as planes are needed."""
        if not f.any_(where):
            return
        for place in range(len(out.t) + 1):
            here = where & count.compare('eq', place)
            if place == len(out.t):
                if not f.any_(here):
                    break
                out.t.append(self.filled(INFINITE, t.shape))
                out.hit.append(f.filled(self.dap, 0, t.shape, CODES))
            out.t[place].assign(t, here)
            out.hit[place].assign(hit, here)
        count.assign(count + 1, where)

    def _merged(self, left: Spans, right: Spans) -> tuple[list[DapArray], list[DapArray], list[DapArray]]:
        """Both lists as one in ascending order, by exchanging neighbours; equal ones keep the left list's first."""
        shape = left.t[0].shape
        t, hit = list(left.t), list(left.hit)
        flags = [f.filled(self.dap, True, shape, LOGICAL) for _ in left.t]
        for new_t, new_hit in zip(right.t, right.hit):
            t.append(new_t)
            hit.append(new_hit)
            flags.append(f.filled(self.dap, False, shape, LOGICAL))
            for place in range(len(t) - 1, 0, -1):
                swap = t[place - 1] > t[place]
                if not f.any_(swap):
                    break
                for planes in (t, hit, flags):
                    before, after = planes[place - 1], planes[place]
                    planes[place - 1], planes[place] = f.merge(after, before, swap), f.merge(before, after, swap)
        return t, hit, flags

    def first_hit(self, spans: Spans, nearest: float, entries_only: bool) -> tuple[DapArray, DapArray, DapArray]:
        """Place (infinite on a miss), code and "enters there" of the first boundary beyond ``nearest``."""
        shape = spans.t[0].shape
        t = self.filled(INFINITE, shape)
        hit = f.filled(self.dap, -1, shape, CODES)
        entering = f.filled(self.dap, True, shape, LOGICAL)
        for column in reversed(range(0, len(spans.t), 2 if entries_only else 1)):
            usable = (spans.t[column] > nearest) & (spans.t[column] < NEVER)
            t.assign(spans.t[column], usable)
            hit.assign(spans.hit[column], usable)
            entering.assign(column % 2 == 0, usable)
        return t, hit, entering
