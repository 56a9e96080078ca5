"""What an experiment is, what it hands back, and the few things that many of them need."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from typing import Any

import numpy as np

from csg_renderer import Scene, default_rig, load_scene, model_features, render_stereo, scene_names, scene_path
from csg_renderer.raycast.sensor import SensorModel
from msgs_py import FeatureSet, Pose, StereoRig

Cell = float | int | str | None
# The sensor of every rendered experiment that does not vary it: 4 x 4 samples a pixel, pixels of blur, grey levels.
ANTIALIAS, PSF, NOISE = 4, 0.5, 2.0


class NotAvailable(Exception):
    """A part of the system that this experiment needs does not exist (yet); the message says which."""


@dataclass
class Table:
    """Rows of cells. A column's title says whose figure it is: '... thesis' or '... ours'."""

    title: str
    columns: list[str]
    rows: list[list[Cell]] = field(default_factory=list)
    # The last rows, so many, sum the others up or hold the thesis' own mean.
    summaries: int = 0

    @property
    def body(self) -> list[list[Cell]]:
        """The rows that are no summary."""
        return self.rows[: len(self.rows) - self.summaries]

    def column(self, title: str) -> list[Cell]:
        """The cells of a column, summaries left out."""
        k = self.columns.index(title)
        return [row[k] for row in self.body]

    def numbers(self, title: str) -> list[float]:
        """The numbers of a column, summaries and gaps left out."""
        return [float(cell) for cell in self.column(title) if isinstance(cell, (int, float, np.number))]

    def paired(self, one: str, other: str) -> list[tuple[float, float]]:
        """The numbers of two columns, of the rows that have both."""
        both = zip(self.column(one), self.column(other))
        return [(float(a), float(b)) for a, b in both if all(isinstance(x, (int, float, np.number)) for x in (a, b))]


@dataclass
class Line:
    """One series of a plot; style is '-' (line), 'o' (marks), 'o-', '--' (a bound or a reference) or 'bar'."""

    label: str
    x: list
    y: list
    style: str = 'o-'


@dataclass
class Plot:
    """Drawn by page.py from the saved result."""

    title: str
    x_label: str
    y_label: str
    lines: list[Line]
    log_x: bool = False
    log_y: bool = False


@dataclass
class Outcome:
    """What an experiment found.

    say : the one sentence on agreement with the thesis, or the lesson, made from the tables and from nothing else;
    notes : what to know; spoken : the tables, by place, of which every row counts in the sentence;
    page : HTML of what was seen, to turn in space
    """

    say: Callable[[list[Table]], str]
    tables: list[Table] = field(default_factory=list)
    plots: list[Plot] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    spoken: tuple[int, ...] = (0,)
    page: str | None = None

    @property
    def sentence(self) -> str:
        return self.say(self.tables)

    def as_dict(self) -> dict[str, Any]:
        plain = {name: [asdict(item) for item in getattr(self, name)] for name in ('tables', 'plots')}
        return {'sentence': self.sentence, **plain, 'notes': self.notes}


@dataclass(frozen=True)
class Setting:
    """tiny : the smallest run that exercises all plumbing; advance : called with what is done next"""

    tiny: bool = False
    advance: Callable[[str], None] = lambda what: None

    def pick(self, full: Any, tiny: Any) -> Any:
        return tiny if self.tiny else full


@dataclass(frozen=True)
class Experiment:
    """name : for --only; reference : of the thesis, or '' for what goes beyond it; run : does it"""

    name: str
    title: str
    reference: str
    run: Callable[[Setting], Outcome]

    @property
    def command(self) -> str:
        return f'python test/experiments/run.py --only {self.name} --force'


# -- scenes ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class View:
    """A scene of csg_renderer with its first object. pose : left_T_model; features : of the model, model frame."""

    name: str
    scene: Scene
    rig: StereoRig
    model: str
    features: FeatureSet
    pose: Pose


@cache
def view(name: str) -> View:
    """Raises NotAvailable when csg_renderer has no such scene."""
    if name not in scene_names():
        raise NotAvailable(f'csg_renderer has no scene {name!r}')
    scene = load_scene(scene_path(name))
    placed = scene.placements[0]
    return View(
        name,
        scene,
        default_rig(scene),
        placed.name,
        model_features(placed.model),
        scene.camera_T_scene.compose(placed.pose),
    )


def stereo_images(
    scene: Scene,
    rig: StereoRig,
    seed: int = 0,
    antialias: int = ANTIALIAS,
    psf: float = PSF,
    noise: float = NOISE,
    left_T_scene: Pose | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """(h, w) uint8 left and right, as a camera would give them."""
    frames = render_stereo(scene, rig, left_T_scene, antialias=antialias, psf=psf)
    left, right = (
        SensorModel(psf, noise, (seed, 0, eye)).picture(frame, monochrome=True) for eye, frame in enumerate(frames)
    )
    return left, right


@cache
def recovered(name: str, seed: int = 0) -> FeatureSet:
    """What stereo_recovery finds in the rendered pair of a scene: the 'non-ideal data' of the thesis."""
    from stereo_recovery import recover

    this = view(name)
    return recover(*stereo_images(this.scene, this.rig, seed), this.rig).features


def stating(features: FeatureSet, err_par: float, err_per: float) -> FeatureSet:
    """The same features with other stated errors, metres."""
    n = len(features)
    return FeatureSet(
        features.kind,
        features.start,
        features.end,
        features.radii,
        np.full(n, err_par),
        np.full(n, err_per),
        features.major_axis,
        features.arc,
    )


def timed(function: Callable[[], Any], repeats: int = 3) -> tuple[Any, float]:
    """Last result and the least of several times, seconds. A call that compiles something does not count."""
    from numba.core.event import install_recorder

    best = np.inf
    result = None
    counted = 0
    while counted < max(repeats, 1):
        with install_recorder('numba:compile') as compiled:
            started = time.perf_counter()
            result = function()
            spent = time.perf_counter() - started
        if compiled.buffer:
            continue
        counted += 1
        best = min(best, spent)
        if best > 1.0:
            break
    return result, best


def within(values: Sequence[float], form: str = '.2f') -> str:
    """'0.12 to 0.68', the least and the largest."""
    return f'{min(values):{form}} to {max(values):{form}}' if values else 'no figure'


def average(values: Sequence[float]) -> float:
    """The mean; NaN of nothing."""
    return float(np.mean(values)) if len(values) else float('nan')


def geometric_mean(values: Sequence[float]) -> float:
    """Of positive numbers; NaN of nothing."""
    return float(np.exp(np.mean(np.log(values)))) if len(values) else float('nan')


def ratio(a: float | None, b: float | None) -> float | None:
    return None if a is None or not b else a / b


def mean(values: Sequence[float | None]) -> float | None:
    good = [value for value in values if value is not None and np.isfinite(value)]
    return float(np.mean(good)) if good else None
