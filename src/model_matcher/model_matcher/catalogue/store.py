"""The file of an index: a header with checksums, and arrays that are mapped into memory rather than read.

The file is written under another name and renamed when it is whole, so that who reads it has the old one or the new
one. A file that is cut off or of another version is refused when it is opened, a damaged array when it is compared with
its checksum.

    8 bytes   MAGIC
    4 + 4     version, and length of the header (unsigned, little-endian)
    4         CRC-32 of the header
    header    JSON: facts, and dtype, shape, place and CRC-32 of each array
    arrays    each at a multiple of ALIGNMENT
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from msgs_py.numeric.typed import AnyArray

from .settings import ALIGNMENT, MAGIC, VERSION

_HEAD = struct.Struct('<8sIII')
_PENDING = '00000000'
# Element types that an index has.
_DTYPES = ('|u1', '<u2', '<u4', '<i8', '<f4', '<f8')


@contextmanager
def writing(
    path: Path, facts: Mapping[str, Any], shapes: Mapping[str, tuple[str, tuple[int, ...]]]
) -> Iterator[dict[str, AnyArray]]:
    """Write a file; it takes the place of an older one when the block ends without an error.

    Parameters
    ----------
    path : Path
    facts : mapping
        What JSON holds.
    shapes : mapping
        Type and shape of each array, by name.

    Yields
    ------
    dict of str to array
        To be filled, mapped into the new file.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    table: dict[str, Any] = {}
    place = 0
    for name, (dtype, shape) in shapes.items():
        table[name] = {'dtype': dtype, 'shape': list(shape), 'at': place, 'crc': _PENDING}
        place += _aligned(int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize)
    header = _header(facts, table)
    begin = _aligned(_HEAD.size + len(header))
    part = path.with_name(f'{path.name}.{os.getpid()}.part')
    try:
        with open(part, 'wb') as file:
            file.truncate(begin + place)
        arrays = {name: _mapped(part, 'r+', begin, record) for name, record in table.items()}
        yield arrays
        for name, array in arrays.items():
            table[name]['crc'] = f'{_checksum(array):08x}'
            if isinstance(array.base, np.memmap):
                array.base.flush()
        header = _header(facts, table)
        with open(part, 'r+b') as file:
            file.write(_HEAD.pack(MAGIC, VERSION, len(header), zlib.crc32(header)) + header)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


class File(NamedTuple):
    """What a file holds.

    Attributes
    ----------
    facts : dict
    arrays : dict of str to array
        Mapped into memory; what is written to them stays in this process.
    checksums : dict of str to str
        CRC-32 of each array.
    """

    facts: dict[str, Any]
    arrays: dict[str, AnyArray]
    checksums: dict[str, str]

    def check(self) -> None:
        """Compare all checksums, which reads the arrays once. Raises ValueError, which names an array."""
        for name, array in self.arrays.items():
            if f'{_checksum(array):08x}' != self.checksums[name]:
                raise ValueError(f'damaged: array {name} does not have its checksum')


def read(path: Path) -> File:
    """Open a file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    File
        Nothing of its arrays has been looked at.

    Raises
    ------
    OSError
        There is no such file.
    ValueError
        It is no index, of another version, cut off, or its header is damaged; the message begins with its name.
    """
    try:
        size = path.stat().st_size
        with open(path, 'rb') as file:
            magic, version, length, crc = _HEAD.unpack(file.read(_HEAD.size))
            if magic != MAGIC:
                raise ValueError('not an index of models')
            if version != VERSION:
                raise ValueError(f'an index of version {version}, expected {VERSION}: make it again with index_models')
            header = file.read(min(length, size))
        if zlib.crc32(header) != crc:
            raise ValueError('damaged: the header does not have its checksum')
        record = json.loads(header)
        begin = _aligned(_HEAD.size + length)
        arrays = {}
        for name, one in record['arrays'].items():
            if one['dtype'] not in _DTYPES or begin + one['at'] + _bytes(one) > size:
                raise ValueError(f'damaged: array {name} does not fit into {size} bytes')
            arrays[name] = _mapped(path, 'c', begin, one)
        checksums = {name: str(one['crc']) for name, one in record['arrays'].items()}
    except (struct.error, KeyError, TypeError, UnicodeDecodeError) as error:
        raise ValueError(f'{path}: not an index of models, or cut off: {error}') from None
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None
    return File(record['facts'], arrays, checksums)


def is_index(path: str | Path) -> bool:
    """Whether a path names an index, by the first bytes of its file."""
    try:
        with open(Path(path).expanduser(), 'rb') as file:
            return file.read(len(MAGIC)) == MAGIC
    except (OSError, ValueError):
        return False


def _header(facts: Mapping[str, Any], table: Mapping[str, Any]) -> bytes:
    return json.dumps({'facts': facts, 'arrays': table}).encode()


def _aligned(size: int) -> int:
    return -(-size // ALIGNMENT) * ALIGNMENT


def _bytes(record: Mapping[str, Any]) -> int:
    count = 1
    for extent in record['shape']:
        count *= int(extent)
    return count * int(np.dtype(record['dtype']).itemsize)


def _mapped(path: Path, mode: Any, begin: int, record: Mapping[str, Any]) -> AnyArray:
    """An array of a file; empty ones cannot be mapped."""
    shape, dtype = tuple(record['shape']), np.dtype(record['dtype'])
    if _bytes(record) == 0:
        return np.zeros(shape, dtype)
    return np.memmap(path, dtype, mode, begin + record['at'], shape).view(np.ndarray)


def _checksum(array: AnyArray) -> int:
    """CRC-32 of an array's bytes."""
    return zlib.crc32(array.reshape(-1).view(np.uint8).data)
