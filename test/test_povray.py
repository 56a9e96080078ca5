"""Our images beside POV-Ray's, an independent exact CSG ray tracer; skipped where it is not installed."""

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

from csg_renderer import Light, Scene, Solid, Surface, default_camera
from msgs_py import Pose

pytestmark = pytest.mark.skipif(shutil.which('povray') is None, reason='povray is not installed')

SURFACE = Surface((0.8, 0.5, 0.4), specular=0.4, diffuse=0.6, ambient=0.5, shininess=15)
LIGHTS = [Light((0.3, -0.3, 0)), Light((-1, 0.2, 0.1), (0.3, 0.5, 0.4))]


@pytest.fixture(scope='module')
def povray():
    path = Path(__file__).parent / 'benchmarks' / 'povray.py'
    spec = importlib.util.spec_from_file_location('povray', path)
    module = importlib.util.module_from_spec(spec)
    import sys

    sys.modules['povray'] = module
    spec.loader.exec_module(module)
    return module


def random_solid(rng):
    """Every primitive under rotation, mirror and shear, and every operator."""

    def leaf(kind):
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        matrix = np.eye(4)
        matrix[:3, :3] = q @ np.diag(rng.uniform(0.03, 0.09, 3)) @ (np.eye(3) + 0.2 * rng.normal(size=(3, 3)))
        matrix[:3, 3] = 0.03 * rng.normal(size=3)
        return Solid.primitive(kind, matrix)

    solid = leaf('BLOCK') | leaf('CYLINDER')
    solid = (solid - leaf('SPHERE')) | (leaf('CONE') & leaf('SPHERE'))
    return (solid | leaf('CYLINDER') - leaf('CONE') - leaf('BLOCK')).painted(SURFACE)


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_silhouette_ids_depth_normals_and_light_agree(povray, seed):
    rng = np.random.default_rng(seed)
    scene = Scene([random_solid(rng).transformed(Pose(np.eye(3), [0, 0, 0.4]))], LIGHTS)
    result = povray.compare(scene, default_camera(256))
    assert result.ids <= 2
    assert result.depth <= 1e-4 and result.normal_deg <= 0.05
    assert result.shade_p99 <= 1.0 and result.shade <= 2.0
