"""Edge chains: edgels linked into curves (thesis 3.7, 3.10.1)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from msgs_py.numeric.typed import BoolArray, Float32Array, IntArray

from . import chain_kernels
from .edgels import Edgels, Maxima, maxima
from .noise import NoiseMap
from .settings import BESIDE_FINER, LEAST_EDGELS, PROMINENCE


@dataclass(frozen=True, eq=False)
class EdgeChains:
    """m chains of edgels.

    Attributes
    ----------
    edgels : Edgels
        Chain after chain, each along its tangent, so that the bright side is on the same hand throughout.
    offsets : (m + 1,) int64
        Chain k is ``edgels[offsets[k]:offsets[k + 1]]``.
    closed : (m,) bool
        Whether the chain's last edgel links back to its first.
    """

    edgels: Edgels
    offsets: IntArray
    closed: BoolArray

    def __len__(self) -> int:
        return len(self.offsets) - 1


def link(found: Maxima, sigma: float, shape: tuple[int, int], high: float, minimum: int = LEAST_EDGELS) -> EdgeChains:
    """Link edgels that follow each other, and keep the chains that stand out of the noise somewhere.

    Parameters
    ----------
    found : Maxima
    sigma : float
        Pixels. Of the smoothing.
    shape : (height, width), pixels
        Of the image.
    high : float
        Grey levels per pixel. A chain is kept when the mean magnitude of three consecutive edgels exceeds this
        somewhere.
    minimum : int
        Least number of edgels in a chain.

    Returns
    -------
    EdgeChains

    References
    ----------
    Thesis 3.7, 3.10.1. Instead of a second threshold (Canny, PAMI 8(6), 1986) a sum over consecutive edgels decides,
    after E. Page, "Continuous inspection schemes", Biometrika 41, 1954.
    """
    if len(found) == 0:
        return EdgeChains(Edgels.empty(), np.zeros(1, np.int64), np.zeros(0, bool))
    prominence = found.prominence
    following = chain_kernels.successors(
        found.position, found.gradient, found.magnitude, prominence > PROMINENCE, shape[0], shape[1]
    )
    order, offsets, closed = chain_kernels.trace(following, found.magnitude, prominence, high, minimum)
    return EdgeChains(found.select(order).described(sigma), offsets, closed)


def chains_of(
    grey: Float32Array,
    detector: str,
    sigma: float,
    thresholds: tuple[float, float],
    noise: NoiseMap | float | None = None,
    border: BoolArray | None = None,
) -> EdgeChains:
    """Edge chains of an image at one scale.

    Parameters
    ----------
    grey : (h, w) float32, grey levels
    detector : str
        One of :data:`~stereo_recovery.params.DETECTORS`.
    sigma : float
        Pixels. Gaussian smoothing.
    thresholds : (float, float), grey levels per pixel
        Least magnitude of an edgel, and what a chain exceeds somewhere, see :func:`link`; raised by noise.
    noise : NoiseMap or float, optional
        See :func:`.edgels.maxima`.
    border : (h, w) bool, optional
        Where no edgels count.

    Returns
    -------
    EdgeChains
    """
    low, high = thresholds
    found = maxima(grey, detector, sigma, low, noise)
    if border is not None:
        column, row = np.rint(found.position).astype(np.intp).T
        found = found.select(np.flatnonzero(~border[row, column]))
    return link(found, sigma, (grey.shape[0], grey.shape[1]), high)


def completed(chains: EdgeChains, coarser: EdgeChains, shape: tuple[int, int], high: float) -> EdgeChains:
    """The chains, and after them what chains of a coarser scale show where there are none.

    Parameters
    ----------
    chains, coarser : EdgeChains
        Both in pixels of the image.
    shape : (height, width), pixels
        Of the image.
    high : float
        Grey levels per pixel. As in :func:`link`.

    Returns
    -------
    EdgeChains
    """
    if len(coarser) == 0:
        return chains
    own = np.zeros(shape, np.uint8)
    pixel = np.rint(chains.edgels.position).astype(np.intp)
    own[pixel[:, 1], pixel[:, 0]] = 1
    near = cv2.dilate(own, np.ones((2 * BESIDE_FINER + 1, 2 * BESIDE_FINER + 1), np.uint8))
    edgels = coarser.edgels
    pixel = np.clip(np.rint(edgels.position).astype(np.intp), 0, [shape[1] - 1, shape[0] - 1])
    covered = near[pixel[:, 1], pixel[:, 0]] > 0
    order, starts = chain_kernels.free_runs(
        covered, coarser.offsets, edgels.magnitude, 1.0 / edgels.sigma_direction, high, LEAST_EDGELS
    )
    # A closed chain stays closed when nothing of it is taken away.
    whole = (
        np.diff(starts) == np.diff(coarser.offsets)[np.searchsorted(coarser.offsets, order[starts[:-1]], 'right') - 1]
    )
    closed = coarser.closed[np.searchsorted(coarser.offsets, order[starts[:-1]], 'right') - 1]
    return EdgeChains(
        Edgels.concatenate([chains.edgels, edgels.select(order)]),
        np.concatenate([chains.offsets, chains.offsets[-1] + starts[1:]]),
        np.concatenate([chains.closed, closed & whole]),
    )
