"""The scenes of the package have the counts of the thesis, and every edge of a test model has contrast."""

import warnings

import cv2
import numpy as np
import pytest

from csg_renderer import SceneWarning, load_models, load_scene, model_features, render, scene_names
from csg_renderer.visibility.hidden_lines import visible_fragments
from msgs_py import PinholeCamera

# Model: primitives, half-spaces (Table 5.1), edges, curves, axes (Tables 5.3, 6.1; thesis 6.9).
MODELS = {
    'chipped_block': (2, 12, (15, 0, 0)),
    'chair': (3, 18, (30, 0, 0)),
    'computer': (9, 54, (32, 0, 0)),
    'l_shape': (2, 12, (18, 0, 0)),
    'wedge': (3, 18, (15, 0, 0)),
    'plug': (8, 48, (54, 0, 0)),
    'cylinder_box': (2, 9, (12, 2, 1)),
    'lamp': (5, 21, (24, 3, 1)),
    'tubes': (5, 15, (0, 10, 5)),
    'widget': (6, 29, (28, 3, 1)),
}
# Scene: edges, curves, axes of which something is seen at the printed pose: ours, and the thesis' where it differs.
VIEWS = {
    'chipped_block_v1': (12, 0, 0),
    'chipped_block_v2': (9, 0, 0),
    'chair_v1': (20, 0, 0),
    'chair_v2': (21, 0, 0),
    'computer_v1': (26, 0, 0),
    'computer_v2': (17, 0, 0),
    'l_shape_v1': (15, 0, 0),
    'l_shape_v2': (9, 0, 0),
    'wedge_v1': (12, 0, 0),
    'wedge_v2': (8, 0, 0),
    'plug_v1': (40, 0, 0),
    'plug_v2': (13, 0, 0),
    'cylinder_box_v1': (9, 2, 1),
    'cylinder_box_v2': (9, 1, 0),  # thesis 11, 1, 0, of 9 edges that face the camera: two were recovered in pieces
    'lamp_v1': (14, 3, 1),
    'lamp_v2': (14, 2, 1),  # thesis 16, 3, 1 and 15, 2, 1
    'tubes_v1': (0, 8, 3),
}
# Scene: primitives, half-spaces, lights (Table 4.3, Plate 4.1).
LARGE = {
    'coverplate': (25, 93, 3),
    'recursive_cubes': (42, 147, 3),
    'oil_rig': (44, 264, 3),
    'robot_arm': (63, 258, 3),
    'geneva_wheel': (38, 147, 3),
    'table': (100, 377, 3),
}


@pytest.mark.parametrize('name', scene_names())
def test_every_scene_reads_without_a_warning(name):
    with warnings.catch_warnings():
        warnings.simplefilter('error', SceneWarning)
        assert load_scene(name).placements


@pytest.mark.parametrize('name', MODELS)
def test_models_have_the_counts_of_the_thesis(name):
    primitives, halfspaces, features = MODELS[name]
    (model,) = load_models(name).values()
    assert (len(model.primitives), model.halfspaces) == (primitives, halfspaces)
    assert tuple(np.bincount(model_features(model).kind, minlength=3)) == features


@pytest.mark.parametrize('name', VIEWS)
def test_views_show_as_many_features_as_the_thesis_saw(name):
    (placement,) = load_scene(name).placements
    wide = PinholeCamera.centred(8000, 8000, 703.0)
    seen = np.unique(visible_fragments(placement.model, placement.pose, wide).model_index)
    assert tuple(np.bincount(model_features(placement.model).kind[seen], minlength=3)) == VIEWS[name]


@pytest.mark.parametrize('name', VIEWS)
def test_views_draw_the_model_of_the_same_name_inside_both_images(name):
    scene = load_scene(name)
    model = next(iter(load_models(name.rsplit('_', 1)[0]).values()))
    (placement,) = scene.placements
    assert [leaf.matrix.tolist() for leaf in placement.model.primitives] == [
        leaf.matrix.tolist() for leaf in model.primitives
    ]
    assert scene.baseline == pytest.approx(placement.pose.translation[2] / 5.0)
    features = model_features(model).transformed(placement.pose)
    ends = np.concatenate([features.start, features.end])
    edges = np.concatenate([features.kind == 0, features.kind == 0])
    for shift in (0.0, scene.baseline):
        assert scene.camera.contains(scene.camera.project(ends[edges] - [shift, 0.0, 0.0])).all()


@pytest.mark.parametrize('name', LARGE)
def test_large_scenes_have_the_counts_of_the_thesis(name):
    scene = load_scene(name)
    assert (len(scene.primitives), sum(solid.halfspaces for solid in scene.solids), len(scene.lights)) == LARGE[name]
    assert scene.camera is not None and scene.baseline is not None


@pytest.mark.parametrize('name', [name for name in VIEWS if not name.startswith(('tubes', 'lamp', 'cylinder'))])
def test_both_sides_of_every_edge_differ_in_grey(name):
    """Stereo needs contrast in grey, not only in colour (thesis 5.11)."""
    scene = load_scene(name)
    (placement,) = scene.placements
    grey = cv2.cvtColor(render(scene).image, cv2.COLOR_RGB2GRAY).astype(float)
    fragments = visible_fragments(placement.model, placement.pose, scene.camera).features
    weak = []
    for start, end in zip(scene.camera.project(fragments.start), scene.camera.project(fragments.end)):
        along = end - start
        if np.linalg.norm(along) < 30.0:
            continue
        across = 2.5 * np.array([-along[1], along[0]]) / np.linalg.norm(along)
        points = start + np.linspace(0.2, 0.8, 21)[:, None] * along
        one, other = (np.rint(points + side * across).astype(int) for side in (1, -1))
        step = float(np.median(np.abs(grey[one[:, 1], one[:, 0]] - grey[other[:, 1], other[:, 0]])))
        if step < 20.0:
            weak.append((start.round(), end.round(), step))
    assert not weak
