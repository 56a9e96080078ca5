"""The machine with its arrays: what a user makes, loads with values and computes on."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .arrays import DapArray
from .kinds import Kind, kind_of, parse_kind
from .machine import MODELS, Machine


class Dap(Machine):
    """An array processor whose store can be loaded with vectors and matrices. Make one with ``Dap.model('510')``."""

    @classmethod
    def model(cls, name: str, memory_bits_per_pe: int | None = None, **options) -> Dap:
        """'510', '610', '510C', '610C' or 'ICL'. Options are those of Dap. Raises ValueError for another name."""
        key = str(name).upper()
        if key not in MODELS:
            raise ValueError(f'model: expected one of {", ".join(MODELS)}, got {name!r}')
        return cls(MODELS[key], memory_bits_per_pe, **options)

    def matrix(self, values: ArrayLike, kind: Kind | str | None = None, mapping: str | None = None) -> DapArray:
        """Two-dimensional values as a parallel matrix. kind: taken from the numbers when not given."""
        return self._load(values, 2, kind, mapping)

    def vector(self, values: ArrayLike, kind: Kind | str | None = None) -> DapArray:
        """One-dimensional values as a parallel (long) vector."""
        return self._load(values, 1, kind, None)

    def _load(self, values: ArrayLike, rank: int, kind: Kind | str | None, mapping: str | None) -> DapArray:
        array = np.asarray(values)
        if array.ndim != rank or 0 in array.shape:
            raise ValueError(
                f'values: expected a {"matrix" if rank == 2 else "vector"} with at least one element, '
                f'got shape {array.shape}'
            )
        plain = not isinstance(values, np.ndarray)
        target = kind_of(array, plain) if kind is None else parse_kind(kind)
        converted = target.convert(array)
        loaded = DapArray(
            self, target, np.array(converted) if converted is array else converted, mapping=mapping or self.mapping
        )
        self.charge('host', target, loaded.shape, loaded.mapping)
        return loaded
