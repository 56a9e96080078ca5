"""Exactness: closed forms of every primitive, random trees against point membership, one answer from every engine."""

import numpy as np
import pytest

from csg_renderer import Light, Scene, Solid, Surface, default_camera, render
from csg_renderer.raycast.programs.products import products_of
from csg_renderer.raycast.programs.program import postfix
from csg_renderer.scene.solid import FACES, Operation, Primitive
from msgs_py import PinholeCamera, Pose

CAMERA = PinholeCamera.centred(72, 60, 110.0)
ENGINES = ['native', 'reference']


def rotation(rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def moved(solid, x, y, z):
    return solid.transformed(Pose(np.eye(3), [x, y, z]))


def random_leaf(rng, lattice):
    """A primitive anywhere; on a lattice of 2 cm, where faces coincide with others' most of the time."""
    kind = str(rng.choice(['BLOCK', 'CYLINDER', 'CONE', 'SPHERE', 'PLANE'], p=[0.45, 0.2, 0.12, 0.18, 0.05]))
    matrix = np.eye(4)
    if lattice:
        matrix[:3, :3] = np.diag(0.02 * rng.integers(1, 4, 3))[:, rng.permutation(3)]
        matrix[:3, 3] = 0.02 * rng.integers(-2, 3, 3)
    else:
        shear = np.eye(3) + (0.3 * rng.normal(size=(3, 3)) if rng.random() < 0.3 else 0.0)
        matrix[:3, :3] = rotation(rng) @ np.diag(rng.uniform(0.02, 0.08, 3) * rng.choice([1, -1], 3)) @ shear
        matrix[:3, 3] = 0.03 * rng.normal(size=3)
    return Solid.primitive(kind, matrix)


def random_tree(rng, leaves, lattice):
    if leaves == 1:
        return random_leaf(rng, lattice)
    split = int(rng.integers(1, leaves))
    left, right = random_tree(rng, split, lattice), random_tree(rng, leaves - split, lattice)
    return (left | right, left - right, left & right)[rng.choice(3, p=[0.4, 0.4, 0.2])]


def random_scene(seed):
    rng = np.random.default_rng(seed)
    lattice = seed % 2 == 0
    tree = random_tree(rng, int(rng.integers(1, 12)), lattice)
    turned = Pose(np.eye(3) if rng.random() < 0.3 else rotation(rng), [0, 0, 0.3 if rng.random() < 0.8 else 0.08])
    if rng.random() < 0.3:
        tree = tree.painted(Surface(transparency=0.5, reflection=0.3, specular=0.5, shininess=7.5))
    return Scene(
        [tree, random_leaf(rng, lattice)],
        [Light((0.3, -0.3, 0)), Light((-0.2, 0, -0.1), (0.5, 0.4, 0.3))],
        background=(0.1, 0.2, 0.3),
    ), turned


def contains(solid, points):
    """(n,) bool by evaluating the set operators point by point, and (n,) bool: near a surface."""
    if isinstance(solid, Operation):
        left, near_left = contains(solid.left, points)
        right, near_right = contains(solid.right, points)
        inside = {'UNION': left | right, 'INTERSECT': left & right, 'DIFFERENCE': left & ~right}[solid.operator]
        return inside, near_left | near_right
    if not isinstance(solid, Primitive):
        return np.zeros(len(points), bool), np.zeros(len(points), bool)
    inverse = np.linalg.inv(solid.matrix)
    x, y, z = (points @ inverse[:3, :3].T + inverse[:3, 3]).T
    rho = np.hypot(x, y)
    values = {
        'BLOCK': [-x, x - 1, -y, y - 1, -z, z - 1],
        'CYLINDER': [rho - 1, -z, z - 1],
        'CONE': [rho - z, z - 1, -z],
        'SPHERE': [np.hypot(rho, z) - 1],
        'PLANE': [z],
    }[solid.kind]
    value = np.max(values, axis=0)
    return value < 0.0, np.abs(value) < 1e-3


# -- closed forms ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize('engine', ENGINES)
def test_sphere(engine):
    frame = render(Scene(moved(Solid.sphere(0.1), 0.02, -0.01, 0.5)), CAMERA, engine=engine)
    rays = CAMERA.rays(CAMERA.pixel_grid())
    centre = np.array([0.02, -0.01, 0.5])
    a, b, c = (rays**2).sum(-1), -(rays @ centre), centre @ centre - 0.01
    square = b * b - a * c
    assert np.array_equal(frame.mask, square > 0.0)
    depth = (-b - np.sqrt(np.maximum(square, 0.0))) / a
    assert np.abs(frame.depth - depth)[frame.mask].max() < 1e-6
    normal = (rays * depth[..., None] - centre) / 0.1
    assert np.abs(frame.normal - normal)[frame.mask].max() < 1e-5


@pytest.mark.parametrize('engine', ENGINES)
def test_cylinder_seen_along_and_across_its_axis(engine):
    along = render(Scene(moved(Solid.cylinder(0.1, (0, 0, 0.2)), 0, 0, 0.5)), CAMERA, engine=engine)
    rays = CAMERA.rays(CAMERA.pixel_grid())
    cap = np.hypot(rays[..., 0], rays[..., 1]) * 0.5 < 0.1
    assert np.array_equal(along.mask, cap)
    assert (along.face_id[cap] == 0).all() and np.abs(along.depth[cap] - 0.5).max() < 1e-7
    across = render(Scene(moved(Solid.cylinder(0.1, (0, 0.3, 0)), 0, -0.15, 0.5)), CAMERA, engine=engine)
    middle = across.mask & (np.abs(CAMERA.pixel_grid()[..., 1] - CAMERA.cy) < 20)
    assert (across.face_id[middle] == 2).all()
    x = rays[..., 0]
    square = 0.25 - (1 + x * x) * (0.25 - 0.01)
    expected = (0.5 - np.sqrt(np.maximum(square, 0.0))) / (1 + x * x)
    assert np.abs(across.depth - expected)[middle].max() < 1e-6


@pytest.mark.parametrize('engine', ENGINES)
def test_cone_from_apex_and_from_base(engine):
    cone = Solid.cone(0.1, (0, 0, 0.2))
    rays = CAMERA.rays(CAMERA.pixel_grid())
    rho = np.hypot(rays[..., 0], rays[..., 1])
    apex = render(Scene(moved(cone, 0, 0, 0.5)), CAMERA, engine=engine)
    # rho t = (t - 0.5) / 2 on the mantle.
    depth = 0.5 / (1.0 - 2.0 * rho)
    mantle = depth < 0.7
    assert np.array_equal(apex.mask, mantle) and (apex.face_id[mantle] == 1).all()
    assert np.abs(apex.depth - depth)[mantle].max() < 1e-6
    base = render(Scene(moved(Solid.cone(0.1, (0, 0, -0.2)), 0, 0, 0.7)), CAMERA, engine=engine)
    disc = rho * 0.5 < 0.1
    assert np.array_equal(base.mask, disc) and (base.face_id[disc] == 0).all()
    assert np.abs(base.depth[disc] - 0.5).max() < 1e-7


@pytest.mark.parametrize('engine', ENGINES)
def test_half_space_ends_at_the_horizon(engine):
    floor = Solid.plane((0, -1, 0), -0.2)  # y >= 0.2, below the camera
    frame = render(Scene(floor), CAMERA, engine=engine)
    y = CAMERA.rays(CAMERA.pixel_grid())[..., 1]
    assert np.array_equal(frame.mask, y > 0)
    assert np.allclose(frame.depth[frame.mask], 0.2 / y[frame.mask], rtol=1e-6)
    assert np.allclose(frame.normal[frame.mask], [0, -1, 0])


@pytest.mark.parametrize('engine', ENGINES)
def test_shear_and_mirror_move_faces_and_keep_normals_outward(engine):
    matrix = np.array([[-0.1, 0.04, 0, 0.03], [0, 0.1, 0.02, -0.05], [0.01, 0, 0.1, 0.4], [0, 0, 0, 1]])
    frame = render(Scene(Solid.primitive('BLOCK', matrix)), CAMERA, engine=engine)
    points = frame.points[frame.mask]
    local = (points - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T
    axis, high = frame.face_id[frame.mask] // 2, frame.face_id[frame.mask] % 2
    assert np.abs(local[np.arange(len(local)), axis] - high).max() < 1e-5
    outward = frame.normal[frame.mask].astype(float)
    step = (points + 1e-4 * outward - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T
    assert ((step < 0) | (step > 1)).any(axis=1).all()
    assert (np.einsum('ni,ni->n', outward, points) < 0).all()


# -- coincident and tangent faces: the stated rule -------------------------------------------------------------------


@pytest.mark.parametrize('engine', ENGINES)
def test_a_face_removed_exactly_leaves_no_skin(engine):
    block = moved(Solid.block(0.2, 0.2, 0.2), -0.1, -0.1, 0.4)
    assert not render(Scene(block - block), CAMERA, engine=engine).mask.any()
    front = moved(Solid.block(0.2, 0.2, 0.05), -0.1, -0.1, 0.4)
    turn = Pose.from_rotation_vector([0.3, 0.2, 0.1], [0.01, 0.02, 0.1])
    frame = render(Scene((block - front).transformed(turn)), CAMERA, engine=engine)
    whole = render(Scene(moved(Solid.block(0.2, 0.2, 0.15), -0.1, -0.1, 0.45).transformed(turn)), CAMERA, engine=engine)
    assert (frame.mask != whole.mask).sum() == 0
    assert np.abs(frame.depth - whole.depth)[frame.mask].max() < 1e-6


@pytest.mark.parametrize('engine', ENGINES)
def test_coincident_faces_belong_to_the_lowest_leaf_and_touching_blocks_have_no_seam(engine):
    left, right = (moved(Solid.block(0.1, 0.2, 0.1), x, -0.1, 0.4) for x in (-0.1, 0.0))
    overlap = moved(Solid.block(0.1, 0.2, 0.1), -0.05, -0.1, 0.4)
    frame = render(Scene(right | overlap | left), CAMERA, engine=engine)
    u = CAMERA.pixel_grid()[..., 0] - CAMERA.cx
    front = frame.mask & (np.abs(frame.depth - 0.4) < 1e-6)
    assert front.sum() > 1000 and (frame.primitive_id[front & (u > 0)] == 0).all()
    assert (frame.primitive_id[front & (u < -15)] == 2).all()
    # From inside the seam nothing shows: one layer is all a ray meets.
    glass = Surface(transparency=0.5, ambient=1.0)
    clear = render(Scene((left | right).painted(glass), ambient_light=(1, 1, 1)), CAMERA, levels=5, engine=engine)
    assert len(np.unique(clear.image[front])) == 1


@pytest.mark.parametrize('engine', ENGINES)
def test_rays_in_a_face_plane_are_never_nan(engine):
    camera = PinholeCamera.centred(65, 65, 100.0)  # odd: the middle column lies in the plane x = 0
    for x in (0.0, -0.1):
        frame = render(
            Scene(moved(Solid.block(0.1, 0.1, 0.1), x, -0.05, 0.3), [Light((0, 0, 0))]), camera, engine=engine
        )
        assert np.isfinite(frame.depth[frame.mask]).all() and np.isfinite(frame.normal[frame.mask]).all()
    both = moved(Solid.block(0.1, 0.1, 0.1), 0, -0.05, 0.3) | moved(Solid.block(0.1, 0.1, 0.1), -0.1, -0.05, 0.3)
    assert render(Scene(both), camera, engine=engine).mask[32, 10:55].all()
    cylinder = moved(Solid.cylinder(0.1, (0, 0, 0.1)), 0.0, -0.1, 0.3)  # the axis ray of the camera is on its mantle
    assert np.isfinite(render(Scene(cylinder), camera, engine=engine).depth).sum() > 0


@pytest.mark.parametrize('engine', ENGINES)
def test_from_inside_a_solid_its_far_wall_is_seen(engine):
    frame = render(Scene(moved(Solid.block(1, 1, 1), -0.5, -0.5, -0.5), [Light((0, 0, 0))]), CAMERA, engine=engine)
    assert frame.mask.all() and frame.depth[30, 36] == pytest.approx(0.5)
    assert np.allclose(frame.normal[30, 36], [0, 0, 1])
    assert frame.image.max() > 0
    room = moved(Solid.block(1, 1, 1), -0.5, -0.5, -0.5) - moved(Solid.block(0.8, 0.8, 0.8), -0.4, -0.4, -0.4)
    inner = render(Scene(room), CAMERA, engine=engine)
    assert inner.depth[30, 36] == pytest.approx(0.4) and (inner.primitive_id == 1).all()
    assert np.allclose(inner.normal[30, 36], [0, 0, -1])


# -- random trees ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize('seed', range(101, 125, 2))
def test_random_trees_agree_with_point_membership(seed):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, int(rng.integers(2, 9)), False)
    pose = Pose(rotation(rng), [0, 0, 0.5])
    camera_T = pose.inverse()
    frame = render(Scene(tree), CAMERA, pose)
    pixels = rng.integers(0, [CAMERA.width, CAMERA.height], size=(250, 2))
    rays = CAMERA.rays(pixels)
    if contains(tree, camera_T.apply(np.zeros((1, 3))))[0][0]:
        pytest.skip('the camera is inside')
    t = np.linspace(0.0, 1.5, 1500)[1:]
    points = camera_T.apply(rays[:, None, :] * t[None, :, None])
    inside, near = (array.reshape(len(rays), -1) for array in contains(tree, points.reshape(-1, 3)))
    depth = frame.depth[pixels[:, 1], pixels[:, 0]].astype(float)
    before = t[None, :] < np.where(np.isnan(depth), np.inf, depth)[:, None]
    assert not (inside & ~near & before).any()  # nothing solid in front of what is seen
    hit = ~np.isnan(depth)
    just_inside = camera_T.apply(rays[hit] * (depth[hit] + 1e-4)[:, None])
    inside, near = contains(tree, just_inside)
    assert (inside | near).all()  # and what is seen is solid


@pytest.mark.parametrize('seed', range(24))
def test_engines_and_tilings_agree(seed):
    scene, pose = random_scene(seed)
    options = {'levels': 3, 'shadows': True} if seed % 3 == 0 else {}
    tiled, small, whole, reference = (
        render(scene, CAMERA, pose, **kind, **options)
        for kind in (
            {},
            {'tile_size': 8, 'threads': 1},
            {'tiling': False},
            {'engine': 'reference', 'tiling': seed % 4 < 2},
        )
    )
    for other in (small, whole):
        assert np.array_equal(tiled.image, other.image)
        assert np.array_equal(tiled.depth, other.depth, equal_nan=True)
        assert np.array_equal(tiled.normal, other.normal, equal_nan=True)
    for other in (small, whole, reference):
        for name in ('primitive_id', 'face_id', 'object_id'):
            assert np.array_equal(getattr(tiled, name), getattr(other, name)), name
    assert np.allclose(tiled.depth, reference.depth, atol=1e-6, equal_nan=True)
    assert np.allclose(tiled.normal, reference.normal, atol=1e-5, equal_nan=True)
    assert np.abs(tiled.image.astype(int) - reference.image).max() <= 1
    assert whole.stats.intersections >= tiled.stats.intersections or options


def test_a_tree_with_too_many_products_is_evaluated_by_lists():
    rng = np.random.default_rng(3)
    tree = random_leaf(rng, False)
    for _ in range(5):
        tree = tree & (random_leaf(rng, False) | random_leaf(rng, False) | random_leaf(rng, False))
    tree = Solid.block(0.2, 0.2, 0.2).transformed(Pose(np.eye(3), [-0.1, -0.1, -0.1])) - tree
    big = Solid.empty()
    for k in range(40):
        big = big | moved(Solid.sphere(0.02), 0.03 * (k % 7 - 3), 0.03 * (k // 7 - 3), 0)
    tree = (tree & big) - (moved(Solid.sphere(0.05), 0.01, 0, 0) & moved(Solid.block(1, 1, 1), 0, 0, -0.5))
    assert products_of(postfix(tree, 0)) is None
    pose = Pose(rotation(rng), [0, 0, 0.4])
    native, reference = (render(Scene(tree, [Light((0, 0, 0))]), CAMERA, pose, engine=engine) for engine in ENGINES)
    assert native.mask.sum() > 100
    assert np.array_equal(native.primitive_id, reference.primitive_id)
    assert np.array_equal(native.image, reference.image)


def test_a_plate_with_a_thousand_holes_is_one_product_and_quick():
    holes = Solid.empty()
    for k in range(1024):
        x, y = 0.01 * (k % 32) - 0.155, 0.01 * (k // 32) - 0.155
        holes = holes | moved(Solid.cylinder(0.004, (0, 0, 0.1)), x, y, -0.05)
    plate = moved(Solid.block(0.32, 0.32, 0.01), -0.16, -0.16, 0) - holes
    products = products_of(postfix(plate, 0))
    assert products is not None and [(len(inside), len(outside)) for inside, outside in products] == [(1, 1024)]
    scene = Scene(plate, [Light((0, 0, 0))])
    frame = render(scene, CAMERA, Pose(np.eye(3), [0, 0, 0.5]))
    assert np.isnan(frame.depth).sum() > 0.3 * frame.depth.size
    # A pixel is tested against the holes of its part of its row: some tens of 3072 surfaces.
    assert frame.stats.intersections < 150 * frame.depth.size


def test_tiling_saves_most_of_the_work_and_changes_nothing():
    beams = [moved(Solid.block(0.3, 0.004, 0.004), -0.15, 0.02 * k - 0.15, 0.5 + 0.01 * k) for k in range(16)]
    solid = beams[0]
    for beam in beams[1:]:
        solid = solid | beam
    scene = Scene(solid, [Light((0, 0, 0))])
    tiled, whole = (render(scene, default_camera(256), tiling=tiling) for tiling in (True, False))
    assert np.array_equal(tiled.image, whole.image)
    assert whole.stats.intersections == 256 * 256 * 16 * 6
    assert tiled.stats.intersections < 0.05 * whole.stats.intersections
    assert tiled.stats.nodes < 0.1 * whole.stats.nodes and tiled.stats.combines < 0.2 * whole.stats.combines
    assert whole.stats.tiles == 1 and 1 < tiled.stats.tiles <= 64


def test_memory_of_a_frame_is_not_reused_while_any_of_its_arrays_is_held():
    frame = render(Scene(moved(Solid.sphere(0.1), 0, 0, 0.4)), CAMERA)
    held = frame.depth[10:20]
    before = held.copy()
    del frame
    for _ in range(10):
        render(Scene([]), CAMERA)
    assert np.array_equal(held, before, equal_nan=True)


def test_every_kind_has_its_faces():
    assert {kind: len(faces) for kind, faces in FACES.items()} == {
        'BLOCK': 6,
        'CYLINDER': 3,
        'CONE': 2,
        'SPHERE': 1,
        'PLANE': 1,
        'TERRAIN': 1,
    }
