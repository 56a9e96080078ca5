"""All that looking at images and tracking need compiled, as a small computation that uses it."""

from __future__ import annotations

import cv2
import numpy as np

from csg_renderer import Solid, SolidOutline
from csg_renderer.features.mesh_outline import compile_steps as mesh_steps
from msgs_py import PinholeCamera, Pose
from msgs_py.numeric.steps import CompileStep

from ..image_pose.measurement import measure_pose
from ..image_pose.settings import FLANK
from ..image_pose.sight import look
from ..image_pose.views import Views
from .texture import corners_of, followed
from .tracker import Tracker


def compile_steps() -> tuple[CompileStep, ...]:
    """What a tracker needs compiled."""
    return (CompileStep('the pose in images', _follow_block), *mesh_steps())


def _follow_block() -> None:
    """Follow a printed block, of which little but its silhouette shows, by its outline and by its print."""
    camera = PinholeCamera.centred(160, 120, 200.0)
    shape = SolidOutline(Solid.block(0.06, 0.05, 0.04) | Solid.cylinder(0.02, (0.0, 0.0, 0.08)))
    start = Pose.from_rotation_vector([0.5, 0.4, 0.0], [0.0, 0.0, 0.25])
    spots = np.random.default_rng(0).integers(0, 80, (24, 32), dtype=np.uint8)
    grey = np.asarray(cv2.resize(spots, (camera.width, camera.height)), np.uint8)
    sight = look(shape, start, Views.of([grey], camera))
    hull = cv2.convexHull(np.rint(sight.placed.pixel).astype(np.int32))
    grey += np.asarray(cv2.fillConvexPoly(np.zeros_like(grey), hull, 150), np.uint8)
    views = Views.of([grey], camera)
    measure_pose(shape, start, views)
    tracker = Tracker(shape, start)
    for _ in range(2):
        tracker.step(views)
    # Last, for its own outline hides all of it.
    tracker.step(views, nearer=[sight])
    followed(corners_of(shape, start, sight, views), start, np.eye(6), shape.centre, views, FLANK)
