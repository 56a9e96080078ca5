"""Outlines of meshes: those of the solids that were facetted, to the error of the facets."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from csg_renderer import MeshOutline, Solid, SolidOutline, load_known_models, load_models
from csg_renderer.features.mesh_features import mesh_features
from msgs_py import FeatureKind, PinholeCamera, Pose

trimesh = pytest.importorskip('trimesh')

CAMERA = PinholeCamera.centred(640, 480, 600.0)
MESHES = Path(__file__).parent / 'meshes'


def outline_of(mesh):
    return MeshOutline(np.array(mesh.vertices), np.array(mesh.faces))


def prism(around, height):
    """A convex polygon (n, 2), anticlockwise, drawn out along z."""
    n, k = len(around), np.arange(len(around))
    after = np.roll(k, -1)
    vertices = np.concatenate([np.column_stack([around, np.full(n, z)]) for z in (0.0, height)])
    fan = np.column_stack([np.zeros(n - 2, int), k[1:-1], k[2:]])
    sides = np.column_stack([k, after, after + n]), np.column_stack([k, after + n, k + n])
    return MeshOutline(vertices, np.concatenate([*sides, fan[:, ::-1], fan + n]))


def turn(angle, radius=1.0):
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def even(count):
    return 2.0 * np.pi * np.arange(count) / count


def before(outline, rotation, distance=3.0):
    """In front of the camera, so many sizes away."""
    return Pose(rotation, np.array([0.0, 0.0, distance * outline.size]) - rotation @ outline.centre)


def eye_of(pose):
    return pose.inverse().translation


def contour(points):
    return points.select((points.outward**2).sum(axis=1) > 0.5)


def pixels(points, pose):
    """Where points are in the image, and the unit normals of their curves there."""
    at = CAMERA.project(pose.apply(points.point))
    ahead = CAMERA.project(pose.apply(points.point + 1e-5 * points.tangent)) - at
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)
    return at, np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)


def off(points, others, pose):
    """How far points lie from the curves of others that are drawn densely, pixels; and how far from their points."""
    at, (near, normal) = pixels(points, pose)[0], pixels(others, pose)
    distance, row = cKDTree(near).query(at, 8)
    return np.abs(((at[:, None] - near[row]) * normal[row]).sum(axis=2)).min(axis=1), distance[:, 0]


@cache
def both(name):
    solid = SolidOutline(next(iter(load_models(name).values())))
    return solid, load_known_models(MESHES / f'{name}.stl')[name].outline


TURNS = st.integers(0, 2**32 - 1).map(lambda seed: Rotation.random(random_state=seed).as_matrix())


class TestAgainstSolids:
    # What 64 facets a turn may be off, pixels, of 200 across: 1e-3 of the radius and less, on a few points; rims and
    # contours of cylinders are exact.
    @pytest.mark.parametrize('name', ['plug', 'widget', 'cylinder_box'])
    @settings(max_examples=25, deadline=None)
    @given(rotation=TURNS)
    def test_the_same_curves_are_seen(self, name, rotation):
        solid, mesh = both(name)
        pose = before(solid, rotation)
        exact, found = solid.visible(pose, CAMERA, 0.1), mesh.visible(pose, CAMERA, 0.5)
        across, apart = off(found, exact, pose)
        # Ends of what is hidden, by the width of a facet; a face seen edge-on is seen or not.
        assert (apart < 2.0).mean() > 0.99
        assert (off(exact, found, pose)[1] < 2.0).mean() > 0.99
        assert np.quantile(across[apart < 2.0], 0.99) < 0.02
        assert np.median(across) < 1e-3

    @settings(max_examples=25, deadline=None)
    @given(rotation=TURNS)
    def test_a_block_is_the_same_to_rounding(self, rotation):
        sides = np.array([0.10, 0.07, 0.05])
        solid = SolidOutline(Solid.block(*sides))
        box = trimesh.creation.box(sides)
        mesh = MeshOutline(np.array(box.vertices) + 0.5 * sides, np.array(box.faces))
        pose = before(solid, rotation)
        found = mesh.visible(pose, CAMERA, 0.5)
        # A point of a block's edge lies in two of its planes. (Which of the solid's points is nearest in the image
        # tells less: of a face seen nearly edge-on two edges lie on each other there.)
        from_planes = np.abs(found.point[:, :, None] - np.stack([np.zeros(3), sides], axis=1)).min(axis=2)
        assert np.sort(from_planes, axis=1)[:, 1].max() < 1e-12
        assert (off(found, solid.visible(pose, CAMERA, 0.1), pose)[1] < 1.0).mean() > 0.99

    def test_an_l_shape_whose_faces_are_one_polygon(self):
        around = np.array([[0, 0], [6, 0], [6, 2], [2, 2], [2, 5], [0, 5]], float) * 0.01
        mesh = trimesh.creation.extrude_triangulation(around, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]], 0.03)
        outline = outline_of(mesh)
        solid = SolidOutline(Solid.block(0.06, 0.02, 0.03) | Solid.block(0.02, 0.05, 0.03))
        for seed in range(5):
            pose = before(solid, Rotation.random(random_state=seed).as_matrix())
            exact, found = solid.visible(pose, CAMERA, 0.1), outline.visible(pose, CAMERA, 2.0)
            assert len(found) == len(solid.visible(pose, CAMERA, 2.0))
            assert off(found, exact, pose)[0].max() < 1e-5

    def test_the_features_are_those_of_the_mesh_and_points_say_which(self):
        outline = both('cylinder_box')[1]
        exact = mesh_features(outline.vertices, outline.triangles)
        np.testing.assert_array_equal(outline.features.start, exact.start)
        pose = before(outline, Rotation.random(random_state=4).as_matrix())
        seen = outline.visible(pose, CAMERA, 1.0)
        assert {int(exact.kind[k]) for k in np.unique(seen.feature[seen.feature >= 0])} == {
            FeatureKind.EDGE,
            FeatureKind.CURVE,
        }
        for feature in np.unique(seen.feature[seen.feature >= 0]):
            line = exact.polyline(int(feature), 9000)
            if len(line) == 2:
                line = line[0] + np.linspace(0.0, 1.0, 9000)[:, None] * (line[1] - line[0])
            assert cKDTree(line).query(seen.point[seen.feature == feature])[0].max() < 1e-5 * outline.size + 1e-5

    def test_the_surface_is_where_rays_meet_it(self):
        solid, mesh = both('plug')
        pose = before(solid, Rotation.random(random_state=2).as_matrix())
        grid = CAMERA.pixel_grid().reshape(-1, 2)[::331]
        one, other = solid.surface(pose, CAMERA, grid), mesh.surface(pose, CAMERA, grid)
        assert (np.isnan(one) == np.isnan(other)).mean() > 0.999
        hit = np.isfinite(one[:, 0]) & np.isfinite(other[:, 0])
        assert hit.sum() > 20
        np.testing.assert_allclose(one[hit], other[hit], atol=1e-7)


class TestRoundSurfaces:
    @settings(max_examples=30, deadline=None)
    @given(st.integers(0, 2**32 - 1), st.integers(24, 100), st.floats(0.2, 2.9))
    def test_limbs_of_an_unevenly_facetted_cylinder_are_rulings(self, seed, count, tilt):
        """However the facets are cut, the limb is a straight line on the cylinder."""
        step = np.random.default_rng(seed).uniform(1.0, 1.7, count)
        rod = prism(turn(np.cumsum(2.0 * np.pi * step / step.sum())), 3.0)
        pose = before(rod, Rotation.from_euler('xz', [tilt, 0.3]).as_matrix())
        limb = contour(rod.visible(pose, CAMERA, 1.0))
        angle = 2.0 * np.pi * step.max() / step.sum()
        # The facets: angle**2 / 8.
        assert np.abs(np.hypot(limb.point[:, 0], limb.point[:, 1]) - 1.0).max(initial=0.0) < 0.05 * angle**4
        assert np.abs((limb.outward * (limb.point - eye_of(pose))).sum(axis=1)).max(initial=0.0) < 1e-9
        for curve in np.unique(limb.curve):
            assert np.ptp(limb.point[limb.curve == curve], axis=0)[:2].max() < 1e-2 * angle**2

    def test_rims_are_round(self):
        rod = prism(turn(even(24)), 2.0)
        seen = rod.visible(before(rod, Rotation.from_euler('x', 2.4).as_matrix()), CAMERA, 1.0)
        rim = seen.point[seen.feature >= 0]
        assert len(rim) > 100
        np.testing.assert_allclose(np.hypot(rim[:, 0], rim[:, 1]), 1.0, atol=2e-6)  # the facets: 8.6e-3

    @pytest.mark.parametrize(('fineness', 'error'), [(2, 2e-4), (3, 2e-5), (4, 2e-6)])
    def test_the_contour_of_a_ball_is_its_circle(self, fineness, error):
        ball = outline_of(trimesh.creation.icosphere(fineness))
        pose = before(ball, Rotation.random(random_state=1).as_matrix())
        seen = contour(ball.visible(pose, CAMERA, 1.0))
        eye = eye_of(pose)
        far = np.linalg.norm(eye)
        # In the image it is a circle about the line to the middle: what counts is the angle to it.
        ray = seen.point - eye
        sine = np.linalg.norm(np.cross(ray, eye), axis=1) / (np.linalg.norm(ray, axis=1) * far)
        np.testing.assert_allclose(sine * far, 1.0, atol=error)
        assert np.unique(seen.curve).size == 1

    def test_the_contour_of_a_cone_runs_to_its_tip(self):
        cone = outline_of(trimesh.creation.cone(1.0, 2.0, sections=48))
        solid = SolidOutline(Solid.cone(1.0, (0.0, 0.0, 2.0)).transformed(np.diag([1.0, 1.0, -1.0, 1.0])))
        pose = before(cone, Rotation.from_euler('xy', [1.2, 0.1]).as_matrix())
        limb = contour(cone.visible(pose, CAMERA, 0.5))
        assert np.unique(limb.curve).size == 2
        assert limb.point[:, 2].max() > 1.98 and limb.point[:, 2].min() < 0.02
        radius = np.hypot(limb.point[:, 0], limb.point[:, 1])
        np.testing.assert_allclose(radius, 1.0 - 0.5 * limb.point[:, 2], atol=1e-3)
        assert solid.size == pytest.approx(cone.size)

    def test_flat_sides_keep_their_normals_up_to_round_ends(self):
        """Of a bar with rounded edges the flats are no part of a contour; it is where the round turns away."""
        corner = np.linspace(0.0, np.pi / 2.0, 7)
        around = np.concatenate(
            [turn(corner + k * np.pi / 2.0, 0.2) + [[2, 1], [-2, 1], [-2, -1], [2, -1]][k] for k in range(4)]
        )
        bar = prism(around, 4.0)
        for tilt in np.radians([20.0, 33.0, 41.0, 70.0]):
            pose = before(bar, Rotation.from_euler('zx', [tilt, np.pi / 2.0]).as_matrix(), 4.0)
            limb = contour(bar.visible(pose, CAMERA, 1.0))
            assert len(limb)
            middle = np.sign(limb.point[:, :2]) * [2.0, 1.0]
            np.testing.assert_allclose(np.linalg.norm(limb.point[:, :2] - middle, axis=1), 0.2, atol=1e-4)
            np.testing.assert_allclose(limb.outward[:, :2], (limb.point[:, :2] - middle) / 0.2, atol=2e-3)

    def test_a_bore_has_no_contour(self):
        ring = outline_of(trimesh.creation.annulus(0.5, 1.0, 1.0, sections=64))
        for seed in range(10):
            pose = before(ring, Rotation.random(random_state=seed).as_matrix())
            limb = contour(ring.visible(pose, CAMERA, 1.0))
            assert np.hypot(limb.point[:, 0], limb.point[:, 1]).min(initial=1.0) > 0.99

    @settings(max_examples=20, deadline=None)
    @given(rotation=TURNS)
    def test_the_contour_of_a_ring(self, rotation):
        """A torus: where the true normal is at right angles to the ray; hidden where it turns towards the eye."""
        torus = outline_of(trimesh.creation.torus(1.0, 0.4, major_sections=96, minor_sections=48))
        pose = before(torus, rotation)
        seen = contour(torus.visible(pose, CAMERA, 1.0))
        assert len(seen) > 100
        spine = np.column_stack([seen.point[:, :2], np.zeros(len(seen))])
        spine /= np.linalg.norm(spine, axis=1, keepdims=True)
        normal = seen.point - spine
        np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 0.4, atol=2e-4)
        ray = seen.point - eye_of(pose)
        slant = (normal * ray).sum(axis=1) / (0.4 * np.linalg.norm(ray, axis=1))
        assert np.quantile(np.abs(slant), 0.95) < 5e-3

    def test_creases_are_none_of_its_contours_and_facets_no_creases(self):
        rod = prism(turn(even(64)), 2.0)
        seen = rod.visible(before(rod, Rotation.from_euler('x', 2.0).as_matrix()), CAMERA, 1.0)
        assert np.unique(seen.curve).size == 4  # two rims and two limbs, and none of 64 edges between facets


class TestMeshesOfOthers:
    def test_inside_out_is_the_same(self):
        mesh = trimesh.creation.cylinder(1.0, 2.0, sections=32)
        one, other = outline_of(mesh), MeshOutline(np.array(mesh.vertices), np.array(mesh.faces)[:, ::-1])
        pose = before(one, Rotation.from_euler('xy', [0.4, 0.5]).as_matrix())
        a, b = one.visible(pose, CAMERA, 2.0), other.visible(pose, CAMERA, 2.0)
        assert len(a) == len(b) > 100
        assert cKDTree(a.point).query(b.point)[0].max() < 1e-9
        assert (contour(b).outward[:, :2] * contour(b).point[:, :2]).sum(axis=1).min() > 0.9

    def test_a_sheet_is_seen_from_both_sides_with_its_border(self):
        square = MeshOutline(
            np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float), np.array([[0, 1, 2], [0, 2, 3]])
        )
        for tilt in (0.3, np.pi - 0.3):
            seen = square.visible(before(square, Rotation.from_euler('x', tilt).as_matrix()), CAMERA, 2.0)
            assert np.unique(seen.curve).size == 4

    def test_parts_that_only_touch_hide_no_corner_between_them(self):
        """A block on a plate, two bodies: the line along which they touch is seen."""
        plate, block = trimesh.creation.box((4, 4, 1)), trimesh.creation.box((2, 2, 1))
        block.apply_translation((0, 0, 1))
        outline = outline_of(trimesh.util.concatenate([plate, block]))
        pose = before(outline, Rotation.from_euler('zx', [0.4, 2.5]).as_matrix())
        seen = outline.visible(pose, CAMERA, 2.0)
        foot = (np.abs(seen.point[:, 2] - 0.5) < 1e-6) & (np.abs(seen.point[:, :2]).max(axis=1) < 1.01)
        assert np.unique(seen.curve[foot]).size == 2

    def test_nothing_is_seen_of_what_lies_behind_the_camera(self):
        rod = prism(turn(even(32)), 2.0)
        assert len(rod.visible(Pose(np.eye(3), np.array([0.0, 0.0, -9.0])), CAMERA, 4.0)) == 0

    def test_a_model_of_another_scale_is_seen_as_it_is(self):
        outline = both('plug')[1]
        pose = before(outline, Rotation.random(random_state=3).as_matrix())
        large = Pose(pose.rotation, 2.0 * pose.translation, 2.0)
        np.testing.assert_allclose(
            outline.visible(pose, CAMERA, 3.0).point, outline.visible(large, CAMERA, 3.0).point, atol=1e-12
        )
