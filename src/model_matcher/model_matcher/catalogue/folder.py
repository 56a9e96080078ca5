"""A folder of models as an index: what is new or changed is read, by the contents of the files, the rest is kept."""

from __future__ import annotations

import hashlib
import json
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from csg_renderer import load_known_models
from csg_renderer.features.library import MODEL_SUFFIXES, SCENE_SUFFIX
from csg_renderer.language import read_scene
from csg_renderer.mesh.units import GUESS
from msgs_py.files import check_file

from ..batches.jobs import Workers, runner
from ..model.library import safe_name
from .build import IndexedModel, indexed_model, write_catalogue
from .catalogue import Catalogue, open_catalogue
from .store import is_index

Progress = Callable[[str, int, int], None]


class ReadFile(NamedTuple):
    """What a model file gave.

    Attributes
    ----------
    path : str
        Below the folder.
    files : dict of str to str
        Digest of its contents, and of the files that it includes, by their paths below the folder.
    models : tuple of IndexedModel
        With the names that the file gives them.
    note : str
        What was taken for the unit of a mesh; empty when there is nothing to say.
    problem : str
        Why it cannot be used; empty when it can.
    """

    path: str
    files: dict[str, str]
    models: tuple[IndexedModel, ...]
    note: str = ''
    problem: str = ''


class Updated(NamedTuple):
    """What an update did.

    Attributes
    ----------
    models, files : int
        In the index now.
    read, kept, removed : int
        Files that were read, that had not changed, and that are there no longer.
    problems, notes : tuple of str
        One line for each file that cannot be used, and for each unit that was guessed.
    """

    models: int
    files: int
    read: int
    kept: int
    removed: int
    problems: tuple[str, ...]
    notes: tuple[str, ...]


def update_catalogue(
    folder: Path,
    index: Path,
    mesh_units: str = GUESS,
    workers: int = 1,
    dask: str | None = None,
    progress: Progress = lambda what, done, total: None,
) -> Updated:
    """Bring the index of a folder, and all folders below, up to date; make it when there is none.

    Parameters
    ----------
    folder : Path
    index : Path
        Its file. A file that cannot be used is reported and left out.
    mesh_units : str
        Unit of mesh files, one of :data:`csg_renderer.mesh.units.MESH_UNITS`.
    workers : int
        Processes on this machine that read files.
    dask : str, optional
        Address of a dask scheduler whose workers read files instead; 'local' starts one here.
    progress : callable
        Takes what is done, and how many of how many.

    Returns
    -------
    Updated

    Raises
    ------
    OSError, ValueError
        There is no such folder, the index cannot be written, what stands in its place is no index, or dask is asked
        for and not installed.
    """
    if not folder.is_dir():
        raise ValueError(f'{folder}: no such folder')
    if index.exists() and not is_index(index):
        raise ValueError(f'{index}: is there and no index of models; it is not overwritten')
    known = _known(index, mesh_units)
    paths = sorted(str(path.relative_to(folder)) for path in _model_files(folder))
    done: dict[str, ReadFile] = {}
    digests: dict[str, str] = {}
    for number, path in enumerate(paths):
        old = known.get(path)
        if old is not None and all(_digest(folder, name, digests) == is_ for name, is_ in old.files.items()):
            done[path] = old
        progress('files looked at', number + 1, len(paths))
    wanted = [path for path in paths if path not in done]
    for number, one in enumerate(_read_all(folder, wanted, mesh_units, Workers(workers, dask))):
        done[one.path] = one
        progress('files read', number + 1, len(wanted))
    ordered = [done[path] for path in paths]
    models, sources = _named(ordered)
    write_catalogue(index, models, {'mesh_units': mesh_units, 'files': sources}, progress)
    return Updated(
        len(models),
        len(paths),
        len(wanted),
        len(paths) - len(wanted),
        len(set(known) - set(paths)),
        tuple(f'{one.path}: {one.problem}' for one in ordered if one.problem),
        tuple(f'{one.path}: {one.note}' for one in ordered if one.note),
    )


def read_file(folder: str, path: str, mesh_units: str) -> ReadFile:
    """Read a model file below a folder; what cannot be used is a problem."""
    files: dict[str, str] = {}
    try:
        full = check_file(Path(folder) / path)
        files = {name: _digest(Path(folder), name, {}) for name in _parts(Path(folder), path)}
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # a scene's useless statements do not matter to the matcher
            known = load_known_models(full, mesh_units=mesh_units)
        models = tuple(indexed_model(one.features, safe_name(name)) for name, one in known.items())
        units = [str(one.unit) for one in known.values() if one.unit is not None and one.unit.guessed]
        return ReadFile(path, files, models, '; '.join(units))
    except Exception as error:  # a parser, a mesh reader or the geometry: whatever it is, the rest must be indexed
        files = files or {path: _digest(Path(folder), path, {})}
        return ReadFile(path, files, (), problem=' '.join(str(error).replace(f'{folder}/', '').split()))


def read_far(path: str, contents: dict[str, bytes], mesh_units: str) -> ReadFile:
    """As read_file, on a machine that shares no folder with this one; contents : of its files, by their paths."""
    with tempfile.TemporaryDirectory() as folder:
        for name, data in contents.items():
            (Path(folder) / name).parent.mkdir(parents=True, exist_ok=True)
            (Path(folder) / name).write_bytes(data)
        return read_file(folder, path, mesh_units)


def checked_answer(path: str, answer: Any) -> ReadFile:
    """What a worker on another machine returned; an answer that is none is a problem of its file."""
    try:
        one = ReadFile(*answer)
        if one.path != path or not all(isinstance(text, str) for text in (*one.files, *one.files.values())):
            raise ValueError('it is of another file')
        for model in one.models:
            n = len(model.rows)
            arrays = (model.rows, (n, 9), float), (model.kind, (n,), np.uint8), (model.details, (n, 5), float)
            if safe_name(model.name) != model.name or not all(a.shape == s and a.dtype == t for a, s, t in arrays):
                raise ValueError('a model is none')
        return one
    except (TypeError, ValueError, AttributeError) as error:
        return ReadFile(path, {}, (), problem=f'the answer of a worker is none: {error}')


class _Job(NamedTuple):
    """A file to read, as another process can be told; contents : of its files, where it cannot open them itself."""

    folder: str
    path: str
    mesh_units: str
    contents: dict[str, bytes] | None


def _read(job: _Job) -> ReadFile:
    if job.contents is None:
        return read_file(job.folder, job.path, job.mesh_units)
    return read_far(job.path, job.contents, job.mesh_units)


def _read_all(folder: Path, paths: Sequence[str], mesh_units: str, workers: Workers) -> Iterator[ReadFile]:
    """The files as they come."""
    far = workers.dask not in (None, 'local')
    jobs = [_Job(str(folder), path, mesh_units, _contents(folder, path) if far else None) for path in paths]
    with runner(workers) as run:
        for job, answer in run(_read, jobs):
            yield checked_answer(job.path, answer) if far else answer


def _known(index: Path, mesh_units: str) -> dict[str, ReadFile]:
    """The files of an index that was made with these units, by their paths; none of an index that cannot be used."""
    if not index.exists():
        return {}
    try:
        catalogue = open_catalogue(index)
        sources = catalogue.sources()
        if sources['mesh_units'] != mesh_units:
            return {}
        known, number = {}, 0
        for one in sources['files']:
            models = tuple(_again(catalogue, number + k, name) for k, name in enumerate(one['models']))
            number += len(models)
            known[one['path']] = ReadFile(one['path'], dict(one['files']), models, one['note'], one['problem'])
    except (KeyError, TypeError, ValueError, json.JSONDecodeError):
        return {}  # damaged or of another version: it is made anew
    return known


def _again(catalogue: Catalogue, number: int, name: str) -> IndexedModel:
    """A model of an index, to be written again."""
    features = catalogue.features
    part = slice(int(features.starts[number]), int(features.starts[number + 1]))
    return IndexedModel(
        name,
        features.rows[part].copy(),
        features.kind[part].copy(),
        catalogue.details[part].copy(),
        float(features.sizes[number]),
        features.centres[number].copy(),
        float(features.radii[number]),
    )


def _named(files: Sequence[ReadFile]) -> tuple[list[IndexedModel], list[dict[str, Any]]]:
    """The models with unique names, and what is kept of their files."""
    count: dict[str, int] = {}
    models: list[IndexedModel] = []
    sources: list[dict[str, Any]] = []
    for one in files:
        for model in one.models:
            name = model.name
            while name in count:
                count[model.name] += 1
                name = f'{model.name}_{count[model.name]}'
            count[name] = 1
            models.append(model._replace(name=name))
        sources.append({**one._asdict(), 'models': [model.name for model in one.models]})
    return models, sources


def _model_files(folder: Path) -> Iterator[Path]:
    """Model files in a folder and below; what begins with a dot is left out."""
    for path in folder.rglob('*'):
        hidden = any(part.startswith('.') for part in path.relative_to(folder).parts)
        if not hidden and path.suffix.lower() in MODEL_SUFFIXES and path.is_file():
            yield path


def _parts(folder: Path, path: str) -> list[str]:
    """A file and those below the folder that it includes."""
    if Path(path).suffix.lower() != SCENE_SUFFIX:
        return [path]
    read = [Path(file).resolve() for file in read_scene(str(folder / path)).files]
    root = folder.resolve()
    below = [str(file.relative_to(root)) for file in read if file.is_relative_to(root)]
    return list(dict.fromkeys([path, *below]))


def _contents(folder: Path, path: str) -> dict[str, bytes]:
    """The contents of a file and those that it includes; of a damaged one its own."""
    try:
        return {name: (folder / name).read_bytes() for name in _parts(folder, path)}
    except (OSError, ValueError):
        return {path: (folder / path).read_bytes() if (folder / path).is_file() else b''}


def _digest(folder: Path, name: str, known: dict[str, str]) -> str:
    """SHA-256 of a file's contents; empty when there is none."""
    if name not in known:
        try:
            known[name] = hashlib.sha256(check_file(folder / name).read_bytes()).hexdigest()
        except (OSError, ValueError):
            known[name] = ''
    return known[name]
