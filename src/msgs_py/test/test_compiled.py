"""Compiled functions: whose machine code is used again, and what may not go wrong with it."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

pytest.importorskip('numba')

from msgs_py.numeric.compiled import SUFFIX

SETTINGS = 'LIMIT = {limit}\n'
KERNEL = 'from msgs_py.numeric.compiled import njit\n\nkernel = njit(nogil=True)\n'
INNER = textwrap.dedent('''\
    from lower.options import kernel
    from lower.settings import LIMIT


    @kernel
    def inner(x):
        """{words}"""
        return x + {offset} if x < LIMIT else x
    ''')
OUTER = textwrap.dedent("""\
    from lower import sums
    from msgs_py.numeric.compiled import njit


    @njit
    def outer(x):
        return 2 * sums.inner(x)
    """)
# One process calls with an integer first, the other with a float: two signatures of the same functions.
CALL = 'from upper.doubled import outer\nimport sys\nprint(*(outer(eval(word)) for word in sys.argv[1:]))'


def write(folder: Path, offset: int = 1, limit: int = 100, words: str = 'Add.') -> Path:
    """Two packages: a function of ``upper`` calls one of ``lower``, which takes its options from a third module."""
    for name, text in (
        ('lower/settings.py', SETTINGS.format(limit=limit)),
        ('lower/options.py', KERNEL),
        ('lower/sums.py', INNER.format(offset=offset, words=words)),
        ('upper/doubled.py', OUTER),
    ):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        (path.parent / '__init__.py').touch()
        path.write_text(text)
    return folder


@pytest.fixture
def modules(tmp_path: Path) -> Path:
    return write(tmp_path / 'checkout')


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    return tmp_path / 'cache'


def start(folder: Path, cache: Path, *words: str, code: str = CALL, **extra: str) -> subprocess.Popen[str]:
    environment = {
        **os.environ,
        'MSGS_PY_CACHE_DIR': str(cache),
        'NUMBA_DISABLE_JIT': '0',
        'PYTHONDONTWRITEBYTECODE': '1',
        **extra,
    }
    return subprocess.Popen(
        [sys.executable, '-c', code, *words],
        cwd=folder,
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def answer(process: subprocess.Popen[str]) -> str:
    out, errors = process.communicate()
    assert process.returncode == 0, errors
    return out.strip()


def entries(cache: Path) -> list[str]:
    return sorted(path.name for path in cache.glob(f'*{SUFFIX}'))


def test_a_second_process_loads_what_the_first_compiled(modules, cache):
    assert answer(start(modules, cache, '1')) == '4'
    made = entries(cache)
    assert len(made) == 1  # what it calls is within
    assert answer(start(modules, cache, '5')) == '12'
    assert entries(cache) == made


def test_a_second_checkout_and_another_docstring_share_the_machine_code(modules, cache, tmp_path):
    assert answer(start(modules, cache, '1')) == '4'
    made = entries(cache)
    other = write(tmp_path / 'elsewhere', words='Says the same in other words.')
    assert answer(start(other, cache, '1')) == '4'
    assert entries(cache) == made


# Functions of one name, types and order of making, which do not do the same: numba's sorts are such, too.
CLOSURES = textwrap.dedent("""\
    import sys
    from msgs_py.numeric.compiled import njit


    def made(step):
        @njit
        def down(n):
            return 0 if n < 1 else step + down(n - 1)  # calls itself, so that it is not written into its caller

        return down


    one, ten = made(1), made(10)


    @njit
    def by_one(n):
        return one(n)


    @njit
    def by_ten(n):
        return ten(n)


    print(*(globals()[name](4) for name in sys.argv[1:]))
    """)


def test_functions_of_one_name_that_two_processes_compiled_stay_apart(tmp_path, cache):
    for name, result in (('by_one', '4'), ('by_ten', '40')):
        assert answer(start(tmp_path, cache, name, code=CLOSURES)) == result
    assert answer(start(tmp_path, cache, 'by_one', 'by_ten', code=CLOSURES)) == '4 40'
    assert answer(start(tmp_path, cache, 'by_ten', 'by_one', code=CLOSURES)) == '40 4'


def test_a_change_in_a_function_that_another_room_calls_is_followed(modules, cache):
    assert answer(start(modules, cache, '1')) == '4'
    write(modules, offset=10)
    assert answer(start(modules, cache, '1')) == '22'


def test_a_changed_constant_of_another_module_is_followed(modules, cache):
    assert answer(start(modules, cache, '50')) == '102'
    write(modules, limit=10)
    assert answer(start(modules, cache, '50')) == '100'


def test_an_earlier_content_finds_its_code_again(modules, cache):
    assert answer(start(modules, cache, '1')) == '4'
    made = entries(cache)
    write(modules, offset=10)
    assert answer(start(modules, cache, '1')) == '22'
    write(modules, offset=1)
    assert answer(start(modules, cache, '1')) == '4'
    assert len(entries(cache)) == 2 * len(made)


def test_the_order_of_a_named_tuples_fields_belongs_to_the_content(tmp_path, cache):
    code = textwrap.dedent("""\
        from collections import namedtuple
        import sys
        from msgs_py.numeric.compiled import njit
        Pair = namedtuple('Pair', sys.argv[1])
        @njit
        def first(pair):
            return pair.a
        print(first(Pair(1, 2)))
        """)
    assert answer(start(tmp_path, cache, 'a b', code=code)) == '1'
    assert answer(start(tmp_path, cache, 'b a', code=code)) == '2'


def test_processes_that_compile_at_the_same_time_do_not_mix_their_signatures(modules, cache):
    together = [start(modules, cache, *words) for words in (('1', '1.5'), ('1.5', '1'), ('1.5', '1'), ('1', '1.5'))]
    assert [answer(process) for process in together] == ['4 5.0', '5.0 4', '5.0 4', '4 5.0']
    assert answer(start(modules, cache, '1', '1.5')) == '4 5.0'
    assert len(entries(cache)) == 2


def test_a_damaged_entry_is_compiled_again(modules, cache):
    assert answer(start(modules, cache, '1')) == '4'
    for path in cache.glob(f'*{SUFFIX}'):
        path.write_bytes(path.read_bytes()[:-100])
    assert answer(start(modules, cache, '1')) == '4'


def test_where_nothing_can_be_written_everything_is_compiled(modules, tmp_path):
    """As root everything can be written; below a file nothing can, and a full device takes no byte."""
    blocked = tmp_path / 'file'
    blocked.write_text('')
    assert answer(start(modules, blocked / 'cache', '1')) == '4'
    full = tmp_path / 'full'
    full.mkdir()
    no_room = (
        'import os, errno\n\ndef replace(a, b):\n    raise OSError(errno.ENOSPC, "no space")\n\nos.replace = replace\n'
    )
    assert answer(start(modules, full, '1', code=no_room + CALL)) == '4'
    assert list(full.iterdir()) == []


def test_the_cache_is_the_users_own_unless_a_variable_moves_it(modules, tmp_path):
    assert (
        answer(
            start(modules, Path(), '1', MSGS_PY_CACHE_DIR='', NUMBA_CACHE_DIR='', XDG_CACHE_HOME=str(tmp_path / 'xdg'))
        )
        == '4'
    )
    assert len(entries(tmp_path / 'xdg' / 'msgs_py' / 'machinecode')) == 1
    assert answer(start(modules, Path(), '1', MSGS_PY_CACHE_DIR='', NUMBA_CACHE_DIR=str(tmp_path / 'numba'))) == '4'
    assert len(entries(tmp_path / 'numba' / 'msgs_py' / 'machinecode')) == 1


def test_the_cache_stays_within_its_size(modules, cache):
    limited = 'import msgs_py.numeric.compiled as c\nc.CACHE_BYTES = 1\n' + CALL
    assert answer(start(modules, cache, '1', code=limited)) == '4'
    assert len(entries(cache)) <= 1


def test_what_compiled_functions_call_can_be_called_from_python_before_and_after(modules, cache):
    code = 'from upper.doubled import outer, sums\n'
    assert (
        answer(start(modules, cache, code=f'{code}print(outer(1), sums.inner(1), outer(1), sums.inner(2))'))
        == '4 2 4 3'
    )
    assert answer(start(modules, cache, code=f'{code}print(sums.inner(1), outer(1), sums.inner(1.5))')) == '2 4 2.5'


def test_what_was_loaded_can_be_taken_in_by_what_is_compiled_anew(modules, cache):
    """The stored function is called first, so that its machine code stands alone; its caller is not stored."""
    inner = 'from lower.sums import inner\nprint(inner(2))'
    assert answer(start(modules, cache, code=inner)) == '3'
    stored = set(entries(cache))
    both = f'{inner}\nfrom upper.doubled import outer\nprint(outer(2))'
    assert answer(start(modules, cache, code=both)).split() == ['3', '6']
    assert len(set(entries(cache)) - stored) == 1
    assert answer(start(modules, cache, code=both)).split() == ['3', '6']


def test_numbas_own_functions_are_compiled_as_ever_beside_ours(tmp_path, cache):
    """Of another's function that ours calls, and that is called from Python afterwards, and calls ours itself."""
    code = textwrap.dedent("""\
        import numba
        import numpy as np
        from msgs_py.numeric.compiled import njit
        @njit
        def lowest(a):
            return np.sort(a)[0]
        @numba.njit
        def others(a):
            return lowest(a) + np.zeros(1)[0]
        @njit
        def ours(a):
            return others(a) + lowest(a)
        @numba.njit
        def on_top(a):
            return others(a) + np.sort(a)[1]
        a = np.array([3.0, 1.0, 2.0])
        print(ours(a), others(a), lowest(a), on_top(a), ours(a[::-1].astype(np.float32)))
        """)
    assert answer(start(tmp_path, cache, code=code)) == '2.0 1.0 1.0 3.0 2.0'
    assert answer(start(tmp_path, cache, code=code)) == '2.0 1.0 1.0 3.0 2.0'


@pytest.mark.parametrize('available', [True, False])
def test_functions_that_call_themselves_and_each_other(tmp_path, cache, available):
    """Also with a numba whose methods are others than those that are replaced."""
    code = textwrap.dedent(f"""\
        import msgs_py.numeric.one_unit as one_unit
        one_unit.AVAILABLE = {available}
        from msgs_py.numeric.compiled import njit
        @njit
        def factorial(n):
            return 1 if n < 2 else n * factorial(n - 1)
        @njit
        def twice(n):
            if n < 0:
                raise ValueError('negative')
            return 2 * factorial(n)
        print(twice(5), factorial(4))
        try:
            twice(-1)
        except ValueError as error:
            print(error)
        """)
    assert answer(start(tmp_path, cache, code=code)) == '240 24\nnegative'


def test_every_library_is_linked_before_those_that_it_needs():
    """Of two users of one function the first may be left out, because its code never runs; the other comes first, too.

    Colouring a picture with terrains and shadows jumped to nowhere: linking takes only what is asked for by then.
    """
    one_unit = pytest.importorskip('msgs_py.numeric.one_unit')

    class Library:
        _finalized = False

        def __init__(self, *needs):
            self._linking_libraries = list(needs)

    shared = Library()
    first, second = Library(shared), Library(shared)
    second._linking_libraries.append(Library(first))
    whole = Library(first, second, shared)
    order = one_unit._reached(whole)
    assert len(order) == 4 == len(set(order))
    for user in order:
        assert all(order.index(user) < order.index(other) for other in user._linking_libraries)


LENT = """\
    import sys
    from typing import NamedTuple
    import numpy as np
    from numba.typed import List
    from msgs_py.numeric.compiled import njit
    class Two(NamedTuple):
        a: np.ndarray
        b: np.ndarray
    @njit
    def tail(two, k):
        return two.a[k:]
    @njit
    def product(two):
        return (two.a * two.b).sum()
    @njit
    def both(two):
        x = tail(two, 1)
        return product(Two(x, x)), x
    @njit
    def keep(x, others):
        others.append(x[1:])
    @njit
    def each(x):
        for i in range(len(x)):
            yield x[i]
    @njit
    def total(x):
        s = 0.0
        for value in each(x.copy()[1:]):
            s += value
        return s
    @njit
    def largest(two, start=None):
        best = two.a
        for i in range(4):
            other = two.b * i
            if other.sum() > best.sum():
                best = other
        return best.sum()
    def many():
        return np.arange(100000.0)  # memory of its own, that is given back when it is freed
    def other_use():
        return [many() + 7 for _ in range(10)]
    for _ in range(3):
        x = tail(Two(many(), many()), 5)
        y = both(Two(many(), many()))[1]
        others = List([many()])
        keep(many(), others)
        other_use()
        s = many().sum()
        print(x[0], x[-1] - 99999, y[0], others[1][0], total(many()) - s, largest(Two(many(), many())) / s)
    x = many()
    before = sys.getrefcount(x)
    for _ in range(100):
        product(Two(x, x)), largest(Two(x, x)), total(x), both(Two(x, x)), keep(x, List([x]))
    print(sys.getrefcount(x) - before)
    if one_unit.AVAILABLE:
        code = ''.join(largest.inspect_llvm().values())
        print('NRT_incref(ptr %arg' in code or 'NRT_incref(i8* %arg' in code)
    else:
        print(False)
"""


@pytest.mark.parametrize('available', [True, False])
def test_arrays_live_as_long_as_what_was_returned_or_kept_of_them(tmp_path, cache, available):
    """References of a function's arguments are counted where something may outlive the call."""
    code = f'import msgs_py.numeric.one_unit as one_unit\none_unit.AVAILABLE = {available}\n{textwrap.dedent(LENT)}'
    assert answer(start(tmp_path, cache, code=code)).splitlines() == ['5.0 0.0 1.0 1.0 0.0 3.0'] * 3 + ['0', 'False']
