"""Source text to statements: cutting, the lark grammar, and syntax errors in words."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

import lark
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from . import ast
from .errors import Place, SceneError, did_you_mean
from .settings import MAX_CHARACTERS, MAX_ERRORS, MAX_NESTING, MAX_STATEMENT, MAX_STATEMENTS

# What must be known to cut a text into statements: strings and comments may hold a semicolon.
_PIECE = re.compile(r'"[^"\n]*"|//[^\n]*|#[^\n]*|/\*.*?\*/|/\*|[;()]', re.DOTALL)

_WORDS = {
    'NAME': 'a name',
    'NUMBER': 'a number',
    'STRING': 'a "file name"',
    'LPAR': "'('",
    'RPAR': "')'",
    'COMMA': "','",
    'EQUAL': "'='",
    'PLUS': "'+'",
    'MINUS': "'-'",
    'TIMES': "'*'",
    'OVER': "'/'",
    '$END': "';'",
}
_SIGNS = ('PLUS', 'MINUS', 'TIMES', 'OVER')
_PRIMITIVES = ('BLOCK', 'CYLINDER', 'SPHERE', 'CONE', 'PLANE', 'TERRAIN')
_OPERATORS = ('UNION', 'INTERSECT', 'DIFFERENCE')


@dataclass(frozen=True)
class Source:
    """A text and the name it is reported under."""

    text: str
    file: str = ''

    def line(self, number: int) -> str:
        """The line with this number (from 1), without its end; '' when there is none."""
        lines = self.text.split('\n')
        return lines[number - 1].rstrip('\r') if 0 < number <= len(lines) else ''

    def error(self, place: Place, message: str, hint: str = '') -> SceneError:
        """An error at a place of this text."""
        return SceneError(
            place.line, place.column, message, hint, file=self.file, source=self.line(place.line), length=place.length
        )


@dataclass(frozen=True)
class Statement:
    """One parsed statement. Places in ``node`` count from its start; ``locate`` makes them count from the file's."""

    node: ast.Statement
    start: Place

    def locate(self, place: Place) -> Place:
        """A place of the node, counted from the start of the file."""
        return _shift(place, self.start)


@dataclass(frozen=True)
class Broken:
    """A statement that does not parse. names : what it may have meant to define."""

    names: tuple[str, ...]


def parse_statements(source: Source) -> tuple[list[Statement | Broken], list[SceneError]]:
    """All statements of a text in order, and the syntax errors found (at most MAX_ERRORS)."""
    errors: list[SceneError] = []
    statements: list[Statement | Broken] = []
    if len(source.text) > MAX_CHARACTERS:
        return [], [
            SceneError(
                1, 1, f'the text has {len(source.text)} characters, at most {MAX_CHARACTERS} are read', file=source.file
            )
        ]
    for text, start in _cut(source, errors):
        if len(statements) == MAX_STATEMENTS:
            errors.append(source.error(start, f'more than {MAX_STATEMENTS} statements'))
            break
        try:
            statements.append(Statement(_parser().parse(text), start))  # type: ignore[arg-type]
        except UnexpectedInput as error:
            errors.append(_syntax_error(source, text, start, error))
            statements.append(Broken(tuple(re.findall(r'([A-Za-z_]\w*)\s*=', text))))
        if len(errors) >= MAX_ERRORS:
            break
    return statements, errors


def _cut(source: Source, errors: list[SceneError]) -> Iterator[tuple[str, Place]]:
    """Each statement's text, comments blanked out, and where it starts. Text that holds none is passed over."""
    text = source.text
    kept: list[str] = []
    begin = depth = 0
    line, line_begin, counted = 1, 0, 0
    start = Place(1, 1)

    def whole(end: int) -> str:
        return ''.join([*kept, text[begin:end]])

    def place(position: int) -> Place:
        nonlocal line, line_begin, counted
        newlines = text.count('\n', counted, position)
        if newlines:
            line += newlines
            line_begin = text.rindex('\n', counted, position) + 1
        counted = position
        return Place(line, position - line_begin + 1)

    too_deep = False
    for piece in _PIECE.finditer(text):
        token = piece.group()
        if token == ';':
            statement = whole(piece.start())
            if statement.strip() and not too_deep:
                yield _checked(statement, start, source, errors)
            kept, begin, depth, too_deep = [], piece.end(), 0, False
            start = place(begin)
        elif token == '(':
            depth += 1
            if depth > MAX_NESTING and not too_deep:
                too_deep = True
                errors.append(source.error(place(piece.start()), f'more than {MAX_NESTING} nested parentheses'))
        elif token == ')':
            depth -= 1
        elif token == '/*':
            errors.append(source.error(place(piece.start())._replace(length=2), "this comment is never closed by '*/'"))
            return
        elif not token.startswith('"'):
            kept += [text[begin : piece.start()], re.sub(r'[^\n]', ' ', token)]
            begin = piece.end()
    statement = whole(len(text))
    if statement.strip() and not too_deep:
        yield _checked(statement, start, source, errors)


def _checked(statement: str, start: Place, source: Source, errors: list[SceneError]) -> tuple[str, Place]:
    if len(statement) > MAX_STATEMENT:
        errors.append(
            source.error(
                start,
                f'a statement of {len(statement)} characters, at most {MAX_STATEMENT} are read',
                "end statements with ';'",
            )
        )
        return 'UNITS M', start
    return statement, start


@lru_cache(maxsize=1)
def _parser() -> lark.Lark:
    """The LALR parser, built once. Its lexer treats every keyword as reserved everywhere."""
    grammar = files(__package__).joinpath('grammar.lark').read_text(encoding='utf-8')
    # The same lexer has two names: 'standard' before lark 1.0, 'basic' since.
    lexer = 'standard' if lark.__version__.startswith('0.') else 'basic'
    return lark.Lark(grammar, parser='lalr', lexer=lexer, transformer=ast.Build())  # type: ignore[arg-type]


def _shift(place: Place, start: Place) -> Place:
    if place.line == 1:
        return Place(start.line, start.column + place.column - 1, place.length)
    return Place(start.line + place.line - 1, place.column, place.length)


def _syntax_error(source: Source, text: str, start: Place, error: UnexpectedInput) -> SceneError:
    if isinstance(error, UnexpectedCharacters):
        place = _shift(Place(error.line, error.column), start)
        character = text[error.pos_in_stream]
        hint = 'close the file name with a quote on the same line' if character == '"' else ''
        return source.error(place, f'{character!r} has no meaning here', hint)
    if not isinstance(error, UnexpectedToken):
        return source.error(start, 'the statement is incomplete')
    token = error.token  # type: ignore[attr-defined]
    expected = set(error.accepts or error.expected or ())
    if token.type == '$END':
        # Point just behind the last thing written, where the missing part belongs.
        stripped = text.rstrip()
        at = Place(stripped.count('\n') + 1, len(stripped) - (stripped.rfind('\n') + 1) + 1)
        return source.error(_shift(at, start), f'the statement ends too early, expected {_expected(expected)}')
    place = _shift(Place(token.line, token.column, len(token)), start)
    # Counted from line and column, because the attribute for the position has changed its name between lark versions.
    before = '\n'.join([*text.split('\n')[: token.line - 1], text.split('\n')[token.line - 1][: token.column - 1]])
    message = f'unexpected {str(token)!r}, expected {_expected(expected)}'
    return source.error(place, message, _hint(token, before, expected))


def _expected(expected: set[str]) -> str:
    """The expected terminals in words, whole families by their family name."""
    left = set(expected)
    words: list[str] = []
    for family, name in (
        (_SIGNS, 'an arithmetic sign'),
        (_PRIMITIVES, 'a primitive'),
        (_OPERATORS, 'an operator'),
        (ast.TRANSFORMS, 'a transform'),
        (ast.PROPERTIES, 'a surface property'),
    ):
        if len(left.intersection(family)) > 2:
            left.difference_update(family)
            words.append(name)
    # A sign in front of a number goes without saying.
    if 'NUMBER' in left:
        left.difference_update(('PLUS', 'MINUS'))
    if len(left) > 8 and '_DRAW' in left:
        return 'a statement (a definition, DRAW, LIGHT, ...)'
    words = sorted((_WORDS.get(name, name.lstrip('_')) for name in left), key=lambda w: (w[0] != "'", w)) + words
    return words[0] if len(words) == 1 else ', '.join(words[:-1]) + ' or ' + words[-1]


def _hint(token: lark.Token, before: str, expected: set[str]) -> str:
    """What may have been meant. before : the statement up to the token."""
    keywords = {name.lstrip('_') for name in expected}.intersection(ast.KEYWORDS)
    new_line = '$END' in expected and '\n' in before[len(before.rstrip()) :] and before.strip() != ''
    if token.type == 'NAME' and token.upper() in keywords:
        return f"words of the language are written in upper case: '{token.upper()}'"
    if token.type == 'NAME' and did_you_mean(token, keywords):
        return did_you_mean(token, keywords)
    if new_line:
        return "is a ';' missing at the end of the line before?"
    if str(token) in ast.KEYWORDS and 'NAME' in expected:
        return f"'{token}' is a word of the language and cannot be a name"
    previous = re.search(r'([A-Za-z_]\w*)\s*$', before)
    if previous and previous[1] not in ast.KEYWORDS:
        words = ast.STATEMENTS if 'EQUAL' in expected else keywords
        if previous[1].upper() in words:
            return f"words of the language are written in upper case: '{previous[1].upper()}'"
        return did_you_mean(previous[1], words)
    return ''
