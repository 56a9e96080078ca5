"""Deadlines, and steps that are told how far they are."""

import threading
import time

from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.steps import CompileStep, Preparation


def test_what_is_over_has_nothing_left_and_what_is_not_has_all():
    over, open_ended = Deadline(-5.0), Deadline()
    assert over.left == 0.0 and over.passed
    assert open_ended.left == float('inf') and not open_ended.passed
    assert 59.0 < Deadline(60.0).left <= 60.0


def test_a_part_ends_with_the_whole_or_before():
    whole = Deadline(100.0)
    assert 9.0 < Deadline(10.0, within=whole).left <= 10.0 and 99.0 < Deadline(500.0, within=whole).left <= 100.0
    assert 24.0 < whole.share(0.25).left <= 25.0
    whole.bring_forward(50.0)
    assert 49.0 < whole.left <= 50.0 and Deadline(500.0, within=whole).left <= 50.0
    whole.bring_forward(80.0)
    assert whole.left <= 50.0, 'it is not put off'


def test_each_step_is_named_while_it_runs_and_none_at_the_end():
    gates, seen = [threading.Event() for _ in range(3)], []
    steps = [CompileStep(name, gate.wait) for name, gate in zip(('edges', 'curves', 'poses'), gates)]
    preparation = Preparation(steps)
    preparation.start()
    for gate in gates:
        until = time.monotonic() + 10.0
        while (progress := preparation.progress) in seen and time.monotonic() < until:
            time.sleep(0.001)
        seen.append(progress)
        gate.set()
    assert seen == ['1 of 3: edges', '2 of 3: curves', '3 of 3: poses']
    preparation._thread.join(10.0)
    assert preparation.done and preparation.progress == ''


def test_without_steps_there_is_no_progress():
    preparation = Preparation(())
    assert preparation.progress == ''
    preparation.start()
    preparation._thread.join(10.0)
    assert preparation.done
