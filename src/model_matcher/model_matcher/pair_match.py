"""Matching straight from a stereo pair of files: recovery, the search, and what is wrong when nothing is found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from csg_renderer.mesh.files import MESH_SUFFIXES
from csg_renderer.mesh.units import METRES
from msgs_py import FeatureSet
from msgs_py.numeric.typed import AnyArray, ByteArray
from stereo_recovery.detection.edgels import as_grey
from stereo_recovery.diagnosis import doubts, remedies
from stereo_recovery.pair_files import PairFiles, read_pair
from stereo_recovery.pipeline import Recovery, recover

from .image_pose.views import Views
from .model.index import ModelIndex
from .model.library import load_library
from .params import MatchParams
from .pipeline import survey

# What a unit taken for another multiplies lengths by.
_MISTAKEN = sorted({a / b for a in METRES.values() for b in METRES.values()})


@dataclass(frozen=True, eq=False)
class RecoveredPair:
    """A pair of files and what recovery found in it."""

    pair: PairFiles
    recovery: Recovery

    @property
    def features(self) -> FeatureSet:
        """Left optical frame, metres."""
        return self.recovery.features

    @property
    def image(self) -> ByteArray:
        """The left image, (h, w, 3) uint8, to draw over."""
        return np.repeat(_bytes(self.pair.left)[..., None], 3, axis=2)

    @property
    def views(self) -> Views:
        """Both images, to look for outlines in."""
        return Views.of([_bytes(self.pair.left), _bytes(self.pair.right)], self.pair.rig)

    def doubts(self) -> list[str]:
        """What is wrong with the images even if something was found, and what to do, a line each."""
        return doubts(self.pair)

    def remedies(self) -> list[str]:
        """What is wrong with the images if nothing was found, and what to do, a line each."""
        return remedies(self.pair, self.recovery)


def recovered_pair(files: Sequence[Path], raw: bool = False, baseline: float | None = None) -> RecoveredPair:
    """Read left image, right image and calibration, and recover features. Raises as :func:`read_pair` does."""
    left, right, calibration = files
    pair = read_pair((left, right), calibration, raw, baseline)
    return RecoveredPair(pair, recover(pair.left, pair.right, pair.rig))


def hints_of(
    model: str,
    models: Sequence[ModelIndex],
    data: FeatureSet,
    params: MatchParams,
    recovered: RecoveredPair | None = None,
) -> list[str]:
    """Why nothing was found and what to do, as far as trying shows it: the images first, then the model's size."""
    hints = [] if recovered is None else recovered.remedies()
    if Path(model).suffix.lower() in MESH_SUFFIXES and not hints:
        # A mesh is one of four sizes: with each of them it is searched as any other, which few features suffice for.
        for unit in METRES:
            if survey(load_library([model], unit).models, data, params):
                return [f'{model}: is found when its unit is {unit}: give it with --mesh-units {unit}']
    scale = None if hints else wrong_scale(models, data, params)
    if scale is not None:
        hints.append(scale_remedy(model, scale, None if recovered is None else recovered.pair.rig.baseline))
    return hints


def wrong_scale(models: Sequence[ModelIndex], data: FeatureSet, params: MatchParams) -> float | None:
    """How many times its size a model fits the data at that it does not fit as it is; None when it fits at none."""
    if params.scale == 'free' or not len(data):
        return None
    best = survey(models, data, params.replace(scale='free')).best
    return None if best is None else float(best.pose.scale)


def scale_remedy(model: str, scale: float, baseline: float | None = None) -> str:
    """What to do about a model that fits at so many times its size, in a pair with this baseline (metres).

    Examples
    --------
    >>> scale_remedy('part.stl', 25.41).split(':')[1]
    ' fits at 25.41 times its size, as in taken for mm'
    """
    nearest = min(_MISTAKEN, key=lambda ratio: abs(np.log(scale / ratio)))
    given = 'METRES' if baseline is None else f'{baseline / (scale if nearest == 1.0 else nearest):.4g}'
    rig = f'if that is right, the baseline of the calibration is wrong: recover with --baseline {given}'
    if nearest == 1.0:
        return f'{model}: fits at {scale:.4g} times its size, as a part of another size: correct the model; {rig}'
    taken = ' or '.join(f'{a} taken for {b}' for a in METRES for b in METRES if METRES[a] / METRES[b] == nearest)
    where = 'UNITS in it' if Path(model).suffix.lower() == '.csg' else '--mesh-units'
    return f'{model}: fits at {scale:.4g} times its size, as {taken}: give the unit with {where}; {rig}'


def _bytes(image: AnyArray) -> ByteArray:
    """(h, w) uint8: grey levels."""
    return np.asarray(np.clip(np.rint(as_grey(image)), 0, 255), np.uint8)
