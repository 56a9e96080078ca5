"""recover() of any number of cameras: what a third one adds, and what a bad one must not take away."""

from __future__ import annotations

import numpy as np
import pytest

from msgs_py import CameraRig, FeatureKind, PinholeCamera, Pose, StereoRig
from stereo_recovery import RecoveryParams, recover
from stereo_recovery.cameras.pairs import camera_pair, main_pairs

DEPTH = 0.25
CAMERA = PinholeCamera.centred(400, 400, 550.0)
PAIR = StereoRig.symmetric(CAMERA, DEPTH / 5)
# Above the pair, looking down at what it looks at, and turned a little.
ABOVE = Pose.from_rotation_vector([-0.16, 0.03, 0.05], [0.02, -0.045, 0.002])
RIG = CameraRig([CAMERA] * 3, [*CameraRig.from_stereo(PAIR).poses, ABOVE])
# Edges along the rows and columns, and along the view.
LEVEL = Pose.from_rotation_vector([0.7, 0.0, 0.0], [0.025, 0.0, DEPTH])
LIGHT = np.array([-0.4, -0.75, -0.6])


def picture(synthetic, solid, camera: PinholeCamera, pose: Pose, seed: int = 0) -> np.ndarray:
    """What a camera anywhere sees."""
    back = pose.inverse()
    return synthetic.render(solid.at(back), camera, light=back.rotate(LIGHT), seed=seed)


def pictures(synthetic, solid, rig: CameraRig = RIG) -> list[np.ndarray]:
    return [picture(synthetic, solid, *each, seed=k) for k, each in enumerate(zip(rig.cameras, rig.poses))]


def found_of(features, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of each true edge (n, 2, 3) the share that is found, and of each report its angle to one, degrees; NaN: none."""
    edges = features.of_kind(FeatureKind.EDGE)
    run = truth[:, 1] - truth[:, 0]
    length = np.linalg.norm(run, axis=1)
    line = run / length[:, None]
    ends = np.stack([edges.start, edges.end], axis=1)
    away = ends[:, None] - truth[None, :, None, 0]
    place = np.clip((away * line[:, None]).sum(axis=-1), 0.0, length[:, None])
    off = np.linalg.norm(away - place[..., None] * line[:, None], axis=-1).max(axis=-1)
    angle = np.degrees(np.arccos(np.minimum(1.0, np.abs(edges.directions @ line.T))))
    same = (off < 0.002) & (angle < 5.0)
    share = np.zeros(len(truth))
    for m in range(len(truth)):
        pieces = np.sort(place[same[:, m], m], axis=1) / length[m]
        places = (np.arange(100)[:, None] + 0.5) / 100
        share[m] = ((places >= pieces[:, 0]) & (places <= pieces[:, 1])).any(axis=1).mean()
    own = np.where(same, angle, np.inf).min(axis=1)
    return share, np.where(np.isfinite(own), own, np.nan)


@pytest.fixture(scope='module')
def solid(solids):
    return solids['channel'].at(LEVEL)


@pytest.fixture(scope='module')
def three(synthetic, solid):
    return pictures(synthetic, solid)


def same_features(one, other) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
        for name in ('kind', 'start', 'end', 'radii', 'err_par', 'err_per')
    )


def test_two_cameras_of_a_rig_give_what_the_pair_gives_to_the_bit(three):
    by_rig = recover(three[:2], CameraRig.from_stereo(PAIR))
    by_pair = recover(three[0], three[1], PAIR)
    assert len(by_pair.features) > 5 and same_features(by_rig.features, by_pair.features)
    assert by_rig.counts == by_pair.counts
    assert same_features(recover(three[:2], PAIR).features, by_pair.features)
    # The parameters may stand in the third place or by name.
    params = RecoveryParams(min_length=30.0)
    fewer = recover(three[0], three[1], PAIR, params).features
    assert same_features(recover(three[:2], CameraRig.from_stereo(PAIR), params).features, fewer)
    assert same_features(recover(three[:2], CameraRig.from_stereo(PAIR), params=params).features, fewer)


def test_a_third_camera_finds_level_edges_and_their_directions(synthetic, solids):
    scenes = (
        ('channel', (0.5, 0.0, 0.0)),
        ('channel', (-0.6, 0.03, 0.02)),
        ('wedge', (0.7, 0.0, 0.0)),
        ('chipped', (-0.6, 0.03, 0.02)),
    )
    share: list[list[np.ndarray]] = [[], []]
    angle: list[list[np.ndarray]] = [[], []]
    for name, turn in scenes:
        shape = solids[name].at(Pose.from_rotation_vector(turn, LEVEL.translation))
        images = pictures(synthetic, shape)
        truth = synthetic.truth_edges(shape, PAIR)
        run = np.diff(CAMERA.project(truth), axis=1)[:, 0]
        level = np.abs(run[:, 1]) < np.sin(np.radians(8.0)) * np.hypot(*run.T)
        assert level.sum() >= 2
        for k, result in enumerate((recover(images[0], images[1], PAIR), recover(images, RIG))):
            shares, angles = found_of(result.features, truth)
            share[k].append(shares[level])
            angle[k].append(angles[np.isfinite(angles)])
    two, three = (np.concatenate(each).mean() for each in share)
    assert three > 0.95 and two < three - 0.1
    off = [np.quantile(np.concatenate(each), [0.5, 0.9]) for each in angle]
    assert (off[1] < 0.8 * off[0]).all() and off[1][0] < 0.12


def fence(synthetic, count: int, pitch: float, height: float):
    """Slats side by side in the plane z = 0, each half a pitch wide."""
    shape = synthetic.Shape()
    outline = np.array([(-0.25, -0.1), (0.25, -0.1), (0.25, 0.1), (-0.25, 0.1)]) * pitch
    for k in range(count):
        place = np.array([(k - 0.5 * (count - 1)) * pitch, 0.5 * height, 0.0])
        shape = shape + synthetic.prism(outline, height).at(Pose.from_rotation_vector([0.5 * np.pi, 0.0, 0.0], place))
    return shape


def test_a_third_camera_outvotes_matches_of_another_period(synthetic):
    pose = Pose.from_rotation_vector([0.1, 0.6, 0.05], LEVEL.translation)
    images = pictures(synthetic, fence(synthetic, 14, 5e-3, 50e-3).at(pose))
    off = []
    for result in (recover(images[0], images[1], PAIR), recover(images, RIG)):
        edges = result.features.of_kind(FeatureKind.EDGE)
        depth = np.abs(pose.inverse().apply(np.concatenate([edges.start, edges.end]))[:, 2])
        off.append(np.mean(depth > 3e-3))
        assert len(edges) > 20
    # A period is 16 mm of depth here.
    assert off[0] > 0.5 and off[1] < 0.1


def test_cameras_that_converge_find_rims_and_edges(synthetic, solids):
    """No two of them are a rectified pair as they come."""
    at = LEVEL.translation

    def looking_at_it(place: np.ndarray, roll: float) -> Pose:
        z = (at - place) / np.linalg.norm(at - place)
        x = np.cross([0.0, 1.0, 0.0], z) / np.linalg.norm(np.cross([0.0, 1.0, 0.0], z))
        turn = Pose.from_rotation_vector([0.0, 0.0, roll]).rotation
        return Pose(np.stack([x, np.cross(z, x), z], axis=1) @ turn, place)

    first = looking_at_it(np.array([0.0, 0.0, 0.0]), 0.02)
    poses = [first, looking_at_it(np.array([0.05, 0.0, 0.0]), -0.03), looking_at_it(np.array([0.02, -0.045, 0.0]), 0.1)]
    rig = CameraRig([CAMERA] * 3, [Pose.identity(), *(first.inverse().compose(pose) for pose in poses[1:])])
    can = solids['cylinder'].at(Pose.from_rotation_vector([-0.9, 0.0, 0.1], at))
    images = [picture(synthetic, can, CAMERA, pose, seed=k) for k, pose in enumerate(poses)]
    result = recover(images, rig)
    rims = result.features.of_kind(FeatureKind.CURVE).transformed(first)
    assert len(rims) == 2 and np.abs(rims.radii[:, 0] - 0.015).max() < 5e-5
    centres = np.array([centre for centre, *_ in can.rims])
    away = np.linalg.norm(rims.start[:, None] - centres, axis=2).min(axis=1)
    assert (away < 1e-4).all() and (away < rims.err_per).all()
    # The curves themselves are in that frame, too.
    np.testing.assert_allclose([c.centre for c in result.curves], result.features.of_kind(FeatureKind.CURVE).start)


PLAIN = {
    'black': np.zeros((400, 400), np.uint8),
    'one grey level': np.full((400, 400), 90, np.uint8),
    'noise': np.random.default_rng(5).integers(0, 256, (400, 400), dtype=np.uint8),
}


@pytest.mark.parametrize('blind', range(3))
@pytest.mark.parametrize('name', [*PLAIN, 'another scene'])
def test_a_blind_camera_leaves_what_the_others_see(synthetic, solids, three, blind, name):
    if name == 'another scene':
        shape = solids['L-block'].at(Pose.from_rotation_vector([0.3, 0.4, 0.5], LEVEL.translation))
        bad = picture(synthetic, shape, CAMERA, RIG.poses[blind])
    else:
        bad = PLAIN[name]
    others = [k for k in range(3) if k != blind]
    first = RIG.poses[others[0]]
    rest = CameraRig([CAMERA] * 2, [Pose.identity(), first.inverse().compose(RIG.poses[others[1]])])
    expected = recover([three[k] for k in others], rest).features.transformed(first)

    found = recover([bad if k == blind else three[k] for k in range(3)], RIG).features

    assert len(found) == len(expected) > 5
    np.testing.assert_allclose(found.start, expected.start, atol=1e-9)
    np.testing.assert_allclose(found.err_per, expected.err_per, atol=1e-9)


def test_a_camera_that_has_moved_a_little_or_much_is_measured_or_left_out(synthetic, solids):
    """A fifth of a degree, 2 px, is measured and taken out; what is off by more is left out."""
    shapes = [
        solids[name].at(Pose.from_rotation_vector(turn, LEVEL.translation))
        for name, turn in (('channel', (0.5, -0.4, 0.1)), ('chipped', (0.3, 0.8, -0.2)))
    ]
    for degrees in (0.2, 1.0, 5.0):
        moved = RIG.poses[2].compose(Pose.from_rotation_vector(np.radians(degrees) * np.array([0.6, 0.6, 0.5])))
        rig = CameraRig(RIG.cameras, [*RIG.poses[:2], moved])
        share: list[list[float]] = [[], []]
        for shape in shapes:
            truth, images = synthetic.truth_edges(shape, PAIR), pictures(synthetic, shape)
            for k, result in enumerate((recover(images[0], images[1], PAIR), recover(images, rig))):
                shares, angles = found_of(result.features, truth)
                share[k].append(shares.mean())
                assert np.isnan(angles).mean() < 0.05
        assert np.mean(share[1]) > np.mean(share[0]) - 0.01


def test_of_three_blind_cameras_a_reason_is_given():
    black = np.zeros((400, 400), np.uint8)
    result = recover([black] * 3, RIG)
    assert len(result.features) == 0 and 'no texture' in result.reason


def test_a_camera_that_looks_away_changes_nothing(three):
    away = CameraRig(RIG.cameras, [*RIG.poses[:2], Pose.from_rotation_vector([0.0, np.pi, 0.0], [0.0, -0.05, 0.0])])
    assert same_features(recover(three, away).features, recover(three[:2], CameraRig.from_stereo(PAIR)).features)


def test_features_are_in_the_first_cameras_frame_whatever_the_order(three):
    """The main pair is then 1 and 2, of which neither is camera 0."""
    order = [2, 0, 1]
    first = RIG.poses[2]
    turned = CameraRig([CAMERA] * 3, [Pose.identity(), *(first.inverse().compose(RIG.poses[k]) for k in (0, 1))])
    expected = recover(three, RIG).features.transformed(first.inverse())
    result = recover([three[k] for k in order], turned)
    assert (result.counts['left camera'], result.counts['right camera']) == (1, 2)
    # The same pair, turned by what rounding leaves of it.
    assert len(result.features) == len(expected)
    np.testing.assert_allclose(result.features.start, expected.start, atol=2e-4)


@pytest.mark.parametrize(
    ('place', 'turn'),
    [((0.0, -0.05, 0.0), 'quarter'), ((0.05, 0.0, 0.0), 'none'), ((-0.05, 0.0, 0.0), 'none'), ((0.03, 0.04, 0.01), '')],
)
def test_any_two_cameras_side_by_side_are_a_pair(place, turn):
    pose = Pose.from_rotation_vector([0.05, -0.04, 0.02] if turn == '' else [0.0, 0.0, 0.0], place)
    rig = CameraRig([CAMERA, PinholeCamera(300, 350, 400.0, 410.0, 140.0, 180.0)], [Pose.identity(), pose])
    pair = main_pairs(rig)[0]
    points = np.random.default_rng(2).uniform([-0.05, -0.05, 0.5], [0.05, 0.05, 1.0], (20, 3))
    # What the two cameras see, taken to the pair's pictures, is what the pair sees of the same points.
    seen = rig.project(points)
    shown = pair.rig.project(pair.first_T_pair.inverse().apply(points))
    for side, k in enumerate(pair.cameras):
        image = np.column_stack([seen[k], np.ones(20)]) @ pair.homographies[side].T
        np.testing.assert_allclose(image[:, :2] / image[:, 2:], shown[side], atol=1e-6)
    upright = pair.first_T_pair.rotation.T @ rig.poses[pair.cameras[0]].rotation
    # A pair is turned no farther than it must be: a camera to the left is the pair's left one.
    assert np.trace(upright) > {'quarter': 0.9, 'none': 2.99, '': 1.0}[turn]


def test_a_camera_in_anothers_picture_makes_no_pair(three):
    behind = CameraRig([CAMERA] * 2, [Pose.identity(), Pose(translation=np.array([0.0, 0.0, -0.1]))])
    assert camera_pair(behind, 0, 1) is None and not main_pairs(behind)
    with pytest.raises(ValueError, match='cameras: no two of them are side by side'):
        recover(three[:2], behind)


@pytest.mark.parametrize(
    ('images', 'error', 'message'),
    [
        (lambda three: three[:2], ValueError, 'images: expected one of each of 3 cameras, got 2'),
        (lambda three: [*three, three[0]], ValueError, 'images: expected one of each of 3 cameras, got 4'),
        (
            lambda three: [*three[:2], three[2][:100]],
            ValueError,
            r'images\[2\]: image is 400 x 100 .* expects 400 x 400',
        ),
        (lambda three: [*three[:2], None], (TypeError, ValueError), r'images\[2\]'),
        (lambda three: 7, TypeError, 'images: expected a sequence'),
    ],
)
def test_wrong_images_are_refused_by_name(three, images, error, message):
    with pytest.raises(error, match=message):
        recover(images(three), RIG)


def test_a_rig_of_another_kind_is_refused_by_name(three):
    with pytest.raises(TypeError, match='rig: expected a StereoRig, got NoneType'):
        recover(three[0], three[1])
    with pytest.raises(TypeError, match='rig: expected a StereoRig, got CameraRig'):
        recover(three[0], three[1], RIG)


@pytest.mark.parametrize('seed', range(12))
def test_any_rig_and_any_images_give_features_or_a_reason(synthetic, solids, seed):
    rng = np.random.default_rng(seed)
    cameras, poses = [], [Pose.identity()]
    spread = 1.0 if seed % 2 else 0.1
    for k in range(rng.integers(2, 6)):
        size, focal = rng.integers(100, 260, 2), rng.uniform(100, 400, 2)
        cameras.append(PinholeCamera(*size, *focal, *(0.5 * size + rng.uniform(-40, 40, 2))))
        if k:
            poses.append(Pose.from_rotation_vector(rng.normal(0, spread, 3), rng.normal(0, 0.05, 3)))
    rig = CameraRig(cameras, poses)
    shape = solids['L-block'].at(Pose.from_rotation_vector(rng.normal(0, 1, 3), [0.0, 0.0, 0.3]))
    images = [
        rng.integers(0, 256, (camera.height, camera.width), dtype=np.uint8)
        if rng.random() < 0.2
        else synthetic.render(shape.at(pose.inverse()), camera, ss=1, seed=k)
        for k, (camera, pose) in enumerate(zip(cameras, poses))
    ]
    if not main_pairs(rig):
        with pytest.raises(ValueError, match='no two of them'):
            recover(images, rig)
        return
    result = recover(images, rig)
    assert np.isfinite(result.features.start).all() and (len(result.features) > 0 or result.reason)
