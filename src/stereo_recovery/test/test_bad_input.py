"""Whatever is put in, recover() answers with features or a reason, or refuses it by name."""

from __future__ import annotations

import warnings

import cv2
import numpy as np
import pytest

from msgs_py import PinholeCamera, StereoRig
from stereo_recovery import recover


def rig_for(image: np.ndarray, baseline: float = 0.05) -> StereoRig:
    height, width = image.shape[:2]
    return StereoRig.symmetric(PinholeCamera.centred(width, height, 1.4 * width), baseline)


def grid(shape=(240, 320), square=20) -> np.ndarray:
    return ((np.indices(shape) // square).sum(axis=0) % 2 * 255).astype(np.uint8)


RANDOM = np.random.default_rng(0)
PICTURES = {
    'black': np.zeros((64, 64), np.uint8),
    'saturated': np.full((64, 64), 255, np.uint8),
    'one pixel': np.zeros((1, 1), np.uint8),
    '8 x 8': RANDOM.integers(0, 255, (8, 8), dtype=np.uint8),
    'a strip': RANDOM.integers(0, 255, (3, 400), dtype=np.uint8),
    'noise': RANDOM.integers(0, 255, (200, 200)),
    'stripes along the rows': np.repeat(grid((12, 320), 320), 20, axis=0),
    'NaN': np.full((64, 64), np.nan),
    'binary noise': (RANDOM.random((200, 200)) > 0.5) * np.uint8(255),
    'huge values': np.full((64, 64), 1e30),
}


@pytest.mark.parametrize('name', PICTURES)
def test_pictures_without_stereo_give_a_reason(name):
    image = PICTURES[name]
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        result = recover(image, image, rig_for(image))
    assert len(result.features) == 0
    assert result.reason


def test_a_large_image_without_texture_is_quick_to_refuse():
    image = np.full((3072, 4096), 40, np.uint8)
    result = recover(image, image, rig_for(image))
    assert 'no texture' in result.reason


def test_a_large_textured_pair_is_no_problem():
    small = cv2.GaussianBlur(np.random.default_rng(5).integers(0, 255, (384, 512), dtype=np.uint8), (0, 0), 2.0)
    left = cv2.resize(small, (4096, 3072), interpolation=cv2.INTER_CUBIC)
    result = recover(left, np.roll(left, -160, axis=1), rig_for(left))
    assert len(result.features) > 0 or result.reason


def test_the_same_picture_twice_is_named():
    image = grid()
    result = recover(image, image, rig_for(image))
    assert len(result.features) == 0
    assert 'same picture' in result.reason


def test_exchanged_pictures_are_named(synthetic, solids):
    from msgs_py import Pose

    rig = StereoRig.symmetric(PinholeCamera.centred(256, 256, 350.0), 0.05)
    solid = solids['wedge'].at(Pose.from_rotation_vector([-0.6, 0.5, 0.4], [0.025, 0, 0.25]))
    left, right = synthetic.render_pair(solid, rig)
    assert len(recover(left, right, rig).features) >= 3
    swapped = recover(right, left, rig)
    assert len(swapped.features) == 0
    assert 'swapped' in swapped.reason


@pytest.mark.parametrize(
    ('image', 'message'),
    [
        (np.zeros((64, 64, 5)), 'left: expected shape'),
        (np.zeros((64, 64), bool), 'left: expected grey levels'),
        (np.zeros((64, 64, 0)), 'left: expected shape'),
        (np.array([['a']]), 'left: expected grey levels'),
    ],
)
def test_what_is_no_image_is_refused_by_name(image, message):
    good = np.zeros((64, 64), np.uint8)
    with pytest.raises(ValueError, match=message):
        recover(image, good, rig_for(good))


def test_a_missing_rig_is_refused_by_name():
    image = np.zeros((64, 64), np.uint8)
    with pytest.raises(TypeError, match='rig'):
        recover(image, image, None)


@pytest.mark.parametrize(
    'convert',
    [
        lambda x: np.dstack([x] * 3),
        lambda x: np.dstack([x] * 4),
        lambda x: x.astype(np.uint16) * 256,
        lambda x: x.astype(np.float64),
        lambda x: np.asfortranarray(x),
    ],
    ids=['rgb', 'rgba', 'uint16', 'float', 'fortran'],
)
def test_every_kind_of_image_gives_the_same_features(synthetic, solids, convert):
    from msgs_py import Pose

    rig = StereoRig.symmetric(PinholeCamera.centred(256, 256, 350.0), 0.05)
    solid = solids['wedge'].at(Pose.from_rotation_vector([-0.6, 0.5, 0.4], [0.025, 0, 0.25]))
    left, right = synthetic.render_pair(solid, rig)
    expected = recover(left, right, rig).features
    found = recover(convert(left), convert(right), rig).features
    assert len(found) == len(expected)
    assert np.allclose(found.start, expected.start, atol=1e-6)
