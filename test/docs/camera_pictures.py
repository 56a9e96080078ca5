"""Draws the pictures of src/csg_renderer/docs/camera.md: one scene as cameras with one fault each take it.

python test/docs/camera_pictures.py [FOLDER]      # default: where the page stands
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from gallery import SOURCE, sheet

from csg_renderer import Frame, Scene, SensorModel, load_scene, render
from csg_renderer.raycast.outputs import save_image
from csg_renderer.raycast.render import scene_rig
from msgs_py import LensDistortion

SCENE = 'table'
# What is shown of the scene at each size of picture: title, sensor.
WHOLE = (
    ('as it is', SensorModel()),
    ('vignetting 0.7', SensorModel(vignetting=0.7)),
    ('exposure 0.25', SensorModel(exposure=0.25)),
    ('black_level 50', SensorModel(black_level=50.0)),
    ('gamma 2.2', SensorModel(gamma=2.2)),
    ('srgb', SensorModel(srgb=True)),
)
CLOSE = (
    ('as it is', SensorModel()),
    ('psf 1.5', SensorModel(psf_sigma=1.5)),
    ('noise 10', SensorModel(noise_sigma=10.0)),
    ('full_well 200', SensorModel(full_well=200.0)),
    ('... and read_noise 30', SensorModel(full_well=200.0, read_noise=30.0)),
    ('exposure 0.1, gain 10', SensorModel(full_well=2000.0, exposure=0.1, gain=10.0)),
    ('bayer rggb', SensorModel(bayer='rggb')),
)
# The dark part of a picture, made as bright as can be: 8 bits have too few numbers for it.
DARK = (('exposure 0.02, 8 bits', 8), ('exposure 0.02, 12 bits', 12))


# One room behind several lenses: title, lens, focal length as a share of that of the scene.
LENSES = (
    ('no distortion', None, 0.55),
    ('plumb_bob, k1 = -0.3', LensDistortion('plumb_bob', (-0.3, 0.08, 0.0, 0.0, 0.0)), 0.55),
    ('plumb_bob, k1 = +0.2', LensDistortion('plumb_bob', (0.2, 0.0, 0.0, 0.0, 0.0)), 0.55),
    ('plumb_bob, p1 = p2 = 0.03', LensDistortion('plumb_bob', (-0.1, 0.0, 0.03, 0.03, 0.0)), 0.55),
    ('rational_polynomial', LensDistortion('rational_polynomial', (0.6, -0.1, 0.0, 0.0, 0.02, 0.95, 0.05, 0.01)), 0.55),
    ('equidistant', LensDistortion('equidistant', (0.0, 0.0, 0.0, 0.0)), 0.3),
    ('equidistant, 178 degrees', LensDistortion('equidistant', (0.0, 0.0, 0.0, 0.0)), 0.2),
)


def titled(picture: np.ndarray, title: str) -> np.ndarray:
    """A picture, (h, w) or (h, w, 3) uint8, in colours and with its title."""
    out = np.ascontiguousarray(picture if picture.ndim == 3 else np.stack([picture] * 3, axis=-1))
    out[-24:] = out[-24:] // 3
    place = (8, out.shape[0] - 7)
    cv2.putText(out, title, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    return out


def enlarged(picture: np.ndarray, size: int, times: int) -> np.ndarray:
    """(size, size) pixels of the middle of a picture, each shown as a square of pixels."""
    part = size // times
    top, left = (picture.shape[0] - part) // 2, (picture.shape[1] - part) // 2
    return picture[top : top + part, left : left + part].repeat(times, axis=0).repeat(times, axis=1)


def brightened(picture: np.ndarray) -> np.ndarray:
    """A picture of any bits, so stretched that its brightest numbers are white."""
    share = picture / np.percentile(picture, 99.5)
    return np.asarray(np.rint(255.0 * share.clip(0.0, 1.0)), dtype=np.uint8)


def sensor_sheet(frame: Frame, size: int) -> np.ndarray:
    tiles = [titled(sensor.picture(frame), title) for title, sensor in WHOLE]
    tiles += [titled(enlarged(sensor.picture(frame), size, 5), title) for title, sensor in CLOSE]
    for title, bits in DARK:
        dark = brightened(SensorModel(exposure=0.02, bits=bits).picture(frame))
        tiles.append(titled(enlarged(dark, size, 2), title))
    return sheet(tiles, 5)


def lens_sheet(scene: Scene, size: int) -> np.ndarray:
    """The scene through every lens, and the barrel's picture undistorted again by OpenCV."""
    tiles = []
    for title, lens, share in LENSES:
        camera = scene_rig(scene, size, size, baseline=1.0).left
        wide = replace(camera, fx=share * camera.fx, fy=share * camera.fy)
        image = render(scene, wide, lens=lens, antialias=4, levels=4, shadows=True).image
        tiles.append(titled(image, title))
        if 'k1 = -' in title and lens is not None:
            straight = cv2.undistort(image, wide.matrix, np.array(lens.coefficients))
            tiles.append(titled(straight, '... undistorted by OpenCV'))
    return sheet(tiles, 4)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog='camera_pictures', description=__doc__)
    parser.add_argument('folder', type=Path, nargs='?', default=SOURCE / 'csg_renderer' / 'docs')
    parser.add_argument('--size', type=int, default=260, help='pixels a side of one picture (260)')
    options = parser.parse_args(arguments)
    scene = load_scene(SCENE)
    rig = scene_rig(scene, options.size, options.size, baseline=1.0)
    frame = render(scene, rig.left, antialias=4, levels=4, shadows=True, radiance=True)
    save_image(options.folder / 'sensor.png', sensor_sheet(frame, options.size))
    save_image(options.folder / 'lenses.png', lens_sheet(scene, options.size))
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
