"""emulator_node: the machine as a memory-like service, and array programs on an image topic."""

from __future__ import annotations

import json
from collections.abc import Generator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from rcl_interfaces.msg import ParameterValue, SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.callback_groups import ReentrantCallbackGroup
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from msgs_py.codecs import array_to_image, gray_from_image
from msgs_py.node_runtime.confinement import TrustedFolders
from msgs_py.node_runtime.runtime import GraphNode, run_node

from .fortran_plus import FortranError, Stopped
from .fortran_plus.library import program_names, summary
from .service.imaging import ImageProgram
from .service.parameter_values import value_from_message, value_to_message
from .service.service_config import EmulatorConfig
from .service.workspaces import Refused, Request, ServiceLimits, Workspaces


class _Finished:
    """Awaitable of a Future of another thread; the executor is woken by a guard condition when it is done."""

    def __init__(self, future: Future[list[Request]]) -> None:
        self.future = future

    def __await__(self) -> Generator[None, None, list[Request]]:
        while not self.future.done():
            yield
        return self.future.result()


class EmulatorNode(GraphNode[EmulatorConfig]):
    """The services ~/store, ~/run, ~/fetch and ~/list (workspaces.py has the names), and image_in -> image_out."""

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
        """Refuse an image program that lies outside of the trusted folders or cannot filter images."""
        if new.image_program:
            if new.image_program != self.config.image_program:
                try:
                    self._trusted.check(new.image_program)
                except ValueError as error:
                    raise ValueError(f'parameter image_program: {error}') from None
            ImageProgram(new.image_program, new.image_entry, new.image_model)

    def on_config(self, old: EmulatorConfig, new: EmulatorConfig) -> None:
        """Apply new limits, and compile the image program when it has changed."""
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
        except Exception as error:  # an error of the emulator itself must not end the service
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
        """Without listeners no image is processed."""
        if self.images is None:
            return None
        return None if self.wanted(self.image_out) else 'nobody listens to image_out, so no image is processed'

    def silence(self) -> str | None:
        """Say why no image comes out; a service that nobody calls is healthy."""
        return super().silence() if self.images is not None else None

    def report_values(self) -> dict[str, object]:
        """Clients, runs, failures and cycles, and the cost of the last image."""
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
        """Forget all workspaces."""
        return self.spaces.clear()

    def destroy_node(self) -> None:
        """Stop what runs, then end the worker thread."""
        self.spaces.clear()
        self._worker.shutdown(wait=True)
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Run emulator_node until it is stopped."""
    return run_node(EmulatorNode, args)
