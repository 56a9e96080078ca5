"""Edge chains: edgels linked into curves (thesis 3.7, 3.10.1)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from msgs_py.numeric.typed import BoolArray, ByteArray, Float32Array, FloatArray, IntArray

from . import chain_kernels
from .edgel_kernels import Maxima
from .edgels import Edgels, Slopes, described, maxima
from .noise import NoiseMap
from .settings import BESIDE_FINER, LEAST_EDGELS, MOST_COVERED, PROMINENCE, SEGMENT_EXCESS


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

    @property
    def evidence(self) -> FloatArray:
        """(m,) float64: by how much each stands out of what noise makes, see :func:`.chain_kernels.evidence`."""
        bounds = np.stack([self.offsets[:-1], self.offsets[1:]], axis=1)
        found: FloatArray = chain_kernels.evidence(self.edgels.prominence, bounds)
        return found

    def select(self, kept: BoolArray) -> EdgeChains:
        """A subset: (m,) bool."""
        count = np.diff(self.offsets)
        offsets = np.concatenate([[0], np.cumsum(count[kept])])
        return EdgeChains(self.edgels.select(np.repeat(kept, count)), offsets, self.closed[kept])

    @classmethod
    def concatenate(cls, first: EdgeChains, second: EdgeChains) -> EdgeChains:
        """The chains of the first, and after them those of the second."""
        return cls(
            Edgels.concatenate([first.edgels, second.edgels]),
            np.concatenate([first.offsets, first.offsets[-1] + second.offsets[1:]]),
            np.concatenate([first.closed, second.closed]),
        )


def link(found: Maxima, sigma: float, shape: tuple[int, int], high: float, minimum: int = LEAST_EDGELS) -> EdgeChains:
    """Link edgels that follow each other, and keep the chains that may be edges.

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
    Thesis 3.7, 3.10.1.
    """
    if len(found.position) == 0:
        return EdgeChains(Edgels.empty(), np.zeros(1, np.int64), np.zeros(0, bool))
    prominence = found.prominence
    following = chain_kernels.successors(
        found.position, found.gradient, found.magnitude, prominence > PROMINENCE, shape[0], shape[1]
    )
    order, offsets, closed = chain_kernels.trace(following, found.magnitude, prominence, high, minimum)
    return EdgeChains(described(found, order, sigma), offsets, closed)


def chains_of(
    grey: Float32Array,
    detector: str,
    sigma: float,
    thresholds: tuple[float, float],
    noise: NoiseMap | float | Slopes | None = None,
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
    noise : NoiseMap, float or Slopes, optional
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
        kept = np.flatnonzero(~border[row, column])
        found = Maxima(*(each[kept] for each in found))
    return link(found, sigma, (grey.shape[0], grey.shape[1]), high)


def completed(chains: EdgeChains, coarser: EdgeChains, shape: tuple[int, int], high: float) -> EdgeChains:
    """The chains, and after them what chains of a coarser scale show where there are none that stand by themselves.

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
        Without those that do not stand by themselves and lie where one of the coarser scale does.
    """
    if len(coarser) == 0:
        return chains
    clear = chains.evidence > SEGMENT_EXCESS
    beside_clear = _beside(chains.edgels.position[np.repeat(clear, np.diff(chains.offsets))], shape)
    order, offsets = chain_kernels.free_runs(
        _within(beside_clear, coarser.edgels.position),
        coarser.offsets,
        coarser.edgels.magnitude,
        coarser.edgels.prominence,
        high,
        LEAST_EDGELS,
    )
    if len(order) == 0:
        return chains
    # A closed chain stays closed when nothing of it is taken away.
    source = np.searchsorted(coarser.offsets, order[offsets[:-1]], 'right') - 1
    closed = coarser.closed[source] & (np.diff(offsets) == np.diff(coarser.offsets)[source])
    more = EdgeChains(coarser.edgels.select(order), offsets, closed)
    seen = more.edgels.position[np.repeat(more.evidence > SEGMENT_EXCESS, np.diff(offsets))]
    covered = _within(_beside(seen, shape), chains.edgels.position)
    share = np.add.reduceat(covered, chains.offsets[:-1]) / np.diff(chains.offsets) if len(chains) else np.zeros(0)
    return EdgeChains.concatenate(chains.select(clear | (share < MOST_COVERED)), more)


def _beside(position: FloatArray, shape: tuple[int, int]) -> ByteArray:
    """(h, w) uint8, not 0 within BESIDE_FINER pixels of positions (n, 2), pixels, along rows and columns."""
    own = np.zeros(shape, np.uint8)
    column, row = np.rint(position).astype(np.intp).T
    own[np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1)] = 1
    side = 2 * BESIDE_FINER + 1
    return np.asarray(cv2.dilate(own, np.ones((side, side), np.uint8)), np.uint8)


def _within(marked: ByteArray, position: FloatArray) -> BoolArray:
    """(n,) bool: whether positions (n, 2), pixels, lie where an image (h, w) is not 0."""
    column, row = np.rint(position).astype(np.intp).T
    there: BoolArray = marked[np.clip(row, 0, marked.shape[0] - 1), np.clip(column, 0, marked.shape[1] - 1)] > 0
    return there
