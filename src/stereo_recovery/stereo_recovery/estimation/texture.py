"""What the texture beside edges says of their disparity, and of the rows.

A fold, a line of print and an outline belong to the surface on at least one of their sides. Where that surface has
texture, the strip beside the edge is found again in the other image (B. Lucas and T. Kanade, "An iterative image
registration technique with an application to stereo vision", IJCAI 1981), and what disparity it has on the edge is
known, however the edge runs; semi-global disparity, which looks farther, says where to begin. Where there is no texture
nothing is said. The rows in which a strip is found again are what its rows differ by.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from msgs_py.numeric.threads import spread
from msgs_py.numeric.typed import AnyArray, Float32Array, FloatArray, IntArray

from ..detection.segments import Segments
from ..matching.dense import DenseDisparity
from ..matching.row_error import RowError, RowWitnesses
from ..matching.settings import PROFILE_SIGMA
from ..matching.stereo_segments import StereoSegments
from .factors import Factors
from .settings import (
    MOST_LEVELS,
    SPREAD,
    STRIP_COARSEST,
    STRIP_CORRELATION,
    STRIP_LEAST_ROW,
    STRIP_PRIOR,
    STRIP_ROW_PRIOR,
    STRIP_SHARP,
    STRIP_SIGMA,
    STRIP_SLOPE_SIGMA,
)
from .texture_kernels import ALIGNED, UNKNOWN, align_strips


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
    return np.asarray(cv2.GaussianBlur(image, (0, 0), PROFILE_SIGMA), np.float32)


def _halved(image: Float32Array) -> Float32Array:
    """(h // 2, w // 2) float32: an image at half its size."""
    height, width = image.shape
    return np.asarray(cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA), np.float32)


class AlignedStrips:
    """The strips of texture on both sides of left segments, each aligned once, when it is first asked for.

    Parameters
    ----------
    left : Segments
    texture : Texture
    rows : RowError, optional
        Once it is known: where strips lie then follows from where they were found before.
    """

    def __init__(self, left: Segments, texture: Texture, rows: RowError | None = None) -> None:
        self.texture, self.rows = texture, rows
        self._left = left
        self._asked = np.zeros(len(left), bool)
        # Of both sides of every segment: who tells it, and if any disparity, slope and row, and their covariance.
        self._told_by = np.full((2, len(left)), UNKNOWN, np.uint8)
        self._value = np.zeros((2, len(left), 3))
        self._covariance = np.zeros((2, len(left), 3, 3))

    def beside(self, index: AnyArray, told_by: int = ALIGNED) -> tuple[IntArray, FloatArray, FloatArray]:
        """Strips beside segments (m,): which of ``index`` they belong to (k,), disparity, slope and row, covariance.

        told_by : ALIGNED or DENSE
        """
        fresh = np.unique(index[~self._asked[index]])
        if len(fresh):
            self._align(fresh)
        side, owner = np.nonzero(self._told_by[:, index] == told_by)
        value, covariance = self._value[side, index[owner]], self._covariance[side, index[owner]]
        if self.rows is None:
            return owner, value, covariance
        # The rows' prior is exchanged, by the Kalman filter's step.
        sigma = max(self.rows.sigma, STRIP_LEAST_ROW)
        more = max(sigma**-2.0 - STRIP_ROW_PRIOR**-2.0, 0.0)
        off = self.rows.at(self.places(index[owner], value)) / sigma**2 - more * value[:, 2]
        gain = covariance[:, :, 2] / (1.0 + more * covariance[:, 2, 2])[:, None]
        return owner, value + gain * off[:, None], covariance - more * gain[:, :, None] * covariance[:, 2:]

    def places(self, index: AnyArray, value: FloatArray) -> FloatArray:
        """(k, 2) pixels: where the right image shows the middles of segments (k,) of disparities and rows (k, 3)."""
        middle = self._left.extent[index].mean(axis=1)
        here = self._left.centre[index] + middle[:, None] * self._left.direction[index]
        return np.asarray(here + np.stack([-value[:, 0] - value[:, 1] * middle, value[:, 2]], axis=1))

    def _align(self, fresh: IntArray) -> None:
        """Align the strips of segments (m,) that were not asked for before, in two threads."""
        left, texture = self._left, self.texture
        # As many for every size of image: another number is another type, for which all would be compiled anew.
        levels = texture.levels + texture.levels[:1] * (MOST_LEVELS - len(texture.levels))
        place = np.column_stack([left.centre[fresh], left.direction[fresh], left.extent[fresh], np.ones(len(fresh))])

        def side(k: int) -> None:
            strips = place * [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0 * k - 1.0]
            dense = texture.dense.disparity, texture.dense.scale
            found = align_strips(levels, texture.scale, *dense, strips)
            self._told_by[k, fresh], self._value[k, fresh] = found[:2]
            self._covariance[k, fresh] = STRIP_CORRELATION * found[2]

        spread(side, (0, 1))
        self._asked[fresh] = True


def texture_rows(seen: StereoSegments, strips: AlignedStrips) -> RowWitnesses:
    """What the texture beside matched edges says of the rows.

    Parameters
    ----------
    seen : StereoSegments
    strips : AlignedStrips
        Of the left segments.
    """
    index = np.unique(seen.matches.left[seen.straight])
    owner, value, covariance = strips.beside(index)
    sigma = np.sqrt(covariance[:, 2, 2])
    told = sigma < STRIP_SHARP
    return RowWitnesses(strips.places(index[owner], value)[told], value[told, 2], sigma[told])


def texture_factors(
    seen: StereoSegments, edges: IntArray, strips: AlignedStrips | None, told_by: int = ALIGNED
) -> Factors:
    """What the surfaces on either side of edges say of their disparity.

    Parameters
    ----------
    seen : StereoSegments
        n edges.
    edges : (m,) int
        Those that are asked for.
    strips : AlignedStrips, optional
        None says nothing.
    told_by : int
        ALIGNED: strips that were found again; DENSE: others, of which dense disparity alone knows.
    """
    if strips is None or len(edges) == 0:
        return Factors.none()
    owner, value, covariance = strips.beside(seen.matches.left[edges], told_by)
    edge = edges[owner]
    # Where disparity and slope are independent, they are two numbers.
    at = -covariance[:, 0, 1] / covariance[:, 1, 1]
    length = seen.segments[0].length[seen.matches.left[edge]]
    sigma = np.sqrt(np.maximum(covariance[:, 0, 0] + at * covariance[:, 0, 1], 0.0) + STRIP_SIGMA**2)
    turn = np.sqrt(covariance[:, 1, 1] * length**2 + (2.0 * STRIP_SIGMA) ** 2)
    k = len(edge)
    prior, spread = np.full(k, STRIP_PRIOR), np.full(k, SPREAD)
    rows = np.stack([np.ones(k), at], axis=1), np.stack([np.zeros(k), length], axis=1)
    place = Factors.of_one(edge, rows[0], value[:, 0] + at * value[:, 1], sigma, prior, spread)
    # The slope of an accident is that of another surface, whose normal distribution is worth this range.
    slopes = np.sqrt(2.0 * np.pi) * STRIP_SLOPE_SIGMA * length
    slope = Factors.of_one(edge, rows[1], length * value[:, 1], turn, prior, slopes)
    # Both are of one surface, to which the edge belongs or not.
    place = replace(place, with_next=np.ones(k, bool))
    return Factors.concatenate([place, slope]).select(np.arange(2 * k).reshape(2, k).T.ravel())
