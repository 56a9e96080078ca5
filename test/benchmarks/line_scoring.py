"""What recovered straight edges are worth: recall, precision, errors, and whether the stated bounds are true."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from stereo_scenes import StereoScene, is_flat

from msgs_py import FeatureSet, Pose

# An edge counts as true when its direction and both its ends are this near to a true one.
SAME_ANGLE, SAME_PLACE = np.radians(10.0), 3e-3
# Median of the absolute value of a standard normal.
# Metres: no end is known better, of a pose to which edges are fitted.
LEAST_SIGMA = 1e-6
HALF_NORMAL = 0.6745
SAMPLES = (np.arange(200) + 0.5) / 200


class LineScore:
    """Sums over scenes; metres, radians."""

    def __init__(self) -> None:
        self.length = self.covered = self.all_length = self.all_covered = 0.0
        self.flat_length = self.flat_covered = 0.0
        self.right = self.reported = 0
        self.angles: list[float] = []
        self.across: list[float] = []
        self.ends: list[float] = []
        self.ratios: dict[str, list[float]] = {'err_per': [], 'err_par': [], 'cone': []}
        self.poses: list[tuple[float, float]] = []

    def include(self, sums: Mapping[str, Any]) -> None:
        """Add the sums of other scenes: the attributes of their score, as JSON has them."""
        for name, value in sums.items():
            if name == 'ratios':
                for what, ratios in value.items():
                    self.ratios[what] += ratios
            else:
                setattr(self, name, getattr(self, name) + value)

    def add(
        self, found: FeatureSet, truth: np.ndarray, faint: np.ndarray, also: np.ndarray | tuple[()] = ()
    ) -> np.ndarray:
        """Edges of one scene against the true ones (n, 2, 3); faint (n,) ones count only where they are reported. What
        is reported on one of ``also`` (m, 2, 3) is right, and nothing more: edges that a third camera sees.

        Returns (len(found),) int: the true edge of each, -1: none.
        """
        self.reported += len(found)
        paired = np.full(len(found), -1)
        cover = np.zeros((len(truth), len(SAMPLES)), bool)
        mine: list[list[tuple[float, float]]] = [[] for _ in truth]
        for k in range(len(found)):
            best = self._nearest(found.start[k], found.end[k], truth)
            if best is None:
                self.right += self._nearest(found.start[k], found.end[k], also) is not None
                continue
            m, angle, across, places, length = best
            paired[k] = m
            self.right += 1
            self.angles.append(angle)
            self.across += [*across]
            err_par, err_per = found.err_par[k], found.err_per[k]
            self.ratios['err_per'] += [x / max(err_per, 1e-9) for x in across]
            stated = np.arctan2(2.0 * err_per, max(found.lengths[k] - 2.0 * err_par, 1e-9))
            self.ratios['cone'].append(angle / max(stated, 1e-9))
            mine[m] += [(place, err_par) for place in places]
            cover[m] |= (SAMPLES * length >= places.min()) & (SAMPLES * length <= places.max())
        flat = is_flat(truth)
        for m, (a, b) in enumerate(truth):
            length = float(np.linalg.norm(b - a))
            self.all_length += length
            self.all_covered += cover[m].mean() * length
            if not faint[m]:
                self.length += length
                self.covered += cover[m].mean() * length
                self.flat_length += length * flat[m]
                self.flat_covered += cover[m].mean() * length * flat[m]
            for true in (0.0, length):
                if mine[m]:
                    miss, bound = min((abs(place - true), bound) for place, bound in mine[m])
                    self.ends.append(miss)
                    self.ratios['err_par'].append(miss / max(bound, 1e-9))
        return paired

    @staticmethod
    def _nearest(start: np.ndarray, end: np.ndarray, truth: np.ndarray) -> tuple | None:
        best = None
        for m, (a, b) in enumerate(truth):
            length = np.linalg.norm(b - a)
            line = (b - a) / length
            angle = np.arccos(min(1.0, abs((end - start) @ line) / max(np.linalg.norm(end - start), 1e-12)))
            places = np.array([(x - a) @ line for x in (start, end)])
            off = max(np.linalg.norm(x - a - np.clip(p, 0, length) * line) for x, p in zip((start, end), places))
            if angle < SAME_ANGLE and off < SAME_PLACE and (best is None or off < best[0]):
                across = [float(np.linalg.norm(x - a - p * line)) for x, p in zip((start, end), places)]
                best = (off, (m, float(angle), across, places, length))
        return None if best is None else best[1]

    def figures(self) -> dict[str, float]:
        """Shares, degrees, millimetres."""
        result = {
            'recall': self.covered / max(self.length, 1e-12),
            'recall with faint edges': self.all_covered / max(self.all_length, 1e-12),
        }
        if self.flat_length > 0.0:
            result['recall of flat edges'] = self.flat_covered / self.flat_length
        result['precision'] = self.right / max(self.reported, 1)
        for name, values, factor in (
            ('direction', self.angles, 180.0 / np.pi),
            ('across', self.across, 1e3),
            ('end', self.ends, 1e3),
        ):
            if values:
                result[f'{name} median'] = factor * float(np.median(values))
                result[f'{name} p90'] = factor * float(np.quantile(values, 0.9))
        for name, ratios in self.ratios.items():
            if ratios:
                result[f'inside {name}'] = float(np.mean(np.array(ratios) <= 1.0))
                # A bound is three sigma; half of all errors are below 0.67 sigma when sigma is true.
                result[f'{name} too wide'] = HALF_NORMAL / 3.0 / max(float(np.median(ratios)), 1e-9)
                result[f'{name} to shrink'] = 1.0 / max(float(np.quantile(ratios, 0.95)), 1e-9)
        if self.poses:
            rotation, translation = np.array(self.poses).T
            result |= {
                'pose rotation': float(rotation.mean()),
                'pose rotation max': float(rotation.max()),
                'pose translation': float(translation.mean()),
                'pose translation max': float(translation.max()),
                'poses': float(len(self.poses)),
            }
        return result


def pose_errors(found: FeatureSet, paired: np.ndarray, scene: StereoScene) -> tuple[float, float] | None:
    """Degrees, and mm at the model's centre, of the pose that brings the model's lines nearest to the paired edges,
    each weighed by its stated covariance across them; None when the edges do not fix a pose."""
    keep = paired >= 0
    if keep.sum() < 3:
        return None
    model = scene.model_index[paired[keep]]
    start, way = scene.model.start[model], scene.model.directions[model]
    ends = np.stack([found.start[keep], found.end[keep]], axis=1)
    # Rows across each true line, whitened: (k, 4, 6).
    flat = np.linalg.svd(scene.pose.rotate(way)[:, None, :])[2][:, 1:]
    both = np.zeros((len(model), 4, 6))
    both[:, :2, :3], both[:, 2:, 3:] = flat, flat
    spread = both @ found.covariance[keep] @ both.swapaxes(1, 2) + LEAST_SIGMA**2 * np.eye(4)
    white = np.linalg.solve(np.linalg.cholesky(spread), both)
    middle = scene.pose.apply(0.5 * (scene.model.start.min(axis=0) + scene.model.start.max(axis=0)))

    def moved(step: np.ndarray) -> Pose:
        turn = Pose.from_rotation_vector(step[:3]).rotation
        return Pose(turn @ scene.pose.rotation, turn @ (scene.pose.translation - middle) + middle + step[3:])

    def misses(step: np.ndarray) -> np.ndarray:
        pose = moved(step)
        line = (way @ pose.rotation.T)[:, None]
        run = ends - pose.apply(start)[:, None]
        across = run - (run * line).sum(-1, keepdims=True) * line
        return np.einsum('kij,kj->ki', white, across.reshape(-1, 6)).ravel()

    solution = least_squares(misses, np.zeros(6), x_scale=(1e-3,) * 3 + (1e-4,) * 3)
    if np.linalg.eigvalsh(solution.jac.T @ solution.jac)[0] < 1e-6:
        return None
    return float(np.degrees(np.linalg.norm(solution.x[:3]))), float(1e3 * np.linalg.norm(solution.x[3:]))
