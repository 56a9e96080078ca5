"""Compiled functions: what processes and changed sources may not do to their cache."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

pytest.importorskip('numba')

from msgs_py.compiled import LOCK_FILE

INNER = 'from msgs_py.compiled import njit\n\n\n@njit\ndef inner(x):\n    return x + {offset}\n'
OUTER = textwrap.dedent('''\
    from inner import inner
    from msgs_py.compiled import njit


    @njit
    def outer(x):
        return 2 * inner(x)
    ''')
# One process calls with an integer first, the other with a float: two signatures of the same functions.
CALL = 'from outer import outer\nimport sys\nprint(*(outer(eval(word)) for word in sys.argv[1:]))'


@pytest.fixture
def modules(tmp_path: Path) -> Path:
    (tmp_path / 'inner.py').write_text(INNER.format(offset=1))
    (tmp_path / 'outer.py').write_text(OUTER)
    return tmp_path


def start(folder: Path, *words: str) -> subprocess.Popen[str]:
    environment = {**os.environ, 'NUMBA_CACHE_DIR': '', 'NUMBA_DISABLE_JIT': '0'}
    return subprocess.Popen([sys.executable, '-c', CALL, *words], cwd=folder, env=environment, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def answer(process: subprocess.Popen[str]) -> str:
    out, errors = process.communicate()
    assert process.returncode == 0, errors
    return out.strip()


def test_a_second_process_loads_what_the_first_compiled(modules):
    assert answer(start(modules, '1')) == '4'
    cached = sorted(path.name for path in (modules / '__pycache__').glob('outer.*.nbc'))
    assert len(cached) == 1
    assert answer(start(modules, '5')) == '12'
    assert sorted(path.name for path in (modules / '__pycache__').glob('outer.*.nbc')) == cached


def test_a_change_in_a_called_function_is_followed(modules):
    assert answer(start(modules, '1')) == '4'
    (modules / 'inner.py').write_text(INNER.format(offset=10))
    assert answer(start(modules, '1')) == '22'


def test_processes_that_compile_at_the_same_time_do_not_mix_their_signatures(modules):
    together = [start(modules, *words) for words in (('1', '1.5'), ('1.5', '1'), ('1.5', '1'), ('1', '1.5'))]
    assert [answer(process) for process in together] == ['4 5.0', '5.0 4', '5.0 4', '4 5.0']
    assert answer(start(modules, '1', '1.5')) == '4 5.0'


def test_where_nobody_can_write_the_cache_is_read_without_a_lock(modules):
    """As root everything can be written; a folder in the lock's place cannot be opened by anybody."""
    assert answer(start(modules, '1')) == '4'
    lock = modules / '__pycache__' / LOCK_FILE
    lock.unlink()
    lock.mkdir()
    assert answer(start(modules, '1')) == '4'


def test_a_system_without_file_locks_computes_the_same(modules):
    code = 'import sys; sys.modules["fcntl"] = None\n' + CALL
    process = subprocess.run([sys.executable, '-c', code, '1'], cwd=modules, capture_output=True, text=True, check=True,
                             env={**os.environ, 'NUMBA_CACHE_DIR': '', 'NUMBA_DISABLE_JIT': '0'})
    assert process.stdout.strip() == '4'
