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

A request takes the workspace as it was when stored, so later stores do not disturb it. Clients take turns: of the
requests that wait, the next is one of the client that was served longest ago. What all clients together hold is
bounded; the workspace that has been idle for longest makes room. Programs are compiled and run in processes of their
own (processes.py). Results are read under the request's id, and are kept until the client's later requests push them
out:

    <client>.result.<id>.state          waiting, running, done, failed, stopped
    <client>.result.<id>.message        why it failed or stopped
    <client>.result.<id>.cycles, .seconds, .statistics, .listing, .trace (the last operations)
    <client>.result.<id>.printed        lines of PRINT
    <client>.result.<id>.names          the arguments that can be read
    <client>.result.<id>.data.<NAME>, .shape.<NAME>
"""

from __future__ import annotations

import re
import threading
import time
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from msgs_py.numeric.typed import IntArray

from ..fortran_plus import Result, Stopped
from ..fortran_plus.library import program_source
from ..fortran_plus.settings import PROGRAMS_CACHED
from ..machine.machine import MODELS
from .processes import PROCESSES, ProgramFailed
from .program_worker import Interface, RunJob, size_of
from .settings import (
    CLIENTS,
    LONGEST_NAME,
    MAX_DIMENSIONS,
    MAX_NAMES,
    MAX_WAITING,
    MAX_WAITING_IN_ALL,
    MOST_DIGITS,
    NAME_BYTES,
    PROGRAM_BYTES,
    RESULTS_KEPT,
    RUN_SECONDS,
    STORE_BYTES,
    TOTAL_BYTES,
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
        Data, shapes and names of one client, bytes; also the largest result of a run.
    run_seconds : float
        Time of one run on this computer, and of compiling one program.
    clients : int
        Workspaces kept; the one that has been idle for longest makes room for a new one.
    total_bytes : int
        What all clients together have stored, waiting and as results, bytes.
    """

    program_bytes: int = PROGRAM_BYTES
    store_bytes: int = STORE_BYTES
    run_seconds: float = RUN_SECONDS
    clients: int = CLIENTS
    total_bytes: int = TOTAL_BYTES


@dataclass
class Request:
    """A queued run: the workspace as it was when it was queued, and afterwards the result.

    Parameters
    ----------
    client : str
    number : int
        The client's number of the request.
    program : Interface
        The text, and its entries.
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
    result_bytes : int
        Size of result and trace.
    cancelled : threading.Event
    """

    client: str
    number: int
    program: Interface
    entry: str | None
    model: str
    data: dict[str, Any]
    shapes: dict[str, tuple[int, ...]]
    state: str = 'waiting'
    message: str = ''
    result: Result | None = None
    trace: list[str] = field(default_factory=list)
    result_bytes: int = 0
    cancelled: threading.Event = field(default_factory=threading.Event)

    def summary(self) -> dict[str, Any]:
        """Describe it for the answer of ~/run."""
        cost = {} if self.result is None else {'cycles': self.result.cycles, 'seconds': self.result.seconds}
        return {'client': self.client, 'id': self.number, 'state': self.state, 'message': self.message, **cost}


@dataclass
class Workspace:
    """One client's values."""

    program: Interface | None = None
    entry: str | None = None
    model: str = '510'
    data: dict[str, Any] = field(default_factory=dict)
    shapes: dict[str, tuple[int, ...]] = field(default_factory=dict)
    requests: OrderedDict[int, Request] = field(default_factory=OrderedDict)

    @property
    def bytes(self) -> int:
        """Size of its data and shapes, with their names."""
        named = sum(len(name) + NAME_BYTES for names in (self.data, self.shapes) for name in names)
        return named + sum(size_of(value) for value in self.data.values())

    def held(self) -> dict[int, int]:
        """Sizes of everything that it keeps in memory, by identity: requests share values with the workspace."""
        values: list[Any] = [*self.data.values()]
        found: dict[int, int] = {id(self): self.bytes - sum(size_of(value) for value in values)}
        for request in self.requests.values():
            found[id(request)] = NAME_BYTES * (1 + len(request.data)) + len(request.message) + request.result_bytes
            values += [*request.data.values(), request.program.source]
        if self.program is not None:
            values.append(self.program.source)
        return found | {id(value): size_of(value) for value in values}

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
        self._served: dict[str, int] = {}
        self._closed = threading.Event()
        self._programs: OrderedDict[str, Interface] = OrderedDict()
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
        programs = self._compiled(items)
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
                    elif name in programs:
                        draft.program = programs[name]
                    else:
                        self._set(draft, group or what, (variable or '').upper(), value)
                except ValueError as error:
                    raise Refused(f'{name}: {error}') from None
            for client, draft in drafts.items():
                self._check(client, draft)
            requests = self._requests(drafts, actions)
            self._accept(drafts, actions, requests)

    def _compiled(self, items: list[tuple[str, Any]]) -> dict[str, Interface]:
        """Compile the programs among them, by name; others may store and fetch meanwhile. Raises Refused."""
        found: dict[str, Interface] = {}
        end = time.monotonic() + self.limits.run_seconds
        for name, value in items:
            what = name.partition('.')[2]
            if what not in ('program', 'library'):
                continue
            try:
                if not isinstance(value, str):
                    raise ValueError(f'expected a text, got {type(value).__name__}')
                if what == 'program' and len(value) > self.limits.program_bytes:
                    raise ValueError(f'{len(value)} characters, at most {self.limits.program_bytes} are accepted')
                found[name] = self._interface(
                    value if what == 'program' else program_source(value), max(0.0, end - time.monotonic())
                )
            except ValueError as error:
                raise Refused(f'{name}: {error}') from None
        return found

    def _interface(self, source: str, seconds: float) -> Interface:
        """Compile a text, once while it is among the last ones. Raises ProgramFailed."""
        with self._lock:
            known = self._programs.get(source)
        if known is None:
            known = PROCESSES.interface(source, seconds, self._closed)
        with self._lock:
            self._programs[source] = known
            self._programs.move_to_end(source)
            while len(self._programs) > PROGRAMS_CACHED:
                self._programs.popitem(last=False)
        return known

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
        elif what == 'model':
            if value.upper() not in MODELS:
                raise ValueError(f'expected one of {", ".join(MODELS)}, got {value!r}')
            draft.model = value.upper()
        else:
            if len(value) > LONGEST_NAME:
                raise ValueError(f'{len(value)} characters, at most {LONGEST_NAME} are accepted')
            draft.entry = value or None

    def _check(self, client: str, draft: Workspace) -> None:
        """Check sizes of a draft's data. Raises Refused."""
        for name, shape in draft.shapes.items():
            value = draft.data.get(name)
            size = value.size if isinstance(value, np.ndarray) else None
            if size is not None and int(np.prod(shape, dtype=np.int64)) != size:
                raise Refused(f'{client}.shape.{name}: {shape} does not hold {size} elements')
        if len(draft.data) + len(draft.shapes) > MAX_NAMES:
            raise Refused(f'{client}: {len(draft.data) + len(draft.shapes)} names, at most {MAX_NAMES} are accepted')
        if draft.bytes > self.limits.store_bytes:
            raise Refused(
                f'{client}: {draft.bytes} bytes of data with their names, '
                f'at most {self.limits.store_bytes} are accepted'
            )

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
            if len(self._waiting) + len(requests) >= MAX_WAITING_IN_ALL:
                raise Refused(f'{client}.run_request: {MAX_WAITING_IN_ALL} requests of all clients are waiting already')
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
        self._make_room({**self._clients, **drafts}, requests, keep=set(drafts))
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

    def _make_room(self, spaces: dict[str, Workspace], requests: list[Request], keep: set[str]) -> None:
        """Forget idle workspaces, the idle for longest first, until these and the requests fit. Raises Refused."""
        queued = Workspace(requests=OrderedDict(enumerate(requests)))
        sizes = {name: space.held() for name, space in spaces.items()}

        def total() -> int:
            merged: dict[int, int] = queued.held()
            for held in sizes.values():
                merged |= held
            return sum(merged.values())

        while (size := total()) > self.limits.total_bytes:
            idle = next((name for name, space in spaces.items() if name not in keep and not space.busy), None)
            if idle is None:
                raise Refused(
                    f'all clients together would hold {size} bytes, at most {self.limits.total_bytes} are kept'
                )
            spaces = {name: space for name, space in spaces.items() if name != idle}
            del sizes[idle]
            self._clients.pop(idle, None)

    def _cancel(self, request: Request) -> None:
        """Stop a request, waiting or running."""
        request.cancelled.set()
        if request.state == 'waiting':
            request.state, request.message = 'stopped', 'cancelled'
            if request in self._waiting:
                self._waiting.remove(request)

    # ~/run

    def take_waiting(self) -> list[Request]:
        """Take the requests that wait, in the order in which they are executed; the caller executes them."""
        with self._lock:
            taken: list[Request] = []
            while self._waiting:
                taken.append(self._take_next(self._waiting))
            return taken

    def _take_next(self, waiting: list[Request]) -> Request:
        """Take the oldest request of the client that was served longest ago."""
        first = min(waiting, key=lambda request: self._served.get(request.client, 0))
        waiting.remove(first)
        self._served.pop(first.client, None)
        self._served[first.client] = 1 + max(self._served.values(), default=0)
        while len(self._served) > self.limits.clients:
            del self._served[next(iter(self._served))]
        return first

    def execute_waiting(self) -> list[Request]:
        """Execute what waits, after what another thread has begun to execute.

        Returns
        -------
        list of Request
            Those that this call executed.
        """
        with self._executing:
            with self._lock:
                mine = list(self._waiting)
            executed: list[Request] = []
            while True:
                # Another client's request may come between those that waited on arrival.
                with self._lock:
                    if not any(request in self._waiting for request in mine):
                        return executed
                    request = self._take_next(self._waiting)
                self.execute(request)
                executed.append(request)

    def execute(self, request: Request) -> None:
        """Run one request; its state says how it went. Raises nothing."""
        with self._lock:
            if request.cancelled.is_set():
                request.state, request.message = 'stopped', 'cancelled'
                return
            request.state = 'running'
        state, message, result = 'done', '', None
        try:
            job = RunJob(
                request.program.source,
                request.entry,
                request.model,
                _arguments(request),
                self.limits.run_seconds,
                self.limits.store_bytes,
            )
            answer = PROCESSES.run(job, request.cancelled)
            result, request.trace = answer.result(request.program.source), answer.trace
        except Stopped as error:
            state, message = 'stopped', str(error)
        except ProgramFailed as error:
            state, message = 'failed', str(error)
        except Exception as error:  # a fault of ours must not leave the request running for ever
            state, message = 'failed', f'{type(error).__name__}: {error}'
        with self._lock:
            request.data, request.shapes = {}, {}
            request.result = result
            if result is not None:
                request.result_bytes = sum(
                    size_of(value) for value in [*result.values(), *request.trace, *result.printed]
                )
            try:
                self._make_room_for_result(request)
            except Refused as error:
                request.result, request.trace, request.result_bytes = None, [], 0
                state, message = 'failed', f'no room for the result: {error}'
            request.message, request.state = message, state
            self.runs += 1
            self.failures += state != 'done'
            self.cycles += result.cycles if result is not None else 0

    def _make_room_for_result(self, request: Request) -> None:
        """Forget older results of the same client, then idle workspaces, until a result fits. Raises Refused."""
        space = self._clients.get(request.client)
        older = (
            [] if space is None else [k for k, r in space.requests.items() if r.result is not None and r is not request]
        )
        while True:
            try:
                return self._make_room(dict(self._clients), [request], keep={request.client})
            except Refused:
                if space is None or not older:
                    raise
                del space.requests[older.pop(0)]

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

    def close(self) -> None:
        """Forget everything, stop what runs or is compiled, and compile nothing more."""
        self._closed.set()
        self.clear()

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
    for name, kind in request.program.entries[request.program.entry(request.entry)].items():
        if name not in request.data:
            continue
        value = request.data[name]
        if isinstance(value, np.ndarray):
            value = value.reshape(request.shapes.get(name, value.shape))
            if kind == 'LOGICAL' and value.dtype.kind == 'i':
                value = value != 0
        elif kind == 'LOGICAL' and isinstance(value, int):
            value = bool(value)
        arguments[name] = value
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
    if what in ('names', 'trace', 'printed'):
        return {'names': list(result), 'trace': request.trace, 'printed': result.printed}[what]
    group, _, variable = what.partition('.')
    if variable.upper() not in result or group not in ('data', 'shape'):
        return None
    value = result[variable]
    if group == 'shape':
        return _shape_of(value, None)
    return value.reshape(-1) if isinstance(value, np.ndarray) else value
