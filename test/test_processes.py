"""Four processes started from their executables, talking over DDS."""

from __future__ import annotations

import signal
import time

from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import Image

SCENE = 'l_shape_v1'


def test_four_processes_yield_a_pose_for_each_pair_and_stop_cleanly(graph, processes):
    poses = graph.collect(PoseStamped, 'interpretations/l_shape')
    lefts = graph.collect(Image, 'left/image_rect')
    running = [
        processes('emulator_node'),
        processes('matcher_node', models=f"['{SCENE}']"),
        processes('recovery_node'),
        processes('renderer_node', scene=SCENE, rate='2.0', antialias='4', noise='1.0'),
    ]
    # The first pairs pass while nodes are still being discovered and code compiled.
    graph.spin_until(lambda: len(poses) >= 4, 28.0, 'four poses')
    answered = [pose.header for pose in poses[1:]]
    graph.spin_until(lambda: any(image.header == answered[-1] for image in lefts), what='the image of the last pose')
    shown = [image.header for image in lefts]
    between = shown[shown.index(answered[0]) : shown.index(answered[-1]) + 1]
    assert answered == between, 'a pose for every pair, with its stamp and frame'
    assert answered[0].frame_id == 'camera_left_optical_frame'
    for process in running:
        process.send_signal(signal.SIGINT)
    deadline = time.monotonic() + 10.0
    codes = [process.wait(max(0.1, deadline - time.monotonic())) for process in running]
    assert codes == [0, 0, 0, 0]
