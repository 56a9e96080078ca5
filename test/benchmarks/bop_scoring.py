"""The errors and scores of the BOP benchmark: MSSD, MSPD, VSD, and the recall that they give.

References
----------
T. Hodan et al., "BOP Challenge 2020 on 6D Object Localization", ECCV Workshops 2020, section 2.2 (VSD, MSSD, MSPD and
their thresholds), T. Hodan, F. Michel et al., "BOP: Benchmark for 6D Object Pose Estimation", ECCV 2018 (VSD), and the
documentation of bop_toolkit, whose numbers ``test_bop.py`` holds ours against.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from model_matcher.closed_form.bop.scene_folder import ModelInfo
from msgs_py import Pose

# Steps of an axis of revolution: a vertex moves by this share of the diameter at most.
SYMMETRY_STEP = 0.01
# Visibility: a surface this far behind what the depth image shows is hidden, millimetres.
VSD_DELTA = 15.0
VSD_TAUS = np.arange(0.05, 0.51, 0.05)
VSD_THRESHOLDS = np.arange(0.05, 0.51, 0.05)
MSSD_THRESHOLDS = np.arange(0.05, 0.51, 0.05)  # of the diameter
MSPD_THRESHOLDS = np.arange(5.0, 51.0, 5.0)  # pixels of an image 640 wide


def symmetry_poses(info: ModelInfo, step: float = SYMMETRY_STEP) -> list[Pose]:
    """Every symmetry of a model, the identity first: discrete ones, each followed by turns about each axis; mm."""
    turns = []
    for axis, offset in info.continuous:
        count = int(np.ceil(np.pi / step))
        for k in range(count):
            turn = Pose.from_rotation_vector(2.0 * np.pi * k / count * axis / np.linalg.norm(axis))
            turns.append(Pose(turn.rotation, offset - turn.rotation @ offset))
    discrete = [Pose.identity(), *info.discrete]
    return [turn.compose(one) for one in discrete for turn in turns] if turns else discrete


def mssd(found: Pose, true: Pose, points: np.ndarray, symmetries: Sequence[Pose]) -> float:
    """Maximum symmetry-aware surface distance: of the vertex that is farthest off, for the best symmetry.

    Parameters
    ----------
    found, true : Pose
        camera_T_model.
    points : (n, 3) float64
        Vertices of the model, in the unit of the poses, as is the result.
    symmetries : sequence of Pose
        model_T_model, of :func:`symmetry_poses`.
    """
    placed = found.apply(points)
    return min(float(np.linalg.norm(placed - true.compose(s).apply(points), axis=1).max()) for s in symmetries)


def mspd(found: Pose, true: Pose, points: np.ndarray, symmetries: Sequence[Pose], matrix: np.ndarray) -> float:
    """Maximum symmetry-aware projection distance, pixels; ``matrix`` is K (3, 3), the others as for :func:`mssd`."""
    placed = project(found.apply(points), matrix)
    return min(
        float(np.linalg.norm(placed - project(true.compose(s).apply(points), matrix), axis=1).max()) for s in symmetries
    )


def project(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """(n, 2) pixels of points (n, 3) of a camera's frame."""
    p = points @ matrix.T
    return np.asarray(p[:, :2] / p[:, 2:])


def vsd(
    found_depth: np.ndarray,
    true_depth: np.ndarray,
    seen_depth: np.ndarray,
    matrix: np.ndarray,
    diameter: float,
    taus: Sequence[float] | np.ndarray = VSD_TAUS,
    delta: float = VSD_DELTA,
) -> np.ndarray:
    """Visible surface discrepancy, one for each tau.

    Parameters
    ----------
    found_depth, true_depth : (h, w) float64
        Depth of the model at both poses; 0 where it is not.
    seen_depth : (h, w) float64
        What the sensor saw; 0 where it saw nothing, and there everything counts as visible.
    matrix : (3, 3) float64
        K.
    diameter : float
        In the unit of the depths.
    taus : sequence of float
        Shares of the diameter from which on a surface is off.
    delta : float
        In the unit of the depths.
    """
    slant = _slant(seen_depth.shape, matrix)
    found, true, seen = (np.asarray(depth, float) * slant for depth in (found_depth, true_depth, seen_depth))
    true_visible = (true > 0.0) & ((true - seen <= delta) | (seen == 0.0))
    # Where the true object is visible, nothing is in front of the found one but itself.
    found_visible = (found > 0.0) & ((found - seen <= delta) | (seen == 0.0) | true_visible)
    both, either = true_visible & found_visible, true_visible | found_visible
    if not either.any():
        return np.ones(len(taus))
    off = np.abs(true[both] - found[both]) / diameter
    alone = either.sum() - both.sum()
    return np.array([((off >= tau).sum() + alone) / either.sum() for tau in taus])


def _slant(shape: tuple[int, ...], matrix: np.ndarray) -> np.ndarray:
    """(h, w): what makes a distance from the camera's centre of a depth."""
    v, u = np.mgrid[0 : shape[0], 0 : shape[1]]
    x, y = (u - matrix[0, 2]) / matrix[0, 0], (v - matrix[1, 2]) / matrix[1, 1]
    return np.asarray(np.sqrt(x**2 + y**2 + 1.0))


def mesh_depth(
    vertices: np.ndarray, faces: np.ndarray, pose: Pose, matrix: np.ndarray, size: tuple[int, int]
) -> np.ndarray:
    """Depth of a mesh in a picture.

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (m, 3) int
    pose : Pose
        camera_T_model, in the unit of the vertices.
    matrix : (3, 3) float64
        K.
    size : (int, int)
        Width and height, pixels.

    Returns
    -------
    (h, w) float64
        z of what each pixel's ray meets first; 0 where that is nothing.
    """
    width, height = size
    depth = np.full((height, width), np.inf)
    for corners in pose.apply(vertices)[faces]:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        if (corners[:, 2] <= 0.0).any() or not normal @ corners[0]:
            continue
        pixels = project(corners, matrix)
        low = np.maximum(np.floor(pixels.min(axis=0)).astype(int), 0)
        high = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 1, [width, height])
        if (low >= high).any():
            continue
        v, u = np.mgrid[low[1] : high[1], low[0] : high[0]]
        rays = np.stack(
            [(u - matrix[0, 2]) / matrix[0, 0], (v - matrix[1, 2]) / matrix[1, 1], np.ones(u.shape)], axis=-1
        )
        # A ray is inside when it passes all sides of the triangle on the same hand.
        sides = np.stack([rays @ np.cross(corners[k], corners[(k + 1) % 3]) for k in range(3)])
        inside = (sides >= 0.0).all(axis=0) | (sides <= 0.0).all(axis=0)
        with np.errstate(divide='ignore', invalid='ignore'):
            z = (normal @ corners[0]) / (rays @ normal)
        part = depth[low[1] : high[1], low[0] : high[0]]
        part[inside] = np.fmin(part[inside], z[inside])
    return np.where(np.isfinite(depth), depth, 0.0)


@dataclass
class Judged:
    """The errors of the answers of one object in one image: rows are answers, the surest first, columns true poses."""

    mssd: np.ndarray  # of the diameter
    mspd: np.ndarray  # pixels of an image 640 wide
    vsd: np.ndarray | None = None  # with a third axis, of taus


@dataclass
class Recall:
    """How many of the true poses were found at each threshold; the benchmark's average recalls."""

    true: int = 0
    hits: dict[str, list[int]] = field(default_factory=dict)

    def add(self, judged: Judged) -> None:
        """Count the answers of one object in one image."""
        self.true += judged.mssd.shape[1]
        self._count('MSSD', [(judged.mssd, limit) for limit in MSSD_THRESHOLDS])
        self._count('MSPD', [(judged.mspd, limit) for limit in MSPD_THRESHOLDS])
        if judged.vsd is not None:
            errors = np.moveaxis(judged.vsd, -1, 0)
            self._count('VSD', [(one, limit) for one in errors for limit in VSD_THRESHOLDS])

    def _count(self, name: str, cases: list[tuple[np.ndarray, float]]) -> None:
        found = [matched(errors, limit) for errors, limit in cases]
        before = self.hits.get(name, [0] * len(found))
        self.hits[name] = [a + b for a, b in zip(before, found, strict=True)]

    def average(self) -> dict[str, float]:
        """Average recall by each error, 0 to 1, and AR, their mean."""
        by_error = {name: float(np.mean(hits)) / max(self.true, 1) for name, hits in self.hits.items()}
        return by_error | {'AR': float(np.mean(list(by_error.values()))) if by_error else 0.0}


def matched(errors: np.ndarray, limit: float) -> int:
    """How many true poses (columns) an answer (rows, the surest first) is nearer to than ``limit``, each taken once."""
    left = np.ones(errors.shape[1], bool)
    for row in errors:
        open_errors = np.where(left, row, np.inf)
        if len(row) and open_errors.min() < limit:
            left[int(open_errors.argmin())] = False
    return int((~left).sum())
