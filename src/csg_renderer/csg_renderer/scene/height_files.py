"""Grids of heights from files: numpy arrays (.npy), 16-bit grey pictures (.png) and ESRI ASCII grids (.asc).

Row 0 of what is read lies at y = 0, so that a map is the right way round when it is looked at from above (z towards the
viewer, x to the right): a picture's last row and a map's southernmost row come first. An array's rows stay as they are.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np

from msgs_py.files import check_image
from msgs_py.numeric.typed import FloatArray

from .settings import ASC_HEADER_LINES, MAX_ASC_BYTES_PER_HEIGHT, MAX_HEIGHTS, PNG_FULL_SCALE

HEIGHT_SUFFIXES = ('.npy', '.png', '.asc')
# What of an .asc header must be there; the other words may be left out.
_NEEDED = ('ncols', 'nrows', 'cellsize')
_KNOWN = (*_NEEDED, 'xllcorner', 'yllcorner', 'xllcenter', 'yllcenter', 'nodata_value')
# Each word of a header with its value and the line it stands on.
_Header: TypeAlias = dict[str, tuple[float, int]]


@dataclass(frozen=True, eq=False)
class HeightGrid:
    """What a file of heights holds.

    Attributes
    ----------
    heights : (rows, columns) float64
        Row 0 at y = 0; a picture's run from 0 to 1, others are what the file says; NaN where it has none.
    cell : float or None
        Side of a cell, in the file's unit; None when the file does not say.
    """

    heights: np.ndarray
    cell: float | None = None


def read_heights(path: Path) -> HeightGrid:
    """Read a grid of heights.

    Parameters
    ----------
    path : Path
        A .npy file of numbers, a grey 16-bit .png, or an ESRI ASCII grid (.asc).

    Returns
    -------
    HeightGrid

    Raises
    ------
    FileNotFoundError
        There is no such file.
    ValueError
        It holds no grid of heights; the message begins with its name, and for an .asc file says line and column.
    """
    if not path.is_file():
        raise FileNotFoundError(f'no height grid {str(path)!r}')
    readers = {'.npy': _read_array, '.png': _read_picture, '.asc': _read_ascii}
    reader = readers.get(path.suffix.lower())
    try:
        if reader is None:
            raise ValueError(f'expected a file of heights ({", ".join(HEIGHT_SUFFIXES)})')
        grid = reader(path)
        check_heights(grid.heights)
    except (ValueError, OSError) as error:
        raise ValueError(f'{path}: {str(error).removeprefix(f"{path}: ")}') from None
    return grid


def check_heights(heights: np.ndarray) -> None:
    """Refuse what is no grid of heights.

    Parameters
    ----------
    heights : array of float64

    Raises
    ------
    ValueError
        It is no grid, has an infinite height, or no cell all of whose corners have a height; begins with "heights".
    """
    if heights.ndim != 2 or min(heights.shape) < 2 or np.isinf(heights).any():
        raise ValueError(f'heights: expected a grid of at least 2 x 2 finite numbers, got shape {heights.shape}')
    there = ~np.isnan(heights)
    if not (there[:-1, :-1] & there[:-1, 1:] & there[1:, :-1] & there[1:, 1:]).any():
        raise ValueError('heights: no cell has a height at all four corners')


def _checked_size(rows: int, columns: int) -> None:
    if rows * columns > MAX_HEIGHTS:
        raise ValueError(f'{rows} x {columns} heights, at most {MAX_HEIGHTS} are read')


def _read_array(path: Path) -> HeightGrid:
    try:
        # Mapped, so that a shape beyond all bounds is seen before any memory is taken.
        mapped = np.load(path, mmap_mode='r', allow_pickle=False)
    except Exception as error:  # the reader raises whatever a damaged header provokes
        raise ValueError(f'not a .npy file: {error}') from None
    if mapped.ndim != 2 or mapped.dtype.kind not in 'fiu':
        raise ValueError(f'expected a two-dimensional array of numbers, got {mapped.dtype} of shape {mapped.shape}')
    _checked_size(*mapped.shape)
    return HeightGrid(np.array(mapped, dtype=np.float64))


def _read_picture(path: Path) -> HeightGrid:
    with path.open('rb') as file:
        head = file.read(26)
    columns, rows = (int.from_bytes(head[k : k + 4], 'big') for k in (16, 20))
    # The size stands in the first bytes; a small file may unpack to a picture of gigabytes.
    if head[:8] != b'\x89PNG\r\n\x1a\n' or head[24:26] != b'\x10\x00':
        raise ValueError('expected a 16-bit grey PNG')
    _checked_size(rows, columns)
    pixels = cv2.imread(str(check_image(path)), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.ndim != 2 or pixels.dtype != np.uint16:
        raise ValueError('not a whole 16-bit grey PNG')
    return HeightGrid(np.ascontiguousarray(pixels[::-1]) / PNG_FULL_SCALE)


def _read_ascii(path: Path) -> HeightGrid:
    size = path.stat().st_size
    if size > MAX_HEIGHTS * MAX_ASC_BYTES_PER_HEIGHT:
        raise ValueError(f'{size} bytes, at most {MAX_HEIGHTS * MAX_ASC_BYTES_PER_HEIGHT} are read')
    try:
        text = path.read_text(encoding='ascii')
    except UnicodeDecodeError as error:
        raise ValueError(f'not an ASCII grid: byte {error.start} is no ASCII character') from None
    header, begin, line = _read_header(text)
    columns, rows = (_whole(header, word) for word in ('ncols', 'nrows'))
    _checked_size(rows, columns)
    cell, at = header['cellsize']
    if not 0.0 < cell < np.inf:
        raise ValueError(f'line {at}: expected a cellsize > 0, got {cell:g}')
    heights = _numbers(text[begin:], line)
    if heights.size != rows * columns:
        raise ValueError(f'expected {rows} rows of {columns} heights, found {heights.size} heights')
    if 'nodata_value' in header:
        heights = np.where(heights == header['nodata_value'][0], np.nan, heights)
    return HeightGrid(np.ascontiguousarray(heights.reshape(rows, columns)[::-1]), cell)


def _read_header(text: str) -> tuple[_Header, int, int]:
    """The words of a header, and where the heights begin: index into the text, and line."""
    header: _Header = {}
    begin = lines = 0
    for number, line in enumerate(text.split('\n', ASC_HEADER_LINES)[:ASC_HEADER_LINES], start=1):
        parts = line.split()
        if not parts or not parts[0][0].isalpha() or parts[0].lower() == 'nan':
            break
        word = parts[0].lower()
        if word not in _KNOWN:
            raise ValueError(f'line {number}, column {line.index(parts[0]) + 1}: unknown word {parts[0]!r}')
        try:
            (value,) = parts[1:]
            header[word] = float(value), number
        except ValueError:
            raise ValueError(f'line {number}: expected a number after {parts[0]}') from None
        begin, lines = begin + len(line) + 1, number
    for word in _NEEDED:
        if word not in header:
            raise ValueError(f'line 1: not an ESRI ASCII grid, its header has no {word}')
    return header, begin, lines + 1


def _whole(header: _Header, word: str) -> int:
    value, line = header[word]
    if value != np.floor(value) or not 2 <= value <= MAX_HEIGHTS:
        raise ValueError(f'line {line}: expected a whole number >= 2 after {word}, got {value:g}')
    return int(value)


def _numbers(text: str, line: int) -> FloatArray:
    """The numbers of a text that begins on this line of its file; names the place of what is none."""
    with warnings.catch_warnings():
        # numpy stops at what is no number; it warns or raises, depending on its version.
        warnings.simplefilter('ignore', DeprecationWarning)
        try:
            values = np.fromstring(text, dtype=np.float64, sep=' ')
        except ValueError:
            values = np.zeros(0)
    if values.size == _count_words(text):
        return values
    for number, row in enumerate(text.split('\n'), start=line):
        column = 0
        for word in row.split():
            column = row.index(word, column)
            try:
                float(word)
            except ValueError:
                raise ValueError(f'line {number}, column {column + 1}: expected a height, got {word!r}') from None
            column += len(word)
    return np.array(text.split(), dtype=np.float64)


def _count_words(text: str) -> int:
    """How many words a text has, without a list of them: there may be millions."""
    characters = np.frombuffer(text.encode('ascii'), dtype=np.uint8) > ord(' ')
    return int(np.count_nonzero(characters[1:] & ~characters[:-1])) + int(characters[:1].sum())
