"""Dense disparity as a witness for candidates: it knows what texture shows, and is silent on plain faces."""

from __future__ import annotations

import cv2
import numpy as np

from msgs_py.numeric.typed import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array

from ..detection.edgels import gradient_noise, noise_level
from ..detection.segments import Segments
from . import dense_kernels
from .dense_kernels import Windows
from .settings import DENSE_OFFSETS, DENSE_PIXELS, DENSE_SAMPLES, PROFILE_SIGMA, TEXTURE_NOISE

# Of OpenCV's semi-global matching, its manual's values: window, penalties of a step of one and of a larger one, by the
# window's pixels; largest difference of the two directions, px; margin of the best over the second, percent.
WINDOW, STEP_PENALTY, JUMP_PENALTY, MOST_DIFFERENCE, UNIQUENESS = 5, 8, 32, 1, 10

# Disparities come as sixteenths of a pixel, and the range is in steps of as many.
FRACTION = cv2.StereoMatcher_DISP_SCALE


def _textured(grey: ByteArray) -> BoolArray:
    """(h, w) bool: where grey levels (h, w) change along the rows by more than noise; elsewhere all disparities fit."""
    change = cv2.Sobel(grey, cv2.CV_32F, 1, 0, scale=0.125)
    energy = cv2.boxFilter(change * change, cv2.CV_32F, (WINDOW, WINDOW))
    limit = (TEXTURE_NOISE * gradient_noise(noise_level(grey.astype(np.float32)), PROFILE_SIGMA)) ** 2
    return np.asarray(energy > limit)


def windows(grey: Float32Array) -> Windows:
    """The windows that dense disparity compares, of grey levels (h, w)."""
    # Sums of squares of small numbers keep their digits.
    image = grey - np.float32(grey.mean())
    mean, squares = (cv2.boxFilter(of, cv2.CV_32F, (WINDOW, WINDOW)) for of in (image, image * image))
    contrast = WINDOW * np.sqrt(np.maximum(squares - mean * mean, 0.0))
    return Windows(image, np.asarray(mean), np.asarray(contrast, np.float32), WINDOW // 2)


class DenseDisparity:
    """Disparity of the left image, at a reduced size.

    Parameters
    ----------
    left, right : (h, w) float32, grey levels
    lowest, highest : float, pixels
        Range in which it is looked for.

    Attributes
    ----------
    disparity : (h', w') float32, reduced pixels
        NaN where nothing is known.
    scale : float
        Reduced pixels a pixel.

    References
    ----------
    H. Hirschmueller, "Stereo processing by semiglobal matching and mutual information", PAMI 30(2), 2008.
    """

    def __init__(self, left: Float32Array, right: Float32Array, lowest: float, highest: float) -> None:
        height, width = left.shape
        scale = min(1.0, float(np.sqrt(DENSE_PIXELS / (height * width))))
        size = max(FRACTION, round(width * scale)), max(FRACTION, round(height * scale))
        self.scale = size[0] / width
        # At a disparity beyond the picture's width no column has a partner, which OpenCV does not survive.
        low = int(np.clip(np.floor(lowest * self.scale) - 1, WINDOW - size[0], size[0]))
        count = max(1, -(-(int(np.ceil(highest * self.scale)) + 2 - low) // FRACTION)) * FRACTION
        # Without room at its left the columns whose partner may lie outside the right image would be lost.
        room = max(low + count, 0)
        reduced = [
            cv2.copyMakeBorder(
                cv2.resize(np.clip(grey, 0, 255), size, interpolation=cv2.INTER_AREA).astype(np.uint8),
                *(0, 0, room, 0),
                cv2.BORDER_REPLICATE,
            )
            for grey in (left, right)
        ]
        matcher = cv2.StereoSGBM.create(
            minDisparity=low,
            numDisparities=count,
            blockSize=WINDOW,
            P1=STEP_PENALTY * WINDOW**2,
            P2=JUMP_PENALTY * WINDOW**2,
            disp12MaxDiff=MOST_DIFFERENCE,
            uniquenessRatio=UNIQUENESS,
            mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
        )
        self._right = windows(np.asarray(reduced[1][:, room:], np.float32))
        raw = matcher.compute(*reduced)[:, room:]
        known = (raw >= low * FRACTION) & _textured(np.asarray(reduced[0][:, room:], np.uint8))
        self.disparity = np.where(known, raw / FRACTION, np.nan).astype(np.float32)

    def log_ratio(self, node: Int32Array, value: FloatArray, left: Segments) -> FloatArray:
        """(k,) float64: how much likelier the surface beside a candidate's edge is if the candidate is true.

        The edge belongs to the nearer of the two surfaces beside it, so that one of them is enough. Where nothing is
        known nothing is said; and nothing against a candidate whose place in the right image looks like the one taken,
        since smoothness alone chose between the two, and of a board's periods it prefers the one parallel to the image.

        Parameters
        ----------
        node, value : (k, 2), (k, 9)
            Candidates, see :func:`.candidate_kernels.candidates`.
        left : Segments
        """
        share = (np.arange(DENSE_SAMPLES) + 0.5) / DENSE_SAMPLES
        middle, across = left.places(DENSE_SAMPLES), left.normal[:, None, None, None]
        offsets = np.multiply.outer([-1.0, 1.0], DENSE_OFFSETS)[:, None, :, None] / self.scale
        height, width = self.disparity.shape
        beside = np.rint((middle[:, None, :, None] + offsets * across) * self.scale)
        places = np.clip(beside, 0, [width - 1, height - 1]).astype(np.int32)
        along = (value[:, :1] + share * (value[:, 2:3] - value[:, :1])) * self.scale
        return np.asarray(dense_kernels.log_ratios(self.disparity, self._right, places, node, along))
