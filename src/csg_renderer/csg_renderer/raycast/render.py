"""Render a scene: the facade that library users, the command line and the node call."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from msgs_py import PinholeCamera, Pose, StereoRig
from msgs_py.numeric.steps import CompileStep

from ..scene.scene import Scene
from .engines import ViewPose, engine_named, refuse_options
from .frame import Frame, RenderOptions
from .program import program_of
from .settings import DEFAULT_BASELINE_RATIO, DEFAULT_FOCAL, DEFAULT_SIZE
from .stop import Stop


def default_camera(width: int = DEFAULT_SIZE, height: int | None = None) -> PinholeCamera:
    """The centred camera used when none is given.

    Parameters
    ----------
    width, height : int
        Pixels; a square image without a height.

    Returns
    -------
    PinholeCamera
        Its field of view across is 40 degrees at every size.

    Examples
    --------
    >>> default_camera(256).fx
    351.5
    """
    return PinholeCamera.centred(width, width if height is None else height, DEFAULT_FOCAL * width / DEFAULT_SIZE)


def default_rig(scene: Scene, camera: PinholeCamera | None = None, baseline: float | None = None) -> StereoRig:
    """A scene's camera twice, side by side.

    Parameters
    ----------
    scene : Scene
    camera : PinholeCamera, optional
        The scene's own by default, else :func:`default_camera`.
    baseline : float, optional
        Metres; the scene's own by default, else its distance / 5.

    Returns
    -------
    StereoRig

    Raises
    ------
    ValueError
        There is no baseline, and nothing in front of the camera to measure a distance to.
    """
    camera = camera or scene.camera or default_camera()
    baseline = baseline or scene.baseline
    if baseline is None:
        distance = scene_distance(scene)
        if not distance > 0.0:
            raise ValueError('baseline: the scene names none, and no solid in front of the camera suggests one')
        baseline = distance / DEFAULT_BASELINE_RATIO
    return StereoRig.symmetric(camera, baseline)


def scene_rig(scene: Scene, width: int = 0, height: int = 0, focal: float = 0.0, baseline: float = 0.0) -> StereoRig:
    """The rig of a scene with some things changed; 0 leaves one as the scene says (or as the defaults are).

    The focal length follows the width; the principal point keeps its place in the image.

    Parameters
    ----------
    scene : Scene
    width, height : int
        Pixels.
    focal : float
        Focal length, pixels.
    baseline : float
        Metres.

    Returns
    -------
    StereoRig

    Raises
    ------
    ValueError
        An argument is out of its range; the message begins with its name.
    """
    camera = scene.camera or default_camera()
    if width or height or focal:
        columns = width or (camera.width if not height else round(camera.width * height / camera.height))
        rows = height or round(camera.height * columns / camera.width)
        across, down = columns / camera.width, rows / camera.height
        fx = focal or camera.fx * across
        camera = PinholeCamera(
            columns,
            rows,
            fx,
            fx * camera.fy / camera.fx,
            (camera.cx + 0.5) * across - 0.5,
            (camera.cy + 0.5) * down - 0.5,
        )
    return default_rig(scene, camera, baseline or None)


def scene_distance(scene: Scene) -> float:
    """Distance along the camera's z to the models in front of it.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    float
        Metres: to the mean origin of those that a Placement moved there, else to the middle of what is in front; 0 when
        nothing is.
    """
    origins = np.array([placement.matrix[:3, 3] for placement in scene.placements]).reshape(-1, 3)
    for points in (origins, program_of(scene).outline):
        depths = scene.camera_T_scene.apply(points)[:, 2]
        if (depths > 0.0).any():
            return float(depths[depths > 0.0].mean())
    return 0.0


def viewing_hints(scene: Scene) -> list[str]:
    """What makes pictures of a scene poor though nothing is wrong with it.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    list of str
        A line each: a part drawn where it was modelled, about the camera, or a scene without light.
    """
    hints = []
    depths = scene.camera_T_scene.apply(program_of(scene).outline)[:, 2]
    if len(depths) and depths.max() <= 0.0:
        hints.append('all of it is behind the camera, which looks along z; AT (x, y, z) moves what DRAW draws')
    elif len(scene.placements) == 1 and len(depths) and depths.min() <= 0.0:
        hints.append('the camera, at the origin, is within or beside it; AT (0, 0, z) of DRAW moves it in front')
    if len(depths) and not scene.lights:
        hints.append('no LIGHT: with ambient light alone the faces of one colour look the same')
    return hints


def render(
    scene: Scene,
    camera: PinholeCamera | None = None,
    world_to_camera: Pose | None = None,
    engine: str = 'native',
    tiling: bool = True,
    levels: int = 1,
    antialias: bool | int = False,
    shadows: bool = False,
    stop: Stop | None = None,
    **options: Any,
) -> Frame:
    """Ray cast (levels=1) or ray trace a scene.

    Parameters
    ----------
    scene : Scene
    camera : PinholeCamera, optional
        The scene's own by default, else :func:`default_camera`.
    world_to_camera : Pose, optional
        camera_T_scene; the scene's own by default (the identity unless the file places its camera).
    engine : str
        'native' (compiled), 'dap' (the emulated array machine) or 'reference' (plain numpy, slow); the same image.
    tiling, levels, antialias, shadows
        See :class:`RenderOptions`.
    stop : Stop, optional
        With it another thread can end the rendering.
    **options
        ``tile_size``, ``threads``, ``early_outs`` and ``left_heavy`` of :class:`RenderOptions`.

    Returns
    -------
    Frame

    Raises
    ------
    ValueError
        An argument is out of its range; the message begins with its name.
    TypeError
        ``scene`` is no Scene.
    RenderStopped
        ``stop`` was set.

    Examples
    --------
    >>> from csg_renderer import Light, Solid
    >>> ball = Solid.sphere(0.1).transformed(Pose(np.eye(3), [0.0, 0.0, 1.0]))
    >>> frame = render(Scene(ball, [Light((0, -1, 0))]), default_camera(33))
    >>> round(float(frame.depth[16, 16]), 4)
    0.9
    """
    camera = camera or _checked(scene).camera or default_camera()
    pose = _checked(scene).camera_T_scene if world_to_camera is None else world_to_camera
    chosen = RenderOptions(tiling=tiling, levels=levels, antialias=antialias, shadows=shadows, **options)
    return _render_views(scene, [(camera, pose)], engine, chosen, stop)[0]


def render_stereo(
    scene: Scene,
    rig: StereoRig | None = None,
    world_to_camera: Pose | None = None,
    engine: str = 'native',
    stop: Stop | None = None,
    **options: Any,
) -> tuple[Frame, Frame]:
    """Render a rectified pair.

    Parameters
    ----------
    scene : Scene
    rig : StereoRig, optional
        :func:`default_rig` of the scene by default.
    world_to_camera : Pose, optional
        Places the left camera, see :func:`render`.
    engine, stop
        See :func:`render`.
    **options
        See :class:`RenderOptions`.

    Returns
    -------
    left, right : Frame

    Raises
    ------
    ValueError, TypeError, RenderStopped
        As :func:`render`.
    """
    rig = rig or default_rig(_checked(scene))
    left = _checked(scene).camera_T_scene if world_to_camera is None else world_to_camera
    # Along the camera's x whatever the scale of the pose: baselines are metres of the camera frame.
    right = Pose(left.rotation, left.translation + rig.right_T_left, left.scale)
    frames = _render_views(scene, [(rig.left, left), (rig.right, right)], engine, RenderOptions(**options), stop)
    return frames[0], frames[1]


def compile_steps(scene: Scene) -> tuple[CompileStep, ...]:
    """What :func:`render` needs compiled, as a small picture of any scene with a solid."""
    return (CompileStep('ray casting', lambda: render_stereo(scene, scene_rig(scene, 32, 32))),)


def _checked(scene: Scene) -> Scene:
    if not isinstance(scene, Scene):
        raise TypeError(f'scene: expected a Scene, got {type(scene).__name__}')
    return scene


def _render_views(
    scene: Scene, views: Sequence[ViewPose], engine: str, options: RenderOptions, stop: Stop | None
) -> list[Frame]:
    """Frames of several views, with the wall time of each."""
    chosen = engine_named(engine)
    refuse_options(engine, options)
    start = time.perf_counter()
    frames = chosen.render_views(_checked(scene), views, options, stop)
    for frame in frames:
        frame.stats.seconds = (time.perf_counter() - start) / len(views)
    return frames
