"""What other programs see of the codecs: names, numbers and order, written out here and not taken from the code."""

from __future__ import annotations

import json
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('sensor_msgs.msg', reason='needs ROS 2 message classes')

from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseArray
from sensor_msgs.msg import Image, PointField
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from msgs_py import FeatureSet, Interpretation, PinholeCamera, Pose, StereoRig, codecs
from msgs_py.shapes import CollisionShapes, MeshShape, PrimitiveShape

HEADER = Header(frame_id='optical')
HEADER.stamp.sec = 7
# Twice as large, a quarter turn about z.
POSE = Pose(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([1.0, 2.0, 3.0]), 2.0)
AWAY = Pose(translation=np.array([0.5, 0.0, 0.25]))


def numbers(message):
    """Position and orientation of a Pose."""
    p, q = message.position, message.orientation
    return [p.x, p.y, p.z], [q.x, q.y, q.z, q.w]


def assert_pose(message, place, turn=(0.0, 0.0, 0.0, 1.0)):
    np.testing.assert_allclose(np.concatenate(numbers(message)), [*place, *turn], atol=1e-12)


QUARTER = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))


# -- features ------------------------------------------------------------------------------------------------------

FIELDS = [
    'x', 'y', 'z', 'kind', 'start_x', 'start_y', 'start_z', 'end_x', 'end_y', 'end_z', 'radius_major',
    'radius_minor', 'err_par', 'err_per', 'major_x', 'major_y', 'major_z', 'arc_start', 'arc_sweep', 'cov_sx_sx',
    'cov_sx_sy', 'cov_sx_sz', 'cov_sx_ex', 'cov_sx_ey', 'cov_sx_ez', 'cov_sy_sy', 'cov_sy_sz', 'cov_sy_ex',
    'cov_sy_ey', 'cov_sy_ez', 'cov_sz_sz', 'cov_sz_ex', 'cov_sz_ey', 'cov_sz_ez', 'cov_ex_ex', 'cov_ex_ey',
    'cov_ex_ez', 'cov_ey_ey', 'cov_ey_ez', 'cov_ez_ez',
]  # fmt: skip


def test_the_cloud_has_the_fields_of_the_readme_in_their_order():
    covariance = np.diag(np.arange(1.0, 7.0))[None] * 1e-6
    features = FeatureSet.from_edges([[0, 1, 2]], [[4, 5, 8]], 0.5, 0.25, covariance)
    cloud = codecs.features_to_cloud(features, HEADER)
    assert [field.name for field in cloud.fields] == FIELDS
    kinds = dict.fromkeys(FIELDS, PointField.FLOAT64)
    kinds |= dict.fromkeys('xyz', PointField.FLOAT32) | {'kind': PointField.UINT8}
    assert {field.name: field.datatype for field in cloud.fields} == kinds
    assert all(field.count == 1 for field in cloud.fields)
    assert [field.offset for field in cloud.fields] == [0, 4, 8, 12, *(16 + 8 * k for k in range(36))]
    assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (1, 1, 304, 304)
    assert cloud.is_dense and not cloud.is_bigendian and cloud.header == HEADER and len(cloud.data) == 304
    assert np.frombuffer(cloud.data, '<f4', 3).tolist() == [2.0, 3.0, 5.0], 'the middle'
    values = np.frombuffer(cloud.data, '<f8', 36, 16)
    assert values[:6].tolist() == [0, 1, 2, 4, 5, 8] and np.isnan(values[6:8]).all()
    assert values[8:10].tolist() == pytest.approx([features.err_par[0], features.err_per[0]])
    np.testing.assert_allclose(values[[15, 21, 26, 30, 33, 35]], 1e-6 * np.arange(1.0, 7.0))


@pytest.mark.parametrize(
    ('code', 'kind', 'value'),
    [
        (PointField.INT8, 'i1', 2),
        (PointField.INT16, 'i2', 2),
        (PointField.UINT16, 'u2', 2),
        (PointField.INT32, 'i4', 2),
        (PointField.UINT32, 'u4', 2),
        (PointField.FLOAT32, 'f4', 2.0),
        (PointField.FLOAT64, 'f8', 2.0),
    ],
)
def test_a_kind_may_have_any_type_of_number(code, kind, value):
    """Another writer's cloud: its kind stands behind all the rest."""
    features = FeatureSet.from_axes([[0, 1, 2]], [[4, 5, 8]])
    cloud = codecs.features_to_cloud(features)
    field = cloud.fields[3]
    field.offset, field.datatype = cloud.point_step, code
    more = np.array([value], kind).tobytes()
    cloud.data.frombytes(more)
    cloud.point_step += len(more)
    cloud.row_step = cloud.point_step
    assert codecs.cloud_to_features(cloud) == features


@pytest.mark.parametrize(
    ('missing', 'attribute'),
    [(('major_x', 'major_y', 'major_z'), 'major_axis'), (('major_y',), 'major_axis'), (('arc_sweep',), 'arc')],
)
def test_what_a_cloud_lacks_a_part_of_it_lacks_whole(missing, attribute):
    given = {'major_axis': [[0.6, 0.8, 0.0]], 'arc': [[0.5, 1.0]]}
    bare = FeatureSet([1], [[0, 1, 2]], [[0, 1, 3]], [[0.5, 0.25]], [0.0], [0.0])
    features = FeatureSet([1], [[0, 1, 2]], [[0, 1, 3]], [[0.5, 0.25]], [0.0], [0.0], **given)
    cloud = codecs.features_to_cloud(features)
    cloud.fields = [field for field in cloud.fields if field.name not in missing]
    back = codecs.cloud_to_features(cloud)
    for name in given:
        np.testing.assert_allclose(getattr(back, name), getattr(bare if name == attribute else features, name))


# -- images -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('encoding', 'name', 'kind', 'channels'),
    [('8UC1', 'mono8', 'u1', 1), ('8UC3', 'bgr8', 'u1', 3), ('16UC1', 'mono16', 'u2', 1), ('32FC1', '32FC1', 'f4', 1)],
)
def test_an_image_as_opencv_users_publish_it(encoding, name, kind, channels):
    pixels = np.arange(2 * 3 * channels).reshape((2, 3, 3) if channels == 3 else (2, 3)).astype(f'>{kind}')
    message = Image(height=2, width=3, encoding=encoding, is_bigendian=1, step=3 * channels * pixels.itemsize)
    message.data.frombytes(pixels.tobytes())
    back, found = codecs.image_to_array(message)
    assert found == name and back.dtype == np.dtype(kind) and np.array_equal(back, pixels)


def test_an_image_is_written_without_padding():
    message = codecs.array_to_image(np.arange(12, dtype=np.uint16).reshape(3, 4), 'mono16', HEADER)
    assert (message.height, message.width, message.step, message.encoding) == (3, 4, 8, 'mono16')
    assert message.is_bigendian == (sys.byteorder == 'big') and message.header == HEADER
    assert np.frombuffer(message.data, np.uint16).tolist() == list(range(12))
    assert codecs.gray_from_image(codecs.array_to_image(np.array([[511, 65535]], np.uint16), 'mono16')).tolist() == [
        [1, 255]
    ]


@pytest.mark.parametrize(
    ('pixels', 'encoding', 'text'),
    [
        (np.zeros((2, 2, 4), np.uint8), 'rgb8', r'shape \(2, 2, 4\), expected shape \(h, w, 3\) for rgb8'),
        (np.zeros((2, 2), np.uint8), 'rgb8', r'expected shape \(h, w, 3\)'),
        (np.zeros((2, 2, 1), np.uint8), 'mono8', r'shape \(2, 2, 1\), expected shape \(h, w\) for mono8'),
        (np.zeros((2, 2), np.int16), 'mono16', 'int16, expected uint16'),
        (np.zeros((2, 2), np.uint8), 'jpeg', "'jpeg' is unknown, expected one of mono8"),
    ],
)
def test_what_does_not_fit_an_encoding_is_told(pixels, encoding, text):
    with pytest.raises(codecs.CodecError, match=text):
        codecs.array_to_image(pixels, encoding)


# -- cameras ----------------------------------------------------------------------------------------------------------


def test_camera_info_has_the_matrices_of_its_page():
    rig = StereoRig(PinholeCamera(64, 48, 90.0, 91.0, 31.0, 22.0), PinholeCamera(64, 48, 90.0, 91.0, 33.0, 22.0), 0.1)
    left, right = codecs.camera_infos_from_rig(rig, HEADER)
    assert (left.width, left.height, list(left.d), left.distortion_model) == (64, 48, [0.0] * 5, 'plumb_bob')
    assert list(left.k) == [90, 0, 31, 0, 91, 22, 0, 0, 1] and list(right.k) == [90, 0, 33, 0, 91, 22, 0, 0, 1]
    assert list(left.r) == list(right.r) == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    assert list(left.p) == [90, 0, 31, 0, 0, 91, 22, 0, 0, 0, 1, 0]
    assert list(right.p) == [90, 0, 33, -9.0, 0, 91, 22, 0, 0, 0, 1, 0]
    assert left.header == right.header == HEADER
    assert codecs.camera_infos_from_rig(rig)[0].header == Header()


# -- poses ------------------------------------------------------------------------------------------------------------


def test_poses_are_written_with_their_quaternion_and_header():
    assert_pose(codecs.pose_to_message(POSE), [1, 2, 3], QUARTER)
    covariance = np.arange(36.0).reshape(6, 6)
    stamped = codecs.pose_with_covariance_stamped(POSE, covariance, HEADER)
    assert stamped.header == HEADER and stamped.pose.covariance.tolist() == list(range(36))
    assert_pose(stamped.pose.pose, [1, 2, 3], QUARTER)
    unknown = codecs.pose_with_covariance_stamped(POSE, None)
    assert not unknown.pose.covariance.any() and unknown.header == Header()
    for made in (codecs.pose_to_stamped(POSE, HEADER), codecs.poses_to_array([POSE], HEADER)):
        assert made.header == HEADER
    assert codecs.pose_to_stamped(POSE).header == codecs.poses_to_array([]).header == Header()
    assert_pose(codecs.poses_to_array([AWAY, POSE]).poses[1], [1, 2, 3], QUARTER)


def test_a_pose_that_is_none_is_refused_in_an_array_too():
    broken = PoseMessage()
    broken.position.x = np.nan
    with pytest.raises(codecs.CodecError, match='pose.translation'):
        codecs.array_to_poses(PoseArray(poses=[broken]))


def test_messages_that_do_not_come_with_the_wheels_are_found_where_they_are_installed(monkeypatch):
    for package, ask in (
        ('tf2_msgs', codecs.transform_message_type),
        ('vision_msgs', codecs.detection_messages),
        ('moveit_msgs', codecs.collision_messages),
    ):
        module = ModuleType(f'{package}.msg')
        module.TFMessage = int
        monkeypatch.setitem(sys.modules, package, ModuleType(package))
        monkeypatch.setitem(sys.modules, f'{package}.msg', module)
        assert ask() is (int if package == 'tf2_msgs' else module)
        monkeypatch.setitem(sys.modules, f'{package}.msg', None)  # as when it is not installed
        assert ask() is None


# -- markers ----------------------------------------------------------------------------------------------------------


def test_markers_of_features_have_colours_and_places():
    features = FeatureSet.concatenate(
        [
            FeatureSet.from_axes([[0, 0, 1]], [[0, 0, 2]]),
            FeatureSet.from_edges([[0, 1, 2], [1, 1, 1]], [[4, 5, 8], [2, 2, 2]]),
            FeatureSet.from_curves([[0, 0, 1]], [[0, 0, 1]], [[0.5, 0.5]]),
        ]
    )
    first, *rest = codecs.features_to_markers(features, HEADER, 'data', width=0.25).markers
    assert (first.action, first.ns, first.id, first.header) == (Marker.DELETEALL, 'data', 0, HEADER)
    told = [(m.ns, m.id, m.action, m.type, m.scale.x, m.pose.orientation.w, len(m.points)) for m in rest]
    lines = (Marker.ADD, Marker.LINE_LIST, 0.25, 1.0)
    assert told == [('data/edge', 0, *lines, 4), ('data/curve', 1, *lines, 94), ('data/axis', 2, *lines, 2)]
    colours = [[m.color.r, m.color.g, m.color.b, m.color.a] for m in rest]
    np.testing.assert_allclose(colours, [[0.1, 0.8, 0.2, 1], [0.2, 0.5, 1, 1], [1, 0.6, 0.1, 1]], atol=1e-6)
    ends = [[p.x, p.y, p.z] for p in rest[0].points]
    assert ends == [[0, 1, 2], [4, 5, 8], [1, 1, 1], [2, 2, 2]]
    circle = np.array([[p.x, p.y, p.z] for p in rest[1].points])
    np.testing.assert_allclose(np.hypot(*circle[:, :2].T), 0.5)
    np.testing.assert_allclose(circle[1:-1:2], circle[2::2])  # each line begins where the last one ended
    (only,) = codecs.features_to_markers(features.select([0]), clear=False, colours={2: (1.0, 0.0, 0.0)}).markers
    assert only.ns == 'features/axis' and only.color.g == 0.0 and only.scale.x == 0.001


# -- reports ----------------------------------------------------------------------------------------------------------


def test_a_report_reads_as_its_page_says():
    pose = Pose(translation=[1.0, 2.0, 3.0])
    good = Interpretation(
        'chair', [0, -1, 4, 5], [1, 0, -1, 1], pose, residual_rms=0.25, support=0.5, free_turn=[0, 0, 1]
    )
    bad = Interpretation('table', [2], [1], Pose(), rejected_reason='no edge there', covariance=np.eye(6))
    report = codecs.report_from_interpretations([good, bad], HEADER, ['chair/3'])
    assert report.header == HEADER and codecs.report_from_interpretations([]).header == Header()
    first, second = report.status
    assert (first.name, first.message, first.level) == ('chair', 'accepted', b'\x00')
    assert (second.name, second.message, second.level) == ('table', 'no edge there', b'\x01')
    values = {item.key: json.loads(item.value) for item in first.values}
    identity = np.eye(3).tolist()
    assert values == {
        'matched': 3,
        'score': 0.75,
        'residual_rms_m': 0.25,
        'assignment': [0, -1, 4, 5],
        'sign': [1, 0, -1, 1],
        'pose': {'rotation': identity, 'translation': [1.0, 2.0, 3.0], 'scale': 1.0},
        'covariance': None,
        'symmetric_poses': [],
        'proven': False,
        'free_shift': None,
        'free_turn': [0.0, 0.0, 1.0],
        'note': None,
        'evidence': None,
        'support': 0.5,
        'chance': None,
        'ambiguous_poses': [],
        'instance': 'chair/3',
    }
    told = {item.key: json.loads(item.value) for item in second.values}
    assert 'instance' not in told and told['covariance'] == np.eye(6).tolist()
    empty = codecs.report_from_interpretations([Interpretation('m', [], [], Pose())])
    assert {item.key: item.value for item in empty.status[0].values}['score'] == '0.0'


def test_a_value_of_a_report_that_is_no_number_is_named():
    report = codecs.report_from_interpretations([Interpretation('m', [0], [1], Pose())] * 2)
    value = next(item for item in report.status[1].values if item.key == 'sign')
    for text in ('[', '["a"]'):
        value.value = text
        with pytest.raises(codecs.CodecError, match=r'^report.status\[1\]: '):
            codecs.interpretations_from_report(report)


# -- what stands in for vision_msgs and moveit_msgs: classes that keep what they are given ----------------------------


class Kept(SimpleNamespace):
    ADD, REMOVE = b'\0', b'\1'


KEPT = SimpleNamespace(
    **dict.fromkeys(
        ('Detection3DArray', 'Detection3D', 'BoundingBox3D', 'ObjectHypothesisWithPose', 'ObjectHypothesis'), Kept
    ),
    CollisionObject=type(
        'CollisionObject',
        (Kept,),
        {'__init__': lambda self, **given: Kept.__init__(self, type=SimpleNamespace(key=''), **given)},
    ),
)


def test_a_detection_has_the_box_of_its_model():
    low, high = np.array([0.0, 0.0, -1.0]), np.array([2.0, 4.0, 5.0])
    given = [codecs.Detection('chair', 'chair/1', score, POSE, np.eye(6), low, high) for score in (0.75, -0.5, 1.5)]
    made = codecs.detections_to_message(given, HEADER, KEPT)
    assert made.header == HEADER and len(made.detections) == 3
    first = made.detections[0]
    (found,) = first.results
    assert (first.id, first.header, found.hypothesis.class_id) == ('chair/1', HEADER, 'chair')
    assert [one.results[0].hypothesis.score for one in made.detections] == [0.75, 0.0, 1.0]
    assert_pose(found.pose.pose, [1, 2, 3], QUARTER)
    assert found.pose.covariance.tolist() == np.eye(6).ravel().tolist()
    # The middle (1, 2, 2) is turned to (-2, 1, 2), twice as far, and moved.
    assert_pose(first.bbox.center, [1 - 4, 2 + 2, 3 + 4], QUARTER)
    assert [first.bbox.size.x, first.bbox.size.y, first.bbox.size.z] == [4.0, 8.0, 12.0]


def test_poses_that_an_object_may_have_instead_are_hypotheses_that_share_its_score():
    one = codecs.Detection('box', 'box/1', 0.75, POSE, np.eye(6), np.zeros(3), np.ones(3), (AWAY, Pose.identity()))
    results = codecs.detections_to_message([one], HEADER, KEPT).detections[0].results
    assert [(each.hypothesis.class_id, each.hypothesis.score) for each in results] == 3 * [('box', 0.25)]
    assert_pose(results[1].pose.pose, AWAY.translation, AWAY.quaternion)
    assert [any(each.pose.covariance) for each in results] == [True, False, False]


def shapes():
    turned = Pose.from_rotation_vector([np.pi / 2, 0.0, 0.0], AWAY.translation)
    kinds = (('BOX', (1.0, 2.0, 3.0)), ('SPHERE', (0.5,)), ('CYLINDER', (4.0, 0.25)), ('CONE', (4.0, 1.0)))
    mesh = MeshShape(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array([[0, 2, 1], [0, 1, 3]]))
    return CollisionShapes(
        tuple(PrimitiveShape(kind, size, turned if kind == 'BOX' else AWAY) for kind, size in kinds), (mesh,)
    )


def test_an_object_for_a_planner_has_its_shapes_and_frames_in_its_size():
    one = codecs.SceneObject('part/1', 'part', POSE, shapes(), {'grip': AWAY, 'rest': Pose.identity()})
    made = codecs.collision_object(one, HEADER, KEPT)
    assert (made.id, made.type.key, made.header, made.operation) == ('part/1', 'part', HEADER, Kept.ADD)
    assert_pose(made.pose, [1, 2, 3], QUARTER)
    assert [shape.type for shape in made.primitives] == [
        SolidPrimitive.BOX,
        SolidPrimitive.SPHERE,
        SolidPrimitive.CYLINDER,
        SolidPrimitive.CONE,
    ]
    assert [list(shape.dimensions) for shape in made.primitives] == [[2, 4, 6], [1], [8, 0.5], [8, 2]]
    assert_pose(made.primitive_poses[0], [1.0, 0.0, 0.5], (np.sqrt(0.5), 0, 0, np.sqrt(0.5)))
    assert_pose(made.primitive_poses[1], [1.0, 0.0, 0.5])
    (mesh,) = made.meshes
    assert [[p.x, p.y, p.z] for p in mesh.vertices] == [[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]]
    assert [list(face.vertex_indices) for face in mesh.triangles] == [[0, 2, 1], [0, 1, 3]]
    assert len(made.mesh_poses) == 1
    assert_pose(made.mesh_poses[0], [0, 0, 0])
    assert made.subframe_names == ['grip', 'rest']
    assert_pose(made.subframe_poses[0], [1.0, 0.0, 0.5])
    gone = codecs.removal('part/1', HEADER, KEPT)
    assert (gone.id, gone.operation, gone.header) == ('part/1', Kept.REMOVE, HEADER)
    assert list(codecs.shapes_to_messages(shapes())[0][0].dimensions) == [1, 2, 3], 'in its own size'


def test_an_object_is_drawn_as_a_planner_has_it():
    objects = [codecs.SceneObject(name, 'part', POSE, shapes()) for name in ('part/1', 'part/2')]
    first, *markers = codecs.objects_to_markers(objects, HEADER).markers
    assert first.action == Marker.DELETEALL and first.header == HEADER
    assert [(m.ns, m.id, m.header) for m in markers] == [(f'part/{k}', n, HEADER) for k in (1, 2) for n in range(5)]
    for marker in markers:
        colour = [marker.color.r, marker.color.g, marker.color.b, marker.color.a]
        np.testing.assert_allclose(colour, [0.9, 0.6, 0.2, 0.5], atol=1e-6)
    box, sphere, cylinder, cone, mesh = markers[:5]
    kinds = [marker.type for marker in markers[:5]]
    assert kinds == [Marker.CUBE, Marker.SPHERE, Marker.CYLINDER, Marker.TRIANGLE_LIST, Marker.TRIANGLE_LIST]
    sizes = [[m.scale.x, m.scale.y, m.scale.z] for m in markers[:5]]
    assert sizes == [[2, 4, 6], [2, 2, 2], [1, 1, 8], [1, 1, 1], [1, 1, 1]]
    for marker in (sphere, cylinder, cone):  # (0.5, 0, 0.25) turned to (0, 0.5, 0.25), twice as far, and moved
        assert_pose(marker.pose, [1.0, 3.0, 3.5], QUARTER)
    assert_pose(mesh.pose, [1, 2, 3], QUARTER)
    assert [[p.x, p.y, p.z] for p in mesh.points] == [[0, 0, 0], [0, 2, 0], [2, 0, 0], [0, 0, 0], [2, 0, 0], [0, 0, 2]]
    corners = np.array([[p.x, p.y, p.z] for p in cone.points])
    assert len(corners) == 24 * 6
    rim = np.abs(np.hypot(corners[:, 0], corners[:, 1]) - 2.0) < 1e-9
    assert np.ptp(corners[rim, 2]) == 0.0 and rim.sum() == 24 * 4
    np.testing.assert_allclose(sorted(set(corners[~rim, 2])), [-4.0, 4.0])
    faces = corners.reshape(-1, 3, 3)
    volume = np.einsum('ij,ij->', faces[:, 0], np.cross(faces[:, 1], faces[:, 2])) / 6.0
    assert volume == pytest.approx(np.pi * 2.0**2 * 8.0 / 3.0, rel=0.02), 'closed, seen from outside'
