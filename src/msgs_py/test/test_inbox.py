"""Calls that other threads have for a node: one at a time, by who brings them or by the node's executor."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from msgs_py.node_runtime.inbox import Inbox


class Stage:
    """A node without ROS, whose executor turns when it is told to."""

    def __init__(self):
        self.problems, self.woken = [], threading.Event()
        self.inbox = Inbox(self)
        self.called: list[tuple[str, int]] = []

    def create_guard_condition(self, callback):
        self.take_all = callback
        return SimpleNamespace(trigger=self.woken.set)

    def problem(self, text):
        self.problems.append(text)

    def call(self, name):
        return lambda: self.called.append((name, threading.get_ident()))

    def turn(self):
        """One turn of the executor, in this thread."""
        self.woken.clear()
        if self.inbox.turn is None:
            self.take_all()
        else:
            with self.inbox.turn:
                self.take_all()


def elsewhere(call):
    thread = threading.Thread(target=call)
    thread.start()
    thread.join()
    return thread.ident


def test_only_the_executor_calls_a_node_that_shares_no_turns():
    stage = Stage()
    elsewhere(lambda: stage.inbox.put(stage.call('a')))
    assert not stage.called and stage.woken.is_set()
    stage.turn()
    assert stage.called == [('a', threading.get_ident())]


def test_who_brings_a_call_makes_it_unless_the_node_is_at_work():
    stage = Stage()
    stage.inbox.turn = threading.Lock()
    other = elsewhere(lambda: stage.inbox.put(stage.call('a')))
    assert stage.called == [('a', other)] and not stage.woken.is_set()
    with stage.inbox.turn:
        elsewhere(lambda: stage.inbox.put(stage.call('b')))
        assert len(stage.called) == 1 and stage.woken.is_set()
    stage.turn()
    assert stage.called[1:] == [('b', threading.get_ident())]


def test_a_call_may_bring_another_and_what_one_raises_is_reported():
    stage = Stage()
    stage.inbox.turn = threading.Lock()

    def first():
        stage.inbox.put(stage.call('second'))
        raise RuntimeError('no')

    stage.inbox.put(first)
    assert [name for name, _ in stage.called] == ['second'] and stage.problems == ['RuntimeError: no']
    stage.inbox.close()
    stage.inbox.put(stage.call('late'))
    assert len(stage.called) == 1


def test_of_many_threads_one_at_a_time_calls_and_nothing_is_left_behind():
    stage = Stage()
    stage.inbox.turn = threading.Lock()
    inside, most, made = [0], [0], [0]

    def call():
        inside[0] += 1
        most[0] = max(most[0], inside[0])
        time.sleep(0)
        made[0] += 1
        inside[0] -= 1

    threads = [threading.Thread(target=lambda: [stage.inbox.put(call) for _ in range(200)]) for _ in range(4)]
    for thread in threads:
        thread.start()
    end = time.monotonic() + 20.0
    while made[0] < 800 and time.monotonic() < end:
        if stage.woken.wait(0.001):
            stage.turn()
    for thread in threads:
        thread.join()
    assert made == [800] and most == [1]
