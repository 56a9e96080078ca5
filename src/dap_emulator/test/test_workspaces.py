"""The emulator's workspaces without ROS: atomic stores, frozen requests, limits, many clients."""

import threading

import numpy as np
import pytest

from dap_emulator import DapClient, DapError
from dap_emulator.service.links import LocalLink
from dap_emulator.service.workspaces import MAX_WAITING, RESULTS_KEPT, Refused, ServiceLimits, Workspaces

DOUBLE = 'ENTRY SUBROUTINE DOUBLE(A, N)\nREAL A(,)\nINTEGER N\nA = A*2.0\nN = N + 1\nEND'


@pytest.fixture
def spaces():
    return Workspaces()


def client(spaces, name='me'):
    return DapClient(client=name, link=LocalLink(spaces))


def test_store_run_fetch(spaces):
    one = client(spaces)
    result = one.run(DOUBLE, a=np.arange(6).reshape(2, 3), n=4)
    assert result['A'].tolist() == [[0, 2, 4], [6, 8, 10]] and result['n'] == 5 and result.cycles > 0
    assert one.fetch('data.a', 'shape.a', 'data.n', 'program')[0].tolist() == list(range(6))
    assert one.fetch('result.1.printed') == [[]]
    assert 'A*2.0' in one.fetch('result.1.listing')[0] and 'multiply' in one.fetch('result.1.statistics')[0]
    assert 'line 4: multiply REAL*4 (2, 3), 1 block(s), 1280 cycles' in one.fetch('result.1.trace')[0]


def test_a_store_is_all_or_nothing(spaces):
    with pytest.raises(Refused, match='me.model'):
        spaces.store([('me.data.a', 1), ('me.model', '999')])
    assert spaces.fetch('me.data.a') is None


def test_a_request_takes_the_workspace_as_it_was(spaces):
    one = client(spaces)
    one.store(program=DOUBLE, a=np.ones((2, 2)), n=1, run_request=1)
    one.store(a=np.full((2, 2), 50.0), n=9, run_request=2)
    assert [item['id'] for item in one.execute()] == [1, 2]
    assert one.result(1)['A'].max() == 2 and one.result(2)['A'].max() == 100 and one.result(1)['N'] == 2


@pytest.mark.parametrize(
    ('items', 'reason'),
    [
        ([('me', 1)], 'expected <client>'),
        ([('me.data.a', [])], 'element'),
        ([('me.shape.a', [2, 0])], 'extents'),
        ([('me.data.a', np.arange(4)), ('me.shape.a', np.array([3, 2]))], r'\(3, 2\) does not hold 4'),
        ([('me.program', 5)], 'expected a text'),
        ([('me.run_request', 1)], 'no program'),
        ([('me.run_request', 'x')], 'whole number'),
        ([('me.library', 'none')], 'library'),
        ([('me.program', 'X = (')], 'line 1'),
        ([('me.program', DOUBLE), ('me.entry', 'NO'), ('me.run_request', 1)], 'NO'),
    ],
)
def test_bad_stores_are_refused_with_a_reason(spaces, items, reason):
    with pytest.raises(Refused, match=reason):
        spaces.store(items)
    assert spaces.clients == 0


def test_a_failing_run_says_why_and_harms_nobody(spaces):
    one = client(spaces)
    with pytest.raises(DapError, match='N: .* does not fit'):
        one.run(DOUBLE, n=2**40)
    with pytest.raises(DapError, match='division'):
        one.run('I = 1/J')
    with pytest.raises(DapError, match='out of store'):
        one.run(program='REAL A(*2000, *2000)\nA = A + A')
    with pytest.raises(DapError, match='unknown to the emulator'):
        one.result(77)
    assert one.run(DOUBLE, n=1)['N'] == 2 and spaces.failures == 3


def test_waiting_requests_can_be_cancelled_and_are_limited(spaces):
    one = client(spaces)
    one.store(program=DOUBLE, n=1, run_request=1)
    one.cancel(1)
    assert one.execute() == [] and one.fetch('result.1.state', 'result.1.message') == ['stopped', 'cancelled']
    for number in range(2, MAX_WAITING + 2):
        one.store(run_request=number)
    with pytest.raises(DapError, match='waiting already'):
        one.store(run_request=500)
    with pytest.raises(DapError, match='used before'):
        one.store(run_request=3)


def test_old_results_and_idle_clients_make_room():
    spaces = Workspaces(ServiceLimits(clients=3))
    one = client(spaces, 'one')
    for _ in range(RESULTS_KEPT + 3):
        one.run(DOUBLE, n=1)
    kept = [number for number in range(1, RESULTS_KEPT + 4) if one.fetch(f'result.{number}.state') != [None]]
    assert len(kept) <= RESULTS_KEPT + 1 and kept[-1] == RESULTS_KEPT + 3
    for name in ('two', 'three', 'four'):
        client(spaces, name).store(n=1)
    assert spaces.clients == 3 and one.fetch('data.n') == [None]


def test_forgetting_a_workspace(spaces):
    with client(spaces) as one:
        one.store(n=1)
        assert spaces.clients == 1
    assert spaces.clients == 0


def test_four_threads_of_clients_never_mix(spaces):
    wrong = []

    def work(index):
        one = client(spaces, f'c{index}')
        for turn in range(60):
            value = 1000.0 * index + turn
            result = one.run(DOUBLE if turn == 0 else None, a=np.full((index + 1, 2), value), n=turn)
            if result['A'].shape != (index + 1, 2) or (result['A'] != 2 * value).any() or result['N'] != turn + 1:
                wrong.append((index, turn))

    threads = [threading.Thread(target=work, args=(index,)) for index in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=50)
    assert not wrong and spaces.runs == 240


def test_what_a_program_prints_can_be_fetched(spaces):
    one = client(spaces)
    one.run("PRINT *, 'three:', 1 + 2")
    assert one.fetch('result.1.printed') == [['three: 3']] and 'three: 3' in one.fetch('result.1.listing')[0]
