"""What some nodes take in and give out, into a file, as it comes: messages stay as they were sent."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy

from msgs_py.node_runtime.runtime import spin_once

from ...settings import MESSAGES_KEPT, WAIT_S
from .mcap_file import McapFile

# What is taken in and worth keeping; all else that the nodes hear is what they say to each other.
INPUTS = ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage', 'sensor_msgs/msg/CameraInfo')
# What every node says, and pictures of results, which nobody would make if they were not recorded.
LEFT_OUT = ('/rosout', '/parameter_events', '/diagnostics', '/transition_event', '/debug_image', '/markers')
# Turns of the executor in which nothing comes, at the end: one may be the timer's.
IDLE_TURNS = 2


class Recorder(Node):
    """Writes the images that nodes take, and the results that they publish.

    Parameters
    ----------
    file : McapFile
        Ended by :meth:`finish`.
    nodes : sequence of Node
        Whose topics are recorded; they may get more of them later.
    **kwargs
        For rclpy's Node.
    """

    def __init__(self, file: McapFile, nodes: Sequence[Node], **kwargs: Any) -> None:
        super().__init__('recorder', **kwargs)
        self.file = file
        self._log: Any = self.get_logger()  # type: ignore[no-untyped-call]
        self._nodes = nodes
        self._known: set[str] = set()
        self._taken = 0
        self._look()
        self.create_timer(WAIT_S, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def finish(self, executor: Executor) -> None:
        """Write what has been sent and not been taken yet, and end the file; spun by nobody any more."""
        idle = 0
        while idle < IDLE_TURNS and self.context.ok():
            before = self._taken
            spin_once(self, executor, WAIT_S)
            idle = 0 if self._taken > before else idle + 1
        self.file.close()

    def _look(self) -> None:
        """Subscribe to what is new."""
        for node in self._nodes:
            asked = node.get_name(), node.get_namespace()
            for topic, kinds in self._topics(self.get_publisher_names_and_types_by_node, *asked):
                if not topic.endswith(LEFT_OUT):
                    self._listen(topic, kinds[0], True)
            for topic, kinds in self._topics(self.get_subscriber_names_and_types_by_node, *asked):
                if kinds[0] in INPUTS:
                    self._listen(topic, kinds[0], False)

    @staticmethod
    def _topics(ask: Callable[..., list[tuple[str, list[str]]]], name: str, namespace: str) -> Any:
        try:
            return ask(name, namespace)
        except Exception:  # rclpy has several types for a node that is not known yet, or no more
            return ()

    def _listen(self, topic: str, kind: str, is_result: bool) -> None:
        if topic in self._known:
            return
        self._known.add(topic)
        if not self.file.knows(kind):
            self._log.warning(f'{topic}: {kind} is not recorded: its definition does not come with ROS 2')
            return
        package, _, name = kind.split('/')
        message_type = getattr(import_module(f'{package}.msg'), name)
        # Some may wait: a file system may hold up a writer for a moment.
        quality = QoSProfile(depth=MESSAGES_KEPT, reliability=QoSReliabilityPolicy.BEST_EFFORT)
        if is_result:
            quality.reliability = QoSReliabilityPolicy.RELIABLE
            publishers = self.get_publishers_info_by_topic(topic)
            if publishers and all(
                one.qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL for one in publishers
            ):
                quality.durability = QoSDurabilityPolicy.TRANSIENT_LOCAL
        stamped = next(iter(message_type.get_fields_and_field_types()), '') == 'header'
        take = partial(self._take, topic, kind, stamped)
        self.create_subscription(message_type, topic, take, quality, raw=True)

    def _take(self, topic: str, kind: str, stamped: bool, data: bytes) -> None:
        """Write a message that is CDR, whose header, if it has one, comes first."""
        now = time.time_ns()
        self._taken += 1
        stamp = stamp_of(data) if stamped else now
        try:
            self.file.write_bytes(topic, kind, data, now, stamp)
        except OSError as error:
            self._log.error(f'{self.file.path}: {error}: nothing more is recorded')
            self._nodes = ()
            for subscription in list(self.subscriptions):
                self.destroy_subscription(subscription)


def stamp_of(data: bytes) -> int:
    """The stamp of a CDR message that begins with a header, nanoseconds.

    Examples
    --------
    >>> stamp_of(bytes([0, 1, 0, 0]) + (2).to_bytes(4, 'little') + (5).to_bytes(4, 'little'))
    2000000005
    """
    seconds, rest = struct.unpack_from('<iI' if data[1] & 1 else '>iI', data, 4)
    return int(seconds) * 10**9 + int(rest)
