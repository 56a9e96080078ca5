"""Models by file name: scene files, feature files and meshes, single or by the folder."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from csg_renderer import load_known_models
from csg_renderer.features.library import MODEL_SUFFIXES
from csg_renderer.language import find_scene
from csg_renderer.mesh.files import cad_remedy
from csg_renderer.mesh.settings import WORKING_DISTANCE
from csg_renderer.mesh.units import GUESS, MeshUnit, mesh_unit
from msgs_py import FeatureSet

from .index import ModelIndex, index_model


@dataclass(frozen=True)
class Library:
    """Models ready for matching.

    Attributes
    ----------
    models
        One index a model, names unique.
    problems
        One line for each path that could not be used, beginning with its name.
    files
        Every file and folder that was looked at, with its time of change (nanoseconds).
    units
        What was taken for the unit of each mesh, by the model's name.
    """

    models: tuple[ModelIndex, ...]
    problems: tuple[str, ...]
    files: dict[Path, int]
    units: dict[str, MeshUnit] = field(default_factory=dict)

    def changed(self) -> bool:
        """Whether a file has been rewritten or has gone since."""
        return any(changed_at(path) != then for path, then in self.files.items())

    def guesses_otherwise(self, distance: float) -> bool:
        """Whether another unit of a mesh is more likely at a working distance, metres."""
        guessed = [unit for unit in self.units.values() if unit.guessed]
        return any(mesh_unit(unit.extent, distance=distance) != unit for unit in guessed)

    def __len__(self) -> int:
        return len(self.models)


def changed_at(path: Path) -> int:
    """Time of change in nanoseconds, -1 when there is no such file."""
    try:
        return os.stat(path).st_mtime_ns
    except (OSError, ValueError):
        return -1


def working_distance(data: FeatureSet) -> float | None:
    """Metres, at which features lie: the median of their distances from the camera; None where there are none."""
    distances = np.linalg.norm(data.midpoints, axis=1)
    distances = distances[np.isfinite(distances) & (distances > 0.0)]
    return float(np.median(distances)) if len(distances) else None


def load_library(paths: Iterable[str], mesh_units: str = GUESS, distance: float | None = None) -> Library:
    """Read models from files, folders or names of models that come with csg_renderer.

    A scene file gives one model for each object it draws, in the object's own frame. A path that cannot be used, or a
    model without features, becomes a problem and is skipped; the rest is loaded.

    Parameters
    ----------
    paths : iterable of str
    mesh_units : str
        Unit of mesh files, one of :data:`csg_renderer.mesh.units.MESH_UNITS`.
    distance : float, optional
        Metres, at which models will be looked at (:func:`working_distance`): what a guess goes by.

    Returns
    -------
    Library
    """
    models: list[ModelIndex] = []
    problems: list[str] = []
    files: dict[Path, int] = {}
    taken: set[str] = set()
    units: dict[str, MeshUnit] = {}
    for given in paths:
        try:
            found = _files(given)
        except (OSError, ValueError) as error:
            problems.append(_problem(given, error))
            files[Path(given).expanduser()] = changed_at(Path(given).expanduser())  # it may come yet
            continue
        if Path(given).expanduser().is_dir():
            files[Path(given).expanduser()] = changed_at(Path(given).expanduser())  # files may come and go
        for path in found:
            files[path] = changed_at(path)
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter('ignore')  # a scene's useless statements do not matter to the matcher
                    loaded = load_known_models(path, mesh_units=mesh_units, distance=distance or WORKING_DISTANCE)
                for given_name, known in loaded.items():
                    name = _unique(safe_name(given_name), taken)
                    index = index_model(known.features, name, known.outline)
                    index.frames.update(known.frames)
                    models.append(index)
                    taken.add(name)
                    if known.unit is not None:
                        units[name] = known.unit
            except Exception as error:  # a parser, a mesh reader or the geometry: whatever it is, the rest must load
                problems.append(_problem(given if str(path.name) in str(given) else path.name, error))
    return Library(tuple(models), tuple(problems), files, units)


def models_of(given: str, mesh_units: str = GUESS) -> tuple[ModelIndex, ...]:
    """The models of one path, one at least; see :func:`load_library`.

    Raises
    ------
    ValueError
        Says why there is none.
    """
    library = load_library([given], mesh_units)
    if not library.models:
        raise ValueError('; '.join(library.problems) or f'{given}: holds no model')
    return library.models


def _problem(name: str, error: Exception) -> str:
    """An error as one line that begins with the name of a path."""
    return str(error) if str(error).startswith(name) else f'{name}: {error}'


def safe_name(name: str) -> str:
    """A model name that may end a topic name: letters, digits and underscores, no digit first."""
    safe = re.sub(r'[^0-9A-Za-z_]+', '_', name).strip('_') or 'model'
    return 'm_' + safe if safe[0].isdigit() else safe


def _files(given: str) -> list[Path]:
    path = Path(given).expanduser()
    if path.is_dir():
        found = sorted(item for item in path.iterdir() if item.suffix.lower() in MODEL_SUFFIXES)
        if not found:
            raise ValueError(f'the folder holds no model ({", ".join(MODEL_SUFFIXES)})')
        return found
    if path.is_file():
        if path.suffix.lower() not in MODEL_SUFFIXES:
            raise ValueError(f'not a model file, expected one of {", ".join(MODEL_SUFFIXES)}{cad_remedy(path)}')
        return [path]
    return [find_scene(given)]


def _unique(name: str, taken: set[str]) -> str:
    number = 2
    unique = name
    while unique in taken:
        unique = f'{name}_{number}'
        number += 1
    return unique
