"""A new user's path, as the pages tell it: their commands are taken from the pages and run, in order.

Rendered images stand in for the camera. What is left out: make setup (the environment is here) and ros2 (the test
listens itself).
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from geometry_msgs.msg import PoseStamped
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

import csg_renderer
from msgs_py import codecs

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / 'README.md'
MESH = ROOT / 'src/csg_renderer/test/meshes/cylinder_box.stl'
CAMERA_PAGE = ROOT / 'src/stereo_recovery/docs/your_camera.md'
MOST_COMMANDS = 8
NOT_RUN = ('make ', 'ros2 ', '. .venv/bin/activate')
pytestmark = pytest.mark.timeout(240)  # nodes and commands compile when they run for the first time
DISTORTION = np.array([-0.18, 0.05, 0.001, -0.0005, 0.0])


def shell_blocks(text: str) -> list[str]:
    return re.findall(r'^```sh\n(.*?)^```', text, re.MULTILINE | re.DOTALL)


def marked(name: str) -> str:
    """The commands between the marks of this name in the README."""
    page = README.read_text(encoding='utf-8')
    return shell_blocks(page[page.index(f'<!-- {name}:begin -->') : page.index(f'<!-- {name}:end -->')])[0]


def commands(block: str) -> list[str]:
    """One string a command: continuation lines and here-documents belong to the command before."""
    found: list[str] = []
    until = None
    for line in block.splitlines():
        if until is not None or (found and found[-1].endswith('\\')):
            found[-1] += '\n' + line
            until = None if line == until else until
        elif line:
            found.append(line)
            opened = re.search(r"<<'(\w+)'", line)
            until = opened.group(1) if opened else None
    return found


@pytest.fixture
def shell(tmp_path, graph) -> Iterator:
    """Runs a command as a user with the activated environment would; what it left in the background ends with it."""
    path = f'{Path(sys.executable).parent}{os.pathsep}{os.environ.get("PATH", "")}'
    environment = os.environ | {'PATH': path, 'ROS_DOMAIN_ID': str(graph.domain_id)}
    background: list[subprocess.Popen] = []

    def run(command: str) -> str:
        if command.endswith(' &'):
            arguments = ['bash', '-c', 'exec ' + command[:-2]]
            background.append(subprocess.Popen(arguments, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL))
            return ''
        done = subprocess.run(
            ['bash', '-ec', command],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, f'{command}\n{done.stdout[-2000:]}{done.stderr[-2000:]}'
        return done.stdout

    yield run
    for process in background:
        process.kill()
        process.wait()


def run_all(shell, block: str) -> str:
    return ''.join(shell(command) for command in commands(block) if not command.startswith(NOT_RUN))


class Camera:
    """Publishes the rendered pair of scene.csg, again and again, as a driver would."""

    def __init__(self, graph, folder: Path, space: str, raw: bool) -> None:
        self.graph = graph
        scene = csg_renderer.load_scene(folder / 'scene.csg')
        self.truth = scene.camera_T_scene.compose(scene.placements[0].pose)
        rig = csg_renderer.default_rig(scene)
        images = [
            codecs.gray_from_image(
                codecs.array_to_image(cv2.cvtColor(cv2.imread(str(folder / f'{side}.png')), cv2.COLOR_BGR2RGB), 'rgb8')
            )
            for side in ('left', 'right')
        ]
        self.images = [distorted(image, rig.left) for image in images] if raw else images
        self.infos = codecs.camera_infos_from_rig(rig, Header())
        if raw:
            for info in self.infos:
                info.distortion_model, info.d = 'plumb_bob', DISTORTION.tolist()
        kind = 'image_raw' if raw else 'image_rect'
        self.outputs = [
            graph.publisher(message_type, f'/{space}/{side}/{topic}')
            for side in ('left', 'right')
            for message_type, topic in ((Image, kind), (CameraInfo, 'camera_info'))
        ]
        self.pairs = 0

    def until(self, answered: list) -> PoseStamped:
        """A pair at a time, each when the one before was answered or a second has passed."""
        self.graph.wait_matched(*self.outputs)
        while not answered:
            self.pairs += 1
            header = Header(frame_id='stereo_left_optical_frame')
            header.stamp.sec = self.pairs
            for side in (0, 1):
                self.infos[side].header = header
                self.outputs[2 * side].publish(codecs.array_to_image(self.images[side], 'mono8', header))
                self.outputs[2 * side + 1].publish(self.infos[side])
            deadline = self.graph.tester.get_clock().now().nanoseconds + 10**9
            self.graph.spin_until(
                lambda end=deadline: answered or self.graph.tester.get_clock().now().nanoseconds > end
            )
            assert self.pairs < 40, 'no pose in forty pairs'
        return answered[0]


def distorted(image: np.ndarray, camera) -> np.ndarray:
    """What a lens would have made of an ideal image."""
    k = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    v, u = np.mgrid[0 : image.shape[0], 0 : image.shape[1]].astype(np.float64)
    ideal = cv2.undistortPoints(np.stack([u.ravel(), v.ravel()], axis=1)[:, None], k, DISTORTION, P=k)
    maps = ideal.reshape(*image.shape, 2).astype(np.float32)
    return cv2.remap(image, maps[..., 0], maps[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def test_a_part_of_cad_is_found_with_the_five_commands_of_the_readme(shell, tmp_path):
    """A mesh in millimetres by another program, and a pair with a calibration as OpenCV writes it."""
    block = marked('five-commands')
    assert len(commands(block)) <= 5
    mesh = trimesh.load(MESH)
    mesh.apply_scale(1e3)
    mesh.export(tmp_path / 'part.stl')
    scene = csg_renderer.load_scene(csg_renderer.scene_path('cylinder_box_v1'))
    rig = csg_renderer.default_rig(scene)
    for side, frame in zip(('left', 'right'), csg_renderer.render_stereo(scene, rig, antialias=4)):
        cv2.imwrite(str(tmp_path / f'{side}.png'), cv2.cvtColor(frame.image, cv2.COLOR_RGB2BGR))
    calibration = cv2.FileStorage(str(tmp_path / 'calibration.yaml'), cv2.FILE_STORAGE_WRITE)
    for number, info in enumerate(codecs.camera_infos_from_rig(rig, Header()), start=1):
        calibration.write(f'P{number}', np.reshape(info.p, (3, 4)))
    calibration.release()
    answer = run_all(shell, block)
    found = re.search(r'^part +12/12 +\S+ +(\S+) (\S+) (\S+) .* accepted$', answer, re.MULTILINE)
    assert found, answer
    pose = scene.camera_T_scene.compose(scene.placements[0].pose)
    assert np.allclose([float(value) for value in found.groups()], 1e3 * pose.translation, atol=0.2)
    for name, begins in (('part.png', b'\x89PNG'), ('match.png', b'\x89PNG'), ('found.html', b'<!')):
        assert (tmp_path / name).read_bytes().startswith(begins)


def test_own_part_is_recognised_with_the_commands_of_the_readme(shell, graph, tmp_path):
    block = marked('new-user')
    assert len(commands(block)) <= MOST_COMMANDS
    part = next(command for command in commands(block) if 'part.csg <<' in command)
    shell(part)
    run_all(shell, marked('stand-in'))
    answer = run_all(shell, block)
    assert re.search(r'^part .* accepted$', answer, re.MULTILINE), answer
    assert (tmp_path / 'part.png').exists() and (tmp_path / 'match.png').exists()
    topic = re.search(r'ros2 topic echo (\S+)', block).group(1)
    poses = graph.collect(PoseStamped, topic)
    camera = Camera(graph, tmp_path, 'stereo', raw=False)
    error = camera.truth.error_to(codecs.pose_from_message(camera.until(poses).pose))
    assert error.rotation_deg < 0.3 and error.translation < 1e-3


def test_the_camera_page_takes_raw_images_to_a_pose_in_the_drivers_frame(shell, graph, tmp_path):
    shell(next(command for command in commands(marked('new-user')) if 'part.csg <<' in command))
    run_all(shell, marked('stand-in'))
    nodes, files = shell_blocks(CAMERA_PAGE.read_text(encoding='utf-8'))
    poses = graph.collect(PoseStamped, 'interpretations/part')
    run_all(shell, nodes)
    camera = Camera(graph, tmp_path, 'stereo', raw=True)
    pose = camera.until(poses)
    assert pose.header.frame_id == 'stereo_left_optical_frame'
    error = camera.truth.error_to(codecs.pose_from_message(pose.pose))
    assert error.rotation_deg < 0.5 and error.translation < 2e-3
    calibration = cv2.FileStorage(str(tmp_path / 'calibration.yaml'), cv2.FILE_STORAGE_WRITE)
    for number, (side, image, info) in enumerate(zip(('left', 'right'), camera.images, camera.infos), start=1):
        cv2.imwrite(str(tmp_path / f'{side}.png'), image)
        for name, values, shape in (
            ('K', info.k, (3, 3)),
            ('D', info.d, (1, 5)),
            ('R', info.r, (3, 3)),
            ('P', info.p, (3, 4)),
        ):
            calibration.write(f'{name}{number}', np.reshape(values, shape))
    calibration.release()
    assert re.search(r'^part .* accepted$', run_all(shell, files), re.MULTILINE)


def test_the_static_transform_of_the_camera_page_points_a_camera_forward():
    text = CAMERA_PAGE.read_text(encoding='utf-8')
    base_R_optical = Rotation.from_quat([float(re.search(rf'--q{axis} (-?[\d.]+)', text).group(1)) for axis in 'xyzw'])
    right, down, forward = np.eye(3)
    assert np.allclose(base_R_optical.apply([right, down, forward]), [[0, -1, 0], [0, 0, -1], [1, 0, 0]])


PAGES = [ROOT / 'README.md', *sorted((ROOT / 'src').glob('*/README.md')), *sorted((ROOT / 'src').glob('*/docs/*.md'))]
RUN = re.compile(r'\.venv/bin/(?:render|features|closed_form|dap|model_table) [^`\n#]*')


def test_the_pages_have_commands():
    assert sum(len(RUN.findall(page.read_text(encoding='utf-8'))) for page in PAGES) > 5


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_of_the_pages_run(page, tmp_path):
    """Those that need no files of the user's own and no minutes; they are run in an empty folder."""
    path = f'{Path(sys.executable).parent}{os.pathsep}{os.environ.get("PATH", "")}'
    (tmp_path / 'src').symlink_to(ROOT / 'src')
    found = [
        command
        for command in RUN.findall(page.read_text(encoding='utf-8'))
        if '--sweep' not in command and '--replay' not in command
    ]
    for command in dict.fromkeys(found):
        done = subprocess.run(
            ['bash', '-ec', command.replace('.venv/bin/', '')],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            env=os.environ | {'PATH': path},
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, f'{command}\n{done.stdout[-1000:]}{done.stderr[-1000:]}'
