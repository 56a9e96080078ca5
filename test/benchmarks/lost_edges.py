"""At which stage of stereo recovery the true edges are lost that it does not report:

    python test/benchmarks/lost_edges.py --seed 311 --views 40 --kinds flat       views of bench_stereo.py
    python test/benchmarks/lost_edges.py --seeds 2500..2519 --kinds any flat      scenes of bench_lines.py
    python test/benchmarks/lost_edges.py --seeds 1710..1711 --kinds curves        views of bench_curves.py

One line for every such edge: where it is in the left image, its contrast in both, and how much of it (percent of its
length) each stage still has; then a count of the stages at which they were lost, by length. ``--pictures DIR`` draws
the scenes with their lost edges in red.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
from bench_stereo import VIEWS
from curve_scenes import KINDS as CURVES
from curve_scenes import curved_view
from measure import seed_range
from stereo_scenes import KINDS, random_scene
from stereo_scoring import RIG, SAME_ANGLE, SAME_PLACE, views
from tqdm import tqdm

from msgs_py import FeatureKind, FeatureSet, StereoRig
from stereo_recovery import Recovery, pipeline, recover
from stereo_recovery.detection.junctions import spurious
from stereo_recovery.detection.segments import Segments
from stereo_recovery.edges import lines3d
from stereo_recovery.matching import relaxation_kernels

# Stages in their order. What is alive less than this, percent of an edge, is lost.
STAGES = (
    'edgels',
    'segments',
    'whole',
    'pairs',
    'matches',
    'joined',
    'no contour',
    'no contradiction',
    'lines',
    'kept',
)
LOST = 50.0
# An edgel or a segment is on a true edge when it is this near to its line, pixels, and turned by less than this,
# radians.
NEAR_EDGEL, NEAR, SAME_SLOPE = 1.5, 2.0, np.radians(8.0)
OFFSET = 3.0
SAMPLES = 100


@dataclass
class Trace:
    """What the stages of one recovery had; segments belong to the images, pairs are of their indices."""

    recovery: Recovery
    views: list[Any] = field(default_factory=list)
    whole: list[Segments] = field(default_factory=list)
    pairs: dict[str, tuple[np.ndarray, np.ndarray, Segments, Segments]] = field(default_factory=dict)
    lines: Any = None
    in_space: Any = None


def traced(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Trace:
    """recover(), with the results of its stages."""
    trace = Trace(Recovery(FeatureSet.empty(), (None, None)))  # type: ignore[arg-type]

    def after(module: Any, name: str, take: Any) -> Any:
        original = getattr(module, name)

        def wrapped(*args: Any, **options: Any) -> Any:
            result = original(*args, **options)
            take(args, result)
            return result

        return mock.patch.object(module, name, wrapped)

    def segmented(args: tuple, view: Any) -> None:
        trace.views.append(view)

    def matched(args: tuple, matches: Any) -> None:
        trace.whole = [args[2], args[3]]
        trace.pairs.setdefault('matches', (matches.left, matches.right, args[2], args[3]))

    def paired(args: tuple, result: Any) -> None:
        node = result[0]
        trace.pairs['pairs'] = (node[:, 0], node[:, 1], None, None)  # type: ignore[assignment]

    def joined(args: tuple, result: Any) -> None:
        trace.pairs['joined'] = (result[0].left, result[0].right, result[1], result[2])

    def of_lines(args: tuple, result: Any) -> None:
        trace.pairs.setdefault('no contour', (args[0].left, args[0].right, args[1], args[2]))
        lines, left_segments, right_segments = result
        trace.lines = lines
        trace.pairs['lines'] = (lines.left, lines.right, left_segments, right_segments)

    def solved(args: tuple, result: Any) -> None:
        # The last call before corners add pairs is the one without contradicted ones.
        trace.pairs['no contradiction'] = (args[0].left, args[0].right, args[1], args[2])

    def spaced(args: tuple, result: Any) -> None:
        trace.in_space = result

    with ExitStack() as stack:
        for patch in (
            after(pipeline, 'detect_view', segmented),
            after(pipeline, 'match', matched),
            after(relaxation_kernels, 'candidates', paired),
            after(pipeline, 'join_matched', joined),
            after(pipeline, 'edges', of_lines),
            after(lines3d, '_solved', solved),
            after(pipeline, 'to_space', spaced),
        ):
            stack.enter_context(patch)
        trace.recovery = recover(left, right, rig)
    if 'pairs' in trace.pairs and trace.whole:
        trace.pairs['pairs'] = (*trace.pairs['pairs'][:2], trace.whole[0], trace.whole[1])
    return trace


def on_edge(segments: Segments, line: np.ndarray) -> np.ndarray:
    """(n, SAMPLES) bool: the part of a line (2, 2) that each segment shows, pixels."""
    run = line[1] - line[0]
    length = max(float(np.hypot(*run)), 1e-9)
    run = run / length
    normal = np.array([-run[1], run[0]])
    places = np.stack([(end - line[0]) @ run for end in (segments.start, segments.end)], axis=1)
    # A segment may go on beyond the edge (where an outline continues): it counts where it is beside it.
    low, high = np.maximum(places.min(axis=1), 0.0), np.minimum(places.max(axis=1), length)
    off = np.zeros(len(segments))
    for end in (low, high):
        share = (end - places[:, 0]) / np.where(np.abs(np.ptp(places, axis=1)) < 1e-9, 1.0, places[:, 1] - places[:, 0])
        point = segments.start + share[:, None] * (segments.end - segments.start)
        off = np.maximum(off, np.abs((point - line[0]) @ normal))
    slope = np.abs(segments.direction @ normal)
    good = (off < NEAR) & (slope < np.sin(max(SAME_SLOPE, 2.0 / length))) & (high > low)
    sample = (np.arange(SAMPLES) + 0.5) / SAMPLES * length
    return good[:, None] & (sample >= low[:, None] - 1.5) & (sample <= high[:, None] + 1.5)


def _edgels_on(edgels: Any, line: np.ndarray) -> float:
    run = line[1] - line[0]
    length = max(float(np.hypot(*run)), 1e-9)
    run = run / length
    normal = np.array([-run[1], run[0]])
    away = edgels.position - line[0]
    good = (np.abs(away @ normal) < NEAR_EDGEL) & (np.abs(edgels.tangent @ normal) < np.sin(np.radians(20.0)))
    places = away[good] @ run
    sample = (np.arange(SAMPLES) + 0.5) / SAMPLES * length
    if len(places) == 0:
        return 0.0
    return 100.0 * float((np.abs(sample[:, None] - places).min(axis=1) < 1.5).mean())


def _contrast(image: np.ndarray, line: np.ndarray) -> tuple[float, float]:
    """Median grey levels on either side."""
    share = np.linspace(0.1, 0.9, 17)[:, None]
    run = line[1] - line[0]
    across = OFFSET * np.array([-run[1], run[0]]) / max(float(np.hypot(*run)), 1e-9)
    values = []
    for sign in (-1, 1):
        at = np.rint((1 - share) * line[0] + share * line[1] + sign * across).astype(int)
        values.append(
            float(np.median(image[np.clip(at[:, 1], 0, image.shape[0] - 1), np.clip(at[:, 0], 0, image.shape[1] - 1)]))
        )
    return values[0], values[1]


def reported(features: FeatureSet, edge: np.ndarray, place: float = SAME_PLACE) -> float:
    """Percent of a true edge (2, 3) that features cover, judged as in the benchmarks."""
    length = float(np.linalg.norm(edge[1] - edge[0]))
    line = (edge[1] - edge[0]) / length
    cover = np.zeros(SAMPLES, bool)
    sample = (np.arange(SAMPLES) + 0.5) / SAMPLES * length
    for start, end in zip(features.start, features.end):
        angle = np.arccos(min(1.0, abs((end - start) @ line) / max(float(np.linalg.norm(end - start)), 1e-12)))
        places = np.array([(x - edge[0]) @ line for x in (start, end)])
        off = max(
            float(np.linalg.norm(x - edge[0] - np.clip(p, 0, length) * line)) for x, p in zip((start, end), places)
        )
        if angle < SAME_ANGLE and off < place:
            cover |= (sample >= places.min()) & (sample <= places.max())
    return 100.0 * float(cover.mean())


@dataclass
class Loss:
    """A true edge that is not reported, and what each stage had of it, percent."""

    edge: int
    lines: list[np.ndarray]
    alive: dict[str, float]
    stage: str
    note: str
    length: float


def losses(trace: Trace, images: tuple[np.ndarray, np.ndarray], rig: StereoRig, edges: np.ndarray) -> Iterator[Loss]:
    found = trace.recovery.features.of_kind(FeatureKind.EDGE)
    for k, edge in enumerate(edges):
        cover = reported(found, edge)
        if cover >= 90.0:
            continue
        lines = list(rig.project(edge))
        alive: dict[str, float] = {}
        sides = [
            (
                _edgels_on(v.edgels, line),
                *(
                    100.0 * float(on_edge(p, line).any(axis=0).mean())
                    for p in (v.segments, v.segments.select(~spurious(v.segments)))
                ),
            )
            for v, line in zip(trace.views, lines)
        ]
        for place, name in enumerate(STAGES[:3]):
            alive[name] = min(side[place] for side in sides)
        notes = []
        for name in STAGES[3:9]:
            if name not in trace.pairs:
                alive[name] = 0.0
                continue
            left, right, mine, theirs = trace.pairs[name]
            a, b = on_edge(mine, lines[0]), on_edge(theirs, lines[1])
            good = a.any(axis=1)[left] & b.any(axis=1)[right]
            alive[name] = 100.0 * float(a[left[good]].any(axis=0).mean()) if good.any() else 0.0
            if name == 'matches' and alive[name] < LOST:
                wrong = a.any(axis=1)[left] & ~good
                other = b.any(axis=1)[right] & ~good
                notes.append(
                    'segments free'
                    if not (wrong.any() or other.any())
                    else f'left {"taken" if wrong.any() else "free"}, right {"taken" if other.any() else "free"}'
                )
        alive['kept'] = cover
        stage = next((name for name in STAGES if alive[name] < min(LOST, 90.0)), 'short')
        if stage == 'kept':
            if reported(found, edge, 4.0 * SAME_PLACE) >= LOST:
                notes.append('but false in space')
            elif trace.in_space is not None:
                left, right, mine, theirs = trace.pairs['lines']
                good = on_edge(mine, lines[0]).any(axis=1)[left] & on_edge(theirs, lines[1]).any(axis=1)[right]
                for e in np.flatnonzero(good):
                    ends = trace.in_space.ends[e]
                    span = np.linalg.norm(ends[1] - ends[0])
                    one = FeatureSet.from_edges(ends[:1], ends[1:])
                    notes.append(
                        f'err_per/span {trace.in_space.err_per[e] / span:.2f} '
                        f'true {reported(one, edge):.0f} near {reported(one, edge, 4 * SAME_PLACE):.0f}'
                    )
        sides_grey = [_contrast(image, line) for image, line in zip(images, lines)]
        notes.append(' '.join(f'{a:.0f}:{b:.0f}' for a, b in sides_grey))
        yield Loss(
            k, lines, alive, stage, '; '.join(notes), float(np.linalg.norm(edge[1] - edge[0])) * (1.0 - cover / 100.0)
        )


def scenes(options: argparse.Namespace) -> Iterator[tuple[str, np.ndarray, np.ndarray, StereoRig, np.ndarray]]:
    for kind in options.kinds:
        if not options.seeds:
            for view in views(kind, options.views, options.seed):
                yield view.name, view.left, view.right, RIG, view.edges
            continue
        for seed in options.seeds:
            if kind == 'curves':
                for name in CURVES:
                    seen = curved_view(name, seed)
                    yield f'{name} {seed}', seen.left, seen.right, seen.rig, seen.edges
            else:
                scene = random_scene(seed, kind)
                yield scene.name, scene.left, scene.right, scene.rig, scene.edges[~scene.faint]


def draw(path: Path, images: tuple[np.ndarray, np.ndarray], found: list[Loss], scale: int = 2) -> None:
    shown = []
    for side, image in enumerate(images):
        big = cv2.cvtColor(
            cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST), cv2.COLOR_GRAY2BGR
        )
        for loss in found:
            a, b = (tuple(int(x) for x in np.rint(scale * (p + 0.5))) for p in loss.lines[side])
            cv2.line(big, a, b, (0, 0, 255), 1)
            cv2.putText(
                big,
                f'{loss.edge} {loss.stage}',
                ((a[0] + b[0]) // 2, (a[1] + b[1]) // 2),
                cv2.FONT_HERSHEY_SIMPLEX,
                0.5,
                (0, 255, 255),
                1,
            )
        shown.append(big)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.hstack(shown))


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('--seeds', type=seed_range, metavar='A..B', help='scenes of bench_lines or bench_curves')
    parser.add_argument('--seed', type=int, default=5, help='of the views of bench_stereo')
    parser.add_argument('--views', type=int, default=20, help='of bench_stereo, of each kind')
    parser.add_argument('--kinds', nargs='+', default=['flat'], choices=sorted({*VIEWS, *KINDS, 'curves'}))
    parser.add_argument('--pictures', type=Path, help='folder for pictures of the scenes with lost edges')
    options = parser.parse_args(arguments)
    counts: Counter[str] = Counter()
    lengths: dict[str, float] = defaultdict(float)
    total = 0.0
    for name, left, right, rig, edges in tqdm(scenes(options), file=sys.stderr, disable=not sys.stderr.isatty()):
        trace = traced(left, right, rig)
        found = list(losses(trace, (left, right), rig, edges))
        total += float(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1).sum())
        for loss in found:
            counts[loss.stage] += 1
            lengths[loss.stage] += loss.length
            (u, v), (x, y) = loss.lines[0]
            row = ' '.join(f'{loss.alive[stage]:3.0f}' for stage in STAGES)
            print(f'{name:<16} {loss.edge:>2} {u:3.0f},{v:3.0f}-{x:3.0f},{y:3.0f} {row} {loss.stage:<16} {loss.note}')
        if options.pictures and found:
            draw(options.pictures / f'{name.replace(" ", "_")}.png', (left, right), found)
    print(f'{"lost at":<18} edges  share of all length')
    for stage in (*STAGES, 'short'):
        if counts[stage]:
            print(f'{stage:<18} {counts[stage]:>5} {100.0 * lengths[stage] / max(total, 1e-9):6.2f} %')
    return 0


if __name__ == '__main__':
    sys.exit(main())
