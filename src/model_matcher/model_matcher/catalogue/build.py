"""An index is built of features: all models' features side by side, and their pairs sorted into cells."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from msgs_py import FeatureKind, FeatureSet
from msgs_py.numeric.deadline import Deadline, blocks
from msgs_py.numeric.typed import AnyArray, ByteArray, FloatArray

from ..geometry.settings import SMALLEST_LENGTH
from ..model.index import extent_points, feature_rows, model_size
from ..model.settings import LARGEST_MODEL
from ..params import MatchParams
from .catalogue import details_of, table_bytes
from .pair_table import count_pairs, no_pairs, write_pairs
from .records import Models, Postings, Scale
from .store import writing


class IndexedModel(NamedTuple):
    """A model as it stands in an index.

    Attributes
    ----------
    name : str
    rows : (e, 9) float64
        Its features, see geometry/features.py.
    kind : (e,) uint8
    details : (e, 5) float64
        See :func:`.catalogue.details_of`.
    size : float
        Metres.
    centre : (3,) float64
        Metres.
    radius : float
        Metres, the largest; 0 without curves.
    """

    name: str
    rows: FloatArray
    kind: ByteArray
    details: FloatArray
    size: float
    centre: FloatArray
    radius: float


def indexed_model(features: FeatureSet, name: str) -> IndexedModel:
    """A model as it stands in an index.

    Parameters
    ----------
    features : FeatureSet
        Model frame, metres; features without length are left out.
    name : str

    Raises
    ------
    ValueError
        It has no features, or too many.
    """
    used = features.select(np.flatnonzero(features.lengths > SMALLEST_LENGTH))
    if not 0 < len(used) <= LARGEST_MODEL:
        raise ValueError(f'{name} has {len(used)} features with a length, expected 1 to {LARGEST_MODEL}')
    points = extent_points(used)
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    curve = used.kind == FeatureKind.CURVE
    radius = float(used.radii[curve].max()) if curve.any() else 0.0
    size = max(model_size(used), SMALLEST_LENGTH)
    return IndexedModel(name, feature_rows(used), used.kind, details_of(used), size, centre, radius)


def write_catalogue(
    path: Path,
    models: Sequence[IndexedModel],
    sources: Any = (),
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> None:
    """Write an index of models; it takes the place of an older one when it is whole.

    Parameters
    ----------
    path : Path
    models : sequence of IndexedModel
        With unique names.
    sources
        What JSON holds: where the models are from.
    progress : callable
        Takes what is done, and how many models of how many.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    share = MatchParams().fracdev
    sizes = np.array([one.size for one in models])
    # What a model of the usual size may be off is about what data may be off, where data is any good.
    scale = Scale(share * (float(np.median(sizes)) if len(sizes) else 1.0), share)
    rows = sum(len(one.rows) for one in models)
    m = len(models)
    features = Models(
        np.concatenate([[0], np.cumsum([len(one.rows) for one in models])]).astype(np.int64),
        np.concatenate([one.rows for one in models]) if m else np.zeros((0, 9)),
        np.concatenate([one.kind for one in models]) if m else np.zeros(0, np.uint8),
        sizes,
        np.array([one.centre for one in models]).reshape(-1, 3),
        np.array([one.radius for one in models]),
    )
    starts = no_pairs()
    for first, last in blocks(m, Deadline()):
        count_pairs(features, scale, starts, first, last)
        progress('pairs counted', last, m)
    np.cumsum(starts, out=starts)
    pairs = int(starts[-1])
    tables = {'names': table_bytes([one.name for one in models]), 'sources': table_bytes(sources)}
    shapes: dict[str, tuple[str, tuple[int, ...]]] = {
        'starts': ('<i8', (m + 1,)),
        'rows': ('<f8', (rows, 9)),
        'kind': ('|u1', (rows,)),
        'sizes': ('<f8', (m,)),
        'centres': ('<f8', (m, 3)),
        'radii': ('<f8', (m,)),
        'details': ('<f8', (rows, 5)),
        'pair_starts': ('<i8', starts.shape),
        'pair_owner': ('<u4', (pairs,)),
        'pair_members': ('<u2', (pairs, 2)),
        'pair_spans': ('<f4', (pairs, 5)),
        **{name: ('|u1', table.shape) for name, table in tables.items()},
    }
    with writing(path, {'models': m, 'pairs': pairs, **scale._asdict()}, shapes) as out:
        filled: dict[str, AnyArray] = {**features._asdict(), **tables, 'pair_starts': starts}
        filled['details'] = np.concatenate([one.details for one in models]) if m else np.zeros((0, 5))
        for name, array in filled.items():
            out[name][...] = array
        postings = Postings(starts, out['pair_owner'], out['pair_members'], out['pair_spans'])
        cursor = starts[:-1].copy()
        for first, last in blocks(m, Deadline()):
            write_pairs(features, scale, cursor, postings, first, last)
            progress('pairs written', last, m)
