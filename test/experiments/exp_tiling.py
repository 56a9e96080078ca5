"""Tiling against brute force (thesis 4.13, Tables 4.3, 4.4, Figures 4.15 to 4.25)."""

from __future__ import annotations

from collections.abc import Sequence
from unittest import mock

import numpy as np
from lab import Cell, Experiment, Line, NotAvailable, Outcome, Plot, Setting, Table, average, timed
from lab import view as lab_view
from machine_times import BYTES, WORD_LENGTH
from thesis import (
    PLATE_LIGHTS,
    PLATE_MINUTES,
    PREPROCESS_S,
    SERIAL_OVER_PARALLEL,
    TILING,
    TILING_SAVED,
    TILING_SPEEDUP,
    VIEWS,
)

from csg_renderer import Frame, Scene, default_camera, load_scene, render, scene_names, scene_path
from csg_renderer.features import thesis_counts
from csg_renderer.raycast import engine_dap
from csg_renderer.raycast.array_machine.caster import Caster
from csg_renderer.raycast.flatten import flatten
from csg_renderer.raycast.frame import RenderOptions, RenderStats
from csg_renderer.raycast.programs.program import program_of, view_of
from csg_renderer.raycast.view_data import plan_of, view_data
from csg_renderer.scene.solid import FACES
from dap_emulator import Dap
from dap_emulator.machine.costs import CostTable
from dap_emulator.machine.kinds import real
from dap_emulator.machine.mapping import Layout
from msgs_py import PinholeCamera

# What the emulated machine's cycles are charged to.
PARTS = ('other', 'intersections', 'combines', 'shading')
OTHER, INTERSECTIONS, COMBINES, SHADING = range(4)
TILE, TILES = 32, 256
HOW = {False: 'brute force', True: 'tiling'}


def _charged_to(part: int, function):
    """The method of an object that has a machine, its work charged to a part."""

    def charged(self, *arguments, **options):
        with self.dap.at_line(part):
            return function(self, *arguments, **options)

    return charged


class _Profiled(Caster):
    localise = _charged_to(INTERSECTIONS, Caster.localise)
    leaf = _charged_to(INTERSECTIONS, Caster.leaf)
    combine = _charged_to(COMBINES, Caster.combine)


def emulated(scene: Scene, camera: PinholeCamera, tiled: bool, length: int) -> tuple[Frame, float, list[float]]:
    """A rendering on the emulated DAP: the frame, seconds, and the seconds of each of PARTS."""
    dap = Dap.model('510', tracing=False)
    shade = _charged_to(SHADING, engine_dap._Tracer._shade)
    with mock.patch.object(engine_dap, 'Caster', _Profiled), mock.patch.object(engine_dap._Tracer, '_shade', shade):
        frame = engine_dap.render(scene, camera, scene.camera_T_scene, RenderOptions(tiling=tiled), dap, length)
    lines = dap.stats().lines
    return frame, dap.seconds, [lines.get(part, (0, 0))[1] * dap.clock_s for part in range(len(PARTS))]


def preparation(scene: Scene, camera: PinholeCamera) -> float:
    """Seconds that this machine takes to find out which pixels each primitive may touch."""
    flat = flatten(program_of(scene))

    def prepare() -> None:
        view = view_of(flat.program, scene.camera_T_scene)
        data = view_data(flat, view, scene.camera_T_scene)
        plan_of(flat, view, data, camera, RenderOptions())

    return timed(prepare, 5)[1]


class _Rendered:
    """A scene rendered with tiling and by brute force, here and on the emulated machine in both word lengths."""

    def __init__(self, name: str, setting: Setting, size: int) -> None:
        self.name, self.size = name, size
        self.scene = load_scene(scene_path(name))
        own = self.scene.camera is None or setting.tiny
        self.camera = default_camera(size) if own else self.scene.camera
        self.frames: dict[bool, Frame] = {}
        self.here: dict[bool, float] = {}
        self.machine: dict[tuple[bool, int], float] = {}
        self.shares: dict[tuple[bool, int], list[float]] = {}
        for tiled in (True, False):
            how = HOW[tiled]
            setting.advance(f'{name}, {how}')
            self.frames[tiled], self.here[tiled] = timed(
                lambda tiled=tiled: render(self.scene, self.camera, tiling=tiled), setting.pick(5, 1)
            )
            for length in BYTES:
                setting.advance(f'{name}, emulated, {how}, REAL*{length}')
                _, self.machine[tiled, length], parts = emulated(self.scene, self.camera, tiled, length)
                self.shares[tiled, length] = [100.0 * part / sum(parts) for part in parts]

    @property
    def tile_share(self) -> float:
        """Of the scene's primitives, what a rendered tile's tree holds."""
        return _tile_tree(self.frames[True].stats, self.frames[False].stats, TILE * TILE, self.size**2)

    def counted(self, what: str) -> tuple[int, int]:
        """Of brute force and of tiling."""
        return getattr(self.frames[False].stats, what), getattr(self.frames[True].stats, what)


def tiling(setting: Setting) -> Outcome:
    names = [name for name in TILING if name in scene_names()]
    if not names:
        raise NotAvailable(f'csg_renderer has none of the scenes {", ".join(TILING)}')
    names = setting.pick(names, names[:1])
    size = setting.pick(512, 64)
    scenes = [_Rendered(name, setting, size) for name in names]
    tables = [
        _counts_table(scenes),
        _work_table(scenes),
        _totals_table(scenes),
        _speed_table(scenes),
        _matrix_table(scenes),
        _serial_table(scenes),
        *(_profile_table(scenes, length) for length in BYTES),
    ]
    speed = tables[3]
    plots = [
        Plot(
            'Brute force / tiling',
            'scene',
            'times faster',
            [
                Line('ours on this machine', names, speed.column('this machine ours'), 'bar'),
                *(Line(f'emulated, REAL*{n}', names, speed.column(f'REAL*{n} ours'), 'bar') for n in BYTES),
                Line('thesis', names, speed.column('DAP 510 thesis'), 'bar'),
            ],
        ),
        Plot(
            'Profile of brute force and of tiling on the emulated DAP, REAL*4',
            'scene and method',
            '% of the time',
            [
                Line(
                    part,
                    [f'{name} {how}' for name in names for how in ('brute', 'tiling')],
                    [one.shares[tiled, 4][k] for one in scenes for tiled in (False, True)],
                    'bar',
                )
                for k, part in enumerate(PARTS)
                if k
            ],
        ),
    ]
    notes = [
        'Both engines test every product on every pixel by brute force. This machine gains less by tiling than its '
        'count of intersections says: it tests a row of pixels at once in vector instructions, leaves out the '
        'cutters of a product that no ray of the row enters, and spends the same time on shading and on the frame '
        'either way.',
        'Intersections are counted a ray. The serial program on a Sun 3/160 cannot be run again: its times over '
        'those of the DAP stand beside the times of the emulated DAP over those of this machine. Preparing the tiles '
        f'is work of the host: {PREPROCESS_S} s an image in the thesis, which stands beside ours, and is not charged '
        "to the emulated machine's own time.",
        WORD_LENGTH,
    ]
    return Outcome(say_tiling, tables, plots, notes, spoken=(1, 3))


def _counts_table(scenes: list[_Rendered]) -> Table:
    table = Table(
        'Complexity and tiles (Tables 4.3, 4.4; Figures 4.15, 4.19, 4.20)',
        [
            'scene',
            'primitives thesis',
            'primitives ours',
            'half-spaces thesis',
            'half-spaces ours',
            'tiles of 256 thesis',
            'tiles ours',
            'visible pixels ours, %',
            "a tile's primitives ours, % of the scene",
        ],
    )
    for one in scenes:
        half_spaces = sum(len(FACES[leaf.kind]) for leaf in one.scene.primitives)
        printed = TILING[one.name]
        tiled = one.frames[True]
        ours = len(one.scene.primitives), half_spaces, tiled.stats.tiles
        table.rows.append(
            [
                one.name,
                *(cell for pair in zip(printed, ours) for cell in pair),
                round(100 * float(tiled.mask.mean()), 1),
                round(100 * one.tile_share, 1),
            ]
        )
    _add_means(table, [8])
    table.rows.append(['thesis, mean', *[None] * 7, TILING_SAVED['tile_tree_percent']])
    table.summaries = 2
    return table


WORK = ('intersections', 'nodes', 'combines')


def _work_table(scenes: list[_Rendered]) -> Table:
    table = Table(
        'Work saved by tiling, %', ['scene', *(f'{what} {who}' for what in WORK for who in ('thesis', 'ours'))]
    )
    for one in scenes:
        saved = [round(100 * (1 - tiled / max(brute, 1)), 1) for brute, tiled in map(one.counted, WORK)]
        printed = (
            TILING_SAVED['robot_arm_intersections'] if one.name == 'robot_arm' else '> 90',
            '> 90',
            TILING_SAVED['geneva_wheel_combines'] if one.name == 'geneva_wheel' else None,
        )
        table.rows.append([one.name, *(cell for pair in zip(printed, saved) for cell in pair)])
    _add_means(table, [2, 4, 6])
    table.rows[-1][5] = TILING_SAVED['combines_mean']
    table.summaries = 1
    return table


def _totals_table(scenes: list[_Rendered]) -> Table:
    table = Table(
        'Totals (Figures 4.22 to 4.24), millions; the printed bars are lost',
        ['scene', *(f'{what}, {how} ours' for what in WORK for how in ('brute force', 'tiling'))],
    )
    for one in scenes:
        table.rows.append([one.name, *(round(count / 1e6, 3) for what in WORK for count in one.counted(what))])
    return table


def _speed_table(scenes: list[_Rendered]) -> Table:
    table = Table(
        'Brute force / tiling, times; and seconds on the emulated DAP 510 (Figure 4.18)',
        [
            'scene',
            'DAP 510 thesis',
            *(f'REAL*{n} ours' for n in BYTES),
            *(f"REAL*{n} with the host's {PREPROCESS_S} s ours" for n in BYTES),
            'this machine ours',
            *(f'{how}, REAL*{n}, s ours' for n in BYTES for how in HOW.values()),
            *(f'{how}, this machine, ms ours' for how in HOW.values()),
        ],
    )
    for one in scenes:
        m = one.machine
        table.rows.append(
            [
                one.name,
                TILING_SPEEDUP.get(one.name),
                *(m[False, n] / m[True, n] for n in BYTES),
                *(m[False, n] / (m[True, n] + PREPROCESS_S) for n in BYTES),
                one.here[False] / one.here[True],
                *(m[tiled, n] for n in BYTES for tiled in HOW),
                *(1e3 * one.here[tiled] for tiled in HOW),
            ]
        )
    _add_means(table, range(2, 11))
    table.rows[-1][1] = TILING_SPEEDUP['mean']
    table.summaries = 1
    return table


def _matrix_table(scenes: list[_Rendered]) -> Table:
    table = Table(
        'A 32 x 32 matrix of the emulated DAP (Figures 4.19 to 4.21)',
        [
            'scene',
            'tiles rendered, % thesis',
            'tiles rendered, % ours',
            *(f'primitives, {how} ours' for how in HOW.values()),
            *(f'{how}, REAL*{n}, ms ours' for n in BYTES for how in HOW.values()),
        ],
    )
    for one in scenes:
        tiles, rendered = (one.size // TILE) ** 2, one.frames[True].stats.tiles
        primitives = {False: len(one.scene.primitives), True: round(one.tile_share * len(one.scene.primitives), 1)}
        matrices = {False: tiles, True: max(rendered, 1)}
        table.rows.append(
            [
                one.name,
                round(100 * TILING[one.name][2] / TILES, 1),
                round(100 * rendered / tiles, 1),
                *(primitives[tiled] for tiled in HOW),
                *(1e3 * one.machine[tiled, n] / matrices[tiled] for n in BYTES for tiled in HOW),
            ]
        )
    return table


def _serial_table(scenes: list[_Rendered]) -> Table:
    table = Table(
        'Serial against parallel (Figures 4.16, 4.17), times',
        [
            'scene',
            *(f'Sun 3/160 over DAP, {how} thesis' for how in HOW.values()),
            *(f'emulated DAP over this machine, {how}, REAL*{n} ours' for n in BYTES for how in HOW.values()),
        ],
    )
    for one in scenes:
        printed = [SERIAL_OVER_PARALLEL[how].get(one.name) for how in HOW.values()]
        ours = [one.machine[tiled, n] / one.here[tiled] for n in BYTES for tiled in HOW]
        table.rows.append([one.name, *printed, *ours])
    _add_means(table, range(3, 3 + 2 * len(BYTES)))
    table.rows[-1][1:3] = [SERIAL_OVER_PARALLEL[how]['mean'] for how in HOW.values()]
    table.summaries = 1
    return table


def _profile_table(scenes: list[_Rendered], length: int) -> Table:
    table = Table(
        f'Where the time of rendering goes, REAL*{length}, % (Figure 4.25)',
        [
            'scene',
            *(f'{part}, {how} ours' for how in HOW.values() for part in PARTS[1:]),
            'preparing the tiles, this machine ours',
        ],
    )
    for one in scenes:
        before = 100.0 * preparation(one.scene, one.camera) / one.here[True]
        shares = [round(one.shares[tiled, length][k], 1) for tiled in HOW for k in (1, 2, 3)]
        table.rows.append([one.name, *shares, round(before, 1)])
    _add_means(table, range(1, 8))
    preparing = f'{TILING_SAVED["preparation_percent"]} (DAP 510)'
    table.rows.append(['thesis', 'most, about 90', None, None, 'most', None, None, preparing])
    table.summaries = 2
    return table


def _add_means(table: Table, columns: Sequence[int]) -> None:
    """A last row with the means of some columns."""
    body = list(table.rows)
    row: list[Cell] = ['mean', *[None] * (len(table.columns) - 1)]
    for k in columns:
        row[k] = average([float(r[k]) for r in body if isinstance(r[k], (int, float, np.floating))])
    table.rows.append(row)


def say_tiling(tables: list[Table]) -> str:
    _, work, _, speed, _, _, short, _ = tables
    saved = {what: work.numbers(f'{what} ours') for what in WORK}
    above = sum(value > TILING_SAVED['intersections_least'] for what in WORK[:2] for value in saved[what])
    faster = {n: average(speed.numbers(f'REAL*{n} ours')) for n in BYTES}
    hosted = {n: average(speed.numbers(f"REAL*{n} with the host's {PREPROCESS_S} s ours")) for n in BYTES}
    brute, tiled = (average(short.numbers(f'intersections, {how} ours')) for how in HOW.values())
    shading = average(short.numbers('shading, tiling ours'))
    first = 'the intersection' if tiled >= shading else 'shading'
    return (
        f'Tiling saves {average(saved["intersections"]):.1f} % of the intersections and '
        f'{average(saved["nodes"]):.1f} % of the nodes (thesis: more than 90 % of both everywhere; ours in {above} '
        f'of {len(saved["nodes"]) + len(saved["intersections"])} cases) and {average(saved["combines"]):.1f} % of '
        f'the combines ({TILING_SAVED["combines_mean"]} %); brute force over tiling: the emulated DAP '
        f'{faster[4]:.1f} times with REAL*4 and {faster[8]:.1f} with REAL*8, {hosted[4]:.1f} and {hosted[8]:.1f} '
        f"when the printed time of the host's tiling is added (thesis {TILING_SPEEDUP['mean']}), this machine "
        f'{average(speed.numbers("this machine ours")):.1f} times. Intersections take {brute:.0f} % of the time of '
        f'brute force with REAL*4 (thesis: about 90 %) and {tiled:.0f} % with tiling, where {first} comes first '
        f'(thesis: intersections); shading takes {shading:.0f} %.'
    )


def plate(setting: Setting) -> Outcome:
    """The table scene, two levels: reflection and transparency, then shadows too."""
    table = Table(
        'The table scene of Plate 4.1, two levels, 512 x 512, minutes',
        [
            'picture',
            'primitives thesis',
            'primitives ours',
            'lights thesis',
            'lights ours',
            'DAP 510 thesis',
            *(f'emulated, REAL*{n} ours' for n in BYTES),
            *(f'REAL*{n}, ours / thesis' for n in BYTES),
        ],
    )
    scene = load_scene(scene_path('table'))
    camera = default_camera(64) if setting.tiny else scene.camera or default_camera(512)
    for what, minutes in PLATE_MINUTES.items():
        spent = []
        for length in BYTES:
            setting.advance(f'{what}, REAL*{length}')
            options = RenderOptions(levels=2, shadows=what == 'with shadows')
            if setting.tiny:
                options = RenderOptions(levels=1)
            frame = engine_dap.render(scene, camera, scene.camera_T_scene, options, length=length)
            spent.append(frame.stats.dap_cycles * 100e-9 / 60.0)
        table.rows.append(
            [
                what,
                thesis_counts.SCENES['table'].primitives,
                len(scene.primitives),
                PLATE_LIGHTS,
                len(scene.lights),
                minutes,
                *spent,
                *(one / minutes for one in spent),
            ]
        )
    return Outcome(
        say_plate,
        [table],
        notes=['Whether the printed pictures were made with tiling the text does not say; ours were.', WORD_LENGTH],
    )


def say_plate(tables: list[Table]) -> str:
    (table,) = tables
    cells = zip(*(table.column(c) for c in ('picture', 'DAP 510 thesis', *(f'emulated, REAL*{n} ours' for n in BYTES))))
    parts = [
        f'{what} {printed:.0f} minutes in the thesis, {short:.1f} with REAL*4 and {long:.1f} with REAL*8 here'
        for what, printed, short, long in cells
    ]
    printed, *ours = (table.column(c) for c in ('DAP 510 thesis', *(f'emulated, REAL*{n} ours' for n in BYTES)))
    factor = ', '.join(f'{values[1] / values[0]:.1f} times with REAL*{n}' for n, values in zip(BYTES, ours))
    said = '; '.join(parts)
    return (
        f'{said[0].upper()}{said[1:]}. Shadows cost {printed[1] / printed[0]:.2f} times the time there, and {factor}.'
    )


# -- what one tile takes ---------------------------------------------------------------------------------------------

# Kinds of operation, and the names of the cost model that they gather.
GROUPS = {
    'add, subtract': ('add', 'subtract', 'negate', 'absolute'),
    'multiply': ('multiply', 'power'),
    'divide': ('divide',),
    'square root, functions': ('sqrt', 'function'),
    'compare': ('compare', 'minmax'),
    'merge, masked and plain copies': ('merge', 'masked_copy', 'copy', 'convert'),
    'LOGICAL': ('logic', 'not', 'any_all', 'pattern', 'first_true'),
    'broadcast, fetch, other': (),
}


def tile_budget(setting: Setting) -> Outcome:
    """Every operation of one tile in the middle of L-shape v1, by kind."""
    name = 'l_shape_v1'
    this = lab_view(name)
    camera = this.rig.left
    whole = {
        n: engine_dap.render(this.scene, camera, this.scene.camera_T_scene, RenderOptions(), length=n).stats
        for n in BYTES
    }
    counts = {n: _one_tile(this.scene, camera, n) for n in BYTES}
    table = Table(
        f'One tile of {name}, 32 x 32 rays, {len(this.scene.primitives)} blocks, lights: {len(this.scene.lights)}; '
        'operations and cycles',
        [
            'operation',
            'how often ours',
            *(f'REAL*{n}, thousand cycles ours' for n in BYTES),
            *(f'REAL*{n}, % ours' for n in BYTES),
        ],
    )
    totals = {n: sum(cycles for _, cycles in counts[n].values()) for n in BYTES}
    for group in GROUPS:
        cycles = [counts[n][group][1] for n in BYTES]
        shares = [100.0 * c / totals[n] for c, n in zip(cycles, BYTES)]
        table.rows.append(
            [group, counts[4][group][0], *(round(c / 1e3, 1) for c in cycles), *(round(s, 1) for s in shares)]
        )
    table.rows.append(
        [
            'all',
            sum(count for count, _ in counts[4].values()),
            *(round(totals[n] / 1e3, 1) for n in BYTES),
            100.0,
            100.0,
        ]
    )
    table.summaries = 1
    return Outcome(
        say_tile_budget,
        [table, _against_print(name, whole), _what_print_adds(whole)],
        notes=[
            'The thesis prints no time of an operation of this program, no count of operations and no word length. '
            'Unknown besides: what its compiler stores between operations, what a subroutine call and the serial '
            'code of the control unit cost, and the time of an image over the fast channel to the screen and to the '
            'host.'
        ],
        spoken=(0, 2),
    )


def _one_tile(scene: Scene, camera: PinholeCamera, length: int) -> dict[str, tuple[int, int]]:
    """How often each group of operations is done for the tile that shows most, and its cycles."""
    dap = Dap.model('510', tracing=False)
    view = view_of(program_of(scene), scene.camera_T_scene)
    tracer = engine_dap._Tracer(dap, view, camera, RenderOptions(), length)
    areas = [tile for tile in engine_dap.tiles(view, camera, TILE) if tile.children]
    tile = max(areas, key=lambda tile: np.isfinite(tracer.trace(tile, 0.0, 0.0, False)[2]).sum())
    dap.reset()
    tracer.trace(tile, 0.0, 0.0)
    found = dict.fromkeys(GROUPS, (0, 0))
    for operation, (count, cycles) in dap.stats().operations.items():
        kind = operation.split()[0]
        group = next((g for g, names in GROUPS.items() if kind in names), 'broadcast, fetch, other')
        found[group] = found[group][0] + count, found[group][1] + cycles
    return found


def _against_print(name: str, whole: dict[int, RenderStats]) -> Table:
    """What is printed of the same image, and what is predicted of it."""
    printed = VIEWS[name].stereo_s
    table = Table('What is printed of it', ['what', 'thesis', *(f'REAL*{n} ours' for n in BYTES)])
    seconds = {n: stats.dap_cycles * 100e-9 for n, stats in whole.items()}
    table.rows += [
        ['an image, s (half of Table 5.2)', printed / 2, *(seconds[n] for n in BYTES)],
        ["of it the host's tiling, s (4.13.2)", PREPROCESS_S, None, None],
        ['tiles', None, *(whole[n].tiles for n in BYTES)],
        [
            'ms a tile, as many tiles as ours taken',
            1e3 * (printed / 2 - PREPROCESS_S) / whole[4].tiles,
            *(1e3 * seconds[n] / whole[n].tiles for n in BYTES),
        ],
    ]
    return table


# What a ray that every PE holds for itself takes to meet a block, in operations.
SLABS = {'divide': 3, 'multiply': 6, 'subtract': 6, 'merge': 10, 'compare': 7}
# For each of six planes: t = -O/D, then two coordinates of the point and their bounds (Table 4.1).
PLANES = {'divide': 6, 'multiply': 12, 'add': 12, 'subtract': 6, 'compare': 30, 'masked_copy': 12}
# For each of six surfaces P'QP = 0: the products of D with itself and with Q, Q O, D'QO, O'QO, the root, both solutions
# (section 4.7), then the point and its bounds.
QUADRICS = {'multiply': 6 * 41, 'add': 6 * 29, 'sqrt': 6, 'divide': 12, 'compare': 36, 'masked_copy': 12}


def _what_print_adds(whole: dict[int, RenderStats]) -> Table:
    """Predicted times of what the text describes and our program does otherwise."""
    costs, tile = CostTable(), Layout((TILE, TILE), es=TILE)
    table = Table(
        'A block as the text may mean it (Table 4.1, section 4.7), predicted',
        [
            'how a ray meets a block',
            *(f'thousand cycles a block, REAL*{n} ours' for n in BYTES),
            *(f'ms a tile with it, REAL*{n} ours' for n in BYTES),
        ],
    )

    def cycles(length: int, operations: dict[str, int]) -> float:
        kind = real(length)
        return sum(times * costs.cycles(name, kind, tile) for name, times in operations.items()) / 1e3

    for title, operations in (
        ('three slabs, a reciprocal each: our program', SLABS),
        ('six planes, a division and the bounds of two coordinates each', PLANES),
        ('six general quadrics, root and all, then the bounds', QUADRICS),
    ):
        spent = [cycles(n, operations) for n in BYTES]
        ms = []
        for n, one in zip(BYTES, spent):
            stats = whole[n]
            blocks = stats.intersections / (6 * TILE * TILE * stats.tiles)
            ms.append(0.1 * (stats.dap_cycles / 1e3 / stats.tiles + blocks * (one - cycles(n, SLABS))))
        table.rows.append([title, *(round(one, 1) for one in spent), *ms])
    return table


def say_tile_budget(tables: list[Table]) -> str:
    table, printed, block = tables
    parts = []
    for n in BYTES:
        spent = table.numbers(f'REAL*{n}, thousand cycles ours')
        order = sorted(zip(spent, table.column('operation')), reverse=True)
        first = ', '.join(f'{what} {100 * cycles / sum(spent):.0f} %' for cycles, what in order[:4])
        parts.append(f'{sum(spent) / 10:.1f} ms with REAL*{n} ({first})')
    left = printed.body[-1][1]
    ours, planes, quadrics = ([row[3 + k] for k in range(len(BYTES))] for row in block.body)
    return (
        f'The operations of one tile are predicted to take {" and ".join(parts)}. A tile of the whole picture takes '
        f'{ours[0]:.0f} and {ours[1]:.0f} ms; the print leaves {left:.0f} ms, {left / ours[0]:.1f} and '
        f'{left / ours[1]:.1f} times as much. With six planes a block, as Table 4.1 lists them, it would take '
        f'{planes[0]:.0f} and {planes[1]:.0f} ms, with the general quadric of section 4.7 for each of them '
        f'{quadrics[0]:.0f} and {quadrics[1]:.0f} ms: general quadrics in REAL*4 come '
        f'{"nearer to" if abs(quadrics[0] - left) < abs(ours[1] - left) else "no nearer to"} the print than our '
        "program in REAL*8, and need no word that the thesis' language does not have by itself."
    )


def _tile_tree(tiled, brute, tile_pixels: int, pixels: int) -> float:
    """Share of the scene's primitives that a rendered tile's tree holds, from the counted work."""
    rendered = max(tiled.tiles, 1) * tile_pixels
    return (tiled.intersections / rendered) / max(brute.intersections / pixels, 1e-9)


EXPERIMENTS = [
    Experiment('tiling', 'Tiling against brute force', 'Tables 4.3, 4.4; Figures 4.15 to 4.25', tiling),
    Experiment('plate', 'The table scene', 'Plate 4.1', plate),
    Experiment('tile_budget', 'Where the time of a tile goes', 'Table 5.2; Figure 4.21', tile_budget),
]
