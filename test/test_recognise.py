"""All three nodes in one process: images in, an object found, and then followed."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from model_matcher.closed_form.recognise_node import Recognition
from msgs_py.codecs import array_to_image, camera_infos_from_rig, pose_from_message

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'src/model_matcher/test'))
from test_tracking import at, images, part, rig_for

PERIOD_NS = 100_000_000
PARAMETERS = """
/recovery_node:
  ros__parameters: {sigma: 0.9}
/matcher_node:
  ros__parameters: {models: [l_shape], min_matched: 4}
/tracker_node:
  ros__parameters: {models: [l_shape], acceleration: 3.0}
"""


@pytest.mark.timeout(300)
def test_images_alone_lead_to_a_followed_object(tmp_path):
    """Images are taken from the network once, and one parameter file has what each node is given."""
    solid, shape = part('l_shape')
    rig, pose = rig_for(shape), at(shape, [25, 30, 0])
    pair = images(solid, shape, [pose])
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:])
    context = Context()
    parameters = tmp_path / 'recognise.yaml'
    parameters.write_text(PARAMETERS)
    rclpy.init(args=['--ros-args', '--params-file', str(parameters)], context=context, domain_id=70 + worker % 8)
    together = Recognition(context)
    recovery, matcher, tracker = together.nodes
    # What hands something over to these calls them; the tracker, which works in its turns, is left to its executor.
    assert [node.inbox.turn is not None for node in together.nodes] == [True, True, False]
    assert (recovery.config.sigma, matcher.config.min_matched, tracker.config.acceleration) == (0.9, 4, 3.0)
    camera, executor = Node('camera', context=context), SingleThreadedExecutor(context=context)
    executor.add_node(camera)
    followed = []
    try:
        camera.create_subscription(PoseWithCovarianceStamped, 'tracked/l_shape', followed.append, 10)
        sides = ('left', 'right')
        infos = [camera.create_publisher(CameraInfo, f'{side}/camera_info', 5) for side in sides]
        pictures = [camera.create_publisher(Image, f'{side}/image_rect', 5) for side in sides]
        deadline, frame, due = time.monotonic() + 240.0, 0, 0.0
        while len(followed) < 5:
            assert time.monotonic() < deadline, [node.health.last_error for node in together.nodes]
            if time.monotonic() >= due:
                due, frame = time.monotonic() + 0.1, frame + 1
                header = Header(frame_id='left_optical')
                header.stamp.sec, header.stamp.nanosec = divmod(10**9 + frame * PERIOD_NS, 10**9)
                for out, info in zip(infos, camera_infos_from_rig(rig, header)):
                    out.publish(info)
                for out, picture in zip(pictures, pair):
                    out.publish(array_to_image(picture, 'mono8', header))
            executor.spin_once(timeout_sec=0.02)
        assert [out.get_subscription_count() for out in (*infos, *pictures)] == [1] * 4
        assert pose.error_to(pose_from_message(followed[-1].pose.pose)).rotation_deg < 0.3
    finally:
        together.close()
        camera.destroy_node()
        rclpy.try_shutdown(context=context)
