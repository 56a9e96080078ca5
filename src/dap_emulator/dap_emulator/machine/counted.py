"""The cost table beside what microprograms on bit-planes count: the table is tested, not only sourced."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from . import intrinsics as f
from .arrays import DapArray
from .dap import Dap
from .kinds import LOGICAL, Kind, integer, real

# Seed of the operands. The counts do not depend on values, but for results that overflow and the exponents of MOD.
_SEED = 1
_INTEGERS = tuple(integer(length) for length in (1, 2, 4, 8))
_REALS = tuple(real(length) for length in (3, 4, 8))
_BOTH = _INTEGERS + _REALS


class Row(NamedTuple):
    """One operation on a DAP 510, cycles a block.

    Attributes
    ----------
    name : str
        Of the operation, as a user writes it.
    kind : Kind
    table : int
        Cycles of the cost table with the overhead H of starting an operation.
    bare : int
        The same without H, where the table adds it; rates of REALs include it.
    counted : int
        Instructions of the microprogram.
    """

    name: str
    kind: Kind
    table: int
    bare: int
    counted: int

    @property
    def ratio(self) -> float:
        """Counted by what the table has without H."""
        return self.counted / self.bare


_Act = Callable[[Any, Any], Any]
# Operation, what does it, and the kinds that it is shown for.
_OPERATIONS: tuple[tuple[str, _Act, tuple[Kind, ...]], ...] = (
    ('a + b', lambda a, b: a + b, _BOTH),
    ('a - b', lambda a, b: a - b, _BOTH),
    ('a < b', lambda a, b: a < b, _BOTH),
    ('a == b', lambda a, b: a == b, _BOTH),
    ('a * b', lambda a, b: a * b, _BOTH),
    ('a / b', lambda a, b: a / b, _BOTH),
    ('neighbour, 1 place', lambda a, b: a.neighbour(1), _BOTH),
    ('neighbour, 4 places', lambda a, b: a.neighbour(4), _INTEGERS),
    ('neighbour, sheets of 4 x 4 blocks', lambda a, b: a.neighbour(1), _INTEGERS[1:2]),
    ('neighbour, crinkled 4 x 4 blocks', lambda a, b: a.neighbour(1), _INTEGERS[1:2]),
    ('copy', lambda a, b: a.copy(), _BOTH),
    ('MERGE', lambda a, b: f.merge(a, b, _mask(a)), _BOTH),
    ('MAX', f.maximum, _BOTH),
    ('MAXP', lambda a, b: f.maxp(a), _BOTH),
    ('SUM', lambda a, b: f.sum_(a), (*_INTEGERS[2:], *_REALS)),
    ('FLOAT', lambda a, b: a.astype(real(4)), _INTEGERS[1:3]),
    ('FIX', lambda a, b: a.astype(integer(4)), _REALS[1:]),
    ('SQRT', lambda a, b: f.sqrt(a), _REALS),
    ('EXP', lambda a, b: f.exp(a), _REALS),
    ('LOG', lambda a, b: f.log(a), _REALS),
    ('SIN', lambda a, b: f.sin(a), _REALS),
    ('ATAN', lambda a, b: f.atan(a), _REALS),
)
# Of these the operands have more than one block: how many along a side, and the mapping.
_SPREAD = {'neighbour, sheets of 4 x 4 blocks': (4, 'sheet'), 'neighbour, crinkled 4 x 4 blocks': (4, 'crinkled')}


def _mask(a: DapArray) -> DapArray:
    """A LOGICAL of an array's shape."""
    return a.like(LOGICAL, np.eye(*a.shape, dtype=bool))


def rows() -> list[Row]:
    """Every operation, charged and counted: on one block, where the name does not say otherwise.

    Returns
    -------
    list of Row
    """
    return [_row(name, act, kind) for name, act, kinds in _OPERATIONS for kind in kinds]


def _row(name: str, act: _Act, kind: Kind) -> Row:
    """One operation, charged with and without H, and counted."""
    rng = np.random.default_rng(_SEED)
    blocks, mapping = _SPREAD.get(name, (1, 'sheet'))
    table = []
    counted = 0
    for costs in ({}, {'overhead_fortran': 0.0}):
        dap = Dap.model('510', arithmetic='bits', costs=costs, mapping=mapping)
        shape = (blocks * dap.es, blocks * dap.es)
        a, b = (dap.matrix(each, kind) for each in rng.integers(1, 100, (2, *shape)))
        dap.reset()
        act(a, b)
        table.append(dap.cycles // blocks**2)
        counted = dap.counted_cycles // blocks**2
    return Row(name, kind, table[0], table[1], counted)


def table() -> str:
    """The comparison as a table in Markdown: an operation a row, a word length a column.

    Each field has the cycles of the cost table without H, those counted, and their ratio.
    """
    found = {(row.name, row.kind): row for row in rows()}
    lines = [
        f'| operation | {" | ".join(str(kind) for kind in _BOTH)} |',
        f'| --- | {" | ".join("---:" for _ in _BOTH)} |',
    ]
    for name in dict.fromkeys(row.name for row in found.values()):
        fields = [found.get((name, kind)) for kind in _BOTH]
        lines.append(f'| {name} | {" | ".join(_field(row) for row in fields)} |')
    return '\n'.join(lines)


def _field(row: Row | None) -> str:
    return '' if row is None else f'{row.bare} → {row.counted} ({row.ratio:.2f})'
