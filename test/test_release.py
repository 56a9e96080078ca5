"""What a release needs: wheels, metadata, keys of the distribution, declarations, and the files of containers."""

from __future__ import annotations

import ast
import importlib.util
import json
import re
import subprocess
import sys
import zipfile
from configparser import ConfigParser
from email import message_from_string
from email.message import Message
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
RELEASE = ROOT / 'test' / 'release'


def script(name: str, folder: Path = RELEASE) -> ModuleType:
    """A script of test/release, or of another folder, as a module."""
    spec = importlib.util.spec_from_file_location(name, folder / f'{name}.py')
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


wheels, extract = script('wheels'), script('extract')
PACKAGES: tuple[str, ...] = wheels.PACKAGES


class Wheel:
    """A built wheel: what it holds, its metadata and its executables."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with zipfile.ZipFile(path) as archive:
            self.names = set(archive.namelist())
            self.information = next(name for name in self.names if name.endswith('.dist-info/METADATA'))[:-8]
            self.metadata: Message = message_from_string(archive.read(self.information + 'METADATA').decode())
            listed = self.information + 'entry_points.txt'
            entries = ConfigParser()
            entries.read_string(archive.read(listed).decode() if listed in self.names else '')
            self.executables = dict(entries['console_scripts']) if entries.has_section('console_scripts') else {}
            self.licences = [archive.read(name).decode() for name in self.names if name.endswith('LICENSE')]


def settings(package: str) -> ConfigParser:
    read = ConfigParser(interpolation=None)
    read.read(ROOT / 'src' / package / 'setup.cfg')
    return read


def manifest(package: str) -> ElementTree.Element:
    return ElementTree.parse(ROOT / 'src' / package / 'package.xml').getroot()


def name_of(requirement: str) -> str:
    """The distribution that a requirement is of, spelt in one way."""
    return re.split(r'[ <>=;\[]', requirement)[0].replace('-', '_').lower()


def hold_every_module_and_all_data(built: dict[str, Wheel]) -> None:
    for package, wheel in built.items():
        source = ROOT / 'src' / package
        expected = {
            str(path.relative_to(source))
            for path in (source / package).rglob('*')
            if path.is_file() and '__pycache__' not in path.parts
        }
        expected |= {path.name for path in source.glob('*.py') if path.name != 'setup.py'}
        assert expected <= wheel.names, f'missing: {sorted(expected - wheel.names)}'
        assert f'{package}/py.typed' in wheel.names
        assert any(name.endswith(f'share/{package}/package.xml') for name in wheel.names)
        assert not any('/test/' in name or name.startswith('test') for name in wheel.names)


def say_what_they_are_and_what_they_need(built: dict[str, Wheel]) -> None:
    for package, wheel in built.items():
        told, setup = wheel.metadata, settings(package)
        assert (told['Name'].replace('-', '_'), told['Version']) == (package, manifest(package).findtext('version'))
        assert told['License'] == 'Apache-2.0' and told['Requires-Python'] == '>=3.10' and told['Summary']
        assert told['Description-Content-Type'] == 'text/markdown' and len(told.get_payload()) > 1000
        assert wheel.licences == [(ROOT / 'LICENSE').read_text()]
        needed = [line for line in told.get_all('Requires-Dist') if 'extra' not in line]
        assert set(map(name_of, needed)) == set(map(name_of, setup['options']['install_requires'].split()))


def work_without_the_sources(built: dict[str, Wheel], folder: Path) -> None:
    """Installed beside the libraries that are here, in a folder of their own; nothing of the clone is on the path."""
    target = folder / 'installed'
    options = ['--quiet', '--no-deps', '--no-index', '--no-compile', '--disable-pip-version-check']
    files = [str(wheel.path) for wheel in built.values()]
    subprocess.run(
        [sys.executable, '-m', 'pip', 'install', *options, '--target', str(target), *files], check=True, timeout=60
    )
    code = (
        'import sys\n'
        f'sys.path.insert(0, {str(target)!r})\n'
        'from importlib.metadata import distribution\n'
        'import csg_renderer, dap_emulator, graph_executables\n'
        f'for name in {PACKAGES!r}:\n'
        '    for entry in distribution(name).entry_points:\n'
        '        assert callable(entry.load()), entry\n'
        f'    assert sys.modules[name].__file__.startswith({str(target)!r}), sys.modules[name].__file__\n'
        "print(csg_renderer.load_scene(csg_renderer.scene_path('l_shape_v1')).placements[0].name)\n"
    )
    done = subprocess.run(
        [sys.executable, '-c', code], cwd=folder, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    for package, wheel in built.items():
        declared = settings(package)
        lines = declared['options.entry_points']['console_scripts'] if 'options.entry_points' in declared else ''
        assert wheel.executables == dict(re.findall(r'^(\w+) = (\S+)$', lines, re.MULTILINE))


def test_the_wheels_are_whole(tmp_path):
    """One test, so that they are built once."""
    built = {package: Wheel(wheels.build(package, tmp_path / 'wheels')) for package in PACKAGES}
    hold_every_module_and_all_data(built)
    say_what_they_are_and_what_they_need(built)
    work_without_the_sources(built, tmp_path)


def test_what_pip_installs_is_what_the_project_was_tested_with():
    bounds = (ROOT / 'requirements-libraries.txt').read_text().splitlines()
    for package in PACKAGES:
        setup = settings(package)
        asked = setup['options']['install_requires'].split()
        for extra in ('bags', 'mesh', 'view', 'dask'):
            asked += setup['options.extras_require'].get(extra, '').split()
        # lark comes with rosidl, under its old name, or from the system; manifold3d is taken as it is.
        own = [line for line in asked if line not in PACKAGES and not line.startswith('lark-parser')]
        assert set(own) <= set(bounds), f'{package}: {set(own) - set(bounds)}'


# --- keys of the distribution

# What is imported, and the key that brings it, where that is not the module's own name.
KEYS = {'cv2': 'python3-opencv', 'yaml': 'python3-yaml', 'lark': 'python3-lark-parser'} | {
    name: f'python3-{name}' for name in ('numpy', 'scipy', 'numba', 'matplotlib', 'tqdm')
}
# Imported where they are present; a message package has a key all the same.
OPTIONAL_MESSAGES = {'msgs_py': {'vision_msgs', 'tf2_msgs', 'moveit_msgs'}}
# Imported where they are present, and without a key that a released package may name.
WITHOUT_KEY = {'trimesh', 'rosbags', 'mcap', 'distributed', 'plotly', 'manifold3d'}


def imported(package: str) -> set[str]:
    """The modules of others that a package imports, at any depth."""
    found: set[str] = set()
    folder = ROOT / 'src' / package
    for path in [*(folder / package).rglob('*.py'), *folder.glob('graph_*.py')]:
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                found |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                found.add(node.module.split('.')[0])
    return found - set(sys.stdlib_module_names) - {package}


def keys_of(package: str) -> set[str]:
    return {str(element.text) for element in manifest(package).findall('exec_depend')}


@pytest.mark.parametrize('package', PACKAGES)
def test_the_manifest_names_what_is_imported_and_nothing_else(package):
    wanted = {KEYS.get(name, name) for name in imported(package) - WITHOUT_KEY} | OPTIONAL_MESSAGES.get(package, set())
    # Every package has a node, if not a module that speaks with rclpy itself.
    assert keys_of(package) == wanted | {'rclpy'}


@pytest.mark.parametrize('package', PACKAGES)
def test_pip_and_rosdep_bring_the_same_libraries(package):
    names = {'opencv-python-headless': 'python3-opencv', 'PyYAML': 'python3-yaml'}
    asked = [re.split('[<>=]', line)[0] for line in settings(package)['options']['install_requires'].split()]
    wanted = {key for key in keys_of(package) if key.startswith('python3-') or key in PACKAGES}
    assert {names.get(name, name if name in PACKAGES else f'python3-{name}') for name in asked} == wanted


def test_every_key_stands_in_the_distribution():
    distribution = yaml.safe_load((RELEASE / 'rosdistro/jazzy/distribution.yaml').read_text())
    released = {name for entry in distribution['repositories'].values() for name in entry['release']['packages']}
    system = yaml.safe_load((RELEASE / 'rosdistro/rosdep/python.yaml').read_text())
    keys = set(extract.keys())
    assert keys <= released | set(system), f'not in the extract: {keys - released - set(system)}; see extract.py'
    assert released | set(system) <= keys | set(extract.OF_BLOOM), 'only what is used is stored'
    for key, rules in system.items():
        rule = (
            rules['ubuntu']
            if isinstance(rules['ubuntu'], list)
            else rules['ubuntu'].get('noble', rules['ubuntu'].get('*'))
        )
        assert isinstance(rule, list), f'{key}: no package of Ubuntu 24.04 (pip keys are refused in a release)'


def test_what_has_no_key_is_named_with_the_reason():
    table = (ROOT / 'README.md').read_text(encoding='utf-8').split('## Dependencies')[1].split('\n## ')[0]
    rows = [[cell.strip() for cell in line.split('|')[1:-1]] for line in table.splitlines() if line.startswith('|')]
    named = {re.sub(r'^dask\.', '', name): key for names, key, _ in rows for name in names.split(', ')}
    assert all(named[name].startswith('none (') for name in WITHOUT_KEY)
    assert {name for package in PACKAGES for name in imported(package)} - {
        *KEYS,
        *PACKAGES,
        *extract.keys(),
    } <= WITHOUT_KEY


# --- declarations of quality

HEADINGS = (
    'Version policy [1]',
    'Change control process [2]',
    'Documentation [3]',
    'Testing [4]',
    'Dependencies [5]',
    'Platform support [6]',
    'Security [7]',
)


@pytest.mark.parametrize('package', PACKAGES)
def test_the_declaration_of_quality_answers_every_heading(package):
    page = (ROOT / 'src' / package / 'QUALITY_DECLARATION.md').read_text(encoding='utf-8')
    assert f'`{package}` claims **Quality Level ' in page.replace('\n', ' ')
    assert tuple(re.findall(r'^## (.*)$', page, re.MULTILINE)) == HEADINGS
    assert all(len(part.strip()) > 50 for part in re.split(r'^## .*$', page, flags=re.MULTILINE)[1:])
    of_ros = {key for key in keys_of(package) if not key.startswith('python3-')}
    assert of_ros <= set(re.findall(r'`(\w+)`', page)), 'a dependency is not accounted for'
    assert all((ROOT / 'src' / package / place).exists() for place in re.findall(r'\]\(([^):]+)\)', page))
    readme = (ROOT / 'src' / package / 'README.md').read_text(encoding='utf-8')
    assert '(QUALITY_DECLARATION.md)' in readme


# --- containers

container = script('container', ROOT / 'test' / 'stress')


def test_the_dockerfile_does_what_the_readme_says():
    text = (ROOT / 'Dockerfile').read_text(encoding='utf-8')
    steps = container.instructions(text)
    assert [name for name, _ in steps] == ['FROM', 'RUN', 'WORKDIR', 'COPY', 'RUN', 'ENV', 'CMD']
    (_, image), (_, packages), (_, folder), (_, copied), (_, setup), (_, path), (_, command) = steps
    assert re.fullmatch(r'debian:[a-z]+-slim', image), 'a release is named, so that a build says the same tomorrow'
    update, install, tidy = packages.split(' && ')
    assert (update, tidy) == ('apt-get update', 'rm -rf /var/lib/apt/lists/*')
    options, names = install.removeprefix('apt-get install ').split(' --yes ')
    assert options == '--no-install-recommends' and names.split() == sorted(names.split())
    readme = ' '.join((ROOT / 'README.md').read_text(encoding='utf-8').split())
    assert f'apt install {names}' in readme and setup in readme and json.loads(command) == ['make', 'demo']
    assert copied == '. .' and folder.startswith('/') and path == f'PATH={folder}/.venv/bin:$PATH'
    ignored = (ROOT / '.dockerignore').read_text().split()
    assert {'.venv', 'out', '.git'} <= set(ignored)
    needed = {'src', 'test', '.ci', 'Makefile', 'LICENSE', *(path.name for path in ROOT.glob('requirements*.txt'))}
    assert not needed & set(ignored), 'the image has what make setup and make test ask for'


def test_the_development_container_builds_on_the_dockerfile():
    file = ROOT / '.devcontainer' / 'devcontainer.json'
    told = json.loads(file.read_text(encoding='utf-8'))
    assert set(told) <= {'name', 'build', 'postCreateCommand', 'remoteEnv', 'customizations'}
    assert (file.parent / told['build']['dockerfile']).resolve() == ROOT / 'Dockerfile'
    assert (file.parent / told['build']['context']).resolve() == ROOT
    assert told['postCreateCommand'].endswith('make setup')


def test_the_steps_of_the_dockerfile_are_left_out_with_the_reason(monkeypatch):
    monkeypatch.setattr(container.os, 'geteuid', lambda: 1000)
    assert container.missing() == 'only root may make a root file system and change to it'
    monkeypatch.setattr(container.os, 'geteuid', lambda: 0)
    monkeypatch.setattr(container.shutil, 'which', lambda tool: None if tool == 'debootstrap' else f'/usr/bin/{tool}')
    assert container.missing() == 'debootstrap not installed'
