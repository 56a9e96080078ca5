"""What is near is found in cells: all of it, in rising order."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from stereo_recovery.detection.buckets import bucketed, in_cell, near, swept

places = st.tuples(st.floats(-50.0, 300.0), st.floats(-50.0, 300.0))


def distances(start: np.ndarray, end: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(n,) of a place from segments."""
    run = end - start
    share = ((place - start) * run).sum(axis=1) / np.maximum((run**2).sum(axis=1), 1e-12)
    return np.linalg.norm(start + np.clip(share, 0.0, 1.0)[:, None] * run - place, axis=1)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(places, places), min_size=1, max_size=12), places, st.floats(1.0, 30.0))
def test_a_cell_has_all_segments_within_the_width(ends, place, width):
    start, end = np.array(ends).transpose(1, 0, 2)
    found = in_cell(swept(np.ascontiguousarray(start), np.ascontiguousarray(end), width, 16.0), *place)
    assert np.all(np.diff(found) > 0)
    assert set(np.flatnonzero(distances(start, end, np.array(place)) < width - 1e-9)) <= set(found)


def test_a_cell_has_few_of_many_segments():
    start = np.random.default_rng(2).uniform(0.0, 4000.0, (4000, 2))
    cells = swept(start, start + 30.0, 8.0, 16.0)
    assert len(in_cell(cells, 2000.0, 2000.0)) < 40


@settings(max_examples=60, deadline=None)
@given(st.lists(places, min_size=1, max_size=20), places, st.floats(1.0, 30.0))
def test_near_has_all_points_within_the_side_of_a_cell(points, place, size):
    found = near(bucketed(np.array(points), size), *place)
    assert np.all(np.diff(found) > 0)
    close = np.flatnonzero(np.linalg.norm(np.array(points) - place, axis=1) < size - 1e-9)
    assert set(close) <= set(found)
