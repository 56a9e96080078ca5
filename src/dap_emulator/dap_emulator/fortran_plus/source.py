"""From source text to statements: comments, labels and continuation lines, in fixed or free form.

Fixed form: C, c, * or ! in column 1 starts a comment, columns 1-5 hold a label, a character in column 6 continues the
line before, and columns after 72 are ignored. Free form: ! starts a comment (so does a C line that cannot be a
statement), & at the end continues, a label is a number at the start.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from .errors import FortranError

FORMS = ('auto', 'free', 'fixed')
# Columns of Fortran's fixed form: the label's, and the last that counts.
LABEL_COLUMNS = 5
LAST_COLUMN = 72
TAB_STOP = 8
_COMMENT_C = re.compile(r'[Cc*](?:\s*$|[^A-Za-z0-9_]*\*|\s+(?![=(\s])|-)')


@dataclass
class Statement:
    """The text of one statement, and where each of its pieces stands in the source.

    Parameters
    ----------
    text : str
    pieces : list of (int, int, int)
        Offset in the text, line and column, of every source line that it came from.
    """

    text: str
    pieces: list[tuple[int, int, int]] = field(default_factory=list)

    @property
    def line(self) -> int:
        """Line of its beginning, from 1."""
        return self.pieces[0][1]

    def place(self, offset: int) -> tuple[int, int]:
        """Line and column, from 1, of the character at an offset of the text."""
        start, line, column = [piece for piece in self.pieces if piece[0] <= max(0, offset)][-1]
        return line, column + max(0, offset) - start


def statements(source: str, form: str = 'auto') -> list[Statement]:
    r"""Cut a source text into statements.

    Parameters
    ----------
    source : str
    form : {'auto', 'free', 'fixed'}
        Form of its lines; 'auto' takes the text for fixed form when every line keeps to the columns of that.

    Returns
    -------
    list of Statement

    Raises
    ------
    FortranError
        For a character or a line that belongs to no statement.
    ValueError
        For another form.

    Examples
    --------
    >>> [statement.text for statement in statements('A = 1 &\n    + 2 ! a sum\nB = A')]
    ['A = 1  + 2 ', 'B = A']
    """
    if form not in FORMS:
        raise ValueError(f'form: expected one of {", ".join(FORMS)}, got {form!r}')
    lines = source.expandtabs(TAB_STOP).splitlines()
    for number, line in enumerate(lines, 1):
        odd = re.search(r'[^\x20-\x7e]', line.split('!')[0])
        if odd and not _COMMENT_C.match(line):
            raise FortranError(f'unexpected character {odd[0]!r}', number, odd.start() + 1, line)
    fixed = form == 'fixed' or (form == 'auto' and _looks_fixed(lines))
    return _fixed(lines) if fixed else _free(lines)


def _looks_fixed(lines: list[str]) -> bool:
    """Whether every line keeps to the columns of fixed form, and at least one is a statement."""
    found = False
    for line in lines:
        if not line.strip() or line[0] in 'Cc*!':
            continue
        label, sign = line[:LABEL_COLUMNS], line[LABEL_COLUMNS : LABEL_COLUMNS + 1]
        if not re.fullmatch(r'[ \d]{5}', label) or (sign.strip() and label.strip()):
            return False
        found = True
    return found and not any(line.rstrip().endswith('&') for line in lines)


def _add(found: list[Statement], text: str, line: int, column: int) -> None:
    """Begin a statement."""
    found.append(Statement(text, [(0, line, column)]))


def _extend(found: list[Statement], text: str, line: int, column: int) -> None:
    """Continue the last statement."""
    last = found[-1]
    last.pieces.append((len(last.text), line, column))
    last.text += text


def _fixed(lines: list[str]) -> list[Statement]:
    """Statements of lines in fixed form."""
    found: list[Statement] = []
    for number, line in enumerate(lines, 1):
        if not line.strip() or line[0] in 'Cc*!':
            continue
        body = _without_comment(line[:LAST_COLUMN])
        if not body.strip():
            continue
        label, sign, rest = body[:LABEL_COLUMNS], body[LABEL_COLUMNS : LABEL_COLUMNS + 1], body[LABEL_COLUMNS + 1 :]
        if sign.strip() and sign != '0':
            if label.strip():
                raise FortranError('a continuation line has a label', number, 1, line)
            if not found:
                raise FortranError('a continuation line continues nothing', number, LABEL_COLUMNS + 1, line)
            _extend(found, rest.rstrip() + ' ', number, LABEL_COLUMNS + 2)
            continue
        if not re.fullmatch(r'[ \d]*', label):
            raise FortranError('columns 1 to 5 hold a label or blanks in fixed form', number, 1, line)
        _add(found, label + ' ' + rest.rstrip(), number, 1)
    return found


def _free(lines: list[str]) -> list[Statement]:
    """Statements of lines in free form."""
    found: list[Statement] = []
    continued = False
    for number, line in enumerate(lines, 1):
        if _COMMENT_C.match(line):
            continue
        body = _without_comment(line).rstrip()
        if not body.strip():
            continue
        more = body.endswith('&')
        if more:
            body = body[:-1] + ' '
        start = len(body) - len(body.lstrip())
        if continued and body[start : start + 1] == '&':
            start += 1
        if continued:
            _extend(found, body[start:] + ' ', number, start + 1)
        else:
            _add(found, body[start:], number, start + 1)
        continued = more
    if continued:
        raise FortranError('the last line is continued (&) but nothing follows', len(lines), len(lines[-1]), lines[-1])
    return found


def _without_comment(line: str) -> str:
    """The line up to a ! that is not inside a character constant."""
    quote = ''
    for position, character in enumerate(line):
        if quote:
            quote = '' if character == quote else quote
        elif character in '\'"':
            quote = character
        elif character == '!':
            return line[:position]
    return line
