"""A raw pair of lenses that distort, end to end: taken, rectified and recovered, beside the same pair without them."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger

from csg_renderer import load_scene, render_stereo
from csg_renderer.node import RendererNode
from csg_renderer.params import RendererConfig
from csg_renderer.raycast.render import scene_rig
from model_matcher.closed_form.comparison import compare_edges
from msgs_py import LensDistortion, StereoRig
from msgs_py.codecs import cloud_to_features, image_to_array
from stereo_recovery.node import RecoveryNode

SCENE = 'l_shape_v1'
LENSES = {
    'plumb_bob': (-0.3, 0.08, 0.001, -0.0008, 0.0),
    'rational_polynomial': (0.6, -0.1, 0.0004, -0.0003, 0.02, 0.95, 0.05, 0.01),
    'equidistant': (-0.02, 0.004, -0.003, 0.0006),
}


@pytest.mark.parametrize(
    ('model', 'encoding', 'bits'),
    [('plumb_bob', 'mono8', 0), ('rational_polynomial', 'bayer_grbg16', 12), ('equidistant', 'mono16', 12)],
)
def test_recovery_of_a_raw_pair_finds_what_it_finds_without_lenses(graph, model, encoding, bits):
    graph.add(
        RendererNode,
        parameters={
            'scene': SCENE,
            'rate': 0.0,
            'distortion_model': model,
            'distortion': list(LENSES[model]),
            'right_distortion': [0.9 * value for value in LENSES[model]],
            'encoding': encoding,
            'bits': bits,
            'full_well': 10000.0,
            'psf': 0.5,
        },
    )
    own = {'image_bits': bits} if bits else {}
    graph.add(RecoveryNode, parameters=own)
    remaps = ['left/image_rect:=left/image_raw', 'right/image_rect:=right/image_raw', 'features:=raw/features']
    arguments = ['--ros-args', '-r', '__node:=raw_recovery_node', *(word for remap in remaps for word in ('-r', remap))]
    graph.add(RecoveryNode, parameters={'rectify': True, **own}, cli_args=arguments)
    topics = {'features': PointCloud2, 'raw/features': PointCloud2, 'ground_truth/features': PointCloud2}
    topics |= {'left/image_raw': Image, 'left/image_rect': Image, 'left/camera_info': CameraInfo}
    heard = {topic: graph.collect(kind, topic) for topic, kind in topics.items()}
    graph.wait_heard(*(f'/{topic}' for topic in topics), '/right/image_raw', '/right/image_rect', '/right/camera_info')
    answer = graph.call(Trigger, '/renderer_node/render', Trigger.Request())
    assert answer.success, answer.message
    graph.spin_until(lambda: all(heard.values()), 60.0, 'features of both')
    info = heard['left/camera_info'][0]
    assert info.distortion_model == model and tuple(info.d) == LENSES[model]
    raw, plain = (image_to_array(heard[f'left/image_{kind}'][0]) for kind in ('raw', 'rect'))
    assert raw[1] == plain[1] == encoding and np.mean(raw[0] != plain[0]) > 0.1
    assert len({m[0].header.stamp.nanosec for m in heard.values()}) == 1
    truth, with_lens, without = (
        cloud_to_features(heard[topic][0]) for topic in ('ground_truth/features', 'raw/features', 'features')
    )
    rectified, ideal = (compare_edges(truth, found) for found in (with_lens, without))
    assert rectified.recall > 0.9 and rectified.recall > ideal.recall - 0.05
    errors = [np.nanmedian(one.across_m) for one in (rectified, ideal)]
    assert errors[0] < 2.0 * errors[1] + 1e-5, errors


def test_raw_pictures_are_those_of_the_library_and_nothing_else_is_rendered(graph):
    lens = LensDistortion('equidistant', LENSES['equidistant'])
    node = graph.add(
        RendererNode,
        parameters={
            'scene': SCENE,
            'rate': 20.0,
            'width': 64,
            'distortion_model': 'equidistant',
            'distortion': list(LENSES['equidistant']),
        },
    )
    raw = [graph.collect(Image, f'{side}/image_raw') for side in ('left', 'right')]
    infos = [graph.collect(CameraInfo, f'{side}/camera_info') for side in ('left', 'right')]
    graph.spin_until(lambda: all(raw) and all(infos), 60.0, 'a raw pair')
    scene = load_scene(SCENE)
    rig = StereoRig.from_camera_info(infos[0][0], infos[1][0])
    assert rig == scene_rig(scene, 64)
    for frame, side in zip(render_stereo(scene, rig, lens=lens, antialias=4), (0, 1)):
        picture = node.config.sensor(0, side).picture(frame, monochrome=True)
        assert np.array_equal(image_to_array(raw[side][0])[0], picture)


def test_without_lenses_raw_and_rectified_pictures_are_the_same(graph):
    graph.add(RendererNode, parameters={'scene': SCENE, 'rate': 0.0, 'width': 64, 'noise': 3.0})
    heard = [graph.collect(Image, f'left/image_{kind}') for kind in ('raw', 'rect')]
    graph.wait_heard('/left/image_raw', '/left/image_rect')
    assert graph.call(Trigger, '/renderer_node/render', Trigger.Request()).success
    graph.spin_until(lambda: all(heard), 30.0, 'both pictures')
    assert heard[0][0].data == heard[1][0].data


@pytest.mark.parametrize(
    ('wrong', 'name'),
    [
        ({'distortion_model': 'plumb_bob'}, 'distortion: .*5 finite'),
        ({'distortion_model': 'equidistant', 'distortion': (0.0,) * 5}, 'distortion: .*4 finite'),
        ({'distortion_model': 'barrel'}, 'distortion_model'),
        ({'distortion_model': 'equidistant', 'distortion': (0.0,) * 4, 'engine': 'dap'}, "distortion_model: .*'dap'"),
    ],
)
def test_a_lens_that_cannot_be_is_refused_by_name(wrong, name):
    with pytest.raises(ValueError, match=f'parameter {name}'):
        RendererConfig(**wrong)
