"""Work beside an executor: one input at a time, the newest kept, begun anew when what it goes by has changed."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from msgs_py.node_runtime.beside import Beside
from msgs_py.node_runtime.health import Health


class Stage:
    """A node without ROS, and work that goes on until it is let go or its deadline passes."""

    def __init__(self):
        self.health = Health(0.0)
        self.setting, self.begun, self.finished, self.problems = 'a', [], [], []
        self.let_go: set[int] = set()
        self.inbox = SimpleNamespace(put=lambda call: None)  # always overheard: look() has to do
        self.beside = Beside(self, 'source', self.begin, lambda given, made: self.finished.append((given, made)))

    def attempt(self, source, work, *arguments, begun=None):
        try:
            work(*arguments)
        except ValueError as error:
            self.problems.append(f'{source}: {error}')

    def begin(self, given, deadline):
        if given < 0:
            raise ValueError('negative')
        self.begun.append(given)
        setting = self.setting

        def work():
            while given not in self.let_go and not deadline.passed:
                time.sleep(0.001)
            if given == 13:
                raise ValueError('thirteen')
            return setting

        return work

    def until(self, holds):
        end = time.monotonic() + 5.0
        while not holds():
            assert time.monotonic() < end
            self.beside.look()
            time.sleep(0.001)


def test_one_at_a_time_and_then_the_newest():
    stage = Stage()
    for given in (1, 2, 3, 4):
        stage.beside.take(given)
    assert stage.begun == [1] and stage.health.passed_over == 2 and stage.beside.seconds > 0.0
    stage.let_go |= {1, 4}
    stage.until(lambda: len(stage.finished) == 2)
    assert stage.finished == [(1, 'a'), (4, 'a')] and stage.beside.seconds == 0.0


def test_what_cannot_begin_or_fails_is_reported_and_the_next_begins():
    stage = Stage()
    stage.let_go |= {1, 2, 13}
    stage.beside.take(13)
    stage.beside.take(2)
    stage.until(lambda: stage.finished)
    stage.beside.take(1)
    stage.beside.take(-1)
    stage.until(lambda: len(stage.problems) == 2)
    assert stage.finished == [(2, 'a'), (1, 'a')]
    assert stage.problems == ['source: thirteen', 'source: negative']


def test_what_goes_by_old_settings_is_finished_when_it_takes_no_time_and_else_begun_anew():
    stage = Stage()
    stage.beside.take(1)
    stage.setting = 'b'
    stage.beside.begin_anew(60.0)
    stage.let_go.add(1)
    stage.until(lambda: stage.finished)
    stage.beside.take(2)
    stage.setting = 'c'
    stage.beside.begin_anew(0.02)
    stage.until(lambda: stage.begun == [1, 2, 2])
    stage.let_go.add(2)
    stage.until(lambda: len(stage.finished) == 2)
    assert stage.finished == [(1, 'a'), (2, 'c')]


def test_what_is_done_is_begun_anew_when_it_is_outdated_and_a_newer_input_goes_before():
    stage = Stage()
    stage.beside.take(1)
    stage.let_go.add(1)
    while not stage.beside._job.background.done:
        time.sleep(0.001)
    stage.setting = 'b'
    stage.beside.begin_anew(0.0)
    stage.until(lambda: stage.finished)
    assert stage.finished == [(1, 'b')]
    stage.beside.take(2)
    stage.beside.take(3)
    stage.let_go.add(3)
    stage.beside.begin_anew(0.0)
    stage.until(lambda: len(stage.finished) == 2)
    assert stage.begun == [1, 1, 2, 3] and stage.finished[-1] == (3, 'b')


def test_nothing_comes_of_what_is_dropped():
    stage = Stage()
    stage.beside.take(1)
    stage.beside.take(2)
    stage.beside.close(5.0)
    stage.let_go.add(3)
    stage.until(lambda: stage.beside.seconds == 0.0)
    stage.beside.take(3)
    stage.until(lambda: stage.finished)
    assert stage.finished == [(3, 'a')] and stage.begun == [1, 3]
