"""Images as cameras publish them, packed by OpenCV itself."""

from __future__ import annotations

import array
import struct
import zlib

import cv2
import numpy as np
import pytest

pytest.importorskip('sensor_msgs', reason='sensor_msgs is not installed')

from sensor_msgs.msg import CompressedImage

from msgs_py import codecs
from msgs_py.codecs.images import ENCODINGS

RNG = np.random.default_rng(5)
# Smooth, so that neither a mosaic nor a JPEG loses much of it.
COLOUR = cv2.GaussianBlur(RNG.integers(0, 255, (40, 52, 3), dtype=np.uint8), (0, 0), 4.0)
GREY = cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY)


def mosaic(colour: np.ndarray, order: str) -> np.ndarray:
    """What a sensor behind a Bayer filter sees of a BGR image; the order is that of REP-118."""
    out = np.zeros(colour.shape[:2], colour.dtype)
    for k, letter in enumerate(order):
        out[k // 2 :: 2, k % 2 :: 2] = colour[k // 2 :: 2, k % 2 :: 2, 'bgr'.index(letter)]
    return out


def compressed(ending: str, pixels: np.ndarray, form: str) -> CompressedImage:
    data = cv2.imencode(ending, pixels, [cv2.IMWRITE_JPEG_QUALITY, 98] if ending == '.jpg' else [])[1].tobytes()
    return CompressedImage(format=form, data=array.array('B', data))


@pytest.mark.parametrize('bits', [8, 16])
@pytest.mark.parametrize(
    ('encoding', 'code'), [('mono', None), ('rgb', 'RGB'), ('bgr', None), ('rgba', 'RGBA'), ('bgra', 'BGRA')]
)
def test_colour_and_grey_of_any_depth_are_one_picture(encoding, code, bits):
    pixels = GREY if encoding == 'mono' else cv2.cvtColor(COLOUR, getattr(cv2, f'COLOR_BGR2{code}')) if code else COLOUR
    if bits == 16:
        pixels = pixels.astype(np.uint16) * 257
    found = codecs.grey_picture(codecs.array_to_image(pixels, f'{encoding}{bits}'))
    assert found.dtype == f'uint{bits}'
    np.testing.assert_allclose(codecs.in_eight_bits(found), GREY, atol=1)


@pytest.mark.parametrize('bits', [8, 16])
@pytest.mark.parametrize('order', ['rggb', 'bggr', 'gbrg', 'grbg'])
def test_a_mosaic_is_interpolated_in_its_own_order(order, bits):
    seen = mosaic(COLOUR, order).astype(f'uint{bits}') * (257 if bits == 16 else 1)
    found = codecs.gray_from_image(codecs.array_to_image(seen, f'bayer_{order}{bits}'))
    np.testing.assert_allclose(found[2:-2, 2:-2], GREY[2:-2, 2:-2], atol=6)


def test_twelve_bits_in_sixteen_are_made_full():
    levels = np.array([[0, 1, 2048, 4095, 5000]], np.uint16)
    message = codecs.array_to_image(levels, 'mono16')
    assert codecs.grey_picture(message, 12).tolist() == [[0, 16, 32768, 65520, 65520]]
    assert codecs.gray_from_image(message, 12).tolist() == [[0, 0, 128, 255, 255]]
    assert codecs.gray_from_image(message).tolist() == [[0, 0, 8, 15, 19]]


@pytest.mark.parametrize(
    ('ending', 'pixels', 'form', 'tolerance'),
    [
        ('.jpg', COLOUR, 'jpeg', 3),
        ('.jpg', COLOUR, 'rgb8; jpeg compressed bgr8', 3),
        ('.jpg', GREY, 'mono8; jpeg compressed ', 3),
        ('.png', GREY, 'png', 0),
        ('.png', COLOUR, 'bgr8; png compressed bgr8', 1),
        ('.png', cv2.cvtColor(COLOUR, cv2.COLOR_BGR2BGRA), 'bgra8; png compressed', 1),
        ('.png', GREY.astype(np.uint16) * 257, 'mono16; png compressed ', 0),
        ('.png', COLOUR, 'bayer_rggb8; png compressed bgr8', 1),
        ('.png', mosaic(COLOUR, 'rggb'), 'bayer_rggb8; png compressed ', 6),
        ('.png', mosaic(COLOUR, 'gbrg').astype(np.uint16) * 257, 'bayer_gbrg16; png compressed ', 6),
    ],
)
def test_what_opencv_has_compressed_is_the_same_picture(ending, pixels, form, tolerance):
    found = codecs.gray_from_image(compressed(ending, pixels, form))
    np.testing.assert_allclose(found[2:-2, 2:-2].astype(int), GREY[2:-2, 2:-2], atol=tolerance)


def bomb() -> bytes:
    """A PNG of 100,000 x 100,000 pixels in a few hundred bytes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))

    head = chunk(b'IHDR', struct.pack('>IIBBBBB', 100_000, 100_000, 8, 0, 0, 0, 0))
    return b'\x89PNG\r\n\x1a\n' + head + chunk(b'IDAT', zlib.compress(bytes(1000))) + chunk(b'IEND', b'')


@pytest.mark.parametrize(
    ('data', 'form', 'text'),
    [
        (b'', 'jpeg', 'image.data: empty'),
        (b'no picture at all', 'jpeg', 'neither JPEG nor PNG'),
        (cv2.imencode('.jpg', GREY)[1].tobytes()[:-100], 'jpeg', 'without its end; truncated'),
        (cv2.imencode('.png', GREY)[1].tobytes()[:600], 'png', 'image.data: a chunk of .* bytes does not fit'),
        (cv2.imencode('.png', GREY)[1].tobytes()[:20], 'png', 'image.data: .* truncated'),
        (bomb(), 'png', 'image.data: a picture of .* bytes does not fit'),
        (cv2.imencode('.png', GREY)[1].tobytes(), '16UC1; compressedDepth png', 'image.format: .* depth image'),
    ],
)
def test_what_cannot_be_unpacked_is_named(data, form, text):
    with pytest.raises(codecs.CodecError, match=text):
        codecs.grey_picture(CompressedImage(format=form, data=array.array('B', data)))


@pytest.mark.parametrize('encoding', sorted(ENCODINGS))
def test_each_encoding_cut_short_is_named(encoding):
    element, channels = ENCODINGS[encoding]
    pixels = np.zeros((8, 8, channels) if channels > 1 else (8, 8), element)
    message = codecs.array_to_image(pixels, encoding)
    assert codecs.grey_picture(message).shape == (8, 8)
    message.data = message.data[:-9]
    with pytest.raises(codecs.CodecError, match='image.data: .*truncated'):
        codecs.grey_picture(message)


def test_a_mosaic_too_small_to_have_colours_is_named():
    with pytest.raises(codecs.CodecError, match='expected at least 3 x 3 pixels of bayer_rggb8'):
        codecs.grey_picture(codecs.array_to_image(np.zeros((2, 8), np.uint8), 'bayer_rggb8'))
