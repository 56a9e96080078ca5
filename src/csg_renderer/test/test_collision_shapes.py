"""Solids as planners take them: the same points are inside."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from csg_renderer import Solid, planning_scene
from csg_renderer.brep.surfaces import solid_box
from csg_renderer.features import collision_shapes
from csg_renderer.scene.mesh_export import ExportError
from csg_renderer.scene.solid import Primitive
from msgs_py import Pose
from msgs_py.shapes import CollisionShapes, PrimitiveShape


def inside_shape(shape: PrimitiveShape, points: np.ndarray) -> np.ndarray:
    """By the definitions of shape_msgs/SolidPrimitive."""
    x, y, z = shape.pose.inverse().apply(points).T
    if shape.kind == 'BOX':
        return (np.abs([x, y, z]) <= np.array(shape.dimensions)[:, None] / 2).all(axis=0)
    if shape.kind == 'SPHERE':
        return np.hypot(np.hypot(x, y), z) <= shape.dimensions[0]
    height, radius = shape.dimensions
    here = np.abs(z) <= height / 2
    if shape.kind == 'CYLINDER':
        return here & (np.hypot(x, y) <= radius)
    return here & (np.hypot(x, y) <= radius * (0.5 - z / height))


def inside(shapes: CollisionShapes, points: np.ndarray) -> np.ndarray:
    return np.any([inside_shape(shape, points) for shape in shapes.primitives], axis=0)


def inside_leaf(leaf: Primitive, points: np.ndarray) -> np.ndarray:
    """By the definition of the unit primitives."""
    x, y, z = (np.linalg.inv(leaf.matrix) @ np.column_stack([points, np.ones(len(points))]).T)[:3]
    if leaf.kind == 'BLOCK':
        return (np.array([x, y, z]) >= 0).all(axis=0) & (np.array([x, y, z]) <= 1).all(axis=0)
    if leaf.kind == 'SPHERE':
        return x**2 + y**2 + z**2 <= 1
    return (z >= 0) & (z <= 1) & (np.hypot(x, y) <= (z if leaf.kind == 'CONE' else 1))


def points_about(solid: Solid, seed: int = 1) -> np.ndarray:
    low, high = solid_box(solid)
    return np.random.default_rng(seed).uniform(low - 0.1 * (high - low), high + 0.1 * (high - low), (4000, 3))


sizes = st.floats(0.01, 0.5)
axes = st.sampled_from([(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.3, -0.4, 0.5)])
leaves = st.one_of(
    st.builds(Solid.block, sizes, st.sampled_from([0.1, -0.2]), sizes),
    st.builds(Solid.sphere, sizes),
    st.builds(lambda r, a, h: Solid.cylinder(r, h * np.array(a)), sizes, axes, sizes),
    st.builds(lambda r, a, h: Solid.cone(r, h * np.array(a)), sizes, axes, sizes),
)
poses = st.builds(Pose.from_rotation_vector, st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-1, 1)] * 3))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.builds(lambda leaf, pose: leaf.transformed(pose), leaves, poses), min_size=1, max_size=4))
def test_a_union_of_primitives_stays_one_primitive_for_each(parts):
    solid = parts[0]
    for part in parts[1:]:
        solid = solid | part
    shapes = planning_scene(solid)
    assert len(shapes.primitives) == len(parts) and not shapes.meshes and shapes.note is None
    points = points_about(solid)
    expected = np.any([inside_leaf(leaf, points) for leaf in solid.primitives], axis=0)
    assert (inside(shapes, points) == expected).mean() > 0.999  # but for points that rounding decides


@pytest.fixture
def without_meshes(monkeypatch):
    def refuse(*arguments):
        raise ExportError('not installed')

    monkeypatch.setattr(collision_shapes, 'mesh_of', refuse)


def test_without_a_mesh_the_shapes_hold_the_solid_and_say_so(without_meshes):
    block, hole = (
        Solid.block(0.2, 0.1, 0.1),
        Solid.cylinder(0.02, (0, 0, 0.1)).transformed(Pose(np.eye(3), [0.1, 0.05, 0])),
    )
    ball = Solid.sphere(0.1).transformed(Pose(np.eye(3), [0.3, 0.0, 0.0]))
    drilled = planning_scene((block - hole) | (ball & Solid.plane((0, 0, 1), 0.0)))
    assert [shape.kind for shape in drilled.primitives] == ['BOX', 'BOX']
    assert drilled.primitives[0].dimensions == pytest.approx((0.2, 0.1, 0.1))
    assert 'larger than the object' in drilled.note
    sheared = np.array([[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    (box,) = planning_scene(Solid.block(0.1, 0.1, 0.1).transformed(sheared)).primitives
    assert box.dimensions == pytest.approx((0.15, 0.1, 0.1))
    (egg,) = planning_scene(Solid.sphere(0.1).transformed(np.diag([1.0, 2.0, 1.0, 1.0]))).primitives
    assert egg.kind == 'BOX' and egg.dimensions == pytest.approx((0.2, 0.4, 0.2))


def test_any_other_solid_is_a_mesh():
    pytest.importorskip('manifold3d')
    solid = Solid.block(0.2, 0.1, 0.1) - Solid.block(0.1, 0.1, 0.05)
    shapes = planning_scene(solid)
    assert not shapes.primitives and shapes.note is None
    (mesh,) = shapes.meshes
    a, b, c = mesh.vertices[mesh.triangles].transpose(1, 0, 2)
    assert np.einsum('ij,ij->', a, np.cross(b, c)) / 6.0 == pytest.approx(0.2 * 0.1 * 0.1 - 0.1 * 0.1 * 0.05)


def test_nothing_and_what_has_no_end():
    assert planning_scene(Solid.empty()).primitives == ()
    with pytest.raises(ValueError, match='no bounds'):
        planning_scene(Solid.plane((0, 0, 1), 0.1))
