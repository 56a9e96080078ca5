"""Linking edgels into chains (thesis 3.7, 3.10.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import chain_kernels
from .edgels import Edgels


@dataclass(frozen=True, eq=False)
class EdgeChains:
    """Edgels in chain order.

    edgels : Edgels, chain after chain, each along its tangent (bright side on the same hand throughout)
    offsets : (m + 1,) int64, chain k is edgels[offsets[k]:offsets[k + 1]]
    closed : (m,) bool, the last edgel links back to the first
    """

    edgels: Edgels
    offsets: np.ndarray
    closed: np.ndarray

    def __len__(self) -> int:
        return len(self.offsets) - 1


def link(edgels: Edgels, shape: tuple[int, int], high: float, minimum: int = 4) -> EdgeChains:
    """Chain edgels that follow each other, keep the chains that are strong somewhere (hysteresis).

    shape : (height, width) of the image; high : a chain needs one edgel of this magnitude (mean of three);
    minimum : least number of edgels in a chain.
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
    """The chains, and long chains of weak edgels between them.

    edgels : all, weak ones too; least : mean magnitude of a weak chain; minimum : its number of edgels. Noise makes
    edgels of that magnitude anywhere, but no long chains of them.
    """
    if len(edgels) == 0:
        return chains
    taken = np.zeros(shape, bool)
    place = np.rint(chains.edgels.position).astype(int)
    taken[place[:, 1], place[:, 0]] = True
    place = np.rint(edgels.position).astype(int)
    weak = link(edgels.select(~taken[place[:, 1], place[:, 0]]), shape, 0.0, minimum)
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
