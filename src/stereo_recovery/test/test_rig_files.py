"""Calibration files of any number of cameras."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from msgs_py import CameraRig, FeatureSet, PinholeCamera, Pose
from stereo_recovery import recover
from stereo_recovery.cameras.rig_files import load_camera_rig
from stereo_recovery.recover_cli import main

SIZE = (640, 480)
K = [[700.0, 0.0, 310.0], [0.0, 710.0, 245.0], [0.0, 0.0, 1.0]]
TURNED = Pose.from_rotation_vector([0.1, -0.2, 0.3], [0.1, -0.2, 0.05])
IN_LINE = Pose(translation=np.array([0.12, 0.0, 0.0]))


def entry(pose: Pose, digits: int = 12) -> dict:
    back = pose.inverse()
    return {'width': 640, 'height': 480, 'K': K, 'R': back.rotation.round(digits).tolist(), 't': [*back.translation]}


def ours(folder: Path, *entries: dict) -> Path:
    file = folder / 'rig.json'
    file.write_text(json.dumps({'cameras': [{'K': K}, *entries]}))
    return file


def agree(rig, poses) -> None:
    assert len(rig) == len(poses) and rig.cameras[0].fy == 710.0
    for found, pose in zip(rig.poses, poses):
        np.testing.assert_allclose(found.matrix, pose.matrix, atol=1e-4)


def test_our_own_form_has_poses_of_any_kind(tmp_path):
    rig = load_camera_rig(ours(tmp_path, entry(IN_LINE), entry(TURNED, digits=4)), SIZE)
    agree(rig, [Pose.identity(), IN_LINE, TURNED])
    # Sizes that the file does not say are those of the images.
    assert rig.cameras[0].width == SIZE[0]


def test_a_chain_of_kalibr_is_composed(tmp_path):
    def camera(before: Pose | None, pose: Pose) -> dict:
        step = {} if before is None else {'T_cn_cnm1': pose.inverse().compose(before).matrix.tolist()}
        return {'camera_model': 'pinhole', 'intrinsics': [700, 710, 310, 245], 'resolution': [640, 480], **step}

    poses = [Pose.identity(), IN_LINE, TURNED]
    chain = {f'cam{k}': camera(poses[k - 1] if k else None, pose) for k, pose in enumerate(poses)}
    file = tmp_path / 'camchain.yaml'
    file.write_text(json.dumps(chain))
    agree(load_camera_rig(file, SIZE), poses)


def projection(x: float, y: float) -> list[float]:
    return [700.0, 0.0, 310.0, -700.0 * x, 0.0, 710.0, 245.0, -710.0 * y, 0.0, 0.0, 1.0, 0.0]


PARALLEL = [Pose(translation=np.array([x, y, 0.0])) for x, y in ((0.0, 0.0), (0.12, 0.0), (0.0, -0.1))]


def test_three_projection_matrices_of_opencv_are_parallel_cameras(tmp_path):
    matrix = '{}: !!opencv-matrix\n   rows: 3\n   cols: 4\n   dt: d\n   data: {}\n'
    places = [(0.0, 0.0), (0.12, 0.0), (0.0, -0.1)]
    file = tmp_path / 'rig.yml'
    file.write_text(
        '%YAML:1.0\n---\n' + ''.join(matrix.format(f'P{k + 1}', projection(*at)) for k, at in enumerate(places))
    )
    agree(load_camera_rig(file, SIZE), PARALLEL)


def test_three_documents_of_ros_are_parallel_cameras(tmp_path):
    documents = [
        {
            'camera_matrix': {'data': np.ravel(K).tolist()},
            'projection_matrix': {'data': projection(*pose.translation[:2])},
        }
        for pose in PARALLEL
    ]
    file = tmp_path / 'rig.yaml'
    file.write_text('\n---\n'.join(json.dumps(document) for document in documents))
    agree(load_camera_rig(file, SIZE), PARALLEL)


def test_a_file_of_a_pair_is_a_rig_of_two(tmp_path):
    file = tmp_path / 'camera.json'
    file.write_text(json.dumps({'K': K, 'baseline': 0.12}))
    agree(load_camera_rig(file, SIZE), [Pose.identity(), IN_LINE])


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'R': None}, 'rig.json: camera 1: R is None, expected 9 numbers'),
        ({'t': [1.0]}, 'rig.json: camera 1: t is .* expected 3 numbers'),
        ({'R': [[2.0, 0, 0], [0, 1, 0], [0, 0, 1]]}, 'rig.json: camera 1: rotation: not orthonormal'),
        ({'K': [[700.0, 3.0, 310.0], [0.0, 710.0, 245.0], [0.0, 0.0, 1.0]]}, 'rig.json: camera 1: K has skew'),
        ({'width': 0}, 'rig.json: camera 1: width: expected a whole number'),
    ],
)
def test_what_a_file_lacks_is_named(tmp_path, change, message):
    with pytest.raises(ValueError, match=message):
        load_camera_rig(ours(tmp_path, {**entry(TURNED), **change}), SIZE)
    short = {key: value for key, value in entry(TURNED).items() if key != 't'}
    with pytest.raises(ValueError, match=r'rig.json: camera 1: t is missing'):
        load_camera_rig(ours(tmp_path, short), SIZE)


def test_command_line_takes_an_image_of_each_camera(tmp_path, synthetic, solids, capsys):
    camera = PinholeCamera(320, 240, 350.0, 350.0, 155.0, 122.0)
    rig = CameraRig([camera] * 3, PARALLEL)
    solid = solids['wedge'].at(Pose.from_rotation_vector([-0.6, 0.5, 0.4], [0.05, -0.03, 0.45]))
    images = [synthetic.render(solid, camera, pose.translation, seed=k) for k, pose in enumerate(PARALLEL)]
    files = [str(tmp_path / f'{k}.png') for k in range(3)]
    for file, image in zip(files, images):
        cv2.imwrite(file, image)
    matrix = camera.matrix.tolist()
    calibration = tmp_path / 'rig.json'
    calibration.write_text(
        json.dumps({'cameras': [{**entry(pose), 'K': matrix, 'width': 320, 'height': 240} for pose in PARALLEL]})
    )
    assert main([*files, str(calibration), '-o', str(tmp_path / 'found')]) == 0
    expected = recover(images, rig).features
    found = FeatureSet.load(tmp_path / 'found' / 'features.npz')
    assert len(found) == len(expected) > 3
    np.testing.assert_allclose(found.start, expected.start, atol=1e-9)
    assert 'baseline' not in json.loads((tmp_path / 'found' / 'camera.json').read_text())
    for arguments, message in (
        ([*files, files[0]], 'rig.json: has 3 cameras, for 4 images'),
        ([*files, '--raw'], '--raw: goes with two images'),
        (files[:1], 'expected a left and a right image'),
    ):
        capsys.readouterr()
        names = [name for name in arguments if name != '--raw']
        assert main([*names, str(calibration), *[a for a in arguments if a == '--raw'], '-o', str(tmp_path)]) == 2
        assert message in capsys.readouterr().err
