"""A compiled function and all that it calls become one piece of machine code, made once.

numba optimises every function that a compiled function calls by itself, makes machine code and two wrappers of it, and
then links and optimises it again in each of its callers; the machine code of its own is used by nobody. Here what is
called by compiled functions stays intermediate code, and only what Python calls is optimised and made machine code,
with everything it reaches in one unit, as compilers of other languages do. That takes a third less time to compile.
The arithmetic is the same: nothing here allows an operation that numba would not do.

Neither are references counted of arrays that a function is given. They belong to its caller until it returns, yet numba
counts one up and down, each time an atomic operation, whenever a record of arrays gets another name, which is also what
passing it on is; that took a third of the time of a search whose loops hand on records. It can be left out where no
array is returned and no list or other container is given that may keep one.

For that some methods of numba are replaced, while one of our functions compiles and numba's lock is held, so that code
of others is compiled as ever. With a version of numba that lacks one of them, :data:`AVAILABLE` is false and numba
compiles in its own way.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from numba.core import base, cgutils, codegen, compiler, dispatcher, lowering, sigutils, types
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import overload
from numba.np import arrayobj

_FunctionCompiler: Any = vars(dispatcher).get('_FunctionCompiler', object)
_METHODS = (
    (codegen.JITCodeLibrary, 'add_linking_library'),
    (codegen.JITCodeLibrary, 'finalize'),
    (codegen.JITCodeLibrary, '_optimize_final_module'),
    (codegen.JITCodeLibrary, '_finalize_final_module'),
    (codegen.JITCodeLibrary, '_get_module_for_linking'),
    (codegen.JITCodeLibrary, '_set_compiled_object'),
    (codegen.JITCodeLibrary, '_unserialize'),
    (codegen.JitEngine, '_load_defined_symbols'),
    (_FunctionCompiler, '_compile_core'),
    (_FunctionCompiler, '_customize_flags'),
    (dispatcher.Dispatcher, 'add_overload'),
    (dispatcher.Dispatcher, 'get_call_template'),
    (lowering.BaseLower, 'extract_function_arguments'),
)
AVAILABLE = all(hasattr(kind, name) for kind, name in _METHODS) and hasattr(compiler.Flags(), 'no_compile')


class Linked:
    """Stands for the entry point of what is called by compiled functions only."""


# What a stored library is told by: its machine code, the names that this defines, and its intermediate code, packed.
STORED = 'unit'


def stored(state: Any, library: Any) -> tuple[str, str, tuple[bytes, set[str], bytes]]:
    """What numba makes of a library to keep it in a file, so that :func:`_restored` need not read all of it.

    Its intermediate code is a third of the time that numba takes to load one, and is asked for only when a function
    that is not stored calls this one.
    """
    name, _, (machine_code, intermediate) = state
    module = library._get_module_for_linking()
    names = {one.name for kind in (module.functions, module.global_variables) for one in kind if not one.is_declaration}
    return name, STORED, (machine_code, names, zlib.compress(intermediate, 1))


def is_linked(result: Any) -> bool:
    """Whether a compile result has no entry for Python."""
    return isinstance(result.entry_point, Linked)


class UnitDispatcher(dispatcher.Dispatcher):
    """A compiled function that is one unit with all it calls."""

    def compile(self, sig: Any) -> Any:
        """Compile for argument types; the entry point is one for Python, unless a compiled function asks."""
        with global_compiler_lock, _replaced():
            key = tuple(sigutils.normalize_signature(sig)[0])
            result = self.overloads.get(key)
            if result is not None and is_linked(result) and not _state.nested:
                del self.overloads[key]
            return super().compile(sig)


class _State:
    """What is being compiled; changed only while numba's lock is held."""

    active = False  # the methods are replaced
    nested = False  # it is called by a compiled function


_state = _State()


@contextmanager
def _replaced() -> Iterator[None]:
    """Let numba compile units; leaves everything as it was."""
    if _state.active:
        yield
        return
    before = [(kind, name, kind.__dict__.get(name)) for kind, name, _ in _REPLACEMENTS]
    _state.active = True
    for kind, name, method in _REPLACEMENTS:
        setattr(kind, name, method)
    try:
        yield
    finally:
        _state.active = False
        for kind, name, method in before:
            if method is None:
                delattr(kind, name)  # inherited
            else:
                setattr(kind, name, method)


@contextmanager
def _nested(value: bool) -> Iterator[None]:
    before, _state.nested = _state.nested, value
    try:
        yield
    finally:
        _state.nested = before


# -- what numba's methods are replaced by ----------------------------------------------------------------------

_get_call_template = dispatcher.Dispatcher.get_call_template
_add_overload = dispatcher.Dispatcher.add_overload


def _called_by_compiled(self: Any, args: Any, kws: Any) -> Any:
    """Compiled functions ask this way. Functions of others are compiled as numba does: Python may call them, too."""
    with _nested(isinstance(self, UnitDispatcher) or self.py_func.__module__.partition('.')[0] == 'numba'):
        return _get_call_template(self, args, kws)


def _compiled(self: Any, args: Any, return_type: Any) -> Any:
    """As numba's, without wrappers and machine code for what compiled functions call."""
    linked = _state.nested
    flags = compiler.Flags()
    self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
    flags = self._customize_flags(flags)
    flags.no_cfunc_wrapper = True
    if linked:
        flags.no_compile = flags.no_cpython_wrapper = True
    context = self.targetdescr.target_context
    with _nested(False):
        result = compiler.compile_extra(
            self.targetdescr.typing_context,
            context,
            self._get_implementation(args, {}),
            args=args,
            return_type=return_type,
            flags=flags,
            locals=self.locals,
            pipeline_class=self.pipeline_class,
        )
    if result.typing_error is not None and not flags.enable_pyobject:
        raise result.typing_error
    if linked:
        result = result._replace(entry_point=Linked())
        context.insert_user_function(result.entry_point, result.fndesc, [result.library])
    return result


def _added(self: Any, result: Any) -> None:
    """What has no entry for Python is kept from Python's table."""
    if is_linked(result):
        self.overloads[tuple(result.signature.args)] = result
    else:
        _add_overload(self, result)


_llvm: Any = vars(codegen).get('ll')  # llvmlite.binding, as numba has it
_unserialize: Any = getattr(codegen.JITCodeLibrary, '_unserialize', None)


@classmethod  # type: ignore[misc]
def _restored(cls: Any, its_codegen: Any, state: Any) -> Any:
    """A library from what :func:`stored` made of it, ready to be called."""
    name, kind, data = state
    if kind != STORED:
        return _unserialize(its_codegen, state)
    machine_code, names, intermediate = data
    library = its_codegen.create_library(name)
    library.enable_object_caching()
    library._set_compiled_object(machine_code)
    library._get_module_for_linking = cache(lambda: _llvm.parse_bitcode(zlib.decompress(intermediate)))
    library._finalize_final_module()
    its_codegen._engine._defined_symbols |= names
    return library


def _link_later(self: Any, library: Any) -> None:
    self._linking_libraries.append(library)


def _finalised(self: Any) -> None:
    """Link what is reached, then optimise once."""
    self._codegen._check_llvm_bugs()
    self._raise_if_finalized()
    for library in _reached(self):
        if hasattr(library, '_reload_init'):  # older versions of numba keep no list of what to run after loading
            self._reload_init.update(library._reload_init)
        whole = library._get_module_for_linking() if library._finalized else _intermediate(library)
        self._final_module.link_in(whole, preserve=True)
    self._optimize_final_module()
    self._final_module.verify()
    self._finalize_final_module()


def _reached(library: Any) -> list[Any]:
    """Libraries that one needs, each before those that it needs; what is machine code already has its own within.

    Linking takes of a library only what is asked for by then. What a library is asked for by several may be asked for
    by the last of them alone, when the code of the others was found never to run.
    """
    order: list[Any] = []
    seen: set[Any] = set()

    def visit(user: Any) -> None:
        for other in user._linking_libraries:
            if other not in seen:
                seen.add(other)
                if not other._finalized:
                    visit(other)
                order.append(other)

    visit(library)
    return order[::-1]


def _intermediate(library: Any) -> Any:
    """A library's own code, to be linked into several others."""
    module = getattr(library, '_for_units', None)
    if module is None:
        module = library._final_module.clone()
        for function in module.functions:
            if not function.is_declaration and function.linkage.name == 'external':
                function.linkage = 'linkonce_odr'
        library._for_units = module
    return module


_get_abi_sizeof = base.BaseContext.get_abi_sizeof
_sizes: dict[tuple[int, str], int] = {}


def _size(self: Any, kind: Any) -> int:
    """Bytes of a type. numba parses a module for each question, a tenth of all time, and asks for few types."""
    key = id(self), str(kind)
    if key not in _sizes:
        _sizes[key] = _get_abi_sizeof(self, kind)  # type: ignore[no-untyped-call]
    return _sizes[key]


def _refuse_shapes(source: Any, target: Any) -> None:
    """Raise for an assignment to a slice of another shape."""


@overload(_refuse_shapes)
def _refuse_shapes_compiled(source: Any, target: Any) -> Callable[[Any, Any], None]:
    """Without the shapes in the text, for which numba compiles half of its functions of strings."""

    def implementation(source: Any, target: Any) -> None:
        raise ValueError('cannot assign to a slice of another shape')

    return implementation


_extract_function_arguments: Any = lowering.BaseLower.extract_function_arguments
# What a function may return or be given, besides arrays and tuples, when references of arrays are not counted.
_NUMBERS = (types.Number, types.Boolean, types.NoneType, types.Omitted)


def _arguments(self: Any) -> Any:
    """A function's arguments; arrays among them have no count of references where none can outlive the call."""
    values = _extract_function_arguments(self)
    kinds = self.fndesc.argtypes
    if _only_of(self.fndesc.restype, _NUMBERS) and all(_only_of(kind, (*_NUMBERS, types.Array)) for kind in kinds):
        self.fnargs = [_uncounted(self, kind, value) for kind, value in zip(kinds, values)]
    return self.fnargs


def _only_of(kind: Any, allowed: tuple[Any, ...]) -> bool:
    """Whether a type, or all that a tuple consists of, is one of some."""
    if isinstance(kind, types.BaseTuple):
        return all(_only_of(part, allowed) for part in _parts(kind))
    return isinstance(kind, allowed)


def _parts(kind: Any) -> tuple[Any, ...]:
    """Types that a tuple consists of."""
    return tuple(kind)


def _uncounted(self: Any, kind: Any, value: Any) -> Any:
    """An array, or a tuple with arrays, without the counter, which numba has only for memory that is its own."""
    if isinstance(kind, types.BaseTuple):
        for position, part in enumerate(_parts(kind)):
            inner = self.builder.extract_value(value, position)
            value = self.builder.insert_value(value, _uncounted(self, part, inner), position)
    elif isinstance(kind, types.Array):
        position = self.context.data_model_manager[kind].get_field_position('meminfo')
        owner = self.builder.extract_value(value, position)
        value = self.builder.insert_value(value, cgutils.get_null_value(owner.type), position)
    return value


_REPLACEMENTS: tuple[tuple[Any, str, Any], ...] = (
    (codegen.JITCodeLibrary, 'add_linking_library', _link_later),
    (codegen.JITCodeLibrary, 'finalize', _finalised),
    (codegen.JITCodeLibrary, '_unserialize', _restored),
    (_FunctionCompiler, '_compile_core', _compiled),
    (dispatcher.Dispatcher, 'add_overload', _added),
    (dispatcher.Dispatcher, 'get_call_template', _called_by_compiled),
    (base.BaseContext, 'get_abi_sizeof', _size),
    (lowering.BaseLower, 'extract_function_arguments', _arguments),
    (arrayobj, 'raise_with_shape_context', _refuse_shapes),
)
