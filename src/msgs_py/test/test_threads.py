"""Work on several things at once, in threads that are kept."""

from __future__ import annotations

import os
import threading
import time

import pytest

from msgs_py.numeric import threads
from msgs_py.numeric.threads import begin, parts_of, spread, together


@pytest.fixture(autouse=True)
def _two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, 'cores', lambda: 2)


@pytest.mark.parametrize('count', [0, 1, 2, 3, 7])
def test_results_come_in_the_order_of_the_items(count: int) -> None:
    assert spread(lambda number: number * number, range(count)) == [number * number for number in range(count)]


def test_both_are_done_at_once() -> None:
    meeting = threading.Barrier(2, timeout=10.0)  # broken unless both wait at it
    assert together(lambda: (meeting.wait(), 'a')[1], lambda: (meeting.wait(), 'b')[1]) == ('a', 'b')


def test_threads_are_kept() -> None:
    """A thousand calls use the threads of the first ones."""
    used: set[int] = set()
    for _ in range(1000):
        spread(lambda number: used.add(threading.get_native_id()), range(2))
    assert len(used) <= 1 + threads.cores()


def test_what_is_begun_one_after_another_has_one_thread():
    """As a node's work on one message after the other; what is begun meanwhile has a thread of its own."""
    threads._idle.clear()
    used: list[int] = []
    for _ in range(100):
        done = threading.Event()
        begin(lambda done=done: (used.append(threading.get_native_id()), done.set()))
        assert done.wait(10.0)
        while not threads._idle:  # it says so a moment before it waits again
            time.sleep(0.0)
    assert len(set(used)) == 1
    meeting, both = threading.Barrier(2, timeout=10.0), threading.Barrier(3, timeout=10.0)
    for _ in range(2):
        begin(lambda: (meeting.wait(), both.wait()))
    both.wait()


@pytest.mark.parametrize('item', [0, 1])
def test_an_error_is_raised_when_all_are_done(item: int) -> None:
    """Nothing goes on in what the caller may take back."""
    done: list[int] = []
    begun = threading.Event()

    def work(number: int) -> None:
        if number == item:
            begun.wait(10.0)
            raise ValueError(f'item {number}')
        begun.set()
        done.append(number)

    with pytest.raises(ValueError, match=f'item {item}'):
        spread(work, (0, 1))
    assert done == [1 - item]


def test_after_an_error_nobody_begins_another() -> None:
    items = range(1_000_000)
    done: list[int] = []
    meeting = threading.Barrier(2, timeout=10.0)

    def work(number: int) -> None:
        if number < 2:
            meeting.wait()  # each thread has one
        if number == 0:
            raise ValueError('item 0')
        done.append(number)

    with pytest.raises(ValueError, match='item 0'):
        spread(work, items)
    assert done[0] == 1 and len(done) < len(items) - 1


def test_work_may_spread_further() -> None:
    assert spread(lambda k: sum(spread(lambda j: sum(spread(lambda i: i, range(3))), range(k))), range(5)) == [
        3 * k for k in range(5)
    ]


@pytest.mark.skipif(not hasattr(os, 'fork'), reason='no fork here')
@pytest.mark.filterwarnings('ignore::DeprecationWarning')
def test_a_forked_child_begins_its_own() -> None:
    spread(lambda number: number, range(2))
    child = os.fork()
    if child == 0:
        os._exit(0 if spread(lambda number: number, range(2)) == [0, 1] else 1)
    assert os.waitpid(child, 0)[1] == 0


@pytest.mark.parametrize('count', [0, 1, 7, 100])
def test_parts_have_each_item_once_and_are_not_too_small(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, 'cores', lambda: 3)
    parts = parts_of(count, 30)
    assert [item for first, end in parts for item in range(first, end)] == list(range(count))
    assert len(parts) == (3 if count == 100 else 1)
