"""An object found in a sequence of pairs and followed through it, as a user's graph of nodes would."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from msgs_py import CameraRig, PinholeCamera, Pose, StereoRig
from msgs_py.numeric.typed import ByteArray
from stereo_recovery import recover

from ...image_pose.views import Views
from ...model.index import ModelIndex
from ...pipeline import match
from ...tracking.tracker import Tracked, Tracker


@dataclass(frozen=True, eq=False)
class PictureFrame:
    """Pictures of one moment.

    Attributes
    ----------
    stamp_s : float
        Seconds.
    images : tuple of (h, w) uint8
        Grey, rectified.
    rig : StereoRig, CameraRig or PinholeCamera
    """

    stamp_s: float
    images: tuple[ByteArray, ...]
    rig: StereoRig | CameraRig | PinholeCamera


@dataclass(frozen=True, eq=False)
class FollowedFrame:
    """What is known after a frame.

    Attributes
    ----------
    frame : PictureFrame
    tracked : Tracked, optional
        None before the object was found.
    found_anew : bool
        The matcher found it in this frame.
    milliseconds : float
        For the frame, by the clock.
    """

    frame: PictureFrame
    tracked: Tracked | None
    found_anew: bool
    milliseconds: float

    @property
    def pose(self) -> Pose | None:
        """first_T_model; None when it is lost."""
        return None if self.tracked is None else self.tracked.pose


def follow(model: ModelIndex, frames: Iterable[PictureFrame], start: Pose | None = None) -> Iterator[FollowedFrame]:
    """Find an object, follow it, and find it again where it was lost.

    Parameters
    ----------
    model : ModelIndex
        Of a solid.
    frames : iterable of PictureFrame
        Of one camera a start is needed: the matcher takes a rectified pair.
    start : Pose, optional
        first_T_model in the first frame.

    Raises
    ------
    ValueError
        Only features are known of the model, or one camera comes without start.
    """
    if model.shape is None:
        raise ValueError(f'{model.name}: only features are known of it, expected a solid (.csg) or a mesh')
    tracker = None if start is None else Tracker(model.shape, start)
    before = 0.0
    for frame in frames:
        since = time.perf_counter()
        views = Views.of(frame.images, frame.rig)
        tracked, anew = None, False
        if tracker is not None:
            tracked = tracker.step(views, max(frame.stamp_s - before, 0.0) if tracker.frames else 0.0)
        elif not isinstance(frame.rig, StereoRig):
            raise ValueError('start: one camera alone does not tell where an object is, expected a pose')
        if (tracked is None or tracked.pose is None) and isinstance(frame.rig, StereoRig):
            found = match(model, recover(frame.images[0], frame.images[1], frame.rig).features, views=views).best
            if found is not None:
                if tracker is None:
                    tracker = Tracker(model.shape, found)
                tracker.restart(found)
                tracked, anew = tracker.step(views, 0.0), True
        before = frame.stamp_s
        yield FollowedFrame(frame, tracked, anew, 1e3 * (time.perf_counter() - since))
