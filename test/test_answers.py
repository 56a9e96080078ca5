"""What matcher_node says in other people's messages: poses with covariance, detections, symmetries."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Header, String
from visualization_msgs.msg import Marker, MarkerArray

import csg_renderer
import model_matcher.node_answers
from model_matcher.closed_form.synthetic.scenes import box, random_pose
from model_matcher.node import MatcherNode
from model_matcher.node_answers import placed, score, transforms
from msgs_py import FeatureSet, Interpretation, Pose, codecs
from msgs_py.shapes import CollisionShapes, MeshShape

sys.path.insert(0, str(Path(__file__).parent))
from stand_ins import MOVEIT_MSGS, OBJECT_RECOGNITION_MSGS, VISION_MSGS, messages, sending


def header(sec: int) -> Header:
    made = Header(frame_id='left_optical')
    made.stamp.sec = sec
    return made


def model(name: str) -> FeatureSet:
    return csg_renderer.load_model_features(name)[name]


class Talk:
    """Features to a matcher, and its answers."""

    def __init__(self, graph, node_class, **parameters):
        self.graph = graph
        self.node = graph.add(node_class, parameters=parameters)
        self.arrays = graph.collect(PoseArray, 'interpretations')
        self.out = graph.publisher(PointCloud2, 'features')
        graph.wait_matched(self.out)
        graph.wait_heard('/interpretations')

    def answer(self, sec: int, features: FeatureSet) -> PoseArray:
        self.out.publish(codecs.features_to_cloud(features, header(sec)))
        return self.graph.spin_until(
            lambda: [a for a in self.arrays if a.header.stamp.sec == sec], what=f'answer {sec}'
        )[0]


def test_the_pose_comes_with_its_covariance(graph):
    poses = graph.collect(PoseStamped, 'interpretations/l_shape')
    both = graph.collect(PoseWithCovarianceStamped, 'interpretations/l_shape/with_covariance')
    reports = graph.collect(DiagnosticArray, 'interpretations/report')
    talk = Talk(graph, MatcherNode, models=['l_shape'])
    graph.wait_heard('/interpretations/l_shape/with_covariance', '/interpretations/report')
    pose = Pose.from_rotation_vector([0.3, 0.5, 0.1], [0.02, 0.0, 0.4])
    talk.answer(1, model('l_shape').transformed(pose))
    graph.spin_until(lambda: poses and both and reports, what='all of it')
    assert both[0].header == header(1) and both[0].pose.pose == poses[0].pose
    (found,) = [one for one in codecs.interpretations_from_report(reports[0]) if one.accepted]
    # The message's rows are x, y, z and rotations about the fixed axes x, y, z; those of an interpretation are, too.
    np.testing.assert_array_equal(np.array(both[0].pose.covariance).reshape(6, 6), found.covariance)
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0
    assert 0.0 < found.chance < 1e-3, 'less than the rate at which chance is accepted'
    values = {item.key: item.value for item in reports[0].status[0].values}
    assert values['instance'] == '"l_shape/1"'


def test_nothing_found_has_no_covariance(graph):
    both = graph.collect(PoseWithCovarianceStamped, 'interpretations/l_shape/with_covariance')
    talk = Talk(graph, MatcherNode, models=['l_shape'])
    talk.answer(1, FeatureSet.empty())
    assert not both


def test_symmetries_are_latched_and_the_canonical_pose_is_the_answer(graph, tmp_path):
    box((0.03, 0.05, 0.08)).save(tmp_path / 'slab.npz')
    talk = Talk(graph, MatcherNode, models=[str(tmp_path / 'slab.npz'), 'l_shape'])
    latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    heard: list[String] = []
    graph.tester.create_subscription(String, 'interpretations/symmetries', heard.append, latched)
    graph.spin_until(lambda: heard, what='what was said before')
    groups = json.loads(heard[0].data)
    assert groups['l_shape'] == {'order': 1, 'axis': None, 'motions': []}
    assert groups['slab']['order'] == 4
    motions = [Pose(np.array(m['rotation']), np.array(m['translation'])) for m in groups['slab']['motions']]
    pose = random_pose(np.random.default_rng(4))
    answers = []
    for sec, motion in enumerate([Pose.identity(), *motions], 1):
        (one,) = talk.answer(sec, box((0.03, 0.05, 0.08)).transformed(pose.compose(motion))).poses
        answers.append(codecs.pose_from_message(one))
    for one in answers:
        assert one.error_to(answers[0]).rotation < 1e-5 and one.error_to(answers[0]).translation < 1e-6
    turns = [pose.compose(motion).rotation.trace() for motion in (Pose.identity(), *motions)]
    assert answers[0].rotation.trace() == pytest.approx(max(turns), abs=1e-5)


def test_detections_in_the_fields_of_vision_msgs(graph, monkeypatch):
    vision, sent = messages('vision_msgs', VISION_MSGS), {}
    monkeypatch.setattr(model_matcher.node_answers, 'detection_messages', lambda: vision)
    talk = Talk(graph, sending(MatcherNode, vision, sent), models=['l_shape'])
    shape = model('l_shape')
    poses = [Pose.from_rotation_vector([0.3, 0.5, 0.1], [x, 0.0, 0.4]) for x in (-0.1, 0.1)]
    both = FeatureSet.concatenate([shape.transformed(pose) for pose in poses])
    arrays = [talk.answer(1, both), talk.answer(2, both), talk.answer(3, FeatureSet.empty())]
    first, second, nothing = sent['detections'].messages
    assert first.header == header(1) and nothing.header == header(3) and nothing.detections == []
    assert {one.id for one in first.detections} == {'l_shape/1', 'l_shape/2'}
    points = np.concatenate([shape.start, shape.end])
    low, high = points.min(axis=0), points.max(axis=0)
    for array, message in zip(arrays, (first, second)):
        assert [one.results[0].pose.pose for one in message.detections] == list(array.poses)
        for one in message.detections:
            assert one.header == message.header and len(one.results) == 1
            assert one.results[0].hypothesis.class_id == 'l_shape'
            assert 0.999 < one.results[0].hypothesis.score <= 1.0
            assert np.array(one.results[0].pose.covariance).reshape(6, 6).diagonal().min() > 0.0
            assert [one.bbox.size.x, one.bbox.size.y, one.bbox.size.z] == pytest.approx(high - low)
            pose = codecs.pose_from_message(one.results[0].pose.pose)
            middle = one.bbox.center.position
            assert [middle.x, middle.y, middle.z] == pytest.approx(pose.apply(0.5 * (low + high)))
            assert one.bbox.center.orientation == one.results[0].pose.pose.orientation
    places = [{one.id: one.bbox.center.position.x for one in message.detections} for message in (first, second)]
    assert places[0] == pytest.approx(places[1], abs=1e-6)


def test_the_stand_in_is_vision_msgs_where_that_is_installed():
    if importlib.util.find_spec('vision_msgs') is None:
        pytest.skip('vision_msgs does not come with the wheels')
    real = codecs.detection_messages()
    for name, text in VISION_MSGS.items():
        fields = getattr(real, name).get_fields_and_field_types()
        expected = {line.split()[1]: line.split()[0] for line in text.splitlines()}
        assert list(fields) == list(expected)
        for field, kind in expected.items():
            plain = kind.removesuffix('[]').split('/')[-1].replace('float64', 'double')
            assert plain in fields[field] and kind.endswith('[]') == fields[field].startswith('sequence')


def test_what_was_not_weighed_scores_nothing():
    one = Interpretation('m', [0], [1], Pose())
    assert score(one) == 0.0
    assert score(Interpretation('m', [0], [1], Pose(), chance=0.25)) == 0.75


PART = """UNITS MM;
plate = BLOCK (70, 10, 50);
wall = BLOCK (12, 45, 50);
part = plate UNION wall;
DRAW part AT (0, 0, 400);
FRAME grip XROT (90) AT (32, 45, 25);
FRAME rest;
"""


def test_frames_of_a_model_are_published_where_it_is(graph, tmp_path):
    (tmp_path / 'part.csg').write_text(PART)
    grips = graph.collect(PoseStamped, 'interpretations/part/frames/grip')
    rests = graph.collect(PoseStamped, 'interpretations/part/frames/rest')
    talk = Talk(graph, MatcherNode, models=[str(tmp_path / 'part.csg')])
    graph.wait_heard('/interpretations/part/frames/grip', '/interpretations/part/frames/rest')
    part = csg_renderer.load_model_features(tmp_path / 'part.csg')['part']
    pose = Pose.from_rotation_vector([0.3, 0.5, 0.1], [0.02, 0.0, 0.4])
    answer = talk.answer(1, part.transformed(pose))
    graph.spin_until(lambda: grips and rests, what='both frames')
    assert grips[0].header == header(1) and rests[0].pose == answer.poses[0]
    model_T_grip = Pose.from_rotation_vector([np.pi / 2, 0, 0], [0.032, 0.045, 0.025])
    error = codecs.pose_from_message(grips[0].pose).error_to(pose.compose(model_T_grip))
    assert error.rotation < 1e-4 and error.translation < 1e-5
    # A frame that goes, goes with its topic.
    (tmp_path / 'part.csg').write_text(PART.replace('FRAME rest;', ''))
    talk.node.reset()
    names = {out.topic_name for out in talk.node.publishers}
    assert '/interpretations/part/frames/grip' in names and '/interpretations/part/frames/rest' not in names


def test_frames_hang_on_the_object_in_tf():
    index = model_matcher.index_model(model('l_shape'), 'l_shape')
    grip = Pose.from_rotation_vector([0.0, 0.0, 1.0], [0.01, 0.0, 0.0])
    index.frames['grip'] = grip
    pose = Pose.from_rotation_vector([0.3, 0.5, 0.1], [0.02, 0.0, 0.4])
    whole, part = transforms({'l_shape': pose}, {'l_shape': index}, 'found/', header(3))
    assert (whole.header.frame_id, whole.child_frame_id) == ('left_optical', 'found/l_shape')
    assert (part.header.frame_id, part.child_frame_id) == ('found/l_shape', 'found/l_shape/grip')
    assert part.header.stamp == whole.header.stamp == header(3).stamp
    assert part.transform.translation.x == 0.01
    assert part.transform.rotation.z == pytest.approx(np.sin(0.5))
    double = Pose(pose.rotation, pose.translation, 2.0)
    np.testing.assert_allclose(placed(double, grip).translation, double.apply(grip.translation))
    assert transforms({'l_shape': double}, {'l_shape': index}, '', header(3))[1].transform.translation.x == 0.02


def moveit():
    recognition = messages('object_recognition_msgs', OBJECT_RECOGNITION_MSGS)
    return messages('moveit_msgs', MOVEIT_MSGS, {'object_recognition_msgs': recognition})


def test_what_is_found_goes_into_the_scene_of_a_planner(graph, monkeypatch, tmp_path):
    module, sent = moveit(), {}
    monkeypatch.setattr(model_matcher.node_answers, 'collision_messages', lambda: module)
    (tmp_path / 'part.csg').write_text(PART)
    talk = Talk(graph, sending(MatcherNode, module, sent), models=[str(tmp_path / 'part.csg')])
    part = csg_renderer.load_model_features(tmp_path / 'part.csg')['part']
    pose = Pose.from_rotation_vector([0.3, 0.5, 0.1], [0.02, 0.0, 0.4])
    answer = talk.answer(1, part.transformed(pose))
    (there,) = sent['scene_objects'].messages
    assert there.header == header(1) and there.operation == module.CollisionObject.ADD
    assert there.id == 'part/1' and there.type.key == 'part' and there.pose == answer.poses[0]
    assert [one.type for one in there.primitives] == [SolidPrimitive.BOX] * 2
    assert [list(one.dimensions) for one in there.primitives] == [
        pytest.approx([0.07, 0.01, 0.05]),
        pytest.approx([0.012, 0.045, 0.05]),
    ]
    middle = there.primitive_poses[0].position
    assert [middle.x, middle.y, middle.z] == pytest.approx([0.035, 0.005, 0.025])
    assert there.subframe_names == ['grip', 'rest']
    assert there.subframe_poses[0].position.x == pytest.approx(0.032)
    talk.answer(100, FeatureSet.empty())
    gone = sent['scene_objects'].messages[-1]
    assert gone.id == 'part/1' and gone.operation == module.CollisionObject.REMOVE and not gone.primitives
    talk.answer(101, FeatureSet.empty())
    assert len(sent['scene_objects'].messages) == 2, 'once'


def test_without_moveit_the_scene_is_markers(graph, tmp_path):
    (tmp_path / 'part.csg').write_text(PART)
    drawn = graph.collect(MarkerArray, 'scene_objects')
    talk = Talk(graph, MatcherNode, models=[str(tmp_path / 'part.csg')])
    graph.wait_heard('/scene_objects')
    part = csg_renderer.load_model_features(tmp_path / 'part.csg')['part']
    talk.answer(1, part.transformed(Pose.from_rotation_vector([0.3, 0.5, 0.1], [0.02, 0.0, 0.4])))
    graph.spin_until(lambda: drawn, what='markers')
    first, *boxes = drawn[0].markers
    assert first.action == Marker.DELETEALL and [one.type for one in boxes] == [Marker.CUBE] * 2
    assert [(one.ns, one.id) for one in boxes] == [('part/1', 0), ('part/1', 1)]
    assert boxes[0].scale.x == pytest.approx(0.07) and boxes[0].header == header(1)


def test_markers_and_messages_of_round_shapes_and_meshes():
    solid = csg_renderer.Solid.cone(0.1, (0, 0, 0.3)) | csg_renderer.Solid.cylinder(0.1, (0, 0, 0.2))
    shapes = csg_renderer.planning_scene(solid | csg_renderer.Solid.sphere(0.2))
    triangle = MeshShape(np.eye(3), np.array([[0, 1, 2]]))
    shapes = CollisionShapes(shapes.primitives, (triangle,))
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 1.0]), 2.0)
    _, cone, cylinder, ball, mesh = codecs.objects_to_markers(
        [codecs.SceneObject('a', 'm', pose, shapes)], header(1)
    ).markers
    kinds = [cone.type, cylinder.type, ball.type, mesh.type]
    assert kinds == [Marker.TRIANGLE_LIST, Marker.CYLINDER, Marker.SPHERE, Marker.TRIANGLE_LIST]
    points = np.array([[p.x, p.y, p.z] for p in cone.points]).reshape(-1, 3, 3)
    volume = np.einsum('ij,ij->', points[:, 0], np.cross(points[:, 1], points[:, 2])) / 6.0
    assert volume == pytest.approx(np.pi * 0.2**2 * 0.6 / 3.0, rel=0.02), 'closed, seen from outside, twice as large'
    at = codecs.pose_from_message(cone.pose).apply([[0.0, 0.0, 0.3]])
    np.testing.assert_allclose(at, [[0.0, 0.0, 1.0]], atol=1e-12, err_msg='our cone has its tip in the origin')
    assert [cylinder.scale.x, cylinder.scale.z] == pytest.approx([0.4, 0.4])
    assert [mesh.points[0].x, mesh.points[1].y] == [2.0, 2.0] and mesh.pose.position.z == 1.0
    made = codecs.collision_object(codecs.SceneObject('a', 'm', pose, shapes), header(1), moveit())
    assert [list(one.dimensions) for one in made.primitives] == [[0.6, 0.2], [0.4, 0.2], [0.4]]
    assert made.meshes[0].vertices[2].z == 2.0 and list(made.meshes[0].triangles[0].vertex_indices) == [0, 1, 2]
