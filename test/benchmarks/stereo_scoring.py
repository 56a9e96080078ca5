"""Views of two solids with known truth, scores of recovered edges, and the recipe people use instead of recover().

The views are rendered by the small exact renderer of stereo_recovery's tests: 512 x 512, f = 703 px, 4 x 4 rays a
pixel, point spread 0.5 px, noise of 2 grey levels, baseline 50 mm, depth 180 to 330 mm.
"""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from msgs_py import FeatureSet, PinholeCamera, Pose, StereoRig

SYNTHETIC = Path(__file__).resolve().parents[2] / 'src' / 'stereo_recovery' / 'test' / 'synthetic.py'
RIG = StereoRig.symmetric(PinholeCamera.centred(512, 512, 703.0), 0.05)
DEPTHS = (0.18, 0.25, 0.33)
MM = 1e-3
# An edge counts as true when its direction and both its ends are this near to a true one.
SAME_ANGLE, SAME_PLACE = np.radians(10.0), 3.0 * MM
FLAT = np.sin(np.radians(8.0))
CIRCLE = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)


def synthetic() -> Any:
    """The test renderer, loaded from its file."""
    name = 'stereo_recovery_synthetic'
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, SYNTHETIC)
        assert spec is not None and spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


@dataclass(frozen=True)
class View:
    """A rendered pair and what is true of it: edges (n, 2, 3) seen by both eyes, rims, axes."""

    name: str
    left: np.ndarray
    right: np.ndarray
    edges: np.ndarray
    rims: list
    axes: list


def views(kind: str, count: int, seed: int = 5) -> list[View]:
    """kind : 'block' (60 x 45 x 30 mm, L-shaped), 'cylinder' (on a box of 70 x 50 x 25 mm) or 'flat' (the block with
    many edges along the rows)."""
    s = synthetic()
    rng = np.random.default_rng(seed)
    if kind == 'cylinder':
        base = s.prism(MM * np.array([(0, 0), (70, 0), (70, 50), (0, 50)]), 25 * MM)
        solid = base.at(Pose(np.eye(3), MM * np.array([-35, -25, -25]))) + s.cylinder(15 * MM, 35 * MM)
    else:
        outline = MM * np.array([(0, 0), (60, 0), (60, 30), (30, 30), (30, 45), (0, 45)])
        solid = s.prism(outline, 30 * MM).at(Pose(np.eye(3), MM * np.array([-30, -22, -15])))
    result = []
    for k in range(count):
        seen = None
        while seen is None or not _whole(seen):
            yaw = rng.uniform(-np.pi, np.pi)
            roll = rng.uniform(-0.3, 0.3) if kind == 'block' else rng.uniform(-0.03, 0.03)
            if kind == 'flat':
                yaw = rng.choice([0, 0.5, 1, -0.5]) * np.pi + rng.uniform(-0.05, 0.05)
            turn = (
                Pose.from_rotation_vector([0, 0, roll]).rotation
                @ Pose.from_rotation_vector([np.pi / 2 + np.radians(rng.uniform(20, 55)), 0, 0]).rotation
                @ Pose.from_rotation_vector([0, 0, yaw]).rotation
            )
            seen = solid.at(Pose(turn, [0.025 + rng.uniform(-0.01, 0.01), rng.uniform(-0.015, 0.015), DEPTHS[k % 3]]))
        left, right = s.render_pair(seen, RIG, seed=seed * 1000 + k)
        result.append(View(f'{kind} {k}', left, right, s.truth_edges(seen, RIG), s.truth_rims(seen, RIG), seen.axes))
    return result


def _whole(shape: Any) -> bool:
    """Whether both pictures show the whole of it, with a margin of 4 px."""
    points = [np.ravel(end) for edge in shape.edges for end in edge]
    for centre, normal, radius in shape.rims:
        across = np.linalg.svd(np.asarray(normal)[None])[2][1:]
        points += [*(centre + radius * np.column_stack([np.cos(CIRCLE), np.sin(CIRCLE)]) @ across)]
    return all(
        bool(RIG.left.contains(pixels + margin).all())
        for pixels in RIG.project(np.array(points))
        for margin in (-4.0, 4.0)
    )


@dataclass
class Score:
    """Sums over views; metres, radians."""

    length: float = 0.0
    covered: float = 0.0
    flat_length: float = 0.0
    flat_covered: float = 0.0
    right: int = 0
    reported: int = 0

    def __post_init__(self) -> None:
        self.angles: list[float] = []
        self.offsets: list[float] = []
        self.ends: list[float] = []

    def add(self, edges: FeatureSet, truth: np.ndarray) -> None:
        """Edges of one view against its true edges (n, 2, 3)."""
        self.reported += len(edges)
        samples = (np.arange(200) + 0.5) / 200
        cover = np.zeros((len(truth), 200), bool)
        mine: list[list[float]] = [[] for _ in truth]
        for start, end in zip(edges.start, edges.end):
            best = None
            for m, (a, b) in enumerate(truth):
                length = np.linalg.norm(b - a)
                line = (b - a) / length
                angle = np.arccos(min(1.0, abs((end - start) @ line) / max(np.linalg.norm(end - start), 1e-12)))
                places = np.array([(x - a) @ line for x in (start, end)])
                off = [np.linalg.norm(x - a - np.clip(p, 0, length) * line) for x, p in zip((start, end), places)]
                if angle < SAME_ANGLE and max(off) < SAME_PLACE and (best is None or max(off) < best[0]):
                    across = [np.linalg.norm(x - a - p * line) for x, p in zip((start, end), places)]
                    best = (max(off), m, angle, across, np.sort(places), length)
            if best is None:
                continue
            _, m, angle, across, places, length = best
            self.right += 1
            self.angles.append(float(angle))
            self.offsets += across
            mine[m] += [*places]
            cover[m] |= (samples * length >= places[0]) & (samples * length <= places[1])
        for m, (a, b) in enumerate(truth):
            length = np.linalg.norm(b - a)
            self.length += length
            self.covered += cover[m].mean() * length
            pixels = RIG.left.project(np.stack([a, b]))
            if abs(pixels[1, 1] - pixels[0, 1]) < FLAT * np.linalg.norm(pixels[1] - pixels[0]):
                self.flat_length += length
                self.flat_covered += cover[m].mean() * length
            if mine[m]:
                self.ends += [float(np.min(np.abs(np.array(mine[m]) - true))) for true in (0.0, length)]


def peer(
    left: np.ndarray,
    right: np.ndarray,
    shortest: float = 12.0,
    lowest: float = 60.0,
    highest: float = 250.0,
    rig: StereoRig = RIG,
) -> FeatureSet:
    """The usual recipe: LSD in both images, epipolar matching of the segments by overlap, slope and contrast, and
    triangulation of the common rows. Segments within 8 degrees of the rows are dropped, as everyone does."""
    found = []
    for image in (left, right):
        lines = cv2.createLineSegmentDetector().detect(image)[0]
        lines = np.zeros((0, 4)) if lines is None else np.asarray(lines, float).reshape(-1, 4)
        run = lines[:, 2:] - lines[:, :2]
        length = np.hypot(*run.T)
        # LSD directs segments by contrast; downwards, with the sign kept beside.
        keep = (length > shortest) & (np.abs(run[:, 1]) > FLAT * length)
        lines, down = lines[keep], run[keep, 1] > 0
        lines[~down] = lines[~down][:, [2, 3, 0, 1]]
        found.append((lines, down))
    (a, sign_a), (b, sign_b) = found
    pairs = []
    for i, (u0, v0, u1, v1) in enumerate(a):
        for j, (x0, y0, x1, y1) in enumerate(b):
            top, bottom = max(v0, y0), min(v1, y1)
            if sign_a[i] != sign_b[j] or bottom - top < 0.5 * max(v1 - v0, y1 - y0):
                continue
            rows = np.array([top, bottom])
            u = u0 + (rows - v0) * (u1 - u0) / (v1 - v0)
            x = x0 + (rows - y0) * (x1 - x0) / (y1 - y0)
            if (u - x).min() < lowest or (u - x).max() > highest:
                continue
            cost = abs((v1 - v0) - (y1 - y0)) / (v1 - v0) + 0.02 * abs((u1 - u0) - (x1 - x0))
            pairs.append((cost, i, j, np.stack([u, rows], axis=1), x))
    used_a, used_b, ends = set(), set(), []
    for _, i, j, pixels, x in sorted(pairs, key=lambda p: p[0]):
        if i in used_a or j in used_b:
            continue
        used_a.add(i)
        used_b.add(j)
        ends.append(rig.triangulate(pixels, x))
    points = np.array(ends).reshape(-1, 2, 3)
    return FeatureSet.from_edges(points[:, 0], points[:, 1])
