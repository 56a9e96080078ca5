"""Tiling against brute force (thesis 4.13, Tables 4.3, 4.4, Figures 4.15 to 4.25)."""

from __future__ import annotations

import numpy as np
from lab import Experiment, Line, NotAvailable, Outcome, Plot, Setting, Table, mean, ratio, timed
from thesis import TILING, TILING_SAVED, TILING_SPEEDUP

from csg_renderer import default_camera, load_scene, render, scene_names, scene_path
from csg_renderer.solid import FACES

DAP_CYCLE_S = 100e-9


def tiling(setting: Setting) -> Outcome:
    names = [name for name in TILING if name in scene_names()]
    missing = [name for name in TILING if name not in names]
    if not names:
        raise NotAvailable(f'csg_renderer has none of the scenes {", ".join(TILING)}')
    names = setting.pick(names, names[:1])
    size = setting.pick(512, 64)
    counts = Table('Complexity and tiles', [
        'scene', 'primitives thesis', 'ours', 'half-spaces thesis', 'ours', 'tiles of 256 thesis', 'ours',
        'visible pixels ours, %', 'primitives a tile ours, % of the scene'])
    work = Table('Work saved by tiling, %', [
        'scene', 'intersections thesis', 'ours', 'nodes thesis', 'ours', 'combines thesis', 'ours'])
    speed = Table('Brute force / tiling, time', [
        'scene', 'thesis DAP 510', 'ours emulated DAP 510', 'ours on this machine', 'brute force ms ours', 'tiling ms '
                                                                                                           'ours',
        'emulated brute force s ours', 'emulated tiling s ours'])
    dap_why = ''
    for name in names:
        scene = load_scene(scene_path(name))
        camera = default_camera(size) if scene.camera is None or setting.tiny else scene.camera
        frames, seconds = {}, {}
        for tiled in (True, False):
            setting.advance(f'{name}, {"tiling" if tiled else "brute force"}')
            frames[tiled], seconds[tiled] = timed(
                lambda tiled=tiled, scene=scene, camera=camera: render(scene, camera, tiling=tiled),
                setting.pick(3, 1))
        stats, brute = frames[True].stats, frames[False].stats
        half_spaces = sum(len(FACES[leaf.kind]) for leaf in scene.primitives)
        printed = TILING[name]
        counts.rows.append([
            name, printed[0], len(scene.primitives), printed[1], half_spaces, printed[2], stats.tiles,
            round(100 * float(frames[True].mask.mean()), 1),
            round(100 * _tile_tree(stats, brute, 32 * 32, size * size), 1)])
        saved = [round(100 * (1 - getattr(stats, what) / max(getattr(brute, what), 1)), 1)
                 for what in ('intersections', 'nodes', 'combines')]
        work.rows.append([
            name, TILING_SAVED['robot_arm_intersections'] if name == 'robot_arm' else '> 90', saved[0], '> 90',
            saved[1], TILING_SAVED['geneva_wheel_combines'] if name == 'geneva_wheel' else None, saved[2]])
        cycles = {}
        if not dap_why:
            try:
                for tiled in (True, False):
                    setting.advance(f'{name}, emulated, {"tiling" if tiled else "brute force"}')
                    cycles[tiled] = render(scene, camera, engine='dap', tiling=tiled).stats.dap_cycles
            except (ValueError, NotImplementedError, ImportError) as error:
                dap_why = str(error)
        speed.rows.append([name, TILING_SPEEDUP.get(name), ratio(cycles.get(False), cycles.get(True)),
                           seconds[False] / seconds[True], 1e3 * seconds[False], 1e3 * seconds[True],
                           *(cycles[tiled] * DAP_CYCLE_S if tiled in cycles else None for tiled in (False, True))])
    work.rows.append(['mean', None, _mean(work, 2), None, _mean(work, 4), TILING_SAVED['combines_mean'],
                      _mean(work, 6)])
    speed.rows.append(['mean', TILING_SPEEDUP['mean'], _mean(speed, 2), _mean(speed, 3), None, None,
                       _mean(speed, 6), _mean(speed, 7)])
    notes = ['Intersections are counted a ray; the thesis compares them with its serial program on a Sun 3/160 too '
             '(83.8 times, 89.0 with tiling), which cannot be run again.']
    if missing:
        notes.append(f'Not available yet: the scenes {", ".join(missing)}.')
    if dap_why:
        notes.append(f'Emulated figures not available yet: {dap_why}.')
    dap_mean = speed.rows[-1][2]
    emulated = f'the emulated DAP {dap_mean:.1f} times' if dap_mean else 'the emulated DAP is not available yet'
    sentence = (f'Tiling saves {work.rows[-1][2]:.1f} % of the intersections (thesis: more than 90 %) and '
                f'{work.rows[-1][6]:.1f} % of the combines (68.6 %: our early-outs prune more); brute force over '
                'tiling: '
                f'{emulated} (thesis 18.1), this machine {speed.rows[-1][3]:.1f} times, whose brute force skips solids '
                'by their image spans.')
    lines = [Line('ours on this machine', [r[0] for r in speed.rows], [r[3] for r in speed.rows], 'bar')]
    if dap_mean:
        lines.append(Line('ours emulated', [r[0] for r in speed.rows], [r[2] for r in speed.rows], 'bar'))
    lines.append(Line('thesis', [r[0] for r in speed.rows], [r[1] for r in speed.rows], 'bar'))
    plot = Plot('Brute force / tiling', '', 'times faster', lines)
    return Outcome(sentence, [counts, work, speed], [plot], notes)


def _tile_tree(tiled, brute, tile_pixels: int, pixels: int) -> float:
    """Share of the scene's primitives that a rendered tile's tree holds, from the counted work."""
    rendered = max(tiled.tiles, 1) * tile_pixels
    return (tiled.intersections / rendered) / max(brute.intersections / pixels, 1e-9)


def _mean(table: Table, column: int) -> float | None:
    return mean([row[column] for row in table.rows if isinstance(row[column], (int, float, np.floating))])


EXPERIMENTS = [Experiment('tiling', 'Tiling against brute force', 'Tables 4.3, 4.4; Figures 4.15 to 4.25', tiling)]
