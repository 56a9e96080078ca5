"""Validation of interpretations as an array program (thesis 5.6, 5.9, 6.7): many of them and all edges at once.

Every interpretation has four rows of PEs and every data feature a column: a row is a component of a vector, or of a
quaternion. 4 x 4 matrices are kept as four columns, each a vector over the rows of all interpretations, so that a step
of Jacobi's process or of the elimination is done for all of them together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dap_emulator import Dap, DapArray
from dap_emulator.machine import intrinsics as f
from dap_emulator.machine.kinds import LOGICAL
from msgs_py import BIN, FeatureKind, FeatureSet, Pose
from msgs_py.numeric.typed import BoolArray, FloatArray, Int8Array, IntArray

from ..model.index import ModelIndex, feature_rows
from .absolute_pose import Validation, proper, validate
from .array_ranges import Word
from .array_tables import Phase
from .settings import JACOBI_ROUNDINGS, PIVOT_ROUNDINGS, SWEEPS

PHASES = (Phase.VALIDATION_SET_UP, Phase.ROTATION, Phase.JACOBI, Phase.TRANSLATION_AND_SCALE, Phase.TEST)


class Limits(NamedTuple):
    """What a feature must keep to: end points (metres), radii (metres); scale_free : estimate a scale, too."""

    deviation: float
    radius: float
    scale_free: bool = False


@dataclass(eq=False)
class ArrayValidation:
    """Poses and verdicts of m interpretations of n data features.

    Attributes
    ----------
    poses : list of Pose
        camera_T_model of each.
    deviations : (m, n) float64
        The larger distance of a feature's end points from its model feature, metres; NaN where unmatched.
    passed : (m, n) bool
        Every limit is kept; True where unmatched.
    signs : (m, n) int8
        Direction signs; those that were 0 are read off the first rotation.
    determined : (m,) bool
        Rotation and translation are; a singular matrix leaves one of them open.
    """

    poses: list[Pose]
    deviations: FloatArray
    passed: BoolArray
    signs: Int8Array
    determined: BoolArray


def at_once(dap: Dap) -> int:
    """Interpretations that a machine validates together: the 4 x 4 matrices that its PEs hold (thesis 5.9: 64)."""
    return (dap.es // 4) ** 2


def validate_on_array(
    dap: Dap,
    index: ModelIndex,
    data: FeatureSet,
    assignments: IntArray,
    signs: Int8Array,
    limits: Limits,
    real_bytes: int,
) -> ArrayValidation:
    """Fit a pose to each interpretation and test every matched feature, on the machine.

    Parameters
    ----------
    dap : Dap
    index : ModelIndex
    data : FeatureSet
        n features, camera frame, metres.
    assignments : (m, n) int
        Model feature of each data feature, or BIN.
    signs : (m, n) int8
        Direction signs, 0 unknown.
    limits : Limits
    real_bytes : int
        Word length.

    Returns
    -------
    ArrayValidation

    References
    ----------
    Thesis 5.6, 5.9 and 6.7; O. D. Faugeras and M. Hebert (1986) for the rotation.
    """
    word, together = Word.of(real_bytes), at_once(dap)
    batches = [
        _Batch(dap, word, index, data, assignments[begin : begin + together], signs[begin : begin + together]).run(
            limits
        )
        for begin in range(0, len(assignments), together)
    ]
    return ArrayValidation(
        [pose for batch in batches for pose in batch.poses],
        *(
            np.concatenate([getattr(batch, name) for batch in batches])
            for name in ('deviations', 'passed', 'signs', 'determined')
        ),
    )


class _Batch:
    """Interpretations validated together: matrices (4 m, n), vectors (4 m,)."""

    def __init__(
        self, dap: Dap, word: Word, index: ModelIndex, data: FeatureSet, assignments: IntArray, signs: Int8Array
    ) -> None:
        self.dap, self.word = dap, word
        self.m, self.n = assignments.shape
        self.matched_host: BoolArray = assignments != BIN
        self.curves = data.kind == FeatureKind.CURVE
        with dap.at_line(Phase.VALIDATION_SET_UP):
            self._masks()
            self._place_data(data)
            self._place_model(index, data, assignments)
            self._place_signs(data, signs)

    # Set-up.

    def _masks(self) -> None:
        """Which rows are the first, second, third and fourth of their group: vectors and matrices."""
        place = np.arange(4 * self.m) % 4
        self.row = [self.dap.vector(place == k) for k in range(4)]
        self.rows = [f.matc(mask, self.n) for mask in self.row]
        self.curve = f.matr(self.dap.vector(self.curves), 4 * self.m)
        self.matched = self._by_group(self.matched_host)

    def _by_group(self, values: FloatArray | BoolArray) -> DapArray:
        """(m, n) values in all four rows of their groups."""
        repeated = np.repeat(values, 4, axis=0)
        kind = LOGICAL if repeated.dtype == bool else self.word.kind
        loaded = self.dap.matrix(repeated, kind)
        loaded.charge('store_element', kind, times=self.m * self.n)
        return loaded

    def _zeros(self) -> DapArray:
        return f.filled(self.dap, 0.0, (4 * self.m, self.n), self.word.kind)

    def _components(self, points: FloatArray) -> DapArray:
        """(n, 3) data: components along the rows of every group."""
        placed = self._zeros()
        for k in range(3):
            placed.assign(f.matr(self.dap.vector(points[:, k], self.word.kind), 4 * self.m), self.rows[k])
        return placed

    def _place_data(self, data: FeatureSet) -> None:
        start, end = self._components(data.start), self._components(data.end)
        edge = end - start
        length = f.sqrt(self._total(edge * edge))
        self.direction = edge / length
        # A curve's centre is fitted to its model's centre; its end only gives the normal.
        end.assign(start, self.curve)
        self.ends = start, end
        self.data_radii = self._radii(data.radii)

    def _radii(self, radii: FloatArray) -> DapArray:
        """(n, 2) radii of data in the first two rows of each group; nothing where there is none."""
        placed = np.zeros((len(radii), 3))
        placed[:, :2] = np.nan_to_num(radii)
        return self._components(placed)

    def _place_model(self, index: ModelIndex, data: FeatureSet, assignments: IntArray) -> None:
        """The model feature of every pairing beside its data: element by element, by the control unit."""
        chosen = index.rows[np.where(self.matched_host, assignments, 0)]
        radii = np.nan_to_num(chosen[..., 7:9])

        def laid(values: FloatArray) -> DapArray:
            """(m, n, up to 3) components into the rows of the groups."""
            out = np.zeros((self.m, 4, self.n))
            out[:, : values.shape[2]] = values.transpose(0, 2, 1)
            loaded = self.dap.matrix(out.reshape(4 * self.m, self.n), self.word.kind)
            moved = self.m * self.n * values.shape[2]
            self.dap.charge('fetch', self.word.kind, (len(index),), times=moved)
            loaded.charge('store_element', self.word.kind, times=moved)
            return loaded

        self.middle, self.model_direction = laid(chosen[..., :3]), laid(chosen[..., 3:6])
        self.half = self._by_group(chosen[..., 6])
        self.model_radii = laid(radii)

    def _place_signs(self, data: FeatureSet, signs: Int8Array) -> None:
        """Without any sign, that of the longest edge may be chosen: the mirrored pose is another interpretation's."""
        self.given = signs
        signs = np.where(self.matched_host, signs, 0).astype(np.int8)
        rows = feature_rows(data)
        length = np.where(self.curves, 1.0, 2.0 * rows[:, 6])
        for k in np.flatnonzero(~signs.any(axis=1) & self.matched_host.any(axis=1)):
            signs[k, int(np.argmax(np.where(self.matched_host[k], length, -1.0)))] = 1
        self.signs_host = signs
        self.sign = self._by_group(signs.astype(float))

    # Steps within the groups of four rows.

    def _mask(self, x: DapArray, k: int) -> DapArray:
        return self.row[k] if x.rank == 1 else self.rows[k]

    def _spread(self, x: DapArray, k: int) -> DapArray:
        """Row k of each group, in all rows of the group."""
        out = x
        for place in range(4):
            if place != k:
                out = f.merge(x.neighbour(k - place), out, self._mask(x, place))
        return out

    def _total(self, x: DapArray) -> DapArray:
        """The sum of the four rows of each group, in all of them: two exchanges of neighbours."""
        odd = self._mask(x, 1) | self._mask(x, 3)
        x = x + f.merge(x.neighbour(-1), x.neighbour(1), odd)
        lower = self._mask(x, 2) | self._mask(x, 3)
        total: DapArray = x + f.merge(x.neighbour(-2), x.neighbour(2), lower)
        return total

    def _summed(self, x: DapArray) -> DapArray:
        """A matrix summed over the matched features: a vector."""
        return f.sumc(f.merge(x, 0.0, self.matched))

    def _wide(self, vector: DapArray) -> DapArray:
        return f.matc(vector, self.n)

    def _chosen_rows(self, entries: Sequence[DapArray | float]) -> DapArray:
        """A vector or matrix whose rows in each group are those of up to four others."""
        first = next(entry for entry in entries if isinstance(entry, DapArray))
        out = f.filled(self.dap, 0.0, first.shape, self.word.kind)
        for k, entry in enumerate(entries):
            out.assign(entry, self._mask(first, k))
        return out

    # Rotation.

    def _rotation(self) -> list[list[DapArray]]:
        """R[i][j], vectors with one number in all rows of a group: the best rotation of all signed pairs."""
        columns = self._normal_matrix()
        with self.dap.at_line(Phase.JACOBI):
            quaternion = self._smallest_eigenvector(columns)
        w, x, y, z = (self._spread(quaternion, k) for k in range(4))
        xx, yy, zz = x * x, y * y, z * z
        xy, xz, yz, wx, wy, wz = x * y, x * z, y * z, w * x, w * y, w * z
        return [
            [1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy)],
            [2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - wx)],
            [2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy)],
        ]

    def _normal_matrix(self) -> list[DapArray]:
        """The four columns of B, the sum of A'A over the edges, with A q = d q - q m (thesis 5.6)."""
        turned = self.direction * self.sign
        signed = f.merge(self.model_direction, 0.0, self.sign.compare('ne', 0.0))
        less, more = turned - signed, turned + signed
        e = [self._spread(less, k) for k in range(3)]
        g = [self._spread(more, k) for k in range(3)]
        a = [
            self._chosen_rows([0.0, e[0], e[1], e[2]]),
            self._chosen_rows([-e[0], 0.0, g[2], -g[1]]),
            self._chosen_rows([-e[1], -g[2], 0.0, g[0]]),
            self._chosen_rows([-e[2], g[1], -g[0], 0.0]),
        ]
        entries: dict[tuple[int, int], DapArray] = {}
        for i in range(4):
            for j in range(i, 4):
                entries[i, j] = entries[j, i] = self._total(self._summed(a[i] * a[j]))
        return [self._chosen_rows([entries[i, j] for i in range(4)]) for j in range(4)]

    def _smallest_eigenvector(self, columns: list[DapArray]) -> DapArray:
        """Of every group's symmetric 4 x 4 matrix, by Jacobi's plane rotations; the eigenvalues are kept."""
        a = list(columns)
        v = [self._chosen_rows([1.0 if i == j else a[0] * 0.0 for i in range(4)]) for j in range(4)]
        beside = [~mask for mask in self.row]
        size = max(float(f.maxv(abs(column))) for column in a) or 1.0
        for _ in range(SWEEPS):
            left = max(float(f.maxv(abs(column), mask)) for column, mask in zip(a, beside))
            if left <= JACOBI_ROUNDINGS * self.word.epsilon * size:
                break
            for p in range(3):
                for q in range(p + 1, 4):
                    self._turn(a, v, p, q)
        values = [self._spread(a[k], k) for k in range(4)]
        best, smallest = v[0], values[0]
        for column, value in zip(v[1:], values[1:]):
            smaller = value < smallest
            best, smallest = f.merge(column, best, smaller), f.merge(value, smallest, smaller)
        self.eigenvalues = values
        return best

    def _turn(self, a: list[DapArray], v: list[DapArray], p: int, q: int) -> None:
        """One plane rotation of all matrices: what stands at (p, q) becomes zero."""
        across = self._spread(a[q], p)
        there = across.compare('ne', 0.0)
        theta = (self._spread(a[q], q) - self._spread(a[p], p)) / f.merge(2.0 * across, 1.0, there)
        t = f.sign(1.0, theta) / (abs(theta) + f.sqrt(theta * theta + 1.0))
        t = f.merge(t, 0.0, there)
        c = 1.0 / f.sqrt(t * t + 1.0)
        s = t * c
        for matrix in (a, v):
            matrix[p], matrix[q] = c * matrix[p] - s * matrix[q], s * matrix[p] + c * matrix[q]
        for k, column in enumerate(a):
            kept = c * column
            turned = f.merge(kept - s * column.neighbour(q - p), column, self.row[p])
            a[k] = f.merge(kept + s * column.neighbour(p - q), turned, self.row[q])

    def _turned(self, rotation: list[list[DapArray]], x: DapArray, back: bool = False) -> DapArray:
        """R x of every column, or R' x."""
        out: DapArray | None = None
        for j in range(3):
            column = self._chosen_rows([rotation[j][i] if back else rotation[i][j] for i in range(3)])
            product = self._wide(column) * self._spread(x, j)
            out = product if out is None else out + product
        assert out is not None
        return out

    def _read_signs(self, rotation: list[list[DapArray]]) -> None:
        """Signs that the search left unknown: those that the first rotation suggests (thesis 5.9)."""
        alike = self._total(self._turned(rotation, self.model_direction) * self.direction)
        unknown = self.sign.compare('eq', 0.0) & self.matched
        self.sign.assign(f.merge(1.0, f.filled(self.dap, -1.0, alike.shape, self.word.kind), alike >= 0.0), unknown)
        read = self.sign.numpy()[::4]
        self.signs_host = np.where(self.matched_host, np.sign(read), 0).astype(np.int8)

    # Translation and scale.

    def _translation(self, rotation: list[list[DapArray]], scale_free: bool) -> tuple[DapArray, BoolArray]:
        """Rows t_x, t_y, t_z and the scale of each group; and which groups have a regular matrix.

        Least squares of the distances of end points across their lines: unlike the thesis' foot vectors, singular only
        when all edges are parallel.
        """
        u = f.merge(0.0, self._turned(rotation, self.model_direction), self.curve)
        placed = self._turned(rotation, self.middle)
        both = self.ends[0] + self.ends[1]
        across = [self._spread(u, j) for j in range(3)]
        columns = []
        for j in range(3):
            unit = self._chosen_rows([2.0 if i == j else u * 0.0 for i in range(3)])
            columns.append(self._summed(unit - (2.0 * u) * across[j]))
        if not scale_free:
            gap = both - 2.0 * placed
            right = self._summed(gap - u * self._total(u * gap))
            solution, regular = self._eliminated(columns, right)
            return self._chosen_rows([solution, solution, solution, 1.0]), regular
        flat = placed - u * self._total(u * placed)
        shares = self._summed(2.0 * flat)
        columns = [self._chosen_rows([x, x, x, self._spread(shares, j)]) for j, x in enumerate(columns)]
        square = self._summed(2.0 * self._total(flat * placed))
        columns.append(self._chosen_rows([shares, shares, shares, square]))
        right = self._summed(both - u * self._total(u * both))
        right = self._chosen_rows([right, right, right, self._summed(self._total(flat * both))])
        return self._eliminated(columns, right)

    def _eliminated(self, columns: list[DapArray], right: DapArray) -> tuple[DapArray, BoolArray]:
        """Solve every group's equations by Gauss and Jordan's elimination; the matrix is symmetric and positive."""
        regular = np.ones(self.m, bool)
        sides = [*columns, right]
        least = PIVOT_ROUNDINGS * self.word.epsilon * self.n
        for k in range(len(columns)):
            pivot = self._spread(sides[k], k)
            usable = abs(pivot) > least
            regular &= usable.numpy()[::4]
            over = f.merge(1.0 / f.merge(pivot, 1.0, usable), 0.0, usable)
            factor = sides[k]
            for j in range(k + 1, len(sides)):
                top = self._spread(sides[j], k) * over
                sides[j] = f.merge(top, sides[j] - factor * top, self.row[k])
        return sides[-1], regular

    # The test.

    def _test(self, rotation: list[list[DapArray]], motion: DapArray, limits: Limits) -> tuple[DapArray, DapArray]:
        """Deviations and verdicts, in all rows of a group."""
        over = self._wide(1.0 / self._spread(motion, 3))
        shift = self._wide(f.merge(0.0, motion, self.row[3]))
        worst: DapArray | None = None
        for end in self.ends:
            back = self._turned(rotation, end - shift, back=True) * over - self.middle
            along = self._total(back * self.model_direction)
            nearest = f.minimum(f.maximum(along, -self.half), self.half)
            rest = back - nearest * self.model_direction
            square = self._total(rest * rest)
            worst = square if worst is None else f.maximum(worst, square)
        assert worst is not None
        deviation = f.sqrt(worst)
        passed = deviation <= limits.deviation
        if self.curves.any():
            difference = abs(self.data_radii * over - self.model_radii)
            close = difference <= limits.radius
            both = self._all_rows(close)
            passed = passed & (both | ~self.curve)
        return deviation, passed | ~self.matched

    def _all_rows(self, mask: DapArray) -> DapArray:
        """Whether all four rows of a group are true, in all of them."""
        for distance in (1, 2):
            first = mask.neighbour(distance)
            other = mask.neighbour(-distance)
            upper = self.rows[1] | self.rows[3] if distance == 1 else self.rows[2] | self.rows[3]
            mask = mask & f.merge(other, first, upper)
        return mask

    def run(self, limits: Limits) -> ArrayValidation:
        """All of it."""
        dap = self.dap
        with dap.at_line(Phase.ROTATION):
            rotation = self._rotation()
            if f.any_(self.sign.compare('eq', 0.0) & self.matched):
                self._read_signs(rotation)
                rotation = self._rotation()
        with dap.at_line(Phase.TRANSLATION_AND_SCALE):
            motion, regular = self._translation(rotation, limits.scale_free)
        with dap.at_line(Phase.TEST):
            deviation, passed = self._test(rotation, motion, limits)
            f.sumc(~passed)  # how many features of each interpretation fail
        turns = np.array([[entry.numpy()[::4] for entry in row] for row in rotation]).transpose(2, 0, 1)
        moves = motion.numpy().reshape(self.m, 4)
        values = np.sort([value.numpy()[::4] for value in self.eigenvalues], axis=0)
        # With parallel edges only, two quaternions fit equally well.
        apart = values[1] - values[0] > PIVOT_ROUNDINGS * self.word.epsilon * np.maximum(values[3], 1.0)
        finite = np.isfinite(turns).all(axis=(1, 2)) & np.isfinite(moves).all(axis=1)
        determined = regular & apart & finite & (moves[:, 3] > 0.0)
        poses = [
            Pose(proper(turn.astype(float)), move[:3].astype(float), float(move[3])) if fine else Pose.identity()
            for turn, move, fine in zip(turns, moves, determined)
        ]
        deviations = np.where(self.matched_host, deviation.numpy()[::4].astype(float), np.nan)
        signs = np.where(self.matched_host, self.signs_host, self.given).astype(np.int8)
        return ArrayValidation(poses, deviations, passed.numpy()[::4], signs, determined)


def validated_by_machine(
    index: ModelIndex,
    data: FeatureSet,
    assignments: IntArray,
    signs: Int8Array,
    fracdev: float,
    curvedev: float,
    size: float,
    real_bytes: int,
) -> Validation:
    """As absolute_pose.validate, by a DAP 510; stats has what it spent.

    Interpretations of parallel edges only are singular on the machine: their poses, and what stays free, are the
    native ones.
    """
    dap = Dap.model('510', tracing=False)
    limits = Limits(fracdev * size, curvedev * index.max_radius)
    found = validate_on_array(dap, index, data, assignments, signs, limits, real_bytes)
    spent = dap.stats()
    phases = {phase.name.lower(): spent.lines[phase][1] * dap.clock_s for phase in PHASES if phase in spent.lines}
    free_shift, free_turn = np.full((2, len(assignments), 3), np.nan)
    checked = Validation(
        found.poses,
        found.deviations,
        found.passed,
        found.signs,
        free_shift,
        free_turn,
        {'dap_cycles': spent.cycles, 'dap_seconds': spent.seconds, 'dap_phases': phases},
    )
    singular = np.flatnonzero(~found.determined)
    if len(singular):
        native = validate(index.features, data, assignments[singular], signs[singular], fracdev, curvedev, size)
        for name in ('deviations', 'passed', 'signs', 'free_shift', 'free_turn'):
            getattr(checked, name)[singular] = getattr(native, name)
        for row, pose in zip(singular, native.poses):
            checked.poses[row] = pose
    return checked
