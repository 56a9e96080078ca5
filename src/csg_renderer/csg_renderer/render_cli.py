"""``ros2 run csg_renderer render``: a scene file to pictures, arrays and cameras."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from msgs_py import LensDistortion, Pose
from msgs_py.commands import DONE, INTERRUPTED, CommandParser, add_json, run_command

from .language import SceneError, SceneFile, find_scene, format_scene, read_scene, scene_names
from .raycast.engines import ENGINES
from .raycast.exposure import moved_by
from .raycast.frame import Frame
from .raycast.outputs import (
    camera_record,
    depth_picture,
    id_picture,
    normal_picture,
    save_arrays,
    save_camera,
    save_image,
)
from .raycast.render import render, scene_rig, viewing_hints
from .raycast.sensor import SensorModel
from .raycast.settings import BAYER_CHANNELS, DEFAULT_PINHOLES, DEFAULT_SAMPLES
from .scene.mesh_export import ExportError, export_mesh
from .scene.scene import Scene
from .scene.solid import Primitive
from .scene.terrain import Terrain

# Time between two checks of the files by --watch, seconds: short enough to seem immediate.
WATCH_PERIOD = 0.25


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit status: 0 when everything was written, 2 for a wrong scene, file or argument."""
    parser = render_parser()
    options = parser.parse_args(arguments)
    if options.scene is None and not options.list:
        parser.error('name a scene file, or a scene of the package (--list shows them)')
    if options.turntable is not None and options.turntable < 2:
        parser.error(f'--turntable: expected at least 2 pictures, got {options.turntable}')
    try:
        return run_command('render', _run, options)
    except KeyboardInterrupt:
        return INTERRUPTED


def _run(options: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Exit code and what --json prints. Raises OSError or ValueError."""
    if options.list:
        print('\n'.join(scene_names()))
        return DONE, {'scenes': scene_names()}
    if options.watch:
        return watch(options), {}
    try:
        _, pictures = run(options)
    except ExportError as error:
        raise ValueError(error) from None
    return DONE, {'written': pictures}


def run(options: argparse.Namespace) -> tuple[SceneFile, list[Path]]:
    """Read the scene and write everything asked for; the scene and the files.

    Raises SceneError, OSError, ValueError, ExportError.
    """
    found = read_scene(options.scene)
    for warning in found.warnings:
        print(f'warning: {warning}', file=sys.stderr)
    if options.print:
        print(format_scene(found.scene), end='')
        return found, []
    written = []
    if options.export:
        triangles = export_mesh(found.scene, options.export, options.segments)
        _say(options, f'{options.export}: {triangles} triangles')
        written.append(options.export)
    if options.output or not options.export:
        for hint in viewing_hints(found.scene):
            print(f'hint: {options.scene}: {hint}', file=sys.stderr)
        written += render_files(found.scene, options)
    return found, written


def render_files(scene: Scene, options: argparse.Namespace) -> list[Path]:
    """Render every view and write its files; returns them."""
    output = options.output or Path(Path(options.scene).stem + '.png')
    width, height = options.size or (0, 0)
    sensor = _sensor(options)
    settings = {
        'engine': options.engine,
        'tiling': not options.no_tiling,
        'levels': options.levels,
        'antialias': options.antialias,
        'shadows': options.shadows,
        'samples': options.samples,
        'early_outs': options.early_outs,
        'left_heavy': options.left_heavy,
        'radiance': sensor.fine,
        'lens': options.distortion,
        'aperture': options.aperture / 1000.0,
        'focus': options.focus / 1000.0,
        'pinholes': options.pinholes,
        'psf': options.psf,
    }
    # A single picture needs no baseline, and a scene with nothing in front of the camera suggests none.
    baseline = options.baseline / 1000.0 if options.baseline else 0.0 if options.stereo else 1.0
    rig = scene_rig(scene, width, height, options.focal, baseline)
    jobs: list[tuple[Path, Pose, bool]] = []
    for path, pose in views(scene, output, options.turntable):
        jobs.append((_marked(path, 'left') if options.stereo else path, pose, False))
        if options.stereo:
            other = Pose(pose.rotation, pose.translation + rig.right_T_left, pose.scale)
            jobs.append((_marked(path, 'right'), other, True))
    if options.engine == 'native':  # compiled, or loaded from the cache: no part of the times that are told
        render(scene, scene_rig(scene, 16, 16, baseline=1.0).left, **settings)
    written: list[Path] = []
    for path, pose, right in tqdm(jobs, desc='rendering', unit='picture', disable=options.quiet or None, leave=False):
        motion = moved_while_exposed(pose, rig.right_T_left if right else np.zeros(3), options.motion)
        frame = render(scene, rig.right if right else rig.left, pose, motion=motion, **settings)
        frame.image = sensor.picture(frame)
        written += write_frame(path, frame, options, rig.baseline if options.stereo else None)
        stats = frame.stats
        _say(
            options,
            f'{path}: {stats.seconds * 1e3:.1f} ms, {stats.tiles} tiles, {stats.intersections} intersections'
            + (f', {stats.dap_cycles} machine cycles, {stats.dap_planes} bit-planes' if stats.dap_cycles else ''),
        )
    return written


def moved_while_exposed(pose: Pose, aside: np.ndarray, motion: Sequence[float] | None) -> list[Pose]:
    """The path of a camera before which the scene moves as the left camera sees it, mm and degrees; none for None.

    aside : (3,) metres, this camera's frame from the left one's
    """
    if motion is None:
        return []
    left = Pose(pose.rotation, pose.translation - aside, pose.scale)
    path = moved_by(left, np.array(motion[:3]) / 1000.0, motion[3:])
    return [Pose(place.rotation, place.translation + aside, place.scale) for place in path]


def write_frame(path: Path, frame: Frame, options: argparse.Namespace, baseline: float | None = None) -> list[Path]:
    """Write one frame: the picture (or only the arrays, for a path that ends in .npz) and the companions asked for."""
    stem = path.with_suffix('')
    written = [save_arrays(path, frame)] if path.suffix == '.npz' else [save_image(path, frame.image)]
    if options.depth:
        written.append(save_image(_marked(stem.with_suffix('.png'), 'depth'), depth_picture(frame)))
    if options.ids:
        written.append(save_image(_marked(stem.with_suffix('.png'), 'ids'), id_picture(frame.primitive_id)))
    if options.normals:
        written.append(save_image(_marked(stem.with_suffix('.png'), 'normals'), normal_picture(frame)))
    if options.npz and path.suffix != '.npz':
        written.append(save_arrays(stem.with_suffix('.npz'), frame))
    if options.camera:
        written.append(save_camera(stem.with_suffix('.json'), camera_record(frame, baseline)))
    return written


def views(scene: Scene, output: Path, count: int | None) -> Iterable[tuple[Path, Pose]]:
    """The files and camera_T_scene of one view, or of a full turn of ``count`` views about the scene's middle."""
    if count is None:
        return [(output, scene.camera_T_scene)]
    digits = max(3, len(str(count - 1)))
    return [(_marked(output, f'{k:0{digits}d}'), turned(scene, 2.0 * np.pi * k / count)) for k in range(count)]


def turned(scene: Scene, angle: float) -> Pose:
    """camera_T_scene with the scene turned (radians) about the vertical through the middle of its objects.

    The vertical is the axis of the scene frame that is nearest to the vertical of the picture.
    """
    corners = np.array(
        [
            leaf.matrix[:3, 3] + leaf.matrix[:3, :3] @ _middle(leaf)
            for leaf in scene.primitives
            if leaf.kind in _MIDDLE or isinstance(leaf, Terrain)
        ]
    ).reshape(-1, 3)
    if not len(corners):
        return scene.camera_T_scene
    centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    vertical = np.zeros(3)
    vertical[np.argmax(np.abs(scene.camera_T_scene.rotation[1]))] = 1.0
    turn = Pose.from_rotation_vector(angle * vertical)
    return scene.camera_T_scene.compose(Pose(turn.rotation, centre - turn.rotation @ centre))


# The middle of each bounded primitive in its unit frame.
_MIDDLE = {
    'BLOCK': np.full(3, 0.5),
    'CYLINDER': np.array([0.0, 0.0, 0.5]),
    'CONE': np.array([0.0, 0.0, 0.5]),
    'SPHERE': np.zeros(3),
}


def _middle(leaf: Primitive | Terrain) -> np.ndarray:
    """The middle of a bounded leaf in its own frame."""
    middle: np.ndarray = leaf.outline.mean(axis=0) if isinstance(leaf, Terrain) else _MIDDLE[leaf.kind]
    return middle


def watch(options: argparse.Namespace, wait: Callable[[float], None] = time.sleep, rounds: int | None = None) -> int:
    """Render, and again whenever a file of the scene changes; a wrong scene is reported and the watch goes on.

    rounds : stop after looking this often (None: until interrupted).
    """
    path = find_scene(options.scene)
    files: tuple[Path, ...] = (path,)
    seen: list[int] | None = None
    try:
        while rounds is None or rounds > 0:
            now = [_changed_at(file) for file in files]
            if now != seen:
                seen = now
                try:
                    files = run(options)[0].files
                except SceneError as error:
                    print(error, file=sys.stderr)
                    # Includes named in the broken text are unknown; the ones known so far are still looked at.
                except (OSError, ValueError, ExportError) as error:
                    print(f'render: {error}', file=sys.stderr)
                seen = [_changed_at(file) for file in files] if len(files) != len(now) else now
                _say(options, f'watching {len(files)} file{"s" * (len(files) > 1)}; Ctrl-C ends')
            wait(WATCH_PERIOD)
            rounds = None if rounds is None else rounds - 1
    except KeyboardInterrupt:
        pass
    return 0


def _changed_at(path: Path) -> int:
    """Modification time, nanoseconds; 0 while there is no such file (editors replace files when they save)."""
    try:
        return os.stat(path).st_mtime_ns
    except OSError:
        return 0


def _marked(path: Path, mark: str) -> Path:
    """The path with a mark: out.png and left make out_left.png."""
    return path.with_name(f'{path.stem}_{mark}{path.suffix}')


def _say(options: argparse.Namespace, text: str) -> None:
    if not options.quiet:
        tqdm.write(text)


def _sensor(options: argparse.Namespace) -> SensorModel:
    """The lens and the chip that are asked for. Raises ValueError that names the option."""
    try:
        return SensorModel(
            options.psf,
            options.noise,
            options.seed,
            options.vignetting,
            options.exposure,
            options.full_well,
            options.read_noise,
            options.gain,
            options.black_level,
            options.gamma,
            options.srgb,
            options.bits,
            options.bayer,
        )
    except ValueError as error:
        name, _, rest = str(error).partition(':')
        option = {'psf_sigma': 'psf', 'noise_sigma': 'noise'}.get(name, name).replace('_', '-')
        raise ValueError(f'--{option}:{rest}') from None


def _size(text: str) -> tuple[int, int]:
    width, cross, height = text.lower().partition('x')
    try:
        size = int(width), int(height if cross else width)
    except ValueError:
        raise argparse.ArgumentTypeError(f'expected WIDTHxHEIGHT in pixels, got {text!r}') from None
    if not (1 <= size[0] <= 16384 and 1 <= size[1] <= 16384):
        raise argparse.ArgumentTypeError(f'expected 1..16384 pixels a side, got {text!r}')
    return size


def _distortion(text: str) -> LensDistortion:
    model, _, numbers = text.partition(':')
    try:
        return LensDistortion(model, tuple(float(number) for number in numbers.split(',')))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f'expected MODEL:K1,K2,..., got {text!r} ({error})') from None


def _antialias(text: str) -> bool | int:
    if text in ('edges', 'on', 'true'):
        return True
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected 'edges' or a number of samples a side, got {text!r}") from None


def render_parser() -> argparse.ArgumentParser:
    """The options of the command."""
    parser = CommandParser(
        prog='render',
        description='Render a scene of the modelling language, with its ground truth. '
        'Exit status 0: all was written, 2: bad input.',
    )
    parser.add_argument('scene', nargs='?', help='a scene file, or the name of a scene of the package')
    parser.add_argument('--list', action='store_true', help='list the scenes of the package')
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        metavar='FILE',
        help='picture to write (.png, .jpg, ...) or arrays (.npz); default: the name of the scene .png',
    )
    what = parser.add_argument_group('what to write')
    what.add_argument('--stereo', action='store_true', help='a pair: FILE_left and FILE_right')
    what.add_argument('--depth', action='store_true', help='also FILE_depth.png, near is bright')
    what.add_argument('--ids', action='store_true', help='also FILE_ids.png, a colour for each primitive')
    what.add_argument('--normals', action='store_true', help='also FILE_normals.png, camera frame')
    what.add_argument('--npz', action='store_true', help='also FILE.npz: exact depth, normals, ids, camera')
    what.add_argument('--camera', action='store_true', help='also FILE.json: K, [R|t], baseline')
    what.add_argument('--turntable', type=int, metavar='N', help='N pictures of a full turn, FILE_000 ...')
    what.add_argument(
        '--export',
        type=Path,
        metavar='MESH',
        help='write a mesh (.stl .glb .gltf .obj .ply); needs manifold3d and trimesh',
    )
    what.add_argument('--segments', type=int, default=64, metavar='N', help='facets around a circle of the mesh (64)')
    view = parser.add_argument_group('camera')
    view.add_argument('--size', type=_size, metavar='WxH', help='pixels; default: what the scene says, or 512x512')
    view.add_argument('--focal', type=float, default=0.0, metavar='PX', help='focal length in pixels')
    view.add_argument('--baseline', type=float, metavar='MM', help='distance of the two cameras, mm')
    how = parser.add_argument_group('how')
    how.add_argument('--engine', choices=sorted(ENGINES), default='native', help='who renders (native)')
    how.add_argument('--levels', type=int, default=1, metavar='N', help='surfaces a ray may meet; 1 is ray casting (1)')
    how.add_argument('--shadows', action='store_true', help='shadow feelers to every light')
    how.add_argument(
        '--antialias',
        type=_antialias,
        nargs='?',
        const=True,
        default=False,
        metavar='N',
        help='9 samples where faces meet, or N x N samples in every pixel',
    )
    how.add_argument(
        '--samples',
        type=int,
        default=DEFAULT_SAMPLES,
        metavar='N',
        help='directions of light a visible place samples: lights with a RADIUS, ENVIRONMENT, METAL '
        f'({DEFAULT_SAMPLES})',
    )
    how.add_argument(
        '--pinholes',
        type=int,
        default=DEFAULT_PINHOLES,
        metavar='N',
        help=f'pictures averaged for --aperture and --motion, in place of --antialias ({DEFAULT_PINHOLES})',
    )
    how.add_argument('--no-tiling', action='store_true', help='test every primitive on every ray, to compare')
    how.add_argument('--early-outs', action='store_true', help='--engine dap: leave out what no ray of a tile can show')
    how.add_argument(
        '--left-heavy', action='store_true', help='--engine dap: evaluate trees in the order that needs least store'
    )
    chip = parser.add_argument_group('lens and chip', 'Grey levels are of 255, whatever the bits.')
    chip.add_argument(
        '--distortion',
        type=_distortion,
        metavar='MODEL:K1,...',
        help='raw pictures of a lens, with its coefficients as camera_info has them: plumb_bob:-0.2,0.05,0,0,0, '
        'rational_polynomial:... (8) or equidistant:... (4)',
    )
    chip.add_argument('--aperture', type=float, default=0.0, metavar='MM', help='diameter of the lens; needs --focus')
    chip.add_argument('--focus', type=float, default=0.0, metavar='MM', help='depth that is sharp')
    chip.add_argument(
        '--motion',
        type=float,
        nargs=6,
        metavar=('X', 'Y', 'Z', 'RX', 'RY', 'RZ'),
        help='how the scene moves while it is exposed, as the left camera sees it: mm, and a rotation vector, degrees',
    )
    chip.add_argument('--psf', type=float, default=0.0, metavar='PX', help='blur of the lens, standard deviation')
    chip.add_argument(
        '--vignetting', type=float, default=0.0, metavar='SHARE', help='light lost in the corners, 0..0.99'
    )
    chip.add_argument(
        '--exposure', type=float, default=1.0, metavar='FACTOR', help='what the light is multiplied by (1)'
    )
    chip.add_argument(
        '--full-well', type=float, default=0.0, metavar='E', help='electrons that make white, for shot noise; 0: none'
    )
    chip.add_argument(
        '--read-noise', type=float, default=0.0, metavar='E', help='standard deviation, electrons; needs --full-well'
    )
    chip.add_argument('--gain', type=float, default=1.0, metavar='FACTOR', help='amplification of the electrons (1)')
    chip.add_argument('--noise', type=float, default=0.0, metavar='GREY', help='noise after it, standard deviation')
    chip.add_argument('--black-level', type=float, default=0.0, metavar='GREY', help='what is added to every pixel')
    chip.add_argument('--gamma', type=float, default=1.0, metavar='G', help='light to the power of 1 / G (1: linear)')
    chip.add_argument('--srgb', action='store_true', help='the curve of sRGB')
    chip.add_argument('--bits', type=int, default=8, help='of a number, 8..16; more than 8 are written as 16 (8)')
    chip.add_argument(
        '--bayer', choices=sorted(BAYER_CHANNELS), default='', help='the mosaic of a colour chip, as grey'
    )
    chip.add_argument('--seed', type=int, default=0, help='of the noise (0)')
    parser.add_argument(
        '--print',
        action='store_true',
        help='print the scene as one file, includes and names resolved, and render nothing',
    )
    parser.add_argument('--watch', action='store_true', help='render again whenever a file of the scene changes')
    parser.add_argument('-q', '--quiet', action='store_true', help='no progress, no figures')
    add_json(parser)
    return parser


if __name__ == '__main__':
    sys.exit(main())
