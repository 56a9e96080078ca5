"""What ties the disparities of straight edges to each other: the factors of :mod:`.estimate`.

Along its left segment an edge has the disparity d(s) = a + b s; its unknowns are x = (a, b). Every factor makes one
statement, h x_e - g x_f = value, give or take a sigma, that holds unless an accident of the views made it:

* junction: two edges that meet in an image have one disparity there;
* collinear: two parts of an edge that is broken in an image lie on one line in both;
* rounded corner: their lines cross beyond their chains, in both images;
* end: both segments of an edge end at one point, whose columns give its disparity;
* parallel: an edge runs in the direction of others, see :mod:`.parallel_groups`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, IntArray

from ..detection.segments import line_table
from ..matching.settings import SEEN_AS_ONE
from ..matching.stereo_segments import StereoSegments
from .line_pair_kernels import collinear_pairs, rounded_corners
from .settings import (
    COLLINEAR_SIGMA,
    CORNER_SIGMA,
    DOUBTFUL_PRIOR,
    HEIGHT_SIGMA,
    JUNCTION_PRIOR,
    LOOSE_END_SIGMA,
    SPREAD,
    STEEP,
    T_PRIOR,
)


@dataclass(frozen=True, eq=False)
class Factors:
    """k statements about edges' disparities.

    Attributes
    ----------
    edge, other : (k,) int64
        The edges e and f; f is -1 where the statement is about one edge.
    row, other_row : (k, 2) float64
        h and g.
    value, sigma : (k,) float64, pixels
        What h x_e - g x_f is, and its standard deviation, if the statement holds.
    prior : (k,) float64
        Probability that it does.
    spread : (k,) float64, pixels
        Range over which the product is even if it does not.
    with_next : (k,) bool
        Whether it and the next one are two numbers of one thing, about the same edges: both hold, or neither does.
    """

    edge: IntArray
    other: IntArray
    row: FloatArray
    other_row: FloatArray
    value: FloatArray
    sigma: FloatArray
    prior: FloatArray
    spread: FloatArray
    with_next: BoolArray

    def __len__(self) -> int:
        return len(self.edge)

    @property
    def first(self) -> BoolArray:
        """(k,) bool: False for those that hold together with the one before."""
        return np.asarray(~np.append(False, self.with_next)[: len(self)])

    def misses(self, x: AnyArray, covariance: AnyArray) -> tuple[FloatArray, FloatArray]:
        """What statements about one edge each miss edges by, that know nothing of them.

        Parameters
        ----------
        x, covariance : (n, 2), (n, 2, 2)
            The edges' unknowns.

        Returns
        -------
        off : (k,) float64, pixels
            Values less what the edges say.
        variance : (k,) float64
            Of that, if the statements hold.
        """
        off = self.value - np.einsum('ki,ki->k', self.row, x[self.edge])
        return off, np.einsum('ki,kij,kj->k', self.row, covariance[self.edge], self.row) + self.sigma**2

    def select(self, index: AnyArray) -> Factors:
        """A subset: (m,) indices or (k,) bool."""
        return Factors(*(getattr(self, f.name)[index] for f in fields(self)))

    @staticmethod
    def concatenate(parts: list[Factors]) -> Factors:
        """All of them, in their order."""
        return Factors(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Factors)))

    @staticmethod
    def of_one(
        edge: IntArray, row: FloatArray, value: FloatArray, sigma: FloatArray, prior: FloatArray, spread: FloatArray
    ) -> Factors:
        """Statements about one edge each; arrays as of the class."""
        k = len(edge)
        none = np.zeros(k, bool)
        return Factors(edge, np.full(k, -1), row, np.zeros((k, 2)), value, sigma, prior, spread, none)

    @staticmethod
    def none() -> Factors:
        """No statements."""
        empty = np.zeros(0)
        return Factors.of_one(np.zeros(0, np.int64), np.zeros((0, 2)), empty, empty, empty, empty)


def _left_row(seen: StereoSegments, edge: IntArray, point: FloatArray) -> FloatArray:
    """(k, 2) rows h so that h x is the disparity of edges where the left image shows them at points (k, 2)."""
    left = seen.segments[0]
    i = seen.matches.left[edge]
    s = ((point - left.centre[i]) * left.direction[i]).sum(axis=1)
    return np.stack([np.ones(len(edge)), s], axis=1)


def _disparities(
    seen: StereoSegments, edge: IntArray, point: FloatArray, found: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """(k,) each: disparities of edges where the right image shows them at points (k, 2), and their variances."""
    x, covariance = found[0][edge], found[1][edge]
    # The left image shows it d pixels farther to the right: d = a + b (s + t_u d).
    row = _left_row(seen, edge, point)
    along = seen.segments[0].direction[seen.matches.left[edge], 0]
    stretch = np.clip(1.0 - x[:, 1] * along, 0.5, 2.0)
    disparity = np.einsum('ki,ki->k', row, x) / stretch
    row[:, 1] += along * disparity
    return disparity, np.einsum('ki,kij,kj->k', row, covariance, row) / stretch**2


def _in_left(
    seen: StereoSegments, edges: tuple[IntArray, IntArray], point: FloatArray, found: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """(k, 2) where the left image shows points (k, 2) of the right one, by the better known of two edges there."""
    (one, variance), (other, its) = (_disparities(seen, edge, point, found) for edge in edges)
    return np.asarray(point + np.stack([np.where(variance < its, one, other), np.zeros(len(point))], axis=1))


def _one_disparity(
    rows: tuple[FloatArray, FloatArray], pair: tuple[IntArray, IntArray], sigma: float, prior: FloatArray | float
) -> Factors:
    """Statements that two edges have one disparity: k edges each, and what :func:`_left_row` says of them."""
    k = len(pair[0])
    numbers = np.zeros(k), np.full(k, sigma), np.broadcast_to(prior, k), np.full(k, SPREAD)
    return Factors(*pair, *rows, *numbers, np.zeros(k, bool))


def _pair_number(seen: StereoSegments, e: IntArray, f: IntArray) -> IntArray:
    """(k,) a number for each two edges, in either order."""
    number: IntArray = np.minimum(e, f) * len(seen.matches) + np.maximum(e, f)
    return number


def junction_factors(seen: StereoSegments, found: tuple[FloatArray, FloatArray]) -> Factors:
    """Edges that meet in an image have one disparity there.

    Parameters
    ----------
    seen : StereoSegments
        n edges.
    found : (n, 2), (n, 2, 2)
        Their unknowns, roughly, and the covariance.
    """
    count = len(seen.matches)
    neighbours = seen.neighbours(0), seen.neighbours(1)
    parts: list[Factors] = []
    told = np.zeros(0, np.int64)
    for image, mine, others in ((0, *neighbours), (1, *neighbours[::-1])):
        # Parts of arcs end where their chains happen to be split.
        e, end = np.nonzero((mine >= 0) & (mine != np.arange(count)[:, None]) & seen.straight[:, None])
        e, end = e[seen.straight[mine[e, end]]], end[seen.straight[mine[e, end]]]
        f = mine[e, end]
        # Two edges meet once, and what both images show is one statement.
        pair = _pair_number(seen, e, f)
        fresh = np.zeros(len(e), bool)
        fresh[np.unique(pair, return_index=True)[1]] = True
        fresh &= ~np.isin(pair, told)
        told = np.concatenate([told, pair])
        e, end, f = e[fresh], end[fresh], f[fresh]
        other = seen.ends[1 - image].neighbour[e, end]
        prior = np.where(others[e, end] == f, JUNCTION_PRIOR, np.where(other < 0, SEEN_AS_ONE, DOUBTFUL_PRIOR))
        hidden = seen.ends[0].t_junction[e, end] | seen.ends[1].t_junction[e, end]
        point = seen.points[image][e, end]
        if image == 1:
            point = _in_left(seen, (e, f), point, found)
        rows = _left_row(seen, e, point), _left_row(seen, f, point)
        parts.append(_one_disparity(rows, (e, f), CORNER_SIGMA, np.where(hidden, T_PRIOR, prior)))
    return Factors.concatenate(parts)


def end_factors(seen: StereoSegments) -> Factors:
    """Both segments of an edge end at one point: its columns differ by the disparity.

    Parameters
    ----------
    seen : StereoSegments
        n edges.
    """
    mine, other = seen.ends
    corner = (mine.neighbour >= 0) & (other.neighbour >= 0)
    # Where one chain just stops, the other's end is where it stops as well, and not its corner.
    p, q = (np.where(corner[..., None], points, stops) for points, stops in zip(seen.points, seen.chain_ends))
    own_sigma = [np.where(corner, side.sigma, LOOSE_END_SIGMA) for side in (mine, other)]
    run = [side.direction[index][:, None] for side, index in zip(seen.segments, seen.index)]
    sigma, height = (
        np.sqrt((own_sigma[0] * run[0][..., c]) ** 2 + (own_sigma[1] * run[1][..., c]) ** 2 + least**2)
        for c, least in ((0, CORNER_SIGMA), (1, HEIGHT_SIGMA))
    )
    neighbours = seen.neighbours(0), seen.neighbours(1)
    # Where both meet one edge the junction tells; where they meet different ones the corners may be two.
    told = (neighbours[0] == neighbours[1]) & (neighbours[0] >= 0)
    third = corner & (neighbours[0] != neighbours[1])
    prior = np.where(third, DOUBTFUL_PRIOR, SEEN_AS_ONE)
    prior = np.where(mine.t_junction | other.t_junction, T_PRIOR, prior)
    # Two heights speak against one point; that they agree says little, since segments that match cover the same rows.
    off = (p - q)[..., 1] / height
    odds = prior / (1.0 - prior) * np.exp(-0.5 * off**2) / (np.sqrt(2.0 * np.pi) * height) * SPREAD
    prior = np.clip(np.minimum(prior, odds / (1.0 + odds)), 1e-3, 0.99)
    steep = np.minimum(np.abs(run[0][..., 1]), np.abs(run[1][..., 1])) > STEEP
    e, end = np.nonzero(~told & ~steep & (seen.straight & seen.paired)[:, None])
    abscissa = np.where(corner, mine.abscissa, seen.segments[0].extent[seen.index[0]])
    return Factors.of_one(
        e,
        np.stack([np.ones(len(e)), abscissa[e, end]], axis=1),
        (p - q)[e, end, 0],
        sigma[e, end],
        prior[e, end],
        np.full(len(e), SPREAD),
    )


def rounded_corner_factors(seen: StereoSegments) -> Factors:
    """Edges whose lines cross beyond the ends of their chains, at the same ends in both images, meet there.

    Of those that meet in an image :func:`junction_factors` says it.

    Parameters
    ----------
    seen : StereoSegments
        n edges.
    """
    loose = (seen.ends[0].neighbour < 0) | (seen.ends[1].neighbour < 0)
    tables = line_table(seen.segments[0]), line_table(seen.segments[1])
    pair, point = rounded_corners(tables, seen.index, seen.flip, loose & (seen.straight & seen.paired)[:, None])
    meeting = []
    for image in (0, 1):
        neighbour = seen.neighbours(image)
        e, end = np.nonzero(neighbour >= 0)
        meeting.append(_pair_number(seen, e, neighbour[e, end]))
    fresh = ~np.isin(_pair_number(seen, *pair.T), np.concatenate(meeting))
    (e, f), point = pair[fresh].T, point[fresh]
    rows = _left_row(seen, e, point), _left_row(seen, f, point)
    return _one_disparity(rows, (e, f), CORNER_SIGMA, DOUBTFUL_PRIOR)


def collinear_factors(seen: StereoSegments) -> Factors:
    """Edges along the rows that continue each other are parts of one: their disparities agree along both.

    Parameters
    ----------
    seen : StereoSegments
        n edges.
    """
    level = np.abs(seen.segments[0].direction[seen.index[0], 1]) < STEEP
    tables = line_table(seen.segments[0]), line_table(seen.segments[1])
    pair, point = collinear_pairs(tables, seen.index, level & seen.straight & seen.paired)
    e, f = np.repeat(pair, 2, axis=0).T
    place = point.reshape(-1, 2)
    rows = _left_row(seen, e, place), _left_row(seen, f, place)
    both = _one_disparity(rows, (e, f), COLLINEAR_SIGMA, SEEN_AS_ONE)
    return replace(both, with_next=np.arange(len(e)) % 2 == 0)
