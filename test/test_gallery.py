"""The page of scenes is what the script writes."""

import importlib.util
from pathlib import Path

import pytest

from csg_renderer import scene_names

HERE = Path(__file__).resolve().parent
DOCS = HERE.parent / 'src' / 'csg_renderer' / 'docs'


def script(name):
    """A module of test/docs, which is a folder of scripts and no package."""
    spec = importlib.util.spec_from_file_location(name, HERE / 'docs' / f'{name}.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope='module')
def gallery():
    return script('gallery')


def test_the_table_is_up_to_date(gallery):
    assert (DOCS / 'scenes.md').read_text(encoding='utf-8') == gallery.page()


def test_every_scene_of_the_package_is_on_the_page(gallery):
    named = {*gallery.MODELS, *gallery.VIEWS, *gallery.SCENES, *gallery.TERRAINS, *gallery.SURFACES}
    assert set(scene_names()) == named


def test_pictures_are_written(gallery, tmp_path, monkeypatch):
    monkeypatch.setattr(gallery, 'VIEWS', {'l_shape_v1': (15, 0, 0)})
    monkeypatch.setattr(gallery, 'SCENES', {name: gallery.SCENES[name] for name in ('coverplate',)})
    monkeypatch.setattr(gallery, 'SURFACES', ('carton',))
    blurred = {'samples': 1, 'aperture': 0.02, 'focus': 0.4, 'motion': ([0.01, 0, 0], [0, 0, 0]), 'pinholes': 2}
    monkeypatch.setattr(gallery, 'EXPOSURES', {'blurred': blurred})
    assert gallery.main([str(tmp_path), '--size', '64']) == 0
    assert {path.name for path in tmp_path.iterdir()} == {
        'scenes.md',
        'test_models.png',
        'large_scenes.png',
        'terrain.png',
        'surfaces.png',
        'exposure.png',
    }


def test_pictures_of_cameras_are_written(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(HERE / 'docs'))
    cameras = script('camera_pictures')
    monkeypatch.setattr(cameras, 'SCENE', 'l_shape_v1')
    assert cameras.main([str(tmp_path), '--size', '60']) == 0
    assert {path.name for path in tmp_path.iterdir()} == {'sensor.png', 'lenses.png'}
