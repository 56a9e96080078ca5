"""Splitting strings into straight pieces and arcs, and where the pieces meet (thesis 3.10.1, 3.10.3)."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from . import junction_kernels, splitting_kernels
from .chains import Strings
from .conics import Ellipse, find_arcs
from .edgels import Edgels

# Neighbouring edgels share pixels, so that several count as one: smoothing correlates them over sqrt(4 pi) sigma; the
# errors of lines against the truth say three quarters of that.
CORRELATION_LENGTH = 0.75 * np.sqrt(4.0 * np.pi)
# Pixels next to a corner whose edgels are pulled towards it.
CORNER_REACH = 3.0
# An edgel belongs to a line when it is within this many of its own sigma.
STANDING_OFF = 4.5
# What a bow adds to the sigma of a line: to its offset, and (over its length) to its slope. Noise alone bows a straight
# line by 3.35 times the sigma of its offset (one sigma: 3/2 of the second Legendre coefficient's); a little more is
# taken off.
BOW_OFFSET = 0.3
BOW_SLOPE = 2.0
NOISE_BOW = 4.0
# An edge is suspect when its width differs from the picture's by more than this share, or so many times the median;
# its place is then uncertain by so many pixels times the root of the excess. Few edgels say nothing, and neither do
# widths in a picture where the median is above a limit (out of focus, uneven light).
UNUSUAL = 0.05
BLURRED = 1.0
DEVIATIONS, LONG, VARIED = 3.0, 10, 0.05
# Another edge close beside a piece moves its edgels; they tell by how much at most, and this share of it is the sigma
# of the line, within the bounds given, pixels: less is noise, and with more the other edge is another piece.
MOVED, LEAST_SHIFT, MOST_MOVED = 0.5, 0.05, 0.7
# Pieces flatter than this (sine) may run either way along their rows.
LEVEL = 0.1
# Collinear pieces are joined across at most this many pixels.
WIDEST_GAP = 15.0
# How far the lines of such pieces may miss each other beyond their own sigma, as a share of the tolerance.
WOBBLE = 0.4
# An end of a joined piece may stand off the common line by so many tolerances, unless the piece is shorter, pixels.
BENT = 3.0
SHORT = 8.0


@dataclass(frozen=True, eq=False)
class Pieces:
    """n straight pieces of strings, each fitted by orthogonal regression.

    bounds : (n, 2) int64, edgels [first, last) in the order that came with the pieces; string : (n,) int64
    centre, direction : (n, 2) float64, pixels; the unit direction runs along the string
    reach : (n, 2) float64, pixels: first and last place along the direction, from the centre
    rms, bow : (n,) float64, pixels: residual, and how far the middle stands off the chord of the ends, beyond noise
    count : (n,) float64, edgels used in the fit
    sigma : (n, 2) float64: of the offset at the centre, pixels, and of the slope, radians
    magnitude : (n,) float64, mean gradient, grey levels per pixel
    arc : (n,) int32, the ellipse it is a piece of, or -1: straight
    """

    bounds: np.ndarray
    string: np.ndarray
    centre: np.ndarray
    direction: np.ndarray
    reach: np.ndarray
    rms: np.ndarray
    bow: np.ndarray
    count: np.ndarray
    sigma: np.ndarray
    magnitude: np.ndarray
    arc: np.ndarray

    def __len__(self) -> int:
        return len(self.bounds)

    def select(self, index: np.ndarray) -> Pieces:
        return Pieces(*(getattr(self, f.name)[index] for f in fields(self)))

    @property
    def start(self) -> np.ndarray:
        """(n, 2) float64, pixels."""
        return self.centre + self.reach[:, :1] * self.direction

    @property
    def end(self) -> np.ndarray:
        """(n, 2) float64, pixels."""
        return self.centre + self.reach[:, 1:] * self.direction

    @property
    def length(self) -> np.ndarray:
        """(n,) float64, pixels."""
        return self.reach[:, 1] - self.reach[:, 0]


def opposed(left: Pieces, right: Pieces, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """(...) bool: whether left pieces i and right pieces j that show the same edges are directed against each other, as
    when contrast changes its sign between the views. Rows have one order in both images, columns need not have."""
    t, u = left.direction[i], right.direction[j]
    rows = t[..., 1] * u[..., 1]
    return np.where(np.minimum(np.abs(t[..., 1]), np.abs(u[..., 1])) > LEVEL, rows, rows + t[..., 0] * u[..., 0]) < 0.0


def line_table(pieces: Pieces) -> np.ndarray:
    """(n, 8) float64 for the compiled loops: centre, direction, reach, sigma."""
    return np.hstack([pieces.centre, pieces.direction, pieces.reach, pieces.sigma])


def roughness(strings: Strings) -> float:
    """How far, in pixels, an edgel typically stands off the line through its neighbours: the images' real precision,
    jaggies included."""
    p = strings.edgels.position
    if len(p) < 16:
        return 0.03
    chord = p[4:] - p[:-4]
    middle = p[2:-2] - 0.5 * (p[4:] + p[:-4])
    length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-9)
    off = np.abs(chord[:, 0] * middle[:, 1] - chord[:, 1] * middle[:, 0]) / length
    return max(0.01, float(np.median(off)) / (0.6745 * np.sqrt(1.5)))


def split(strings: Strings, tolerance: float, sigma: float, minimum: int = 4) -> tuple[Edgels, Pieces, list[Ellipse]]:
    """Recursive fit and segment, arcs told from edges, collinear edges joined across gaps.

    tolerance : pixels an edgel may stand off, more where its own sigma is large; sigma : smoothing of the detector,
    pixels. Returns the edgels in the order of the pieces, the pieces, and the ellipses of the arcs.
    """
    e = strings.edgels
    x, y = np.ascontiguousarray(e.position[:, 0]), np.ascontiguousarray(e.position[:, 1])
    limit = np.maximum(tolerance, STANDING_OFF * e.sigma_position)
    bounds, string = splitting_kernels.split(x, y, limit, strings.offsets, minimum)
    pieces = fit_pieces(e, bounds, string, sigma)
    arc, ellipses = find_arcs(e.position, limit, bounds, string, strings.closed, pieces.bow, pieces.direction)
    pieces = replace(pieces, arc=arc)
    for _ in range(2):
        e, pieces = joined(e, pieces, sigma, tolerance)
    return e, pieces, ellipses


def joined(e: Edgels, pieces: Pieces, sigma: float, tolerance: float) -> tuple[Edgels, Pieces]:
    """Straight pieces that continue each other on one line become one."""
    straight = np.flatnonzero(pieces.arc < 0)
    successor = np.full(len(pieces), -1)
    found = splitting_kernels.continuations(
        line_table(pieces.select(straight)), WIDEST_GAP, np.radians(6.0), WOBBLE * tolerance
    )
    successor[straight[found >= 0]] = straight[found[found >= 0]]
    if (successor < 0).all():
        return e, pieces
    heads, following = np.setdiff1d(np.arange(len(pieces)), successor).tolist(), successor.tolist()
    chains = []
    for head in heads:
        chain = [head]
        while following[chain[-1]] >= 0:
            chain.append(following[chain[-1]])
        chains.append(chain)
    whole = fit_chains(e, pieces, chains, sigma)[1]
    # Two edges that meet at a slight angle, with a scrap between them that could belong to either, are two edges.
    bent = _bent(pieces, whole, chains, BENT * tolerance)
    chains = [part for chain, apart in zip(chains, bent) for part in ([[k] for k in chain] if apart else [chain])]
    return fit_chains(e, pieces, chains, sigma)


def _bent(pieces: Pieces, whole: Pieces, chains: list[list[int]], limit: float) -> np.ndarray:
    """(m,) bool: chains of pieces some end of which is farther than this, pixels, from the line through all of them."""
    member = np.concatenate(chains)
    chain = np.repeat(np.arange(len(chains)), [len(c) for c in chains])
    across = np.stack([-whole.direction[chain, 1], whole.direction[chain, 0]], axis=1)
    off = np.maximum(
        *(np.abs(((end[member] - whole.centre[chain]) * across).sum(axis=1)) for end in (pieces.start, pieces.end))
    )
    # The ends of a short piece say little.
    off[pieces.length[member] < SHORT] = 0.0
    return np.bincount(chain, off > limit + pieces.sigma[member, 0]) > 0


def fit_chains(e: Edgels, pieces: Pieces, chains: list[list[int]], sigma: float) -> tuple[Edgels, Pieces]:
    """One piece for each chain of pieces: the edgels in the new order, and the fitted lines."""
    member = np.concatenate(chains)
    start, count = pieces.bounds[member, 0], np.diff(pieces.bounds[member], axis=1)[:, 0]
    total = np.cumsum(count)
    e = e.select(np.arange(total[-1]) + np.repeat(start - total + count, count))
    last = total[np.cumsum([len(chain) for chain in chains]) - 1]
    bounds = np.stack([np.append(0, last[:-1]), last], axis=1)
    heads = [chain[0] for chain in chains]
    return e, replace(fit_pieces(e, bounds, pieces.string[heads], sigma), arc=pieces.arc[heads])


def unusual(e: Edgels, bounds: np.ndarray) -> np.ndarray:
    """(n,) float64: by how much the width of runs of edgels differs from the usual one, as a share, beyond what is
    common in the picture; nothing where some edges are out of focus."""
    if len(bounds) == 0:
        return np.zeros(0)
    off = np.abs(splitting_kernels.medians(e.width, bounds) / float(np.median(e.width)) - 1.0)
    count = np.diff(bounds, axis=1)[:, 0]
    common = float(np.median(np.repeat(off, count)))
    if common > VARIED:
        return np.zeros(len(bounds))
    return np.where(count >= LONG, np.maximum(off - max(UNUSUAL, DEVIATIONS * common), 0.0), 0.0)


def fit_pieces(e: Edgels, bounds: np.ndarray, string: np.ndarray, sigma: float) -> Pieces:
    """Lines through given runs of edgels (n, 2)."""
    x, y = np.ascontiguousarray(e.position[:, 0]), np.ascontiguousarray(e.position[:, 1])
    rows = splitting_kernels.fit_lines(x, y, e.sigma_position, bounds, CORNER_REACH)
    weight, moment, count = rows[:, 9], rows[:, 10], np.maximum(rows[:, 8], 1.0)
    # Edgels a pixel: a slanting edge has fewer, and correlation is a matter of distance.
    density = count / np.maximum(rows[:, 5] - rows[:, 4], 1.0)
    together = np.maximum(1.0, CORRELATION_LENGTH * sigma * np.minimum(density, 1.5))
    excess = np.maximum(1.0, rows[:, 6] * np.sqrt(weight / count))
    fit_sigma = excess[:, None] * np.sqrt(together[:, None] / np.maximum(np.stack([weight, moment], axis=1), 1e-9))
    # A line that bows is not quite one: two edges that meet at a slight angle, a lens, a fold. Its place is as vague.
    bow = np.sqrt(np.maximum(rows[:, 7] ** 2 - (NOISE_BOW * fit_sigma[:, 0]) ** 2, 0.0))
    length = np.maximum(rows[:, 5] - rows[:, 4], 1.0)
    fit_sigma = np.hypot(fit_sigma, np.column_stack([BOW_OFFSET * bow, BOW_SLOPE * bow / length]))
    # So is one that is narrower or wider than a step is in this picture, or brighter on one side than a step is: it is
    # two edges, or a shadow.
    moved = MOVED * np.maximum(splitting_kernels.medians(e.shift, bounds) - LEAST_SHIFT, 0.0)
    spread = np.hypot(BLURRED * np.sqrt(unusual(e, bounds)), np.minimum(moved, MOST_MOVED))
    fit_sigma = np.hypot(fit_sigma, np.column_stack([spread, spread / length]))
    total = np.concatenate([[0.0], np.cumsum(e.magnitude)])
    magnitude = (total[bounds[:, 1]] - total[bounds[:, 0]]) / np.maximum(bounds[:, 1] - bounds[:, 0], 1)
    # Which way it bends is told even where noise hides by how much.
    signed = np.copysign(np.maximum(bow, 1e-9), rows[:, 7])
    return Pieces(
        bounds,
        string,
        rows[:, 0:2],
        rows[:, 2:4],
        rows[:, 4:6],
        rows[:, 6],
        signed,
        rows[:, 8],
        fit_sigma,
        magnitude,
        np.full(len(bounds), -1, np.int32),
    )


@dataclass(frozen=True, eq=False)
class Corners:
    """Where each end of each piece really is: on the line it runs into.

    place : (n, 2) float64, pixels along the piece from its centre, first and last end, corrected where ``other`` >= 0
    other : (n, 2) int32, the piece it meets there, or -1; through : (n, 2) bool, that piece goes on beyond the meeting
    sigma : (n, 2) float64, pixels, of the place
    """

    place: np.ndarray
    other: np.ndarray
    through: np.ndarray
    sigma: np.ndarray


def whole_pieces(pieces: Pieces) -> np.ndarray:
    """(n,) bool: pieces long enough to mean something, without the scraps at the ends of longer ones."""
    return (pieces.length >= 3.0) & ((pieces.arc >= 0) | ~junction_kernels.scraps(line_table(pieces), 16.0, 16.0, 2.5))


def corners(pieces: Pieces, gap: float = 18.0) -> Corners:
    """Intersect each piece with the one its ends run into, at most ``gap`` pixels away (less at square corners)."""
    if len(pieces) == 0:
        return Corners(np.zeros((0, 2)), np.zeros((0, 2), np.int32), np.zeros((0, 2), bool), np.zeros((0, 2)))
    place, other, through, sigma = junction_kernels.meet(line_table(pieces), gap)
    return Corners(place, other, through, sigma)
