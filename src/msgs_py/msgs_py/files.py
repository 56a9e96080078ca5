"""Files of others: how large they are is looked at before they are read.

A few bytes may unpack to gigabytes, and a header may promise what is not there: an archive or a picture says its size
before any of it is unpacked, and what is too large is refused by name.
"""

from __future__ import annotations

import io
import json
import stat
import struct
import sys
import zipfile
from pathlib import Path
from typing import IO, Any

import numpy as np

from .numeric.typed import AnyArray
from .settings import LARGEST_FILE, LARGEST_IMAGE, LARGEST_TEXT

# Of a JPEG: markers of frames (their size follows), and those that stand without a length.
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_ALONE = frozenset({0x01, *range(0xD0, 0xD9)})
# Channels of a PNG by its colour type; and the most bytes that deflate makes of one (RFC 1951).
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
_DEFLATE = 1032
# Bytes of a PNG's chunk besides its data: length, name and checksum.
_CHUNK = 12
# Of a TIFF: type of an entry's value to its struct code, and the tags of width and height.
_TIFF_TYPES = {3: 'H', 4: 'I'}
_TIFF_SIZE = {256: 0, 257: 1}


class _Promises(Exception):
    """A header promises what is not there."""


def check_file(path: str | Path, most: int = LARGEST_FILE) -> Path:
    """Refuse what is no file, or too large to be read.

    Parameters
    ----------
    path : str or Path
    most : int
        Bytes.

    Returns
    -------
    Path
        The same.

    Raises
    ------
    OSError
        There is no such file.
    ValueError
        It is no ordinary file, or larger than that; the message begins with its name.
    """
    path = Path(path)
    try:
        found = path.stat()
    except FileNotFoundError:
        raise FileNotFoundError(f'{path}: no such file') from None
    if not stat.S_ISREG(found.st_mode):
        raise ValueError(f'{path}: not an ordinary file')
    if found.st_size > most:
        raise ValueError(f'{path}: {found.st_size} bytes, at most {most} are read')
    return path


def read_text(path: str | Path, errors: str = 'strict') -> str:
    """The text of a file, UTF-8, no larger than texts are; raises as :func:`check_file`."""
    return check_file(path, LARGEST_TEXT).read_text(encoding='utf-8', errors=errors)


def read_json(path: str | Path) -> Any:
    """What a JSON file says.

    Raises
    ------
    OSError
        There is no such file.
    ValueError
        It is too large, no JSON, nested too deeply, or has an integer beyond all floating point numbers.
    """
    try:
        return json.loads(read_text(path), parse_int=_integer)
    except RecursionError:
        raise ValueError('brackets within brackets, too many to be read') from None


def _integer(digits: str) -> int:
    """An integer of JSON."""
    value = int(digits)
    if abs(value) > sys.float_info.max:
        raise ValueError(f'an integer of {len(digits)} characters, beyond all floating point numbers')
    return value


def load_arrays(path: str | Path) -> dict[str, AnyArray]:
    """The arrays of a .npz archive, whose sizes are known before they are unpacked.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict of str to array

    Raises
    ------
    OSError
        There is no such file.
    ValueError
        It is no archive of arrays, or would unpack to more than LARGEST_FILE bytes; begins with its name.
    """
    check_file(path)
    try:
        with zipfile.ZipFile(path) as archive:
            total = sum(member.file_size for member in archive.infolist())
            if total > LARGEST_FILE:
                raise ValueError(f'it unpacks to {total} bytes, at most {LARGEST_FILE} are read')
            for member in archive.infolist():
                with archive.open(member) as file:
                    _check_array(file, member.file_size)
        with np.load(path, allow_pickle=False) as arrays:
            return dict(arrays)
    except OSError:
        raise
    except Exception as error:  # zipfile and numpy raise half a dozen types for a damaged archive
        raise ValueError(f'{path}: not an archive of arrays: {error}') from error


def load_array(path: str | Path) -> AnyArray:
    """The array of a .npy file; raises as :func:`load_arrays`."""
    check_file(path)
    try:
        with open(path, 'rb') as file:
            _check_array(file, Path(path).stat().st_size)
        return np.asarray(np.load(path, allow_pickle=False))
    except OSError:
        raise
    except Exception as error:
        raise ValueError(f'{path}: not a .npy file: {error}') from error


def _check_array(file: IO[bytes], size: int) -> None:
    """Refuse an array whose header promises more than its size, bytes; numpy would make room for it first."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    promised = dtype.itemsize
    for extent in shape:
        promised *= int(extent)
    if promised > size:
        raise ValueError(f'an array of shape {shape} does not fit into {size} bytes')


def check_image(path: str | Path) -> Path:
    """Refuse a picture that is too large to be unpacked.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Path
        The same. Of PNG, JPEG, BMP, TIFF and PGM files the number of pixels is known; of others the size of the file.

    Raises
    ------
    OSError, ValueError
        As :func:`check_file`, and for more than LARGEST_IMAGE pixels.
    """
    path = check_file(path)
    with path.open('rb') as file:
        try:
            size = _picture_size(file)
        except (struct.error, ValueError, IndexError):
            size = None  # damaged: the decoder has words for it
        except _Promises as error:
            raise ValueError(f'{path}: {error}') from None
    if size is not None and size[0] * size[1] > LARGEST_IMAGE:
        raise ValueError(f'{path}: {size[0]} x {size[1]} pixels, at most {LARGEST_IMAGE} are read')
    return path


def check_packed_picture(data: bytes) -> None:
    """Refuse a packed picture that is too large to be unpacked, or of no known format.

    Parameters
    ----------
    data : bytes
        Of a PNG, JPEG, BMP, TIFF or PGM.

    Raises
    ------
    ValueError
        Says what is wrong with it.
    """
    if not data:
        raise ValueError('empty, expected a JPEG or PNG')
    try:
        size = _picture_size(io.BytesIO(data))
    except (struct.error, ValueError, IndexError):
        raise ValueError(f'{len(data)} bytes without the header of a picture; truncated?') from None
    except _Promises as error:
        raise ValueError(str(error)) from None
    # A decoder fills up with grey what is missing, and that would have edges. No scan has these bytes inside.
    if data.startswith(b'\xff\xd8') and data.rfind(b'\xff\xd9') < data.rfind(b'\xff\xda'):
        raise ValueError(f'{len(data)} bytes of a JPEG without its end; truncated?')
    if size is None:
        raise ValueError(f'{len(data)} bytes that are neither JPEG nor PNG')
    if size[0] * size[1] > LARGEST_IMAGE:
        raise ValueError(f'{size[0]} x {size[1]} pixels, at most {LARGEST_IMAGE} are unpacked')


def _picture_size(file: IO[bytes]) -> tuple[int, int] | None:
    """Width and height in the header of a picture; None for a format that is not known here."""
    head = file.read(32)
    if head.startswith(b'\x89PNG\r\n\x1a\n'):
        width, height, depth, kind = struct.unpack('>IIBB', head[16:26])
        _check_packed(file, width * height * depth * _PNG_CHANNELS.get(kind, 1) // 8)
        return width, height
    if head.startswith(b'\xff\xd8'):
        return _jpeg_size(file)
    if head.startswith(b'BM'):
        width, height = struct.unpack('<ii', head[18:26])
        return abs(width), abs(height)
    if head[:4] in (b'II*\0', b'MM\0*'):
        return _tiff_size(file, '<' if head.startswith(b'II') else '>')
    if head[:2] in (b'P1', b'P2', b'P3', b'P4', b'P5', b'P6'):
        return _pnm_size(file)
    return None


def _check_packed(file: IO[bytes], size: int) -> None:
    """Refuse a PNG that unpacks to more bytes than its file can hold, or with a chunk that goes on beyond its end."""
    there = file.seek(0, 2)
    if size > _DEFLATE * there:
        raise _Promises(f'a picture of {size} bytes does not fit into a file of {there}')
    at = file.seek(8)
    while there - at >= _CHUNK:
        (length,) = struct.unpack('>I', file.read(4))
        if length > there - at - _CHUNK:
            raise _Promises(f'a chunk of {length} bytes does not fit into the {there - at} that are left')
        at = file.seek(length + _CHUNK - 4, 1)


def _jpeg_size(file: IO[bytes]) -> tuple[int, int] | None:
    file.seek(2)
    while True:
        lead, marker = struct.unpack('BB', file.read(2))
        if lead != 0xFF:
            return None
        if marker == 0xFF:  # filling
            file.seek(-1, 1)
        elif marker not in _JPEG_ALONE:
            (length,) = struct.unpack('>H', file.read(2))
            if marker in _JPEG_FRAMES:
                height, width = struct.unpack('>xHH', file.read(5))
                return width, height
            file.seek(max(length - 2, 0), 1)


def _tiff_size(file: IO[bytes], order: str) -> tuple[int, int] | None:
    file.seek(4)
    file.seek(struct.unpack(order + 'I', file.read(4))[0])
    size = [0, 0]
    for _ in range(struct.unpack(order + 'H', file.read(2))[0]):
        tag, kind, _count = struct.unpack(order + 'HHI', file.read(8))
        value = file.read(4)
        if tag in _TIFF_SIZE and kind in _TIFF_TYPES:
            size[_TIFF_SIZE[tag]] = struct.unpack_from(order + _TIFF_TYPES[kind], value)[0]
    return size[0], size[1]


def _pnm_size(file: IO[bytes]) -> tuple[int, int] | None:
    file.seek(2)
    words = b' '.join(line.split(b'#')[0] for line in file.read(4096).splitlines()).split()
    return int(words[0]), int(words[1])
