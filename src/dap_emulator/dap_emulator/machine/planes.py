"""Packed bit-planes: one bit of every element, 64 elements to a word.

Logical work on 64 PEs is then one instruction of this computer (thesis 3.2.3: bit b of every element lies in plane b).
Arithmetic on planes stands in ``dap_emulator.bit_planes``.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import AnyArray, BoolArray, WordArray

from .kinds import Kind

WORD_BITS = 64


def words_for(count: int) -> int:
    """64-bit words that hold one bit of each of count elements."""
    return -(-count // WORD_BITS)


def pack(flags: BoolArray) -> WordArray:
    """(..., count) bool to (..., words) uint64; unused bits are 0.

    Examples
    --------
    >>> import numpy as np
    >>> pack(np.array([True, False, True])).tolist()
    [5]
    """
    count = flags.shape[-1]
    packed = np.packbits(flags, axis=-1, bitorder='little')  # numpy packs eight to a byte
    size = 8 * words_for(count)
    if packed.shape[-1] != size:
        padded = np.zeros(packed.shape[:-1] + (size,), dtype=np.uint8)
        padded[..., : packed.shape[-1]] = packed
        packed = padded
    return packed.view(np.uint64)


def unpack(words: WordArray, count: int) -> BoolArray:
    """(..., words) uint64 to (..., count) bool."""
    return np.unpackbits(words.view(np.uint8), axis=-1, count=count, bitorder='little').view(bool)


def ones(count: int) -> WordArray:
    """(words,) uint64: a plane that is 1 for every element and 0 in the unused bits."""
    words = np.full(words_for(count), ~np.uint64(0))
    if count % WORD_BITS:
        words[-1] = np.uint64((1 << (count % WORD_BITS)) - 1)
    return words


def invert(words: WordArray, count: int) -> WordArray:
    """(words,) plane: NOT; the unused bits stay 0."""
    out = ~words
    if count % WORD_BITS:
        out[-1] &= np.uint64((1 << (count % WORD_BITS)) - 1)
    return out


def count_true(words: WordArray) -> int:
    """Number of ones in packed words."""
    if hasattr(np, 'bitwise_count'):
        return int(np.bitwise_count(words).sum())
    return int(np.unpackbits(words.view(np.uint8)).sum())


def to_planes(values: AnyArray, kind: Kind) -> WordArray:
    """Integers of any shape to (bits, words) uint64, plane 0 the least significant."""
    flat = np.ascontiguousarray(values).reshape(-1)
    flat = flat.astype(np.int64) if flat.dtype != np.uint64 else flat
    one = flat.dtype.type(1)
    return pack(np.stack([(flat >> flat.dtype.type(bit)) & one for bit in range(kind.bits)]).astype(bool))
