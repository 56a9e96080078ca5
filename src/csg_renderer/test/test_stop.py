"""A rendering that would take for ever is ended from another thread, by every engine, in a moment."""

import itertools
import threading
import time

import numpy as np
import pytest

from csg_renderer import Light, Scene, Solid, Surface, render, render_stereo
from csg_renderer.raycast.render import default_camera
from csg_renderer.raycast.stop import RenderStopped, Stop
from msgs_py import Pose


def hall_of_mirrors() -> Scene:
    """Mirroring glass balls all around the camera: every ray becomes two, sixty-four times."""
    places = [place for place in itertools.product((-0.5, -0.25, 0.0, 0.25, 0.5), repeat=3) if any(place)]
    balls = [
        Solid.sphere(0.12).painted(Surface(reflection=0.5, transparency=0.5)).transformed(Pose(np.eye(3), place))
        for place in places
    ]
    return Scene(balls, [Light((0, -1, 0))])


@pytest.mark.parametrize('engine', ['native', 'reference', 'dap'])
@pytest.mark.parametrize(
    'options',
    [{'levels': 64}, {'levels': 64, 'antialias': 16, 'shadows': True}, {'levels': 40, 'antialias': 1, 'tiling': False}],
)
def test_what_would_take_for_ever_is_ended_at_once(engine, options):
    scene, stop, ended = hall_of_mirrors(), Stop(), []
    if engine == 'native':
        render(scene, default_camera(16), **{**options, 'levels': 2})  # compiled before

    def work():
        with pytest.raises(RenderStopped, match='it takes too long'):
            render_stereo(scene, engine=engine, stop=stop, **options)
        ended.append(time.monotonic())

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(0.5)
    assert thread.is_alive()
    stop.set('it takes too long')
    asked = time.monotonic()
    thread.join(5.0)
    assert ended and ended[0] - asked < 1.0


@pytest.mark.parametrize('engine', ['native', 'reference', 'dap'])
def test_what_was_ended_before_it_began_does_not_begin(engine):
    stop = Stop()
    stop.set('nobody wants it')
    with pytest.raises(RenderStopped, match='nobody'):
        render(hall_of_mirrors(), default_camera(32), engine=engine, stop=stop, levels=64)
