"""Two edges a few pixels apart that blur into one chain: told apart by the profile of the gradient across it.

A thin face (seen at a grazing angle, perhaps by one eye only) makes a chain of edgels that lies on neither of its two
edges, and that is narrower or wider than a single blurred step. Such segments are fitted with two steps; the chain
moves to its own, and the other edge becomes a segment of its own where it has none.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from . import double_edge_kernels
from .edgels import Edgels
from .segments import CORNER_REACH, CORRELATION_LENGTH, Segments, width_excess
from .splitting_kernels import medians

# Variance, px^2, that linear interpolation between pixels adds to a step.
SAMPLED = 1.0 / 6.0
# So much edgels are moved by what is beside them, pixels, when that is another edge; scraps of noise beside an edge are
# shorter.
UNEVEN, LEAST_MOVED = 0.15, 20.0
# Shorter segments, pixels, say too little; of more than this many suspects the longest are looked at.
SHORTEST = 10.0
MOST = 12
# Two steps are believed when they leave so much less than one does (squared residual), and little of the height.
LEAST_GAIN = 0.12
LEAST_LEFT = 0.02
# What is left of the error of a place, pixels, of a segment that was taken apart.
APART = 0.06
# A segment is on a line when both its ends are this near, pixels; a chain goes on across a break of so many; and a
# fragment is shorter than this share of the whole.
SAME = 1.0
BREAK = 8.0
FRAGMENT = 0.5


def fit_double_steps(
    gradients: tuple[np.ndarray, np.ndarray], edgels: Edgels, segments: Segments, sigma: float
) -> Segments:
    """Segments with unusual profiles corrected, and the edges hidden beside them added.

    gradients : two (h, w) float32, grey levels per pixel, of the smoothing sigma, pixels; edgels : as the segments
        count
    """
    if len(segments) == 0:
        return segments
    usual = float(np.median(edgels.width))
    moved = (medians(edgels.bias, segments.bounds) > UNEVEN) & (segments.length >= LEAST_MOVED)
    odd = (width_excess(edgels, segments.bounds) > 0.0) | moved
    suspects = np.flatnonzero(odd & (segments.length >= SHORTEST) & (segments.arc < 0))
    suspects = suspects[np.argsort(-segments.length[suspects])]
    values = {f.name: getattr(segments, f.name).copy() for f in fields(segments)}
    added: list[dict[str, np.ndarray]] = []
    gone = np.zeros(len(segments), bool)
    for k in suspects[:MOST]:
        if gone[k]:
            continue
        extent = _whole(segments, int(k))
        found = _steps(gradients, segments, int(k), extent, usual, sigma)
        if found is None:
            continue
        p, errors = found
        first = _line(segments, int(k), extent, p[2], p[3], errors[0])
        other = _line(segments, int(k), extent, p[2] + p[4], p[3] + p[5], errors[1])
        values['sagitta'][k] = 0.0
        for name, value in first.items():
            values[name][k] = value
        if p[0] * p[1] < 0.0:
            other['direction'] = -other['direction']
            other['extent'] = -other['extent'][::-1]
        common = [_common(segments, line) for line in (first, other)]
        own = np.arange(len(segments)) == k
        # Fragments of either edge are told by them; a segment that is the other edge as a whole stays.
        half = FRAGMENT * (extent[1] - extent[0])
        gone |= ~own & (np.maximum(*common) > 0.0) & (segments.length < half) & (segments.arc < 0)
        if not (~own & ~gone & (common[1] > half) & (segments.direction @ other['direction'] > 0.9)).any():
            row = {f.name: getattr(segments, f.name)[k] for f in fields(segments)}
            row |= {'magnitude': row['magnitude'] * abs(p[1] / p[0]), 'sagitta': 0.0}
            added.append(row | other)
    values = {name: value[~gone] for name, value in values.items()}
    for row in added:
        values = {name: np.concatenate([value, np.asarray(row[name])[None]]) for name, value in values.items()}
    return Segments(**values)


def warm_up() -> None:
    """Compile the fit, which only pictures with thin faces reach."""
    step = np.zeros((32, 32), np.float32)
    step[15:17] = 10.0
    double_edge_kernels.two_steps(*double_edge_kernels.sample(step, step, 16.0, 16.0, 1.0, 0.0, -10.0, 10.0), 1.0)


def _whole(segments: Segments, k: int) -> np.ndarray:
    """(2,) float64, pixels: extent of segment k with the segments that go on along its line: such chains break."""
    c, t = segments.centre[k], segments.direction[k]
    ends = [end - c for end in (segments.start, segments.end)]
    off = np.maximum(*(np.abs(end @ [-t[1], t[0]]) for end in ends))
    places = np.stack([end @ t for end in ends], axis=1)
    near = (off < SAME) & (segments.direction @ t > 0.9) & (segments.arc < 0)
    extent = segments.extent[k].copy()
    for _ in range(3):
        touching = near & (places[:, 0] < extent[1] + BREAK) & (places[:, 1] > extent[0] - BREAK)
        touching[k] = True
        extent = np.array([min(extent[0], places[touching, 0].min()), max(extent[1], places[touching, 1].max())])
    return extent


def _steps(
    gradients: tuple[np.ndarray, np.ndarray], segments: Segments, k: int, extent: np.ndarray, usual: float, sigma: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Parameters of two steps (see profile_kernels), and the sigma (2, 2) of place and slope of each; or None."""
    low, high = extent
    cut = min(CORNER_REACH, 0.2 * (high - low))
    (cu, cv), (tu, tv) = segments.centre[k], segments.direction[k]
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
    segments: Segments, k: int, extent: np.ndarray, shift: float, slope: float, sigma: np.ndarray
) -> dict[str, np.ndarray]:
    """Segment k, of this extent, moved along its normal by shift + slope s."""
    t = segments.direction[k]
    normal = np.array([-t[1], t[0]])
    turned = t + slope * normal
    length = np.hypot(*turned)
    return {
        'centre': segments.centre[k] + shift * normal,
        'direction': turned / length,
        'extent': extent * length,
        'sigma': sigma,
    }


def _common(segments: Segments, line: dict[str, np.ndarray]) -> np.ndarray:
    """(n,) float64, pixels: along what length each segment lies on this line."""
    t, normal = line['direction'], np.array([-line['direction'][1], line['direction'][0]])
    ends = [end - line['centre'] for end in (segments.start, segments.end)]
    off = np.maximum(*(np.abs(end @ normal) for end in ends))
    places = np.sort(np.stack([end @ t for end in ends], axis=1), axis=1)
    common = np.minimum(places[:, 1], line['extent'][1]) - np.maximum(places[:, 0], line['extent'][0])
    return np.where(off < SAME, np.maximum(common, 0.0), 0.0)
