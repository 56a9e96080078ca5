"""Whether the stated errors of straight edges are true: by their causes, and under other conditions than the usual:

    python test/benchmarks/bounds.py --seeds 100..119 [--kinds any flat aliased] [--conditions usual noisy ...]

A row a group: how many, the share inside the stated bound (bar 95 %), and how many times too wide the bound is in the
median (bar 2), for err_per and the cone of directions of its edges, or err_par of its ends.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

import numpy as np
from bench_lines import KINDS, edges_of, scene_of
from line_scoring import HALF_NORMAL, LineScore
from measure import seed_range
from stereo_scenes import USUAL, Imaging, StereoScene
from tqdm import tqdm

from msgs_py import PinholeCamera

CONDITIONS = {
    'usual': USUAL,
    'small, wide': Imaging(PinholeCamera.centred(640, 480, 500.0)),
    'small, long': Imaging(PinholeCamera.centred(640, 480, 1400.0)),
    'large, wide': Imaging(PinholeCamera.centred(1280, 960, 700.0)),
    'large, long': Imaging(PinholeCamera.centred(1280, 960, 1400.0)),
    'clean': Imaging(noise=1.0),
    'noisy': Imaging(noise=5.0),
    'sharp': Imaging(blur=0.3),
    'blurred': Imaging(blur=1.2),
    'near': Imaging(depth_ratio=3.0),
    'far': Imaging(depth_ratio=10.0),
}
FLAT, UPRIGHT = 0.15, 0.7
BESIDE, NEAR = 2.5, 6.0
SHORT = 30.0
# An end of a visible piece this near to one of the model's edge is a corner, metres; elsewhere something hides it.
CORNER = 0.2e-3
Groups = dict[str, dict[str, list[float]]]


def add(groups: Groups, head: str, scene: StereoScene) -> None:
    """The ratios of errors to stated bounds of one scene, by groups."""
    score = LineScore()
    found = edges_of(scene)
    paired = score.add(found, scene.edges, scene.faint)
    true = paired[paired >= 0]
    run = np.diff(scene.rig.left.project(scene.edges), axis=1)[:, 0]
    length = np.maximum(np.hypot(*run.T), 1e-9)
    sine = np.abs(run[:, 1]) / length
    wire = scene.pose.apply(np.stack([scene.model.start, scene.model.end], axis=1)[scene.model_index])
    corner = np.linalg.norm(scene.edges[:, :, None] - wire[:, None], axis=-1).min(axis=-1) < CORNER
    of_edges = {
        'all edges': true >= 0,
        'along the rows': sine[true] < FLAT,
        'leaning': (sine[true] >= FLAT) & (sine[true] < UPRIGHT),
        'upright': sine[true] >= UPRIGHT,
        'shorter than 30 px': length[true] < SHORT,
        'another within 2.5 px': scene.nearest[true] < BESIDE,
        'another within 6 px': (scene.nearest[true] >= BESIDE) & (scene.nearest[true] < NEAR),
        'no other near': scene.nearest[true] >= NEAR,
    }
    seen = np.unique(true)
    of_ends = {
        'all ends': corner[seen] >= 0,
        'corners': corner[seen],
        'hidden ends': ~corner[seen],
        'ends along the rows': np.repeat(sine[seen, None] < FLAT, 2, axis=1),
        'ends of others': np.repeat(sine[seen, None] >= FLAT, 2, axis=1),
    }
    for name, mask in of_edges.items():
        _extend(groups, head + name, 'err_per', np.array(score.ratios['err_per']).reshape(-1, 2)[mask])
        _extend(groups, head + name, 'cone', np.array(score.ratios['cone'])[mask])
    for name, mask in of_ends.items():
        _extend(groups, head + name, 'err_par', np.array(score.ratios['err_par']).reshape(-1, 2)[mask])


def _extend(groups: Groups, group: str, what: str, ratios: np.ndarray) -> None:
    groups.setdefault(group, {}).setdefault(what, []).extend(ratios.ravel().tolist())


def rows(groups: Groups) -> Iterator[str]:
    for group, columns in groups.items():
        cells = [
            f'{what} {len(ratios):>5} {100 * np.mean(np.array(ratios) <= 1.0):6.1f} % '
            f'{HALF_NORMAL / 3.0 / max(float(np.median(ratios)), 1e-9):5.2f} x'
            for what, ratios in columns.items()
            if ratios
        ]
        if cells:
            yield f'{group:<44}' + ' | '.join(cells)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('--seeds', type=seed_range, default='0..19', metavar='A..B', help='scenes, both ends included')
    parser.add_argument('--kinds', nargs='+', choices=KINDS, default=['any', 'flat'])
    parser.add_argument(
        '--conditions',
        nargs='*',
        choices=list(CONDITIONS),
        help='cameras, rigs and noise; without a name: all; only their sums are shown',
    )
    options = parser.parse_args(arguments)
    names = ['usual'] if options.conditions is None else options.conditions or list(CONDITIONS)
    groups: Groups = {}
    for name in names:
        for kind in options.kinds:
            for seed in tqdm(
                options.seeds, desc=f'{name} {kind}', unit='pair', file=sys.stderr, disable=not sys.stderr.isatty()
            ):
                add(groups, f'{name}, {kind}: ', scene_of(kind, seed, CONDITIONS[name]))
    if options.conditions is not None:
        groups = {name: columns for name, columns in groups.items() if ': all ' in name}
    print('\n'.join(rows(groups)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
