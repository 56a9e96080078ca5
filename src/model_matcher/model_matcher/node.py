"""matcher_node: recovered features in, poses of known models out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseStamped
from rclpy.publisher import Publisher
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from csg_renderer.language.includes import models_folder
from msgs_py import FeatureSet, Interpretation
from msgs_py.codecs import (
    cloud_to_features,
    features_to_markers,
    pose_to_stamped,
    poses_to_array,
    poses_to_transforms,
    report_from_interpretations,
    transform_message_type,
)
from msgs_py.node_runtime.config import Config, parameter
from msgs_py.node_runtime.confinement import TrustedFolders
from msgs_py.node_runtime.runtime import GraphNode, StereoMessages, run_node
from msgs_py.renaming import without_effect

from .image_pose.views import Views
from .model.library import Library, load_library
from .node_views import ViewMemory, stamp_ns, views_of_cameras, views_of_pair
from .params import CONSTRAINTS, ENGINES, ORDERINGS, SCALES, SEARCHES, MatchParams, MatchResult
from .pipeline import compile_steps, survey
from .settings import MOST_CAMERAS, WAIT_FOR_IMAGES_S
from .tracking.compiling import compile_steps as image_steps

TOPIC = 'interpretations'
WATCH_PERIOD_S = 1.0
NO_TF = 'parameter tf: tf2_msgs is not installed (ros-jazzy-tf2-msgs), so nothing can be broadcast'
_DEFAULT = MatchParams()


@dataclass(frozen=True)
class MatcherConfig(Config):
    """Parameters of matcher_node."""

    models: tuple[str, ...] = parameter(
        (), 'Model files (.csg, .npz, .stl, .obj, .ply), folders of them, or names of models of csg_renderer'
    )
    model_folders: tuple[str, ...] = parameter(
        (),
        'Folders that models may be read from when they are changed at run time, besides those of the models given '
        'at the start and those of csg_renderer',
        read_only=True,
    )
    watch: bool = parameter(True, 'Read the models again when a file changes')
    search: str = parameter(_DEFAULT.search, 'Search method', choices=SEARCHES)
    engine: str = parameter(_DEFAULT.engine, 'Where the tree search runs', choices=ENGINES)
    ordering: str = parameter(_DEFAULT.ordering, 'Order of data pairs in the tree search', choices=ORDERINGS)
    constraints: tuple[str, ...] = parameter(CONSTRAINTS, 'Pairwise constraints of the tree search')
    scale: str = parameter(_DEFAULT.scale, 'Whether the data has absolute size', choices=SCALES)
    fracdev: float = parameter(
        _DEFAULT.fracdev,
        "Largest distance of a data end point from its model feature, as a fraction of the model's size",
        minimum=1e-6,
        maximum=0.5,
    )
    curvedev: float = parameter(
        _DEFAULT.curvedev,
        "Largest difference of radii, as a fraction of the model's largest",
        minimum=0.0,
        maximum=10.0,
    )
    max_cone_deg: float = parameter(
        _DEFAULT.max_cone_deg, "Cap of the uncertainty of an edge's direction", unit='deg', minimum=0.1, maximum=90.0
    )
    curve_cone_deg: float = parameter(
        _DEFAULT.curve_cone_deg, "Uncertainty of a curve's normal", unit='deg', minimum=0.1, maximum=90.0
    )
    err_scale: float = parameter(
        _DEFAULT.err_scale, 'Factor on the uncertainties that come with the features', minimum=0.0, maximum=100.0
    )
    overhang: float = parameter(
        _DEFAULT.overhang,
        'How far an edge may run past its model edge, as a fraction of its length',
        minimum=0.0,
        maximum=1.0,
    )
    min_matched: int = parameter(
        _DEFAULT.min_matched, 'Fewest distinct model features of an accepted interpretation', minimum=1, maximum=10000
    )
    max_interpretations: int = parameter(
        _DEFAULT.max_interpretations, 'Most interpretations reported for a model', minimum=1, maximum=1000
    )
    false_alarm_rate: float = parameter(
        _DEFAULT.false_alarm_rate,
        'Accepted share of scenes in which an absent model is reported; sets the evidence that an interpretation needs',
        minimum=0.0,
        maximum=1.0,
    )
    prove: bool = parameter(False, 'Certify that no larger interpretation exists')
    time_limit: float = parameter(
        2.0, 'Time for one message and model; the best so far is taken then', unit='s', minimum=0.001, maximum=3600.0
    )
    use_images: bool = parameter(
        True,
        'Take the rectified images that the features were recovered from, when they are published: what they show of a '
        'model counts, and poses are measured in them. Turn it off where the image topics carry raw images',
    )
    cameras: int = parameter(
        2,
        'How many cameras there are; of three and more the topics are camera_0/image_rect, camera_0/camera_info, ...',
        minimum=2,
        maximum=MOST_CAMERAS,
        read_only=True,
    )
    tf: bool = parameter(False, 'Broadcast the best pose of each model on /tf (needs tf2_msgs)')
    tf_prefix: str = parameter('', "Put before the model's name to make its frame")
    seed: int = parameter(0, 'Deprecated: has no effect', minimum=0, maximum=2**31 - 1)

    def match_params(self) -> MatchParams:
        """The parameters of a match; raises ValueError, naming the parameter."""
        return MatchParams(
            search=self.search,
            engine=self.engine,
            ordering=self.ordering,
            constraints=self.constraints,
            scale=self.scale,
            fracdev=self.fracdev,
            curvedev=self.curvedev,
            max_cone_deg=self.max_cone_deg,
            curve_cone_deg=self.curve_cone_deg,
            err_scale=self.err_scale,
            overhang=self.overhang,
            min_matched=self.min_matched,
            max_interpretations=self.max_interpretations,
            false_alarm_rate=self.false_alarm_rate,
            prove=self.prove,
            time_limit_s=self.time_limit,
        )

    def validate(self) -> None:
        """Raise ValueError, naming the parameter, when they do not go together."""
        try:
            self.match_params()
        except ValueError as error:
            raise ValueError(f'parameter {error}') from None


class MatcherNode(GraphNode[MatcherConfig]):
    """Publishes what it recognises in every ``features`` message; an empty PoseArray when that is nothing."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('matcher_node', MatcherConfig, **kwargs)
        self._array_out = self.create_output(PoseArray, TOPIC)
        self._report_out = self.create_output(DiagnosticArray, f'{TOPIC}/report')
        self._markers_out = self.create_output(MarkerArray, f'{TOPIC}/markers')
        self._pose_out: dict[str, Publisher] = {}
        self._transforms_out: Publisher | None = None
        self._transforms_type = transform_message_type()
        self._reason = ''
        self._looked_at = time.monotonic()
        self._library = Library((), (), {})
        self._params = self.config.match_params()
        self._trusted = TrustedFolders(
            [*self.config.model_folders, models_folder()], self.config.models, 'model_folders'
        )
        self._warn_of_seed()
        self._load()
        self.prepare((*compile_steps(self._params, len(self._library.models)), *image_steps()))
        self._start_transforms()
        self._images = ViewMemory()
        self._waiting: tuple[PointCloud2, float] | None = None
        self._seen = 0
        if self.config.cameras == 2:
            self.listen_stereo(self._on_pair, optional=True)
        else:
            self.listen_cameras(self.config.cameras, self._on_cameras, optional=True)
        self.listen(PointCloud2, 'features', self._on_features)
        self.create_timer(WAIT_FOR_IMAGES_S, self._wait_no_longer, clock=self._steady_clock)

    # -- configuration -----------------------------------------------------------------------------------------

    def check_config(self, new: MatcherConfig) -> None:
        """Raise ValueError for a change that cannot be made: no tf messages, or models from elsewhere."""
        if new.tf and not self.config.tf and self._transforms_type is None:
            raise ValueError(NO_TF)
        for given in set(new.models) - set(self.config.models):
            try:
                self._trusted.check(given)
            except ValueError as error:
                raise ValueError(f'parameter models: {error}') from None

    def on_config(self, old: MatcherConfig, new: MatcherConfig) -> None:
        """Take over what was changed."""
        self._params = new.match_params()
        if new.seed != old.seed:
            self._warn_of_seed()
        if new.tf != old.tf:
            self._start_transforms()
        if new.models != old.models:
            self._load()

    def _warn_of_seed(self) -> None:
        if self.config.seed:
            self.get_logger().warning(without_effect('parameter', 'seed'))

    def reset(self) -> str:
        """Read the models again; says what was reset."""
        self._load()
        self._images.clear()
        self._waiting, self._seen = None, 0
        return f'counters, images, and {len(self._library)} models read again'

    def _load(self) -> None:
        """Read the models; what cannot be used is reported by name and left out."""
        self._library = load_library(self.config.models)
        for problem in self._library.problems:
            self.problem(f'models: {problem}')
        if not self.config.models:
            self.problem('parameter models: empty, expected model files, folders or names')
        names = {model.name for model in self._library.models}
        for name in set(self._pose_out) - names:
            self.destroy_publisher(self._pose_out.pop(name))
        for name in sorted(names - set(self._pose_out)):
            self._pose_out[name] = self.create_output(PoseStamped, f'{TOPIC}/{_topic_name(name)}')

    def _start_transforms(self) -> None:
        """Begin or end broadcasting, as the parameter says."""
        if self._transforms_out is not None:
            self.destroy_publisher(self._transforms_out)
            self._transforms_out = None
        if not self.config.tf:
            return
        if self._transforms_type is None:
            self.problem(NO_TF)
            return
        self._transforms_out = self.create_publisher(self._transforms_type, '/tf', 100)

    def _look_for_changes(self) -> None:
        now = time.monotonic()
        if self.config.watch and now - self._looked_at >= WATCH_PERIOD_S:
            self._looked_at = now
            if self._library.changed():
                self._load()

    # -- work --------------------------------------------------------------------------------------------------

    def _on_pair(self, messages: StereoMessages) -> None:
        if self.config.use_images:
            self._keep(stamp_ns(messages.left.header), views_of_pair(messages))

    def _on_cameras(self, messages: Sequence[tuple[Image, CameraInfo]]) -> None:
        if self.config.use_images:
            self._keep(stamp_ns(messages[0][0].header), views_of_cameras(messages))

    def _keep(self, stamp: int, views: Views) -> None:
        """Remember images; features that waited for them, or for older ones, wait no longer."""
        self._images.keep(stamp, views)
        if self._waiting is not None and stamp >= stamp_ns(self._waiting[0].header):
            self._answer_waiting()

    def _on_features(self, message: PointCloud2) -> None:
        """Features, with the images of their stamp; they wait a moment when images come that are not there yet."""
        self._answer_waiting()
        newest = self._images.newest
        if self.config.use_images and newest is not None and newest < stamp_ns(message.header):
            self._waiting = message, time.monotonic()
        else:
            self._recognise(message)

    def _wait_no_longer(self) -> None:
        if self._waiting is not None and time.monotonic() - self._waiting[1] >= WAIT_FOR_IMAGES_S:
            self._images.clear()  # they may have ended: what follows waits only when they come again
            self._answer_waiting()

    def _answer_waiting(self) -> None:
        if self._waiting is not None:
            (message, _), self._waiting = self._waiting, None
            self._guard('features', self._recognise)(message)

    def _recognise(self, message: PointCloud2) -> None:
        self._look_for_changes()
        data = cloud_to_features(message)
        views = self._images.at(stamp_ns(message.header)) if self.config.use_images else None
        self._seen += views is not None
        result = survey(self._library.models, data, self._params, views)
        self._reason = result.reason or ''
        self._publish(result, message.header)
        self.done(message.header)

    def _publish(self, result: MatchResult, header: Any) -> None:
        best: dict[str, Interpretation] = {}
        for one in result.interpretations:
            best.setdefault(one.model, one)
        for name, one in best.items():
            self._pose_out[name].publish(pose_to_stamped(one.pose, header))
        if self._transforms_out is not None and self._transforms_type is not None and best:
            frames = {self.config.tf_prefix + name: one.pose for name, one in best.items()}
            self._transforms_out.publish(self._transforms_type(transforms=poses_to_transforms(frames, header)))
        self._report_out.publish(report_from_interpretations([*result.interpretations, *result.rejected], header))
        if self.wanted(self._markers_out):
            self._markers_out.publish(self._markers(result, header))
        self._array_out.publish(poses_to_array([one.pose for one in result.interpretations], header))

    def _markers(self, result: MatchResult, header: Any) -> MarkerArray:
        """Wire frames of what was accepted; the array begins by deleting the last ones."""
        features = {model.name: model.features for model in self._library.models}
        markers = features_to_markers(FeatureSet.empty(), header, TOPIC)
        for number, one in enumerate(result.interpretations):
            placed = features[one.model].transformed(one.pose)
            markers.markers += features_to_markers(placed, header, f'{one.model}/{number}', clear=False).markers
        return markers

    # -- health ------------------------------------------------------------------------------------------------

    def why_silent(self) -> str | None:
        """What keeps the node from finding anything; None when nothing does."""
        if not self._library.models:
            return 'no model is loaded: ' + ('; '.join(self._library.problems) or 'parameter models is empty')
        return None

    def report_values(self) -> dict[str, object]:
        """What diagnostics say besides the counters."""
        return {
            'models': ', '.join(model.name for model in self._library.models),
            'unusable_models': '; '.join(self._library.problems),
            'why_nothing_found': self._reason,
            'with_images': self._seen,
        }


def _topic_name(name: str) -> str:
    """The last part of a model's topic; 'report' and 'markers' are taken."""
    return f'{name}_model' if name in ('report', 'markers') else name


def main(args: list[str] | None = None) -> int:
    """Run the node until it is told to stop; the exit status."""
    return run_node(MatcherNode, args)


if __name__ == '__main__':
    raise SystemExit(main())
