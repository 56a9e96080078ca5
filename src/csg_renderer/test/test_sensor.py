"""The sensor against what is known of light, electrons and curves without a picture."""

import cv2
import numpy as np
import pytest

from csg_renderer import SensorModel, load_scene, render
from csg_renderer.params import RendererConfig
from csg_renderer.raycast.sensor import illumination, mosaic
from csg_renderer.raycast.settings import BAYER_CHANNELS
from csg_renderer.render_cli import main
from msgs_py import PinholeCamera

CAMERA = PinholeCamera.centred(48, 40, 60.0)
RAMP = np.repeat(np.linspace(0.0, 255.0, 256)[None], 256, axis=0)


def flat(level, size=400):
    return np.full((size, size), level, dtype=float)


# -- light ------------------------------------------------------------------------------------------------------------


def test_vignetting_is_the_fourth_power_of_the_cosine():
    # A lens whose corner is 30 degrees off its axis loses 1 - cos^4 there.
    corner = np.radians(30.0)
    light = illumination(640, 480, 1.0 - np.cos(corner) ** 4)
    focal = np.hypot(319.5, 239.5) / np.tan(corner)
    v, u = np.mgrid[0:480, 0:640]
    angle = np.arctan(np.hypot(u - 319.5, v - 239.5) / focal)
    assert np.allclose(light, np.cos(angle) ** 4, atol=1e-6)
    picture = SensorModel(vignetting=0.5).apply(flat(200.0, 101))
    assert picture[50, 50] == 200 and {int(picture[i, j]) for i in (0, -1) for j in (0, -1)} == {100}


# -- electrons --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize('gain', [1.0, 2.0])
@pytest.mark.parametrize('level', [10.0, 40.0, 100.0])
def test_variance_grows_with_the_mean_as_the_photon_transfer_curve_says(gain, level):
    well, read = 4000.0, 12.0
    sensor = SensorModel(full_well=well, read_noise=read, gain=gain, bits=16, seed=3, black_level=20.0)
    numbers = sensor.apply(flat(level)).astype(float) * 255.0 / sensor.white
    per_electron = gain * 255.0 / well
    mean = gain * level + 20.0
    variance = per_electron * (mean - 20.0) + (per_electron * read) ** 2
    n = numbers.size
    # Five standard errors of a mean and of a variance.
    assert numbers.mean() == pytest.approx(mean, abs=5.0 * np.sqrt(variance / n))
    assert numbers.var() == pytest.approx(variance, rel=5.0 * np.sqrt(2.0 / n))


def test_half_the_light_with_twice_the_gain_is_as_bright_and_has_twice_the_variance():
    once, pushed = (
        SensorModel(full_well=2000.0, exposure=1.0 / gain, gain=gain, bits=16).apply(flat(90.0)) / 257.0
        for gain in (1.0, 2.0)
    )
    assert pushed.mean() == pytest.approx(once.mean(), rel=2e-3)
    assert pushed.var() / once.var() == pytest.approx(2.0, rel=0.03)


def test_a_full_well_holds_no_more():
    sensor = SensorModel(full_well=1000.0, exposure=4.0, gain=0.5, bits=16)
    assert (sensor.apply(flat(200.0, 50)) == round(65535 / 2)).all()


def test_noise_of_the_light_needs_light_and_repeats_with_its_seed():
    sensor = SensorModel(full_well=500.0, seed=7)
    assert (sensor.apply(flat(0.0, 50)) == 0).all()
    assert np.array_equal(sensor.apply(flat(50.0)), sensor.apply(flat(50.0)))
    assert not np.array_equal(sensor.apply(flat(50.0)), SensorModel(full_well=500.0, seed=(7, 1)).apply(flat(50.0)))


# -- numbers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize('bits', range(8, 17))
def test_numbers_have_their_bits(bits):
    sensor = SensorModel(bits=bits)
    numbers = sensor.apply(RAMP)
    assert numbers.dtype == (np.uint8 if bits == 8 else np.uint16) and numbers.max() == sensor.white == 2**bits - 1
    assert np.abs(numbers / sensor.white - RAMP / 255.0).max() <= 0.5 / sensor.white + 1e-7


@pytest.mark.parametrize('gamma', [1.0, 1.8, 2.2, 0.5])
def test_the_inverse_of_gamma_gives_the_light_back(gamma):
    numbers = SensorModel(gamma=gamma, bits=16).apply(RAMP[:1]).astype(float)
    # What was rounded lies half a number away at most; single precision has some 1e-7 of its own.
    least, most = ((numbers + side).clip(0.0, 65535.0) / 65535.0 for side in (-0.51, 0.51))
    assert (least**gamma <= RAMP[:1] / 255.0).all() and (RAMP[:1] / 255.0 <= most**gamma).all()


def test_srgb_is_the_curve_of_the_standard():
    # Its two pieces meet, and 18 % grey is 46 % of white: 118 of 255 (IEC 61966-2-1).
    encoded = SensorModel(srgb=True, bits=16).apply(np.array([[0.0, 0.0031308 * 255.0, 0.18 * 255.0, 255.0]])) / 65535.0
    assert np.allclose(encoded, [[0.0, 12.92 * 0.0031308, 0.4614, 1.0]], atol=5e-5)
    inverse = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    assert np.allclose(inverse, [[0.0, 0.0031308, 0.18, 1.0]], atol=5e-5)


# -- mosaics ----------------------------------------------------------------------------------------------------------

OPENCV = {'rggb': 'BG', 'bggr': 'RG', 'gbrg': 'GR', 'grbg': 'GB'}  # OpenCV names the second row's pair


@pytest.mark.parametrize('pattern', sorted(BAYER_CHANNELS))
def test_a_mosaic_has_the_colours_of_the_picture_and_opencv_reads_it(pattern):
    colours = np.random.default_rng(1).integers(0, 256, (12, 16, 3), dtype=np.uint8)
    raw, rgb = SensorModel(bayer=pattern).apply(colours), SensorModel().apply(colours)
    names = np.array(list(pattern)).reshape(2, 2)
    for v in range(12):
        for u in range(16):
            assert raw[v, u] == rgb[v, u, 'rgb'.index(names[v % 2, u % 2])]
    plain = np.broadcast_to(np.array([200, 90, 30], np.uint8), (8, 8, 3))
    code = getattr(cv2, f'COLOR_Bayer{OPENCV[pattern]}2RGB')
    assert (cv2.cvtColor(mosaic(plain, pattern), code) == plain).all()


def test_a_mosaic_of_grey_is_refused():
    with pytest.raises(ValueError, match=r'bayer.*shape \(4, 4\)'):
        SensorModel(bayer='rggb').apply(np.zeros((4, 4)))


# -- what is asked for ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('arguments', 'name'),
    [
        ({'vignetting': 1.0}, 'vignetting'),
        ({'exposure': 0.0}, 'exposure'),
        ({'full_well': -1.0}, 'full_well'),
        ({'read_noise': 3.0}, 'read_noise.*full_well'),
        ({'gain': np.nan}, 'gain'),
        ({'black_level': 255.0}, 'black_level'),
        ({'gamma': 0.0}, 'gamma'),
        ({'gamma': 2.2, 'srgb': True}, 'gamma.*srgb'),
        ({'bits': 7}, 'bits'),
        ({'bits': 8.5}, 'bits'),
        ({'bayer': 'rgbg'}, 'bayer'),
    ],
)
def test_misuse_names_the_field(arguments, name):
    with pytest.raises(ValueError, match=f'^{name}'):
        SensorModel(**arguments)


@pytest.mark.parametrize('engine', ['native', 'reference', 'dap'])
@pytest.mark.parametrize('antialias', [0, 1, 2])
def test_radiance_is_what_the_image_rounds(engine, antialias):
    scene = load_scene('l_shape_v1')
    frame = render(scene, CAMERA, engine=engine, antialias=antialias, radiance=True)
    assert frame.radiance.dtype == np.float32 and frame.radiance.shape == (40, 48, 3)
    assert np.abs(255.0 * frame.radiance - frame.image).max() <= 0.5 + 1e-4
    assert len(np.unique(frame.radiance)) > len(np.unique(frame.image)) or antialias == 0
    assert render(scene, CAMERA, engine=engine, antialias=antialias).radiance is None


def test_sixteen_bits_of_a_scene_are_more_than_eight(tmp_path):
    options = ['l_shape_v1', '--size', '64', '--antialias', '4', '-q', '-o']
    assert main([*options, str(tmp_path / 'fine.png'), '--bits', '16']) == 0
    assert main([*options, str(tmp_path / 'raw.png'), '--bits', '12', '--bayer', 'grbg']) == 0
    assert main([*options, str(tmp_path / 'plain.png')]) == 0
    fine, raw, plain = (
        cv2.imread(str(tmp_path / f'{name}.png'), cv2.IMREAD_UNCHANGED) for name in ('fine', 'raw', 'plain')
    )
    assert fine.dtype == raw.dtype == np.uint16 and raw.shape == (64, 64) and raw.max() < 4096
    assert np.abs(fine / 257.0 - plain).max() <= 0.51 and len(np.unique(fine)) > len(np.unique(plain))
    assert np.abs(raw / 4095.0 - mosaic(fine[..., ::-1], 'grbg') / 65535.0).max() <= 0.5 / 4095 + 0.51 / 65535


def test_the_command_names_what_cannot_be(tmp_path, capsys):
    assert main(['l_shape_v1', '-q', '-o', str(tmp_path / 'a.png'), '--read-noise', '3']) == 2
    assert '--read-noise' in capsys.readouterr().err
    assert main(['l_shape_v1', '-q', '-o', str(tmp_path / 'a.jpg'), '--bits', '12']) == 2
    assert 'a.jpg' in capsys.readouterr().err


def test_parameters_of_the_node_are_the_sensor():
    config = RendererConfig(encoding='bayer_gbrg16', bits=12, full_well=9000.0, read_noise=5.0, psf=0.5, gain=2.0)
    assert config.sensor(3, 1) == SensorModel(
        0.5, 0.0, (0, 3, 1), full_well=9000.0, read_noise=5.0, gain=2.0, bits=12, bayer='gbrg'
    )
    assert RendererConfig().sensor(0, 0) == SensorModel(seed=(0, 0, 0)) and not RendererConfig().sensor(0, 0).fine
    for wrong, name in (
        ({'bits': 12}, 'bits'),
        ({'encoding': 'mono16', 'bits': 8}, 'bits'),
        ({'read_noise': 2.0}, 'read_noise'),
        ({'gamma': 2.0, 'srgb': True}, 'gamma'),
    ):
        with pytest.raises(ValueError, match=f'parameter {name}'):
            RendererConfig(**wrong)
