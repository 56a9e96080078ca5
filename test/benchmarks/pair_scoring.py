"""One score for stereo recovery on every kind of pair: what is found, what is true, how near, and within which bounds.

A sample of a true edge is found when a reported edge runs beside it: PLACE_PX in the image, DISPARITY_PX in depth, and
within SAME_DEG in direction. A sample of a reported edge is right when it lies on a true edge, or on a surface whose
place is known, to the same pixel of disparity; it is gross when it is GROSS_PX off or on nothing.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from scipy.spatial import cKDTree
from true_pairs import STEP, TruePair, beside_disparity, line_segments

from msgs_py import FeatureKind, FeatureSet

PLACE_PX, DISPARITY_PX, GROSS_PX, SAME_DEG = 2.0, 1.0, 3.0, 10.0
# Contrast classes, grey levels, by the least of each.
CLASSES = (('40', 40.0, np.inf), ('20', 20.0, 40.0), ('6', 6.0, 20.0))
# Neighbours that are looked at around a sample: three edges beside each other have so many.
NEIGHBOURS = 32
# A reported edge belongs to the true one on which this share of its samples lies.
BELONGS = 0.5
# A curve is a true one when normal, centre and radii (shares of the true radius) are this near.
SAME_NORMAL_DEG, SAME_CENTRE, SAME_RADIUS, LEAST_PLACE_M, LEAST_RADIUS_M = 10.0, 0.15, 0.12, 1e-3, 5e-4


def score(pair: TruePair, features: FeatureSet) -> dict[str, Any]:
    """One flat row of figures; shares are None where there is nothing to take a share of. Keys that end in _px are
    lengths in the left image, so that rows of several pairs can be added; see :func:`summary`."""
    edges = features.of_kind(FeatureKind.EDGE)
    mine = _samples(pair, edges)
    found = found_samples(pair, mine)
    right, gross, judged, on_edge = judged_samples(pair, mine)
    row: dict[str, Any] = {'edges': len(edges)}
    weight = pair.weight
    classes = {'': pair.asked, '_flat': pair.asked & pair.flat}
    classes |= {f'_{name}': pair.asked & (pair.contrast >= low) & (pair.contrast < high) for name, low, high in CLASSES}
    for name, asked in classes.items():
        total, have = float(weight[asked].sum()), float(weight[asked & found].sum())
        row |= {f'asked{name}_px': total, f'found{name}_px': have, f'recall{name}': _share(have, total)}
    length = mine['weight']
    h, w = pair.parts.shape
    at = np.clip(np.round(mine['pixel']).astype(int), 0, [w - 1, h - 1])
    parts = judged & (pair.parts[at[:, 1], at[:, 0]] | ~pair.judged[at[:, 1], at[:, 0]])
    chosen = {'reported': judged, 'right': judged & right, 'gross': judged & gross}
    chosen |= {'parts': parts, 'right_parts': parts & right}
    for name, which in chosen.items():
        row[f'{name}_px'] = float(length[which].sum())
    row['all_px'] = float(length.sum())
    row['right'] = _share(row['right_px'], row['reported_px'])
    row['gross'] = _share(row['gross_px'], row['reported_px'])
    row['right_parts'] = _share(row['right_parts_px'], row['parts_px'])
    row |= _precision(pair, edges, mine, on_edge)
    row |= _circles(pair, features.of_kind(FeatureKind.CURVE))
    if np.isfinite(pair.plane).all():
        off = np.abs(mine['point'] @ pair.plane[:3] - pair.plane[3]) > 1.0
        row['wrong_period_px'] = float(length[judged & off].sum())
        row['wrong_period'] = _share(row['wrong_period_px'], row['reported_px'])
    return row


def _share(part: float, whole: float) -> float | None:
    return part / whole if whole > 0.0 else None


def _samples(pair: TruePair, edges: FeatureSet) -> dict[str, np.ndarray]:
    """Samples of the reported edges that lie in the left image, evenly in it."""
    start, end = (x[:, :2] / np.maximum(x[:, 2:], 1e-6) for x in (edges.start, edges.end))
    focal = np.array([pair.rig.left.fx, pair.rig.left.fy])
    inverse = 1.0 / np.maximum(np.stack([edges.start[:, 2], edges.end[:, 2]], axis=1), 1e-6)
    length = np.linalg.norm((end - start) * focal, axis=1)
    # An edge that leaves the picture or is wildly deep is not sampled for ever.
    size = np.minimum(
        np.maximum(length, pair.scale * np.abs(inverse[:, 1] - inverse[:, 0])), 2.0 * sum(pair.left.shape)
    )
    count = np.ceil(size / STEP).astype(int) + 1
    owner = np.repeat(np.arange(len(edges)), count)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    t = ((place + 0.5) / count[owner])[:, None]
    seen = (1 - t) * start[owner] + t * end[owner]
    pixel = seen * focal + [pair.rig.left.cx, pair.rig.left.cy]
    inside = pair.rig.left.contains(pixel)
    seen, pixel, owner, t = seen[inside], pixel[inside], owner[inside], t[inside]
    depth = 1.0 / ((1 - t[:, 0]) * inverse[owner, 0] + t[:, 0] * inverse[owner, 1])
    slope = (end - start) * focal
    slope = slope / np.maximum(length, 1e-9)[:, None]
    return {
        'point': np.column_stack([seen, np.ones(len(seen))]) * depth[:, None],
        'pixel': pixel,
        'disparity': pair.scale / depth,
        'slope': slope[owner],
        'direction': edges.directions[owner],
        'owner': owner,
        'weight': (length / count)[owner],
    }


def _space(pair: TruePair, pixel: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    """Coordinates in which two samples are one place when none differs by more than 1."""
    return np.column_stack([pixel / PLACE_PX, disparity / (DISPARITY_PX + pair.slack)])


def _neighbours(tree: cKDTree, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(s, k) indices of the tree's samples at a place, and which of them are there."""
    _, index = tree.query(places, k=NEIGHBOURS, p=np.inf, distance_upper_bound=1.0)
    there = index < tree.n
    return np.where(there, index, 0), there


def found_samples(pair: TruePair, mine: dict[str, np.ndarray]) -> np.ndarray:
    """(s,) bool: whether a reported edge lies at each true sample, along it."""
    found = np.zeros(len(pair.weight), bool)
    if len(mine['owner']) == 0 or len(found) == 0:
        return found
    tree = cKDTree(_space(pair, mine['pixel'], mine['disparity']))
    known = np.isfinite(pair.direction[:, :1])
    for disparity in (pair.near, pair.far) if (pair.near != pair.far).any() else (pair.near,):
        index, there = _neighbours(tree, _space(pair, pair.pixel, disparity))
        in_image = np.abs(np.einsum('skj,sj->sk', mine['slope'][index], pair.slope))
        in_space = np.abs(np.einsum('skj,sj->sk', mine['direction'][index], pair.direction))
        along = np.where(known, in_space, in_image) >= np.cos(np.radians(SAME_DEG))
        found |= (there & along).any(axis=1)
    return found


def judged_samples(pair: TruePair, mine: dict[str, np.ndarray]) -> tuple[np.ndarray, ...]:
    """right, gross, judged (s,) bool of reported samples, and the true straight edge each lies on, -1: none."""
    count = len(mine['owner'])
    right, on_edge = np.zeros(count, bool), np.full(count, -1)
    if count == 0:
        return right, right, right, on_edge
    if len(pair.weight):
        index, there = _neighbours(
            cKDTree(_space(pair, pair.pixel, pair.near)), _space(pair, mine['pixel'], mine['disparity'])
        )
        right |= there.any(axis=1)
        known = np.isfinite(pair.direction[index]).all(axis=2)
        along = np.abs(np.einsum('skj,sj->sk', pair.direction[index], mine['direction']))
        hit = there & known & (along >= np.cos(np.radians(SAME_DEG))) & (pair.edge[index] >= 0)
        first = hit.argmax(axis=1)
        on_edge = np.where(hit.any(axis=1), pair.edge[index[np.arange(count), first]], -1)
    beside = beside_disparity(pair.surface, mine['pixel'], mine['slope'])
    off = np.abs(beside - mine['disparity'][:, None])
    off = np.where(np.isfinite(off), off, np.inf).min(axis=1)
    right |= off <= DISPARITY_PX + pair.slack
    h, w = pair.judged.shape
    at = np.round(mine['pixel']).astype(int)
    inside = (at >= 0).all(axis=1) & (at[:, 0] < w) & (at[:, 1] < h)
    judged = inside & pair.judged[np.clip(at[:, 1], 0, h - 1), np.clip(at[:, 0], 0, w - 1)]
    if not pair.judged.all() and len(pair.edges):
        # What follows a true edge in the picture is judged though the surfaces end there.
        index, there = _neighbours(cKDTree(pair.pixel / PLACE_PX), mine['pixel'] / PLACE_PX)
        along = np.abs(np.einsum('skj,sj->sk', pair.slope[index], mine['slope'])) >= np.cos(np.radians(SAME_DEG))
        judged |= inside & (there & along).any(axis=1)
    return right, ~right & (off > GROSS_PX + pair.slack), judged, on_edge


def true_lines(pair: TruePair, edges: FeatureSet) -> tuple[np.ndarray, np.ndarray]:
    """The reported edges (m,) that belong to a true one, and the ends of that (m, 2, 3)."""
    if len(edges) == 0 or len(pair.edges) == 0:
        return np.zeros(0, int), np.zeros((0, 2, 3))
    mine = _samples(pair, edges)
    own, best = _belonging(pair, edges, mine, judged_samples(pair, mine)[3])
    return own, pair.edges[best]


def _belonging(
    pair: TruePair, edges: FeatureSet, mine: dict[str, np.ndarray], on_edge: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The reported edges (m,) most samples of which lie on one true edge, and that edge's number (m,)."""
    count = np.bincount(mine['owner'], minlength=len(edges))
    key = mine['owner'] * (len(pair.edges) + 1) + on_edge + 1
    votes = np.bincount(key, minlength=len(edges) * (len(pair.edges) + 1)).reshape(len(edges), -1)[:, 1:]
    best = votes.argmax(axis=1)
    own = np.flatnonzero(votes[np.arange(len(edges)), best] >= np.maximum(BELONGS * count, 1))
    return own, best[own]


def _precision(pair: TruePair, edges: FeatureSet, mine: dict[str, np.ndarray], on_edge: np.ndarray) -> dict[str, Any]:
    """How near the reported edges are to the true ones they belong to, and whether the stated bounds hold."""
    names = ('angle_deg', 'across_mm', 'along_mm', 'end_mm')
    empty: dict[str, Any] = {name: [] for name in names} | {'inside_per': [], 'inside_par': []}
    if len(edges) == 0 or len(pair.edges) == 0:
        return empty
    own, best = _belonging(pair, edges, mine, on_edge)
    a, b = pair.edges[best, 0], pair.edges[best, 1]
    true_length = np.linalg.norm(b - a, axis=1)
    line = (b - a) / true_length[:, None]
    ends = np.stack([edges.start[own], edges.end[own]], axis=1)
    away = ends - a[:, None]
    places = np.einsum('nej,nj->ne', away, line)
    across = np.linalg.norm(away - places[..., None] * line[:, None], axis=2)
    beyond = np.maximum(np.maximum(-places, places - true_length[:, None]), 0.0)
    turn = np.degrees(np.arccos(np.minimum(1.0, np.abs(np.einsum('nj,nj->n', edges.directions[own], line)))))
    stated = edges.err_per[own] > 0.0
    # The ends of what was found of each true edge, where most of it was found.
    end_errors: list[float] = []
    for m in np.unique(best):
        of = places[best == m]
        low, high = of.min(), of.max()
        if high - low > BELONGS * true_length[best == m][0]:
            end_errors += [abs(low), abs(high - true_length[best == m][0])]
    return {
        'angle_deg': turn.tolist(),
        'across_mm': (1e3 * across).ravel().tolist(),
        'along_mm': (1e3 * beyond).ravel().tolist(),
        'end_mm': [1e3 * e for e in end_errors],
        'inside_per': (across <= edges.err_per[own, None])[stated].ravel().tolist(),
        'inside_par': (beyond <= edges.err_par[own, None] + 1e-12)[stated].ravel().tolist(),
    }


def matched_circles(pair: TruePair, curves: FeatureSet) -> tuple[dict[int, int], np.ndarray, np.ndarray, np.ndarray]:
    """Which reported curve (by number) is which true circle; for all pairs (c, m) how unlike they are, below 1 one, the
    difference of radii, metres, and of normals, degrees."""
    true = pair.circle
    turn = np.degrees(np.arccos(np.minimum(1.0, np.abs(true[:, 3:6] @ curves.directions.T))))
    away = curves.start[None] - true[:, None, :3]
    # Along the line of sight a pixel of disparity is allowed.
    sight = true[:, :3] / np.linalg.norm(true[:, :3], axis=1, keepdims=True)
    deep = np.abs(np.einsum('tcj,tj->tc', away, sight))
    side = np.sqrt(np.maximum((away**2).sum(axis=2) - deep**2, 0.0))
    radius = true[:, 6:7]
    least = np.maximum(SAME_CENTRE * radius, LEAST_PLACE_M)
    pixel_deep = true[:, 2:3] ** 2 * DISPARITY_PX / pair.scale
    size = np.abs(np.sort(curves.radii, axis=1)[None] - np.sort(true[:, None, 6:8], axis=2)).max(axis=2)
    cost = np.max(
        [
            turn / SAME_NORMAL_DEG,
            side / least,
            deep / np.maximum(least, pixel_deep),
            size / np.maximum(SAME_RADIUS * radius, LEAST_RADIUS_M),
        ],
        axis=0,
    )
    pairs: dict[int, int] = {}
    for k in np.argsort(cost, axis=None):
        i, j = (int(x) for x in np.unravel_index(k, cost.shape))
        if cost[i, j] < 1.0 and i not in pairs and j not in pairs.values():
            pairs[i] = j
    return pairs, cost, size, turn


def _circles(pair: TruePair, curves: FeatureSet) -> dict[str, Any]:
    """True circles found, found twice, and curves that lie on nothing at all."""
    true, wanted = pair.circle, pair.circle[:, 11] > 0.0
    result: dict[str, Any] = {'circles': int(wanted.sum()), 'circles_found': 0, 'circles_twice': 0}
    result |= {'curves': len(curves), 'curves_on_nothing': 0, 'radius_percent': [], 'normal_deg': []}
    if len(curves) == 0:
        return result
    pairs, cost, size, turn = matched_circles(pair, curves)
    radius = true[:, 6:7]
    result['circles_found'] = sum(bool(wanted[i]) for i in pairs)
    for i, j in pairs.items():
        if wanted[i]:
            result['radius_percent'].append(100.0 * float(size[i, j] / radius[i, 0]))
            result['normal_deg'].append(float(turn[i, j]))
    for j in set(range(len(curves))) - set(pairs.values()):
        if len(cost) and cost[:, j].min() < 1.0:
            result['circles_twice'] += 1
        elif curve_rightness(pair, curves, j) < 0.5:
            result['curves_on_nothing'] += 1
    return result


def curve_rightness(pair: TruePair, curves: FeatureSet, index: int) -> float:
    """Share of a curve's judged points that lie on a true curve or a known surface; 1 where nothing can be said."""
    points = curves.polyline(index, 97)
    points = points[points[:, 2] > 1e-3]
    chain = FeatureSet.from_edges(points[:-1], points[1:])
    right, _, judged, _ = judged_samples(pair, _samples(pair, chain))
    return float(right[judged].mean()) if judged.any() else 1.0


# -- several pairs ---------------------------------------------------------------------------------------------


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Totals by length of several rows, and medians over pairs under ``pair_*``."""
    result: dict[str, Any] = {'pairs': len(rows)}

    def add(name: str) -> float:
        return float(sum(row.get(name) or 0.0 for row in rows))

    for name in ('', '_40', '_20', '_6', '_flat'):
        result[f'recall{name}'] = _share(add(f'found{name}_px'), add(f'asked{name}_px'))
    for name in ('right', 'gross', 'wrong_period'):
        result[name] = _share(add(f'{name}_px'), add('reported_px'))
    result['right_parts'] = _share(add('right_parts_px'), add('parts_px'))
    if not any('wrong_period' in row for row in rows):
        result['wrong_period'] = None
    pooled = {
        name: [x for row in rows for x in row.get(name, ())]
        for name in ('angle_deg', 'across_mm', 'end_mm', 'inside_per', 'inside_par', 'radius_percent')
    }
    for name in ('angle_deg', 'across_mm', 'end_mm', 'radius_percent'):
        result[name] = float(np.median(pooled[name])) if pooled[name] else None
        result[f'{name}_p90'] = float(np.quantile(pooled[name], 0.9)) if pooled[name] else None
    for name in ('inside_per', 'inside_par'):
        result[name] = float(np.mean(pooled[name])) if pooled[name] else None
    for name in ('circles', 'circles_found', 'circles_twice', 'curves', 'curves_on_nothing', 'edges'):
        result[name] = int(add(name))
    for name in ('recall', 'recall_flat', 'right', 'gross', 'ms', 'lsd_ms', 'in_lsd', 'cpu_in_lsd'):
        values = [row[name] for row in rows if row.get(name) is not None]
        result[f'pair_{name}'] = float(np.median(values)) if values else None
    stages = sorted({stage for row in rows for stage in row.get('stages', {})})
    result['stages'] = {s: float(np.median([row.get('stages', {}).get(s, 0.0) for row in rows])) for s in stages}
    return result


# -- the recipe a user would try first -------------------------------------------------------------------------

SHORTEST_PX, INLIER_PX, LEAST_INLIERS = 12.0, 1.0, 0.5
PROFILE = 24


def semi_global_edges(pair: TruePair) -> FeatureSet:
    """LSD in the left image laid on OpenCV's semi-global disparity: a robust line through the disparities beside each
    segment, the nearer side where there are two. Told the range of disparities."""
    lines = line_segments(pair.left)
    lines = lines[np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1]) >= SHORTEST_PX]
    offset = pair.rig.left.cx - pair.rig.right.cx
    low, high = pair.disparity_window()
    low = int(np.floor(low + offset))
    count = int(np.ceil((high + offset - low) / 16.0)) * 16
    # Columns that have no counterpart inside the right image would be left out; a border keeps them.
    matcher = cv2.StereoSGBM_create(
        low, max(16, count), 5, 8 * 25, 32 * 25, 1, 31, 10, 100, 2, cv2.STEREO_SGBM_MODE_SGBM_3WAY
    )
    border = max(0, low + count)
    left, right = (cv2.copyMakeBorder(x, 0, 0, border, 0, cv2.BORDER_REPLICATE) for x in (pair.left, pair.right))
    disparity = matcher.compute(left, right)[:, border:].astype(np.float32) / 16.0
    disparity[disparity < low] = np.nan
    t = (np.arange(PROFILE) + 0.5) / PROFILE
    run = lines[:, 2:] - lines[:, :2]
    normal = np.column_stack([-run[:, 1], run[:, 0]]) / np.maximum(np.hypot(*run.T), 1e-9)[:, None]
    at = lines[:, None, :2] + t[None, :, None] * run[:, None]
    best_depth = np.full(len(lines), -np.inf)
    ends = np.zeros((len(lines), 2))
    h, w = disparity.shape
    for side in (-2.5, 2.5):
        p = np.round(at + side * normal[:, None]).astype(int)
        inside = (p[..., 0] >= 0) & (p[..., 0] < w) & (p[..., 1] >= 0) & (p[..., 1] < h)
        d = np.where(inside, disparity[np.clip(p[..., 1], 0, h - 1), np.clip(p[..., 0], 0, w - 1)], np.nan)
        known = np.isfinite(d)
        middle = np.nanmedian(np.where(known.any(axis=1)[:, None], d, 0.0), axis=1)
        slope = np.zeros(len(lines))
        for limit in (4.0, 2.0, 1.0, 1.0):
            fit = middle[:, None] + slope[:, None] * (t - 0.5)
            good = known & (np.abs(d - fit) < limit * INLIER_PX)
            g, x, y = good.astype(float), t[None] - 0.5, np.where(good, d, 0.0)
            n = np.maximum(g.sum(axis=1), 1e-9)
            mx, my = (g * x).sum(axis=1) / n, (g * y).sum(axis=1) / n
            spread = (g * (x - mx[:, None]) ** 2).sum(axis=1)
            slope = (g * (x - mx[:, None]) * (y - my[:, None])).sum(axis=1) / np.maximum(spread, 1e-6)
            middle = my - slope * mx
        valid = good.mean(axis=1) >= LEAST_INLIERS
        nearer = valid & (middle > best_depth)
        best_depth[nearer] = middle[nearer]
        ends[nearer] = np.stack([middle - 0.5 * slope, middle + 0.5 * slope], axis=1)[nearer]
    keep = np.isfinite(best_depth) & ((ends - offset) > 0.5).all(axis=1)
    lines, ends = lines[keep], ends[keep]
    start = pair.rig.triangulate(lines[:, :2], lines[:, 0] - ends[:, 0])
    end = pair.rig.triangulate(lines[:, 2:], lines[:, 2] - ends[:, 1])
    return FeatureSet.from_edges(start, end)


# -- pictures --------------------------------------------------------------------------------------------------

GREEN, RED, MAGENTA, GREY = (60, 220, 60), (40, 40, 255), (255, 60, 255), (200, 160, 90)


def drawing(pair: TruePair, features: FeatureSet) -> np.ndarray:
    """(h, w, 3) uint8 BGR, small pictures twice as large: true samples found (green) and missed (red), reported samples
    that are wrong (magenta); right ones on a mere surface, and true ones not asked for, pale blue."""
    factor = 2 if pair.left.shape[1] < 900 else 1
    large = cv2.resize(pair.left, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
    image = cv2.cvtColor(large // 2 + 40, cv2.COLOR_GRAY2BGR)
    edges = features.of_kind(FeatureKind.EDGE)
    mine = _samples(pair, edges)
    right, _, judged, on_edge = judged_samples(pair, mine)
    found = found_samples(pair, mine)

    def dots(pixel: np.ndarray, colour: tuple[int, int, int]) -> None:
        at = np.round((pixel + 0.5) * factor - 0.5).astype(int)
        at = at[((at >= 0) & (at < [image.shape[1] - 1, image.shape[0] - 1])).all(axis=1)]
        for du in (0, 1):
            image[at[:, 1], at[:, 0] + du] = colour
            image[at[:, 1] + 1, at[:, 0] + du] = colour

    dots(mine['pixel'][right & (on_edge < 0) | ~judged], GREY)
    dots(pair.pixel[~pair.asked & (pair.edge >= 0)], GREY)
    dots(pair.pixel[pair.asked & ~found], RED)
    dots(pair.pixel[pair.asked & found], GREEN)
    dots(mine['pixel'][judged & ~right], MAGENTA)
    curves = features.of_kind(FeatureKind.CURVE)
    for number in range(len(curves)):
        points = curves.polyline(number, 97)
        if (points[:, 2] > 1e-3).all():
            at = np.round((pair.rig.left.project(points) + 0.5) * factor - 0.5).astype(np.int32)
            fine = curve_rightness(pair, curves, number) >= 0.5
            cv2.polylines(image, [at], False, (220, 220, 0) if fine else MAGENTA, 1, cv2.LINE_AA)
    return image
