"""What is renamed still works under its old name, and nobody can miss that it was renamed."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter as NodeParameter
from std_msgs.msg import String

from msgs_py.node_runtime.config import Config, parameter
from msgs_py.node_runtime.renaming import renamed_arguments, renamed_names
from msgs_py.node_runtime.runtime import GraphNode


@dataclass(frozen=True)
class RenamedConfig(Config):
    smoothing: float = parameter(1.0, 'A number', minimum=0.0, maximum=9.0, formerly=('sigma', 'blur'))
    files: tuple[str, ...] = parameter((), 'Names', read_only=True, formerly=('paths',))


class RenamedNode(GraphNode):
    def __init__(self, **kwargs):
        super().__init__('renamed_node', RenamedConfig, **kwargs)
        self.start()

    def configure(self):
        self.out = self.create_output(String, 'texts', formerly=('output',))

    def activate(self):
        self.listen(String, 'words', self.on_text, formerly=('input',))

    def on_text(self, message):
        self.out.publish(message)
        self.done()


def status_of(graph, statuses: list) -> DiagnosticStatus:
    statuses.clear()
    return graph.spin_until(lambda: [s for m in statuses for s in m.status if s.name == '/renamed_node'])[-1]


def test_a_value_given_under_the_old_name_counts_and_is_reported(graph):
    node = graph.add(RenamedNode, parameters={'sigma': 2, 'paths': ['a']})
    assert node.config == RenamedConfig(2.0, ('a',))
    status = status_of(graph, graph.collect(DiagnosticArray, '/diagnostics'))
    assert status.level == DiagnosticStatus.WARN
    assert 'parameter sigma is now smoothing' in status.message and 'paths is now files' in status.message


def test_the_new_name_wins_over_the_old_one(graph):
    assert graph.add(RenamedNode, parameters={'blur': 2.0, 'smoothing': 3.0}).config.smoothing == 3.0


def test_a_bad_value_under_the_old_name_is_refused_like_any_other(graph):
    node = graph.add(RenamedNode, parameters={'sigma': 100.0})
    assert node.config.smoothing == 1.0 and 'smoothing' in node.health.last_error


def test_the_old_name_is_accepted_at_run_time_too(graph):
    node = graph.add(RenamedNode)
    request = SetParameters.Request(
        parameters=[Parameter(name='blur', value=ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=4.0))]
    )
    assert graph.call(SetParameters, '/renamed_node/set_parameters', request).results[0].successful
    assert node.config.smoothing == node.get_parameter('smoothing').value == 4.0
    refused = node.set_parameters_atomically([NodeParameter('sigma', value=-1.0)])
    assert not refused.successful and 'smoothing' in refused.reason


def test_topics_are_served_under_their_old_names(graph):
    node = graph.add(RenamedNode)
    heard = graph.collect(String, 'output')
    talk = graph.publisher(String, 'input')
    graph.wait_matched(talk)
    graph.spin_until(lambda: node.wanted(node.out), what='the listener to the old name')
    talk.publish(String(data='hello'))
    graph.spin_until(lambda: heard, what='the text under the old names')
    values = {v.key: v.value for v in status_of(graph, graph.collect(DiagnosticArray, '/diagnostics')).values}
    assert 'topic input is now words' in values['old_names_in_use']
    assert 'topic output is now texts' in values['old_names_in_use']


def test_new_names_alone_are_no_reason_for_a_warning(graph):
    graph.add(RenamedNode, parameters={'smoothing': 2.0})
    status = status_of(graph, graph.collect(DiagnosticArray, '/diagnostics'))
    values = {v.key: v.value for v in status.values}
    assert values['old_names_in_use'] == '' and values['ignored_parameters'] == ''


def test_a_misspelt_parameter_is_not_ignored_in_silence(graph):
    graph.add(RenamedNode, parameters={'smothing': 2.0, 'qos_overrides./wrods.subscription.depth': 3})
    values = {v.key: v.value for v in status_of(graph, graph.collect(DiagnosticArray, '/diagnostics')).values}
    assert values['ignored_parameters'] == 'smothing, qos_overrides./wrods.subscription.depth'


def test_a_renamed_function_warns_everybody_and_works(monkeypatch):
    module = ModuleType('shop')
    module.match = lambda: 42
    monkeypatch.setitem(__import__('sys').modules, 'shop', module)
    module.__getattr__ = renamed_names('shop', {'find': 'match', 'Number': 'fractions.Fraction'})
    with pytest.warns(FutureWarning, match=r'name shop\.find is now shop\.match'):
        assert module.find() == 42
    with pytest.warns(FutureWarning, match=r'shop\.Number is now fractions\.Fraction'):
        assert module.Number(1, 2) == 0.5
    with pytest.raises(AttributeError, match="'shop' has no attribute 'lose'"):
        _ = module.lose


def test_a_renamed_argument_warns_everybody_and_works():
    @renamed_arguments(sigma='smoothing')
    def blur(image, smoothing=1.0):
        return image, smoothing

    with pytest.warns(FutureWarning, match='blur: argument sigma is now smoothing'):
        assert blur(1, sigma=3.0) == (1, 3.0)
    assert blur(1, smoothing=2.0) == (1, 2.0)
    with pytest.raises(TypeError, match='sigma is the old name of smoothing'):
        blur(1, sigma=1.0, smoothing=1.0)
