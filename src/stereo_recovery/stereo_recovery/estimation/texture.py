"""What the texture beside edges says of their disparity, and of the rows.

A fold, a line of print and an outline belong to the surface on at least one of their sides. Where that surface has
texture, the strip beside the edge is found again in the other image (B. Lucas and T. Kanade, "An iterative image
registration technique with an application to stereo vision", IJCAI 1981), and what disparity it has on the edge is
known, however the edge runs; semi-global disparity, which looks farther, says where to begin. Where there is no texture
nothing is said. The rows in which a strip is found again are what its rows differ by.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from msgs_py.numeric.typed import AnyArray, Float32Array, FloatArray, IntArray

from ..detection.segments import Segments
from ..matching.dense import DenseDisparity
from ..matching.row_error import RowWitnesses
from ..matching.stereo_segments import StereoSegments
from .factors import Factors
from .settings import (
    SPREAD,
    STRIP_ASKED,
    STRIP_COARSEST,
    STRIP_CORRELATION,
    STRIP_FITS,
    STRIP_LEAST_KNOWN,
    STRIP_LEAST_ROW,
    STRIP_LEVEL_SIGMA,
    STRIP_PRIOR,
    STRIP_ROW_SIGMA,
    STRIP_SIGMA,
    STRIP_SLOPE_SIGMA,
    STRIP_STARTS,
)
from .texture_kernels import align_strips


@dataclass(frozen=True, eq=False)
class Texture:
    """The two images of a pair, from coarse to fine, and their dense disparity.

    Attributes
    ----------
    levels : tuple of (left, right), (h, w) float32 each
    scale : (levels,) float64
        Their pixels a pixel.
    dense : DenseDisparity
    """

    levels: tuple[tuple[Float32Array, Float32Array], ...]
    scale: FloatArray
    dense: DenseDisparity

    @classmethod
    def of(cls, greys: tuple[Float32Array, Float32Array], dense: DenseDisparity) -> Texture:
        """Levels of the two images, each half as large as the one before, down to the size of the dense disparity."""
        pair = greys[0], greys[1]
        levels, scale = [(_smooth(pair[0]), _smooth(pair[1]))], [1.0]
        while 0.5 * scale[-1] > STRIP_COARSEST * dense.scale:
            pair = _smooth(_halved(levels[-1][0])), _smooth(_halved(levels[-1][1]))
            levels.append(pair)
            scale.append(0.5 * scale[-1])
        return cls(tuple(levels[::-1]), np.array(scale[::-1]), dense)


def _smooth(image: Float32Array) -> Float32Array:
    """(h, w) float32: an image, smoothed."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), STRIP_LEVEL_SIGMA), np.float32)


def _halved(image: Float32Array) -> Float32Array:
    """(h // 2, w // 2) float32: an image at half its size."""
    height, width = image.shape
    return np.asarray(cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA), np.float32)


def strips_beside(left: Segments, index: AnyArray, dense: DenseDisparity) -> tuple[IntArray, FloatArray, FloatArray]:
    """Strips beside segments where dense disparity is known.

    Returns (k,) which of ``index`` they belong to, (k, 7) their places and (k, 3) disparity at abscissa 0 and its
    gradients, see :func:`.texture_kernels.align_strips`.
    """
    f = dense.scale
    height, width = dense.disparity.shape
    share = (np.arange(STRIP_STARTS) + 0.5) / STRIP_STARTS
    s = left.extent[index, :1] + share * np.diff(left.extent[index])
    c, t = left.centre[index][:, None, None], left.direction[index][:, None, None]
    owner, places, starts = [], [], []
    for side in (-1.0, 1.0):
        o = side * np.array(STRIP_ASKED) / f
        column, row = (
            np.clip(np.rint(at * f).astype(np.intp), 0, size - 1)
            for at, size in (
                (c[..., 0] + s[..., None] * t[..., 0] - o * t[..., 1], width),
                (c[..., 1] + s[..., None] * t[..., 1] + o * t[..., 0], height),
            )
        )
        value = dense.disparity[row, column] / f
        known = np.isfinite(value)
        e = np.flatnonzero(known.mean(axis=(1, 2)) > STRIP_LEAST_KNOWN)
        a, b = _line_through(value[e], np.broadcast_to(s[e][..., None], value[e].shape), f)
        i = index[e]
        owner.append(e)
        places.append(np.column_stack([left.centre[i], left.direction[i], left.extent[i], np.full(len(e), side)]))
        starts.append(np.column_stack([a, b, np.zeros(len(e))]))
    return np.concatenate(owner), np.concatenate(places), np.concatenate(starts)


def _line_through(value: FloatArray, place: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """Robust lines a + b s through disparities (n, ...), pixels, at places s; NaN is not known; scale : of a pixel."""
    known = np.isfinite(value)
    a = np.nanmedian(value, axis=(1, 2))
    b = np.zeros(len(a))
    value = np.where(known, value, 0.0)
    rows = np.stack([np.ones_like(place), place], axis=-1)
    for _ in range(STRIP_FITS):
        off = (value - a[:, None, None] - b[:, None, None] * place) * scale
        weight = known / (1.0 + off**2)
        normal = np.einsum('nij,nijk,nijl->nkl', weight, rows, rows)
        normal[:, 1, 1] += (STRIP_SLOPE_SIGMA * scale) ** -2.0
        a, b = np.linalg.solve(normal, np.einsum('nij,nijk,nij->nk', weight, rows, value)[..., None])[..., 0].T
    return a, b


def texture_rows(seen: StereoSegments, texture: Texture) -> RowWitnesses:
    """What the texture beside matched edges says of the rows.

    Parameters
    ----------
    seen : StereoSegments
    texture : Texture
    """
    _, places, starts = strips_beside(seen.segments[0], np.unique(seen.matches.left[seen.straight]), texture.dense)
    good, value, _, rows = align_strips(texture.levels, texture.scale, places, starts, 1.0)
    sigma = np.sqrt(STRIP_CORRELATION * rows[:, 1])
    good &= sigma < STRIP_ROW_SIGMA
    places, value, rows = places[good], value[good], rows[good]
    middle = places[:, 4:6].mean(axis=1)
    right = places[:, :2] + middle[:, None] * places[:, 2:4]
    right[:, 0] -= value[:, 0] + value[:, 1] * middle
    right[:, 1] += rows[:, 0]
    return RowWitnesses(right, rows[:, 0], sigma[good])


class AlignedStrips:
    """The strips of texture beside left segments, aligned when they are first asked for: estimates ask many times.

    Parameters
    ----------
    left : Segments
    texture : Texture
    row_sigma : float, pixels
        By which single rows of the two images disagree.
    """

    def __init__(self, left: Segments, texture: Texture, row_sigma: float) -> None:
        self._left, self._texture, self._row_sigma = left, texture, max(row_sigma, STRIP_LEAST_ROW)
        self._asked = np.zeros(len(left), bool)
        # Of both sides of every segment: whether it aligned, and if so disparity and slope, and their covariance.
        self._good = np.zeros((2, len(left)), bool)
        self._value = np.zeros((2, len(left), 2))
        self._covariance = np.zeros((2, len(left), 2, 2))

    def beside(self, index: AnyArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Strips beside segments (m,): which of ``index`` they belong to (k,), disparity and slope, covariance."""
        fresh = np.unique(index[~self._asked[index]])
        if len(fresh):
            self._align(fresh)
        side, owner = np.nonzero(self._good[:, index])
        return owner, self._value[side, index[owner]], self._covariance[side, index[owner]]

    def _align(self, fresh: IntArray) -> None:
        """Align the strips of segments (m,) that were not asked for before."""
        owner, places, starts = strips_beside(self._left, fresh, self._texture.dense)
        good, value, covariance, _ = align_strips(
            self._texture.levels, self._texture.scale, places, starts, self._row_sigma
        )
        slot = (places[:, 6] > 0.0).astype(np.intp), fresh[owner]
        self._good[slot], self._value[slot] = good, value
        self._covariance[slot] = STRIP_CORRELATION * covariance
        self._asked[fresh] = True


def texture_factors(seen: StereoSegments, open_edges: IntArray, strips: AlignedStrips | None) -> Factors:
    """What the surfaces on either side of edges say of their disparity.

    Parameters
    ----------
    seen : StereoSegments
        n edges.
    open_edges : (m,) int
        Those that need it.
    strips : AlignedStrips, optional
        None says nothing.
    """
    if strips is None or len(open_edges) == 0:
        return Factors.none()
    owner, value, covariance = strips.beside(seen.matches.left[open_edges])
    edge = open_edges[owner]
    # Where disparity and slope are independent, they are two statements.
    at = -covariance[:, 0, 1] / covariance[:, 1, 1]
    length = seen.segments[0].length[seen.matches.left[edge]]
    sigma = np.sqrt(np.maximum(covariance[:, 0, 0] + at * covariance[:, 0, 1], 0.0) + STRIP_SIGMA**2)
    turn = np.sqrt(covariance[:, 1, 1] * length**2 + (2.0 * STRIP_SIGMA) ** 2)
    k = len(edge)
    prior, spread = np.full(k, STRIP_PRIOR), np.full(k, SPREAD)
    rows = np.stack([np.ones(k), at], axis=1), np.stack([np.zeros(k), length], axis=1)
    return Factors.concatenate(
        [
            Factors.of_one(edge, rows[0], value[:, 0] + at * value[:, 1], sigma, prior, spread),
            Factors.of_one(edge, rows[1], length * value[:, 1], turn, prior, spread),
        ]
    )
