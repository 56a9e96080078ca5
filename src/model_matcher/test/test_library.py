"""Models are read from files of every kind that the documentation promises."""

import numpy as np
import pytest
import trimesh

from csg_renderer import Solid, load_model_features, model_features
from model_matcher.model.library import load_library


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
