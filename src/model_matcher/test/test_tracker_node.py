"""tracker_node over real topics: images and interpretations in, poses out; lost, found again, reset, clock set back."""

import os
import shutil
import sys
import time
from pathlib import Path

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402
from geometry_msgs.msg import PoseWithCovarianceStamped  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from sensor_msgs.msg import CameraInfo, Image  # noqa: E402
from std_msgs.msg import Header  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from csg_renderer.language.includes import models_folder  # noqa: E402
from model_matcher.catalogue.folder import update_catalogue  # noqa: E402
from model_matcher.closed_form.synthetic.scenes import random_polyhedron  # noqa: E402
from model_matcher.tracker_node import TrackerNode  # noqa: E402
from msgs_py import Interpretation  # noqa: E402
from msgs_py.codecs import (  # noqa: E402
    array_to_image,
    camera_infos_from_rig,
    pose_from_message,
    pose_to_message,
    report_from_interpretations,
)

sys.path.insert(0, str(Path(__file__).parent))
from test_tracking import at, images, part, rig_for  # noqa: E402

SIDES = ('left', 'right')


class Bench:
    """A tracker_node, and a node that publishes what it needs and hears all that it says."""

    def __init__(self, domain, model='l_shape', found=()):
        """model : parameter models; found : models that are not known before they are found."""
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        models = Parameter('models', Parameter.Type.STRING_ARRAY, [model])
        self.node = TrackerNode(context=self.context, parameter_overrides=[models])
        self.other = Node('observer', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        for node in (self.node, self.other):
            self.executor.add_node(node)
        self.poses, self.reports = [], []
        self.other.create_subscription(PoseWithCovarianceStamped, 'tracked/l_shape', self.poses.append, 10)
        self.other.create_subscription(DiagnosticArray, 'tracked/report', self.reports.append, 10)
        self.pictures = [self.other.create_publisher(Image, f'{side}/image_rect', 5) for side in SIDES]
        self.infos = [self.other.create_publisher(CameraInfo, f'{side}/camera_info', 5) for side in SIDES]
        self.found = self.other.create_publisher(DiagnosticArray, 'interpretations/report', 5)
        self.start = self.other.create_publisher(PoseWithCovarianceStamped, 'track/l_shape', 5)
        outs = (*self.pictures, *self.infos, self.found, *([] if found else [self.start]))
        self.wait(
            lambda: (
                all(out.get_subscription_count() == 1 for out in outs)
                and self.node.count_subscribers('tracked/report') == 1
                and self.other.count_publishers('tracked/l_shape') == (0 if found else 1)
                and not self.node.compiling
            ),
            120.0,
        )

    def wait(self, predicate, seconds=20.0):
        deadline = time.monotonic() + seconds
        while not predicate():
            assert time.monotonic() < deadline, f'waited in vain: {self.node.health.last_error}'
            self.executor.spin_once(timeout_sec=0.05)

    def header(self, frame):
        header = Header(frame_id='left_optical')
        header.stamp.sec, header.stamp.nanosec = divmod(10**9 + frame * 33_333_333, 10**9)
        return header

    def show(self, frame, poses):
        """Publish a pair, and wait until it is answered; the status of the part."""
        solid, shape = part('l_shape')
        header = self.header(frame)
        for out, info in zip(self.infos, camera_infos_from_rig(rig_for(shape), header)):
            out.publish(info)
        for out, picture in zip(self.pictures, images(solid, shape, poses, seed=frame)):
            out.publish(array_to_image(picture, 'mono8', header))
        self.wait(lambda: any(report.header.stamp == header.stamp for report in self.reports))
        status = next(report for report in self.reports if report.header.stamp == header.stamp).status
        return status[0] if status else None

    def tell(self, frame, pose, name='l_shape'):
        """Publish where the matcher found the part in a frame."""
        covariance = np.diag([1e-6] * 3 + [1e-4] * 3)
        one = Interpretation(name, [0], [1], pose, covariance=covariance)
        self.found.publish(report_from_interpretations([one], self.header(frame)))

    def close(self):
        for node in (self.node, self.other):
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)


@pytest.fixture
def bench():
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:])
    made = Bench(61 + worker % 8)
    yield made
    made.close()


def moving(frame):
    _, shape = part('l_shape')
    return at(shape, [25, 30 + 1.5 * frame, 0], [0.01 * frame, 0.0, 0.0])


def test_a_part_is_followed_from_an_interpretation_of_an_earlier_frame(bench):
    for frame in range(4):
        status = bench.show(frame, [moving(frame)])
    assert status.level == DiagnosticStatus.STALE
    assert not bench.poses
    bench.tell(1, moving(1))
    bench.wait(lambda: bench.node._followed)
    for frame in range(4, 7):
        status = bench.show(frame, [moving(frame)])
    assert status.level == DiagnosticStatus.OK
    assert status.message == 'followed'
    bench.wait(lambda: len(bench.poses) == 3)
    last = bench.poses[-1]
    assert last.header.stamp == bench.header(6).stamp
    assert last.header.frame_id == 'left_optical'
    assert moving(6).error_to(pose_from_message(last.pose.pose)).rotation_deg < 0.2
    covariance = np.array(last.pose.covariance).reshape(6, 6)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert bench.node.report_values()['followed'] == 'l_shape'


def test_a_part_that_is_gone_is_lost_and_taken_up_again(bench):
    bench.show(0, [moving(0)])
    message = PoseWithCovarianceStamped(header=bench.header(0))
    message.pose.pose = pose_to_message(moving(0))
    bench.start.publish(message)
    bench.wait(lambda: bench.node._followed)
    assert bench.show(1, [moving(0)]).level == DiagnosticStatus.OK
    for frame in range(2, 5):
        status = bench.show(frame, [])
    assert status.level == DiagnosticStatus.WARN
    assert 'lost' in status.message
    heard = len(bench.poses)
    elsewhere = at(part('l_shape')[1], [25, 30, 0], [-0.4, 0.2, 0.0])
    bench.show(5, [elsewhere])
    assert len(bench.poses) == heard
    bench.tell(5, elsewhere)
    bench.wait(lambda: bench.node.report_values()['followed'] == 'l_shape')
    assert bench.show(6, [elsewhere]).level == DiagnosticStatus.OK
    assert bench.node.report_values()['times_lost'] == 1


def test_reset_and_a_clock_set_back_forget_what_was_followed(bench):
    for forget in ('reset', 'clock'):
        bench.show(100, [moving(0)])
        bench.tell(100, moving(0))
        bench.wait(lambda: bench.node._followed)
        assert bench.show(101, [moving(0)]).level == DiagnosticStatus.OK
        if forget == 'reset':
            bench.node._on_reset(Trigger.Request(), Trigger.Response())
            assert not bench.node._followed
            bench.reports.clear()
        else:
            assert bench.show(10, [moving(0)]).level == DiagnosticStatus.STALE


def test_models_without_a_solid_are_named(bench, tmp_path):
    from csg_renderer import load_models, model_features

    model_features(next(iter(load_models('l_shape').values()))).save(tmp_path / 'only_features.npz')
    bench.node._trusted = type(bench.node._trusted)([tmp_path], (), 'model_folders')
    path = str(tmp_path / 'only_features.npz')
    assert bench.node.set_parameters([Parameter('models', value=[path])])[0].successful
    assert 'cannot be followed' in bench.node.health.last_error
    assert 'no model can be followed' in bench.node.why_silent()


def test_a_part_of_an_index_is_known_from_its_first_pose_on(tmp_path):
    shutil.copy(Path(str(models_folder())) / 'l_shape.csg', tmp_path / 'l_shape.csg')
    random_polyhedron(3).save(tmp_path / 'wires.npz')
    update_catalogue(tmp_path, tmp_path / 'models.index')
    bench = Bench(70, str(tmp_path / 'models.index'), found=('l_shape',))
    try:
        assert bench.show(0, [moving(0)]) is None and bench.node.why_silent() is None
        for name, problem in (('stranger', 'stranger is found, which'), ('wires', 'wires: no solid is known of it')):
            bench.tell(0, moving(0), name)
            bench.wait(lambda: problem in bench.node.health.last_error)  # noqa: B023
        bench.tell(0, moving(0))
        bench.wait(lambda: bench.node._followed)
        status = bench.show(1, [moving(1)])
        assert status.level == DiagnosticStatus.OK and status.name == 'l_shape'
        assert bench.node.report_values()['models'] == 'l_shape of the 2 of an index'
        bench.wait(lambda: bench.poses)
    finally:
        bench.close()
