"""Look-up tables, entry by entry: each is what the ranges of its two pairs say, and what is asked for."""

import numpy as np
import pytest

from model_matcher import MatchParams, index_model
from model_matcher.closed_form.synthetic.scenes import MODELS, random_pose
from model_matcher.geometry.constraints import (
    A_MINUS,
    A_PLUS,
    ANY_SIGN,
    B_MINUS,
    B_PLUS,
    DIFFERENT,
    SAME,
    consistent_signs,
    corner_ranges,
    entry,
    pair_ranges,
)
from model_matcher.interpretation_tree.cores import core_numbers, largest_core
from model_matcher.interpretation_tree.ordering import order_pairs
from model_matcher.interpretation_tree.settings import LARGEST_TABLES, RATES
from model_matcher.interpretation_tree.signs import apply_code, relate, set_sign, unknown_signs, write_signs
from model_matcher.interpretation_tree.tables import (
    Tables,
    all_pairs,
    build_tables,
    constraints_used,
    data_ranges,
    model_ranges,
    pair_tests,
    ranges_of_rows,
    unary_table,
)
from model_matcher.model.index import data_tolerances, feature_rows
from model_matcher.params import ORDERINGS
from msgs_py import FeatureKind, FeatureSet

NEAR, FAR = 0.999, 1.001


def some_edges(seed, n=5):
    rng = np.random.default_rng(seed)
    start = rng.uniform(-0.1, 0.1, (n, 3))
    return FeatureSet.from_edges(start, start + rng.normal(size=(n, 3)) * 0.1, 1e-3, 2e-3)


def alone(function, a, b, errors=(0.0, 0.0), cones=(0.0, 0.0)):
    out = np.empty(11)
    function(a, b, *errors, *cones, out)
    return out


@pytest.mark.parametrize(('ranges', 'function'), [('exact', pair_ranges), ('corners', corner_ranges)])
def test_ranges_of_all_pairs_are_those_of_each(ranges, function):
    edges = some_edges(1)
    index, params = index_model(edges), MatchParams(ranges=ranges)
    rows, tolerances = feature_rows(edges), data_tolerances(edges, feature_rows(edges), 0.5, params)
    tolerances[:, 0] *= [1.0, 2.0, 3.0, 4.0, 5.0]
    # An end point is off across and along; the thesis shortens edges by what is across.
    errors = tolerances[:, 0] if ranges == 'corners' else np.hypot(tolerances[:, 0], tolerances[:, 1])
    expected = [
        alone(function, rows[a], rows[b], (errors[a], errors[b]), (tolerances[a, 2], tolerances[b, 2]))
        for a in range(5)
        for b in range(a + 1, 5)
    ]
    np.testing.assert_array_equal(ranges_of_rows(rows, tolerances, ranges == 'corners'), expected)
    np.testing.assert_array_equal(data_ranges(edges, 0.5, params, tolerances), expected)
    by_default = data_tolerances(edges, rows, 0.5, params)
    np.testing.assert_array_equal(
        data_ranges(edges, 0.5, params), ranges_of_rows(rows, by_default, ranges == 'corners')
    )
    of_model = model_ranges(index, ranges == 'corners')
    for i in range(5):
        for j in range(5):
            pair = np.zeros(11) if i == j else alone(function, index.rows[i], index.rows[j])
            np.testing.assert_array_equal(of_model[i, j], pair)


@pytest.mark.parametrize('ranges', ['exact', 'corners'])
@pytest.mark.parametrize('signs', [True, False])
def test_an_entry_is_what_the_constraints_say_of_its_two_pairs(ranges, signs):
    model = MODELS['wedge']()
    edges = model.select([0, 4, 8, 11]).transformed(random_pose(np.random.default_rng(2)))
    index, params = index_model(model), MatchParams(ranges=ranges, signs=signs)
    tables = build_tables(index, edges, params)
    rows = feature_rows(edges)
    tolerances = data_tolerances(edges, rows, index.size, params)
    tests = pair_tests(index, rows, tolerances, params)
    np.testing.assert_array_equal(tests.data, ranges_of_rows(rows, tolerances, ranges == 'corners'))
    np.testing.assert_array_equal(tests.model, model_ranges(index, ranges == 'corners'))
    np.testing.assert_allclose(tests.lengths, index.features.lengths)
    np.testing.assert_allclose(tests.errors, np.hypot(tolerances[:, 0], tolerances[:, 1]))
    inconsistent = 0
    for p, (a, b) in enumerate(all_pairs(4)):
        assert tables.number(a, b) == p and tables.pairs[p].tolist() == [a, b]
        for i in range(15):
            for j in range(15):
                code = 0
                if tables.unary[a, i] and tables.unary[b, j]:
                    slack = tests.errors[a] + tests.errors[b]
                    code = entry(tests.data[p], tests.model[i, j], i == j, tests.lengths[i], slack, tests.use)
                if code and not consistent_signs(code):
                    inconsistent += 1
                    code = 0 if signs else code
                assert tables.code[p, i, j] == code
    np.testing.assert_array_equal(tables.match, tables.code > 0)
    np.testing.assert_array_equal(tables.sums, [(table > 0).sum() for table in tables.code])
    assert 0 < tables.sums.sum() < tables.code.size
    assert inconsistent, 'signs decide here'


def test_an_edge_is_on_one_that_is_as_long_up_to_both_ends_errors():
    model = FeatureSet.from_edges([[0, 0, 0]], [[1, 0, 0]])
    tolerances = np.array([[0.01, 0.05, 0.1]])
    for share, expected in ((NEAR, True), (FAR, False)):
        data = FeatureSet.from_edges([[0, 0, 1]], [[0, share * 1.1, 1]])
        assert unary_table(index_model(model), data, tolerances, MatchParams()).item() is expected
        for told in (MatchParams(scale='free'), MatchParams(constraints=('angle', 'direction1'))):
            assert unary_table(index_model(model), data, tolerances, told).item(), 'where lengths are not compared'


def test_of_a_curve_the_normals_length_does_not_count_and_kinds_are_kept_apart():
    curve, edge = np.array([FeatureKind.CURVE], np.uint8), np.array([FeatureKind.EDGE], np.uint8)
    radii, at = np.full((1, 2), 0.02), np.zeros((1, 3))
    model = FeatureSet(curve, at, at + [0, 0, 0.01], radii, np.zeros(1), np.zeros(1))
    long_normal = FeatureSet(curve, at, at + [0, 0, 5.0], radii, np.zeros(1), np.zeros(1))
    small = np.full((1, 3), 1e-4)
    assert unary_table(index_model(model), long_normal, small, MatchParams()).item()
    other = FeatureSet(edge, at, at + [0, 0, 1e-3], np.full((1, 2), np.nan), np.zeros(1), np.zeros(1))
    assert not unary_table(index_model(model), other, small, MatchParams()).item()


def test_which_constraints_are_tested():
    assert constraints_used(MatchParams()).all()
    assert constraints_used(MatchParams(scale='free')).tolist() == [False, True, True, True, True]
    some = MatchParams(constraints=('direction3', 'distance'))
    assert constraints_used(some).tolist() == [True, False, False, False, True]


def test_tables_too_large_for_memory_or_time_are_refused():
    edges = some_edges(4, 4)
    index, entries = index_model(edges), 6 * 4 * 4
    assert entries < LARGEST_TABLES
    enough = entries / RATES.entries
    assert len(build_tables(index, edges, MatchParams(time_limit_s=FAR * enough)).pairs) == 6
    with pytest.raises(ValueError, match='6 data pairs x 4 x 4 model features are too many'):
        build_tables(index, edges, MatchParams(time_limit_s=NEAR * enough))


# -- the order of pairs ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize('ordering', ORDERINGS)
def test_no_pair_and_one_pair_have_their_order(ordering):
    assert order_pairs(all_pairs(1), np.zeros(0, int), ordering).tolist() == []
    assert order_pairs(all_pairs(2), np.array([7]), ordering).tolist() == [0]
    assert order_pairs(all_pairs(0), np.zeros(0, int), ordering).dtype == np.int64


def test_equal_sums_keep_the_order_of_the_list():
    for ordering in ('worst', 'holder_buxton', 'consistency'):
        found = order_pairs(all_pairs(4), np.full(6, 3), ordering).tolist()
        assert found == ([0, 1, 3, 2, 4, 5] if ordering == 'consistency' else [0, 1, 2, 3, 4, 5])


def test_another_ordering_is_refused_by_name():
    with pytest.raises(ValueError, match="ordering: .*got 'best'"):
        order_pairs(all_pairs(3), np.ones(3, int), 'best')


# -- what entries say of signs -----------------------------------------------------------------------------------------


def signs_after(code, known_a=0, known_b=0, relation=0):
    """Whether an entry agrees with what is known of features 0 and 1, and the signs of both after it."""
    signs = unknown_signs(2)
    assert not relation or relate(0, 1, relation, signs)
    for k, known in enumerate((known_a, known_b)):
        assert not known or set_sign(k, known, signs)
    out = np.empty(2, np.int8)
    agrees = apply_code(code, 0, 1, signs)
    write_signs(signs, np.zeros(2, np.int32), out)
    return agrees, out.tolist()


@pytest.mark.parametrize('a', [1, -1])
@pytest.mark.parametrize('b', [1, -1])
def test_an_entry_with_one_sign_for_each_gives_both(a, b):
    bits = (A_PLUS if a > 0 else A_MINUS) | (B_PLUS if b > 0 else B_MINUS)
    relation = SAME if a == b else DIFFERENT
    assert signs_after(bits | relation) == (True, [a, b])
    assert signs_after(bits | SAME | DIFFERENT) == (True, [a, b])
    assert not signs_after(bits | (SAME | DIFFERENT) & ~relation)[0]
    assert signs_after(bits | relation, a, b)[0]
    assert not signs_after(bits | SAME | DIFFERENT, known_a=-a)[0]
    assert not signs_after(bits | SAME | DIFFERENT, known_b=-b)[0]
    assert not signs_after(bits | SAME | DIFFERENT, relation=-a * b)[0]


@pytest.mark.parametrize(('bit', 'relation'), [(SAME, 1), (DIFFERENT, -1)])
def test_an_entry_that_relates_both_hands_a_sign_on(bit, relation):
    either = ANY_SIGN & ~(SAME | DIFFERENT) | bit
    assert signs_after(either) == (True, [0, 0])
    for sign in (1, -1):
        assert signs_after(either, known_a=sign) == (True, [sign, relation * sign])
        assert signs_after(either, known_b=sign) == (True, [relation * sign, sign])
        assert signs_after(either, known_a=sign, known_b=relation * sign)[0]
        assert not signs_after(either, known_a=sign, known_b=-relation * sign)[0]
    assert signs_after(either, relation=relation)[0] and not signs_after(either, relation=-relation)[0]
    assert signs_after(ANY_SIGN, known_a=1) == (True, [1, 0]), 'what says nothing changes nothing'


# -- core numbers ------------------------------------------------------------------------------------------------------


def tables_of(agreeing, n, e, unary=None):
    """Tables in which these pairings ((a, i), (b, j)) agree and no others."""
    pairs = all_pairs(n)
    unary = np.ones((n, e), bool) if unary is None else unary
    tables = Tables(pairs, np.zeros((len(pairs), e, e), np.uint8), unary, np.zeros(n, bool))
    for (a, i), (b, j) in agreeing:
        tables.code[tables.number(a, b), i, j] = ANY_SIGN
    return tables


def clique(*pairings):
    return [(one, other) for k, one in enumerate(pairings) for other in pairings[k + 1 :]]


def test_core_numbers_of_a_graph_that_can_be_seen_through():
    """Four features agree on (0, 0, 0, 0), three on (1, 1, 1, -); a fifth agrees with one of the four only."""
    agreeing = clique((0, 0), (1, 0), (2, 0), (3, 0)) + clique((0, 1), (1, 1), (2, 1)) + [((3, 0), (4, 1))]
    core = core_numbers(tables_of(agreeing, 5, 2))
    assert core.tolist() == [[4, 3], [4, 3], [4, 3], [4, 1], [1, 2]]
    assert largest_core(core) == 4


def test_a_chain_of_agreement_is_taken_off_from_its_end():
    """0 to 4 in a row: the ends go first, and with them all, from three on."""
    agreeing = [((a, 0), (a + 1, 0)) for a in range(4)]
    assert core_numbers(tables_of(agreeing, 5, 1)).tolist() == [[2]] * 5
    ring = [*agreeing, ((0, 0), (4, 0))]
    assert core_numbers(tables_of(ring, 5, 1)).tolist() == [[3]] * 5


def test_a_feature_counts_once_however_many_pairings_it_has():
    agreeing = [((0, 0), (1, j)) for j in range(3)]
    core = core_numbers(tables_of(agreeing, 2, 3))
    assert core.tolist() == [[2, 1, 1], [2, 2, 2]]


def test_what_single_features_forbid_has_no_core_and_supports_none():
    unary = np.ones((3, 1), bool)
    unary[1] = False
    tables = tables_of(clique((0, 0), (2, 0)), 3, 1, unary)
    assert core_numbers(tables).tolist() == [[2], [0], [2]]
    assert core_numbers(tables_of([], 2, 2, np.zeros((2, 2), bool))).tolist() == [[0, 0], [0, 0]]


def test_the_largest_core_has_as_many_features_as_it_says():
    assert largest_core(np.array([[5], [5], [2]], np.int32)) == 2
    assert largest_core(np.array([[1, 4], [4, 0], [4, 4], [0, 4]], np.int32)) == 4
    assert largest_core(np.zeros((0, 3), np.int32)) == 0 and largest_core(np.zeros((2, 0), np.int32)) == 0
