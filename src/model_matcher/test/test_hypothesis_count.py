"""How many hypotheses there are: counted one by one for small scenes, and what they must not depend on."""

from __future__ import annotations

import numpy as np
import pytest

from csg_renderer import model_features, parse_scene
from model_matcher import MatchParams, index_model
from model_matcher.closed_form.synthetic.scenes import MODELS, box, make_scene, random_pose
from model_matcher.geometry.pair_pose import matching_pairs, pair_window
from model_matcher.geometry.settings import PARALLEL_SINE
from model_matcher.model.index import ModelIndex
from model_matcher.model.problem import Problem, make_problem
from model_matcher.model.symmetry import distinct_pairs
from model_matcher.verification.false_alarms import needed_evidence
from msgs_py import FeatureSet


def one_by_one(problem: Problem) -> int:
    """Pairs of model edges that each pair of data edges may lie on."""
    data, table = problem.features, distinct_pairs(problem.index)
    found = np.empty(2 * len(table.members), np.int32)
    count = 0
    for a in range(len(data.rows)):
        for b in range(a + 1, len(data.rows)):
            sine = np.linalg.norm(np.cross(data.rows[a, 3:6], data.rows[b, 3:6]))
            if sine >= PARALLEL_SINE:
                count += matching_pairs(data, problem.model, table, a, b, pair_window(data, a, b), found)
    return count


def of(index: ModelIndex, data: FeatureSet) -> Problem:
    return make_problem(index, data, MatchParams())


@pytest.mark.parametrize('name', ['l_shape', 'wedge', 'chipped_block'])
def test_of_one_object_all_pairs_are_counted(name):
    """It is small enough for every pair to be near, and for few of them to be left out of the sample."""
    index = index_model(MODELS[name](), name)
    data = index.features.transformed(random_pose(np.random.default_rng(1)))
    problem = of(index, data)
    counted = problem.hypotheses - len(data)
    assert counted == pytest.approx(one_by_one(problem), rel=0.4)


def test_two_square_edges_lie_on_each_pair_of_a_box_once_for_each_way_round():
    size = np.array([0.1, 0.06, 0.04])
    data = box(size).select([0, int(np.flatnonzero(np.abs(box(size).directions[:, 1]) > 0.9)[0])])
    problem = of(index_model(box(size)), data)
    assert problem.hypotheses == 2 + one_by_one(problem)
    assert 1 <= one_by_one(problem) <= 2 * len(distinct_pairs(problem.index).members)


def test_the_number_hardly_depends_on_the_order_of_the_data():
    index = index_model(MODELS['chair'](), 'chair')
    data = make_scene(index.features, 5, 0.8).data
    rng = np.random.default_rng(0)
    counts = [of(index, data.select(rng.permutation(len(data)))).hypotheses for _ in range(12)]
    assert np.std(np.log(counts)) < 0.35


def test_loose_edges_leave_fewer_than_an_object_does():
    """Equally many of the same lengths, turned at random: the model's angles and distances are rare among them."""
    index = index_model(MODELS['l_shape'](), 'l_shape')
    rng = np.random.default_rng(2)
    data = index.features
    turned = [data.select([k]).transformed(random_pose(rng, 0.02)) for k in range(len(data))]
    loose = of(index, FeatureSet.concatenate(turned))
    together = of(index, data.transformed(random_pose(rng)))
    assert loose.hypotheses < 0.5 * together.hypotheses
    assert needed_evidence(loose, MatchParams()) < needed_evidence(together, MatchParams())


def test_a_can_has_hypotheses_though_all_its_features_are_parallel():
    solid = parse_scene('UNITS M; c = CYLINDER (0.026, 0, 0, 0.104); DRAW c;').solids[0]
    index = index_model(model_features(solid), 'can')
    two = FeatureSet.concatenate(
        [index.features.transformed(random_pose(np.random.default_rng(seed))) for seed in (1, 2)]
    )
    one = of(index, two.select(np.arange(len(index))))
    assert one.hypotheses > len(index)
    assert of(index, two).hypotheses > one.hypotheses


def test_no_data_and_one_edge_leave_none_but_themselves():
    index = index_model(MODELS['wedge'](), 'wedge')
    for count in (0, 1):
        assert of(index, index.features.select(np.arange(count))).hypotheses == count
