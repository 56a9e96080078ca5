"""A model and data, made ready for each other: what of the data is usable, and within which tolerances it fits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from msgs_py import FeatureKind, FeatureSet

from ..geometry.features import DataFeatures, ModelFeatures
from ..geometry.hypothesis_count import count_hypotheses
from ..geometry.pair_bounds import possible
from ..geometry.settings import SMALLEST_LENGTH
from ..params import MatchParams
from .index import ModelIndex, data_tolerances, feature_rows
from .settings import FARTHEST, MOST_ACROSS, SEARCH_WIDTH
from .symmetry import distinct_pairs


@dataclass(eq=False)
class Problem:
    """A model and data, made ready.

    Attributes
    ----------
    index : ModelIndex
        The model.
    data : FeatureSet
        The n usable features, camera frame, metres; without the errors that they have in common.
    keep : (n,) int
        Their numbers among all.
    n_data : int
        How many there are with those that are not usable.
    model : ModelFeatures
        The model as compiled functions take it.
    features : DataFeatures
        The n data features, likewise, with what they may be off.
    moved : DataFeatures, optional
        The same, one sigma of the error off that they have in common; None where they have none.
    """

    index: ModelIndex
    data: FeatureSet
    keep: np.ndarray
    n_data: int
    model: ModelFeatures
    features: DataFeatures
    moved: DataFeatures | None

    @cached_property
    def of_its_kinds(self) -> np.ndarray:
        """(k,) int, data features of kinds that the model has; of others chance makes no pose."""
        has = np.zeros(256, bool)
        has[self.index.kind] = True
        return np.flatnonzero(has[self.features.kind])

    @cached_property
    def hypotheses(self) -> float:
        """What chance may try: each feature alone, and pairs, see :func:`.hypothesis_count.count_hypotheses`.

        Of a library out of which the scene picks a few models, it tries as many in all, not of every model.
        """
        data, model = self.features, self.model
        may = np.zeros((0, 0), bool)
        # Of edges alone no parallel pair is counted.
        if (model.kind != FeatureKind.EDGE).any():
            may = possible(data.rows, data.kind, data.tolerances, model.rows, model.kind, data.radius_tolerance)
        table, parallel, some = distinct_pairs(self.index), self.index.parallel_pairs, self.of_its_kinds
        of_pairs: float = count_hypotheses(model, table, parallel, may, data, some)
        return (len(some) + of_pairs) / self.index.library

    @property
    def rows(self) -> np.ndarray:
        """(n, 9) float64, the data features."""
        return self.features.rows

    @property
    def tolerances(self) -> np.ndarray:
        """(n, 3) float64 of the data features: across and along (metres), half cone angle (radians)."""
        return self.features.tolerances

    @property
    def radius_tol(self) -> float:
        """Metres that radii of curves may be off, besides the tolerance across."""
        return self.features.radius_tolerance


def usable(data: FeatureSet, unit: float | None = 1.0) -> np.ndarray:
    """The features that are neither without length nor beyond all distance, in place or in error.

    An edge that was measured so badly that its direction is open, as its covariance says, tells no pose; an edge of
    which bounds alone are stated is taken with them.

    Parameters
    ----------
    data : FeatureSet
        Of any unit.
    unit : float, optional
        Metres, of the data; None when it is not known: what most of the data is away then stands for a metre.

    Returns
    -------
    (k,) int
        Their numbers.

    Examples
    --------
    >>> usable(FeatureSet.from_edges([[0, 0, 1], [0, 0, 1]], [[0, 0, 1], [0, 1, 1]])).tolist()
    [1]
    """
    far = np.maximum(np.abs(data.start), np.abs(data.end)).max(axis=1, initial=0.0)
    if unit is None:
        unit = 1.0 / (float(np.median(far)) or 1.0) if len(far) else 1.0
    data = data.alone
    far = np.maximum(far, np.maximum(data.err_par, data.err_per))
    measured = (data.kind == FeatureKind.EDGE) & np.isfinite(data.covariance[:, 0, 0])
    directed = ~measured | (data.err_per < MOST_ACROSS * data.lengths)
    return np.flatnonzero((data.lengths > SMALLEST_LENGTH) & (far < FARTHEST / unit) & directed)


def make_problem(index: ModelIndex, data: FeatureSet, params: MatchParams) -> Problem:
    """Prepare data for a model; of it, what is :func:`usable`."""
    keep, alone = usable(data), data.alone
    used = alone if len(keep) == len(data) else alone.select(keep)
    rows = feature_rows(used)
    tolerances = data_tolerances(used, rows, index.size, params)
    widest = SEARCH_WIDTH * float(tolerances[:, 0].max(initial=0.0))
    features = DataFeatures(rows, used.kind, tolerances, params.curvedev * index.max_radius)
    moved = None
    if data.common.any():
        moved = features._replace(rows=feature_rows(data.select(keep).moved_in_common))
    return Problem(index, used, keep, len(data), index.prepared(widest), features, moved)
