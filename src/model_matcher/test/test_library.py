"""Models are read from files of every kind that the documentation promises."""

import numpy as np
import pytest
import trimesh

from csg_renderer import Solid, load_model_features, model_features
from csg_renderer.mesh.units import mesh_unit
from model_matcher.model.library import load_library, working_distance
from msgs_py import FeatureSet


@pytest.mark.parametrize('suffix', ['stl', 'obj', 'ply', 'off'])
def test_a_mesh_becomes_a_model(tmp_path, suffix):
    path = tmp_path / f'brick 1.{suffix}'
    trimesh.creation.box((0.04, 0.03, 0.02)).export(path)
    library = load_library([str(path)])
    assert library.problems == ()
    (model,) = library.models
    assert model.name == 'brick_1' and len(model.features) == 12
    np.testing.assert_allclose(np.sort(model.features.lengths), [0.02] * 4 + [0.03] * 4 + [0.04] * 4, atol=1e-6)


def test_features_that_were_saved_become_a_model(tmp_path):
    features = model_features(Solid.block(0.04, 0.03, 0.02))
    features.save(tmp_path / 'brick.npz')
    assert load_model_features(tmp_path / 'brick.npz') == {'brick': features}
    (model,) = load_library([str(tmp_path / 'brick.npz')]).models
    assert model.features == features


def test_a_folder_gives_all_its_models_and_names_what_cannot_be_used(tmp_path):
    (tmp_path / 'part.csg').write_text('UNITS MM; part = BLOCK (40, 30, 20); DRAW part;')
    trimesh.creation.box((0.04, 0.03, 0.02)).export(tmp_path / 'part.off')
    (tmp_path / 'torn.off').write_text('OFF\n3 1')
    library = load_library([str(tmp_path)])
    assert [model.name for model in library.models] == ['part', 'part_2']
    (problem,) = library.problems
    assert problem.startswith('torn.off')


SIDES = np.array([0.04, 0.03, 0.02])


@pytest.mark.parametrize(('unit', 'metres'), [('mm', 1e-3), ('cm', 1e-2), ('m', 1.0), ('in', 0.0254)])
def test_a_mesh_has_the_unit_that_is_given(tmp_path, unit, metres):
    path = tmp_path / 'brick.stl'
    trimesh.creation.box(SIDES / metres).export(path)
    library = load_library([str(path)], unit)
    np.testing.assert_allclose(np.sort(library.models[0].features.lengths), np.repeat(SIDES[::-1], 4), rtol=1e-6)
    assert library.units['brick'].name == unit and not library.units['brick'].guessed


@pytest.mark.parametrize(
    ('extent', 'distance', 'unit'),
    [
        (54.0, 0.6, 'mm'),
        (54.0, 0.1, 'mm'),
        (1000.0, 0.6, 'mm'),
        (13.0, 0.6, 'mm'),
        (0.054, 0.6, 'm'),
        (0.5, 3.0, 'm'),
        (2.0, 0.6, 'in'),
        (8.0, 0.6, 'in'),
        (3.0, 5.0, 'm'),
        (1e-4, 0.6, 'm'),
        (1e5, 0.6, 'mm'),
        (0.0, 0.6, 'mm'),
    ],
)
def test_a_unit_is_guessed_from_the_size_against_the_distance(extent, distance, unit):
    found = mesh_unit(extent, distance=distance)
    assert found.name == unit and found.guessed and 'guessed' in str(found)


def test_another_unit_or_distance_than_there_is_is_refused_by_name():
    with pytest.raises(ValueError, match="mesh_units: expected one of guess, mm, cm, m, in; got 'ft'"):
        mesh_unit(1.0, 'ft')
    with pytest.raises(ValueError, match='distance: expected metres > 0'):
        mesh_unit(1.0, distance=0.0)


def test_features_tell_the_distance_that_a_guess_goes_by(tmp_path):
    """A ball of 9 units is nothing in millimetres from 3 m, and too much in metres from 60 mm."""
    far = FeatureSet.from_edges([[0.0, 0.0, 3.0]], [[0.1, 0.0, 3.0]])
    near = FeatureSet.from_edges([[0.0, 0.0, 0.06]], [[0.001, 0.0, 0.06]])
    assert working_distance(FeatureSet.empty()) is None
    path = tmp_path / 'brick.stl'
    trimesh.creation.box((6.0, 5.0, 4.0)).export(path)
    units = {}
    for name, data in (('far', far), ('near', near)):
        library = load_library([str(path)], distance=working_distance(data))
        units[name] = library.units['brick'].name
        assert not library.guesses_otherwise(working_distance(data))
    assert units == {'far': 'in', 'near': 'mm'}
    assert library.guesses_otherwise(working_distance(far))
