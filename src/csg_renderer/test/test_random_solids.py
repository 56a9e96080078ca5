"""Random solids: what the boundary says and what a rendering shows must be the same, both ways."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from csg_renderer import Scene, Solid, boundary, model_features, render, visible_fragments
from msgs_py import FeatureKind, PinholeCamera, Pose

SIZE = 400
CAMERA = PinholeCamera.centred(SIZE, SIZE, 1.2 * SIZE)
KINDS = ('BLOCK', 'CYLINDER', 'CONE', 'SPHERE')
MIDDLE = {'BLOCK': [0.5, 0.5, 0.5], 'CYLINDER': [0, 0, 0.5], 'CONE': [0, 0, 0.5], 'SPHERE': [0, 0, 0]}


def random_solid(rng: np.random.Generator, kinds: tuple[str, ...], count: int) -> Solid:
    """Up to count leaves about the origin, some sheared, some along the axes."""
    solid = random_leaf(rng, kinds)
    for _ in range(int(rng.integers(1, count))):
        other, choice = random_leaf(rng, kinds), rng.random()
        solid = solid | other if choice < 0.5 else solid - other if choice < 0.8 else solid & other
    return solid


def random_leaf(rng: np.random.Generator, kinds: tuple[str, ...]) -> Solid:
    kind = str(rng.choice(kinds))
    matrix = np.eye(4)
    if rng.random() < 0.6:
        matrix[:3, :3] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    matrix[:3, :3] = matrix[:3, :3] * rng.uniform(0.4, 1.0, 3)
    if rng.random() < 0.3:
        matrix[:3, :3] += 0.1 * rng.normal(size=(3, 3))
    matrix[:3, 3] = rng.uniform(-0.5, 0.5, 3) - matrix[:3, :3] @ MIDDLE[kind]
    return Solid.primitive(kind, matrix)


def image_creases(frame, camera: PinholeCamera, fine: bool) -> np.ndarray:
    """(n, 2) pixels between neighbours that show different surfaces; fine: also those that hardly differ."""
    depth, normal = frame.depth.astype(float), frame.camera_normal.astype(float)
    point = camera.rays(camera.pixel_grid()) * depth[..., None]
    found = []
    for dy, dx in ((0, 1), (1, 0)):
        a = (slice(0, camera.height - dy), slice(0, camera.width - dx))
        b = (slice(dy, camera.height), slice(dx, camera.width))
        empty_a, empty_b = np.isnan(depth[a]), np.isnan(depth[b])
        with np.errstate(invalid='ignore'):
            turn = np.arccos(np.clip((normal[a] * normal[b]).sum(-1), -1.0, 1.0))
            gap = point[b] - point[a]
            step = np.minimum(np.abs((gap * normal[a]).sum(-1)), np.abs((gap * normal[b]).sum(-1)))
            other = (frame.primitive_id[a] != frame.primitive_id[b]) | (frame.face_id[a] != frame.face_id[b])
            differ = (other | (turn > 0.01) | (step > 1e-3)) if fine else ((other & (turn > 0.2)) | (step > 0.05))
        found.append(np.argwhere((empty_a != empty_b) | (~empty_a & ~empty_b & differ))[:, ::-1] + [dx / 2, dy / 2])
    return np.concatenate(found)


def drawn(seen, camera: PinholeCamera) -> np.ndarray:
    """(n, 2) pixels along everything that is said to be visible, about four a pixel."""
    lines = [
        features.polyline(k, 400)
        for features in (seen.features, seen.contours)
        for k in range(len(features))
        if features.kind[k] != FeatureKind.AXIS
    ]
    out = [np.zeros((0, 2))]
    for line in [*lines, *seen.others]:
        pixels = camera.project(line)
        for start, end in zip(pixels[:-1], pixels[1:]):
            count = int(4 * np.linalg.norm(end - start)) + 2
            out.append(start + np.linspace(0, 1, count)[:, None] * (end - start))
    return np.concatenate(out)


def far_from(points: np.ndarray, others: np.ndarray, distance: float) -> np.ndarray:
    """The points (n, 2) that have none of the others within a distance."""
    if not len(points) or not len(others):
        return points
    return points[cKDTree(others).query(points)[0] > distance]


@pytest.mark.parametrize(
    'kinds',
    [('BLOCK',), ('CYLINDER',), ('BLOCK', 'CYLINDER'), ('SPHERE',), KINDS],
    ids=lambda kinds: '+'.join(kinds).lower(),
)
def test_every_visible_crease_is_in_the_image_and_the_other_way_round(kinds):
    seen_creases = 0
    for seed in range(8):
        rng = np.random.default_rng([seed, len(kinds), KINDS.index(kinds[0])])
        solid = random_solid(rng, kinds, 5)
        place = Pose(Rotation.from_rotvec(2 * rng.normal(size=3)).as_matrix(), [0.0, 0.0, 4.0])
        seen = visible_fragments(solid, place, CAMERA)
        frame = render(Scene([solid]), CAMERA, place)
        lines = drawn(seen, CAMERA)
        # A pixel pair stands for a crease anywhere between its centres: half a pixel more than one, and the diagonal.
        coarse = image_creases(frame, CAMERA, fine=False)
        seen_creases += len(coarse)
        missing = far_from(coarse, lines, 1.5)
        assert len(missing) <= 2, f'seed {seed}: {len(missing)} crease pixels without a feature, at {missing[:3]}'
        inside = lines[((lines > 2) & (lines < SIZE - 3)).all(axis=1)]
        for pixel in far_from(inside, image_creases(frame, CAMERA, fine=True), 1.5)[::20]:
            # Too small for this image: look again through a long lens.
            close = PinholeCamera(
                61,
                61,
                40 * CAMERA.fx,
                40 * CAMERA.fy,
                30 - 40 * (pixel[0] - CAMERA.cx),
                30 - 40 * (pixel[1] - CAMERA.cy),
            )
            creases = image_creases(render(Scene([solid]), close, place), close, fine=True)
            assert not len(far_from(np.array([[30.0, 30.0]]), creases, 3.0)), f'seed {seed}: no crease at {pixel}'
    assert seen_creases > 200


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10_000))
@example(115)  # a plane cuts its cone in a hyperbola that comes from far away
@example(1071)
def test_counts_do_not_depend_on_where_a_solid_stands(seed):
    rng = np.random.default_rng(seed)
    solid = random_solid(rng, KINDS, 4)
    moved = solid.transformed(Pose(Rotation.from_rotvec(rng.normal(size=3)).as_matrix(), rng.normal(size=3) * 3, 0.01))
    one, two = model_features(solid), model_features(moved)
    assert [(one.kind == k).sum() for k in FeatureKind] == [(two.kind == k).sum() for k in FeatureKind]
    # Volumes of curved solids are quadratures, and where a border is cut into ranges depends on where it stands.
    np.testing.assert_allclose(
        boundary(moved).details.volume, 1e-6 * boundary(solid).details.volume, rtol=1e-5, atol=1e-15
    )


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_edges_of_voxel_solids(seed):
    """Against a count on the grid: a grid edge is a crease unless its four cells say flat, full or empty."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((5, 5, 5), bool)
    cells[1:4, 1:4, 1:4] = rng.random((3, 3, 3)) < 0.5
    solid = Solid.empty()
    for x, y, z in np.argwhere(cells):
        solid = solid | Solid.block(1, 1, 1).transformed(Pose(np.eye(3), [x, y, z]))
    wanted = 0
    for axis in range(3):
        grid = np.moveaxis(cells, axis, 2)
        for u in range(1, 5):
            for v in range(1, 5):
                around = grid[u - 1 : u + 1, v - 1 : v + 1].reshape(4, 5)
                flat = (around[0] == around[1]) & (around[2] == around[3]) | (
                    (around[0] == around[2]) & (around[1] == around[3])
                )
                # A run goes on while the same faces meet: the same cells are full.
                run = np.where(flat, 0, around.T @ [1, 2, 4, 8])
                wanted += int(((run[1:] != 0) & (run[1:] != run[:-1])).sum())
    found = model_features(solid)
    assert len(found) == wanted
    np.testing.assert_allclose(found.start, np.round(found.start), atol=1e-9)


def test_slivers_and_tangencies_have_definite_counts():
    plate = Solid.block(1, 1, 1e-4)
    assert len(model_features(plate)) == 12
    groove = Solid.block(1, 1, 1) - Solid.block(1e-4, 3, 1e-4).transformed(Pose(np.eye(3), [0.5, -1, 1 - 1e-4]))
    assert len(model_features(groove)) == 24
    # A cylinder that lies on a plate touches it along a line; one that just misses does not; one that is sunk in a
    # little meets it in two lines, and so do its ends.
    plate = Solid.block(4, 4, -1)
    for height, edges in ((1.0, 13), (1.0 + 1e-4, 12), (1.0 - 1e-4, 16)):
        log = Solid.cylinder(1.0, (2, 0, 0)).transformed(Pose(np.eye(3), [1, 2, height]))
        assert (model_features(plate | log).kind == FeatureKind.EDGE).sum() == edges, height
