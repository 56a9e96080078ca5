"""Covariances of pairs of points: whether a matrix is one, and what it says along and across their line."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .settings import LEAST_SIGMA, PSD_TOLERANCE
from .typed import BoolArray, FloatArray

# Where the upper triangle of a (6, 6) matrix stands, row by row: 21 numbers are all of it.
UPPER = np.triu_indices(6)


def as_covariances(name: str, value: ArrayLike, n: int) -> FloatArray:
    """A copy of a value as covariances of n pairs of points; NaN throughout where nothing is known.

    Parameters
    ----------
    name : str
        What the value is called in errors.
    value : (n, 6, 6) array_like of float
    n : int

    Returns
    -------
    (n, 6, 6) float64
        Exactly symmetric.

    Raises
    ------
    ValueError
        Starts with ``name`` and says which matrix is none.

    Examples
    --------
    >>> as_covariances('covariance', -np.eye(6)[None], 1)
    Traceback (most recent call last):
    ValueError: covariance: feature 0: not positive semidefinite, as a covariance is
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f'{name}: not an array of numbers: {error}') from None
    if array.size == 0 and n == 0:
        array = array.reshape(0, 6, 6)
    if array.shape != (n, 6, 6):
        raise ValueError(f'{name}: expected shape ({n}, 6, 6), got {array.shape}')
    known = np.isfinite(array).all(axis=(1, 2))
    partly = np.flatnonzero(~known & ~np.isnan(array).all(axis=(1, 2)))
    if len(partly):
        raise ValueError(f'{name}: feature {partly[0]}: expected 36 finite numbers, or NaN throughout')
    # As correlations, so that metres and radians in one matrix count alike.
    sigma = np.sqrt(np.maximum(np.einsum('nii->ni', array[known]), 0.0))
    sigma = np.where(sigma > 0.0, sigma, LEAST_SIGMA)
    correlation = array[known] / sigma[:, :, None] / sigma[:, None, :]
    at = np.flatnonzero(known)
    skew = np.abs(correlation - correlation.swapaxes(1, 2)).max(axis=(1, 2), initial=0.0) > PSD_TOLERANCE
    if skew.any():
        raise ValueError(f'{name}: feature {at[skew][0]}: not symmetric')
    try:
        np.linalg.cholesky(correlation + PSD_TOLERANCE * np.eye(6))
    except np.linalg.LinAlgError:
        least = np.linalg.eigvalsh(correlation)[:, 0]
        raise ValueError(
            f'{name}: feature {at[least.argmin()]}: not positive semidefinite, as a covariance is'
        ) from None
    return np.asarray(0.5 * (array + array.swapaxes(1, 2)))


def along_and_across(covariance: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variances of points along a direction, and across it where that is largest.

    Parameters
    ----------
    covariance : (n, 3, 3) float64
        Symmetric.
    direction : (n, 3) float64
        Unit vectors.

    Returns
    -------
    along, across : (n,) float64
        In the unit of the covariance.

    Examples
    --------
    >>> along_and_across(np.diag([4.0, 9.0, 1.0])[None], np.array([[1.0, 0.0, 0.0]]))
    (array([4.]), array([9.]))
    """
    u = direction[:, None, :]
    # Row by row, so that the figures of one feature do not hang on how many there are.
    turned = covariance[:, :, 0] * u[:, :, 0] + covariance[:, :, 1] * u[:, :, 1] + covariance[:, :, 2] * u[:, :, 2]
    along = turned[:, 0] * direction[:, 0] + turned[:, 1] * direction[:, 1] + turned[:, 2] * direction[:, 2]
    flat = covariance - turned[:, :, None] * u - turned[:, None, :] * direction[:, :, None]
    flat = flat + (along[:, None, None] * direction[:, :, None]) * u
    trace = flat[:, 0, 0] + flat[:, 1, 1] + flat[:, 2, 2]
    # Of the two eigenvalues across, sum and sum of squares are known.
    squares = flat[:, 0, 0] ** 2 + flat[:, 1, 1] ** 2 + flat[:, 2, 2] ** 2
    squares = squares + 2.0 * (flat[:, 0, 1] ** 2 + flat[:, 0, 2] ** 2 + flat[:, 1, 2] ** 2)
    across = 0.5 * (trace + np.sqrt(np.maximum(2.0 * squares - trace**2, 0.0)))
    return np.maximum(along, 0.0), np.maximum(across, 0.0)


def pair_variances(start: FloatArray, end: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variances of both points of pairs along the line between them, and across it where that is largest.

    Parameters
    ----------
    start, end : (n, 3) float64
    covariance : (n, 6, 6) float64
        Of start and end.

    Returns
    -------
    along, across : (n, 2) float64
        Of start and of end, in the unit of the covariance.
    """
    run = end - start
    # Numbers of messages may be so large that their squares are infinite; so are their bounds then.
    with np.errstate(over='ignore', invalid='ignore'):
        length = np.sqrt(run[:, 0] ** 2 + run[:, 1] ** 2 + run[:, 2] ** 2)[:, None]
        direction = np.divide(run, length, out=np.zeros_like(run), where=length > 0.0)
        of_both = [along_and_across(covariance[:, block, block], direction) for block in (slice(0, 3), slice(3, 6))]
    along, across = (np.stack(pair, axis=1) for pair in zip(*of_both))
    return along, across


def semidefinite(covariance: FloatArray) -> FloatArray:
    """Symmetric matrices (n, 6, 6), finite, as covariances: what rounding made less than zero is zero."""
    covariance = 0.5 * (covariance + covariance.swapaxes(1, 2))
    sigma = np.sqrt(np.maximum(np.einsum('nii->ni', covariance), 0.0))
    sigma = np.where(sigma > 0.0, sigma, LEAST_SIGMA)
    scale = sigma[:, :, None] * sigma[:, None, :]
    correlation = covariance / scale
    try:
        np.linalg.cholesky(correlation + 0.5 * PSD_TOLERANCE * np.eye(6))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(correlation)
        covariance = (vectors * np.maximum(values, 0.0)[:, None]) @ vectors.swapaxes(1, 2) * scale
    return np.asarray(covariance)


def upper_triangles(covariance: FloatArray) -> FloatArray:
    """(n, 21): what has to be kept of covariances (n, 6, 6), row by row."""
    return np.asarray(covariance[:, UPPER[0], UPPER[1]])


def from_upper_triangles(values: FloatArray) -> FloatArray:
    """(n, 6, 6): the covariances of :func:`upper_triangles` (n, 21)."""
    covariance = np.empty((len(values), 6, 6))
    covariance[:, UPPER[0], UPPER[1]] = values
    covariance[:, UPPER[1], UPPER[0]] = values
    return covariance


def known_covariances(covariance: FloatArray) -> BoolArray:
    """(n,) bool: which of covariances (n, 6, 6) are known."""
    return np.asarray(~np.isnan(covariance[:, 0, 0]))
