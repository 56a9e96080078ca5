"""Hostile parameters, services and programs against live nodes: each answers the next good message within a second.

    python test/stress/hostile.py --calls 1000 --programs 100

A call sets one to three parameters to the ends of their ranges, or to what is none, and asks the node to work with
them; then they are set back, and a good input has to be answered. Programs of the emulator never end, or take all
memory; another client's has to be answered beside them.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

import numpy as np
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger

sys.path.insert(0, str(Path(__file__).resolve().parent))
import damage
from fuzz import cloud_source, stereo_source
from harness import Failed, Harness
from services import own_parameters

from csg_renderer.node import RendererNode
from dap_emulator.node import EmulatorNode
from dap_emulator.service.client import DapClient
from model_matcher.node import MatcherNode
from msgs_py import FeatureSet, codecs
from stereo_recovery.node import RecoveryNode

NODES = ('recovery_node', 'matcher_node', 'renderer_node', 'emulator_node')
ANSWER_S = 1.0
# Limit of one run on the array machine, and what ending a process and starting another may take.
RUN_S, ENDED_S = 0.5, 2.5
# What one asks for oneself is no attack: these bound the time that a node may take, and stay as they are.
KEPT = {'time_limit', 'max_run_seconds', 'models', 'scene', 'calibration', 'rate'}
# Larger pictures are a matter of memory, which the machine has or has not.
LARGEST_SIDE = 2048


def extremes(spec: Any, rng: np.random.Generator) -> Any:
    """An end of a parameter's range, one of its choices, or what is none of them."""
    if rng.random() < 0.2:
        return damage.parameter_value(rng)
    if spec.choices:
        return damage.one_of(rng, spec.choices)
    if spec.kind is bool:
        return bool(rng.integers(2))
    ends = [value for value in (spec.minimum, spec.maximum) if value is not None]
    if not ends:
        return damage.parameter_value(rng)
    value = damage.one_of(rng, ends)
    return min(value, LARGEST_SIDE) if spec.name in ('width', 'height') else spec.kind(value)


class Attack:
    """Calls on one node."""

    def __init__(
        self, harness: Harness, work: Callable[[], None], good: Callable[[], bool], within: float = ANSWER_S
    ) -> None:
        self.harness, self.node, self.work, self.good = harness, harness.node, work, good
        self.within = within
        name = self.node.get_fully_qualified_name()
        self.setter = harness.tester.create_client(SetParametersAtomically, f'{name}/set_parameters_atomically')
        self.reset = harness.tester.create_client(Trigger, f'{name}/reset')
        self.slowest = 0.0
        if harness.spin(lambda: self.setter.service_is_ready() and self.reset.service_is_ready(), 20.0) is None:
            raise Failed('no services')
        fixed = {spec.name for spec in type(self.node.config).parameters() if spec.read_only}
        self.initial = [
            one.to_parameter_msg() for name, one in own_parameters(self.node.config).items() if name not in fixed
        ]

    def run(self, calls: int, rng: np.random.Generator) -> str:
        specs = [spec for spec in type(self.node.config).parameters() if spec.name not in KEPT and not spec.read_only]
        applied = 0
        for _ in range(calls):
            given = {}
            for spec in (damage.one_of(rng, specs) for _ in range(int(rng.integers(1, 4)))):
                try:
                    given[spec.name] = Parameter(spec.name, value=extremes(spec, rng)).to_parameter_msg()
                except (AttributeError, TypeError, ValueError, AssertionError):
                    continue  # rclpy itself has no message for it
            request = SetParametersAtomically.Request(parameters=list(given.values()))
            applied += self.harness.call(self.setter, request, self.within).result.successful
            if rng.random() < 0.1:
                self.harness.call(self.reset, Trigger.Request(), self.within)
            self.work()
            start = time.monotonic()
            back = self.harness.call(self.setter, SetParametersAtomically.Request(parameters=self.initial), 10.0)
            if not back.result.successful:
                raise Failed(f'{self.node.get_name()}: its own values are refused: {back.result.reason}')
            if not self.good():
                raise Failed(f'{self.node.get_name()}: no answer after {given}: {self.node.health.last_error}')
            took = time.monotonic() - start
            self.slowest = max(self.slowest, took)
            if took > self.within:
                raise Failed(f'{self.node.get_name()}: {took:.2f} s for the next good input after {given}')
        return f'{self.node.get_name()}: {calls} calls, {applied} applied, slowest answer {self.slowest:.2f} s'


def on_topics(harness: Harness, types: dict[str, type], good: Any, bad: Any) -> tuple[Any, Any]:
    """What sends a hostile input, and what sends a good one and waits for its result."""
    outputs, moment = harness.publishers(types), [1000]

    def send(source: Any) -> None:
        moment[0] += 1
        for topic, message in source(moment[0]).items():
            outputs[topic].publish(message)

    def answered() -> bool:
        before = harness.node.health.processed
        send(good)
        # One that was lost while the node was busy is sent again, as a camera does.
        for _ in range(20):
            if harness.spin(lambda: harness.node.health.processed > before, 0.25) is not None:
                return True
            send(good)
        return False

    return lambda: send(bad), answered


def crowd(rng: np.random.Generator) -> Any:
    """moment -> a cloud in which everything looks like the model."""
    start = np.column_stack([rng.uniform(-0.3, 0.3, (400, 2)), 0.8 + 0.02 * rng.normal(size=400)])
    data = FeatureSet.from_edges(
        start, start + np.eye(3)[rng.integers(0, 3, 400)] * rng.uniform(0.005, 0.06, (400, 1)), 5e-3, 5e-3
    )

    def made(moment: int) -> dict[str, Any]:
        header = Header(frame_id='cam_left_optical_frame')
        header.stamp.sec = moment
        return {'features': codecs.features_to_cloud(data, header)}

    return made


def attack_renderer(domain: int, calls: int, rng: np.random.Generator, within: float = ANSWER_S) -> str:
    harness = Harness(RendererNode, {'rate': 0.0, 'scene': 'l_shape_v1', 'width': 64, 'time_limit': 0.3}, domain)
    try:
        client = harness.tester.create_client(Trigger, '/renderer_node/render')
        harness.spin(client.service_is_ready, 20.0)
        for levels in (1, 2):  # what is compiled at its first use is no attack
            for antialias in (0, 1, 2):
                for shadows in (False, True):
                    values = {'levels': levels, 'antialias': antialias, 'shadows': shadows, 'time_limit': 300.0}
                    harness.node.set_parameters_atomically([Parameter(name, value=v) for name, v in values.items()])
                    harness.call(client, Trigger.Request(), 300.0)
        harness.node.set_parameters_atomically(
            [
                Parameter(name, value=value)
                for name, value in {'levels': 1, 'antialias': 4, 'shadows': False, 'time_limit': 0.3}.items()
            ]
        )

        def good() -> bool:
            return any(harness.call(client, Trigger.Request(), 10.0).success for _ in range(2))

        return Attack(harness, lambda: client.call_async(Trigger.Request()), good, within).run(calls, rng)
    finally:
        harness.close()


# Of array programs: what never ends, or takes more than there is. Numbers are put in for {}.
PROGRAMS = (
    ('10 CONTINUE', '  N = N + {}', '  GOTO 10'),
    ('  REAL A(*{0},*{0})', '10 A = SIN(A) + COS(A) + ATAN2(A, A)', '  GOTO 10'),
    ('  INTEGER*1 A(*{0}, *{0})', '10 CALL DISPLAY(A)', '  GOTO 10'),
    ('  REAL X(,,{0}00)', '  X = 1.0'),
    ('  N = SUM(MAT(1, {0}00, {0}00))'),
    ('  N = 9**9**9**9**{}'),
    ('  N = 7**(-{}9999999)'),
    ('  CALL MAIN(N)'),
)


def hostile_program(rng: np.random.Generator) -> str:
    lines = damage.one_of(rng, PROGRAMS)
    lines = (lines,) if isinstance(lines, str) else lines
    number = int(rng.integers(1, 1000))
    return '\n'.join(['ENTRY SUBROUTINE MAIN(N)', '  INTEGER N', *(line.format(number) for line in lines), 'END', ''])


def attack_emulator(domain: int, programs: int, rng: np.random.Generator, within: float = ANSWER_S) -> str:
    """A good program beside each hostile one, of another client.

    The services answer at once. The machine runs one program at a time, each up to max_run_seconds and a moment more in
    which a process that does not listen is ended: so long a good one may wait.
    """
    harness = Harness(EmulatorNode, {'max_run_seconds': RUN_S}, domain)
    good_program = 'ENTRY SUBROUTINE MAIN(N)\n  INTEGER N\n  N = N + 1\nEND\n'
    stored = answered = 0.0
    try:
        where = {'node': harness.tester, 'executor': harness.executor}
        name = harness.node.get_fully_qualified_name()
        with DapClient(name, client='good', **where) as good:
            good.run(good_program, entry='MAIN', N=1)  # its process is there
            for number in range(programs):
                source = hostile_program(rng)
                with DapClient(name, client='bad', **where) as bad:
                    with contextlib.suppress(ValueError):  # refused
                        bad.store(program=source, entry='MAIN', run_request=number + 1)
                    start = time.monotonic()
                    good.store(program=good_program)
                    stored = max(stored, time.monotonic() - start)
                    if good.run(good_program, entry='MAIN', N=number)['N'] != number + 1:
                        raise Failed(f'emulator_node: a wrong sum beside {source!r}')
                    answered = max(answered, time.monotonic() - start)
                    if stored > within or answered > RUN_S + ENDED_S:
                        raise Failed(
                            f'emulator_node: {stored:.2f} s to store, {answered:.2f} s to run beside {source!r}'
                        )
        return f'emulator_node: {programs} programs, slowest service {stored:.2f} s, slowest good run {answered:.2f} s'
    finally:
        harness.close()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--calls', type=int, default=1000, help='on each node (default: 1000)')
    parser.add_argument('--programs', type=int, default=100, help='of the emulator (default: 100)')
    parser.add_argument('--only', nargs='+', choices=NODES, default=NODES, help='these nodes (default: all)')
    parser.add_argument(
        '--within',
        type=float,
        default=ANSWER_S,
        help='seconds in which a node has to answer (default: 1; a busy machine: more)',
    )
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--domain', type=int, default=101, help='DDS domain (tests use 1 to 100)')
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    pairs = {topic: CameraInfo if topic.endswith('info') else Image for topic in damage.TOPICS}
    targets = (
        (RecoveryNode, {}, pairs, stereo_source(rng), stereo_source(rng)),
        (
            MatcherNode,
            {'models': ['l_shape', 'chair', 'wedge'], 'time_limit': 0.3},
            {'features': PointCloud2},
            cloud_source(),
            crowd(rng),
        ),
    )
    try:
        for node, (node_class, parameters, types, good, bad) in zip(NODES, targets):
            if node not in options.only:
                continue
            harness = Harness(node_class, copy.deepcopy(parameters), options.domain)
            try:
                work, answered = on_topics(harness, types, good, bad)
                answered()
                print(Attack(harness, work, answered, options.within).run(options.calls, rng), flush=True)
            finally:
                harness.close()
        if 'renderer_node' in options.only:
            print(attack_renderer(options.domain, options.calls, rng, options.within), flush=True)
        if 'emulator_node' in options.only:
            print(attack_emulator(options.domain, options.programs, rng, options.within), flush=True)
    except Failed as error:
        print(f'FAILED: {error}')
        return 1
    print(f'every node answered the next good input within {options.within:g} s')
    return 0


if __name__ == '__main__':
    sys.exit(main())
