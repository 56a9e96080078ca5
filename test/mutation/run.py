"""Whether the tests notice when the code is wrong: ``make mutants`` or ``python test/mutation/run.py [AREA ...]``.

Of the small changes that can be made in the modules of an area (mutants.py) a sample is made, one at a time, and the
tests that execute the changed line are run until one fails. What survives is listed in SURVIVORS.md beside this file:
a test that is missing, or a change that changes nothing. The sample is drawn with a seed; ``--seed`` draws another.

Every mutant is a forked process in which the module is compiled from the changed tree; files are never touched, and
one process runs at a time. Compiled functions are interpreted, so that a mutant of theirs takes a second and not a
minute of compiling. Tests that need more than a few seconds interpreted are left to `make test`.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import json
import os
import random
import signal
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.machinery import SourceFileLoader
from pathlib import Path
from typing import Any

os.environ['NUMBA_DISABLE_JIT'] = '1'

import coverage
import hypothesis.strategies  # noqa: F401  with what follows: read once, and there in every fork
import numba  # noqa: F401
import numpy as np  # noqa: F401
import pytest
import scipy.optimize
import scipy.spatial.transform  # noqa: F401
from mutants import Mutant, mutants_of
from tqdm import tqdm

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
PAGE = HERE / 'SURVIVORS.md'
RESULTS = HERE / 'results.json'
# Of changes that no test can tell from the original: why, by file, line and change. They count as survivors as well.
EQUIVALENT = HERE / 'equivalent.json'
# Seconds of CPU time that a test may take interpreted; more, and it is left out of the run.
TEST_LIMIT_S = 3.0
# Seconds of tests for one mutant: the quickest of those that execute the changed line.
TESTS_S = 20.0
# Seconds for a mutant's tests: so many times what they take unchanged, and so many beside.
TIMES, BESIDE_S = 4.0, 20.0
# Share of an area's mutants that its tests have to notice.
LEAST_SHARE = 0.85


@dataclass(frozen=True)
class Area:
    """Modules whose tests are tested.

    Attributes
    ----------
    modules, tests : tuple of str
        Patterns of files below the project's root.
    without : tuple of str
        Names of files that are left out.
    """

    modules: tuple[str, ...]
    tests: tuple[str, ...]
    without: tuple[str, ...] = ()

    def files(self) -> list[Path]:
        """The modules; the numbers of ``settings.py`` are measured, not tested."""
        found = {path for pattern in self.modules for path in ROOT.glob(pattern)}
        return sorted(path for path in found if path.name not in ('settings.py', *self.without))

    def test_files(self) -> list[str]:
        """The files of tests, from the project's root; what compiles has no place in an interpreted run."""
        found = {path for pattern in self.tests for path in ROOT.glob(pattern)}
        return sorted(str(path.relative_to(ROOT)) for path in found if path.name != 'test_compiled.py')


EXAMPLES = 'test/test_examples.py'
# Of node_runtime: what the tests across packages show over real topics.
OVER_A_GRAPH = ('runtime.py', 'background.py', 'beside.py', 'hand_over.py', 'managed.py')
VOCABULARY, MATCHER = 'src/msgs_py', 'src/model_matcher'
AREAS = {
    # What needs a graph, or compiles, is tested there.
    'msgs_py': Area(
        (f'{VOCABULARY}/msgs_py/*.py', f'{VOCABULARY}/msgs_py/numeric/*.py', f'{VOCABULARY}/msgs_py/node_runtime/*.py'),
        (f'{VOCABULARY}/test/test_*.py', 'test/test_renaming.py', EXAMPLES),
        (*OVER_A_GRAPH, 'transport.py', 'compiled.py', 'one_unit.py'),
    ),
    'codecs': Area(
        (f'{VOCABULARY}/msgs_py/codecs/*.py',),
        (f'{VOCABULARY}/test/test_c*.py', f'{VOCABULARY}/test/test_wire.py', EXAMPLES),
    ),
    'constraints': Area(
        (
            f'{MATCHER}/model_matcher/geometry/constraints.py',
            f'{MATCHER}/model_matcher/geometry/pair_bounds.py',
            f'{MATCHER}/model_matcher/interpretation_tree/tables.py',
            f'{MATCHER}/model_matcher/interpretation_tree/signs.py',
            f'{MATCHER}/model_matcher/interpretation_tree/cores.py',
            f'{MATCHER}/model_matcher/interpretation_tree/ordering.py',
        ),
        (f'{MATCHER}/test/test_constraints.py', f'{MATCHER}/test/test_tree.py', f'{MATCHER}/test/test_pair_*.py'),
    ),
    'proof': Area(
        (f'{MATCHER}/model_matcher/proof/*.py',),
        (f'{MATCHER}/test/test_proof*.py', f'{MATCHER}/test/test_pair_test.py'),
        ('warm_up.py',),
    ),
}


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('areas', nargs='*', metavar='AREA', help=f'of {", ".join(AREAS)}; default: all')
    parser.add_argument('--mutants', type=int, default=100, metavar='N', help='so many of each area (100)')
    parser.add_argument('--seed', type=int, default=0, help='of the sample (0)')
    parser.add_argument('--module', help='only mutants of files whose name contains this')
    options = parser.parse_args(arguments)
    unknown = [name for name in options.areas if name not in AREAS]
    if unknown:
        parser.error(f'no area {unknown[0]!r}; there are {", ".join(AREAS)}')
    os.chdir(ROOT)
    low = []
    for name in options.areas or AREAS:
        outcome = run_area(name, options.mutants, options.seed, options.module)
        print(f'{name}: {outcome["killed"]} of {outcome["mutants"]} mutants noticed')
        for one in outcome['survivors']:
            print(f'  {one["file"]}:{one["line"]}: {one["before"]}  ->  {one["after"]}')
        if outcome['killed'] < LEAST_SHARE * outcome['mutants']:
            low.append(name)
        if not options.module:
            keep(name, outcome)
    return 1 if low else 0


def keep(name: str, outcome: dict[str, Any]) -> None:
    """Write an area's outcome beside those of the others, and the page."""
    results = json.loads(RESULTS.read_text(encoding='utf-8')) if RESULTS.exists() else {}
    results[name] = outcome
    results = {name: results[name] for name in AREAS if name in results}
    RESULTS.write_text(json.dumps(results, indent=1, ensure_ascii=False) + '\n', encoding='utf-8')
    PAGE.write_text(page(results), encoding='utf-8')


def run_area(name: str, count: int, seed: int, only: str | None) -> dict[str, Any]:
    """Make a sample of an area's mutants, and say which were noticed."""
    area = AREAS[name]
    covering, seconds = baseline(area)
    trees = {
        path: ast.parse(path.read_text(encoding='utf-8')) for path in area.files() if only is None or only in path.name
    }
    every = [(path, mutant) for path, tree in trees.items() for mutant in mutants_of(tree)]
    unchanged = Mutant(0, '', '', lambda: None)
    if not survives(
        area.files()[0], trees.get(area.files()[0], ast.Module([], [])), unchanged, list(seconds), sum(seconds.values())
    ):
        raise RuntimeError(f'{name}: the tests fail without any mutant')
    # One that no test reaches is as good as survived; it is in the sample like all others.
    chosen = random.Random(seed).sample(every, min(count, len(every)))
    survivors = []
    for path, mutant in tqdm(chosen, desc=name, unit='mutant', file=sys.stdout, disable=not sys.stdout.isatty()):
        tests = quickest(covering[str(path)].get(mutant.line, ()), seconds)
        if not tests or survives(path, trees[path], mutant, tests, sum(seconds[test] for test in tests)):
            survivors.append(
                {
                    'file': str(path.relative_to(ROOT)),
                    'line': mutant.line,
                    'before': _short(mutant.before),
                    'after': _short(mutant.after),
                    'tests': len(tests),
                }
            )
    return {
        'mutants': len(chosen),
        'of': len(every),
        'seed': seed,
        'date': time.strftime('%Y-%m-%d', time.gmtime()),
        'killed': len(chosen) - len(survivors),
        'survivors': sorted(survivors, key=lambda one: (one['file'], one['line'])),
    }


def quickest(tests: Iterable[str], seconds: dict[str, float]) -> list[str]:
    """Tests in the order of their time, as many as there is time for."""
    found, spent = [], 0.0
    for test in sorted(tests, key=lambda test: seconds[test]):
        spent += seconds[test]
        if found and spent > TESTS_S:
            break
        found.append(test)
    return found


def baseline(area: Area) -> tuple[dict[str, dict[int, set[str]]], dict[str, float]]:
    """Which tests execute each line of each file, and how long each takes; tests that are slow or fail are left out."""
    seconds: dict[str, float] = {}

    def measure() -> dict[str, Any]:
        watch = Watch([str(path) for path in area.files()])
        run_tests(area.test_files(), watch)
        return {'seconds': watch.seconds, 'lines': watch.lines()}

    found = json.loads(in_a_fork(measure, 3600.0) or '{}')
    seconds = found['seconds']
    covering: dict[str, dict[int, set[str]]] = defaultdict(lambda: defaultdict(set))
    for path, lines in found['lines'].items():
        whole = {test for tests in lines.values() for test in tests if test in seconds}
        for line, tests in lines.items():
            # A line that runs when the module is imported, '', is every test's of that module.
            covering[path][int(line)] = whole if '' in tests else {test for test in tests if test in seconds}
    return covering, seconds


class Watch:
    """A plugin of pytest: times every test and has coverage note who executes what."""

    def __init__(self, files: list[str]) -> None:
        self.seconds: dict[str, float] = {}
        self._coverage = coverage.Coverage(data_file=None, include=files, config_file=False)
        self._coverage.start()

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterable[None]:
        """Everything of a test counts, its fixtures too."""
        self._coverage.switch_context(item.nodeid)
        yield
        self._coverage.switch_context('')

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep what has passed."""
        if report.when == 'call' and report.passed:
            self.seconds[report.nodeid] = report.duration

    def lines(self) -> dict[str, dict[int, list[str]]]:
        """File to line to the tests that execute it."""
        self._coverage.stop()
        data = self._coverage.get_data()
        return {path: data.contexts_by_lineno(path) for path in data.measured_files()}


def survives(path: Path, tree: ast.Module, mutant: Mutant, tests: list[str], seconds: float) -> bool:
    """Whether all tests pass with the mutant. What takes far longer than before does not."""

    def changed() -> int:
        mutant.apply()
        code = compile(ast.fix_missing_locations(tree), str(path), 'exec', dont_inherit=True)
        original = SourceFileLoader.get_code

        def get_code(self: SourceFileLoader, name: str) -> Any:
            return code if self.path == str(path) else original(self, name)

        SourceFileLoader.get_code = get_code  # type: ignore[method-assign]
        return run_tests(tests, None)

    return in_a_fork(changed, TIMES * seconds + BESIDE_S) == '0'


def run_tests(tests: list[str], plugin: Any) -> int:
    """Run pytest in this process; its exit status."""
    # Nobody reads what an assertion compares: they are not rewritten.
    options = ['-x', '--assert=plain'] if plugin is None else [f'--interpreted={TEST_LIMIT_S}']
    options += ['-p', 'no:cacheprovider', '--hypothesis-profile=mutants', '--tb=no', '--timeout=0']
    return int(pytest.main([*options, *tests], plugins=[plugin] if plugin is not None else []))


def in_a_fork(work: Callable[[], Any], limit_s: float) -> str | None:
    """The answer of a function as JSON, from a process of its own; None when it dies or takes too long."""
    sys.stdout.flush()
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        status = 1
        with contextlib.suppress(BaseException):
            os.setsid()
            for stream in (1, 2):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
            answer = json.dumps(work())
            with os.fdopen(writer, 'w') as file:
                file.write(answer)
            status = 0
        os._exit(status)
    os.close(writer)
    signal.signal(signal.SIGALRM, lambda *_: os.killpg(child, signal.SIGKILL))
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    with os.fdopen(reader) as file:
        answer = file.read()
    os.waitpid(child, 0)
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    return answer or None


def page(results: dict[str, Any]) -> str:
    """The survivors as Markdown."""
    lines = [
        '# Mutants that no test noticed',
        '',
        'Written by `make mutants` (`test/mutation/run.py`, which says what a mutant is and how it is tried). Each is',
        'a test that is missing, or a change that changes nothing that could be told; of those it is said why, but',
        'they count as not noticed all the same.',
        '',
        '| area | mutants tried | of | seed | noticed | date |',
        '| --- | --- | --- | --- | --- | --- |',
    ]
    lines += [
        f'| {name} | {one["mutants"]} | {one["of"]} | {one["seed"]} | {100 * one["killed"] / one["mutants"]:.0f} % '
        f'| {one["date"]} |'
        for name, one in results.items()
    ]
    known = json.loads(EQUIVALENT.read_text(encoding='utf-8'))
    for name, one in results.items():
        lines += ['', f'## {name}', '', '| where | was | became | why nothing tells |', '| --- | --- | --- | --- |']
        for survivor in one['survivors']:
            file = Path(survivor['file']).name
            why = known.get(f'{file}:{survivor["line"]}: {survivor["before"]} -> {survivor["after"]}', '')
            if not survivor['tests']:
                why = 'no test runs it'
            before, after = (_cell(survivor[key]) for key in ('before', 'after'))
            lines.append(f'| `{file}:{survivor["line"]}` | `{before}` | `{after}` | {why} |')
    return '\n'.join(lines) + '\n'


def _short(text: str) -> str:
    line = ' '.join(text.split())
    return line if len(line) <= 90 else line[:87] + '...'


def _cell(text: str) -> str:
    return text.replace('|', '\\|')


if __name__ == '__main__':
    sys.exit(main())
