"""One closed-form test: all nodes in one process, one stereo pair, every stage compared with the truth.

The nodes are the ones a user runs, on a real executor over real topics; the context and the namespace are private, so
that no other process exchanges messages with them. The only module of this room that imports ROS.
"""

from __future__ import annotations

import random
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image, PointCloud2
from std_srvs.srv import Trigger

from csg_renderer.language import find_scene
from csg_renderer.node import RendererNode
from csg_renderer.stereo_pictures import frames_of, sensor_images
from dap_emulator.node import EmulatorNode
from msgs_py import FeatureSet, Interpretation, StereoRig, codecs
from msgs_py.node_runtime.stamp_sync import stamp_ns
from stereo_recovery.node import RecoveryNode

from ..model.library import safe_name
from ..node import MatcherNode
from ..settings import WAIT_S
from .array_machine import roberts_through_service
from .camera_options import camera_config, camera_values
from .case import Case
from .comparison import compare_edges, surface_residual
from .result import CaseResult, judge
from .scene_files import prepare
from .settings import TIMEOUT_S

# What a node needs to take raw images in place of rectified ones.
RAW = ['--ros-args', *(word for side in ('left', 'right') for word in ('-r', f'{side}/image_rect:={side}/image_raw'))]


def run_case(
    case: Case, progress: Callable[[str], None] = lambda stage: None, folder: Path | None = None
) -> CaseResult:
    """Run one test through the nodes.

    Parameters
    ----------
    case : Case
        What to test.
    progress : callable
        Called with the name of each stage (:data:`~model_matcher.closed_form.case.STAGES`) that is over.
    folder : Path, optional
        Where the scene file of a case that sets pose or clutter is written; a temporary one when not given.

    Returns
    -------
    CaseResult
        Also when nothing was recognised.

    Raises
    ------
    ValueError, OSError
        For a scene that cannot be used, or a node that does not answer.
    """
    if folder is None:
        with tempfile.TemporaryDirectory() as temporary:
            return run_case(case, progress, Path(temporary))
    path, rig, scene, name, model, true_pose = prepare(case, folder)
    progress('scene')

    with GraphRun(case, path, rig) as run:
        progress('nodes')
        run.one_pair()  # its times include compiling; those reported are of the next
        messages = run.one_pair(progress)
        milliseconds = run.milliseconds()
        emulator = run.emulate(messages.left)
        progress('emulator')

    frames = frames_of(scene, rig, scene.camera_T_scene, camera_config(case))
    data = messages.features
    result = CaseResult(
        case,
        name,
        rig,
        true_pose,
        model,
        messages.true_features,
        data,
        messages.left,
        messages.right,
        edges=compare_edges(messages.true_features, data),
        surface_residual_m=surface_residual(scene, frames[0]),
        image_difference=run.image_difference(frames, messages),
        emulator=emulator,
        milliseconds=milliseconds,
    )
    mine = [item for item in messages.interpretations if item.model == safe_name(name)]
    judge(result, mine, messages.reason)
    progress('comparison')
    return result


@dataclass
class PairMessages:
    """What the graph said about one pair, decoded."""

    left: np.ndarray
    right: np.ndarray
    true_features: FeatureSet
    features: FeatureSet
    interpretations: list[Interpretation]
    reason: str


class GraphRun:
    """renderer_node, recovery_node, matcher_node and emulator_node in one process, and an observer."""

    def __init__(self, case: Case, scene: Path, rig: StereoRig) -> None:
        self.case, self.rig = case, rig
        self.pairs = 0
        self.camera = camera_config(case)
        # Behind lenses that distort the recovery sees the raw pair.
        self.raw = self.camera.lenses() is not None
        self.bits = self.camera.bits if self.camera.bits > 8 else 16
        self.scene, self.own_scene = str(scene), str(find_scene(case.scene))

    def __enter__(self) -> GraphRun:
        self.context = Context()
        # A namespace of its own keeps two tests on one machine apart, whatever the domain.
        namespace = f'/closed_form_{random.SystemRandom().randrange(10**9)}'
        rclpy.init(args=[], context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        case = self.case
        # A scene written for the case names its camera itself.
        size = {'width': case.width or 0, 'height': case.height or 0, 'focal': float(case.focal or 0.0)}
        parameters: dict[type, dict[str, Any]] = {
            RendererNode: dict(
                scene=self.scene,
                rate=0.0,
                baseline=self.rig.baseline,
                antialias=case.antialias,
                psf=case.psf,
                noise=case.noise,
                seed=case.seed,
                **{name: list(v) if isinstance(v, tuple) else v for name, v in camera_values(case.camera).items()},
                **(size if self.scene == self.own_scene else {}),
            ),
            RecoveryNode: {'rectify': self.raw, 'image_bits': self.bits},
            MatcherNode: {'models': [self.own_scene], 'time_limit': case.time_limit_s},
            EmulatorNode: {},
        }
        self.nodes: dict[str, Any] = {}
        for node_class, values in parameters.items():
            node = node_class(
                context=self.context,
                namespace=namespace,
                parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
                cli_args=RAW if node_class is RecoveryNode and self.raw else None,
            )
            self.nodes[node_class.__name__] = node
            self.executor.add_node(node)
        observer = self.observer = Node('observer', context=self.context, namespace=namespace)
        self.executor.add_node(observer)
        self.received: dict[str, list[Any]] = {}
        for message_type, topic in (
            (Image, 'left/image_rect'),
            (Image, 'right/image_rect'),
            (PointCloud2, 'features'),
            (PointCloud2, 'ground_truth/features'),
            (PoseArray, 'interpretations'),
            (DiagnosticArray, 'interpretations/report'),
        ):
            self.received[topic] = []
            observer.create_subscription(message_type, topic, self.received[topic].append, 10)
        self.trigger = observer.create_client(Trigger, 'renderer_node/render')
        self._spin_until(self.trigger.service_is_ready, 'the renderer')
        self._spin_until(self._connected, 'discovery of the nodes')
        return self

    def __exit__(self, *exception: object) -> None:
        for node in [*self.nodes.values(), self.observer]:
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()
        rclpy.try_shutdown(context=self.context)

    def one_pair(self, progress: Callable[[str], None] = lambda stage: None) -> PairMessages:
        """Ask for one pair and wait until the matcher has answered it."""
        for messages in self.received.values():
            messages.clear()
        answer = self.trigger.call_async(Trigger.Request())
        self._spin_until(answer.done, 'an image')
        reply = answer.result()
        if reply is None or not reply.success:
            raise ValueError(f'{self.case.scene}: {reply.message if reply else "no answer of the renderer"}')
        self.pairs += 1
        for topic, stage in (('right/image_rect', 'image'), ('features', 'features'), ('interpretations', 'pose')):
            self._spin_until(partial(self.received.__getitem__, topic), stage)
            progress(stage)
        self._spin_until(lambda: all(self.received.values()), 'ground truth and report')
        stamps = {stamp_ns(messages[-1].header) for messages in self.received.values()}
        if len(stamps) != 1:
            raise ValueError(f"{self.case.scene}: results carry {len(stamps)} different stamps, expected the pair's")
        report = self.received['interpretations/report'][-1]
        return PairMessages(
            codecs.gray_from_image(self.received['left/image_rect'][-1], self.bits),
            codecs.gray_from_image(self.received['right/image_rect'][-1], self.bits),
            codecs.cloud_to_features(self.received['ground_truth/features'][-1]),
            codecs.cloud_to_features(self.received['features'][-1]),
            list(codecs.interpretations_from_report(report)),
            '; '.join(status.message for status in report.status if status.message != codecs.reports.ACCEPTED),
        )

    def milliseconds(self) -> dict[str, float]:
        """What the last pair took in each node."""
        stages = {'render': 'RendererNode', 'recover': 'RecoveryNode', 'match': 'MatcherNode'}
        return {stage: round(1e3 * self.nodes[name].health.last_latency_s, 2) for stage, name in stages.items()}

    def emulate(self, image: np.ndarray) -> dict[str, Any]:
        """A small array program on the emulated DAP, through its service: Roberts' operator on part of the image."""
        name = self.nodes['EmulatorNode'].get_fully_qualified_name()
        return roberts_through_service(self.observer, self.executor, name, image)

    def image_difference(self, frames: Any, messages: PairMessages) -> int:
        """Pixels in which the node's left image differs from the library's, sensor model included."""
        config = self.nodes['RendererNode'].config
        expected = codecs.array_to_image(sensor_images(frames, config, self.pairs - 1)[0], config.encoding)
        return int((codecs.gray_from_image(expected, self.bits) != messages.left).sum())

    def _connected(self) -> bool:
        recovery, matcher = self.nodes['RecoveryNode'], self.nodes['MatcherNode']
        renderer = self.nodes['RendererNode']
        namespace = self.observer.get_namespace()

        def heard(node: Any, topic: str, count: int) -> bool:
            return bool(node.count_subscribers(f'{namespace}/{topic}') >= count)

        return (
            heard(renderer, 'left/image_rect', 1 if self.raw else 2)
            and heard(renderer, 'right/image_rect', 1 if self.raw else 2)
            and (not self.raw or all(heard(renderer, f'{side}/image_raw', 1) for side in ('left', 'right')))
            and heard(renderer, 'left/camera_info', 1)
            and heard(renderer, 'right/camera_info', 1)
            and heard(recovery, 'features', 2)
            and heard(matcher, 'interpretations', 1)
            and all(self.observer.count_publishers(f'{namespace}/{topic}') for topic in self.received)
        )

    def _spin_until(self, predicate: Callable[[], Any], what: str) -> None:
        deadline = time.monotonic() + TIMEOUT_S
        while not predicate():
            if time.monotonic() > deadline:
                problems = [
                    f'{name}: {node.health.last_error or node.silence() or "no complaint"}'
                    for name, node in self.nodes.items()
                ]
                raise ValueError(f'{self.case.scene}: waited {TIMEOUT_S:g} s for {what}; {"; ".join(problems)}')
            self.executor.spin_once(timeout_sec=WAIT_S)
