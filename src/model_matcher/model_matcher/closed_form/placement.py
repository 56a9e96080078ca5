"""Where the object of a closed-form case stands, what the cameras are and what lights it.

A scene file that is only a part (drawn where it was modelled, with no camera and no light, as parts are) can be tested
as it is: what nobody chose is chosen here, so that the part is in view, whole, and its faces differ in brightness.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from csg_renderer import Light, Scene, Solid, load_scene, model_features
from csg_renderer.language import find_scene
from csg_renderer.raycast.render import scene_rig
from csg_renderer.raycast.settings import DEFAULT_BASELINE_RATIO
from msgs_py import PinholeCamera, Pose, StereoRig

from .case import Case
from .settings import LIGHTS, SPAN, VIEW


def load_case_scene(case: Case) -> Scene:
    """The scene of a case.

    Raises
    ------
    OSError
        No such file.
    ValueError
        A bad scene (SceneError), or one that draws nothing.
    """
    scene = load_scene(find_scene(case.scene))
    if not scene.placements:
        raise ValueError(f'{case.scene}: draws nothing')
    return scene


def case_rig(case: Case) -> StereoRig:
    """The rig of a case: what the case names, else what its scene says, else the defaults.

    The default baseline is a fifth of the distance at which the case has its object.
    """
    scene = load_case_scene(case)
    baseline = case.baseline or scene.baseline or 0.0
    if not baseline and not stands_as_drawn(case, scene):
        baseline = _middle_depth(scene, case_pose(case, scene)) / DEFAULT_BASELINE_RATIO
    return scene_rig(scene, case.width or 0, case.height or 0, case.focal or 0.0, baseline)


def case_pose(case: Case, scene: Scene) -> Pose:
    """left_T_model of a case: its own, else as drawn, else (that being behind the camera or about it) one in view."""
    if case.pose is not None:
        return Pose.from_matrix(np.reshape(case.pose, (4, 4)))
    drawn = drawn_pose(scene)
    return drawn if in_front(scene, drawn) else _in_view(case, scene, drawn)


def drawn_pose(scene: Scene) -> Pose:
    """left_T_model of what the scene draws first."""
    return scene.camera_T_scene.compose(scene.placements[0].pose)


def stands_as_drawn(case: Case, scene: Scene) -> bool:
    """Whether the case leaves its object where the scene file has it."""
    return case.pose is None and in_front(scene, drawn_pose(scene))


def in_front(scene: Scene, pose: Pose) -> bool:
    """Whether the first object, at left_T_model, is wholly in front of the camera."""
    _, radius = model_centre(scene)
    return _middle_depth(scene, pose) > radius


def model_centre(scene: Scene) -> tuple[np.ndarray, float]:
    """Middle (3,) of the first object's model and the radius about it, metres, model frame."""
    return _enclosing(scene.placements[0].model)


@lru_cache(maxsize=4)  # what a case asks is asked of one model, and finding its features is most of the work
def _enclosing(model: Solid) -> tuple[np.ndarray, float]:
    features = model_features(model)
    points = np.concatenate([features.polyline(k, 16) for k in range(len(features))])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return middle, float(np.linalg.norm(points - middle, axis=1).max())


def case_lights(scene: Scene, pose: Pose) -> tuple[Light, ...]:
    """The scene's lights, in the scene's frame.

    A scene that says nothing of light, neither LIGHT nor AMBIENT, gets two about the object at left_T_model.
    """
    if scene.lights or scene.ambient_light != Scene([]).ambient_light:
        return tuple(scene.lights)
    scene_T_camera = scene.camera_T_scene.inverse()
    return tuple(
        Light(tuple(scene_T_camera.apply(np.asarray(one.position))), one.colour)
        for one in lights_about(_middle_depth(scene, pose))
    )


def lights_about(depth: float) -> tuple[Light, ...]:
    """The two lights of an object at a depth, metres, in the camera's frame."""
    return tuple(Light(tuple(depth * np.asarray(place)), (brightness,) * 3) for place, brightness in LIGHTS)


def _middle_depth(scene: Scene, pose: Pose) -> float:
    return float(pose.apply(model_centre(scene)[0])[2])


def _in_view(case: Case, scene: Scene, drawn: Pose) -> Pose:
    middle, radius = model_centre(scene)
    # The distance is what is sought here: any baseline does for the camera.
    camera: PinholeCamera = scene_rig(scene, case.width or 0, case.height or 0, case.focal or 0.0, 1.0).left
    distance = camera.fx * 2.0 * radius / (SPAN * min(camera.width, camera.height))
    turned = VIEW.rotation @ drawn.rotation
    centre = camera.rays(np.array([0.5 * (camera.width - 1), 0.5 * (camera.height - 1)])) * distance
    return Pose(turned, centre - turned @ middle)
