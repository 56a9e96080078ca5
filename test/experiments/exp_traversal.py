"""What early outs and left-heavy trees save on the array machine (thesis 4.8), which prints no figures of them."""

from __future__ import annotations

import numpy as np
from lab import Experiment, Line, NotAvailable, Outcome, Plot, Setting, Table, mean
from thesis import TILING

from csg_renderer import Scene, Solid, load_scene, scene_names
from csg_renderer.raycast.engine_dap import render
from csg_renderer.raycast.frame import RenderOptions, RenderStats
from csg_renderer.raycast.programs.program import postfix
from csg_renderer.raycast.programs.tree_order import left_heavy, stack_depth
from csg_renderer.raycast.render import scene_rig
from dap_emulator import Dap
from msgs_py import PinholeCamera, Pose

HOLES = (2, 4, 8, 16, 32)
SIDE = 256


def traversal(setting: Setting) -> Outcome:
    names = [name for name in TILING if name in scene_names()]
    if not names:
        raise NotAvailable(f'csg_renderer has none of the scenes {", ".join(TILING)}')
    size = setting.pick(SIDE, 64)
    early = Table(
        f'Early outs on the emulated DAP 510, REAL*8, {size} x {size} pixels',
        [
            'scene',
            'brute force s ours',
            'with early outs s ours',
            'time saved % ours',
            'intersections saved % ours',
            'nodes saved % ours',
            'with early outs, left-heavy s ours',
            'tiling s ours',
            'tiling with early outs s ours',
            'time of tiling saved % ours',
        ],
    )
    for name in setting.pick(names, names[:1]):
        scene = load_scene(name)
        camera = scene_rig(scene, size, size).left
        setting.advance(f'{name}, brute force')
        plain, plain_s = emulated(scene, camera, tiling=False)
        outs, outs_s = emulated(scene, camera, tiling=False, early_outs=True)
        both_s = emulated(scene, camera, tiling=False, early_outs=True, left_heavy=True)[1]
        setting.advance(f'{name}, tiling')
        tiled_s, tiled_outs_s = (emulated(scene, camera, early_outs=option)[1] for option in (False, True))
        work = [saved(getattr(plain, what), getattr(outs, what)) for what in ('intersections', 'nodes')]
        brute = [plain_s, outs_s, saved(plain_s, outs_s), *work, both_s]
        early.rows.append([name, *brute, tiled_s, tiled_outs_s, saved(tiled_s, tiled_outs_s)])
    early.rows.append(['mean', *(mean([row[k] for row in early.rows]) for k in range(1, len(early.columns)))])
    early.summaries = 1
    heavy = Table(
        'Left-heavy trees: a plate minus one union of its holes, which leans to the right',
        [
            'holes',
            'lists on the stack ours',
            'lists, left-heavy ours',
            'bit-planes ours',
            'bit-planes, left-heavy ours',
            's ours',
            'left-heavy s ours',
        ],
    )
    camera = PinholeCamera.centred(setting.pick(128, 32), setting.pick(64, 32), setting.pick(100.0, 25.0))
    for holes in setting.pick(HOLES, HOLES[:2]):
        setting.advance(f'{holes} holes')
        solid = plate(holes)
        code = postfix(solid, 0)
        (plain, plain_s), (first, first_s) = (
            emulated(Scene(solid), camera, tiling=False, left_heavy=option) for option in (False, True)
        )
        lists = stack_depth(code), stack_depth(left_heavy(code))
        heavy.rows.append([holes, *lists, plain.dap_planes, first.dap_planes, plain_s, first_s])
    plots = [
        Plot(
            'Store that traversal needs',
            'holes of the plate',
            'bit-planes',
            [
                Line(label, [row[0] for row in heavy.rows], [row[k] for row in heavy.rows])
                for label, k in (('as written', 3), ('left-heavy', 4))
            ],
        )
    ]
    return Outcome(lambda tables: sentence(*tables), [early, heavy], plots, NOTES)


def sentence(early: Table, heavy: Table) -> str:
    """From the rows alone."""
    scenes = early.body
    average = [None, *(mean([row[k] for row in scenes]) for k in range(1, len(early.columns)))]
    most = max(scenes, key=lambda row: row[3])
    worse = max(scenes, key=lambda row: row[6] - row[2])
    without = [row[0] for row in scenes if row[4] == 0.0]
    none = f', nothing in {" and ".join(without)}, whose trees are unions' if without else ''
    last = heavy.rows[-1]
    return (
        f'Early outs save {average[3]:.0f} % of the time of brute force on average ({most[3]:.0f} % in '
        f'{most[0]}{none}), and {average[9]:.1f} % of that of tiling, whose pruned trees hold little that is out. A '
        f'left-heavy tree keeps {last[2]} lists on the stack instead of {last[1]} for {last[0]} holes, which takes '
        f'{last[4]} bit-planes instead of {last[3]} and {saved(last[5], last[6]):.1f} % less time. A DIFFERENCE that '
        f'has its second operand first has no early out: {worse[0]} takes {worse[6]:.3g} s with both options, '
        f'{worse[2]:.3g} s with early outs alone.'
    )


NOTES = [
    'Both are options of engine="dap" (`render --early-outs --left-heavy`), and change no pixel. What is right of an '
    'operator is left out when no ray of a 32 x 32 tile is in what is left of it; to know it costs a comparison and '
    'an ANY.',
    'Objects, and the operands of a UNION at the top of a tree, take no room on the stack here: the nearer of two '
    "hits is kept as they come. The thesis' scenes lean to the left as they are written, and gain no store.",
]


def emulated(scene: Scene, camera: PinholeCamera, **options: bool) -> tuple[RenderStats, float]:
    """Work and seconds of a rendering on a DAP 510."""
    dap = Dap.model('510', tracing=False)
    stats = render(scene, camera, scene.camera_T_scene, RenderOptions(**options), dap).stats
    return stats, stats.dap_cycles * dap.clock_s


def plate(holes: int) -> Solid:
    """A plate before the camera minus a row of cylinders, which are united from the right."""
    drill = Solid.cylinder(0.25 / holes, (0.0, 0.0, 0.4))
    drills = [drill.transformed(Pose(np.eye(3), [(k + 0.5) / holes - 0.5, 0.0, 0.8])) for k in range(holes)]
    union: Solid = drills.pop()
    while drills:
        union = drills.pop() | union
    return Solid.block(1.1, 0.3, 0.1).transformed(Pose(np.eye(3), [-0.55, -0.15, 1.0])) - union


def saved(before: float, after: float) -> float:
    """Per cent."""
    return 100.0 * (1.0 - after / max(before, 1e-12))


EXPERIMENTS = [Experiment('traversal', 'Early outs and left-heavy trees', '4.8', traversal)]
