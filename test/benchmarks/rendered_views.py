"""Features recovered from rendered stereo pairs of single objects in random poses: real data of known content."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from csg_renderer import Light, Scene, Solid, load_models, model_features, render_stereo, scene_path
from csg_renderer.raycast.sensor import SensorModel
from msgs_py import FeatureSet, PinholeCamera, Pose, StereoRig
from stereo_recovery import recover

CAMERA = PinholeCamera.centred(512, 512, 703.0)
DISTANCES = (3.2, 5.0)  # of the camera, in sizes of the object
BASELINE = 0.2  # of the distance
PSF = 0.5  # of the lens, pixels


def load_object(file: str) -> tuple[Solid, FeatureSet]:
    """The first object of a scene file that comes with csg_renderer, and its features, metres."""
    solid = next(iter(load_models(scene_path(file)).values()))
    return solid, model_features(solid)


@dataclass(frozen=True, eq=False)
class RenderedView:
    """A stereo pair of one object, uint8, and its pose, first_T_model."""

    left: np.ndarray
    right: np.ndarray
    rig: StereoRig
    pose: Pose


def recovered_view(solid: Solid, model: FeatureSet, seed: int) -> FeatureSet:
    """What stereo recovery finds of the object alone; see :func:`rendered_view`."""
    view = rendered_view(solid, model, seed)
    return recover(view.left, view.right, view.rig).features


def rendered_view(solid: Solid, model: FeatureSet, seed: int, samples: int = 2) -> RenderedView:
    """A pair of the object alone; the seed decides pose, lights, greys, rig and noise.

    samples : a pixel is the mean of so many squared
    """
    rng = np.random.default_rng([seed, 31])
    low, high = model.start.min(axis=0), model.start.max(axis=0)
    distance = float(np.linalg.norm(high - low)) * rng.uniform(*DISTANCES)
    rig = StereoRig.symmetric(CAMERA, distance * BASELINE * rng.uniform(0.85, 1.15))
    turn = Rotation.random(random_state=rng).as_matrix()
    aim = np.array([0.5 * rig.baseline, 0.0, distance]) + rng.uniform(-0.03, 0.03, 3) * distance
    pose = Pose(turn, aim - turn @ (0.5 * (low + high)))
    lights = [
        Light(tuple(rng.uniform((-0.5, -0.7, -0.5), (0.5, 0.1, 0.1))), (strength,) * 3)
        for strength in (rng.uniform(0.6, 0.9), rng.uniform(0.1, 0.4))
    ]
    scene = Scene([solid.transformed(pose)], lights, (rng.uniform(0.1, 0.3),) * 3, (rng.uniform(0.0, 0.7),) * 3)
    left, right = (
        SensorModel(PSF, 2.0, (seed, eye)).picture(frame, monochrome=True)
        for eye, frame in enumerate(render_stereo(scene, rig, antialias=samples, psf=PSF))
    )
    return RenderedView(left, right, rig, pose)
