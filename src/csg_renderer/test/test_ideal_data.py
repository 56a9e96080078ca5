"""Ideal data: what both eyes see, with the truth; and its degradation."""

from __future__ import annotations

import numpy as np
import pytest

import csg_renderer
from csg_renderer import Placement, Scene, Solid, model_features
from csg_renderer.features.ideal_data import Degradation, ideal_data
from msgs_py import BIN, FeatureKind, PinholeCamera, Pose, StereoRig

L_SHAPE = Solid.block(-0.06, 0.02, -0.03) | Solid.block(-0.02, 0.06, -0.03)
DRUM = Solid.cylinder(0.02, (0, 0, 0.05))
RIG = StereoRig.symmetric(PinholeCamera.centred(512, 512, 700.0), 0.06)
L_POSE = Pose.from_rotation_vector([0.5, 0.7, 0.1], [0.03, -0.02, 0.3])
DRUM_POSE = Pose.from_rotation_vector([2.2, 0.0, 0.2], [-0.07, 0.04, 0.35])
SCENE = Scene([Placement('l', L_SHAPE, L_POSE.matrix), Placement('drum', DRUM, DRUM_POSE.matrix)])


def distances_to_model(data, index, solid):
    """Of the data's end points from the lines of their model edges."""
    truth = data.truth(index)
    rows = truth.data_indices
    model = model_features(solid).transformed(truth.pose).select(truth.assignment[rows])
    mine = data.features.select(rows)
    edges = mine.kind != FeatureKind.CURVE
    offset = np.stack([mine.start - model.start, mine.end - model.start])
    along = np.einsum('kni,ni->kn', offset, model.directions)
    across = np.linalg.norm(offset - along[..., None] * model.directions, axis=2)
    return across[:, edges], along[:, edges], model.lengths[edges]


def test_every_feature_lies_on_its_model_feature_under_the_true_pose():
    data = ideal_data(SCENE, RIG)
    assert data.names == ('l', 'drum')
    assert set(data.object_index) == {0, 1}
    for index, solid in enumerate((L_SHAPE, DRUM)):
        across, along, length = distances_to_model(data, index, solid)
        assert across.max() < 1e-12
        assert along.min() > -1e-12
        assert (along <= length + 1e-12).all()


def test_signs_tell_which_way_a_feature_runs():
    data = ideal_data(SCENE, RIG, seed=3)
    truth = data.truth(0)
    rows = truth.data_indices
    model = model_features(L_SHAPE).transformed(truth.pose).select(truth.assignment[rows])
    cosine = np.einsum('ni,ni->n', data.features.directions[rows], model.directions)
    np.testing.assert_allclose(cosine, truth.sign[rows], atol=1e-12)
    assert {-1, 1} == set(truth.sign[rows])
    assert (data.sign[data.features.kind == FeatureKind.CURVE] == 1).all()


def test_the_scenes_camera_is_the_default():
    turned = Scene(SCENE.placements, camera_T_scene=Pose.from_rotation_vector([0, 0, 0.3], [0, 0, 0.1]))
    data = ideal_data(turned, RIG)
    assert data.poses[0].error_to(turned.camera_T_scene.compose(L_POSE)).translation < 1e-12


def test_seed_decides_everything():
    degradation = Degradation(pieces=3, err_par=1e-3, err_per=1e-3, normal_cone=0.1, keep=0.8)
    one, same, other = (ideal_data(SCENE, RIG, degradation=degradation, seed=seed) for seed in (1, 1, 2))
    assert one.features == same.features
    assert one.features != other.features


@pytest.mark.parametrize('seed', range(5))
def test_displacement_stays_inside_the_stated_error(seed):
    degradation = Degradation(pieces=2, err_par=3e-3, err_per=1e-3)
    data = ideal_data(SCENE, RIG, degradation=degradation, seed=seed)
    assert (data.features.err_par == 3e-3).all() and (data.features.err_per == 1e-3).all()
    across, along, length = distances_to_model(data, 0, L_SHAPE)
    assert 0.0 < across.max() <= 1e-3
    assert along.min() >= -3e-3 and (along - length).max() <= 3e-3


def test_fragments_keep_their_model_edge_and_do_not_overlap():
    data = ideal_data(SCENE, RIG, degradation=Degradation(pieces=4, gap=0.2), seed=7)
    assert len(data.features) > len(ideal_data(SCENE, RIG).features)
    across, along, _ = distances_to_model(data, 0, L_SHAPE)
    assert across.max() < 1e-12
    truth = data.truth(0)
    low, high = along.min(axis=0), along.max(axis=0)
    owner = truth.assignment[truth.data_indices]
    for k in np.unique(owner):
        order = np.argsort(low[owner == k])
        assert (low[owner == k][order][1:] >= high[owner == k][order][:-1]).all()


def test_thinning_and_short_fragments():
    whole = ideal_data(SCENE, RIG)
    thin = ideal_data(SCENE, RIG, degradation=Degradation(keep=0.5), seed=1)
    assert 0 < len(thin.features) < len(whole.features)
    long = ideal_data(SCENE, RIG, degradation=Degradation(shortest=0.025))
    edges = long.features.of_kind(FeatureKind.EDGE)
    assert len(edges) and edges.lengths.min() >= 0.025


def test_clutter_is_in_the_bin_and_hides():
    screen = Placement('screen', Solid.block(0.1, 0.2, 0.001), Pose(np.eye(3), [-0.01, -0.1, 0.2]).matrix)
    clear, data = ideal_data(SCENE, RIG), ideal_data(SCENE, RIG, clutter=[screen])
    assert (data.object_index == BIN).sum() > 0
    assert (data.object_index == 0).sum() < (clear.object_index == 0).sum()
    for index in range(2):
        assert (data.truth(index).assignment[data.object_index == BIN] == BIN).all()


@pytest.mark.parametrize(
    ('field', 'value'), [('pieces', 0), ('keep', 1.5), ('gap', -0.1), ('err_par', -1.0), ('normal_cone', float('nan'))]
)
def test_wear_names_the_field(field, value):
    with pytest.raises(ValueError, match=field):
        Degradation(**{field: value})


def test_an_empty_scene_gives_no_features():
    assert len(ideal_data(Scene([]), RIG).features) == 0


def test_the_old_name_of_degradation_still_works():
    with pytest.warns(FutureWarning, match='csg_renderer.Degradation'):
        old = csg_renderer.Wear
    assert old is Degradation
    with pytest.warns(FutureWarning, match='degradation'):
        data = ideal_data(SCENE, RIG, wear=Degradation(keep=0.0))
    assert not len(data.features)
