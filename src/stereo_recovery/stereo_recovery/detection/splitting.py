"""Splitting edge chains into straight segments and arcs, and joining collinear segments (thesis 3.10.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from . import splitting_kernels
from .chains import EdgeChains
from .conics import Ellipse, find_arcs
from .edgels import Edgels
from .segments import Segments, fit_segments, line_table

# An edgel belongs to a line when it is within this many of its own sigma.
STANDING_OFF = 4.5
# Collinear segments are joined across at most this many pixels.
WIDEST_GAP = 15.0
# How far the lines of such segments may miss each other beyond their own sigma, as a share of the tolerance.
WOBBLE = 0.4
# An end of a joined segment may stand off the common line by so many tolerances, unless the segment is shorter, pixels.
BENT = 3.0
SHORT = 8.0


def localisation_noise(chains: EdgeChains) -> float:
    """How far, in pixels, an edgel typically stands off the line through its neighbours: the images' real precision,
    jaggies included."""
    p = chains.edgels.position
    if len(p) < 16:
        return 0.03
    chord = p[4:] - p[:-4]
    middle = p[2:-2] - 0.5 * (p[4:] + p[:-4])
    length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-9)
    off = np.abs(chord[:, 0] * middle[:, 1] - chord[:, 1] * middle[:, 0]) / length
    return max(0.01, float(np.median(off)) / (0.6745 * np.sqrt(1.5)))


def split(
    chains: EdgeChains, tolerance: float, sigma: float, minimum: int = 4
) -> tuple[Edgels, Segments, list[Ellipse]]:
    """Recursive fit and segment, arcs told from edges, collinear edges joined across gaps.

    tolerance : pixels an edgel may stand off, more where its own sigma is large; sigma : smoothing of the detector,
    pixels. Returns the edgels in the order of the segments, the segments, and the ellipses of the arcs.
    """
    e = chains.edgels
    x, y = np.ascontiguousarray(e.position[:, 0]), np.ascontiguousarray(e.position[:, 1])
    limit = np.maximum(tolerance, STANDING_OFF * e.sigma_position)
    bounds, chain = splitting_kernels.split(x, y, limit, chains.offsets, minimum)
    segments = fit_segments(e, bounds, chain, sigma)
    arc, ellipses = find_arcs(e.position, limit, bounds, chain, chains.closed, segments.sagitta, segments.direction)
    segments = replace(segments, arc=arc)
    for _ in range(2):
        e, segments = join_collinear(e, segments, sigma, tolerance)
    return e, segments, ellipses


def join_collinear(e: Edgels, segments: Segments, sigma: float, tolerance: float) -> tuple[Edgels, Segments]:
    """Straight segments that continue each other on one line become one."""
    straight = np.flatnonzero(segments.arc < 0)
    successor = np.full(len(segments), -1)
    found = splitting_kernels.continuations(
        line_table(segments.select(straight)), WIDEST_GAP, np.radians(6.0), WOBBLE * tolerance
    )
    successor[straight[found >= 0]] = straight[found[found >= 0]]
    if (successor < 0).all():
        return e, segments
    heads, following = np.setdiff1d(np.arange(len(segments)), successor).tolist(), successor.tolist()
    chains = []
    for head in heads:
        chain = [head]
        while following[chain[-1]] >= 0:
            chain.append(following[chain[-1]])
        chains.append(chain)
    whole = fit_runs(e, segments, chains, sigma)[1]
    # Two edges that meet at a slight angle, with a scrap between them that could belong to either, are two edges.
    bent = _bent(segments, whole, chains, BENT * tolerance)
    chains = [part for chain, apart in zip(chains, bent) for part in ([[k] for k in chain] if apart else [chain])]
    return fit_runs(e, segments, chains, sigma)


def _bent(segments: Segments, whole: Segments, chains: list[list[int]], limit: float) -> np.ndarray:
    """(m,) bool: chains of segments some end of which is farther than this, pixels, from the line through all of
    them."""
    member = np.concatenate(chains)
    chain = np.repeat(np.arange(len(chains)), [len(c) for c in chains])
    across = np.stack([-whole.direction[chain, 1], whole.direction[chain, 0]], axis=1)
    off = np.maximum(
        *(np.abs(((end[member] - whole.centre[chain]) * across).sum(axis=1)) for end in (segments.start, segments.end))
    )
    # The ends of a short segment say little.
    off[segments.length[member] < SHORT] = 0.0
    return np.bincount(chain, off > limit + segments.sigma[member, 0]) > 0


def fit_runs(e: Edgels, segments: Segments, chains: list[list[int]], sigma: float) -> tuple[Edgels, Segments]:
    """One segment for each chain of segments: the edgels in the new order, and the fitted lines."""
    member = np.concatenate(chains)
    start, count = segments.bounds[member, 0], np.diff(segments.bounds[member], axis=1)[:, 0]
    total = np.cumsum(count)
    e = e.select(np.arange(total[-1]) + np.repeat(start - total + count, count))
    last = total[np.cumsum([len(chain) for chain in chains]) - 1]
    bounds = np.stack([np.append(0, last[:-1]), last], axis=1)
    heads = [chain[0] for chain in chains]
    return e, replace(fit_segments(e, bounds, segments.chain[heads], sigma), arc=segments.arc[heads])
