"""What renderer_node publishes of one moment: the pictures of both cameras, and the truth behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import FeatureSet, LensDistortion, Pose, StereoRig

from .params import RendererConfig
from .raycast.exposure import moved_by
from .raycast.frame import Frame
from .raycast.render import render_stereo
from .raycast.stop import Stop
from .scene.scene import Scene
from .scene.terrain import Terrain
from .visibility.hidden_lines import visible_features


@dataclass(frozen=True)
class Wanted:
    """What somebody listens to: rectified pictures or depth, raw pictures, the true pose, what is truly visible."""

    rectified: bool = True
    raw: bool = False
    pose: bool = True
    features: bool = True


@dataclass(frozen=True, eq=False)
class Rendered:
    """What a rendering gives, of what was wanted.

    Attributes
    ----------
    rig : StereoRig
        Of the rectified cameras.
    rectified, raw : list of arrays
        Left and right image as published, or nothing.
    depth : (h, w) float32, optional
        Of the left rectified image, metres.
    pose : Pose, optional
    features : FeatureSet, optional
    problems : tuple of str
        Why some of the truth is missing.
    """

    rig: StereoRig
    rectified: list[np.ndarray]
    raw: list[np.ndarray]
    depth: np.ndarray | None
    pose: Pose | None
    features: FeatureSet | None
    problems: tuple[str, ...]


def rendered(
    scene: Scene, rig: StereoRig, config: RendererConfig, number: int, wanted: Wanted, stop: Stop | None = None
) -> Rendered:
    """Render a pair, with the truth of its first object but terrains.

    Parameters
    ----------
    scene : Scene
    rig : StereoRig
    config : RendererConfig
    number : int
        Of the pair.
    wanted : Wanted
    stop : Stop, optional
        With it another thread can end the rendering.

    Returns
    -------
    Rendered

    Raises
    ------
    RenderStopped
    """
    stop = stop or Stop()
    camera_T_scene = turned(scene, config.turntable * number)
    lenses = config.lenses()
    rectified, raw = None, None
    if wanted.rectified or (wanted.raw and lenses is None):
        rectified = frames_of(scene, rig, camera_T_scene, config, stop)
    if wanted.raw:
        raw = rectified if lenses is None else frames_of(scene, rig, camera_T_scene, config, stop, lenses)
    stop.check()
    images = sensor_images(rectified, config, number) if rectified else []
    raw_images = images if raw is rectified else sensor_images(raw, config, number) if raw else []
    stop.check()
    models = [placement for placement in scene.placements if not isinstance(placement.model, Terrain)]
    pose, features, problems = None, None, []
    if models and (wanted.pose or wanted.features):
        name = models[0].name
        try:
            pose = camera_T_scene.compose(models[0].pose)
        except ValueError as error:
            problems.append(f'ground_truth: object {name} has no pose: {error}')
    if pose is not None and wanted.features:
        try:
            features = visible_features(models[0].model, pose, rig.left)
        except ValueError as error:
            problems.append(f'ground_truth/features: object {name} has none: {error}')
    return Rendered(
        rig,
        images,
        raw_images if wanted.raw else [],
        rectified[0].depth if rectified else None,
        pose if wanted.pose else None,
        features,
        tuple(problems),
    )


def frames_of(
    scene: Scene,
    rig: StereoRig,
    camera_T_scene: Pose,
    config: RendererConfig,
    stop: Stop | None = None,
    lenses: tuple[LensDistortion, LensDistortion] | None = None,
) -> tuple[Frame, Frame]:
    """Both pictures, as the parameters of the node say; raw ones of these lenses where they are given."""
    return render_stereo(
        scene,
        rig,
        camera_T_scene,
        engine=config.engine,
        stop=stop,
        lens=lenses,
        tiling=config.tiling,
        levels=config.levels,
        antialias=config.antialias,
        shadows=config.shadows,
        samples=config.samples,
        aperture=config.aperture,
        focus=config.focus,
        motion=moved_by(camera_T_scene, config.motion[:3], config.motion[3:]) if config.motion else (),
        pinholes=config.pinholes,
        psf=config.psf,
        radiance=config.sensor(0, 0).fine,
    )


def sensor_images(frames: tuple[Frame, Frame], config: RendererConfig, pair_index: int = 0) -> list[np.ndarray]:
    """Left and right image as the node publishes them: blurred, and with noise that differs from pair to pair and side.

    Parameters
    ----------
    frames : tuple of two Frames
        Left and right.
    config : RendererConfig
        Says encoding, lens and chip.
    pair_index : int
        Number of the pair.

    Returns
    -------
    list of two arrays of uint8 or uint16
        (h, w, 3) for rgb8 and rgb16, else (h, w).
    """
    mono = config.encoding.startswith('mono')
    return [config.sensor(pair_index, side).picture(frame, mono) for side, frame in enumerate(frames)]


def turned(scene: Scene, degrees: float) -> Pose:
    """The pose of a scene on the turntable.

    Parameters
    ----------
    scene : Scene
    degrees : float
        About the camera's y axis through the origin of the first object.

    Returns
    -------
    Pose
        camera_T_scene.
    """
    if degrees == 0.0 or not scene.placements:
        return scene.camera_T_scene
    centre = scene.camera_T_scene.apply(scene.placements[0].matrix[:3, 3])
    turn = Pose.from_rotation_vector([0.0, np.radians(degrees), 0.0])
    return Pose(turn.rotation, centre - turn.rotation @ centre).compose(scene.camera_T_scene)
