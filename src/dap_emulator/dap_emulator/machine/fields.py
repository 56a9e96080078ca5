"""Values of this computer to fields of bit-planes and back.

A cell is one element's word as this computer holds it: a truth, an integer, or the bit pattern of a REAL in the
machine's own form (``bit_planes.reals``), which no float of this computer holds in every length.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from msgs_py.numeric.typed import AnyArray, FloatArray, WordArray

from ..bit_planes.processors import Field
from ..bit_planes.reals import BIAS, DIGIT, EXPONENT_PLANES, Format
from .kinds import Kind


def to_field(cells: AnyArray, planes: int) -> Field:
    """Cells of any shape as planes, elements in row order.

    Parameters
    ----------
    cells : bool, integer or uint64 array
    planes : int
        Planes of the word: lowest bits of the cells.

    Returns
    -------
    list of int
        The least significant plane first; bit e of each belongs to element e.

    Examples
    --------
    >>> to_field(np.array([1, 2, 3], dtype=np.int8), 2)
    [5, 6]
    """
    flat = np.ascontiguousarray(cells).reshape(-1)
    octets = flat.view(np.uint8).reshape(flat.size, flat.dtype.itemsize)
    bits = np.unpackbits(octets, axis=1, bitorder='little', count=planes)
    rows = np.packbits(bits.T, axis=1, bitorder='little')
    return [int.from_bytes(row.tobytes(), 'little') for row in rows]


def from_field(field: Field, kind: Kind, shape: tuple[int, ...]) -> AnyArray:
    """Planes as cells of this shape: truths, integers, or patterns (uint64) of REALs. The inverse of ``to_field``."""
    count = int(np.prod(shape))
    octets = -(-count // 8)
    rows = np.frombuffer(b''.join(plane.to_bytes(octets, 'little') for plane in field), dtype=np.uint8)
    bits = np.unpackbits(rows.reshape(len(field), octets), axis=1, bitorder='little', count=count)
    if kind.name == 'LOGICAL':
        flags: AnyArray = bits[0].astype(bool)
        return flags.reshape(shape)
    dtype = cell_type(kind, in_bits=True)
    wanted = 8 * dtype.itemsize
    if len(field) < wanted:
        top = bits[-1:] if kind.name == 'INTEGER' and kind.signed else np.zeros_like(bits[-1:])
        bits = np.concatenate([bits, np.repeat(top, wanted - len(field), axis=0)])
    packed = np.packbits(bits.T, axis=1, bitorder='little')
    cells: AnyArray = np.ascontiguousarray(packed).view(dtype)
    return cells.reshape(shape)


def cell_type(kind: Kind, in_bits: bool) -> np.dtype[Any]:
    """The numpy type of cells: on a machine that computes in words they are values."""
    return np.dtype(np.uint64) if in_bits and kind.name == 'REAL' else kind.dtype


def form_of(kind: Kind, nearest: bool) -> Format:
    """The machine's form of a REAL."""
    return Format(kind.bits, nearest)


def real_cells(values: Any, form: Format) -> WordArray:
    """Floats as patterns of the machine's REALs.

    Parameters
    ----------
    values : array of floats
        Infinity becomes the largest number.
    form : Format

    Returns
    -------
    uint64 array of the same shape

    Raises
    ------
    ValueError
        For not-a-number, which the machine's form does not have.

    Examples
    --------
    >>> [hex(x) for x in real_cells(np.array([1.0, -118.625, 0.0]), Format(32))]
    ['0x41100000', '0xc276a000', '0x0']
    """
    x = np.asarray(values, dtype=np.float64)
    if np.isnan(x).any():
        raise ValueError(f'REAL*{form.planes // 8} on bit-planes: not-a-number is no number of the machine')
    m = form.fraction
    infinite = np.isinf(x)
    size, binary = np.frexp(np.where(infinite, 0.0, np.abs(x)))
    power = -(-binary // DIGIT)
    scaled = np.ldexp(size, m + binary - DIGIT * power)
    whole = np.floor(scaled)
    fraction = whole.astype(np.uint64)
    if form.nearest:
        fraction = fraction + (scaled - whole >= 0.5).astype(np.uint64)
    over = fraction == np.uint64(1 << m)
    fraction = np.where(over, np.uint64(1 << (m - DIGIT)), fraction)
    exponent = power + over + BIAS
    word = (np.maximum(exponent, 0).astype(np.uint64) << np.uint64(m)) | fraction
    word = np.where(infinite | (exponent >= 1 << EXPONENT_PLANES), np.uint64(form.largest), word)
    word = word | ((x < 0).astype(np.uint64) << np.uint64(form.planes - 1))
    result: WordArray = np.where(((x == 0) | (exponent < 0)) & ~infinite, np.uint64(0), word)
    return result


def real_values(cells: WordArray, kind: Kind) -> AnyArray:
    """Patterns of the machine's REALs as floats of ``kind.dtype``; the largest number is what overflows: infinity.

    REAL*8 has up to 56 bits of significand, of which a float keeps 53; REAL*3 and *4 reach further than a float32.

    Examples
    --------
    >>> from .kinds import real
    >>> real_values(np.array([0x41100000, 0xC276A000, 0x7FFFFFFF], dtype=np.uint64), real(4)).tolist()
    [1.0, -118.625, inf]
    """
    form = Format(kind.bits)
    m = form.fraction
    fraction = (cells & np.uint64((1 << m) - 1)).astype(np.float64)
    exponent = ((cells >> np.uint64(m)) & np.uint64((1 << EXPONENT_PLANES) - 1)).astype(np.int64)
    size: FloatArray = np.ldexp(fraction, DIGIT * (exponent - BIAS) - m)
    size = np.where(cells & np.uint64(form.largest) == np.uint64(form.largest), np.inf, size)
    negative = (cells >> np.uint64(form.planes - 1)).astype(bool)
    with np.errstate(over='ignore'):
        return np.where(negative, -size, size).astype(kind.dtype)
