"""The one-bit processing elements: registers, store and the steps that microprograms are made of, counted.

A plane holds one bit of every element and is a Python integer: bit e belongs to element e. A field is a list of planes,
the least significant first. All elements take part in every instruction, so that an addition is one pass up the planes
with a plane of carries.

A PE has an accumulator Q, a carry C and an activity A. One instruction takes one cycle and does one of: load a plane
from the store, or combine it with Q, C or A by a Boolean function or a full adder on its way; store Q; take Q from the
neighbour to the north, east, south or west; tell the control unit whether any Q is true. A load or a store may be
limited to the PEs whose A is true, and a bit that the control unit broadcasts may stand for the plane. Where a step
needs a plane of the store at another significance, it addresses that plane: moving up and down a word is free.

The registers are named in public listings of the assembly; one access to the store a cycle is the published rate of the
family (docs/dap.md). What one instruction may combine is our estimate.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TypeAlias

Field: TypeAlias = list[int]


def _full_add(x: Sequence[int], y: Sequence[int], carry: int) -> tuple[Field, int]:
    """The sum x + y + carry of two fields of equal length, plane by plane, and the carry out."""
    out = []
    for a, b in zip(x, y):
        one = a ^ b
        out.append(one ^ carry)
        carry = (a & b) | (carry & one)
    return out, carry


class Processors:
    """The PEs that hold one block of an array, all blocks at once: they take the same instructions.

    Parameters
    ----------
    count : int
        Elements: bits of a plane.

    Attributes
    ----------
    full : int
        The plane that is true everywhere.
    cycles : int
        Instructions so far, for one block.
    faults : int
        Elements so far whose result is not a number of the format: overflow, division by zero, square root of a
        negative number.

    Examples
    --------
    >>> pe = Processors(3)
    >>> total, carry = pe.add([0b101, 0b110], [0b011, 0b000])  # 1, 2, 3 and 1, 1, 0, in two planes
    >>> total, carry, pe.cycles
    ([6, 7], 0, 7)
    """

    def __init__(self, count: int) -> None:
        self.count, self.full = count, (1 << count) - 1
        self.cycles = self.faults = 0

    # Constants and single planes.

    def constant(self, value: int, planes: int) -> Field:
        """A whole number that the control unit broadcasts, in two's complement: it is in no plane and costs nothing."""
        return [self.full if value >> bit & 1 else 0 for bit in range(planes)]

    def inverse(self, plane: int) -> int:
        """The inverse of one plane: load and store."""
        self.cycles += 2
        return plane ^ self.full

    def both(self, a: int, b: int) -> int:
        """True where both planes are: load, combine, store."""
        self.cycles += 3
        return a & b

    def either(self, a: int, b: int) -> int:
        """True where a plane is: load, combine, store."""
        self.cycles += 3
        return a | b

    def differ(self, a: int, b: int) -> int:
        """True where two planes differ: load, combine, store."""
        self.cycles += 3
        return a ^ b

    def any_plane(self, planes: Iterable[int]) -> int:
        """True where any of the planes is: one load for each, and a store."""
        self.cycles += 1
        found = 0
        for plane in planes:
            self.cycles += 1
            found |= plane
        return found

    def anywhere(self, plane: int) -> bool:
        """Whether the plane is true in any PE, told to the control unit: a load and a test."""
        self.cycles += 2
        return plane != 0

    def fault(self, plane: int) -> bool:
        """Count the PEs where the plane is true as faults; whether there are any."""
        self.faults += plane.bit_count()
        return self.anywhere(plane)

    # Adding: load one operand, add the other, store. Each clears or sets the carry first.

    def add(self, x: Sequence[int], y: Sequence[int], carry: int = 0) -> tuple[Field, int]:
        """The sum x + y + carry of two fields of equal length, and the carry out: three instructions a plane."""
        self.cycles += 3 * len(x) + 1
        return _full_add(x, y, carry)

    def subtract(self, x: Sequence[int], y: Sequence[int]) -> tuple[Field, int]:
        """The difference x - y, and a carry that is true where x >= y, unsigned: the inverse of y is added."""
        self.cycles += 3 * len(x) + 1
        full = self.full
        return _full_add(x, [b ^ full for b in y], full)

    def add_where(self, x: Sequence[int], y: Sequence[int], active: int) -> tuple[Field, int]:
        """The sum x + y where active, x elsewhere: Q is loaded from x, y is added where A is true."""
        self.cycles += 3 * len(x) + 2
        if not active:  # a bit of a scalar that is 0: the machine adds nothing just as long
            return list(x), 0
        return _full_add(x, [b & active for b in y], 0)

    def add_or_subtract(self, x: Sequence[int], y: Sequence[int], minus: int) -> tuple[Field, int]:
        """Subtract y where minus is true, add it elsewhere: load y with A exclusive-or, add x, store; C begins as A."""
        self.cycles += 3 * len(x) + 2
        return _full_add(x, [b ^ minus for b in y], minus)

    def increment(self, x: Sequence[int], carry: int) -> tuple[Field, int]:
        """The sum x + carry, and the carry out: two instructions a plane."""
        self.cycles += 2 * len(x) + 1
        out = []
        for a in x:
            out.append(a ^ carry)
            carry &= a
        return out, carry

    def negate_where(self, x: Sequence[int], active: int) -> Field:
        """Change the sign of x where active: load with A exclusive-or, add the carry, store."""
        self.cycles += 3 * len(x) + 2
        carry = active
        out = []
        for a in x:
            a ^= active
            out.append(a ^ carry)
            carry &= a
        return out

    def carry_of(self, x: Sequence[int], y: Sequence[int], carry: int) -> int:
        """The carry of x - y - 1 + carry, without the difference: two loads a plane, C set and stored.

        With a carry of all ones it is true where x >= y, with none where x > y, unsigned.
        """
        self.cycles += 2 * len(x) + 2
        full = self.full
        for a, b in zip(x, y):
            b ^= full
            carry = (a & b) | (carry & (a ^ b))
        return carry

    def equal(self, x: Sequence[int], y: Sequence[int]) -> int:
        """True where two fields are equal: two loads and a step of A for each plane, A set and stored."""
        self.cycles += 3 * len(x) + 2
        differ = 0
        for a, b in zip(x, y):
            differ |= a ^ b
        return differ ^ self.full

    # Choosing and shifting.

    def copy(self, x: Sequence[int]) -> Field:
        """The same planes at another place of the store: load and store."""
        self.cycles += 2 * len(x)
        return list(x)

    def select(self, active: int, x: Sequence[int], y: Sequence[int]) -> Field:
        """Take x where active, y elsewhere: load y, load x where A is true, store."""
        self.cycles += 3 * len(x) + 1
        return [b ^ ((a ^ b) & active) for a, b in zip(x, y)]

    def store_where(self, active: int, x: Sequence[int], old: Sequence[int]) -> Field:
        """Store x over old where active: load x, store where A is true."""
        self.cycles += 2 * len(x) + 1
        return [b ^ ((a ^ b) & active) for a, b in zip(x, old)]

    def keep_where(self, active: int, x: Sequence[int]) -> Field:
        """Keep x where active, zero elsewhere: load with A, store."""
        self.cycles += 2 * len(x) + 1
        return [a & active for a in x]

    def down_where(self, x: Sequence[int], places: int, active: int) -> Field:
        """Shift x down by so many places where active; zeros come in at the top."""
        self.cycles += 3 * len(x) - min(places, len(x)) + 1
        still = active ^ self.full
        moved = [*x[places:], *([0] * min(places, len(x)))]
        return [(a & still) | (b & active) for a, b in zip(x, moved)]

    def up_where(self, x: Sequence[int], places: int, active: int) -> Field:
        """Shift x up by so many places where active; zeros come in at the bottom, the top is lost."""
        self.cycles += 3 * len(x) - min(places, len(x)) + 1
        still = active ^ self.full
        moved = [*([0] * min(places, len(x))), *x][: len(x)]
        return [(a & still) | (b & active) for a, b in zip(x, moved)]
