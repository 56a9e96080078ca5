"""The native engine: four scenes of the renderer's bars at 512 x 512, brute force beside tiling, and peers beside both.

All times are whole render() calls, warm: depth, ids, normals and Phong's light of every light.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator

import embree
import numpy as np
import povray
from measure import Absent, Measurement, interleaved, milliseconds

from csg_renderer import Light, Scene, Solid, Surface, default_camera, default_rig, render, render_stereo
from msgs_py import PinholeCamera, Pose

LIGHTS = (Light((0.4, -0.6, -0.2)), Light((-0.5, -0.3, 0.0), (0.4, 0.4, 0.5)), Light((0.0, -0.9, 0.5), (0.3, 0.3, 0.2)))
PLASTIC = Surface((0.8, 0.5, 0.3), ambient=0.6, diffuse=0.6, specular=0.4, shininess=20)


def move(x: float, y: float, z: float) -> Pose:
    return Pose(np.eye(3), [x, y, z])


def tilt(about_x: float, about_y: float) -> Pose:
    return Pose.from_rotation_vector([np.radians(about_x), 0, 0]).compose(
        Pose.from_rotation_vector([0, np.radians(about_y), 0])
    )


def l_shape() -> Scene:
    """2 blocks, filling a quarter of the image."""
    solid = Solid.block(-0.05, 0.02, -0.03) | Solid.block(-0.02, 0.05, -0.03)
    pose = Pose(tilt(30, -40).rotation, [0.01, -0.03, 0.15])
    return Scene(solid.painted(PLASTIC).transformed(pose), LIGHTS[:1])


def lattice() -> Scene:
    """44 beams: four legs on four floors, with braces."""
    beams = []
    for x in (-1, 1):
        for z in (-1, 1):
            beams.append(Solid.block(0.012, 0.40, 0.012).transformed(move(0.09 * x, -0.2, 0.09 * z)))
    for floor in range(4):
        y = -0.2 + 0.125 * floor
        for side in (-1, 1):
            beams.append(Solid.block(0.192, 0.012, 0.012).transformed(move(-0.09, y, 0.09 * side)))
            beams.append(Solid.block(0.012, 0.012, 0.192).transformed(move(0.09 * side, y, -0.09)))
    for floor in range(3):
        y = -0.2 + 0.125 * floor
        for side in (-1, 1):
            for slope in (-1, 1):
                brace = Solid.block(0.22, 0.008, 0.008).transformed(move(-0.11, -0.004, -0.004))
                slanted = brace.transformed(Pose.from_rotation_vector([0, 0, slope * 0.6]))
                beams.append(slanted.transformed(move(0, y + 0.0625, 0.096 * side)))
                across = slanted.transformed(Pose.from_rotation_vector([0, np.pi / 2, 0]))
                beams.append(across.transformed(move(0.096 * side, y + 0.0625, 0)))
    solid = beams[0]
    for beam in beams[1:44]:
        solid = solid | beam
    return Scene(solid.painted(PLASTIC).transformed(Pose(tilt(-25, 30).rotation, [0, 0, 0.75])), LIGHTS)


def hollow_cubes() -> Scene:
    """42 primitives: 21 cubes, each with a sphere taken out, in three sizes."""
    cubes = []
    for level, (size, count) in enumerate(((0.12, 1), (0.06, 6), (0.03, 14))):
        for k in range(count):
            angle, height = 2 * np.pi * k / max(count, 1), 0.05 * (k % 3 - 1) if level else 0.0
            radius = (0.0, 0.13, 0.19)[level]
            cube = Solid.block(size, size, size).transformed(move(-size / 2, -size / 2, -size / 2))
            hole = Solid.sphere(0.63 * size)
            cubes.append((cube - hole).transformed(move(radius * np.cos(angle), height, radius * np.sin(angle))))
    solid = cubes[0]
    for cube in cubes[1:]:
        solid = solid | cube
    return Scene(solid.painted(PLASTIC).transformed(Pose(tilt(-30, 20).rotation, [0, 0, 0.6])), LIGHTS)


def table() -> Scene:
    """100 primitives: a laid table with mirrors and glass, three lights."""
    wood = Surface((0.5, 0.3, 0.15), ambient=0.5, diffuse=0.7, specular=0.2, shininess=10, reflection=0.15)
    glass = Surface(
        (0.6, 0.75, 0.8), ambient=0.3, diffuse=0.3, specular=0.8, shininess=80, transparency=0.6, reflection=0.1
    )
    china = Surface((0.9, 0.9, 0.85), ambient=0.4, diffuse=0.7, specular=0.5, shininess=40, reflection=0.1)
    steel = Surface((0.5, 0.5, 0.55), ambient=0.3, diffuse=0.4, specular=0.8, shininess=60, reflection=0.4)
    up = (0, -1, 0)
    parts: list[Solid] = [Solid.block(0.5, 0.02, 0.5).transformed(move(-0.25, 0, -0.25)).painted(wood)]
    for x in (-1, 1):
        for z in (-1, 1):
            parts.append(
                Solid.block(0.03, 0.25, 0.03).transformed(move(0.22 * x - 0.015, 0.02, 0.22 * z - 0.015)).painted(wood)
            )
    parts.append(Solid.block(2.0, 0.01, 2.0).transformed(move(-1, 0.27, -1)).painted(wood))
    for k in range(10):
        angle = 2 * np.pi * k / 10
        x, z = 0.17 * np.cos(angle), 0.17 * np.sin(angle)
        plate = Solid.cylinder(0.04, np.multiply(up, 0.006)) - Solid.sphere(0.1).transformed(move(0, -0.102, 0))
        parts.append(plate.painted(china).transformed(move(x, 0, z)))
        cup = Solid.cylinder(0.015, np.multiply(up, 0.04)) - Solid.cylinder(0.0125, np.multiply(up, 0.05)).transformed(
            move(0, -0.003, 0)
        )
        parts.append(cup.painted(glass).transformed(move(0.72 * x, 0, 0.72 * z)))
        parts.append(Solid.sphere(0.012).painted(steel).transformed(move(x, -0.016, z)))
        for side in (-1, 1):
            knife = Solid.block(0.004, 0.002, 0.05).transformed(move(-0.002, -0.002, -0.025))
            turn = Pose.from_rotation_vector([0, np.pi / 2 - angle, 0])
            parts.append(
                knife.painted(steel)
                .transformed(turn)
                .transformed(move(x - 0.05 * side * np.sin(angle), 0, z + 0.05 * side * np.cos(angle)))
            )
    for k in range(12):
        candle = Solid.cylinder(0.005, np.multiply(up, 0.05 + 0.01 * (k % 3)))
        flame = Solid.cone(0.005, (0, 0.02, 0)).transformed(move(0, -0.075 - 0.01 * (k % 3), 0))
        place = move(0.05 * np.cos(k * np.pi / 6), 0, 0.05 * np.sin(k * np.pi / 6))
        parts += [candle.painted(china).transformed(place), flame.painted(PLASTIC).transformed(place)]
    scene = Scene(
        [part.transformed(Pose(tilt(32, 15).rotation, [0, 0.02, 0.75])) for part in parts],
        LIGHTS,
        background=(0.2, 0.25, 0.35),
    )
    assert len(scene.primitives) == 100, len(scene.primitives)
    return scene


SCENES = {
    'L-shape, 2 blocks': (l_shape, 4.0),
    'lattice, 44 beams': (lattice, 8.0),
    'hollow cubes, 42 primitives': (hollow_cubes, 20.0),
}


def measurements(quick: bool) -> Iterator[Measurement | Absent]:
    budget = 0.5 if quick else 3.0
    camera = default_camera()
    traces = povray.available()
    no_embree = embree.missing()
    ratios = []
    for name, (build, bar) in SCENES.items():
        scene = build()
        rig = default_rig(scene, camera, 0.05)
        ours, pair = interleaved(
            [lambda s=scene: render(s, camera), lambda s=scene, r=rig: render_stereo(s, r)], budget
        )
        yield Measurement(name, ours, note=f'bar {bar:g} ms')
        yield Measurement(f'{name}: stereo pair', pair, note=f'{pair / ours:.2f} of one image; bar 1.7, aim 1.5')
        ratios.append(pair / ours)
        brute = milliseconds(lambda s=scene: render(s, camera, tiling=False), budget)
        tiled, untiled = render(scene, camera).stats, render(scene, camera, tiling=False).stats
        yield Measurement(
            f'{name}: without tiling',
            brute,
            note=f'tiling: time / {brute / ours:.1f}, intersections / '
            f'{untiled.intersections / tiled.intersections:.1f}',
        )
        if traces:
            yield _trace(name, scene, 1, False)
        if no_embree is None:
            spent, share, triangles = embree.cast_time(scene, camera, budget)
            yield Measurement(name, spent, by='Embree', note=f'hits of {triangles} triangles, one thread, no shading')
    yield Measurement('a stereo pair over one image, least', min(ratios), 'times')
    yield Measurement('a stereo pair over one image, most', max(ratios), 'times')
    scene = table()
    for levels, shadows in ((1, False), (2, True), (6, True)):
        what = f'table, 100 primitives, {levels} levels' + (', shadows' if shadows else '')
        ours = milliseconds(lambda n=levels, s=shadows: render(scene, camera, levels=n, shadows=s), budget)
        yield Measurement(what, ours)
        if traces and levels == 6:
            theirs = _trace(what, scene, levels, True)
            yield theirs
            yield Measurement(
                "table: POV-Ray's time over ours",
                theirs.value / ours,
                'times',
                lower_is_better=False,
                note='bar 8, aim 15',
            )
    for name, (build, _) in SCENES.items():
        yield from _anti_aliased(name, build(), camera, budget)
    yield Measurement('new process to image', min(_process() for _ in range(1 if quick else 3)), note='bar 800 ms')
    if not traces:
        yield Absent('POV-Ray', 'povray is not installed')
    if no_embree is not None:
        yield Absent('Embree', no_embree)


def _anti_aliased(name: str, scene: Scene, camera: PinholeCamera, budget: float) -> Iterator[Measurement]:
    """A picture with one sample a pixel, and anti-aliased ones beside it."""
    one, faces, sparse, every = interleaved(
        [
            lambda: render(scene, camera),
            lambda: render(scene, camera, antialias=1),
            lambda: render(scene, camera, antialias=4),
            lambda: render(scene, camera, antialias=4, every_pixel=True),
        ],
        budget,
    )
    frame = render(scene, camera)
    edges, seen = _edges(frame.primitive_id * 8 + frame.face_id), frame.mask.mean()
    for spent, what, bar in (
        (faces, '3 x 3 where faces meet', ''),
        (
            sparse,
            '4 x 4 samples',
            f'; edges cover {100 * edges:.1f} %, {100 * seen:.0f} % show something; bar 3, aim 2',
        ),
        (every, '4 x 4 samples in every pixel', ''),
    ):
        yield Measurement(f'{name}: anti-aliased, {what}', spent, note=f'{spent / one:.1f} of one sample{bar}')


def _edges(faces: np.ndarray) -> float:
    """The share of pixels that have another face beside, above or below them."""
    edge = np.zeros(faces.shape, dtype=bool)
    for axis in range(2):
        differ = np.diff(faces, axis=axis) != 0
        first, last = (np.delete(np.arange(faces.shape[axis]), end) for end in (-1, 0))
        for place in (first, last):
            part = np.take(edge, place, axis=axis) | differ
            edge[(place, slice(None)) if axis == 0 else (slice(None), place)] = part
    return float(edge.mean())


def _trace(name: str, scene: Scene, levels: int, shadows: bool) -> Measurement:
    camera = default_camera()
    text = povray.Writer(scene, camera, scene.camera_T_scene).text('shade', shadows=shadows, levels=levels)
    seconds = min(povray.run(text, camera)[1] for _ in range(3))
    return Measurement(name, 1e3 * seconds, by='POV-Ray', note='its own trace time, 2 threads')


def _process() -> float:
    code = (
        'from csg_renderer import Scene, Solid, Light, render\n'
        'import numpy as np\nm = np.eye(4); m[2, 3] = 0.5\n'
        'render(Scene(Solid.sphere(0.1).transformed(m), [Light((0, -1, 0))]))'
    )
    start = time.perf_counter()
    subprocess.run([sys.executable, '-c', code], check=True)
    return 1e3 * (time.perf_counter() - start)
