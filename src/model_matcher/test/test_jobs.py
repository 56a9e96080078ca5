"""Jobs: done once, kept as they come, taken up again; in this process and in others."""

from __future__ import annotations

import os

import pytest

from model_matcher.batches.jobs import Store, Workers, run_jobs

QUIET = Workers(quiet=True)


def square(number):
    return {'squared': number * number, 'process': os.getpid()}


def fail(number):
    raise AssertionError(f'{number} is done already')


def test_what_is_done_is_not_done_again_and_what_was_half_written_is(tmp_path):
    path, arguments = tmp_path / 'out' / 'results.jsonl', {'part': 'a', 'size': (1, 2)}
    first = run_jobs(square, {'a': 2, 'b': 3}, QUIET, Store(path, arguments))
    assert [one['squared'] for one in first.values()] == [4, 9]
    assert run_jobs(fail, {'b': 3, 'a': 2}, QUIET, Store(path, arguments)) == first
    with open(path, 'a') as file:
        file.write('{"job": "c", "res')
    again = run_jobs(square, {'a': 2, 'c': 4}, QUIET, Store(path, arguments))
    assert again['a'] == first['a'] and again['c']['squared'] == 16
    assert set(Store(path, arguments).results) == {'a', 'b', 'c'}
    assert not Store(path, arguments, fresh=True).results


def test_results_of_other_arguments_are_not_mixed_in(tmp_path):
    path = tmp_path / 'results.jsonl'
    Store(path, {'part': 'a', 'noise': 2.0})
    with pytest.raises(ValueError, match=r'results.jsonl: holds results of other arguments \(noise\)'):
        Store(path, {'part': 'a', 'noise': 3.0})
    path.write_text('something else\n')
    with pytest.raises(ValueError, match='not a file of results'):
        Store(path, {})


def test_other_processes_do_them_and_errors_come_back(tmp_path):
    workers = Workers(2, quiet=True)
    found = run_jobs(square, {str(k): k for k in range(4)}, workers)
    assert [one['squared'] for one in found.values()] == [0, 1, 4, 9]
    assert os.getpid() not in {one['process'] for one in found.values()}
    with pytest.raises(AssertionError, match='7 is done'):
        run_jobs(fail, {'x': 7}, QUIET)
