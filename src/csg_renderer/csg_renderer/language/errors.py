"""Errors and warnings that say where: file, line, column, the line itself with a caret, and what would have helped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import NamedTuple

from .settings import PROPOSALS, SHOWN, SIMILAR


class Place(NamedTuple):
    """Where something stands in a source text. line and column count from 1; length : characters underlined."""

    line: int
    column: int
    length: int = 1


class SceneError(ValueError):
    """A scene file that cannot be read.

    line, column : int, from 1 (1, 1 when the file as a whole is meant); message : what is wrong; hint : what to do,
    or ''; file : str, '' for text without a file; source : the line of the file; errors : all errors found in the
    same pass, this one first. ``str()`` shows them all.
    """

    def __init__(
        self,
        line: int,
        column: int,
        message: str,
        hint: str = '',
        *,
        file: str = '',
        source: str = '',
        length: int = 1,
        errors: Sequence[SceneError] = (),
    ) -> None:
        super().__init__(message)
        self.line = line
        self.column = column
        self.message = message
        self.hint = hint
        self.file = file
        self.source = source
        self.length = length
        self.errors: tuple[SceneError, ...] = tuple(errors) or (self,)

    def describe(self) -> str:
        """This error alone."""
        return describe(self.file, self.line, self.column, self.message, self.hint, self.source, self.length)

    def __str__(self) -> str:
        text = '\n'.join(error.describe() for error in self.errors)
        return text if len(self.errors) == 1 else f'{text}\n{len(self.errors)} errors'

    @classmethod
    def of(cls, errors: Sequence[SceneError]) -> SceneError:
        """The first of several errors, carrying all."""
        first = errors[0]
        return cls(
            first.line,
            first.column,
            first.message,
            first.hint,
            file=first.file,
            source=first.source,
            length=first.length,
            errors=errors,
        )


class SceneWarning(UserWarning):
    """Something in a scene file that is probably not meant: an unused name, nothing drawn."""


def describe(file: str, line: int, column: int, message: str, hint: str = '', source: str = '', length: int = 1) -> str:
    """``file:line:column: message``, the source line, a caret under it, and the hint."""
    parts = [f'{file or "scene"}:{line}:{column}: {message}']
    if source.strip():
        start = max(0, column - 1 - SHOWN // 2)
        shown = source.expandtabs(1)[start : start + SHOWN]
        caret = ' ' * (column - 1 - start) + '^' + '~' * (min(length, len(shown) - (column - 1 - start)) - 1)
        parts += [f'    {shown}', f'    {caret}']
    if hint:
        parts.append(f'    {hint}')
    return '\n'.join(parts)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A hint naming the known words nearest to this one, or ''."""
    known = sorted(set(known))
    folded: dict[str, str] = {}
    for candidate in known:
        folded.setdefault(candidate.upper(), candidate)
    close = get_close_matches(word.upper(), folded, n=PROPOSALS, cutoff=SIMILAR)
    if not close:
        return ''
    return 'did you mean ' + ' or '.join(f"'{folded[match]}'" for match in close) + '?'
