"""The machine with its arrays: what a user makes, loads with values and computes on."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from msgs_py.numeric.typed import AnyArray
from msgs_py.renaming import notice

from .arrays import DapArray
from .fields import form_of, real_cells
from .kinds import Kind, kind_of, parse_kind
from .machine import MODELS, Machine


class Dap(Machine):
    """An array processor whose store can be loaded with vectors and matrices. Make one with ``Dap.model('510')``.

    Parameters and attributes are those of ``Machine``.

    Examples
    --------
    >>> dap = Dap.model('510')
    >>> a = dap.matrix([[1, 2], [3, 4]])
    >>> (a * a + 1).values.tolist()
    [[2, 5], [10, 17]]
    >>> (a > 2).values.tolist()
    [[False, False], [True, True]]
    >>> dap.cycles > 0
    True
    """

    @classmethod
    def model(cls, name: str, memory_bits_per_pe: int | None = None, **options: Any) -> Dap:
        """Make a machine by the name of its model.

        Parameters
        ----------
        name : {'510', '610', '510C', '610C', 'ICL'}
            32 x 32 or 64 x 64 PEs, C with 8-bit co-processors; ICL is the 64 x 64 ancestor.
        memory_bits_per_pe : int, optional
            Store of one PE, bits.
        **options
            The other parameters of ``Machine``.

        Returns
        -------
        Dap

        Raises
        ------
        ValueError
            For another name.
        """
        key = str(name).upper()
        if key not in MODELS:
            raise ValueError(f'model: expected one of {", ".join(MODELS)}, got {name!r}')
        if options.pop('bit_serial', False):
            warnings.warn(notice('argument', 'bit_serial=True', "arithmetic='bits'"), FutureWarning, stacklevel=2)
            options['arithmetic'] = 'bits'
        return cls(MODELS[key], memory_bits_per_pe, **options)

    def matrix(self, values: ArrayLike, kind: Kind | str | None = None, mapping: str | None = None) -> DapArray:
        """Load two-dimensional values as a parallel matrix.

        Parameters
        ----------
        values : (rows, columns) array_like of truths, integers or reals
        kind : Kind or str, optional
            For example 'INTEGER*2'; taken from the numbers when not given.
        mapping : {'sheet', 'crinkled', 'combined'}, optional
            The machine's mapping when not given.

        Returns
        -------
        DapArray

        Raises
        ------
        ValueError
            For values that are no matrix or not numbers.
        OutOfStore
            When too few bit-planes are free.
        """
        return self._load(values, 2, kind, mapping)

    def vector(self, values: ArrayLike, kind: Kind | str | None = None) -> DapArray:
        """Load one-dimensional values as a parallel (long) vector; arguments and errors as for ``matrix``."""
        return self._load(values, 1, kind, None)

    def _load(self, values: ArrayLike, rank: int, kind: Kind | str | None, mapping: str | None) -> DapArray:
        """An array of this rank from the host."""
        array = np.asarray(values)
        if array.ndim != rank or 0 in array.shape:
            raise ValueError(
                f'values: expected a {"matrix" if rank == 2 else "vector"} with at least one element, '
                f'got shape {array.shape}'
            )
        plain = not isinstance(values, np.ndarray)
        target = kind_of(array, plain) if kind is None else parse_kind(kind)
        if self.in_bits and target.name == 'REAL' and array.dtype.kind in 'iuf':
            cells: AnyArray = real_cells(array, form_of(target, self.nearest))
        else:
            cells = target.convert(array)
        loaded = DapArray(
            self, target, None, cells=np.array(cells) if cells is array else cells, mapping=mapping or self.mapping
        )
        self.charge('host', target, loaded.shape, loaded.mapping)
        return loaded
