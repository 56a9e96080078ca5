"""Launch files, parameter files and the RViz view agree with the nodes."""

from __future__ import annotations

import importlib.util
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml
from geometry_msgs.msg import PoseStamped

from csg_renderer.node import RendererNode
from csg_renderer.params import RendererConfig
from dap_emulator.node import EmulatorNode
from dap_emulator.service.service_config import EmulatorConfig
from model_matcher.merger_node import MergerConfig, MergerNode
from model_matcher.node import MatcherConfig, MatcherNode
from model_matcher.tracker_node import TrackerConfig, TrackerNode
from model_matcher.viewer_node import ViewerConfig, ViewerNode
from msgs_py.node_runtime.runtime import STEREO_TOPICS
from stereo_recovery.node import RecoveryConfig, RecoveryNode

ROOT = Path(__file__).resolve().parent.parent
LAUNCH = sorted((ROOT / 'src/model_matcher/model_matcher/launch').glob('*.launch.py'))
CONFIGS = {
    'renderer_node': ('csg_renderer', 'renderer.yaml', RendererConfig, RendererNode),
    'recovery_node': ('stereo_recovery', 'recovery.yaml', RecoveryConfig, RecoveryNode),
    'matcher_node': ('model_matcher', 'matcher.yaml', MatcherConfig, MatcherNode),
    'tracker_node': ('model_matcher', 'tracker.yaml', TrackerConfig, TrackerNode),
    'merger_node': ('model_matcher', 'merger.yaml', MergerConfig, MergerNode),
    'viewer_node': ('model_matcher', 'viewer.yaml', ViewerConfig, ViewerNode),
    'emulator_node': ('dap_emulator', 'emulator.yaml', EmulatorConfig, EmulatorNode),
}


def config_path(package: str, name: str) -> Path:
    return ROOT / 'src' / package / package / 'config' / name


@pytest.mark.parametrize('node', CONFIGS)
def test_a_parameter_file_holds_every_parameter_with_its_default(node):
    package, name, config_class, _ = CONFIGS[node]
    values = yaml.safe_load(config_path(package, name).read_text())['/**']['ros__parameters']
    defaults = {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in config_class().as_parameters().items()
        if value != ()
    }
    assert values == defaults
    assert config_class.from_parameters(values) == config_class()


# viewer_node would take its port of this machine, which another test run may have (test_viewer.py starts it on others).
@pytest.mark.parametrize('node', [name for name in CONFIGS if name != 'viewer_node'])
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
    names = {
        'launch': ['LaunchDescription'],
        'launch.actions': ['DeclareLaunchArgument'],
        'launch.conditions': ['IfCondition'],
        'launch.substitutions': ['LaunchConfiguration', 'PathJoinSubstitution', 'PythonExpression'],
        'launch_ros': [],
        'launch_ros.actions': ['Node'],
        'launch_ros.parameter_descriptions': ['ParameterValue'],
        'launch_ros.substitutions': ['FindPackageShare'],
    }
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
    live = {'recovery_node', 'matcher_node', 'tracker_node'}
    all_but = set(CONFIGS) - {'tracker_node', 'merger_node', 'viewer_node'}
    assert set(ours) == (live if 'recognise' in path.name else all_but)
    for executable, node in ours.items():
        package, config, config_class, _ = CONFIGS[executable]
        assert node.kwargs['package'] == package
        files = [item for item in node.kwargs['parameters'] if not isinstance(item, dict)]
        assert [item.args[0][1:] for item in files] == [['config', config]]
        assert files[0].args[0][0].args[0] == package
        known = {spec.name for spec in config_class.parameters()} | {'use_sim_time'}
        given = {
            key
            for item in node.kwargs['parameters']
            if isinstance(item, dict)
            for key in item
            if not key.startswith('qos_overrides.')
        }
        assert given <= known
        assert {source for source, _ in node.kwargs.get('remappings', [])} in (set(), {*STEREO_TOPICS, 'image_rect'})
        assert node.kwargs['respawn'].args == ('respawn',) and node.kwargs['respawn_delay'] < 1.0
    declared = {action.args[0] for action in actions if type(action).__name__ == 'DeclareLaunchArgument'}
    assert (
        declared
        == set(module.ARGUMENTS)
        == set(re.findall(r"value\['(\w+)'\]", path.read_text()))
        | {'scene', 'models', 'rate', 'noise', 'turntable'} & set(module.ARGUMENTS)
    )


@pytest.mark.parametrize('path', LAUNCH, ids=lambda path: path.name)
def test_a_launch_file_loads_in_launch_itself(path):
    pytest.importorskip('launch_ros', reason='launch does not come with the wheels')
    assert load(path).generate_launch_description().entities


RUN = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import EmitEvent, IncludeLaunchDescription, TimerAction
from launch.events import Shutdown
from launch.launch_description_sources import PythonLaunchDescriptionSource

service = LaunchService()
service.include_launch_description(LaunchDescription([
    IncludeLaunchDescription(PythonLaunchDescriptionSource(sys.argv[1]),
                             launch_arguments=[argument.split(':=', 1) for argument in sys.argv[2:]]),
    TimerAction(period=45.0, actions=[EmitEvent(event=Shutdown())])]))
sys.exit(service.run())
"""


def test_launch_starts_the_graph_with_its_arguments(graph):
    """In a sourced workspace: processes, parameter files, types of arguments and namespace, through launch itself."""
    pytest.importorskip('launch_ros', reason='launch does not come with the wheels')
    packages = pytest.importorskip('ament_index_python.packages', reason='no ament index')
    try:
        share = [packages.get_package_share_directory(package) for package, *_ in CONFIGS.values()][2]
    except packages.PackageNotFoundError:
        pytest.skip('the workspace is not sourced')
    poses = graph.collect(PoseStamped, '/arm/interpretations/chipped_block')
    command = [
        sys.executable,
        '-c',
        RUN,
        f'{share}/launch/closed_form.launch.py',
        'namespace:=arm',
        'rate:=4',
        'scene:=chipped_block_v1',
        "models:=['l_shape', 'chipped_block']",
        'noise:=0.5',
    ]
    launched = subprocess.Popen(
        command,
        env=os.environ | {'ROS_DOMAIN_ID': str(graph.domain_id)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        graph.spin_until(lambda: len(poses) >= 2, 45.0, 'two poses')
    finally:
        launched.send_signal(signal.SIGINT)
        said = launched.communicate(timeout=15)[0]
    assert said.count('process has finished cleanly') == len(CONFIGS), said


def test_the_view_shows_topics_that_the_nodes_publish(graph):
    view = yaml.safe_load(config_path('model_matcher', 'recognise.rviz').read_text())
    displays = view['Visualization Manager']['Displays']
    nodes = [graph.add(RendererNode, parameters={'rate': 0.0}), graph.add(RecoveryNode), graph.add(MatcherNode)]
    published = {p.topic_name: p.msg_type.__name__ for node in nodes for p in node.publishers}
    for display in displays:
        kind, topic = display['Class'].split('/')[1], display['Topic']['Value']
        assert published[topic] == kind
    assert view['Visualization Manager']['Global Options']['Fixed Frame'] == RendererConfig().frame_id
