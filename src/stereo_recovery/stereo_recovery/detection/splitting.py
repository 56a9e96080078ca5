"""Splitting edge chains into straight segments and arcs, and joining collinear segments (thesis 3.10.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from msgs_py.numeric.robust import NORMAL_QUARTILE
from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import BoolArray, IntArray

from . import chain_kernels, splitting_kernels
from .chains import EdgeChains
from .conics import Ellipse, find_arcs
from .edgels import Edgels
from .segments import Segments, fit_segments, laid_out
from .settings import (
    BENT_TOLERANCES,
    FEW_EDGELS,
    JOINING_ROUNDS,
    LEAST_EDGELS,
    LEAST_LOCALISATION_NOISE,
    LINE_GATE,
    ON_LINE,
    SEGMENT_EXCESS,
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
    length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), NOT_ZERO)
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
    e, segments = _significant(e, segments)
    return e, segments, ellipses


def _significant(e: Edgels, segments: Segments) -> tuple[Edgels, Segments]:
    """Segments that stand out of the noise as a whole, and those of arcs; with their edgels, in their order.

    Instead of a second threshold (Canny, PAMI 8(6), 1986) a sum over consecutive edgels decides, after E. Page,
    "Continuous inspection schemes", Biometrika 41, 1954.
    """
    clear = chain_kernels.evidence(e.prominence, segments.bounds) > SEGMENT_EXCESS
    kept = np.flatnonzero(clear | (segments.arc >= 0))
    if len(kept) == len(segments):
        return e, segments
    own = segments.select(kept)
    return e.select(_edgels_of(own.bounds)), replace(own, bounds=laid_out(own.bounds[:, 1] - own.bounds[:, 0]))


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
    found = splitting_kernels.continuations(segments.select(straight).lines, STRAIGHTNESS_SHARE * tolerance, ON_LINE)
    successor = np.full(len(segments), -1)
    successor[straight[found >= 0]] = straight[found[found >= 0]]
    head, place = splitting_kernels.runs_of(successor)
    order = np.lexsort((place, head))
    member = order[(np.bincount(head, minlength=len(head)) > 1)[head[order]]]
    if len(member) == 0:
        return e, segments
    firsts = np.flatnonzero(place[member] == 0)
    run = np.repeat(np.arange(len(firsts)), np.diff(firsts, append=len(member)))
    parts = segments.select(member)
    bounds = _of_runs(parts.bounds, firsts)
    whole = fit_segments(e.select(_edgels_of(parts.bounds)), bounds, parts.chain[firsts], sigma)
    # Two edges that meet at a slight angle may be joined through a short segment between them that fits either.
    bent = _bent(parts, whole, run, BENT_TOLERANCES * tolerance)
    apart = member[bent[run]]
    head[apart], place[apart] = apart, 0
    return _with_joined(e, segments, np.lexsort((place, head)), place, whole.select(~bent))


def _bent(parts: Segments, whole: Segments, run: IntArray, limit: float) -> BoolArray:
    """(m,) bool: runs of segments with an end farther than limit, pixels, from the line through all (whole, m).

    run : (k,) that each of the segments is part of
    """
    across = np.stack([-whole.direction[run, 1], whole.direction[run, 0]], axis=1)
    off = np.maximum(*(np.abs(((end - whole.centre[run]) * across).sum(axis=1)) for end in (parts.start, parts.end)))
    off[parts.length < SHORT_PART] = 0.0
    bent: BoolArray = np.bincount(run, off > limit + parts.sigma[:, 0]) > 0
    return bent


def _edgels_of(bounds: IntArray) -> IntArray:
    """Indices of the edgels of runs [first, last), run after run; bounds : (n, 2) int."""
    count = bounds[:, 1] - bounds[:, 0]
    total = np.cumsum(count)
    every: IntArray = np.arange(count.sum()) + np.repeat(bounds[:, 0] - total + count, count)
    return every


def _of_runs(bounds: IntArray, firsts: IntArray) -> IntArray:
    """(m, 2): bounds of runs of segments once the edgels of all segments, [first, last) each, stand one after another.

    firsts : (m,) the segment that each run begins with
    """
    return laid_out(np.add.reduceat(bounds[:, 1] - bounds[:, 0], firsts))


def _with_joined(
    e: Edgels, segments: Segments, order: IntArray, place: IntArray, whole: Segments
) -> tuple[Edgels, Segments]:
    """The segments, each run of them replaced by one (whole), where its first stood; and the edgels in their order.

    order : (n,) the segments, run after run; place : (n,) of each in its run
    """
    firsts = np.flatnonzero(place[order] == 0)
    bounds = segments.bounds[order]
    joined = np.flatnonzero(np.diff(firsts, append=len(order)) > 1)
    result = segments.select(order[firsts]).exchanged(joined, whole, _of_runs(bounds, firsts))
    return e.select(_edgels_of(bounds)), result
