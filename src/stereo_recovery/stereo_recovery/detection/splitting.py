"""Splitting edge chains into straight segments and arcs, and joining collinear segments (thesis 3.10.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from msgs_py.numeric.robust import NORMAL_QUARTILE
from msgs_py.numeric.typed import BoolArray

from . import splitting_kernels
from .chains import EdgeChains
from .conics import Ellipse, find_arcs
from .edgels import Edgels
from .segments import Segments, fit_segments
from .settings import (
    BENT_TOLERANCES,
    FEW_EDGELS,
    JOINING_ROUNDS,
    LEAST_CHORD,
    LEAST_EDGELS,
    LEAST_LOCALISATION_NOISE,
    LINE_GATE,
    SHORT_PART,
    STRAIGHTNESS_SHARE,
    USUAL_LOCALISATION_NOISE,
    VARIANCE_OF_OFFSET,
)


def localisation_noise(chains: EdgeChains) -> float:
    """Sigma of an edgel's position across its edge, as the chains show it.

    It is the median offset of edgels from the chord of the second neighbours on either side, so that staircases of
    pictures without anti-aliasing count.

    Parameters
    ----------
    chains : EdgeChains

    Returns
    -------
    float
        Pixels.
    """
    p = chains.edgels.position
    if len(p) < FEW_EDGELS:
        return USUAL_LOCALISATION_NOISE
    chord = p[4:] - p[:-4]
    middle = p[2:-2] - 0.5 * (p[4:] + p[:-4])
    length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), LEAST_CHORD)
    off = np.abs(chord[:, 0] * middle[:, 1] - chord[:, 1] * middle[:, 0]) / length
    return max(LEAST_LOCALISATION_NOISE, float(np.median(off)) / (NORMAL_QUARTILE * float(np.sqrt(VARIANCE_OF_OFFSET))))


def split(
    chains: EdgeChains, tolerance: float, sigma: float, minimum: int = LEAST_EDGELS
) -> tuple[Edgels, Segments, list[Ellipse]]:
    """Recursive fit and segment; runs of segments that are arcs are marked, and collinear segments are joined.

    Parameters
    ----------
    chains : EdgeChains
    tolerance : float
        Pixels. Largest offset of an edgel from its line; more for an edgel with a large sigma of its own.
    sigma : float
        Pixels. Smoothing of the detector.
    minimum : int
        Least number of edgels in a segment.

    Returns
    -------
    edgels : Edgels
        In the order of the segments.
    segments : Segments
    ellipses : list of Ellipse
        Those of the arcs, see :attr:`.segments.Segments.arc`.

    References
    ----------
    Thesis 3.10.1, 3.10.3.
    """
    e = chains.edgels
    x, y = np.ascontiguousarray(e.position[:, 0]), np.ascontiguousarray(e.position[:, 1])
    limit = np.maximum(tolerance, LINE_GATE * e.sigma_position)
    bounds, chain = splitting_kernels.split(x, y, limit, chains.offsets, minimum)
    segments = fit_segments(e, bounds, chain, sigma)
    arc, ellipses = find_arcs(e.position, limit, segments, chains.closed)
    segments = replace(segments, arc=arc)
    for _ in range(JOINING_ROUNDS):
        e, segments = join_collinear(e, segments, sigma, tolerance)
    return e, segments, ellipses


def join_collinear(e: Edgels, segments: Segments, sigma: float, tolerance: float) -> tuple[Edgels, Segments]:
    """Join straight segments that continue each other on one line.

    Parameters
    ----------
    e : Edgels
        As the segments' bounds count.
    segments : Segments
    sigma, tolerance : float
        Pixels. As in :func:`split`.

    Returns
    -------
    edgels : Edgels
        In the order of the segments returned.
    segments : Segments
    """
    straight = np.flatnonzero(segments.arc < 0)
    successor = np.full(len(segments), -1)
    found = splitting_kernels.continuations(segments.select(straight).lines, STRAIGHTNESS_SHARE * tolerance)
    successor[straight[found >= 0]] = straight[found[found >= 0]]
    if (successor < 0).all():
        return e, segments
    heads, following = np.setdiff1d(np.arange(len(segments)), successor).tolist(), successor.tolist()
    runs = []
    for head in heads:
        run = [head]
        while following[run[-1]] >= 0:
            run.append(following[run[-1]])
        runs.append(run)
    whole = fit_runs(e, segments, runs, sigma)[1]
    # Two edges that meet at a slight angle may be joined through a short segment between them that fits either.
    bent = _bent(segments, whole, runs, BENT_TOLERANCES * tolerance)
    runs = [part for run, apart in zip(runs, bent) for part in ([[k] for k in run] if apart else [run])]
    return fit_runs(e, segments, runs, sigma)


def _bent(segments: Segments, whole: Segments, runs: list[list[int]], limit: float) -> BoolArray:
    """(m,) bool: runs of segments with an end farther than limit, pixels, from the line through all (whole, m)."""
    member = np.concatenate(runs)
    run = np.repeat(np.arange(len(runs)), [len(r) for r in runs])
    across = np.stack([-whole.direction[run, 1], whole.direction[run, 0]], axis=1)
    off = np.maximum(
        *(np.abs(((end[member] - whole.centre[run]) * across).sum(axis=1)) for end in (segments.start, segments.end))
    )
    off[segments.length[member] < SHORT_PART] = 0.0
    bent: BoolArray = np.bincount(run, off > limit + segments.sigma[member, 0]) > 0
    return bent


def fit_runs(e: Edgels, segments: Segments, runs: list[list[int]], sigma: float) -> tuple[Edgels, Segments]:
    """One segment for each run of segments.

    Parameters
    ----------
    e : Edgels
        As the segments' bounds count.
    segments : Segments
    runs : list of lists of int
        Segments that belong together, in their order.
    sigma : float
        Pixels. Smoothing of the detector.

    Returns
    -------
    edgels : Edgels
        In the order of the runs.
    segments : Segments
        One a run.
    """
    member = np.concatenate(runs)
    start, count = segments.bounds[member, 0], np.diff(segments.bounds[member], axis=1)[:, 0]
    total = np.cumsum(count)
    e = e.select(np.arange(total[-1]) + np.repeat(start - total + count, count))
    last = total[np.cumsum([len(run) for run in runs]) - 1]
    bounds = np.stack([np.append(0, last[:-1]), last], axis=1)
    heads = [run[0] for run in runs]
    return e, replace(fit_segments(e, bounds, segments.chain[heads], sigma), arc=segments.arc[heads])
