"""What an operation costs: an analytic model, one table, every constant with its source and how far to trust it.

Cycles are computed from formulas, not simulated plane by plane. For an array of B blocks an operation costs
B * (c(kind) + H): c from the formulas below, H the overhead of starting an operation on a block. The cost never depends
on how many PEs are active, because inactive ones wait. Arithmetic whose cost is known as a published rate includes H.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

from .kinds import Kind
from .mapping import Layout


@dataclass(frozen=True)
class Constant:
    """One number of the model, with its unit, the source it is from, and the confidence in it: high, medium or low."""

    name: str
    value: float
    unit: str
    source: str
    confidence: str


def _table(*rows: tuple[str, float, str, str, str]) -> dict[str, Constant]:
    return {row[0]: Constant(*row) for row in rows}


# Sources: [S] read in a published source, [D] arithmetic from such figures, [R] recalled from the DAP literature and
# not found again, [E] our estimate. n is the word length in bits, m the bits of a REAL's significand.
CONSTANTS: dict[str, Constant] = _table(
    (
        'plane_logic',
        1,
        'cycles',
        '[D] one bit-operation per PE and cycle: Gamma 1 bit/PE/cycle, rate of the family',
        'high',
    ),
    ('plane_access', 1, 'cycles', '[D] one store bit per PE and cycle (same source)', 'high'),
    ('overhead_fortran', 20, 'cycles/block', '[E] 20 fits the recalled REAL*4 copy (85 = 2*32 + 21)', 'low'),
    ('overhead_apal', 10, 'cycles/block', "[E] 10 fits Reddaway's crinkled Sobel (thesis 3.5.1)", 'low'),
    ('copy', 2, 'cycles * n', '[D] one load and one store a plane', 'medium'),
    (
        'integer_add',
        3,
        'cycles * n',
        '[D] two loads and a store a plane; bit-serial literature: 64 reads + 32 writes',
        'medium-high',
    ),
    ('compare', 2, 'cycles * n, plus 1', '[D] two loads a plane, one result plane', 'medium-high'),
    ('integer_multiply', 2, 'cycles * n^2', '[E] the inner step of the REAL*4 multiply', 'low-medium'),
    ('integer_divide', 3, 'cycles * n^2', '[E] restoring division: subtract, test and select at each bit', 'low'),
    (
        'real_add_slope',
        3,
        'cycles * m',
        '[E] shape; with the next two 731 at m = 24, [D] 14 MFLOPS (thesis 3.2.1)',
        'high for REAL*4, low else',
    ),
    (
        'real_add_align',
        4.56,
        'cycles * m * ceil(log2(m + 1))',
        '[E] aligning and normalising by powers of two',
        'high for REAL*4, low else',
    ),
    ('real_add_fixed', 112, 'cycles', '[E] exponents and signs', 'high for REAL*4, low else'),
    (
        'real_multiply',
        2,
        'cycles * m^2',
        '[D]/[R] 1280 for REAL*4 lies between 1250 [R] and 1317 [D, 20 MFLOPS mean]',
        'medium, 10%',
    ),
    ('real_multiply_fixed', 128, 'cycles', '[D]/[R] as above', 'medium, 10%'),
    ('real_divide', 2.7, 'cycles * m^2', '[R] 330 us on the ICL DAP', 'low, 25%'),
    ('real_sqrt', 1.3, 'cycles * m^2', '[R] 170 us on the ICL DAP', 'low, 25%'),
    ('real_divide_fixed', 98, 'cycles', '[R] divide and square root', 'low, 25%'),
    ('real_function', 1.5, 'REAL multiplies', '[E] EXP LOG SIN COS ATAN by bitwise table methods', 'low'),
    ('convert', 1, 'cycles * m * ceil(log2(m + 1))', '[E] FLOAT and FIX shift by powers of two', 'low'),
    ('coprocessor_add', 1, 'cycles per byte', '[S] Gamma II: 8-bit rate equals 1-bit rate', 'medium'),
    ('coprocessor_multiply', 17, 'cycles per byte^2', '[D] 610C: 2.4e9 8-bit multiplies/s (thesis 3.2.1)', 'high'),
    (
        'coprocessor_real',
        10,
        'times faster',
        '[D] 610C: 560 MFLOPS REAL*4 add; "times ten" (thesis 3.2.1, 4.13.1)',
        'high for REAL*4 add, low else',
    ),
    ('merge', 3, 'cycles * n', '[E] as an addition: two loads and a store under the activity register', 'medium'),
    ('shift', 1, 'cycles * n * (d + 1)', '[E] one NEWS step a plane and place, and a store', 'low-medium'),
    (
        'sheet_neighbour',
        11.6,
        'cycles * n * d',
        "[E] fitted to Reddaway's sheet Sobel, 8.0 ms: a fit, no measurement",
        'low',
    ),
    ('crinkled_neighbour', 2, 'cycles * n * d / tile side', "[D] only a tile's rim crosses PEs", 'medium'),
    ('broadcast', 3, 'cycles * n', '[D] highway of ES bits a cycle; MATR, MATC, rows and columns', 'low-medium'),
    ('any_all', 4, 'cycles', '[E]', 'low'),
    ('first_true', 30, 'cycles', '[E] ELN, FRST, ROWN, COLN: column test, then row test in the MCU', 'low'),
    ('extreme', 6, 'cycles * n', '[E] MAXP, MINP: a test and a narrowing of the candidates at each bit', 'low'),
    ('fetch', 1, 'cycles * n', '[E] one element of each plane over a highway to the MCU', 'low'),
    ('transpose', 1, 'cycles * n * ES', '[E] row by row over the highways', 'low'),
    ('pattern', 4, 'cycles', '[E] ROW, COL, ALT...: a pattern from MCU registers', 'low'),
    ('mcu_integer', 4, 'cycles', '[E] load, load, operate, store in MCU registers', 'low'),
    ('mcu_real', 60, 'cycles', '[E] 32-bit software floating point in the MCU', 'low'),
    ('mcu_real_function', 400, 'cycles', '[E] square root and elementary functions in the MCU', 'low'),
    ('mcu_branch', 4, 'cycles', '[E] test and jump; a DO step', 'low'),
    ('mcu_call', 40, 'cycles', '[E] stack frame and argument addresses', 'low'),
    ('host_transfer', 0, 'cycles per bit-plane', 'no source found, so none is claimed: set it to study it', 'none'),
)

# Arithmetic of these operations runs on the co-processors of a C model.
_ADDITIVE = frozenset({'add', 'subtract'})


class CostTable:
    """The cost model of one machine.

    Parameters
    ----------
    coprocessor : bool
        Arithmetic runs on 8-bit co-processors.
    level : {'fortran', 'apal'}
        Which overhead H is charged.
    overrides : mapping of str to float, optional
        Names of constants and the values that replace those of the table.

    Raises
    ------
    ValueError
        For another level, an unknown constant, or a value that is negative or not finite.

    Examples
    --------
    >>> from dap_emulator.machine.kinds import integer
    >>> from dap_emulator.machine.mapping import Layout
    >>> table = CostTable(level='apal', overrides={'overhead_apal': 0})
    >>> table.cycles('add', integer(2), Layout((32, 32), es=32))  # three cycles for each of 16 planes
    48
    """

    def __init__(
        self, coprocessor: bool = False, level: str = 'fortran', overrides: Mapping[str, float] | None = None
    ) -> None:
        if level not in ('fortran', 'apal'):
            raise ValueError(f"level: expected 'fortran' or 'apal', got {level!r}")
        self.coprocessor, self.level = coprocessor, level
        self.constants = dict(CONSTANTS)
        for name, value in (overrides or {}).items():
            if name not in CONSTANTS:
                raise ValueError(f'costs: unknown constant {name!r}, expected one of {", ".join(CONSTANTS)}')
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f'costs: {name} is {value}, expected a number >= 0')
            self.constants[name] = replace(CONSTANTS[name], value=float(value), source='override', confidence='yours')
        self.overhead = self[f'overhead_{level}']
        self.cycles = lru_cache(maxsize=None)(self._cycles)

    def __getitem__(self, name: str) -> float:
        return self.constants[name].value

    def _cycles(self, operation: str, kind: Kind, layout: Layout, detail: int = 1, axis: int = 0) -> int:
        """Cycles of one operation on an array of this kind and layout; ``cycles`` is the same with a memory.

        Parameters
        ----------
        operation : str
        kind : Kind
        layout : Layout
        detail : int
            Distance of a shift, or exponent of a power.
        axis : int
            Axis of a shift or of a sum along one dimension.

        Raises
        ------
        ValueError
            For an operation that is not in the model.
        """
        n, blocks = kind.bits, layout.blocks
        if operation in ('sum', 'sum_axis'):
            return round(self._reduction(kind, layout, axis if operation == 'sum_axis' else None))
        cost, includes_overhead = self._cost(operation, kind, layout, detail, axis)
        if operation == 'host':
            return round(blocks * n * self['host_transfer'])
        return round(blocks * (cost + (0 if includes_overhead else self.overhead)))

    def _cost(self, operation: str, kind: Kind, layout: Layout, detail: int, axis: int) -> tuple[float, bool]:
        """c(kind) for one block, and whether H is already in it."""
        n = kind.bits
        if operation in ('add', 'subtract', 'multiply', 'divide', 'sqrt', 'function', 'power'):
            return self._arithmetic(operation, kind, detail)
        if operation == 'neighbour':
            # An APAL operand is read from the neighbour inside the operation that uses it; a compiler stores it first.
            return self._neighbour(n, layout, detail, axis), self.level == 'apal'
        simple = {
            'copy': self['copy'] * n,
            'masked_copy': self['copy'] * n,
            'negate': self['copy'] * n,
            'absolute': self['integer_add'] * n,
            'compare': self['compare'] * n + 1,
            'minmax': self['compare'] * n + 1 + self['merge'] * n,
            'merge': self['merge'] * n,
            'logic': 2 * self['plane_access'] + self['plane_logic'],
            'not': self['plane_access'] + self['plane_logic'],
            'broadcast': self['broadcast'] * n,
            'any_all': self['any_all'],
            'first_true': self['first_true'],
            'extreme': self['extreme'] * n,
            'extreme_value': self['extreme'] * n + self['fetch'] * n,
            'fetch': self['fetch'] * n,
            'store_element': self['copy'] * n,
            'transpose': self['transpose'] * n * layout.es,
            'pattern': self['pattern'],
            'host': 0.0,
            'remap': self['copy'] * n * layout.es,
        }
        if operation in simple:
            return simple[operation], False
        if operation == 'convert':
            m = kind.mantissa if kind.name == 'REAL' else n
            return self['convert'] * m * math.ceil(math.log2(m + 1)), False
        raise ValueError(f'operation: {operation!r} is not in the cost model')

    def _arithmetic(self, operation: str, kind: Kind, detail: int) -> tuple[float, bool]:
        """Cycles of arithmetic on one block, and whether the overhead H is already in them."""
        n = kind.bits
        if operation == 'power':  # by repeated squaring
            times = max(1, detail.bit_length() - 1 + bin(detail).count('1') - 1)
            cost, included = self._arithmetic('multiply', kind, 1)
            return times * (cost + (0 if included else self.overhead)), True
        if kind.name == 'REAL':
            cost = self._real(operation, kind.mantissa)
            return (cost / self['coprocessor_real'] if self.coprocessor else cost), True
        if self.coprocessor:
            if operation in _ADDITIVE:
                return self['coprocessor_add'] * math.ceil(n / 8), True
            if operation == 'multiply':
                return self['coprocessor_multiply'] * math.ceil(n / 8) ** 2, True
            return self._integer(operation, n) / self['coprocessor_real'], True
        return self._integer(operation, n), False

    def _integer(self, operation: str, n: int) -> float:
        """Cycles of INTEGER arithmetic with n bits, on 1-bit PEs."""
        if operation in _ADDITIVE:
            return self['integer_add'] * n
        return (self['integer_multiply'] if operation == 'multiply' else self['integer_divide']) * n * n

    def _real(self, operation: str, m: int) -> float:
        """Cycles of REAL arithmetic with m bits of significand, on 1-bit PEs."""
        if operation in _ADDITIVE:
            steps = math.ceil(math.log2(m + 1))
            return round(self['real_add_slope'] * m + self['real_add_align'] * m * steps + self['real_add_fixed'])
        if operation in ('multiply', 'function'):
            multiply = self['real_multiply'] * m * m + self['real_multiply_fixed']
            return multiply if operation == 'multiply' else multiply * self['real_function']
        return self['real_divide' if operation == 'divide' else 'real_sqrt'] * m * m + self['real_divide_fixed']

    def _neighbour(self, n: int, layout: Layout, distance: int, axis: int) -> float:
        """Cycles of reading n planes from an element this many places away along an axis."""
        tiles = layout.grid[axis] if len(layout.shape) == 2 else 1
        if tiles == 1:
            return self['shift'] * n * (min(distance, layout.es) + 1)
        if layout.is_crinkled(axis):
            return self['crinkled_neighbour'] * n * distance / tiles
        return self['sheet_neighbour'] * n * min(distance, layout.es)

    def _reduction(self, kind: Kind, layout: Layout, axis: int | None) -> float:
        """Cycles of a sum: add up the blocks in place, then shift by 1, 2, 4, ... and add.

        A LOGICAL becomes a count, which grows by a bit at each stage.
        """
        stages = max(1, round(math.log2(layout.es)))
        axes = (0, 1) if axis is None else (axis,)
        down, across = layout.grid
        folded = (down if axis == 0 else across) if axis is not None else layout.blocks
        kept = layout.blocks // folded
        counted = kind.name == 'LOGICAL'
        total, n = float(self.overhead), kind.bits
        if counted:
            total += kept * (folded - 1) * self['integer_add'] * max(1, (folded - 1).bit_length())
            n += (folded - 1).bit_length()
        else:
            cost, included = self._arithmetic('add', kind, 1)
            total += kept * (folded - 1) * (cost + (0 if included else self.overhead))
        for _ in axes:
            for stage in range(stages):
                total += kept * self['shift'] * n * (2**stage + 1)
                total += kept * (self['integer_add'] * n if counted else self._arithmetic('add', kind, 1)[0])
                n += counted
        return total

    def mcu(self, real: bool = False, function: bool = False) -> int:
        """Cycles of one scalar operation in the control unit.

        Parameters
        ----------
        real : bool
            REAL instead of INTEGER.
        function : bool
            A function of REAL, such as a square root.
        """
        return round(self['mcu_real_function'] if function else self['mcu_real'] if real else self['mcu_integer'])

    def table(self) -> str:
        """All constants with value, unit, source and confidence, as text."""
        rows = [f'{c.name:22} {c.value:>6g}  {c.unit:34} {c.confidence:26} {c.source}' for c in self.constants.values()]
        return '\n'.join(['Cycles are computed from this table, not simulated.', ''] + rows)
