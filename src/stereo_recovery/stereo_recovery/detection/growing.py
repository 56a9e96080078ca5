"""Segments followed beyond the ends of their chains.

A chain ends where one edgel is too faint to be told from noise. Where the line of a segment is known already less is
enough: many pixels together show whether the picture goes on with its contrast.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import BoolArray, IntArray

from .edgel_kernels import position_factor
from .edgels import Edgels, Slopes
from .growing_kernels import Grown, Picture, grow
from .segments import Segments, fit_segments, laid_out
from .settings import DIRECTED_LENGTH, FLANK_DISTANCE, GROWING_ROUNDS
from .splitting import join_collinear


def grown(
    e: Edgels, segments: Segments, slopes: Slopes, sigma: float, tolerance: float, border: BoolArray | None = None
) -> tuple[Edgels, Segments]:
    """Straight segments with what the picture shows of them beyond their ends.

    Parameters
    ----------
    e : Edgels
        As the segments' bounds count.
    segments : Segments
    slopes : Slopes
        Of the picture.
    sigma, tolerance : float
        Pixels. As in :func:`.splitting.split`.
    border : (h, w) bool, optional
        Where no edgels count.

    Returns
    -------
    edgels : Edgels
        In the order of the segments returned.
    segments : Segments
        Fitted again where they grew, and joined where they met.
    """
    directed = (segments.arc < 0) & (segments.length >= DIRECTED_LENGTH)
    if not directed.any():
        return e, segments
    width = max(float(np.median(e.width)), sigma)
    picture = Picture(slopes.gx, slopes.gy, slopes.noise.sigma, slopes.noise.tile, FLANK_DISTANCE * width)
    order = np.flatnonzero(directed)
    marked = _marked(e, segments, slopes.gx.shape, border)
    given = segments
    for _ in range(GROWING_ROUNDS):
        found = grow(picture, segments.lines, order[np.argsort(-segments.length[order], kind='stable')], marked)
        order = np.unique(found.owner)
        if len(order) == 0:
            break
        e, segments = _with(e, segments, found, width, sigma)
    return (e, segments) if segments is given else join_collinear(e, segments, sigma, tolerance)


def _marked(e: Edgels, segments: Segments, shape: tuple[int, int], border: BoolArray | None) -> IntArray:
    """(h, w) int32: one more than the segment that has an edgel in a pixel, 0 where none has, -1 in the border."""
    result = np.zeros(shape, np.int32) if border is None else -border.astype(np.int32)
    column, row = np.rint(e.position).astype(np.intp).T
    count = segments.bounds[:, 1] - segments.bounds[:, 0]
    result[row, column] = np.repeat(np.arange(1, len(segments) + 1), count)
    return result


def _with(e: Edgels, segments: Segments, found: Grown, width: float, sigma: float) -> tuple[Edgels, Segments]:
    """The segments with more edgels, those fitted again; width : of the usual step, pixels."""
    order = np.lexsort((found.step, found.owner))
    owner, step, across = found.owner[order], found.step[order], (found.noise / found.magnitude)[order]
    direction = segments.direction[owner]
    more = Edgels(
        found.position[order],
        np.arctan2(direction[:, 0], -direction[:, 1]),
        found.magnitude[order],
        position_factor(width, sigma) * across,
        across,
        np.full(len(order), width),
        np.zeros(len(order)),
        found.prominence[order],
    )
    at = segments.bounds[owner, (step > 0).astype(np.intp)]
    every = Edgels.concatenate([e, more]).select(np.insert(np.arange(len(e)), at, len(e) + np.arange(len(order))))
    count = segments.bounds[:, 1] - segments.bounds[:, 0] + np.bincount(owner, minlength=len(segments))
    bounds = laid_out(count)
    changed = np.unique(owner)
    fitted = fit_segments(every, bounds[changed], segments.chain[changed], sigma)
    return every, segments.exchanged(changed, fitted, bounds)
