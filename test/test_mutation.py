"""The mutants of make mutants: what is changed, and what is left alone."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent / 'mutation'))
from mutants import mutants_of


def changes(text: str) -> set[tuple[str, str]]:
    return {(one.before, one.after) for one in mutants_of(ast.parse(text))}


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('a < b', {('a < b', 'a >= b')}),
        ('len(a) <= b', {('len(a) <= b', 'len(a) < b'), ('len(a) <= b', 'len(a) > b')}),
        ('a + b', {('a + b', 'a - b')}),
        ('a and b', {('a and b', 'a or b')}),
        ('x = not a', {('not a', 'a')}),
        ('x = -a', {('-a', 'a')}),
        ('x = 2.5', {('2.5', '3.5')}),
        ('x = True', {('True', 'False')}),
        ("x = 'key'", {("'key'", "'keyX'")}),
        ('a.b = c', {('a.b = c', 'pass')}),
        ('f(a)', {('f(a)', 'pass')}),
        ('x = min(a)', {('min', 'max')}),
        ('def f():\n    return a', {('return a', 'return None')}),
        ('def f():\n    return False', {('False', 'True')}),
        ("if a:\n    raise ValueError('b')", {("raise ValueError('b')", 'pass'), ('a', 'not a')}),
        ('for a in b:\n    continue', {('continue', 'break')}),
    ],
)
def test_what_is_changed(text, expected):
    assert changes(text) == expected


@pytest.mark.parametrize(
    'text',
    [
        '"""A docstring."""',
        'def f(a: int | None) -> tuple[int, 3]: ...',
        "x = 'a text for people'",
        "x = f'{a} of {b}'",
        "x = argsort(a, kind='stable')",
        '@decorator(1)\ndef f(): ...',
        "__all__ = ['a']",
        'if TYPE_CHECKING:\n    x = 1',
        'import a',
    ],
)
def test_what_is_left_alone(text):
    assert not changes(text)


def test_a_mutant_is_one_change_of_the_tree():
    text = 'def f(a):\n    if a < 0:\n        return -a\n    return a + 1\n'
    for number, mutant in enumerate(mutants_of(ast.parse(text))):
        tree = ast.parse(text)
        again = mutants_of(tree)[number]
        assert (again.line, again.before, again.after) == (mutant.line, mutant.before, mutant.after)
        assert ast.unparse(tree) == ast.unparse(ast.parse(text)), 'finding them changes nothing'
        again.apply()
        assert ast.unparse(tree) != ast.unparse(ast.parse(text))
        compile(ast.fix_missing_locations(tree), 'f.py', 'exec')
