"""What nodes share that say which models are where: the models, by name or from an index, and the topics of answers."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseStamped
from visualization_msgs.msg import MarkerArray

from csg_renderer.mesh.units import GUESS, MESH_UNITS
from msgs_py import FeatureSet, Interpretation
from msgs_py.codecs import features_to_markers, pose_to_stamped, poses_to_array, report_from_interpretations
from msgs_py.node_runtime.config import parameter
from msgs_py.node_runtime.settings import DIAGNOSTICS_PERIOD_S
from msgs_py.node_runtime.stamp_sync import stamp_ns

from .catalogue.catalogue import Share
from .instances import Instances
from .model.index import ModelIndex
from .model_node import ModelConfig, ModelNode
from .node_answers import Answers
from .params import MatchResult
from .settings import NAMED_MODELS

TOPIC = 'interpretations'


@dataclass(frozen=True)
class AnsweringConfig(ModelConfig):
    """Parameters of a node that answers which models are where."""

    mesh_units: str = parameter(
        GUESS,
        'Unit of mesh files, which do not say it; a guess goes by their size against the distance of the features',
        choices=MESH_UNITS,
    )
    watch: bool = parameter(True, 'Read the models again when a file changes')
    speed: float = parameter(
        0.1,
        'Sigma of the speed of any point of an object in the frame of the camera, by which it is known again in the '
        'next message; 0 when all stands still',
        unit='m/s',
        minimum=0.0,
        maximum=100.0,
    )


_A = TypeVar('_A', bound=AnsweringConfig)


class AnsweringNode(ModelNode[_A]):
    """A node that publishes answers; parameters as for :class:`GraphNode`."""

    def __init__(self, name: str, config_class: type[_A], **kwargs: Any) -> None:
        super().__init__(name, config_class, **kwargs)
        self._instances = Instances()
        self._looked_at = time.monotonic()
        self._distance: float | None = None
        # Of an index the models that have been found; topics are made for these.
        self._found: OrderedDict[str, ModelIndex] = OrderedDict()

    def share(self) -> Share:
        """The share of the models that is this node's."""
        return Share()

    # -- its life ----------------------------------------------------------------------------------------------

    def _make_outputs(self) -> None:
        """Make the topics that do not depend on the models."""
        self._array_out = self.create_output(PoseArray, TOPIC)
        self._report_out = self.create_output(DiagnosticArray, f'{TOPIC}/report')
        self._markers_out = self.create_output(MarkerArray, f'{TOPIC}/markers')
        self._answers = Answers(self, TOPIC)

    def unusable(self) -> str:
        """No model, or a parameter that was refused. See ManagedNode."""
        return super().unusable() or self._no_model()

    def cleanup(self) -> None:
        """Forget the models."""
        super().cleanup()
        self._distance = None
        self._found.clear()

    # -- models ------------------------------------------------------------------------------------------------

    def _load(self) -> None:
        """Read the models; what cannot be used is reported by name and left out."""
        said = self._library.units
        self._found.clear()
        if not self._open_index(self.share()):
            self._read_library(self.config.mesh_units, self._distance)
            first, last = self.share().models(len(self._library))
            self._library = replace(self._library, models=self._library.models[first:last])
        for name, unit in self._library.units.items():
            if unit.guessed and said.get(name) != unit:
                self.get_logger().warning(f'models: {name}: {unit}')
        self._make_topics()
        self._models_changed()

    def _models_changed(self) -> None:
        """What is under way goes by models that are there no longer."""

    def _index_lost(self) -> None:
        """See ModelNode."""
        self._found.clear()
        self._make_topics()
        self._models_changed()

    def _make_topics(self) -> None:
        """Make the topics of models that are known, and no others."""
        models = self._models()
        for name in set(self._pose_out) - set(models):
            self.destroy_publisher(self._pose_out.pop(name))
        for name in sorted(set(models) - set(self._pose_out)):
            self._pose_out[name] = self.create_output(PoseStamped, f'{TOPIC}/{topic_name(name)}')
        self._answers.load(models.values(), {name: topic_name(name) for name in models})
        if self.active:
            self._answers.tell_symmetries()

    def _models(self) -> Mapping[str, ModelIndex]:
        """The models that have topics, by their names."""
        return self._found if self._catalogue is not None else {model.name: model for model in self._library.models}

    def _models_of(self, names: Iterable[str]) -> dict[str, ModelIndex]:
        """Models by their names; raises KeyError for one that is not known."""
        if self._catalogue is None:
            models = self._models()
            return {name: models[name] for name in names}
        return {name: self._catalogue.model(self._catalogue.number(name)) for name in names}

    def _make_known(self, names: Iterable[str]) -> None:
        """Give models of an index their topics when they are found first; what was found long ago loses them."""
        if self._catalogue is None:
            return
        new = False
        for name, model in self._models_of(names).items():
            if name not in self._found:
                self._found[name] = self._catalogue.outlined(model)
                new = True
            self._found.move_to_end(name)
        while len(self._found) > NAMED_MODELS:
            self._found.popitem(last=False)
        if new:
            self._make_topics()

    def _look_for_changes(self) -> None:
        now = time.monotonic()
        if self.config.watch and now - self._looked_at >= DIAGNOSTICS_PERIOD_S:
            self._looked_at = now
            if self._library.changed():
                self._load()

    def _no_model(self) -> str:
        """Why there is no model; empty when there is one."""
        if self._library.models or self._catalogue:
            return ''
        return 'no model is loaded: ' + ('; '.join(self._library.problems) or 'parameter models is empty')

    # -- answers -----------------------------------------------------------------------------------------------

    def _publish(self, result: MatchResult, header: Any) -> None:
        """Say what was found, with the header of the data: poses first, for somebody waits for them."""
        self._array_out.publish(poses_to_array([one.pose for one in result.interpretations], header))
        best: dict[str, Interpretation] = {}
        for one in result.interpretations:
            best.setdefault(one.model, one)
        self._make_known(best)
        models = self._models()
        for name, one in best.items():
            self._pose_out[name].publish(pose_to_stamped(one.pose, header))
        self._broadcast({name: one.pose for name, one in best.items()}, models, header)
        instances = self._instances.names(stamp_ns(header), result.interpretations, models, self.config.speed)
        self._answers.publish(result.interpretations, instances, header)
        self._answers.publish_scene(result.interpretations, instances, self._instances.remembered, header)
        every = [*result.interpretations, *result.rejected]
        self._report_out.publish(report_from_interpretations(every, header, instances))
        if self.wanted(self._markers_out):
            self._markers_out.publish(self._markers(result, header))

    def _markers(self, result: MatchResult, header: Any) -> MarkerArray:
        """Wire frames of what was accepted; the array begins by deleting the last ones."""
        models = self._models()
        markers = features_to_markers(FeatureSet.empty(), header, TOPIC)
        for number, one in enumerate(result.interpretations):
            placed = models[one.model].features.transformed(one.pose)
            markers.markers += features_to_markers(placed, header, f'{one.model}/{number}', clear=False).markers
        return markers

    def report_values(self) -> dict[str, object]:
        """What diagnostics say besides the counters."""
        names = ', '.join(model.name for model in self._library.models)
        if self._catalogue is not None:
            names = f'{self._catalogue.last - self._catalogue.first} of {len(self._catalogue)} models of an index'
        return {
            'models': names,
            'mesh_units': '; '.join(f'{name}: {unit}' for name, unit in self._library.units.items()),
            'unusable_models': '; '.join(self._library.problems),
        }


def topic_name(name: str) -> str:
    """The last part of a model's topic; some are taken."""
    return f'{name}_model' if name in ('report', 'markers', 'symmetries') else name
