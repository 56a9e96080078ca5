"""Two edges a few pixels apart that blur into one string: told apart by the profile of the gradient across it.

A thin face (seen at a grazing angle, perhaps by one eye only) makes a string of edgels that lies on neither of its two
edges, and that is narrower or wider than a single blurred step. Such pieces are fitted with two steps; the string moves
to its own, and the other edge becomes a piece of its own where it has none.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from . import double_edge_kernels
from .edgels import Edgels
from .segmentation import CORNER_REACH, CORRELATION_LENGTH, Pieces, unusual
from .splitting_kernels import medians

# Variance, px^2, that linear interpolation between pixels adds to a step.
SAMPLED = 1.0 / 6.0
# So much edgels are moved by what is beside them, pixels, when that is another edge; scraps of noise beside an edge are
# shorter.
UNEVEN, LEAST_MOVED = 0.15, 20.0
# Shorter pieces, pixels, say too little; of more than this many suspects the longest are looked at.
SHORTEST = 10.0
MOST = 12
# Two steps are believed when they leave so much less than one does (squared residual), and little of the height.
LEAST_GAIN = 0.12
LEAST_LEFT = 0.02
# What is left of the error of a place, pixels, of a piece that was taken apart.
APART = 0.06
# A piece is on a line when both its ends are this near, pixels; a string goes on across a break of so many; and a
# fragment is shorter than this share of the whole.
SAME = 1.0
BREAK = 8.0
FRAGMENT = 0.5


def taken_apart(gradients: tuple[np.ndarray, np.ndarray], edgels: Edgels, pieces: Pieces, sigma: float) -> Pieces:
    """Pieces with unusual profiles corrected, and the edges hidden beside them added.

    gradients : two (h, w) float32, grey levels per pixel, of the smoothing sigma, pixels; edgels : as the pieces count
    """
    if len(pieces) == 0:
        return pieces
    usual = float(np.median(edgels.width))
    moved = (medians(edgels.shift, pieces.bounds) > UNEVEN) & (pieces.length >= LEAST_MOVED)
    odd = (unusual(edgels, pieces.bounds) > 0.0) | moved
    suspects = np.flatnonzero(odd & (pieces.length >= SHORTEST) & (pieces.arc < 0))
    suspects = suspects[np.argsort(-pieces.length[suspects])]
    values = {f.name: getattr(pieces, f.name).copy() for f in fields(pieces)}
    added: list[dict[str, np.ndarray]] = []
    gone = np.zeros(len(pieces), bool)
    for k in suspects[:MOST]:
        if gone[k]:
            continue
        reach = _whole(pieces, int(k))
        found = _steps(gradients, pieces, int(k), reach, usual, sigma)
        if found is None:
            continue
        p, errors = found
        first = _line(pieces, int(k), reach, p[2], p[3], errors[0])
        other = _line(pieces, int(k), reach, p[2] + p[4], p[3] + p[5], errors[1])
        values['bow'][k] = 0.0
        for name, value in first.items():
            values[name][k] = value
        if p[0] * p[1] < 0.0:
            other['direction'] = -other['direction']
            other['reach'] = -other['reach'][::-1]
        common = [_common(pieces, line) for line in (first, other)]
        own = np.arange(len(pieces)) == k
        # Fragments of either edge are told by them; a piece that is the other edge as a whole stays.
        half = FRAGMENT * (reach[1] - reach[0])
        gone |= ~own & (np.maximum(*common) > 0.0) & (pieces.length < half) & (pieces.arc < 0)
        if not (~own & ~gone & (common[1] > half) & (pieces.direction @ other['direction'] > 0.9)).any():
            row = {f.name: getattr(pieces, f.name)[k] for f in fields(pieces)}
            row |= {'magnitude': row['magnitude'] * abs(p[1] / p[0]), 'bow': 0.0}
            added.append(row | other)
    values = {name: value[~gone] for name, value in values.items()}
    for row in added:
        values = {name: np.concatenate([value, np.asarray(row[name])[None]]) for name, value in values.items()}
    return Pieces(**values)


def warm_up() -> None:
    """Compile the fit, which only pictures with thin faces reach."""
    step = np.zeros((32, 32), np.float32)
    step[15:17] = 10.0
    double_edge_kernels.two_steps(*double_edge_kernels.sample(step, step, 16.0, 16.0, 1.0, 0.0, -10.0, 10.0), 1.0)


def _whole(pieces: Pieces, k: int) -> np.ndarray:
    """(2,) float64, pixels: reach of piece k with the pieces that go on along its line: such strings break."""
    c, t = pieces.centre[k], pieces.direction[k]
    ends = [end - c for end in (pieces.start, pieces.end)]
    off = np.maximum(*(np.abs(end @ [-t[1], t[0]]) for end in ends))
    places = np.stack([end @ t for end in ends], axis=1)
    near = (off < SAME) & (pieces.direction @ t > 0.9) & (pieces.arc < 0)
    reach = pieces.reach[k].copy()
    for _ in range(3):
        touching = near & (places[:, 0] < reach[1] + BREAK) & (places[:, 1] > reach[0] - BREAK)
        touching[k] = True
        reach = np.array([min(reach[0], places[touching, 0].min()), max(reach[1], places[touching, 1].max())])
    return reach


def _steps(
    gradients: tuple[np.ndarray, np.ndarray], pieces: Pieces, k: int, reach: np.ndarray, usual: float, sigma: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Parameters of two steps (see profile_kernels), and the sigma (2, 2) of place and slope of each; or None."""
    low, high = reach
    cut = min(CORNER_REACH, 0.2 * (high - low))
    (cu, cv), (tu, tv) = pieces.centre[k], pieces.direction[k]
    profile, place = double_edge_kernels.sample(gradients[0], gradients[1], cu, cv, tu, tv, low + cut, high - cut)
    p, left, single, inverse = double_edge_kernels.two_steps(profile, place, np.sqrt(usual**2 + SAMPLED))
    if left > LEAST_GAIN * single or left > LEAST_LEFT * (profile**2).sum():
        return None
    # Neighbouring samples share pixels, across the edge as well as along it.
    correlation = CORRELATION_LENGTH * sigma
    noise = left / (profile.size - 6) * max(1.0, correlation / double_edge_kernels.STEP)
    second = np.zeros((2, 6))
    second[0, [2, 4]] = second[1, [3, 5]] = 1.0
    covariance = noise * inverse
    errors = np.sqrt(np.array([np.diag(covariance)[2:4], np.diag(second @ covariance @ second.T)]))
    return p, np.hypot(errors, [APART, APART / max(high - low, 1.0)])


def _line(
    pieces: Pieces, k: int, reach: np.ndarray, shift: float, slope: float, sigma: np.ndarray
) -> dict[str, np.ndarray]:
    """Piece k, of this reach, moved along its normal by shift + slope s."""
    t = pieces.direction[k]
    normal = np.array([-t[1], t[0]])
    turned = t + slope * normal
    length = np.hypot(*turned)
    return {
        'centre': pieces.centre[k] + shift * normal,
        'direction': turned / length,
        'reach': reach * length,
        'sigma': sigma,
    }


def _common(pieces: Pieces, line: dict[str, np.ndarray]) -> np.ndarray:
    """(n,) float64, pixels: along what length each piece lies on this line."""
    t, normal = line['direction'], np.array([-line['direction'][1], line['direction'][0]])
    ends = [end - line['centre'] for end in (pieces.start, pieces.end)]
    off = np.maximum(*(np.abs(end @ normal) for end in ends))
    places = np.sort(np.stack([end @ t for end in ends], axis=1), axis=1)
    common = np.minimum(places[:, 1], line['reach'][1]) - np.maximum(places[:, 0], line['reach'][0])
    return np.where(off < SAME, np.maximum(common, 0.0), 0.0)
