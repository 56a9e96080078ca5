"""Rates with the interval in which they lie."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.stats import binomtest


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
        low, high = binomtest(self.hits, self.count).proportion_ci(method='wilson')
        return float(low), float(high)

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
