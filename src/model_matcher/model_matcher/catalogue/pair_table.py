"""The pairs of all models, sorted into the cells of their invariants: counted first, then written in place.

A model gives the pairs of each feature with its best partners: crossing ones that are near, long and far from parallel
(:func:`.line_pairs.rank_pairs`, by which a scene's pairs are chosen, too), and parallel ones of which one is a curve,
the nearest. Two parallel edges are left out: they leave the shift along them open.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import ByteArray, Float32Array, FloatArray, Int32Array, Int64Array

from ..geometry.features import CURVE
from ..geometry.line_pairs import pair_geometry, rank_pairs
from ..geometry.parallel_pairs import offsets
from ..geometry.settings import PARALLEL_SINE
from .records import CELLS, Models, Postings, Scale, along_cell, angle_cell, apart_cell, cell_of, group_of, size_cell
from .settings import PARTNERS


@njit
def parallel_partners(rows: FloatArray, kind: ByteArray, reach: float, most: int) -> Int32Array:
    """The nearest parallel pairs of each curve, (p, 2) int32, the curve first; each pair of curves once.

    Parameters
    ----------
    rows : (n, 9) float64
        Features.
    kind : (n,) uint8
    reach : float
        Metres between mid points, beyond which no pair is one of a single object.
    most : int
        Pairs that each curve gives.

    """
    n = rows.shape[0]
    pairs, count = np.empty((n * most, 2), np.int32), 0
    far, partners, found = np.empty(most), np.empty((n, most), np.int32), np.zeros(n, np.int64)
    for a in range(n):
        if kind[a] != CURVE:
            continue
        for b in range(n):
            if a == b:
                continue
            x, y, z = rows[b, 0] - rows[a, 0], rows[b, 1] - rows[a, 1], rows[b, 2] - rows[a, 2]
            way = np.sqrt(x * x + y * y + z * z)
            if way > reach + rows[b, 6] or (found[a] == most and far[most - 1] <= way):
                continue
            cosine = rows[a, 3] * rows[b, 3] + rows[a, 4] * rows[b, 4] + rows[a, 5] * rows[b, 5]
            if 1.0 - cosine * cosine >= PARALLEL_SINE * PARALLEL_SINE:
                continue
            at = min(found[a], most - 1)
            while at > 0 and far[at - 1] > way:
                far[at], partners[a, at] = far[at - 1], partners[a, at - 1]
                at -= 1
            far[at], partners[a, at] = way, b
            found[a] = min(found[a] + 1, most)
    for a in range(n):
        for k in range(found[a]):
            b = partners[a, k]
            known = False
            if b < a:
                for q in range(found[b]):
                    if partners[b, q] == a:
                        known = True
                        break
            if not known:
                pairs[count, 0], pairs[count, 1] = a, b
                count += 1
    return pairs[:count]


@njit
def feature_size(rows: FloatArray, kind: ByteArray, a: int) -> float:
    """What a feature is told by beside its place: a curve's radius, the length of an edge or axis, metres."""
    return float(rows[a, 7] if kind[a] == CURVE else 2.0 * rows[a, 6])


@njit
def in_order(kind: ByteArray, a: int, b: int) -> tuple[int, int]:
    """A crossing pair with the lower kind first."""
    return (a, b) if kind[a] <= kind[b] else (b, a)


@njit
def describe(
    rows: FloatArray, kind: ByteArray, a: int, b: int, parallel: bool, scale: Scale, span: Float32Array
) -> int:
    """The cell of a pair of model features, and its spans (5,), which are filled; see :class:`.records.Postings`."""
    floor, share = scale.floor, scale.share
    if parallel:
        apart, foot_a, _ = offsets(rows[a], rows[b])
        foot_b = 0.0
        angle = along_cell(foot_a, floor, share) if kind[b] == CURVE else 0
    else:
        c, s, d, foot_a, foot_b, _ = pair_geometry(rows[a], rows[b])
        apart = abs(d)
        angle = angle_cell(np.arctan2(s, c))
    span[0] = apart
    span[1], span[2] = -rows[a, 6] - foot_a, rows[a, 6] - foot_a
    span[3], span[4] = -rows[b, 6] - foot_b, rows[b, 6] - foot_b
    cell: int = cell_of(
        group_of(kind[a], kind[b], parallel),
        angle,
        apart_cell(apart, floor, share),
        size_cell(feature_size(rows, kind, a), kind[a] == CURVE, floor, share),
        size_cell(feature_size(rows, kind, b), kind[b] == CURVE, floor, share),
    )
    return cell


@njit(nogil=True)
def count_pairs(models: Models, scale: Scale, starts: Int64Array, first: int, last: int) -> None:
    """Add the pairs of models first to last - 1 to the counts of their cells: cell k at starts[k + 1]."""
    span = np.empty(5, np.float32)
    for model in range(first, last):
        rows = models.rows[models.starts[model] : models.starts[model + 1]]
        kind = models.kind[models.starts[model] : models.starts[model + 1]]
        for parallel in range(2):
            pairs = _pairs_of(rows, kind, models.sizes[model], parallel == 1)
            for p in range(len(pairs)):
                a, b = pairs[p, 0], pairs[p, 1]
                starts[describe(rows, kind, a, b, parallel == 1, scale, span) + 1] += 1


@njit(nogil=True)
def write_pairs(models: Models, scale: Scale, cursor: Int64Array, out: Postings, first: int, last: int) -> None:
    """Write the pairs of models first to last - 1 where their cells go on: cursor (CELLS,), changed in place."""
    span = np.empty(5, np.float32)
    for model in range(first, last):
        rows = models.rows[models.starts[model] : models.starts[model + 1]]
        kind = models.kind[models.starts[model] : models.starts[model + 1]]
        for parallel in range(2):
            pairs = _pairs_of(rows, kind, models.sizes[model], parallel == 1)
            for p in range(len(pairs)):
                a, b = pairs[p, 0], pairs[p, 1]
                cell = describe(rows, kind, a, b, parallel == 1, scale, span)
                at = cursor[cell]
                cursor[cell] += 1
                out.owner[at] = model
                out.members[at, 0], out.members[at, 1] = a, b
                for k in range(5):
                    out.spans[at, k] = span[k]


@njit
def _pairs_of(rows: FloatArray, kind: ByteArray, size: float, parallel: bool) -> Int32Array:
    """The pairs of one model that stand in the index; crossing ones in order."""
    if parallel:
        pairs: Int32Array = parallel_partners(rows, kind, size, PARTNERS)
        return pairs
    pairs = rank_pairs(rows, np.zeros((0, 0), np.int32), size, PARTNERS)[0]
    for p in range(len(pairs)):
        pairs[p, 0], pairs[p, 1] = in_order(kind, pairs[p, 0], pairs[p, 1])
    return pairs


def no_pairs() -> Int64Array:
    """Counts of cells without pairs, (CELLS + 1,)."""
    return np.zeros(CELLS + 1, np.int64)
