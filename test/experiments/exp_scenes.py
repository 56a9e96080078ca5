"""The test scenes themselves: complexity, visible features, time of a stereo pair (Tables 5.1-5.3, 5.6, 6.1, 6.2)."""

from __future__ import annotations

import numpy as np
from lab import Experiment, NotAvailable, Outcome, Plot, Setting, Table, mean, timed, view
from lab import Line as L
from thesis import VIEWS

from csg_renderer import boundary, ideal_data, load_models, model_features, render_stereo, scene_path, visible_features
from csg_renderer.features import thesis_counts
from csg_renderer.features.thesis_counts import MODELS
from csg_renderer.scene.solid import FACES
from msgs_py import FeatureKind


def complexity(setting: Setting) -> Outcome:
    table = Table(
        'Model complexity',
        [
            'model',
            'primitives thesis',
            'ours',
            'half-spaces thesis',
            'ours',
            'faces thesis',
            'ours',
            'edges thesis',
            'ours',
            'curves thesis',
            'ours',
            'axes thesis',
            'ours',
        ],
    )
    differing, missing = [], []
    for name in setting.pick(list(MODELS), ['l_shape', 'cylinder_box']):
        setting.advance(name)
        printed = MODELS[name]
        try:
            solid = load_models(scene_path(name))[name]
        except (OSError, KeyError):
            missing.append(name)
            continue
        features = model_features(solid)
        counts = [int((features.kind == kind).sum()) for kind in FeatureKind]
        faces = sum(face.kind == 'plane' for face in boundary(solid).details.faces)
        ours = (len(solid.primitives), sum(len(FACES[leaf.kind]) for leaf in solid.primitives), faces, *counts)
        row: list = [name]
        for theirs, mine in zip(printed, ours):
            row += [theirs, mine]
            if theirs is not None and theirs != mine:
                differing.append(f'{name} ({theirs} | {mine})')
        table.rows.append(row)
    sentence = (
        'Every count that the thesis prints is met.'
        if not differing and not missing
        else f'All printed counts are met but those of {", ".join(differing) or "none"}'
        + (f'; not available yet: {", ".join(missing)}' if missing else '')
        + '.'
    )
    return Outcome(sentence, [table], notes=['Faces are planar faces; all counts come from the CSG tree.'])


def visibility(setting: Setting) -> Outcome:
    table = Table(
        'Visible data features of the 17 views',
        [
            'view',
            'model features thesis',
            'ours',
            'visible thesis',
            'left eye ours',
            'both eyes ours',
            'data pairs thesis',
            'data pairs ours',
            'log10 of potential interpretations thesis',
            'ours',
        ],
    )
    same = 0
    names = _views(setting)
    for name in names:
        setting.advance(name)
        this = view(name)
        placed = this.scene.placements[0]
        left = len(visible_features(placed.model, this.pose, this.rig.left))
        both = len(ideal_data(this.scene, this.rig).features)
        printed, e = thesis_counts.VIEWS[name].total, sum(MODELS[this.model][3:])
        table.rows.append(
            [
                name,
                e,
                len(this.features),
                printed,
                left,
                both,
                printed * (printed - 1) // 2,
                left * (left - 1) // 2,
                round(printed * np.log10(e), 1),
                round(left * np.log10(len(this.features)), 1),
            ]
        )
        same += printed == left
    return Outcome(
        f'{same} of {len(names)} views show as many features to the left eye as the thesis prints; the '
        'column '
        'for both eyes is what stereo can recover.',
        [table],
        notes=['Table 6.2 counts what the thesis recovered of the scenes with curves; ours are exact.'],
    )


def stereo_times(setting: Setting) -> Outcome:
    table = Table(
        'Time of a 512 x 512 stereo pair, tiling, one level',
        ['view', 'thesis DAP 510, s', 'ours emulated DAP 510, s', 'ratio', 'ours on this machine, ms'],
    )
    ratios: list[float | None] = []
    why = ''
    for name in [n for n in _views(setting) if VIEWS[n].stereo_s is not None]:
        setting.advance(name)
        this = view(name)
        _, native = timed(lambda this=this: render_stereo(this.scene, this.rig), setting.pick(5, 1))
        seconds = None
        if not why:
            try:
                frames = render_stereo(this.scene, this.rig, engine='dap')
                seconds = sum(frame.stats.dap_cycles for frame in frames) * 100e-9
            except (ValueError, NotImplementedError, ImportError) as error:
                why = str(error)
        printed = VIEWS[name].stereo_s
        ratios.append(None if seconds is None else seconds / printed)
        table.rows.append([name, printed, seconds, ratios[-1], round(1e3 * native, 2)])
    average = mean(ratios)
    if average is None:
        sentence = f'The emulated machine does not render: not available yet ({why}).'
    else:
        good = [r for r in ratios if r is not None]
        sentence = (
            f'The emulated DAP 510 takes {average:.2f} times the printed time on average ({min(good):.2f} to '
            f"{max(good):.2f}); the cost model is analytic, and the models' dimensions are ours."
        )
    lines = [L('thesis', [r[0] for r in table.rows], [r[1] for r in table.rows], 'bar')]
    if average is not None:
        lines.append(L('ours, emulated', [r[0] for r in table.rows], [r[2] for r in table.rows], 'bar'))
    return Outcome(sentence, [table], [Plot('Stereo pair on the DAP 510', 'view', 'seconds', lines)])


def _views(setting: Setting) -> list[str]:
    names = setting.pick(list(VIEWS), ['l_shape_v1', 'chipped_block_v1'])
    good = []
    for name in names:
        try:
            view(name)
        except NotAvailable:
            continue
        good.append(name)
    if not good:
        raise NotAvailable("csg_renderer has none of the thesis' views")
    return good


EXPERIMENTS = [
    Experiment('complexity', 'Complexity of the models', 'Tables 5.1, 5.3, 6.1', complexity),
    Experiment('visibility', 'Visible data features', 'Tables 5.6, 6.2', visibility),
    Experiment('stereo_times', 'Time to generate stereo pairs', 'Table 5.2', stereo_times),
]
