"""What all commands have in common: exit codes, one line for an error, JSON for programs."""

import argparse
import enum
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from msgs_py import commands
from msgs_py.commands import CommandParser, add_json, as_text, run_command


class Colour(enum.Enum):
    RED = 1


def options(*given):
    parser = argparse.ArgumentParser()
    add_json(parser)
    return parser.parse_args(given)


def told(code, record):
    """A command that says something to people."""

    def run(_):
        print('for people')
        return code, record

    return run


def test_exit_codes_are_those_of_the_readme():
    assert (commands.DONE, commands.NOTHING, commands.BAD_INPUT, commands.INTERRUPTED) == (0, 1, 2, 130)


@pytest.mark.parametrize('code', [0, 1])
def test_text_is_for_people_and_json_for_programs(capsys, code):
    assert run_command('find', told(code, {'found': 3}), options()) == code
    assert capsys.readouterr() == ('for people\n', '')
    assert run_command('find', told(code, {'found': 3}), options('--json')) == code
    assert capsys.readouterr() == ('{"found": 3}\n', 'for people\n')


@pytest.mark.parametrize('error', [ValueError('part.csg: line 3'), FileNotFoundError('part.csg: no such file')])
def test_bad_input_is_one_line(capsys, error):
    def run(_):
        raise error

    assert run_command('find', run, options()) == 2
    assert capsys.readouterr() == ('', f'find: {error}\n')
    assert run_command('find', run, options('--json')) == 2
    out, err = capsys.readouterr()
    assert json.loads(out) == {'error': str(error)} and err == f'find: {error}\n'


def test_a_mistake_of_the_programmer_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        run_command('find', lambda _: 1 // 0, options())


def test_a_reader_that_has_seen_enough_is_no_error():
    code = (
        'import argparse, sys\n'
        'from msgs_py.commands import run_command\n'
        'def run(_):\n'
        '    for _ in range(100000): print("line")\n'
        '    return 1, {}\n'
        'sys.exit(run_command("many", run, argparse.Namespace(json=False)))\n'
    )
    environment = os.environ | {'PYTHONPATH': os.pathsep.join(filter(None, sys.path))}
    command = subprocess.Popen(
        [sys.executable, '-c', code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    assert command.stdout.readline() == 'line\n'
    command.stdout.close()
    assert command.wait(20) == 0 and not command.stderr.read()
    command.stderr.close()


def test_everything_has_its_form_in_json():
    record = {
        1: np.float64('inf'),
        'array': np.array([[1.5, np.nan]]),
        'nothing': None,
        'yes': True,
        'colour': Colour.RED,
        'path': Path('a') / 'b',
        'pair': (1, 'text'),
    }
    assert json.loads(as_text(record)) == {
        '1': None,
        'array': [[1.5, None]],
        'nothing': None,
        'yes': True,
        'colour': 'RED',
        'path': str(Path('a/b')),
        'pair': [1, 'text'],
    }


@pytest.mark.parametrize('as_json', [True, False])
def test_an_option_that_is_wrong_is_an_object_where_json_is_asked_for(capsys, as_json):
    parser = CommandParser(prog='find')
    add_json(parser)
    with pytest.raises(SystemExit) as ended:
        parser.parse_args(['--depth', *(['--json'] if as_json else [])])
    out, err = capsys.readouterr()
    assert ended.value.code == 2 and err.startswith('find: ') and 'usage: find' in err
    assert (json.loads(out)['error'] in err) if as_json else out == ''
