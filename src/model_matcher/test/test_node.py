"""matcher_node over real topics: features in, poses, report and markers out; bad input reported, node alive."""

import os
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from model_matcher.catalogue.build import indexed_model, write_catalogue
from model_matcher.closed_form.synthetic.scenes import l_shape, make_scene, random_polyhedron
from model_matcher.model.library import load_library
from msgs_py import FeatureSet

rclpy = pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from geometry_msgs.msg import PoseArray, PoseStamped  # noqa: E402
from rcl_interfaces.srv import SetParametersAtomically  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from sensor_msgs.msg import CameraInfo, Image, PointCloud2  # noqa: E402
from std_msgs.msg import Header  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402
from visualization_msgs.msg import MarkerArray  # noqa: E402

sys.path.insert(0, str(Path(__file__).parent))
from test_tracking import at, images, part, rig_for  # noqa: E402

from model_matcher.node import MatcherNode  # noqa: E402
from msgs_py.codecs import (  # noqa: E402
    array_to_image,
    camera_infos_from_rig,
    features_to_cloud,
    interpretations_from_report,
    pose_from_message,
)
from stereo_recovery import recover  # noqa: E402

OUTPUTS = {
    'interpretations': PoseArray,
    'interpretations/l_shape': PoseStamped,
    'interpretations/report': DiagnosticArray,
    'interpretations/markers': MarkerArray,
}


class Bench:
    """A matcher_node, a publisher of features and ears for everything it says."""

    def __init__(self, models, domain):
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.node = MatcherNode(
            context=self.context, parameter_overrides=[Parameter('models', Parameter.Type.STRING_ARRAY, models)]
        )
        self.other = Node('observer', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        for node in (self.node, self.other):
            self.executor.add_node(node)
        self.heard = {topic: [] for topic in OUTPUTS}
        for topic, kind in OUTPUTS.items():
            self.other.create_subscription(kind, topic, self.heard[topic].append, 10)
        self.features = self.other.create_publisher(PointCloud2, 'features', 10)
        self.wait(
            lambda: (
                self.features.get_subscription_count() == 1
                and self.other.count_publishers('interpretations') == 1
                and self.node.count_subscribers('interpretations/markers') == 1
            )
        )

    def wait(self, predicate, seconds=20.0):
        deadline = time.monotonic() + seconds
        while not predicate():
            assert time.monotonic() < deadline, f'waited in vain: {self.node.health.last_error}'
            self.executor.spin_once(timeout_sec=0.05)

    def send(self, message):
        for messages in self.heard.values():
            messages.clear()
        self.features.publish(message)

    def close(self):
        for node in (self.node, self.other):
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)


@pytest.fixture(scope='module')
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp('models')
    l_shape().save(folder / 'l_shape.npz')
    (folder / 'broken.csg').write_text('THIS IS NO SCENE ((')
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:])
    made = Bench([str(folder), str(folder / 'missing.csg')], 87 + worker % 8)
    yield made
    made.close()


def stamped(features, second=7):
    header = Header(frame_id='left_optical')
    header.stamp.sec = second
    return features_to_cloud(features, header)


def test_a_scene_gives_pose_report_and_markers_with_the_header_of_the_input(bench):
    scene = make_scene(l_shape(), 1, clutter=0.5)
    bench.send(stamped(scene.data, 42))
    bench.wait(lambda: all(bench.heard.values()))
    for messages in (
        bench.heard['interpretations'],
        bench.heard['interpretations/l_shape'],
        bench.heard['interpretations/report'],
    ):
        assert messages[0].header.stamp.sec == 42 and messages[0].header.frame_id == 'left_optical'
    pose = pose_from_message(bench.heard['interpretations/l_shape'][0].pose)
    error = pose.error_to(scene.poses[0])
    assert error.rotation_deg < 2.0 and error.translation < 2e-3
    best = interpretations_from_report(bench.heard['interpretations/report'][0])[0]
    assert best.accepted and best.model == 'l_shape' and len(best.assignment) == len(scene.data)
    assert len(bench.heard['interpretations/markers'][0].markers) >= 2


def test_nothing_found_is_an_empty_array(bench):
    bench.send(stamped(FeatureSet.empty(), 43))
    arrays = bench.heard['interpretations']
    bench.wait(lambda: arrays and arrays[-1].header.stamp.sec == 43)
    assert len(arrays[-1].poses) == 0
    assert all(pose.header.stamp.sec != 43 for pose in bench.heard['interpretations/l_shape'])
    assert 'no features' in bench.node.report_values()['why_nothing_found']


def test_bad_models_are_named_and_skipped(bench):
    problems = bench.node.report_values()['unusable_models']
    assert 'broken.csg' in problems and 'missing.csg' in problems
    assert bench.node.report_values()['models'] == 'l_shape'


def test_a_damaged_message_is_reported_and_the_node_lives(bench):
    message = stamped(make_scene(l_shape(), 1).data)
    message.data = message.data[:10]
    bench.send(message)
    before = bench.node.health.dropped
    bench.wait(lambda: bench.node.health.dropped > before)
    assert 'data' in bench.node.health.last_error
    bench.send(stamped(make_scene(l_shape(), 2).data, 44))
    arrays = bench.heard['interpretations']
    bench.wait(lambda: arrays and arrays[-1].header.stamp.sec == 44)
    assert len(arrays[-1].poses) == 1


def test_images_of_the_same_stamp_confirm_what_features_say():
    solid, shape = part('l_shape')
    pose, rig = at(shape, [25, 30, 0]), rig_for(shape)
    pair = images(solid, shape, [pose])
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:])
    other = Bench(['l_shape'], 40 + worker % 8)
    try:
        sides = ('left', 'right')
        infos = [other.other.create_publisher(CameraInfo, f'{side}/camera_info', 5) for side in sides]
        pictures = [other.other.create_publisher(Image, f'{side}/image_rect', 5) for side in sides]
        other.wait(lambda: all(out.get_subscription_count() == 1 for out in (*infos, *pictures)))
        assert other.node.silence() is None or 'image' not in other.node.silence()
        reports = other.heard['interpretations/report']
        for second, with_images in ((50, False), (51, True)):
            message = stamped(recover(*pair, rig).features, second)
            other.send(message)
            if with_images:  # they may come later than the features
                for out, info in zip(infos, camera_infos_from_rig(rig, message.header)):
                    out.publish(info)
                for out, picture in zip(pictures, pair):
                    out.publish(array_to_image(picture, 'mono8', message.header))
                other.wait(lambda: other.node._images.newest == 51 * 10**9)
                message.header.stamp.nanosec = 0
                other.send(message)
            other.wait(lambda second=second: reports and reports[-1].header.stamp.sec == second)
            best = interpretations_from_report(reports[-1])[0]
            assert np.isnan(best.support) != with_images
        assert best.accepted and best.support > 0.7 and best.evidence > 15.0
        assert pose.error_to(best.pose).rotation_deg < 0.3
        assert other.node.report_values()['with_images'] >= 1
        # Images have come: features that are ahead of them wait, but not for ever.
        other.send(stamped(FeatureSet.empty(), 60))
        other.wait(lambda: reports and reports[-1].header.stamp.sec == 60)
    finally:
        other.close()


def test_the_seed_is_accepted_without_effect(bench):
    before = bench.node._params
    assert bench.node.set_parameters([Parameter('seed', value=3)])[0].successful
    assert bench.node._params == before


def test_parameters_are_checked_and_models_can_be_exchanged(bench):
    refused = bench.node.set_parameters([Parameter('fracdev', value=-1.0)])[0]
    assert not refused.successful and 'fracdev' in refused.reason
    before = bench.node.config.models
    other = Path(before[0]) / 'other.npz'
    l_shape().save(other)
    assert bench.node.set_parameters([Parameter('models', value=[str(other)])])[0].successful
    assert bench.node.report_values()['models'] == 'other'
    bench.send(stamped(make_scene(l_shape(), 1).data, 45))
    reports = bench.heard['interpretations/report']
    bench.wait(lambda: reports and reports[-1].header.stamp.sec == 45)
    assert interpretations_from_report(reports[-1])[0].model == 'other'
    other.unlink()
    assert np.all(bench.node.set_parameters([Parameter('models', value=list(before))])[0].successful)


def test_a_mesh_in_millimetres_is_found_and_its_unit_said(tmp_path):
    """Features tell the working distance, and what was guessed before they came is guessed again."""
    trimesh = pytest.importorskip('trimesh')
    path = tmp_path / 'l_shape.ply'
    trimesh.creation.box((90.0, 50.0, 30.0)).export(path)
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:])
    bench = Bench([str(path)], 95 + worker % 5)
    try:
        data = make_scene(mesh_features_of(path), 4).data

        def found(features):
            bench.send(stamped(features))
            bench.wait(lambda: bench.heard['interpretations'])
            return len(bench.heard['interpretations'][0].poses)

        def unit():
            return bench.node.report_values()['mesh_units']

        assert found(data) == 1 and unit().startswith('l_shape: 107.2 mm across (guessed')
        bench.node.set_parameters([Parameter('mesh_units', value='m')])
        assert found(data) == 0 and unit() == 'l_shape: 107.2 m across'
        bench.node.set_parameters([Parameter('mesh_units', value='guess')])
        assert unit().startswith('l_shape: 107.2 mm')
        bench.node.reset()
        far = FeatureSet.from_edges(1e3 * data.start, 1e3 * data.end, 1.0, 1.0)  # a building, from half a kilometre
        assert found(far) == 1 and unit().startswith('l_shape: 107.2 m across')
    finally:
        bench.close()


def test_a_search_of_an_hour_holds_nothing_up(tmp_path):
    """Meanwhile parameters, services and diagnostics answer; changed parameters end it, and the newest is answered."""
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:])
    l_shape().save(tmp_path / 'l_shape.npz')
    bench = Bench([str(tmp_path), 'chair'], 48 + worker % 8)
    try:
        name = '/matcher_node'
        setter = bench.other.create_client(SetParametersAtomically, f'{name}/set_parameters_atomically')
        reset = bench.other.create_client(Trigger, f'{name}/reset')
        told = []
        bench.other.create_subscription(DiagnosticArray, '/diagnostics', told.append, 10)
        bench.wait(lambda: setter.service_is_ready() and reset.service_is_ready() and told)

        def answer(client, request):
            asked, future = time.monotonic(), client.call_async(request)
            bench.wait(future.done, 1.0)
            assert time.monotonic() - asked < 0.5
            return future.result()

        def set_to(**values):
            parameters = [Parameter(key, value=value).to_parameter_msg() for key, value in values.items()]
            assert answer(setter, SetParametersAtomically.Request(parameters=parameters)).result.successful

        rng = np.random.default_rng(0)
        start = np.column_stack([rng.uniform(-0.3, 0.3, (150, 2)), 0.8 + 0.02 * rng.normal(size=150)])
        vectors = np.eye(3)[rng.integers(0, 3, 150)] * rng.uniform(0.005, 0.06, (150, 1))
        crowd = FeatureSet.from_edges(start, start + vectors, 5e-3, 5e-3)
        arrays = bench.heard['interpretations']

        def waiting():
            newest = bench.node._search._newest
            return None if newest is None else newest.header.stamp.sec

        set_to(search='serial', time_limit=3600.0)
        bench.send(stamped(crowd, 1))
        bench.wait(lambda: bench.node._search.seconds > 0.3)
        told.clear()
        bench.wait(lambda: any(status.name == name for message in told for status in message.status), 1.5)
        for second in (2, 3, 4):
            bench.features.publish(stamped(make_scene(l_shape(), second).data, second))
            bench.wait(lambda second=second: waiting() == second)
        assert bench.node.health.passed_over == 2 and not arrays
        changed = time.monotonic()
        set_to(search='hypotheses', time_limit=2.0)
        bench.wait(lambda: arrays)
        assert time.monotonic() - changed < 1.25
        assert [message.header.stamp.sec for message in arrays] == [4] and len(arrays[0].poses) == 1
        set_to(search='serial', time_limit=3600.0)
        bench.send(stamped(crowd, 5))
        bench.wait(lambda: bench.node._search.seconds > 0.1)
        assert answer(reset, Trigger.Request()).success
        set_to(search='hypotheses', time_limit=2.0)
        bench.send(stamped(make_scene(l_shape(), 6).data, 6))
        bench.wait(lambda: arrays, 1.25)
        assert arrays[0].header.stamp.sec == 6
    finally:
        ending = time.monotonic()
        bench.close()
        assert time.monotonic() - ending < 2.0


def mesh_features_of(path):
    return load_library([str(path)]).models[0].features


def test_an_index_that_turns_out_to_be_damaged_is_used_no_longer(tmp_path):
    """Its checksums are compared beside the executor: until then the node answers from what is whole."""
    index = tmp_path / 'parts.index'
    write_catalogue(index, [indexed_model(random_polyhedron(k), f'm{k}') for k in range(20)])
    data = bytearray(index.read_bytes())
    data[data.rfind(b'[]')] ^= 1  # where its models are from
    (tmp_path / 'damaged.index').write_bytes(data)
    bench = Bench([str(index)], 86)
    try:
        bench.wait(lambda: bench.node._checking is None)
        assert bench.node.report_values()['models'] == '20 of 20 models of an index'
        models = Parameter('models', Parameter.Type.STRING_ARRAY, [str(tmp_path / 'damaged.index')])
        assert bench.node.set_parameters([models])[0].successful
        assert bench.node.report_values()['models'] == '20 of 20 models of an index'
        bench.wait(lambda: bench.node.why_silent())
        assert 'damaged.index: damaged: array sources does not have its checksum' in bench.node.why_silent()
        bench.send(stamped(make_scene(random_polyhedron(3), 3).data, 50))
        bench.wait(lambda: bench.heard['interpretations'])
        assert len(bench.heard['interpretations'][0].poses) == 0
    finally:
        bench.close()
