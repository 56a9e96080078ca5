"""Edges that print, folds or a changing background break: closed forms, and boxes with print on their faces."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from msgs_py import FeatureKind, PinholeCamera, StereoRig
from stereo_recovery import recover
from stereo_recovery.detection.edgels import Edgels
from stereo_recovery.detection.segments import Segments, fit_segments
from stereo_recovery.edges import broken_edges
from stereo_recovery.matching.matches import Matches
from stereo_recovery.matching.merging import join_matched, joined_line, split_matched


def segments(*ends) -> Segments:
    """Straight segments from (start, end) pairs, pixels."""
    ends = np.array(ends, float)
    run = ends[:, 1] - ends[:, 0]
    length = np.hypot(*run.T)
    n, zeros = len(ends), np.zeros(len(ends))
    return Segments(
        np.zeros((n, 2), int),
        np.zeros(n, int),
        ends.mean(axis=1),
        run / length[:, None],
        0.5 * np.column_stack([-length, length]),
        zeros,
        zeros,
        length,
        np.full((n, 2), 0.02),
        zeros + 20.0,
        np.full(n, -1, np.int32),
    )


def matched(*pairs, disparity) -> Matches:
    left, right = np.array(pairs, np.int32).T
    return Matches(left, right, np.array(disparity, float), np.zeros((len(left), 2)), np.ones(len(left)))


def test_the_line_through_parts_of_a_line_is_that_line():
    parts = segments(((0, 0), (30, 3)), ((40, 4), (100, 10)))
    line = joined_line(parts, np.arange(2), np.array([1.0, 0.0]))
    assert np.allclose(line.direction, [10 / np.hypot(10, 1), 1 / np.hypot(10, 1)], atol=1e-9)
    assert np.allclose(line.centre + line.extent[:, None] * line.direction, [[0, 0], [100, 10]], atol=1e-9)
    assert line.miss < 1e-9 and abs(line.sagitta) < 1e-9


@pytest.mark.parametrize(('bend', 'joined'), [(0.8, True), (6.0, False)])
def test_what_the_other_eye_sees_as_one_is_one_if_it_is_nearly_straight(bend, joined):
    left = segments(((50 + bend, 0), (50, 40)), ((50, 42), (50 + bend, 90)))
    right = segments(((20, 0), (20, 90)))
    matches, left, right = join_matched(matched((0, 0), (1, 0), disparity=[[30, 30, 30]] * 2), left, right)
    assert len(left) == (1 if joined else 2)
    assert len(matches) == len(left) and len(right) == 1
    if joined:
        assert left.length[0] == pytest.approx(90, abs=0.1)


def test_parts_that_match_elsewhere_too_stay_apart():
    left = segments(((50, 0), (50, 40)), ((50, 42), (50, 90)))
    right = segments(((20, 0), (20, 90)), ((10, 42), (10, 90)))
    matches, left, right = join_matched(matched((0, 0), (1, 0), (1, 1), disparity=[[30, 30, 30]] * 3), left, right)
    assert len(left) == 2 and len(matches) == 3


def broken_edge(right_shift: float = 0.0):
    """A flat edge broken at other places in the two images, between posts of disparity 40 and 50 at its ends."""
    left = segments(((100, 20), (100, 98)), ((300, 20), (300, 98)), ((105, 100), (190, 100)), ((200, 100), (294, 100)))
    right = segments(
        ((60, 20), (60, 98)),
        ((250, 20), (250, 98)),
        ((64 + right_shift, 100), (120 + right_shift, 100)),
        ((128 + right_shift, 100), (245 + right_shift, 100)),
    )
    matches = matched((0, 0), (1, 1), disparity=[[40] * 3, [50] * 3])
    coefficient, covariance = np.array([[40.0, 0], [50.0, 0]]), np.array([np.diag([1e-3, 1e-7])] * 2)
    return broken_edges.complete(matches, left, right, coefficient, covariance)


def test_a_broken_flat_edge_runs_between_the_posts_that_tell_its_ends():
    (edge,) = broken_edge()
    assert set(edge.members) == {2, 3} and edge.fixed.all()
    ends = edge.line.centre + edge.extent[:, None] * edge.line.direction
    assert np.allclose(ends, [[100, 100], [300, 100]], atol=1e-6)
    assert np.allclose(edge.coefficient[0] + edge.coefficient[1] * edge.extent, [40, 50], atol=1e-6)


def test_a_line_that_the_right_image_has_elsewhere_is_no_edge_between_them():
    assert broken_edge(right_shift=30.0) == []


@pytest.mark.parametrize('seed', [1, 4, 7])
def test_long_edges_of_a_printed_box_along_the_rows_are_found(synthetic, seed):
    box = synthetic.printed_box(seed)
    rig = StereoRig.symmetric(PinholeCamera.centred(512, 448, 640.0), 0.06)
    left, right = synthetic.render_pair(box.shape, rig, seed=seed, background=120.0)
    found = recover(left, right, rig).features.of_kind(FeatureKind.EDGE)
    flat = [SimpleNamespace(a=a, b=b) for a, b in box.edges if abs((b - a)[0]) > 0.9 * np.linalg.norm(b - a)]
    hit = 0
    for edge in flat:
        length = np.linalg.norm(edge.b - edge.a)
        line = (edge.b - edge.a) / length
        places = [
            np.sort((np.stack([s, e]) - edge.a) @ line)
            for s, e in zip(found.start, found.end)
            if np.linalg.norm(np.cross(np.stack([s, e]) - edge.a, line), axis=1).max() < 4e-3
        ]
        samples = np.linspace(0, length, 100)
        hit += np.mean([any(p[0] <= x <= p[1] for p in places) for x in samples]) > 0.5
    assert len(flat) == 3 and hit >= 2


def test_print_that_reaches_an_edge_tells_its_depth_where_an_end_has_no_corner():
    # Disparity 40 + 0.05 (u - 100) along the row 100; strokes of print end near it; a post at the left end only, and
    # one stroke that something else explains.
    strokes = [(u, 40.0 + 0.05 * (u - 100)) for u in (100, 140, 180, 250)] + [(220, 30.0)]
    left = segments(*(((u, 40), (u, 97)) for u, _ in strokes), ((105, 100), (300, 100)))
    right = segments(*(((u - d, 40), (u - d, 97)) for u, d in strokes), ((65, 100), (250, 100)))
    matches = matched(*((k, k) for k in range(5)), disparity=[[d] * 3 for _, d in strokes])
    coefficient = np.array([[d, 0.0] for _, d in strokes])
    (edge,) = broken_edges.complete(matches, left, right, coefficient, np.array([np.diag([1e-3, 1e-7])] * 5))
    assert list(edge.fixed) == [True, False]
    ends = edge.line.centre + edge.extent[:, None] * edge.line.direction
    assert np.allclose(ends, [[100, 100], [300, 100]], atol=1e-6)
    assert np.allclose(edge.coefficient[0] + edge.coefficient[1] * edge.extent, [40, 50], atol=1e-6)


def chains(*polylines):
    """Edgels of chains with one edgel a row through these (column, row) points, and one segment for each chain."""
    parts = [
        np.column_stack([np.interp(v, *np.array(line, float).T[::-1]), v])
        for line in polylines
        for v in [np.arange(line[0][1], line[-1][1] + 1.0)]
    ]
    n, last = sum(map(len, parts)), np.cumsum([len(part) for part in parts])
    edgels = Edgels(
        np.concatenate(parts),
        np.zeros(n),
        np.full(n, 9.0),
        np.full(n, 0.05),
        np.full(n, 0.1),
        np.ones(n),
        np.zeros(n),
        np.full(n, 10.0),
    )
    bounds = np.column_stack([np.append(0, last[:-1]), last])
    return edgels, fit_segments(edgels, bounds, np.arange(len(parts)), 0.8)


def test_a_line_that_the_other_eye_sees_bent_is_two_edges_each_with_its_own_line():
    edgels, left = chains([(200, 100), (201, 160), (204, 220)])
    far, right = chains([(150, 100), (140, 157)], [(141, 164), (160, 220)])
    disparity = [[50, 55.5, 61], [70, 57, 44]]
    pairs, left, right = split_matched(matched((0, 0), (0, 1), disparity=disparity), left, right, (edgels, far), 0.8)
    assert pairs.left.tolist() == [0, 1] and pairs.right.tolist() == [0, 1] and len(right) == 2
    assert left.end[0, 1] == pytest.approx(160, abs=2) and left.start[1, 1] == pytest.approx(160, abs=2)
    np.testing.assert_allclose(left.direction[:, 0] / left.direction[:, 1], [1 / 60, 3 / 60], atol=0.002)
    # What the match says at the ends is what it said at these places.
    np.testing.assert_allclose(pairs.disparity[[0, 1], [0, 2]], [50, 44], atol=0.2)


def test_a_line_is_not_cut_where_the_other_image_shows_no_corner():
    edgels, left = chains([(200, 100), (200, 220)])
    far, right = chains([(150, 100), (150, 150)], [(160, 180), (160, 220)])
    pairs = matched((0, 0), (0, 1), disparity=[[50, 50, 50], [40, 40, 40]])
    assert len(split_matched(pairs, left, right, (edgels, far), 0.8)[1]) == 1
