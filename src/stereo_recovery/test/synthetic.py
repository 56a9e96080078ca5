"""A small exact renderer of prisms, convex solids and cylinders, so that these tests need no other package.

Every face is a plane with an inside test; a pixel is the mean of ss x ss rays, blurred by a point spread function,
with noise added. The truth (visible edges and rims) comes from casting rays at points along each edge.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from scipy.spatial import ConvexHull

from msgs_py import PinholeCamera, Pose, StereoRig
from msgs_py.numeric.vectors import perpendicular


@dataclass
class Face:
    """A plane piece: polygon (n, 3), or a disc or cylinder side given by its centre, axis, radius and height."""

    kind: str
    points: np.ndarray
    normal: np.ndarray
    radius: float = 0.0
    height: float = 0.0
    albedo: float = 1.0


@dataclass
class Shape:
    faces: list[Face] = field(default_factory=list)
    edges: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)
    rims: list[tuple[np.ndarray, np.ndarray, float]] = field(default_factory=list)  # centre, normal, radius
    axes: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)

    def __add__(self, other: Shape) -> Shape:
        return Shape(self.faces + other.faces, self.edges + other.edges, self.rims + other.rims, self.axes + other.axes)

    def at(self, pose: Pose) -> Shape:
        move, turn = pose.apply, pose.rotate
        return Shape(
            [Face(f.kind, move(f.points), turn(f.normal), f.radius, f.height, f.albedo) for f in self.faces],
            [(move(a), move(b)) for a, b in self.edges],
            [(move(c), turn(n), r) for c, n, r in self.rims],
            [(move(a), move(b)) for a, b in self.axes],
        )


def prism(outline, height: float) -> Shape:
    """outline (n, 2), counter-clockwise in x, y; extruded along z."""
    outline = np.asarray(outline, float)
    n = len(outline)
    low = np.column_stack([outline, np.zeros(n)])
    high = np.column_stack([outline, np.full(n, height)])
    shape = Shape([Face('polygon', low[::-1], np.array([0, 0, -1.0])), Face('polygon', high, np.array([0, 0, 1.0]))])
    for i in range(n):
        j = (i + 1) % n
        side = np.array([low[i], low[j], high[j], high[i]])
        normal = np.cross(side[1] - side[0], side[3] - side[0])
        shape.faces.append(Face('polygon', side, normal / np.linalg.norm(normal)))
        shape.edges += [(low[i], low[j]), (high[i], high[j]), (low[i], high[i])]
    return shape


def convex(vertices) -> Shape:
    """The convex hull of points (n, 3), coplanar triangles joined."""
    vertices = np.asarray(vertices, float)
    hull = ConvexHull(vertices)
    planes: dict[tuple, set[int]] = {}
    for simplex, equation in zip(hull.simplices, hull.equations):
        key = tuple(np.round(equation, 6) + 0.0)
        planes.setdefault(key, set()).update(int(i) for i in simplex)
    shape = Shape()
    sides: dict[tuple[int, int], int] = {}
    for key, members in planes.items():
        normal = np.array(key[:3])
        ids = np.array(sorted(members))
        points = vertices[ids]
        first = points[0] - points.mean(axis=0)
        spokes = points - points.mean(axis=0)
        around = np.arctan2(spokes @ np.cross(normal, first), spokes @ first)
        ids = ids[np.argsort(around)]
        shape.faces.append(Face('polygon', vertices[ids], normal))
        for a, b in zip(ids, np.roll(ids, -1)):
            sides[tuple(sorted((int(a), int(b))))] = 1
    shape.edges = [(vertices[a], vertices[b]) for a, b in sides]
    return shape


def cylinder(radius: float, height: float) -> Shape:
    """Along +z from the origin."""
    up = np.array([0, 0, 1.0])
    base, top = np.zeros(3), height * up
    return Shape(
        [
            Face('side', base[None], up, radius, height),
            Face('disc', base[None], -up, radius),
            Face('disc', top[None], up, radius),
        ],
        [],
        [(base, -up, radius), (top, up, radius)],
        [(base, top)],
    )


def _hits(face: Face, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance along rays (n, 3) in units of the ray, inf where missed, and the normal's part towards the light."""
    with np.errstate(divide='ignore', invalid='ignore'):
        if face.kind == 'side':
            axis = face.normal
            oc = origin - face.points[0]
            d = rays - (rays @ axis)[:, None] * axis
            o = oc - (oc @ axis) * axis
            a, b, c = (d * d).sum(1), d @ o, o @ o - face.radius**2
            root = b * b - a * c
            t = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
            along = (oc @ axis) + t * (rays @ axis)
            t = np.where((along >= 0) & (along <= face.height) & (t > 0), t, np.inf)
            p = np.where(np.isfinite(t), t, 0)[:, None] * d + o
            return t, p / face.radius
        slope = rays @ face.normal
        t = ((face.points[0] - origin) @ face.normal) / slope
        t = np.where((slope < 0) & (t > 0), t, np.inf)
        p = origin + np.where(np.isfinite(t), t, 0)[:, None] * rays
        if face.kind == 'disc':
            inside = ((p - face.points[0]) ** 2).sum(1) <= face.radius**2
        else:
            e1 = face.points[1] - face.points[0]
            e1 = e1 / np.linalg.norm(e1)
            e2 = np.cross(face.normal, e1)
            q = np.stack([(p - face.points[0]) @ e1, (p - face.points[0]) @ e2], 1)
            poly = np.stack([(face.points - face.points[0]) @ e1, (face.points - face.points[0]) @ e2], 1)
            inside = np.zeros(len(q), bool)
            for (x0, y0), (x1, y1) in zip(poly, np.roll(poly, -1, axis=0)):
                if y0 != y1:
                    crossing = (x1 - x0) * (q[:, 1] - y0) / (y1 - y0) + x0
                    inside ^= ((y0 > q[:, 1]) != (y1 > q[:, 1])) & (q[:, 0] < crossing)
        return np.where(inside, t, np.inf), np.broadcast_to(face.normal, rays.shape)


def render(
    shape: Shape,
    camera: PinholeCamera,
    eye=(0.0, 0.0, 0.0),
    ss: int = 4,
    background: float = 30.0,
    light=(-0.4, -0.75, -0.6),
    ambient: float = 40.0,
    diffuse: float = 180.0,
    psf: float = 0.5,
    noise: float = 2.0,
    seed: int = 0,
) -> np.ndarray:
    """(h, w) uint8."""
    eye = np.asarray(eye, float)
    light = np.asarray(light, float) / np.linalg.norm(light)
    h, w = camera.height * ss, camera.width * ss
    image = np.full((h, w), background, np.float32)
    depth = np.full((h, w), np.inf, np.float32)
    for face in shape.faces:
        around = face.points
        if face.kind != 'polygon':
            box = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T * (face.radius + face.height)
            around = face.points[0] + box
        pixels = camera.project(around - eye)
        if not np.isfinite(pixels).all():
            continue
        low = np.maximum(np.floor((pixels.min(axis=0) + 0.5) * ss).astype(int) - 2, 0)
        high = np.minimum(np.ceil((pixels.max(axis=0) + 0.5) * ss).astype(int) + 2, [w, h])
        if (high <= low).any():
            continue
        u, v = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
        rays = camera.rays(np.stack([(u.ravel() + 0.5) / ss - 0.5, (v.ravel() + 0.5) / ss - 0.5], 1))
        t, normal = _hits(face, eye, rays)
        t = t.reshape(u.shape)
        # Half Lambert: no face is without light, so that no edge is without contrast by accident.
        shade = (ambient + diffuse * (0.5 + 0.5 * normal @ light) * face.albedo).reshape(u.shape)
        window = np.s_[low[1] : high[1], low[0] : high[0]]
        near = t < depth[window]
        depth[window][near] = t[near]
        image[window][near] = shade[near]
    image = image.reshape(camera.height, ss, camera.width, ss).mean(axis=(1, 3))
    if psf > 0:
        image = cv2.GaussianBlur(image, (0, 0), psf)
    image = image + np.random.default_rng(seed).normal(0, noise, image.shape) if noise > 0 else image
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def render_pair(shape: Shape, rig: StereoRig, seed: int = 0, **options) -> tuple[np.ndarray, np.ndarray]:
    return (
        render(shape, rig.left, (0, 0, 0), seed=2 * seed, **options),
        render(shape, rig.right, (rig.baseline, 0, 0), seed=2 * seed + 1, **options),
    )


def _seen(shape: Shape, points: np.ndarray, camera: PinholeCamera, eye: np.ndarray) -> np.ndarray:
    rays = points - eye
    free = camera.contains(camera.project(rays))
    for face in shape.faces:
        t, _ = _hits(face, eye, rays)
        free &= t > 1.0 - 1e-4
    return free


def visible_pieces(shape: Shape, start, end, rig: StereoRig, samples: int = 400) -> list[tuple[np.ndarray, np.ndarray]]:
    """Pieces of an edge seen by both cameras."""
    s = (np.arange(samples) + 0.5) / samples
    points = start + s[:, None] * (end - start)
    seen = np.ones(samples, bool)
    for camera, x in ((rig.left, 0.0), (rig.right, rig.baseline)):
        eye = np.array([x, 0, 0])
        visible = np.zeros(samples, bool)
        # A point just outside the edge on one of its two faces is seen when the edge is.
        for shift in _around(end - start):
            visible |= _seen(shape, points + 2e-5 * shift, camera, eye)
        seen &= visible
    steps = np.flatnonzero(np.diff(np.concatenate([[0], seen.astype(int), [0]])))
    return [
        (start + a / samples * (end - start), start + b / samples * (end - start))
        for a, b in zip(steps[::2], steps[1::2])
    ]


def _around(direction: np.ndarray) -> np.ndarray:
    direction = direction / np.linalg.norm(direction)
    first = -perpendicular(direction)
    second = np.cross(direction, first)
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    return np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second


def truth_edges(shape: Shape, rig: StereoRig, minimum: float = 0.004) -> np.ndarray:
    """(n, 2, 3), metres: visible pieces of at least the minimum length."""
    pieces = [piece for a, b in shape.edges for piece in visible_pieces(shape, a, b, rig)]
    pieces = [p for p in pieces if np.linalg.norm(p[1] - p[0]) >= minimum]
    return np.array(pieces).reshape(-1, 2, 3)


def truth_rims(shape: Shape, rig: StereoRig) -> list[tuple[np.ndarray, np.ndarray, float, float]]:
    """Rims with the share of their length that both cameras see: centre, normal, radius, share."""
    result = []
    for centre, normal, radius in shape.rims:
        frame = _around(normal)
        angle = np.linspace(0, 2 * np.pi, 360, endpoint=False)
        first, second = frame[0], np.cross(normal, frame[0])
        ring = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
        seen = np.ones(len(angle), bool)
        for camera, x in ((rig.left, 0.0), (rig.right, rig.baseline)):
            visible = np.zeros(len(angle), bool)
            for outward, up in ((1, 1), (1, -1), (-1, 1), (1, 0), (0, 1), (0, -1)):
                visible |= _seen(
                    shape, centre + radius * ring + 3e-5 * (outward * ring + up * normal), camera, np.array([x, 0, 0])
                )
            seen &= visible
        result.append((centre, normal, radius, float(seen.mean())))
    return result


@dataclass
class PrintedBox:
    """shape : to render; edges (n, 2, 3) : of the ideal box, those that both eyes see, left optical frame, metres;
    pose : left_T_box; size (3,) metres: the box reaches from the origin to it."""

    shape: Shape
    edges: np.ndarray
    pose: Pose
    size: np.ndarray


def printed_box(seed: int, fold: float = 1.5e-3, prints: int = 40) -> PrintedBox:
    """A cardboard box on end or lying, its long edges along the rows: rounded folds of this radius along them, and
    patches of other brightness on its faces, many with sides along the edges."""
    rng = np.random.default_rng(seed)
    size = np.array([rng.uniform(0.12, 0.18), rng.uniform(0.06, 0.09), rng.uniform(0.05, 0.08)])
    _, b, c = size
    bend = np.radians(np.arange(0, 91, 22.5))
    outline = [
        (x + fold * np.cos(t + q), y + fold * np.sin(t + q))
        for x, y, q in (
            (b - fold, c - fold, 0.0),
            (fold, c - fold, 0.5 * np.pi),
            (fold, fold, np.pi),
            (b - fold, fold, 1.5 * np.pi),
        )
        for t in bend
    ]
    # The prism's outline lies in y and z, its height along x.
    shape = prism(np.array(outline), size[0]).at(Pose(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), np.zeros(3)))
    for axis in range(3):
        along = [k for k in range(3) if k != axis]
        for side in (0.0, 1.0):
            for k in range(prints if axis else prints // 4):
                margin = 2 * fold
                low = margin + rng.uniform(0, 0.9, 2) * (size[along] - 2 * margin)
                high = np.minimum(low + rng.uniform(0.002, 0.5, 2) ** 1.5 * size[along], size[along] - margin)
                patch = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
                if k % 3 == 0:
                    centre, turn = patch.mean(axis=0), Pose.from_rotation_vector([0, 0, rng.uniform(0, 3)]).rotation
                    patch = np.clip(centre + (patch - centre) @ turn[:2, :2], margin, size[along] - margin)
                points = np.empty((4, 3))
                points[:, along] = patch
                normal = np.zeros(3)
                normal[axis] = 2.0 * side - 1.0
                points[:, axis] = side * size[axis] + (2 * side - 1) * (1e-5 + 1e-6 * k)
                shape.faces.append(Face('polygon', points, normal, albedo=rng.uniform(0.2, 1.3)))
    tilt = Pose.from_rotation_vector([np.radians(rng.uniform(35, 60)), 0, 0]).rotation
    yaw = Pose.from_rotation_vector([0, 0, rng.uniform(-0.03, 0.03)]).rotation
    swing = Pose.from_rotation_vector([0, rng.uniform(-0.08, 0.08), 0]).rotation
    turn = yaw @ tilt @ swing
    pose = Pose(turn, np.array([0.03, 0.0, rng.uniform(0.38, 0.46)]) - turn @ (0.5 * size))
    plain = convex(np.array(np.meshgrid(*[[0.0, x] for x in size])).reshape(3, -1).T).at(pose)
    rig = StereoRig.symmetric(PinholeCamera.centred(512, 448, 640.0), 0.06)
    return PrintedBox(shape.at(pose), truth_edges(plain, rig, 0.02), pose, size)


def solids() -> dict[str, Shape]:
    """A few solids of 60 to 70 mm, in metres, centred near their origin."""
    mm = 1e-3
    corner = [p for p in np.array(np.meshgrid([-30, 30], [-20, 20], [-25, 25])).reshape(3, -1).T if not (p > 0).all()]

    def centred(x: float, y: float, z: float) -> Pose:
        return Pose(np.eye(3), mm * np.array([x, y, z]))

    block = prism(mm * np.array([(0, 0), (60, 0), (60, 20), (25, 20), (25, 45), (0, 45)]), 30 * mm)
    groove = [(0, 0), (65, 0), (65, 40), (45, 40), (45, 15), (20, 15), (20, 40), (0, 40)]
    channel = prism(mm * np.array(groove), 35 * mm)
    base = prism(mm * np.array([(0, 0), (70, 0), (70, 50), (0, 50)]), 25 * mm)
    return {
        'L-block': block.at(centred(-30, -22, -15)),
        'chipped': convex(mm * np.array([*corner, (30, 20, 5), (30, 2, 25), (12, 20, 25)], float)),
        'wedge': prism(mm * np.array([(0, 0), (65, 0), (0, 35)]), 40 * mm).at(centred(-22, -12, -20)),
        'channel': channel.at(centred(-32, -20, -17)),
        'cylinder': cylinder(15 * mm, 40 * mm).at(centred(0, 0, -20)),
        'cylinder on box': base.at(centred(-35, -25, -25)) + cylinder(15 * mm, 35 * mm).at(centred(-10, -5, 0)),
    }
