"""BOP scenes and the bin-picking challenge's requests: answered, written, and scored as bop_toolkit scores them."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent / 'benchmarks'))
import bench_bop
import bop_scenes
import bop_scoring
from stand_ins import messages

from csg_renderer import MeshOutline, SolidOutline
from model_matcher.closed_form.bop import bpc_node
from model_matcher.closed_form.bop.answer import load_models
from model_matcher.closed_form.bop.bop_cli import main
from model_matcher.closed_form.bop.bpc_requests import answer_request
from model_matcher.closed_form.bop.results import COLUMNS, BopResult, read_results, write_results
from model_matcher.closed_form.bop.scene_folder import ModelInfo, read_models_info, read_scene
from msgs_py import Pose
from msgs_py.codecs import array_to_image, pose_from_message, pose_to_message

K = np.array([[900.0, 0.0, 319.5], [0.0, 900.0, 239.5], [0.0, 0.0, 1.0]])
SIZE = (640, 480)
# Errors that bop_toolkit (cea62d6) gives for answers that are off by a symmetry, or are not, and by a little and much:
# part; MSSD, mm; MSPD, px; VSD at tau 0.05, 0.2, 0.5.
TOOLKIT = """
1 3.365066 3.769848 0.136339 0.081662 0.081662
1 26.502788 37.701126 0.973073 0.757247 0.519027
1 40.0 7.602688 1.0 1.0 0.410289
1 60.451171 110.614329 0.836159 0.774617 0.774617
1 80.297293 127.682418 1.0 0.990976 0.936621
1 90.513953 105.317724 1.0 1.0 0.869162
1 47.693296 90.654614 0.628068 0.555201 0.517887
1 67.170292 117.850376 0.977798 0.711845 0.560618
1 69.626511 85.547208 1.0 0.991048 0.568608
2 3.066223 4.060987 0.118274 0.074576 0.074576
2 27.626293 31.98788 1.0 0.751462 0.407489
2 40.0 6.382786 1.0 1.0 1.0
2 2.740851 3.963662 0.116452 0.061854 0.061854
2 28.68046 34.162385 1.0 0.624757 0.368932
2 40.0 6.382786 1.0 1.0 1.0
2 40.178306 76.528556 0.564451 0.522837 0.495813
2 57.920439 95.601466 0.971583 0.592152 0.543843
2 62.139654 72.504591 1.0 1.0 0.940611
3 2.842841 3.095835 0.079186 0.057919 0.057692
3 25.656373 31.793001 1.0 0.896571 0.511799
3 40.0 5.076048 1.0 1.0 1.0
3 2.598134 2.968957 0.084906 0.062668 0.062444
3 25.055625 31.83484 1.0 0.888292 0.535754
3 40.0 5.076048 1.0 1.0 1.0
3 2.820158 2.340919 0.087659 0.062386 0.062158
3 22.09115 26.778083 1.0 0.867477 0.600274
3 40.026188 5.075169 1.0 1.0 1.0
"""
# ibpc_interfaces of opencv/bpc.
BPC_MSGS = {
    'Camera': 'sensor_msgs/CameraInfo info\ngeometry_msgs/Pose pose\nsensor_msgs/Image rgb\nsensor_msgs/Image depth\n'
    'sensor_msgs/Image aolp\nsensor_msgs/Image dolp',
    'Photoneo': 'sensor_msgs/CameraInfo info\ngeometry_msgs/Pose pose\nsensor_msgs/Image rgb\nsensor_msgs/Image depth',
    'PoseEstimate': 'uint64 obj_id\nfloat64 score\ngeometry_msgs/Pose pose',
    'Request': 'uint64[] object_ids\nCamera[] cameras\nPhotoneo photoneo',
    'Response': 'PoseEstimate[] pose_estimates',
}


@pytest.fixture(scope='module')
def data(tmp_path_factory) -> Path:
    """A data set: models, a scene of three cameras and one of a camera that moved."""
    folder = tmp_path_factory.mktemp('bop')
    bop_scenes.write_models(folder / 'models')
    bop_scenes.write_scene(folder / 'val' / '000004')
    bop_scenes.write_scene(folder / 'moved' / '000005', one_camera=True)
    return folder


def model_info(data: Path) -> dict[int, ModelInfo]:
    return read_models_info(data / 'models' / 'models_info.json')


# -- answers ---------------------------------------------------------------------------------------------------------


@pytest.mark.timeout(180)
def test_scenes_of_three_cameras_and_of_one_that_moved_are_answered_and_score_full_marks(data, tmp_path, capsys):
    for scene, views in ((data / 'val' / '000004', 1), (data / 'moved' / '000005', 3)):
        out = tmp_path / f'{scene.name}.csv'
        assert main([str(scene), str(data / 'models'), '-o', str(out), '-q', '--json']) == 0
        assert json.loads(capsys.readouterr().out)['poses'] == 3 * views
        assert out.read_text().splitlines()[0] == 'scene_id,im_id,obj_id,score,R,t,time'
        assert {(one.scene_id, one.object_id) for one in read_results(out)} == {(int(scene.name), k) for k in (1, 2, 3)}
        recall = bench_bop.score([scene], data / 'models', out)
        assert recall.true == 3 * views
        assert recall.average() == {'MSSD': 1.0, 'MSPD': 1.0, 'VSD': 1.0, 'AR': 1.0}
    # Of several cameras poses are in the world, tenths of a millimetre from the truth.
    found = {one.object_id: one for one in read_results(tmp_path / '000004.csv')}
    error = bop_scenes.object_poses(0)[1].error_to(found[1].pose)
    assert error.rotation_deg < 0.1 and error.translation < 2e-4


@pytest.mark.timeout(180)
def test_a_request_of_the_challenge_is_answered_in_its_units_and_frame(data):
    msg = messages('ibpc_interfaces', BPC_MSGS)
    scene, models = read_scene(data / 'val' / '000004'), load_models(data / 'models')
    cameras = []
    for name in scene.cameras:
        image = scene.images[name][0]
        camera = msg.Camera(rgb=array_to_image(image.read(), 'mono8'))
        camera.rgb.encoding = '8UC1'  # as the challenge's tester calls it
        camera.info.k = image.matrix.ravel()
        # The challenge hands over world-to-camera, in millimetres.
        place = image.camera_T_world
        camera.pose = pose_to_message(Pose(place.rotation, 1e3 * place.translation))
        cameras.append(camera)
    answer = answer_request(msg.Request(object_ids=[1, 3, 1], cameras=cameras), models, msg.PoseEstimate)
    assert sorted(one.obj_id for one in answer) == [1, 3]
    (found,) = [one for one in answer if one.obj_id == 1]
    pose = pose_from_message(found.pose)
    true = bop_scenes.object_poses(0)[1]
    assert np.linalg.norm(pose.translation - 1e3 * true.translation) < 0.2
    assert Pose(pose.rotation).error_to(Pose(true.rotation)).rotation_deg < 0.1
    with pytest.raises(ValueError, match='object 9: no model of it is known, only of 1, 2, 3'):
        answer_request(msg.Request(object_ids=[9], cameras=cameras), models, msg.PoseEstimate)
    with pytest.raises(ValueError, match='cameras: 1, expected two or more'):
        answer_request(msg.Request(object_ids=[1], cameras=cameras[:1]), models, msg.PoseEstimate)
    cameras[1].info.k = np.zeros(9)
    with pytest.raises(ValueError, match=r'cameras\[1\]: fx'):
        answer_request(msg.Request(object_ids=[1], cameras=cameras), models, msg.PoseEstimate)


@pytest.mark.timeout(180)
def test_the_service_of_the_challenge_lives_through_a_bad_request(graph, data, monkeypatch):
    """With a stand-in of its messages, which cannot be sent: the request is handed to the node."""
    msg = messages('ibpc_interfaces', BPC_MSGS)
    monkeypatch.setattr(bpc_node, 'challenge_messages', lambda: (msg, SimpleNamespace(GetPoseEstimates=object)))
    offered = {}

    class Node(bpc_node.EstimatorNode):
        def create_service(self, kind, name, answer, **options):
            if kind is object:
                offered[name] = answer
                return None
            return super().create_service(kind, name, answer, **options)

    node = graph.add(Node, parameters={'model_dir': str(data / 'models')})
    task = graph.executor.create_task(offered['get_pose_estimates'], msg.Request(object_ids=[1]), msg.Response())
    graph.spin_until(task.done, 120.0, 'the answer')
    assert task.result().pose_estimates == []
    assert node.health.last_error.startswith('get_pose_estimates: cameras: 0, expected two or more')


def test_without_the_messages_of_the_challenge_the_node_names_what_else_there_is():
    result = subprocess.run(
        [sys.executable, '-m', 'model_matcher.closed_form.bop.bpc_node'],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.returncode == 2 and 'Traceback' not in result.stderr
    assert 'bpc_node: ibpc_interfaces is not installed' in result.stderr


def test_targets_say_which_images_are_answered_and_what_is_looked_for(data, tmp_path, capsys):
    scene, out = data / 'moved' / '000005', tmp_path / 'r.csv'
    targets = tmp_path / 'test_targets_bop19.json'
    entries = [(5, 2, 3), (5, 2, 1), (9, 0, 2)]
    targets.write_text(json.dumps([dict(zip(('scene_id', 'im_id', 'obj_id'), one)) for one in entries]))
    assert main([str(scene), str(data / 'models'), '-o', str(out), '-q', '--targets', str(targets)]) == 0
    assert sorted((one.image_id, one.object_id) for one in read_results(out)) == [(2, 1), (2, 3)]
    # That of detection names images only.
    targets.write_text(json.dumps([{'scene_id': 5, 'im_id': 1}]))
    assert main([str(scene), str(data / 'models'), '-o', str(out), '-q', '--targets', str(targets)]) == 0
    assert sorted((one.image_id, one.object_id) for one in read_results(out)) == [(1, 1), (1, 2), (1, 3)]
    capsys.readouterr()
    targets.write_text('[{"scene_id": 5}]')
    assert main([str(scene), str(data / 'models'), '-q', '--targets', str(targets)]) == 2
    assert "entry 0: no field 'im_id'" in capsys.readouterr().err


# -- files -----------------------------------------------------------------------------------------------------------


def test_results_are_read_as_they_were_written(tmp_path):
    pose = Pose.from_rotation_vector([0.3, -1.2, 0.4], [0.0123, -0.2, 0.7])
    write_results(tmp_path / 'r.csv', [BopResult(48, 3, 12, 7.25, pose, 0.125)])
    head, line = (tmp_path / 'r.csv').read_text().splitlines()
    cells = line.split(',')
    assert head == ','.join(COLUMNS) and len(cells) == len(COLUMNS)
    assert cells[5] == '12.3 -200 700' and cells[6] == '0.1250'
    (again,) = read_results(tmp_path / 'r.csv')
    assert again.pose.error_to(pose).rotation_deg < 1e-6 and (again.scene_id, again.object_id) == (48, 12)
    (tmp_path / 'r.csv').write_text(head + '\n1,2,3,4,0 0 0,1 2 3,1\n')
    with pytest.raises(ValueError, match=r'r\.csv: line 2'):
        read_results(tmp_path / 'r.csv')


def spoilt(data: Path, folder: Path, change) -> Path:
    """A copy of the scene of three cameras, changed."""
    scene = folder / '000004'
    shutil.copytree(data / 'val' / '000004', scene)
    change(scene)
    return scene


def rewrite(name: str, change):
    def do(scene: Path) -> None:
        record = json.loads((scene / name).read_text())
        change(record['0'])
        (scene / name).write_text(json.dumps(record))

    return do


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        (lambda scene: (scene / 'rgb_cam2' / '000000.png').unlink(), 'rgb_cam2/000000.png: no such image'),
        (
            rewrite('scene_camera_cam1.json', lambda record: record.pop('cam_K')),
            "scene_camera_cam1.json: image 0: no field 'cam_K'",
        ),
        (rewrite('scene_camera_cam1.json', lambda record: record.pop('cam_R_w2c')), 'has no cam_R_w2c and cam_t_w2c'),
        (rewrite('scene_camera_cam1.json', lambda record: record['cam_K'].__setitem__(1, 3.0)), 'no skew'),
        (
            rewrite('scene_gt_cam1.json', lambda records: records[0].update(cam_R_m2c=[0.0] * 9)),
            'scene_gt_cam1.json: image 0: cam_R_m2c: no rotation',
        ),
        (lambda scene: (scene / 'scene_camera_cam3.json').write_text('[]'), 'scene_camera_cam3.json: expected a JSON'),
        (lambda scene: [one.unlink() for one in scene.glob('*.json')], 'has no scene_camera.json'),
        (lambda scene: cv2.imwrite(str(scene / 'rgb_cam2' / '000000.png'), np.zeros((4, 4), np.uint8)), None),
    ],
)
def test_what_is_wrong_with_a_scene_is_named_in_one_line(data, tmp_path, capsys, change, says):
    scene = spoilt(data, tmp_path, change)
    code = main([str(scene), str(data / 'models'), '-o', str(tmp_path / 'r.csv'), '-q'])
    if says is None:  # a camera that sees nothing leaves what the others see
        assert code in (0, 1)
        return
    said = capsys.readouterr().err
    assert code == 2 and said.count('\n') == 1 and says in said, said


def test_what_is_wrong_with_the_arguments_is_named_in_one_line(data, tmp_path, capsys):
    scene = str(data / 'val' / '000004')
    for arguments, says in (
        ([scene], 'expected folders of scenes and then that of the models'),
        ([scene, str(tmp_path)], 'holds no models'),
        ([str(tmp_path / 'nowhere'), str(data / 'models')], 'nowhere: no such folder'),
        ([scene, str(data / 'models'), '--objects', '8'], 'object 8: no model of it is known'),
    ):
        assert main([*arguments, '-q']) == 2
        said = capsys.readouterr().err
        assert said.startswith('bop: ') and said.count('\n') == 1 and says in said


def test_a_solid_beside_a_mesh_is_taken_for_it(data, tmp_path):
    """Both have an outline; that of the solid is exact."""
    shutil.copytree(data / 'models', tmp_path / 'models')
    (tmp_path / 'models' / 'obj_000001.csg').write_text(f'UNITS MM;\nDRAW {bop_scenes.SOLIDS[1]};\n')
    models = load_models(tmp_path / 'models')
    assert isinstance(models[1].shape, SolidOutline) and isinstance(models[2].shape, MeshOutline)


# -- scores ----------------------------------------------------------------------------------------------------------


def test_errors_are_those_of_the_toolkit(data):
    """Against numbers that bop_toolkit gives, with hidden parts and pixels without depth."""
    rows = [[float(cell) for cell in line.split()] for line in TOOLKIT.split('\n') if line]
    true = Pose.from_rotation_vector([0.4, -0.2, 0.9], [12.0, -7.0, 480.0])
    turns = [[0.0, 0.0, 0.0], [np.pi, 0.0, 0.0], [0.0, 0.0, 1.3]]
    offs = [
        ([0.02, 0.01, -0.03], [1.0, -0.5, 2.0]),
        ([0.3, -0.1, 0.2], [-6.0, 4.0, 15.0]),
        ([0.0, 0.0, 0.0], [0.0, 0.0, 40.0]),
    ]
    found = []
    for part, (points, faces) in bop_scenes.meshes().items():
        info = model_info(data)[part]
        symmetries = bop_scoring.symmetry_poses(info)
        assert len(symmetries) == {1: 1, 2: 4, 3: 630}[part]
        depth = bop_scoring.mesh_depth(points, faces, true, K, SIZE)
        seen = np.where((depth > 0.0) & (depth < 520.0), depth, 520.0)
        seen[:240, :335], seen[250:256] = 300.0, 0.0
        for turn in turns:
            for vector, shift in offs:
                about = Pose.from_rotation_vector(turn).compose(Pose.from_rotation_vector(vector))
                pose = Pose(true.rotation @ about.rotation, true.translation + shift)
                drawn = bop_scoring.mesh_depth(points, faces, pose, K, SIZE)
                visible = bop_scoring.vsd(drawn, depth, seen, K, info.diameter, [0.05, 0.2, 0.5])
                surface = bop_scoring.mssd(pose, true, points, symmetries)
                found.append([part, surface, bop_scoring.mspd(pose, true, points, symmetries, K), *visible])
    np.testing.assert_allclose(found, rows, atol=2e-4)


def test_errors_in_closed_form():
    points = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 2, 0], [0, -2, 0], [0, 0, 3], [0, 0, -3]])
    true, nothing = Pose(np.eye(3), [0.0, 0.0, 100.0]), [Pose.identity()]
    shifted = Pose(np.eye(3), [3.0, 4.0, 100.0])
    assert bop_scoring.mssd(shifted, true, points, nothing) == pytest.approx(5.0)
    # 5 / 97 at the nearest vertex, with a focal length of 970.
    matrix = np.diag([970.0, 970.0, 1.0])
    assert bop_scoring.mspd(shifted, true, points, nothing, matrix) == pytest.approx(50.0)
    turned = Pose(np.diag([-1.0, -1.0, 1.0]), true.translation)
    assert bop_scoring.mssd(turned, true, points, nothing) == pytest.approx(4.0)
    half = ModelInfo(6.0, discrete=(Pose(np.diag([-1.0, -1.0, 1.0])),))
    assert bop_scoring.mssd(turned, true, points, bop_scoring.symmetry_poses(half)) == pytest.approx(0.0)
    # An axis off the origin: a half turn about it moves the origin by twice its distance.
    axis = ModelInfo(6.0, continuous=((np.array([0.0, 0.0, 2.0]), np.array([5.0, 0.0, 7.0])),))
    moved = max(np.linalg.norm(one.translation) for one in bop_scoring.symmetry_poses(axis))
    assert moved == pytest.approx(10.0, abs=0.01)
    assert all(abs(one.translation[2]) < 1e-12 for one in bop_scoring.symmetry_poses(axis))


def test_visible_surface_in_closed_form():
    matrix = np.array([[1e6, 0, 49.5], [0, 1e6, 49.5], [0, 0, 1.0]])  # so long a lens that rays are parallel
    true, found = np.zeros((100, 100)), np.zeros((100, 100))
    true[:, :60], found[:, 30:90] = 500.0, 504.0
    seen = np.full((100, 100), 600.0)
    seen[true > 0.0] = 500.0
    # Columns 0-29 are the true one's alone, 30-59 both's, 60-89 the found one's alone: 4 of a diameter of 40 is 0.1.
    errors = bop_scoring.vsd(found, true, seen, matrix, 40.0, [0.05, 0.2])
    assert errors.tolist() == pytest.approx([1.0, 60.0 / 90.0])
    # What is in front hides the columns from 60 on, and of the true one those to 29.
    seen[:, 60:], seen[:, :30] = 300.0, 300.0
    assert bop_scoring.vsd(found, true, seen, matrix, 40.0, [0.2]).tolist() == [0.0]
    assert bop_scoring.vsd(np.zeros_like(true), np.zeros_like(true), seen, matrix, 40.0).tolist() == [1.0] * 10


def test_depth_of_a_mesh_is_that_of_the_solid(data):
    """The box as triangles against the rendered solid."""
    scene = read_scene(data / 'val' / '000004')
    points, faces = bop_scenes.meshes()[2]
    view = scene.images['cam1'][0]
    (pose,) = [one.pose for one in scene.truth['cam1'][0] if one.object_id == 2]
    drawn = bop_scoring.mesh_depth(points, faces, Pose(pose.rotation, 1e3 * pose.translation), view.matrix, SIZE)
    seen = bench_bop.read_depth(scene, 'cam1', 0)
    both = (drawn > 0.0) & (seen > 0.0)
    assert both.sum() > 0.995 * (drawn > 0.0).sum() > 5000
    assert np.abs(drawn - seen)[both].max() < 2.0 * bop_scenes.DEPTH_SCALE


def test_every_true_pose_counts_once():
    errors = np.array([[0.1, 0.3], [0.05, 0.6], [0.2, 0.2]])
    assert [bop_scoring.matched(errors, limit) for limit in (0.01, 0.15, 0.25, 1.0)] == [0, 1, 2, 2]
    assert bop_scoring.matched(np.zeros((0, 2)), 1.0) == 0
