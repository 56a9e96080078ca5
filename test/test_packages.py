"""What a package says of itself agrees with what it is."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from configparser import ConfigParser
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ('msgs_py', 'dap_emulator', 'csg_renderer', 'stereo_recovery', 'model_matcher')


def manifest(package: str) -> ElementTree.Element:
    return ElementTree.parse(ROOT / 'src' / package / 'package.xml').getroot()


def settings(package: str) -> ConfigParser:
    """setup.cfg, which holds all that setup.py could say."""
    read = ConfigParser(interpolation=None)
    read.read(ROOT / 'src' / package / 'setup.cfg')
    return read


@pytest.mark.parametrize('package', PACKAGES)
def test_the_manifest_is_complete_and_agrees_with_setup(package):
    root, setup = manifest(package), settings(package)
    assert root.get('format') == '3' and root.findtext('name') == package == setup['metadata']['name']
    for key in ('version', 'license', 'maintainer'):
        assert root.findtext(key) == setup['metadata'][key]
    assert root.find('maintainer').get('email') == setup['metadata']['maintainer_email']
    assert root.findtext('description').strip() and root.findtext('export/build_type') == 'ament_python'
    assert 'pytest' in setup['options.extras_require']['test'], 'so that colcon test runs pytest'


@pytest.mark.parametrize('package', PACKAGES)
def test_dependencies_are_listed_once(package):
    keys = [element.text for element in manifest(package) if element.tag.endswith('depend')]
    runtime = [key for key in keys if not key.startswith('python3-pytest')]
    assert len(set(runtime)) == len(runtime)


@pytest.mark.parametrize('package', PACKAGES)
def test_the_changelog_ends_with_this_version(package):
    text = (ROOT / 'src' / package / 'CHANGELOG.rst').read_text()
    newest = re.search(r'^(\d+\.\d+\.\d+) \(', text, re.MULTILINE)
    assert newest and newest.group(1) == manifest(package).findtext('version')
    assert f'Changelog for package {package}' in text


@pytest.mark.parametrize('package', PACKAGES)
def test_every_folder_of_data_is_installed(package):
    """What is not Python and not named in setup.cfg would be missing from a wheel or from share/."""
    folder = ROOT / 'src' / package / package
    setup = settings(package)
    packed = {line.removesuffix('/*') for line in setup['options.package_data'][package].split() if line.endswith('/*')}
    shared = {
        key.removeprefix(f'share/{package}/')
        for key in setup['options.data_files']
        if key.startswith(f'share/{package}/')
    }
    kept = ('.py', '.pyi', '.lark', '.html', '.css', '.js', '.typed', '.pyc')
    found = {
        str(path.parent.relative_to(folder))
        for path in folder.rglob('*')
        if path.is_file()
        and not path.name.endswith(kept)
        and '__pycache__' not in path.parts
        or path.name.endswith('.launch.py')
    }
    assert found <= packed == shared, f'not in setup.cfg: {found - (packed & shared)}'
    assert all((folder / item).is_dir() for item in packed)


@pytest.mark.parametrize(
    ('name', 'package'),
    [
        ('emulator_node', 'dap_emulator'),
        ('renderer_node', 'csg_renderer'),
        ('recovery_node', 'stereo_recovery'),
        ('matcher_node', 'model_matcher'),
    ],
)
@pytest.mark.parametrize(('given', 'threads'), [(None, '1'), ('2', '2')])
def test_an_executable_starts_its_node_with_one_blas_thread_unless_told_otherwise(name, package, given, threads):
    assert f'{name} = graph_executables:{name}' in settings(package)['options.entry_points']['console_scripts']
    code = (
        f'import os, sys, types, graph_executables\n'
        'assert "numpy" not in sys.modules, "too late to say how many threads"\n'
        f'node = sys.modules["{package}.node"] = types.ModuleType("node")\n'
        f'node.main = lambda: int(os.environ["OPENBLAS_NUM_THREADS"])\n'
        f'sys.modules["{package}"] = types.ModuleType("{package}")\n'
        f'sys.exit(graph_executables.{name}())'
    )
    environment = {key: value for key, value in os.environ.items() if key != 'OPENBLAS_NUM_THREADS'}
    if given is not None:
        environment['OPENBLAS_NUM_THREADS'] = given
    result = subprocess.run([sys.executable, '-c', code], env=environment, timeout=30, check=False)
    assert result.returncode == int(threads)
