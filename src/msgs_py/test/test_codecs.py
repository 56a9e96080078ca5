"""Every codec: exact round trips, and one clear error for every damaged message."""

from __future__ import annotations

import array
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('sensor_msgs.msg', reason='needs ROS 2 message classes')

from geometry_msgs.msg import Pose as PoseMessage
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from sensor_msgs.msg import CameraInfo, Image, PointField
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from msgs_py import FeatureSet, Interpretation, LensDistortion, PinholeCamera, Pose, StereoRig, codecs
from msgs_py.numeric.covariances import upper_triangles

fast = settings(max_examples=40, deadline=None)
finite = st.floats(-1e3, 1e3, allow_nan=False)
HEADER = Header(frame_id='cam_left_optical_frame')
HEADER.stamp.sec, HEADER.stamp.nanosec = 12, 34

DTYPES = {'mono8': np.uint8, 'rgb8': np.uint8, 'bgr8': np.uint8, 'mono16': np.uint16, '32FC1': np.float32}


@st.composite
def images(draw):
    encoding = draw(st.sampled_from(sorted(DTYPES)))
    shape = (draw(st.integers(1, 9)), draw(st.integers(1, 9))) + ((3,) if encoding in ('rgb8', 'bgr8') else ())
    if encoding == '32FC1':
        elements = st.floats(width=32, allow_nan=True)
    else:
        elements = st.integers(0, np.iinfo(DTYPES[encoding]).max)
    return encoding, draw(hnp.arrays(DTYPES[encoding], shape, elements=elements))


@st.composite
def covariances(draw, n):
    """Of n features, some unknown; None for all."""
    if draw(st.booleans()):
        return None
    mix = draw(hnp.arrays(np.float64, (n, 6, 6), elements=st.floats(-1e-2, 1e-2)))
    result = mix @ mix.swapaxes(1, 2)
    result[draw(hnp.arrays(bool, (n,)))] = np.nan
    return result


@st.composite
def feature_sets(draw):
    n_edges, n_curves, n_axes = (draw(st.integers(0, 4)) for _ in range(3))

    def rows(n, columns, elements=finite):
        return draw(hnp.arrays(np.float64, (n, columns), elements=elements))

    errors = draw(hnp.arrays(np.float64, (n_edges,), elements=st.floats(0, 1)))
    normals = np.concatenate([rows(n_curves, 2), np.ones((n_curves, 1))], axis=1)
    return FeatureSet.concatenate(
        [
            FeatureSet.from_edges(rows(n_edges, 3), rows(n_edges, 3), errors, errors / 2, draw(covariances(n_edges))),
            FeatureSet.from_curves(
                rows(n_curves, 3),
                normals,
                rows(n_curves, 2, st.floats(1e-3, 10)),
                covariance=draw(covariances(n_curves)),
            ),
            FeatureSet.from_axes(rows(n_axes, 3), rows(n_axes, 3), covariance=draw(covariances(n_axes))),
        ]
    )


poses = st.builds(
    lambda r, t: Pose.from_rotation_vector(r, t), st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(finite, finite, finite)
)


class TestImages:
    @fast
    @given(images(), st.integers(0, 5), st.booleans(), st.booleans())
    def test_round_trip_with_padded_rows_and_either_byte_order(self, image, padding, swap, cut_last_padding):
        encoding, pixels = image
        message = codecs.array_to_image(pixels, encoding, HEADER)
        assert message.header == HEADER and message.step * message.height == len(message.data)
        data = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
        if swap:
            size = pixels.dtype.itemsize
            data = data.reshape(message.height, -1, size)[:, :, ::-1].reshape(message.height, -1)
            message.is_bigendian = 1 - message.is_bigendian
        data = np.pad(data, ((0, 0), (0, padding)), constant_values=77)
        message.step += padding
        raw = data.tobytes()
        message.data = array.array('B', raw[: len(raw) - padding] if cut_last_padding and padding else raw)
        back, found = codecs.image_to_array(message)
        assert found == encoding and back.dtype == pixels.dtype
        assert np.array_equal(back, pixels, equal_nan=encoding == '32FC1')

    def test_colour_to_grey_uses_the_channel_order(self):
        pixels = np.zeros((1, 3, 3), np.uint8)
        pixels[0, 0, 0] = pixels[0, 1, 1] = pixels[0, 2, 2] = 255
        assert codecs.gray_from_image(codecs.array_to_image(pixels, 'rgb8')).tolist() == [[76, 150, 29]]
        assert codecs.gray_from_image(codecs.array_to_image(pixels, 'bgr8')).tolist() == [[29, 150, 76]]

    @pytest.mark.parametrize(
        ('change', 'text'),
        [
            ({'encoding': 'yuv422'}, 'image.encoding'),
            ({'data': array.array('B', [1, 2, 3])}, 'image.data'),
            ({'step': 3}, 'image.step'),
            ({'width': 0}, 'image.height, image.width'),
            ({'height': 2**20}, 'image.data'),
            ({'data': array.array('B')}, 'image.data'),
        ],
    )
    def test_damage_is_named(self, change, text):
        message = codecs.array_to_image(np.zeros((4, 4), np.uint8), 'mono8')
        for name, value in change.items():
            setattr(message, name, value)
        with pytest.raises(codecs.CodecError, match=text):
            codecs.image_to_array(message)

    @pytest.mark.parametrize(
        ('pixels', 'encoding'),
        [
            (np.zeros((2, 2)), 'mono8'),
            (np.zeros((2, 2, 3), np.uint8), 'mono8'),
            (np.zeros((2, 2), np.uint8), 'rgb8'),
            (np.zeros((2, 2), np.uint8), 'jpeg'),
        ],
    )
    def test_an_array_that_does_not_fit_its_encoding_is_refused(self, pixels, encoding):
        with pytest.raises(codecs.CodecError):
            codecs.array_to_image(pixels, encoding)

    def test_a_depth_image_is_no_grey_image(self):
        with pytest.raises(codecs.CodecError, match='32FC1'):
            codecs.gray_from_image(codecs.array_to_image(np.zeros((2, 2), np.float32), '32FC1'))


class TestCameraInfo:
    @fast
    @given(st.floats(10, 5000), st.floats(10, 5000), st.floats(1e-3, 10), st.floats(-50, 50))
    def test_round_trip_and_the_sign_of_the_baseline(self, fx, fy, baseline, offset):
        left = PinholeCamera(640, 480, fx, fy, 300.0, 200.0)
        rig = StereoRig(left, PinholeCamera(640, 480, fx, fy, 300.0 + offset, 200.0), baseline)
        infos = codecs.camera_infos_from_rig(rig, HEADER)
        assert infos[0].p[3] == 0.0 and infos[1].p[3] == -fx * baseline
        assert infos[1].header == HEADER and infos[0].k[0] == fx and infos[0].distortion_model == 'plumb_bob'
        back = codecs.rig_from_camera_infos(*infos)
        assert back.left == rig.left and back.right == rig.right
        assert back.baseline == pytest.approx(baseline, rel=1e-12)

    def test_a_raw_pair_says_what_its_lenses_do(self):
        rig = StereoRig.symmetric(PinholeCamera.centred(64, 64, 100.0), 0.1)
        lens = LensDistortion('equidistant', (0.1, 0.2, 0.3, 0.4))
        left, right = codecs.camera_infos_from_rig(rig, HEADER, (lens, None))
        assert left.distortion_model == 'equidistant' and list(left.d) == [0.1, 0.2, 0.3, 0.4]
        assert right.distortion_model == 'plumb_bob' and list(right.d) == [0.0] * 5
        assert codecs.rig_from_camera_infos(left, right) == rig

    @pytest.mark.parametrize(
        ('offset', 'text'), [(0.0, 'baseline is missing'), (35.0, 'wrong sign'), (np.nan, 'NaN'), (-np.inf, 'infinity')]
    )
    def test_a_wrong_or_missing_baseline_is_refused_by_name(self, offset, text):
        rig = StereoRig.symmetric(PinholeCamera.centred(64, 64, 100.0), 0.1)
        left, right = codecs.camera_infos_from_rig(rig)
        right.p[3] = offset
        with pytest.raises(codecs.CodecError, match='right camera_info: .*' + text):
            codecs.rig_from_camera_infos(left, right)

    def test_exchanged_cameras_are_named_as_such(self):
        left, right = codecs.camera_infos_from_rig(StereoRig.symmetric(PinholeCamera.centred(64, 64, 100.0), 0.1))
        with pytest.raises(codecs.CodecError, match='left camera_info.*exchanged'):
            codecs.rig_from_camera_infos(right, left)

    def test_an_uncalibrated_camera_is_named_as_such(self):
        with pytest.raises(codecs.CodecError, match='left camera_info.*uncalibrated'):
            codecs.rig_from_camera_infos(CameraInfo(), CameraInfo())


class TestFeatures:
    @fast
    @given(feature_sets())
    def test_round_trip_is_exact(self, features):
        cloud = codecs.features_to_cloud(features, HEADER)
        assert cloud.width == len(features) and cloud.header == HEADER
        assert codecs.cloud_to_features(cloud) == features

    @fast
    @given(feature_sets())
    def test_clouds_without_covariances_are_read_and_those_with_them_by_who_knows_none(self, features):
        cloud = codecs.features_to_cloud(features)
        names = [field.name for field in cloud.fields]
        assert names[:19] == ['x', 'y', 'z', 'kind', *(n for n in names[4:19] if not n.startswith('cov'))]
        assert names[19:21] == ['cov_sx_sx', 'cov_sx_sy'] and len(names) == 40 and len(set(names)) == 40
        cloud.fields = [field for field in cloud.fields if not field.name.startswith('cov')]
        back = codecs.cloud_to_features(cloud)
        assert not back.has_covariance.any()
        assert back == replace(features, covariance=None)

    @fast
    @given(feature_sets(), st.integers(0, 2**32 - 1))
    def test_what_features_have_in_common_travels_with_them(self, features, seed):
        common = np.random.default_rng(seed).normal(size=(len(features), 6))
        features = replace(features, common=common)
        cloud = codecs.features_to_cloud(features)
        names = [field.name for field in cloud.fields]
        assert names[40:] == (
            ['common_sx', 'common_sy', 'common_sz', 'common_ex', 'common_ey', 'common_ez'] if len(features) else []
        )
        assert codecs.cloud_to_features(cloud) == features
        # Who knows none of it reads the rest.
        cloud.fields = [field for field in cloud.fields if not field.name.startswith('common')]
        assert codecs.cloud_to_features(cloud) == replace(features, common=None)

    @fast
    @given(feature_sets(), st.binary(min_size=1, max_size=200), st.integers(0, 10_000))
    def test_what_is_written_over_a_cloud_is_one_clear_error_or_features(self, features, noise, at):
        cloud = codecs.features_to_cloud(features)
        data = bytearray(cloud.data.tobytes())
        at = at % (len(data) + 1)
        data[at : at + len(noise)] = noise[: len(data) - at]
        cloud.data = array.array('B', bytes(data))
        try:
            assert len(codecs.cloud_to_features(cloud)) == len(features)
        except codecs.CodecError as error:
            assert str(error).startswith('features.')

    def test_covariances_of_32_bits_are_read(self):
        mix = np.random.default_rng(1).normal(size=(2, 6, 6)) * 1e-3
        features = FeatureSet.from_edges(
            [[0, 1, 2], [3, 4, 5]], [[1, 1, 1], [2, 2, 2]], covariance=mix @ mix.swapaxes(1, 2)
        )
        cloud = codecs.features_to_cloud(features)
        offset = cloud.point_step
        rows = np.frombuffer(cloud.data, np.uint8).reshape(2, -1)
        covariance = upper_triangles(features.covariance).astype('<f4')
        wide = np.hstack([rows, np.ascontiguousarray(covariance).view(np.uint8).reshape(2, -1)])
        for k, field in enumerate(f for f in cloud.fields if f.name.startswith('cov')):
            field.offset, field.datatype = offset + 4 * k, PointField.FLOAT32
        cloud.point_step, cloud.row_step = wide.shape[1], wide.size
        cloud.data = array.array('B', wide.tobytes())
        assert np.allclose(codecs.cloud_to_features(cloud).covariance, features.covariance, rtol=1e-6, atol=1e-12)

    def test_a_covariance_that_is_none_is_named(self):
        cloud = codecs.features_to_cloud(FeatureSet.from_edges([[0, 0, 0]], [[1, 0, 0]], covariance=np.eye(6)[None]))
        offset = next(field.offset for field in cloud.fields if field.name == 'cov_sy_sy')
        data = bytearray(cloud.data.tobytes())
        data[offset : offset + 8] = np.float64(-1.0).tobytes()
        cloud.data = array.array('B', bytes(data))
        with pytest.raises(codecs.CodecError, match='features.data: covariance: feature 0: not positive semidefinite'):
            codecs.cloud_to_features(cloud)

    def test_decoding_goes_by_name_with_padding_rows_and_byte_order(self):
        features = FeatureSet.from_edges([[0, 1, 2], [3, 4, 5]], [[1, 1, 1], [2, 2, 2]], 0.5, 0.25)
        cloud = codecs.features_to_cloud(features)
        dtype = np.dtype(
            {
                'names': [f.name for f in cloud.fields],
                'formats': [{7: '<f4', 2: 'u1', 8: '<f8'}[f.datatype] for f in cloud.fields],
                'offsets': [f.offset for f in cloud.fields],
                'itemsize': cloud.point_step,
            }
        )
        rows = np.frombuffer(cloud.data, dtype)
        keep = [n for n in reversed(dtype.names) if not n.startswith(('major', 'arc', 'cov'))]
        big = np.zeros((2, 1), np.dtype([(n, dtype[n].newbyteorder('>')) for n in keep]))
        for name in keep:
            big[name][:, 0] = rows[name]
        offsets = {n: big.dtype.fields[n][1] for n in keep}
        cloud.fields = [f for f in cloud.fields if f.name in keep]
        for f in cloud.fields:
            f.offset = offsets[f.name]
        cloud.is_bigendian, cloud.height, cloud.width = True, 2, 1
        cloud.point_step, cloud.row_step = big.dtype.itemsize, big.dtype.itemsize + 5
        cloud.data = array.array('B', b''.join(row.tobytes() + b'xxxxx' for row in big))
        assert codecs.cloud_to_features(cloud) == features

    @pytest.mark.parametrize(
        ('damage', 'text'),
        [
            (lambda c: setattr(c, 'data', c.data[:-1]), 'features.data'),
            (lambda c: setattr(c, 'fields', [f for f in c.fields if f.name != 'end_y']), 'end_y'),
            (lambda c: setattr(c, 'fields', []), 'no field'),
            (lambda c: setattr(c, 'point_step', 8), 'point_step'),
            (lambda c: setattr(c, 'row_step', 8), 'row_step'),
            (lambda c: setattr(c.fields[3], 'datatype', 99), 'datatype'),
            (lambda c: setattr(c, 'data', array.array('B', b'\xff' * len(c.data))), 'features.data'),
        ],
    )
    def test_damage_is_named(self, damage, text):
        cloud = codecs.features_to_cloud(FeatureSet.from_edges([[0, 1, 2]], [[1, 1, 1]]))
        damage(cloud)
        with pytest.raises(codecs.CodecError, match=text):
            codecs.cloud_to_features(cloud)


class TestPoses:
    @fast
    @given(poses)
    def test_round_trip(self, pose):
        error = pose.error_to(codecs.pose_from_message(codecs.pose_to_message(pose)))
        assert error.rotation < 1e-12 and error.translation == 0.0
        assert codecs.pose_to_stamped(pose, HEADER).header == HEADER

    def test_arrays_keep_their_order(self):
        given_poses = [Pose(translation=[i, 0, 0]) for i in range(3)]
        message = codecs.poses_to_array(given_poses, HEADER)
        assert [p.translation[0] for p in codecs.array_to_poses(message)] == [0, 1, 2]
        assert codecs.array_to_poses(codecs.poses_to_array([], HEADER)) == []

    def test_an_unset_orientation_is_refused(self):
        message = PoseMessage()
        message.orientation.w = 0.0
        with pytest.raises(codecs.CodecError, match='pose.quaternion'):
            codecs.pose_from_message(message)


class TestMarkersAndReports:
    @fast
    @given(feature_sets())
    def test_markers_have_one_list_a_kind_and_begin_by_clearing(self, features):
        markers = codecs.features_to_markers(features, HEADER, 'data').markers
        assert markers[0].action == Marker.DELETEALL
        assert len(markers) == 1 + len(np.unique(features.kind))
        for marker in markers[1:]:
            assert marker.header == HEADER and marker.type == Marker.LINE_LIST and len(marker.points) % 2 == 0
        edges = [m for m in markers if m.ns == 'data/edge']
        straight = features.select(np.flatnonzero(features.kind == 0))
        assert [[[p.x, p.y, p.z] for p in m.points] for m in edges] == (
            [np.stack([straight.start, straight.end], axis=1).reshape(-1, 3).tolist()] if len(straight) else []
        )

    @fast
    @given(
        st.lists(st.tuples(st.integers(-1, 5), st.integers(-1, 1)), max_size=6),
        poses,
        st.booleans(),
        st.floats(0, 1),
        st.booleans(),
    )
    def test_report_round_trip(self, pairs, pose, accepted, residual, with_covariance):
        item = Interpretation(
            'chair',
            [a for a, _ in pairs],
            [s for _, s in pairs],
            pose,
            residual_rms=residual,
            covariance=np.diag(np.arange(6.0)) if with_covariance else None,
            symmetric_poses=(pose, pose.inverse()),
            proven=accepted,
            rejected_reason=None if accepted else 'edge 3 is 2 mm away',
            free_shift=None if accepted else [0.0, 0.6, 0.8],
            free_turn=[0.6, 0.0, 0.8] if accepted else None,
            note='free to turn' if accepted else None,
            evidence=12.5 if accepted else float('nan'),
            support=residual,
            chance=residual,
            ambiguous_poses=(pose.inverse(),),
        )
        (back,) = codecs.interpretations_from_report(codecs.report_from_interpretations([item], HEADER))
        for name in ('assignment', 'sign'):
            assert np.array_equal(getattr(back, name), getattr(item, name))
        for name in (
            'model',
            'pose',
            'matched',
            'residual_rms',
            'symmetric_poses',
            'ambiguous_poses',
            'proven',
            'rejected_reason',
            'note',
            'support',
            'chance',
        ):
            assert getattr(back, name) == getattr(item, name)
        assert (back.covariance is None) == (item.covariance is None)
        assert np.array_equal(back.free_shift, item.free_shift)
        assert np.array_equal(back.free_turn, item.free_turn)
        assert np.array_equal(back.evidence, item.evidence, equal_nan=True)

    def test_a_report_from_before_free_turns_and_notes_is_read(self):
        report = codecs.report_from_interpretations([Interpretation('m', [0], [1], Pose(), note='new')])
        later = ('free_turn', 'note', 'evidence', 'support', 'chance', 'ambiguous_poses')
        report.status[0].values = [v for v in report.status[0].values if v.key not in later]
        (back,) = codecs.interpretations_from_report(report)
        assert back.free_turn is None and back.note is None and back.ambiguous_poses == ()
        assert np.isnan([back.evidence, back.support, back.chance]).all()

    def test_a_damaged_report_names_status_and_key(self):
        report = codecs.report_from_interpretations([Interpretation('m', [0], [1], Pose())])
        report.status[0].values = [v for v in report.status[0].values if v.key != 'pose']
        with pytest.raises(codecs.CodecError, match=r"status\[0\].*'pose'"):
            codecs.interpretations_from_report(report)


def test_message_memory_is_an_array_of_bytes():
    message = codecs.array_to_image(np.zeros((4, 4), np.uint8), 'mono8')
    assert isinstance(message, Image) and isinstance(message.data, array.array)


def test_poses_become_transforms_of_the_header_s_frame():
    pose = Pose.from_rotation_vector([0.1, -0.2, 0.3], [1.0, 2.0, 3.0])
    transforms = codecs.poses_to_transforms({'part': pose, 'other': pose.inverse()}, HEADER)
    assert [(t.header, t.child_frame_id) for t in transforms] == [(HEADER, 'part'), (HEADER, 'other')]
    v, q = transforms[0].transform.translation, transforms[0].transform.rotation
    back = Pose.from_quaternion((q.x, q.y, q.z, q.w), (v.x, v.y, v.z))
    assert back.error_to(pose).rotation < 1e-12 and back.error_to(pose).translation < 1e-12
