"""Edge chains: edgels linked into curves (thesis 3.7, 3.10.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import BoolArray, IntArray

from . import chain_kernels
from .edgels import Edgels
from .settings import LEAST_EDGELS


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


def link(edgels: Edgels, shape: tuple[int, int], high: float, minimum: int = LEAST_EDGELS) -> EdgeChains:
    """Link edgels that follow each other, and keep the chains that are strong somewhere (hysteresis).

    Parameters
    ----------
    edgels : Edgels
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
    Thesis 3.7, 3.10.1. The hysteresis is Canny's (PAMI 8(6), 1986).
    """
    if len(edgels) == 0:
        return EdgeChains(edgels, np.zeros(1, np.int64), np.zeros(0, bool))
    tangent = edgels.tangent
    following = chain_kernels.successors(
        edgels.position[:, 0], edgels.position[:, 1], tangent[:, 0], tangent[:, 1], edgels.magnitude, shape[0], shape[1]
    )
    order, offsets, closed = chain_kernels.trace(following, edgels.magnitude, high, minimum)
    return EdgeChains(edgels.select(order), offsets, closed)


def with_weak(chains: EdgeChains, edgels: Edgels, shape: tuple[int, int], least: float, minimum: int) -> EdgeChains:
    """The chains, and after them long chains of weak edgels on pixels that the chains leave free.

    Noise makes weak edgels anywhere, but no long chains of them.

    Parameters
    ----------
    chains : EdgeChains
    edgels : Edgels
        All of the picture, the weak ones too.
    shape : (height, width), pixels
        Of the image.
    least : float
        Grey levels per pixel. Least mean magnitude of a weak chain.
    minimum : int
        Least number of edgels in a weak chain.

    Returns
    -------
    EdgeChains
    """
    if len(edgels) == 0:
        return chains
    taken = np.zeros(shape, bool)
    pixel = np.rint(chains.edgels.position).astype(int)
    taken[pixel[:, 1], pixel[:, 0]] = True
    pixel = np.rint(edgels.position).astype(int)
    weak = link(edgels.select(~taken[pixel[:, 1], pixel[:, 0]]), shape, 0.0, minimum)
    if len(weak) == 0:
        return chains
    count = np.diff(weak.offsets)
    mean = np.add.reduceat(weak.edgels.magnitude, weak.offsets[:-1]) / count
    keep = mean >= least
    offsets = np.concatenate([chains.offsets, chains.offsets[-1] + np.cumsum(count[keep])])
    return EdgeChains(
        Edgels.concatenate([chains.edgels, weak.edgels.select(np.repeat(keep, count))]),
        offsets,
        np.concatenate([chains.closed, weak.closed[keep]]),
    )
