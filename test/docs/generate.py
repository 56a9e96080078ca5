"""Writes what the documentation says of nodes from the nodes themselves: tables in the packages' pages, and YAML files.

    python test/docs/generate.py            # write
    python test/docs/generate.py --check    # exit code 1, naming the files, when they are not what the code says

On pages the figures that were measured are written (figures.py), in src/dap_emulator/docs/dap.md the table of
cycles counted on bit-planes.
In src/<package>/README.md everything between ``<!-- node:begin -->`` and ``<!-- node:end -->`` is written (of a second
node with another word), and in ARCHITECTURE.md the table of rooms; the rest is left alone. config/<node>.yaml is
written whole.
"""

from __future__ import annotations

import argparse
import ast
import sys
from dataclasses import dataclass
from pathlib import Path

import figures
import rclpy
import yaml
from rclpy.context import Context

from csg_renderer.node import RendererNode
from dap_emulator.machine import counted
from dap_emulator.node import EmulatorNode
from model_matcher.merger_node import MergerNode
from model_matcher.node import MatcherNode
from model_matcher.tracker_node import TrackerNode
from model_matcher.viewer_node import ViewerNode
from msgs_py.node_runtime.config import ParameterSpec
from msgs_py.node_runtime.runtime import GraphNode
from stereo_recovery.node import RecoveryNode

ROOT = Path(__file__).resolve().parents[2]
COUNTED_BEGIN, COUNTED_END = '<!-- counted:begin (written by test/docs/generate.py) -->', '<!-- counted:end -->'
ROOMS_BEGIN, ROOMS_END = '<!-- rooms:begin (written by test/docs/generate.py) -->', '<!-- rooms:end -->'

# What the code cannot say: the meaning of a topic or service. A missing or an idle entry is an error.
MEANING = {
    'left/image_rect': 'rectified left image',
    'right/image_rect': 'rectified right image',
    'left/image_raw': 'left image as the lens distorts it; on demand',
    'right/image_raw': 'right image as the lens distorts it; on demand',
    'left/camera_info': 'its calibration',
    'right/camera_info': 'its calibration; `P[0,3]` is -fx · baseline',
    'left/depth': 'camera z in metres, NaN where there is nothing; on demand',
    'ground_truth/pose': "true pose of the scene's first object but terrains, in the left camera; on demand",
    'ground_truth/features': 'what is truly visible of it; on demand',
    'features': 'recovered edges, curves and axes, one point each',
    'features/markers': 'the same for RViz; on demand',
    'debug_image': 'left image with the features drawn in; on demand',
    'interpretations': 'accepted poses, best first; empty when nothing is recognised',
    'interpretations/l_shape': 'best accepted pose of a model; one topic for each model',
    'interpretations/l_shape/with_covariance': 'the same with its 6 x 6 covariance, axes fixed, x y z before rx ry rz',
    'interpretations/report': 'one status for each hypothesis: score, assignment, reason of rejection',
    'shard_1/interpretations/report': 'what the matcher_node with shard 1/N answered; one topic for each shard',
    'shard_2/interpretations/report': 'what the matcher_node with shard 2/N answered',
    'scene_objects': 'shapes of what was recognised, as CollisionObject where moveit_msgs is installed; on demand',
    'interpretations/symmetries': 'JSON, latched: the symmetry of each model, from its features',
    'interpretations/markers': 'wire frames of what was recognised; on demand',
    'tracked/l_shape': 'pose of a followed model in every frame, with its covariance; none when it is lost',
    'tracked/report': 'one status for each model: followed or lost, support, evidence, sigmas, velocities; on demand',
    'track/l_shape': 'a pose from which to follow a model; one topic for each model',
    'image_in': 'images for the program named by `image_program`',
    'image_out': 'what the program made of them',
    '/diagnostics': 'rate, latency, drops, last error; once a second',
    '~/reset': 'forget earlier inputs and counters',
    '~/render': 'render one pair now',
    '~/store': 'write program text and arrays',
    '~/run': 'execute what was stored',
    '~/fetch': 'read arrays, counters and the trace',
    '~/list': 'programs that come with the package, as JSON',
}
# The same of a topic that a node both publishes and hears, where that differs.
HEARD = {
    '/diagnostics': 'which nodes of the graph are still compiling; their silence is no fault then',
    'interpretations/report': 'where objects were found that are not followed yet',
}
EVERY_NODE_HAS = (
    'rosout',
    'parameter_events',
    '/clock',
    'clock',
    *(
        f'~/{name}'
        for name in (
            'change_state',
            'get_state',
            'get_available_states',
            'get_available_transitions',
            'get_transition_graph',
            'get_type_description',
            'describe_parameters',
            'get_parameter_types',
            'get_parameters',
            'list_parameters',
            'set_parameters',
            'set_parameters_atomically',
        )
    ),
)


@dataclass(frozen=True)
class Documented:
    """A node, the package it is in, and its YAML file."""

    package: str
    node_class: type[GraphNode]
    parameters: dict[str, object]
    config: str
    mark: str = 'node'

    @property
    def begin(self) -> str:
        return f'<!-- {self.mark}:begin (written by test/docs/generate.py) -->'

    @property
    def end(self) -> str:
        return f'<!-- {self.mark}:end -->'

    @property
    def page(self) -> Path:
        return ROOT / 'src' / self.package / 'README.md'

    @property
    def yaml(self) -> Path:
        return ROOT / 'src' / self.package / self.package / 'config' / self.config


NODES = (
    Documented('csg_renderer', RendererNode, {'rate': 0.0}, 'renderer.yaml'),
    Documented('stereo_recovery', RecoveryNode, {}, 'recovery.yaml'),
    Documented('model_matcher', MatcherNode, {'models': ['l_shape']}, 'matcher.yaml'),
    Documented('model_matcher', TrackerNode, {'models': ['l_shape']}, 'tracker.yaml', 'tracker'),
    Documented('model_matcher', MergerNode, {'models': ['l_shape']}, 'merger.yaml', 'merger'),
    Documented('model_matcher', ViewerNode, {'port': 0}, 'viewer.yaml', 'viewer'),
    Documented('dap_emulator', EmulatorNode, {}, 'emulator.yaml'),
)


@dataclass(frozen=True)
class Interface:
    """What a node has: its name, its parameters, and (name, type) of its topics and services."""

    name: str
    parameters: tuple[ParameterSpec, ...]
    published: tuple[tuple[str, str], ...]
    subscribed: tuple[tuple[str, str], ...]
    served: tuple[tuple[str, str], ...]


def interface(documented: Documented) -> Interface:
    """Make the node, look at it, and take it down."""
    context = Context()
    rclpy.init(context=context, domain_id=101)
    overrides = [rclpy.Parameter(name, value=value) for name, value in documented.parameters.items()]
    node = documented.node_class(context=context, parameter_overrides=overrides)
    try:
        private = node.get_fully_qualified_name() + '/'

        def shown(name: str) -> str:
            if name.startswith(private):
                return '~/' + name[len(private) :]
            return name if name == '/diagnostics' else name.lstrip('/')

        def listed(entities, attribute: str, kind: str) -> tuple[tuple[str, str], ...]:
            rows = [
                (shown(node.resolve_service_name(getattr(e, attribute))), _type_name(getattr(e, kind)))
                for e in entities
            ]
            return tuple(sorted(dict(row for row in rows if row[0] not in EVERY_NODE_HAS).items()))

        return Interface(
            node.get_name(),
            type(node.config).parameters(),
            listed(node.publishers, 'topic_name', 'msg_type'),
            listed(node.subscriptions, 'topic_name', 'msg_type'),
            listed(node.services, 'srv_name', 'srv_type'),
        )
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def _type_name(message_type: type) -> str:
    return '/'.join(
        [message_type.__module__.split('.')[0], message_type.__module__.split('.')[1], message_type.__name__]
    )


def tables(documented: Documented, found: Interface) -> str:
    """Topics, services and parameters as Markdown."""
    lines = [documented.begin, '', f'### `{found.name}`', '']
    for title, rows in (('subscribes', found.subscribed), ('publishes', found.published), ('serves', found.served)):
        if rows:
            lines += [f'| {title} | type | |', '| --- | --- | --- |']
            meaning = MEANING | HEARD if title == 'subscribes' else MEANING
            lines += [f'| `{_topic(name)}` | `{kind}` | {meaning[name]} |' for name, kind in rows]
            lines.append('')
    lines += ['| parameter | default | range | |', '| --- | --- | --- | --- |']
    for spec in found.parameters:
        text = spec.description + (f' [{spec.unit}]' if spec.unit else '')
        text += '. Fixed at the start' if spec.read_only else ''
        text += f'. Formerly {", ".join(f"`{old}`" for old in spec.formerly)}' if spec.formerly else ''
        lines.append(f'| `{spec.name}` | `{_plain(spec.default)}` | {spec.range_text} | {text} |')
    return '\n'.join([*lines, '', documented.end])


def _topic(name: str) -> str:
    return name.replace('/l_shape', '/<model>')


def _plain(value: object) -> str:
    return (
        yaml.safe_dump(
            list(value) if isinstance(value, tuple) else value, default_flow_style=True, width=1000, allow_unicode=True
        )
        .removesuffix('...\n')
        .strip()
    )


def config_file(found: Interface) -> str:
    """A parameter file with every default, each with what it means. A list that is empty cannot stand in YAML (it has
    no type), so it is shown as a comment."""
    lines = [
        f'# Parameters of {found.name} and their defaults. Written by test/docs/generate.py.',
        '# Use: ros2 run ... --ros-args --params-file <this file, or your copy of it>',
        '/**:',
        '  ros__parameters:',
    ]
    for spec in found.parameters:
        about = spec.description + (f' [{spec.unit}]' if spec.unit else '')
        about += f'; {spec.range_text}' if spec.range_text else ''
        lines.append(f'    # {about}')
        lines.append(f'    {"# " if spec.default == () else ""}{spec.name}: {_plain(spec.default)}')
    return '\n'.join(lines) + '\n'


def rooms() -> str:
    """Every room with its one sentence, in the order of imports that the layer test holds; then the rooms inside it."""
    source = ast.parse((ROOT / 'test' / 'test_layers.py').read_text(encoding='utf-8'))
    order: dict[str, tuple[str, ...]] = next(
        ast.literal_eval(node.value)
        for node in source.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], 'id', '') == 'ROOMS'
    )
    lines = [ROOMS_BEGIN, '', '| room | what it is for |', '| --- | --- |']
    for package, names in order.items():
        for name in names:
            base = ROOT / 'src' / package / package
            for face in sorted((base / name).rglob('__init__.py'), key=lambda face: face.parent):
                words = ast.get_docstring(ast.parse(face.read_text(encoding='utf-8'))) or ''
                room = '.'.join(face.parent.relative_to(base.parent).parts)
                lines.append(f'| `{room}` | {words.splitlines()[0]} |')
    return '\n'.join([*lines, '', ROOMS_END])


def expected_files() -> dict[Path, str]:
    """Every generated file and what it must hold. Raises ValueError for a page without its marks, a topic without a
    meaning and a meaning without a topic."""
    files: dict[Path, str] = {}
    used: set[str] = set()
    for documented in NODES:
        found = interface(documented)
        names = {name for rows in (found.published, found.subscribed, found.served) for name, _ in rows}
        unknown = names - set(MEANING)
        if unknown:
            raise ValueError(f'{documented.package}: no meaning is given for {", ".join(sorted(unknown))}')
        used |= names
        page = files.get(documented.page) or documented.page.read_text(encoding='utf-8')
        if documented.begin not in page or documented.end not in page:
            raise ValueError(f'{documented.page}: has no {documented.begin} ... {documented.end}')
        before, rest = page.split(documented.begin, 1)
        files[documented.page] = before + tables(documented, found) + rest.split(documented.end, 1)[1]
        files[documented.yaml] = config_file(found)
    page = (ROOT / 'ARCHITECTURE.md').read_text(encoding='utf-8')
    files[ROOT / 'ARCHITECTURE.md'] = page.split(ROOMS_BEGIN)[0] + rooms() + page.split(ROOMS_END)[1]
    machine_page = ROOT / 'src' / 'dap_emulator' / 'docs' / 'dap.md'
    page = machine_page.read_text(encoding='utf-8')
    files[machine_page] = (
        f'{page.split(COUNTED_BEGIN)[0]}{COUNTED_BEGIN}\n\n{counted.table()}\n\n{COUNTED_END}'
        f'{page.split(COUNTED_END)[1]}'
    )
    for name, (path, _) in figures.BLOCKS.items():
        begin, end = figures.block(name)
        page = files.get(path) or path.read_text(encoding='utf-8')
        if begin not in page or end not in page:
            raise ValueError(f'{path}: has no {begin} ... {end}')
        files[path] = page.split(begin, 1)[0] + figures.written(name) + page.split(end, 1)[1]
    idle = set(MEANING) - used
    if idle:
        raise ValueError(f'meanings of topics that no node has: {", ".join(sorted(idle))}')
    return files


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--check', action='store_true', help='write nothing; say what differs')
    check = parser.parse_args().check
    expected = expected_files()
    differing = [
        path for path, text in expected.items() if not path.exists() or path.read_text(encoding='utf-8') != text
    ]
    for path in differing:
        print(f'{"differs" if check else "written"}: {path.relative_to(ROOT)}')
        if not check:
            path.parent.mkdir(exist_ok=True)
            path.write_text(expected[path], encoding='utf-8')
    return int(check and bool(differing))


if __name__ == '__main__':
    sys.exit(main())
