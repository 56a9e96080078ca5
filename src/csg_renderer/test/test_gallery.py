"""The page of scenes is what the command writes."""

from pathlib import Path

from csg_renderer import gallery, scene_names

DOCS = Path(__file__).parent.parent / 'docs'


def test_the_table_is_up_to_date():
    assert (DOCS / 'scenes.md').read_text(encoding='utf-8') == gallery.page()


def test_every_scene_of_the_package_is_on_the_page():
    assert set(scene_names()) == {*gallery.MODELS, *gallery.VIEWS, *gallery.LARGE}


def test_pictures_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(gallery, 'VIEWS', {'l_shape_v1': (15, 0, 0)})
    monkeypatch.setattr(gallery, 'LARGE', {'coverplate': ('Coverplate', (25, 93))})
    assert gallery.main([str(tmp_path), '--size', '64']) == 0
    assert {path.name for path in tmp_path.iterdir()} == {'scenes.md', 'test_models.png', 'large_scenes.png'}
