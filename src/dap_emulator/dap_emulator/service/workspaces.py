"""Workspaces of the emulator's clients, without ROS: named values, requests, results and limits.

To its host a DAP is extra memory, so a client writes and reads named values. Every name starts with the client's id:

    <client>.program            text: the program (compiled when stored, so an error is refused at once)
    <client>.library            text: or the name of a library program
    <client>.entry              text: which ENTRY SUBROUTINE (needed only when there are several)
    <client>.model              text: 510 (default), 610, 510C, 610C, ICL
    <client>.data.<NAME>        number, truth or text; or a flat array in row order
    <client>.shape.<NAME>       its extents, when it is not a vector
    <client>.run_request        whole number > 0: queue this workspace, as it now is, under this id
    <client>.cancel             whole number: stop that request, waiting or running
    <client>.forget             true: drop the workspace

A request takes the workspace as it was when stored, so later stores do not disturb it. Results are read under the
request's id, and are kept until the client's later requests push them out:

    <client>.result.<id>.state          waiting, running, done, failed, stopped
    <client>.result.<id>.message        why it failed or stopped
    <client>.result.<id>.cycles, .seconds, .statistics, .listing, .trace (the last operations)
    <client>.result.<id>.names          the arguments that can be read
    <client>.result.<id>.data.<NAME>, .shape.<NAME>
"""

from __future__ import annotations

import re
import threading
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from msgs_py.numeric.typed import IntArray

from ..fortran_plus import FortranError, Limits, Program, Result, Stopped
from ..fortran_plus.library import compiled, program_source
from ..machine.dap import Dap
from ..machine.machine import MODELS, OutOfStore
from .settings import (
    CLIENTS,
    LONGEST_NAME,
    MAX_DIMENSIONS,
    MAX_WAITING,
    MOST_DIGITS,
    PROGRAM_BYTES,
    RESULTS_KEPT,
    RUN_SECONDS,
    STORE_BYTES,
    TRACE_KEPT,
)

_CLIENT = rf'([A-Za-z0-9_-]{{1,{LONGEST_NAME}}})'
_NAME = re.compile(
    _CLIENT + r'\.(program|library|entry|model|run_request|cancel|forget|(data|shape)\.'
    rf'([A-Za-z][A-Za-z0-9_]{{0,{LONGEST_NAME - 1}}}))'
)
_RESULT = re.compile(_CLIENT + rf'\.result\.(\d{{1,{MOST_DIGITS}}})\.(.+)')


class Refused(ValueError):
    """A store cannot be accepted; nothing of it has been."""


@dataclass(frozen=True)
class ServiceLimits:
    """What clients may use.

    Parameters
    ----------
    program_bytes : int
        Length of a program's text, characters.
    store_bytes : int
        Data of one client, bytes.
    run_seconds : float
        Time of one run on this computer.
    clients : int
        Workspaces kept; the one that has been idle for longest makes room for a new one.
    """

    program_bytes: int = PROGRAM_BYTES
    store_bytes: int = STORE_BYTES
    run_seconds: float = RUN_SECONDS
    clients: int = CLIENTS


@dataclass
class Request:
    """A queued run: the workspace as it was when it was queued, and afterwards the result.

    Parameters
    ----------
    client : str
    number : int
        The client's number of the request.
    program : Program
    entry : str, optional
    model : str
        Model of the machine.
    data : dict of str to value
    shapes : dict of str to tuple of int
    state : {'waiting', 'running', 'done', 'failed', 'stopped'}
    message : str
        Why it failed or was stopped.
    result : Result, optional
    trace : list of str
        The last operations.
    cancelled : threading.Event
    """

    client: str
    number: int
    program: Program
    entry: str | None
    model: str
    data: dict[str, Any]
    shapes: dict[str, tuple[int, ...]]
    state: str = 'waiting'
    message: str = ''
    result: Result | None = None
    trace: list[str] = field(default_factory=list)
    cancelled: threading.Event = field(default_factory=threading.Event)

    def summary(self) -> dict[str, Any]:
        """Describe it for the answer of ~/run."""
        cost = {} if self.result is None else {'cycles': self.result.cycles, 'seconds': self.result.seconds}
        return {'client': self.client, 'id': self.number, 'state': self.state, 'message': self.message, **cost}


@dataclass
class Workspace:
    """One client's values."""

    program: Program | None = None
    entry: str | None = None
    model: str = '510'
    data: dict[str, Any] = field(default_factory=dict)
    shapes: dict[str, tuple[int, ...]] = field(default_factory=dict)
    requests: OrderedDict[int, Request] = field(default_factory=OrderedDict)

    @property
    def bytes(self) -> int:
        """Size of its data."""
        return sum(_bytes(value) for value in self.data.values())

    @property
    def busy(self) -> bool:
        """Whether a request waits or runs."""
        return any(request.state in ('waiting', 'running') for request in self.requests.values())


class Workspaces:
    """All clients. Thread-safe: one thread may execute requests while another stores and fetches.

    Parameters
    ----------
    limits : ServiceLimits, optional

    Attributes
    ----------
    runs, failures, cycles : int
        Requests executed, those of them that failed or were stopped, and cycles of the machine in all.

    Examples
    --------
    >>> spaces = Workspaces()
    >>> spaces.store([('me.library', 'life'), ('me.data.GENERATIONS', 1)])
    >>> spaces.store([('me.data.CELLS', [True] * 4), ('me.shape.CELLS', [2, 2]), ('me.run_request', 1)])
    >>> [request.state for request in spaces.execute_waiting()]
    ['done']
    >>> spaces.fetch('me.result.1.names')
    ['CELLS', 'GENERATIONS']
    """

    def __init__(self, limits: ServiceLimits | None = None) -> None:
        self.limits = limits or ServiceLimits()
        self._lock = threading.RLock()
        self._executing = threading.Lock()
        self._clients: OrderedDict[str, Workspace] = OrderedDict()
        self._waiting: list[Request] = []
        self.runs = self.failures = self.cycles = 0

    # ~/store

    def store(self, items: list[tuple[str, Any]]) -> None:
        """Store all of these names and values, or none.

        Parameters
        ----------
        items : list of (str, value)
            Names as in this module's description.

        Raises
        ------
        Refused
            With the reason.
        """
        with self._lock:
            drafts: dict[str, Workspace] = {}
            actions: list[tuple[str, str, int]] = []
            for name, value in items:
                found = _NAME.fullmatch(name)
                if not found:
                    raise Refused(
                        f'{name}: expected <client>.program, library, entry, model, data.<NAME>, '
                        'shape.<NAME>, run_request, cancel or forget'
                    )
                client, what, group, variable = found.groups()
                draft = drafts.setdefault(client, self._draft(client))
                try:
                    if what in ('run_request', 'cancel', 'forget'):
                        actions.append((client, what, _whole(value, what != 'forget')))
                    else:
                        self._set(draft, group or what, (variable or '').upper(), value)
                except ValueError as error:
                    raise Refused(f'{name}: {error}') from None
            for client, draft in drafts.items():
                self._check(client, draft)
            requests = self._requests(drafts, actions)
            self._accept(drafts, actions, requests)

    def _draft(self, client: str) -> Workspace:
        """A copy of a client's workspace, to be changed."""
        now = self._clients.get(client)
        if now is None:
            return Workspace()
        return Workspace(now.program, now.entry, now.model, dict(now.data), dict(now.shapes), now.requests)

    def _set(self, draft: Workspace, what: str, variable: str, value: Any) -> None:
        """Write one value into a draft. Raises ValueError."""
        if what == 'data':
            draft.data[variable] = _value(value)
            draft.shapes.pop(variable, None)
        elif what == 'shape':
            extents = np.asarray(value)
            if (
                extents.dtype.kind != 'i'
                or extents.ndim != 1
                or not 1 <= extents.size <= MAX_DIMENSIONS
                or (extents < 1).any()
            ):
                raise ValueError('expected a list of extents of at least 1')
            draft.shapes[variable] = tuple(int(extent) for extent in extents)
        elif not isinstance(value, str):
            raise ValueError(f'expected a text, got {type(value).__name__}')
        elif what == 'program':
            if len(value) > self.limits.program_bytes:
                raise ValueError(f'{len(value)} characters, at most {self.limits.program_bytes} are accepted')
            draft.program = compiled(value)
        elif what == 'library':
            draft.program = compiled(program_source(value))
        elif what == 'model':
            if value.upper() not in MODELS:
                raise ValueError(f'expected one of {", ".join(MODELS)}, got {value!r}')
            draft.model = value.upper()
        else:
            draft.entry = value or None

    def _check(self, client: str, draft: Workspace) -> None:
        """Check sizes of a draft's data. Raises Refused."""
        for name, shape in draft.shapes.items():
            value = draft.data.get(name)
            size = value.size if isinstance(value, np.ndarray) else None
            if size is not None and int(np.prod(shape, dtype=np.int64)) != size:
                raise Refused(f'{client}.shape.{name}: {shape} does not hold {size} elements')
        if draft.bytes > self.limits.store_bytes:
            raise Refused(f'{client}: {draft.bytes} bytes of data, at most {self.limits.store_bytes} are accepted')

    def _requests(self, drafts: dict[str, Workspace], actions: list[tuple[str, str, int]]) -> list[Request]:
        """The runs that are asked for. Raises Refused."""
        requests: list[Request] = []
        for client, what, number in actions:
            if what != 'run_request':
                continue
            draft = drafts[client]
            if draft.program is None:
                raise Refused(f'{client}.run_request: no program is stored')
            try:
                draft.program.entry(draft.entry)
            except ValueError as error:
                raise Refused(f'{client}.run_request: {error}') from None
            if number in draft.requests or any((r.client, r.number) == (client, number) for r in requests):
                raise Refused(f'{client}.run_request: {number} was used before')
            if sum(request.state == 'waiting' for request in draft.requests.values()) >= MAX_WAITING:
                raise Refused(f'{client}.run_request: {MAX_WAITING} requests are waiting already')
            requests.append(
                Request(client, number, draft.program, draft.entry, draft.model, dict(draft.data), dict(draft.shapes))
            )
        return requests

    def _accept(
        self, drafts: dict[str, Workspace], actions: list[tuple[str, str, int]], requests: list[Request]
    ) -> None:
        """Put drafts, requests and actions into effect. Raises Refused when there is no room for a new client."""
        new = [client for client in drafts if client not in self._clients]
        while new and len(self._clients) + len(new) > self.limits.clients:
            idle = next((name for name, space in self._clients.items() if not space.busy and name not in drafts), None)
            if idle is None:
                raise Refused(f'{new[0]}: {self.limits.clients} clients are busy')
            del self._clients[idle]
        for client, draft in drafts.items():
            self._clients[client] = draft
            self._clients.move_to_end(client)
        for request in requests:
            kept = self._clients[request.client].requests
            kept[request.number] = request
            self._waiting.append(request)
            for number in [n for n, r in kept.items() if r.state not in ('waiting', 'running')][:-RESULTS_KEPT]:
                del kept[number]
        for client, what, number in actions:
            if what == 'cancel' and number in self._clients[client].requests:
                self._cancel(self._clients[client].requests[number])
            elif what == 'forget' and number and client in self._clients:
                for request in self._clients.pop(client).requests.values():
                    self._cancel(request)

    def _cancel(self, request: Request) -> None:
        """Stop a request, waiting or running."""
        request.cancelled.set()
        if request.state == 'waiting':
            request.state, request.message = 'stopped', 'cancelled'
            if request in self._waiting:
                self._waiting.remove(request)

    # ~/run

    def take_waiting(self) -> list[Request]:
        """Take the requests that wait, oldest first; the caller executes them."""
        with self._lock:
            taken, self._waiting = self._waiting, []
            return taken

    def execute_waiting(self) -> list[Request]:
        """Execute what waits, after what another thread has begun to execute.

        Returns
        -------
        list of Request
            Those that this call executed.
        """
        with self._executing:
            waiting = self.take_waiting()
            for request in waiting:
                self.execute(request)
            return waiting

    def execute(self, request: Request) -> None:
        """Run one request; its state says how it went. Raises nothing."""
        with self._lock:
            if request.cancelled.is_set():
                request.state, request.message = 'stopped', 'cancelled'
                return
            request.state = 'running'
        state, message, result = 'done', '', None
        try:
            dap = Dap.model(request.model)
            limits = Limits(seconds=self.limits.run_seconds, cancelled=request.cancelled)
            arguments = _arguments(request)
            result = request.program.run(dap, request.entry, limits=limits, **arguments)
            request.trace = [str(entry) for entry in list(dap.trace)[-TRACE_KEPT:]]
        except Stopped as error:
            state, message = 'stopped', str(error)
        except (FortranError, ValueError, OutOfStore) as error:
            state, message = 'failed', str(error)
        except Exception as error:  # a fault of ours must not leave the request running for ever
            state, message = 'failed', f'{type(error).__name__}: {error}'
        with self._lock:
            request.result, request.message, request.state = result, message, state
            request.data, request.shapes = {}, {}
            self.runs += 1
            self.failures += state != 'done'
            self.cycles += result.cycles if result is not None else 0

    # ~/fetch

    def fetch(self, name: str) -> Any:
        """Read the value of a name, or None when there is none."""
        with self._lock:
            result = _RESULT.fullmatch(name)
            if result:
                space = self._clients.get(result[1])
                request = space.requests.get(int(result[2])) if space else None
                return None if request is None else _result_value(request, result[3])
            found = _NAME.fullmatch(name)
            space = self._clients.get(found[1]) if found else None
            if found is None or space is None:
                return None
            if found[3] == 'data':
                value = space.data.get(found[4].upper())
                return value.reshape(-1) if isinstance(value, np.ndarray) else value
            if found[3] == 'shape':
                value = space.data.get(found[4].upper())
                return _shape_of(value, space.shapes.get(found[4].upper()))
            return {
                'program': space.program.source if space.program else None,
                'entry': space.entry,
                'model': space.model,
            }.get(found[2])

    def clear(self) -> str:
        """Forget everything and stop what runs; return what was forgotten, in words."""
        with self._lock:
            count = len(self._clients)
            for space in self._clients.values():
                for request in space.requests.values():
                    self._cancel(request)
            self._clients.clear()
            self._waiting.clear()
            self.runs = self.failures = self.cycles = 0
            return f'{count} workspace(s)'

    @property
    def clients(self) -> int:
        """Number of workspaces."""
        return len(self._clients)


def _whole(value: Any, positive: bool) -> int:
    """A whole number of at least 1, or a truth as 0 or 1. Raises ValueError."""
    if not positive and isinstance(value, bool):
        return int(value)
    if isinstance(value, bool) or not isinstance(value, int) or (positive and value < 1):
        raise ValueError(f'expected {"a whole number of at least 1" if positive else "true or false"}, got {value!r}')
    return value


def _bytes(value: Any) -> int:
    """Size of a stored value."""
    return value.nbytes if isinstance(value, np.ndarray) else len(value) if isinstance(value, str) else 8


def _value(value: Any) -> Any:
    """A value as it is stored. Raises ValueError."""
    if isinstance(value, (bool, int, float, str)):
        return value
    array = np.array(value)
    if array.dtype.kind not in 'bif' or array.size == 0:
        raise ValueError('expected a number, a text, or a list of integers, doubles or truths with an element')
    return array


def _shape_of(value: Any, shape: tuple[int, ...] | None) -> IntArray | None:
    """Extents of an array, None of another value."""
    if not isinstance(value, np.ndarray):
        return None
    return np.asarray(shape or value.shape, dtype=np.int64)


def _arguments(request: Request) -> dict[str, Any]:
    """Data of the workspace as arguments of the entry; what is no argument is left out."""
    arguments: dict[str, Any] = {}
    for symbol in request.program.entry(request.entry).arguments:
        if symbol.name not in request.data:
            continue
        value = request.data[symbol.name]
        if isinstance(value, np.ndarray):
            value = value.reshape(request.shapes.get(symbol.name, value.shape))
            if symbol.type.kind.name == 'LOGICAL' and value.dtype.kind == 'i':
                value = value != 0
        elif symbol.type.kind.name == 'LOGICAL' and isinstance(value, int):
            value = bool(value)
        arguments[symbol.name] = value
    return arguments


def _result_value(request: Request, what: str) -> Any:
    """One value of a request's result; None when there is none."""
    if what in ('state', 'message'):
        return getattr(request, what)
    result = request.result
    if result is None:
        return None
    if what == 'statistics':
        return str(result.stats)
    if what in ('cycles', 'seconds'):
        return getattr(result, what)
    if what == 'listing':
        return result.listing()
    if what in ('names', 'trace'):
        return list(result) if what == 'names' else request.trace
    group, _, variable = what.partition('.')
    if variable.upper() not in result or group not in ('data', 'shape'):
        return None
    value = result[variable]
    if group == 'shape':
        return _shape_of(value, None)
    return value.reshape(-1) if isinstance(value, np.ndarray) else value
