"""POV-Ray as an independent renderer: a Scene written as .pov, and its images compared with ours.

POV-Ray ray traces CSG exactly too, so silhouettes, ids, depth, normals and Phong's light must agree. Run it on scene
files: ``python test/benchmarks/povray.py l_shape_v1 chipped_block_v1``. Needs the povray program.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from csg_renderer import Frame, Scene, default_camera, render
from csg_renderer.scene.solid import Operation, Primitive, Solid
from msgs_py import PinholeCamera, Pose

SHAPES = {
    'BLOCK': 'box { <0, 0, 0>, <1, 1, 1>',
    'CYLINDER': 'cylinder { <0, 0, 0>, <0, 0, 1>, 1',
    'CONE': 'cone { <0, 0, 0>, 0, <0, 0, 1>, 1',
    'SPHERE': 'sphere { <0, 0, 0>, 1',
    'PLANE': 'plane { z, 0',
}
OPERATIONS = {'UNION': 'union', 'INTERSECT': 'intersection', 'DIFFERENCE': 'difference'}
# POV-Ray's camera frame has y up; ours has it down.
FLIP = np.diag([1.0, -1.0, 1.0, 1.0])
# Faces of a leaf have one texture in POV-Ray, so ids are compared by leaf.
FULL = 65535.0


def available() -> bool:
    return shutil.which('povray') is not None


def _numbers(values) -> str:
    return '<' + ', '.join(f'{float(value):.17g}' for value in values) + '>'


class Writer:
    """One scene, seen by one camera, as .pov texts for different purposes."""

    def __init__(self, scene: Scene, camera: PinholeCamera, camera_T_scene: Pose) -> None:
        self.scene, self.camera, self.pov_T_scene = scene, camera, FLIP @ camera_T_scene.matrix

    def text(self, purpose: str, scale: float = 1.0, shadows: bool = False, levels: int = 1) -> str:
        """purpose : 'shade', 'ids', 'depth' (scale: metres of white), 'normal+' or 'normal-' (components per colour)"""
        self.leaf = 0
        self.purpose, self.scale, self.shadows = purpose, scale, shadows
        c = self.camera
        middle = [((c.width - 1) / 2 - c.cx) / c.fx, -((c.height - 1) / 2 - c.cy) / c.fy, 1.0]
        background = self.scene.background if purpose == 'shade' else (0, 0, 0)
        ambient = self.scene.ambient_light if purpose == 'shade' else (1, 1, 1)
        lines = [
            '#version 3.7;',
            f'global_settings {{ assumed_gamma 1.0 ambient_light rgb {_numbers(ambient)} '
            f'max_trace_level {max(levels, 1)} }}',
            f'camera {{ location <0, 0, 0> direction {_numbers(middle)} right {_numbers([c.width / c.fx, 0, 0])} '
            f'up {_numbers([0, c.height / c.fy, 0])} }}',
            f'background {{ rgb {_numbers(background)} }}',
        ]
        if purpose == 'shade':
            for light in self.scene.lights:
                at = self.pov_T_scene @ [*light.position, 1.0]
                lines.append(f'light_source {{ {_numbers(at[:3])} rgb {_numbers(light.colour)} }}')
        elif purpose.startswith('normal'):
            sign = 1.0 if purpose.endswith('+') else -1.0
            for axis in range(3):
                direction, colour = sign * np.eye(3)[axis], np.eye(3)[axis]
                lines.append(
                    f'light_source {{ {_numbers(direction * 1e4)} rgb {_numbers(colour)} parallel '
                    'point_at <0, 0, 0> shadowless }'
                )
        lines += [self._solid(solid) for solid in self.scene.solids if solid.primitives]
        return '\n'.join(lines) + '\n'

    def _solid(self, solid: Solid, top: bool = True) -> str:
        flags = ' no_shadow' if top and not self.shadows else ''
        if isinstance(solid, Primitive):
            return self._primitive(solid, flags)
        assert isinstance(solid, Operation)
        left = self._solid(solid.left, False)
        right = self._solid(solid.right, False)
        return f'{OPERATIONS[solid.operator]} {{\n{left}\n{right}\n{flags} }}'

    def _primitive(self, leaf: Primitive, flags: str) -> str:
        matrix = self.pov_T_scene @ leaf.matrix
        placed = f'{SHAPES[leaf.kind]} matrix {_numbers(matrix[:3].T.ravel())}'
        number, self.leaf = self.leaf, self.leaf + 1
        surface = leaf.surface
        flat = 'finish { ambient 1 diffuse 0 }'
        if self.purpose == 'ids':
            code = _numbers([(number + 1) % 256 / 255, (number + 1) // 256 / 255, 1])
            texture = f'pigment {{ rgb {code} }} {flat}'
        elif self.purpose == 'depth':
            texture = f'pigment {{ gradient z color_map {{ [0 rgb 0] [1 rgb 1] }} scale {self.scale:.17g} }} {flat}'
        elif self.purpose.startswith('normal'):
            texture = 'pigment { rgb 1 } finish { ambient 0 diffuse 1 }'
        else:
            texture = (
                f'pigment {{ rgb {_numbers(surface.colour)} transmit {surface.transparency:.17g} }} '
                f'finish {{ ambient {surface.ambient:.17g} diffuse {surface.diffuse:.17g} '
                f'phong {surface.specular:.17g} phong_size {surface.shininess:.17g} '
                f'reflection {surface.reflection:.17g} }}'
            )
        return f'{placed} texture {{ {texture} }}{flags} }}'


def run(text: str, camera: PinholeCamera, threads: int = 2) -> tuple[np.ndarray, float]:
    """The image (h, w, 3) uint16, RGB, and POV-Ray's own trace time, seconds."""
    with tempfile.TemporaryDirectory() as folder:
        source, image = Path(folder, 'scene.pov'), Path(folder, 'scene.png')
        source.write_text(text)
        done = subprocess.run(
            [
                'povray',
                f'+I{source}',
                f'+O{image}',
                f'+W{camera.width}',
                f'+H{camera.height}',
                '-D',
                '-A',
                '+FN16',
                'File_Gamma=1.0',
                f'+WT{threads}',
            ],
            capture_output=True,
            text=True,
            cwd=folder,
        )
        if done.returncode != 0:
            raise RuntimeError(f'povray failed:\n{done.stderr[-2000:]}')
        pixels = cv2.imread(str(image), cv2.IMREAD_UNCHANGED)
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[..., None], 3, axis=2)
    # "Trace Time: 0 hours 0 minutes 0 seconds (0.041 seconds)"
    times = re.findall(r'Trace Time:.*\((\d+\.\d+) seconds\)', done.stderr)
    return pixels[..., 2::-1], float(times[-1]) if times else float('nan')


@dataclass
class Comparison:
    """ids : pixels where silhouette or primitive differ; depth : p99.9 of the relative difference; normal_deg : p99 of
    the angle; shade : largest difference on the scale 0..255 off the pixels that differ; trace_s : POV-Ray's time"""

    ids: int
    depth: float
    normal_deg: float
    shade: float
    shade_p99: float
    trace_s: float


def compare(
    scene: Scene, camera: PinholeCamera | None = None, camera_T_scene: Pose | None = None, frame: Frame | None = None
) -> Comparison:
    """Our frame of a scene (ray casting, no shadows) beside POV-Ray's."""
    camera = camera or scene.camera or default_camera()
    pose = scene.camera_T_scene if camera_T_scene is None else camera_T_scene
    frame = frame or render(scene, camera, pose)
    writer = Writer(scene, camera, pose)
    ids = run(writer.text('ids'), camera)[0].astype(np.int64)
    theirs = np.where(ids[..., 2] > 0, np.rint(ids[..., 0] / 257) + 256 * np.rint(ids[..., 1] / 257) - 1, -1)
    same = theirs == frame.primitive_id
    both = same & frame.mask
    far = float(np.nanmax(frame.depth, initial=0.1)) * 1.01
    depth = run(writer.text('depth', far), camera)[0][..., 0] / FULL * far
    relative = np.abs(depth - frame.depth)[both] / frame.depth[both]
    normal = (run(writer.text('normal+'), camera)[0].astype(float) - run(writer.text('normal-'), camera)[0]) / FULL
    # POV-Ray turns normals to the viewer, as ours are wherever the camera is outside.
    ours = frame.camera_normal[both].astype(float) * [1, -1, 1]
    angle = 2.0 * np.degrees(np.arcsin(np.minimum(1.0, np.linalg.norm(ours - normal[both], axis=1) / 2.0)))
    # A leaf has one colour there, so paint that gives each face its own is left out for this comparison.
    shade, trace_s = run(writer.text('shade'), camera)
    image = render(_one_colour(scene), camera, pose).image if _painted(scene) else frame.image
    difference = np.abs(shade / 257.0 - image).max(axis=2)[same]
    return Comparison(
        int((~same).sum()),
        float(np.quantile(relative, 0.999)) if both.any() else 0.0,
        float(np.quantile(angle, 0.99)) if both.any() else 0.0,
        float(difference.max(initial=0.0)),
        float(np.quantile(difference, 0.99)),
        trace_s,
    )


def _painted(scene: Scene) -> bool:
    return any(leaf.face_colours is not None for leaf in scene.primitives)


def _one_colour(scene: Scene) -> Scene:
    """The scene with every leaf in the colour of its surface."""

    def plain(leaf: Primitive) -> Primitive:
        return replace(leaf, face_colours=None)

    solids = [
        solid.map_leaves(plain) if isinstance(solid, Operation) else plain(solid)
        for solid in scene.solids
        if solid.primitives
    ]
    return Scene(
        solids,
        scene.lights,
        scene.ambient_light,
        scene.background,
        camera=scene.camera,
        camera_T_scene=scene.camera_T_scene,
    )


def main() -> None:
    from csg_renderer import load_scene

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('scenes', nargs='+', help='scene files, or names of scenes of csg_renderer')
    for name in parser.parse_args().scenes:
        print(f'{name:24} {compare(load_scene(name))}')


if __name__ == '__main__':
    main()
