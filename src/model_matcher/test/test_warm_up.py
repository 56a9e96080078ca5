"""Whatever a search needs is compiled before its clock starts."""

import subprocess
import sys
from pathlib import Path

import pytest

# A process of its own: what other tests had compiled would hide what is missing.
PROGRAM = """
import gc
from numba.core.dispatcher import Dispatcher
from csg_renderer import Light, Scene, SolidOutline, load_known_models, load_models, model_features, render_stereo
from csg_renderer.raycast.sensor import SensorModel, grey
from model_matcher import index_model, pipeline
from model_matcher.image_pose.views import Views
from msgs_py import PinholeCamera, Pose, StereoRig


def compiled():
    ours = [one for one in gc.get_objects() if isinstance(one, Dispatcher)]
    ours = [one for one in ours if one.py_func.__module__.split('.')[0] in ('model_matcher', 'csg_renderer', 'msgs_py')]
    return {(one.py_func.__module__, one.py_func.__qualname__, str(kinds)) for one in ours for kinds in one.overloads}


before, at_start = pipeline._compile_first, set()


def compile_first(*arguments):
    before(*arguments)
    at_start.update(compiled())


solid = next(iter(load_models('NAME').values()))
shape = SolidOutline(solid)
rig = StereoRig.symmetric(PinholeCamera.centred(256, 256, 350.0), 0.8 * shape.size)
turn = Pose.from_rotation_vector([0.6, -0.5, 0.2], [0.0, 0.0, 0.0])
pose = Pose(turn.rotation, [0.0, 0.0, 4.0 * shape.size] - turn.rotation @ shape.centre)
lights = [Light((0.3, -0.5, 0.2), (0.8,) * 3), Light((-0.5, -0.2, -0.3), (0.3,) * 3)]
scene = Scene([solid.transformed(pose)], lights, (0.2,) * 3, (0.4,) * 3)
frames = [grey(frame.image) for frame in render_stereo(scene, rig)]
views = Views.of([SensorModel(0.5, 2.0, (0, eye)).apply(frame) for eye, frame in enumerate(frames)], rig)
index = index_model(model_features(solid), 'wedge', shape)
data = index.features.transformed(pose)
pipeline._compile_first = compile_first
CALL
print(bool(found), found.best.support, sorted(compiled() - at_start))
"""

MESHES = Path(__file__).parents[2] / 'csg_renderer' / 'test' / 'meshes'
MESH = f"index.shape = load_known_models('{MESHES}/plug.stl')['plug'].outline; "


@pytest.mark.parametrize(
    'call',
    [
        'found = pipeline.match(index, data, views=views)',
        MESH + 'found = pipeline.match(index, data, views=views)',
        'found = pipeline.survey([index], data, views=views)',
        'pipeline.match(index, data); found = pipeline.match(index, data, views=views)',
    ],
)
def test_the_first_search_in_images_compiles_nothing_while_its_clock_runs(call):
    program = PROGRAM.replace('CALL', call).replace('NAME', 'plug' if call.startswith(MESH) else 'wedge_v1')
    told = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, timeout=600, check=False)
    found, support, late = told.stdout.split(maxsplit=2) if told.returncode == 0 else ('', '', told.stderr)
    assert found == 'True' and late.strip() == '[]', late
    assert float(support) > 0.5
