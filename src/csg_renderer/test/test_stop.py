"""A rendering that would take for ever is ended from another thread, by every engine, in a moment."""

import itertools
import threading
import time

import numpy as np
import pytest

from csg_renderer import Environment, Light, Scene, Solid, Surface, render, render_stereo
from csg_renderer.raycast.render import default_camera
from csg_renderer.raycast.stop import RenderStopped, Stop
from msgs_py import LensDistortion, PinholeCamera, Pose


def hall_of_mirrors() -> Scene:
    """Mirroring glass balls all around the camera: every ray becomes two, sixty-four times."""
    places = [place for place in itertools.product((-0.5, -0.25, 0.0, 0.25, 0.5), repeat=3) if any(place)]
    balls = [
        Solid.sphere(0.12).painted(Surface(reflection=0.5, transparency=0.5)).transformed(Pose(np.eye(3), place))
        for place in places
    ]
    return Scene(balls, [Light((0, -1, 0))])


def ended_after(work, stop, most):
    """Seconds from when a rendering that goes on is stopped until it has ended; waits for most of them at most."""
    ended = []

    def stopped():
        with pytest.raises(RenderStopped, match='it takes too long'):
            work()
        ended.append(time.monotonic())

    thread = threading.Thread(target=stopped, daemon=True)
    thread.start()
    thread.join(0.5)
    assert thread.is_alive()
    stop.set('it takes too long')
    asked = time.monotonic()
    thread.join(most)
    assert ended
    return ended[0] - asked


@pytest.mark.parametrize('engine', ['native', 'reference', 'dap'])
@pytest.mark.parametrize(
    'options',
    [{'levels': 64}, {'levels': 64, 'antialias': 16, 'shadows': True}, {'levels': 40, 'antialias': 1, 'tiling': False}],
)
def test_what_would_take_for_ever_is_ended_at_once(engine, options):
    scene, stop = hall_of_mirrors(), Stop()
    if engine == 'native':
        render(scene, default_camera(16), **{**options, 'levels': 2})  # compiled before

    assert ended_after(lambda: render_stereo(scene, engine=engine, stop=stop, **options), stop, 5.0) < 1.0


@pytest.mark.parametrize('engine', ['native', 'reference'])
@pytest.mark.parametrize('options', [{'samples': 1024}, {'aperture': 0.1, 'focus': 1.0, 'pinholes': 4096}])
def test_any_number_of_samples_and_pinholes_is_ended_at_once(engine, options):
    balls = hall_of_mirrors()
    lights = [Light((0.0, -1.0, 0.0), radius=0.2)] * 8
    scene = Scene(balls.placements, lights, environment=Environment(np.ones((2, 4))))
    stop = Stop()
    if engine == 'native':
        render(scene, default_camera(16), samples=1)  # compiled before

    assert (
        ended_after(lambda: render(scene, engine=engine, stop=stop, levels=4, shadows=True, **options), stop, 5.0) < 1.0
    )


BARREL = LensDistortion('plumb_bob', (-0.3, 0.08, 0.0, 0.0, 0.0))
FISHEYE = LensDistortion('equidistant', (0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ('camera', 'lens', 'options'),
    [
        (default_camera(512), BARREL, {'levels': 64}),
        (default_camera(512), BARREL, {'levels': 64, 'antialias': 16}),
        (PinholeCamera.centred(512, 512, 100.0), FISHEYE, {'levels': 64, 'antialias': 4}),
        (default_camera(2048), BARREL, {'antialias': 16}),
    ],
)
def test_a_raw_picture_that_would_take_for_ever_is_ended_at_once(camera, lens, options):
    scene, stop = hall_of_mirrors(), Stop()
    small = PinholeCamera.centred(16, 16, 16 * camera.fx / camera.width)
    render(scene, small, lens=lens, **{**options, 'levels': 2, 'antialias': 2})  # compiled before

    assert ended_after(lambda: render(scene, camera, lens=lens, stop=stop, **options), stop, 15.0) < 3.0


@pytest.mark.parametrize('engine', ['native', 'reference', 'dap'])
def test_what_was_ended_before_it_began_does_not_begin(engine):
    stop = Stop()
    stop.set('nobody wants it')
    with pytest.raises(RenderStopped, match='nobody'):
        render(hall_of_mirrors(), default_camera(32), engine=engine, stop=stop, levels=64)
