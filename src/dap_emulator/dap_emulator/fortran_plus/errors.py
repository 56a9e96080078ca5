"""Errors of Fortran-Plus programs: where, what, and the line itself."""

from __future__ import annotations

from ..machine.machine import OutOfStore


class FortranError(ValueError):
    """A program cannot be compiled or run.

    Parameters
    ----------
    reason : str
        What is wrong.
    line, column : int
        Where, from 1; 0 where no place is known.
    text : str
        The source line.

    Examples
    --------
    >>> print(FortranError('a name is missing', 3, 5, 'X = )'))
    line 3, column 5: a name is missing
      X = )
          ^
    """

    def __init__(self, reason: str, line: int = 0, column: int = 0, text: str = '') -> None:
        self.reason, self.line, self.column, self.text = reason, line, column, text
        where = f'line {line}, column {column}: ' if line else ''
        shown = f'\n  {text.rstrip()}\n  {" " * max(0, column - 1)}^' if text else ''
        super().__init__(f'{where}{reason}{shown}')


class FortranStoreError(FortranError, OutOfStore):
    """A program asked for more bit-planes than are free; the parameters are those of :class:`FortranError`."""


class Stopped(RuntimeError):
    """A run was stopped from outside: cancelled, or out of time or cycles."""
