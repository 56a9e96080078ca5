"""The shape of the house: what may import what, and what must work without ROS (DESIGN section 2)."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ('msgs_py', 'dap_emulator', 'csg_renderer', 'stereo_recovery', 'model_matcher')
# package: those it may import
BELOW = {
    'msgs_py': (), 'dap_emulator': ('msgs_py',), 'csg_renderer': ('msgs_py', 'dap_emulator'),
    'stereo_recovery': ('msgs_py',), 'model_matcher': ('msgs_py', 'dap_emulator', 'csg_renderer'),
}
# The closed-form harness joins the two halves of the graph; nothing else may.
JOINS = ('closed_form', 'real_pair')
ROS = ('rclpy', 'sensor_msgs', 'geometry_msgs', 'std_msgs', 'std_srvs', 'diagnostic_msgs', 'visualization_msgs',
       'rcl_interfaces', 'builtin_interfaces')


def sources(package: str) -> list[Path]:
    """Modules; launch files are data (test_launch.py looks after them)."""
    return sorted(path for path in (ROOT / 'src' / package / package).rglob('*.py')
                  if not path.name.endswith('.launch.py'))


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT / 'src').with_suffix('').parts[1:]
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.split('.')[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found.add(node.module.split('.')[0])
    return found


def may_use_ros(path: Path) -> bool:
    return path.stem in ('node', 'runtime', 'client') or 'codecs' in path.parts


@pytest.mark.parametrize('package', PACKAGES)
def test_no_import_goes_against_the_layers(package):
    for path in sources(package):
        allowed = {package, *BELOW[package]}
        if package == 'model_matcher' and path.stem.startswith(JOINS):
            allowed |= {'stereo_recovery'}
        against = imports(path) & set(PACKAGES) - allowed
        assert not against, f'{path.relative_to(ROOT)} imports {against}'


def test_every_pure_module_imports_with_ros_blocked():
    modules = [module_name(path) for package in PACKAGES for path in sources(package) if not may_use_ros(path)]
    code = (
        'import importlib, sys\n'
        'class Blocked:\n'
        '    def find_spec(self, name, path=None, target=None):\n'
        f'        if name.split(".")[0] in {ROS!r}:\n'
        '            raise ImportError(f"{name} is blocked")\n'
        'sys.meta_path.insert(0, Blocked())\n'
        f'for name in {modules!r}:\n'
        '    importlib.import_module(name)\n')
    result = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=50, check=False)
    assert result.returncode == 0, result.stderr[-2000:]


@pytest.mark.parametrize('package', PACKAGES)
def test_no_file_is_over_500_lines(package):
    long = {str(path.relative_to(ROOT)): n for path in sources(package)
            if (n := len(path.read_text().splitlines())) > 500}
    assert not long


@pytest.mark.parametrize('package', PACKAGES)
def test_every_import_has_a_dependency_in_package_xml(package):
    keys = set(re.findall(r'<(?:exec_)?depend>([\w-]+)</', (ROOT / 'src' / package / 'package.xml').read_text()))
    names = {'cv2': 'python3-opencv', 'yaml': 'python3-yaml', 'lark': 'python3-lark-parser', 'PIL': 'python3-pil'}
    for path in sources(package):
        for name in imports(path) - set(sys.stdlib_module_names) - {package}:
            # trimesh and manifold3d have no rosdep key in Ubuntu: optional, and absent is reported by name.
            if name in ('trimesh', 'manifold3d', 'networkx', 'dask', 'distributed'):
                continue
            key = names.get(name, name if name in PACKAGES or name in ROS else f'python3-{name}')
            assert key in keys, f'{path.relative_to(ROOT)} imports {name}, package.xml lacks {key}'


@pytest.mark.parametrize('package', PACKAGES)
def test_packages_stand_where_ros_looks(package):
    folder = ROOT / 'src' / package
    assert (folder / 'resource' / package).exists() and (folder / package / 'py.typed').exists()
    assert f'$base/lib/{package}' in (folder / 'setup.cfg').read_text()
    assert '<build_type>ament_python</build_type>' in (folder / 'package.xml').read_text()
