"""Variables of a running program: parallel arrays in bit-planes, serial arrays of scalars beside them."""

from __future__ import annotations

from typing import Any

import numpy as np

from msgs_py.numeric.typed import AnyArray, BoolArray

from ..machine import moves, planes
from ..machine.arrays import DapArray
from ..machine.fields import cell_type, form_of, real_cells, real_values
from ..machine.kinds import LOGICAL, Kind
from ..machine.machine import Machine
from ..machine.operands import checked_scalar

Place = tuple[int, ...]


class ArrayVariable:
    """An array variable of a program.

    Parameters
    ----------
    dap : Machine
    kind : Kind
    parallel : tuple of int
        Parallel extents: (), (n,) or (rows, columns).
    serial : tuple of int
        Serial extents.
    data : array, optional
        Of a part of another variable, whose store it shares. Otherwise the variable takes store of its own.
    name : str
        Named when the store is exhausted.

    Attributes
    ----------
    data : array
        Packed words (serial..., words) uint64 of a parallel LOGICAL, otherwise cells (serial..., parallel...): values,
        but of a parallel REAL on bit-planes the machine's patterns.
    packed : bool
        Whether data are packed words.
    patterns : bool
        Whether data are patterns.

    Raises
    ------
    OutOfStore
        When too few bit-planes are free.
    """

    __slots__ = ('dap', 'kind', 'parallel', 'serial', 'data', 'packed', 'patterns', '_taken')

    def __init__(
        self,
        dap: Machine,
        kind: Kind,
        parallel: Place,
        serial: Place,
        data: AnyArray | None = None,
        name: str = 'an array',
    ) -> None:
        self.dap, self.kind, self.parallel, self.serial = dap, kind, tuple(parallel), tuple(serial)
        self.packed = kind == LOGICAL and bool(parallel)
        self.patterns = dap.in_bits and kind.name == 'REAL' and bool(parallel)
        self._taken = 0
        if data is None:
            many = int(np.prod(self.serial, dtype=np.int64)) if self.serial else 1
            if self.parallel:
                wanted = many * kind.bits * dap.layout(self.parallel).blocks
            else:  # scalars lie along a plane's rows, ES * ES bits to a plane (thesis 3.2.3)
                wanted = -(-many * kind.bits // dap.pes)
            dap.store.take(wanted, f'{name} ({kind}, {" x ".join(map(str, self.parallel + self.serial))})')
            self._taken = wanted
            if self.packed:
                data = np.zeros(self.serial + (planes.words_for(int(np.prod(self.parallel))),), dtype=np.uint64)
            elif kind.name == 'CHARACTER':
                data = np.full(self.serial, ' ', dtype=object)
            else:
                data = np.zeros(self.serial + self.parallel, dtype=cell_type(kind, self.patterns))
        self.data = data

    def __del__(self) -> None:
        if self._taken:
            self.dap.store.give_back(self._taken)

    def place(self, indices: tuple[int, ...]) -> Place:
        """Serial indices, from 1, as numpy indices. Raises IndexError when one is outside."""
        for index, extent in zip(indices, self.serial):
            if not 1 <= index <= extent:
                raise IndexError(f'serial index {index} is outside 1 to {extent}')
        return tuple(index - 1 for index in indices)

    def read(self, place: Place) -> DapArray:
        """Read the parallel array at a serial place, as a view."""
        if self.packed:
            return DapArray(self.dap, LOGICAL, None, shape=self.parallel, words=self.data[place], owned=False)
        return DapArray(self.dap, self.kind, None, cells=self.data[place] if place else self.data, owned=False)

    def part(self, place: Place) -> ArrayVariable:
        """Make the parallel array at a serial place a variable of its own, which shares the store."""
        return ArrayVariable(self.dap, self.kind, self.parallel, (), self.data[place])

    def scalar(self, value: Any) -> Any:
        """Convert a scalar that will be stored to this kind."""
        if self.kind.name == 'LOGICAL' or isinstance(value, bool):
            return checked_scalar(self.kind, value, 'assignment')
        if self.patterns:
            return real_cells(float(value), form_of(self.kind, self.dap.nearest))
        return self.kind.scalar(value)

    def _charge(self, operation: str) -> None:
        """Charge a move within the store, and count it on bit-planes."""
        self.dap.charge(operation, self.kind, self.parallel)
        if self.dap.in_bits:
            self.dap.count(moves.cycles(operation, self.kind.bits, self.dap.layout(self.parallel)))

    def write(self, place: Place, value: Any) -> None:
        """Write a parallel array or a scalar over the whole parallel array at a serial place."""
        target = self.data[place] if place else self.data
        if not isinstance(value, DapArray):
            scalar = self.scalar(value)
            self._charge('copy')
            if self.packed:
                target[...] = planes.ones(int(np.prod(self.parallel))) if scalar else 0
            else:
                target[...] = scalar
            return
        if value.shape != self.parallel:
            raise ValueError(f'cannot assign shape {value.shape} to shape {self.parallel}')
        if value.kind != self.kind:
            target[...] = value.converted(self.kind)
            return
        if not value.fresh:
            self._charge('copy')
        target[...] = value.words if self.packed else value.cells

    def write_where(self, place: Place, value: Any, mask: BoolArray) -> None:
        """Write a parallel array or a scalar where a mask is true.

        Parameters
        ----------
        place : tuple of int
            Serial place, from 0.
        value : DapArray or scalar
        mask : bool array
            Of the parallel shape, or broadcast to it.
        """
        target = self.data[place] if place else self.data
        self._charge('masked_copy')
        source: Any
        if isinstance(value, DapArray):
            source = value.cells if value.kind == self.kind else value.converted(self.kind)
            if source.ndim == 1 and len(self.parallel) == 2:
                source = source[None, :] if mask.shape[1] == 1 or mask.shape[0] > 1 else source[:, None]
        else:
            source = self.scalar(value)
        if self.packed:
            chosen = np.broadcast_to(mask, self.parallel)
            flags = planes.unpack(target, int(np.prod(self.parallel))).reshape(self.parallel)
            target[...] = planes.pack(np.where(chosen, source, flags).reshape(-1))
        else:
            np.copyto(target, source, where=mask, casting='unsafe')

    def write_part(self, place: Place, where: tuple[Any, ...], value: Any) -> None:
        """Write a scalar or a vector into the part that numpy indices select.

        Parameters
        ----------
        place : tuple of int
            Serial place, from 0.
        where : tuple of int or slice
            An element, a row or a column of the parallel array.
        value : DapArray or scalar
        """
        element = all(isinstance(index, int) for index in where)
        self._charge('store_element' if element else 'broadcast')
        source = value
        if isinstance(value, DapArray):
            source = value.cells if value.kind == self.kind else value.converted(self.kind)
        else:
            source = self.scalar(value)
        target = self.data[place] if place else self.data
        if not self.packed:
            target[where] = source
        elif element:
            flat = int(np.ravel_multi_index(where, self.parallel))
            bit = np.uint64(1 << (flat % planes.WORD_BITS))
            word = flat // planes.WORD_BITS
            target[word] = target[word] | bit if source else target[word] & ~bit
        else:
            flags = planes.unpack(target, int(np.prod(self.parallel))).reshape(self.parallel)
            flags[where] = source
            target[...] = planes.pack(flags.reshape(-1))

    def to_numpy(self) -> Any:
        """Return the values in the language's order of dimensions, parallel before serial; a text of CHARACTERs."""
        if self.kind.name == 'CHARACTER':
            return ''.join(self.data) if self.data.ndim == 1 else self.data.copy()
        values = self.data
        if self.packed:
            values = planes.unpack(values, int(np.prod(self.parallel))).reshape(self.serial + self.parallel)
        elif self.patterns:
            values = real_values(values, self.kind)
        axes = tuple(range(len(self.serial), values.ndim)) + tuple(range(len(self.serial)))
        return np.ascontiguousarray(values.transpose(axes))

    def load(self, values: Any, name: str) -> None:
        """Take values from the host, in the language's order of dimensions.

        Raises
        ------
        ValueError
            Naming the variable, for another shape or class of values.
        """
        if self.kind.name == 'CHARACTER':
            text = list(values)
            if self.data.shape != (len(text),):
                raise ValueError(f'{name}: expected {self.data.shape[0]} characters, got {len(text)}')
            self.data[...] = text
            return
        array = np.asarray(values)
        shape = self.parallel + self.serial
        if array.shape != shape:
            raise ValueError(f'{name}: expected shape {shape}, got {array.shape}')
        logical = array.dtype == bool
        if logical != (self.kind.name == 'LOGICAL') or array.dtype.kind not in 'biuf':
            raise ValueError(f'{name}: expected {self.kind}, got {array.dtype}')
        if self.patterns:
            try:
                converted: AnyArray = real_cells(array, form_of(self.kind, self.dap.nearest))
            except ValueError as error:
                raise ValueError(f'{name}: {error}') from None
        else:
            converted = self.kind.convert(array)
        count = len(self.parallel)
        converted = np.ascontiguousarray(converted.transpose(tuple(range(count, array.ndim)) + tuple(range(count))))
        if self.packed:
            self.data[...] = planes.pack(converted.reshape(self.serial + (-1,)))
        else:
            self.data[...] = converted
        if self.parallel:
            self.dap.charge('host', self.kind, self.parallel, times=int(np.prod(self.serial)) if self.serial else 1)
