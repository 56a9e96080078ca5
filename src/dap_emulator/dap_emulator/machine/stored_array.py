"""What an array holds, in the form that the machine computes on, and what it is for the machine.

On a machine that computes in words: values, or packed words of a LOGICAL. On one that computes on bit-planes: a field
of planes, or the cells that are moved about; each is made of the others when it is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np

from msgs_py.numeric.typed import AnyArray, WordArray

from ..bit_planes.processors import Field, Processors
from ..bit_planes.reals import Format
from . import fields, moves, planes, serial
from .kinds import LOGICAL, Kind
from .machine import Machine

Array = TypeVar('Array', bound='StoredArray')


class StoredArray:
    """An array in the store of one machine; ``DapArray``, which adds the operations, describes parameters."""

    __slots__ = (
        'dap',
        'kind',
        'shape',
        'mapping',
        '_values',
        '_words',
        '_cells',
        '_field',
        '_planes',
        'fresh',
        '__weakref__',
    )

    def __init__(
        self,
        dap: Machine,
        kind: Kind,
        values: AnyArray | None,
        *,
        shape: tuple[int, ...] | None = None,
        words: WordArray | None = None,
        cells: AnyArray | None = None,
        field: Field | None = None,
        mapping: str | None = None,
        owned: bool = True,
    ) -> None:
        self._planes = 0
        self.dap, self.kind = dap, kind
        self._cells, self._field = None, field
        if cells is not None:
            shape = cells.shape
            if dap.in_bits and kind.name == 'REAL':
                self._cells = cells
            else:
                values = cells
        self._values, self._words = values, words
        self.shape: tuple[int, ...] = values.shape if values is not None else tuple(shape or ())
        self.mapping = mapping or dap.mapping
        self.fresh = owned
        if owned:
            wanted = kind.bits * dap.layout(self.shape, self.mapping).blocks
            dap.store.take(wanted, f'a {kind} array of shape {self.shape}')
            self._planes = wanted

    def __del__(self) -> None:
        if self._planes:
            self.dap.store.give_back(self._planes)

    # What is in it.

    @property
    def values(self) -> AnyArray:
        """Values as a numpy array of ``kind.dtype``, for reading: ``a[mask] = ...`` and ``assign`` change an array."""
        if self._values is None:
            if self._words is not None:
                self._values = planes.unpack(self._words, self.size).reshape(self.shape)
            elif self.kind.name == 'REAL':
                self._values = fields.real_values(self.cells, self.kind)
            else:
                assert self._field is not None
                self._values = fields.from_field(self._field, self.kind, self.shape)
        return self._values

    @property
    def cells(self) -> AnyArray:
        """Words of the elements as ``fields.cell_type`` has them: what is moved about unchanged. For reading."""
        if not self.dap.in_bits or self.kind.name != 'REAL':
            return self.values
        if self._cells is None:
            if self._field is not None:
                self._cells = fields.from_field(self._field, self.kind, self.shape)
            else:
                self._cells = fields.real_cells(self._values, self._form)
        return self._cells

    @property
    def field(self) -> Field:
        """The bit-planes of a number or LOGICAL, the least significant first, elements in row order."""
        if self._field is None:
            if self.kind.name == 'LOGICAL':
                self._field = [int.from_bytes(self.words.tobytes(), 'little')]
            else:
                self._field = fields.to_field(self.cells, self.kind.bits)
        return self._field

    @property
    def _form(self) -> Format:
        return Format(self.kind.bits, self.dap.nearest)

    @property
    def words(self) -> WordArray:
        """(words,) uint64: the packed bit-plane of a LOGICAL, elements in row order."""
        if self._words is None:
            assert self._values is not None
            self._words = planes.pack(self._values.reshape(-1))
        return self._words

    def count_true(self) -> int:
        """Number of trues of a LOGICAL. Charges nothing."""
        if self._words is None:
            return int(np.count_nonzero(self.values))
        return planes.count_true(self._words)

    def any_true(self) -> bool:
        """Whether a LOGICAL has a true. Charges nothing."""
        return bool(self.values.any() if self._words is None else self._words.any())

    @property
    def size(self) -> int:
        """Number of elements."""
        return int(np.prod(self.shape))

    @property
    def rank(self) -> int:
        """1 for a vector, 2 for a matrix."""
        return len(self.shape)

    @property
    def blocks(self) -> int:
        """Blocks of ES x ES elements that it covers."""
        return self.dap.layout(self.shape, self.mapping).blocks

    def numpy(self) -> AnyArray:
        """Copy the values to the host, at the cost of a transfer."""
        self.charge('host', self.kind)
        return self.values.copy()

    def __array__(self, dtype: Any = None, copy: Any = None) -> AnyArray:
        return self.values.astype(dtype) if dtype is not None else self.values.copy()

    def planes(self) -> WordArray:
        """(bits, words) uint64: the packed bit-planes, plane 0 the least significant; of a REAL on bit-planes only."""
        if self.kind.name == 'LOGICAL':
            return self.words[None]
        if self.dap.in_bits:
            octets = 8 * planes.words_for(self.size)
            packed = b''.join(plane.to_bytes(octets, 'little') for plane in self.field)
            return np.frombuffer(packed, dtype=np.uint64).reshape(self.kind.bits, -1)
        if self.kind.name != 'INTEGER':
            raise ValueError(f"planes: of a LOGICAL or INTEGER array, or with arithmetic='bits'; not {self.kind}")
        return planes.to_planes(self.values, self.kind)

    # Charging and making results.

    def charge(self, operation: str, kind: Kind, detail: int = 1, axis: int = 0, times: int = 1) -> None:
        """Charge an operation on this array to the machine's counters; arguments as for ``Machine.charge``."""
        self.dap.charge(operation, kind, self.shape, self.mapping, detail, axis, times)

    def like(self: Array, kind: Kind, values: AnyArray) -> Array:
        """Make an array of these values on the same machine and mapping; it costs nothing.

        Parameters
        ----------
        kind : Kind
        values : array of this array's shape
            In the kind's type.
        """
        return type(self)(self.dap, kind, values, mapping=self.mapping)

    def like_cells(self: Array, cells: AnyArray, mapping: str | None = None) -> Array:
        """Make an array of this kind, on the same machine, of these cells of any shape; it costs nothing."""
        return type(self)(self.dap, self.kind, None, cells=cells, mapping=mapping or self.mapping)

    def like_field(self: Array, kind: Kind, field: Field) -> Array:
        """Make an array of these bit-planes, of this array's shape, on the same machine; it costs nothing."""
        if kind.name == 'LOGICAL':
            octets = 8 * planes.words_for(self.size)
            return self._logical(np.frombuffer(field[0].to_bytes(octets, 'little'), dtype=np.uint64))
        return type(self)(self.dap, kind, None, shape=self.shape, field=field, mapping=self.mapping)

    @contextmanager
    def processors(self) -> Iterator[Processors]:
        """The PEs that hold the array; what they count goes to the operation that was charged last."""
        pe = Processors(self.size)
        yield pe
        self.dap.count(pe.cycles * self.blocks)
        self.dap.faults += pe.faults

    @contextmanager
    def arithmetic(self, kind: Kind) -> Iterator[serial.Arithmetic]:
        """Arithmetic on bit-planes of one kind, counted as by ``processors``."""
        with self.processors() as pe:
            yield serial.Arithmetic(pe, kind, self.dap.nearest)

    def field_as(self, kind: Kind) -> Field:
        """The bit-planes in a longer word or as REAL; only the latter costs cycles."""
        if self.kind == kind:
            return self.field
        if kind.name == 'REAL' and self.kind.name == 'INTEGER':
            self.charge('convert', kind)
        with self.processors() as pe:
            return serial.convert(pe, self.kind, kind, self.dap.nearest, self.field)

    def constant(self, kind: Kind, value: bool | int | float) -> Field:
        """A scalar as bit-planes that the control unit broadcasts."""
        if kind.name == 'REAL':
            form = Format(kind.bits, self.dap.nearest)
            return Processors(self.size).constant(int(fields.real_cells(float(value), form)), kind.bits)
        return Processors(self.size).constant(int(kind.scalar(value)), kind.bits)

    def _logical(self: Array, words: WordArray) -> Array:
        """A LOGICAL of this array's shape from packed words."""
        return type(self)(self.dap, LOGICAL, None, shape=self.shape, words=words, mapping=self.mapping)

    def charge_move(self, operation: str) -> None:
        """Charge an operation that moves whole planes (``moves.cycles``), and count it on bit-planes."""
        self.charge(operation, self.kind)
        if self.dap.in_bits:
            self.dap.count(moves.cycles(operation, self.kind.bits, self.dap.layout(self.shape, self.mapping)))

    def cell(self, value: bool | int | float) -> Any:
        """A scalar as one of ``cells``."""
        if self.dap.in_bits and self.kind.name == 'REAL':
            return fields.real_cells(float(value), self._form)
        return self.kind.scalar(value)
