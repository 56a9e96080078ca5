"""Where true length is lost on the way from the picture to the reported edge, stage by stage.

A sample of a true edge is followed through one recovery: whether both eyes have edgels there, then segments, whether a
left and a right one of them are a candidate, are matched, have the right disparity in the estimate, and are reported.
What each later stage is asked for is what the stages before have kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from pair_scoring import CLASSES, DISPARITY_PX, PLACE_PX, SAME_DEG, _samples, found_samples
from scipy import sparse
from scipy.spatial import cKDTree
from true_pairs import FAMILIES, PHOTOREAL_KINDS, TruePair, _image_slope

import stereo_recovery.detection.view as view_module
from msgs_py import FeatureKind
from stereo_recovery import pipeline
from stereo_recovery.detection.segments import Segments
from stereo_recovery.edges import selection
from stereo_recovery.matching import labelling

# What a sample fails first; the last is what all stages kept and the score does not find.
STAGES = ('edgel', 'segment', 'candidate', 'match', 'estimate', 'bound', 'selection', 'score')
# Edgels of an edge have its direction to this, degrees: three sigma of the faintest.
EDGEL_DEG = 30.0
# Samples looked at together.
BLOCK = 1000


class Trace(NamedTuple):
    """What went through one recovery. chains: edgels of the left and the right picture; game: (k, 2) candidates that
    the labelling weighed, of ``weighed``; chosen: those it chose; lines, segments: as the selection got them, with
    whether each is reported, and whether its bound forbade that."""

    chains: list[Any]
    weighed: tuple[Segments, Segments]
    game: np.ndarray
    chosen: np.ndarray
    lines: Any
    segments: tuple[Segments, Segments]
    kept: np.ndarray
    wide: np.ndarray


def traced(recover: Callable[[], Any]) -> tuple[Any, Trace | None]:
    """What a recovery returns, and what went through it; None when it ended before anything was selected."""
    seen: dict[str, list[Any]] = {}
    with (
        watched(view_module, 'split', seen, lambda given, _: given[0].edgels),
        watched(pipeline, 'detect_views', seen, lambda _, out: out),
        watched(pipeline, 'in_light', seen, lambda _, out: out),
        watched(labelling, '_labelling', seen, lambda given, out: (given[0], out)),
        watched(pipeline, 'is_edge', seen, lambda given, out: (given, out)),
    ):
        result = recover()
    if not all(name in seen for name in ('_labelling', 'is_edge')):
        return result, None
    views = seen['detect_views'][0]
    # The two pictures are looked at in two threads, in any order.
    chains = sorted(seen['split'], key=lambda e: not _is_of(e, views[0]))
    game, out = seen['_labelling'][-1]
    (lines, in_space, segments, *_), kept = seen['is_edge'][-1]
    wide = ~selection.has_direction(in_space)
    # Where edges are in light decides which of them are worth matching.
    in_light = seen['in_light'][0]
    weighed = in_light[0].matchable, in_light[1].matchable
    return result, Trace(chains, weighed, game, game[out.chosen], lines, segments, kept, wide)


def _is_of(edgels: Any, view: Any) -> bool:
    """Whether the segments of a view are mostly of these edgels; they have those as well by which they grew."""
    return len(view.edgels) > 0 and bool(np.isin(view.edgels.position[:, 0], edgels.position[:, 0]).mean() > 0.5)


@contextmanager
def watched(module: Any, name: str, seen: dict[str, list[Any]], keep: Callable[..., Any]) -> Iterator[None]:
    """A function of a module, each call of which is kept in ``seen``."""
    own = getattr(module, name)

    def watching(*given: Any, **more: Any) -> Any:
        out = own(*given, **more)
        seen.setdefault(name, []).append(keep(given, out))
        return out

    setattr(module, name, watching)
    try:
        yield
    finally:
        setattr(module, name, own)


def lost_at(pair: TruePair, trace: Trace, found: np.ndarray) -> np.ndarray:
    """(s,) int: the stage of STAGES that loses each true sample, -1: found."""
    offset = pair.rig.left.cx - pair.rig.right.cx
    best = np.zeros(len(found), int)
    for disparity in (pair.near, pair.far) if (pair.near != pair.far).any() else (pair.near,):
        right = pair.pixel - np.column_stack([disparity + offset, np.zeros(len(found))])
        best = np.maximum(best, _reached(pair, trace, right, disparity + offset))
    return np.where(found, -1, best)


def _reached(pair: TruePair, trace: Trace, right: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    """(s,) int: the first stage that has nothing of a sample whose place in the right picture is known."""
    slopes = [pair.slope, pair.slope]
    if np.isfinite(pair.direction).all() and len(right):
        slopes[1] = _image_slope(pair.point, pair.direction, pair.rig, pair.rig.baseline)
    places = (pair.pixel, right)
    result = np.zeros(len(right), int)
    edgel = _beside(trace.chains[0], places[0], slopes[0]) & _beside(trace.chains[1], places[1], slopes[1])
    for first in range(0, len(right), BLOCK):
        part = slice(first, first + BLOCK)
        on = [
            sparse.csr_array(covering(segments, place[part], slope[part]))
            for segments, place, slope in zip(trace.weighed, places, slopes)
        ]
        segment = np.logical_and(*(np.diff(each.indptr) > 0 for each in on))
        candidate, match = (
            _has_pair(on, chosen, [len(each) for each in trace.weighed]) for chosen in (trace.game, trace.chosen)
        )
        line, wide, kept = _lines_at(trace, places[0][part], slopes[0][part], disparity[part])
        here = edgel[part] | segment
        stages = [here, segment, candidate, match, line, line & ~wide, kept]
        # A later stage may have what an earlier one has not: an edge between two corners has one segment.
        last = np.where(np.any(stages, axis=0), len(stages) - np.argmax(stages[::-1], axis=0), 0)
        result[part] = last
    return result


def _beside(edgels: Any, pixel: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """(s,) bool: whether an edgel lies at a sample and has its direction."""
    if len(edgels) == 0 or len(pixel) == 0:
        return np.zeros(len(pixel), bool)
    tree = cKDTree(edgels.position)
    distance, index = tree.query(pixel, k=8, distance_upper_bound=PLACE_PX)
    there = np.isfinite(distance)
    direction = edgels.direction[np.where(there, index, 0)]
    across = np.abs(np.cos(direction) * slope[:, :1] + np.sin(direction) * slope[:, 1:])
    return np.asarray((there & (across < np.sin(np.radians(EDGEL_DEG)))).any(axis=1))


def covering(segments: Segments, pixel: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """(s, n) bool: which segments pass samples in their direction."""
    away = pixel[:, None] - segments.centre
    t = segments.direction
    along = np.einsum('snj,nj->sn', away, t)
    across = np.abs(away[..., 0] * t[:, 1] - away[..., 1] * t[:, 0])
    on = (along >= segments.extent[:, 0] - PLACE_PX) & (along <= segments.extent[:, 1] + PLACE_PX)
    return on & (across < PLACE_PX) & (np.abs(slope @ t.T) >= np.cos(np.radians(SAME_DEG)))


def _has_pair(on: list[Any], pairs: np.ndarray, sizes: list[int]) -> np.ndarray:
    """(s,) bool: whether a pair (k, 2) is of a left and a right segment on a sample."""
    links = sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=sizes).tocsr()
    reached = (on[0].astype(float) @ links).multiply(on[1].astype(float))
    return np.asarray(reached.sum(axis=1)).ravel() > 0


def _lines_at(
    trace: Trace, pixel: np.ndarray, slope: np.ndarray, disparity: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(s,) bool: whether a line has a sample's disparity; whether all that do are too uncertain; one is kept."""
    lines, left = trace.lines, trace.segments[0].select(trace.lines.left)
    left = Segments(**{**left.__dict__, 'extent': lines.extent})
    on = covering(left, pixel, slope)
    along = np.einsum('snj,nj->sn', pixel[:, None] - left.centre, left.direction)
    off = np.abs(lines.coefficient[:, 0] + lines.coefficient[:, 1] * along - disparity[:, None])
    right = on & (off <= DISPARITY_PX)
    return right.any(axis=1), ~(right & ~trace.wide).any(axis=1), (right & trace.kept).any(axis=1)


def lost_lengths(pair: TruePair, recover: Callable[[], Any]) -> dict[str, dict[str, float]]:
    """Pixels asked for, found, and lost at each stage, by class of contrast and near the rows.

    recover : ours, or what calls it
    """
    result, trace = traced(recover)
    features = getattr(result, 'features', result)
    found = found_samples(pair, _samples(pair, features.of_kind(FeatureKind.EDGE)))
    lost = np.where(found, -1, 0) if trace is None else lost_at(pair, trace, found)
    classes = {'all': pair.asked, 'rows': pair.asked & pair.flat}
    for name, low, high in CLASSES:
        classes[f'{name}+'] = pair.asked & (pair.contrast >= low) & (pair.contrast < high)
    return {
        name: {
            'asked': float(pair.weight[which].sum()),
            'found': float(pair.weight[which & (lost < 0)].sum()),
            **{stage: float(pair.weight[which & (lost == k)].sum()) for k, stage in enumerate(STAGES)},
        }
        for name, which in classes.items()
    }


LEGEND = """\
shares of the true length: found, or lost where, of both eyes, one has no edgel or no segment there, no two segments
are a candidate, none are a match, the estimate has another disparity, its bound is too wide to be reported, or it is
not reported for another reason; score: reported, and not near enough. 6+: edges of a contrast of 6 to 20 grey levels"""


def stage_table(rows: list[dict[str, Any]]) -> str:
    """Of rows with a family and what :func:`lost_lengths` gives under ``lost``: a line a family and class."""
    groups = {'photoreal': [row for row in rows if row['family'] in PHOTOREAL_KINDS]}
    groups |= {family: [row for row in rows if row['family'] == family] for family in FAMILIES}
    lines = [f'{"":<20}{"px":>8}' + ''.join(f'{name:>10}' for name in ('found', *STAGES))]
    for family, own in groups.items():
        for name in own[0]['lost'] if own else ():
            total = {key: sum(row['lost'][name][key] for row in own) for key in ('asked', 'found', *STAGES)}
            if total['asked'] > 0.0:
                shares = ''.join(f'{total[key] / total["asked"]:>10.3f}' for key in ('found', *STAGES))
                lines.append(f'{family + " " + name:<20}{total["asked"]:>8.0f}{shares}')
    return '\n'.join(lines)
