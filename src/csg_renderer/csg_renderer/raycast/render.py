"""Render a scene: the facade that library users, the command line and the node call."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from msgs_py import LensDistortion, PinholeCamera, Pose, StereoRig
from msgs_py.numeric.steps import CompileStep

from ..scene.scene import Scene
from .engines import SPARING, Engine, ViewPose, engine_named, refuse_options, refuse_surfaces, spares
from .exposure import blurred_light, finer, mean_pictures
from .frame import Frame, RenderOptions, RenderStats
from .programs.program import program_of
from .raw_view import mean_light
from .settings import DEFAULT_BASELINE_RATIO, DEFAULT_FOCAL, DEFAULT_SIZE, WHITE
from .shading import quantise
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
    if len(depths) and not scene.lights and scene.environment is None:
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
    lens: LensDistortion | None = None,
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
    lens : LensDistortion, optional
        Its distortion makes the picture the raw one of a camera with the calibration matrix of ``camera``: a ray for
        every raw pixel. Of 'native' and 'reference'.
    **options
        ``tile_size``, ``threads``, ``samples``, ``aperture``, ``focus``, ``motion``, ``pinholes``, ``psf``,
        ``early_outs``, ``left_heavy`` and ``radiance`` of :class:`RenderOptions`.

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
    return _render_views(scene, [ViewPose(camera, pose, lens)], engine, chosen, stop)[0]


def render_stereo(
    scene: Scene,
    rig: StereoRig | None = None,
    world_to_camera: Pose | None = None,
    engine: str = 'native',
    stop: Stop | None = None,
    lens: LensDistortion | tuple[LensDistortion, LensDistortion] | None = None,
    **options: Any,
) -> tuple[Frame, Frame]:
    """Render a rectified pair, or a raw one of cameras whose lenses distort.

    Parameters
    ----------
    scene : Scene
    rig : StereoRig, optional
        :func:`default_rig` of the scene by default.
    world_to_camera : Pose, optional
        Places the left camera, see :func:`render`.
    engine, stop
        See :func:`render`.
    lens : LensDistortion or two of them, optional
        Of both cameras, or of the left and the right one: the pair is raw, and undistorting it with the cameras of
        ``rig`` gives the rectified one.
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
    lenses = lens if isinstance(lens, tuple) else (lens, lens)
    views = [ViewPose(rig.left, left, lenses[0]), ViewPose(rig.right, right, lenses[1])]
    frames = _render_views(scene, views, engine, RenderOptions(**options), stop)
    return frames[0], frames[1]


def compile_steps(scene: Scene) -> tuple[CompileStep, ...]:
    """What :func:`render` needs compiled, as a small picture of any scene with a solid."""
    return (CompileStep('ray casting', lambda: render_stereo(scene, scene_rig(scene, 32, 32), antialias=2)),)


def _checked(scene: Scene) -> Scene:
    if not isinstance(scene, Scene):
        raise TypeError(f'scene: expected a Scene, got {type(scene).__name__}')
    return scene


def _render_views(
    scene: Scene, views: Sequence[ViewPose], engine: str, options: RenderOptions, stop: Stop | None
) -> list[Frame]:
    """Frames of several views, with the wall time of each."""
    chosen = engine_named(engine)
    refuse_options(engine, options, views)
    refuse_surfaces(engine, program_of(_checked(scene)))
    start = time.perf_counter()
    frames = _Rendering(engine, chosen, scene, options, stop).seen(views, views[0].camera_T_scene)
    for frame in frames:
        frame.stats.seconds = (time.perf_counter() - start) / len(views)
    return frames


@dataclass(frozen=True)
class _Rendering:
    """A scene that an engine renders in some way."""

    name: str
    engine: Engine
    scene: Scene
    options: RenderOptions
    stop: Stop | None

    @property
    def once(self) -> RenderOptions:
        """With one ray a pixel of a pinhole, and what the image rounds to bytes."""
        return replace(self.options, antialias=0, radiance=True, aperture=0.0, motion=(), psf=0.0)

    def seen(self, views: Sequence[ViewPose], left: Pose) -> list[Frame]:
        """Frames, with all that is asked for; left : the camera whose poses ``options.motion`` are."""
        options = self.options
        if options.psf > 0.0:
            return _blurred_frames(self, views, left)
        if options.averaged or (options.box and any(view.lens is not None for view in views)):
            return _mean_frames(self, views, left)
        return self.engine.render_views(self.scene, views, options, self.stop)

    def sharp(self, view: ViewPose) -> _Rendering:
        """Finer pictures of a view, before the lens has blurred them."""
        options = self.options
        antialias = options.antialias
        if options.box and not (self.name in SPARING and spares(options, program_of(self.scene), view)):
            # Finer pixels share out the samples.
            antialias = options.box // finer(options.psf)
            antialias = antialias if antialias > 1 else 0
        return replace(self, options=replace(options, psf=0.0, antialias=antialias))

    def light(self, views: Sequence[ViewPose], left: Pose) -> tuple[list[np.ndarray], list[RenderStats]]:
        """What ideal cameras see, (h, w, 3) each, and the work it took; through their apertures, in their exposures."""
        if self.options.averaged:
            light, stats = mean_pictures(self.frames, views, self.options, left)
            return list(light), stats
        frames = self.frames(views)
        return [np.asarray(frame.radiance) for frame in frames], [frame.stats for frame in frames]

    def frames(self, views: Sequence[ViewPose]) -> list[Frame]:
        """Frames with one ray a pixel."""
        return self.engine.render_views(self.scene, views, self.once, self.stop)


def _blurred_frames(rendering: _Rendering, views: Sequence[ViewPose], left: Pose) -> list[Frame]:
    """Frames of one ray a pixel with the light that a lens has blurred."""
    frames = rendering.frames(views)
    for frame, view in zip(frames, views):
        light = partial(_sharp_light, rendering.sharp(view), view, left, frame.stats)
        frame.psf = rendering.options.psf
        _with_light(frame, blurred_light(view.camera, frame.psf, light), rendering.options)
    return frames


def _sharp_light(
    rendering: _Rendering, view: ViewPose, left: Pose, stats: RenderStats, part: PinholeCamera
) -> np.ndarray:
    """What a finer camera sees in place of that of a view, (h, w, 3); its work is counted."""
    (frame,) = rendering.seen([view._replace(camera=part)], left)
    stats.add(frame.stats)
    return np.asarray(frame.image / np.float32(WHITE) if frame.radiance is None else frame.radiance)


def _mean_frames(rendering: _Rendering, views: Sequence[ViewPose], left: Pose) -> list[Frame]:
    """Frames whose pixels are means over their area, the aperture and the exposure."""
    options = rendering.options
    frames = rendering.frames(views)
    ideal = [k for k, view in enumerate(views) if view.lens is None]
    light, stats = rendering.light([views[k] for k in ideal], left) if options.averaged else ([], [])
    for k, seen, done in zip(ideal, light, stats):
        frames[k] = _with_light(frames[k], seen, options)
        frames[k].stats.add(done)
    for k, view in enumerate(views):
        if view.lens is not None or not options.averaged:
            frames[k] = _raw_frame(rendering, frames[k], view, left)
    return frames


def _raw_frame(rendering: _Rendering, frame: Frame, view: ViewPose, left: Pose) -> Frame:
    """A frame of one ray a pixel with its means, behind a lens that distorts where it has one."""
    camera, camera_T_scene, lens = view
    options = rendering.options

    def light(part: PinholeCamera) -> np.ndarray:
        """What an ideal camera sees in place of the raw one."""
        (seen,), (stats,) = rendering.light([ViewPose(part, camera_T_scene)], left)
        frame.stats.add(stats)
        return seen

    mean = None if lens is None else mean_light(camera, lens, max(options.box, 1), light)
    if frame.radiance is None or mean is None:
        if options.averaged:
            raise ValueError('lens: it sees too far aside for an aperture or motion')
        return rendering.engine.render_views(rendering.scene, [view], options, rendering.stop)[0]
    # A pixel on the rim of what the lens shows, into which no sample has fallen, is as its centre.
    return _with_light(frame, np.where(mean[1][..., None] > 0.0, mean[0], frame.radiance), options)


def _with_light(frame: Frame, light: np.ndarray, options: RenderOptions) -> Frame:
    frame.image = quantise(light)
    frame.radiance = light.astype(np.float32) if options.radiance else None
    return frame
