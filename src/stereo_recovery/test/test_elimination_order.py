"""Orders of elimination: of trees no block is filled in, of others as few as with scipy's least degree."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from stereo_recovery.estimation.elimination_order import least_degree
from stereo_recovery.estimation.sparse_kernels import pattern


def blocks_below(place, e, f):
    """How many blocks the factor of a matrix with links e - f has below its diagonal."""
    return len(pattern(len(place), np.minimum(place[e], place[f]), np.maximum(place[e], place[f])).row)


def order_of_scipy(count, e, f):
    node = np.arange(count)
    rows, columns = np.concatenate([node, e, f]), np.concatenate([node, f, e])
    graph = csc_matrix((np.where(rows == columns, 4.0 * len(rows), 1.0), (rows, columns)), (count, count))
    options = {'SymmetricMode': True}
    return splu(graph, permc_spec='MMD_AT_PLUS_A', diag_pivot_thresh=0.0, options=options).perm_c.astype(np.int64)


@settings(deadline=None)
@given(st.integers(1, 40), st.randoms(use_true_random=False))
def test_nothing_of_a_tree_is_filled_in(count, random):
    parent = np.array([random.randrange(k) for k in range(1, count)], np.int64)
    child = np.arange(1, count)
    place = least_degree(count, child, parent)
    assert sorted(place) == list(range(count))
    assert blocks_below(place, child, parent) == count - 1


@settings(deadline=None)
@given(st.integers(2, 30), st.integers(0, 200), st.randoms(use_true_random=False))
def test_every_node_has_a_place_of_its_own(count, links, random):
    pairs = np.array([random.sample(range(count), 2) for _ in range(links)], np.int64).reshape(-1, 2)
    place = least_degree(count, *np.ascontiguousarray(pairs.T))
    assert sorted(place) == list(range(count))


@pytest.mark.parametrize(('count', 'links'), [(300, 400), (300, 1500), (2000, 10_000)])
def test_as_little_is_filled_in_as_with_scipy(count, links):
    random = np.random.default_rng(count + links)
    points = random.uniform(size=(count, 2))
    e = random.integers(count, size=links)
    f = cKDTree(points).query(points[e], k=8)[1][np.arange(links), random.integers(1, 8, size=links)]
    ours, theirs = least_degree(count, e, f), order_of_scipy(count, e, f)
    assert blocks_below(ours, e, f) < 1.1 * blocks_below(theirs, e, f)


def test_links_that_are_there_twice_count_once():
    e, f = np.array([0, 1, 0, 3, 1, 0]), np.array([1, 2, 1, 0, 0, 3])
    assert blocks_below(least_degree(4, e, f), e, f) == 3
