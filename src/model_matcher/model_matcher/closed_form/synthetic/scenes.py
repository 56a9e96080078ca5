"""Wire-frame models in code and seeded scenes of them, for tests and benchmarks.

A scene is what a stereo recovery might hand over: fragments of model features, perturbed, thinned, in arbitrary
direction and order, among fragments of other objects (clutter). The truth is kept beside the data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from msgs_py import BIN, FeatureKind, FeatureSet, Pose


@dataclass(frozen=True)
class SyntheticScene:
    """Data with its truth.

    Attributes
    ----------
    data
        FeatureSet in the camera frame.
    assignment : (n,) int32
        True model feature of each data feature or BIN.
    sign : (n,) int8
    instance : (n,) int32
        Which instance (index into poses) a feature belongs to, -1 for clutter.
    poses
        The true camera_T_model of every instance of the model.
    """

    data: FeatureSet
    assignment: np.ndarray
    sign: np.ndarray
    instance: np.ndarray
    poses: tuple[Pose, ...]


# -- models (metres) -------------------------------------------------------------------------------------------------


def prism(polygon: ArrayLike, depth: float) -> FeatureSet:
    """The edges of a right prism: polygon (k, 2) in x, y, extruded from z = 0 to z = -depth."""
    flat = np.asarray(polygon, dtype=float)
    near = np.column_stack([flat, np.zeros(len(flat))])
    far = near - [0.0, 0.0, depth]
    start = np.concatenate([near, far, near])
    end = np.concatenate([np.roll(near, -1, axis=0), np.roll(far, -1, axis=0), far])
    return FeatureSet.from_edges(start, end)


def box(size: ArrayLike, corner: ArrayLike = (0.0, 0.0, 0.0)) -> FeatureSet:
    """The 12 edges of a block of the given size (3,), one corner at ``corner``, the others in +x, +y, -z."""
    sx, sy, sz = np.asarray(size, dtype=float)
    edges = prism([(0, 0), (sx, 0), (sx, sy), (0, sy)], sz)
    return edges.transformed(Pose(np.eye(3), np.asarray(corner, dtype=float)))


def chipped_block() -> FeatureSet:
    """A block with one corner cut off obliquely: 7 faces, 15 edges."""
    edges = box((0.12, 0.07, 0.09))
    start, end = edges.start.copy(), edges.end.copy()
    corner = np.array([0.12, 0.07, 0.0])
    cuts = corner - np.diag([0.05, 0.03, -0.04])
    for i in range(len(start)):
        for points, other in ((start, edges.end), (end, edges.start)):
            if np.allclose(points[i], corner):
                axis = int(np.argmax(np.abs(other[i] - corner)))
                points[i] = cuts[axis]
    return FeatureSet.from_edges(np.concatenate([start, cuts]), np.concatenate([end, np.roll(cuts, -1, axis=0)]))


def l_shape() -> FeatureSet:
    """8 faces, 18 edges."""
    return prism(np.array([(0, 0), (60, 0), (60, 20), (25, 20), (25, 50), (0, 50)]) * 1e-3, 0.03)


def wedge() -> FeatureSet:
    """7 faces, 15 edges."""
    return prism(np.array([(0, 0), (90, 0), (90, 25), (40, 60), (0, 60)]) * 1e-3, 0.045)


def chair() -> FeatureSet:
    """An L-shaped seat and back with a channel under the seat: 12 faces, 30 edges."""
    outline = [(0, 0), (15, 0), (15, 25), (45, 25), (45, 0), (60, 0), (60, 40), (14, 40), (14, 95), (0, 95)]
    return prism(np.array(outline) * 1e-3, 0.055)


def computer() -> FeatureSet:
    """A screen with a recess on a base: 32 edges."""
    recess = box((0.08, 0.06, 0.015), (0.03, 0.05, 0.02))
    return FeatureSet.concatenate(
        [box((0.14, 0.03, 0.12)), box((0.11, 0.09, 0.08), (0.015, 0.035, 0.02)), recess.select(np.r_[0:4, 8:12])]
    )


def plug() -> FeatureSet:
    """A body with three thin pins: 54 edges, the shortest 4 mm."""
    body = prism(np.array([(0, 0), (50, 0), (50, 30), (38, 48), (12, 48), (0, 30)]) * 1e-3, 0.022)
    pins = [
        box((0.004, 0.008, -0.023), (0.023, 0.034, 0.0)),
        box((0.0065, 0.004, -0.018), (0.011, 0.012, 0.0)),
        box((0.0065, 0.004, -0.018), (0.0325, 0.012, 0.0)),
    ]
    return FeatureSet.concatenate([body, *pins])


def lattice(nodes: tuple[int, int, int] = (4, 5, 5), edges: int = 224, seed: int = 3) -> FeatureSet:
    """A grid of struts whose nodes are jittered, so that it has no symmetry; span about 0.2 m."""
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in nodes), indexing='ij'), axis=-1)
    points = grid * 0.05 + rng.uniform(-0.012, 0.012, (*nodes, 3))
    start, end = [], []
    for axis in range(3):
        near = np.take(points, np.arange(nodes[axis] - 1), axis=axis).reshape(-1, 3)
        far = np.take(points, np.arange(1, nodes[axis]), axis=axis).reshape(-1, 3)
        start.append(near)
        end.append(far)
    return FeatureSet.from_edges(np.concatenate(start)[:edges], np.concatenate(end)[:edges])


def cylinder_box() -> FeatureSet:
    """A box with a cylinder standing on it: 12 edges, 2 curves, 1 axis."""
    base, top = np.array([0.03, 0.04, -0.025]), np.array([0.03, 0.075, -0.025])
    curves = FeatureSet.from_curves([base, top], [[0, -1, 0], [0, 1, 0]], [0.015, 0.015])
    return FeatureSet.concatenate([box((0.09, 0.04, 0.05)), curves, FeatureSet.from_axes([base], [top])])


def lamp() -> FeatureSet:
    """Two boxes and a tapered shade: 24 edges, 3 curves, 1 axis."""
    centres = np.array([(0, 70, 0), (0, 110, 0), (30, 12, 20)]) * 1e-3
    curves = FeatureSet.from_curves(centres, [(0, -1, 0), (0, 1, 0), (0, 1, 0)], [0.04, 0.02, 0.006])
    boxes = [box((0.1, 0.012, 0.08), (-0.05, 0.0, 0.04)), box((0.014, 0.058, 0.014), (-0.007, 0.012, 0.007))]
    return FeatureSet.concatenate([*boxes, curves, FeatureSet.from_axes([centres[0]], [centres[1]])])


def tubes() -> FeatureSet:
    """Five cylinders, two crossing the others: 10 curves, 5 axes and no edge."""
    bottoms = np.array([(0, 0, 0), (45, 0, 10), (20, 0, 40), (-20, 50, -10), (-15, 75, 25)]) * 1e-3
    tops = np.array([(0, 100, 0), (45, 80, 10), (20, 95, 40), (65, 50, -10), (30, 75, 70)]) * 1e-3
    radii = np.array([10, 9, 12, 6, 7]) * 1e-3
    along = tops - bottoms
    curves = FeatureSet.from_curves(np.concatenate([bottoms, tops]), np.concatenate([-along, along]), np.tile(radii, 2))
    return FeatureSet.concatenate([curves, FeatureSet.from_axes(bottoms, tops)])


def random_polyhedron(seed: int) -> FeatureSet:
    """A random prism or a union of two blocks, 12 to 30 edges: filler for libraries and clutter."""
    rng = np.random.default_rng([seed, 77])
    if rng.random() < 0.6:
        corners = int(rng.integers(4, 9))
        angle = np.sort(rng.uniform(0.0, 2 * np.pi, corners))
        radius = rng.uniform(0.025, 0.07, corners)
        return prism(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]), rng.uniform(0.02, 0.1))
    return FeatureSet.concatenate(
        [box(rng.uniform(0.02, 0.1, 3)), box(rng.uniform(0.02, 0.08, 3), rng.uniform(-0.03, 0.06, 3))]
    )


MODELS = {
    'chipped_block': chipped_block,
    'l_shape': l_shape,
    'wedge': wedge,
    'chair': chair,
    'computer': computer,
    'plug': plug,
    'lattice': lattice,
    'cylinder_box': cylinder_box,
    'lamp': lamp,
    'tubes': tubes,
}


# -- scenes ----------------------------------------------------------------------------------------------------------


def random_pose(rng: np.random.Generator, spread: float = 0.1, depth: float = 0.35) -> Pose:
    """A random rotation, at about the given depth in front of a camera."""
    return Pose(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-spread, spread, 3) + [0.0, 0.0, depth])


def fragment(
    features: FeatureSet,
    rng: np.random.Generator,
    visible: float = 0.75,
    break_chance: float = 0.25,
    sigma: float = 5e-4,
    stated: float | None = None,
    depth_factor: float = 1.0,
) -> tuple[FeatureSet, np.ndarray, np.ndarray]:
    """What is recovered of features already in the camera frame.

    visible : share of the features that appear at all; break_chance : share of the edges that fall into two pieces
    sigma : standard deviation, metres, of every end point coordinate; stated : err_par and err_per written to the
        data (default 3 sigma); depth_factor : how much worse z is

    Returns the features, the index of each one's origin (m,) int32 and its direction sign (m,) int8.
    """
    chosen = np.flatnonzero(rng.random(len(features)) < visible)
    start, end, origin = [], [], []
    for i in chosen:
        a, b = features.start[i], features.end[i]
        if features.kind[i] == FeatureKind.CURVE:
            pieces = [(0.0, 1.0)]
        elif rng.random() < break_chance:
            cut = rng.uniform(0.3, 0.7)
            pieces = [(rng.uniform(0.0, 0.1), cut - 0.05), (cut + 0.05, 1.0 - rng.uniform(0.0, 0.1))]
        else:
            pieces = [(rng.uniform(0.0, 0.1), 1.0 - rng.uniform(0.0, 0.1))]
        for first, last in pieces:
            start.append(a + first * (b - a))
            end.append(a + last * (b - a))
            origin.append(i)
    n = len(origin)
    index = np.array(origin, dtype=np.int32).reshape(n)
    first_points = np.array(start, dtype=float).reshape(n, 3)
    last_points = np.array(end, dtype=float).reshape(n, 3)
    scale = np.array([1.0, 1.0, depth_factor]) * sigma
    curve = features.kind[index] == FeatureKind.CURVE
    normals = (last_points - first_points)[curve]
    first_points += rng.normal(size=(n, 3)) * scale
    last_points += rng.normal(size=(n, 3)) * scale
    tilted = normals + rng.normal(size=normals.shape) * (20.0 * sigma)
    last_points[curve] = first_points[curve] + tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
    flip = (rng.random(n) < 0.5) & ~curve
    first_points[flip], last_points[flip] = last_points[flip].copy(), first_points[flip].copy()
    radii = features.radii[index] * (1.0 + 0.0 * curve[:, None]) + rng.normal(size=(n, 2)) * sigma
    radii = np.maximum(radii, 0.5 * features.radii[index])
    error = np.full(n, 3.0 * sigma * depth_factor if stated is None else stated)
    found = FeatureSet(features.kind[index], first_points, last_points, radii, error, error)
    return found, index, np.where(flip, -1, 1).astype(np.int8)


def make_scene(
    model: FeatureSet,
    seed: int,
    clutter: float = 0.0,
    visible: float = 0.75,
    instances: int = 1,
    sigma: float = 5e-4,
    decoys: tuple[FeatureSet, ...] = (),
    others: tuple[FeatureSet, ...] | None = None,
    stated: float | None = None,
    depth_factor: float = 1.0,
    volume: float = 0.15,
) -> SyntheticScene:
    """A seeded scene.

    clutter : share of all data features that belong to no instance, in [0, 1); with instances = 0 there are as many
        clutter features as one instance with this share would have
    decoys : objects placed before other clutter; others : what clutter consists of (default: random polyhedra)
    volume : metres, half side of the cube in which clutter is placed
    """
    rng = np.random.default_rng([seed, 2024])
    pieces, origin, sign, member, poses = [], [], [], [], []
    n_true = 0
    for instance in range(max(instances, 1)):
        pose = random_pose(rng, 0.02 if instances == 1 else 0.08)
        found, index, signs = fragment(
            model.transformed(pose), rng, visible, sigma=sigma, stated=stated, depth_factor=depth_factor
        )
        n_true += len(found)
        if instance < instances:
            pieces.append(found)
            origin.append(index)
            sign.append(signs)
            member.append(np.full(len(found), instance))
            poses.append(pose)
    wanted = int(round(n_true * clutter / (1.0 - clutter))) if clutter > 0.0 else 0
    n_clutter = 0
    while n_clutter < wanted:
        if n_clutter == 0 and decoys:
            others_now: list[FeatureSet] = list(decoys)
        elif others is None:
            others_now = [random_polyhedron(int(rng.integers(1 << 30)))]
        else:
            others_now = [others[int(rng.integers(len(others)))]]
        for other in others_now:
            pose = random_pose(rng, volume)
            found, _, _ = fragment(
                other.transformed(pose), rng, 0.75, sigma=sigma, stated=stated, depth_factor=depth_factor
            )
            if not decoys or other not in decoys:
                found = found.select(np.arange(min(len(found), wanted - n_clutter)))
            n_clutter += len(found)
            pieces.append(found)
            origin.append(np.full(len(found), BIN))
            sign.append(np.zeros(len(found)))
            member.append(np.full(len(found), -1))
    data = FeatureSet.concatenate(pieces)
    order = rng.permutation(len(data))
    stack = [np.concatenate(part)[order] if part else np.zeros(0) for part in (origin, sign, member)]
    return SyntheticScene(
        data.select(order), stack[0].astype(np.int32), stack[1].astype(np.int8), stack[2].astype(np.int32), tuple(poses)
    )


def measured(
    model: FeatureSet,
    pose: Pose,
    rng: np.random.Generator,
    across: float = 1e-4,
    along: float = 6e-4,
    visible: float = 0.8,
) -> FeatureSet:
    """What a camera pair in the origin recovers of a model, off by noise whose covariance the features state.

    Every feature is better or worse known than the next, along its line of sight worse than across it, and its two ends
    are off together.

    Parameters
    ----------
    model : FeatureSet
        Model frame.
    pose : Pose
        camera_T_model.
    rng : numpy.random.Generator
    across, along : float
        Metres, sigma of an end across and along its line of sight, give or take a factor of e.
    visible : float
        Share of the features that appear.

    Returns
    -------
    FeatureSet
        Camera frame; edges lack up to a seventh at either end, and run in either direction.
    """
    seen = model.transformed(pose)
    seen = seen.select(np.flatnonzero(rng.random(len(seen)) < visible))
    n, curve = len(seen), seen.kind == FeatureKind.CURVE
    low, high = rng.uniform(0.0, 0.15, n) * ~curve, np.where(curve, 1.0, rng.uniform(0.85, 1.0, n))
    ends = [seen.start + share[:, None] * seen.vectors for share in (low, high)]
    # Factors of the covariance: what both ends have in common and what each has alone; a curve's normal tilts.
    factor = np.zeros((n, 6, 6))
    for block, points in enumerate(ends):
        sight = points / np.linalg.norm(points, axis=1, keepdims=True)
        spread = across * np.eye(3) + (along - across) * sight[:, :, None] * sight[:, None, :]
        here = slice(3 * block, 3 * block + 3)
        factor[:, here, here] = np.sqrt(0.75) * spread if block else spread
        if block:
            factor[:, here, :3] = 0.5 * spread
    normal = seen.directions[curve]
    flat = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    factor[curve, 3:, 3:] = 5e-3 * flat
    factor[curve, 3:, :3] = flat @ rng.normal(0.0, 2e-3, (len(normal), 3, 3))
    factor *= np.exp(rng.uniform(-1.0, 1.0, n))[:, None, None]
    off = np.einsum('nij,nj->ni', factor, rng.normal(size=(n, 6)))
    start, end = ends[0] + off[:, :3], ends[1] + off[:, 3:]
    tilted = normal + off[curve, 3:]
    end[curve] = start[curve] + tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
    covariance = factor @ factor.swapaxes(1, 2)
    turn = (rng.random(n) < 0.5) & ~curve
    start[turn], end[turn] = end[turn].copy(), start[turn].copy()
    swapped = [3, 4, 5, 0, 1, 2]
    covariance[turn] = covariance[turn][:, swapped][:, :, swapped]
    nothing = np.zeros(n)
    return FeatureSet(seen.kind, start, end, seen.radii, nothing, nothing, covariance=covariance)


def mirrored(model: FeatureSet) -> FeatureSet:
    """The mirror image in x: a decoy when the model is chiral."""
    flip = np.array([-1.0, 1.0, 1.0])
    return FeatureSet(model.kind, model.start * flip, model.end * flip, model.radii, model.err_par, model.err_per)


def scaled(model: FeatureSet, factor: float) -> FeatureSet:
    """A copy of another size: a decoy."""
    return model.transformed(Pose(np.eye(3), np.zeros(3), factor))
