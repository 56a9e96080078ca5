"""Scene files to scenes: what everybody else calls."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from ..scene.scene import Scene
from ..scene.solid import Operation, Primitive, Solid
from .errors import SceneError, SceneWarning
from .evaluate import Evaluator
from .expressions import Skip
from .includes import Includes, models_folder, read_source
from .parser import Source

SUFFIX = '.csg'


@dataclass(frozen=True)
class SceneFile:
    """A scene with what its reading found out. warnings : one line each; files : all files read, in order."""

    scene: Scene
    warnings: tuple[str, ...]
    files: tuple[Path, ...]


def scene_names() -> list[str]:
    """The scenes and models that come with the package, by name."""
    return sorted(path.stem for path in models_folder().glob('*' + SUFFIX))


def scene_path(name: str) -> Path:
    """The file of a scene or model that comes with the package: ``scene_path('l_shape_v1')``.

    Raises FileNotFoundError, with the nearest names.
    """
    path = models_folder() / (name if name.endswith(SUFFIX) else name + SUFFIX)
    if Path(name).name != name or not path.is_file():
        close = get_close_matches(name, scene_names(), n=3)
        hint = f' (did you mean {", ".join(close)}?)' if close else f'; there are {", ".join(scene_names())}'
        raise FileNotFoundError(f'no scene {name!r} in the package{hint}')
    return path


def find_scene(path: str | os.PathLike[str]) -> Path:
    """A path as it is when there is such a file, else the package's scene of that name.

    Raises FileNotFoundError.
    """
    given = Path(path)
    if given.is_file():
        return given
    if given.name == str(path):
        return scene_path(given.name)
    raise FileNotFoundError(f'no scene file {str(given)!r}')


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene file, or a scene of the package by name (``load_scene('l_shape_v1')``).

    Raises SceneError when the text is wrong (all its errors in ``.errors``), FileNotFoundError when there is no file.
    Warns SceneWarning for names never used and scenes that draw nothing.
    """
    return _warned(read_scene(path))


def parse_scene(text: str, file: str = '', folder: str | os.PathLike[str] | None = None) -> Scene:
    """A scene from its text. file : name shown in errors; folder : where INCLUDE looks (always also in the package).

    Raises SceneError; warns SceneWarning.
    """
    return _warned(read_text(text, file, folder))


def load_models(path: str | os.PathLike[str]) -> dict[str, Solid]:
    """The models a scene file holds for recognition, by unique name: one per DRAW, in the model's own frame, metres.

    The transforms of the DRAW statement itself are the pose and are left out; a model that is drawn twice comes once.
    Raises as load_scene.
    """
    models: dict[str, Solid] = {}
    for placement in load_scene(path).placements:
        if not any(same_geometry(placement.model, model) for model in models.values()):
            models[placement.name] = placement.model
    return models


def read_scene(path: str | os.PathLike[str]) -> SceneFile:
    """As load_scene, with warnings as values and the list of files (to watch)."""
    found = find_scene(path)
    try:
        source = read_source(found, str(path))
    except ValueError as error:
        raise SceneError(1, 1, str(error), file=str(path)) from None
    return _read(source, Includes(found.parent, found), found)


def read_text(text: str, file: str = '', folder: str | os.PathLike[str] | None = None) -> SceneFile:
    """As parse_scene, with warnings as values and the list of files."""
    root = Path(folder) if folder is not None else None
    return _read(Source(text.replace('\r\n', '\n'), file), Includes(root), None)


def _read(source: Source, includes: Includes, path: Path | None) -> SceneFile:
    evaluator = Evaluator(source, includes, path)
    evaluator.run(main=True)
    # What follows from an error reported already is not news.
    errors = [error for error in evaluator.errors if not isinstance(error, Skip)]
    errors.sort(key=lambda error: (error.file != source.file, error.file, error.line, error.column))
    if errors or evaluator.errors:
        raise SceneError.of(errors or evaluator.errors)
    return SceneFile(evaluator.scene(), tuple(evaluator.warnings), tuple(includes.read))


def _warned(result: SceneFile) -> Scene:
    for message in result.warnings:
        warnings.warn(message, SceneWarning, stacklevel=3)
    return result.scene


def same_geometry(a: Solid, b: Solid) -> bool:
    """Are two solids the same tree of the same primitives at the same places, whatever their surfaces?"""
    pending = [(a, b)]
    while pending:
        x, y = pending.pop()
        if isinstance(x, Operation) and isinstance(y, Operation) and x.operator == y.operator:
            pending += [(x.left, y.left), (x.right, y.right)]
        elif isinstance(x, Primitive) and isinstance(y, Primitive):
            if x.kind != y.kind or not np.array_equal(x.matrix, y.matrix):
                return False
        elif type(x) is not type(y) or isinstance(x, Operation):
            return False
    return True
