"""The seventeen views of the thesis as rendered pairs with their poses, and the least error of a pose of each."""

from __future__ import annotations

import re
import tempfile
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from pose_bounds import PoseBound, View, pose_bound
from true_poses import Instance, Part, Pictures, PosedPair, make_part

from csg_renderer import Frame, render_stereo, scene_names
from csg_renderer.raycast.sensor import SensorModel, grey
from model_matcher.closed_form.case import Case
from model_matcher.closed_form.planning.steps import sensor_blur
from model_matcher.closed_form.scene_files import PreparedCase, prepare
from msgs_py import PinholeCamera, Pose

RENDERED = 'rendered'
# The views that the thesis prints; the widget's are ours.
VIEW = re.compile(r'(?!widget)\w+_v[12]$')
# Samples along each side of a pixel of a finer picture.
FINE_SAMPLES = 8


@lru_cache(maxsize=32)
def _view(name: str, finer: int = 0) -> tuple[PreparedCase, Part, tuple[Frame, Frame], PoseBound]:
    """A case, its part, its pictures before the chip, and the bound of its pose behind it; see rendered_pair."""
    case = Case(name)
    with tempfile.TemporaryDirectory() as folder:
        ready = prepare(case, Path(folder))
    solid = ready.scene.placements[0].model
    left, right = render_stereo(ready.scene, ready.rig, antialias=case.antialias, psf=case.psf)
    if finer:
        _render_finer((left, right), ready, case.psf, finer)
    eyes = (ready.rig.left, Pose.identity()), (ready.rig.right, Pose(np.eye(3), ready.rig.right_T_left))
    sharp = render_stereo(ready.scene, ready.rig)
    views = [View(camera, pose, grey(frame.image)) for (camera, pose), frame in zip(eyes, sharp)]
    bound = pose_bound(solid, ready.true_pose, views, sensor_blur(case.psf), case.noise)
    return ready, make_part(name, solid), (left, right), bound


def _render_finer(frames: tuple[Frame, Frame], ready: PreparedCase, psf: float, finer: int) -> None:
    """Give frames the light of pictures so many times finer, blurred and averaged over each pixel."""
    rig = replace(ready.rig, left=_fine(ready.rig.left, finer), right=_fine(ready.rig.right, finer))
    for frame, fine in zip(frames, render_stereo(ready.scene, rig, antialias=FINE_SAMPLES, radiance=True)):
        blurred = cv2.GaussianBlur(fine.radiance, (0, 0), finer * psf)
        size = frame.camera.width, frame.camera.height
        frame.radiance = np.asarray(cv2.resize(blurred, size, interpolation=cv2.INTER_AREA))


def _fine(camera: PinholeCamera, finer: int) -> PinholeCamera:
    """A camera with so many pixels along each side of a pixel."""
    cx, cy = (finer * (centre + 0.5) - 0.5 for centre in (camera.cx, camera.cy))
    return PinholeCamera(finer * camera.width, finer * camera.height, finer * camera.fx, finer * camera.fy, cx, cy)


def view_names() -> list[str]:
    """The scenes of the views."""
    return sorted(filter(VIEW.match, scene_names()))


def rendered_pair(name: str, seed: int, finer: int = 0) -> PosedPair:
    """A view with noise of its own; the sensor is that of a closed-form case.

    finer : pixels of the rendered picture along each side of a pixel, 0 for the pictures of a closed-form case; finer
        ones are not rounded to bytes before the noise
    """
    ready, part, frames, bound = _view(name, finer)
    left, right = (
        SensorModel(Case.psf, Case.noise, (seed, 0, eye)).picture(frame, monochrome=True)
        for eye, frame in enumerate(frames)
    )
    pair = Pictures(f'{name} {seed}', RENDERED, left, right, ready.rig)
    return PosedPair(pair, (Instance(part, ready.true_pose, 1.0, part.axis),), (part,), (bound,))
