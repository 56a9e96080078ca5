"""tracker_node: follows known objects from image to image, from where matcher_node found them."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped
from std_msgs.msg import Header

from csg_renderer.mesh.units import GUESS, MESH_UNITS
from msgs_py import Interpretation, Pose
from msgs_py.codecs import interpretations_from_report, pose_from_message, pose_to_message
from msgs_py.node_runtime.camera_input import CameraImages, CameraTopics, cameras_parameter
from msgs_py.node_runtime.config import parameter
from msgs_py.node_runtime.runtime import run_node
from msgs_py.node_runtime.settings import NANOSECONDS
from msgs_py.node_runtime.stamp_sync import stamp_ns

from .image_pose.sight import Sight
from .image_pose.views import Views
from .model.index import ModelIndex
from .model_node import ModelConfig, ModelNode
from .node_views import ViewMemory, views_of
from .settings import NAMED_MODELS
from .tracking.compiling import compile_steps
from .tracking.settings import ACCELERATION
from .tracking.tracker import Tracked, Tracker, TrackParams

TOPIC = 'tracked'


@dataclass(frozen=True)
class TrackerConfig(ModelConfig):
    """Parameters of tracker_node."""

    models: tuple[str, ...] = parameter(
        (),
        'Model files (.csg, .stl, .obj, .ply), folders of them, or names of models of csg_renderer; of each one '
        'object is followed',
    )
    mesh_units: str = parameter(
        GUESS, 'Unit of mesh files, which do not say it; a guess goes by their size', choices=MESH_UNITS
    )
    cameras: int = cameras_parameter(1)
    acceleration: float = parameter(
        ACCELERATION,
        'Sigma of the acceleration of any point of an object, until its own is learnt',
        unit='m/s^2',
        minimum=1e-3,
        maximum=1e3,
    )
    tf: bool = parameter(False, 'Broadcast the pose of each followed object, and its frames, on /tf (needs tf2_msgs)')
    sync_queue_size: int = parameter(
        5, 'Sets of images that may wait for the rest', name='sync.queue_size', minimum=1, maximum=100, read_only=True
    )
    sync_tolerance: float = parameter(
        0.0,
        'Largest difference of stamps in a set',
        name='sync.tolerance',
        unit='s',
        minimum=0.0,
        maximum=1.0,
        read_only=True,
    )

    def validate(self) -> None:
        """Raise ValueError, naming the parameter, when they do not go together."""
        CameraTopics.of(self, self.cameras)


@dataclass
class _Followed:
    """An object that is followed, the stamp (nanoseconds) of its last frame and what was found there."""

    tracker: Tracker
    stamp: int
    last: Tracked | None = None

    def take(self, stamp: int, views: Views, nearer: Sequence[Sight] = ()) -> None:
        """Take in a frame; one that was taken before, or is older, is left out."""
        if stamp > self.stamp or self.last is None:
            self.last = self.tracker.step(views, max(stamp - self.stamp, 0) / NANOSECONDS, nearer=nearer)
            self.stamp = stamp

    @property
    def depth(self) -> float:
        """Metres, of its middle."""
        pose = None if self.last is None else self.last.pose
        return math.inf if pose is None else float(pose.apply(self.tracker.shape.centre)[2])


class TrackerNode(ModelNode[TrackerConfig]):
    """Publishes the pose of every object that it follows at the rate of the images."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('tracker_node', TrackerConfig, **kwargs)
        self._starts: dict[str, Any] = {}
        self._models: dict[str, ModelIndex] = {}
        self._followed: dict[str, _Followed] = {}
        self._images = ViewMemory()
        self._without_shape: set[str] = set()
        self._lost = 0
        self.start()

    # -- its life ----------------------------------------------------------------------------------------------

    def configure(self) -> None:
        """Make the outputs, read the models, and compile."""
        self._report_out = self.create_output(DiagnosticArray, f'{TOPIC}/report')
        self._load()
        self._start_transforms()
        self.prepare(compile_steps())

    def unusable(self) -> str:
        """No model that can be followed, or a parameter that was refused. See ManagedNode."""
        return super().unusable() or self.why_silent() or ''

    def activate(self) -> None:
        """Subscribe."""
        self._hear_starts()
        queue = self.config.sync_queue_size, self.config.sync_tolerance
        self.listen_images(CameraTopics.of(self.config, self.config.cameras), self._on_images, *queue)
        self.listen(DiagnosticArray, 'interpretations/report', self._on_report, optional=True)

    def deactivate(self) -> None:
        """Follow nothing more."""
        self._starts.clear()
        self._images.clear()
        self._followed.clear()

    def cleanup(self) -> None:
        """Forget the models."""
        super().cleanup()
        self._models, self._lost = {}, 0

    # -- configuration -----------------------------------------------------------------------------------------

    def on_config(self, old: TrackerConfig, new: TrackerConfig) -> None:
        """Take over what was changed."""
        super().on_config(old, new)
        if (new.models, new.mesh_units) != (old.models, old.mesh_units):
            self._load()

    def reset(self) -> str:
        """Read the models again and follow nothing; says what was reset."""
        self._images.clear()
        self._followed.clear()
        self._lost = 0
        self._load()
        return f'counters, images, what was followed, and {len(self._models)} models read again'

    def _load(self) -> None:
        """Read the models; what cannot be used is reported by name and left out."""
        self._models, self._without_shape = {}, set()
        if not self._open_index():
            self._read_library(self.config.mesh_units)
        for model in self._library.models:
            self._add(model)
        self._make_topics()

    def _add(self, model: ModelIndex) -> None:
        """A model can be followed, where more is known than its features."""
        if model.shape is not None:
            self._models[model.name] = model
        elif model.name not in self._without_shape:
            self._without_shape.add(model.name)
            self.problem(f'models: {model.name}: no solid is known of it, only features: it cannot be followed')

    def _make_known(self, name: str) -> None:
        """A model of an index is known from its first pose on; what was found long ago and is lost is forgotten."""
        if self._catalogue is None or name in self._models or name in self._without_shape:
            return
        try:
            number = self._catalogue.number(name)
        except KeyError:
            self.problem(f'interpretations/report: {name} is found, which parameter models does not have')
            return
        self._add(self._catalogue.outlined(self._catalogue.model(number)))
        lost = [one for one in self._models if one not in self._held() and one != name]
        for old in lost[: max(len(self._models) - NAMED_MODELS, 0)]:
            del self._models[old]
        self._make_topics()

    def _index_lost(self) -> None:
        """See ModelNode."""
        self._models = {}
        self._make_topics()

    def _make_topics(self) -> None:
        """Make the topics of models that are known, and follow no others."""
        for name in set(self._pose_out) - set(self._models):
            self.destroy_publisher(self._pose_out.pop(name))
            if name in self._starts:
                self.destroy_subscription(self._starts.pop(name))
        for name in sorted(set(self._models) - set(self._pose_out)):
            self._pose_out[name] = self.create_output(PoseWithCovarianceStamped, f'{TOPIC}/{topic_name(name)}')
        if self.active:
            self._hear_starts()
        self._followed = {name: one for name, one in self._followed.items() if name in self._models}

    def _hear_starts(self) -> None:
        """Subscribe to the poses that users give, of models that are not heard of yet."""
        for name in sorted(set(self._models) - set(self._starts)):
            self._starts[name] = self.listen(
                PoseWithCovarianceStamped, f'track/{topic_name(name)}', partial(self._on_start, name), optional=True
            )

    # -- what to follow ------------------------------------------------------------------------------------------

    def _on_report(self, message: DiagnosticArray) -> None:
        """Begin to follow what was found and is not followed already."""
        for one in interpretations_from_report(message):
            followed = self._followed.get(one.model)
            if one.accepted and (followed is None or followed.tracker.pose is None):
                self._make_known(one.model)
                self._begin(one.model, one, stamp_ns(message.header))

    def _on_start(self, name: str, message: PoseWithCovarianceStamped) -> None:
        """Follow an object from a pose that a user gives."""
        pose = pose_from_message(message.pose.pose)
        covariance = np.array(message.pose.covariance, float).reshape(6, 6)
        nothing = np.zeros(0, np.int32), np.zeros(0, np.int8)
        given = Interpretation(name, *nothing, pose, covariance=covariance if covariance.any() else None)
        self._begin(name, given, stamp_ns(message.header))

    def _begin(self, name: str, start: Interpretation, stamp: int) -> None:
        """Follow an object from a pose of an earlier frame, through all images since then."""
        model = self._models.get(name)
        if model is None or model.shape is None or start.pose.scale != 1.0:
            return
        since = self._images.since(stamp)
        params = TrackParams(acceleration=self.config.acceleration)
        followed = _Followed(Tracker(model.shape, start, params), stamp)
        for when, views in since:
            followed.take(when, views)
        self._followed[name] = followed

    # -- work --------------------------------------------------------------------------------------------------

    def _on_images(self, images: CameraImages) -> None:
        self._follow(views_of(images), images.header)

    def _follow(self, views: Views, header: Header) -> None:
        """One set of images: every object, the nearest first, for it hides the others."""
        stamp = stamp_ns(header)
        newest = self._images.newest
        if newest is not None and stamp < newest:
            self._followed.clear()  # the clock was set back: nobody knows how long ago the last frame was
        self._images.keep(stamp, views)
        nearer: list[Sight] = []
        poses: dict[str, Pose] = {}
        for name, followed in sorted(self._followed.items(), key=lambda one: one[1].depth):
            held = followed.tracker.pose is not None
            followed.take(stamp, views, nearer)
            last = followed.last
            if last is None or last.pose is None:
                self._lost += held
                continue
            nearer.append(last.presence.sight)
            poses[name] = last.pose
            self._publish(name, last, last.pose, header)  # at once: others take as long again
        self._broadcast(poses, self._models, header)
        if self.wanted(self._report_out):
            status = [_status(name, self._followed.get(name)) for name in self._models]
            self._report_out.publish(DiagnosticArray(header=header, status=status))
        self.done(header)

    def _publish(self, name: str, last: Tracked, pose: Pose, header: Header) -> None:
        """The pose of one object."""
        message = PoseWithCovarianceStamped(header=header)
        message.pose.pose = pose_to_message(pose)
        message.pose.covariance = last.covariance.ravel()
        self._pose_out[name].publish(message)

    # -- health ------------------------------------------------------------------------------------------------

    def why_silent(self) -> str | None:
        """What keeps the node from following anything; None when nothing does."""
        if not self._models and self._catalogue is None:
            return 'no model can be followed: ' + ('; '.join(self._library.problems) or 'parameter models is empty')
        return None

    def _held(self) -> dict[str, Tracked | None]:
        """What is followed now, by the names of models."""
        return {name: one.last for name, one in self._followed.items() if one.tracker.pose is not None}

    def report_values(self) -> dict[str, object]:
        """What diagnostics say besides the counters."""
        held = self._held()
        of_index = '' if self._catalogue is None else f' of the {len(self._catalogue)} of an index'
        return {
            'models': ', '.join(self._models) + of_index,
            'followed': ', '.join(held),
            'not_followed': ', '.join(name for name in self._models if name not in held),
            'times_lost': self._lost,
            **{f'support.{name}': f'{one.presence.support:.2f}' for name, one in held.items() if one is not None},
        }


def _status(name: str, followed: _Followed | None) -> DiagnosticStatus:
    """State and quality of one object in a frame; values are JSON, as those of the matcher's report."""
    last = None if followed is None else followed.last
    if last is None:
        return DiagnosticStatus(level=DiagnosticStatus.STALE, name=name, message='not found yet')
    shift, turn = np.split(np.sqrt(np.maximum(np.diag(last.covariance), 0.0)), 2)
    values = {
        'support': last.presence.support,
        'evidence': last.presence.log_ratio if math.isfinite(last.presence.log_ratio) else None,
        'log_odds': last.log_odds if math.isfinite(last.log_odds) else None,
        'sigma_m': float(np.linalg.norm(shift)),
        'sigma_deg': float(np.degrees(np.linalg.norm(turn))),
        'velocity_m_s': last.twist[:3].tolist(),
        'angular_velocity_rad_s': last.twist[3:].tolist(),
        'search_px': last.search_px,
    }
    return DiagnosticStatus(
        level=DiagnosticStatus.OK if last.pose is not None else DiagnosticStatus.WARN,
        name=name,
        message='followed' if last.pose is not None else f'lost: {last.reason}',
        values=[KeyValue(key=key, value=json.dumps(value)) for key, value in values.items()],
    )


def topic_name(name: str) -> str:
    """The last part of a model's topic; 'report' is taken."""
    return f'{name}_model' if name == 'report' else name


def main(args: list[str] | None = None) -> int:
    """Run the node until it is told to stop; the exit status."""
    return run_node(TrackerNode, args)


if __name__ == '__main__':
    raise SystemExit(main())
