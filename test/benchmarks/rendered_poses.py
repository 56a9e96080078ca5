"""The seventeen views of the thesis as rendered pairs with their poses, and the least error of a pose of each."""

from __future__ import annotations

import re
import tempfile
from functools import lru_cache
from pathlib import Path

import numpy as np
from pose_bounds import PoseBound, View, pose_bound
from true_poses import Instance, Part, Pictures, PosedPair, make_part

from csg_renderer import Frame, render_stereo, scene_names
from csg_renderer.raycast.sensor import SensorModel, grey
from model_matcher.closed_form.case import Case
from model_matcher.closed_form.planning.steps import sensor_blur
from model_matcher.closed_form.scene_files import PreparedCase, prepare
from msgs_py import Pose

RENDERED = 'rendered'
# The views that the thesis prints; the widget's are ours.
VIEW = re.compile(r'(?!widget)\w+_v[12]$')


@lru_cache(maxsize=32)
def _view(name: str) -> tuple[PreparedCase, Part, tuple[Frame, Frame], PoseBound]:
    """A case, its part, its pictures before the chip, and the bound of its pose behind it."""
    case = Case(name)
    with tempfile.TemporaryDirectory() as folder:
        ready = prepare(case, Path(folder))
    solid = ready.scene.placements[0].model
    left, right = render_stereo(ready.scene, ready.rig, antialias=case.antialias, psf=case.psf)
    eyes = (ready.rig.left, Pose.identity()), (ready.rig.right, Pose(np.eye(3), ready.rig.right_T_left))
    sharp = render_stereo(ready.scene, ready.rig)
    views = [View(camera, pose, grey(frame.image)) for (camera, pose), frame in zip(eyes, sharp)]
    bound = pose_bound(solid, ready.true_pose, views, sensor_blur(case.psf), case.noise)
    return ready, make_part(name, solid), (left, right), bound


def view_names() -> list[str]:
    """The scenes of the views."""
    return sorted(filter(VIEW.match, scene_names()))


def rendered_pair(name: str, seed: int) -> PosedPair:
    """A view with noise of its own; the sensor is that of a closed-form case."""
    ready, part, frames, bound = _view(name)
    left, right = (
        SensorModel(Case.psf, Case.noise, (seed, 0, eye)).picture(frame, monochrome=True)
        for eye, frame in enumerate(frames)
    )
    pair = Pictures(f'{name} {seed}', RENDERED, left, right, ready.rig)
    return PosedPair(pair, (Instance(part, ready.true_pose, 1.0, part.axis),), (part,), (bound,))
