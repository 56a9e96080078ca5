"""Rates with the interval in which they lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .settings import INTERVAL


@dataclass(frozen=True)
class Rate:
    """So many of so many.

    Attributes
    ----------
    hits, count : int
    """

    hits: int
    count: int

    @property
    def share(self) -> float:
        """Of all; not a number of none."""
        return self.hits / self.count if self.count else float('nan')

    @property
    def interval(self) -> tuple[float, float]:
        """Where the true share lies with 95 % confidence (Wilson 1927); all of 0..1 when nothing was tried.

        Examples
        --------
        >>> [round(end, 3) for end in Rate(0, 100).interval]
        [0.0, 0.037]
        """
        if not self.count:
            return 0.0, 1.0
        z2 = INTERVAL**2
        middle = (self.hits + 0.5 * z2) / (self.count + z2)
        half = INTERVAL * np.sqrt(self.hits * (1.0 - self.share) + 0.25 * z2) / (self.count + z2)
        return max(float(middle - half), 0.0), min(float(middle + half), 1.0)

    @property
    def record(self) -> dict[str, float | int]:
        """Plain values."""
        low, high = self.interval
        return {'hits': self.hits, 'count': self.count, 'share': self.share, 'low': low, 'high': high}

    def __str__(self) -> str:
        if not self.count:
            return 'not tried'
        low, high = self.interval
        return f'{100 * self.share:.3g} % ({self.hits} of {self.count}; 95 %: {100 * low:.3g} to {100 * high:.3g} %)'
