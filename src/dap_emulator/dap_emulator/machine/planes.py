"""Packed bit-planes, and arithmetic done plane by plane the way one-bit PEs do it.

A plane holds one bit of every element, 64 elements to a word. Logical work on 64 PEs is then one machine instruction,
and numbers can be added by rippling a carry plane upwards (thesis 3.2.3: bit b of every element lies in plane b).
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


def from_planes(planes: WordArray, kind: Kind, shape: tuple[int, ...]) -> AnyArray:
    """(bits, words) uint64 to integers of this shape: the inverse of to_planes."""
    flags = unpack(planes, int(np.prod(shape)))
    total = np.zeros(flags.shape[1], dtype=np.uint64)
    for bit in range(kind.bits):
        total |= flags[bit].astype(np.uint64) << np.uint64(bit)
    if kind.signed and kind.bits < WORD_BITS:
        total |= np.where(flags[kind.bits - 1], ~np.uint64((1 << kind.bits) - 1), np.uint64(0))
    return total.astype(kind.dtype if not kind.signed else np.int64).astype(kind.dtype).reshape(shape)


def add(a: WordArray, b: WordArray, carry: WordArray) -> WordArray:
    """The sum a + b + carry modulo the word length, by rippling the carry: two loads and a store for every plane."""
    out = np.empty_like(a)
    for bit in range(len(a)):
        either = a[bit] ^ b[bit]
        out[bit] = either ^ carry
        carry = (a[bit] & b[bit]) | (carry & either)
    return out


def subtract(a: WordArray, b: WordArray, all_ones: WordArray) -> WordArray:
    """The difference a - b: add the complement and one."""
    return add(a, ~b & all_ones, all_ones)


def multiply(a: WordArray, b: WordArray) -> WordArray:
    """The product a * b modulo the word length: add a, shifted up, where b's bit is set."""
    out = np.zeros_like(a)
    none = np.zeros_like(a[0])
    for bit in range(len(b)):
        out[bit:] = add(out[bit:], a[: len(a) - bit] & b[bit], none)
    return out


def less(a: WordArray, b: WordArray, signed: bool) -> WordArray:
    """(words,) plane: a < b. The highest differing bit decides; a sign bit decides the other way round."""
    result: WordArray = np.zeros_like(a[0])
    for bit in range(len(a)):
        differ = a[bit] ^ b[bit]
        winner = a[bit] if signed and bit == len(a) - 1 else b[bit]
        result = (winner & differ) | (result & ~differ)
    return result


def equal(a: WordArray, b: WordArray, all_ones: WordArray) -> WordArray:
    """(words,) plane: a == b."""
    result: WordArray = all_ones.copy()
    for bit in range(len(a)):
        result &= ~(a[bit] ^ b[bit])
    return result
