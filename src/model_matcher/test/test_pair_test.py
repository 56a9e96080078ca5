"""No pairwise test refuses two pairings that one pose explains: the promise that look-up tables and proof rest on."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from model_matcher import MatchParams, index_model
from model_matcher.closed_form.synthetic.scenes import MODELS, fragment, random_pose
from model_matcher.closed_form.synthetic.strained import strained_scene
from model_matcher.geometry.back_projection import fit_one
from model_matcher.geometry.features import DataFeatures, FeatureRows
from model_matcher.geometry.pair_bounds import margins_of, model_relations, pair_fits, possible, relation
from model_matcher.interpretation_tree.tables import build_tables
from model_matcher.model.index import data_tolerances, feature_rows
from model_matcher.proof.arc_consistency import Nodes, forward_check, no_ranges, pair_test, revise
from model_matcher.proof.feasibility import Sample
from model_matcher.proof.spares import Groups

NAMES = ('chair', 'plug', 'lamp', 'tubes', 'wedge', 'cylinder_box')


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(NAMES), st.floats(-5.0, -2.5), st.floats(-3.0, -1.5))
def test_what_fits_together_under_a_pose_passes_every_pairwise_test(seed, name, log_sigma, log_fracdev):
    rng = np.random.default_rng(seed)
    model = MODELS[name]()
    index, params = index_model(model, name), MatchParams(fracdev=float(10**log_fracdev))
    pose = random_pose(rng)
    data, _, _ = fragment(model.transformed(pose), rng, 0.8, break_chance=0.5, sigma=10**log_sigma)
    passes_every_pairwise_test(rng, index, data, params, pose, 0)


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**31))
def test_what_hardly_fits_together_under_a_pose_passes_every_pairwise_test(seed):
    scene = strained_scene(seed, NAMES)
    rng = np.random.default_rng(seed)
    passes_every_pairwise_test(rng, scene.index, scene.data, scene.params, scene.pose, scene.explained)


def passes_every_pairwise_test(rng, index, data, params, pose, least):
    """least : features of the data that fit one of the model's under the pose, at least."""
    rows = feature_rows(data)
    tols = data_tolerances(data, rows, index.size, params)
    radius_tol = params.curvedev * index.max_radius
    features, lines = DataFeatures(rows, data.kind, tols, radius_tol), FeatureRows(index.rows, index.kind)
    mids, directions = pose.inverse().apply(rows[:, :3]), rows[:, 3:6] @ pose.rotation
    fitting = [
        (a, i)
        for a in range(len(data))
        for i in range(len(index))
        if fit_one(a, features, i, lines, tuple(mids[a]), tuple(directions[a]), 1.0) >= 0.0
    ]
    assert len({a for a, _ in fitting}) >= least
    relations, margins, halves = model_relations(index.rows), margins_of(rows, tols), index.rows[:, 6].copy()
    alone = possible(rows, data.kind, tols, index.rows, index.kind, radius_tol)
    tables = build_tables(index, data, params)
    rel = np.empty((1, 10))
    for a, i in fitting:
        assert alone[a, i] and tables.unary[a, i]
    for p in rng.permutation(len(fitting))[:25]:
        for q in rng.permutation(len(fitting))[:25]:
            (a, i), (b, j) = fitting[p], fitting[q]
            if a == b:
                continue
            relation(rows[a], rows[b], rel[0])
            assert pair_fits(rel, 0, margins, a, b, halves, relations, i, j)
            if a < b:
                assert tables.code[tables.number(a, b), i, j]
    nodes_a, nodes_i = np.array(fitting, dtype=np.int64).reshape(-1, 2).T.copy()
    test, nothing = pair_test(Sample(rows, data.kind, tols, index.rows)), np.zeros(0, np.int64)
    groups = Groups(np.full(len(data), -1), nothing)
    supporters = len(np.unique(nodes_a)) - 1
    possible_now = alone.copy()
    for node, (a, _) in enumerate(fitting):
        others = np.flatnonzero(nodes_a != a)
        own = no_ranges(len(data))
        left = forward_check(node, others, nothing, supporters, Nodes(nodes_a, nodes_i), groups, test, own)
        assert left.tolist() == others.tolist()
    for a in np.unique(nodes_a):
        revise(a, np.delete(np.arange(len(data)), a), test, possible_now, supporters)
        assert possible_now[a, nodes_i[nodes_a == a]].all()
