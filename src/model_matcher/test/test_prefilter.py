"""A large library is thinned out before the search without losing the models that are there."""

import numpy as np
import pytest

from model_matcher import MatchParams, index_model, recognise
from model_matcher.closed_form.synthetic.scenes import l_shape, make_scene, random_polyhedron
from model_matcher.search.prefilter import prefilter
from msgs_py import FeatureSet

PARAMS = MatchParams()


@pytest.fixture(scope='module')
def shelf():
    return [index_model(random_polyhedron(k), f'm{k}') for k in range(60)]


@pytest.mark.parametrize(('clutter', 'visible'), [(0.0, 0.75), (0.5, 0.75), (0.5, 0.5), (0.8, 0.75)])
def test_a_model_that_is_there_is_kept(shelf, clutter, visible):
    # With fewer than six edges in view a model cannot be told from its like, by no search.
    tried = lost = 0
    for seed in range(40):
        which = (7 * seed) % len(shelf)
        scene = make_scene(shelf[which].features, seed, clutter=clutter, visible=visible)
        if len(np.unique(scene.assignment[scene.instance == 0])) < 6:
            continue
        tried += 1
        lost += which not in prefilter(shelf, scene.data, PARAMS)
    assert tried >= 25
    assert lost == 0


def test_most_models_of_a_library_are_spared_the_search(shelf):
    scene = make_scene(shelf[5].features, 1, clutter=0.6)
    assert len(prefilter(shelf, scene.data, PARAMS)) <= 12


def test_without_data_nothing_is_left_out(shelf):
    assert prefilter(shelf, FeatureSet.empty(), PARAMS) == list(range(len(shelf)))


def test_parallel_and_pointlike_data_is_no_problem(shelf):
    same = FeatureSet.from_edges(np.zeros((5, 3)), np.tile([[0.1, 0.0, 0.0]], (5, 1)))
    assert prefilter(shelf, same, PARAMS) == []
    points = FeatureSet.from_edges(np.zeros((5, 3)), np.zeros((5, 3)))
    assert prefilter(shelf, points, PARAMS) == list(range(len(shelf)))


def test_the_same_scene_gives_the_same_models_in_the_same_order(shelf):
    scene = make_scene(l_shape(), 2, clutter=0.5)
    first = prefilter(shelf, scene.data, PARAMS)
    assert all(prefilter(shelf, scene.data, PARAMS) == first for _ in range(3))


def test_recognise_finds_the_model_of_a_large_library(shelf):
    for which in (5, 23, 48):
        scene = make_scene(shelf[which].features, which, clutter=0.5)
        assert shelf[which].name in [one.model for one in recognise(shelf, scene.data)]
