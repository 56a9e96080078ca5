"""measure_camera on rendered pictures of cameras whose noise and blur are known."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from csg_renderer import SensorModel, load_scene, render
from csg_renderer.raycast.render import scene_rig
from csg_renderer.raycast.sensor import grey
from model_matcher.closed_form.planning.rig import Sensor, read_sensor
from stereo_recovery import measure_camera
from stereo_recovery.measure_camera_cli import main

# Rays along a side of a pixel: a blur of so many as these is that of a lens, and not of a kernel of a few pixels.
FINE = 6


@pytest.fixture(scope='module')
def seen():
    """What a lens with a given blur, pixels, shows of a laid table: (h, w, 3) grey levels of light."""
    scene = load_scene('table')
    fine = render(scene, scene_rig(scene, 400 * FINE, 400 * FINE, baseline=1.0).left, radiance=True).radiance

    def light(psf):
        blurred = cv2.GaussianBlur(fine, (0, 0), FINE * psf)
        return 255.0 * cv2.resize(blurred, (400, 400), interpolation=cv2.INTER_AREA)

    return light


def pair(light, colour=False, **chip):
    return [SensorModel(seed=(1, k), **chip).apply(light if colour else grey(light)) for k in (0, 1)]


@pytest.mark.parametrize(
    ('chip', 'psf', 'options'),
    [
        ({'full_well': 6000.0, 'read_noise': 40.0, 'bits': 12}, 0.5, {'bits': 12}),
        ({'full_well': 3000.0, 'read_noise': 20.0, 'black_level': 16.0}, 1.0, {'black_level': 16.0}),
        ({'full_well': 2500.0, 'read_noise': 30.0, 'gamma': 2.2}, 0.8, {'gamma': 2.2}),
        (
            {'full_well': 5000.0, 'read_noise': 50.0, 'bits': 16, 'bayer': 'grbg', 'gain': 2.0, 'exposure': 0.5},
            0.7,
            {'bayer': 'grbg'},
        ),
    ],
)
def test_what_a_camera_does_is_measured_within_a_tenth(seen, chip, psf, options):
    found = measure_camera(*pair(seen(psf), 'bayer' in chip, **chip), **options)
    gain = chip.get('gain', 1.0) * 255.0 / chip['full_well']
    assert found.reasons == ()
    assert found.gain == pytest.approx(gain, rel=0.1)
    assert found.read_noise == pytest.approx(gain * chip['read_noise'], rel=0.1)
    assert found.psf == pytest.approx(psf, rel=0.1) and found.psf_error < 0.05
    gamma = chip.get('gamma', 1.0)
    level = 255.0 * 0.5**gamma - chip.get('black_level', 0.0)
    noise = np.sqrt(gain * level + (gain * chip['read_noise']) ** 2) / (gamma * 0.5 ** (gamma - 1.0))
    assert found.noise == pytest.approx(noise, rel=0.05)
    assert abs(found.noise - noise) < 5.0 * found.noise_error + 0.01 * noise


def test_noise_without_light_is_all_read_noise(seen):
    found = measure_camera(*pair(seen(0.6), noise_sigma=2.0))
    assert found.read_noise == pytest.approx(2.0, rel=0.05) and found.noise == pytest.approx(2.0, rel=0.05)
    assert found.gain < 0.002


def test_flickering_light_and_what_moves_in_a_corner_do_no_harm(seen):
    first, second = pair(seen(0.6), full_well=4000.0, read_noise=40.0, bits=16)
    second = (second * 0.98).astype(np.uint16)
    second[:60, :60] = second[60:120, :60]
    found = measure_camera(first, second)
    assert found.gain == pytest.approx(255.0 / 4000.0, rel=0.1)
    assert found.psf == pytest.approx(0.6, rel=0.1)


def test_a_camera_that_was_touched_is_noticed(seen):
    light = seen(0.6)
    turned = cv2.warpAffine(light, np.float64([[1, 0, 0.3], [0, 1, 0]]), (400, 400), borderMode=cv2.BORDER_REPLICATE)
    first, second = (SensorModel(noise_sigma=1.0, seed=k).apply(grey(one)) for k, one in enumerate((light, turned)))
    found = measure_camera(first, second)
    assert found.shift == pytest.approx([0.3, 0.0], abs=0.05)
    assert any('moved by 0.3' in reason for reason in found.reasons)


def test_an_even_wall_tells_its_own_noise_only():
    wall = np.full((200, 200), 90.0)
    found = measure_camera(*pair(np.stack([wall] * 3, axis=-1), full_well=5000.0))
    assert found.gain is None and found.read_noise is None and found.psf is None
    assert found.noise == pytest.approx(np.sqrt(90.0 * 255.0 / 5000.0), rel=0.05)
    assert len(found.reasons) == 2 and 'about 90' in found.reasons[0] and 'psf' in found.reasons[1]


@pytest.mark.parametrize(
    ('arguments', 'name'),
    [
        ({'second': np.zeros((3, 3), np.uint8)}, 'second: .*3, 3'),
        ({'second': None}, 'second: the same picture'),
        ({'bits': 12}, 'bits'),
        ({'gamma': 0.0}, 'gamma'),
        ({'black_level': 200.0}, 'black_level'),
        ({'bayer': 'rgb'}, 'bayer'),
    ],
)
def test_misuse_names_the_argument(arguments, name):
    first = np.arange(100, dtype=np.uint8).reshape(10, 10)
    given = {'second': first + 1} | arguments
    second = given.pop('second')
    with pytest.raises(ValueError, match=f'^{name}'):
        measure_camera(first, first if second is None else second, **given)


def test_the_command_writes_what_plan_rig_reads(seen, tmp_path, capsys):
    for k, picture in enumerate(pair(seen(0.6), full_well=5000.0, read_noise=40.0)):
        cv2.imwrite(str(tmp_path / f'{k}.png'), picture)
    files = [str(tmp_path / f'{k}.png') for k in (0, 1)]
    assert main([*files, '-o', str(tmp_path / 'camera.json')]) == 0
    said = capsys.readouterr().out
    assert 'grey levels at mid grey' in said
    options = said.split('"render": ')[1].split()
    for name, true in (('--psf', 0.6), ('--full-well', 5000.0), ('--read-noise', 40.0)):
        assert float(options[options.index(name) + 1]) == pytest.approx(true, rel=0.1)
    record = json.loads((tmp_path / 'camera.json').read_text())
    assert {'noise', 'read_noise', 'gain', 'psf'} <= set(record)
    sensor = read_sensor(tmp_path / 'camera.json')
    assert sensor == Sensor(record['read_noise'], record['psf'], record['gain'])
    assert sensor.pixel_noise(127.5) == pytest.approx(record['noise'], rel=0.02)
    assert main([*files, '--json']) == 0 and json.loads(capsys.readouterr().out) == record
    assert main([files[0], files[0]]) == 2 and files[0] in capsys.readouterr().err
    assert main([*files, '--gamma', '0']) == 2 and '--gamma' in capsys.readouterr().err
