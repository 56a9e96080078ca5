"""The pages say what the code does: tables, examples, links, pictures."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import csg_renderer
import model_matcher
import stereo_recovery
from msgs_py.numeric import settings as shared_settings
from stereo_recovery import settings as root_settings
from stereo_recovery.edges import settings as edge_settings
from stereo_recovery.estimation import settings as estimation_settings
from stereo_recovery.matching import settings as matching_settings

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / 'test' / 'docs'
PAGES = [
    *sorted(ROOT.glob('*.md')),
    *sorted((ROOT / 'src').glob('*/README.md')),
    *sorted((ROOT / 'src').glob('*/docs/*.md')),
    ROOT / 'test' / 'README.md',
]
EXAMPLE = ROOT / 'src' / 'model_matcher' / 'docs'


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf'^```{language}\n(.*?)^```', page.read_text(encoding='utf-8'), re.MULTILINE | re.DOTALL)


def test_tables_and_parameter_files_are_what_the_code_says():
    result = subprocess.run(
        [sys.executable, str(DOCS / 'generate.py'), '--check'], capture_output=True, text=True, timeout=50, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr[-2000:] + '\nrun python test/docs/generate.py'


LINK = re.compile(r'\]\(([^)#:]+)\)')


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for target in LINK.findall(page.read_text(encoding='utf-8')):
        assert (page.parent / target).exists(), target


def test_pages_have_links_and_examples():
    """What the tests about each page look for is there to be found."""
    texts = [page.read_text(encoding='utf-8') for page in PAGES]
    assert len(PAGES) > 12 and sum(len(LINK.findall(text)) for text in texts) > 60
    assert sum(len(blocks(page, 'python')) for page in PAGES) > 8


def test_the_tests_that_the_list_of_promises_names_exist():
    page = (ROOT / 'test' / 'README.md').read_text(encoding='utf-8')
    tests = {
        name
        for path in [*(ROOT / 'test').glob('test_*.py'), *(ROOT / 'src').glob('*/test/test_*.py')]
        for name in re.findall(r'def (test_\w+)', path.read_text(encoding='utf-8'))
    }
    named = set(re.findall(r'`(test_\w+)`', page))
    assert len(named) > 30 and named <= tests, named - tests
    assert all((ROOT / 'test' / path).exists() for path in re.findall(r'`(\w+/\w+\.py)`', page))


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_examples_compile_and_import_what_exists(page):
    for block in blocks(page, 'python'):
        compile(block, str(page), 'exec')
        imports = [line for line in block.splitlines() if line.startswith(('import ', 'from '))]
        exec('\n'.join(imports), {})


def test_the_page_of_the_method_quotes_the_settings():
    page = (ROOT / 'src/stereo_recovery/docs/method.md').read_text(encoding='utf-8')
    quoted = re.findall(r'`([A-Z][A-Z_]+) = (-?[\d.]+)`', page)
    assert len(quoted) > 40
    for name, number in quoted:
        values = [
            getattr(room, name)
            for room in (root_settings, matching_settings, estimation_settings, edge_settings, shared_settings)
            if hasattr(room, name)
        ]
        assert float(number) in values, f'{name}: the page says {number}, the settings {values}'


def test_the_example_of_the_types_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(blocks(ROOT / 'src/msgs_py/README.md', 'python')[0], names)
    assert np.allclose(names['moved'].end, [[0, 0.1, 0.5]]) and (tmp_path / 'edges.npz').exists()


def test_the_example_node_is_a_node(graph, monkeypatch):
    example = ModuleType('example')
    monkeypatch.setitem(sys.modules, 'example', example)  # dataclasses look their module up
    exec(blocks(ROOT / 'src/msgs_py/README.md', 'python')[1], example.__dict__)
    node = graph.add(example.CounterNode)
    assert node.config.min_length == 0.01


def test_the_worked_example_finds_its_part():
    page = (ROOT / 'src/model_matcher/README.md').read_text(encoding='utf-8')
    assert (EXAMPLE / 'bracket.csg').read_text() in page, 'the page shows the file'
    scene = csg_renderer.load_scene(EXAMPLE / 'bracket_scene.csg')
    rig = csg_renderer.default_rig(scene)
    left, right = csg_renderer.render_stereo(scene, rig, antialias=4)
    recovery = stereo_recovery.recover(left.image, right.image, rig)
    features = csg_renderer.model_features(csg_renderer.load_models(EXAMPLE / 'bracket.csg')['bracket'])
    best = model_matcher.match(features, recovery.features).interpretations[0]
    error = scene.camera_T_scene.compose(scene.placements[0].pose).error_to(best.pose)
    assert error.rotation_deg < 0.2 and error.translation < 5e-4


def test_pictures_are_drawn_by_their_command(tmp_path):
    subprocess.run(
        [sys.executable, str(DOCS / 'pictures.py'), '--out', str(tmp_path)], check=True, timeout=50, capture_output=True
    )
    drawn = {path.name for path in tmp_path.glob('*.png')}
    shown = {
        Path(target).name
        for page in PAGES
        for target in re.findall(r'!\[[^\]]*\]\(([^)]+)\)', page.read_text(encoding='utf-8'))
    }
    assert drawn and drawn <= shown
