"""An index of models in use: opened, its models made ready when they are asked for, and the candidates of a scene."""

from __future__ import annotations

import hashlib
import json
import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from csg_renderer.features.library import FEATURE_SUFFIX, load_known_models
from msgs_py import FeatureKind, FeatureSet
from msgs_py.numeric.typed import AnyArray

from ..model.index import ModelIndex, index_model
from ..model.library import safe_name
from .records import CELLS, Models, Postings, Scale
from .settings import CLASS_RATIO, KEPT_MODELS
from .store import File, read


@dataclass(frozen=True)
class Share:
    """A part of the models of an index, as one of several nodes has it.

    Attributes
    ----------
    number, of : int
        The second of eight is 2, 8.
    """

    number: int = 1
    of: int = 1

    @classmethod
    def parse(cls, text: str) -> Share:
        """The share that a text such as '2/8' names; empty: all.

        Raises
        ------
        ValueError
            It names none.

        Examples
        --------
        >>> Share.parse('2/8')
        Share(number=2, of=8)
        """
        if not text:
            return cls()
        number, _, of = text.partition('/')
        if not (number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
            raise ValueError(f'shard: expected a share such as 2/8, got {text!r}')
        return cls(int(number), int(of))

    def models(self, count: int) -> tuple[int, int]:
        """The models first to last - 1 of so many."""
        return (self.number - 1) * count // self.of, self.number * count // self.of


@dataclass(eq=False)
class Catalogue:
    """An index of models; make it with :func:`open_catalogue`.

    Attributes
    ----------
    path : Path
    names : tuple of str
        Of all models of the index, unique.
    first, last : int
        The share of it that is searched: models first to last - 1.
    features, postings, scale
        What compiled functions take.
    class_sizes : (c,) float64
        Metres, the largest model of each class of sizes, rising.
    classes : (m,) uint8
        The class of each model.
    details : (f, 5) float64
        Of each feature, see :func:`details_of`.
    """

    path: Path
    names: tuple[str, ...]
    first: int
    last: int
    features: Models
    postings: Postings
    scale: Scale
    class_sizes: AnyArray
    classes: AnyArray
    details: AnyArray
    _file: File
    _kept: OrderedDict[int, ModelIndex] = field(default_factory=OrderedDict)
    _numbers: dict[str, int] = field(default_factory=dict)
    _files: dict[str, tuple[str, str, str]] | None = None
    _lock: Lock = field(default_factory=Lock)
    _picked: WeakKeyDictionary[ModelIndex, ModelIndex] = field(default_factory=WeakKeyDictionary)

    def __len__(self) -> int:
        return len(self.names)

    def number(self, name: str) -> int:
        """The number of a model; raises KeyError."""
        if not self._numbers:
            self._numbers.update({name: number for number, name in enumerate(self.names)})
        return self._numbers[name]

    def feature_set(self, number: int) -> FeatureSet:
        """The features of a model, metres, model frame."""
        part = slice(int(self.features.starts[number]), int(self.features.starts[number + 1]))
        return features_of(self.features.rows[part], self.features.kind[part], self.details[part])

    def model(self, number: int) -> ModelIndex:
        """A model ready for matching; the last ones asked for are kept."""
        with self._lock:
            known = self._kept.get(number)
            if known is not None:
                self._kept.move_to_end(number)
                return known
        made = index_model(self.feature_set(number), self.names[number])
        with self._lock:
            self._kept[number] = made
            while len(self._kept) > KEPT_MODELS:
                self._kept.popitem(last=False)
        return made

    def one_of_all(self, model: ModelIndex) -> ModelIndex:
        """A model of this index as one that a scene has picked out of all; the same one as long as the model is kept.

        What is computed once for each ModelIndex is not computed again for the next scene.
        """
        with self._lock:
            if model not in self._picked:
                self._picked[model] = replace(model, library=len(self))
            return self._picked[model]

    def sources(self) -> Any:
        """Where the models are from, as it was written; raises ValueError when it is no JSON text."""
        return json.loads(bytes(self._file.arrays['sources']).decode())

    def check(self) -> None:
        """Compare the checksums of the file, which reads it once. Raises ValueError, which begins with its name."""
        try:
            self._file.check()
        except ValueError as error:
            raise ValueError(f'{self.path}: {error}') from None

    def outlined(self, model: ModelIndex) -> ModelIndex:
        """A model of this index with what its file says besides its features, where that file is still there.

        Looked for below the folder of the index, and nowhere else; a file that has changed since is not read.
        """
        with self._lock:
            if self._files is None:
                self._files = self._model_files()
        source = self._files.get(model.name)
        if source is None or model.shape is not None:
            return model
        path, digest, name = source
        folder = self.path.parent.resolve()
        full = (folder / path).resolve()
        try:
            if not full.is_relative_to(folder) or hashlib.sha256(full.read_bytes()).hexdigest() != digest:
                return model
            for given, known in load_known_models(full, mesh_units=self.sources()['mesh_units']).items():
                if safe_name(given) == name:
                    model.shape = known.outline
                    model.frames.update(known.frames)
        except (OSError, ValueError, KeyError, TypeError):
            pass  # its features are what is known of it then
        return model

    def _model_files(self) -> dict[str, tuple[str, str, str]]:
        """Scene or mesh file, its digest, and the name in it, by the names of models."""
        found = {}
        number = 0
        try:
            for one in self.sources()['files']:
                for name in one['models']:
                    if not one['path'].endswith(FEATURE_SUFFIX):
                        found[self.names[number]] = one['path'], one['files'][one['path']], name
                    number += 1
        except (KeyError, TypeError, IndexError, ValueError):
            return {}
        return found


def details_of(features: FeatureSet) -> AnyArray:
    """What rows of features do not say, (n, 5) float64: direction of the major radius, and arc."""
    return np.concatenate([features.major_axis, features.arc], axis=1)


def features_of(rows: AnyArray, kind: AnyArray, details: AnyArray) -> FeatureSet:
    """The features that :func:`.index.feature_rows` and :func:`details_of` were made of."""
    curve = (kind == FeatureKind.CURVE)[:, None]
    half = rows[:, 6:7] * rows[:, 3:6]
    start = np.where(curve, rows[:, 0:3], rows[:, 0:3] - half)
    end = np.where(curve, rows[:, 0:3] + rows[:, 3:6], rows[:, 0:3] + half)
    none = np.zeros(len(rows))
    return FeatureSet(kind, start, end, rows[:, 7:9], none, none, details[:, :3], details[:, 3:])


def open_catalogue(path: str | Path, share: Share | None = None, check: bool = True) -> Catalogue:
    """Open an index of models.

    Parameters
    ----------
    path : str or Path
        A file that ``index_models`` wrote.
    share : Share, optional
        The part of the models that is searched; all of them when left out.
    check : bool
        Compare all checksums: a second for each gigabyte. Without, :meth:`Catalogue.check` does it at any time; until
        then what is damaged may be answered wrongly, and harms nothing else.

    Returns
    -------
    Catalogue

    Raises
    ------
    OSError
        There is no such file.
    ValueError
        It is no index, of another version, or damaged; the message begins with its name.
    """
    path = Path(path).expanduser()
    file = read(path)
    facts, arrays = file.facts, file.arrays
    try:
        features = Models(*(arrays[name] for name in Models._fields))
        postings = Postings(*(arrays[f'pair_{name}'] for name in Postings._fields))
        names = tuple(str(one) for one in json.loads(bytes(arrays['names']).decode()))
        scale = Scale(float(facts['floor']), float(facts['share']))
        details = arrays['details']
        if check:
            file.check()
        _check(features, postings, details, names)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f'{path}: damaged: {str(error).removeprefix("damaged: ")}') from None
    sizes, classes = size_classes(features.sizes)
    first, last = (share or Share()).models(len(names))
    return Catalogue(path, names, first, last, features, postings, scale, sizes, classes, details, file)


def size_classes(sizes: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Classes of models by their sizes (metres): the largest of each class, rising, and the class of each model."""
    if len(sizes) == 0:
        return np.ones(1), np.zeros(0, np.uint8)
    low, high = float(sizes.min()), float(sizes.max())
    count = min(255, 1 + math.ceil(math.log(max(high / low, 1.0)) / math.log(CLASS_RATIO)))
    edges = np.geomspace(low, high, count + 1)[1:] if high > low else np.array([high])
    edges[-1] = high
    return edges, np.searchsorted(edges, sizes).astype(np.uint8)


def _check(features: Models, postings: Postings, details: AnyArray, names: Sequence[str]) -> None:
    """Refuse numbers that lead outside of an array. Raises ValueError.

    Those of single pairs are looked at where they are read (:func:`.lookup.gather`): there are very many.
    """
    models, rows, pairs = len(names), len(features.rows), len(postings.owner)
    wanted: dict[str, tuple[AnyArray, tuple[int, ...]]] = {
        'starts': (features.starts, (models + 1,)),
        'rows': (features.rows, (rows, 9)),
        'kind': (features.kind, (rows,)),
        'sizes': (features.sizes, (models,)),
        'centres': (features.centres, (models, 3)),
        'radii': (features.radii, (models,)),
        'details': (details, (rows, 5)),
        'pair_starts': (postings.starts, (CELLS + 1,)),
        'pair_members': (postings.members, (pairs, 2)),
        'pair_spans': (postings.spans, (pairs, 5)),
    }
    for name, (array, shape) in wanted.items():
        if array.shape != shape:
            raise ValueError(f'array {name} has shape {array.shape}, expected {shape}')
    for name, starts, end in (('starts', features.starts, rows), ('pair_starts', postings.starts, pairs)):
        if starts[0] != 0 or starts[-1] != end or (np.diff(starts) < 0).any():
            raise ValueError(f'array {name} does not rise from 0 to {end}')
    if not (np.isfinite(features.sizes).all() and (features.sizes > 0.0).all()):
        raise ValueError('a model without size')
    if rows and features.kind.max() > max(FeatureKind):
        raise ValueError('a feature of an unknown kind')


def table_bytes(value: Any) -> AnyArray:
    """A value as JSON text, (n,) uint8."""
    return np.frombuffer(json.dumps(value).encode(), np.uint8)
