"""What nodes of known models share: which models, where they may be read from, and their frames on /tf."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from rclpy.publisher import Publisher
from std_msgs.msg import Header

from csg_renderer.features.mesh_units import GUESS
from csg_renderer.language.includes import models_folder
from msgs_py import Pose
from msgs_py.codecs import transform_message_type
from msgs_py.node_runtime.camera_input import CameraConfig
from msgs_py.node_runtime.config import parameter
from msgs_py.node_runtime.confinement import TrustedFolders
from msgs_py.node_runtime.runtime import GraphNode

from .model.index import ModelIndex
from .model.library import Library, load_library
from .node_answers import transforms

NO_TF = 'parameter tf: tf2_msgs is not installed (ros-jazzy-tf2-msgs), so nothing can be broadcast'


@dataclass(frozen=True)
class ModelConfig(CameraConfig):
    """Parameters of a node of known models."""

    models: tuple[str, ...] = parameter(
        (), 'Model files (.csg, .npz, .stl, .obj, .ply), folders of them, or names of models of csg_renderer'
    )
    model_folders: tuple[str, ...] = parameter(
        (),
        'Folders that models may be read from when they are changed at run time, besides those of the models given '
        'at the start and those of csg_renderer',
        read_only=True,
    )
    tf: bool = parameter(False, 'Broadcast the best pose of each model, and its frames, on /tf (needs tf2_msgs)')
    tf_prefix: str = parameter('', "Put before the model's name to make its frame")


_C = TypeVar('_C', bound=ModelConfig)


class ModelNode(GraphNode[_C]):
    """A node of known models; parameters as for :class:`GraphNode`. Nothing is read or broadcast before it says so."""

    def __init__(self, name: str, config_class: type[_C], **kwargs: Any) -> None:
        super().__init__(name, config_class, **kwargs)
        self._pose_out: dict[str, Publisher] = {}
        self._library = Library((), (), {})
        self._transforms_out: Publisher | None = None
        self._transforms_type = transform_message_type()
        self._trusted = TrustedFolders(
            [*self.config.model_folders, models_folder()], self.config.models, 'model_folders'
        )

    def check_config(self, new: _C) -> None:
        """Raise ValueError for a change that cannot be made: no tf messages, or models from elsewhere."""
        if new.tf and not self.config.tf and self._transforms_type is None:
            raise ValueError(NO_TF)
        for given in set(new.models) - set(self.config.models):
            try:
                self._trusted.check(given)
            except ValueError as error:
                raise ValueError(f'parameter models: {error}') from None

    def on_config(self, old: _C, new: _C) -> None:
        """Take over what was changed."""
        if new.tf != old.tf:
            self._start_transforms()

    def cleanup(self) -> None:
        """Forget the models."""
        self._pose_out, self._transforms_out, self._library = {}, None, Library((), (), {})

    def _read_library(self, mesh_units: str = GUESS, distance: float | None = None) -> None:
        """Read the models; what cannot be used is reported by name and left out."""
        self._library = load_library(self.config.models, mesh_units, distance)
        for problem in self._library.problems:
            self.problem(f'models: {problem}')
        if not self.config.models:
            self.problem('parameter models: empty, expected model files, folders or names')

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
        self._transforms_out = self.owned(self.create_publisher(self._transforms_type, '/tf', 100))

    def _broadcast(self, poses: Mapping[str, Pose], models: Mapping[str, ModelIndex], header: Header) -> None:
        """The frames of objects at poses, by the names of their models, where they are asked for."""
        if self._transforms_out is not None and self._transforms_type is not None and poses:
            made = transforms(poses, models, self.config.tf_prefix, header)
            self._transforms_out.publish(self._transforms_type(transforms=made))
