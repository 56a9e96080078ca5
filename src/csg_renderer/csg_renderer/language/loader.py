"""Scene files to scenes: what everybody else calls."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from ..scene.scene import Placement, Scene
from ..scene.solid import Operation, Primitive, Solid
from ..scene.terrain import Terrain
from .errors import SceneError, SceneWarning
from .evaluate import Evaluator
from .expressions import Skip
from .includes import Includes, models_folder, read_source
from .parser import Source

SUFFIX = '.csg'


@dataclass(frozen=True)
class SceneFile:
    """A scene with what its reading found out.

    Attributes
    ----------
    scene : Scene
    warnings : tuple of str
        One line each.
    files : tuple of Path
        All files that were read, in order; those of terrains, too.
    """

    scene: Scene
    warnings: tuple[str, ...]
    files: tuple[Path, ...]


def scene_names() -> list[str]:
    """The scenes and models that come with the package.

    Returns
    -------
    list of str
        Names for :func:`load_scene`, in alphabetical order.

    Examples
    --------
    >>> 'l_shape_v1' in scene_names()
    True
    """
    return sorted(path.stem for path in models_folder().glob('*' + SUFFIX))


def scene_path(name: str) -> Path:
    """The file of a scene or model that comes with the package.

    Parameters
    ----------
    name : str
        With or without ``.csg``.

    Returns
    -------
    Path

    Raises
    ------
    FileNotFoundError
        There is no such scene; the message has the nearest names.

    Examples
    --------
    >>> scene_path('l_shape_v1').name
    'l_shape_v1.csg'
    """
    path = models_folder() / (name if name.endswith(SUFFIX) else name + SUFFIX)
    if Path(name).name != name or not path.is_file():
        close = get_close_matches(name, scene_names(), n=3)
        hint = f' (did you mean {", ".join(close)}?)' if close else f'; there are {", ".join(scene_names())}'
        raise FileNotFoundError(f'no scene {name!r} in the package{hint}')
    return path


def find_scene(path: str | os.PathLike[str]) -> Path:
    """The file that a user means.

    Parameters
    ----------
    path : str or path-like
        A file, or the name of a scene of the package.

    Returns
    -------
    Path

    Raises
    ------
    FileNotFoundError
        There is neither.
    """
    given = Path(path)
    if given.is_file():
        return given
    if given.suffix not in ('', SUFFIX):
        raise FileNotFoundError(f'{given}: no such file')
    if given.name == str(path):
        return scene_path(given.name)
    raise FileNotFoundError(f'no scene file {str(given)!r}')


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene file, or a scene of the package by name.

    Parameters
    ----------
    path : str or path-like

    Returns
    -------
    Scene
        Lengths in metres.

    Raises
    ------
    SceneError
        The text is wrong; all its errors are in ``.errors``.
    FileNotFoundError
        There is no such file.

    Warns
    -----
    SceneWarning
        A name is never used, or nothing is drawn.

    Examples
    --------
    >>> load_scene('l_shape_v1').placements[0].name
    'l_shape'
    """
    return _warned(read_scene(path))


def parse_scene(text: str, file: str = '', folder: str | os.PathLike[str] | None = None) -> Scene:
    """A scene from its text.

    Parameters
    ----------
    text : str
    file : str
        Name shown in errors.
    folder : str or path-like, optional
        Where INCLUDE looks; always also in the package.

    Returns
    -------
    Scene
        Lengths in metres.

    Raises
    ------
    SceneError
        The text is wrong; all its errors are in ``.errors``.

    Warns
    -----
    SceneWarning
        A name is never used, or nothing is drawn.

    Examples
    --------
    >>> scene = parse_scene('cube = BLOCK (20, 20, 20); DRAW cube AT (0, 0, 300);')
    >>> scene.placements[0].matrix[:3, 3].tolist()
    [0.0, 0.0, 0.3]
    """
    return _warned(read_text(text, file, folder))


def load_models(path: str | os.PathLike[str]) -> dict[str, Solid]:
    """The models that a scene file holds for recognition, one for each DRAW.

    The transforms of the DRAW statement itself are the pose and are left out; a model that is drawn twice comes once. A
    terrain is ground, and no model.

    Parameters
    ----------
    path : str or path-like
        As for :func:`load_scene`.

    Returns
    -------
    dict of str to Solid
        By unique name, in the model's own frame, metres.

    Raises
    ------
    SceneError
        The text is wrong; all its errors are in ``.errors``.
    FileNotFoundError
        There is no such file.

    Examples
    --------
    >>> [len(model.primitives) for model in load_models('l_shape').values()]
    [2]
    """
    return {placement.name: placement.model for placement in load_placements(path)}


def load_placements(path: str | os.PathLike[str]) -> list[Placement]:
    """The objects that a scene file draws, the first of each model; terrains are none.

    What :func:`load_models` gives, with pose and frames of each: of a model that is drawn twice the frames of both.

    Parameters
    ----------
    path : str or path-like
        As for :func:`load_scene`, which raises the same.

    Returns
    -------
    list of Placement
    """
    chosen: list[Placement] = []
    for placement in load_scene(path).placements:
        if isinstance(placement.model, Terrain):
            continue
        same = next((k for k, known in enumerate(chosen) if same_geometry(placement.model, known.model)), None)
        if same is None:
            chosen.append(placement)
        else:
            chosen[same] = replace(chosen[same], frames={**placement.frames, **chosen[same].frames})
    return chosen


def read_scene(path: str | os.PathLike[str]) -> SceneFile:
    """Read a scene as :func:`load_scene` does, with warnings as values and the list of files (to watch).

    Parameters
    ----------
    path : str or path-like

    Returns
    -------
    SceneFile

    Raises
    ------
    SceneError
        The text is wrong; all its errors are in ``.errors``.
    FileNotFoundError
        There is no such file.
    """
    found = find_scene(path)
    try:
        source = read_source(found, str(path))
    except ValueError as error:
        raise SceneError(1, 1, str(error), file=str(path)) from None
    return _read(source, Includes(found.parent, found), found)


def read_text(text: str, file: str = '', folder: str | os.PathLike[str] | None = None) -> SceneFile:
    """Read a text as :func:`parse_scene` does, with warnings as values and the list of files.

    Parameters
    ----------
    text, file, folder
        As for :func:`parse_scene`.

    Returns
    -------
    SceneFile

    Raises
    ------
    SceneError
        The text is wrong; all its errors are in ``.errors``.
    """
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
    """Whether two solids are the same tree of the same primitives at the same places, whatever their surfaces.

    Parameters
    ----------
    a, b : Solid

    Returns
    -------
    bool
    """
    pending = [(a, b)]
    while pending:
        x, y = pending.pop()
        if isinstance(x, Operation) and isinstance(y, Operation) and x.operator == y.operator:
            pending += [(x.left, y.left), (x.right, y.right)]
        elif isinstance(x, Primitive) and isinstance(y, Primitive):
            if x.kind != y.kind or not np.array_equal(x.matrix, y.matrix):
                return False
        elif isinstance(x, Terrain) and isinstance(y, Terrain):
            same = np.array_equal(x.heights, y.heights, equal_nan=True) and x.bilinear == y.bilinear
            if not same or not np.array_equal(x.matrix, y.matrix):
                return False
        elif type(x) is not type(y) or isinstance(x, Operation):
            return False
    return True
