"""emulator_node: the machine as a memory-like service, and array programs on an image topic."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, TypeVar

from rcl_interfaces.msg import ParameterValue, SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.callback_groups import ReentrantCallbackGroup
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from msgs_py.codecs import array_to_image, gray_from_image
from msgs_py.node_runtime.beside import ENDING_S, LOOK_S, Beside
from msgs_py.node_runtime.confinement import TrustedFolders
from msgs_py.node_runtime.runtime import GraphNode, run_node
from msgs_py.node_runtime.until import Until
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.typed import ByteArray

from .fortran_plus import Stopped
from .fortran_plus.library import program_names, summary
from .service.imaging import ImageProgram
from .service.parameter_values import value_from_message, value_to_message
from .service.processes import PROCESSES, ProgramFailed
from .service.service_config import EmulatorConfig
from .service.settings import MAX_CALLS
from .service.workspaces import Refused, ServiceLimits, Workspaces

_T = TypeVar('_T')
NO_PROGRAM = 'no program: set the parameter image_program'


class EmulatorNode(GraphNode[EmulatorConfig]):
    """The services ~/store, ~/run, ~/fetch and ~/list (workspaces.py has the names), and image_in -> image_out."""

    def __init__(self, **kwargs: Any) -> None:
        self.spaces = Workspaces()
        self.images: ImageProgram | None = None
        super().__init__('emulator_node', EmulatorConfig, **kwargs)
        started_with = [self.config.image_program] if self.config.image_program else []
        self._trusted = TrustedFolders(self.config.program_folders, started_with, 'program_folders')
        # Threads that wait for the processes in which programs run and are compiled, so that meanwhile a store can
        # cancel a run, and a fetch can watch it.
        self._runner, self._compiler = (
            ThreadPoolExecutor(max_workers=1, thread_name_prefix=f'dap {what}') for what in ('run', 'compile')
        )
        self._calls = 0
        self._filter = Beside(self, 'image_in', self._begin_image, self._publish_image)
        self._no_more_images = threading.Event()
        PROCESSES.prepare()
        self.create_service(SetParametersAtomically, '~/store', self._on_store, callback_group=ReentrantCallbackGroup())
        self.create_service(GetParameters, '~/fetch', self._on_fetch)
        self.create_service(Trigger, '~/list', self._on_list)
        self.create_service(Trigger, '~/run', self._on_run, callback_group=ReentrantCallbackGroup())
        self.start()

    def configure(self) -> None:
        """Make the output, take over the limits, and compile the image program."""
        self.image_out = self.create_output(Image, 'image_out')
        self.on_config(self.config, self.config)

    def unusable(self) -> str:
        """An image program that cannot be used, or a parameter that was refused. See ManagedNode."""
        missing = self.config.image_program and self.images is None
        return super().unusable() or (self.health.last_error if missing else '')

    def activate(self) -> None:
        """Subscribe to the images; programs may be stored and run."""
        self.listen(Image, 'image_in', self._on_image)
        self.every(LOOK_S, self._filter.look, clock=self._steady_clock)

    def deactivate(self) -> None:
        """Stop what runs, and forget all workspaces."""
        self.spaces.clear()
        self._filter.drop()

    def cleanup(self) -> None:
        """Forget the image program."""
        self.images = None

    def _refuse_unless_active(self) -> None:
        """Raise Refused."""
        if not self.active:
            raise Refused(f'emulator_node is {self.lifecycle}')

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
            new.max_program_bytes, new.max_store_bytes, new.max_run_seconds, new.max_clients, new.max_total_bytes
        )
        if not new.image_program:
            self.images = None
        elif self.images is None or self.images.settings != (new.image_program, new.image_entry, new.image_model):
            try:
                self.images = ImageProgram(new.image_program, new.image_entry, new.image_model)
            except (ValueError, OSError) as error:
                self.problem(f'parameter image_program: {error}')

    async def _on_store(
        self, request: SetParametersAtomically.Request, response: SetParametersAtomically.Response
    ) -> SetParametersAtomically.Response:
        try:
            self._refuse_unless_active()
            items = []
            for parameter in request.parameters:
                try:
                    items.append((parameter.name, value_from_message(parameter.value)))
                except ValueError as error:
                    raise Refused(f'{parameter.name}: {error}') from None
            if any(name.endswith(('.program', '.library')) for name, _ in items):
                await self._done(self._compiler, self.spaces.store, items)
            else:
                self.spaces.store(items)
            response.result = SetParametersResult(successful=True)
        except Refused as error:
            response.result = SetParametersResult(successful=False, reason=str(error))
        except Exception as error:  # an error of the emulator itself must not end the service
            self.problem(f'store: {type(error).__name__}: {error}')
            response.result = SetParametersResult(successful=False, reason=f'{type(error).__name__}: {error}')
        return response

    async def _done(self, threads: ThreadPoolExecutor, work: Callable[..., _T], *arguments: Any) -> _T:
        """What work of a call gives in its thread. Raises Refused when too many calls wait already."""
        if self._calls >= MAX_CALLS:
            raise Refused(f'{self._calls} calls are waiting already')
        self._calls += 1
        try:
            future = threads.submit(work, *arguments)
            await Until(future.done)
            return future.result()
        finally:
            self._calls -= 1

    async def _on_run(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Execute what waits, oldest first; done when everything that waited on arrival is done."""
        try:
            self._refuse_unless_active()
            waiting = await self._done(self._runner, self.spaces.execute_waiting)
        except Refused as error:
            response.success, response.message = False, str(error)
            return response
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
            raise ValueError(NO_PROGRAM)
        if not self.wanted(self.image_out):
            return
        self._filter.take(message)

    @property
    def filtering(self) -> bool:
        """Whether the program has an image in hand."""
        return self._filter.busy

    def _begin_image(self, message: Image, deadline: Deadline) -> Callable[[], ByteArray]:
        """An image through the program of now, which its own limit ends."""
        if self.images is None:
            raise ValueError(NO_PROGRAM)
        run = partial(self.images.run, gray_from_image(message), self.config.max_run_seconds, self._no_more_images)
        return partial(_named, self.config.image_program, run)

    def _publish_image(self, message: Image, result: ByteArray) -> None:
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
        """Stop what runs, then end the worker threads."""
        self.spaces.close()
        self._no_more_images.set()
        self._filter.close(ENDING_S)
        for threads in (self._runner, self._compiler):
            threads.shutdown(wait=True)
        super().destroy_node()


def _named(program: str, run: Callable[[], ByteArray]) -> ByteArray:
    """What a program makes of an image; its failure says which program it was."""
    try:
        return run()
    except (ProgramFailed, Stopped) as error:
        raise ValueError(f'{program}: {error}') from None


def main(args: list[str] | None = None) -> int:
    """Run emulator_node until it is stopped."""
    return run_node(EmulatorNode, args)
