"""Messages into an MCAP file: what ros2 bag, Foxglove and any MCAP reader open.

rosbags makes CDR of messages and the text of their definitions, without ROS running; it writes bags as folders only,
so that the file itself is written by the mcap library, which is also what others check files with.
"""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from msgs_py.node_runtime.stamp_sync import stamp_ns

LIBRARY = 'model_matcher'


class McapFile:
    """A file that is written message by message; close it, or use it in a with statement.

    Parameters
    ----------
    path : Path
        A new file, .mcap.

    Raises
    ------
    OSError, ValueError
        It exists, is called otherwise or cannot be written, or a library is missing; begins with its name.
    """

    def __init__(self, path: Path) -> None:
        if path.suffix.lower() != '.mcap':
            raise ValueError(f'{path}: expected a name that ends in .mcap')
        if path.exists():
            raise ValueError(f'{path}: is there already: give another name, or remove it')
        try:
            from mcap.writer import Writer
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise ValueError(f'{path}: writing it needs {error.name} (pip install mcap rosbags)') from None
        self.path = path
        self._store: Any = get_typestore(Stores.ROS2_JAZZY)
        self._file = path.open('wb')
        self._writer: Any = Writer(self._file)
        self._writer.start(profile='ros2', library=LIBRARY)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}

    def knows(self, kind: str) -> bool:
        """Whether messages of a type ('sensor_msgs/msg/Image') can be written: those that come with ROS 2."""
        return kind in self._store.fielddefs

    def write(self, topic: str, message: Any, log_ns: int) -> None:
        """Write a message of ROS, with a header.

        Parameters
        ----------
        topic : str
            Absolute name.
        message : message of ROS
        log_ns : int
            Nanoseconds: where a player shows it.
        """
        kind = f'{type(message).__module__.split(".")[0]}/msg/{type(message).__name__}'
        data = self._store.serialize_cdr(self._converted(message, kind), kind)
        self.write_bytes(topic, kind, bytes(data), log_ns, stamp_ns(message.header))

    def write_bytes(self, topic: str, kind: str, data: bytes, log_ns: int, stamp_ns: int) -> None:
        """Write a message that is CDR already; stamp_ns : of its header, or when it was published, nanoseconds."""
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, 'cdr', self._schema(kind))
        count = self._counts[topic] = self._counts.get(topic, 0) + 1
        # Times of MCAP have no sign; a stamp that has one says nothing of when anything was.
        self._writer.add_message(self._channels[topic], max(log_ns, 0), data, max(stamp_ns, 0), count)

    def close(self) -> None:
        """Write the index, without which readers have to look through all of the file."""
        if not self._file.closed:
            self._writer.finish()
            self._file.close()

    def __enter__(self) -> McapFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _schema(self, kind: str) -> int:
        if kind not in self._schemas:
            text = self._store.generate_msgdef(kind, ros_version=2)[0]
            self._schemas[kind] = self._writer.register_schema(kind, 'ros2msg', text.encode())
        return self._schemas[kind]

    def _converted(self, message: Any, kind: str) -> Any:
        """A message of ROS as rosbags has it."""
        fields = self._store.fielddefs[kind][1]
        return self._store.types[kind](
            **{name: self._value(getattr(message, name), described) for name, described in fields}
        )

    def _value(self, value: Any, described: Any) -> Any:
        """A field's value; described : what rosbags says of it (its kind of node, and the type)."""
        node, detail = described
        if node.name == 'NAME':
            return self._converted(value, detail)
        if node.name == 'BASE':
            return value[0] if isinstance(value, bytes) else value  # a byte of rclpy's
        element = detail[0]
        if element[0].name == 'BASE' and element[1][0] != 'string':
            return np.asarray(value, np.dtype(element[1][0]))
        return [self._value(one, element) for one in value]
