"""Records the public names of the packages: what users may rely on.

    python test/docs/api_surface.py            # write test/docs/api_surface.json
    python test/docs/api_surface.py --check    # say what has changed; exit code 1 when anything has

A name that goes, or a parameter that changes, breaks somebody's program: look at the difference before you write it,
and say so in the package's CHANGELOG.rst.
"""

from __future__ import annotations

import argparse
import dataclasses
import enum
import importlib
import inspect
import json
import sys
from pathlib import Path
from typing import Any

RECORD = Path(__file__).with_suffix('.json')
MODULES = (
    'msgs_py',
    'msgs_py.codecs',
    'msgs_py.config',
    'msgs_py.confinement',
    'msgs_py.renaming',
    'msgs_py.runtime',
    'dap_emulator',
    'dap_emulator.fortran_plus',
    'csg_renderer',
    'stereo_recovery',
    'model_matcher',
)


def public_names(module: Any) -> list[str]:
    if hasattr(module, '__all__'):
        return sorted(module.__all__)
    return sorted(
        name
        for name, value in vars(module).items()
        if not name.startswith('_') and getattr(value, '__module__', None) == module.__name__
    )


def signature(function: Any) -> str:
    """Names, kinds and plain defaults; no annotations, which differ between versions of Python."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return '(...)'
    shown = []
    for parameter in parameters:
        default = parameter.default
        if isinstance(default, float):
            default = float(default)  # numpy's own floats show themselves otherwise
        plain = default is inspect.Parameter.empty or default is None or isinstance(default, (bool, int, float, str))
        shown.append(
            str(
                parameter.replace(
                    annotation=inspect.Parameter.empty, default=default if plain else inspect.Parameter.empty
                )
            )
            + ('' if plain else '=...')
        )
    return f'({", ".join(shown)})'


def own_names(value: type) -> set[str]:
    """Names that a class has of its own, or from classes of these packages."""
    bases = [base for base in value.__mro__ if base.__module__.split('.')[0] in MODULES]
    return {name for base in bases for name in vars(base)}


def described(value: Any) -> Any:
    """A function's signature; a class's members; a constant's type."""
    if inspect.isclass(value):
        if issubclass(value, enum.Enum):
            return {'members': {item.name: item.value for item in value}}
        members = {'()': signature(value)}
        if dataclasses.is_dataclass(value):
            members['fields'] = [field.name for field in dataclasses.fields(value) if not field.name.startswith('_')]
        for name in sorted(own_names(value)):
            if name.startswith('_') or name in members.get('fields', ()):
                continue
            member = inspect.getattr_static(value, name)
            if isinstance(member, property):
                members[name] = 'property'
            elif isinstance(member, (staticmethod, classmethod)) or inspect.isfunction(member):
                members[name] = signature(getattr(value, name))
        return members
    if callable(value):
        return signature(value)
    return 'module' if inspect.ismodule(value) else type(value).__name__


def surface() -> dict[str, dict[str, Any]]:
    result = {}
    for name in MODULES:
        module = importlib.import_module(name)
        result[name] = {item: described(getattr(module, item)) for item in public_names(module)}
    return result


def flat(found: dict, prefix: str = '') -> dict[str, str]:
    rows: dict[str, str] = {}
    for key, value in found.items():
        if isinstance(value, dict):
            rows |= flat(value, f'{prefix}{key}.')
        else:
            rows[prefix + key] = str(value)
    return rows


def differences(recorded: dict, found: dict) -> list[str]:
    """One line a change."""
    old, new = flat(recorded), flat(found)
    return (
        [f'gone:    {name} {old[name]}' for name in sorted(set(old) - set(new))]
        + [f'new:     {name} {new[name]}' for name in sorted(set(new) - set(old))]
        + [
            f'changed: {name} {old[name]} -> {new[name]}'
            for name in sorted(set(old) & set(new))
            if old[name] != new[name]
        ]
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--check', action='store_true', help='write nothing')
    check = parser.parse_args().check
    found = surface()
    recorded = json.loads(RECORD.read_text(encoding='utf-8')) if RECORD.exists() else {}
    changes = differences(recorded, found)
    print('\n'.join(changes) or 'unchanged')
    if not check:
        RECORD.write_text(json.dumps(found, indent=1, sort_keys=True) + '\n', encoding='utf-8')
    return int(check and bool(changes))


if __name__ == '__main__':
    sys.exit(main())
