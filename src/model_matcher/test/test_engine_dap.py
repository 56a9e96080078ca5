"""The tree search on the array machine: the native tables, orders and interpretations, and its cost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dap_emulator import Dap
from model_matcher import MatchParams, match
from model_matcher.interpretation_tree.engine_dap import DapTables, sort_pairs, tree_search
from model_matcher.interpretation_tree.ordering import order_pairs
from model_matcher.interpretation_tree.tables import all_pairs, build_tables
from model_matcher.interpretation_tree.tree import tree_search as native_search
from model_matcher.model.index import indexed
from model_matcher.params import ORDERINGS
from msgs_py import FeatureSet, Pose


def block_with_a_step() -> FeatureSet:
    """An L-shaped bar: 18 edges."""
    outline = np.array([[0, 0], [0.06, 0], [0.06, 0.02], [0.025, 0.02], [0.025, 0.05], [0, 0.05]])
    low, high = np.column_stack([outline, np.zeros(6)]), np.column_stack([outline, np.full(6, 0.03)])
    start = np.concatenate([low, high, low])
    end = np.concatenate([np.roll(low, -1, 0), np.roll(high, -1, 0), high])
    return FeatureSet.from_edges(start, end)


MODEL = block_with_a_step()
POSE = Pose(np.array([[0.0, -0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, 0.6]]), (0.01, -0.02, 0.3))


def seen(indices, noise=0.0, seed=0, flip=True, clutter=0):
    """Some of the model's edges in the camera frame, some reversed, some cut short, with clutter."""
    rng = np.random.default_rng(seed)
    moved = MODEL.transformed(POSE).select(np.asarray(indices))
    start, end = moved.start.copy(), moved.end.copy()
    turn = rng.random(len(start)) < (0.5 if flip else 0.0)
    start[turn], end[turn] = end[turn], start[turn].copy()
    start, end = start + rng.normal(0, noise, start.shape), end + rng.normal(0, noise, end.shape)
    extra = rng.random((clutter, 2, 3)) * 0.05 + [0.0, 0.0, 0.28]
    return FeatureSet.from_edges(
        np.concatenate([start, extra[:, 0]]),
        np.concatenate([end, extra[:, 1]]),
        err_par=max(3 * noise, 1e-5),
        err_per=max(3 * noise, 1e-5),
    )


@pytest.mark.parametrize(
    'constraints',
    [
        ('distance', 'angle', 'direction1', 'direction2', 'direction3'),
        ('angle',),
        ('distance', 'direction3'),
        ('direction1', 'direction2'),
    ],
)
@pytest.mark.parametrize('signs', [True, False])
def test_tables_are_the_native_ones(constraints, signs):
    params = MatchParams(search='tree', constraints=constraints, signs=signs)
    index, data = indexed(MODEL, 'bar'), seen([0, 3, 5, 7, 11, 13], noise=1e-4)
    native = build_tables(index, data, params)
    ours = DapTables(Dap.model('510'), index, data, params)
    assert np.array_equal(ours.tables.code, native.code) and np.array_equal(ours.sums, native.sums)


@given(st.integers(2, 12), st.sampled_from(ORDERINGS), st.integers(0, 2**32 - 1), st.integers(1, 20))
@settings(max_examples=25, deadline=None)
def test_sorts_are_the_native_ones_ties_included(features, ordering, seed, most):
    pairs = all_pairs(features)
    sums = np.random.default_rng(seed).integers(0, most, len(pairs))
    assert np.array_equal(sort_pairs(Dap.model('510'), pairs, sums, ordering), order_pairs(pairs, sums, ordering))


@pytest.mark.parametrize(
    'changes',
    [{}, {'signs': False}, {'ordering': 'holder_buxton'}, {'max_bin': 0}, {'ordering': 'consistency_grouped'}],
    ids=str,
)
@pytest.mark.parametrize('clutter', [0, 2])
def test_interpretations_are_the_native_ones(changes, clutter):
    params = MatchParams(search='tree', **changes)
    index, data = indexed(MODEL, 'bar'), seen([1, 4, 8, 10, 12, 14, 16], noise=5e-5, seed=3, clutter=clutter)
    native = native_search(build_tables(index, data, params), params)
    ours = tree_search(index, data, params)
    assert np.array_equal(ours.assignments, native.assignments)
    assert np.array_equal(ours.signs, native.signs)
    for counter in ('levels', 'sign_cutoffs', 'unassigned_pairs'):
        assert ours.stats[counter] == native.stats[counter], counter


def test_match_finds_the_pose_and_says_what_the_machine_would_take():
    data = seen([1, 4, 8, 10, 12, 14, 16], noise=5e-5, seed=5)
    native = match(MODEL, data, MatchParams(search='tree'))
    ours = match(MODEL, data, MatchParams(search='tree', engine='dap'))
    assert np.array_equal(ours.best.assignment, native.best.assignment)
    assert np.allclose(ours.best.pose.matrix, native.best.pose.matrix)
    assert 0.01 < ours.stats['dap_seconds'] < 1.0


def test_a_model_too_large_for_the_store_is_refused_with_the_number_of_planes():
    with pytest.raises(ValueError, match='bit-planes'):
        tree_search(
            indexed(MODEL, 'bar'),
            seen(range(12)),
            MatchParams(search='tree'),
            dap=Dap.model('510', memory_bits_per_pe=2000),
        )


@pytest.mark.parametrize(('misplaced', 'max_bin'), [((2,), 1), ((0, 4), 2), ((1, 3), 3)])
@pytest.mark.parametrize('signs', [True, False])
def test_misplaced_edges_go_to_the_bin_as_they_do_natively(misplaced, max_bin, signs):
    """Edges that agree with some of the others but not with all: the search itself must leave them out."""
    params = MatchParams(search='tree', max_bin=max_bin, signs=signs)
    index, right = indexed(MODEL, 'bar'), seen([1, 4, 8, 10, 12, 14], noise=5e-5, seed=4)
    shift = np.zeros((len(right), 3))
    shift[list(misplaced)] = POSE.rotate([[0.004, 0.0, 0.008]])
    data = FeatureSet.from_edges(right.start + shift, right.end + shift, err_par=2e-4, err_per=2e-4)
    native, ours = native_search(build_tables(index, data, params), params), tree_search(index, data, params)
    assert len(native.assignments) and (native.assignments < 0).any()
    assert np.array_equal(ours.assignments, native.assignments) and np.array_equal(ours.signs, native.signs)
    for counter in ('levels', 'sign_cutoffs', 'unassigned_pairs'):
        assert ours.stats[counter] == native.stats[counter], counter


def test_a_single_edge_may_be_every_edge_of_its_kind_and_none_agrees_with_another_model():
    params = MatchParams(search='tree', max_bin=1)
    index, data = indexed(MODEL, 'bar'), seen([3, 9], noise=5e-5)
    far = FeatureSet.from_edges(
        data.start + [[0, 0, 0], [0, 0, 5.0]], data.end + [[0, 0, 0], [0, 0, 5.0]], err_par=1e-4, err_per=1e-4
    )
    for some in (far, seen([3])):
        native, ours = native_search(build_tables(index, some, params), params), tree_search(index, some, params)
        assert np.array_equal(ours.assignments, native.assignments)
