"""Straight edges as one least squares: the disparities of all edges, with the factors that hold.

Every edge has what its own two lines say, a normal distribution of its unknowns, and factors tie it to others. A factor
holds with some probability, and is else an accident whose value is even over a range. Which hold is decided one after
another by what all the others say: the residual of a factor is compared with its variance as it would be without it,
the least likely goes first and the likeliest comes first. What comes out is a minimum of one robust least squares, with
the covariances of the same normal equations.

References
----------
W. Baarda, "A testing procedure for use in geodetic networks", 1968; H. Yang, P. Antonante, V. Tzoumas and L. Carlone,
"Graduated non-convexity for robust spatial perception", RA-L 5(2), 2020.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from msgs_py.numeric.robust import NORMAL_QUARTILE
from msgs_py.numeric.threads import parts_of, spread
from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, IntArray

from ..detection.settings import SMALLEST
from .equation_kernels import Solution
from .factors import Factors
from .normal_equations import NormalEquations
from .settings import (
    ACCIDENT,
    LEAST_OPEN,
    LEAST_REST,
    MATCH_SIGMA,
    MATCH_SLOPE,
    OPEN_SIGMA,
    PRIOR_ROUNDS,
    REDUNDANCY,
    START_ROUNDS,
    WELL_MEASURED,
)
from .start_kernels import Statements, likeliest


@dataclass(frozen=True, eq=False)
class OwnLines:
    """What the two lines of n edges say of them, and no one else.

    Attributes
    ----------
    information, vector : (n, 2, 2), (n, 2)
        Of the unknowns (a, b).
    extent : (n, 2) float64, pixels
        The part of each edge that counts.
    with_line : (n, 2, 2), optional
        Covariance of the vector with offset (pixels) and direction (radians) of the left line; none: unrelated.
    """

    information: FloatArray
    vector: FloatArray
    extent: FloatArray
    with_line: FloatArray | None = None

    @cached_property
    def covariance(self) -> FloatArray:
        """(n, 2, 2) of the unknowns."""
        return np.asarray(np.linalg.inv(self.information), np.float64)

    @cached_property
    def x(self) -> FloatArray:
        """(n, 2) unknowns."""
        return np.asarray(np.einsum('nij,nj->ni', self.covariance, self.vector))

    @property
    def ends(self) -> FloatArray:
        """(n, 2, 2) rows h: h x is the disparity at either end."""
        return np.stack([np.ones_like(self.extent), self.extent], axis=-1)

    @cached_property
    def are_open(self) -> BoolArray:
        """(n,) bool: edges whose disparity at an end they know no better than to OPEN_SIGMA."""
        return np.asarray(end_sigma(self.covariance, self).max(axis=1) >= OPEN_SIGMA)

    def covariance_with_line(self, covariance: FloatArray) -> FloatArray:
        """(n, 2, 2) of unknowns of this covariance (n, 2, 2) with offset and direction of the left lines."""
        return np.zeros_like(covariance) if self.with_line is None else np.asarray(covariance @ self.with_line)

    def about(self, rough: FloatArray) -> OwnLines:
        """With the prior that an edge lies within MATCH_SIGMA of disparities (n,), and not along the line of sight."""
        information = self.information + np.einsum('nei,nej->nij', self.ends, self.ends) / MATCH_SIGMA**2
        information[:, 1, 1] += MATCH_SLOPE**-2.0
        vector = self.vector + np.einsum('nei,n->ni', self.ends, rough) / MATCH_SIGMA**2
        return OwnLines(information, vector, self.extent, self.with_line)


@dataclass(frozen=True, eq=False)
class Estimate:
    """Disparities a + b s of n edges by k factors.

    Attributes
    ----------
    lines, factors : OwnLines, Factors
        What it was made of.
    solution : Solution
        Least squares with the factors that hold, by the stated sigmas.
    used : (k,) bool
        The factors that hold.
    holds : (k,) float64
        Probability of each, by what all others say.
    misfit : (k,) float64
        By how many sigma each factor that holds misses what all others say; NaN where they do not say it.
    unit_variance : float
        How much larger covariances are than the stated sigmas have them; those of x hold it.
    place : (n,) int
        The order in which edges were eliminated, for estimates of much the same factors.
    """

    lines: OwnLines
    factors: Factors
    solution: Solution
    used: BoolArray
    holds: FloatArray
    misfit: FloatArray
    unit_variance: float
    place: IntArray

    @property
    def x(self) -> FloatArray:
        """(n, 2) unknowns."""
        return self.solution.x

    @cached_property
    def covariance(self) -> FloatArray:
        """(n, 2, 2) of them."""
        return self.solution.covariance * self.unit_variance


def without_itself(factors: Factors, solution: Solution, used: BoolArray) -> tuple[FloatArray, FloatArray]:
    """(k,) each: residuals of factors and the variances of their products, in a least squares of all others."""
    # Taking a used factor out of a least squares.
    share = np.where(used, np.maximum(1.0 - solution.variance / factors.sigma**2, LEAST_REST), 1.0)
    return solution.residual / share, solution.variance / share


def _statements(factors: Factors, count: int) -> Statements:
    """The factors by their ``count`` edges."""
    both = np.flatnonzero(factors.other >= 0)
    factor = np.concatenate([np.arange(len(factors)), both])
    owner = np.concatenate([factors.edge, factors.other[both]])
    mirrored = np.arange(len(factor)) >= len(factors)
    order = np.argsort(owner, kind='stable')
    first = np.searchsorted(owner[order], np.arange(count + 1))
    arrays = (getattr(factors, f.name) for f in fields(Factors))
    return Statements(first, factor[order], mirrored[order], *arrays)


def _start(equations: NormalEquations, statements: Statements, lines: OwnLines, used: BoolArray) -> BoolArray:
    """(k,) bool: ``used``, and of edges that are open with those the statements of their likeliest depths."""
    used = used.copy()

    def asked(part: tuple[int, int]) -> bool:
        """Some of the open edges; no statement that is asked is about two of them."""
        return _asked(statements, open_edges[part[0] : part[1]], known, solution, lines, used)

    for _ in range(START_ROUNDS):
        solution = equations.solve(used)
        known = end_sigma(solution.covariance, lines).max(axis=1) < WELL_MEASURED
        open_edges = np.flatnonzero(~known)
        if not any(spread(asked, parts_of(len(open_edges), LEAST_OPEN))):
            break
    return used


def _asked(
    statements: Statements, edges: IntArray, known: BoolArray, so_far: Solution, lines: OwnLines, used: BoolArray
) -> bool:
    """Whether any of some edges is likelier elsewhere by what known ones say, see :func:`.start_kernels.likeliest`."""
    own = lines.information, lines.x, lines.covariance
    return bool(likeliest(statements, edges, known, (so_far.x, so_far.covariance), own, used))


def _decided(equations: NormalEquations, lines: OwnLines, used: BoolArray) -> tuple[BoolArray, Solution, FloatArray]:
    """Which factors hold, (k,) bool, from those taken to do so; the solution; and the probability of each.

    One decision after another stops where none of them alone is better, though several together might be. Where edges
    are that their own lines leave open is therefore asked once more, when all say it that know it by then.
    """
    statements = _statements(equations.factors, len(lines.extent))
    used, solution, holds = equations.decided(_start(equations, statements, lines, used))
    everyone = np.ones(len(lines.extent), bool)
    if _asked(statements, np.flatnonzero(lines.are_open), everyone, solution, lines, used):
        used, solution, holds = equations.decided(used)
    return used, solution, holds


def end_sigma(covariance: AnyArray, lines: OwnLines) -> FloatArray:
    """(n, 2) sigma of disparity at the edges' ends, pixels."""
    return np.asarray(np.sqrt(np.einsum('nei,nij,nej->ne', lines.ends, covariance, lines.ends)))


def without_accidents(found: Estimate) -> FloatArray:
    """(n, 2, 2) covariance of edges: by their own lines alone where all else that says where they are may be accident.

    What holds is decided, and the least squares does not know how surely. An edge along the rows whose only statement
    holds with two chances in three is as likely anywhere with the third.
    """
    factors = found.factors
    accident = np.zeros(len(found.x))
    for edge, row in ((factors.edge, factors.row), (factors.other, factors.other_row)):
        # Of its slope others speak: their rows have hardly a first number. What holds with the one before says no more.
        tells = np.flatnonzero(found.used & (edge >= 0) & (row[:, 0] > 0.5) & factors.first)
        np.add.at(accident, edge[tells], np.log(np.maximum(1.0 - found.holds[tells], SMALLEST)))
    doubted = found.lines.are_open & (accident > np.log(ACCIDENT))
    return np.where(doubted[:, None, None], found.lines.covariance, found.covariance)


def estimate(
    lines: OwnLines, factors: Factors, used: BoolArray, telling: int | None = None, place: IntArray | None = None
) -> Estimate:
    """The disparities of all edges.

    Parameters
    ----------
    lines : OwnLines
        What each edge's own lines say of it, and roughly the match.
    factors : Factors
        What ties them to each other.
    used : (k,) bool
        Factors that were found to hold before.
    telling : int, optional
        The unit variance is told by so many of the factors, the first; by all when it is not given.
    place : (n,) int, optional
        See :class:`.normal_equations.NormalEquations`.
    """
    equations = NormalEquations(lines.information, lines.vector, factors, place)
    used, solution, holds = _decided(equations, lines, used)
    misses = misfit(factors, solution, used)
    return Estimate(lines, factors, solution, used, holds, misses, unit_variance(misses[:telling]), equations.place)


def by_factors(lines: OwnLines, factors: Factors, used: BoolArray, found: Estimate) -> tuple[FloatArray, FloatArray]:
    """Unknowns (n, 2) and covariance (n, 2, 2) of edges by given factors that are taken to hold, (k,) bool.

    found : an estimate of much the same factors, whose unit variance is theirs
    """
    solution = NormalEquations(lines.information, lines.vector, factors, found.place).solve(used)
    return solution.x, solution.covariance * found.unit_variance


def misfit(factors: Factors, solution: Solution, used: BoolArray) -> FloatArray:
    """(k,) by how many sigma each factor that is used misses what all others say; NaN where they do not say it."""
    off, variance = without_itself(factors, solution, used)
    told = used & (1.0 - solution.variance / factors.sigma**2 > 0.05)
    return np.where(told, np.abs(off) / np.sqrt(variance + factors.sigma**2), np.nan)


def told_prior(factors: Factors, known: BoolArray, x: FloatArray, covariance: FloatArray) -> FloatArray:
    """(k,) probability that statements of one kind hold, by those whose edges are known without them.

    The most likely one by expectation-maximisation, with the statements' own word worth REDUNDANCY of them.

    Parameters
    ----------
    factors : Factors
        k statements about one edge each.
    known : (n,) bool
        Edges that are known.
    x, covariance : (n, 2), (n, 2, 2)
        What edges know.
    """
    telling = known[factors.edge]
    told = factors.select(telling)
    off, variance = told.misses(x, covariance)
    odds = told.spread * np.exp(-0.5 * off**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    prior = factors.prior
    first = np.flatnonzero(told.first)
    odds = np.multiply.reduceat(odds, first) if len(first) else odds
    for _ in range(PRIOR_ROUNDS):
        share = prior[telling][first]
        held = float((share * odds / (share * odds + 1.0 - share)).sum())
        prior = (REDUNDANCY * factors.prior + held) / (REDUNDANCY + len(odds))
    return prior


def unit_variance(misses: FloatArray) -> float:
    """Variance of unit weight: how much larger squared residuals are than the stated sigmas have them, at least 1.

    By the median of residuals in sigmas, NaN left out; the sigmas' own word is worth REDUNDANCY of them.
    """
    off = misses[~np.isnan(misses)]
    if len(off) == 0:
        return 1.0
    scale = float(np.median(off)) / NORMAL_QUARTILE
    return max(1.0, (scale * len(off) + REDUNDANCY) / (len(off) + REDUNDANCY)) ** 2
