"""Closed forms of the numerical helpers, and steps that run beside."""

import threading

import numpy as np
import pytest
from scipy import stats

from msgs_py.numeric import spatial
from msgs_py.numeric.covariances import (
    along_and_across,
    as_covariances,
    from_upper_triangles,
    known_covariances,
    pair_variances,
    semidefinite,
    upper_triangles,
)
from msgs_py.numeric.robust import outlying, sigma_from_median
from msgs_py.numeric.spatial import any_within, pairs_within, rotations
from msgs_py.numeric.steps import CompileStep, Preparation, run_all


def test_sigma_of_normal_noise():
    noise = np.random.default_rng(1).normal(0.0, 3.0, 200_000)
    assert sigma_from_median(float(np.median(np.abs(noise)))) == pytest.approx(3.0, rel=0.01)


def test_what_is_outlying_is_the_quantile_of_chi_squared():
    rare = 2.0 * stats.norm.sf(3.0)
    for freedom in range(1, 40):
        assert outlying(freedom) == pytest.approx(stats.chi2.isf(rare, freedom), rel=1e-12)


def test_what_is_near_is_the_same_where_a_tree_finds_it(monkeypatch):
    random = np.random.default_rng(0)
    some, others = random.uniform(size=(80, 3)), random.uniform(size=(60, 3)) + [0.9, 0.0, 0.0]
    few = pairs_within(some, 0.2), [any_within(some, others, d) for d in (0.01, 0.05, 0.1, 0.5)]
    monkeypatch.setattr(spatial, 'MOST_COMPARED', 0)
    many = pairs_within(some, 0.2), [any_within(some, others, d) for d in (0.01, 0.05, 0.1, 0.5)]
    assert len(few[0]) > 20
    assert {*map(tuple, few[0].tolist())} == {*map(tuple, np.sort(many[0], axis=1).tolist())}
    assert few[1] == many[1]
    assert few[1] == [bool(np.linalg.norm(some[:, None] - others, axis=2).min() < d) for d in (0.01, 0.05, 0.1, 0.5)]
    assert few[1][0] < few[1][-1]
    assert not any_within(some, others[:0], 1.0)


def test_turns_are_those_of_scipy():
    np.testing.assert_allclose(rotations().from_rotvec([0, 0, np.pi / 2]).apply([1.0, 0.0, 0.0]), [0, 1, 0], atol=1e-12)


class TestCovariances:
    def test_none_is_of_any_form_where_there_are_no_features(self):
        assert as_covariances('covariance', [], 0).shape == (0, 6, 6)
        for value, n in (([], 1), (np.zeros((1, 6, 6)), 0), (np.zeros((2, 6, 6)), 1)):
            with pytest.raises(ValueError, match=rf'covariance: expected shape \({n}, 6, 6\)'):
                as_covariances('covariance', value, n)
        with pytest.raises(ValueError, match='covariance: not an array of numbers'):
            as_covariances('covariance', 'text', 1)

    def test_the_first_that_is_none_is_named(self):
        good, unknown = np.eye(6), np.full((6, 6), np.nan)
        skew, partly, negative = np.eye(6), np.eye(6), np.diag([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
        skew[0, 1] = 0.5
        partly[2, 2] = np.nan
        for bad, text in (
            (skew, 'not symmetric'),
            (partly, 'expected 36 finite numbers, or NaN throughout'),
            (negative, 'not positive semidefinite'),
        ):
            with pytest.raises(ValueError, match=f'covariance: feature 2: {text}'):
                as_covariances('covariance', [good, unknown, bad, good, bad], 5)
        assert known_covariances(as_covariances('c', [good, unknown, good], 3)).tolist() == [True, False, True]

    def test_metres_and_radians_count_alike(self):
        """Of 1e-6 m and 1e3 rad a correlation of one in a thousand is none, of one half it is."""
        sigma = np.array([1e-6, 1e-6, 1e-6, 1e3, 1e3, 1e3])
        for share, symmetric in ((1e-12, True), (0.5, False)):
            matrix = np.eye(6)
            matrix[0, 4] = share
            matrix *= sigma[:, None] * sigma
            if symmetric:
                found = as_covariances('c', matrix[None], 1)
                np.testing.assert_array_equal(found, found.swapaxes(1, 2))
            else:
                with pytest.raises(ValueError, match='not symmetric'):
                    as_covariances('c', matrix[None], 1)

    def test_variances_along_and_across_are_those_of_points(self):
        rng = np.random.default_rng(4)
        mix = rng.normal(size=(5, 3, 3))
        covariance, direction = mix @ mix.swapaxes(1, 2), rng.normal(size=(5, 3))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        along, across = along_and_across(covariance, direction)
        for k in range(5):
            assert along[k] == pytest.approx(direction[k] @ covariance[k] @ direction[k])
            flat = np.eye(3) - np.outer(direction[k], direction[k])
            assert across[k] == pytest.approx(np.linalg.eigvalsh(flat @ covariance[k] @ flat)[-1])

    def test_both_ends_of_a_pair_have_their_own(self):
        covariance = np.diag([4.0, 9.0, 1.0, 16.0, 25.0, 36.0])[None]
        along, across = pair_variances(np.zeros((1, 3)), np.array([[0.0, 2.0, 0.0]]), covariance)
        assert along.tolist() == [[9.0, 25.0]] and across.tolist() == [[4.0, 36.0]]
        along, across = pair_variances(np.zeros((1, 3)), np.zeros((1, 3)), covariance)  # no direction
        assert along.tolist() == [[0.0, 0.0]] and across.shape == (1, 2)

    def test_what_is_kept_of_them(self):
        mix = np.random.default_rng(5).normal(size=(2, 6, 6))
        covariance = mix @ mix.swapaxes(1, 2)
        kept = upper_triangles(covariance)
        assert kept.shape == (2, 21) and kept[0, :7].tolist() == [*covariance[0, 0], covariance[0, 1, 1]]
        np.testing.assert_array_equal(from_upper_triangles(kept), (covariance + covariance.swapaxes(1, 2)) / 2)

    def test_what_rounding_made_negative_is_zero(self):
        mix = np.random.default_rng(6).normal(size=(6, 3))
        singular = (mix @ mix.T)[None]
        np.testing.assert_allclose(semidefinite(singular), singular, atol=1e-12)
        vectors = np.linalg.qr(np.random.default_rng(7).normal(size=(6, 6)))[0]
        broken = (vectors * np.array([1.0, 1.0, 1.0, 1.0, 1.0, -0.5])) @ vectors.T
        mended = semidefinite(broken[None])[0]
        np.testing.assert_allclose(mended, mended.T, atol=1e-15)
        assert np.linalg.eigvalsh(mended)[0] > -1e-12
        thin = np.zeros((1, 6, 6))  # known without any error, and one matrix beside it that has to be mended
        np.testing.assert_array_equal(semidefinite(np.concatenate([thin, broken[None]]))[0], thin[0])
        # Nothing is taken from the directions in which it was one.
        assert (np.linalg.eigvalsh(mended - broken) > -1e-12).all()


class TestSteps:
    def test_all_run_in_their_order(self):
        done = []
        run_all([CompileStep(str(k), lambda k=k: done.append(k)) for k in range(3)])
        assert done == [0, 1, 2]

    def test_who_waits_is_told_how_far_it_is_and_when_it_ends(self):
        go, there, ended = threading.Event(), threading.Event(), threading.Event()

        def held():
            there.set()
            assert go.wait(10)

        def broken():
            raise ValueError('no compiler')

        steps = [CompileStep('edges', broken), CompileStep('curves', held), CompileStep('lines', lambda: None)]
        preparation = Preparation(steps, ended.set)
        assert not preparation.running and not preparation.done and preparation.progress == '1 of 3: edges'
        preparation.start()
        assert there.wait(10)
        assert preparation.running and not preparation.done and preparation.progress == '2 of 3: curves'
        assert not preparation.wait(0.0)
        go.set()
        assert preparation.wait(10) and ended.wait(10) and preparation.done
        assert preparation.progress == '' and preparation.errors == ['edges: ValueError: no compiler']

    def test_cancelled_it_begins_no_other_step_and_says_nothing(self):
        go, there = threading.Event(), threading.Event()
        done = []

        def held():
            there.set()
            assert go.wait(10)
            done.append('first')

        for last in (False, True):
            steps = [CompileStep('first', held), *([] if last else [CompileStep('second', lambda: done.append('two'))])]
            preparation = Preparation(steps, lambda: done.append('end'))
            preparation.start()
            assert there.wait(10)
            preparation.cancel()
            go.set()
            preparation._thread.join(10)
            assert not preparation.running and done == ['first'] and preparation.done == last
            go.clear(), there.clear(), done.clear()

    def test_nothing_to_do_is_done_at_once(self):
        ended = threading.Event()
        preparation = Preparation([], ended.set)
        assert preparation.progress == ''
        preparation.start()
        assert ended.wait(10) and preparation.wait(10)
