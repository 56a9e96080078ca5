"""viewer_node: what the graph sees and finds, as a page that a browser of this machine shows while it happens."""

from __future__ import annotations

import math
import sys
import time
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from msgs_py import FeatureSet, Interpretation
from msgs_py.codecs import cloud_to_features, interpretations_from_report, pose_from_message
from msgs_py.node_runtime.camera_input import CameraConfig, CameraImages, CameraTopics, cameras_parameter
from msgs_py.node_runtime.config import parameter
from msgs_py.node_runtime.runtime import GraphNode, run_node
from msgs_py.node_runtime.settings import NANOSECONDS
from msgs_py.node_runtime.stamp_sync import stamp_ns

from .node_views import views_of
from .settings import MESSAGES_KEPT
from .tracker_node import topic_name
from .viewing.moments import Moment, Placed, moment_record, placed_objects
from .viewing.page import page_of
from .viewing.server import PageServer
from .viewing.settings import PORT, SILENT_S

Lines = list[list[list[float]]]
# What a moment is made of; each comes on topics of its own.
IMAGES, FEATURES, FOUND, WIRES, FOLLOWED = 'images', 'features', 'found', 'wires', 'followed'
# Those that a moment waits for; what is followed comes with some.
AWAITED = (IMAGES, FEATURES, FOUND, WIRES)


@dataclass(frozen=True)
class ViewerConfig(CameraConfig):
    """Parameters of viewer_node."""

    port: int = parameter(
        PORT,
        'Where on this machine the page is: http://localhost:PORT/; 0 for any port that is free',
        minimum=0,
        maximum=65535,
        read_only=True,
    )
    cameras: int = cameras_parameter(1)

    def validate(self) -> None:
        """Raise ValueError, naming the parameter, when they do not go together."""
        CameraTopics.of(self, self.cameras)


class ViewerNode(GraphNode[ViewerConfig]):
    """Serves a page with the newest moment of which all has come that comes at all.

    Parameters
    ----------
    **kwargs
        For rclpy's Node.

    Raises
    ------
    ValueError
        The port cannot be had, or what draws the page is not installed.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('viewer_node', ViewerConfig, **kwargs)
        self._parts: OrderedDict[int, dict[str, Any]] = OrderedDict()
        self._heard: dict[str, float] = {}
        self._lines: dict[str, Lines] = {}
        self._tracked: dict[str, Any] = {}
        self._shown = -1
        try:
            self.server = PageServer(page_of(f'live: {self.get_namespace()}', {}, None), self.config.port)
        except ValueError:
            self.destroy_node()
            raise
        self.start()
        self.get_logger().info(f'open {self.server.url}')

    def activate(self) -> None:
        """Subscribe to all that may be shown."""
        topics = CameraTopics.of(self.config, self.config.cameras)
        self.listen_images(topics, self._on_images, MESSAGES_KEPT, optional=True)
        self.listen(PointCloud2, 'features', self._on_features, optional=True)
        self.listen(DiagnosticArray, 'interpretations/report', self._on_report, optional=True)
        self.listen(MarkerArray, 'interpretations/markers', self._on_markers, optional=True)

    def deactivate(self) -> None:
        """Forget what has come."""
        self._tracked.clear()
        self.reset()

    def destroy_node(self) -> None:
        """Also ends the page."""
        if hasattr(self, 'server'):
            self.server.close()
        super().destroy_node()

    def reset(self) -> str:
        """Forget what has come; the page keeps its last moment until there is another."""
        self._parts.clear()
        self._heard.clear()
        self._shown = -1
        return 'counters and what was waiting for the rest of its moment'

    def why_silent(self) -> str | None:
        """That nothing at all has come."""
        if self._heard:
            return None
        return 'nothing received on the image topics, features or interpretations/report'

    def report_values(self) -> dict[str, object]:
        """What diagnostics say besides the counters."""
        return {'url': self.server.url, 'coming': ', '.join(sorted(self._coming()))}

    # -- what comes --------------------------------------------------------------------------------------------

    def _on_images(self, images: CameraImages) -> None:
        self._take(images.header, IMAGES, views_of(images))

    def _on_features(self, message: PointCloud2) -> None:
        self._take(message.header, FEATURES, cloud_to_features(message))

    def _on_report(self, message: DiagnosticArray) -> None:
        every = interpretations_from_report(message)
        for name in {one.model for one in every if one.accepted} - set(self._tracked):
            topic = f'tracked/{topic_name(name)}'
            heard = partial(self._on_tracked, name)
            self._tracked[name] = self.listen(PoseWithCovarianceStamped, topic, heard, optional=True)
        self._take(message.header, FOUND, every)

    def _on_tracked(self, name: str, message: PoseWithCovarianceStamped) -> None:
        spread = np.array(message.pose.covariance, float).reshape(6, 6)
        placed = Placed(f'{name}, followed', name, pose_from_message(message.pose.pose), spread)
        followed = self._parts.get(stamp_ns(message.header), {}).get(FOLLOWED, ())
        self._take(message.header, FOLLOWED, (*followed, placed))

    def _on_markers(self, message: MarkerArray) -> None:
        """The lines of a model are those of its markers, taken from where its first accepted pose put them."""
        if not message.markers:
            return
        header = message.markers[0].header
        accepted = [one for one in self._parts.get(stamp_ns(header), {}).get(FOUND, ()) if one.accepted]
        placed = {f'{one.model}/{number}': one for number, one in enumerate(accepted)}
        lines: dict[str, Lines] = {}
        first: dict[str, str] = {}
        for marker in message.markers:
            space = marker.ns.rpartition('/')[0]
            one = placed.get(space)
            if marker.points and one is not None and first.setdefault(one.model, space) == space:
                ends = np.array([[point.x, point.y, point.z] for point in marker.points])
                lines.setdefault(one.model, []).extend(one.pose.inverse().apply(ends).reshape(-1, 2, 3).tolist())
        self._lines |= lines
        self._take(header, WIRES, True)

    # -- moments -----------------------------------------------------------------------------------------------

    def _coming(self) -> set[str]:
        """What has come a short while ago, and so is worth waiting for."""
        now = time.monotonic()
        return {kind for kind in AWAITED if now - self._heard.get(kind, -math.inf) < SILENT_S}

    def _take(self, header: Any, kind: str, part: Any) -> None:
        """Add a part to the moment of its stamp, and show that when it is whole and the newest."""
        stamp = stamp_ns(header)
        if stamp < self._shown - NANOSECONDS * SILENT_S:
            self.reset()  # the clock was set back
        self._heard[kind] = time.monotonic()
        parts = self._parts.setdefault(stamp, {})
        parts[kind] = part
        while len(self._parts) > MESSAGES_KEPT:
            self._parts.popitem(last=False)
        if stamp >= self._shown and self._coming() <= set(parts):
            self._shown = stamp
            moment, lines = moment_of_parts(stamp, parts), dict(self._lines)
            self.server.show(lambda: moment_record(moment) | {'models': lines})
            self.done(header)


def moment_of_parts(stamp: int, parts: Mapping[str, Any]) -> Moment:
    """The moment of a stamp, nanoseconds, of what has come of it."""
    every: list[Interpretation] = parts.get(FOUND, [])
    placed = placed_objects(one for one in every if one.accepted)
    words = '' if placed or not every else f'{every[0].model}: {every[0].rejected_reason}'
    features = parts.get(FEATURES, FeatureSet.empty())
    return Moment(stamp / NANOSECONDS, parts.get(IMAGES), features, (*placed, *parts.get(FOLLOWED, ())), words)


def main(args: list[str] | None = None) -> int:
    """Run the node until it is told to stop; the exit status, 2 when the page cannot be served."""
    try:
        return run_node(ViewerNode, args)
    except ValueError as error:
        print(
            f'viewer_node: parameter {error}' if str(error).startswith('port') else f'viewer_node: {error}',
            file=sys.stderr,
        )
        return 2


if __name__ == '__main__':
    raise SystemExit(main())
