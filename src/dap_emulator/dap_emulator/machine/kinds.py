"""Data types of the array machine: a class of number and a word length, and arithmetic that respects both.

Thesis 3.2: LOGICAL is one bit-plane, INTEGER*n is 8n planes (n = 1..8), REAL*n is 8n planes (n = 3..8). Shorter
integers of any number of bits exist below the language, where a programmer counts planes (APAL).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from msgs_py.numeric.typed import AnyArray

# Bits of significand of IEEE 754 numbers, the hidden one included. A REAL*n has 8n - 8 (REAL*4: 24), as far as a
# float64 can hold them.
FLOAT32_MANTISSA = 24
FLOAT64_MANTISSA = 53
# Reals beyond this magnitude are cut to it before they become integers: int64 holds it with room to spare.
LARGEST_CONVERTED = 2.0**62


@dataclass(frozen=True)
class Kind:
    """A data type: a class of number and a word length.

    Parameters
    ----------
    name : {'LOGICAL', 'INTEGER', 'REAL', 'CHARACTER'}
    bits : int
        Word length, which is the number of bit-planes.
    signed : bool
        Of an INTEGER.

    Examples
    --------
    >>> str(integer(2)), integer(2).range
    ('INTEGER*2', (-32768, 32767))
    >>> integer(2).scalar(40000)
    -25536
    >>> str(common_kind(integer(4), real(3)))
    'REAL*3'
    """

    name: str
    bits: int
    signed: bool = True

    def __str__(self) -> str:
        if self.name == 'LOGICAL':
            return 'LOGICAL'
        if self.bits % 8 == 0 and self.signed:
            return f'{self.name}*{self.bits // 8}'
        return f'{"" if self.signed else "UNSIGNED "}{self.name}({self.bits} bits)'

    @property
    def is_numeric(self) -> bool:
        """Whether it is INTEGER or REAL."""
        return self.name in ('INTEGER', 'REAL')

    @property
    def length(self) -> int:
        """Bytes: the n of INTEGER*n."""
        return -(-self.bits // 8)

    @property
    def mantissa(self) -> int:
        """Bits of significand of a REAL."""
        return min(self.bits - 8, FLOAT64_MANTISSA)

    @property
    def dtype(self) -> np.dtype[Any]:
        """The numpy type whose values hold this kind exactly."""
        return _dtype(self)

    @property
    def range(self) -> tuple[int, int]:
        """Smallest and largest INTEGER."""
        if self.signed:
            return -(1 << (self.bits - 1)), (1 << (self.bits - 1)) - 1
        return 0, (1 << self.bits) - 1

    def fit(self, values: AnyArray) -> AnyArray:
        """Cut values to the word length: integers wrap, reals round to nearest even.

        Parameters
        ----------
        values : array of ``dtype``

        Returns
        -------
        array of the same shape and type
            The array itself where nothing had to be cut.
        """
        if self.name == 'INTEGER':
            spare = 8 * values.dtype.itemsize - self.bits
            if not spare:
                return values
            fitted: AnyArray = np.right_shift(np.left_shift(values, spare), spare)
            return fitted
        if self.name == 'REAL':
            full = FLOAT32_MANTISSA if values.dtype == np.float32 else FLOAT64_MANTISSA
            return values if self.mantissa >= full else _round(values, full - self.mantissa)
        return values

    def convert(self, values: AnyArray) -> AnyArray:
        """Values of any numeric type as this kind.

        Parameters
        ----------
        values : array

        Returns
        -------
        array of ``dtype`` and the same shape
            To INTEGER, reals are truncated toward zero and wrap; not-a-number becomes 0.
        """
        source = np.asarray(values)
        if source.dtype == self.dtype:
            return self.fit(source)
        if self.name == 'INTEGER' and source.dtype.kind == 'f':
            low, high = (float(source.min()), float(source.max())) if source.size else (0.0, 0.0)
            if low > -(2.0**31) and high < 2.0**31:  # false for NaN
                return self.fit(source.astype(np.int32).astype(self.dtype, copy=False))
            most = LARGEST_CONVERTED
            whole = np.nan_to_num(np.trunc(source), nan=0.0, posinf=most, neginf=-most)
            return self.fit(np.clip(whole, -most, most).astype(np.int64).astype(self.dtype))
        with np.errstate(over='ignore', invalid='ignore'):
            return self.fit(source.astype(self.dtype))

    def scalar(self, value: bool | int | float) -> bool | int | float:
        """One value as this kind: a plain Python number that the word can hold."""
        if self.name == 'LOGICAL':
            return bool(value)
        if self.name == 'INTEGER':
            if isinstance(value, float):
                value = int(value) if abs(value) < 2.0**63 else 0
            low, high = self.range
            value = int(value)
            return value if low <= value <= high else (value - low) % (1 << self.bits) + low
        if self.bits == 64:
            return float(value)
        with np.errstate(over='ignore'):
            if self.bits == 32:
                return float(np.float32(value))
            return float(self.fit(np.asarray([value], dtype=self.dtype))[0])


LOGICAL = Kind('LOGICAL', 1)
CHARACTER = Kind('CHARACTER', 8)


@cache
def integer(length: int = 4) -> Kind:
    """INTEGER of this many bytes, 1 to 8; ValueError otherwise."""
    if length not in range(1, 9):
        raise ValueError(f'INTEGER*{length}: the word length is 1 to 8 bytes')
    return Kind('INTEGER', 8 * length)


@cache
def real(length: int = 4) -> Kind:
    """REAL of this many bytes, 3 to 8; ValueError otherwise."""
    if length not in range(3, 9):
        raise ValueError(f'REAL*{length}: the word length is 3 to 8 bytes')
    return Kind('REAL', 8 * length)


def bits(count: int, signed: bool = False) -> Kind:
    """An integer of any number of bit-planes, 1 to 64, as in assembly (APAL); ValueError otherwise."""
    if not 1 <= count <= 64:
        raise ValueError(f'bits: expected 1 to 64 planes, got {count}')
    return Kind('INTEGER', count, signed)


def parse_kind(text: str | Kind) -> Kind:
    """Read the name of a kind.

    Parameters
    ----------
    text : str or Kind
        'LOGICAL', 'INTEGER', 'INTEGER*2', 'REAL*4', ...; a Kind is returned as it is.

    Returns
    -------
    Kind

    Raises
    ------
    ValueError
        Naming the text.

    Examples
    --------
    >>> parse_kind('integer*2')
    Kind(name='INTEGER', bits=16, signed=True)
    """
    if isinstance(text, Kind):
        return text
    found = re.fullmatch(r'\s*(LOGICAL|INTEGER|REAL)\s*(?:\*\s*(\d+))?\s*', str(text), re.IGNORECASE)
    if not found or (found[1].upper() == 'LOGICAL' and found[2]):
        raise ValueError(f'kind: expected LOGICAL, INTEGER*1..8 or REAL*3..8, got {text!r}')
    name, length = found[1].upper(), int(found[2] or 4)
    return LOGICAL if name == 'LOGICAL' else integer(length) if name == 'INTEGER' else real(length)


def kind_of(values: AnyArray, plain: bool = False) -> Kind:
    """The kind that holds the values of a numpy array.

    Parameters
    ----------
    values : array of truths, integers or reals
    plain : bool
        The values come from a Python list, which has no word length: numbers take the default of 4 bytes.

    Returns
    -------
    Kind

    Raises
    ------
    ValueError
        For other types.
    """
    dtype = values.dtype
    if dtype.kind == 'b':
        return LOGICAL
    if dtype.kind == 'i':
        return integer(4 if plain else dtype.itemsize)
    if dtype.kind == 'u':
        return integer(min(8, 2 * dtype.itemsize))
    if dtype.kind == 'f':
        return real(4 if plain or dtype.itemsize <= 4 else 8)
    raise ValueError(f'array: expected logical, integer or real numbers, got dtype {dtype}')


@cache
def common_kind(a: Kind, b: Kind) -> Kind:
    """The kind of a result of two operands: REAL wins over INTEGER, then the longer word."""
    if a == b:
        return a
    if a.name != b.name:
        return a if a.name == 'REAL' else b
    if a.signed == b.signed:
        return a if a.bits >= b.bits else b
    signed, unsigned = (a, b) if a.signed else (b, a)
    return bits(min(64, max(signed.bits, unsigned.bits + 1)), signed=True)


@cache
def _dtype(kind: Kind) -> np.dtype[Any]:
    """The smallest numpy type that holds every value of a kind."""
    if kind.name == 'LOGICAL':
        return np.dtype(bool)
    if kind.name == 'REAL':
        return np.dtype(np.float32 if kind.mantissa <= FLOAT32_MANTISSA else np.float64)
    if kind.name == 'INTEGER':
        size = next(size for size in (1, 2, 4, 8) if 8 * size >= kind.bits)
        return np.dtype(f'{"i" if kind.signed else "u"}{size}')
    return np.dtype(object)


def _round(values: AnyArray, drop: int) -> AnyArray:
    """Round a float's significand to nearest, ties to even, dropping this many bits."""
    unsigned: Any = np.uint32 if values.dtype == np.float32 else np.uint64
    pattern = np.ascontiguousarray(values).view(unsigned)
    one = unsigned(1)
    half = unsigned((1 << (drop - 1)) - 1) + ((pattern >> unsigned(drop)) & one)
    rounded = (pattern + half) & ~unsigned((1 << drop) - 1)
    return np.where(np.isfinite(values), rounded.view(values.dtype), values)
