"""The public names are those that are recorded: nothing goes or changes by accident."""

from __future__ import annotations

import enum
import importlib
import inspect
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

SCRIPT = Path(__file__).resolve().parent / 'docs' / 'api_surface.py'
RECORD = json.loads(SCRIPT.with_suffix('.json').read_text(encoding='utf-8'))


def callables(module: str) -> Iterator[tuple[str, Any]]:
    """Public functions and classes of a module, and the methods of these, each with its name."""
    found = importlib.import_module(module)
    for name in sorted(RECORD[module].keys() & vars(found).keys()):
        value = getattr(found, name)
        if not callable(value) or not inspect.getmodule(value):
            continue
        yield name, value
        if inspect.isclass(value):
            yield from ((f'{name}.{key}', member) for key, member in vars(value).items() if inspect.isfunction(member))


def test_the_public_names_are_those_recorded():
    result = subprocess.run(
        [sys.executable, str(SCRIPT), '--check'], capture_output=True, text=True, timeout=50, check=False
    )
    assert result.returncode == 0, (
        f'{result.stdout}{result.stderr[-2000:]}\nIf that is meant: python test/docs/api_surface.py, and a line in the '
        'CHANGELOG.rst of the package'
    )


@pytest.mark.parametrize('module', RECORD)
def test_what_is_public_says_what_it_takes(module):
    """In numpydoc sections, where it takes two arguments or more; some refer to what takes the same."""
    silent = []
    for name, value in callables(module):
        words = inspect.getdoc(value) or ''
        if name.rpartition('.')[2].startswith('_') or (inspect.isclass(value) and issubclass(value, enum.Enum)):
            continue
        try:
            parameters = inspect.signature(value).parameters.values()
        except ValueError:  # an exception with the constructor of its base
            parameters = ()
        plain = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
        if not words or (
            len([p for p in parameters if p.kind in plain and p.name != 'self']) > 1
            and not re.search(r'^(Parameters|Attributes)\n---', words, re.MULTILINE)
            and not re.search('those of|as for', words)
        ):
            silent.append(name)
    assert not silent
