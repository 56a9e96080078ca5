"""Launch files, parameter files and the RViz view agree with the nodes."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml

from csg_renderer.node import RendererConfig, RendererNode
from dap_emulator.node import EmulatorNode
from dap_emulator.service_config import EmulatorConfig
from model_matcher.node import MatcherConfig, MatcherNode
from msgs_py.runtime import STEREO_TOPICS
from stereo_recovery.node import RecoveryConfig, RecoveryNode

ROOT = Path(__file__).resolve().parent.parent
LAUNCH = sorted((ROOT / 'src/model_matcher/model_matcher/launch').glob('*.launch.py'))
CONFIGS = {'renderer_node': ('csg_renderer', 'renderer.yaml', RendererConfig, RendererNode),
           'recovery_node': ('stereo_recovery', 'recovery.yaml', RecoveryConfig, RecoveryNode),
           'matcher_node': ('model_matcher', 'matcher.yaml', MatcherConfig, MatcherNode),
           'emulator_node': ('dap_emulator', 'emulator.yaml', EmulatorConfig, EmulatorNode)}


def config_path(package: str, name: str) -> Path:
    return ROOT / 'src' / package / package / 'config' / name


@pytest.mark.parametrize('node', CONFIGS)
def test_a_parameter_file_holds_every_parameter_with_its_default(node):
    package, name, config_class, _ = CONFIGS[node]
    values = yaml.safe_load(config_path(package, name).read_text())['/**']['ros__parameters']
    defaults = {key: list(value) if isinstance(value, tuple) else value
                for key, value in config_class().as_parameters().items() if value != ()}
    assert values == defaults
    assert config_class.from_parameters(values) == config_class()


@pytest.mark.parametrize('node', CONFIGS)
def test_a_node_starts_from_its_parameter_file(graph, node):
    package, name, config_class, node_class = CONFIGS[node]
    started = graph.add(node_class, cli_args=['--ros-args', '--params-file', str(config_path(package, name))])
    assert started.config == config_class()
    assert 'using the default' not in started.health.last_error


class Recorded:
    """Stands for any class of launch and launch_ros: remembers how it was made."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.args, self.kwargs = args, kwargs


def stand_ins() -> dict[str, ModuleType]:
    """Modules with the names of launch's that these files import. launch does not come with the wheels."""
    names = {'launch': ['LaunchDescription'], 'launch.actions': ['DeclareLaunchArgument'],
             'launch.conditions': ['IfCondition'],
             'launch.substitutions': ['LaunchConfiguration', 'PathJoinSubstitution'], 'launch_ros': [],
             'launch_ros.actions': ['Node'], 'launch_ros.parameter_descriptions': ['ParameterValue'],
             'launch_ros.substitutions': ['FindPackageShare']}
    modules = {}
    for name, classes in names.items():
        modules[name] = ModuleType(name)
        for one in classes:
            setattr(modules[name], one, type(one, (Recorded,), {}))
    return modules


def load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.name.replace('.', '_'), path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize('path', LAUNCH, ids=lambda path: path.name)
def test_a_launch_file_names_what_exists(path, monkeypatch):
    for name, module in stand_ins().items():
        monkeypatch.setitem(sys.modules, name, module)
    module = load(path)
    actions = module.generate_launch_description().args[0]
    nodes = [action for action in actions if type(action).__name__ == 'Node']
    ours = {node.kwargs['executable']: node for node in nodes if node.kwargs['package'] != 'rviz2'}
    assert set(ours) == ({'recovery_node', 'matcher_node'} if 'recognise' in path.name else set(CONFIGS))
    for executable, node in ours.items():
        package, config, config_class, _ = CONFIGS[executable]
        assert node.kwargs['package'] == package
        files = [item for item in node.kwargs['parameters'] if not isinstance(item, dict)]
        assert [item.args[0][1:] for item in files] == [['config', config]]
        assert files[0].args[0][0].args[0] == package
        known = {spec.name for spec in config_class.parameters()} | {'use_sim_time'}
        given = {key for item in node.kwargs['parameters'] if isinstance(item, dict) for key in item
                 if not key.startswith('qos_overrides.')}
        assert given <= known
        assert {source for source, _ in node.kwargs.get('remappings', [])} in (set(), set(STEREO_TOPICS))
    declared = {action.args[0] for action in actions if type(action).__name__ == 'DeclareLaunchArgument'}
    assert declared == set(module.ARGUMENTS) == set(re.findall(r"value\['(\w+)'\]", path.read_text())) | {
        'scene', 'models', 'rate', 'noise', 'turntable'} & set(module.ARGUMENTS)


@pytest.mark.parametrize('path', LAUNCH, ids=lambda path: path.name)
def test_a_launch_file_loads_in_launch_itself(path):
    pytest.importorskip('launch_ros', reason='launch does not come with the wheels')
    assert load(path).generate_launch_description().entities


def test_the_view_shows_topics_that_the_nodes_publish(graph):
    view = yaml.safe_load(config_path('model_matcher', 'recognise.rviz').read_text())
    displays = view['Visualization Manager']['Displays']
    nodes = [graph.add(RendererNode, parameters={'rate': 0.0}), graph.add(RecoveryNode), graph.add(MatcherNode)]
    published = {p.topic_name: p.msg_type.__name__ for node in nodes for p in node.publishers}
    for display in displays:
        kind, topic = display['Class'].split('/')[1], display['Topic']['Value']
        assert published[topic] == kind
    assert view['Visualization Manager']['Global Options']['Fixed Frame'] == RendererConfig().frame_id
