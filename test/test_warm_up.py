"""A node is ready when all is compiled: no pair waits for a compiler, whatever its size and whatever it shows."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('numba')

BOARDS = Path(__file__).resolve().parent / 'chessboards'
# What is looked up in the cache is compiled where the cache has none: whatever is looked up after the warm-up would
# keep a pair waiting in a node that starts for the first time.
LATE = """
import sys
import cv2
import csg_renderer
from csg_renderer.raycast.render import scene_rig
from msgs_py import PinholeCamera, StereoRig
from msgs_py.numeric import compiled
from stereo_recovery import recover
from stereo_recovery.pipeline import warm_up

pairs = []
for name in ('plug_v1', 'cylinder_box_v1'):
    scene = csg_renderer.load_scene(name)
    frames = csg_renderer.render_stereo(scene, antialias=2)
    pairs.append((*(frame.image for frame in frames), scene_rig(scene)))
board = [cv2.imread(f'{sys.argv[1]}/{side}02.jpg', cv2.IMREAD_GRAYSCALE) for side in ('left', 'right')]
for scale in (1, 3):
    large = [cv2.resize(side, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC) for side in board]
    height, width = large[0].shape
    pairs.append((*large, StereoRig.symmetric(PinholeCamera.centred(width, height, 500.0 * scale), 0.1)))
warm_up()
late = []
load = compiled.ContentCache.load_overload

def noted(self, sig, context):
    late.append(self._function.__qualname__)
    return load(self, sig, context)

compiled.ContentCache.load_overload = noted
found = [len(recover(*pair).features) for pair in pairs]
assert found[0] and found[1], found
print(*sorted(set(late)))
"""


def test_no_pair_waits_for_a_compiler():
    command = [sys.executable, '-c', LATE, str(BOARDS)]
    result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == []
