"""A node is ready when all is compiled: no pair waits for a compiler, whatever its size and whatever it shows."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('numba')

BOARDS = Path(__file__).resolve().parent / 'chessboards'
MESH = Path(__file__).resolve().parents[1] / 'src' / 'csg_renderer' / 'test' / 'meshes' / 'cylinder_box.stl'
# What is looked up in the cache is compiled where the cache has none: whatever is looked up after the warm-up would
# keep a pair waiting in a node that starts for the first time.
NOTED = """
from msgs_py.numeric import compiled

late = []
load = compiled.ContentCache.load_overload

def noted(self, sig, context):
    late.append(self._function.__qualname__)
    return load(self, sig, context)

compiled.ContentCache.load_overload = noted
"""
RECOVERY = f"""
import sys
import cv2
import csg_renderer
from csg_renderer.raycast.render import scene_rig
from msgs_py import PinholeCamera, StereoRig
from stereo_recovery import recover
from stereo_recovery.pipeline import warm_up

pairs = []
for name in ('plug_v1', 'cylinder_box_v1'):
    scene = csg_renderer.load_scene(name)
    frames = csg_renderer.render_stereo(scene, antialias=2)
    pairs.append((*(frame.image for frame in frames), scene_rig(scene)))
board = [cv2.imread(f'{{sys.argv[1]}}/{{side}}02.jpg', cv2.IMREAD_GRAYSCALE) for side in ('left', 'right')]
for scale in (1, 3):
    large = [cv2.resize(side, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC) for side in board]
    height, width = large[0].shape
    pairs.append((*large, StereoRig.symmetric(PinholeCamera.centred(width, height, 500.0 * scale), 0.1)))
warm_up()
{NOTED}
found = [len(recover(*pair).features) for pair in pairs]
assert found[0] and found[1], found
print(*sorted(set(late)))
"""
# Solids, a turned part and a mesh among data of three scenes, with images and without; what is found is followed
# through a jump, until it is lost, and taken up again.
MATCHING = f"""
import sys
import numpy as np
import csg_renderer
from csg_renderer import Solid, SolidOutline, load_known_models, load_models, model_features
from csg_renderer.raycast.render import scene_rig
from csg_renderer.raycast.sensor import grey
from model_matcher.image_pose.views import Views
from model_matcher.model.index import index_model
from model_matcher.pipeline import survey, warm_up
from model_matcher.tracking.compiling import compile_steps
from model_matcher.tracking.tracker import Tracker
from msgs_py.numeric.steps import run_all
from stereo_recovery import recover

solids = {{name: next(iter(load_models(name).values())) for name in ('plug', 'l_shape')}}
solids['peg'] = Solid.cylinder(0.03, (0.0, 0.0, 0.09))
indexes = [index_model(model_features(solid), name, SolidOutline(solid)) for name, solid in solids.items()]
known = next(iter(load_known_models(sys.argv[1]).values()))
indexes.append(index_model(known.features, 'mesh', known.outline))
seen = []
for name in ('plug_v1', 'l_shape_v1', 'cylinder_box_v1'):
    scene = csg_renderer.load_scene(name)
    rig = scene_rig(scene)
    pictures = [grey(frame.image) for frame in csg_renderer.render_stereo(scene, antialias=2)]
    pictures = [np.rint(picture).astype(np.uint8) for picture in pictures]
    seen.append((recover(*pictures, rig).features, Views.of(pictures, rig)))
warm_up(images=True)
run_all(compile_steps())
{NOTED}
found = set()
for data, views in seen:
    survey(indexes, data)
    for one in survey(indexes, data, views=views).interpretations:
        found.add(one.model)
        moved, blank = (
            Views([change(image) for image in views.images], views.cameras, views.poses)
            for change in (lambda image: np.roll(image, 25, axis=1), lambda image: np.full_like(image, 90))
        )
        index = next(index for index in indexes if index.name == one.model)
        tracker = Tracker(index.shape, one)
        held = [tracker.step(frame, 0.03).pose is not None for frame in (views, moved, views, *[blank] * 4, views)]
        assert held[0] and not held[6], held
assert found >= {{'plug', 'l_shape'}}, found
print(*sorted(set(late)))
"""


def run(program: str, path: Path) -> list[str]:
    """Names of functions that a program has looked up after its warm-up."""
    command = [sys.executable, '-c', program, str(path)]
    result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert result.returncode == 0, result.stderr
    return result.stdout.split()


def test_no_pair_waits_for_a_compiler():
    assert run(RECOVERY, BOARDS) == []


def test_no_search_and_no_frame_waits_for_a_compiler():
    assert run(MATCHING, MESH) == []
