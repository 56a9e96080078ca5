"""Validation as an array program on the emulated DAP (thesis 5.6, 5.9): one matched pair of edges a PE.

Rotation by quaternions with Jacobi's process on a 4 x 4 matrix of PEs, translation and scale by elimination in the
control unit, then all edges are tested at once. Only the experiments use it: it shows what each part costs.
"""

from __future__ import annotations

import numpy as np

from dap_emulator import Dap
from dap_emulator.machine import intrinsics as f
from dap_emulator.machine.kinds import real
from model_matcher.model.index import feature_rows
from msgs_py import FeatureSet, Pose

PARTS = ('set-up', 'rotation', 'Jacobi', 'translation and scale', 'test')
SETUP, ROTATION, JACOBI, TRANSLATION, TEST = range(1, 6)
WORD = real(4)
SWEEPS, SMALL = 10, 1e-7


class DapValidation:
    """Validates one interpretation of edges; seconds maps each of PARTS to its share of the machine's time.

    assignment : (n,) model edges; sign : (n,) of their directions; limit : metres, of an end point's deviation
    pose : camera_T_model with its scale; passed : (n,) bool
    """

    def __init__(
        self, model: FeatureSet, data: FeatureSet, assignment: np.ndarray, sign: np.ndarray, limit: float
    ) -> None:
        self.dap = dap = Dap.model('510', tracing=False)
        rows = feature_rows(model)[assignment]
        with dap.at_line(SETUP):
            ends = [self._vectors(data.start), self._vectors(data.end)]
            middle, direction = self._vectors(rows[:, :3]), self._vectors(rows[:, 3:6])
            half = dap.vector(rows[:, 6], WORD)
            turned = dap.vector(sign.astype(float), WORD)
            edge = [b - a for a, b in zip(*ends)]
            length = f.sqrt(self._dot(edge, edge))
            unit = [component / length * turned for component in edge]
        with dap.at_line(ROTATION):
            rotation = self._rotation(direction, unit)
            u = self._turned(rotation, direction)
            placed = self._turned(rotation, middle)
        with dap.at_line(TRANSLATION):
            shift, scale = self._translation(u, placed, ends)
        with dap.at_line(TEST):
            passed = None
            for end in ends:
                back = [
                    (self._dot(rotation[:, k].tolist(), [x - float(t) for x, t in zip(end, shift)])) / scale - middle[k]
                    for k in range(3)
                ]
                along = self._dot(back, direction)
                nearest = f.minimum(f.maximum(along, -half), half)
                rest = [b - nearest * d for b, d in zip(back, direction)]
                good = self._dot(rest, rest) <= limit**2
                passed = good if passed is None else passed & good
            self.valid = f.all_(passed)
        self.passed = passed.numpy()
        u_, _, v_ = np.linalg.svd(rotation)  # REAL*4 leaves it orthonormal to seven digits only
        self.pose = Pose(u_ @ v_, shift, scale)
        lines = dap.stats().lines
        self.seconds = {part: lines.get(line, (0, 0))[1] * dap.clock_s for line, part in enumerate(PARTS, 1)}

    @property
    def total(self) -> float:
        return sum(self.seconds.values())

    def _vectors(self, points: np.ndarray) -> list:
        return [self.dap.vector(points[:, k], WORD) for k in range(3)]

    def _dot(self, a, b):
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

    def _turned(self, rotation: np.ndarray, vectors: list) -> list:
        return [self._dot(row.tolist(), vectors) for row in rotation]

    def _mcu(self, operations: int, functions: int = 0) -> None:
        costs = self.dap.costs
        self.dap.charge_mcu(
            'REAL in the control unit',
            operations * costs.mcu(real=True) + functions * costs.mcu(real=True, function=True),
        )

    def _rotation(self, model: list, data: list) -> np.ndarray:
        s = np.array([[f.sum_(m * d) for d in data] for m in model])
        form = np.array(
            [
                [s[0, 0] + s[1, 1] + s[2, 2], s[1, 2] - s[2, 1], s[2, 0] - s[0, 2], s[0, 1] - s[1, 0]],
                [0, s[0, 0] - s[1, 1] - s[2, 2], s[0, 1] + s[1, 0], s[2, 0] + s[0, 2]],
                [0, 0, -s[0, 0] + s[1, 1] - s[2, 2], s[1, 2] + s[2, 1]],
                [0, 0, 0, -s[0, 0] - s[1, 1] + s[2, 2]],
            ]
        )
        form += np.triu(form, 1).T
        self._mcu(14)
        with self.dap.at_line(JACOBI):
            values, vectors = self._jacobi(form)
        w, x, y, z = vectors[:, np.argmax(values)]
        self._mcu(30)
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )

    def _jacobi(self, form: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Eigenvalues and eigenvectors of a symmetric 4 x 4 matrix by plane rotations, whole matrices at a time."""
        dap = self.dap
        a, v = dap.matrix(form, WORD), dap.matrix(np.eye(4), WORD)
        lines = [
            [
                dap.matrix(np.broadcast_to((np.arange(4) == k)[:, None] if axis == 0 else np.arange(4) == k, (4, 4)))
                for k in range(4)
            ]
            for axis in range(2)
        ]
        beside = dap.matrix(~np.eye(4, dtype=bool))

        def turn(matrix, axis: int, p: int, q: int, c: float, s: float) -> None:
            kept = matrix * c
            one, other = kept - matrix.neighbour(q - p, axis) * s, kept + matrix.neighbour(p - q, axis) * s
            matrix.assign(one, lines[axis][p])
            matrix.assign(other, lines[axis][q])

        size = float(np.abs(form).max()) or 1.0
        for _ in range(SWEEPS):
            if f.maxv(abs(a), beside) <= SMALL * size:
                break
            for p in range(3):
                for q in range(p + 1, 4):
                    across = a[p, q]
                    if abs(across) <= SMALL * size:
                        continue
                    theta = (a[q, q] - a[p, p]) / (2.0 * across)
                    t = (1.0 if theta >= 0.0 else -1.0) / (abs(theta) + np.sqrt(theta * theta + 1.0))
                    c = 1.0 / np.sqrt(t * t + 1.0)
                    self._mcu(12, 2)
                    turn(a, 1, p, q, float(c), float(t * c))
                    turn(a, 0, p, q, float(c), float(t * c))
                    turn(v, 1, p, q, float(c), float(t * c))
        return np.array([a[k, k] for k in range(4)]), v.numpy().astype(float)

    def _translation(self, u: list, placed: list, ends: list) -> tuple[np.ndarray, float]:
        """t and s that bring s R p + t nearest to the data's points across each line; 4 equations."""
        n = placed[0].shape[0]
        flat = [p - self._dot(u, placed) * d for p, d in zip(placed, u)]
        left, right = np.zeros((4, 4)), np.zeros(4)
        for i in range(3):
            for j in range(i, 3):
                left[i, j] = left[j, i] = 2.0 * ((n if i == j else 0.0) - f.sum_(u[i] * u[j]))
            left[i, 3] = left[3, i] = 2.0 * f.sum_(flat[i])
        left[3, 3] = 2.0 * f.sum_(self._dot(flat, placed))
        both = [a + b for a, b in zip(*ends)]
        across = [x - self._dot(u, both) * d for x, d in zip(both, u)]
        right[:3] = [f.sum_(x) for x in across]
        right[3] = f.sum_(self._dot(flat, both))
        self._mcu(16 + 4 * 4 * 5 * 2)
        solution = np.linalg.solve(left, right)
        return solution[:3], float(solution[3])
