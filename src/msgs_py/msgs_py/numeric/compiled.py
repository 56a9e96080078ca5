"""Compiled functions that are never stale and rarely compiled: the one way numba is used here.

numba's own cache is keyed by the path and the time of the file in which a function stands. A function's machine code
also contains that of the functions it calls, wherever they stand, so a change there leaves old code in use; and
every clone, installation and checkout compiles everything again. Here an entry is found by its content: a digest of the
byte code of the function and of all functions it reaches, of the global constants they use, of the argument types, the
options, the versions of Python and numba, and the processor. Equal content has one entry wherever the source lies, so
that a clone, an installed package and a second checkout share it.

Machine code calls other machine code by name, and names are looked up among all that a process has loaded. numba tells
functions of one name and types apart, such as its own sorts of values and of indices, by a number that it counts up in
each process; entries that two processes wrote may have the same number for different functions, and the one that is
loaded first is then called for both. So the numbers are drawn at random here.

Entries are written under another name and then renamed, so that no process ever reads half of one, and none needs a
lock. A cache that cannot be read or written costs compiling and nothing else.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import secrets
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, cast, overload

import numba
import numpy as np
from numba.core import bytecode, types
from numba.core.caching import CompileResultCacheImpl, _Cache
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps

from .one_unit import AVAILABLE, UnitDispatcher, is_linked, stored
from .settings import CACHE_BYTES, FORM, NAME_CHARACTERS, NUMBER_BITS, SIZE_CHECKED_EVERY_S, USE_NOTED_AFTER_S

# Moves the cache; numba's own NUMBA_CACHE_DIR is taken where this one is not set.
FOLDER_VARIABLE = 'MSGS_PY_CACHE_DIR'
# End of the names of the cache's files.
SUFFIX = '.machinecode'
# Length of a SHA-256 digest, with which a file begins.
DIGEST_BYTES = 32
# Functions of these are told apart by their name: their version is the library's, and numba's own is in the key.
FOREIGN = ('builtins', 'cmath', 'llvmlite', 'math', 'numba', 'numpy', 'operator')


class _Numbers:
    """Of functions, which no two processes share; with a version of numba that does not ask here it counts as ever."""

    def __next__(self) -> int:
        return secrets.randbits(NUMBER_BITS)


cast(Any, bytecode.FunctionIdentity)._unique_ids = _Numbers()


def cache_folder() -> Path:
    """Where machine code is kept.

    Returns
    -------
    pathlib.Path
        ``$MSGS_PY_CACHE_DIR``; without it a folder in ``$NUMBA_CACHE_DIR``, ``$XDG_CACHE_HOME`` or ``~/.cache``; for a
        user without a home one among the temporary files.
    """
    own = os.environ.get(FOLDER_VARIABLE)
    if own:
        return Path(own)
    user = os.environ.get('NUMBA_CACHE_DIR') or os.environ.get('XDG_CACHE_HOME')
    with contextlib.suppress(RuntimeError):  # a user without a home
        return Path(user or Path.home() / '.cache') / 'msgs_py' / 'machinecode'
    return Path(tempfile.gettempdir()) / f'msgs_py-{os.getuid()}' / 'machinecode'


class ContentCache(_Cache):
    """The cached overloads of one function, in the form that numba's dispatcher asks for."""

    def __init__(self, function: FunctionType, options: dict[str, Any]) -> None:
        self._function, self._options = function, options
        self._impl = object.__new__(CompileResultCacheImpl)  # its constructor looks for a place beside the source
        self._enabled = True

    @property
    def cache_path(self) -> str:
        """The folder of the entries."""
        return str(cache_folder())

    def enable(self) -> None:
        """Read and write entries."""
        self._enabled = True

    def disable(self) -> None:
        """Neither read nor write entries."""
        self._enabled = False

    def flush(self) -> None:
        """Nothing to do: what another content needs has another name."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for these argument types; None where the cache has none."""
        if not self._enabled:
            return None
        _initialise(target_context)
        content = _read(self._path(sig, target_context.codegen()))
        if content is None:
            return None
        with contextlib.suppress(pickle.UnpicklingError, AttributeError, ImportError, ValueError, TypeError, EOFError):
            return self._impl.rebuild(target_context, pickle.loads(content))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled, unless it depends on addresses of this process."""
        if is_linked(data):  # it is in the entries of what calls it
            return
        if not self._enabled or data.library.has_dynamic_globals or any(not lift.can_cache for lift in data.lifted):
            return
        library, *rest = self._impl.reduce(data)
        library = stored(library, data.library) if AVAILABLE else library
        _write(self._path(sig, data.codegen), dumps((library, *rest)))

    def _path(self, sig: Any, codegen: Any) -> Path:
        """The entry's file: its name is the digest of all that the machine code depends on."""
        key = hashlib.sha256()
        for part in (
            sys.version_info[:2],
            numba.__version__,
            AVAILABLE,
            FORM,
            codegen.magic_tuple(),
            sorted(self._options.items()),
            self._function.__module__,
            self._function.__qualname__,
            *map(_described_type, sig.args if hasattr(sig, 'args') else sig),
            content(self._function),
        ):
            key.update(repr(part).encode())
            key.update(b'\0')
        return cache_folder() / f'{self._function.__name__[:NAME_CHARACTERS]}-{key.hexdigest()}{SUFFIX}'


@cache
def _initialise(target_context: Any) -> None:
    """Let a context know what there is, once: numba does so for each function, which takes as long as to load it."""
    target_context.refresh()


@overload
def njit(function: Callable[..., Any], **options: Any) -> Any: ...
@overload
def njit(function: None = None, **options: Any) -> Callable[[Callable[..., Any]], Any]: ...
def njit(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """``numba.njit`` with the cache of this module.

    Parameters
    ----------
    function : callable, optional
        The function to compile; without it a decorator is returned.
    **options
        As numba's; ``cache`` is always on.

    Examples
    --------
    >>> @njit
    ... def twice(x):
    ...     return 2 * x
    >>> twice(21)
    42
    """
    if function is None:
        return partial(njit, **options)
    dispatcher = numba.njit(**options)(function)
    if isinstance(dispatcher, Dispatcher):  # with compilation switched off it is the function itself
        cast(Any, dispatcher)._cache = ContentCache(cast(FunctionType, function), options)
        if AVAILABLE:
            dispatcher.__class__ = UnitDispatcher
    return dispatcher


# -- content ---------------------------------------------------------------------------------------------------

_own: dict[FunctionType, tuple[str, tuple[FunctionType, ...]]] = {}


def content(function: FunctionType) -> str:
    """Digest of all that a function's machine code is made of.

    Parameters
    ----------
    function : function
        A Python function that numba compiles.

    Returns
    -------
    str
        SHA-256 of its byte code and constants, and of those of all functions it reaches, in whatever module.
    """
    reached, waiting = {function}, [function]
    while waiting:
        for callee in _described(waiting.pop())[1]:
            if callee not in reached:
                reached.add(callee)
                waiting.append(callee)
    parts = [_described(function)[0], *sorted(_described(other)[0] for other in reached)]
    return hashlib.sha256('\n'.join(parts).encode()).hexdigest()


def _described(function: FunctionType) -> tuple[str, tuple[FunctionType, ...]]:
    """Digest of a function's own code and constants, and the functions that it names."""
    if function not in _own:
        callees: list[FunctionType] = []
        names = sorted(_names(function.__code__))
        closure = dict(zip(function.__code__.co_freevars, function.__closure__ or ()))
        values = [
            (name, _described_value(function.__globals__[name], names, callees))
            for name in names
            if name in function.__globals__
        ]
        values += [(name, _described_value(cell.cell_contents, names, callees)) for name, cell in closure.items()]
        text = repr(
            (
                function.__module__,
                function.__qualname__,
                _described_code(function.__code__, function.__doc__),
                _described_value(function.__defaults__, names, callees),
                values,
            )
        )
        _own[function] = hashlib.sha256(text.encode()).hexdigest(), tuple(callees)
    return _own[function]


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A function's code and those of the functions and comprehensions inside it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _names(code: CodeType) -> set[str]:
    """Names of globals and attributes, of nested functions and comprehensions too."""
    return {name for inner in _codes(code) for name in inner.co_names}


def _described_code(code: CodeType, documentation: str | None) -> str:
    """What a function does; line numbers, paths and its docstring are left out."""
    constants = [
        _described_code(c, None)
        if isinstance(c, CodeType)
        else sorted(map(repr, c))
        if isinstance(c, frozenset)
        else None
        if isinstance(c, str) and c == documentation
        else c
        for c in code.co_consts
    ]
    return repr(
        (
            code.co_code.hex(),
            constants,
            code.co_names,
            code.co_varnames,
            code.co_cellvars,
            code.co_freevars,
            code.co_argcount,
            code.co_kwonlyargcount,
            code.co_posonlyargcount,
        )
    )


def _described_value(value: Any, names: list[str], callees: list[FunctionType]) -> str:
    """What of a global a compiled function can depend on; functions are added to ``callees``."""
    if isinstance(value, Dispatcher):
        options = sorted((name, repr(option)) for name, option in value.targetoptions.items() if name != 'cache')
        callees.append(value.py_func)
        return f'compiled {value.py_func.__module__}.{value.py_func.__qualname__} {options}'
    if isinstance(value, ModuleType):
        if value.__name__.partition('.')[0] in FOREIGN:
            return f'module {value.__name__}'
        # ``module.name`` in a function's code: both are among its names.
        return repr(
            (
                value.__name__,
                [(name, _described_value(vars(value)[name], [], callees)) for name in names if name in vars(value)],
            )
        )
    if isinstance(value, np.ndarray):
        return f'{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}'
    if isinstance(value, (tuple, list)):
        return repr((type(value).__name__, [_described_value(item, names, callees) for item in value]))
    if isinstance(value, type):
        fields = getattr(value, '_fields', None) or getattr(value, '__members__', None)
        return f'{value.__module__}.{value.__qualname__} {fields}'
    if isinstance(value, FunctionType):
        if value.__module__.partition('.')[0] not in FOREIGN:
            callees.append(value)
        return f'{value.__module__}.{value.__qualname__}'
    text = repr(value)
    return f'{type(value).__module__}.{type(value).__qualname__}' + ('' if ' at 0x' in text else f' {text}')


def _described_type(kind: Any) -> str:
    """An argument's type; of a named tuple the order of its fields, of a compiled function its content."""
    if isinstance(kind, types.Dispatcher):
        return f'compiled {content(kind.dispatcher.py_func)}'
    if isinstance(kind, types.BaseTuple):
        fields = getattr(kind, 'fields', ())
        return f'{type(kind).__name__} {fields} {[_described_type(item) for item in cast(Any, kind)]}'
    return repr(kind)


# -- files -----------------------------------------------------------------------------------------------------


def _read(path: Path) -> bytes | None:
    """An entry's content; None where there is none, or what lies there is not whole."""
    try:
        data = path.read_bytes()
        if time.time() - path.stat().st_mtime > USE_NOTED_AFTER_S:
            os.utime(path)
    except OSError:
        return None
    digest, content = data[:DIGEST_BYTES], data[DIGEST_BYTES:]
    return content if hashlib.sha256(content).digest() == digest else None


def _write(path: Path, content: bytes) -> None:
    """Under another name first: readers see the whole entry or none. Where nothing can be written nothing is kept."""
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle, temporary = tempfile.mkstemp(prefix='.', dir=path.parent)
        try:
            with os.fdopen(handle, 'wb') as file:
                file.write(hashlib.sha256(content).digest() + content)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise
        _forget_the_oldest(path.parent)


_last_look: dict[Path, float] = {}


def _forget_the_oldest(folder: Path) -> None:
    """Keep the cache within its size; each process that writes looks at it now and then."""
    if time.monotonic() - _last_look.get(folder, -np.inf) < SIZE_CHECKED_EVERY_S:
        return
    _last_look[folder] = time.monotonic()
    entries = sorted(
        (status.st_mtime, status.st_size, path) for path in folder.glob(f'*{SUFFIX}') if (status := path.stat())
    )
    total = sum(size for _, size, _ in entries)
    for _, size, path in entries:
        if total <= CACHE_BYTES:
            break
        path.unlink(missing_ok=True)
        total -= size
