"""Errors and warnings that say where: file, line, column, the line itself with a caret, and what would have helped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import NamedTuple

from .settings import PROPOSALS, SHOWN, SIMILAR


class Place(NamedTuple):
    """Where something stands in a source text.

    Attributes
    ----------
    line, column : int
        Counted from 1.
    length : int
        Characters to underline.
    """

    line: int
    column: int
    length: int = 1


class SceneError(ValueError):
    """A scene file that cannot be read. ``str()`` shows all errors that were found in the same pass.

    Attributes
    ----------
    line, column : int
        Counted from 1; 1, 1 when the file as a whole is meant.
    message : str
        What is wrong.
    hint : str
        What to do, or ''.
    file : str
        Name of the file, '' for text without one.
    source : str
        The line of the file.
    errors : tuple of SceneError
        All errors of the pass, this one first.

    Examples
    --------
    >>> from csg_renderer import parse_scene
    >>> try:
    ...     parse_scene('part = BLOK (1, 1, 1); DRAW part;')
    ... except SceneError as error:
    ...     print(error.line, error.column, error.hint)
    1 8 did you mean 'BLOCK'?
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
        """The text for one error alone, without the others of its pass."""
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
    """A report: ``file:line:column: message``, the source line, a caret under it, and the hint.

    Parameters
    ----------
    file : str
        '' for text without a file.
    line, column : int
        Counted from 1.
    message, hint : str
        What is wrong, and what to do.
    source : str
        The line of the file; '' leaves line and caret out.
    length : int
        Characters to underline.

    Returns
    -------
    str
        Of several lines.
    """
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
    """A hint naming the known words nearest to one that is not.

    Parameters
    ----------
    word : str
    known : iterable of str

    Returns
    -------
    str
        '' when no word is near.

    Examples
    --------
    >>> did_you_mean('SPERE', ['SPHERE', 'CONE'])
    "did you mean 'SPHERE'?"
    """
    known = sorted(set(known))
    folded: dict[str, str] = {}
    for candidate in known:
        folded.setdefault(candidate.upper(), candidate)
    close = get_close_matches(word.upper(), folded, n=PROPOSALS, cutoff=SIMILAR)
    if not close:
        return ''
    return 'did you mean ' + ' or '.join(f"'{folded[match]}'" for match in close) + '?'
