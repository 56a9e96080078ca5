"""Speed and accuracy of stereo recovery, beside the recipe of LSD, epipolar matching and triangulation, in one run.

``python test/benchmarks/bench_stereo.py [--seed 5] [--views 40] [--kinds block cylinder flat] [--each]`` judges our
edges alone on other views of the same two solids; ``--each`` lists the views in which something is missing or false.
``--large WIDTH HEIGHT`` says what one pair of that size full of small polygons takes: milliseconds when warm, those of
LSD over both images, and the most memory that the process has had, MB.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from importlib import resources
from pathlib import Path

import cv2
import numpy as np
from measure import OURS, Absent, Measurement, milliseconds
from results import add_record_option, keep
from stereo_scoring import RIG, Score, peer, views

from msgs_py import FeatureKind, FeatureSet, PinholeCamera, StereoRig
from stereo_recovery import recover
from stereo_recovery.cameras.calibration import load_rig

PEER = 'LSD + epipolar'
VIEWS = {'block': 8, 'cylinder': 8, 'flat': 6}
LARGE = ((640, 480), (1920, 1080), (4096, 3072))
# Pixels of a large pair to one polygon; their radii, pixels; the disparity of the surface at its top and at its bottom.
PIXELS_OF_ONE, RADII, DISPARITIES = 3000, (8.0, 60.0), (40.0, 60.0)


def measurements(quick: bool) -> Iterator[Measurement | Absent]:
    methods: dict[str, Callable[[np.ndarray, np.ndarray], FeatureSet]] = {
        OURS: lambda left, right: recover(left, right, RIG).features
    }
    if hasattr(cv2, 'createLineSegmentDetector'):
        methods[PEER] = peer
    else:
        yield Absent(PEER, 'this OpenCV has no line segment detector')
    for kind, count in VIEWS.items():
        shown = views(kind, 2 if quick else count)
        for by, method in methods.items():
            yield from _accuracy(kind, by, [method(view.left, view.right) for view in shown], shown)
            ours = np.median([milliseconds(partial(method, v.left, v.right), 0.1, 3, 10) for v in shown])
            yield Measurement(f'{kind}: a 512 x 512 pair', float(ours), 'ms', by)
        if kind == 'cylinder':
            yield from _curves(shown)
    yield from _real()
    for width, height in LARGE[: 1 if quick else None]:
        yield from _large(width, height)


def _accuracy(kind: str, by: str, found: list[FeatureSet], shown: list) -> Iterator[Measurement]:
    score = Score()
    for features, view in zip(found, shown):
        score.add(features.of_kind(FeatureKind.EDGE), view.edges)
    yield Measurement(f'{kind}: recall of edge length', 100 * score.covered / score.length, '%', by, False)
    if score.flat_length > 0.0:
        yield Measurement(
            f'{kind}: recall within 8 deg of the rows', 100 * score.flat_covered / score.flat_length, '%', by, False
        )
    yield Measurement(f'{kind}: precision', 100 * score.right / max(score.reported, 1), '%', by, False)
    for what, values, factor, unit in (
        ('direction error', score.angles, 180 / np.pi, 'deg'),
        ('distance of ends from the line', score.offsets, 1e3, 'mm'),
        ('end points along it', score.ends, 1e3, 'mm'),
    ):
        if values:
            yield Measurement(
                f'{kind}: {what}',
                float(factor * np.median(values)),
                unit,
                by,
                note=f'p90 {factor * np.quantile(values, 0.9):.3g}',
            )


def _curves(shown: list) -> Iterator[Measurement]:
    errors: dict[str, list[tuple[float, float, float]]] = {'full circles': [], 'half-hidden circles': []}
    axes = []
    for view in shown:
        features = recover(view.left, view.right, RIG).features
        curves, found = features.of_kind(FeatureKind.CURVE), features.of_kind(FeatureKind.AXIS)
        for centre, normal, radius, share in view.rims:
            if len(curves) == 0 or share < 0.3:
                continue
            k = int(np.argmin(np.linalg.norm(curves.start - centre, axis=1)))
            turn = np.degrees(np.arccos(min(1.0, abs(curves.directions[k] @ normal))))
            errors['full circles' if share > 0.95 else 'half-hidden circles'].append(
                (turn, 1e3 * np.linalg.norm(curves.start[k] - centre), 1e3 * abs(curves.radii[k, 0] - radius))
            )
        for low, high in view.axes:
            true = (high - low) / np.linalg.norm(high - low)
            axes += [float(np.degrees(np.arccos(min(1.0, max(abs(found.directions @ true))))))] if len(found) else []
    for name, rows in errors.items():
        for what, unit, values in zip(('normal', 'centre', 'radius'), ('deg', 'mm', 'mm'), np.array(rows).T):
            yield Measurement(
                f'{name}: {what}',
                float(np.median(values)),
                unit,
                note=f'max {values.max():.3g}, {len(rows)} of {len(shown)} found',
            )
    if axes:
        yield Measurement('cylinder axis', float(np.median(axes)), 'deg', note=f'{len(axes)} of {len(shown)} found')


def _real() -> Iterator[Measurement]:
    data = Path(str(resources.files('stereo_recovery'))) / 'data' / 'chessboard'
    left, right = (cv2.imread(str(data / f'{side}01_rect.png'), cv2.IMREAD_GRAYSCALE) for side in ('left', 'right'))
    rig = load_rig(data / 'calibration.yaml', (left.shape[1], left.shape[0]))
    yield Measurement('a cluttered 640 x 480 pair', milliseconds(partial(recover, left, right, rig), 1.0))


def _large(width: int, height: int) -> Iterator[Measurement]:
    """In a process of its own: memory that was ever taken is not given back."""
    told = subprocess.run(
        [sys.executable, __file__, '--large', str(width), str(height)], capture_output=True, text=True, check=True
    )
    ours, peers, memory = (float(word) for word in told.stdout.split()[-3:])
    what = f'a {width} x {height} pair full of polygons'
    yield Measurement(what, ours, note=f'{ours / peers:.1f} times LSD over both images')
    yield Measurement(f'{what}: most memory', memory, 'MB', note='of the process; bar 2000')


def large_pair(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """A pair of pictures of one slanted surface, full of overlapping polygons, with noise of 1.5 grey levels."""
    rng = np.random.default_rng(1)
    wide = np.full((height, width + 2 * int(max(DISPARITIES))), 128, np.uint8)
    for _ in range(wide.size // PIXELS_OF_ONE):
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, rng.integers(3, 6)))
        corners = rng.uniform([0.0, 0.0], wide.shape[::-1]) + rng.uniform(*RADII) * np.stack(
            [np.cos(angle), np.sin(angle)], axis=1
        )
        cv2.fillConvexPoly(wide, np.int32(16.0 * corners), int(rng.uniform(20, 235)), cv2.LINE_AA, 4)
    wide = cv2.GaussianBlur(wide, (0, 0), 0.6)
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    disparity = np.linspace(*DISPARITIES, height, dtype=np.float32)[:, None]
    shown = wide[:, :width], cv2.remap(wide, columns + disparity, rows, cv2.INTER_LINEAR)
    noisy = (cv2.add(each, rng.normal(0.0, 1.5, each.shape).astype(np.float32), dtype=cv2.CV_8U) for each in shown)
    left, right = noisy
    return left, right


def large(width: int, height: int) -> tuple[float, float, float]:
    """Milliseconds of a recovery and of LSD over both images, and the most memory that this process has had, MB."""
    left, right = large_pair(width, height)
    rig = StereoRig.symmetric(PinholeCamera.centred(width, height, 1.2 * width), 0.1)
    ours = milliseconds(partial(recover, left, right, rig), 1.0, 2, 3)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    detector = cv2.createLineSegmentDetector()
    return ours, milliseconds(lambda: (detector.detect(left), detector.detect(right)), 1.0, 2, 3), memory


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('--seed', type=int, default=5)
    parser.add_argument('--views', type=int, default=40, help='of each kind')
    parser.add_argument('--kinds', nargs='+', choices=list(VIEWS), default=list(VIEWS))
    parser.add_argument('--each', action='store_true', help='list the views with missing or false edges')
    parser.add_argument(
        '--large', nargs=2, type=int, metavar=('WIDTH', 'HEIGHT'), help='time and memory of such a pair'
    )
    add_record_option(parser)
    options = parser.parse_args(arguments)
    if options.large:
        print('{:.0f} {:.0f} {:.0f}'.format(*large(*options.large)))
        return 0
    measured: dict[str, float] = {}
    for kind in options.kinds:
        shown = views(kind, options.views, options.seed)
        found = [recover(view.left, view.right, RIG).features for view in shown]
        for features, view in zip(found, shown) if options.each else ():
            score = Score()
            score.add(features.of_kind(FeatureKind.EDGE), view.edges)
            if score.covered < 0.9 * score.length or score.right < score.reported:
                print(
                    f'{view.name:<12} recall {100 * score.covered / score.length:5.1f} %, {score.right} of '
                    f'{score.reported} right'
                )
        for item in _accuracy(kind, OURS, found, shown):
            print(f'{item.what:<44} {item.value:>9.3f} {item.unit:<4} {item.note}')
            measured[item.what] = item.value
    if options.record:
        keep(options.record, measured)
    return 0


if __name__ == '__main__':
    sys.exit(main())
