"""All that looking at images and tracking need compiled, as a small computation that uses it."""

from __future__ import annotations

import numpy as np

from csg_renderer import Solid, SolidOutline
from msgs_py import PinholeCamera, Pose
from msgs_py.numeric.steps import CompileStep

from ..image_pose.measurement import measure_pose
from ..image_pose.views import Views
from .tracker import Tracker


def compile_steps() -> tuple[CompileStep, ...]:
    """What a tracker needs compiled."""
    return (CompileStep('the pose in images', _follow_noise),)


def _follow_noise() -> None:
    """Follow a block through a picture of noise, in which there are edges everywhere."""
    noise = np.random.default_rng(0).integers(0, 255, (120, 160), dtype=np.uint8)
    views = Views.of([noise], PinholeCamera.centred(160, 120, 200.0))
    shape = SolidOutline(Solid.block(0.06, 0.05, 0.04) | Solid.cylinder(0.02, (0.0, 0.0, 0.08)))
    start = Pose.from_rotation_vector([0.5, 0.4, 0.0], [0.0, 0.0, 0.25])
    measure_pose(shape, start, views)
    shape.surface(start, views.cameras[0], np.array([[80.0, 60.0]]))
    Tracker(shape, start).step(views)
