"""Which topics a node of cameras hears, and pictures of their messages."""

import numpy as np
import pytest

pytest.importorskip('sensor_msgs.msg', reason='needs ROS 2 message classes')

from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from msgs_py import codecs
from msgs_py.node_runtime.camera_input import CameraConfig, CameraImages, CameraTopics, message_type


@pytest.mark.parametrize(
    ('given', 'cameras', 'images', 'infos', 'source'),
    [
        ({}, 2, ('left/image_rect', 'right/image_rect'), ('left/camera_info', 'right/camera_info'), 'stereo pair'),
        ({}, 1, ('left/image_rect',), ('left/camera_info',), 'image'),
        (
            {},
            3,
            tuple(f'camera_{k}/image_rect' for k in range(3)),
            tuple(f'camera_{k}/camera_info' for k in range(3)),
            'set of images',
        ),
        (
            {'image_transport': 'compressed', 'side_by_side': True},
            2,
            ('image_rect/compressed',),
            ('left/camera_info', 'right/camera_info'),
            'stereo pair',
        ),
    ],
)
def test_topics_are_those_of_drivers(given, cameras, images, infos, source):
    topics = CameraTopics.of(CameraConfig(image_bits=12, **given), cameras)
    assert (topics.images, topics.infos, topics.source, topics.bits) == (images, infos, source, 12)
    assert topics.all == images + infos
    kinds = [CompressedImage if given else Image] * len(images) + [CameraInfo] * len(infos)
    assert [message_type(topic) for topic in topics.all] == kinds


@pytest.mark.parametrize(
    ('given', 'text'),
    [
        ({'image_transport': 'theora'}, 'image_transport'),
        ({'image_bits': 7}, 'image_bits'),
        ({'image_bits': 17}, 'image_bits'),
    ],
)
def test_what_no_camera_has_is_refused_by_name(given, text):
    with pytest.raises(ValueError, match=text):
        CameraConfig(**given)


def test_a_pair_side_by_side_is_of_two_cameras():
    with pytest.raises(ValueError, match='side_by_side: is of two cameras, expected cameras to be 2, got 3'):
        CameraTopics.of(CameraConfig(side_by_side=True), 3)


def test_pictures_of_both_eyes_come_from_two_images_or_from_halves_of_one():
    pixels = np.arange(24, dtype=np.uint8).reshape(3, 8)
    halves = [pixels[:, :4], pixels[:, 4:]]
    infos = [CameraInfo(), CameraInfo()]
    header = Header(frame_id='left')
    messages = [codecs.array_to_image(half, 'mono8', header) for half in halves]
    for topics, given in (
        (CameraTopics.of(CameraConfig()), messages),
        (CameraTopics.of(CameraConfig(side_by_side=True)), [codecs.array_to_image(pixels, 'mono8', header)]),
    ):
        both = CameraImages(topics, given, infos)
        assert both.header == header
        for found, half in zip(both.pictures(), halves, strict=True):
            np.testing.assert_array_equal(found, half)


def test_what_is_wrong_with_an_image_names_its_topic():
    odd = codecs.array_to_image(np.zeros((3, 7), np.uint8), 'mono8')
    topics = CameraTopics.of(CameraConfig(side_by_side=True))
    with pytest.raises(codecs.CodecError, match='^image_rect: image.width: 7, expected an even number'):
        CameraImages(topics, [odd], [CameraInfo()] * 2).pictures()
    short = codecs.array_to_image(np.zeros((3, 8), np.uint8), 'mono8')
    short.data = short.data[:5]
    with pytest.raises(codecs.CodecError, match='^right/image_rect: image.data: 5 bytes'):
        CameraImages(CameraTopics.of(CameraConfig()), [odd, short], [CameraInfo()] * 2).pictures()
