"""One live node under test in this process, and a node that talks to it over real topics and services."""

from __future__ import annotations

import time
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from msgs_py.node_runtime.runtime import GraphNode, spin_once

HANG_S = 2.0


class Failed(AssertionError):
    """The node did not do what it must."""


class Harness:
    """One node under test and the fuzzer's own, in a context of their own."""

    def __init__(self, node_class: type[GraphNode], parameters: dict[str, Any], domain: int) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.executor = SingleThreadedExecutor(context=self.context)
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        self.node = node_class(context=self.context, parameter_overrides=overrides)
        self.node.get_logger().set_level(rclpy.logging.LoggingSeverity.FATAL)
        self.tester = Node('fuzzer', context=self.context)
        for node in (self.node, self.tester):
            self.executor.add_node(node)
        self.spin(lambda: not self.node.compiling, 300.0)  # what is not compiled yet is no hang

    def spin(self, done, timeout_s: float) -> float | None:
        """Spin until done() and return the seconds it took, or None."""
        start = time.monotonic()
        while not done():
            if time.monotonic() - start > timeout_s:
                return None
            spin_once(self.node, self.executor, 0.02)
        return time.monotonic() - start

    def publishers(self, types: dict[str, type]) -> dict[str, Any]:
        made = {topic: self.tester.create_publisher(kind, topic, 10) for topic, kind in types.items()}
        if self.spin(lambda: all(p.get_subscription_count() for p in made.values()), 20.0) is None:
            raise Failed('publishers found no subscriber')
        return made

    def call(self, client: Any, request: Any, timeout_s: float = HANG_S + 3.0) -> Any:
        future = client.call_async(request)
        if self.spin(future.done, timeout_s) is None:
            raise Failed(f'{client.srv_name} did not answer {str(request)[:300]}')
        return future.result()

    def close(self) -> None:
        for node in (self.node, self.tester):
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()
        rclpy.try_shutdown(context=self.context)
