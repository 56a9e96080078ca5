"""A client's link to an emulator_node over ROS services."""

from __future__ import annotations

import time
from typing import Any

import rclpy
from rcl_interfaces.msg import Parameter, ParameterType
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from .links import DapError
from .parameter_values import value_from_message, value_to_message


class ServiceLink:
    """A client's link over ROS services.

    Parameters
    ----------
    emulator : str
        Name of the emulator node, relative or absolute.
    name : str
        Name of the link's own node.
    node, executor : optional
        Both or neither: used to wait with, instead of a node and an executor of the link's own.
    context : optional
        In which the link's own node lives.
    namespace : str, optional
        Of the link's own node.
    timeout : float
        Time to wait for an answer, seconds.

    Raises
    ------
    ValueError
        When only one of node and executor is given.
    """

    def __init__(
        self,
        emulator: str,
        name: str,
        node: Node | None,
        executor: Any,
        context: Any,
        namespace: str | None,
        timeout: float,
    ) -> None:
        if (node is None) != (executor is None):
            raise ValueError('node and executor: give both or neither')
        self.timeout = timeout
        self._own, self._initialised = node is None, False
        if node is None:
            if context is None and not rclpy.ok():
                rclpy.init()
                self._initialised = True
            node = Node(name, context=context, namespace=namespace, start_parameter_services=False, enable_rosout=False)
            executor = SingleThreadedExecutor(context=context)
            executor.add_node(node)
        self._node, self._executor = node, executor
        self._store = node.create_client(SetParametersAtomically, f'{emulator}/store')
        self._run = node.create_client(Trigger, f'{emulator}/run')
        self._fetch = node.create_client(GetParameters, f'{emulator}/fetch')
        self._list = node.create_client(Trigger, f'{emulator}/list')

    def store(self, items: list[tuple[str, Any]]) -> str | None:
        """Store names and values; return None, or the reason why nothing was stored."""
        parameters = [Parameter(name=name, value=value_to_message(value)) for name, value in items]
        result = self._call(self._store, SetParametersAtomically.Request(parameters=parameters)).result
        return None if result.successful else result.reason

    def run(self) -> str:
        """Execute what waits; return its summaries as JSON text."""
        return str(self._call(self._run, Trigger.Request()).message)

    def fetch(self, names: list[str]) -> list[Any]:
        """Read the values of names; None where there is none."""
        values = self._call(self._fetch, GetParameters.Request(names=names)).values
        return [
            None if value.type == ParameterType.PARAMETER_NOT_SET else value_from_message(value) for value in values
        ]

    def list(self) -> str:
        """Return the library's programs, name to summary, as JSON text."""
        return str(self._call(self._list, Trigger.Request()).message)

    def close(self) -> None:
        """Destroy the clients of the services, and the node and context that the link has made."""
        for service in (self._store, self._run, self._fetch, self._list):
            self._node.destroy_client(service)
        if self._own:
            self._executor.shutdown()
            self._node.destroy_node()
        if self._initialised:
            rclpy.try_shutdown()

    def _call(self, service: Any, request: Any) -> Any:
        """Call a service and wait. Raises DapError when no answer comes in time."""
        if not service.wait_for_service(timeout_sec=self.timeout):
            raise DapError(f'{service.srv_name}: no such service within {self.timeout:g} s; is emulator_node running?')
        future = service.call_async(request)
        # Not spin_until_future_complete: each call of it leaves tasks behind in the executor, which slow down the next.
        deadline = time.monotonic() + self.timeout
        while not future.done() and (left := deadline - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)
        if not future.done():
            service.remove_pending_request(future)
            raise DapError(f'{service.srv_name}: no answer within {self.timeout:g} s')
        return future.result()
