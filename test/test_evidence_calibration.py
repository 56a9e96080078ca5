"""What calibrate_evidence fits: what it is given back where that is known, and nothing where nothing tells."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent / 'benchmarks'))
import calibrate_evidence
import evidence_of_features
import reliability
from evidence_of_features import Searched
from evidence_of_images import BETA_BOUNDS, IN_USE, NAMES, Best, _ends, _scale, _share, _surface_shares, fitted
from reliability import RATES, Stated

RIGHT_FACES = [(18, 20), (15, 20)]


def search(pair: int, right: bool, nats: float, faces=(), curves=(), ends=(0.0, 0.0)) -> Best:
    """A search that features tell about, and the outline half as much."""
    return Best('real', f'pair{pair}', 'part', right, nats, 0.5 * nats, list(faces), True, list(curves), ends)


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


def test_the_share_of_ends_past_which_edges_go_on_is_given_back():
    rng = np.random.default_rng(4)
    share = rng.beta(0.5, 4.0, 4000)
    right = [search(k, True, 9.0, ends=(float(rng.binomial(12, one)), 12.0)) for k, one in enumerate(share)]
    np.testing.assert_allclose(_ends(right, True), [0.5, 4.0], rtol=0.15)
    assert np.isnan(_ends(right, False)).all() and np.isnan(_ends([search(0, True, 9.0)], True)).all()
    # Of absent parts the best count, with the most evidence.
    absent = [search(k, False, float(k), ends=(8.0 * (k >= 90), 8.0)) for k in range(100)]
    a, b = _ends(absent, False)
    assert a > 20.0 * b
    # A share that is the same for all is told as nearly so.
    assert max(_ends([search(k, True, 9.0, ends=(1.0, 4.0)) for k in range(9)], True)) <= 1.01 * np.exp(BETA_BOUNDS[1])


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
    told = list(calibrate_evidence.numbers(some, fitted, NAMES, IN_USE).items())
    assert [name for name, _ in told] == list(NAMES)
    assert all(one['low'] <= one['high'] for _, one in told[:3])
    assert all(np.isnan(one['low']) for _, one in told[3:])
    few = calibrate_evidence.numbers(some[:3], fitted, NAMES, IN_USE)
    assert all(np.isnan(one['high']) for one in few.values())


def in_scenes(count: int, least: float, tail: float, alike: float) -> list[Searched]:
    """Searches for what is absent whose best evidence is as FALSE_ALARMS has it."""
    rng = np.random.default_rng(2)
    hypotheses = np.exp(rng.uniform(1.0, 12.0, count))
    nats = least + tail * (np.log(hypotheses + alike) + rng.exponential(1.0, count))
    return [Searched('some', f'{k}', 0.0, *values, True) for k, values in enumerate(zip(hypotheses, nats))]


def test_the_tail_of_chance_is_given_back():
    true = np.array([-10.0, 2.1, 300.0])
    found = in_scenes(8000, *true)
    fit = evidence_of_features._tail(found)
    for numbers in (true, fit):
        assert reliability.within(reliability.figures([one.stated(numbers) for one in found])['some']) == []
    needed = [least + tail * np.log((np.array([50.0, 1e4]) + alike) / 0.001) for least, tail, alike in (true, fit)]
    assert needed[1] == pytest.approx(needed[0], abs=2.5), 'one in a thousand of eight thousand tells so much'


def test_what_is_found_of_a_view_and_about_it_is_given_back():
    rng = np.random.default_rng(3)
    found = []
    for k in range(4000):
        there = k % 2 == 0
        thinned = rng.random() < 0.5
        seen = rng.binomial(12, (0.5 if thinned else 0.7) if there else 0.2)
        hidden = rng.binomial(8, (0.5 if thinned else 0.05) if there else 0.2)
        density, crowded = rng.uniform(0.0, 1.0), rng.random() < 0.1
        met = rng.poisson(0.4 * density + 0.05 * 6 + 0.05 + (2.5 if crowded or not there else 0.0))
        view = [20, int(seen + hidden), 12, int(seen), 8, int(hidden)]
        found.append(Searched('some', f'{k}', float(there), 5.0, 5.0, True, view, [6.0, float(met), density]))
    assert evidence_of_features._view(found) == pytest.approx([0.2, 0.5, 0.7, 0.05], abs=0.05)
    assert evidence_of_features._about(found) == pytest.approx([2.5, 0.05, 0.4, 0.1], rel=0.5)


def test_figures_count_false_alarms_and_refusals_of_every_kind():
    some = [Stated('a', 0.0, 0.05), Stated('a', 0.0, 1.0), Stated('a', 0.75, 0.02), Stated('a', 0.75, 1e-6)]
    rows = reliability.figures([*some, Stated('b', 0.0, 1.0)])
    assert rows['a']['0.1'] == 500.0 and rows['a']['0.03'] == 0.0 and rows['all']['absent'] == 3
    assert rows['a']['0.75 refused at 0.01'] == 0.5 and rows['a']['0.75 refused at 0.1'] == 0.0
    assert '0.75 there' not in rows['b']
    text = reliability.lines(rows)
    assert len(text) == 1 + 3 + 2 and '2 there, 75 % in view' in text[4]


def test_a_rate_is_off_only_where_the_searches_tell():
    many_more = [Stated('a', 0.0, 0.01)] * 30 + [Stated('a', 0.0, 1.0)] * 70
    row = reliability.figures(many_more)['a']
    assert reliability.within(row) == ['0.1 (0.3)', '0.03 (0.3)', '0.01 (0.3)']
    assert reliability.within(reliability.figures(many_more[29:32])['a']) == []
    low, high = reliability.bounds(5, 100)
    assert low < 0.05 < high and reliability.bounds(0, 9)[0] == 0.0 and reliability.bounds(9, 9)[1] == 1.0


def test_the_diagram_shows_what_is_true_inside_its_band():
    """Chances that are true run along the diagonal, in the band; four times too many, beyond it."""
    true = [Stated('true', 0.0, float(chance)) for chance in np.linspace(1e-4, 1.0, 4000)]
    image = reliability.drawing(true, 'true')
    assert image.shape[2] == 3 and len(RATES) == 6
    many_more = reliability.drawing([Stated('true', 0.0, one.chance / 4.0) for one in true], 'more')
    column = slice(200, 220)
    dark = [np.flatnonzero((some[60:500, column] < 60).all(axis=2).any(axis=1)).mean() for some in (image, many_more)]
    assert dark[1] < dark[0], 'more are observed than stated'
