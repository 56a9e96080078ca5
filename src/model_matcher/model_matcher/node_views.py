"""What both nodes do with images: messages to views, and a memory of the last ones by their stamps."""

from __future__ import annotations

from collections import OrderedDict

from msgs_py import CameraRig, StereoRig
from msgs_py.codecs import in_eight_bits
from msgs_py.node_runtime.camera_input import CameraImages

from .image_pose.views import Views
from .settings import MESSAGES_KEPT


def views_of(images: CameraImages) -> Views:
    """Rectified images of any number of parallel cameras; raises ValueError naming what cannot be used."""
    infos = images.infos
    rig = StereoRig.from_camera_info(*infos) if len(infos) == 2 else CameraRig.from_camera_info(infos)
    return Views.of([in_eight_bits(picture) for picture in images.pictures()], rig)


class ViewMemory:
    """The last images, by their stamps.

    Parameters
    ----------
    most : int
        How many are kept.
    """

    def __init__(self, most: int = MESSAGES_KEPT) -> None:
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
