"""Parser: statements through the lark grammar, then grouped into subroutines and functions."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from typing import Any, cast

from lark import Lark, Token, Transformer, v_args
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken, VisitError

from ..machine.kinds import CHARACTER, LOGICAL, integer, real
from .errors import FortranError
from .settings import MAX_EXPECTED
from .source import Statement, statements
from .syntax import Binary, Constant, DataTarget, Dimension, Entity, Node, Reference, Step, Unary, Unit, Whole

# Names of the grammar's terminals in error messages.
_READABLE = {
    'NAME': 'a name',
    'INT': 'a whole number',
    'REAL': 'a number',
    'TEXT': 'a text',
    'LPAR': "'('",
    'RPAR': "')'",
    'COMMA': "','",
    'EQUAL': "'='",
    'STAR': "'*'",
    'SLASH': "'/'",
    '$END': 'the end of the statement',
    'PLUS': "'+'",
    'MINUS': "'-'",
    'POWER': "'**'",
    'RELATION': 'a relation such as .EQ.',
    'NOT': '.NOT.',
    'AND': '.AND.',
    'OR': '.OR.',
    'EQUIV': '.EQV.',
    'TRUE': '.TRUE.',
    'FALSE': '.FALSE.',
}


def _at(token: Token) -> int:
    """Offset of a token in its statement."""
    return (token.column or 1) - 1


@v_args(inline=True)
class _Builder(Transformer):  # type: ignore[type-arg]  # one argument in lark 0.12, two in 1.1
    """Makes tree nodes; each method has the name of a rule of the grammar."""

    def start(self, label: Token | None, node: Node) -> Node:
        node.label = int(label) if label is not None else None
        return node

    def assignment(self, target: Reference, value: Any) -> Node:
        return Node('assign', {'target': target, 'value': value}, target.at)

    def call(self, _: Token, name: Token, items: list[Any] | None) -> Node:
        return Node('call', {'name': name.upper(), 'arguments': _arguments(items)}, _at(name))

    def goto(self, word: Token, label: Token) -> Node:
        return Node('goto', {'target': int(label)}, _at(word))

    def computed_goto(self, word: Token, labels: list[int], choice: Any) -> Node:
        return Node('computed_goto', {'targets': labels, 'choice': choice}, _at(word))

    def arithmetic_if(self, word: Token, value: Any, *labels: Token) -> Node:
        return Node('arithmetic_if', {'value': value, 'targets': [int(label) for label in labels]}, _at(word))

    def labels(self, *labels: Token) -> list[int]:
        return [int(label) for label in labels]

    def print_(self, word: Token, *items: Any) -> Node:
        values = [item for item in items if item is not None and not isinstance(item, Token)]
        return Node('print', {'values': values}, _at(word))

    def continue_(self, word: Token) -> Node:
        return Node('continue', {}, _at(word))

    def return_(self, word: Token) -> Node:
        return Node('return', {}, _at(word))

    def stop(self, word: Token) -> Node:
        return Node('stop', {}, _at(word))

    def logical_if(self, word: Token, condition: Any, then: Node) -> Node:
        return Node('if', {'condition': condition, 'then': then}, _at(word))

    def block_if(self, word: Token, condition: Any, _: Token) -> Node:
        return Node('block_if', {'condition': condition}, _at(word))

    def else_if(self, word: Token, condition: Any, _: Token) -> Node:
        return Node('else_if', {'condition': condition}, _at(word))

    def else_(self, word: Token) -> Node:
        return Node('else', {}, _at(word))

    def end_if(self, word: Token) -> Node:
        return Node('end_if', {}, _at(word))

    def do_label(self, word: Token, label: Token, name: Token, first: Any, last: Any, step: Any) -> Node:
        return self._do(word, int(label), name, first, last, step)

    def do_block(self, word: Token, name: Token, first: Any, last: Any, step: Any) -> Node:
        return self._do(word, None, name, first, last, step)

    def _do(self, word: Token, label: int | None, name: Token, first: Any, last: Any, step: Any) -> Node:
        variable = Reference(name.upper(), None, _at(name))
        return Node(
            'do', {'end_label': label, 'variable': variable, 'first': first, 'last': last, 'step': step}, _at(word)
        )

    def do_while(self, word: Token, condition: Any) -> Node:
        return Node('do_while', {'condition': condition}, _at(word))

    def end_do(self, word: Token) -> Node:
        return Node('end_do', {}, _at(word))

    def subroutine(self, word: Token, name: Token, names: list[str] | None) -> Node:
        return Node(
            'subroutine',
            {'name': name.upper(), 'arguments': names or [], 'entry': word.upper().startswith('ENTRY')},
            _at(name),
        )

    def function(self, type_: Token | None, word: Token, name: Token, names: list[str] | None) -> Node:
        rank = {'M': 2, 'V': 1}.get(word[0].upper(), 0)
        return Node(
            'function',
            {
                'name': name.upper(),
                'arguments': names or [],
                'rank': rank,
                'type': None if type_ is None else _squeezed(type_),
            },
            _at(name),
        )

    def names(self, *names: Token) -> list[str]:
        return [name.upper() for name in names]

    def end(self, word: Token) -> Node:
        return Node('end', {}, _at(word))

    def declaration(self, type_: Token, *entities: Entity) -> Node:
        return Node('declare', {'type': _squeezed(type_), 'entities': list(entities)}, _at(type_))

    def dimension(self, word: Token, *entities: Entity) -> Node:
        return Node('dimension', {'entities': list(entities)}, _at(word))

    def length(self, _: Token, number: Token) -> int:
        return int(number)

    def entity(self, name: Token, length: int | None, dimensions: list[Dimension] | None) -> Entity:
        return Entity(name.upper(), length, dimensions, _at(name))

    def dims(self, *dimensions: Dimension) -> list[Dimension]:
        return list(dimensions)

    def dim_assumed(self, *_: Token) -> Dimension:
        return Dimension(True, None)

    def dim_parallel(self, _: Token, extent: Any) -> Dimension:
        return Dimension(True, extent)

    def dim_serial(self, extent: Any) -> Dimension:
        return Dimension(False, extent)

    def parameter(self, word: Token, *pairs: Any) -> Node:
        constants = [(name.upper(), value, _at(name)) for name, value in zip(pairs[::2], pairs[1::2])]
        return Node('parameter', {'constants': constants}, _at(word))

    def block(self, _: Token, name: Token, __: Token) -> str:
        return name.upper()

    def common(self, word: Token, block: str | None, *entities: Entity) -> Node:
        return Node('common', {'block': block or '', 'entities': list(entities)}, _at(word))

    def data(self, word: Token, *sets: Any) -> Node:
        return Node('data', {'sets': list(sets)}, _at(word))

    def data_set(self, targets: list[DataTarget], _: Token, *values: Any) -> tuple[list[DataTarget], list[Any]]:
        return targets, [value for part in values[:-1] for value in part]

    def data_targets(self, *targets: DataTarget) -> list[DataTarget]:
        return list(targets)

    def data_name(self, name: Token) -> DataTarget:
        return DataTarget(name.upper(), _at(name))

    def data_element(self, name: Token, items: list[Any]) -> DataTarget:
        return DataTarget(name.upper(), _at(name), items)

    def data_loop(self, name: Token, items: list[Any], variable: Token, first: Any, last: Any, step: Any) -> DataTarget:
        return DataTarget(name.upper(), _at(name), items, (variable.upper(), first, last, step))

    def repeat(self, number: Token, _: Token) -> int:
        return int(number)

    def data_value(self, repeat: int | None, minus: Token | None, constant: Constant) -> list[Any]:
        value = -constant.value if minus is not None else constant.value
        return [value] * (1 if repeat is None else repeat)

    def geometry(self, word: Token, first: Token, second: Token | None) -> Node:
        return Node('geometry', {'names': [first.upper(), (second or first).upper()]}, _at(word))

    def implicit(self, word: Token) -> Node:
        return Node('implicit', {}, _at(word))

    def equivalence(self, word: Token, *shares: list[Reference]) -> Node:
        return Node('equivalence', {'shares': list(shares)}, _at(word))

    def share(self, *members: Reference) -> list[Reference]:
        return list(members)

    def external(self, word: Token, type_: Token | None, function: Token | None, *names: Token) -> Node:
        rank = None if function is None else {'M': 2, 'V': 1}.get(function[0].upper(), 0)
        return Node(
            'external',
            {
                'type': None if type_ is None else _squeezed(type_),
                'rank': rank,
                'names': [(name.upper(), _at(name)) for name in names],
            },
            _at(word),
        )

    def binary(self, left: Any, operator: Token, right: Any) -> Binary:
        return Binary(_OPERATORS.get(operator.upper(), operator.upper()), left, right, _at(operator))

    def unary(self, operator: Token, operand: Any) -> Unary:
        return Unary(operator.upper(), operand, _at(operator))

    def parenthesis(self, inner: Any) -> Any:
        return inner

    def integer(self, token: Token) -> Constant:
        value = int(token)
        if value >= 2**63:
            raise FortranError('number too large for INTEGER*8', 0, _at(token))
        return Constant(value, integer(4 if value < 2**31 else 8), _at(token))

    def real(self, token: Token) -> Constant:
        double = 'D' in token.upper()
        return Constant(float(token.upper().replace('D', 'E')), real(8 if double else 4), _at(token))

    def text(self, token: Token) -> Constant:
        return Constant(token[1:-1].replace(token[0] * 2, token[0]), CHARACTER, _at(token))

    def true(self, token: Token) -> Constant:
        return Constant(True, LOGICAL, _at(token))

    def false(self, token: Token) -> Constant:
        return Constant(False, LOGICAL, _at(token))

    def reference(self, name: Token, items: list[Any] | None) -> Reference:
        return Reference(name.upper(), items, _at(name))

    def items(self, *items: Any) -> list[Any]:
        return list(items)

    def whole(self) -> Whole:
        return Whole()

    def step(self, sign: Token) -> Step:
        return Step(1 if sign == '+' else -1, _at(sign))

    def index(self, expression: Any) -> Any:
        return expression


_OPERATORS = {'==': '.EQ.', '/=': '.NE.', '<': '.LT.', '<=': '.LE.', '>': '.GT.', '>=': '.GE.'}


def _squeezed(token: Token) -> str:
    """Text in upper case without blanks."""
    return ''.join(token.upper().split())


def _arguments(items: list[Any] | None) -> list[Any]:
    """Arguments of a call; those of CALL F() are none, though the brackets hold one empty item."""
    return [] if items is None or (len(items) == 1 and isinstance(items[0], Whole)) else items


@lru_cache(maxsize=1)
def _parser() -> Lark:
    """The parser of statements, made once."""
    text = resources.files(__package__).joinpath('grammar.lark').read_text(encoding='utf-8')
    return Lark(text, parser='lalr', transformer=_Builder(), maybe_placeholders=True)


def parse_statement(statement: Statement) -> Node:
    """Parse one statement.

    Parameters
    ----------
    statement : Statement

    Returns
    -------
    Node

    Raises
    ------
    FortranError
        With line, column and the offending text.
    """
    try:
        # The transformer makes a Node of every statement; lark's own type of a result is a tree.
        node = cast(Node, _parser().parse(statement.text))
    except UnexpectedToken as error:
        raise _unexpected(statement, error, str(getattr(error, 'token', '')), error.expected) from None
    except UnexpectedCharacters as error:
        found = statement.text[error.column - 1 : error.column]
        raise _unexpected(statement, error, found, error.allowed or set()) from None
    except (FortranError, VisitError) as error:
        inner = error if isinstance(error, FortranError) else error.orig_exc
        if not isinstance(inner, FortranError):
            raise
        raise located(statement, inner.column, inner.reason) from None
    except RecursionError:
        raise located(statement, 0, 'the expression is nested too deeply') from None
    node.source = statement
    if node.what == 'if':
        node.then.source = statement
    return node


def located(statement: Statement, offset: int, reason: str) -> FortranError:
    """Make an error at a character of a statement, which shows the source line.

    Parameters
    ----------
    statement : Statement
    offset : int
        Of the character in the statement's text.
    reason : str
    """
    line, column = statement.place(offset)
    piece = [piece for piece in statement.pieces if piece[1] == line][-1]
    following = [other[0] for other in statement.pieces if other[0] > piece[0]]
    text = statement.text[piece[0] : following[0] if following else None]
    return FortranError(reason, line, column, ' ' * (piece[2] - 1) + text)


def _unexpected(statement: Statement, error: UnexpectedInput, found: str, expected: Any) -> FortranError:
    """The error for a token or character that the grammar does not allow here."""
    token: Any = getattr(error, 'token', None)  # characters that start no token have none
    ended = found == '' or getattr(token, 'type', '') == '$END'
    offset = len(statement.text.rstrip()) if ended else max(0, (error.column or 1) - 1)
    names = sorted({_READABLE.get(name, name) for name in expected})
    hint = f'; expected {" or ".join(names)}' if 0 < len(names) <= MAX_EXPECTED else ''
    what = 'the statement ends too early' if ended else f'unexpected {found.strip()!r}'
    if not ended and getattr(token, 'type', '') == 'NAME' and offset == 0 and not hint:
        what = f'not a statement: {found!r}'
    return located(statement, offset, what + hint)


def _unit(header: Node) -> Unit:
    """A unit without statements, from its first line."""
    if header.what == 'function':
        return Unit(header.name, header.arguments, False, True, header.type, header.rank, header)
    return Unit(header.name, header.arguments, header.entry, False, None, 0, header)


def parse(source: str, form: str = 'auto') -> list[Unit]:
    """Parse a program.

    Parameters
    ----------
    source : str
    form : {'auto', 'free', 'fixed'}

    Returns
    -------
    list of Unit
        Its subroutines and functions; statements outside any of them make an ENTRY SUBROUTINE MAIN.

    Raises
    ------
    FortranError
        With line, column and the offending text.
    """
    units: list[Unit] = []
    current: Unit | None = None
    loose: list[Node] = []
    for statement in statements(source, form):
        node = parse_statement(statement)
        if node.what in ('subroutine', 'function'):
            if current is not None:
                raise located(statement, node.at, f'{current.name} has no END before this')
            current = _unit(node)
        elif node.what == 'end':
            if current is None and not loose:
                raise located(statement, node.at, 'END without a subroutine or function')
            if current is not None:
                units.append(current)
            current = None
        elif current is not None:
            current.body.append(node)
        else:
            loose.append(node)
    if current is not None:
        raise located(current.header.source, current.header.at, f'{current.name} has no END')
    if loose:
        header = Node('subroutine', {'name': 'MAIN', 'arguments': [], 'entry': True}, source=loose[0].source)
        units.append(Unit('MAIN', [], True, False, None, 0, header, loose))
    if not units:
        raise FortranError('the program is empty')
    return units
