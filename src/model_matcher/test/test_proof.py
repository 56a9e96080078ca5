"""The certificate agrees with trying everything, and costs milliseconds at the thesis' sizes."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model_matcher import MatchParams, index_model, match
from model_matcher.proof import prove, prove_tables
from model_matcher.synthetic import MODELS, make_scene
from model_matcher.tables import Tables, all_pairs


def agrees(tables, assignment):
    """Whether every two matched data features are consistent, and each may be where it is."""
    used = [k for k, j in enumerate(assignment) if j >= 0]
    return (all(tables.unary[k, assignment[k]] for k in used)
            and all(tables.code[tables.number(a, b), assignment[a], assignment[b]]
                    for a, b in itertools.combinations(used, 2)))


def largest_by_trying(tables):
    n, e = tables.unary.shape
    return max(sum(j >= 0 for j in chosen) for chosen in itertools.product(range(-1, e), repeat=n)
               if agrees(tables, chosen))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 3), st.sampled_from([0.3, 0.5, 0.7, 0.9]))
def test_it_is_proven_exactly_when_nothing_larger_exists(seed, n, e, density):
    rng = np.random.default_rng(seed)
    pairs = all_pairs(n)
    unary = rng.random((n, e)) < 0.9
    code = (rng.random((len(pairs), e, e)) < density).astype(np.uint8)
    code *= (unary[pairs[:, 0], :, None] & unary[pairs[:, 1], None, :]).astype(np.uint8)
    tables = Tables(pairs, code, unary)
    largest = largest_by_trying(tables)
    for matched in range(n + 1):
        proof = prove_tables(tables, matched)
        assert proof.proven == (matched >= largest)
        if not proof.proven:
            assert agrees(tables, proof.assignment) and (proof.assignment >= 0).sum() > matched
            assert proof.reason


@pytest.mark.parametrize('name', ['l_shape', 'wedge'])
def test_the_true_interpretation_of_ideal_data_is_proven_largest(name):
    model = MODELS[name]()
    proof = prove(index_model(model, name), model, len(model), MatchParams())
    assert proof.proven and proof.reason is None


def test_a_tree_that_is_too_large_is_given_up_with_a_reason():
    n, e = 8, 4
    pairs = all_pairs(n)
    code = np.ones((len(pairs), e, e), np.uint8)
    code[0] = 0
    proof = prove_tables(Tables(pairs, code, np.ones((n, e), bool)), n - 2, most_nodes=2)
    assert not proof.proven and 'nodes' in proof.reason


def test_less_than_the_truth_is_never_proven():
    scene = make_scene(MODELS['l_shape'](), 4, clutter=0.3, sigma=1e-6, stated=1e-5)
    index = index_model(MODELS['l_shape'](), 'l_shape')
    true = int((scene.assignment >= 0).sum())
    assert not prove(index, scene.data, true - 2, MatchParams()).proven


def test_match_says_that_it_is_proven_or_why_not():
    model = MODELS['wedge']()
    result = match(model, make_scene(model, 0, clutter=0.3).data, MatchParams(prove=True))
    assert result.best.proven == ('unproven' not in result.stats)
    assert match(model, model, MatchParams(prove=True)).best.proven
    assert not match(model, model).best.proven
