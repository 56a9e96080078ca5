"""Old names that still work, and say so. Pure; :mod:`msgs_py.runtime` does the same for parameters and topics.

A name that users rely on is not taken away at once: for a release or more the old one works and warns, naming the new
one. The warning is a FutureWarning, which Python shows to everybody (a DeprecationWarning only to developers).
"""

from __future__ import annotations

import functools
import importlib
import warnings
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

_F = TypeVar('_F', bound=Callable[..., Any])


def notice(kind: str, old: str, new: str) -> str:
    """What a user of an old name is told, in a log or a warning.

    Parameters
    ----------
    kind : str
        What has the name: 'parameter', 'topic', 'name'.
    old, new : str
        The names.

    Examples
    --------
    >>> notice('topic', 'edges', 'features')
    'topic edges is now features: use the new name, the old one will go'
    """
    return f'{kind} {old} is now {new}: use the new name, the old one will go'


def without_effect(kind: str, name: str) -> str:
    """The notice about a name that is still accepted and has no effect, for a log or a warning.

    Parameters
    ----------
    kind : str
        What has the name: 'parameter', 'argument'.
    name : str

    Examples
    --------
    >>> without_effect('parameter', 'seed')
    'parameter seed has no effect: leave it out, the name will go'
    """
    return f'{kind} {name} has no effect: leave it out, the name will go'


def renamed_names(module: str, names: Mapping[str, str]) -> Callable[[str], Any]:
    """A ``__getattr__`` for a module whose public names were renamed.

    Parameters
    ----------
    module : str
        The module's ``__name__``.
    names : mapping of str to str
        Old name to new name, in the same module, or to 'package.module.name'.

    Examples
    --------
    >>> __getattr__ = renamed_names(__name__, {'find': 'match'})
    """

    def module_getattr(name: str) -> Any:
        if name not in names:
            raise AttributeError(f'module {module!r} has no attribute {name!r}')
        new = names[name]
        where, _, attribute = new.rpartition('.')
        warnings.warn(
            notice('name', f'{module}.{name}', new if where else f'{module}.{new}'), FutureWarning, stacklevel=2
        )
        return getattr(importlib.import_module(where or module), attribute)

    return module_getattr


def renamed_arguments(**names: str) -> Callable[[_F], _F]:
    """A decorator for a function whose arguments were renamed: ``@renamed_arguments(old='new')``.

    Raises
    ------
    TypeError
        When the function is called with both.
    """

    def decorate(function: _F) -> _F:
        @functools.wraps(function)
        def accepting(*arguments: Any, **keywords: Any) -> Any:
            for old in names.keys() & keywords.keys():
                new = names[old]
                if new in keywords:
                    raise TypeError(f'{function.__name__}: {old} is the old name of {new}; give one of them')
                warnings.warn(notice(f'{function.__name__}: argument', old, new), FutureWarning, stacklevel=2)
                keywords[new] = keywords.pop(old)
            return function(*arguments, **keywords)

        return accepting  # type: ignore[return-value]

    return decorate
