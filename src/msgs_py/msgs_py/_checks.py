"""Validation at the boundary: one clear message that names the argument."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from .numeric.typed import FloatArray

# Numbers that are few.
FEW = 20


def as_finite(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """A copy of a value as a float64 array of the given shape, every element finite.

    Parameters
    ----------
    name : str
        What the value is called in errors.
    value : array_like of float
    shape : tuple of int or None
        Expected shape; None stands for any length.

    Raises
    ------
    ValueError
        Starts with ``name``.

    Examples
    --------
    >>> as_finite('points', [[0, 0, 1]], (None, 3))
    array([[0., 0., 1.]])
    >>> as_finite('points', [[0, 0]], (None, 3))
    Traceback (most recent call last):
    ValueError: points: expected shape (n, 3), got (1, 2)
    """
    array = as_shaped(name, value, shape)
    # Poses are made by the thousand: of so few numbers Python's own look takes a tenth of the time of numpy's.
    finite = all(map(math.isfinite, array.ravel().tolist())) if array.size < FEW else np.isfinite(array).all()
    if not finite:
        raise ValueError(f'{name}: contains NaN or infinity')
    return array


def as_shaped(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """As :func:`as_finite`, but NaN and infinity are allowed."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f'{name}: not an array of numbers: {error}') from None
    if array.shape == shape:
        return array
    if array.ndim != len(shape) or any(want is not None and want != got for want, got in zip(shape, array.shape)):
        wanted = ', '.join('n' if want is None else str(want) for want in shape)
        raise ValueError(f'{name}: expected shape ({wanted}), got {array.shape}')
    return array
