"""Files of others are looked at before they are read: what is too large, or promises too much, is refused by name."""

import io
import os
import struct
import zipfile
import zlib

import cv2
import numpy as np
import pytest

from msgs_py import FeatureSet, files
from msgs_py.files import check_file, check_image, load_array, load_arrays, read_json, read_text

HUGE = (10**7, 10**7)


def npy(shape, values=b'', dtype='<f8') -> bytes:
    """A .npy file that says to hold a shape."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {'descr': dtype, 'fortran_order': False, 'shape': shape})
    return file.getvalue() + values


def archive(path, **members: bytes) -> None:
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(f'{name}.npy', data)


def png(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))

    head = chunk(b'IHDR', struct.pack('>IIBBBBB', width, height, 8, 0, 0, 0, 0))
    return b'\x89PNG\r\n\x1a\n' + head + chunk(b'IDAT', zlib.compress(b'\0' * 1000)) + chunk(b'IEND', b'')


@pytest.mark.parametrize(
    ('suffix', 'options'), [('.png', []), ('.jpg', []), ('.bmp', []), ('.tiff', []), ('.pgm', []), ('.webp', [])]
)
def test_the_size_of_a_picture_is_read_from_its_header(tmp_path, monkeypatch, suffix, options):
    path = tmp_path / f'picture{suffix}'
    cv2.imwrite(str(path), np.arange(48, dtype=np.uint8).reshape(6, 8), options)
    assert check_image(path) == path
    monkeypatch.setattr(files, 'LARGEST_IMAGE', 48)
    check_image(path)
    monkeypatch.setattr(files, 'LARGEST_IMAGE', 47)
    if suffix == '.webp':  # a format that is left to the decoder
        check_image(path)
    else:
        with pytest.raises(ValueError, match='8 x 6 pixels, at most 47') as error:
            check_image(path)
        assert str(error.value).startswith(str(path))


@pytest.mark.parametrize(
    'data',
    [
        b'BM' + bytes(16) + struct.pack('<ii', 60_000, -60_000) + bytes(40),
        b'P5 # a comment\n60000 60000 255\n' + bytes(100),
        b'\xff\xd8\xff\xe0\x00\x04ab\xff\xff\xc2\x00\x11\x08' + struct.pack('>HH', 60_000, 60_000) + bytes(20),
        b'II*\0\x08\0\0\0\x02\0' + struct.pack('<HHIIHHII', 256, 4, 1, 60_000, 257, 4, 1, 60_000),
    ],
)
def test_a_small_file_that_unpacks_to_gigabytes_is_refused(tmp_path, data):
    path = tmp_path / 'bomb'
    path.write_bytes(data)
    with pytest.raises(ValueError, match='60000 x 60000 pixels'):
        check_image(path)


def test_a_picture_that_promises_more_than_deflate_can_pack_is_refused(tmp_path):
    path = tmp_path / 'promises.png'
    for size in (60_000, 5_000):
        path.write_bytes(png(size, size))
        with pytest.raises(ValueError, match=f'a picture of {size * size} bytes does not fit into a file of'):
            check_image(path)
    path.write_bytes(png(2, 2)[:-12] + struct.pack('>I', 2**31 - 1) + b'IDAT' + bytes(20))
    with pytest.raises(ValueError, match='a chunk of 2147483647 bytes does not fit'):
        check_image(path)
    cv2.imwrite(str(path), np.zeros((3000, 3000, 3), np.uint8))  # as well packed as can be
    assert check_image(path) == path


@pytest.mark.parametrize(
    'data', [b'', b'P5', b'P5 x y', b'BM', b'\xff\xd8\xff', b'\xff\xd8\xff\xe0\x00', b'II*\0', png(2, 2)[:20]]
)
def test_a_damaged_header_is_left_to_the_decoder(tmp_path, data):
    path = tmp_path / 'damaged'
    path.write_bytes(data)
    assert check_image(path) == path


def test_an_archive_says_its_size_before_it_is_unpacked(tmp_path, monkeypatch):
    path = tmp_path / 'file.npz'
    np.savez_compressed(path, kind=np.zeros(1000))
    assert set(load_arrays(path)) == {'kind'}
    monkeypatch.setattr(files, 'LARGEST_FILE', 8000)
    assert path.stat().st_size < 8000  # packed
    with pytest.raises(ValueError, match='unpacks to 8128 bytes, at most 8000') as error:
        load_arrays(path)
    assert str(error.value).startswith(str(path))


@pytest.mark.parametrize(
    'header', [npy(HUGE), npy((2**62, 2**62)), npy((3,), b'12345678'), npy((1, -5)), b'', b'no header']
)
def test_a_header_that_promises_more_than_there_is_takes_no_memory(tmp_path, header):
    archive(tmp_path / 'file.npz', kind=header)
    with pytest.raises(ValueError, match='not an archive of arrays|not a feature file'):
        load_arrays(tmp_path / 'file.npz')
    with pytest.raises(ValueError, match='not a feature file'):
        FeatureSet.load(tmp_path / 'file.npz')
    (tmp_path / 'file.npy').write_bytes(header)
    with pytest.raises(ValueError, match='not a .npy file'):
        load_array(tmp_path / 'file.npy')


def test_arrays_come_as_they_were_saved(tmp_path):
    given = {'a': np.arange(6.0).reshape(2, 3), 'b': np.array([True]), 'c': np.zeros((0, 3)), 'd': np.array(7)}
    np.savez(tmp_path / 'file.npz', **given)
    found = load_arrays(tmp_path / 'file.npz')
    assert list(found) == list(given)
    for name, array in found.items():
        np.testing.assert_array_equal(array, given[name])
        np.save(tmp_path / 'one.npy', given[name])
        np.testing.assert_array_equal(load_array(tmp_path / 'one.npy'), given[name])


def test_objects_are_not_unpickled(tmp_path):
    np.savez(tmp_path / 'file.npz', a=np.array([print], dtype=object))
    with pytest.raises(ValueError, match='not an archive'):
        load_arrays(tmp_path / 'file.npz')


def test_a_large_file_and_what_is_no_file_are_refused(tmp_path, monkeypatch):
    path = tmp_path / 'text'
    path.write_text('grüße')
    assert read_text(path) == 'grüße'
    monkeypatch.setattr(files, 'LARGEST_TEXT', 6)
    with pytest.raises(ValueError, match='7 bytes, at most 6 are read'):
        read_text(path)
    for odd in (tmp_path, '/dev/zero'):
        with pytest.raises(ValueError, match='not an ordinary file'):
            check_file(odd)
    os.mkfifo(tmp_path / 'pipe')
    for read in (read_text, check_image, load_arrays, load_array, FeatureSet.load):
        with pytest.raises(ValueError, match='not an ordinary file'):
            read(tmp_path / 'pipe')
        with pytest.raises(FileNotFoundError):
            read(tmp_path / 'nothing')


def test_a_sparse_file_of_a_terabyte_is_refused_at_once(tmp_path):
    path = tmp_path / 'sparse.npz'
    with path.open('wb') as file:
        file.truncate(2**40)
    for read in (FeatureSet.load, check_image, read_text):
        with pytest.raises(ValueError, match=f'{2**40} bytes'):
            read(path)


@pytest.mark.parametrize(
    ('text', 'says'),
    [('[' * 100_000, 'brackets'), (f'[1, -{10**400}]', 'an integer of 402 characters'), ('{"a": ', 'line 1')],
)
def test_json_that_cannot_be_used_is_a_value_error(tmp_path, text, says):
    path = tmp_path / 'record.json'
    path.write_text(text)
    with pytest.raises(ValueError, match=says):
        read_json(path)
    path.write_text('{"a": [1, -2.5, 100000000000000000000]}')
    assert read_json(path) == {'a': [1, -2.5, 10**20]}
