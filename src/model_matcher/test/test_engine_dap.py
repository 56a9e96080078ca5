"""The tree search on the array machine: the native tables, orders and interpretations, and its cost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dap_emulator import Dap
from model_matcher import MatchParams, index_model, match
from model_matcher.closed_form.synthetic.scenes import MODELS, random_pose
from model_matcher.interpretation_tree.absolute_pose import validate
from model_matcher.interpretation_tree.array_elimination import alive_for
from model_matcher.interpretation_tree.array_sorts import sort_pairs
from model_matcher.interpretation_tree.array_tables import ArrayTables, Phase
from model_matcher.interpretation_tree.array_traversal import ArrayTraversal
from model_matcher.interpretation_tree.array_validation import Limits as ValidationLimits
from model_matcher.interpretation_tree.array_validation import validate_on_array
from model_matcher.interpretation_tree.cores import core_numbers, largest_core
from model_matcher.interpretation_tree.engine_dap import tree_search
from model_matcher.interpretation_tree.ordering import order_pairs
from model_matcher.interpretation_tree.tables import all_pairs, build_tables
from model_matcher.interpretation_tree.tree import UNASSIGNED, Limits
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
    'changes',
    [
        {},
        {'constraints': ('angle',)},
        {'constraints': ('distance', 'direction3')},
        {'constraints': ('direction1', 'direction2')},
        {'search': 'subgraph', 'quadrant': 9},
    ],
    ids=str,
)
@pytest.mark.parametrize('signs', [True, False])
@pytest.mark.parametrize('ranges', ['exact', 'corners'])
def test_tables_are_the_native_ones(changes, signs, ranges):
    """The machine makes all ranges itself."""
    params = MatchParams(**{'search': 'tree', **changes}, signs=signs, ranges=ranges)
    index, data = indexed(MODEL, 'bar'), seen([0, 3, 5, 7, 11, 13], noise=1e-4)
    native = build_tables(index, data, params)
    ours = ArrayTables(Dap.model('510'), index, data, params)
    assert np.array_equal(ours.on_host().code, native.code) and np.array_equal(ours.sums, native.sums)
    assert np.array_equal(ours.unary, native.unary)


@pytest.mark.parametrize('ranges', ['exact', 'corners'])
def test_tables_of_curves_and_axes_are_the_native_ones(ranges):
    model = MODELS['cylinder_box']()
    index = index_model(model)
    data = model.transformed(POSE).select(np.arange(0, len(model), 2))
    params = MatchParams(search='tree', ranges=ranges)
    ours, native = ArrayTables(Dap.model('510'), index, data, params), build_tables(index, data, params)
    assert np.array_equal(ours.on_host().code, native.code)


def test_in_short_words_the_tables_lose_no_pair_and_cost_less():
    """REAL*4 rounds more, so that its bounds are wider."""
    index, data = indexed(MODEL, 'bar'), seen([0, 3, 5, 7, 11, 13], noise=1e-4)
    params = MatchParams(search='tree')
    machines = [Dap.model('510') for _ in range(2)]
    long, short = (
        ArrayTables(machine, index, data, params.replace(real_bytes=length)).on_host().match
        for machine, length in zip(machines, (8, 4))
    )
    assert (short | ~long).all() and (short & ~long).sum() < 0.02 * long.sum()
    assert machines[1].cycles < 0.6 * machines[0].cycles


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


@pytest.mark.compiled
@pytest.mark.parametrize(
    ('clutter', 'quadrant', 'eliminate'), [(0, 5, True), (0, 9, False), (1, 32, False), (2, 32, True), (1, 9, True)]
)
def test_subgraph_matching_runs_on_the_machine(clutter, quadrant, eliminate):
    """Thesis 5.8: by quadrants of the tables, in the native order, with the native interpretations."""
    params = MatchParams(search='subgraph', quadrant=quadrant, eliminate=eliminate)
    index, data = indexed(MODEL, 'bar'), seen([1, 4, 8, 10, 12, 14, 16], noise=5e-5, seed=3, clutter=clutter)
    native, ours = native_search(build_tables(index, data, params), params), tree_search(index, data, params)
    assert len(native.assignments) and np.array_equal(ours.assignments, native.assignments)
    assert np.array_equal(ours.signs, native.signs)
    for counter in ('levels', 'sign_cutoffs', 'unassigned_pairs'):
        assert ours.stats[counter] == native.stats[counter], counter


def test_a_quadrant_is_entered_only_when_the_four_tests_pass():
    """Thesis 5.8: a quadrant without matches, or beside an assigned model edge, is passed over by one array test."""
    params = MatchParams(search='subgraph', quadrant=5, max_bin=0)
    index, data = indexed(MODEL, 'bar'), seen([1, 4, 8, 10, 12, 14, 16], noise=5e-5, seed=3)
    tables = ArrayTables(Dap.model('510'), index, data, params)
    rows = np.arange(len(tables.pairs))
    limits = Limits(0, 1, 1000, True, False)
    search = ArrayTraversal(tables, tables.unary, tables.pairs, rows, limits, np.inf)
    counts = np.array([0 if plane is None else plane.values.sum() for plane in tables.match[0]])
    columns, sides = (np.array([getattr(part, side) for part in tables.parts]) for side in ('columns', 'rows'))
    for fixed in ((UNASSIGNED, UNASSIGNED), (7, UNASSIGNED), (UNASSIGNED, 12), (3, 16)):
        wanted = counts > 0
        for label, places in zip(fixed, (columns, sides)):
            if label != UNASSIGNED:
                wanted &= (places[:, 0] <= label) & (label < places[:, 1])
        assert np.array_equal(search._quadrants(0, fixed).values, wanted)


def test_the_algorithm_as_printed_leaves_nothing_out_beforehand_and_every_phase_is_charged():
    data = seen([1, 4, 8, 10, 12, 14, 16], noise=5e-5, seed=5)
    index = indexed(MODEL, 'bar')
    printed = tree_search(index, data, MatchParams(search='tree', eliminate=False, max_bin=0))
    aided = tree_search(index, data, MatchParams(search='tree', max_bin=0))
    phases = printed.stats['dap_phases']
    assert set(phases) == {'set_up', 'model_ranges', 'data_ranges', 'tables', 'sort', 'traversal', 'signs'}
    assert sum(phases.values()) == pytest.approx(printed.stats['dap_seconds'])
    assert aided.stats['dap_phases']['elimination'] > 0.0
    assert np.array_equal(printed.assignments, aided.assignments) and printed.stats['levels'] > aided.stats['levels']


@pytest.mark.parametrize('clutter', [0, 1])
def test_without_elimination_the_interpretations_are_the_native_ones(clutter):
    params = MatchParams(search='tree', eliminate=False, max_bin=1)
    index, data = indexed(MODEL, 'bar'), seen([1, 4, 8, 10, 12, 14, 16], noise=5e-5, seed=6, clutter=clutter)
    native, ours = native_search(build_tables(index, data, params), params), tree_search(index, data, params)
    assert len(native.assignments) and np.array_equal(ours.assignments, native.assignments)
    assert ours.stats['levels'] == native.stats['levels']


@given(st.integers(0, 2**32 - 1), st.integers(2, 9))
@settings(max_examples=10, deadline=None)
def test_what_the_machine_eliminates_is_what_core_numbers_say(seed, size):
    index = indexed(MODEL, 'bar')
    data = seen([1, 4, 8, 10, 12, 14], noise=5e-5, seed=seed, clutter=3)
    params = MatchParams(search='tree')
    core = core_numbers(build_tables(index, data, params))
    expected = core >= size if size <= largest_core(core) else np.zeros_like(core, bool)
    assert np.array_equal(alive_for(ArrayTables(Dap.model('510'), index, data, params), size), expected)


def test_match_finds_the_pose_and_says_what_the_machine_would_take():
    data = seen([1, 4, 8, 10, 12, 14, 16], noise=5e-5, seed=5)
    native = match(MODEL, data, MatchParams(search='tree'))
    ours = match(MODEL, data, MatchParams(search='tree', engine='dap'))
    assert np.array_equal(ours.best.assignment, native.best.assignment)
    assert np.allclose(ours.best.pose.matrix, native.best.pose.matrix)
    phases = ours.stats['dap_phases']
    assert sum(phases.values()) == pytest.approx(ours.stats['dap_seconds'])
    assert {'tables', 'elimination', 'traversal', 'rotation', 'jacobi', 'test'} <= set(phases)


def interpretations_of(name, count, seed=0):
    """Ideal data of a model, its true interpretation, and interpretations that are wrong in one pairing."""
    rng = np.random.default_rng(seed)
    model = MODELS[name]()
    index = index_model(model)
    pose = random_pose(rng)
    data = model.transformed(pose)
    assignments = np.tile(np.arange(len(model)), (count, 1))
    for k in range(1, count):
        assignments[k, rng.integers(len(model))] = rng.integers(len(model))
    return index, data, assignments, np.ones(assignments.shape, np.int8), pose


@pytest.mark.parametrize('name', ['chair', 'cylinder_box'])
@pytest.mark.parametrize('scale_free', [False, True])
def test_validation_of_many_interpretations_at_once_is_the_native_one(name, scale_free):
    """Poses, deviations and verdicts: bins, unknown signs and more than 64 interpretations included."""
    index, data, assignments, signs, pose = interpretations_of(name, 70)
    assignments[:, 2] = -1
    signs[:, 4] = 0
    native = validate(index.features, data, assignments, signs, 0.01, 0.1, index.size, scale_free)
    limits = ValidationLimits(0.01 * index.size, 0.1 * index.max_radius, scale_free)
    ours = validate_on_array(Dap.model('510'), index, data, assignments, signs, limits, 8)
    assert ours.determined.all() and np.array_equal(ours.signs, native.signs)
    error = ours.poses[0].error_to(pose)
    assert error.rotation_deg < 1e-6 and error.translation < 1e-9 and abs(ours.poses[0].scale - 1.0) < 1e-9
    assert ours.passed[0].all() and np.array_equal(ours.passed.all(axis=1), native.valid)
    assert np.isnan(ours.deviations[:, 2]).all() and ours.deviations[0, 3] < 1e-9


def test_many_interpretations_cost_little_more_than_one_and_parallel_edges_are_singular():
    """Thesis 5.9: 64 transformations at once; 5.11.4.2: a singular elimination."""
    index, data, assignments, signs, _ = interpretations_of('l_shape', 8)
    limits = ValidationLimits(0.01 * index.size, 0.0)
    seconds = []
    for count in (1, 8):
        dap = Dap.model('510')
        validate_on_array(dap, index, data, np.repeat(assignments[1:2], count, 0), signs[:count], limits, 4)
        lines = dap.stats().lines
        seconds.append(sum(spent for line, (_, spent) in lines.items() if line != Phase.VALIDATION_SET_UP))
    assert seconds[1] == seconds[0]  # 32 rows and 18 columns of PEs are one block, as 4 and 18 are
    along = np.abs(index.rows[:, 3:6] @ index.rows[0, 3:6]) > 0.999
    assignments[0, ~along] = -1
    found = validate_on_array(Dap.model('510'), index, data, assignments[:2], signs[:2], limits, 8)
    assert not found.determined[0] and found.determined[1]
    parallel = data.select(along)
    native, ours = (match(index, parallel, MatchParams(search='tree', engine=engine)) for engine in ('native', 'dap'))
    assert ours.stats['free_shift'] == pytest.approx(native.stats['free_shift'])


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
