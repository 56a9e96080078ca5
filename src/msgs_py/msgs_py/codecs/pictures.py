"""Grey levels of whatever a camera publishes: raw or compressed, in 8 or 16 bits, grey, colour or a Bayer mosaic.

OpenCV unpacks, and interpolates mosaics. It is imported where that is done: who only writes images needs none of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from sensor_msgs.msg import Image

from ..files import check_packed_picture
from ..numeric.typed import AnyArray, ByteArray
from .errors import CodecError
from .images import ENCODINGS, image_to_array

if TYPE_CHECKING:
    from sensor_msgs.msg import CompressedImage

BITS = 16
"""What a 16-bit image holds, unless its camera is known to fill fewer."""
# OpenCV names a mosaic by the second and third pixel of its second row, ROS by the first two rows from their corner.
_MOSAICS = {'rggb': 'BG', 'bggr': 'RG', 'gbrg': 'GR', 'grbg': 'GB'}
# Sides of the smallest mosaic that has a pixel with neighbours of both other colours.
_LEAST_MOSAIC = 3


def grey_picture(message: Image | CompressedImage, bits: int = BITS) -> AnyArray:
    """Grey levels of an image, as precisely as it has them.

    Parameters
    ----------
    message : sensor_msgs.msg.Image or sensor_msgs.msg.CompressedImage
        Colours are weighted as in ITU-R BT.601. A Bayer mosaic is interpolated, also one that was compressed as such.
    bits : int
        Of a 16-bit image, how many of them its camera fills: 12 of most that call themselves so.

    Returns
    -------
    (height, width) uint8, uint16 or float32
        0 to 255 or 0 to 65535, whatever ``bits`` is; of 32FC1 the numbers that it has. It may be a view of the
        message's memory: copy it before changing it.

    Raises
    ------
    CodecError
        Names the field: an encoding that is unknown, sizes that do not agree, data that cannot be unpacked.

    Examples
    --------
    >>> from msgs_py.codecs import array_to_image
    >>> grey_picture(array_to_image(np.full((1, 2), 4095, np.uint16), 'mono16'), bits=12)
    array([[65520, 65520]], dtype=uint16)
    """
    pixels, encoding = _unpacked(message) if hasattr(message, 'format') else image_to_array(message)
    grey = _grey(pixels, encoding)
    if grey.dtype == np.uint16 and bits < BITS:
        # What exceeds the stated bits is as bright as can be, and no dark pixel.
        return np.asarray(np.minimum(grey, 2**bits - 1) << (BITS - bits), np.uint16)
    return grey


def gray_from_image(message: Image | CompressedImage, bits: int = BITS) -> ByteArray:
    """Grey levels of any image but a depth image, in 8 bits.

    Parameters
    ----------
    message, bits
        As for :func:`grey_picture`.

    Returns
    -------
    (height, width) uint8
        Of 16 bits the upper half.

    Raises
    ------
    CodecError
        As :func:`grey_picture`, and for 32FC1.
    """
    return in_eight_bits(grey_picture(message, bits))


def in_eight_bits(grey: AnyArray) -> ByteArray:
    """(height, width) uint8 of grey levels in 8 or 16 bits; of 16 the upper half. Raises CodecError for others."""
    if grey.dtype not in (np.uint8, np.uint16):
        raise CodecError('image.encoding: 32FC1 is a depth image, expected grey levels or colour')
    return grey if grey.dtype == np.uint8 else (grey >> 8).astype(np.uint8)


def _grey(pixels: AnyArray, encoding: str) -> AnyArray:
    """(h, w) uint8 or uint16 of pixels in an encoding of images."""
    if encoding.startswith('bayer_'):
        return _of_mosaic(pixels, encoding)
    if pixels.ndim == 2:
        return pixels
    import cv2

    order = 'RGB' if encoding.startswith('rgb') else 'BGR'
    alpha = 'A' if pixels.shape[2] == 4 else ''
    return np.asarray(cv2.cvtColor(pixels, getattr(cv2, f'COLOR_{order}{alpha}2GRAY')))


def _of_mosaic(mosaic: AnyArray, encoding: str) -> AnyArray:
    """(h, w) grey levels of a Bayer mosaic."""
    import cv2

    if min(mosaic.shape) < _LEAST_MOSAIC:
        raise CodecError(
            f'image.height, image.width: {mosaic.shape[0]} x {mosaic.shape[1]}, expected at least {_LEAST_MOSAIC} x '
            f'{_LEAST_MOSAIC} pixels of {encoding}'
        )
    order = encoding.removeprefix('bayer_').rstrip('0123456789')
    return np.asarray(cv2.cvtColor(mosaic, getattr(cv2, f'COLOR_Bayer{_MOSAICS[order]}2GRAY')))


def _unpacked(message: CompressedImage) -> tuple[AnyArray, str]:
    """Pixels and encoding of a compressed image, whose format may be ``jpeg`` or ``rgb8; jpeg compressed bgr8``."""
    import cv2

    source = message.format.partition(';')[0].strip()
    if 'compressedDepth' in message.format or source == '32FC1':
        raise CodecError(f'image.format: {message.format!r} is a depth image, expected grey levels or colour')
    data = bytes(message.data)
    try:
        check_packed_picture(data)
    except ValueError as error:
        raise CodecError(f'image.data: {error} (format {message.format!r})') from None
    # A JPEG's luma is there already, and need not be made of colours; of others all bits are kept.
    flags = (
        cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION if data.startswith(b'\xff\xd8') else cv2.IMREAD_UNCHANGED
    )
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        pixels = None
    if pixels is None or pixels.dtype not in (np.uint8, np.uint16):
        raise CodecError(
            f'image.data: {len(data)} bytes that cannot be unpacked (format {message.format!r}), expected a JPEG or '
            'PNG of 8 or 16 bits; truncated?'
        )
    bits = 8 * pixels.dtype.itemsize
    if pixels.ndim == 3:
        # Two channels are grey and alpha.
        kinds = {2: (pixels[..., 0], 'mono'), 3: (pixels, 'bgr'), 4: (pixels, 'bgra')}
        pixels, kind = cast('tuple[AnyArray, str]', kinds[pixels.shape[2]])
        return np.ascontiguousarray(pixels), f'{kind}{bits}'
    # What was a mosaic before it was compressed is one still, unless it was made colours on the way.
    if source.startswith('bayer_') and source in ENCODINGS and not _made_colour(message.format):
        return np.asarray(pixels), f'{source.rstrip("0123456789")}{bits}'
    return np.asarray(pixels), f'mono{bits}'


def _made_colour(form: str) -> bool:
    """Whether a format says that the image was made colours or grey levels before it was compressed."""
    target: Any = form.rpartition('compressed')[2].strip()
    return bool(target) and not target.startswith('bayer_')
