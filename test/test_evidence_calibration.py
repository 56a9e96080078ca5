"""What calibrate_evidence fits: what it is given back where that is known, and nothing where nothing tells."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent / 'benchmarks'))
from calibrate_evidence import NAMES, Best, _scale, _share, _surface_shares, fitted, intervals, report

RIGHT_FACES = [(18, 20), (15, 20)]


def search(pair: int, right: bool, nats: float, faces=(), curves=()) -> Best:
    """A search that features tell about, and the outline half as much."""
    return Best('real', f'pair{pair}', 'part', right, nats, 0.5 * nats, list(faces), True, list(curves))


def many(count: int = 400) -> list[Best]:
    """Absent parts whose evidence is exponential with a mean of 2 and 1 nats, right ones that have far more."""
    rng = np.random.default_rng(0)
    absent = [search(k % 20, False, float(nats)) for k, nats in enumerate(rng.exponential(2.0, count))]
    return absent + [search(k, True, 60.0) for k in range(20)]


def test_evidence_is_scaled_so_that_t_nats_are_reached_in_exp_minus_t_of_the_searches():
    rng = np.random.default_rng(1)
    for mean in (0.5, 3.0):
        assert _scale(rng.exponential(mean, 20000)) * mean == pytest.approx(1.0, rel=0.05)
    counts = fitted(many())[:3]
    of_absent = np.array([[one.features, one.outline, 0.0] for one in many() if not one.right]) @ counts
    assert (of_absent > -np.log(0.03)).mean() == pytest.approx(0.03, abs=0.015)


def test_a_share_is_that_of_the_curves_which_are_more_likely_on_edges():
    clear = [(False, 0.0, -50.0)] * 3 + [(False, -50.0, 0.0)] * 7 + [(True, 0.0, -50.0)]
    found = [search(0, False, 1.0, curves=clear), search(0, True, 1.0, curves=[(False, 0.0, -50.0)] * 90)]
    assert _share(found, False) == pytest.approx(0.3, abs=1e-3), 'those of right ones do not count'
    assert _share(found, True) == pytest.approx(0.9, abs=1e-3), 'as much as may be'


def test_what_no_search_tells_is_not_a_number():
    alone = [search(0, True, 9.0)]
    assert np.isnan(fitted(alone)).all() and np.isnan(fitted([])).all()
    assert np.isnan(_share(many(30), True)) and np.isnan(_surface_shares(many(30))).all()
    without_surface = fitted(many())
    assert np.isfinite(without_surface[:3]).all() and np.isnan(without_surface[3:]).all()
    own_alone = _surface_shares([search(0, True, 9.0, RIGHT_FACES)])
    assert np.isfinite(own_alone[:2]).all() and np.isnan(own_alone[2:]).all()


def test_intervals_of_a_few_pairs_are_those_of_what_they_tell(monkeypatch):
    monkeypatch.setattr('calibrate_evidence.BOOTSTRAPS', 4)
    some = many(60)
    low, high = intervals(some, np.random.default_rng(0))
    assert (low[:3] <= high[:3]).all() and np.isnan(low[3:]).all() and len(low) == len(NAMES)
    for few in (some[:3], []):
        assert np.isnan(intervals(few, np.random.default_rng(0))).all()


def test_a_report_counts_false_alarms_and_refusals():
    found = [search(0, False, 5.0), search(0, False, 1.0), search(1, True, 4.0), search(1, True, 1.0)]
    lines = report(found, np.array([1.0, 0.0, 0.0]), 'some')
    assert lines[0] == 'some: 2 right, 2 absent'
    assert '0.010:  4.6 nats, 500.0 false alarms in 1000 searches, 1.000 of the right ones refused' in lines[2]
    assert report([], np.ones(3), 'none')[0] == 'none: 0 right, 0 absent'
