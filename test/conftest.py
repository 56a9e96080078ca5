"""Fixtures of the tests that use a real ROS graph: a context of its own and a domain of its own for each test."""

from __future__ import annotations

import fcntl
import itertools
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TextIO

import pytest

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_PYTHON_CHECK_FIELDS', '1')

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from msgs_py.node_runtime.transport import make_room_for_images

make_room_for_images()  # as every node does

TIMEOUT_S = 20.0
# Of a service: it may render pictures, on a machine that does other things beside.
ANSWER_S = 60.0
DOMAINS = 100  # 1 to 100 keeps clear of ephemeral ports
_claims = itertools.count()


def claim_domain() -> tuple[int, TextIO]:
    """A DDS domain that no other test on this machine uses, and the lock that keeps it so until it is closed."""
    start = os.getpid() + next(_claims)  # not at once the one of the test before, which may still be going down
    for number in range(DOMAINS):
        domain = 1 + (start + number) % DOMAINS
        lock = open(Path(tempfile.gettempdir()) / f'ros_test_domain_{domain}.lock', 'w')  # noqa: SIM115
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        return domain, lock
    raise RuntimeError('all DDS domains are taken by other tests')


class Graph:
    """A ROS context, an executor, and waits on a predicate."""

    def __init__(self) -> None:
        self.domain_id, self._domain_lock = claim_domain()
        self.context = Context()
        rclpy.init(context=self.context, domain_id=self.domain_id)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.nodes: list[Node] = []
        self._tester: Node | None = None

    def add(
        self, node_class: Callable[..., Node], *args: Any, parameters: dict[str, Any] | None = None, **kwargs: Any
    ) -> Any:
        """Make a node in this graph's context and spin it with the others."""
        overrides = [rclpy.Parameter(name, value=value) for name, value in (parameters or {}).items()]
        node = node_class(*args, context=self.context, parameter_overrides=overrides, **kwargs)
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def spin_until(self, predicate: Callable[[], Any], timeout_s: float = TIMEOUT_S, what: str = '') -> Any:
        """Spin until the predicate holds, and return its value; fail when it does not in time."""
        deadline = time.monotonic() + timeout_s
        while True:
            value = predicate()
            if value:
                return value
            if time.monotonic() > deadline:
                pytest.fail(f'not within {timeout_s:g} s: {what or predicate}')
            self.executor.spin_once(timeout_sec=0.02)

    @property
    def tester(self) -> Node:
        """The test's own node, for its subscriptions, publishers and clients."""
        if self._tester is None:
            self._tester = self.add(Node, 'tester')
        return self._tester

    def collect(self, message_type: type, topic: str, depth: int = 50) -> list:
        """Subscribe; the returned list grows as messages arrive."""
        received: list = []
        self.tester.create_subscription(message_type, topic, received.append, depth)
        return received

    def publisher(self, message_type: type, topic: str, depth: int = 10) -> Any:
        return self.tester.create_publisher(message_type, topic, depth)

    def wait_matched(self, *publishers: Any, count: int = 1) -> None:
        """Discovery has joined every publisher with its subscribers."""
        self.spin_until(lambda: all(p.get_subscription_count() >= count for p in publishers), what='publishers matched')

    def wait_heard(self, *topics: str) -> None:
        """Every topic (absolute name) that the test collects has found its publisher, and they each other."""
        publishers = [p for node in self.nodes if node is not self.tester for p in node.publishers]
        wanted = [p for p in publishers if p.topic_name in topics]
        assert len(wanted) >= len(topics), f'{topics}: only {[p.topic_name for p in wanted]} are published here'
        self.wait_matched(*wanted)

    def call(self, service_type: type, name: str, request: Any) -> Any:
        """Call a service of this graph and spin until it answers."""
        client = self.tester.create_client(service_type, name)
        self.spin_until(client.service_is_ready, what=f'service {name}')
        future = client.call_async(request)
        self.spin_until(future.done, ANSWER_S, f'answer of {name}')
        self.tester.destroy_client(client)
        return future.result()

    def close(self) -> None:
        for node in self.nodes:
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()
        rclpy.try_shutdown(context=self.context)
        self._domain_lock.close()


@pytest.fixture
def graph() -> Iterator[Graph]:
    graph = Graph()
    yield graph
    graph.close()


def executable(name: str) -> str:
    """Where pip has put the console script, beside this interpreter."""
    found = shutil.which(name, path=f'{Path(sys.executable).parent}{os.pathsep}{os.environ.get("PATH", "")}')
    if found is None:
        pytest.skip(f'{name} is not installed as an executable')
    return found


@pytest.fixture
def processes(graph) -> Iterator[Callable[..., subprocess.Popen]]:
    """Starts an executable in the graph's domain: (name, remaps, parameters); what is left is killed at the end."""
    started: list[subprocess.Popen] = []

    def start(name: str, remaps: Sequence[str] = (), **parameters: str) -> subprocess.Popen:
        arguments = [item for key, value in parameters.items() for item in ('-p', f'{key}:={value}')]
        arguments += [item for remap in remaps for item in ('-r', remap)]
        environment = os.environ | {'ROS_DOMAIN_ID': str(graph.domain_id)}
        process = subprocess.Popen(
            [executable(name), '--ros-args', *arguments],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()
