"""Images of cameras as their drivers publish them: which topics there are, and grey pictures of their messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from ..codecs import CodecError, grey_picture
from ..codecs.pictures import BITS
from ..numeric.typed import AnyArray
from .config import Config, parameter
from .settings import MOST_CAMERAS

RAW, COMPRESSED = 'raw', 'compressed'
INFO = 'camera_info'
"""What the name of a topic of calibrations ends in."""
SIDES = ('left', 'right')


@dataclass(frozen=True)
class CameraConfig(Config):
    """Parameters of a node that takes images."""

    image_transport: str = parameter(
        RAW,
        'How images come: raw, or compressed as JPEG or PNG, on topics that end in /compressed',
        choices=(RAW, COMPRESSED),
        read_only=True,
    )
    side_by_side: bool = parameter(
        False,
        'Both images of a pair come as the halves of one, on image_rect; left/camera_info and right/camera_info are of '
        'the halves',
        read_only=True,
    )
    image_bits: int = parameter(
        BITS,
        'How many of its 16 bits the camera fills, where images have 16',
        unit='bit',
        minimum=8,
        maximum=BITS,
        read_only=True,
    )


def cameras_parameter(least: int) -> int:
    """The parameter ``cameras`` of a node that takes images of at least so many."""
    of_one = '; of one left/image_rect and left/camera_info' if least == 1 else ''
    number: int = parameter(
        2,
        'How many cameras there are; of three and more the topics are camera_0/image_rect, camera_0/camera_info, ...'
        + of_one,
        minimum=least,
        maximum=MOST_CAMERAS,
        read_only=True,
    )
    return number


@dataclass(frozen=True)
class CameraTopics:
    """What a node that takes images listens to.

    Attributes
    ----------
    images : tuple of str
        One of each camera, or one with the halves of a pair.
    infos : tuple of str
        Of camera_info, one of each camera.
    bits : int
        That a 16-bit image has.
    """

    images: tuple[str, ...]
    infos: tuple[str, ...]
    bits: int = BITS

    @classmethod
    def of(cls, config: CameraConfig, cameras: int = 2) -> CameraTopics:
        """Those of a configuration: of one camera or two left and right, of more camera_0, camera_1, ...

        Raises
        ------
        ValueError
            A pair side by side has two cameras.

        Examples
        --------
        >>> CameraTopics.of(CameraConfig(side_by_side=True)).images
        ('image_rect',)
        """
        if config.side_by_side and cameras != 2:
            raise ValueError(f'parameter side_by_side: is of two cameras, expected cameras to be 2, got {cameras}')
        names = SIDES[:cameras] if cameras <= len(SIDES) else tuple(f'camera_{k}' for k in range(cameras))
        ending = '/compressed' if config.image_transport == COMPRESSED else ''
        images = ('image_rect',) if config.side_by_side else tuple(f'{name}/image_rect' for name in names)
        return cls(
            tuple(image + ending for image in images), tuple(f'{name}/{INFO}' for name in names), config.image_bits
        )

    @property
    def all(self) -> tuple[str, ...]:
        """Every topic."""
        return (*self.images, *self.infos)

    @property
    def source(self) -> str:
        """What a set of their messages is called."""
        return {1: 'image', 2: 'stereo pair'}.get(len(self.infos), 'set of images')


@dataclass(frozen=True, eq=False)
class CameraImages:
    """The messages of one moment.

    Attributes
    ----------
    topics : CameraTopics
    messages : sequence of Image or CompressedImage
        One of each of its images.
    infos : sequence of CameraInfo
        One of each camera.
    """

    topics: CameraTopics
    messages: Sequence[Image | CompressedImage]
    infos: Sequence[CameraInfo]

    @property
    def header(self) -> Header:
        """Of the first image."""
        return self.messages[0].header

    def pictures(self) -> list[AnyArray]:
        """Grey levels of each image, (h, w) uint8, uint16 or float32; they may be views of the memory of its message.

        Raises
        ------
        CodecError
            Names topic and field of what cannot be used.
        """
        found = []
        for topic, message in zip(self.topics.images, self.messages):
            try:
                found.append(grey_picture(message, self.topics.bits))
            except CodecError as error:
                raise CodecError(f'{topic}: {error}') from None
        if len(found) == len(self.infos):
            return found
        return _halves(found[0], self.topics.images[0])


def _halves(both: AnyArray, topic: str) -> list[AnyArray]:
    """Left and right half of an image."""
    width = both.shape[1]
    if width % 2:
        raise CodecError(f'{topic}: image.width: {width}, expected an even number of two images side by side')
    return [both[:, : width // 2], both[:, width // 2 :]]


def message_type(topic: str) -> Any:
    """Type of the messages of one of these topics."""
    if topic.endswith(INFO):
        return CameraInfo
    return CompressedImage if topic.endswith(COMPRESSED) else Image
