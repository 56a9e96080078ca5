"""Two edges a few pixels apart that blur into one string: told apart by the profile of the gradient across it.

A thin face (seen at a grazing angle, perhaps by one eye only) makes a string of edgels that lies on neither of its two
edges, and that is narrower or wider than a single blurred step. Such pieces are fitted with two steps; the string moves
to its own, and the other edge becomes a piece of its own where it has none.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from . import profile_kernels
from .edgels import Edgels
from .segmentation import CORNER_REACH, CORRELATION_LENGTH, Pieces, unusual

# Shorter pieces, pixels, say too little; of more than this many suspects the longest are looked at.
SHORTEST = 10.0
MOST = 12
# Two steps are believed when they leave so much less than one does (squared residual), and little of the height.
LEAST_GAIN = 0.12
LEAST_LEFT = 0.02
# What is left of the error of a place, pixels, of a piece that was taken apart.
APART = 0.06
# A piece within this distance, pixels, already is the other edge.
SAME = 1.0


def taken_apart(gradients: tuple[np.ndarray, np.ndarray], edgels: Edgels, pieces: Pieces, sigma: float) -> Pieces:
    """Pieces with unusual profiles corrected, and the edges hidden beside them added.

    gradients : two (h, w) float32, grey levels per pixel, of the smoothing sigma, pixels; edgels : as the pieces count
    """
    if len(pieces) == 0:
        return pieces
    usual = float(np.median(edgels.width))
    suspects = np.flatnonzero((unusual(edgels, pieces.bounds) > 0.0) & (pieces.length >= SHORTEST) & (pieces.arc < 0))
    suspects = suspects[np.argsort(-pieces.length[suspects])]
    values = {f.name: getattr(pieces, f.name).copy() for f in fields(pieces)}
    added: list[dict[str, np.ndarray]] = []
    for rank, k in enumerate(suspects):
        found = _steps(gradients, pieces, int(k), usual, sigma) if rank < MOST else None
        if found is None:
            continue
        p, errors = found
        for name, value in _line(pieces, int(k), p[2], p[3], errors[0]).items():
            values[name][k] = value
        other = _line(pieces, int(k), p[2] + p[4], p[3] + p[5], errors[1])
        if p[0] * p[1] < 0.0:
            other['direction'] = -other['direction']
            other['reach'] = -other['reach'][::-1]
        if not _known(pieces, int(k), other):
            row = {f.name: getattr(pieces, f.name)[k] for f in fields(pieces)}
            row['magnitude'] = row['magnitude'] * abs(p[1] / p[0])
            added.append(row | other)
    for row in added:
        values = {name: np.concatenate([value, np.asarray(row[name])[None]]) for name, value in values.items()}
    return Pieces(**values)


def _steps(gradients: tuple[np.ndarray, np.ndarray], pieces: Pieces, k: int, usual: float,
           sigma: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Parameters of two steps (see profile_kernels), and the sigma (2, 2) of place and slope of each; or None."""
    low, high = pieces.reach[k]
    cut = min(CORNER_REACH, 0.2 * (high - low))
    profile, place = profile_kernels.sample(*gradients, *pieces.centre[k], *pieces.direction[k], low + cut, high - cut)
    p, left, single, inverse = profile_kernels.two_steps(profile, place, usual)
    if left > LEAST_GAIN * single or left > LEAST_LEFT * (profile ** 2).sum():
        return None
    # Neighbouring samples share pixels, across the edge as well as along it.
    correlation = CORRELATION_LENGTH * sigma
    noise = left / (profile.size - 6) * max(1.0, correlation / profile_kernels.STEP)
    second = np.zeros((2, 6))
    second[0, [2, 4]] = second[1, [3, 5]] = 1.0
    covariance = noise * inverse
    errors = np.sqrt(np.array([np.diag(covariance)[2:4], np.diag(second @ covariance @ second.T)]))
    return p, np.hypot(errors, [APART, APART / max(high - low, 1.0)])


def _line(pieces: Pieces, k: int, shift: float, slope: float, sigma: np.ndarray) -> dict[str, np.ndarray]:
    """Piece k moved along its normal by shift + slope s."""
    t = pieces.direction[k]
    normal = np.array([-t[1], t[0]])
    turned = t + slope * normal
    length = np.hypot(*turned)
    return {'centre': pieces.centre[k] + shift * normal, 'direction': turned / length, 'reach': pieces.reach[k] * length,
            'sigma': sigma}


def _known(pieces: Pieces, k: int, line: dict[str, np.ndarray]) -> bool:
    """Whether a piece other than k lies on this line, along half of it."""
    t, normal = line['direction'], np.array([-line['direction'][1], line['direction'][0]])
    ends = [(end - line['centre']) for end in (pieces.start, pieces.end)]
    off = np.maximum(np.abs(ends[0] @ normal), np.abs(ends[1] @ normal))
    places = np.sort(np.stack([end @ t for end in ends], axis=1), axis=1)
    low, high = line['reach']
    common = np.minimum(places[:, 1], high) - np.maximum(places[:, 0], low)
    same = (off < SAME) & (common > 0.5 * (high - low)) & (pieces.direction @ t > 0.9)
    same[k] = False
    return bool(same.any())
