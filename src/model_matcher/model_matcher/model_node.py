"""What nodes of known models share: which models, where they may be read from, and their frames on /tf."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from rclpy.publisher import Publisher
from std_msgs.msg import Header

from csg_renderer.language.includes import models_folder
from csg_renderer.mesh.units import GUESS
from msgs_py import Pose
from msgs_py.codecs import transform_message_type
from msgs_py.node_runtime.background import Background
from msgs_py.node_runtime.camera_input import CameraConfig
from msgs_py.node_runtime.config import parameter
from msgs_py.node_runtime.confinement import TrustedFolders
from msgs_py.node_runtime.runtime import GraphNode

from .catalogue.catalogue import Catalogue, Share, open_catalogue
from .catalogue.store import is_index
from .model.index import ModelIndex
from .model.library import Library, changed_at, load_library
from .node_answers import transforms

NO_TF = 'parameter tf: tf2_msgs is not installed (ros-jazzy-tf2-msgs), so nothing can be broadcast'


@dataclass(frozen=True)
class ModelConfig(CameraConfig):
    """Parameters of a node of known models."""

    models: tuple[str, ...] = parameter(
        (),
        'Model files (.csg, .npz, .stl, .obj, .ply), folders of them, or names of models of csg_renderer; or one index '
        'of models, as index_models makes it',
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
        self._catalogue: Catalogue | None = None
        self._checking: Background[None] | None = None
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
        self._catalogue, self._checking = None, None

    def _read_library(self, mesh_units: str = GUESS, distance: float | None = None) -> None:
        """Read the models; what cannot be used is reported by name and left out."""
        self._library = load_library(self.config.models, mesh_units, distance)
        for problem in self._library.problems:
            self.problem(f'models: {problem}')
        if not self.config.models:
            self.problem('parameter models: empty, expected model files, folders or names')

    def _open_index(self, share: Share | None = None) -> bool:
        """Open the index that parameter models names, which goes alone; False when it names none.

        Its checksums are compared while it is used: of many models that takes seconds.
        """
        self._catalogue, self._checking = None, None
        indexes = [given for given in self.config.models if is_index(given)]
        if not indexes:
            return False
        path = Path(indexes[0]).expanduser()
        problems = []
        if len(self.config.models) > 1:
            problems.append(f'{indexes[0]}: an index goes alone; the others are left out')
        try:
            self._catalogue = open_catalogue(path, share, check=False)
            self._checking = Background(self._catalogue.check, lambda: self.inbox.put(self._on_checked))
        except (OSError, ValueError) as error:
            problems.append(str(error))
        self._library = Library((), tuple(problems), {path: changed_at(path)})
        for problem in problems:
            self.problem(f'models: {problem}')
        return True

    def _on_checked(self) -> None:
        """An index that turns out to be damaged is used no longer."""
        if self._checking is None or not self._checking.done:
            return  # another index has taken the place of the one that was checked
        checking, self._checking = self._checking, None
        try:
            checking.result()
        except (OSError, ValueError) as error:
            self._catalogue = None
            self._library = replace(self._library, problems=(*self._library.problems, str(error)))
            self.problem(f'models: {error}')
            self._index_lost()

    def _index_lost(self) -> None:
        """What was made of an index goes with it."""

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
