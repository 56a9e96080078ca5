"""Circles, ellipses and axes of random scenes against the truth: recall by visible share, errors, false curves, and
whether the stated errors are true.

``python test/benchmarks/bench_curves.py [--seeds 100-119] [--kind NAME ...] [--thesis] [--aliased] [--noise 6]
[--distance 4] [--remarks]`` prints a table by kind of scene and the figures beside the bars; ``run.py`` collects the
latter. Scenes and scores: curve_scenes.py, curve_scoring.py.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from curve_scenes import KINDS, THESIS, Imaging, curved_view
from curve_scoring import LARGE, SHARES, CurveScore
from measure import Measurement

from stereo_recovery import RecoveryParams, recover

SEEDS = range(500, 510)
QUICK_SEEDS = range(500, 501)
ALIASED = Imaging(samples=1, blur=0.0, noise=0.0)


def score(
    kinds: Iterable[str],
    seeds: Iterable[int],
    imaging: Imaging,
    each: dict[str, CurveScore] | None = None,
    params: RecoveryParams | None = None,
) -> CurveScore:
    """All views of some kinds together; each : takes the scores by kind."""
    total = CurveScore()
    for kind in kinds:
        own = CurveScore()
        for seed in seeds:
            view = curved_view(kind, seed, imaging)
            recovery = recover(view.left, view.right, view.rig, params)
            own.add(recovery, view)
            total.add(recovery, view)
        if each is not None:
            each[kind] = own
    return total


def figures(total: CurveScore, head: str = '', aliased: bool = False) -> Iterator[Measurement]:
    """The figures; the note gives spread and bars (floor | aim)."""
    yield from rim_figures(total, head, aliased)
    yield from axis_figures(total, head)
    yield from false_figures(total, head)


def rim_figures(total: CurveScore, head: str, aliased: bool) -> Iterator[Measurement]:
    """How many circles and ellipses are found, and how well."""
    bars = {
        'normal': ('deg', '0.25 | 0.10' if aliased else '0.10 / max 0.4 | 0.03 / 0.1'),
        'centre': ('mm', '0.05 | 0.02'),
        'radius': ('mm', '0.03 | 0.01'),
    }
    for name, _ in SHARES:
        rims = total.rims[name]
        if not rims.there:
            continue
        yield Measurement(
            f'{head}{name} circles and ellipses: found',
            100 * rims.found / rims.there,
            '%',
            lower_is_better=False,
            note=f'{rims.found} of {rims.there}' + (', bars for 42 % seen 75 | 100' if name == 'half' else ''),
        )
        if not rims.found:
            continue
        yield Measurement(
            f'{head}{name} circles and ellipses: normal to the right side',
            100 * rims.sure / rims.found,
            '%',
            lower_is_better=False,
        )
        for what, (unit, bar) in bars.items():
            values = np.array(getattr(rims, what))
            note = f'p90 {np.quantile(values, 0.9):.3g}, max {values.max():.3g}'
            if name == 'full':
                note += f'; bars {bar}'
            elif name == 'half' and what == 'normal':
                note += f'; {100 * np.mean(values < 3):.0f} % within 3 deg, {100 * np.mean(values < 1):.0f} % within 1'
            yield Measurement(f'{head}{name} circles and ellipses: {what}', float(np.median(values)), unit, note=note)
    if total.large:
        spread = f'p90 {np.quantile(total.large, 0.9):.3g}, max {max(total.large):.3g}'
        yield Measurement(
            f'{head}full circles of more than {LARGE:.0f} px radius: normal',
            float(np.median(total.large)),
            'deg',
            note=f'{spread}; {len(total.large)} circles; bars {bars["normal"][1]}',
        )


def axis_figures(total: CurveScore, head: str) -> Iterator[Measurement]:
    """How many axes are found, and how well."""
    for name, axes in total.axes.items():
        if not axes.there:
            continue
        yield Measurement(
            f'{head}axes with {name} in view: found',
            100 * axes.found / axes.there,
            '%',
            lower_is_better=False,
            note=f'{axes.found} of {axes.there}',
        )
        for what, unit, bar in (('angle', 'deg', '; bars 0.3 | 0.1'), ('across', 'mm', ''), ('ends', 'mm', '')):
            values = np.array(getattr(axes, what))
            if len(values):
                yield Measurement(
                    f'{head}axes with {name} in view: {what}',
                    float(np.median(values)),
                    unit,
                    note=f'p90 {np.quantile(values, 0.9):.3g}, max {values.max():.3g}{bar}',
                )


def false_figures(total: CurveScore, head: str) -> Iterator[Measurement]:
    """What is reported and not there, and the edges that stand beside curves."""
    reported, true = total.shown
    edges = total.edges
    yield Measurement(f'{head}false curves', float(total.false_curves), '', note=f'of {total.curves}')
    yield Measurement(f'{head}false axes', float(total.false_axes), '', note=f'of {total.reported_axes}')
    yield Measurement(f'{head}edges where rims are', float(total.lines_on_rims), '', note=f'of {edges.reported}')
    yield Measurement(
        f'{head}precision of edges and curves',
        100 * true / max(reported, 1),
        '%',
        lower_is_better=False,
        note='bars 85 | 95',
    )
    if edges.length > 0.0:
        yield Measurement(
            f'{head}edges beside curves: precision',
            100 * edges.right / max(edges.reported, 1),
            '%',
            lower_is_better=False,
            note=f'bars 85 | 95; {edges.right} of {edges.reported}, {total.faint} hardly stand out',
        )
        yield Measurement(
            f'{head}edges beside curves: recall of length',
            100 * edges.covered / edges.length,
            '%',
            lower_is_better=False,
            note='bars 92 | 97',
        )
    for what, unit, values, bar in (
        ('direction', 'deg', np.degrees(edges.angles), '0.15 / p90 0.8 | 0.09 / 0.5'),
        ('distance of ends from the line', 'mm', 1e3 * np.array(edges.offsets), '0.06 / 0.25 | 0.03 / 0.15'),
        ('end points along it', 'mm', 1e3 * np.array(edges.ends), '0.25 / 1.0 | 0.10 / 0.5'),
    ):
        if len(values):
            yield Measurement(
                f'{head}edges beside curves: {what}',
                float(np.median(values)),
                unit,
                note=f'p90 {np.quantile(values, 0.9):.3g}; bars {bar}',
            )
    for what, known in total.calibration.items():
        if known.inside:
            yield Measurement(
                f'{head}{what} inside 3 sigma',
                100 * float(np.mean(known.inside)),
                '%',
                lower_is_better=False,
                note=f'bar 95; bounds {known.width:.2f} times the errors, bar 2',
            )
    if total.axis_inside:
        yield Measurement(
            f'{head}axis ends inside the stated errors',
            100 * float(np.mean(total.axis_inside)),
            '%',
            lower_is_better=False,
            note='bar 95',
        )


def measurements(quick: bool) -> Iterator[Measurement]:
    seeds = QUICK_SEEDS if quick else SEEDS
    yield from figures(score(KINDS, seeds, Imaging()), 'curves: ')
    yield from figures(score(KINDS, seeds if quick else SEEDS[:4], ALIASED), 'aliased curves: ', aliased=True)
    yield from figures(score(THESIS, [seeds[0]], Imaging()), 'thesis scenes: ')


def _row(kind: str, s: CurveScore) -> str:
    cells = [f'{kind:<16}']
    groups = [(s.rims[name], s.rims[name].normal) for name, _ in SHARES] + [(a, a.angle) for a in s.axes.values()]
    for group, errors in groups:
        spread = f'{np.median(errors):6.3f} {max(errors):6.2f}' if errors else f'{"":13}'
        cells.append(f'{group.found:>3}/{group.there:<3}{spread}')
    e = s.edges
    cells.append(
        f'{s.false_curves:>3} {s.false_axes:>3} {s.lines_on_rims:>3} '
        f'{e.reported - e.right:>4}/{e.reported:<4} {100 * e.covered / e.length if e.length else np.nan:5.1f} '
        f'{np.median(np.degrees(e.angles)) if e.angles else np.nan:6.3f}'
    )
    return '|'.join(cells)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', default='', help='first-last, e.g. 100-119')
    parser.add_argument('--quick', action='store_true', help='one view of each kind')
    parser.add_argument('--kind', nargs='+', default=[], help=f'some of {", ".join([*KINDS, *THESIS])}')
    parser.add_argument('--thesis', action='store_true', help='the scenes of the thesis instead of random ones')
    parser.add_argument('--aliased', action='store_true', help='one ray a pixel, no blur, no noise')
    parser.add_argument('--noise', type=float, help='grey levels (default 2)')
    parser.add_argument('--distance', type=float, default=1.0, help='times further away')
    parser.add_argument('--remarks', action='store_true', help='every loss and every false feature')
    options = parser.parse_args(arguments)
    kinds = options.kind or (THESIS if options.thesis else KINDS)
    for kind in kinds:
        if kind not in KINDS and kind not in THESIS:
            parser.error(f'--kind: no scene {kind!r}; there are {", ".join([*KINDS, *THESIS])}')
    imaging = replace(ALIASED if options.aliased else Imaging(), distance=options.distance)
    if options.noise is not None:
        imaging = replace(imaging, noise=options.noise)
    low, _, high = options.seeds.partition('-')
    seeds = range(int(low), int(high or low) + 1) if low else QUICK_SEEDS if options.quick or options.thesis else SEEDS
    each: dict[str, CurveScore] = {}
    total = score(kinds, seeds, imaging, each)
    print(
        f'{"":16}|'
        + '|'.join(f'{name + ": found, normal":<20}' for name, _ in SHARES)
        + '|axis, two rims: deg |axis, one rim: deg  |false curves, axes, edges on rims, false edges, recall, deg'
    )
    for kind, own in each.items():
        print(_row(kind, own))
    print()
    for item in figures(total, aliased=options.aliased):
        print(f'{item.what:<52} {item.value:>9.3f} {item.unit:<4} {item.note}')
    angles = np.degrees([a for kind, own in each.items() if kind != 'clutter' for a in own.edges.angles])
    if len(angles) and 'clutter' in each:
        print(
            f'direction without the scenes of clutter (blocks of 6 to 18 mm): {np.median(angles):.3f} deg, p90 '
            f'{np.quantile(angles, 0.9):.2f}'
        )
    if options.remarks:
        print('\n' + '\n'.join(total.remarks))
    return 0


if __name__ == '__main__':
    sys.exit(main())
