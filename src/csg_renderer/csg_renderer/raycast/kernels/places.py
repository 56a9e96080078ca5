"""Where the samples of a pixel lie."""

from __future__ import annotations

from .rows import kernel

# Multiples of it leave remainders that are spread as evenly as those of any number.
GOLDEN = 0.6180339887498949


@kernel
def sample_place(k, n):
    """How far right and below the centre of a pixel the k-th of its n x n samples lies, pixels.

    In each cell of a grid there is one, and in each of n x n columns and rows (N-rooks: Chiu, Shirley and Wang 1994,
    multi-jittered sampling), in the same order in all cells: an edge along the rows or columns passes one sample after
    another, not n at once, and the pixel tells it to 1 / n^2 of its width. The order is that of multiples of the golden
    ratio, so that no other direction is as bad as those along a grid are.
    """
    column, row = k % n, k // n
    return (column + (rank(row, n) + 0.5) / n) / n - 0.5, (row + (rank(column, n) + 0.5) / n) / n - 0.5


@kernel
def rank(k, n):
    """How many of the first n multiples of the golden ratio leave less than the k-th does."""
    mine, before = (k * GOLDEN) % 1.0, 0
    for other in range(n):
        before += 1 if (other * GOLDEN) % 1.0 < mine else 0
    return before
