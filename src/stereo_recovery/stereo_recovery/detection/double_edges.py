"""Two edges a few pixels apart that blur into one chain: separated by fitting two steps to the profile across it.

A thin face (seen at a grazing angle, perhaps in one image only) makes a chain of edgels that lies on neither of its two
edges, and that is narrower or wider than a single blurred step. Such segments are fitted with two steps; the segment
moves to the first step, and the second becomes a segment of its own where there is none.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from msgs_py.numeric.typed import AnyArray, Float32Array, FloatArray

from . import double_edge_kernels
from .edgels import Edgels
from .line_kernels import medians
from .segments import Segments, width_excess
from .settings import (
    CORNER_TRIM,
    CORNER_TRIM_SHARE,
    CORRELATION_LENGTH,
    DIRECTED_LENGTH,
    DOUBLE_BREAK,
    DOUBLE_BREAK_ROUNDS,
    DOUBLE_GAIN,
    DOUBLE_RESIDUAL,
    DOUBLE_SIGMA,
    FRAGMENT_SHARE,
    INTERPOLATION_VARIANCE,
    MOST_SUSPECTS,
    ON_LINE,
    ONE_DIRECTION_COSINE,
    PROFILE_STEP,
    SUSPECT_BIAS,
    SUSPECT_LENGTH,
)


def fit_double_steps(
    gradients: tuple[Float32Array, Float32Array], edgels: Edgels, segments: Segments, sigma: float
) -> Segments:
    """Correct segments that are two edges, and add the second edge.

    Parameters
    ----------
    gradients : pair of (h, w) float32, grey levels per pixel
        Derivatives of the smoothed image, see :func:`.edgels.gradient`.
    edgels : Edgels
        As the segments' bounds count.
    segments : Segments
    sigma : float
        Pixels. Of the smoothing.

    Returns
    -------
    Segments
        Without the fragments of the edges that were separated; edges added last.
    """
    if len(segments) == 0:
        return segments
    usual = float(np.median(edgels.width))
    values = {f.name: getattr(segments, f.name).copy() for f in fields(segments)}
    added: list[dict[str, AnyArray]] = []
    removed = np.zeros(len(segments), bool)
    for k in _suspects(edgels, segments):
        if removed[k]:
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
        # Fragments of either edge go; a segment that is the other edge as a whole stays.
        half = FRAGMENT_SHARE * (extent[1] - extent[0])
        removed |= ~own & (np.maximum(*common) > 0.0) & (segments.length < half) & (segments.arc < 0)
        alike = segments.direction @ other['direction'] > ONE_DIRECTION_COSINE
        if not (~own & ~removed & (common[1] > half) & alike).any():
            row = {f.name: getattr(segments, f.name)[k] for f in fields(segments)}
            row |= {'magnitude': row['magnitude'] * abs(p[1] / p[0]), 'sagitta': 0.0}
            added.append(row | other)
    values = {name: value[~removed] for name, value in values.items()}
    for row in added:
        values = {name: np.concatenate([value, np.asarray(row[name])[None]]) for name, value in values.items()}
    return Segments(**values)


def warm_up() -> None:
    """Compile the fit, which only pictures with thin faces need."""
    step = np.zeros((32, 32), np.float32)
    step[15:17] = 10.0
    profile, abscissa = double_edge_kernels.sample(step, step, (16.0, 16.0), (1.0, 0.0), -10.0, 10.0)
    double_edge_kernels.two_steps(profile, abscissa, 1.0)


def _suspects(edgels: Edgels, segments: Segments) -> AnyArray:
    """Indices of the straight segments that may be two edges, longest first."""
    biased = (medians(edgels.bias, segments.bounds) > SUSPECT_BIAS) & (segments.length >= SUSPECT_LENGTH)
    odd = (width_excess(edgels, segments.bounds) > 0.0) | biased
    suspects = np.flatnonzero(odd & (segments.length >= DIRECTED_LENGTH) & (segments.arc < 0))
    return suspects[np.argsort(-segments.length[suspects])][:MOST_SUSPECTS]


def _whole(segments: Segments, k: int) -> FloatArray:
    """(2,) float64, pixels: extent of segment k with the segments that continue its line across breaks."""
    c, t = segments.centre[k], segments.direction[k]
    ends = [end - c for end in (segments.start, segments.end)]
    off = np.maximum(*(np.abs(end @ [-t[1], t[0]]) for end in ends))
    abscissas = np.stack([end @ t for end in ends], axis=1)
    near = (off < ON_LINE) & (segments.direction @ t > ONE_DIRECTION_COSINE) & (segments.arc < 0)
    extent: FloatArray = segments.extent[k].copy()
    for _ in range(DOUBLE_BREAK_ROUNDS):
        touching = near & (abscissas[:, 0] < extent[1] + DOUBLE_BREAK) & (abscissas[:, 1] > extent[0] - DOUBLE_BREAK)
        touching[k] = True
        extent = np.array([min(extent[0], abscissas[touching, 0].min()), max(extent[1], abscissas[touching, 1].max())])
    return extent


def _steps(
    gradients: tuple[Float32Array, Float32Array],
    segments: Segments,
    k: int,
    extent: FloatArray,
    usual: float,
    sigma: float,
) -> tuple[FloatArray, FloatArray] | None:
    """The two steps that the profile across segment k shows; None when one step explains it about as well.

    Returns the parameters (6,) of :func:`.double_edge_kernels.two_steps`, and sigma (2, 2) of offset and slope of each.
    usual : median width of the picture's steps, pixels
    """
    low, high = extent
    cut = min(CORNER_TRIM, CORNER_TRIM_SHARE * (high - low))
    centre, direction = tuple(segments.centre[k]), tuple(segments.direction[k])
    profile, abscissa = double_edge_kernels.sample(*gradients, centre, direction, low + cut, high - cut)
    p, cost, single, inverse = double_edge_kernels.two_steps(
        profile, abscissa, np.sqrt(usual**2 + INTERPOLATION_VARIANCE)
    )
    if cost > DOUBLE_GAIN * single or cost > DOUBLE_RESIDUAL * (profile**2).sum():
        return None
    # Neighbouring samples share pixels, across the edge as well as along it.
    correlation = CORRELATION_LENGTH * sigma
    noise = cost / (profile.size - 6) * max(1.0, correlation / PROFILE_STEP)
    second = np.zeros((2, 6))
    second[0, [2, 4]] = second[1, [3, 5]] = 1.0
    covariance = noise * inverse
    errors = np.sqrt(np.array([np.diag(covariance)[2:4], np.diag(second @ covariance @ second.T)]))
    return p, np.hypot(errors, [DOUBLE_SIGMA, DOUBLE_SIGMA / max(high - low, 1.0)])


def _line(
    segments: Segments, k: int, extent: FloatArray, offset: float, slope: float, sigma: FloatArray
) -> dict[str, AnyArray]:
    """Segment k, of this extent, moved along its normal by offset + slope s, pixels, at abscissa s."""
    t = segments.direction[k]
    normal = np.array([-t[1], t[0]])
    turned = t + slope * normal
    length = np.hypot(*turned)
    return {
        'centre': segments.centre[k] + offset * normal,
        'direction': turned / length,
        'extent': extent * length,
        'sigma': sigma,
    }


def _common(segments: Segments, line: dict[str, AnyArray]) -> FloatArray:
    """(n,) float64, pixels: along what length each segment lies on this line."""
    t, normal = line['direction'], np.array([-line['direction'][1], line['direction'][0]])
    ends = [end - line['centre'] for end in (segments.start, segments.end)]
    off = np.maximum(*(np.abs(end @ normal) for end in ends))
    abscissas = np.sort(np.stack([end @ t for end in ends], axis=1), axis=1)
    common = np.minimum(abscissas[:, 1], line['extent'][1]) - np.maximum(abscissas[:, 0], line['extent'][0])
    return np.where(off < ON_LINE, np.maximum(common, 0.0), 0.0)
