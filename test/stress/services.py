"""Odd requests to the services of live nodes: each is answered, refused with words, or counted as lost."""

from __future__ import annotations

import itertools
import time
from collections import Counter
from pathlib import Path

import damage
import numpy as np
from harness import HANG_S, Failed, Harness
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

import csg_renderer
from msgs_py.node_runtime.config import Config

RENDER_SIZES = (0, 1, 2, 7, 33, 96, 16384, -1, 2**40)


# An empty list does not say what it is a list of.
ARRAYS = {
    str: Parameter.Type.STRING_ARRAY,
    int: Parameter.Type.INTEGER_ARRAY,
    float: Parameter.Type.DOUBLE_ARRAY,
    bool: Parameter.Type.BOOL_ARRAY,
}


def own_parameters(config: Config) -> dict[str, Parameter]:
    """All parameters of a node with the values they have."""
    values = config.as_parameters()
    return {
        spec.name: Parameter(spec.name, ARRAYS[spec.element], list(values[spec.name]))
        if spec.kind is tuple
        else Parameter(spec.name, value=values[spec.name])
        for spec in type(config).parameters()
    }


def fuzz_parameters(harness: Harness, rng: np.random.Generator, count: int) -> Counter[str]:
    """Values of every type for every parameter: applied, or refused with a reason that names it."""
    node, outcomes = harness.node, Counter()
    names = [spec.name for spec in type(node.config).parameters()]
    initial = own_parameters(node.config)
    for _ in range(count):
        name = damage.one_of(rng, [*names, 'use_sim_time', 'no_such_parameter'])
        value = damage.parameter_value(rng)
        start = time.monotonic()
        try:
            parameter = Parameter(name, value=value)
        except (AttributeError, TypeError, ValueError):
            continue  # rclpy itself has no message for it
        result = node.set_parameters_atomically([parameter])
        if time.monotonic() - start > HANG_S:
            raise Failed(f'parameter {name} := {value!r} took {time.monotonic() - start:.1f} s')
        if not result.successful and not result.reason:
            raise Failed(f'parameter {name} := {value!r} refused without a reason')
        outcomes['applied' if result.successful else 'refused with a reason'] += 1
        if result.successful and name in initial:
            restored = node.set_parameters_atomically([initial[name]])
            if not restored.successful:
                raise Failed(f'parameter {name}: {initial[name].value!r} no longer accepted: {restored.reason}')
        elif result.successful and name == 'use_sim_time':
            node.set_parameters_atomically([Parameter(name, value=False)])
    return outcomes


def fuzz_emulator(harness: Harness, rng: np.random.Generator, count: int) -> Counter[str]:
    """Requests of any names and types to ~/store, ~/run and ~/fetch."""
    tester, outcomes = harness.tester, Counter()
    store = tester.create_client(SetParametersAtomically, '/emulator_node/store')
    fetch = tester.create_client(GetParameters, '/emulator_node/fetch')
    run = tester.create_client(Trigger, '/emulator_node/run')
    if harness.spin(lambda: all(client.service_is_ready() for client in (store, fetch, run)), 20.0) is None:
        raise Failed('no services')
    names = (
        '',
        '.',
        '/',
        'a',
        'a.program',
        'a.entry',
        'a.run_request',
        'b.library',
        'a.x',
        'a.model',
        'x' * 3000,
        'a..b',
        'a.data.X',
        'a.shape.X',
        'a.forget',
        'a.cancel',
        'a.result.1.data.X',
        'b.run_request',
        '\0',
        '../../etc',
        'a.result.1.cycles',
    )
    texts = (
        '',
        '      SUBROUTINE MAIN',
        'entry main\nend',
        'program',
        'canny',
        '/etc/passwd',
        '(' * 2000,
        '\0\n',
        'x' * 20000,
    )
    for _ in range(count):
        parameters = []
        for _ in range(int(rng.integers(0, 4))):
            value = ParameterValue(type=int(rng.integers(0, 12)))
            value.string_value = damage.one_of(rng, texts)
            value.integer_array_value = rng.integers(-(2**60), 2**60, int(rng.integers(0, 50))).tolist()
            value.double_array_value = [damage.one_of(rng, damage.ODD_FLOATS) for _ in range(3)]
            value.integer_value = int(rng.integers(-(2**62), 2**62))
            value.double_value = damage.one_of(rng, damage.ODD_FLOATS)
            parameters.append(ParameterMessage(name=damage.one_of(rng, names), value=value))
        result = harness.call(store, SetParametersAtomically.Request(parameters=parameters)).result
        if not result.successful and not result.reason:
            raise Failed('store refused without a reason')
        outcomes['stored' if result.successful else 'refused with a reason'] += 1
        if rng.random() < 0.2:
            answer = harness.call(run, Trigger.Request())
            if not answer.success and not answer.message:
                raise Failed('run failed without a reason')
            outcomes['ran' if answer.success else 'run failed with a reason'] += 1
        if rng.random() < 0.2:
            wanted = [damage.one_of(rng, names) for _ in range(3)]
            if len(harness.call(fetch, GetParameters.Request(names=wanted)).values) != 3:
                raise Failed('fetch answered another number of values')
            outcomes['fetched'] += 1
    return outcomes


def fuzz_parameter_services(harness: Harness, rng: np.random.Generator, count: int) -> Counter[str]:
    """The services that every node has: several odd values at once, names that are no names."""
    name, tester, outcomes = harness.node.get_fully_qualified_name(), harness.tester, Counter()
    kinds = {
        'set_parameters': SetParameters,
        'set_parameters_atomically': SetParametersAtomically,
        'get_parameters': GetParameters,
        'describe_parameters': DescribeParameters,
        'list_parameters': ListParameters,
    }
    clients = {service: tester.create_client(kind, f'{name}/{service}') for service, kind in kinds.items()}
    if harness.spin(lambda: all(client.service_is_ready() for client in clients.values()), 20.0) is None:
        raise Failed('no parameter services')
    known = [spec.name for spec in type(harness.node.config).parameters()]
    names = [*known, '', '.', 'no_such_parameter', 'x' * 3000, '/', '*', 'qos_overrides']
    initial = list(own_parameters(harness.node.config).values())
    for _ in range(count):
        service = damage.one_of(rng, list(kinds))
        wanted = [damage.one_of(rng, names) for _ in range(int(rng.integers(0, 5)))]
        request = kinds[service].Request()
        if service.startswith('set'):
            request.parameters = [ParameterMessage(name=name, value=odd_value(rng)) for name in wanted]
        elif service == 'list_parameters':
            request.prefixes, request.depth = wanted, int(rng.integers(0, 2**63))
        else:
            request.names = wanted
        problems = harness.node.health.problems
        future = clients[service].call_async(request)
        if (
            harness.spin(
                lambda: future.done() or harness.node.health.problems > problems,  # noqa: B023
                HANG_S + 3.0,
            )
            is None
        ):
            raise Failed(f'{service} neither answered nor reported {str(request)[:3000]}')
        if harness.spin(future.done, 0.05) is None:
            # rclpy itself stumbles over a type or name that does not exist, and then has no answer to send.
            outcomes['reported, not answered'] += 1
            continue
        answer = future.result()
        results = getattr(answer, 'results', None) or ([answer.result] if service.endswith('atomically') else [])
        if any(not result.successful and not result.reason for result in results):
            raise Failed(f'{service}: refused without a reason: {str(request)[:300]}')
        outcomes[service] += 1
        for parameter in initial:
            if harness.node.get_parameter(parameter.name).value != parameter.value:
                harness.node.set_parameters([parameter])
    return outcomes


def odd_value(rng: np.random.Generator) -> ParameterValue:
    """Any type, also types that do not exist, filled with any values."""
    value = ParameterValue(type=int(rng.integers(0, 12)))
    value.bool_value = bool(rng.integers(2))
    value.string_value = damage.one_of(rng, ('', 'native', 'no such', '/etc/passwd', 'x' * 3000, '\0'))
    value.integer_value = int(rng.integers(-(2**62), 2**62))
    value.double_value = damage.one_of(rng, damage.ODD_FLOATS)
    value.string_array_value = [value.string_value] * int(rng.integers(0, 3))
    value.integer_array_value = rng.integers(-(2**60), 2**60, int(rng.integers(0, 9))).tolist()
    value.double_array_value = [damage.one_of(rng, damage.ODD_FLOATS) for _ in range(3)]
    return value


def fuzz_renderer(harness: Harness, rng: np.random.Generator, count: int, scene: Path) -> Counter[str]:
    """~/render and ~/reset while the scene's file is damaged, half written or gone, and sizes and options change.

    scene : the file that the node was started with; it is written here.
    """
    node, outcomes = harness.node, Counter()
    clients = [harness.tester.create_client(Trigger, f'/renderer_node/{name}') for name in ('render', 'reset')]
    if harness.spin(lambda: all(client.service_is_ready() for client in clients), 20.0) is None:
        raise Failed('no services')
    whole = csg_renderer.scene_path('chair').read_bytes() + b'DRAW chair AT (0, 0, 300);\n'
    for levels, antialias in itertools.product((1, 2), (0, 1, 2)):  # what is compiled at its first use is no hang
        node.set_parameters_atomically(
            [Parameter('width', value=16), Parameter('levels', value=levels), Parameter('antialias', value=antialias)]
        )
        harness.call(clients[0], Trigger.Request(), 120.0)
    for _ in range(count):
        content = bytearray(whole)
        if rng.random() < 0.5:
            content = content[: int(rng.integers(0, len(content)))]
        for _ in range(int(rng.integers(0, 4)) if content else 0):
            content[int(rng.integers(0, len(content)))] = int(rng.integers(0, 256))
        if rng.random() < 0.1:
            scene.unlink(missing_ok=True)
        else:
            scene.write_bytes(bytes(content))
        options = [
            Parameter(name, value=damage.one_of(rng, values))
            for name, values in (
                ('width', RENDER_SIZES),
                ('height', RENDER_SIZES),
                ('antialias', (0, 1, 2)),
                ('levels', (1, 2)),
                ('encoding', ('mono8', 'rgb8', 'jpeg')),
                ('baseline', (0.0, 1e-9, 0.05, 999.0, float('nan'))),
                ('focal', (0.0, 1e-3, 100.0, 1e6, float('inf'))),
                ('turntable', (0.0, 90.0, -180.0, 1e9)),
            )
        ]
        for option in options:
            node.set_parameters_atomically([option])
        client, problems = damage.one_of(rng, clients), node.health.problems
        start = time.monotonic()
        answer = harness.call(client, Trigger.Request(), 30.0)
        if time.monotonic() - start > HANG_S:
            raise Failed(f'{client.srv_name} took {time.monotonic() - start:.1f} s: {node.config}, {bytes(content)!r}')
        if not answer.success and (not answer.message or node.health.problems == problems):
            raise Failed(f'{client.srv_name} failed without a reason')
        if 'Error: ' in node.health.last_error:
            raise Failed(f'{client.srv_name}: not foreseen: {node.health.last_error}; {node.config}')
        outcomes['answered' if answer.success else 'failed with a reason'] += 1
    scene.write_bytes(whole)
    for name, value in (('width', 64), ('height', 64), ('focal', 0.0), ('baseline', 0.0)):
        node.set_parameters_atomically([Parameter(name, value=value)])
    if not harness.call(clients[0], Trigger.Request()).success:
        raise Failed(f'a good scene is not rendered: {node.health.last_error}')
    return outcomes
