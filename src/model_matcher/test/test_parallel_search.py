"""Parallel features make poses: side by side, about one axis, or alone on a solid of revolution."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from csg_renderer import Solid, model_features, parse_scene
from model_matcher import MatchParams, index_model, match
from model_matcher.closed_form.synthetic.scenes import measured, random_pose
from model_matcher.geometry.parallel_pairs import parallel_pairs
from model_matcher.geometry.settings import UNIFORM_ANGLE
from model_matcher.model.index import ModelIndex
from model_matcher.model.problem import make_problem
from model_matcher.model.symmetry import axis_of_revolution, common_axis, equal_but_for_turn, symmetries
from model_matcher.search.pair_search import Candidates
from model_matcher.search.parallel_search import search_all_parallel
from msgs_py import FeatureKind, FeatureSet, Pose
from msgs_py.numeric.deadline import Deadline


def cylinder(radius: float, length: float, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solid:
    """A cylinder along z from (x, y, z), metres."""
    text = f'UNITS M; c = CYLINDER ({radius}, 0, 0, {length}) AT ({x}, {y}, {z}); DRAW c;'
    return parse_scene(text).solids[0]


def part(name: str) -> ModelIndex:
    """Solids whose features are parallel, or mostly."""
    if name == 'can':
        solid = cylinder(0.026, 0.104)
    elif name == 'stepped':
        solid = cylinder(0.03, 0.02) | cylinder(0.012, 0.05)
    elif name == 'flange':
        solid = cylinder(0.05, 0.012) | cylinder(0.026, 0.036)
        for x, y in ((0.038, 0.0), (-0.019, 0.033)):
            solid = solid - cylinder(0.0055, 0.06, x, y, -0.02)
    else:
        solid = Solid.block(0.05, 0.04, 0.03) - cylinder(0.01, 0.06, 0.02, 0.015, -0.01)
    return index_model(model_features(solid), name)


INDEXES = {name: part(name) for name in ('can', 'stepped', 'flange', 'drilled')}
ANY = MatchParams(min_matched=1, false_alarm_rate=1.0)


def poses_of(index: ModelIndex, data: FeatureSet, edges: bool) -> list[Pose]:
    problem = make_problem(index, data, ANY)
    candidates = Candidates(np.zeros((500, 12)), np.zeros(500))
    search_all_parallel(problem, edges, candidates, Deadline())
    return [
        Pose(row[:9].reshape(3, 3), row[9:]) for row, score in zip(candidates.motions, candidates.scores) if score > 0.0
    ]


def is_true(index: ModelIndex, used: np.ndarray, pose: Pose, truth: Pose) -> bool:
    """Whether a pose is the true one, but for a turn that the features used leave free."""
    axis = common_axis(index.rows[used], index.size)
    if axis is not None:
        return equal_but_for_turn(pose, truth, axis, index.size)
    error = pose.error_to(truth)
    return error.rotation_deg < 1e-3 and error.translation < 1e-6


KINDS = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]


def members(name, kinds):
    """(n, 2) the parallel pairs of two kinds that a model has."""
    table = INDEXES[name].parallel_pairs
    return table.members[table.starts[3 * kinds[0] + kinds[1]] : table.starts[3 * kinds[0] + kinds[1] + 1]]


HAD = [(name, kinds) for name in INDEXES for kinds in KINDS if len(members(name, kinds))]


def test_every_two_kinds_are_parallel_in_some_model():
    assert {kinds for _, kinds in HAD} == set(KINDS)


@pytest.mark.parametrize(('name', 'kinds'), HAD)
def test_every_parallel_pair_of_every_two_kinds_makes_the_true_pose(name, kinds):
    """The rims, axes and edges of a solid, exactly known, two at a time."""
    index = INDEXES[name]
    rng = np.random.default_rng([len(name), *kinds])
    for i, j in members(name, kinds)[:24]:
        truth = random_pose(rng)
        used = np.array([i, j])
        data = index.features.select(used).transformed(truth)
        found = poses_of(index, data, kinds == (0, 0))
        assert any(is_true(index, used, pose, truth) for pose in found), (i, j)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31), name=st.sampled_from(sorted(INDEXES)), reverse=st.booleans())
def test_a_pose_is_found_whichever_way_round_the_data_runs(seed, name, reverse):
    index, rng = INDEXES[name], np.random.default_rng(seed)
    truth = random_pose(rng)
    table = index.parallel_pairs
    curved = np.flatnonzero((index.kind[table.members] != FeatureKind.EDGE).any(axis=1))
    used = table.members[rng.choice(curved)]
    data = index.features.select(used).transformed(truth)
    if reverse:
        vectors = np.where((data.kind == FeatureKind.CURVE)[:, None], -data.vectors, 0.0)
        swap = data.kind != FeatureKind.CURVE
        start = np.where(swap[:, None], data.end, data.start)
        end = np.where(swap[:, None], data.start, data.start + vectors)
        data = FeatureSet(data.kind, start, end, data.radii, data.err_par, data.err_per)
    assert any(is_true(index, used, pose, truth) for pose in poses_of(index, data, False))


@pytest.mark.parametrize('name', ['can', 'stepped'])
def test_one_rim_fixes_a_solid_of_revolution_but_for_its_turn(name):
    index, rng = INDEXES[name], np.random.default_rng(3)
    assert axis_of_revolution(index) is not None
    for i in np.flatnonzero(index.kind == FeatureKind.CURVE):
        truth = random_pose(rng)
        found = poses_of(index, index.features.select([i]).transformed(truth), False)
        assert any(is_true(index, np.array([i]), pose, truth) for pose in found)


def test_one_rim_of_a_part_with_holes_makes_no_pose():
    index = INDEXES['flange']
    assert poses_of(index, index.features.select([0]), False) == []


@pytest.mark.parametrize('seed', range(5))
def test_of_edges_no_pose_is_lost_by_asking_for_whole_ones_first(seed, monkeypatch):
    index, rng = INDEXES['drilled'], np.random.default_rng(seed)
    seen = index.features.select(np.flatnonzero(index.features.kind == FeatureKind.EDGE))
    cut = rng.choice([0.0, 0.4], (len(seen), 1)) * (seen.end - seen.start)
    data = measured(FeatureSet.from_edges(seen.start + cut, seen.end), random_pose(rng), rng, visible=1.0)
    whole = poses_of(index, data, True)
    monkeypatch.setattr(
        'model_matcher.search.parallel_search.seen_whole',
        lambda data, model: np.ones((len(data.kind), len(model.kind)), bool),
    )
    every = poses_of(index, data, True)
    assert len(whole) == len(every) > 0
    assert all(np.array_equal(a.matrix, b.matrix) for a, b in zip(whole, every))


def test_the_table_has_all_ordered_parallel_pairs_by_kind_and_distance():
    index = INDEXES['drilled']
    table = index.parallel_pairs
    directions = index.rows[:, 3:6]
    count = (np.abs(directions @ directions.T) > 0.999).sum() - len(index)
    assert len(table.members) == table.starts[-1] == count
    both = 3 * index.kind[table.members[:, 0]].astype(int) + index.kind[table.members[:, 1]]
    assert (np.diff(both) >= 0).all()
    assert all((np.diff(table.apart[a:b]) >= 0.0).all() for a, b in zip(table.starts, table.starts[1:]))
    assert len(parallel_pairs(index.rows[:1], index.kind[:1]).members) == 0


@pytest.mark.parametrize('search', ['hypotheses', 'tree', 'subgraph', 'serial'])
@pytest.mark.parametrize('name', ['can', 'stepped'])
def test_a_solid_of_revolution_has_its_turn_free(name, search):
    """Found with the axis that is free, and the variance of a uniform angle about it and about nothing else."""
    index = INDEXES[name]
    for seed in range(3):
        truth = random_pose(np.random.default_rng(seed))
        best = match(index, index.features.transformed(truth), MatchParams(search=search, false_alarm_rate=1.0)).best
        along = truth.rotation[:, 2]
        assert best is not None and abs(best.free_turn @ along) > 1.0 - 1e-9
        assert 'same all round' in best.note
        turn = best.covariance[3:, 3:]
        assert along @ turn @ along == pytest.approx(UNIFORM_ANGLE**2, rel=1e-3)
        assert np.trace(turn) == pytest.approx(UNIFORM_ANGLE**2, rel=1e-2)
        axis = axis_of_revolution(index)
        assert any(equal_but_for_turn(pose, truth, axis, index.size) for pose in (best.pose, *best.symmetric_poses))
        assert len(best.symmetric_poses) == len(symmetries(index)) == (name == 'can')


def test_a_turn_that_hidden_holes_would_tell_is_free_and_one_that_a_hole_tells_is_not():
    index = INDEXES['flange']
    about = np.flatnonzero(np.linalg.norm(index.rows[:, :2], axis=1) < 1e-9)
    hole = np.flatnonzero((index.rows[:, 0] > 0.03) & (index.kind == FeatureKind.CURVE))[:1]
    truth = random_pose(np.random.default_rng(5))
    hidden, seen = (
        match(index, index.features.select(used).transformed(truth), MatchParams(false_alarm_rate=1.0)).best
        for used in (about, np.concatenate([about, hole]))
    )
    assert abs(hidden.free_turn @ truth.rotation[:, 2]) > 1.0 - 1e-9 and 'does not tell' in hidden.note
    assert seen.free_turn is None and seen.note is None
    assert any(pose.error_to(truth).rotation_deg < 1e-3 for pose in (seen.pose, *seen.symmetric_poses))


def test_the_covariance_of_what_is_not_free_is_that_of_the_errors():
    """Five of six directions of a can: chi squared of five degrees of freedom."""
    index = INDEXES['can']
    axis = axis_of_revolution(index)
    deviations = []
    for seed in range(150):
        rng = np.random.default_rng([seed, 7])
        truth = random_pose(rng, 0.03)
        data = measured(index.features, truth, rng, visible=1.0)
        best = match(index, data, MatchParams(false_alarm_rate=1.0)).best
        pose = min((best.pose, *best.symmetric_poses), key=lambda pose: -pose.rotation[:, 2] @ truth.rotation[:, 2])
        # Turned about the axis until it is nearest to the truth.
        middle = axis.point
        turn = truth.rotation.T @ pose.rotation
        angle = np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
        pose = pose.compose(Pose.from_rotation_vector([0.0, 0.0, -angle], np.zeros(3)))
        error = Pose(pose.rotation @ truth.rotation.T).rotation_vector
        off = np.concatenate([pose.apply(middle[None])[0] - truth.apply(middle[None])[0], error])
        # The covariance of the axis' middle, from that of the model's origin.
        lever = best.pose.rotate(middle[None])[0]
        cross = np.array([[0, lever[2], -lever[1]], [-lever[2], 0, lever[0]], [lever[1], -lever[0], 0]])
        carry = np.block([[np.eye(3), cross], [np.zeros((3, 3)), np.eye(3)]])
        deviations.append(off @ np.linalg.solve(carry @ best.covariance @ carry.T, off))
    assert np.mean(deviations) == pytest.approx(5.0, rel=0.2)
