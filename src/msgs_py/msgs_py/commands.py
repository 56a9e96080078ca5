"""What all commands have in common: exit codes, one line for an error, and ``--json``.

Text for people goes to stdout. With ``--json`` it goes to stderr, and stdout gets one JSON object, also when a command
has bad input: ``{"error": "..."}``.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import sys
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any, NoReturn

import numpy as np

DONE = 0
"""The command did what it was asked, and found what it looked for."""
NOTHING = 1
"""It ran, and the answer is no: nothing found, too few recognised, or the program that it ran has failed."""
BAD_INPUT = 2
"""It did not run: an option, a file or what stands in one cannot be used."""
INTERRUPTED = 130
"""Ended by Ctrl-C, as shells count it."""


class CommandParser(argparse.ArgumentParser):
    """The options of a command; of what is wrong with them the first line on stderr says it, before the usage."""

    _as_json = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse's."""
        self._as_json = '--json' in (sys.argv[1:] if args is None else args)
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """As argparse's."""
        print(f'{self.prog}: {message}', file=sys.stderr)
        self.print_usage(sys.stderr)
        if self._as_json:
            print(as_text({'error': message}))
        raise SystemExit(BAD_INPUT)


def add_json(parser: argparse.ArgumentParser) -> None:
    """Give a command its option ``--json``."""
    parser.add_argument(
        '--json', action='store_true', help='print one JSON object on stdout, and text for people on stderr'
    )


def run_command(
    name: str, run: Callable[[argparse.Namespace], tuple[int, Mapping[str, Any]]], options: argparse.Namespace
) -> int:
    """Run a command; OSError and ValueError are bad input, said in one line on stderr.

    Parameters
    ----------
    name : str
        Of the command, with which the line begins.
    run : callable
        Takes the options; returns the exit code and what ``--json`` prints.
    options : argparse.Namespace
        With ``json``.

    Returns
    -------
    int
        The exit code.
    """
    people = contextlib.redirect_stdout(sys.stderr) if options.json else contextlib.nullcontext()
    try:
        try:
            with people:
                code, record = run(options)
        except (OSError, ValueError) as error:
            if isinstance(error, BrokenPipeError):
                raise
            print(f'{name}: {error}', file=sys.stderr)
            code, record = BAD_INPUT, {'error': str(error)}
        if options.json:
            print(as_text(record))
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of the output has closed it, and needs no more
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    return code


def as_text(record: Any) -> str:
    """A record as JSON: arrays as lists, paths and enumerations by name, what is not a number as null.

    Examples
    --------
    >>> as_text({'a': np.array([1.0, np.nan]), 'b': 2})
    '{"a": [1.0, null], "b": 2}'
    """
    return json.dumps(_plain(record), allow_nan=False)


def _plain(value: Any) -> Any:
    """A value as JSON has it."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return value.name if isinstance(value, Enum) else str(value)
