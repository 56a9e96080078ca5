"""renderer_node alone in a real graph: topics, truth, errors, reload."""

import itertools
import time

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger

from csg_renderer import render_stereo
from csg_renderer.node import RendererNode
from csg_renderer.raycast.render import scene_rig
from csg_renderer.stereo_pictures import sensor_images
from msgs_py import StereoRig
from msgs_py.codecs import cloud_to_features, image_to_array, pose_from_message

SCENE = """
UNITS MM;
wall = BLOCK(60, 40, 20) AT(-30, -20, 0);
LIGHT(100, -200, -100);
DRAW(wall) AT(10, 5, 300);
"""
TOPICS = {
    'left/image_rect': Image,
    'right/image_rect': Image,
    'left/camera_info': CameraInfo,
    'right/camera_info': CameraInfo,
    'left/depth': Image,
    'ground_truth/pose': PoseStamped,
    'ground_truth/features': PointCloud2,
}


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / 'wall.csg'
    path.write_text(SCENE)
    return path


class Listener:
    def __init__(self, graph, topics=TOPICS):
        self.node = graph.add(Node, 'listener')
        self.messages = {topic: [] for topic in topics}
        for topic in topics:
            self.node.create_subscription(TOPICS[topic], topic, self.messages[topic].append, 10)

    def complete(self):
        return all(self.messages.values())


def renderer(graph, scene, **parameters):
    values = {'scene': str(scene), 'width': 64, 'rate': 20.0, 'antialias': 0} | parameters
    return graph.add(RendererNode, parameters=values)


def test_a_pair_has_four_equal_stamps_and_its_truth(graph, scene_file):
    node = renderer(graph, scene_file, noise=2.0, psf=0.7, seed=5)
    listener = Listener(graph)
    graph.spin_until(lambda: all(len(received) >= 3 for received in listener.messages.values()))
    by_stamp = [
        {(m.header.stamp.sec, m.header.stamp.nanosec): m for m in received} for received in listener.messages.values()
    ]
    common = set.intersection(*(set(messages) for messages in by_stamp))
    assert common
    left, right, left_info, right_info, depth, pose, cloud = (messages[max(common)] for messages in by_stamp)
    assert {m.header.frame_id for m in (left, right, left_info, right_info, depth, pose, cloud)} == {
        'camera_left_optical_frame'
    }
    rig = StereoRig.from_camera_info(left_info, right_info)
    scene = node._file.scene
    assert rig == scene_rig(scene, width=64)
    assert rig.baseline == pytest.approx(0.06)
    frames = render_stereo(scene, rig, antialias=node.config.antialias, psf=0.7)
    pixels, encoding = image_to_array(left)
    assert encoding == 'mono8' and pixels.shape == (64, 64)
    clean = sensor_images(frames, type(node.config)(psf=0.7))[0].astype(float)
    # Noise of two levels, but where it is cut off at black: the mean of its size varies by less than two.
    assert 0.5 < np.abs(pixels - clean).std() < 2.0
    assert np.array_equal(image_to_array(depth)[0], frames[0].depth, equal_nan=True)
    assert np.allclose(pose_from_message(pose.pose).translation, [0.010, 0.005, 0.300], atol=1e-9)
    seen = cloud_to_features(cloud)
    assert len(seen) >= 4
    assert np.abs(seen.start[:, 2] - 0.3).min() < 1e-9 and (seen.start[:, 2] <= 0.32 + 1e-9).all()


def test_single_shot_renders_once_and_only_when_asked(graph, scene_file):
    node = renderer(graph, scene_file, rate=0.0, encoding='rgb8')
    listener = Listener(graph, ['left/image_rect', 'right/image_rect'])
    client = listener.node.create_client(Trigger, 'renderer_node/render')
    graph.spin_until(lambda: client.service_is_ready() and node.wanted(node._images[1]))
    answer = client.call_async(Trigger.Request())
    graph.spin_until(lambda: answer.done() and listener.complete())
    assert answer.result().success
    assert [len(received) for received in listener.messages.values()] == [1, 1]
    expected = render_stereo(node._file.scene, scene_rig(node._file.scene, width=64))
    for frame, received in zip(expected, listener.messages.values()):
        assert np.array_equal(image_to_array(received[0])[0], frame.image)


def test_nothing_is_rendered_while_nobody_listens(graph, scene_file):
    node = renderer(graph, scene_file, rate=100.0)
    ticks = []
    node.create_timer(0.05, lambda: ticks.append(1))
    graph.spin_until(lambda: len(ticks) >= 3)
    assert node._pair_index == 0


def test_a_scene_that_is_missing_or_wrong_is_reported_and_the_last_good_one_kept(graph, scene_file):
    node = renderer(graph, scene_file)
    good = node._file
    bad = scene_file.with_name('bad.csg')
    bad.write_text('wall = BLOCK(60, 40;\nDRAW(wall);')
    for wrong, named in ((bad, 'bad.csg'), ('no_such_scene', 'no_such_scene')):
        (result,) = node.set_parameters([Parameter('scene', value=str(wrong))])
        assert not result.successful and named in result.reason
        assert named in node.health.last_error
    assert node._file is good and node.config.scene == str(scene_file)


def test_a_node_started_with_a_bad_scene_lives_and_says_why(graph, tmp_path):
    node = renderer(graph, tmp_path / 'none.csg')
    assert 'none.csg' in node.health.last_error and 'none.csg' in node.why_silent()
    good = tmp_path / 'good.csg'
    good.write_text(SCENE)
    (result,) = node.set_parameters([Parameter('scene', value=str(good))])
    assert result.successful and node._file is not None


def test_a_changed_file_is_read_again_and_a_typo_is_survived(graph, scene_file):
    node = renderer(graph, scene_file)
    listener = Listener(graph, ['left/depth', 'left/image_rect'])
    received = listener.messages['left/depth']
    graph.spin_until(lambda: received)

    def middle():
        return float(image_to_array(received[-1])[0][32, 32])

    assert middle() == pytest.approx(0.3)
    scene_file.write_text(SCENE.replace('300);', '400'))  # neither bracket nor semicolon
    graph.spin_until(lambda: node.health.last_error)
    assert middle() == pytest.approx(0.3)
    scene_file.write_text(SCENE.replace('300);', '400);'))
    graph.spin_until(lambda: middle() == pytest.approx(0.4))


def test_the_turntable_turns_scene_and_truth_together(graph, scene_file):
    renderer(graph, scene_file, turntable=30.0)
    listener = Listener(graph, ['ground_truth/pose', 'left/depth'])
    poses = listener.messages['ground_truth/pose']
    graph.spin_until(lambda: len(poses) >= 2)
    first, second = (pose_from_message(message.pose) for message in poses[:2])
    assert np.degrees(first.error_to(second).rotation) == pytest.approx(30.0, abs=1e-6)
    assert np.allclose(first.translation, second.translation)


def test_a_terrain_is_rendered_and_the_truth_is_of_what_stands_on_it(graph, tmp_path):
    np.save(tmp_path / 'ground.npy', np.random.default_rng(0).random((5, 5)))
    path = tmp_path / 'scene.csg'
    path.write_text(
        'DRAW TERRAIN ("ground.npy", 400, 400, 30, BILINEAR) XROT (90) AT (-200, 60, 200) AS ground;'
        'DRAW BLOCK (40, 40, 40) AT (-10, 10, 350) AS box; LIGHT (0, -300, 0);'
    )
    node = renderer(graph, path, rate=5.0, engine='dap', shadows=True, encoding='rgb8')
    listener = Listener(graph, ['left/image_rect', 'ground_truth/pose', 'ground_truth/features'])
    graph.spin_until(listener.complete)
    scene = node._file.scene
    left, _ = render_stereo(scene, scene_rig(scene, width=64), shadows=True)
    assert (left.primitive_id == 0).sum() > 300
    difference = np.abs(image_to_array(listener.messages['left/image_rect'][0])[0].astype(int) - left.image)
    assert (difference > 1).sum() == 0
    pose = pose_from_message(listener.messages['ground_truth/pose'][0].pose)
    assert np.allclose(pose.translation, [-0.01, 0.01, 0.35], atol=1e-9)
    assert len(cloud_to_features(listener.messages['ground_truth/features'][0])) >= 4


def hall_of_mirrors() -> str:
    """Mirroring glass balls all around the camera, of which every ray becomes two at every level."""
    places = [place for place in itertools.product((-500, -250, 0, 250, 500), repeat=3) if any(place)]
    balls = ''.join(f'DRAW ball AT {place};\n' for place in places)
    return f'UNITS MM;\nball = SPHERE(120) REFLECT(0.5) TRANSPARENT(0.5);\nLIGHT(10, -20, -10);\n{balls}'


@pytest.mark.parametrize('engine', ['native', 'reference', 'dap'])
def test_a_rendering_that_takes_for_ever_holds_nothing_up(graph, tmp_path, engine):
    """The node answers meanwhile, ends it in time or when parameters change, says so, and renders the next."""
    path = tmp_path / 'mirrors.csg'
    path.write_text(hall_of_mirrors())
    node = renderer(graph, path, rate=0.0, width=16, levels=1, engine=engine, baseline=0.01)
    listener = Listener(graph, ['left/image_rect'])
    client = listener.node.create_client(Trigger, 'renderer_node/render')
    reset = listener.node.create_client(Trigger, 'renderer_node/reset')
    graph.spin_until(lambda: client.service_is_ready() and reset.service_is_ready() and not node.compiling)

    def asked(service, within):
        answer, start = service.call_async(Trigger.Request()), time.monotonic()
        graph.spin_until(answer.done, 60.0)
        assert time.monotonic() - start < within
        return answer.result()

    for levels in (1, 2):
        node.set_parameters([Parameter('levels', value=levels)])
        assert asked(client, 60.0).success  # compiled before
    endless = [Parameter('levels', value=64), Parameter('width', value=512)]
    easy = [Parameter('levels', value=1), Parameter('width', value=16)]

    node.set_parameters_atomically([*endless, Parameter('time_limit', value=1.0)])
    late = asked(client, 2.5)
    assert not late.success and 'stopped: it took longer than the time_limit of 1 s' in late.message

    node.set_parameters_atomically([*endless, Parameter('time_limit', value=3600.0)])
    for what, told in (
        ('parameters', 'stopped: the parameters have changed'),
        ('reset', 'stopped: the node was reset'),
    ):
        answer = client.call_async(Trigger.Request())
        graph.spin_until(lambda: node._picture is not None)
        if what == 'reset':
            assert asked(reset, 1.0).success
        else:
            node.set_parameters_atomically(easy)
        start = time.monotonic()
        graph.spin_until(answer.done)
        assert time.monotonic() - start < 1.5
        assert not answer.result().success and told in answer.result().message
        node.set_parameters_atomically(easy)
        assert asked(client, 10.0 if engine == 'dap' else 1.0).success  # the machine is emulated
        node.set_parameters_atomically(endless)
    answer = client.call_async(Trigger.Request())
    graph.spin_until(lambda: node._picture is not None)  # and a node that ends does not wait for it
