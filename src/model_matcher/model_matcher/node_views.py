"""What both nodes do with images: messages to views, and a memory of the last ones by their stamps."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from msgs_py import CameraRig, StereoRig
from msgs_py.codecs import image_to_array
from msgs_py.node_runtime.runtime import StereoMessages
from msgs_py.numeric.typed import ByteArray

from .image_pose.views import Views
from .settings import IMAGES_KEPT

NANOSECONDS = 10**9


def stamp_ns(header: Any) -> int:
    """The stamp of a header, nanoseconds."""
    return int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)


def views_of_pair(messages: StereoMessages) -> Views:
    """Rectified images of a stereo pair; raises ValueError naming what cannot be used."""
    rig = StereoRig.from_camera_info(messages.left_info, messages.right_info)
    return Views.of([grey_image(messages.left), grey_image(messages.right)], rig)


def views_of_cameras(messages: Sequence[tuple[Any, Any]]) -> Views:
    """Rectified images of any number of parallel cameras, each with its camera_info."""
    rig = CameraRig.from_camera_info([info for _, info in messages])
    return Views.of([grey_image(image) for image, _ in messages], rig)


def grey_image(message: Any) -> ByteArray:
    """(h, w) uint8 of an image message; of 16 bits the upper half."""
    pixels, encoding = image_to_array(message)
    if pixels.dtype == np.uint16:
        pixels = (pixels >> 8).astype(np.uint8)
    if pixels.dtype != np.uint8:
        raise ValueError(f'image.encoding: {encoding!r} is no picture, expected 8 or 16 bits')
    if pixels.ndim == 3:
        pixels = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY if encoding == 'rgb8' else cv2.COLOR_BGR2GRAY)
    return np.asarray(pixels, np.uint8)


class ViewMemory:
    """The last images, by their stamps.

    Parameters
    ----------
    most : int
        How many are kept.
    """

    def __init__(self, most: int = IMAGES_KEPT) -> None:
        self._most = most
        self._views: OrderedDict[int, Views] = OrderedDict()

    def keep(self, stamp: int, views: Views) -> None:
        """Remember images; what is later than they are is from before a clock was set back, and forgotten."""
        for later in [one for one in self._views if one > stamp]:
            del self._views[later]
        self._views[stamp] = views
        while len(self._views) > self._most:
            self._views.popitem(last=False)

    def at(self, stamp: int) -> Views | None:
        """The images of a stamp."""
        return self._views.get(stamp)

    def since(self, stamp: int) -> list[tuple[int, Views]]:
        """Stamps and images, of this stamp and later ones, in their order."""
        return [(when, views) for when, views in self._views.items() if when >= stamp]

    @property
    def newest(self) -> int | None:
        """The last stamp."""
        return next(reversed(self._views), None)

    def clear(self) -> None:
        """Forget all."""
        self._views.clear()
