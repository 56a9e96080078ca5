"""Draws the pictures of the documentation: conventions, the method of recovery, and the worked example step by step.

python test/docs/pictures.py [--out FOLDER]      # default: where the pages look for them
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

import cv2
import matplotlib

matplotlib.use('Agg')
import factor_graph
import matplotlib.pyplot as plt
import numpy as np

import csg_renderer
import model_matcher
import stereo_recovery
from dap_emulator import dap_cli
from model_matcher.drawing import canvas, draw_features

SOURCE = Path(__file__).resolve().parents[2] / 'src'
EXAMPLE = SOURCE / 'model_matcher' / 'docs'
CONVENTIONS = SOURCE / 'msgs_py' / 'docs'
ARRAY_MACHINE = SOURCE / 'dap_emulator' / 'docs'
METHOD = SOURCE / 'stereo_recovery' / 'docs'
BROWSERS = ('chromium', 'chromium-browser', 'google-chrome', 'chrome')
# The step of the Game of Life that is shown: the masked assignment of its first generation.
MASKED_STEP = 4
CUT = slice(90, 410)  # the part of the picture that shows something
INK, X, Y, Z = '#333333', '#c0392b', '#27ae60', '#2471a3'


def arrow(axes, start, end, text: str, colour: str, offset=(0.0, 0.0)) -> None:
    axes.annotate('', xy=end, xytext=start, arrowprops={'arrowstyle': '-|>', 'color': colour, 'lw': 2})
    axes.text(end[0] + offset[0], end[1] + offset[1], text, color=colour, fontsize=11, ha='center', va='center')


def rig_from_above(axes) -> None:
    """The two eyes and a point, seen from above: x to the right, z forward."""
    for eye, name in ((0.0, 'left'), (2.0, 'right')):
        axes.plot([eye - 0.6, eye, eye + 0.6], [1.0, 0.0, 1.0], color=INK, lw=1.5)
        axes.plot([eye - 0.6, eye + 0.6], [1.0, 1.0], color=INK, lw=4, solid_capstyle='butt')
        axes.text(eye, -0.3, name, ha='right' if eye == 0 else 'left', color=INK)
        axes.plot([eye, 0.9], [0.0, 3.6], color='#999999', lw=1, ls='--')
    arrow(axes, (0, 0), (0, 2.2), 'z forward', Z, (-0.4, 0.25))
    arrow(axes, (0, 0), (1.3, 0), 'x', X, (0.2, 0.0))
    axes.annotate('', xy=(2, -0.6), xytext=(0, -0.6), arrowprops={'arrowstyle': '<->', 'color': INK})
    axes.text(1, -0.75, 'baseline > 0, along +x', ha='center', va='top', color=INK)
    axes.plot(0.9, 3.6, 'o', color=INK)
    axes.text(1.0, 3.75, "point, in the LEFT camera's frame, metres", ha='center', color=INK)
    axes.set_title('The rig from above')
    axes.text(
        1,
        -1.25,
        'right camera_info: P[0,3] = -fx · baseline\ndisparity = u_left - u_right = fx · baseline / z',
        ha='center',
        va='top',
        color=INK,
        fontsize=9,
    )


def image_frame(axes) -> None:
    """Pixels and the axes of the optical frame as one looks through the camera."""
    for k in range(6):
        axes.plot([k - 0.5, k - 0.5], [-0.5, 3.5], color='#bbbbbb', lw=1)
        axes.plot([-0.5, 4.5], [min(k, 4) - 0.5] * 2, color='#bbbbbb', lw=1)
    axes.plot(0, 0, 'o', color=INK)
    axes.text(-0.4, -0.8, 'pixel (0, 0): its centre', color=INK)
    axes.plot(2, 1.5, '+', color=INK, ms=14, mew=2)
    axes.text(2.25, 1.0, 'cx = (width - 1) / 2\ncy = (height - 1) / 2', color=INK, fontsize=9, va='center')
    arrow(axes, (2, 1.5), (3.7, 1.5), 'x right', X, (0.0, 0.3))
    arrow(axes, (2, 1.5), (2, 3.2), 'y down', Y, (0.65, 0.0))
    axes.text(1.8, 1.5, 'z into\nthe image', color=Z, ha='right', va='center')
    axes.set_title('Image and optical frame')


def features_drawing(axes) -> None:
    """What start and end mean for each kind of feature."""
    arrow(axes, (0, 3.2), (2.6, 3.6), '', '#27ae60')
    axes.text(1.3, 3.75, 'EDGE: start to end (no direction of its own)', ha='center', color='#27ae60')
    turn = np.linspace(0, 2 * np.pi, 100)
    axes.plot(1.3 + 1.1 * np.cos(turn), 1.75 + 0.45 * np.sin(turn), color='#2471a3', lw=2)
    axes.plot(1.3, 1.75, 'o', color='#2471a3')
    arrow(axes, (1.3, 1.75), (1.3, 2.75), '', '#2471a3')
    axes.text(1.45, 2.55, 'end = start + unit normal', color='#2471a3', va='center', fontsize=9)
    axes.text(1.3, 1.05, 'CURVE: start = centre, radii = (major, minor)', ha='center', color='#2471a3')
    for y in (0.15, -0.85):
        axes.plot(0.4 + 0.25 * np.cos(turn), y + 0.12 * np.sin(turn), color='#999999', lw=1)
    axes.plot([0.15, 0.15], [0.15, -0.85], color='#999999', lw=1)
    axes.plot([0.65, 0.65], [0.15, -0.85], color='#999999', lw=1)
    axes.plot([0.4, 0.4], [0.15, -0.85], color='#e67e22', lw=2, ls='--')
    axes.text(0.85, -0.35, 'AXIS: between the centres of\nthe two ends', color='#e67e22', va='center')
    axes.set_title('Features')


def draw_conventions(path: Path) -> None:
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.8))
    rig_from_above(axes[0])
    image_frame(axes[1])
    features_drawing(axes[2])
    limits = (((-1.6, 3.6), (-2.1, 4.3)), ((-0.8, 5.0), (4.0, -1.5)), ((-1.4, 4.2), (-1.2, 4.3)))
    for one, (across, upwards) in zip(axes, limits):
        one.set_xlim(*across)
        one.set_ylim(*upwards)
        one.set_aspect('equal')
        one.axis('off')
    figure.tight_layout()
    figure.savefig(path, dpi=100)
    plt.close(figure)


def save(path: Path, picture: np.ndarray) -> None:
    """The middle of a picture (BGR) of any enlargement."""
    scale = picture.shape[0] // 512
    cut = slice(CUT.start * scale, CUT.stop * scale)
    cv2.imwrite(str(path), cv2.resize(picture[cut], None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA))


def draw_example(folder: Path) -> None:
    """The bracket: rendered, its model features, what was recovered, and where it was found."""
    scene = csg_renderer.load_scene(EXAMPLE / 'bracket_scene.csg')
    rig = csg_renderer.default_rig(scene)
    left, right = csg_renderer.render_stereo(scene, rig, antialias=4)
    model = csg_renderer.model_features(scene.placements[0].model)
    truth = model.transformed(scene.camera_T_scene.compose(scene.placements[0].pose))
    recovery = stereo_recovery.recover(left.image, right.image, rig)
    best = model_matcher.match(model, recovery.features).interpretations[0]
    picture = np.ascontiguousarray(left.image[..., ::-1])
    save(folder / 'own_part_1_rendered.png', canvas(picture))
    save(folder / 'own_part_2_model.png', draw_features(canvas(picture, dim=0.0), truth, rig.left))
    save(folder / 'own_part_3_recovered.png', draw_features(canvas(picture, dim=0.4), recovery.features, rig.left))
    save(folder / 'own_part_4_found.png', draw_features(canvas(picture), model.transformed(best.pose), rig.left))


def draw_watched_program(path: Path) -> None:
    """The page of the Game of Life, as a browser shows it; left as it is where no browser is installed."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        print(f'{path.name}: no browser ({", ".join(BROWSERS)}), left as it is')
        return
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / 'life.html'
        dap_cli.main(['run', 'life', '--example', '--html', str(page)])
        options = [
            '--headless',
            '--no-sandbox',
            '--disable-gpu',
            '--window-size=1400,860',
            '--virtual-time-budget=4000',
        ]
        address = f'{page.as_uri()}#{MASKED_STEP}'
        subprocess.run(
            [browser, *options, f'--screenshot={path}', address], check=True, timeout=60, stderr=subprocess.DEVNULL
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--out', type=Path, help='one folder for all pictures')
    out = parser.parse_args().out
    for folder in (CONVENTIONS, EXAMPLE, ARRAY_MACHINE, METHOD) if out is None else (out,):
        folder.mkdir(parents=True, exist_ok=True)
    draw_conventions((out or CONVENTIONS) / 'conventions.png')
    factor_graph.draw((out or METHOD) / 'factor_graph.png')
    draw_example(out or EXAMPLE)
    draw_watched_program((out or ARRAY_MACHINE) / 'watch.png')


if __name__ == '__main__':
    main()
