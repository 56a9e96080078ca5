"""What a node says of itself, to the second and to the message."""

import numpy as np
import pytest

from msgs_py.node_runtime.health import REMEMBERED_PROBLEMS, Health
from msgs_py.node_runtime.settings import RATE_WINDOW_S, REPEAT_LOG_S


def test_an_output_is_counted_and_its_time_and_latency_kept():
    health = Health(100.0)
    assert health.last_output_time is None and np.isnan(health.last_latency_s)
    health.done(103.0, 0.25)
    health.done(104.0, 0.5)
    assert health.processed == 2 and health.last_output_time == 104.0 and health.last_latency_s == 0.5
    values = health.values(104.0)
    assert values['processed'] == 2 and values['latency_p50_ms'] == '375.0' and values['latency_p99_ms'] == '497.5'
    assert (health.dropped, health.lost, health.passed_over, health.problems) == (0, 0, 0, 0)


def test_a_rate_is_that_of_the_last_seconds_and_of_a_second_at_least():
    health = Health(0.0)
    health.done(0.0, 0.1)
    assert health.rate_hz(0.5) == 1.0, 'not two a second from half a second'
    for now in np.arange(1.0, 10.0 * RATE_WINDOW_S):
        health.done(now, 0.1)
    last = 10.0 * RATE_WINDOW_S - 1.0
    assert health.rate_hz(last) == pytest.approx(1.0, abs=1.0 / RATE_WINDOW_S)
    assert health.rate_hz(last + RATE_WINDOW_S + 0.1) == 0.0


def test_a_problem_is_logged_again_after_a_while_with_how_often_it_was():
    health = Health(0.0)
    assert health.problem(0.0, 'no') == 'no'
    assert health.problem(REPEAT_LOG_S - 0.1, 'no') is None and health.problem(REPEAT_LOG_S - 0.05, 'no') is None
    assert health.problem(REPEAT_LOG_S, 'no') == 'no (and 2 times more)'
    assert health.problem(2.0 * REPEAT_LOG_S, 'no') == 'no', 'nothing was kept back meanwhile'
    assert health.problems == 5 and health.last_error == 'no' and health.last_error_time == 2.0 * REPEAT_LOG_S
    values = health.values(2.0 * REPEAT_LOG_S + 1.26)
    assert values['last_error_age_s'] == '1.3' and Health(0.0).values(9.0)['last_error_age_s'] == ''


def test_of_very_many_problems_the_longest_unseen_is_forgotten():
    health = Health(0.0)
    for k in range(REMEMBERED_PROBLEMS):
        assert health.problem(0.0, f'problem {k}') is not None
    assert health.problem(0.1, 'problem 0') is None, 'all are remembered, and this one now seen last'
    assert health.problem(0.2, 'one more') is not None
    assert health.problem(0.3, 'problem 0') is None and health.problem(0.3, 'problem 1') == 'problem 1'
