"""sensor_msgs/Image to and from arrays. Row padding and byte order are respected."""

from __future__ import annotations

import array
import sys

import numpy as np
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from ..numeric.typed import AnyArray
from .errors import CodecError

# Encodings that are understood: element type without byte order, channels.
ENCODINGS: dict[str, tuple[str, int]] = {
    'mono8': ('u1', 1),
    'rgb8': ('u1', 3),
    'bgr8': ('u1', 3),
    'rgba8': ('u1', 4),
    'bgra8': ('u1', 4),
    'mono16': ('u2', 1),
    'rgb16': ('u2', 3),
    'bgr16': ('u2', 3),
    'rgba16': ('u2', 4),
    'bgra16': ('u2', 4),
    **{f'bayer_{order}{bits}': (f'u{bits // 8}', 1) for bits in (8, 16) for order in ('rggb', 'bggr', 'gbrg', 'grbg')},
    '32FC1': ('f4', 1),
}
# The same memory layouts under the names OpenCV users publish.
ALIASES = {'8UC1': 'mono8', '8UC3': 'bgr8', '8UC4': 'bgra8', '16UC1': 'mono16', '16UC3': 'bgr16', '16UC4': 'bgra16'}


def image_to_array(message: Image) -> tuple[AnyArray, str]:
    """Pixels and encoding of an image.

    Parameters
    ----------
    message : sensor_msgs.msg.Image
        Row padding and either byte order are understood.

    Returns
    -------
    pixels : (height, width) or (height, width, 3 or 4) array of uint8, uint16 or float32
        In this machine's byte order; of a Bayer encoding the mosaic as it is. It is a view of the message's memory
        where that is possible: copy it before changing it.
    encoding : str
        One of ENCODINGS.

    Raises
    ------
    CodecError
        Names the field: an unknown encoding, or sizes that do not agree.

    Examples
    --------
    >>> image_to_array(array_to_image(np.zeros((2, 3), np.uint8), 'mono8'))
    (array([[0, 0, 0],
           [0, 0, 0]], dtype=uint8), 'mono8')
    """
    encoding = ALIASES.get(message.encoding, message.encoding)
    if encoding not in ENCODINGS:
        raise CodecError(
            f'image.encoding: {message.encoding!r} is unknown, expected one of {", ".join([*ENCODINGS, *ALIASES])}'
        )
    element, channels = ENCODINGS[encoding]
    dtype = np.dtype(element).newbyteorder('>' if message.is_bigendian else '<')
    height, width, step = int(message.height), int(message.width), int(message.step)
    if height < 1 or width < 1:
        raise CodecError(f'image.height, image.width: {height} x {width}, expected at least one pixel')
    row = width * channels * dtype.itemsize
    if step < row:
        raise CodecError(f'image.step: {step} bytes, expected at least {row} for {width} pixels of {encoding}')
    needed = step * (height - 1) + row
    # np.frombuffer refuses an empty buffer, so the length is looked at first.
    if len(message.data) < needed:
        raise CodecError(
            f'image.data: {len(message.data)} bytes, expected {step * height} ({height} rows of {step}); truncated?'
        )
    buffer = np.frombuffer(message.data, dtype=np.uint8)
    if len(buffer) < step * height:  # the last row may come without its padding
        buffer = np.concatenate([buffer, np.zeros(step * height - len(buffer), np.uint8)])
    rows = buffer[: step * height].reshape(height, step)[:, :row]
    pixels = np.ascontiguousarray(rows) if step != row else rows
    pixels = pixels.view(dtype)
    if not dtype.isnative:
        pixels = pixels.astype(dtype.newbyteorder('='))
    return (pixels.reshape(height, width, channels) if channels > 1 else pixels.reshape(height, width)), encoding


def array_to_image(pixels: AnyArray, encoding: str, header: Header | None = None) -> Image:
    """The message of an array of pixels.

    Parameters
    ----------
    pixels : (height, width) or (height, width, 3 or 4) array
        With the element type of the encoding.
    encoding : str
        One of ENCODINGS.
    header : std_msgs.msg.Header, optional

    Returns
    -------
    sensor_msgs.msg.Image
        Rows unpadded, in this machine's byte order.

    Raises
    ------
    CodecError
        When array and encoding do not agree.
    """
    if encoding not in ENCODINGS:
        raise CodecError(f'encoding: {encoding!r} is unknown, expected one of {", ".join(ENCODINGS)}')
    element, channels = ENCODINGS[encoding]
    pixels = np.asarray(pixels)
    expected = f'shape (h, w, {channels})' if channels > 1 else 'shape (h, w)'
    if pixels.ndim != (3 if channels > 1 else 2) or (channels > 1 and pixels.shape[2] != channels):
        raise CodecError(f'pixels: shape {pixels.shape}, expected {expected} for {encoding}')
    if pixels.dtype != np.dtype(element):
        raise CodecError(f'pixels: {pixels.dtype}, expected {np.dtype(element)} for {encoding}')
    message = Image()
    if header is not None:
        message.header = header
    message.height, message.width = pixels.shape[:2]
    message.encoding = encoding
    message.is_bigendian = int(sys.byteorder == 'big')
    message.step = pixels.shape[1] * channels * pixels.dtype.itemsize
    # array('B') is stored as it is; anything else is converted element by element (1000 times slower).
    data = array.array('B')
    data.frombytes(np.ascontiguousarray(pixels).data.cast('B') if pixels.size else b'')
    message.data = data
    return message
