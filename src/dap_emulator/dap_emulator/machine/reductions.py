"""Sums, and places of extremes, on bit-planes.

A sum folds the blocks of the machine onto one, then adds what lies 1, 2, 4, ... PEs away. Here elements are paired at
half the distance that is left, in the order of a long vector along rows: the same number of stages, the same word
lengths, and for INTEGERs the same sum; of REALs every addition rounds.
"""

from __future__ import annotations

from typing import NamedTuple

from ..bit_planes import integers
from ..bit_planes.processors import Field, Processors
from . import serial
from .arrays import DapArray, Scalar
from .kinds import LOGICAL, Kind


def extreme_places(source: DapArray, mask: DapArray | None, largest: bool) -> DapArray:
    """Every place of the largest or smallest element where the mask is true, as a LOGICAL; charge it first."""
    with source.arithmetic(source.kind) as work:
        chosen = work.pe.full if mask is None else mask.field[0]
        return source.like_field(LOGICAL, [work.candidates(source.field, chosen, largest) if chosen else 0])


def total(source: DapArray, mask: DapArray | None, kind: Kind) -> Scalar:
    """The sum of all elements where the mask is true, in a word of this kind; charge it first."""
    field, addition = _folded(source, _masked(source, mask), kind, _Runs(source.size, 1, 1))
    where = source.dap.layout(source.shape, source.mapping)
    _count(source, addition, where.blocks - 1, 1, 2)
    first = source.like_field(kind, field).cells.reshape(-1)[:1]
    value: Scalar = DapArray(source.dap, kind, None, cells=first, owned=False).values[0].item()
    return value


def totals_along(source: DapArray, axis: int, kind: Kind) -> DapArray:
    """The sums of a matrix along an axis, as a vector; charge it first."""
    rows, columns = source.shape
    runs = _Runs(rows, columns, 1) if axis == 0 else _Runs(columns, 1, rows)
    field, addition = _folded(source, source.field, kind, runs)
    down, across = source.dap.layout(source.shape, source.mapping).grid
    folded, kept = (down, across) if axis == 0 else (across, down)
    _count(source, addition, kept * (folded - 1), kept, 1)
    cells = source.like_field(kind, field).cells
    sums = (cells[0] if axis == 0 else cells[:, 0]).copy()
    return DapArray(source.dap, kind, None, cells=sums, mapping=source.mapping)


class _Runs(NamedTuple):
    """What is added together: ``runs`` runs of ``length`` places, each of ``stride`` elements that are not added."""

    length: int
    stride: int
    runs: int

    def first(self, count: int) -> int:
        """A plane that is true in the first so many places of every run."""
        run = self.length * self.stride
        every_run = ((1 << (run * self.runs)) - 1) // ((1 << run) - 1)
        return ((1 << (count * self.stride)) - 1) * every_run


def _masked(source: DapArray, mask: DapArray | None) -> Field:
    """The field, zero where the mask is false."""
    if mask is None:
        return source.field
    with source.processors() as pe:
        return pe.keep_where(mask.field[0], source.field)


def _folded(source: DapArray, field: Field, kind: Kind, runs: _Runs) -> tuple[Field, int]:
    """Sums over runs, in the first place of each (other places have no meaning), and what one addition took.

    The sum of truths is a count that grows by a plane at each stage.
    """
    logical = source.kind.name == 'LOGICAL'
    work = serial.Arithmetic(Processors(source.size), kind, source.dap.nearest)
    if not logical:
        field = serial.convert(work.pe, source.kind, kind, source.dap.nearest, field)
    addition, left = 0, runs.length
    while left > 1:
        distance = 1 << ((left - 1).bit_length() - 1)
        kept = runs.first(left - distance)
        other = [plane >> (distance * runs.stride) & kept for plane in field]
        work.pe.cycles = 0
        if logical:
            counts, carry = work.pe.add(field, other)
            field = [*counts, carry]
        else:
            field = work.binary('add', field, other)
        addition, left = work.pe.cycles, distance
    source.dap.faults += work.pe.faults
    return (integers.extended(work.pe, field, kind.bits, signed=False) if logical else field), addition


def _count(source: DapArray, addition: int, folds: int, kept: int, axes: int) -> None:
    """Count what the machine does: additions of blocks, then for each axis shifts and additions on ``kept`` blocks."""
    logical = source.kind.name == 'LOGICAL'
    planes, cycles = source.kind.bits, folds * addition
    for _ in range(axes):
        for stage in range(source.dap.es.bit_length() - 1):
            # Load, a step for each place, store; then the addition, of truths three instructions a plane.
            cycles += kept * (planes * ((1 << stage) + 2) + (3 * planes + 1 if logical else addition))
            planes += logical
    source.dap.count(cycles)
