"""DapClient: store, run and fetch on an emulator_node, from Python."""

from __future__ import annotations

import contextlib
import itertools
import json
import uuid
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from .links import DapError, Link
from .settings import CLIENT_TIMEOUT_S

SETTINGS = ('program', 'library', 'entry', 'model', 'run_request', 'cancel', 'forget')


class ClientResult(Mapping[str, Any]):
    """Arguments of the entry after a run, by upper-case name, and what the run cost.

    Attributes
    ----------
    cycles : int
    seconds : float
        On the machine: computed, not simulated.
    request : int
        Number of the request.
    """

    def __init__(self, values: dict[str, Any], cycles: int, seconds: float, request: int) -> None:
        self._values, self.cycles, self.seconds, self.request = values, cycles, seconds, request

    def __getitem__(self, name: str) -> Any:
        return self._values[name.upper()]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)


class DapClient:
    """One client of an emulator_node; its names begin with its own id, so that clients do not collide.

    Every call waits for an answer: do not call inside a callback of the same executor.

    Parameters
    ----------
    emulator : str
        Name of the emulator node, relative or absolute.
    client : str, optional
        The id; made up when not given.
    node, executor : optional
        Both or neither: used to wait with (the executor must not be spinning), instead of a pair of the client's own.
    context : optional
        In which the client's own node lives.
    namespace : str, optional
        Of the client's own node.
    timeout : float
        Time to wait for an answer, seconds.
    link : Link, optional
        What carries the requests, when it is not a ROS node. LocalLink works without ROS.

    Raises
    ------
    DapError
        By every call, when the emulator refuses or does not answer in time.

    Examples
    --------
    >>> from dap_emulator.service.links import LocalLink
    >>> from dap_emulator.service.workspaces import Workspaces
    >>> with DapClient(link=LocalLink(Workspaces())) as client:
    ...     result = client.run(library='sobel', image=[[0, 0, 9], [0, 0, 9], [0, 0, 9]])
    >>> sorted(result)
    ['ANGLE', 'IMAGE', 'RESULT']
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
        timeout: float = CLIENT_TIMEOUT_S,
        link: Link | None = None,
    ) -> None:
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
        """Write the client's own names.

        Parameters
        ----------
        **values
            program='...', library='...', entry='...', model='610', or arrays and scalars by name.

        Raises
        ------
        DapError
            When they are refused; nothing has been stored then.
        ValueError
            For an array that does not hold numbers or truths.
        """
        items: list[tuple[str, Any]] = []
        for name, given in values.items():
            scalar = isinstance(given, np.generic) or (isinstance(given, np.ndarray) and given.ndim == 0)
            value = given.item() if scalar else given
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
        """Execute everything that waits, other clients' requests too; return summaries of what this call executed."""
        summaries: list[dict[str, Any]] = json.loads(self._link.run())
        return summaries

    def programs(self) -> dict[str, str]:
        """Return the emulator's library: names of programs, and their summaries."""
        summaries: dict[str, str] = json.loads(self._link.list())
        return summaries

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
        """Store what is given, run, and fetch the results.

        Parameters
        ----------
        program : str, optional
            Text of a program; that of an earlier store when neither program nor library is given.
        library : str, optional
            Name of a library program.
        entry : str, optional
            Name of the ENTRY SUBROUTINE; needed only when there are several.
        model : str, optional
            Model of the machine.
        **arguments
            Numbers, truths, texts and arrays by name.

        Returns
        -------
        ClientResult
            Arrays have their shapes.

        Raises
        ------
        DapError
            When the request is refused, or the program fails or is stopped.
        """
        number = next(self._numbers)
        settings = {'program': program, 'library': library, 'entry': entry, 'model': model}
        self.store(
            **{name: value for name, value in settings.items() if value is not None}, **arguments, run_request=number
        )
        self.execute()
        return self.result(number)

    def result(self, number: int) -> ClientResult:
        """Fetch the result of one request. Raises DapError when it failed, was stopped, or is unknown."""
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
        with contextlib.suppress(DapError):  # when the emulator is gone, so is the workspace
            self.store(forget=True)
        self._link.close()

    def __enter__(self) -> DapClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
