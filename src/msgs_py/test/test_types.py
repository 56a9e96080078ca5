"""Pose, cameras, feature sets, interpretations: closed forms and properties."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_py import FeatureKind, FeatureSet, Interpretation, PinholeCamera, Pose, StereoRig

finite = st.floats(-10, 10, allow_nan=False, allow_subnormal=False)
vector = st.tuples(finite, finite, finite).map(np.array)
poses = st.builds(Pose.from_rotation_vector, vector, vector)
similarities = st.builds(lambda p, s: Pose(p.rotation, p.translation, s), poses, st.floats(0.1, 10))
fast = settings(max_examples=50, deadline=None)


class TestPose:
    def test_column_form_is_the_transpose_of_the_thesis_matrix(self):
        # Row form YROT(90): (x, y, z) -> (z, y, -x), so the column form takes x to -z.
        c, s = np.cos(np.pi / 2), np.sin(np.pi / 2)
        row = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        assert np.allclose(Pose(row.T).apply([1, 0, 0]), np.array([1, 0, 0]) @ row)

    @fast
    @given(similarities, vector)
    def test_inverse_undoes(self, pose, point):
        assert np.allclose(pose.inverse().apply(pose.apply(point)), point, atol=1e-9)

    @fast
    @given(similarities, similarities, vector)
    def test_composition_applies_the_right_hand_pose_first(self, a, b, point):
        assert np.allclose(a.compose(b).apply(point), a.apply(b.apply(point)), atol=1e-8)
        assert np.allclose(a.compose(b).matrix, a.matrix @ b.matrix, atol=1e-8)

    @fast
    @given(poses)
    def test_quaternion_and_matrix_round_trip(self, pose):
        assert np.allclose(Pose.from_quaternion(pose.quaternion, pose.translation).matrix, pose.matrix, atol=1e-12)
        assert np.allclose(Pose.from_matrix(pose.matrix).matrix, pose.matrix, atol=1e-9)

    @pytest.mark.parametrize('axis', [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, 0.8), (-0.48, 0.6, -0.64)])
    @pytest.mark.parametrize('angle', [0.0, 1e-9, 1.0, np.pi - 1e-9, np.pi + 1e-9, 5.0])
    def test_the_quaternion_is_that_of_axis_and_angle(self, angle, axis):
        half = np.array([*(np.sin(angle / 2) * np.array(axis)), np.cos(angle / 2)])
        quaternion = Pose.from_rotation_vector(angle * np.array(axis)).quaternion
        assert np.allclose(quaternion, half * np.sign(half[3]), atol=1e-15, rtol=0) and quaternion[3] >= 0.0

    @pytest.mark.parametrize('axis', [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, 0.8)])
    @pytest.mark.parametrize('angle', [1e-10, 1e-3, 1.0, np.pi - 1e-9])
    def test_error_is_the_angle_and_the_distance(self, angle, axis):
        a = Pose.from_rotation_vector([0.3, -0.2, 0.9], [1, 2, 3])
        b = a.compose(Pose.from_rotation_vector(angle * np.array(axis)))
        error = a.error_to(Pose(b.rotation, [1, 2, 5]))
        assert error.rotation == pytest.approx(angle, rel=1e-5, abs=1e-15)
        assert error.translation == pytest.approx(2.0)

    def test_it_is_shown_in_degrees_and_metres_and_its_scale_where_it_has_one(self):
        pose = Pose.from_rotation_vector([0.0, 0.0, np.pi / 2], [1, 2, 0.5])
        assert repr(pose) == 'Pose(rotation_vector_deg=[0, 0, 90], translation=[1, 2, 0.5])'
        assert repr(Pose(scale=2.0)).endswith('translation=[0, 0, 0], scale=2)')
        assert pose.error_to(Pose(scale=2.0)).scale == 1.0

    def test_what_is_given_is_copied_into_arrays(self):
        given = np.eye(3)
        pose = Pose(given, [1, 2, 3])
        given[0, 0] = 5.0
        assert np.array_equal(pose.rotation, np.eye(3)) and pose.translation.dtype == np.float64
        assert isinstance(Pose(np.eye(3).tolist()).rotation, np.ndarray)
        assert not Pose.from_quaternion([0, 0, 0, 2]).translation.any()
        assert not Pose.from_rotation_vector([0, 0, 1]).translation.any() and not Pose().translation.any()

    def test_a_scale_of_whole_numbers_is_a_number_and_a_matrix_has_a_last_row(self):
        assert isinstance(Pose(scale=np.float32(2)).scale, float)
        matrix = np.diag([2.0, 2.0, 2.0, 1.0])
        assert Pose.from_matrix(matrix).scale == pytest.approx(2.0)
        for row, text in (([0, 0, 0, 2], 'last row'), ([0, 0, 1, 1], 'last row')):
            with pytest.raises(ValueError, match=text):
                Pose.from_matrix(np.vstack([matrix[:3], row]))
        for bad in (np.diag([1.0, 1.0, -1.0, 1.0]), np.diag([1.0, 1.0, 0.0, 1.0])):
            with pytest.raises(ValueError, match='determinant .* expected > 0'):
                Pose.from_matrix(bad)
        small = np.diag([0.1, 0.1, 0.1, 1.0])
        assert Pose.from_matrix(small).scale == pytest.approx(0.1)

    @pytest.mark.parametrize(
        ('arguments', 'name'),
        [
            ((np.eye(3) * 2,), 'rotation'),
            ((np.diag([1, 1, -1]),), 'rotation'),
            ((np.eye(2),), 'rotation'),
            (('text',), 'rotation'),
            ((np.eye(3), [0, 0, np.nan]), 'translation'),
            ((np.eye(3), [0, 0, 0], 0.0), 'scale'),
        ],
    )
    def test_misuse_names_the_argument(self, arguments, name):
        with pytest.raises(ValueError, match=f'^{name}'):
            Pose(*arguments)

    def test_a_zero_quaternion_is_refused(self):
        with pytest.raises(ValueError, match='quaternion'):
            Pose.from_quaternion([0, 0, 0, 0])


class TestCameras:
    camera = PinholeCamera(640, 480, 500.0, 510.0, 320.5, 239.5)

    def test_centred_principal_point_is_between_the_middle_pixels(self):
        assert PinholeCamera.centred(512, 512, 703.0).cx == 255.5

    @fast
    @given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(0.1, 5.0))
    def test_rays_undo_projection(self, x, y, z):
        point = np.array([x * z, y * z, z])
        assert np.allclose(self.camera.rays(self.camera.project(point)) * z, point, atol=1e-12)

    def test_an_image_reaches_half_a_pixel_around_its_outer_centres(self):
        camera = PinholeCamera(64, 48, 70.0, 70.0, 31.5, 23.5)
        inside = [(-0.5, -0.5), (63.5, 47.5), (30.0, 20.0)]
        outside = [(-0.6, 20.0), (63.6, 20.0), (30.0, -0.6), (30.0, 47.6), (np.nan, 20.0), (30.0, np.nan)]
        assert camera.contains(inside).all() and not camera.contains(outside).any()

    def test_points_behind_the_camera_have_no_image(self):
        assert np.isnan(self.camera.project([0, 0, -1.0])).all()

    @fast
    @given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(0.2, 5.0), st.floats(0.01, 1.0), st.floats(-20, 20))
    def test_project_then_triangulate(self, x, y, z, baseline, offset):
        right = PinholeCamera(640, 480, 500.0, 510.0, 320.5 + offset, 239.5)
        rig = StereoRig(self.camera, right, baseline)
        point = np.array([x * z, y * z, z])
        left_pixel, right_pixel = rig.project(point)
        assert left_pixel[1] == pytest.approx(right_pixel[1])
        assert np.allclose(rig.triangulate(left_pixel, right_pixel[0]), point, rtol=1e-9, atol=1e-9)
        assert rig.disparity(z) == pytest.approx(left_pixel[0] - right_pixel[0])

    @pytest.mark.parametrize(
        ('change', 'name'),
        [({'fx': 0.0}, 'fx'), ({'fy': np.nan}, 'fy'), ({'width': 0}, 'width'), ({'height': 2.5}, 'height')],
    )
    def test_bad_intrinsics_are_refused_by_name(self, change, name):
        values = {'width': 640, 'height': 480, 'fx': 500.0, 'fy': 500.0, 'cx': 320.0, 'cy': 240.0} | change
        with pytest.raises(ValueError, match=f'^{name}'):
            PinholeCamera(**values)

    @pytest.mark.parametrize(
        ('right', 'baseline', 'name'),
        [
            (PinholeCamera(640, 480, 501.0, 510.0, 320.5, 239.5), 0.1, 'fx'),
            (PinholeCamera(640, 480, 500.0, 510.0, 320.5, 240.5), 0.1, 'cy'),
            (PinholeCamera(641, 480, 500.0, 510.0, 320.5, 239.5), 0.1, 'width'),
            (camera, 0.0, 'baseline'),
            (camera, -0.1, 'baseline'),
            (camera, np.inf, 'baseline'),
        ],
    )
    def test_an_unrectified_pair_is_refused_by_name(self, right, baseline, name):
        with pytest.raises(ValueError, match=f'^{name}'):
            StereoRig(self.camera, right, baseline)


def example_features() -> FeatureSet:
    return FeatureSet.concatenate(
        [
            FeatureSet.from_edges([[0, 0, 0], [1, 1, 1]], [[1, 0, 0], [1, 1, 3]], 0.001, [0.002, 0.003]),
            FeatureSet.from_curves([[0, 0, 1]], [[0, 0, 2]], [[2.0, 1.0]], major_axis=[[0, 1, 0]], arc=[[0.5, 1.0]]),
            FeatureSet.from_axes([[0, 0, 0]], [[0, 2, 0]]),
        ]
    )


def spread(rng_seed: int, n: int) -> np.ndarray:
    """n covariances of no particular shape, square metres."""
    mix = np.random.default_rng(rng_seed).normal(size=(n, 6, 6)) * 1e-3
    return mix @ mix.swapaxes(1, 2)


@pytest.mark.parametrize('copied', [lambda one: pickle.loads(pickle.dumps(one)), copy.deepcopy])
def test_features_are_read_only_after_a_journey_to_another_process(copied):
    features = example_features()
    again = copied(features)
    assert again == features
    for name in ('kind', 'start', 'end', 'err_par', 'err_per', 'radii', 'covariance'):
        assert not getattr(again, name).flags.writeable, name


def certain_features() -> FeatureSet:
    """The example with covariances of all but the second edge."""
    covariance = spread(3, 4)
    covariance[1] = np.nan
    return replace(example_features(), covariance=covariance)


class TestCovariance:
    def test_bounds_follow_from_it_whatever_is_given(self):
        covariance = np.diag([1.0, 4.0, 2.0, 9.0, 1.0, 16.0]) * 1e-6
        f = FeatureSet.from_edges([[0, 0, 0]], [[1, 0, 0]], 7.0, 7.0, covariance[None])
        assert f.err_par[0] == pytest.approx(3e-3 * np.sqrt(0.5 * (1.0 + 9.0)))
        assert f.err_per[0] == pytest.approx(3e-3 * np.sqrt(0.5 * (4.0 + 16.0)))
        rim = FeatureSet.from_curves([[0, 0, 1]], [[0, 1, 0]], 0.1, covariance=covariance[None])
        assert rim.err_par[0] == pytest.approx(3e-3 * 2.0) and rim.err_per[0] == pytest.approx(3e-3 * np.sqrt(2.0))

    def test_where_it_is_not_known_the_bounds_stay_as_given(self):
        f = certain_features()
        assert f.has_covariance.tolist() == [True, False, True, True]
        assert (
            f.err_per[1] == 0.003 and np.isnan(f.end_covariance[1]).all() and np.isnan(f.direction_covariance[1]).all()
        )
        assert not example_features().has_covariance.any()

    @fast
    @given(similarities)
    def test_it_turns_and_grows_with_the_points(self, pose):
        f = certain_features()
        moved, turn = f.transformed(pose), pose.scale * pose.rotation
        for name in ('start_covariance', 'end_covariance'):
            assert np.allclose(getattr(moved, name)[0], turn @ getattr(f, name)[0] @ turn.T, atol=1e-12)
        # The normal of a curve has no length, so scale does not touch it; nor any direction.
        assert np.allclose(moved.end_covariance[2], pose.rotation @ f.end_covariance[2] @ pose.rotation.T, atol=1e-12)
        turned = pose.rotation @ f.direction_covariance @ pose.rotation.T
        assert np.allclose(moved.direction_covariance, turned, atol=1e-12, equal_nan=True)
        assert np.allclose(moved.err_per, pose.scale * f.err_per) and np.allclose(moved.err_par, pose.scale * f.err_par)
        back = moved.transformed(pose.inverse())
        assert np.allclose(back.covariance, f.covariance, atol=1e-12, equal_nan=True)

    @fast
    @given(st.integers(0, 1000))
    def test_of_the_direction_is_what_ends_moved_by_it_show(self, seed):
        f = FeatureSet.from_edges([[0.1, 0.2, 0.3]], [[1.0, -0.5, 0.9]], covariance=1e-4 * spread(seed, 1))
        moved = np.random.default_rng(seed).multivariate_normal(np.zeros(6), f.covariance[0], 4000)
        run = f.vectors + moved[:, 3:] - moved[:, :3]
        off = run / np.linalg.norm(run, axis=1, keepdims=True) - f.directions
        stated = f.direction_covariance[0]
        assert np.allclose(off.T @ off / len(off), stated, atol=0.15 * np.trace(stated))

    def test_select_concatenate_and_files_keep_it(self, tmp_path):
        f = certain_features()
        assert FeatureSet.concatenate([f.select([0]), f.select([1, 2, 3])]) == f
        assert FeatureSet.concatenate([f, example_features()]).has_covariance.tolist() == [
            True,
            False,
            *[True] * 2,
            *[False] * 4,
        ]
        f.save(tmp_path / 'features.npz')
        assert FeatureSet.load(tmp_path / 'features.npz') == f
        example_features().save(tmp_path / 'old.npz')
        with np.load(tmp_path / 'old.npz') as old:
            assert 'covariance' not in old
        assert FeatureSet.load(tmp_path / 'old.npz') == example_features()

    @pytest.mark.parametrize(
        ('value', 'text'),
        [
            (np.eye(6)[None, :3], r'expected shape \(1, 6, 6\)'),
            ('text', 'array of numbers'),
            (-np.eye(6)[None], 'feature 0: not positive semidefinite'),
            ((np.eye(6) + 2.0 * np.eye(6)[::-1])[None], 'feature 0: not positive semidefinite'),
            ((np.eye(6) + np.triu(np.ones((6, 6)), 1))[None], 'feature 0: not symmetric'),
            (np.where(np.eye(6) > 0, np.nan, 1.0)[None], 'feature 0: expected 36 finite numbers'),
            (np.full((1, 6, 6), np.inf), 'feature 0: expected 36 finite numbers'),
        ],
    )
    def test_what_is_none_is_refused_by_name(self, value, text):
        with pytest.raises(ValueError, match=f'^covariance: .*{text}'):
            FeatureSet.from_edges([[0, 0, 0]], [[1, 0, 0]], covariance=value)

    def test_singular_ones_and_zero_are_allowed(self):
        point = np.outer(*[np.array([1.0, 2.0, 3.0, 1.0, 2.0, 3.0])] * 2) * 1e-12
        f = FeatureSet.from_edges([[0, 0, 0]] * 2, [[1, 0, 0]] * 2, covariance=[point, np.zeros((6, 6))])
        assert f.err_par == pytest.approx([3e-6, 0.0])


class TestFeatureSet:
    def test_lengths_directions_midpoints(self):
        f = example_features()
        assert np.allclose(f.lengths, [1, 2, 1, 2])
        assert np.allclose(f.directions[1], [0, 0, 1])
        assert np.allclose(f.midpoints, [[0.5, 0, 0], [1, 1, 2], [0, 0, 1], [0, 1, 0]])
        assert list(f.kind) == [FeatureKind.EDGE, FeatureKind.EDGE, FeatureKind.CURVE, FeatureKind.AXIS]

    @fast
    @given(similarities)
    def test_what_features_have_in_common_is_part_of_what_each_is_off(self, pose):
        rng = np.random.default_rng(4)
        f = example_features()
        root = rng.normal(size=(len(f), 6, 6))
        alone = replace(f, covariance=root @ root.swapaxes(1, 2))
        common = rng.normal(size=(len(f), 6))
        both = alone.with_common(common)
        assert np.allclose(both.covariance - alone.covariance, common[:, :, None] * common[:, None, :])
        assert (both.err_per >= alone.err_per).all() and alone.alone is alone
        assert np.allclose(both.alone.covariance, alone.covariance)
        assert not both.alone.common.any()
        assert np.allclose(both.alone.err_per, alone.err_per)
        # One sigma of it moves the features, in whatever frame they are.
        moved = both.moved_in_common
        assert np.allclose(moved.start - f.start, common[:, :3])
        curve = f.kind == FeatureKind.CURVE
        assert np.allclose((moved.end - f.end)[~curve], common[~curve, 3:])
        assert np.allclose((moved.vectors - f.vectors)[curve], common[curve, 3:])
        here, there = both.transformed(pose), moved.transformed(pose)
        assert np.allclose(here.moved_in_common.start, there.start, atol=1e-9 * pose.scale)
        assert np.allclose(here.moved_in_common.end, there.end, atol=1e-9 * pose.scale)

    def test_an_error_in_common_of_another_shape_is_refused(self):
        f = example_features()
        with pytest.raises(ValueError, match=r'common: expected shape \(4, 6\)'):
            replace(f, common=np.zeros((4, 3)))
        with pytest.raises(ValueError, match='common'):
            f.with_common(np.full((4, 6), np.nan))

    @fast
    @given(similarities)
    def test_transforming_there_and_back(self, pose):
        f = example_features()
        moved = f.transformed(pose)
        assert np.allclose(moved.lengths, f.lengths * np.where(f.kind == FeatureKind.CURVE, 1.0, pose.scale))
        back = moved.transformed(pose.inverse())
        for name in ('start', 'end', 'radii', 'err_per', 'major_axis'):
            assert np.allclose(getattr(back, name), getattr(f, name), atol=1e-8, equal_nan=True)

    def test_a_whole_circle_is_drawn_round_and_an_arc_as_far_as_it_goes(self):
        circle = FeatureSet.from_curves([[1.0, 2.0, 3.0]], [[0.0, 0.0, 2.0]], [[0.5, 0.5]]).polyline(0, 5)
        around = np.arctan2(*(circle[:, 1::-1] - [2.0, 1.0]).T)
        np.testing.assert_allclose(np.exp(1j * np.diff(around)), np.full(4, 1j), atol=1e-12)
        np.testing.assert_allclose(circle[0], circle[4], atol=1e-12)
        arc = FeatureSet([1], [[0, 0, 0]], [[0, 0, 1]], [[2.0, 1.0]], [0.0], [0.0], [[1, 0, 0]], [[0.0, np.pi / 2]])
        np.testing.assert_allclose(arc.polyline(0, 3), [[2, 0, 0], [2**0.5, 0.5**0.5, 0], [0, 1, 0]], atol=1e-12)

    def test_errors_are_zero_where_none_are_stated(self):
        for features in (
            FeatureSet.from_edges([[0, 0, 0]], [[1, 0, 0]]),
            FeatureSet.from_curves([[0, 0, 0]], [[0, 0, 1]], [[1, 1]]),
            FeatureSet.from_axes([[0, 0, 0]], [[1, 0, 0]]),
        ):
            assert features.err_par.tolist() == features.err_per.tolist() == [0.0]

    def test_every_kind_is_one_of_three_and_a_file_has_every_array(self, tmp_path):
        with pytest.raises(ValueError, match='kind: expected 0'):
            FeatureSet([0, 7], np.zeros((2, 3)), np.ones((2, 3)), np.ones((2, 2)), 0.0, 0.0)
        np.savez(tmp_path / 'bare.npz', kind=[0], start=[[0, 0, 0]])
        with pytest.raises(ValueError, match="bare.npz: not a feature file: no array named 'end'"):
            FeatureSet.load(tmp_path / 'bare.npz')

    def test_one_curve_without_a_radius_is_enough_to_be_refused(self):
        rows = np.zeros((2, 3)), np.tile([0.0, 0.0, 1.0], (2, 1))
        for radii in ([[1.0, 1.0], [1.0, 0.0]], [[1.0, 1.0], [np.nan, 1.0]], [[-1.0, 1.0], [1.0, 1.0]]):
            with pytest.raises(ValueError, match='radii: a CURVE needs two finite radii > 0'):
                FeatureSet([1, 1], *rows, radii, 0.0, 0.0)

    def test_an_empty_list_stands_for_no_rows_and_for_nothing_else(self):
        assert len(FeatureSet([], [], [], [], [], [])) == 0
        for name in ('start', 'end', 'radii', 'err_par', 'err_per'):
            values = {'kind': [0], 'start': [[0, 0, 0]], 'end': [[1, 0, 0]], 'radii': [[1, 1]], 'err_par': [0.0]}
            values |= {'err_per': [0.0], name: np.zeros((0, 3))}
            with pytest.raises(ValueError, match=f'{name}: expected shape'):
                FeatureSet(**values)

    def test_a_curve_is_drawn_on_its_ellipse(self):
        points = example_features().polyline(2, 5)
        assert np.allclose(points[:, 2], 1.0)
        assert np.allclose((points[:, 1] / 2.0) ** 2 + points[:, 0] ** 2, 1.0)
        # It starts half a radian from the major axis (+y), turning about +z towards -x.
        assert np.allclose(points[0], [-np.sin(0.5), 2 * np.cos(0.5), 1])

    def test_select_and_concatenate(self):
        f = example_features()
        assert FeatureSet.concatenate([f.select([0]), f.select([1, 2, 3])]) == f
        assert len(f.of_kind(FeatureKind.AXIS)) == 1
        assert len(FeatureSet.concatenate([])) == 0

    def test_files_round_trip_exactly(self, tmp_path):
        for f in (example_features(), FeatureSet.empty()):
            f.save(tmp_path / 'features.npz')
            assert FeatureSet.load(tmp_path / 'features.npz') == f

    def test_a_damaged_file_is_named(self, tmp_path):
        path = tmp_path / 'broken.npz'
        path.write_bytes(b'PK\x03\x04 not really')
        with pytest.raises(ValueError, match='broken.npz'):
            FeatureSet.load(path)

    @pytest.mark.parametrize(
        ('change', 'name'),
        [
            ({'end': [[0, 0, np.inf]]}, 'end'),
            ({'start': [[0, 0]]}, 'start'),
            ({'kind': [7]}, 'kind'),
            ({'kind': [1]}, 'radii'),
            ({'err_par': [-1.0]}, 'err_par'),
        ],
    )
    def test_misuse_names_the_array(self, change, name):
        values = {
            'kind': [0],
            'start': [[0, 0, 0]],
            'end': [[1, 0, 0]],
            'radii': [[np.nan, np.nan]],
            'err_par': [0],
            'err_per': [0],
        }
        with pytest.raises(ValueError, match=f'^{name}'):
            FeatureSet(**(values | change))

    def test_arrays_cannot_be_changed_behind_its_back(self):
        with pytest.raises(ValueError, match='read-only'):
            example_features().start[0] = 5


class TestInterpretation:
    def test_matched_is_counted(self):
        item = Interpretation('block', [0, -1, 3], [1, 0, -1], Pose())
        assert item.matched == 2 and item.accepted and list(item.data_indices) == [0, 2]
        nothing = Interpretation('block', [-1], [0], Pose(), symmetric_poses=[Pose()], rejected_reason='too few')
        assert nothing.matched == 0 and not nothing.accepted and nothing.symmetric_poses == (Pose(),)
        assert repr(nothing).endswith('rejected: too few)') and 'matched=0/1' in repr(nothing)

    @pytest.mark.parametrize(
        ('change', 'name'),
        [
            ({'sign': [1]}, 'sign'),
            ({'assignment': [0, -2]}, 'assignment'),
            ({'sign': [2, 0]}, 'sign'),
            ({'matched': 5}, 'matched'),
            ({'matched': 0}, 'matched'),
            ({'assignment': [[0, -1]], 'sign': [[1, 0]]}, 'assignment'),
            ({'covariance': np.eye(3)}, 'covariance'),
        ],
    )
    def test_misuse_names_the_field(self, change, name):
        values = {'model': 'm', 'assignment': [0, -1], 'sign': [1, 0], 'pose': Pose()}
        with pytest.raises(ValueError, match=f'^{name}'):
            Interpretation(**(values | change))
