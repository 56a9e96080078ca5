"""Features of meshes: the same as of the solids they are facetted from."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from csg_renderer import Solid, features_from_mesh, load_model_features, model_features
from csg_renderer.features.mesh_features import mesh_features
from msgs_py import FeatureKind, FeatureSet

SIDES = 64


def prism(outline: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
    """A convex polygon (n, 2), anticlockwise, drawn out along z: vertices and triangles."""
    n = len(outline)
    vertices = np.concatenate([np.column_stack([outline, np.full(n, z)]) for z in (0.0, height)])
    k = np.arange(n)
    after = (k + 1) % n
    fan = np.column_stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)])
    return vertices, np.concatenate(
        [np.column_stack([k, after, after + n]), np.column_stack([k, after + n, k + n]), fan[:, ::-1], fan + n]
    )


def counts(features: FeatureSet) -> list[int]:
    return [int((features.kind == kind).sum()) for kind in FeatureKind]


def arc(low: float, high: float, count: int) -> np.ndarray:
    angle = np.linspace(low, high, count)
    return np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize(
    ('mesh', 'wanted'),
    [
        (trimesh.creation.box((1, 2, 3)), [12, 0, 0]),
        (trimesh.creation.cylinder(1, 2, sections=SIDES), [0, 2, 1]),
        (trimesh.creation.cone(1, 2, sections=SIDES), [0, 1, 1]),
        (trimesh.creation.annulus(0.5, 1, 2, sections=SIDES), [0, 4, 1]),
        (trimesh.creation.icosphere(3), [0, 0, 0]),
        (trimesh.creation.capsule(2, 1), [0, 0, 0]),
    ],
)
def test_counts_of_primitives(mesh, wanted):
    assert counts(mesh_features(np.array(mesh.vertices), np.array(mesh.faces))) == wanted


def test_a_facetted_cylinder_agrees_with_the_exact_one():
    vertices, triangles = prism(arc(0, 2 * np.pi, SIDES + 1)[:-1], 2.0)
    mesh, exact = mesh_features(vertices, triangles), model_features(Solid.cylinder(1.0, (0, 0, 2)))
    order = np.argsort(mesh.start[:2, 2])
    np.testing.assert_allclose(mesh.start[order], exact.start[:2], atol=1e-9)
    np.testing.assert_allclose(mesh.directions[order], exact.directions[:2], atol=1e-9)
    np.testing.assert_allclose(mesh.radii[order], exact.radii[:2], atol=1e-9)
    np.testing.assert_allclose(np.sort([mesh.start[2, 2], mesh.end[2, 2]]), [0, 2], atol=1e-9)


def test_an_elliptic_cylinder_has_elliptic_rims():
    vertices, triangles = prism(arc(0, 2 * np.pi, SIDES + 1)[:-1] * [3.0, 1.0], 2.0)
    curves = mesh_features(vertices, triangles).of_kind(FeatureKind.CURVE)
    np.testing.assert_allclose(curves.radii, [[3, 1], [3, 1]], atol=1e-6)
    np.testing.assert_allclose(np.abs(curves.major_axis), [[1, 0, 0], [1, 0, 0]], atol=1e-6)


def test_half_a_cylinder_has_four_edges_and_two_half_circles():
    vertices, triangles = prism(arc(0, np.pi, SIDES // 2 + 1), 2.0)
    found = mesh_features(vertices, triangles)
    assert counts(found) == [4, 2, 1]
    curves = found.of_kind(FeatureKind.CURVE)
    np.testing.assert_allclose(curves.arc[:, 1], np.pi, atol=1e-9)
    for k in range(2):
        assert curves.polyline(k)[:, 1].min() > -1e-9


def test_straight_sides_run_smoothly_into_round_ends():
    outline = np.concatenate([arc(-np.pi / 2, np.pi / 2, 33) + [2, 0], arc(np.pi / 2, 3 * np.pi / 2, 33) - [2, 0]])
    vertices, triangles = prism(outline, 1.0)
    found = mesh_features(vertices, triangles)
    assert counts(found) == [4, 4, 2]
    np.testing.assert_allclose(found.lengths[:4], 4.0, atol=1e-9)


def test_creases_are_merged_over_needless_vertices():
    vertices, triangles = trimesh.remesh.subdivide(*prism(np.array([[0, 0], [3, 0], [3, 2], [0, 2]], float), 1.0))
    found = mesh_features(vertices, triangles)
    assert counts(found) == [12, 0, 0]
    np.testing.assert_allclose(np.sort(found.lengths), [1] * 4 + [2] * 4 + [3] * 4, atol=1e-12)


def test_the_axis_of_a_shaft_runs_through_its_bulge():
    """Two stumps that a smooth bulge joins to one round surface, which is neither cylinder nor cone."""
    bulge = np.linspace(0, 2 * np.pi, 41)
    profile = np.concatenate(
        [
            [[0, 0], [1, 0]],
            np.column_stack([1.3 - 0.3 * np.cos(bulge), 1 + bulge / 2]),
            [[1, 2 + np.pi], [0, 2 + np.pi]],
        ]
    )
    mesh = trimesh.creation.revolve(profile, sections=SIDES)
    found = mesh_features(np.array(mesh.vertices), np.array(mesh.faces))
    assert counts(found) == [0, 2, 1]
    axis = found.of_kind(FeatureKind.AXIS)
    np.testing.assert_allclose(np.sort([axis.start[0], axis.end[0]], axis=0), [[0, 0, 0], [0, 0, 2 + np.pi]], atol=1e-6)


@pytest.mark.parametrize('suffix', ['stl', 'obj', 'ply', 'off'])
def test_files(tmp_path, suffix):
    path = tmp_path / f'drum.{suffix}'
    trimesh.creation.cylinder(20, 50, sections=SIDES).export(path)
    found = features_from_mesh(path, scale=1e-3)
    assert counts(found) == [0, 2, 1]
    np.testing.assert_allclose(found.radii[:2], 0.02, rtol=1e-4)
    assert list(load_model_features(path)) == ['drum']


def test_crease_angle_decides_what_is_round(tmp_path):
    path = tmp_path / 'prism.stl'
    trimesh.creation.cylinder(1, 1, sections=12).export(path)
    assert counts(features_from_mesh(path, crease_angle=np.radians(35))) == [0, 2, 1]
    assert counts(features_from_mesh(path, crease_angle=np.radians(20))) == [36, 0, 0]


@pytest.mark.parametrize(
    ('name', 'content', 'error', 'match'),
    [
        ('none.stl', None, FileNotFoundError, 'none.stl'),
        ('bad.stl', b'solid nothing here', ValueError, 'bad.stl'),
        ('bad.ply', b'not a mesh', ValueError, 'bad.ply'),
        ('model.step', b'ISO-10303-21', ValueError, 'step'),
    ],
)
def test_bad_files_are_named(tmp_path, name, content, error, match):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(error, match=match):
        features_from_mesh(path)


@pytest.mark.parametrize('argument', [{'crease_angle': 0.0}, {'crease_angle': 4.0}, {'scale': -1.0}])
def test_bad_arguments_are_named(tmp_path, argument):
    with pytest.raises(ValueError, match=next(iter(argument))):
        features_from_mesh(tmp_path / 'x.stl', **argument)


@pytest.mark.parametrize('index', [-1, 4, 2**31 - 1])
def test_triangles_of_vertices_that_are_not_there_are_refused(tmp_path, index):
    path = tmp_path / 'odd.ply'
    path.write_text(
        'ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n'
        'element face 1\nproperty list uchar int vertex_indices\nend_header\n'
        f'0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 {index}\n'
    )
    with pytest.raises(ValueError, match='odd.ply: '):
        features_from_mesh(path)


def test_a_mesh_of_creases_only_is_refused_in_time():
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match='30000 creases, expected at most 8000: is it a scan'):
        mesh_features(rng.normal(size=(30_000, 3)), np.arange(30_000).reshape(-1, 3))
