"""Stereo pairs out of bags: rosbag2 (folders, .mcap, .db3) and ROS 1 (.bag), as any driver has recorded them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

from msgs_py import StereoRig
from msgs_py.node_runtime.stamp_sync import StampSync, stamp_ns
from msgs_py.numeric.typed import ByteArray
from stereo_recovery.cameras.rectification import Rectifier

# What the topics of a pair end in; images may be compressed.
IMAGES = ('left/image_rect', 'right/image_rect')
INFO = 'camera_info'
COMPRESSED = '/compressed'
BAGS = ('.mcap', '.db3', '.bag')
# Fields of a camera_info, and what ROS 1 calls those that it calls otherwise.
_FIELDS = {'width': 'width', 'height': 'height', 'distortion_model': 'distortion_model', 'roi': 'roi'}
_FIELDS |= {'binning_x': 'binning_x', 'binning_y': 'binning_y', 'd': 'D', 'k': 'K', 'r': 'R', 'p': 'P'}


class RecordedMessage(NamedTuple):
    """A message as it was recorded: serialised as the bag has it, or as CDR where that is ROS 1's."""

    topic: str
    kind: str
    data: bytes
    log_ns: int


@dataclass(frozen=True, eq=False)
class RecordedPair:
    """A stereo pair of a bag.

    Attributes
    ----------
    images : (left, right) of (h, w) uint8
        Grey, rectified.
    rig : StereoRig
    stamp_ns : int
        Nanoseconds, of the left image's header.
    frame_id : str
        The same.
    log_ns : int
        When the later one was recorded, nanoseconds.
    messages : tuple of RecordedMessage
        The images, and the camera_info that they go with.
    """

    images: tuple[ByteArray, ByteArray]
    rig: StereoRig
    stamp_ns: int
    frame_id: str
    log_ns: int
    messages: tuple[RecordedMessage, ...]


def is_bag(path: Path) -> bool:
    """Whether a path is that of a bag: a folder with metadata.yaml, or a file that is called as one."""
    return (path / 'metadata.yaml').exists() or (path.is_file() and path.suffix.lower() in BAGS)


def check_bag(path: Path) -> None:
    """Raise FileNotFoundError or ValueError for a path that is not that of a bag."""
    if not path.exists():
        raise FileNotFoundError(f'{path}: no such bag')
    if not is_bag(path):
        raise ValueError(f'{path}: not a bag, expected a folder of rosbag2, or a file {", ".join(BAGS)}')


class StereoBag:
    """The stereo pairs of a bag.

    Parameters
    ----------
    path : Path
        A folder of rosbag2, a file .mcap or .db3 of one, or a .bag of ROS 1.
    images : sequence of str, optional
        Topics of the left and right image; by default those that end in left/image_rect and right/image_rect, or are
        these compressed. camera_info stands beside each, as drivers publish it.
    raw : bool
        The images are raw: undistort and rectify them.
    problem : callable, optional
        Takes the text of what is wrong with a pair, which is left out then; without it, such a pair raises.

    Raises
    ------
    OSError, ValueError
        The bag cannot be read, or lacks something; begins with its name.
    """

    def __init__(
        self, path: Path, images: Sequence[str] = (), raw: bool = False, problem: Callable[[str], None] | None = None
    ) -> None:
        self.path, self.raw, self.problem = path, raw, problem
        self._given = tuple(images)
        self._rectifier: tuple[tuple[Any, ...], Rectifier] | None = None

    def __iter__(self) -> Iterator[RecordedPair]:
        try:
            from rosbags.highlevel import AnyReader, AnyReaderError
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise ValueError(f'{self.path}: reading bags needs rosbags (pip install rosbags)') from None
        check_bag(self.path)
        try:
            reader = AnyReader([self.path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
            reader.open()
        except (AnyReaderError, AssertionError, EOFError) as error:
            raise ValueError(f'{self.path}: not a bag that can be read: {error}') from None
        try:
            yield from self._pairs(reader)
        finally:
            reader.close()

    # -- topics ------------------------------------------------------------------------------------------------

    def _connections(self, reader: Any) -> dict[str, list[Any]]:
        """Connections of left and right image and camera_info, by topic as recorded."""
        recorded: dict[str, list[Any]] = {}
        for connection in reader.connections:
            recorded.setdefault(connection.topic, []).append(connection)
        if not any(topic.endswith(INFO) for topic in recorded):
            raise ValueError(
                f'{self.path}: no topic ends in left/{INFO} or right/{INFO}, and nothing says what the cameras are'
            )
        images = [self._image_topic(recorded, k) for k in range(2)]
        infos = [f'{topic.removesuffix(COMPRESSED).rpartition("/")[0]}/{INFO}' for topic in images]
        missing = [info for info in infos if info not in recorded]
        if missing:
            raise ValueError(
                f'{self.path}: there is no topic {" or ".join(missing)}, so nothing says what the cameras are'
            )
        return {topic: recorded[topic] for topic in (*images, *infos)}

    def _image_topic(self, recorded: dict[str, list[Any]], side: int) -> str:
        if self._given:
            if self._given[side] in recorded:
                return self._given[side]
            raise ValueError(f'{self.path}: there is no topic {self._given[side]}; there are {_listed(recorded)}')
        found = [topic for topic in recorded if topic.removesuffix(COMPRESSED).endswith(IMAGES[side])]
        # Of one camera the raw images count: compressing takes something away.
        found = [
            topic for topic in found if not (topic.endswith(COMPRESSED) and topic.removesuffix(COMPRESSED) in found)
        ]
        if len(found) == 1:
            return found[0]
        what = f'several topics end in {IMAGES[side]}' if found else f'no topic ends in {IMAGES[side]}'
        raise ValueError(
            f'{self.path}: {what}; there are {_listed(recorded)}: name those of the images (--left, --right)'
        )

    # -- messages ----------------------------------------------------------------------------------------------

    def _pairs(self, reader: Any) -> Iterator[RecordedPair]:
        connections = self._connections(reader)
        topics = tuple(connections)
        sync = StampSync(topics[:2])
        # A latched camera_info may stand anywhere in the bag: the first of each side holds until another comes.
        infos: dict[str, tuple[RecordedMessage, Any]] = {}
        for topic in topics[2:]:
            first = next(reader.messages(connections[topic]), None)
            if first is None:
                raise ValueError(f'{self.path}: {topic} has no message, so nothing says what the cameras are')
            infos[topic] = self._decoded(reader, *first)
        for item in reader.messages([one for each in connections.values() for one in each]):
            message, decoded = self._decoded(reader, *item)
            if message.topic in infos:
                infos[message.topic] = message, decoded
                continue
            together = sync.add(message.topic, stamp_ns(decoded.header), (message, decoded))
            if together is None:
                continue
            try:
                yield self._pair([together[topic] for topic in topics[:2]], [infos[topic] for topic in topics[2:]])
            except ValueError as error:
                if self.problem is None:
                    raise ValueError(f'{self.path}: {error}') from None
                self.problem(f'{self.path}: {error}')
        if not sync.counters.sets:
            raise ValueError(f'{self.path}: {sync.explain()}')

    def _decoded(self, reader: Any, connection: Any, log_ns: int, data: bytes) -> tuple[RecordedMessage, Any]:
        try:
            decoded = reader.deserialize(data, connection.msgtype)
            cdr = data if reader.is2 else reader.default_typestore.ros1_to_cdr(data, connection.msgtype)
        except Exception as error:  # what a damaged message makes of a deserialiser is of any type
            raise ValueError(f'{self.path}: {connection.topic}: a message that cannot be read: {error}') from None
        return RecordedMessage(connection.topic, connection.msgtype, bytes(cdr), log_ns), decoded

    def _pair(
        self, images: Sequence[tuple[RecordedMessage, Any]], infos: Sequence[tuple[RecordedMessage, Any]]
    ) -> RecordedPair:
        # The codecs need message classes, which folders of pictures, and most who import this, do without.
        from msgs_py.codecs import CodecError, gray_from_image

        pictures = []
        for message, decoded in images:
            try:
                pictures.append(gray_from_image(decoded))
            except CodecError as error:
                raise ValueError(f'{message.topic}: {error}') from None
        cameras = [_camera_info(decoded) for _, decoded in infos]
        rig, (left, right) = self._rectified(pictures, cameras)
        header = images[0][1].header
        return RecordedPair(
            (left, right),
            rig,
            stamp_ns(header),
            header.frame_id,
            max(message.log_ns for message, _ in images),
            tuple(message for message, _ in (*images, *infos)),
        )

    def _rectified(self, pictures: Sequence[Any], cameras: Sequence[Any]) -> tuple[StereoRig, Sequence[Any]]:
        """The rig, and the pictures without distortion."""
        if not self.raw:
            return StereoRig.from_camera_info(*cameras), pictures
        key = tuple(str(camera) for camera in cameras)
        if self._rectifier is None or self._rectifier[0] != key:
            self._rectifier = key, Rectifier(*cameras)
        return self._rectifier[1].rig, self._rectifier[1].apply(pictures[0], pictures[1])


def _listed(recorded: dict[str, list[Any]]) -> str:
    """Topics of images, for a message."""
    images = [topic for topic, connections in recorded.items() if connections[0].msgtype.endswith('Image')]
    return ', '.join(images) or 'none of images'


def _camera_info(message: Any) -> SimpleNamespace:
    """A recorded camera_info with the names of ROS 2."""
    values: dict[str, Any] = {}
    for name, former in _FIELDS.items():
        value = getattr(message, name if hasattr(message, name) else former)
        values[name] = list(value) if name in 'dkrp' else value
    return SimpleNamespace(**values)
