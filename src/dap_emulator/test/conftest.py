"""Fixtures: machines, and an emulator_node that spins in a context of its own."""

from __future__ import annotations

import itertools
import os
import threading

import pytest

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

from dap_emulator import Dap

_domains = itertools.count()


@pytest.fixture
def dap():
    return Dap.model('510')


class Emulator:
    """An emulator_node spun by a thread, and clients in the same context."""

    def __init__(self, **parameters):
        import rclpy
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor

        from dap_emulator.node import EmulatorNode

        worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:])
        self.context = Context()
        rclpy.init(context=self.context, domain_id=1 + (50 + worker * 25 + next(_domains)) % 100)
        overrides = [rclpy.Parameter(name, value=value) for name, value in parameters.items()]
        self.node = EmulatorNode(context=self.context, parameter_overrides=overrides)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        self._clients = []

    def _spin(self):
        while not self._stop.is_set() and self.context.ok():
            self.executor.spin_once(timeout_sec=0.05)

    def client(self, name=None, **options):
        from dap_emulator import DapClient

        client = DapClient(client=name, context=self.context, **options)
        self._clients.append(client)
        return client

    def close(self):
        import rclpy

        for client in self._clients:
            client.close()
        self._stop.set()
        self._thread.join(timeout=10)
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def start_emulator():
    """start_emulator(**parameters) -> Emulator"""
    running = []

    def start(**parameters):
        running.append(Emulator(**parameters))
        return running[-1]

    yield start
    for emulator in running:
        emulator.close()
