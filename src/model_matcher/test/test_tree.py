"""The thesis' searches: orderings, signs, bin, quadrants; all find what the hypothesis search finds."""

import numpy as np
import pytest

from model_matcher import MatchParams, index_model, match
from model_matcher.closed_form.synthetic.scenes import MODELS, make_scene, random_pose
from model_matcher.interpretation_tree.cores import _withdraw, core_numbers, largest_core
from model_matcher.interpretation_tree.ordering import order_pairs
from model_matcher.interpretation_tree.serial import serial_search
from model_matcher.interpretation_tree.signs import apply_code, relate, set_sign, unknown_signs
from model_matcher.interpretation_tree.tables import all_pairs, build_tables
from model_matcher.interpretation_tree.tree import subgraph_search, tree_search
from model_matcher.params import ORDERINGS
from msgs_py import FeatureSet
from msgs_py.numeric.deadline import Deadline


def names(pairs, order):
    return [f'{a + 1}-{b + 1}' for a, b in pairs[order]]


def test_orderings_are_those_of_the_thesis():
    """Groups by second feature, each led by its pair of fewest matches; Combined starts with the fewest of all."""
    pairs = all_pairs(5)
    sums = np.array([15, 2, 1, 6, 9, 18, 29, 31, 30, 14])
    assert names(pairs, order_pairs(pairs, sums, 'consistency')) == [
        '1-2',
        '1-3',
        '2-3',
        '1-4',
        '2-4',
        '3-4',
        '1-5',
        '2-5',
        '3-5',
        '4-5',
    ]
    assert names(pairs, order_pairs(pairs, sums, 'consistency_grouped')) == [
        '1-2',
        '1-3',
        '2-3',
        '1-4',
        '2-4',
        '3-4',
        '1-5',
        '2-5',
        '3-5',
        '4-5',
    ]
    assert names(pairs, order_pairs(pairs, sums, 'holder_buxton'))[:3] == ['1-4', '1-3', '1-5']
    assert names(pairs, order_pairs(pairs, sums, 'worst'))[:2] == ['3-4', '3-5']
    assert names(pairs, order_pairs(pairs, sums, 'combined')) == [
        '1-4',
        '1-2',
        '1-3',
        '2-3',
        '2-4',
        '3-4',
        '1-5',
        '2-5',
        '3-5',
        '4-5',
    ]
    for ordering in ORDERINGS:
        assert sorted(order_pairs(pairs, sums, ordering)) == list(range(10))


def states(signs):
    """The thesis' five states, by feature: 'U', '+', '-', '+3' (same sign as feature 3), '-3'."""
    names = []
    for k, (root, parity) in enumerate(zip(signs.root, signs.parity)):
        sign = '+' if parity > 0 else '-'
        if signs.known[root]:
            names.append('+' if signs.known[root] * parity > 0 else '-')
        else:
            names.append('U' if root == k else f'{sign}{root}')
    return names


def test_the_pair_that_leads_a_group_has_the_fewest_matches_of_that_group():
    pairs = np.array([[0, 1], [0, 2], [1, 2], [0, 3], [1, 3], [2, 3]])
    assert order_pairs(pairs, [5, 9, 8, 7, 1, 6], 'consistency_grouped').tolist() == [0, 2, 1, 4, 3, 5]
    assert order_pairs(pairs, [5, 9, 8, 7, 1, 6], 'combined').tolist() == [4, 0, 2, 1, 5, 3]


@pytest.mark.parametrize('removed_first', [0, 1, 2])
def test_what_is_removed_takes_its_support_from_all_others(removed_first):
    """Three data features on one model feature, all consistent: two are no interpretation of three."""
    code, counts = np.ones((3, 1, 1), np.uint8), np.ones((3, 1, 3), np.int32)
    support, removed = np.full((3, 1), 2, np.int32), np.zeros((3, 1), bool)
    removed[removed_first] = True
    stack = np.zeros((3, 2), np.int32)
    others = [b for b in range(3) if b != removed_first]
    assert _withdraw(removed_first, 0, 3, code, counts, support, removed, stack, 0) == 2
    assert stack[:2, 0].tolist() == others and removed.all()
    assert [support[b, 0] for b in others] == [1, 1] and support[removed_first, 0] == 2
    assert [counts[b, 0, removed_first] for b in others] == [0, 0] and counts.sum() == 7


def test_the_five_sign_states():
    signs = unknown_signs(4)
    assert states(signs) == ['U', 'U', 'U', 'U']
    assert relate(0, 1, 1, signs) and relate(1, 2, -1, signs)
    assert states(signs) == ['U', '+0', '-0', 'U']
    assert set_sign(1, -1, signs)
    assert states(signs) == ['-', '-', '+', 'U']
    assert not set_sign(2, -1, signs)
    assert not relate(0, 2, 1, signs)
    assert apply_code(63, 0, 3, signs) and states(signs)[3] == 'U'
    assert apply_code(63 & ~1, 0, 3, signs) and states(signs)[3] == '+'


@pytest.mark.parametrize('ordering', [name for name in ORDERINGS if name != 'worst'])
@pytest.mark.parametrize('signs', [True, False])
def test_every_ordering_finds_the_interpretation_of_ideal_data(ordering, signs):
    model = MODELS['l_shape']()
    data = model.transformed(random_pose(np.random.default_rng(2))).select(np.arange(0, 18, 2))
    tables = build_tables(index_model(model), data, MatchParams(fracdev=1e-4, signs=signs))
    result = tree_search(tables, MatchParams(ordering=ordering, signs=signs, max_bin=0), deadline=Deadline(20.0))
    assert result.complete
    assert any((row == np.arange(0, 18, 2)).all() for row in result.assignments)


def test_signs_cut_off_what_assignments_alone_allow():
    model = MODELS['chair']()
    data = model.transformed(random_pose(np.random.default_rng(0)))
    counts = {}
    for signs in (True, False):
        params = MatchParams(fracdev=1e-4, signs=signs, max_bin=0)
        result = tree_search(build_tables(index_model(model), data, params), params, deadline=Deadline(20.0))
        counts[signs] = len(result.assignments)
        if signs:
            assert (result.signs[0] != 0).all()
    assert 1 <= counts[True] < counts[False]


@pytest.mark.parametrize('spurious', [1, 2])
def test_the_bin_takes_spurious_edges_and_no_others(spurious):
    model = MODELS['chipped_block']()
    rng = np.random.default_rng(spurious)
    seen = model.transformed(random_pose(rng))
    junk = FeatureSet.from_edges(*(rng.uniform(-0.05, 0.05, (spurious, 3)) + [0, 0, 0.35] for _ in range(2)))
    data = FeatureSet.concatenate([junk, seen])
    tables = build_tables(index_model(model), data, MatchParams(fracdev=1e-4))
    for eliminate in (True, False):
        result = tree_search(tables, MatchParams(max_bin=4, eliminate=eliminate), deadline=Deadline(20.0))
        assert (result.assignments[0] == [*[-1] * spurious, *range(15)]).all()
    assert largest_core(core_numbers(tables)) == 15
    assert not len(tree_search(tables, MatchParams(max_bin=spurious - 1)).assignments)


def test_pairs_of_curves_lead_and_every_other_pair_has_an_assigned_feature():
    """Thesis 6.10: curve tables first, as far as consistency allows."""
    pairs = all_pairs(6)
    curves = np.array([False, True, False, True, True, False])
    sums = np.random.default_rng(3).integers(1, 50, len(pairs))
    order = order_pairs(pairs, sums, 'curves_first', curves)
    assert sorted(order) == list(range(len(pairs)))
    both = curves[pairs[order]].sum(axis=1)
    assert (both[:3] == 2).all() and (both[3:] < 2).all()
    met = set(pairs[order[0]].tolist())
    for a, b in pairs[order[1:]]:
        assert a in met or b in met
        met |= {int(a), int(b)}
    assert np.array_equal(order_pairs(pairs, sums, 'curves_first'), order_pairs(pairs, sums, 'consistency_grouped'))


def test_without_elimination_the_bin_search_is_the_thesis_own_and_finds_the_same():
    """Neither pairings nor branches are left out for want of agreement: more levels, one answer."""
    index, data = index_model(MODELS['l_shape'](), 'l_shape'), make_scene(MODELS['l_shape'](), 5, clutter=0.2).data
    aided, printed = (match(index, data, MatchParams(search='tree', eliminate=e)) for e in (True, False))
    assert np.array_equal(aided.best.assignment, printed.best.assignment)
    assert printed.stats['levels'] > aided.stats['levels'] and printed.stats['eliminated'] == 0


def test_ranges_of_corners_prune_more_and_may_prune_a_fragment_that_is_right():
    """The thesis' ranges leave out what lies between end points: the middle of an edge is nearer than either end."""
    model = FeatureSet.from_edges([[0, 0, 0], [0, 0.02, 0]], [[0.1, 0, 0], [0.1, 0.02, 0]])
    crossing = FeatureSet.from_edges([[0, 0, 0], [0.05, -0.05, 0.01]], [[0.1, 0, 0], [0.05, 0.05, 0.01]])
    index = index_model(crossing)
    data = FeatureSet.from_edges([[0.04, 0, 0], [0.05, -0.01, 0.01]], [[0.06, 0, 0], [0.05, 0.01, 0.01]])
    params = MatchParams(fracdev=1e-9, overhang=0.0, signs=False)
    assert build_tables(index, data, params).match[0, 0, 1]
    assert not build_tables(index, data, params.replace(ranges='corners')).match[0, 0, 1]
    whole = index_model(model)
    for ranges in ('exact', 'corners'):
        assert build_tables(whole, model, params.replace(ranges=ranges)).match[0, 0, 1]


@pytest.mark.parametrize('name', ['l_shape', 'wedge', 'cylinder_box', 'chair'])
def test_quadrants_and_the_serial_search_give_the_same_feasible_interpretations(name):
    model = MODELS[name]()
    index = index_model(model)
    data = make_scene(model, 3, sigma=2e-4, clutter=0.1).data
    params = MatchParams(max_bin=6)
    tables = build_tables(index, data, params)
    results = [
        tree_search(tables, params),
        subgraph_search(tables, params.replace(quadrant=4)),
        serial_search(index, data, params),
    ]
    found = [sorted(map(tuple, result.assignments.tolist())) for result in results]
    assert found[0] and found[0] == found[1] == found[2]


@pytest.mark.parametrize('name', ['l_shape', 'chipped_block', 'wedge', 'chair', 'computer', 'lamp', 'tubes'])
@pytest.mark.parametrize('seed', [0, 1])
def test_all_searches_give_one_best_interpretation(name, seed):
    model = MODELS[name]()
    scene = make_scene(model, seed, sigma=2e-4, clutter=0.05)
    bests = {
        search: match(model, scene.data, MatchParams(search=search)).best
        for search in ('hypotheses', 'tree', 'subgraph', 'serial')
    }
    first = bests['hypotheses']
    for search, best in bests.items():
        np.testing.assert_array_equal(best.assignment, first.assignment, err_msg=search)
        np.testing.assert_array_equal(best.sign, first.sign, err_msg=search)
        error = best.pose.error_to(first.pose)
        assert error.rotation < 1e-6 and error.translation < 1e-7, search


@pytest.mark.parametrize('search', ['hypotheses', 'tree', 'subgraph', 'serial'])
def test_parallel_data_gives_its_pose_and_the_shift_that_stays_free(search):
    model = MODELS['chair']()
    truth = random_pose(np.random.default_rng(0))
    along = model.select(np.flatnonzero(np.abs(model.directions[:, 2]) > 0.9)).transformed(truth)
    data = FeatureSet.from_edges(along.start + 0.1 * along.vectors, along.end - 0.15 * along.vectors, 1e-3, 1e-3)
    result = match(model, data, MatchParams(search=search))
    free = np.array(result.stats['free_shift'])
    assert abs(free @ data.directions[0]) > 1.0 - 1e-9 and 'free_turn' not in result.stats
    assert result.best.matched == len(data)
    np.testing.assert_allclose(result.best.free_shift, free)
    gaps = [
        pose.translation - truth.translation
        for pose in (result.best.pose, *result.best.symmetric_poses)
        if pose.error_to(truth).rotation_deg < 1e-3
    ]
    assert any(np.linalg.norm(np.cross(gap, free)) < 1e-6 for gap in gaps)
    variance = free @ result.best.covariance[:3, :3] @ free
    assert variance > (0.5 * np.ptp(model.start, axis=0).max()) ** 2


@pytest.mark.parametrize('search', ['tree', 'subgraph', 'serial'])
@pytest.mark.parametrize('scale', ['known', 'free'])
def test_much_data_gives_a_reason(search, scale):
    rng = np.random.default_rng(0)
    start = rng.uniform(-3.0, 3.0, (20_000, 3))
    data = FeatureSet.from_edges(start, start + 0.03 * rng.normal(size=start.shape), 1e-3, 1e-3)
    result = match(MODELS['wedge'](), data, MatchParams(search=search, scale=scale, time_limit_s=1.0))
    assert not result and 'too many' in result.reason


def test_tables_that_would_not_fit_are_refused_with_a_reason():
    model = MODELS['lattice']()
    result = match(model, model, MatchParams(search='tree'))
    assert not result and 'hypotheses' in result.reason
