"""Operations of arrays on bit-planes: which microprogram does what, for every kind of number."""

from __future__ import annotations

from collections.abc import Sequence

from ..bit_planes import functions, integers, reals
from ..bit_planes.processors import Field, Processors
from ..bit_planes.reals import Format
from .kinds import Kind


class Arithmetic:
    """Arithmetic on fields of one kind.

    Parameters
    ----------
    pe : Processors
        The PEs that do it and count.
    kind : Kind
        INTEGER or REAL.
    nearest : bool
        Rounding of REALs.
    """

    def __init__(self, pe: Processors, kind: Kind, nearest: bool) -> None:
        self.pe, self.kind = pe, kind
        self.form = Format(kind.bits, nearest) if kind.name == 'REAL' else None

    def binary(self, operation: str, x: Field, y: Field) -> Field:
        """An operation on two; operations are those of ``DapArray.binary``."""
        pe, form = self.pe, self.form
        if form is None:
            if operation in ('divide', 'remainder'):
                quotient, rest, _ = integers.divide(pe, x, y, self.kind.signed)
                return quotient if operation == 'divide' else rest
            if operation == 'multiply':
                return integers.multiply(pe, x, y)
            return (pe.add if operation == 'add' else pe.subtract)(x, y)[0]
        if operation in ('add', 'subtract'):
            return reals.add(pe, form, x, y, minus=operation == 'subtract')
        return {'multiply': reals.multiply, 'divide': reals.divide, 'remainder': reals.remainder}[operation](
            pe, form, x, y
        )

    def power(self, x: Field, exponent: int) -> Field:
        """A whole power of at least 0."""
        if self.form is None:
            return integers.power(self.pe, x, exponent)
        return reals.power(self.pe, self.form, x, exponent)

    def function(self, name: str, *arguments: Field) -> Field:
        """A function of REALs: SQRT, EXP, LOG, SIN, COS, TAN, ASIN, ACOS, ATAN, ATAN2, POWER."""
        assert self.form is not None
        return functions.FUNCTIONS[name](self.pe, self.form, *arguments)

    def compare(self, relation: str, x: Field, y: Field) -> int:
        """The plane that is true where x is in the relation ('lt', 'le', 'gt', 'ge', 'eq', 'ne') to y.

        The opposite relation stores the inverse of the same plane, in as many instructions.
        """
        if relation in ('eq', 'ne'):
            same = self.pe.equal(x, y)
            return same if relation == 'eq' else same ^ self.pe.full
        if relation in ('gt', 'le'):
            x, y = y, x
        if self.form is None:
            smaller = integers.less(self.pe, x, y, self.kind.signed)
        else:
            smaller = reals.less(self.pe, self.form, x, y)
        return smaller if relation in ('lt', 'gt') else smaller ^ self.pe.full

    def negate(self, x: Field) -> Field:
        """The negative."""
        return integers.negate(self.pe, x) if self.form is None else reals.negate(self.pe, self.form, x)

    def absolute(self, x: Field) -> Field:
        """The magnitude; that of the most negative INTEGER is itself, and an unsigned one stays."""
        if self.form is not None:
            return reals.absolute(self.pe, self.form, x)
        return integers.absolute(self.pe, x) if self.kind.signed else self.pe.copy(x)

    def with_sign(self, x: Field, y: Field) -> Field:
        """The magnitude of x with the sign of y."""
        if self.form is not None:
            return reals.with_sign(self.pe, self.form, x, y[-1])
        size = self.absolute(x)
        return self.pe.negate_where(size, y[-1]) if self.kind.signed else size

    def extreme(self, x: Field, y: Field, largest: bool) -> Field:
        """The larger or the smaller of two, element by element; of equals the first."""
        replaced = self.compare('gt' if largest else 'lt', y, x)
        return self.pe.select(replaced, y, x)

    def candidates(self, x: Field, chosen: int, largest: bool) -> int:
        """Every place of the largest or smallest of the chosen elements, found from the highest plane downwards.

        For each plane: load it with A, ask whether any PE has the wanted bit, and narrow A where one has.
        """
        signed = self.form is not None or self.kind.signed
        negative = x[-1] if signed else 0
        # Those of the better sign come first, where there are any.
        found = chosen & (negative ^ self.pe.full if largest else negative) or chosen
        # Of negative REALs magnitudes are stored: there the order turns.
        turned = self.form is not None and bool(found & negative)
        unwanted = 0 if largest != turned else self.pe.full
        for plane in reversed(x[:-1] if signed else x):
            found = found & (plane ^ unwanted) or found
        self.pe.cycles += 3 * len(x) + 1
        return found


def convert(pe: Processors, before: Kind, after: Kind, nearest: bool, x: Sequence[int]) -> Field:
    """A field of one kind in another. To a longer word only new planes are made, which are not stored."""
    field = list(x)
    if before == after:
        return field
    if after.name == 'INTEGER':
        if before.name == 'INTEGER':
            return integers.extended(pe, field, after.bits, before.signed)
        return reals.to_integer(pe, Format(before.bits, nearest), field, after.bits, after.signed)
    form = Format(after.bits, nearest)
    if before.name == 'INTEGER':
        return reals.from_integer(pe, form, field, before.signed)
    if after.bits > before.bits:
        return [*([0] * (after.bits - before.bits)), *field]
    return reals.resized(pe, Format(before.bits, nearest), form, field)
