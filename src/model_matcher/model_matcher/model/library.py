"""Models by file name: scene files, feature files and meshes, single or by the folder."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from csg_renderer import load_known_models
from csg_renderer.features.library import MODEL_SUFFIXES
from csg_renderer.language import find_scene

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
                with warnings.catch_warnings():
                    warnings.simplefilter('ignore')  # a scene's useless statements do not matter to the matcher
                    loaded = load_known_models(path)
                for given_name, known in loaded.items():
                    name = _unique(safe_name(given_name), taken)
                    models.append(index_model(known.features, name, known.outline))
                    taken.add(name)
            except Exception as error:  # a parser, a mesh reader or the geometry: whatever it is, the rest must load
                problems.append(f'{given}: {error}' if str(path.name) in str(given) else f'{path.name}: {error}')
    return Library(tuple(models), tuple(problems), files)


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
            raise ValueError(f'not a model file, expected one of {", ".join(MODEL_SUFFIXES)}')
        return [path]
    return [find_scene(given)]


def _unique(name: str, taken: set[str]) -> str:
    number = 2
    unique = name
    while unique in taken:
        unique = f'{name}_{number}'
        number += 1
    return unique
