"""Recorded data: a bag of the chessboard, played into recovery_node and matcher_node."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import cv2
import numpy as np
import pytest
from geometry_msgs.msg import PoseArray
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2

pytest.importorskip('rosbags', reason='rosbags (pip) is not installed')

from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

from model_matcher.closed_form.following.picture_frames import picture_frames
from model_matcher.closed_form.real_pair import chessboard_model, reference_pose
from model_matcher.node import MatcherNode
from msgs_py import Pose, codecs
from stereo_recovery.node import RecoveryNode

TOPICS = ('/left/image_rect', '/left/camera_info', '/right/image_rect', '/right/camera_info')


def bag_tools():
    path = Path(__file__).resolve().parent / 'bags' / 'make_bag.py'
    spec = importlib.util.spec_from_file_location('make_bag', path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def play(graph, tools, bag: Path, outputs: list) -> list[int]:
    """Publish the recorded bytes pair by pair, each when the one before has come out; return the recorded times."""
    players = {topic: graph.publisher(CameraInfo if topic.endswith('info') else Image, topic) for topic in TOPICS}
    graph.wait_matched(*players.values())
    stamps: list[int] = []
    for topic, time_ns, data in tools.read_bag(bag):
        if not stamps or stamps[-1] != time_ns:
            graph.spin_until(lambda: len(outputs) == len(stamps), what='the answer to the pair before')
            stamps.append(time_ns)
        players[topic].publish(data)
    graph.spin_until(lambda: len(outputs) == len(stamps), what='the last answer')
    return stamps


@pytest.mark.parametrize('ending', ['.png', '.jpg'])
def test_compressed_images_and_one_camera_info_are_read(tmp_path, ending):
    """As foreign drivers record: camera_info latched, here the last message of the bag, and a clock that jumps back."""
    tools = bag_tools()
    store = get_typestore(Stores.LATEST)
    recorded = list(tools.messages(3, 2.0, raw=False))
    images = [item for item in recorded if item[0].endswith('image_rect')]
    infos = [item for item in recorded if item[0].endswith('camera_info')][:2]
    for _, _, message in images[4::2]:  # both sides share one header
        message.header.stamp.sec -= 3600
    with Writer(tmp_path / 'bag', version=9) as writer:
        connections = {}
        for number, (topic, _, message) in enumerate([*images, *infos]):
            if topic.endswith('image_rect'):
                pixels = codecs.gray_from_image(message)
                data = cv2.imencode(ending, pixels)[1].tobytes()
                topic, message = topic + '/compressed', CompressedImage(header=message.header, format=ending, data=data)
            if topic not in connections:
                kind = 'sensor_msgs/msg/' + type(message).__name__
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], 10**9 + number, serialize_message(message))
    frames = list(picture_frames(tmp_path / 'bag'))
    assert [frame.stamp_s - tools.START_S for frame in frames] == pytest.approx([0.0, 0.5, -3599.0])
    assert frames[0].rig.baseline > 0.0
    original = codecs.gray_from_image(images[0][2])
    difference = np.abs(frames[0].images[0].astype(int) - original)
    assert difference.max() == 0 if ending == '.png' else difference.mean() < 3.0


def test_a_bag_without_camera_info_says_so(tmp_path):
    tools = bag_tools()
    store = get_typestore(Stores.LATEST)
    with Writer(tmp_path / 'bag', version=9) as writer:
        topic, time_ns, message = next(tools.messages(1, 2.0, raw=False))
        connection = writer.add_connection(topic, 'sensor_msgs/msg/Image', typestore=store)
        writer.write(connection, time_ns, serialize_message(message))
    with pytest.raises(ValueError, match='left/camera_info or right/camera_info'):
        list(picture_frames(tmp_path / 'bag'))


def nanoseconds(stamp) -> int:
    return stamp.sec * 10**9 + stamp.nanosec


@pytest.mark.parametrize('raw', [False, True], ids=['rectified', 'raw'])
def test_a_replayed_bag_gives_features_with_the_recorded_stamps(graph, tmp_path, raw):
    tools = bag_tools()
    tools.write_bag(tmp_path / 'bag', pairs=3, raw=raw)
    node = graph.add(RecoveryNode, parameters={'rectify': raw})
    clouds = graph.collect(PointCloud2, 'features')
    graph.wait_heard('/features')
    stamps = play(graph, tools, tmp_path / 'bag', clouds)
    assert [nanoseconds(cloud.header.stamp) for cloud in clouds] == stamps and len(stamps) == 3
    assert {cloud.header.frame_id for cloud in clouds} == {tools.FRAME}
    assert node.health.lost == node.health.dropped == 0
    assert min(len(codecs.cloud_to_features(cloud)) for cloud in clouds) >= 15


def test_a_replayed_board_is_found_where_its_corners_say(graph, tmp_path):
    tools = bag_tools()
    tools.write_bag(tmp_path / 'bag', pairs=1)
    board = chessboard_model()
    board.save(tmp_path / 'board.npz')
    graph.add(RecoveryNode)
    graph.add(MatcherNode, parameters={'models': [str(tmp_path / 'board.npz')]})
    poses = graph.collect(PoseArray, 'interpretations')
    graph.wait_heard('/features', '/interpretations')
    stamps = play(graph, tools, tmp_path / 'bag', poses)
    assert [nanoseconds(array.header.stamp) for array in poses] == stamps
    found = codecs.pose_from_message(poses[0].poses[0])
    truth = reference_pose(Path(str(tools.resources.files('stereo_recovery') / 'data' / 'chessboard')))
    # Lines have no colour: a grid lies on itself after half a turn about each of its axes.
    middle = board.midpoints.mean(axis=0)
    errors = []
    for axis in ([0, 0, 0], [np.pi, 0, 0], [0, np.pi, 0], [0, 0, np.pi]):
        turn = Pose.from_rotation_vector(axis)
        errors.append(truth.compose(Pose(turn.rotation, middle - turn.rotate(middle))).error_to(found))
    assert min(error.rotation_deg for error in errors) < 1.0
