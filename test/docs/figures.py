"""What the pages say of measured figures, written from test/benchmarks/results.

Each function is one block of a page, between ``<!-- NAME:begin ... -->`` and ``<!-- NAME:end -->``. Numbers are in no
text here: a command measures them and keeps them with ``--record``, test/benchmarks/results.py says how.
"""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / 'test' / 'benchmarks'))

from results import Record, read  # noqa: E402

WIDTH = 120
NUMBERS = ('none', 'one', 'two', 'three', 'four', 'five', 'six', 'seven', 'eight', 'nine', 'ten', 'eleven', 'twelve')


def block(name: str) -> tuple[str, str]:
    """The lines between which a block is written."""
    return f'<!-- {name}:begin (written by test/docs/generate.py) -->', f'<!-- {name}:end -->'


def paragraph(text: str, indent: str = '') -> str:
    """Text in lines of a page's width."""
    return textwrap.fill(
        ' '.join(text.split()),
        WIDTH,
        initial_indent=indent,
        subsequent_indent=' ' * len(indent),
        break_long_words=False,
        break_on_hyphens=False,
    )


def table(head: list[str], rows: list[list[str]]) -> str:
    """A table; the first column has no title."""
    lines = [['', *head], ['---'] * (len(head) + 1), *rows]
    return '\n'.join('| ' + ' | '.join(cells) + ' |' for cells in lines).replace('|  |', '| |')


def word(count: int) -> str:
    """A small count as a word."""
    return NUMBERS[count] if count < len(NUMBERS) else str(count)


def percent(part: float, of: float) -> str:
    """A share as a whole number of percents."""
    return f'{100.0 * part / of:.0f} %'


# -- README ----------------------------------------------------------------------------------------------------


def views() -> str:
    """The poses of the thesis' views."""
    record = read('experiment_poses')
    median = record.figures['Pose errors']['median']
    x, y, z = (f'{median[f"{axis} mm ours"]:.3f}' for axis in 'xyz')
    rows = [
        ['rotation error', f'{median["rotation deg ours"]:.3f} deg', '0.5 deg'],
        ['translation error in x, y, z', f'{x}, {y}, {z} mm', '0.31, 0.31, 1.57 mm'],
    ]
    return f'{table(["here, median", "thesis, mean"], rows)}\n\n{paragraph(record.source + ".")}'


def renderer() -> str:
    """Times of the renderer beside POV-Ray's."""
    record = read('renderer')
    scenes = {
        'L-shape, 2 blocks': 'L-shape, 2 blocks',
        'lattice, 44 beams': 'lattice, 44 beams',
        'hollow cubes, 42 primitives': '42 primitives, curved differences',
        'table, 100 primitives, 6 levels, shadows': 'table: 100 primitives, 3 lights, shadows, 6 levels',
    }
    rows = [
        [label, _ms(record.figures[name]), _ms(record.figures.get(f'{name} [POV-Ray]'))]
        for name, label in scenes.items()
    ]
    return f'{table(["here", "POV-Ray 3.7, its own trace time"], rows)}\n\n{paragraph(record.source + ".")}'


def latency() -> str:
    """From image to pose."""
    record = read('latency')
    rows = []
    for where, label in (('one process', 'all nodes in one process'), ('a process a node', 'one process a node')):
        name = f'l_shape_v1, {where}'
        p50, p99 = (_ms(record.figures[f'{name}: image to pose, p{share}']) for share in (50, 99))
        rows.append([label, p50, p99, f'{record.figures[f"{name}: poses a second, flooded"]:.0f} Hz'])
    tracked = read('tracker_node')
    rates = [f'{name} {_ms(row["p50"])} ({_ms(row["p99"])})' for name, row in tracked.figures.items()]
    answered = sum(row['poses'] for row in tracked.figures.values())
    note = paragraph(f"""
        {record.source}. tracker_node, in a process of its own, follows two objects in pairs of 640 x 480: p50 (p99) at
        {', '.join(rates)}; {answered:,} of {sum(row['asked'] for row in tracked.figures.values()):,} poses came.
        {tracked.source}.""")
    return f'{table(["p50", "p99", "most poses a second"], rows)}\n\n{note}'


def pictures() -> str:
    """Parts found in pictures of cameras and path-traced ones."""
    record = read('poses')
    traced, parts, cube, every = (record.figures[name] for name in ('photoreal', 'openvgr', 'visp_cube', 'all'))
    answers = every['right'] + every['wrong'] + every['false'] + every['twice'] + every['ambiguous']
    mistakes = every['wrong'] + every['twice']
    return paragraph(f"""
        {traced['found']} of {traced['to_find']} path-traced ones, to {traced['deg']:.2f} degrees and
        {traced['mm']:.2f} mm (medians); {parts['found']} of {parts['to_find']} machined parts, cans and cubes in
        pictures of cameras, to {parts['deg']:.2f} degrees and {parts['mm']:.2f} mm (what their truth is good for);
        {word(cube['found'])} of {cube['to_find']} pairs of a printed cube among tags. Of {answers} answers
        {word(mistakes)} {'was' if mistakes == 1 else 'were'} a part at a wrong pose, and {word(every['false'])} of
        {every['absent']} parts that were not there {'was' if every['false'] == 1 else 'were'} answered.
        {record.source}, where the pictures are installed.""")


def found_in_pictures() -> str:
    """The table of poses in pictures, with and without what the images say."""
    record, without = read('poses'), read('poses_without_images')
    families = {
        'photoreal': 'path-traced parts',
        'openvgr': 'machined parts, a can, a cube; pictures of cameras',
        'visp_cube': 'a printed cube on a cluttered desk',
        'rendered': 'rendered views of the thesis',
    }
    rows = []
    for name, label in families.items():
        with_, off = record.figures[name], without.figures[name]
        wrong, wrong_off = (one['wrong'] + one['twice'] for one in (with_, off))
        absent = f'{with_["false"]} of {with_["absent"]} ({off["false"]})' if with_['absent'] else ''
        rows.append(
            [
                f'{label}, {with_["pairs"]} pairs',
                f'{with_["found"]} of {with_["to_find"]} ({off["found"]})',
                f'{wrong} ({wrong_off})',
                absent,
                _near(with_) + (f' ({_near(off)})' if off['deg'] is not None else ''),
            ]
        )
    hidden = read('poses_hidden')
    figures = hidden.figures['hidden']
    rows.append(
        [
            f'30 % of a part among 80 % of other things, rendered, {figures["pairs"]} pairs',
            f'{figures["found"]} of {figures["to_find"]}; {figures["ambiguous"]} more name the true pose too',
            str(figures['wrong'] + figures['twice']),
            f'{figures["false"]} of {figures["absent"]}',
            _near(figures),
        ]
    )
    head = ['found', 'wrong', 'absent, answered', 'turned by, off by (medians)']
    sources = f'{record.source}; hidden ones {hidden.source}; in brackets {without.source}.'
    return f'{table(head, rows)}\n\n{paragraph(sources)}'


def _near(figures: dict[str, Any]) -> str:
    return f'{figures["deg"]:.2g} deg, {figures["mm"]:.2g} mm'


def limits() -> str:
    """What it cannot do, as it is."""
    return '\n'.join(paragraph(text, '* ') for text in (_rows(), _print(), _alike(), _hidden(), *_others()))


def _rows() -> str:
    lines, flat, three = read('lines'), read('stereo_flat'), read('lines_three_cameras')
    level, usual, more = (record.figures[kind] for record, kind in ((lines, 'flat'), (lines, 'any'), (three, 'flat')))
    wrong = 100.0 - flat.figures['flat: precision']
    directions, place = (100.0 * (1.0 - more[what] / level[what]) for what in ('direction median', 'pose translation'))
    return f"""
        Edges within 8 degrees of the image rows carry no disparity of their own. They are recovered from their corners,
        their ends and what is parallel to them. On views full of such edges {100 * level['recall of flat edges']:.0f} %
        of their length is found, and the pose from all edges is {level['pose rotation']:.3f} degrees off, on other
        views {usual['pose rotation']:.3f} ({lines.source}). A face that one eye sees a pixel or two wide, and the
        other not at all, still leads to wrong edges: {wrong:.0f} in 100 on views full of them ({flat.source}). A third
        camera above the pair takes {directions:.0f} % off the error of the edges' directions there, and {place:.0f} %
        off that of the pose's place ({three.source})."""


def _print() -> str:
    real, rooms = read('experiment_real_pairs'), read('rooms')
    box = real.figures['Tea box']
    found = sorted({row['edges found of 7 ours'] for row in box.values()})
    near = [row for row in box.values() if isinstance(row['pose deg from the reference ours'], float)]
    placed = ' and '.join(
        f'{row["pose deg from the reference ours"]:.1f} degrees and {row["mm from the reference ours"]:.1f} mm'
        for row in near
    )
    return f"""
        On real images with print and clutter fewer edges are found, and less exactly, than on rendered ones: of the
        seven of ViSP's tea box {' to '.join(word(n) for n in found)} in either pair, and {word(len(near))} of
        {word(len(box))} pairs is placed, within {placed} of its reference ({real.source}, where the pictures are
        installed). Of the strong edges of rooms {100 * rooms.figures['middlebury']['recall']:.0f} % are found
        ({rooms.source}). A regular grid is nearly its own shifted copy; poses that the data cannot tell apart are
        listed together."""


def _alike() -> str:
    alike, absent = read('target_decoys'), read('absent')
    found = alike.figures['target_decoys']
    tried = sum(one['scenes'] for one in absent.figures['absent'].values())
    answered = tried - sum(one['right'] for one in absent.figures['absent'].values())
    return f"""
        Two objects that share dimensions can be taken for each other: {found['answered']} of {found['searches']:,}
        searches in views of other objects were answered ({alike.source}), {word(answered)} of {tried:,} in clutter
        without such an object ({absent.source})."""


def _hidden() -> str:
    record = read('low_visible')
    models = record.figures['low_visible']
    share = {name: one['right'] / one['scenes'] for name, one in models.items()}
    best = max(share, key=lambda name: share[name])
    hard = sorted((name for name in share if share[name] < 0.9), key=lambda name: share[name])
    told = ', '.join(f'{percent(share[name], 1.0)} ({name})' for name in hard)
    wrong = sum(one['wrong'] + one['of these answered wrongly'] for one in models.values())
    scenes = sum(one['scenes'] for one in models.values())
    return f"""
        Small objects mostly hidden are often refused: with 30 % of its edges in view among 80 % clutter an object is
        found in {told} of scenes, beside {percent(share[best], 1.0)} ({best}); the rest is unanswered, but for
        {word(wrong)} wrong in {scenes:,}. In part no answer is right: where what is left determines the pose,
        {_of_determined(models, hard)} are found ({record.source})."""


def _of_determined(models: dict[str, Any], names: list[str]) -> str:
    shares = [models[name]['right'] / models[name]['determined'] for name in names]
    return f'{100 * min(shares):.0f} to {100 * max(shares):.0f} %' if shares else 'all'


def _others() -> tuple[str, ...]:
    times, serial, pair = read('experiment_stereo_times'), read('experiment_serial_parallel'), read('renderer')
    least, most = (pair.figures[f'a stereo pair over one image, {which}'] for which in ('least', 'most'))
    return (
        """Textured and free-form objects are out of its world: it sees straight edges, circles, ellipses and their
        axes.""",
        f"""The array machine's times are computed from a cost model, not simulated. {times.figures['sentence']}
        ({times.source}.) {_first_sentence(serial)} ({serial.source}.)
        [Where the rest goes](src/dap_emulator/docs/dap.md).""",
        f"""A stereo pair takes {least:.1f} to {most:.1f} times as long to render as one image: one image already keeps
        both cores busy, and the eyes share only the scene's preparation.""",
    )


def _first_sentence(record: Record) -> str:
    return record.figures['sentence'].split('. ')[0] + '.'


def _ms(value: float | None) -> str:
    return '-' if value is None else f'{value:.1f} ms' if value < 10.0 else f'{value:.0f} ms'


README, IMAGES = ROOT / 'README.md', ROOT / 'src' / 'model_matcher' / 'docs' / 'images.md'
MATCHER = ROOT / 'src' / 'model_matcher' / 'README.md'
CAMERA = ROOT / 'src' / 'csg_renderer' / 'docs' / 'camera.md'


def effects() -> str:
    """Recovery on our pictures of the path traced scenes beside recovery on the tracer's."""
    record = read('effects')
    keys = {
        'recall': 'recall',
        'right': 'right',
        'across_mm': 'ends across, mm',
        'end_mm': 'ends along, mm',
        'angle_deg': 'deg',
    }

    def cell(pair: list[float | None]) -> str:
        theirs, ours = pair
        if theirs is None or ours is None or not theirs:
            return '-'
        return f'{theirs:.3g}, {ours:.3g} ({100.0 * (ours - theirs) / theirs:+.0f} %)'

    rows = [
        ['all' if family == 'photoreal' else family, *(cell(values[key]) for key in keys)]
        for family, values in record.figures.items()
    ]
    return f'{table(list(keys.values()), rows)}\n\n{paragraph(record.source + ".")}'


def covariances() -> str:
    """Squared errors of poses in units of the stated covariance, by model, by features alone and in the images."""
    record = read('covariances')
    models = list(dict.fromkeys(name.split(',')[0] for name in record.figures))
    rows = []
    for model in models:
        cells = []
        for way in ('features', 'images'):
            one = record.figures[f'{model}, {way}']
            cells += [
                f'{one["mean"]:.1f}',
                f'{one["median"]:.1f}',
                f'{100 * one["inside"]:.0f} %',
                f'{one["ks_p"]:.2g}',
            ]
        rows.append([f'`{model}`, {record.figures[f"{model}, features"]["poses"]:.0f} poses', *cells])
    head = ['features: mean (6)', 'median (5.3)', 'inside (95 %)', 'KS p', 'images: mean', 'median', 'inside', 'KS p']
    return f'{table(head, rows)}\n\n{paragraph(record.source + ".")}'


def chances() -> str:
    """False alarms at stated rates, and what is refused, by features alone."""
    return _reliability('features', ('0.1', '0.03', '0.01', '0.003', '0.001'))


def chances_in_images() -> str:
    """The same with what images say."""
    return _reliability('images', ('0.1', '0.01', '0.001'))


def _reliability(way: str, rates: tuple[str, ...]) -> str:
    record = read('evidence')
    rows = []
    for kind, row in record.figures[way]['reliability'].items():
        alarms = [f'{row[rate]:.0f} ({row[f"{rate} low"]:.0f} to {row[f"{rate} high"]:.0f})' for rate in rates]
        shares = [name.removesuffix(' there') for name in row if name.endswith(' there')]
        refused = [
            f'{percent(row[f"{share} refused at 0.001"], 1.0)} of {row[f"{share} there"]:.0f}'
            + (f' ({percent(float(share), 1.0)} in view)' if float(share) < 1.0 else '')
            for share in shares
        ]
        rows.append([kind.removeprefix('images: '), f'{row["absent"]:.0f}', *alarms, '; '.join(refused)])
    head = ['searches', *(f'at {rate}' for rate in rates), 'refused at 0.001']
    return f'{table(head, rows)}\n\n{paragraph(record.source + ".")}'


def numbers_of_evidence() -> str:
    """Every fitted number of the evidence, with its interval and the one in use."""
    record = read('evidence')
    rows = [
        [name, *(f'{one[key]:.3g}' for key in ('fitted', 'low', 'high', 'in use'))]
        for way in ('features', 'images')
        for name, one in record.figures[way]['numbers'].items()
    ]
    return f'{table(["fitted", "from", "to", "in use"], rows)}\n\n{paragraph(record.source + ".")}'


BLOCKS: dict[str, tuple[Path, Callable[[], str]]] = {
    'views': (README, views),
    'renderer': (README, renderer),
    'latency': (README, latency),
    'pictures': (README, pictures),
    'limits': (README, limits),
    'found': (IMAGES, found_in_pictures),
    'covariances': (MATCHER, covariances),
    'chances': (MATCHER, chances),
    'numbers': (MATCHER, numbers_of_evidence),
    'chances-images': (IMAGES, chances_in_images),
    'effects': (CAMERA, effects),
}


def written(name: str) -> str:
    """A block with its marks."""
    begin, end = block(name)
    return f'{begin}\n\n{BLOCKS[name][1]()}\n\n{end}'
