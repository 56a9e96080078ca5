"""The matcher beyond the thesis: clutter, noise, occlusion, many models, several instances."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from lab import Experiment, Line, Outcome, Plot, Setting, Table, average, within

from model_matcher import MatchParams, index_model, match, recognise
from model_matcher.closed_form.synthetic.scenes import MODELS, SyntheticScene, make_scene, random_polyhedron
from model_matcher.model.index import ModelIndex
from msgs_py import Interpretation

NAMES = ('l_shape', 'chair', 'plug')
SUCCESS = (
    "A success is a best pose (or one stated to be its equal) within 3 degrees and 3 % of the model's size of a true "
    'one, or an answer that explains every true fragment.'
)


def is_right(found: Interpretation | None, scene: SyntheticScene, size: float, instance: int = 0) -> bool:
    if found is None:
        return False
    truth = scene.poses[instance]
    errors = [pose.error_to(truth) for pose in (found.pose, *found.symmetric_poses)]
    if any(error.rotation_deg < 3.0 and error.translation < 0.03 * size for error in errors):
        return True
    return bool((found.assignment[scene.instance == instance] >= 0).all())


def _curve(
    setting: Setting,
    title: str,
    x_label: str,
    values: list,
    seeds: Callable[[float], int],
    scene_of: Callable,
    names: tuple[str, ...] = NAMES,
    params: MatchParams | None = None,
    factor: float = 100.0,
) -> tuple[Table, list[Plot]]:
    """Success and time of several models over one varied quantity."""
    table = Table(
        title, [x_label, *(f'{name}: {what} ours' for name in names for what in ('success %', 'ms', 'p95 ms'))]
    )
    success: dict[str, list] = {name: [] for name in names}
    times: dict[str, list] = {name: [] for name in names}
    indexes = {name: index_model(MODELS[name](), name) for name in names}
    for value in values:
        row: list = [round(factor * value, 2)]
        for name in names:
            setting.advance(f'{x_label} {factor * value:g}: {name}')
            index = indexes[name]
            good, spent = [], []
            for seed in range(setting.pick(seeds(value), 1)):
                scene = scene_of(index.features, seed, value)
                started = time.perf_counter()
                result = match(index, scene.data, params)
                spent.append(1e3 * (time.perf_counter() - started))
                good.append(is_right(result.best, scene, index.size))
            success[name].append(100.0 * float(np.mean(good)))
            times[name].append(float(np.median(spent)))
            row += [round(success[name][-1], 1), times[name][-1], float(np.percentile(spent, 95))]
        table.rows.append(row)
    x = [factor * value for value in values]
    plots = [
        Plot(f'{title}: success', x_label, '% of the scenes', [Line(n, x, success[n]) for n in names]),
        Plot(f'{title}: time', x_label, 'ms, median', [Line(n, x, times[n]) for n in names], log_y=True),
    ]
    return table, plots


def _success(table: Table) -> str:
    """The mean and the worst of all cells, and the time that goes with them."""
    shares = [share for name in NAMES for share in table.numbers(f'{name}: success % ours')]
    return f'{average(shares):.1f} % of the scenes (worst cell {min(shares):.0f} %)'


def _warm() -> None:
    model = MODELS['l_shape']()
    match(model, make_scene(model, 0).data)


def clutter(setting: Setting) -> Outcome:
    _warm()
    values = setting.pick([0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98], [0.0, 0.5])
    table, plots = _curve(
        setting,
        'Success and time against clutter',
        'clutter, % of the data',
        values,
        lambda v: 50 if v < 0.85 else 25 if v < 0.97 else 10,
        lambda model, seed, v: make_scene(model, seed, clutter=v),
    )
    return Outcome(
        lambda tables: (
            f'From {within(tables[0].numbers(tables[0].columns[0]), "g")} % clutter the matcher is right in '
            f'{_success(tables[0])}; the thesis left clutter as its open problem (7.4).'
        ),
        [table],
        plots,
        [SUCCESS],
    )


def noise(setting: Setting) -> Outcome:
    _warm()
    values = setting.pick([0.0, 0.5e-3, 1e-3, 2e-3, 3e-3, 4e-3, 5e-3], [0.5e-3])
    table, plots = _curve(
        setting,
        'Success and time against noise, 50 % clutter',
        'noise of every end point coordinate, mm',
        values,
        lambda v: 30,
        lambda model, seed, v: make_scene(model, seed, clutter=0.5, sigma=v),
        factor=1e3,
    )
    return Outcome(
        lambda tables: (
            f'From {within(tables[0].numbers(tables[0].columns[0]), "g")} mm of noise the matcher is right in '
            f"{_success(tables[0])}: models of 60 to 110 mm, the plug's pins are 4 mm wide."
        ),
        [table],
        plots,
        [SUCCESS],
    )


def occlusion(setting: Setting) -> Outcome:
    _warm()
    values = setting.pick([1.0, 0.75, 0.5, 0.4, 0.3, 0.2], [0.5])
    table, plots = _curve(
        setting,
        'Success and time against occlusion, 80 % clutter',
        'model features that are seen, %',
        values,
        lambda v: 30,
        lambda model, seed, v: make_scene(model, seed, clutter=0.8, visible=v),
    )
    return Outcome(
        lambda tables: (
            f'From {within(tables[0].numbers(tables[0].columns[0]), "g")} % of the features seen the matcher is '
            f'right in {_success(tables[0])}.'
        ),
        [table],
        plots,
        [SUCCESS],
    )


def library(setting: Setting) -> Outcome:
    """One known object among 1 to 1,000 models."""
    _warm()
    counts = setting.pick([1, 10, 100, 1000], [1, 3])
    table = Table(
        'One object in 50 % clutter against a library',
        ['models', 'index ms ours', 'recognised ours, %', 'false alarms ours', 'ms a scene ours', 'ms a model ours'],
    )
    indexes: list[ModelIndex] = []
    spent_indexing = 0.0
    times = []
    for count in counts:
        setting.advance(f'{count} models')
        started = time.perf_counter()
        indexes += [index_model(random_polyhedron(k), f'm{k}') for k in range(len(indexes), count)]
        spent_indexing += time.perf_counter() - started
        shelf = _shelf(indexes)
        good, spent, false = [], [], 0
        for seed in range(setting.pick(10 if count < 1000 else 3, 1)):
            which = int(np.random.default_rng([seed, 5]).integers(count))
            scene = make_scene(indexes[which].features, seed, clutter=0.5)
            started = time.perf_counter()
            found = recognise(shelf, scene.data)
            spent.append(1e3 * (time.perf_counter() - started))
            mine = next((item for item in found if item.model == indexes[which].name), None)
            good.append(is_right(mine, scene, indexes[which].size))
            false += sum(item.model != indexes[which].name for item in found)
        times.append(float(np.median(spent)))
        table.rows.append(
            [count, 1e3 * spent_indexing, 100.0 * float(np.mean(good)), false, times[-1], times[-1] / count]
        )
    return Outcome(
        say_library,
        [table],
        [
            Plot(
                'Time against the size of the library',
                'models',
                'ms a scene',
                [Line('ours', counts, times)],
                log_x=True,
                log_y=True,
            )
        ],
    )


def say_library(tables: list[Table]) -> str:
    (table,) = tables
    took = ', '.join(f'{count:.0f} in {1e-3 * ms:.2g} s' for count, ms in table.paired('models', 'ms a scene ours'))
    named = ', '.join(f'{share:.0f}' for share in table.numbers('recognised ours, %'))
    return (
        f'A scene takes, by the number of models, {took}; {named} % of the objects are named and placed, with '
        f'{sum(table.numbers("false alarms ours")):.0f} false alarms in all. Clutter here consists of models of the '
        'same kind, so a "false alarm" may be a likeness.'
    )


def _shelf(indexes: list[ModelIndex]):
    """A shared index where the matcher offers one, else the list."""
    try:
        from model_matcher.model.library import build_library
    except ImportError:
        return indexes
    return build_library(indexes)


def instances(setting: Setting) -> Outcome:
    _warm()
    table = Table(
        'Several instances in 50 % clutter',
        [
            'instances',
            'model',
            'all found ours, %',
            'instances found ours, %',
            'poses that are no instance ours',
            'ms ours',
        ],
    )
    shares = []
    for count in setting.pick([2, 3, 4, 5], [2]):
        for name in NAMES:
            setting.advance(f'{count} x {name}')
            index = index_model(MODELS[name](), name)
            every, each, spent, false = [], [], [], 0
            for seed in range(setting.pick(15, 1)):
                scene = make_scene(index.features, seed, clutter=0.5, instances=count)
                started = time.perf_counter()
                found = recognise([index], scene.data)
                spent.append(1e3 * (time.perf_counter() - started))
                hits = [any(is_right(item, scene, index.size, k) for item in found) for k in range(count)]
                every.append(all(hits))
                each += hits
                false += sum(not any(is_right(item, scene, index.size, k) for k in range(count)) for item in found)
            shares.append(100.0 * float(np.mean(each)))
            table.rows.append([count, name, 100.0 * float(np.mean(every)), shares[-1], false, float(np.median(spent))])
    return Outcome(
        lambda tables: (
            f'{average(tables[0].numbers("instances found ours, %")):.1f} % of all instances are found when '
            f'{within(tables[0].numbers("instances"), ".0f")} stand in one scene.'
        ),
        [table],
        notes=[SUCCESS],
    )


EXPERIMENTS = [
    Experiment('clutter', 'Clutter', '', clutter),
    Experiment('noise', 'Noise', '', noise),
    Experiment('occlusion', 'Occlusion', '', occlusion),
    Experiment('library', 'One to a thousand models', '', library),
    Experiment('instances', 'Two to five instances', '', instances),
]
