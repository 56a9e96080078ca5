"""Groups of linked things: as scipy's connected components, and numbered in order of first members."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from msgs_py.numeric.grouping import linked_groups


def test_what_a_chain_of_pairs_connects_is_one_group():
    np.testing.assert_array_equal(linked_groups(7, [(5, 1), (3, 5), (6, 2)]), [0, 1, 2, 1, 3, 1, 2])


def test_without_pairs_each_is_a_group_of_its_own():
    np.testing.assert_array_equal(linked_groups(3, []), [0, 1, 2])
    assert linked_groups(0, []).shape == (0,)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 60), st.integers(0, 90), st.integers(0, 2**31 - 1))
def test_groups_are_connected_components(count, n_pairs, seed):
    pairs = np.random.default_rng(seed).integers(0, count, (n_pairs, 2))
    graph = coo_matrix((np.ones(n_pairs), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    np.testing.assert_array_equal(linked_groups(count, pairs), connected_components(graph, directed=False)[1])


@pytest.mark.parametrize('order', ['forwards', 'backwards', 'shuffled', 'star'])
def test_a_hundred_thousand_in_one_chain_take_no_time(order):
    n = 100_000
    chain = np.arange(n) if order != 'shuffled' else np.random.default_rng(0).permutation(n)
    pairs = np.column_stack([chain[:-1], chain[1:]])
    if order == 'backwards':
        pairs = pairs[::-1, ::-1]
    if order == 'star':
        pairs = np.column_stack([np.full(n - 1, n - 1), np.arange(n - 1)])
    assert not linked_groups(n, pairs).any()
