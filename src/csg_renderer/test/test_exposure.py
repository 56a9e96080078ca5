"""Depth of field and motion blur, against closed forms: the disc of defocus, and the streak of what moves."""

import cv2
import numpy as np
import pytest

from csg_renderer import Light, Scene, Solid, Surface, render, render_cli, render_stereo
from csg_renderer.params import RendererConfig
from csg_renderer.raycast.exposure import along_path, moved_by, part_of
from csg_renderer.stereo_pictures import frames_of
from msgs_py import LensDistortion, PinholeCamera, Pose, StereoRig

CAMERA = PinholeCamera.centred(96, 16, 200.0)
GLOW = Surface((1.0, 1.0, 1.0), ambient=1.0, diffuse=0.0)


def moved(solid, x, y, z):
    return solid.transformed(Pose(np.eye(3), [x, y, z]))


def half_plane(z):
    """Bright where x < 0 at this depth."""
    return Scene(moved(Solid.block(2.0, 2.0, 0.001), -2.0, -1.0, z).painted(GLOW), ambient_light=(1, 1, 1))


def bar(width, z):
    return Scene(moved(Solid.block(width, 2.0, 0.001), -width / 2, -1.0, z).painted(GLOW), ambient_light=(1, 1, 1))


def profile(frame):
    """Share of light across the middle row, and its pixels from the principal point."""
    return frame.image[8, :, 0] / 255.0, np.arange(96) - CAMERA.cx


@pytest.mark.parametrize(('depth', 'focus'), [(0.5, 1.0), (2.0, 1.0), (1.0, 4.0)])
def test_the_disc_of_defocus_is_as_wide_as_the_lens_says(depth, focus):
    # Similar triangles: f A |1/z - 1/focus| pixels.
    aperture = 0.03
    share, u = profile(render(half_plane(depth), CAMERA, aperture=aperture, focus=focus, pinholes=1024))
    disc = CAMERA.fx * aperture * abs(1.0 / depth - 1.0 / focus)
    assert 2.0 < disc < 7.0
    # The share of a disc on one side of an edge, averaged over the pixel.
    at = u[:, None] + (np.arange(64) + 0.5) / 64 - 0.5
    s = np.clip(-at / (disc / 2.0), -1.0, 1.0)
    expected = (0.5 + (s * np.sqrt(1.0 - s * s) + np.arcsin(s)) / np.pi).mean(axis=1)
    assert np.abs(share - expected).max() < 0.01


def test_what_lies_at_the_focus_is_as_sharp_as_without_a_lens():
    scene = half_plane(1.0)
    sharp, focused = (render(scene, CAMERA, **o) for o in ({'antialias': 8}, {'aperture': 0.05, 'focus': 1.0}))
    assert np.abs(sharp.image.astype(int) - focused.image).max() <= 8
    for name in ('depth', 'face_id', 'primitive_id', 'normal'):
        assert np.array_equal(getattr(sharp, name), getattr(focused, name), equal_nan=True)


@pytest.mark.parametrize('path', [2, 5])
def test_the_streak_of_what_moves_is_as_long_as_its_way(path):
    width, depth, way = 0.01, 1.0, 0.06
    poses = [Pose(np.eye(3), [x, 0.0, 0.0]) for x in np.linspace(-way / 2, way / 2, path)]
    share, u = profile(render(bar(width, depth), CAMERA, motion=poses, pinholes=1024))
    # A box of the bar's width over one of the way's length over the pixel: 2 and 12 and 1 pixels.
    at = u[:, None] + (np.arange(64) + 0.5) / 64 - 0.5
    long, thick = CAMERA.fx * way / depth, CAMERA.fx * width / depth
    covered = np.clip(np.minimum(at + thick / 2, long / 2) - np.maximum(at - thick / 2, -long / 2), 0.0, None) / long
    assert np.abs(share - covered.mean(axis=1)).max() < 0.01
    assert share.sum() == pytest.approx(thick, rel=0.02)


def test_both_cameras_of_a_rig_see_the_same_motion():
    rig = StereoRig.symmetric(CAMERA, 0.05)
    turn = moved_by(Pose(), [0.0, 0.0, 0.1], [0.0, 0.0, 30.0])
    scene = Scene(moved(Solid.sphere(0.02), 0.1, 0.0, 1.0).painted(GLOW), ambient_light=(1, 1, 1))
    left, right = render_stereo(scene, rig, motion=turn, pinholes=16)
    # Each moment is a rectified pair of its own: the same as a render of the right camera alone along its own path.
    shift = Pose(np.eye(3), rig.right_T_left)
    alone = render(scene, rig.right, shift, motion=[shift.compose(pose) for pose in turn], pinholes=16)
    assert np.array_equal(right.image, alone.image) and not np.array_equal(left.image, right.image)


def test_screws_are_followed_at_a_steady_pace():
    whole = Pose.from_rotation_vector([0.3, -0.2, 1.1], [0.1, 0.2, -0.3])
    third = part_of(whole, 1.0 / 3.0)
    thrice = third.compose(third).compose(third)
    assert np.allclose(thrice.matrix, whole.matrix, atol=1e-12)
    assert np.allclose(part_of(whole, -1.0).compose(whole).matrix, np.eye(4), atol=1e-12)
    tiny = Pose.from_rotation_vector([1e-6, 0, 0], [1.0, 0, 0])
    assert np.allclose(part_of(tiny, 0.5).translation, [0.5, 0.0, 0.0])
    path = [Pose(np.eye(3), [x, 0.0, 0.0]) for x in (0.0, 1.0, 4.0)]
    assert [along_path(path, t).translation[0] for t in (0.0, 0.25, 0.5, 0.75, 1.0)] == pytest.approx(
        [0, 0.5, 1, 2.5, 4]
    )
    before, after = moved_by(whole, [0.2, 0.0, 0.0], [0.0, 0.0, 0.0])
    assert np.allclose(after.translation - before.translation, [0.2, 0.0, 0.0])


def test_engines_and_raw_pictures_have_both():
    scene = Scene(moved(Solid.block(0.2, 0.1, 0.1), 0.0, 0.0, 1.0).painted(GLOW), [Light((0, -1, 0))])
    small = PinholeCamera.centred(24, 16, 40.0)
    options = {'aperture': 0.05, 'focus': 0.7, 'motion': moved_by(Pose(), [0.1, 0, 0], [0, 0, 5]), 'pinholes': 9}
    native, *others = (render(scene, small, engine=engine, **options) for engine in ('native', 'reference', 'dap'))
    for other in others:
        assert np.abs(native.image.astype(int) - other.image).max() <= 1
    plain = LensDistortion('plumb_bob', (0.0, 0.0, 0.0, 0.0, 0.0))
    raw = render(scene, small, lens=plain, **{**options, 'pinholes': 256})
    ideal = render(scene, small, **{**options, 'pinholes': 256})
    assert np.abs(raw.image.astype(int) - ideal.image).max() <= 12 and raw.lens is plain
    assert render(scene, small, radiance=True, **options).radiance.dtype == np.float32


def test_the_command_takes_millimetres_and_degrees(tmp_path, capsys):
    (tmp_path / 'bar.csg').write_text(
        'AMBIENT (1); CAMERA SIZE (96, 16) FOCAL (200); STEREO (50);'
        'DRAW BLOCK (10, 2000, 1) COLOUR (1) AT (-5, -1000, 1000) AS bar;'
    )
    arguments = [str(tmp_path / 'bar.csg'), '-o', str(tmp_path / 'out.png'), '--stereo', '-q', '--pinholes', '256']
    assert render_cli.main([*arguments, '--motion', '60', '0', '0', '0', '0', '0']) == 0
    for side, middle in (('left', 0.0), ('right', -10.0)):
        row = cv2.imread(str(tmp_path / f'out_{side}.png'))[8, :, 0] / 255.0
        # 2 pixels of light, spread over 12 about the middle of the way.
        assert row.sum() == pytest.approx(2.0, rel=0.05)
        assert np.average(np.arange(96) - CAMERA.cx, weights=row) == pytest.approx(middle, abs=0.1)
        assert 12 <= (row > 0.01).sum() <= 15
    assert render_cli.main([*arguments, '--aperture', '60', '--focus', '500']) == 0
    row = cv2.imread(str(tmp_path / 'out_left.png'))[8, :, 0]
    assert 12 <= (row > 2).sum() <= 15
    assert render_cli.main([*arguments, '--aperture', '60']) == 2
    assert 'focus: expected the depth that is sharp' in capsys.readouterr().err


def test_the_node_takes_metres_and_degrees():
    scene, rig = bar(0.02, 1.0), StereoRig.symmetric(PinholeCamera.centred(32, 8, 60.0), 0.05)
    config = RendererConfig(aperture=0.05, focus=0.5, motion=(0.1, 0.0, 0.0, 0.0, 0.0, 5.0), pinholes=8)
    path = moved_by(Pose(), [0.1, 0.0, 0.0], [0.0, 0.0, 5.0])
    expected = render_stereo(scene, rig, aperture=0.05, focus=0.5, motion=path, pinholes=8)
    for mine, other in zip(frames_of(scene, rig, Pose(), config), expected):
        assert np.array_equal(mine.image, other.image)
    for wrong, message in (
        ({'motion': (1.0, 2.0)}, 'parameter motion: expected 6 numbers or none, got 2'),
        ({'aperture': 0.1}, 'parameter focus: expected the depth that is sharp'),
        ({'pinholes': 0}, 'pinholes'),
    ):
        with pytest.raises(ValueError, match=message):
            RendererConfig(**wrong)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'aperture': -1.0}, 'aperture: expected a length >= 0'),
        ({'aperture': 0.1}, 'focus: expected the depth that is sharp'),
        ({'aperture': 0.1, 'focus': np.inf}, 'focus: expected a length'),
        ({'motion': [Pose()]}, 'motion: expected two poses or more'),
        ({'motion': [Pose(), 3]}, 'motion: expected two poses or more'),
        ({'pinholes': 0}, 'pinholes: expected a whole number in 1..4096'),
    ],
)
def test_what_cannot_be_is_refused_by_name(options, message):
    with pytest.raises(ValueError, match=message):
        render(half_plane(1.0), CAMERA, **options)
