"""Models by file name: scene files, feature files and meshes, single or by the folder."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from msgs_py import FeatureSet

from .index import ModelIndex, index_model

SCENE_SUFFIX = '.csg'
FEATURE_SUFFIX = '.npz'
MESH_SUFFIXES = ('.stl', '.obj', '.ply', '.off')
SUFFIXES = (SCENE_SUFFIX, FEATURE_SUFFIX, *MESH_SUFFIXES)


@dataclass(frozen=True)
class Library:
    """Models ready for matching.

    models : one index a model, names unique
    problems : one line for each path that could not be used, beginning with its name
    files : every file and folder that was looked at, with its time of change (nanoseconds)
    """

    models: tuple[ModelIndex, ...]
    problems: tuple[str, ...]
    files: dict[Path, int]

    def changed(self) -> bool:
        """Whether a file has been rewritten or has gone since."""
        return any(changed_at(path) != then for path, then in self.files.items())

    def __len__(self) -> int:
        return len(self.models)


def changed_at(path: Path) -> int:
    """Time of change in nanoseconds, -1 when there is no such file."""
    try:
        return os.stat(path).st_mtime_ns
    except (OSError, ValueError):
        return -1


def load_library(paths: Iterable[str]) -> Library:
    """Read models from files, folders or names of models that come with csg_renderer.

    A scene file gives one model for each object it draws, in the object's own frame. A path that cannot be used, or a
    model without features, becomes a problem and is skipped; the rest is loaded.
    """
    models: list[ModelIndex] = []
    problems: list[str] = []
    files: dict[Path, int] = {}
    taken: set[str] = set()
    for given in paths:
        try:
            found = _files(given)
        except (OSError, ValueError) as error:
            problems.append(f'{given}: {error}')
            files[Path(given).expanduser()] = changed_at(Path(given).expanduser())  # it may come yet
            continue
        if Path(given).expanduser().is_dir():
            files[Path(given).expanduser()] = changed_at(Path(given).expanduser())  # files may come and go
        for path in found:
            files[path] = changed_at(path)
            try:
                for name, features in load_features(path).items():
                    name = _unique(safe_name(name), taken)
                    models.append(index_model(features, name))
                    taken.add(name)
            except Exception as error:  # a parser, a mesh reader or the geometry: whatever it is, the rest must load
                problems.append(f'{given}: {error}' if str(path.name) in str(given) else f'{path.name}: {error}')
    return Library(tuple(models), tuple(problems), files)


def load_features(path: str | os.PathLike[str]) -> dict[str, FeatureSet]:
    """The models of one file, by name, in the model frame, metres.

    Raises ValueError (a SceneError for a scene file) or FileNotFoundError.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == FEATURE_SUFFIX:
        return {path.stem: FeatureSet.load(path)}
    if suffix in MESH_SUFFIXES:
        csg_renderer: Any = import_module('csg_renderer')
        return {path.stem: csg_renderer.features_from_mesh(path)}
    from csg_renderer.brep.model_features import model_features
    from csg_renderer.language import load_models

    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # what a scene draws in vain is no concern of the matcher
        return {name: model_features(solid) for name, solid in load_models(path).items()}


def safe_name(name: str) -> str:
    """A model name that may end a topic name: letters, digits and underscores, no digit first."""
    safe = re.sub(r'[^0-9A-Za-z_]+', '_', name).strip('_') or 'model'
    return 'm_' + safe if safe[0].isdigit() else safe


def _files(given: str) -> list[Path]:
    path = Path(given).expanduser()
    if path.is_dir():
        found = sorted(item for item in path.iterdir() if item.suffix.lower() in SUFFIXES)
        if not found:
            raise ValueError(f'the folder holds no model ({", ".join(SUFFIXES)})')
        return found
    if path.is_file():
        if path.suffix.lower() not in SUFFIXES:
            raise ValueError(f'not a model file, expected one of {", ".join(SUFFIXES)}')
        return [path]
    from csg_renderer.language import find_scene

    return [find_scene(given)]


def _unique(name: str, taken: set[str]) -> str:
    number = 2
    unique = name
    while unique in taken:
        unique = f'{name}_{number}'
        number += 1
    return unique
