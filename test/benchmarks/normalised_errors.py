"""Errors in units of their stated covariance, squared: what they are of ends, directions, corners, circles and axes.

Where covariances are true, such a square is of chi squared with as many degrees of freedom as the error has numbers:
its mean is that number, and 95 % lie inside the 95 % region.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from msgs_py import FeatureSet
from stereo_recovery.curves.curve import Curve

# Pixels: an end this near to a true one, along the edge in the picture, claims to be it.
CORNER_PX = 2.5
SHARE = 0.95
# Chance below which an error is no noise but a mistake: a wrong match, another edge beside the true one.
MISTAKEN = 1e-6


@dataclass
class NormalisedErrors:
    """Squares of errors in sigmas, by what they are the error of.

    Attributes
    ----------
    squared : dict of str to list of float
    freedom : dict of str to int
        How many numbers each error has.
    """

    squared: dict[str, list[float]] = field(default_factory=dict)
    freedom: dict[str, int] = field(default_factory=dict)

    def add(self, name: str, error: np.ndarray, covariance: np.ndarray) -> None:
        """error : (k, f); covariance : (k, f, f)."""
        if len(covariance) == 0:
            return
        error = np.asarray(error, float).reshape(len(covariance), -1)
        white = np.linalg.solve(covariance, error[..., None])[..., 0]
        self.freedom[name] = error.shape[1]
        self.squared.setdefault(name, []).extend((error * white).sum(axis=1).tolist())

    def include(self, squared: Mapping[str, list[float]], freedom: Mapping[str, int]) -> None:
        """Add the errors of others."""
        for name, values in squared.items():
            self.squared.setdefault(name, []).extend(values)
        self.freedom.update(freedom)

    def rows(self) -> Iterator[tuple[str, int, float, float, float, float]]:
        """Name, number, share that are mistakes; of the rest the mean of the squares over their freedom; of all the
        median over that of chi squared, and the share inside 95 %."""
        for name, values in self.squared.items():
            law, squares = chi2(self.freedom[name]), np.array(values)
            noise = squares < law.isf(MISTAKEN)
            yield (
                name,
                len(squares),
                float(1.0 - noise.mean()),
                float(squares[noise].mean()) / self.freedom[name] if noise.any() else float('nan'),
                float(np.median(squares) / law.median()),
                float((squares <= law.ppf(SHARE)).mean()),
            )


def add_edges(into: NormalisedErrors, found: FeatureSet, lines: np.ndarray, pixels_per_metre: np.ndarray) -> None:
    """Edges against the true lines they lie on.

    Parameters
    ----------
    into : NormalisedErrors
    found : FeatureSet
        k edges.
    lines : (k, 2, 3) float64, metres
        The ends of the true edge of each.
    pixels_per_metre : (k,) float64
        How long a metre along each is in the picture.
    """
    if len(found) == 0:
        return
    run = lines[:, 1] - lines[:, 0]
    length = np.linalg.norm(run, axis=1)
    along = run / length[:, None]
    # Rows across each true line: (k, 2, 3).
    flat = np.linalg.svd(along[:, None, :])[2][:, 1:]
    ends = np.stack([found.start, found.end], axis=1)
    off = np.einsum('kij,kej->kei', flat, ends - lines[:, None, 0])
    both = np.zeros((len(found), 4, 6))
    both[:, :2, :3], both[:, 2:, 3:] = flat, flat
    spread = both @ found.covariance @ both.swapaxes(1, 2)
    of_ends = np.stack([spread[:, :2, :2], spread[:, 2:, 2:]], axis=1)
    into.add('ends, across their edge', off.reshape(-1, 2), of_ends.reshape(-1, 2, 2))
    into.add('both ends together', off.reshape(-1, 4), spread)
    way = np.where((found.directions * along).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    turn = np.einsum('kij,kj->ki', flat, way * found.directions - along)
    into.add('directions', turn, flat @ found.direction_covariance @ flat.swapaxes(1, 2))
    blocks = found.start_covariance, found.end_covariance
    for end, block in enumerate(blocks):
        for true in range(2):
            miss = ends[:, end] - lines[:, true]
            near = np.abs((miss * along).sum(axis=1)) * pixels_per_metre < CORNER_PX
            into.add('corners', miss[near], block[near])


def add_circle(into: NormalisedErrors, curve: Curve, centre: np.ndarray, normal: np.ndarray, radius: float) -> None:
    """A circle or ellipse against the true one: centre (3,), unit normal (3,), major radius."""
    normal = normal * np.sign(normal @ curve.normal)
    # The two tilts move the normal along second and against first.
    tilt = np.array([(curve.normal - normal) @ curve.second, -(curve.normal - normal) @ curve.first])
    spread = curve.covariance[None]
    into.add('centres of circles', (curve.centre - centre)[None], spread[:, :3, :3])
    into.add('normals of circles', tilt[None], spread[:, 3:5, 3:5])
    into.add('radii of circles', np.array([[curve.radii[0] - radius]]), spread[:, 5:6, 5:6])


def add_axis(into: NormalisedErrors, axes: FeatureSet, index: int, true: np.ndarray) -> None:
    """Both ends of an axis across the line of the true one (2, 3), and its direction."""
    one = axes.select([index])
    alone = NormalisedErrors()
    add_edges(alone, one, true[None], np.zeros(1))
    for name, renamed in (('both ends together', 'ends of axes'), ('directions', 'directions of axes')):
        into.squared.setdefault(renamed, []).extend(alone.squared[name])
        into.freedom[renamed] = alone.freedom[name]
