"""DapClient: store, run and fetch on an emulator_node, from Python."""

from __future__ import annotations

import contextlib
import itertools
import json
import uuid
from collections.abc import Mapping
from typing import Any

import numpy as np

from .links import DapError, Link

SETTINGS = ('program', 'library', 'entry', 'model', 'run_request', 'cancel', 'forget')


class ClientResult(Mapping[str, Any]):
    """Arguments of the entry after a run, by upper-case name, and what the run cost (computed, not simulated)."""

    def __init__(self, values: dict[str, Any], cycles: int, seconds: float, request: int) -> None:
        self._values, self.cycles, self.seconds, self.request = values, cycles, seconds, request

    def __getitem__(self, name: str) -> Any:
        return self._values[name.upper()]

    def __iter__(self):
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)


class DapClient:
    """One client of an emulator_node; its names carry its own id, so clients do not meet.

    emulator : the node's name, relative or absolute; client : the id (made up when not given)
    node, executor : use these to wait with (the executor must not be spinning); otherwise the client has its own pair,
    in the given context. Its calls wait for an answer, so do not call them inside a callback of that executor.
    Every call raises DapError when the emulator refuses or does not answer within timeout seconds.
    """

    def __init__(
        self,
        emulator: str = 'emulator_node',
        client: str | None = None,
        *,
        node: Any = None,
        executor: Any = None,
        context: Any = None,
        namespace: str | None = None,
        timeout: float = 30.0,
        link: Link | None = None,
    ) -> None:
        """link: what carries the requests, when it is not a ROS node (LocalLink needs none)."""
        self.client = client or 'c' + uuid.uuid4().hex[:12]
        if link is None:
            # A client of Workspaces in its own process (LocalLink) works without ROS.
            from .service_link import ServiceLink

            link = ServiceLink(
                emulator, f'dap_client_{self.client.replace("-", "_")}', node, executor, context, namespace, timeout
            )
        self._link: Link = link
        self._numbers = itertools.count(1)

    # The three services.

    def store(self, **values: Any) -> None:
        """Write the client's own names: program='...', entry='...', model='610', or arrays and scalars by name."""
        items: list[tuple[str, Any]] = []
        for name, value in values.items():
            if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.ndim == 0):
                value = value.item()
            if name in SETTINGS:
                items.append((f'{self.client}.{name}', value))
            elif isinstance(value, (list, tuple, np.ndarray)):
                array = np.asarray(value)
                if array.dtype.kind not in 'biuf':
                    raise ValueError(f'{name}: expected numbers or truths, got {array.dtype}')
                items.append((f'{self.client}.data.{name}', array.reshape(-1)))
                items.append((f'{self.client}.shape.{name}', np.asarray(array.shape, dtype=np.int64)))
            else:
                items.append((f'{self.client}.data.{name}', value))
        reason = self._link.store(items)
        if reason is not None:
            raise DapError(reason)

    def fetch(self, *names: str) -> list[Any]:
        """Read the client's own names, for example 'result.3.cycles'; None where there is nothing."""
        return self._link.fetch([f'{self.client}.{name}' for name in names])

    def execute(self) -> list[dict[str, Any]]:
        """~/run: everything that waits, mine among it. A summary of what this call executed."""
        return json.loads(self._link.run())

    def programs(self) -> dict[str, str]:
        """The emulator's library: name and summary."""
        return json.loads(self._link.list())

    # The three together.

    def run(
        self,
        program: str | None = None,
        *,
        library: str | None = None,
        entry: str | None = None,
        model: str | None = None,
        **arguments: Any,
    ) -> ClientResult:
        """Store what is given, run, fetch the results. Arrays come back in their shapes."""
        number = next(self._numbers)
        settings = {'program': program, 'library': library, 'entry': entry, 'model': model}
        self.store(
            **{name: value for name, value in settings.items() if value is not None}, **arguments, run_request=number
        )
        self.execute()
        return self.result(number)

    def result(self, number: int) -> ClientResult:
        """The result of one request. Raises DapError when it failed, was stopped, or is unknown."""
        base = f'result.{number}'
        state, message, cycles, seconds, names = self.fetch(
            *(f'{base}.{what}' for what in ('state', 'message', 'cycles', 'seconds', 'names'))
        )
        if state is None:
            raise DapError(f'request {number}: unknown to the emulator (forgotten, or pushed out by later ones)')
        if state != 'done':
            raise DapError(message or f'request {number} is {state}')
        wanted = [f'{base}.{what}.{name}' for name in names for what in ('data', 'shape')]
        found = self.fetch(*wanted) if wanted else []
        values = {
            name: data if shape is None else np.asarray(data).reshape(shape)
            for name, data, shape in zip(names, found[::2], found[1::2])
        }
        return ClientResult(values, cycles, seconds, number)

    def cancel(self, number: int) -> None:
        """Stop a request of this client, waiting or running."""
        self.store(cancel=number)

    def close(self) -> None:
        """Forget the workspace and give everything back."""
        with contextlib.suppress(DapError):  # the emulator is gone, and the workspace with it
            self.store(forget=True)
        self._link.close()

    def __enter__(self) -> DapClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
