"""A model made ready for matching: feature rows, pair table, voxel tables. Built once, kept while the model lives."""

from __future__ import annotations

import weakref
from dataclasses import dataclass, field

import numpy as np

from csg_renderer.features.library import ModelOutline
from msgs_py import FeatureKind, FeatureSet, Pose

from ..geometry.back_projection import build_voxels
from ..geometry.features import ModelFeatures, PairTable, VoxelGrid
from ..geometry.line_pairs import build_pair_table
from ..geometry.parallel_pairs import ParallelPairs, parallel_pairs
from ..geometry.settings import NEAR_LAYERS, NOT_ZERO, ROUNDING, SMALLEST_LENGTH
from ..params import MatchParams
from .settings import LARGEST_MODEL, VOXEL_REACHES, VOXELS_ACROSS


def feature_rows(features: FeatureSet) -> np.ndarray:
    """Features as rows of nine numbers, see geometry/features.py.

    Parameters
    ----------
    features : FeatureSet
        Metres.

    Returns
    -------
    (n, 9) float64
        Mid point, unit direction, half length, radii. A feature without length has direction 0 and half length 0.

    Examples
    --------
    >>> feature_rows(FeatureSet.from_edges([[0, 0, 1]], [[2, 0, 1]]))[0, :7].tolist()
    [1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0]
    """
    n = len(features)
    rows = np.empty((n, 9))
    start, end = features.start, features.end
    vector = end - start
    length = np.sqrt(np.einsum('ij,ij->i', vector, vector))
    curve = features.kind == FeatureKind.CURVE
    rows[:, 0:3] = 0.5 * (start + end)
    rows[:, 3:6] = vector / np.maximum(length, SMALLEST_LENGTH)[:, None]
    rows[:, 6] = 0.5 * length
    rows[:, 7:9] = features.radii
    if curve.any():
        rows[curve, 0:3] = start[curve]
        rows[curve, 6] = 0.0
    return rows


@dataclass(eq=False)
class ModelIndex:
    """A model ready for matching; make it with :func:`index_model`.

    Attributes
    ----------
    name : str
    features : FeatureSet
        The features that have a length, model frame, metres.
    rows : (e, 9) float64
        The same as rows, see :func:`feature_rows`.
    kind : (e,) uint8
    source : (e,) int
        Number of each in the FeatureSet that the model came from.
    size : float
        Largest distance between two model points, metres (the thesis' maxdist).
    middle : (3,) float64
        Centre of the model's bounding box, metres.
    max_radius : float
        Metres; 0 without curves.
    pair_reach, pair_starts, pair_members, pair_values
        The table of pairs, see :attr:`pair_table`.
    shape : SolidOutline or MeshOutline, optional
        What of the model a camera sees, when more of it is known than its features.
    frames : dict of str to Pose
        Named frames on the model, model_T_frame.
    library : int
        Models of the library out of which a scene has picked this one.
    """

    name: str
    features: FeatureSet
    rows: np.ndarray
    kind: np.ndarray
    source: np.ndarray
    size: float
    middle: np.ndarray
    max_radius: float
    pair_reach: float
    pair_starts: np.ndarray
    pair_members: np.ndarray
    pair_values: np.ndarray
    shape: ModelOutline | None = None
    frames: dict[str, Pose] = field(default_factory=dict)
    library: int = 1
    _voxels: dict[float, VoxelGrid] = field(default_factory=dict)
    _parallel: list[ParallelPairs] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def pair_table(self) -> PairTable:
        """The model's pairs as compiled searches take them."""
        return PairTable(self.pair_reach, self.pair_starts, self.pair_members, self.pair_values)

    @property
    def parallel_pairs(self) -> ParallelPairs:
        """The model's pairs of parallel features; made when they are asked for first."""
        if not self._parallel:
            self._parallel.append(parallel_pairs(self.rows, self.kind))
        return self._parallel[0]

    def prepared(self, tolerance: float) -> ModelFeatures:
        """The model as back-projection takes it, for data that is off by no more than a tolerance (metres)."""
        return ModelFeatures(self.rows, self.kind, self.middle, self.size, self.voxels(tolerance))

    def voxels(self, tolerance: float) -> VoxelGrid:
        """The table whose reach covers a tolerance (metres); the widest one when none does."""
        wanted = tolerance / max(self.size, SMALLEST_LENGTH)
        reach = next((r for r in VOXEL_REACHES if r >= wanted), VOXEL_REACHES[-1])
        if reach not in self._voxels:
            points = extent_points(self.features)
            margin = reach * self.size
            low = points.min(axis=0) - margin
            span = points.max(axis=0) + margin - low
            cell = float(span.max()) / VOXELS_ACROSS
            nx, ny, nz = (int(v) for v in np.maximum(np.ceil(span / cell), 1))
            shape = (nx, ny, nz)
            starts, items = build_voxels(self.rows, low, cell, shape, margin)
            self._voxels[reach] = VoxelGrid(low, cell, 1.0 / cell, shape, NEAR_LAYERS / margin, starts, items)
        return self._voxels[reach]


def extent_points(features: FeatureSet) -> np.ndarray:
    """(m, 3) float64: points that bound the features: end points, and six points about each curve."""
    curve = features.kind == FeatureKind.CURVE
    points = [features.start, features.end[~curve]]
    if curve.any():
        around = np.concatenate([np.eye(3), -np.eye(3)])
        points.append((features.start[curve][:, None] + around * features.radii[curve, :1, None]).reshape(-1, 3))
    return np.concatenate(points)


def model_box(index: ModelIndex) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner (3,), model frame, metres, of a box that holds a model.

    That of the solid, where it is known and bounded; that of the features otherwise.
    """
    if index.shape is not None and np.isfinite(index.shape.box).all():
        return index.shape.box
    points = extent_points(index.features)
    return points.min(axis=0), points.max(axis=0)


def model_size(features: FeatureSet) -> float:
    """Largest distance between two points of the model, metres: the thesis' maxdist."""
    points = extent_points(features)
    if len(points) < 2:
        return 0.0
    if len(points) > 2000:
        return float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))
    squares = np.einsum('ij,ij->i', points, points)
    return float(np.sqrt(max(0.0, (squares[:, None] + squares - 2.0 * points @ points.T).max())))


def index_model(features: FeatureSet, name: str = 'model', shape: ModelOutline | None = None) -> ModelIndex:
    """Make a model ready for matching.

    Parameters
    ----------
    features : FeatureSet
        Model frame, metres; edges without length are left out.
    name : str
        Written to the interpretations.
    shape : SolidOutline or MeshOutline, optional
        Of the same model; with it, poses are measured in the images.

    Returns
    -------
    ModelIndex

    Raises
    ------
    ValueError
        No feature is left, or there are more than a table of pairs is made of.
    """
    keep = np.flatnonzero(features.lengths > SMALLEST_LENGTH)
    if len(keep) == 0:
        raise ValueError(
            f'model: {name} has no features'
            if len(features) == 0
            else f'model: every feature of {name} has length zero'
        )
    if len(keep) > LARGEST_MODEL:
        raise ValueError(f'model: {name} has {len(keep)} features, expected at most {LARGEST_MODEL}')
    used = features if len(keep) == len(features) else features.select(keep)
    rows = feature_rows(used)
    size = max(model_size(used), SMALLEST_LENGTH)
    points = extent_points(used)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    curve = used.kind == FeatureKind.CURVE
    max_radius = float(used.radii[curve].max()) if curve.any() else 0.0
    starts, members, values = build_pair_table(rows, size)
    kinds = np.ascontiguousarray(used.kind)
    return ModelIndex(name, used, rows, kinds, keep, size, middle, max_radius, size, starts, members, values, shape)


_cache: dict[int, tuple[weakref.ref[FeatureSet], ModelIndex]] = {}


def indexed(model: FeatureSet | ModelIndex, name: str = 'model') -> ModelIndex:
    """The index of a model; made once for each FeatureSet object and dropped with it."""
    if isinstance(model, ModelIndex):
        return model
    if not isinstance(model, FeatureSet):
        raise TypeError(f'model: expected a FeatureSet, got {type(model).__name__}')
    key = id(model)
    known = _cache.get(key)
    if known is not None and known[0]() is model and known[1].name == name:
        return known[1]
    index = index_model(model, name)

    # Bound here, because a module's globals go first when the interpreter ends.
    def forget(_: object, cache: dict[int, tuple[weakref.ref[FeatureSet], ModelIndex]] = _cache) -> None:
        cache.pop(key, None)

    _cache[key] = (weakref.ref(model, forget), index)
    return index


def data_tolerances(data: FeatureSet, rows: np.ndarray, size: float, params: MatchParams) -> np.ndarray:
    """How far data may be off a model's features.

    Parameters
    ----------
    data : FeatureSet
        n features with their stated errors, metres. What they have in common hardly tells where they are from each
        other, and is left out.
    rows : (n, 9) float64
        Its :func:`feature_rows`.
    size : float
        Metres, of the model.
    params : MatchParams
        Of the match.

    Returns
    -------
    (n, 3) float64
        Across (metres): the stated error and fracdev x size, which are independent: the root of the sum of their
        squares; along (metres): the same with the overhang; half cone angle (radians): thesis 5.4, with the errors at
        both ends, at most max_cone_deg (curve_cone_deg for curves).
    """
    data, floor = data.alone, params.fracdev * size
    tolerances = np.empty((len(rows), 3))
    tolerances[:, 0] = np.hypot(data.err_per * params.err_scale, floor)
    half = rows[:, 6]
    tolerances[:, 1] = np.hypot(data.err_par * params.err_scale, floor) + params.overhang * 2.0 * half
    room = np.maximum(2.0 * half - 2.0 * data.err_par * params.err_scale, NOT_ZERO)
    cone = np.arctan2(2.0 * tolerances[:, 0], room)
    tolerances[:, 2] = np.minimum(cone, np.radians(params.max_cone_deg))
    curve = data.kind == FeatureKind.CURVE
    if curve.any():
        tolerances[curve, 2] = np.radians(params.curve_cone_deg)
    return np.maximum(tolerances, ROUNDING)
