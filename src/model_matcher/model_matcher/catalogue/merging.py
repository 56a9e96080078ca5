"""Answers of several searches of the same data, each with a share of the models, put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msgs_py import BIN, Interpretation

from ..verification.settings import CLAIMED


def merged(parts: Sequence[Sequence[Interpretation]]) -> tuple[tuple[Interpretation, ...], tuple[Interpretation, ...]]:
    """The answers of all shares together.

    Data belongs to the interpretation with most evidence. What loses more than CLAIMED of its data to better ones is
    rejected; what loses less explains what is left. No share has searched again in what others claim: the search does
    that for the models of one share only.

    Parameters
    ----------
    parts : sequence of sequence of Interpretation
        Of each share, accepted and rejected ones, about the same data.

    Returns
    -------
    accepted, rejected : tuple of Interpretation
        Best first.

    Raises
    ------
    ValueError
        They are about different data.
    """
    ones = [one for part in parts for one in part]
    if len({len(one.assignment) for one in ones}) > 1:
        raise ValueError('interpretations of different data: ' + ', '.join(sorted({one.model for one in ones})))
    # Of equal evidence the one that explains more, and then by name: whatever share answers first.
    ones.sort(key=lambda one: (-np.nan_to_num(one.evidence, nan=-np.inf), -one.matched, one.model))
    accepted: list[Interpretation] = []
    rejected: list[Interpretation] = []
    for one in ones:
        if not one.accepted:
            rejected.append(one)
            continue
        mine = one.assignment != BIN
        better = [(int((mine & (other.assignment != BIN)).sum()), other) for other in accepted]
        lost = sum(count for count, _ in better)
        if lost > CLAIMED * mine.sum():
            other = max(better, key=lambda pair: pair[0])[1]
            reason = f'competes for the same data with {other.model} (evidence {one.evidence:.1f} against '
            rejected.append(replace(one, rejected_reason=f'{reason}{other.evidence:.1f} nats)'))
            continue
        if lost:
            one = _without(one, np.any([other.assignment != BIN for _, other in better], axis=0))
        accepted.append(one)
    return tuple(accepted), tuple(rejected)


def _without(one: Interpretation, claimed: np.ndarray) -> Interpretation:
    """An interpretation of the data that others do not claim."""
    assignment, sign = one.assignment.copy(), one.sign.copy()
    assignment[claimed], sign[claimed] = BIN, 0
    return replace(one, assignment=assignment, sign=sign, matched=int((assignment != BIN).sum()))
