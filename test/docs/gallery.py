"""Draws the pictures and writes the tables of src/csg_renderer/docs/scenes.md.

python test/docs/gallery.py [FOLDER]      # default: where the page stands
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from csg_renderer import Scene, load_models, load_scene, model_features, render, visible_fragments
from csg_renderer.features import thesis_counts
from csg_renderer.features.thesis_counts import MODELS, SCENES
from csg_renderer.raycast.exposure import moved_by
from csg_renderer.raycast.outputs import save_image
from csg_renderer.raycast.render import scene_rig
from msgs_py import PinholeCamera

SOURCE = Path(__file__).resolve().parents[2] / 'src'
TITLES = {
    'chipped_block': 'Chipped Block',
    'chair': 'Chair',
    'computer': 'Computer',
    'l_shape': 'L-shape',
    'wedge': 'Wedge',
    'plug': 'Plug',
    'cylinder_box': 'CylinderBox',
    'lamp': 'Lamp',
    'tubes': 'Tubes',
    'widget': 'Widget',
    'coverplate': 'Coverplate',
    'recursive_cubes': 'Recursive Cubes',
    'oil_rig': 'Oil Rig',
    'robot_arm': 'Robot Arm',
    'geneva_wheel': 'Geneva Wheel',
    'table': 'Table',
}
# Scenes with a terrain, of which the thesis has none.
TERRAINS = ('hills',)
# Scenes with pictures on faces, metal and soft light.
SURFACES = ('carton', 'printed_goods')
# What camera.md shows of aperture and motion.
EXPOSURES: dict[str, dict[str, Any]] = {
    'pinhole': {'samples': 36},
    '24 mm wide, sharp at 0.4 m': {'samples': 4, 'aperture': 0.024, 'focus': 0.4},
    'moves 12 mm aside, turns by 2 deg': {'samples': 4, 'motion': ([0.012, 0.0, 0.0], [0.0, 0.0, 2.0])},
}
VIEWS = {**thesis_counts.VIEWS, **thesis_counts.REAL_VIEWS}
# Wide enough to count what is seen whatever the framing of a scene.
WIDE = PinholeCamera.centred(8000, 8000, 703.0)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog='gallery', description=__doc__)
    parser.add_argument(
        'folder',
        type=Path,
        nargs='?',
        default=SOURCE / 'csg_renderer' / 'docs',
        help='where the page and its pictures go',
    )
    parser.add_argument('--size', type=int, default=300, help='pixels a side of one picture (300)')
    options = parser.parse_args(arguments)
    models = [tile(name, options.size, name.replace('_', ' '), flipped=True) for name in tqdm(VIEWS, desc='models')]
    save_image(options.folder / 'test_models.png', sheet(models, 5))
    large = [
        tile(name, options.size, TITLES[name], levels=4 if name == 'table' else 1)
        for name in tqdm(SCENES, desc='large scenes')
    ]
    save_image(options.folder / 'large_scenes.png', sheet(large, 3))
    grounds = [tile(name, 2 * options.size, name, levels=4) for name in tqdm(TERRAINS, desc='terrains')]
    save_image(options.folder / 'terrain.png', sheet(grounds, 1))
    prints = [tile(name, 2 * options.size, name, levels=3) for name in tqdm(SURFACES, desc='surfaces')]
    save_image(options.folder / 'surfaces.png', sheet(prints, 2))
    blurred = [
        tile('printed_goods', options.size, title, levels=3, **camera)
        for title, camera in tqdm(EXPOSURES.items(), desc='exposures')
    ]
    save_image(options.folder / 'exposure.png', sheet(blurred, 3))
    (options.folder / 'scenes.md').write_text(page(), encoding='utf-8')
    return 0


def tile(name: str, size: int, title: str, flipped: bool = False, levels: int = 1, **options) -> np.ndarray:
    """(size, size, 3) uint8: a scene with its title. A test model fills the picture, whatever its camera says.

    levels : surfaces a ray may meet; with more than one there are shadows, too. options : of render
    """
    scene = load_scene(name)
    rig = scene_rig(scene, size, size, baseline=1.0)
    camera = framed(scene, size) if flipped else rig.left
    if 'motion' in options:
        options['motion'] = moved_by(scene.camera_T_scene, *options['motion'])
    image = render(scene, camera, antialias=3, shadows=levels > 1, levels=levels, **options).image
    if flipped:
        image = image[::-1]
    out: np.ndarray = np.ascontiguousarray(image)
    cv2.putText(out, title, (8, size - 10), cv2.FONT_HERSHEY_SIMPLEX, size / 650, (235, 235, 235), 1, cv2.LINE_AA)
    return out


def framed(scene: Scene, size: int) -> PinholeCamera:
    """A camera at the scene's place whose picture the objects fill."""
    frame = render(scene, PinholeCamera.centred(256, 256, 128.0))
    rows, columns = (np.nonzero(frame.mask.any(axis=axis))[0] for axis in (1, 0))
    middle = (columns[0] + columns[-1]) / 2, (rows[0] + rows[-1]) / 2
    extent = max(columns[-1] - columns[0], rows[-1] - rows[0]) + 1
    zoom = 0.8 * size / extent
    focal = 128.0 * zoom
    cx, cy = (size / 2 - (value - 127.5) * zoom for value in middle)
    return PinholeCamera(size, size, focal, focal, cx, cy)


def sheet(tiles: list[np.ndarray], columns: int) -> np.ndarray:
    """Tiles in rows, with thin lines between them."""
    height, width = tiles[0].shape[:2]
    rows = -(-len(tiles) // columns)
    out = np.full((rows * (height + 2) - 2, columns * (width + 2) - 2, 3), 60, dtype=np.uint8)
    for k, image in enumerate(tiles):
        y, x = (k // columns) * (height + 2), (k % columns) * (width + 2)
        out[y : y + height, x : x + width] = image
    return out


def page() -> str:
    """docs/scenes.md: ours beside the thesis, a line for every scene."""
    lines = [
        '# Scenes',
        '',
        'Written by `python test/docs/gallery.py`. The thesis gives counts and poses of its scenes; its dimensions are',
        'lost, these are ours. "ours (thesis)" where they differ; - where it gives no number.',
        '',
        '![Test models](test_models.png)',
        '',
        'The test models at the printed poses, each framed to fill its picture and turned over top to bottom, which is',
        'how the thesis shows them: its y axis points up, that of an optical frame down.',
        '',
        '![Large scenes](large_scenes.png)',
        '',
        '| model | primitives | half-spaces | edges | curves | axes |',
        '| --- | --- | --- | --- | --- | --- |',
    ]
    for name, counts in MODELS.items():
        thesis = counts.primitives, counts.halfspaces, counts.edges, counts.curves, counts.axes
        (model,) = load_models(name).values()
        ours = (len(model.primitives), model.halfspaces, *np.bincount(model_features(model).kind, minlength=3).tolist())
        lines.append(f'| {TITLES[name]} (`{name}`) | ' + ' | '.join(beside(a, b) for a, b in zip(ours, thesis)) + ' |')
    lines += ['', '| view | visible edges | curves | axes |', '| --- | --- | --- | --- |']
    for name, seen in VIEWS.items():
        lines.append(f'| `{name}` | ' + ' | '.join(beside(a, b) for a, b in zip(visible(name), seen)) + ' |')
    lines += ['', NOTES, '', '| scene | primitives | half-spaces |', '| --- | --- | --- |']
    for name, counts in SCENES.items():
        scene = load_scene(name)
        ours = (len(scene.primitives), sum(solid.halfspaces for solid in scene.solids))
        thesis = counts.primitives, counts.halfspaces
        lines.append(f'| {TITLES[name]} (`{name}`) | ' + ' | '.join(beside(a, b) for a, b in zip(ours, thesis)) + ' |')
    lines += ['', '![Hills](terrain.png)', '', TERRAIN_NOTES]
    lines += ['', '![Printed cartons, metal and soft light](surfaces.png)', '', SURFACE_NOTES]
    return '\n'.join(lines) + '\n'


TERRAIN_NOTES = """`hills`: a digital terrain map (`TERRAIN`, thesis 4.11) of 97 x 97 heights, coloured by height, with
shadows, water that mirrors and lets through, and solids on it: `render hills --shadows --levels 4 --antialias 3`.
`python test/docs/hills.py` makes the heights."""
SURFACE_NOTES = """`carton`: a picture for each side of a box (`TEXTURE`). `printed_goods`: it stands on a table
beside a can, a part of rough steel and a brass ball (`METAL`). `ENVIRONMENT` and a lamp with a `RADIUS` light it:
`render printed_goods --shadows --levels 3 --antialias 3`. `python test/docs/carton.py` draws the pictures."""
NOTES = """A feature counts once, however many pieces of it are seen. The thesis' counts of Plug, Chipped Block, Chair,
Computer, L-shape and Wedge are of ideal data. Those of CylinderBox, Lamp, Tubes and Widget are of recovered data, where
a broken edge counts twice and a weak one not at all: view 2 of the CylinderBox shows 9 edges of a box at most, of which
the thesis recovered 11 pieces. The thesis gives the Lamp 13 planar faces; this one has 12."""


def visible(name: str) -> tuple[int, ...]:
    """Edges, curves and axes of which some part is seen."""
    (placement,) = load_scene(name).placements
    seen = np.unique(visible_fragments(placement.model, placement.pose, WIDE).model_index)
    return tuple(np.bincount(model_features(placement.model).kind[seen], minlength=3).tolist())


def beside(ours: int, thesis: int | None) -> str:
    return f'{ours} (-)' if thesis is None else str(ours) if ours == thesis else f'{ours} ({thesis})'


if __name__ == '__main__':
    sys.exit(main())
