"""Random scenes with curved surfaces and the whole truth about them, for bench_curves.py.

Objects 60-70 mm across at 180 to 330 mm, baseline : distance 1 : 5, 512 x 512 pixels, f = 703 px, rendered by
csg_renderer with 4 x 4 rays a pixel, point spread 0.5 px and noise of 2 grey levels unless asked for otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from csg_renderer import Light, Placement, Scene, Solid, Surface, load_scene, model_features, render_stereo, scene_path
from csg_renderer.raycast.render import scene_rig
from csg_renderer.raycast.sensor import SensorModel, grey
from csg_renderer.scene.solid import Operation, Primitive
from csg_renderer.visibility.hidden_lines import stereo_fragments, visible_fragments
from msgs_py import FeatureKind, FeatureSet, PinholeCamera, Pose, StereoRig

MM = 1e-3
CAMERA = PinholeCamera.centred(512, 512, 703.0)
# Planes n.x + d = 0 of the unit primitives' flat faces, in the order of their faces.
UNIT_PLANES = {
    'BLOCK': np.array([[1.0, 0, 0, 0], [1, 0, 0, -1], [0, 1, 0, 0], [0, 1, 0, -1], [0, 0, 1, 0], [0, 0, 1, -1]]),
    'CYLINDER': np.array([[0.0, 0, 1, 0], [0, 0, 1, -1]]),
    'CONE': np.array([[0.0, 0, 1, -1]]),
    'SPHERE': np.zeros((0, 4)),
}
# What a rim, edge or part of one must stand out by, grey levels, to count as something to be seen.
LEAST_CONTRAST = 8.0
THESIS = (
    'cylinder_box_v1',
    'cylinder_box_v2',
    'tubes_v1',
    'lamp_v1',
    'lamp_v2',
    'plug_v1',
    'plug_v2',
    'widget_v1',
    'widget_v2',
)


@dataclass(frozen=True)
class Imaging:
    """How pictures are taken: rays a pixel (samples squared), blur in pixels, noise in grey levels, and how many
    times further away than usual (the baseline stays in proportion to the distance of the usual place)."""

    samples: int = 4
    blur: float = 0.5
    noise: float = 2.0
    distance: float = 1.0


@dataclass(frozen=True, eq=False)
class Rim:
    """A true circle or ellipse, left camera frame, metres: with how much of it both eyes see.

    centre, normal, major : (3,); radii : (2,); share : 0..1, of its circumference, in view and standing out;
    pixels : its major radius in the picture; squint : rad, between its plane and the line of sight;
    points : (k, 3), samples of what is seen
    """

    centre: np.ndarray
    normal: np.ndarray
    major: np.ndarray
    radii: np.ndarray
    share: float
    pixels: float
    squint: float
    points: np.ndarray


@dataclass(frozen=True, eq=False)
class CurvedView:
    """A rendered pair and its truth, left camera frame.

    edges : (n, 2, 3) seen by both eyes and standing out; seen : (k, 2, 3) the same and what hardly stands
        out; rims : all with any piece in view
    axes : (m, 2, 3), all of the model; seen_rims : (m,) how many of an axis' ends have a rim in view (share > 0.2); one
        is none when there is no outline beside it either, as in a bore
    """

    name: str
    left: np.ndarray
    right: np.ndarray
    rig: StereoRig
    edges: np.ndarray
    seen: np.ndarray
    rims: list[Rim]
    axes: np.ndarray
    seen_rims: np.ndarray


def _at(x: float, y: float, z: float, turn: np.ndarray | None = None) -> Pose:
    return Pose(np.eye(3) if turn is None else turn, MM * np.array([x, y, z]))


def _box(sx: float, sy: float, sz: float, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solid:
    """Millimetres; x and y are of its middle, z of its bottom."""
    return Solid.block(sx * MM, sy * MM, sz * MM).transformed(_at(x - sx / 2, y - sy / 2, z))


def _can(r: float, h: float, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solid:
    return Solid.cylinder(r * MM, [0, 0, h * MM]).transformed(_at(x, y, z))


def _frustum(low: float, high: float, h: float, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solid:
    """Radius low at the bottom, a smaller one, high, at the top; high = 0 makes a cone."""
    whole = h * low / (low - high)
    cone = Solid.cone(low * MM, [0, 0, -whole * MM]).transformed(_at(x, y, z + whole))
    return cone if high == 0.0 else cone - _box(4 * low, 4 * low, whole, x, y, z + h)


def _tilted(x: float, y: float, z: float, tilt: float, around: float) -> Solid:
    """A big block whose lower face passes through a point, tilted."""
    turn = Pose.from_rotation_vector([0, 0, around]).rotation @ Pose.from_rotation_vector([tilt, 0, 0]).rotation
    return _box(300, 300, 200).transformed(_at(x, y, z, turn))


def _on_box(rng: np.random.Generator) -> Solid:
    sx, sy, h = rng.uniform(60, 70), rng.uniform(45, 60), rng.uniform(15, 28)
    r = rng.uniform(10, 18)
    x, y = rng.uniform(-1, 1) * (sx / 2 - r - 2), rng.uniform(-4, 4)
    return _box(sx, sy, h, z=-h) | _can(r, rng.uniform(18, 38), x, y)


def _frustum_on_plate(rng: np.random.Generator) -> Solid:
    low = rng.uniform(14, 22)
    return _box(65, 55, 8, z=-8) | _frustum(low, low * rng.uniform(0.35, 0.75), rng.uniform(18, 32), rng.uniform(-8, 8))


def _cone(rng: np.random.Generator) -> Solid:
    low = rng.uniform(14, 24)
    return _box(65, 55, 8, z=-8) | _frustum(low, 0.0, rng.uniform(25, 45), rng.uniform(-8, 8))


def _one_rim(rng: np.random.Generator) -> Solid:
    """A cylinder behind a wall that hides its foot."""
    r = rng.uniform(10, 15)
    return _can(r, rng.uniform(32, 42)) | _box(65, 8, rng.uniform(16, 22), 0, -r - rng.uniform(8, 14))


def _oblique(rng: np.random.Generator) -> Solid:
    r, h = rng.uniform(11, 18), rng.uniform(25, 35)
    # The cut leans towards us, so that its face is seen.
    return (_can(r, 60) - _tilted(0, 0, h, rng.uniform(0.3, 0.8), rng.uniform(-1.2, 1.2))) | _box(60, 50, 10, z=-10)


def _tubes(rng: np.random.Generator) -> Solid:
    lying = Pose.from_rotation_vector([0, np.pi / 2, 0])
    away = Pose.from_rotation_vector([-np.pi / 2, 0, 0])
    whole = _can(rng.uniform(9, 12), 65, z=-30)
    for turn, r, z in ((lying, rng.uniform(5, 8), rng.uniform(-18, -8)), (away, rng.uniform(4, 7), rng.uniform(4, 20))):
        bar = _can(r, 56, z=-28).transformed(turn)
        whole = whole | bar.transformed(_at(0, 0, z))
    return whole


def _bores(rng: np.random.Generator) -> Solid:
    h = rng.uniform(15, 28)
    body = _box(65, 50, h, z=-h)
    for x in (-17, 17):
        r = rng.uniform(6, 12)
        deep = h + 2 if rng.random() < 0.5 else h * rng.uniform(0.3, 0.7)
        body = body - _can(r, deep + 1, x + rng.uniform(-3, 3), rng.uniform(-8, 8), -deep)
    return body


def _small(rng: np.random.Generator) -> Solid:
    """Pegs and holes of 8 to 20 pixels radius (at 250 mm: 2.8 to 7 mm)."""
    body = _box(66, 50, 12, z=-12)
    for x in (-24, -8, 8, 24):
        r, y = rng.uniform(2.8, 7.0), rng.uniform(-14, 14)
        body = (
            body - _can(r, 20, x, y, -rng.uniform(4, 11))
            if rng.random() < 0.5
            else body | _can(r, rng.uniform(5, 14), x, y)
        )
    return body


def _discs(rng: np.random.Generator) -> Solid:
    r, h = rng.uniform(16, 26), rng.uniform(8, 25)
    return _can(r, h) | _can(r * rng.uniform(0.4, 0.7), 40 - h, z=h)


def _hidden(rng: np.random.Generator) -> Solid:
    """A block stands in front of part of a disc."""
    r = rng.uniform(15, 22)
    side = rng.choice([-1, 1])
    return (
        _box(68, 60, 8, z=-8)
        | _can(r, rng.uniform(10, 22), 0, 8)
        | _box(rng.uniform(10, 18), 12, rng.uniform(22, 40), side * rng.uniform(4, 18), -22)
    )


def _slot(rng: np.random.Generator) -> Solid:
    """Rounded ends: arcs that run into edges without a corner; some with a slot cut in."""
    r, half, h = rng.uniform(14, 20), rng.uniform(12, 18), rng.uniform(10, 22)
    body = _box(2 * half, 2 * r, h) | _can(r, h, -half) | _can(r, h, half)
    if rng.random() < 0.6:
        inner = r * rng.uniform(0.4, 0.65)
        body = body - (
            _box(2 * half, 2 * inner, h + 2, z=-1) | _can(inner, h + 2, -half, 0, -1) | _can(inner, h + 2, half, 0, -1)
        )
    return body


def _clutter(rng: np.random.Generator) -> Solid:
    body = _can(rng.uniform(9, 15), rng.uniform(22, 36), rng.uniform(-8, 8), rng.uniform(-4, 4))
    for k in range(6):
        turn = Pose.from_rotation_vector([0, 0, rng.uniform(0, np.pi)])
        angle = k * np.pi / 3 + rng.uniform(-0.3, 0.3)
        far = rng.uniform(24, 34)
        block = _box(*rng.uniform(6, 18, 2), rng.uniform(5, 25)).transformed(turn)
        body = body | block.transformed(_at(far * np.cos(angle), far * np.sin(angle), 0))
    return body


def _ball(r: float, x: float, y: float, z: float) -> Solid:
    return Solid.sphere(r * MM).transformed(_at(x, y, z))


def _balls(rng: np.random.Generator) -> Solid:
    """Two balls, one on the plate and one sunk into it, whose outlines are no curves of theirs."""
    body = _box(68, 58, 8, z=-8)
    for x in (-17, 17):
        r = rng.uniform(8, 15)
        body = body | _ball(r, x + rng.uniform(-2, 2), rng.uniform(-10, 10), r if x < 0 else rng.uniform(0.0, 0.7) * r)
    return body


def _dome(rng: np.random.Generator) -> Solid:
    """A ball cut flat on top."""
    r = rng.uniform(14, 22)
    z, top = rng.uniform(-0.3, 0.3) * r, rng.uniform(0.4, 0.85) * r
    return _box(68, 58, 8, z=-8) | (_ball(r, rng.uniform(-8, 8), rng.uniform(-4, 4), z) - _box(90, 90, 40, z=z + top))


def _cut_cone(rng: np.random.Generator) -> Solid:
    """A cone cut by a slanting plane: its upper rim is an ellipse off its axis."""
    low, h = rng.uniform(16, 23), rng.uniform(35, 60)
    body = _frustum(low, 0.0, h) - _tilted(
        0, 0, rng.uniform(0.35, 0.6) * h, rng.uniform(0.25, 0.6), rng.uniform(-1.0, 1.0)
    )
    return body | _box(60, 52, 8, z=-8)


def _turned(rng: np.random.Generator) -> Solid:
    """A turned part: three or four steps on one axis, one of them a groove, and perhaps a bore."""
    radii, heights = rng.permutation([26.0, 19.0, 12.5, 16.0])[: rng.integers(3, 5)], rng.uniform(6, 14, 4)
    # Rims at least as far apart as a blurred step is wide.
    body, z = Solid.empty(), 0.0
    for r, h in zip(radii + rng.uniform(-1.5, 1.5, len(radii)), heights):
        body, z = body | _can(r, h, z=z), z + h
    return body - _can(rng.uniform(4, 8), 30, z=z - rng.uniform(4, 15)) if rng.random() < 0.5 else body


def _several(rng: np.random.Generator) -> Solid:
    """Four cylinders side by side, one of them lying."""
    body = _box(76, 66, 6, z=-6)
    for x, y in ((-20, -14), (18, -16), (-16, 17)):
        body = body | _can(rng.uniform(6, 12), rng.uniform(8, 30), x + rng.uniform(-3, 3), y + rng.uniform(-2, 2))
    r, half = rng.uniform(5, 8), rng.uniform(10, 14)
    turn = (
        Pose.from_rotation_vector([0, 0, rng.uniform(-1, 1)]).rotation
        @ Pose.from_rotation_vector([0, np.pi / 2, 0]).rotation
    )
    return body | _can(r, 2 * half, z=-half).transformed(_at(19, 17, 0.95 * r, turn))


def _oval(rng: np.random.Generator) -> Solid:
    """A column of elliptical section on a box, with an elliptical pocket."""

    def column(a: float, b: float, h: float, z: float) -> Solid:
        turn = Pose.from_rotation_vector([0, 0, around]).matrix
        return _can(1.0, h).transformed(turn @ np.diag([a, b, 1.0, 1.0])).transformed(_at(x, y, z))

    a, around, x, y = rng.uniform(15, 22), rng.uniform(0, np.pi), rng.uniform(-5, 5), rng.uniform(-3, 3)
    b, h = a * rng.uniform(0.5, 0.8), rng.uniform(10, 24)
    body = _box(66, 54, 12, z=-12) | column(a, b, h, 0.0)
    share = rng.uniform(0.45, 0.7)
    return body - column(share * a, share * b, 20, h - rng.uniform(3, 8)) if rng.random() < 0.5 else body


def _covered(rng: np.random.Generator) -> Solid:
    """A disc, a bar that crosses before it in the air, and a post before that."""
    r = rng.uniform(17, 24)
    turn = Pose.from_rotation_vector([0, 0, rng.uniform(-0.5, 0.5)]).rotation
    bar = _box(90, 5, 5).transformed(_at(0, -rng.uniform(8, 16), rng.uniform(24, 34), turn))
    return (
        _box(66, 60, 6, z=-6)
        | _can(r, rng.uniform(5, 14))
        | bar
        | _can(rng.uniform(3, 5), rng.uniform(20, 32), rng.choice([-1, 1]) * rng.uniform(4, 18), -26)
    )


@dataclass(frozen=True)
class Kind:
    """What to build, from how high above its ground it is seen, degrees, and how far it is turned to either side;
    joined : its upright faces have one colour, because they run into each other."""

    build: Callable[[np.random.Generator], Solid]
    elevation: tuple[float, float] = (20.0, 60.0)
    yaw: float = np.pi
    joined: bool = False


KINDS = {
    'cylinder on box': Kind(_on_box),
    'frustum': Kind(_frustum_on_plate),
    'cone': Kind(_cone, (12.0, 45.0)),
    'one rim': Kind(_one_rim, (12.0, 30.0), 0.3),
    'oblique cut': Kind(_oblique, (20.0, 50.0), 0.5),
    'tubes': Kind(_tubes),
    'bores': Kind(_bores, (30.0, 70.0)),
    'small': Kind(_small, (30.0, 65.0)),
    'edge-on': Kind(_discs, (6.0, 15.0)),
    'hidden in part': Kind(_hidden, (20.0, 45.0), 0.6),
    'slot': Kind(_slot, joined=True),
    'clutter': Kind(_clutter, (20.0, 50.0)),
}
# The number of a kind's random numbers: those of the first twelve go by the alphabet, newer ones follow.
STREAMS = sorted(KINDS)
KINDS |= {
    'balls': Kind(_balls),
    'dome': Kind(_dome),
    'cut cone': Kind(_cut_cone, (20.0, 50.0), 0.6),
    'turned': Kind(_turned, (15.0, 60.0)),
    'several': Kind(_several),
    'oval': Kind(_oval, (25.0, 60.0)),
    'covered': Kind(_covered, (20.0, 45.0), 0.6),
}
STREAMS += list(KINDS)[len(STREAMS) :]


def curved_view(kind: str, seed: int, imaging: Imaging | None = None) -> CurvedView:
    """A random scene of one of KINDS, or one of the THESIS' scenes (the seed is then only that of the noise)."""
    imaging = imaging or Imaging()
    if kind in THESIS:
        scene = load_scene(scene_path(kind))
        placed = [(item.model, scene.camera_T_scene.compose(item.pose)) for item in scene.placements]
        return _view(f'{kind} {seed}', scene, placed, scene_rig(scene), imaging, seed)
    rng = np.random.default_rng([seed, STREAMS.index(kind)])
    what = KINDS[kind]
    solid = _shaded(what.build(rng), rng, what.joined)
    depth = rng.uniform(0.18, 0.33)
    rig = StereoRig.symmetric(CAMERA, depth / 5.0)
    # z up in the model, seen from above; the camera may lean.
    turn = (
        Pose.from_rotation_vector([0, 0, rng.uniform(-0.35, 0.35)]).rotation
        @ Pose.from_rotation_vector([np.pi / 2 + np.radians(rng.uniform(*what.elevation)), 0, 0]).rotation
        @ Pose.from_rotation_vector([0, 0, rng.uniform(-what.yaw, what.yaw)]).rotation
    )
    # The thing's middle, about 10 mm above its ground, goes to the middle of what both eyes see.
    place = np.array([rig.baseline / 2 + rng.uniform(-4, 4) * MM, rng.uniform(-4, 4) * MM, depth * imaging.distance])
    pose = Pose(turn, place - turn @ [0, 0, 8 * MM])
    lamp = np.array([rng.uniform(-0.5, 0.6), -rng.uniform(0.4, 1.0), rng.uniform(-0.2, 0.1)])
    scene = Scene(
        [Placement('thing', solid, pose.matrix)],
        [Light(tuple(lamp), (0.65, 0.65, 0.65))],
        np.full(3, rng.uniform(0.25, 0.4)),
        np.full(3, rng.uniform(0.02, 0.25)),
    )
    return _view(f'{kind} {seed}', scene, [(solid, pose)], rig, imaging, seed)


def _shaded(solid: Solid, rng: np.random.Generator, joined: bool) -> Solid:
    """Each plane and each curved face its own grey: an edge between faces of one brightness shows nothing to anybody,
    and one face that two primitives share must not show a seam. joined : upright faces run into each other smoothly."""
    greys: dict[tuple[int, ...], float] = {}

    def shade(leaf: Primitive) -> Primitive:
        planes = UNIT_PLANES[leaf.kind] @ np.linalg.inv(leaf.matrix)
        planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        # A cutter's face and the face it leaves look opposite ways.
        largest = np.take_along_axis(planes, np.abs(planes[:, :3]).argmax(axis=1)[:, None], axis=1)
        planes *= np.where(largest < 0.0, -1.0, 1.0)
        keys = [tuple(np.round(plane / [1e-3, 1e-3, 1e-3, 1e-5]).astype(int)) for plane in planes]
        keys += [(len(greys), 0)] if leaf.kind != 'BLOCK' else []
        if joined:
            keys = [key if len(key) == 4 and key[2] != 0 else (0,) for key in keys]
        for key in keys:
            # Far from the one before.
            greys.setdefault(key, 0.4 + 0.6 * ((0.618 * len(greys) + first) % 1.0))
        colours = np.repeat(np.array([greys[key] for key in keys])[:, None], 3, axis=1)
        return replace(leaf, surface=Surface(colour=(1.0, 1.0, 1.0)), face_colours=colours)

    first = rng.uniform()
    return solid.map_leaves(shade) if isinstance(solid, Operation) else shade(solid)


def _view(name: str, scene: Scene, placed: list, rig: StereoRig, imaging: Imaging, seed: int) -> CurvedView:
    frames = render_stereo(scene, rig, antialias=imaging.samples if imaging.samples > 1 else False)
    clean = [grey(frame.image) for frame in frames]
    left, right = (
        SensorModel(imaging.blur, imaging.noise, [seed, side]).apply(image) for side, image in enumerate(clean)
    )
    edges, all_edges, rims, axes, counts = [], [], [], [], []
    for (solid, pose), (seen, index) in zip(placed, stereo_fragments(placed, rig)):
        model = model_features(solid).transformed(pose)
        edges.append(_standing_out(seen.of_kind(FeatureKind.EDGE), clean, rig))
        sides = seen.of_kind(FeatureKind.EDGE)
        all_edges.append(np.stack([sides.start, sides.end], axis=1))
        mine = _rims(model, seen, index, clean, rig)
        outlines = visible_fragments(solid, pose, rig.left).contours.of_kind(FeatureKind.EDGE)
        rims += mine
        for k in np.flatnonzero(model.kind == FeatureKind.AXIS):
            ends = np.stack([model.start[k], model.end[k]])
            # A cone's apex has no rim; an oblique cut's centre is on the axis.
            about = [
                [rim for rim in mine if np.linalg.norm(rim.centre - end) < 1e-5 and rim.share > 0.2] for end in ends
            ]
            count = sum(len(rims) > 0 for rims in about)
            if count == 1 and not _has_outline(ends, max(rim.radii[0] for rims in about for rim in rims), outlines):
                count = 0
            axes.append(ends)
            counts.append(count)
    return CurvedView(
        name,
        left,
        right,
        rig,
        np.concatenate(edges),
        np.concatenate(all_edges),
        rims,
        np.array(axes).reshape(-1, 2, 3),
        np.array(counts, int),
    )


def _has_outline(ends: np.ndarray, radius: float, outlines: FeatureSet) -> bool:
    """Whether the left eye sees an outline of the surface about an axis, at least 3 mm of it."""
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    off = [np.linalg.norm(np.cross(points - ends[0], along), axis=1) for points in (outlines.start, outlines.end)]
    return bool(((np.maximum(*off) < 1.05 * radius) & (np.minimum(*off) > 0.0) & (outlines.lengths > 3 * MM)).any())


def contrast(
    points: np.ndarray, along: np.ndarray, images: list[np.ndarray], rig: StereoRig, reach: float = 2.0
) -> np.ndarray:
    """(n,) float64: grey levels between the two sides of points (n, 3) on a line that runs along (n, 3), in the clean
    images; the lower of the two."""
    worst = np.full(len(points), np.inf)
    for image, camera, eye in zip(images, (rig.left, rig.right), (0.0, rig.baseline)):
        at = points - [eye, 0.0, 0.0]
        a, b = camera.project(at), camera.project(at + 1e-4 * along)
        run = b - a
        across = reach * np.stack([-run[:, 1], run[:, 0]], axis=1) / np.maximum(np.hypot(*run.T), 1e-12)[:, None]
        sides = [
            cv2.remap(
                image.astype(np.float32),
                (a + s * across)[:, None, 0].astype(np.float32),
                (a + s * across)[:, None, 1].astype(np.float32),
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )[:, 0]
            for s in (1.0, -1.0)
        ]
        worst = np.minimum(worst, np.abs(sides[0] - sides[1]))
    return worst


def _standing_out(edges: FeatureSet, images: list[np.ndarray], rig: StereoRig) -> np.ndarray:
    """(n, 2, 3): pieces of edges with contrast, at least 4 mm long at the usual distance."""
    pieces = []
    for start, end in zip(edges.start, edges.end):
        at = (np.arange(60) + 0.5) / 60
        points = start + at[:, None] * (end - start)
        good = (
            contrast(points, np.repeat((end - start)[None] / np.linalg.norm(end - start), 60, axis=0), images, rig)
            > LEAST_CONTRAST
        )
        # A few weak samples (a corner's neighbourhood) do not break an edge.
        good = cv2.morphologyEx(
            good.astype(np.uint8)[None], cv2.MORPH_CLOSE, np.ones((1, 9), np.uint8), borderType=cv2.BORDER_REPLICATE
        )[0].astype(bool)
        steps = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(int), [0]])))
        pieces += [
            (start + a / 60 * (end - start), start + b / 60 * (end - start)) for a, b in zip(steps[::2], steps[1::2])
        ]
    pieces = [p for p in pieces if np.linalg.norm(p[1] - p[0]) >= 4 * MM]
    return np.array(pieces).reshape(-1, 2, 3)


def _rims(
    model: FeatureSet, seen: FeatureSet, index: np.ndarray, images: list[np.ndarray], rig: StereoRig
) -> list[Rim]:
    result = []
    for k in np.flatnonzero(model.kind == FeatureKind.CURVE):
        centre, normal, major, radii = model.start[k], model.directions[k], model.major_axis[k], model.radii[k]
        minor = np.cross(normal, major)
        points = []
        for row in np.flatnonzero(index == k):
            start, extent = seen.arc[row]
            # A fragment may have its own origin of angles.
            first, second = seen.major_axis[row], np.cross(seen.directions[row], seen.major_axis[row])
            angle = start + extent * (np.arange(max(4, int(120 * extent))) + 0.5) / max(4, int(120 * extent))
            at = np.column_stack([np.cos(angle), np.sin(angle)]) * seen.radii[row]
            place = seen.start[row] + at @ np.stack([first, second])
            run = np.column_stack([-np.sin(angle), np.cos(angle)]) * seen.radii[row] @ np.stack([first, second])
            run /= np.linalg.norm(run, axis=1, keepdims=True)
            points.append(place[contrast(place, run, images, rig) > LEAST_CONTRAST])
        shown = np.concatenate(points) if points else np.zeros((0, 3))
        around = np.arctan2((shown - centre) @ minor / radii[1], (shown - centre) @ major / radii[0])
        bins = np.unique(np.floor(around / (2 * np.pi) * 240).astype(int))
        if len(bins) == 0:
            continue
        sight = centre / np.linalg.norm(centre)
        result.append(
            Rim(
                centre,
                normal,
                major,
                radii,
                len(bins) / 240,
                rig.left.fx * radii[0] / centre[2],
                float(np.arcsin(min(1.0, abs(sight @ normal)))),
                shown,
            )
        )
    return result
