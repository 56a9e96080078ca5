"""Validation at the boundary: one clear message that names the argument."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def as_finite(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> np.ndarray:
    """Return value as a float64 array of the given shape (None: any length), every element finite.

    Raises ValueError that starts with ``name``.
    """
    array = as_shaped(name, value, shape)
    if not np.isfinite(array).all():
        raise ValueError(f'{name}: contains NaN or infinity')
    return array


def as_shaped(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> np.ndarray:
    """As :func:`as_finite`, but NaN and infinity are allowed."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f'{name}: not an array of numbers: {error}') from None
    if array.ndim != len(shape) or any(want is not None and want != got for want, got in zip(shape, array.shape)):
        wanted = ', '.join('n' if want is None else str(want) for want in shape)
        raise ValueError(f'{name}: expected shape ({wanted}), got {array.shape}')
    return array
