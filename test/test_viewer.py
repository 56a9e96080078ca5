"""The page that shows what is seen and found: as a file, served, live from topics; looked at in a real browser."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
import urllib.error
import urllib.request

import numpy as np
import pytest
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from csg_renderer import default_rig, load_scene, model_features, render_stereo, scene_path
from csg_renderer.raycast.sensor import grey
from model_matcher.closed_form.following.follow import FollowedFrame, PictureFrame
from model_matcher.closed_form.viewing.view_cli import main
from model_matcher.closed_form.viewing.view_files import followed_moment, moment_of, recorded_moments
from model_matcher.image_pose.views import Views
from model_matcher.model.library import load_library
from model_matcher.viewer_node import ViewerNode
from model_matcher.viewing import page as page_module
from model_matcher.viewing.moments import Moment, Placed
from model_matcher.viewing.page import NoPlotly, page_of, write_page
from model_matcher.viewing.server import PageServer
from msgs_py import Interpretation, Pose
from msgs_py.codecs import (
    array_to_image,
    camera_infos_from_rig,
    features_to_cloud,
    features_to_markers,
    report_from_interpretations,
)
from stereo_recovery import recover

pytest.importorskip('plotly', reason='the page draws with plotly')


@pytest.fixture(scope='module')
def demo():
    """The demo's first scene: true pose, rig, pair, features and the moment that the page shows."""
    scene = load_scene(scene_path('l_shape_v1'))
    rig = default_rig(scene)
    left, right = (grey(frame.image) for frame in render_stereo(scene, rig, antialias=4))
    pair = [np.rint(image).astype(np.uint8) for image in (left, right)]
    models = load_library(['l_shape']).models
    moment = moment_of(models, recover(*pair, rig).features, Views.of(pair, rig))
    pose = Pose.from_matrix(scene.camera_T_scene.matrix @ scene.placements[0].matrix)
    return pose, rig, pair, {model.name: model.features for model in models}, moment


def data_of(page: str) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[1])


def shown_lines(browser, name):
    """(n, 3) of the points of a trace in the view in space, millimetres."""
    found = browser.evaluate(
        f"""(() => {{ const t = document.getElementById('space').data.find((one) => one.name === {json.dumps(name)});
        return [...t.x].map((x, k) => [x, t.y[k], t.z[k]]).filter((p) => p[0] !== null); }})()"""
    )
    return np.array(found, float)


def drawn_lines(browser, kind, camera):
    """Ends of the lines drawn over an image, each (m, 2), pixels."""
    found = browser.evaluate(
        f"""[...document.querySelectorAll('#images svg[data-camera="{camera}"] polyline.{kind}')]
        .map((one) => one.getAttribute('points'))"""
    )
    return [np.array([[float(v) for v in point.split(',')] for point in text.split(' ')]) for text in found]


def eye(browser):
    return browser.evaluate(
        "(() => { const c = document.getElementById('space')._fullLayout.scene.camera.eye; return [c.x, c.y, c.z]; })()"
    )


def assert_quiet(browser, *allowed):
    assert not browser.errors(), browser.errors()
    asked = [url for url in browser.asked() if not url.startswith(('file:', 'data:', 'blob:', *allowed))]
    assert not asked, asked


# -- in a browser ------------------------------------------------------------------------------------------------------


@pytest.mark.timeout(180)
def test_the_demo_in_a_browser_without_a_network(browser, demo, tmp_path):
    pose, rig, pair, models, moment = demo
    write_page(tmp_path / 'view.html', 'the demo', models, [moment])
    network = {'latency': 0, 'downloadThroughput': -1, 'uploadThroughput': -1}
    browser.send('Network.emulateNetworkConditions', offline=True, **network)
    try:
        browser.open(tmp_path / 'view.html')
        browser.wait("document.body.dataset.step === '0'", 60.0)
    finally:
        browser.send('Network.emulateNetworkConditions', offline=False, **network)
    # The object stands where it truly is: in space, in both images, and in the table.
    true = model_features(load_scene(scene_path('l_shape')).placements[0].model).transformed(pose)
    points = np.concatenate([true.start, true.end])
    found = shown_lines(browser, 'l_shape')
    gap = np.linalg.norm(found[:, None] - 1e3 * points[None], axis=2)
    assert gap.min(axis=1).max() < 0.1 and gap.min(axis=0).max() < 0.1
    for number, camera in enumerate((rig.left, rig.right)):
        pixels = camera.project(points - [number * rig.baseline, 0.0, 0.0])
        lines = np.concatenate(drawn_lines(browser, 'model', number))
        assert np.linalg.norm(lines[:, None] - pixels[None], axis=2).min(axis=1).max() < 0.5
        assert len(drawn_lines(browser, 'feature', number)) == len(moment.features)
    cells = browser.evaluate("[...document.querySelectorAll('#objects tbody td')].map((one) => one.textContent)")
    assert cells[0] == 'l_shape'
    assert np.allclose([float(v) for v in cells[1].split()], 1e3 * pose.translation, atol=0.1)
    names = browser.evaluate("document.getElementById('space').data.map((one) => one.name)")
    assert {'edges', 'errors of edges', 'l_shape', 'error of l_shape', 'l_shape: x', 'camera 0', 'camera 1'} <= set(
        names
    )
    assert browser.evaluate("document.getElementById('space').querySelectorAll('canvas').length") >= 1
    # It turns under the mouse.
    before = eye(browser)
    browser.drag('#space', [(0.5, 0.5), (0.55, 0.52), (0.65, 0.55), (0.75, 0.6)])
    browser.wait(f"Math.abs(document.getElementById('space')._fullLayout.scene.camera.eye.x - {before[0]}) > 0.05")
    # What is unticked goes, and the view stays as it was turned.
    turned = eye(browser)
    browser.mouse('#features', click=True)
    browser.wait("!document.getElementById('space').data.some((one) => one.name === 'edges')")
    assert not drawn_lines(browser, 'feature', 0) and np.allclose(eye(browser), turned)
    assert_quiet(browser)


@pytest.mark.timeout(180)
def test_a_recording_has_a_time_slider(browser, demo, tmp_path):
    _, _, _, models, moment = demo
    poses = [Pose(np.eye(3), [0.0, 0.0, 0.2 + 0.01 * k]) for k in range(4)]
    moments = [Moment(0.1 * k, moment.views, placed=(Placed('part', 'l_shape', pose),)) for k, pose in enumerate(poses)]
    write_page(tmp_path / 'view.html', 'a recording', models, moments)
    browser.open(tmp_path / 'view.html')
    browser.wait("document.body.dataset.step === '0'", 60.0)
    near = shown_lines(browser, 'part')
    browser.mouse('#slider', 0.999, 0.5, click=True)
    browser.wait("document.body.dataset.step === '3'")
    assert np.allclose(shown_lines(browser, 'part') - near, [0.0, 0.0, 30.0], atol=1e-6)
    assert browser.evaluate("document.getElementById('where').textContent") == '4 of 4, 0.300 s'
    browser.mouse('#play', click=True)
    browser.wait("document.body.dataset.step === '1'")
    browser.mouse('#play', click=True)
    assert_quiet(browser)


@pytest.mark.timeout(180)
def test_what_is_live_on_topics_is_shown_in_a_browser(browser, graph, demo):
    pose, rig, pair, models, moment = demo
    node = graph.add(ViewerNode, parameters={'port': 0})
    from diagnostic_msgs.msg import DiagnosticArray
    from sensor_msgs.msg import CameraInfo, Image, PointCloud2
    from visualization_msgs.msg import MarkerArray

    sides = ('left', 'right')
    infos = [graph.publisher(CameraInfo, f'{side}/camera_info') for side in sides]
    pictures = [graph.publisher(Image, f'{side}/image_rect') for side in sides]
    cloud = graph.publisher(PointCloud2, 'features')
    report = graph.publisher(DiagnosticArray, 'interpretations/report')
    markers = graph.publisher(MarkerArray, 'interpretations/markers')
    graph.wait_matched(*infos, *pictures, cloud, report, markers)
    n = len(moment.features)
    nothing = np.full(n, -1, np.int32), np.zeros(n, np.int8)

    def publish(second, shift):
        header = Header(frame_id='left_optical')
        header.stamp.sec = second
        for out, info in zip(infos, camera_infos_from_rig(rig, header)):
            out.publish(info)
        for out, picture in zip(pictures, pair):
            out.publish(array_to_image(picture, 'mono8', header))
        cloud.publish(features_to_cloud(moment.features, header))
        placed = Pose(pose.rotation, pose.translation + [0.0, 0.0, shift])
        found = Interpretation('l_shape', *nothing, placed, covariance=1e-8 * np.eye(6))
        report.publish(report_from_interpretations([found], header))
        lines = models['l_shape'].transformed(placed)
        markers.publish(features_to_markers(lines, header, 'l_shape/0'))
        whole = {'images', 'features', 'found', 'wires'}
        graph.spin_until(lambda: set(node._parts.get(second * 10**9, ())) >= whole, what=f'moment {second}')

    browser.open(node.server.url)
    assert browser.evaluate("document.getElementById('words').textContent").startswith('waiting')
    publish(1, 0.0)
    browser.wait("document.body.dataset.stamp === '1'", 60.0)
    publish(2, 0.05)
    publish(3, 0.05)
    browser.wait("document.body.dataset.stamp === '3'", 60.0)
    true = models['l_shape'].transformed(Pose(pose.rotation, pose.translation + [0.0, 0.0, 0.05]))
    gap = np.linalg.norm(
        shown_lines(browser, 'l_shape')[:, None] - 1e3 * np.concatenate([true.start, true.end])[None], axis=2
    )
    assert gap.min(axis=1).max() < 1e-3
    assert len(drawn_lines(browser, 'feature', 1)) == n
    assert_quiet(browser, node.server.url)


# -- without one -------------------------------------------------------------------------------------------------------


def test_a_pair_becomes_one_file_that_names_no_address(demo, tmp_path, capsys):
    import cv2

    _, rig, pair, _, _ = demo
    for side, image in zip(('left', 'right'), pair):
        cv2.imwrite(str(tmp_path / f'{side}.png'), image)
    camera = rig.left
    matrix = [[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]]
    record = {'K': matrix, 'width': camera.width, 'height': camera.height, 'baseline': rig.baseline}
    (tmp_path / 'camera.json').write_text(json.dumps(record))
    files = [str(tmp_path / name) for name in ('left.png', 'right.png', 'camera.json')]
    out = tmp_path / 'page.html'
    assert main(['l_shape', *files, '-o', str(out), '--json']) == 0
    assert json.loads(capsys.readouterr().out) == {'moments': 1, 'found': 1, 'out': str(out)}
    page = out.read_text()
    own = page.replace(page_module.plotly_script(), '')
    assert not re.search(r'(src|href)="(?!data:|\$\{)|url\(|https?://|@import', own)
    (shown,) = data_of(page)['moments']
    assert [one['model'] for one in shown['objects']] == ['l_shape'] and len(shown['images']) == 2


@pytest.mark.parametrize('with_images', [True, False])
def test_a_recording_is_shown_as_it_was_with_what_was_found_then(demo, tmp_path, with_images, capsys):
    """A file with results, as nodes and replay publish them: the pose is the recorded one, though it is wrong."""
    pytest.importorskip('rosbags')
    pytest.importorskip('mcap')
    from model_matcher.closed_form.recordings.mcap_file import McapFile

    pose, rig, pair, _, moment = demo
    nothing = np.full(len(moment.features), -1, np.int32), np.zeros(len(moment.features), np.int8)
    wrong = [Pose(pose.rotation, pose.translation + [0.0, 0.0, 0.01 * k]) for k in (1, 2)]
    path = tmp_path / 'results.mcap'
    with McapFile(path) as file:
        for number, placed in enumerate(wrong):
            header = Header(frame_id='left_optical')
            header.stamp.sec, header.stamp.nanosec = 1_700_000_000, number * 500_000_000
            at = header.stamp.sec * 10**9 + header.stamp.nanosec
            if with_images:
                for side, picture, info in zip(('left', 'right'), pair, camera_infos_from_rig(rig, header)):
                    file.write(f'/stereo/{side}/image_rect', array_to_image(picture, 'mono8', header), at)
                    file.write(f'/stereo/{side}/camera_info', info, at)
            file.write('/stereo/features', features_to_cloud(moment.features, header), at)
            found = Interpretation('l_shape', *nothing, placed)
            file.write('/stereo/interpretations/report', report_from_interpretations([found], header), at)
    shown = list(recorded_moments([], path))
    assert [one.stamp_s for one in shown] == [0.0, 0.5]
    assert [one.placed[0].pose.error_to(true).translation for one, true in zip(shown, wrong)] == [0.0, 0.0]
    assert all(one.features == moment.features for one in shown)
    assert all((one.views is not None) == with_images for one in shown)
    assert main(['l_shape', str(path), '-o', str(tmp_path / 'page.html'), '-q', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['found'] == 2


def test_nothing_in_the_data_ends_the_script():
    page = page_of('<b>&', {}, [Moment(0.0, words='</script><script>alert(1)</script>')])
    assert page.count('<script') == 3 + page_module.plotly_script().count('<script')
    assert '<title>&lt;b&gt;&amp;</title>' in page
    assert data_of(page)['moments'][0]['words'] == '</script><script>alert(1)</script>'


def test_a_lost_object_is_a_moment_without_it(demo):
    _, rig, pair, _, _ = demo
    lost = followed_moment('part', FollowedFrame(PictureFrame(0.5, tuple(pair), rig), None, False, 1.0))
    assert not lost.placed and lost.words == 'part: lost' and lost.stamp_s == 0.5


@pytest.mark.parametrize(
    ('arguments', 'says'),
    [
        (['l_shape'], 'l_shape: expected files to look at'),
        (['nowhere.csg', 'x'], 'nowhere.csg'),
        (['l_shape', 'nowhere'], 'nowhere: no such folder'),
        (['l_shape', 'a.png', 'b.png'], 'expected left image, right image and calibration, or one recording'),
        (['l_shape', 'a.png', 'b.png', 'c.yaml'], 'a.png'),
        (['l_shape', 'x', '-o', 'page.txt'], 'page.txt: expected a file name ending in .html'),
        (['l_shape', 'x', '--ros-args'], '--ros-args: goes with a live view'),
        (['l_shape', 'x', '--every', '0'], '--every'),
    ],
)
def test_what_cannot_be_viewed_is_named_in_one_line(arguments, says, capsys):
    assert main([*arguments, '--port', '0']) == 2
    said = capsys.readouterr().err
    assert said.startswith('view: ') and said.count('\n') == 1 and says in said


def test_a_port_that_is_taken_is_said_in_one_line(capsys):
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ValueError, match=f'port {port}: another program'):
            PageServer('', port)
        assert main(['l_shape', 'no.png', 'no.png', 'no.yaml', '--port', str(port)]) == 2
        assert capsys.readouterr().err.startswith(f'view: port {port}: another program')
        command = [sys.executable, '-m', 'model_matcher.viewer_node', '--ros-args', '-p', f'port:={port}']
        result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 2
    assert result.stderr.splitlines()[-1].startswith(f'viewer_node: parameter port {port}: another program'), (
        result.stderr
    )
    assert 'Traceback' not in result.stderr


def test_the_server_answers_this_machine_alone_and_sends_the_newest(monkeypatch):
    monkeypatch.setattr('model_matcher.viewing.server.SILENT_S', 0.05)
    server = PageServer('<p>here</p>', 0)
    try:
        assert urllib.request.urlopen(server.url, timeout=5).read() == b'<p>here</p>'
        for url, host, code in ((server.url + 'x', 'localhost:1', 404), (server.url, 'elsewhere.example:80', 403)):
            with pytest.raises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(urllib.request.Request(url, headers={'Host': host}), timeout=5)
            assert refused.value.code == code
        with urllib.request.urlopen(server.url + 'events', timeout=5) as events:
            server.show(lambda: {'n': 1})
            assert next(line for line in events if line.startswith(b'data')) == b'data: {"n":1}\n'
            assert next(line for line in events if line.startswith(b':')) == b': still here\n'
            server.show(lambda: {'n': 2})
            assert next(line for line in events if line.startswith(b'data')) == b'data: {"n":2}\n'
    finally:
        server.close()


def test_what_is_not_installed_is_named(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(page_module.resources, 'files', lambda package: tmp_path)
    with pytest.raises(NoPlotly, match='pip install plotly'):
        page_module.plotly_script()
    assert main(['l_shape', 'no.npz']) == 2
    assert 'pip install plotly' in capsys.readouterr().err


def test_a_set_back_clock_starts_the_live_view_afresh(graph, demo):
    from sensor_msgs.msg import PointCloud2

    node = graph.add(ViewerNode, parameters={'port': 0})
    cloud = graph.publisher(PointCloud2, 'features')
    graph.wait_matched(cloud)
    for count, second in enumerate((100, 5), 1):
        header = Header(frame_id='left_optical')
        header.stamp.sec = second
        cloud.publish(features_to_cloud(demo[4].features, header))
        graph.spin_until(lambda count=count: node.health.processed == count)
    assert node._shown == 5 * 10**9
    answer = node.set_parameters([Parameter('port', value=1234)])[0]
    assert not answer.successful
