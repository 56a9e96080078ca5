"""Recordings of other programs in, recordings for other programs out; nothing of ROS runs."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from importlib import resources
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip('rosbags', reason='rosbags (pip) is not installed')
pytest.importorskip('mcap', reason='mcap (pip) is not installed')

import mcap.reader
from geometry_msgs.msg import PoseArray
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from csg_renderer import load_scene, render_stereo, scene_path
from model_matcher.closed_form.recognise_node import main as recognise
from model_matcher.closed_form.recordings.bag_reader import StereoBag
from model_matcher.closed_form.recordings.replay_cli import main as replay
from model_matcher.match_cli import main as match
from msgs_py import PinholeCamera, StereoRig, codecs
from stereo_recovery.cameras.calibration import load_cameras
from stereo_recovery.pair_files import read_pair

RIG = StereoRig.symmetric(PinholeCamera.centred(320, 320, 440.0), 0.03)
STORE, STORE1 = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
FRAME = 'stereo_left_optical_frame'
# The second pair is of an hour before the first: the clock was set.
STAMPS = (1_700_003_600_250_000_000, 1_700_000_000_000_000_000, 1_700_000_000_100_000_000)


@pytest.fixture(scope='module')
def pictures(tmp_path_factory) -> list[list[Path]]:
    """JPEG files of three pairs, and their calibration, camera.json beside them."""
    folder = tmp_path_factory.mktemp('pictures')
    camera = RIG.left
    matrix = [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]]
    record = {'width': camera.width, 'height': camera.height, 'K': matrix, 'baseline': RIG.baseline}
    (folder / 'camera.json').write_text(json.dumps(record))
    files: list[list[Path]] = []
    frames = render_stereo(load_scene(scene_path('l_shape_v1')), RIG, antialias=True)
    rng = np.random.default_rng(2)
    for number in range(len(STAMPS)):
        files.append([folder / f'{side}_{number}.jpg' for side in ('left', 'right')])
        for path, frame in zip(files[-1], frames):
            grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY) + rng.normal(0.0, 2.0, frame.image.shape[:2])
            cv2.imwrite(str(path), np.clip(np.rint(grey), 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 95])
    return files


def header(store, stamp_ns: int, sequence: dict):
    time = store.types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
    return store.types['std_msgs/msg/Header'](**sequence, stamp=time, frame_id=FRAME)


def info(store, side: int, capitals: bool, sequence: dict):
    """The message of one camera, with a stamp that no image has."""
    camera, offset = (RIG.left, 0.0) if side == 0 else (RIG.right, -RIG.right.fx * RIG.baseline)
    matrices = {
        'd': np.zeros(5),
        'k': np.array([camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]),
        'r': np.eye(3).ravel(),
        'p': np.array([camera.fx, 0.0, camera.cx, offset, 0.0, camera.fy, camera.cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
    }
    roi = store.types['sensor_msgs/msg/RegionOfInterest'](0, 0, 0, 0, False)
    return store.types['sensor_msgs/msg/CameraInfo'](
        header=header(store, 10**9, sequence),
        height=camera.height,
        width=camera.width,
        distortion_model='plumb_bob',
        binning_x=0,
        binning_y=0,
        roi=roi,
        **{name.upper() if capitals else name: value for name, value in matrices.items()},
    )


def recorded(store, pictures, capitals: bool = False, sequence: dict | None = None):
    """Topic, message and time of recording: camera_info once, here after the first images; a clock that is set back."""
    sequence = sequence or {}
    for number, (files, stamp) in enumerate(zip(pictures, STAMPS)):
        for side, path in zip(('left', 'right'), files):
            data = np.frombuffer(path.read_bytes(), np.uint8)
            message = store.types['sensor_msgs/msg/CompressedImage'](header(store, stamp, sequence), 'jpeg', data)
            yield f'/stereo/{side}/image_rect/compressed', message, 10**18 + number * 10**8
        if number == 0:
            for side, name in enumerate(('left', 'right')):
                yield f'/stereo/{name}/camera_info', info(store, side, capitals, sequence), 10**18 + 5 * 10**7


def write(writer, store, messages, serialise) -> None:
    with writer:
        connections = {}
        for topic, message, time_ns in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=store)
            writer.write(connections[topic], time_ns, serialise(message, message.__msgtype__))


@pytest.fixture(params=['mcap', 'sqlite3', 'ros1'])
def bag(request, tmp_path, pictures) -> Path:
    """What rosbags itself has written of these pictures."""
    if request.param == 'ros1':
        path = tmp_path / 'foreign.bag'
        write(Writer1(path), STORE1, recorded(STORE1, pictures, True, {'seq': 0}), STORE1.serialize_ros1)
        return path
    path = tmp_path / 'foreign'
    plugin = StoragePlugin.MCAP if request.param == 'mcap' else StoragePlugin.SQLITE3
    write(Writer(path, version=9, storage_plugin=plugin), STORE, recorded(STORE, pictures), STORE.serialize_cdr)
    return path


def test_pairs_of_foreign_bags(bag, pictures):
    pairs = list(StereoBag(bag))
    assert [pair.stamp_ns for pair in pairs] == list(STAMPS)
    assert {pair.frame_id for pair in pairs} == {FRAME}
    assert [pair.log_ns for pair in pairs] == [10**18 + k * 10**8 for k in range(3)]
    assert pairs[0].rig.baseline == pytest.approx(RIG.baseline)
    for pair, files in zip(pairs, pictures):
        for image, path in zip(pair.images, files):
            assert np.array_equal(image, cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))


def test_a_replayed_bag_gives_what_match_gives(bag, pictures, tmp_path, capsys):
    out = tmp_path / 'out.mcap'
    assert replay([str(bag), 'l_shape', '-o', str(out), '--inputs', '-q', '--json']) == 0
    record = json.loads(capsys.readouterr().out)
    expected = []
    for files in pictures:
        arguments = ['l_shape', *map(str, files), str(files[0].parent / 'camera.json'), '--json']
        assert match([*arguments, '-o', str(tmp_path / 'match.png')]) == 0
        expected.append(json.loads(capsys.readouterr().out)['found'][0])
    said = [pair['found'][0] for pair in record['pairs']]
    for mine, other in zip(said, expected):
        np.testing.assert_allclose(mine['position'], other['position'], atol=1e-9)
    assert [pair['stamp_ns'] for pair in record['pairs']] == list(STAMPS)

    # With the library of the format: schemas, encodings, stamps, checksums.
    with out.open('rb') as file:
        reader = mcap.reader.make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        summary = reader.get_summary()
        assert {channel.message_encoding for channel in summary.channels.values()} == {'cdr'}
        assert {schema.encoding for schema in summary.schemas.values()} == {'ros2msg'}
        messages = [(c.topic, s.name, m) for s, c, m in reader.iter_messages(log_time_order=False)]
    assert {m.publish_time for _, _, m in messages} == set(STAMPS)
    poses = [(name, m) for topic, name, m in messages if topic == '/interpretations/l_shape']
    assert [m.publish_time for _, m in poses] == list(STAMPS)
    assert {name for name, _ in poses} == {'geometry_msgs/msg/PoseStamped'}
    for (name, message), other in zip(poses, expected):
        decoded = STORE.deserialize_cdr(message.data, name)
        at = decoded.pose.position
        np.testing.assert_allclose([at.x, at.y, at.z], other['position'], atol=1e-9)
        assert decoded.header.frame_id == FRAME
        assert decoded.header.stamp.sec * 10**9 + decoded.header.stamp.nanosec == message.publish_time

    # With rosbags, by the definitions in the file.
    with AnyReader([out]) as again:
        topics = {c.topic: c.msgcount for c in again.connections}
        below = [f'/interpretations{each}' for each in ('', '/report', '/l_shape', '/l_shape/with_covariance')]
        assert {topic: topics[topic] for topic in ('/features', *below)} == dict.fromkeys(('/features', *below), 3)
        assert topics['/stereo/left/image_rect/compressed'] == 3
        features = again.messages([c for c in again.connections if c.topic == '/features'])
        clouds = [again.deserialize(data, connection.msgtype) for connection, _, data in features]
        assert [cloud.width for cloud in clouds] == [pair['features'] for pair in record['pairs']]
    # And what was written can be replayed.
    assert [pair.stamp_ns for pair in StereoBag(out)] == list(STAMPS)


def test_raw_images_are_rectified(tmp_path):
    """The chessboard's pair as it was taken, under the names of a driver, and its calibration as ROS has it."""
    folder = Path(str(resources.files('stereo_recovery') / 'data' / 'chessboard'))
    files = [folder / f'{side}01.jpg' for side in ('left', 'right')]
    cameras = load_cameras(folder / 'calibration.yaml', (640, 480))
    messages = []
    for side, (path, camera) in enumerate(zip(files, cameras)):
        told = info(STORE, side, False, {})
        for name in ('width', 'height', 'distortion_model'):
            setattr(told, name, getattr(camera, name))
        for name in 'dkrp':
            setattr(told, name, np.array(getattr(camera, name), float))
        messages.append((f'/cam{side}/camera_info', told, 10**18))
        data = np.frombuffer(path.read_bytes(), np.uint8)
        image = STORE.types['sensor_msgs/msg/CompressedImage'](header(STORE, STAMPS[0], {}), 'jpeg', data)
        messages.append((f'/cam{side}/image_raw/compressed', image, 10**18))
    write(Writer(tmp_path / 'bag', version=9), STORE, messages, STORE.serialize_cdr)
    topics = ['/cam0/image_raw/compressed', '/cam1/image_raw/compressed']
    (pair,) = StereoBag(tmp_path / 'bag', topics, raw=True)
    expected = read_pair((files[0], files[1]), folder / 'calibration.yaml', raw=True)
    for image, other in zip(pair.images, (expected.left, expected.right)):
        assert np.array_equal(image, other)
    assert pair.rig == expected.rig
    with pytest.raises(
        ValueError, match='no topic ends in left/image_rect; there are /cam0/image_raw/compressed, /cam1'
    ):
        list(StereoBag(tmp_path / 'bag'))


def test_nothing_of_ros_runs(tmp_path, pictures):
    write(Writer(tmp_path / 'bag', version=9), STORE, recorded(STORE, pictures[:1]), STORE.serialize_cdr)
    code = (
        'import sys\n'
        'from model_matcher.closed_form.recordings.replay_cli import main\n'
        f'assert main([{str(tmp_path / "bag")!r}, "l_shape", "-o", {str(tmp_path / "out.mcap")!r}, "-q"]) == 0\n'
        'assert "rclpy" not in sys.modules\n'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_what_recognise_records_can_be_replayed(graph, tmp_path, pictures):
    """The process as users start it, ended as they end it."""
    out = tmp_path / 'live.mcap'
    arguments = ['--record', str(out), '--ros-args', '-p', "models:=['l_shape']"]
    environment = os.environ | {'ROS_DOMAIN_ID': str(graph.domain_id)}
    code = 'from model_matcher.closed_form.recognise_node import main; raise SystemExit(main())'
    process = subprocess.Popen(
        [sys.executable, '-c', code, *arguments], env=environment, stderr=subprocess.PIPE, text=True
    )
    try:
        found = graph.collect(PoseArray, 'interpretations')
        images = [graph.publisher(Image, f'{side}/image_rect') for side in ('left', 'right')]
        infos = [graph.publisher(CameraInfo, f'{side}/camera_info') for side in ('left', 'right')]
        # The three nodes share one subscription, and the recorder has its own.
        graph.spin_until(
            lambda: all(p.get_subscription_count() == 2 for p in (*images, *infos)), 60.0, 'the nodes and the recorder'
        )
        # It looks for topics every so often; between nodes of one process features go without a subscription.
        results = {'/features': 1, '/interpretations': 2, '/interpretations/l_shape': 1}
        graph.spin_until(
            lambda: all(graph.tester.count_subscribers(topic) == count for topic, count in results.items()),
            60.0,
            'the recorder at all topics',
        )

        def publish(second: int) -> None:
            at = Header(frame_id=FRAME)
            at.stamp.sec = second
            for publisher, message in zip(infos, codecs.camera_infos_from_rig(RIG, at)):
                publisher.publish(message)
            for publisher, path in zip(images, pictures[0]):
                grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
                publisher.publish(codecs.array_to_image(grey, 'mono8', at))

        # A publisher knows of a subscription before that knows of it, and what is sent between is lost.
        first = 0
        while not found:
            first += 1
            assert first <= 30, 'no interpretation'
            publish(first)
            with contextlib.suppress(pytest.fail.Exception):
                graph.spin_until(lambda: found, 2.0)
        for second in range(first + 1, first + 4):
            publish(second)
            graph.spin_until(lambda n=second: found[-1].header.stamp.sec == n, 60.0, 'an interpretation')
        live = codecs.pose_from_message(found[-1].poses[0])
        process.send_signal(signal.SIGINT)
        assert process.wait(30.0) == 0
    finally:
        process.kill()
        said = process.communicate()[1]
    with out.open('rb') as file:
        reader = mcap.reader.make_reader(file, validate_crcs=True)
        counts: dict[str, int] = {}
        total = 0
        for schema, channel, message in reader.iter_messages():
            total += 1
            if schema.name not in ('visualization_msgs/msg/MarkerArray', 'std_msgs/msg/String'):  # without a header
                second = message.publish_time / 1e9
                assert second in range(1, first + 4), channel.topic
                counts[channel.topic] = counts.get(channel.topic, 0) + int(second > first)
        assert reader.get_summary().statistics.message_count == total
    recorded_topics = {f'/{side}/{name}' for side in ('left', 'right') for name in ('image_rect', 'camera_info')}
    for topic in (*recorded_topics, '/features', '/interpretations', '/interpretations/l_shape'):
        assert counts.get(topic) == 3, f'{topic}: {counts}\n{said}'
    assert replay([str(out), 'l_shape', '-q', '-o', str(tmp_path / 'again.mcap')]) == 0
    with AnyReader([tmp_path / 'again.mcap']) as again:
        poses = again.messages([c for c in again.connections if c.topic == '/interpretations/l_shape'])
        pose = [again.deserialize(data, connection.msgtype) for connection, _, data in poses][-1].pose.position
    np.testing.assert_allclose([pose.x, pose.y, pose.z], live.translation, atol=1e-6)


@pytest.mark.parametrize('name', ['poses.bag', 'there.mcap'])
def test_recognise_does_not_start_without_its_file(tmp_path, capsys, name):
    (tmp_path / 'there.mcap').write_bytes(b'precious')
    assert recognise(['--record', str(tmp_path / name)]) == 2
    assert f'recognise: cannot start: {tmp_path / name}: ' in capsys.readouterr().err


def test_a_broken_image_costs_one_pair_and_is_named(tmp_path, pictures, capsys):
    messages = list(recorded(STORE, pictures))
    messages[-1][1].data = messages[-1][1].data[:500]
    write(Writer(tmp_path / 'bag', version=9), STORE, messages, STORE.serialize_cdr)
    assert replay([str(tmp_path / 'bag'), 'l_shape', '-q']) == 0
    said = capsys.readouterr()
    assert '2 pairs' in said.out
    assert (
        f'{tmp_path / "bag"}: /stereo/right/image_rect/compressed: image.data: 500 bytes of a JPEG without' in said.err
    )


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        (
            ['--left', '/cam0/image_raw', '--right', '/cam1/image_raw'],
            'there is no topic /cam0/image_raw; there are /stereo',
        ),
        (['--left', '/cam0/image_raw'], '--left, --right: expected both'),
        (['-o', 'poses.bag'], 'poses.bag: expected a name that ends in .mcap'),
        (None, 'there.mcap: is there already'),
    ],
)
def test_typical_mistakes_are_named(tmp_path, pictures, capsys, change, text):
    write(Writer(tmp_path / 'bag', version=9), STORE, recorded(STORE, pictures), STORE.serialize_cdr)
    there = tmp_path / 'there.mcap'
    there.write_bytes(b'precious')
    change = ['-o', str(there)] if change is None else change
    assert replay([str(tmp_path / 'bag'), 'l_shape', '-q', *change]) == 2
    assert text in capsys.readouterr().err
    assert there.read_bytes() == b'precious'


def test_what_is_no_bag_is_named(tmp_path, capsys):
    (tmp_path / 'torn.mcap').write_bytes(b'\x89MCAP0\r\n torn')
    for name, text in {'missing': 'no such bag', 'torn.mcap': 'not a bag that can be read'}.items():
        assert replay([str(tmp_path / name), 'l_shape', '-q']) == 2
        assert f'{tmp_path / name}: {text}' in capsys.readouterr().err
