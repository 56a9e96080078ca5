"""emulator_node: the machine as a memory-like service, and array programs on an image topic."""

from __future__ import annotations

import array
import json
import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
import rclpy
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue, SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from msgs_py.codecs import array_to_image, gray_from_image
from msgs_py.node_runtime.confinement import TrustedFolders
from msgs_py.node_runtime.runtime import GraphNode, run_node

from .fortran_plus import FortranError, Stopped
from .fortran_plus.library import program_names, summary
from .service.client import DapError
from .service.imaging import ImageProgram
from .service.service_config import EmulatorConfig
from .service.workspaces import Refused, ServiceLimits, Workspaces

_FIELDS = {
    ParameterType.PARAMETER_BOOL: 'bool_value',
    ParameterType.PARAMETER_INTEGER: 'integer_value',
    ParameterType.PARAMETER_DOUBLE: 'double_value',
    ParameterType.PARAMETER_STRING: 'string_value',
    ParameterType.PARAMETER_BOOL_ARRAY: 'bool_array_value',
    ParameterType.PARAMETER_INTEGER_ARRAY: 'integer_array_value',
    ParameterType.PARAMETER_DOUBLE_ARRAY: 'double_array_value',
    ParameterType.PARAMETER_STRING_ARRAY: 'string_array_value',
}


def value_from_message(message: ParameterValue) -> Any:
    """A typed variant as a Python value; arrays as numpy. Raises ValueError for a type that is not accepted."""
    if message.type not in _FIELDS:
        raise ValueError(f'type {message.type} is not accepted; use bool, integer, double, string or an array of them')
    value = getattr(message, _FIELDS[message.type])
    if isinstance(value, array.array):
        return np.array(value, dtype=np.int64 if value.typecode == 'q' else np.float64)
    if message.type == ParameterType.PARAMETER_BOOL_ARRAY:
        return np.array(value, dtype=bool)
    return list(value) if message.type == ParameterType.PARAMETER_STRING_ARRAY else value


def value_to_message(value: Any) -> ParameterValue:
    """The reverse. None: not set."""
    message = ParameterValue()
    if value is None:
        return message
    if isinstance(value, np.ndarray) and value.dtype.kind in 'iub':
        message.type = ParameterType.PARAMETER_INTEGER_ARRAY
        message.integer_array_value = array.array('q', value.astype(np.int64).tobytes())
        return message
    if isinstance(value, np.ndarray):
        message.type = ParameterType.PARAMETER_DOUBLE_ARRAY
        message.double_array_value = array.array('d', value.astype(np.float64).tobytes())
        return message
    kinds = {
        bool: ParameterType.PARAMETER_BOOL,
        int: ParameterType.PARAMETER_INTEGER,
        float: ParameterType.PARAMETER_DOUBLE,
        str: ParameterType.PARAMETER_STRING,
        list: ParameterType.PARAMETER_STRING_ARRAY,
    }
    message.type = kinds[type(value)]
    setattr(message, _FIELDS[message.type], value)
    return message


class ServiceLink:
    """A client's link over ROS services. node, executor: given, or its own pair in the given context."""

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
        parameters = [Parameter(name=name, value=value_to_message(value)) for name, value in items]
        result = self._call(self._store, SetParametersAtomically.Request(parameters=parameters)).result
        return None if result.successful else result.reason

    def run(self) -> str:
        return self._call(self._run, Trigger.Request()).message

    def fetch(self, names: list[str]) -> list[Any]:
        values = self._call(self._fetch, GetParameters.Request(names=names)).values
        return [
            None if value.type == ParameterType.PARAMETER_NOT_SET else value_from_message(value) for value in values
        ]

    def list(self) -> str:
        return self._call(self._list, Trigger.Request()).message

    def close(self) -> None:
        for service in (self._store, self._run, self._fetch, self._list):
            self._node.destroy_client(service)
        if self._own:
            self._executor.shutdown()
            self._node.destroy_node()
        if self._initialised:
            rclpy.try_shutdown()

    def _call(self, service: Any, request: Any) -> Any:
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


class _Finished:
    """Awaitable of a Future of another thread; the executor is woken by a guard condition when it is done."""

    def __init__(self, future: Future) -> None:
        self.future = future

    def __await__(self):
        while not self.future.done():
            yield
        return self.future.result()


class EmulatorNode(GraphNode[EmulatorConfig]):
    """Serves ~/store, ~/run, ~/fetch and ~/list (see workspaces.py for the names), and image_in -> image_out."""

    def __init__(self, **kwargs: Any) -> None:
        self.spaces = Workspaces()
        self.images: ImageProgram | None = None
        super().__init__('emulator_node', EmulatorConfig, **kwargs)
        started_with = [self.config.image_program] if self.config.image_program else []
        self._trusted = TrustedFolders(self.config.program_folders, started_with, 'program_folders')
        self.on_config(self.config, self.config)
        # Runs happen in a thread of their own, so that a store can cancel one and a fetch can watch it.
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix='dap')
        self._wake = self.create_guard_condition(lambda: None)
        self.create_service(SetParametersAtomically, '~/store', self._on_store)
        self.create_service(GetParameters, '~/fetch', self._on_fetch)
        self.create_service(Trigger, '~/list', self._on_list)
        self.create_service(Trigger, '~/run', self._on_run, callback_group=ReentrantCallbackGroup())
        self.image_out = self.create_output(Image, 'image_out')
        self.listen(Image, 'image_in', self._on_image)

    def check_config(self, new: EmulatorConfig) -> None:
        if new.image_program:
            if new.image_program != self.config.image_program:
                try:
                    self._trusted.check(new.image_program)
                except ValueError as error:
                    raise ValueError(f'parameter image_program: {error}') from None
            ImageProgram(new.image_program, new.image_entry, new.image_model)

    def on_config(self, old: EmulatorConfig, new: EmulatorConfig) -> None:
        self.spaces.limits = ServiceLimits(
            new.max_program_bytes, new.max_store_bytes, new.max_run_seconds, new.max_clients
        )
        if not new.image_program:
            self.images = None
        elif self.images is None or self.images.settings != (new.image_program, new.image_entry, new.image_model):
            try:
                self.images = ImageProgram(new.image_program, new.image_entry, new.image_model)
            except (ValueError, OSError) as error:
                self.problem(f'parameter image_program: {error}')

    def _on_store(
        self, request: SetParametersAtomically.Request, response: SetParametersAtomically.Response
    ) -> SetParametersAtomically.Response:
        try:
            items = []
            for parameter in request.parameters:
                try:
                    items.append((parameter.name, value_from_message(parameter.value)))
                except ValueError as error:
                    raise Refused(f'{parameter.name}: {error}') from None
            self.spaces.store(items)
            response.result = SetParametersResult(successful=True)
        except Refused as error:
            response.result = SetParametersResult(successful=False, reason=str(error))
        except Exception as error:  # a fault of ours must not take the service down
            self.problem(f'store: {type(error).__name__}: {error}')
            response.result = SetParametersResult(successful=False, reason=f'{type(error).__name__}: {error}')
        return response

    async def _on_run(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Execute what waits, oldest first; done when everything that waited on arrival is done."""
        future = self._worker.submit(self.spaces.execute_waiting)
        future.add_done_callback(lambda _: self._wake.trigger())
        waiting = await _Finished(future)
        response.success = all(item.state == 'done' for item in waiting)
        response.message = json.dumps([item.summary() for item in waiting])
        return response

    def _on_fetch(self, request: GetParameters.Request, response: GetParameters.Response) -> GetParameters.Response:
        for name in request.names:
            try:
                response.values.append(value_to_message(self.spaces.fetch(name)))
            except Exception as error:
                self.problem(f'fetch {name}: {type(error).__name__}: {error}')
                response.values.append(ParameterValue())
        return response

    def _on_list(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        response.message = json.dumps({name: summary(name) for name in program_names()})
        return response

    def _on_image(self, message: Image) -> None:
        if self.images is None:
            raise ValueError('no program: set the parameter image_program')
        if not self.wanted(self.image_out):
            return
        try:
            result = self.images.run(gray_from_image(message), self.config.max_run_seconds)
        except (FortranError, Stopped) as error:
            raise ValueError(f'{self.config.image_program}: {error}') from None
        self.image_out.publish(array_to_image(result, 'mono8', message.header))
        self.done(message.header)

    def why_silent(self) -> str | None:
        if self.images is None:
            return None
        return None if self.wanted(self.image_out) else 'nobody listens to image_out, so no image is processed'

    def silence(self) -> str | None:
        """A service that nobody calls is healthy; only a configured image program can be silent."""
        return super().silence() if self.images is not None else None

    def report_values(self) -> dict[str, object]:
        values: dict[str, object] = {
            'clients': self.spaces.clients,
            'runs': self.spaces.runs,
            'failed_runs': self.spaces.failures,
            'cycles': self.spaces.cycles,
        }
        if self.images is not None:
            values |= {
                'image_program': self.config.image_program,
                'image_cycles': self.images.cycles,
                'image_dap_seconds': self.images.seconds,
            }
        return values

    def reset(self) -> str:
        return self.spaces.clear()

    def destroy_node(self) -> None:
        self.spaces.clear()
        self._worker.shutdown(wait=True)
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    return run_node(EmulatorNode, args)
