"""A sequence through the nodes of a user: its pairs and its truth on topics, frame by frame, and what the matcher says.

The next frame is published when the last one is answered, so that a slow machine answers all of them too. As run_graph,
this module imports ROS.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from typing import Any

import rclpy
from geometry_msgs.msg import PoseArray, PoseStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image

from csg_renderer.language import find_scene
from msgs_py import Pose
from msgs_py.codecs import array_to_image, camera_infos_from_rig, pose_to_stamped
from stereo_recovery.node import RecoveryNode

from ...model.library import safe_name
from ...node import MatcherNode
from ...settings import WAIT_S
from ..case import Case
from ..settings import TIMEOUT_S
from .sequence import Sequence, SequenceFrame

FRAME_ID = 'camera_left_optical_frame'


def play_sequence(
    case: Case, sequence: Sequence, progress: Callable[[str], None] = lambda stage: None
) -> list[Pose | None]:
    """Publish a sequence to recovery_node and matcher_node.

    Parameters
    ----------
    case : Case
        Names the scene, whose first object is looked for.
    sequence : Sequence
        What is published: the four stereo topics and ``ground_truth/pose``, stamped with the time of the frame.
    progress : callable
        Called after every frame.

    Returns
    -------
    list of Pose or None
        left_T_part that the matcher accepted in each frame.

    Raises
    ------
    ValueError
        A node does not answer.
    """
    with _Player(case, sequence) as player:
        found = []
        for frame in sequence:
            found.append(player.answer(frame))
            progress('frame')
    return found


class _Player:
    """recovery_node and matcher_node in one process, and a node that publishes a sequence to them."""

    def __init__(self, case: Case, sequence: Sequence) -> None:
        self.case, self.sequence = case, sequence

    def __enter__(self) -> _Player:
        self.context = Context()
        # A namespace of its own keeps two runs on one machine apart, whatever the domain.
        namespace = f'/sequence_{random.SystemRandom().randrange(10**9)}'
        rclpy.init(args=[], context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        matching = {'models': [str(find_scene(self.case.scene))], 'time_limit': self.case.time_limit_s}
        self.nodes: list[Any] = [
            RecoveryNode(context=self.context, namespace=namespace),
            MatcherNode(
                context=self.context,
                namespace=namespace,
                parameter_overrides=[Parameter(name, value=value) for name, value in matching.items()],
            ),
        ]
        player = self.player = Node('player', context=self.context, namespace=namespace)
        for node in (*self.nodes, player):
            self.executor.add_node(node)
        sides = ('left', 'right')
        self.images = [player.create_publisher(Image, f'{side}/image_rect', 2) for side in sides]
        self.infos = [player.create_publisher(CameraInfo, f'{side}/camera_info', 2) for side in sides]
        self.truth = player.create_publisher(PoseStamped, 'ground_truth/pose', 2)
        self.accepted: list[PoseStamped] = []
        self.answered: list[PoseArray] = []
        model = safe_name(self.sequence.name)
        player.create_subscription(PoseStamped, f'interpretations/{model}', self.accepted.append, 10)
        player.create_subscription(PoseArray, 'interpretations', self.answered.append, 10)
        self._spin_until(self._connected, 'discovery of the nodes')
        return self

    def __exit__(self, *exception: object) -> None:
        for node in (*self.nodes, self.player):
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()
        rclpy.try_shutdown(context=self.context)

    def answer(self, frame: SequenceFrame) -> Pose | None:
        """What the matcher accepts in a frame; the first one waits for the compiler."""
        # A stamp of 0 would say that there is none.
        whole = round(1e9 * (frame.stamp_s + 1.0))
        header = Image().header
        header.frame_id = FRAME_ID
        header.stamp.sec, header.stamp.nanosec = divmod(whole, 10**9)
        self.accepted.clear()
        self.answered.clear()
        self.truth.publish(pose_to_stamped(frame.pose, header))
        for publisher, info in zip(self.infos, camera_infos_from_rig(self.sequence.rig, header)):
            publisher.publish(info)
        for publisher, image in zip(self.images, frame.images):
            publisher.publish(array_to_image(image, 'mono8', header))
        self._spin_until(lambda: any(m.header.stamp == header.stamp for m in self.answered), f'frame {frame.number}')
        # The best pose of a model is published with the array, on a topic of its own.
        count = len(next(m for m in self.answered if m.header.stamp == header.stamp).poses)
        if count == 0:
            return None
        self._spin_until(lambda: any(m.header.stamp == header.stamp for m in self.accepted), f'pose {frame.number}')
        found = next(m for m in self.accepted if m.header.stamp == header.stamp).pose
        place, turn = found.position, found.orientation
        return Pose.from_quaternion([turn.x, turn.y, turn.z, turn.w], [place.x, place.y, place.z])

    def _connected(self) -> bool:
        publishers = (*self.images, *self.infos)
        heard = all(publisher.get_subscription_count() > 0 for publisher in publishers)
        return heard and all(
            self.player.count_publishers(f'{self.player.get_namespace()}/{topic}') > 0
            for topic in ('features', 'interpretations')
        )

    def _spin_until(self, predicate: Callable[[], Any], what: str) -> None:
        deadline = time.monotonic() + TIMEOUT_S
        while not predicate():
            if time.monotonic() > deadline:
                problems = '; '.join(
                    f'{node.get_name()}: {node.health.last_error or node.silence() or "no complaint"}'
                    for node in self.nodes
                )
                raise ValueError(f'{self.case.scene}: waited {TIMEOUT_S:g} s for {what}; {problems}')
            self.executor.spin_once(timeout_sec=WAIT_S)
