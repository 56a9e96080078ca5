"""The shape of the house: what may import what, package by package and room by room, and what must work without ROS."""

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
    'msgs_py': (),
    'dap_emulator': ('msgs_py',),
    'csg_renderer': ('msgs_py', 'dap_emulator'),
    'stereo_recovery': ('msgs_py',),
    'model_matcher': ('msgs_py', 'dap_emulator', 'csg_renderer'),
}
# The closed-form harness and the match command join the two halves of the graph; nothing else may.
JOINS = ('closed_form', 'pair_match.py', 'match_cli.py', 'completion.py')
# Rooms from the lowest to the highest: a module imports from its own room and from those before it. Modules at the root
# of a package stand in the list by name where a room imports them; all others are after the last room.
ROOMS = {
    'msgs_py': (
        'numeric',
        'settings',
        '_checks',
        'files',
        'pose',
        'camera',
        'camera_rig',
        'lens',
        'features',
        'interpretation',
        'shapes',
        'codecs',
        'node_runtime',
    ),
    'dap_emulator': ('bit_planes', 'machine', 'fortran_plus', 'service', 'watch'),
    'csg_renderer': ('mesh', 'scene', 'brep', 'language', 'visibility', 'features', 'raycast'),
    'stereo_recovery': ('params', 'stopwatch', 'cameras', 'detection', 'matching', 'curves', 'estimation', 'edges'),
    'model_matcher': (
        'geometry',
        'image_pose',
        'params',
        'settings',
        'model',
        'verification',
        'tracking',
        'interpretation_tree',
        'search',
        'batches',
        'catalogue',
        'proof',
        'drawing',
        'pipeline',
        'instances',
        'viewing',
        'node_views',
        'node_answers',
        'model_node',
        'answering_node',
        'node',
        'merger_node',
        'tracker_node',
        'viewer_node',
        'pair_match',
        'match_cli',
        'index_cli',
        'closed_form',
    ),
}
# Rooms inside a room that belong to one module of it: nothing else, and no room beside them, imports them.
OWNERS = {'csg_renderer.raycast.array_machine': 'csg_renderer.raycast.engine_dap'}
ROS = (
    'rclpy',
    'sensor_msgs',
    'geometry_msgs',
    'shape_msgs',
    'std_msgs',
    'std_srvs',
    'diagnostic_msgs',
    'visualization_msgs',
    'rcl_interfaces',
    'builtin_interfaces',
)


def sources(package: str) -> list[Path]:
    """Modules; launch files are data (test_launch.py looks after them)."""
    return sorted(
        path for path in (ROOT / 'src' / package / package).rglob('*.py') if not path.name.endswith('.launch.py')
    )


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


# Modules outside of the codecs that know ROS.
ROS_MODULES = (
    'node',
    'node_views',
    'node_answers',
    'model_node',
    'answering_node',
    'merger_node',
    'tracker_node',
    'viewer_node',
    'bpc_node',
    'bpc_requests',
    'recognise_node',
    'runtime',
    'beside',
    'camera_input',
    'managed',
    'inbox',
    'hand_over',
    'adapted',
    'service_link',
    'parameter_values',
    'run_graph',
    'run_sequence',
    'replay',
    'recorder',
)


def may_use_ros(path: Path) -> bool:
    return path.stem in ROS_MODULES or 'codecs' in path.parts


def inner_imports(path: Path, package: str) -> set[str]:
    """Dotted names, below the package, of what a module imports from its own package, inside functions too."""
    here = module_name(path).split('.')
    folder = here if path.name == '__init__.py' else here[:-1]
    modules = {module_name(other) for other in sources(package)}
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.ImportFrom):
            continue
        if node.level:
            base = '.'.join([*folder[: len(folder) - node.level + 1], *([node.module] if node.module else [])])
        elif node.module and node.module.split('.')[0] == package:
            base = node.module
        else:
            continue
        found |= {f'{base}.{alias.name}' if f'{base}.{alias.name}' in modules else base for alias in node.names}
    return found - {'.'.join(here)}


def room_number(module: str, package: str) -> int:
    """Place of a module in the order of rooms; what is not named comes after all."""
    first = module.split('.')[1] if '.' in module else ''
    return ROOMS[package].index(first) if first in ROOMS[package] else len(ROOMS[package])


def circles(graph: dict[str, set[str]]) -> list[str]:
    """Modules that import one another, each circle as its path."""
    done: set[str] = set()
    found: list[str] = []

    def visit(module: str, way: list[str]) -> None:
        if module in way:
            found.append(' -> '.join([*way[way.index(module) :], module]))
        elif module not in done:
            for other in sorted(graph.get(module, ())):
                visit(other, [*way, module])
            done.add(module)

    for module in sorted(graph):
        visit(module, [])
    return found


@pytest.mark.parametrize('package', PACKAGES)
def test_every_package_has_modules_that_import_others(package):
    """What the tests below go through is there."""
    assert len(sources(package)) > 20 and any(inner_imports(path, package) for path in sources(package))


@pytest.mark.parametrize('package', PACKAGES)
def test_no_import_goes_against_the_layers(package):
    for path in sources(package):
        allowed = {package, *BELOW[package]}
        if package == 'model_matcher' and set(path.parts) & set(JOINS):
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
        '    importlib.import_module(name)\n'
    )
    result = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=50, check=False)
    assert result.returncode == 0, result.stderr[-2000:]


@pytest.mark.parametrize('package', PACKAGES)
def test_no_room_imports_a_later_one(package):
    against = [
        f'{module_name(path)} imports {other}'
        for path in sources(package)
        if path.name != '__init__.py'
        for other in inner_imports(path, package)
        if room_number(other, package) > room_number(module_name(path), package)
    ]
    assert not against, '\n'.join(against)


@pytest.mark.parametrize(('room', 'owner'), OWNERS.items())
def test_a_room_that_belongs_to_one_module_is_imported_by_it_alone(room, owner):
    package = room.split('.')[0]
    users = {
        module_name(path)
        for path in sources(package)
        if any(f'{other}.'.startswith(f'{room}.') for other in inner_imports(path, package))
    }
    outside = {user for user in users if not f'{user}.'.startswith(f'{room}.')}
    assert outside == {owner}, f'{room} is imported by {sorted(outside)}'


@pytest.mark.parametrize('package', PACKAGES)
def test_no_imports_run_in_a_circle(package):
    """Inside functions and for annotations too; the face of a package or room may import its own modules."""
    graph = {module_name(path): inner_imports(path, package) for path in sources(package) if path.name != '__init__.py'}
    found = circles(graph)
    assert not found, '\n'.join(found)


@pytest.mark.parametrize('package', PACKAGES)
def test_every_room_says_in_one_sentence_what_it_is_for(package):
    for folder in {path.parent for path in sources(package)}:
        words = ast.get_docstring(ast.parse((folder / '__init__.py').read_text()))
        assert words and words.splitlines()[0].endswith('.'), f'{folder.relative_to(ROOT)}/__init__.py'


@pytest.mark.parametrize('package', PACKAGES)
def test_every_import_has_a_dependency_in_package_xml(package):
    keys = set(re.findall(r'<(?:exec_)?depend>([\w-]+)</', (ROOT / 'src' / package / 'package.xml').read_text()))
    names = {'cv2': 'python3-opencv', 'yaml': 'python3-yaml', 'lark': 'python3-lark-parser', 'PIL': 'python3-pil'}
    for path in sources(package):
        for name in imports(path) - set(sys.stdlib_module_names) - {package}:
            # These have no rosdep key in Ubuntu: optional, and absent is reported by name.
            if name in ('trimesh', 'manifold3d', 'networkx', 'dask', 'distributed', 'rosbags', 'mcap'):
                continue
            key = names.get(name, name if name in PACKAGES or name in ROS else f'python3-{name}')
            assert key in keys, f'{path.relative_to(ROOT)} imports {name}, package.xml lacks {key}'


@pytest.mark.parametrize('package', PACKAGES)
def test_packages_stand_where_ros_looks(package):
    folder = ROOT / 'src' / package
    assert (folder / 'resource' / package).exists() and (folder / package / 'py.typed').exists()
    assert f'$base/lib/{package}' in (folder / 'setup.cfg').read_text()
    assert '<build_type>ament_python</build_type>' in (folder / 'package.xml').read_text()
