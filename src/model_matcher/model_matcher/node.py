"""matcher_node: recovered features in, poses of known models out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from msgs_py import FeatureSet
from msgs_py.codecs import cloud_to_features
from msgs_py.node_runtime.adapted import Adapted
from msgs_py.node_runtime.beside import CHANGED_GRACE_S, ENDING_S, Beside
from msgs_py.node_runtime.camera_input import CameraImages, CameraTopics, cameras_parameter
from msgs_py.node_runtime.config import parameter
from msgs_py.node_runtime.runtime import run_node
from msgs_py.node_runtime.settings import SILENCE_S
from msgs_py.node_runtime.stamp_sync import stamp_ns
from msgs_py.numeric.deadline import Deadline
from msgs_py.renaming import without_effect

from .answering_node import AnsweringConfig, AnsweringNode
from .catalogue.catalogue import Share
from .image_pose.views import Views
from .model.equal_poses import canonical
from .model.library import working_distance
from .node_views import ViewMemory, views_of
from .params import CONSTRAINTS, ENGINES, ORDERINGS, SCALES, SEARCHES, MatchParams, MatchResult
from .pipeline import compile_steps, survey
from .settings import WAIT_S

_DEFAULT = MatchParams()


@dataclass(frozen=True)
class MatcherConfig(AnsweringConfig):
    """Parameters of matcher_node."""

    shard: str = parameter(
        '',
        'Share of the models that this node looks for, as 2/8 for the second of eight nodes; empty: all. merger_node '
        'puts the answers of all together',
    )
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
    prove: bool = parameter(False, 'Certify that no larger interpretation exists, or none of min_matched features')
    time_limit: float = parameter(
        2.0,
        'Time for one message, all models together; the best so far is taken then',
        unit='s',
        minimum=0.001,
        maximum=3600.0,
    )
    use_images: bool = parameter(
        True,
        'Take the rectified images that the features were recovered from, when they are published: what they show of a '
        'model counts, and poses are measured in them. Turn it off where the image topics carry raw images',
    )
    cameras: int = cameras_parameter(2)
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
        CameraTopics.of(self, self.cameras)
        try:
            Share.parse(self.shard)
            self.match_params()
        except ValueError as error:
            raise ValueError(f'parameter {error}') from None


class Recovered(NamedTuple):
    """Features of a message, its header, and the images that they were recovered from, where there are any."""

    header: Header
    data: FeatureSet
    views: Views | None


class MatcherNode(AnsweringNode[MatcherConfig]):
    """Publishes what it recognises in every ``features`` message; an empty PoseArray when that is nothing."""

    brief = True

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('matcher_node', MatcherConfig, **kwargs)
        self._reason = ''
        self._params = self.config.match_params()
        self._search = Beside(self, 'features', self._begin, self._finish)
        self._images = ViewMemory()
        self._waiting: tuple[PointCloud2 | Adapted[FeatureSet], float] | None = None
        self._seen = 0
        self.start()

    # -- its life ----------------------------------------------------------------------------------------------

    def configure(self) -> None:
        """Make the outputs, read the models, and compile."""
        self._make_outputs()
        self._params = self.config.match_params()
        self._warn_of_seed()
        self._load()
        many, indexed = len(self._library.models), self._catalogue is not None
        # A proof may be asked for at any time; what it takes is loaded now, so that no message waits for it then.
        asked = self._params.replace(prove=True)
        self.prepare(compile_steps(asked, many, images=True, catalogue=indexed))
        self._start_transforms()

    def activate(self) -> None:
        """Subscribe, and say what is latched."""
        self._answers.tell_symmetries()
        self.listen_images(CameraTopics.of(self.config, self.config.cameras), self._on_images, optional=True)
        self.listen(PointCloud2, 'features', self._on_features, adapted=True)
        self.every(WAIT_S, self._wait_no_longer, clock=self._steady_clock)

    def deactivate(self) -> None:
        """End the search, and forget what it was about."""
        self._search.drop()
        self._images.clear()
        self._instances.clear()
        self._waiting = None

    def cleanup(self) -> None:
        """Forget the models."""
        super().cleanup()
        self._reason, self._seen = '', 0

    # -- configuration -----------------------------------------------------------------------------------------

    def on_config(self, old: MatcherConfig, new: MatcherConfig) -> None:
        """Take over what was changed."""
        super().on_config(old, new)
        self._params = new.match_params()
        if self._params != old.match_params():
            self._search.begin_anew(CHANGED_GRACE_S)
        if new.seed != old.seed:
            self._warn_of_seed()
        of_library = (new.models, new.shard) != (old.models, old.shard)
        if of_library or (new.mesh_units != old.mesh_units and self._library.units):
            self._load()

    def _warn_of_seed(self) -> None:
        if self.config.seed:
            self.get_logger().warning(without_effect('parameter', 'seed'))

    def reset(self) -> str:
        """Read the models again, and end the search; says what was reset."""
        self._search.drop()
        self._load()
        self._images.clear()
        self._instances.clear()
        self._waiting, self._seen, self._distance = None, 0, None
        return f'counters, images, and {len(self._library)} models read again'

    def share(self) -> Share:
        """See AnsweringNode."""
        return Share.parse(self.config.shard)

    def _models_changed(self) -> None:
        """A search that is under way begins anew. See AnsweringNode."""
        self._search.begin_anew(0.0)

    def _look_at_units(self, data: FeatureSet) -> None:
        """The first features tell from what distance the models are looked at."""
        if self._distance is None and any(unit.guessed for unit in self._library.units.values()):
            self._distance = working_distance(data)
            if self._distance is not None and self._library.guesses_otherwise(self._distance):
                self._load()

    # -- work --------------------------------------------------------------------------------------------------

    def _on_images(self, images: CameraImages) -> None:
        if self.config.use_images:
            self._keep(stamp_ns(images.header), views_of(images))

    def _keep(self, stamp: int, views: Views) -> None:
        """Remember images; features that waited for them, or for older ones, wait no longer."""
        self._images.keep(stamp, views)
        if self._waiting is not None and stamp >= stamp_ns(self._waiting[0].header):
            self._answer_waiting()

    def _on_features(self, message: PointCloud2 | Adapted[FeatureSet]) -> None:
        """Features, with the images of their stamp; they wait a moment when images come that are not there yet."""
        self._answer_waiting()
        newest = self._images.newest
        if self.config.use_images and newest is not None and newest < stamp_ns(message.header):
            self._waiting = message, time.monotonic()
        else:
            self._take(message)

    def _wait_no_longer(self) -> None:
        self._search.look()
        if self._waiting is not None and time.monotonic() - self._waiting[1] >= WAIT_S:
            self._images.clear()  # they may have ended: what follows waits only when they come again
            self._answer_waiting()

    def _answer_waiting(self) -> None:
        if self._waiting is not None:
            (message, _), self._waiting = self._waiting, None
            self.attempt('features', self._take, message)

    def _take(self, message: PointCloud2 | Adapted[FeatureSet]) -> None:
        """Search in features now, or when the search that is under way is done."""
        views = self._images.at(stamp_ns(message.header)) if self.config.use_images else None
        data = message.value if isinstance(message, Adapted) else cloud_to_features(message)
        self._search.take(Recovered(message.header, data, views))

    def _begin(self, recovered: Recovered, deadline: Deadline) -> Callable[[], MatchResult]:
        """A search by the models and parameters of now."""
        self._look_for_changes()
        self._look_at_units(recovered.data)
        models = self._library.models if self._catalogue is None else self._catalogue
        return partial(survey, models, recovered.data, self._params, recovered.views, deadline)

    def _finish(self, recovered: Recovered, result: MatchResult) -> None:
        self._seen += recovered.views is not None
        self._reason = result.reason or ''
        late = result.stats['out_of_time']
        if late:
            self.problem(f'time_limit: {self.config.time_limit:g} s left no time to look for {", ".join(late)}')
        self._publish(self._canonical(result), recovered.header)
        self.done(recovered.header)

    def _canonical(self, result: MatchResult) -> MatchResult:
        """A result with the canonical ones of the poses that symmetries make equal."""
        models = self._models_of({one.model for one in (*result.interpretations, *result.rejected)})
        accepted, rejected = (
            tuple(canonical(models[one.model], one) for one in ones)
            for ones in (result.interpretations, result.rejected)
        )
        return replace(result, interpretations=accepted, rejected=rejected)

    # -- health ------------------------------------------------------------------------------------------------

    def why_silent(self) -> str | None:
        """What keeps the node from finding anything; None when nothing does."""
        if self._no_model():
            return self._no_model()
        if self._search.seconds > SILENCE_S:
            return f'a search takes {self._search.seconds:.0f} s, of a time_limit of {self.config.time_limit:g} s'
        return None

    def report_values(self) -> dict[str, object]:
        """What diagnostics say besides the counters."""
        return {
            **super().report_values(),
            'why_nothing_found': self._reason,
            'with_images': self._seen,
            'searching_s': f'{self._search.seconds:.1f}',
        }

    def destroy_node(self) -> None:
        """As GraphNode's; the search is ended."""
        search = getattr(self, '_search', None)  # there is none when the node could not be made
        if search is not None:
            search.close(ENDING_S)
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Run the node until it is told to stop; the exit status."""
    return run_node(MatcherNode, args)


if __name__ == '__main__':
    raise SystemExit(main())
