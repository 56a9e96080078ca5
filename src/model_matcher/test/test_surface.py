"""Patches of a printed surface: found where it is, elsewhere when it is taken to be nearer, of no use without print."""

import numpy as np
import pytest
from scipy.stats import betabinom

from csg_renderer import Solid, SolidOutline
from model_matcher.image_pose.settings import OTHERS_FACES, PATCHES, SURFACE_OF_OTHERS, SURFACE_OF_OWN
from model_matcher.image_pose.sight import look
from model_matcher.image_pose.surface import Agreement, agreement, log_ratio
from model_matcher.image_pose.views import Views
from msgs_py import PinholeCamera, Pose

CAMERA = PinholeCamera.centred(320, 240, 400.0)
APART = Pose(np.eye(3), [0.06, 0.0, 0.0])
# Above the first, and turned towards what is before it.
ABOVE = Pose.from_rotation_vector([-0.15, 0.0, 0.0], [0.0, -0.07, 0.0])
BLOCK = Pose.from_rotation_vector([0.5, -0.6, 0.2], [-0.05, -0.03, 0.5])
POST = Pose.from_rotation_vector([1.4, 0.2, 0.0], [0.0, 0.05, 0.5])
SHAPES = {
    'block': (SolidOutline(Solid.block(0.10, 0.07, 0.06)), BLOCK),
    'post': (SolidOutline(Solid.cylinder(0.04, (0.0, 0.0, 0.1))), POST),
}


def printed(shape: SolidOutline, pose: Pose, stands: tuple[Pose, ...], contrast: float) -> Views:
    """What cameras see of a shape: waves in space of a few millimetres on it, and others on a wall behind."""
    rng = np.random.default_rng(3)
    waves, phase = rng.normal(scale=400.0, size=(12, 3)), rng.uniform(0.0, 6.28, 12)
    images = []
    pixels = np.stack(np.meshgrid(np.arange(320.0), np.arange(240.0)), -1).reshape(-1, 2)
    for stand in stands:
        place = shape.surface(stand.inverse().compose(pose), CAMERA, pixels)
        rays = stand.rotate(CAMERA.rays(pixels))
        wall = stand.translation + rays * ((1.2 - stand.translation[2]) / rays[:, 2:])
        point = np.where(np.isfinite(place), place, 0.3 * wall)
        grey = 128.0 + contrast * np.cos(point @ waves.T + phase).sum(axis=1) / np.sqrt(12.0)
        grey += rng.normal(size=len(grey))
        images.append(np.clip(np.rint(grey), 0, 255).astype(np.uint8).reshape(240, 320))
    return Views(images, [CAMERA] * len(stands), stands)


def seen(name: str, moved: float = 0.0, contrast: float = 40.0, stands=(APART,)) -> tuple[Agreement, ...]:
    shape, pose = SHAPES[name]
    views = printed(shape, pose, (Pose.identity(), *stands), contrast)
    taken = Pose(pose.rotation, pose.translation + [0.0, 0.0, moved])
    return agreement(shape, taken, look(shape, taken, views), views)


@pytest.mark.parametrize('stands', [(APART,), (ABOVE,), (APART, ABOVE)], ids=['beside', 'above', 'both'])
@pytest.mark.parametrize('name', SHAPES)
def test_print_lies_where_the_surface_is(name, stands):
    found = seen(name, stands=stands)
    agree, looked = np.sum(found, axis=0)
    assert len(found) == {'block': 3, 'post': 1}[name]
    assert looked >= 10 * len(stands)
    assert agree >= 0.97 * looked
    assert log_ratio(found) > 1.0


@pytest.mark.parametrize('moved', [-0.05, -0.03, 0.03, 0.05])
@pytest.mark.parametrize('name', SHAPES)
def test_print_lies_elsewhere_when_the_surface_is_taken_to_be_nearer_or_farther(name, moved):
    found = seen(name, moved)
    agree, looked = np.sum(found, axis=0)
    assert looked >= 10
    assert agree <= 0.3 * looked
    assert log_ratio(found) < 0.0


def test_a_plain_surface_says_nothing():
    assert seen('block', contrast=0.0) == ()
    assert log_ratio(()) == 0.0


def test_one_view_says_nothing():
    assert seen('block', stands=()) == ()


@pytest.mark.parametrize('place', [[0.0, 0.0, 0.03], [0.17, 0.0, 0.5], [0.0, 0.0, -0.5], [5.0, 0.0, 0.5]])
def test_what_is_too_near_or_not_in_view_is_left_out(place):
    shape, pose = SHAPES['block']
    views = printed(shape, pose, (Pose.identity(), APART), 40.0)
    taken = Pose(pose.rotation, place)
    found = agreement(shape, taken, look(shape, taken, views), views)
    assert all(0 <= face.agree <= face.looked for face in found)
    assert sum(face.looked for face in found) <= PATCHES


def test_a_face_that_lies_on_another_objects_says_little_when_the_others_do_not():
    on, off = Agreement(20, 20), Agreement(0, 20)
    assert log_ratio([on, off]) < log_ratio([on]) < log_ratio([on, on])


@pytest.mark.parametrize('looked', [1, 10, 100])
def test_the_ratio_is_one_of_chances(looked):
    """Weighed with the chances of the other hypothesis it has the mean one."""
    counts = np.arange(looked + 1)
    own, others = (betabinom.pmf(counts, looked, *share) for share in (SURFACE_OF_OWN, SURFACE_OF_OTHERS))
    chance = OTHERS_FACES * own + (1.0 - OTHERS_FACES) * others
    ratio = np.exp([log_ratio([Agreement(int(k), looked)]) for k in counts])
    assert chance @ ratio == pytest.approx(1.0, abs=1e-9)
    assert ratio.max() < 1.0 / OTHERS_FACES


@pytest.mark.parametrize('seed', range(20))
def test_an_object_anywhere_in_the_images_is_looked_at(seed):
    rng = np.random.default_rng(seed)
    shape, pose = SHAPES['block']
    views = printed(shape, pose, (Pose.identity(), APART), 40.0)
    taken = Pose.from_rotation_vector(rng.normal(size=3), [*rng.uniform(-0.25, 0.25, 2), rng.uniform(0.15, 0.8)])
    found = agreement(shape, taken, look(shape, taken, views), views)
    assert all(0 <= face.agree <= face.looked for face in found)
