"""What operations need of their operands: moved arrays, scalars that fit, kinds that meet."""

from __future__ import annotations

from typing import Any

import numpy as np

from msgs_py.numeric.typed import AnyArray

from .kinds import Kind, real


def moved(values: AnyArray, distance: int, axis: int, cyclic: bool) -> AnyArray:
    """out[i] = values[i + distance] along an axis; beyond the edge zero, or wrapped around.

    Examples
    --------
    >>> import numpy as np
    >>> moved(np.array([1, 2, 3]), 1, axis=0, cyclic=False).tolist()
    [2, 3, 0]
    """
    if cyclic:
        return np.roll(values, -distance, axis=axis)
    out = np.zeros_like(values)
    extent = values.shape[axis]
    if abs(distance) < extent:
        here: list[Any] = [slice(None)] * values.ndim
        there = list(here)
        here[axis] = slice(0, extent - distance) if distance >= 0 else slice(-distance, extent)
        there[axis] = slice(distance, extent) if distance >= 0 else slice(0, extent + distance)
        out[tuple(here)] = values[tuple(there)]
    return out


def checked_scalar(kind: Kind, value: Any, what: str) -> bool | int | float:
    """Return a scalar that meets an array of this kind, as a plain Python number.

    Raises
    ------
    ValueError
        Beginning with ``what``, when the scalar is of another class or does not fit the word.
    """
    if isinstance(value, (bool, np.bool_)):
        if kind.name != 'LOGICAL':
            raise ValueError(f'{what}: a logical value meets {kind}')
        return bool(value)
    if kind.name == 'LOGICAL' or not isinstance(value, (int, float, np.integer, np.floating)):
        raise ValueError(f'{what}: {value!r} meets {kind}')
    if kind.name == 'INTEGER' and isinstance(value, (int, np.integer)):
        low, high = kind.range
        if not low <= value <= high:
            raise ValueError(f'{what}: {value} does not fit {kind} ({low} to {high})')
    plain: bool | int | float = value.item() if isinstance(value, np.generic) else value
    return plain


def scalar_kind(kind: Kind, value: Any, what: str) -> Kind:
    """The kind of the result of an operation on an array of this kind and a scalar."""
    if kind.name == 'INTEGER' and isinstance(value, (float, np.floating)):
        return real(4) if kind.bits <= 32 else real(8)
    checked_scalar(kind, value, what)
    return kind
