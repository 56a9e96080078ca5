"""What lens and exposure do to light before pixels count it: depth of field, motion, and the blur of the lens itself.

Light that comes through one point of a thin lens makes the picture of a pinhole there, moved so that what lies at the
focused depth stays where it is (Potmesil and Chakravarty 1981). So any engine has both by rendering many times. Each
pinhole's rays also pass the pixels elsewhere, which anti-aliases them.

What a lens blurs is light: pictures are rendered finer, blurred, and only then made pixels. To blur an image of pixels
is another thing: an edge that passes through a pixel has given it a share already, and is blurred as two edges with
shares, one pixel apart. Where its place in the pixels is the same all along, as that of an upright edge is, a
measurement of it is off by up to 0.1 pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import ArrayLike

from msgs_py import PinholeCamera, Pose
from msgs_py.numeric.typed import Float32Array, FloatArray

from .engines import ViewPose
from .frame import Frame, RenderOptions, RenderStats
from .settings import FINE_PSF, MOST_FINER, PINHOLE_STEPS, STRIP_SAMPLES


def pinholes(
    camera: PinholeCamera, camera_T_scene: Pose, options: RenderOptions, left: Pose
) -> Iterator[tuple[PinholeCamera, Pose]]:
    """The pinholes whose pictures are a camera's picture.

    Parameters
    ----------
    camera : PinholeCamera
    camera_T_scene : Pose
        In the middle of the exposure.
    options : RenderOptions
        Its aperture, focus, motion and number of pinholes.
    left : Pose
        Where the camera stands whose poses ``options.motion`` are: this one, or the left one of its rig.

    Yields
    ------
    PinholeCamera
    Pose
        Its camera_T_scene.
    """
    for k in range(options.pinholes):
        # Evenly spread over the lens, the exposure and the pixel at once.
        u, v, time, du, dv = np.modf(0.5 + (k + 1) * np.array(PINHOLE_STEPS))[0].tolist()
        radius = 0.5 * options.aperture * np.sqrt(u)
        x, y = radius * np.cos(2.0 * np.pi * v), radius * np.sin(2.0 * np.pi * v)
        nearness = 1.0 / options.focus if options.aperture else 0.0
        seen = replace(
            camera,
            cx=camera.cx + camera.fx * x * nearness - (du - 0.5),
            cy=camera.cy + camera.fy * y * nearness - (dv - 0.5),
        )
        pose = camera_T_scene
        if options.motion:
            pose = camera_T_scene.compose(left.inverse()).compose(along_path(options.motion, time))
        yield seen, Pose(pose.rotation, pose.translation - [x, y, 0.0], pose.scale)


def mean_pictures(
    render_views: Callable[[list[ViewPose]], list[Frame]], views: Sequence[ViewPose], options: RenderOptions, left: Pose
) -> tuple[list[FloatArray], list[RenderStats]]:
    """What ideal cameras see through their apertures in their exposures.

    Parameters
    ----------
    render_views : callable
        From views of pinholes to frames with radiance.
    views : sequence of ViewPose
        Without lenses that distort.
    options, left
        As for :func:`pinholes`.

    Returns
    -------
    list of (h, w, 3) float64
        Light of each view.
    list of RenderStats
        What was done for each view.
    """
    total: list[FloatArray] = [np.zeros((view.camera.height, view.camera.width, 3)) for view in views]
    stats = [RenderStats() for _ in views]
    for cameras in zip(*(pinholes(view.camera, view.camera_T_scene, options, left) for view in views)):
        for sums, done, frame in zip(total, stats, render_views([ViewPose(*camera) for camera in cameras])):
            sums += np.asarray(frame.radiance)
            done.add(frame.stats)
    return [sums / options.pinholes for sums in total], stats


def finer(psf: float) -> int:
    """How many pixels along each side of a pixel a picture has that is blurred.

    Parameters
    ----------
    psf : float
        Standard deviation of the blur, pixels, > 0.

    Returns
    -------
    int

    Examples
    --------
    >>> finer(0.5), finer(3.0), finer(0.01)
    (4, 1, 8)
    """
    return max(1, min(MOST_FINER, math.ceil(FINE_PSF / psf)))


def blurred_light(camera: PinholeCamera, psf: float, light: Callable[[PinholeCamera], np.ndarray]) -> Float32Array:
    """The light of a picture behind a lens that blurs.

    Parameters
    ----------
    camera : PinholeCamera
    psf : float
        Standard deviation of the blur, pixels, > 0.
    light : callable
        What a camera sees without blur, (h, w, 3): it is asked for strips of the picture, finer and with what is beside
        them.

    Returns
    -------
    (h, w, 3) float32
        On the scale of ``light``.
    """
    n, margin = finer(psf), math.ceil(4.0 * psf)
    width = camera.width + 2 * margin
    rows = max(STRIP_SAMPLES // (n * n * width) - 2 * margin, 1)
    out = np.empty((camera.height, camera.width, 3), np.float32)
    for top in range(0, camera.height, rows):
        height = min(rows, camera.height - top)
        # Pixels have whole numbers in their middles.
        middle = [n * (place + margin + 0.5) - 0.5 for place in (camera.cx, camera.cy - top)]
        fine = PinholeCamera(n * width, n * (height + 2 * margin), n * camera.fx, n * camera.fy, *middle)
        seen = np.asarray(light(fine), np.float32)
        seen = np.asarray(cv2.GaussianBlur(seen, (0, 0), n * psf, borderType=cv2.BORDER_REPLICATE))
        seen = np.asarray(cv2.resize(seen, (width, height + 2 * margin), interpolation=cv2.INTER_AREA))
        out[top : top + height] = seen[margin : margin + height, margin : margin + camera.width]
    return out


def along_path(path: Sequence[Pose], time: float) -> Pose:
    """A pose between poses in equal steps of time, by screws.

    Parameters
    ----------
    path : sequence of Pose
        At least two.
    time : float
        0 at the first, 1 at the last.

    Returns
    -------
    Pose
    """
    step = min(int(time * (len(path) - 1)), len(path) - 2)
    turn = path[step + 1].compose(path[step].inverse())
    return part_of(turn, time * (len(path) - 1) - step).compose(path[step])


def part_of(motion: Pose, share: float) -> Pose:
    """A part of a screw motion.

    Parameters
    ----------
    motion : Pose
        A turn about an axis together with a shift along it; every rigid motion is one.
    share : float
        1 is all of it, 0 none, negative backwards.

    Returns
    -------
    Pose

    Examples
    --------
    >>> part_of(Pose.from_rotation_vector([0, 0, np.pi / 2], [1.0, 1.0, 3.0]), 0.5).translation.round(3).tolist()
    [0.707, 0.293, 1.5]
    """
    turn = motion.rotation_vector
    velocity = np.linalg.solve(_shift(turn), motion.translation)
    return Pose.from_rotation_vector(share * turn, _shift(share * turn) @ (share * velocity))


def _shift(turn: FloatArray) -> FloatArray:
    """(3, 3): the shift of a steady velocity while the frame turns by a rotation vector."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # (1 - cos a) / a^2 and (a - sin a) / a^3, by their series where the quotients are rounding.
    small = angle < 1e-3
    first = 0.5 - angle**2 / 24.0 if small else (1.0 - np.cos(angle)) / angle**2
    second = 1.0 / 6.0 - angle**2 / 120.0 if small else (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


def moved_by(pose: Pose, metres: ArrayLike, degrees: ArrayLike) -> tuple[Pose, Pose]:
    """A path of a camera before which everything moves, from half before to half after a pose.

    Parameters
    ----------
    pose : Pose
        camera_T_scene in the middle.
    metres, degrees : (3,) array_like of float64
        How far the scene goes and turns as the camera sees it, the turn as a rotation vector about the camera's centre.

    Returns
    -------
    tuple of two Poses
        For ``motion`` of :func:`csg_renderer.render`.
    """
    motion = Pose.from_rotation_vector(np.radians(degrees), metres)
    return part_of(motion, -0.5).compose(pose), part_of(motion, 0.5).compose(pose)
