"""Programs from anybody on the network cannot take the emulator's machine down: time, memory and depth are bounded."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import threading
import time
from multiprocessing import Pipe
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import Image

from dap_emulator import Dap, DapClient
from dap_emulator.fortran_plus import Limits, Stopped, compile
from dap_emulator.node import EmulatorNode
from dap_emulator.service import program_worker
from dap_emulator.service.processes import PROCESSES, ProgramFailed
from dap_emulator.service.program_worker import CompileJob, Failure, Interface, RunAnswer, RunJob, answer
from dap_emulator.service.workspaces import Refused, ServiceLimits, Workspaces
from msgs_py.codecs import array_to_image

SECONDS = 1.0


def entry(*lines: str) -> str:
    return '\n'.join(['ENTRY SUBROUTINE MAIN(N)', '  INTEGER N', *lines, 'END', ''])


HOSTILE = {
    'a statement of many operations': (
        entry(
            '  REAL A(*256,*256)', '10 A = ' + '+'.join(['(' + '+'.join(['ATAN2(A, A)'] * 50) + ')'] * 60), '  GOTO 10'
        ),
        'time limit',
    ),
    'a larger matrix than this computer has': (entry('  N = SUM(MAT(1, 300000, 300000))'), 'out of store'),
    'a larger pattern than this computer has': (entry('  N = SUM(ROW(1, 300000, 300000))'), 'out of store'),
    'a larger spread than this computer has': (entry('  N = SUM(MATR(INDEX(30000), 300000))'), 'out of store'),
    'pictures without end': (entry('  INTEGER*1 A(*2000, *2000)', '10 CALL DISPLAY(A)', '  GOTO 10'), 'time limit'),
    'a loop without end': (entry('10 CONTINUE', '  N = N + 1', '  GOTO 10'), 'time limit'),
    'more store than there is': (entry('  REAL X(,,100000)', '  X = 1.0'), 'out of store'),
    'many large arrays': (entry(*[f'  REAL A{i}(*1024,*1024)' for i in range(300)]), 'out of store'),
    'recursion without end': (entry('  CALL MAIN(N)'), None),
    'a tower of powers': (entry('  N = 9**9**9**9**9'), None),
    'a huge negative power': (entry('  N = 7**(-999999999)'), None),
    'a constant without end': (entry('  INTEGER K', '  PARAMETER (K = 9**999999999)', '  N = K'), None),
    'ten thousand operations': (entry('  N = ' + '+'.join(['1'] * 10000)), None),
    'ten thousand brackets': (entry('  N = ' + '(' * 10000 + '1' + ')' * 10000), None),
}


@pytest.mark.parametrize('name', HOSTILE)
def test_a_hostile_program_is_refused_or_stopped_in_time(name):
    source, expected = HOSTILE[name]
    spaces = Workspaces()
    spaces.limits = ServiceLimits(program_bytes=200_000, run_seconds=SECONDS)
    start = time.process_time()
    try:
        spaces.store([('a.program', source), ('a.data.N', 1), ('a.run_request', 1)])
    except Refused as error:
        outcome = str(error)
    else:
        for item in spaces.take_waiting():
            spaces.execute(item)
        outcome = str(spaces.fetch('a.result.1.message') or '')
        assert spaces.fetch('a.result.1.state') in ('done', 'failed', 'stopped')
    assert expected is None or expected in outcome
    assert time.process_time() - start < SECONDS + 3.0


def test_a_program_that_is_too_long_or_data_that_is_too_much_is_refused():
    spaces = Workspaces()
    spaces.limits = ServiceLimits(program_bytes=1000, store_bytes=1000)
    with pytest.raises(Refused, match='program'):
        spaces.store([('a.program', 'X' * 2000)])
    with pytest.raises(Refused, match='data'):
        spaces.store([('a.data.X', [1.0] * 2000)])


# What one operation on arrays takes longest for: an elementary function of as many numbers as the largest store holds.
LONG_OPERATION = """
ENTRY SUBROUTINE MAIN(N)
  INTEGER N
  REAL*3 X(*2600, *2600)
  X = 0.5
10 X = ATAN2(X, X)
  GOTO 10
END
"""


def job(source, seconds, **arguments):
    return RunJob(source, None, '610', arguments, seconds, 10**8)


def shortest_excess(seconds, run, turns=4):
    """How much longer than it may something takes, at best of some turns: this computer does other things, too."""
    found = []
    for _ in range(turns):
        PROCESSES.interface('X = 1.0', 10.0)  # a process is there, also after one was ended
        start = time.monotonic()
        run()
        found.append(time.monotonic() - start - seconds)
        if found[-1] < 0.05:
            break
    return min(found)


@pytest.mark.parametrize('seconds', [0.1, 0.6])
def test_a_limit_holds_inside_one_operation(seconds):
    PROCESSES.interface(LONG_OPERATION, 10.0)

    def run():
        with pytest.raises(Stopped, match=f'run time limit of {seconds:g} s'):
            PROCESSES.run(job(LONG_OPERATION, seconds))

    assert shortest_excess(seconds, run) < max(0.05, 0.1 * seconds)


def test_a_limit_holds_inside_one_statement_without_a_process_of_its_own():
    """A statement of 3000 operations, of which none is long."""
    program = compile(HOSTILE['a statement of many operations'][0])

    def run():
        with pytest.raises(Stopped):
            program.run(Dap.model('510'), limits=Limits(seconds=0.2))

    assert shortest_excess(0.2, run) < 0.05
    dap = Dap.model('510')
    with pytest.raises(Stopped, match='cycle limit'):
        program.run(dap, limits=Limits(cycles=10**6))
    assert 10**6 < dap.cycles < 2 * 10**6
    assert dap.watch is None


def test_a_cancellation_holds_inside_one_operation():
    def run():
        cancelled = threading.Event()
        timer = threading.Timer(0.5, cancelled.set)
        timer.start()
        with pytest.raises(Stopped, match='cancelled'):
            PROCESSES.run(job(LONG_OPERATION, 60.0), cancelled)
        timer.join()

    assert shortest_excess(0.5, run) < 0.05


def test_a_text_that_takes_long_to_compile_is_refused_in_time():
    text = entry(*['  N = N + 1 - 2*N'] * 40_000)
    spaces = Workspaces(ServiceLimits(program_bytes=10**6, run_seconds=0.3))

    def run():
        with pytest.raises(Refused, match=r'a.program: compiling \d+ characters: run time limit of 0.3 s'):
            spaces.store([('a.program', text)])

    assert shortest_excess(0.3, run) < 0.05


def test_memory_is_bounded_and_a_process_that_ends_harms_only_its_own_run():
    spaces = Workspaces()
    spaces.store([('a.program', entry('10 N = N + 1', '  GOTO 10')), ('a.run_request', 1)])
    runner = threading.Thread(target=spaces.execute_waiting)
    runner.start()
    deadline = time.monotonic() + 20.0
    while spaces.fetch('a.result.1.state') != 'running' and time.monotonic() < deadline:
        time.sleep(0.01)
    busy = PROCESSES.busy
    assert len(busy) == 1
    os.kill(busy[0], signal.SIGKILL)
    runner.join(timeout=20.0)
    assert spaces.fetch('a.result.1.state') == 'failed'
    assert 'has ended (exit code -9)' in spaces.fetch('a.result.1.message')
    spaces.store([('a.program', entry('  N = 7')), ('a.run_request', 2)])
    spaces.execute_waiting()
    assert spaces.fetch('a.result.2.data.N') == 7
    # 1.3e8 truths are a byte each in numpy: the machine has room for them, the result has not.
    large = 'ENTRY SUBROUTINE MAIN(A)\nLOGICAL A(*11000, *11000)\nEND'
    spaces.store([('a.program', large), ('a.run_request', 3)])
    spaces.execute_waiting()
    assert 'the result has 121000000 bytes, at most 64000000 are kept' in spaces.fetch('a.result.3.message')


def test_a_service_that_is_killed_leaves_nothing_running():
    script = (
        'from dap_emulator.service.processes import PROCESSES; '
        'from dap_emulator.service.program_worker import RunJob; PROCESSES.interface("X = 1.0", 9.0); '
        'print(PROCESSES._idle[0].number, flush=True); '
        'PROCESSES.run(RunJob("10 N = N + 1\\nGOTO 10", None, "510", {}, 60.0, 1000))'
    )
    environment = os.environ | {'PYTHONPATH': os.pathsep.join(filter(None, sys.path))}
    service = subprocess.Popen([sys.executable, '-c', script], stdout=subprocess.PIPE, text=True, env=environment)
    number = int(service.stdout.readline())
    service.kill()
    service.communicate()
    deadline = time.monotonic() + 10.0
    while _runs(number):
        assert time.monotonic() < deadline, 'the program runs on, with nobody to answer'
        time.sleep(0.01)


def _runs(number):
    """Whether a process is there and not just waiting to be counted as ended."""
    try:
        with open(f'/proc/{number}/stat') as file:
            return file.read().rsplit(')', 1)[1].split()[0] != 'Z'
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_names_count_against_the_limits():
    limits = ServiceLimits(store_bytes=100_000)
    for kind, value in (('data', 1), ('shape', [2])):
        spaces = Workspaces(limits)
        with pytest.raises(Refused, match='bytes of data with their names, at most 100000'):
            spaces.store([(f'a.{kind}.{"N" * 50}{k}', value) for k in range(500)])
    spaces = Workspaces()
    with pytest.raises(Refused, match='1200 names, at most 1000'):
        spaces.store([(f'a.shape.N{k}', [2]) for k in range(1200)])
    with pytest.raises(Refused, match='a.entry: 5000 characters, at most 64'):
        spaces.store([('a.entry', 'E' * 5000)])
    assert spaces.clients == 0


def test_all_clients_together_have_a_bound():
    limits = ServiceLimits(store_bytes=50_000, total_bytes=120_000)
    spaces = Workspaces(limits)
    data = np.zeros(5000)  # 40,000 bytes
    for name in ('one', 'two'):
        spaces.store([(f'{name}.data.A', data), (f'{name}.library', 'life'), (f'{name}.run_request', 1)])
    with pytest.raises(Refused, match='all clients together would hold 1[2-3].... bytes, at most 120000'):
        spaces.store([('three.data.A', data)])
    assert spaces.clients == 2
    spaces.store([('two.cancel', 1)])
    spaces.store([('three.data.A', data)])
    assert spaces.clients == 2 and spaces.fetch('two.data.A') is None, 'who is idle makes room'


def test_waiting_requests_of_all_clients_have_a_bound(monkeypatch):
    monkeypatch.setattr('dap_emulator.service.workspaces.MAX_WAITING_IN_ALL', 3)
    spaces = Workspaces()
    for name in ('one', 'two'):
        spaces.store([(f'{name}.library', 'life'), (f'{name}.run_request', 1)])
    spaces.store([('one.run_request', 2)])
    with pytest.raises(Refused, match='3 requests of all clients are waiting'):
        spaces.store([('two.run_request', 2)])


def test_results_push_out_older_ones_and_one_for_which_there_is_no_room_is_not_kept():
    source = 'ENTRY SUBROUTINE MAIN(A)\nREAL A(*100, *100)\nEND'
    for total, states in ((60_000, [None, 'done']), (30_000, ['failed', 'failed'])):
        spaces = Workspaces(ServiceLimits(store_bytes=50_000, total_bytes=total))
        spaces.store([('a.program', source), ('a.run_request', 1), ('a.run_request', 2)])
        spaces.execute_waiting()
        assert [spaces.fetch(f'a.result.{k}.state') for k in (1, 2)] == states
    assert 'no room for the result: all clients together would hold' in spaces.fetch('a.result.2.message')


def test_clients_take_turns():
    spaces = Workspaces()
    for k in range(1, 4):
        spaces.store([('greedy.library', 'life'), ('greedy.run_request', k)])
    spaces.store([('modest.library', 'life'), ('modest.run_request', 1)])
    order = [(request.client, request.number) for request in spaces.take_waiting()]
    assert order == [('greedy', 1), ('modest', 1), ('greedy', 2), ('greedy', 3)]


def test_what_a_process_answers():
    """The process's own side, in this process."""
    never = threading.Event()
    source = entry('  N = N/2')
    assert answer(CompileJob(source), never) == Interface(source, {'MAIN': {'N': 'INTEGER'}})
    done = answer(RunJob(source, None, '510', {'N': 8}, 5.0, 1000), never)
    assert isinstance(done, RunAnswer) and done.result(source)['N'] == 4 and done.stats.cycles > 0
    assert answer(CompileJob('X = ('), never).message.startswith('line 1, column 6')
    assert 'expected INTEGER' in answer(RunJob(source, None, '510', {'N': 'x'}, 5.0, 1000), never).message
    never.set()
    assert answer(RunJob(HOSTILE['a loop without end'][0], None, '510', {}, 5.0, 1000), never) == Failure(
        'cancelled', stopped=True
    )
    with pytest.raises(ProgramFailed, match='UNKNOWN is neither an array'):
        PROCESSES.run(RunJob('X = UNKNOWN(3)', None, '510', {}, 5.0, 1000))


def test_a_process_serves_until_the_service_hangs_up(monkeypatch):
    ended = threading.Event()

    def end(code):
        ended.set()
        raise SystemExit(code)

    monkeypatch.setattr(program_worker.os, '_exit', end)
    ours, theirs = Pipe()
    threading.Thread(target=program_worker.serve, args=(theirs,), daemon=True).start()
    assert ours.recv() == program_worker.READY
    ours.send(CompileJob('X = 1.0'))
    assert list(ours.recv().entries) == ['MAIN']
    ours.send(RunJob(HOSTILE['a loop without end'][0], None, '510', {}, 60.0, 1000))
    ours.send(program_worker.CANCEL)
    assert ours.recv().stopped
    ours.close()
    assert ended.wait(10.0)


def test_a_process_bounds_its_memory(monkeypatch):
    asked = []
    monkeypatch.setattr(program_worker.resource, 'setrlimit', lambda what, limits: asked.append(limits[0]))
    program_worker.bound_memory(1 << 20)
    has = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()
    assert abs(asked[0] - has) < 64 << 20


def test_an_endless_image_program_does_not_hold_the_services(graph, tmp_path):
    """The executor goes on; the image that came last is filtered when its turn comes, the ones between are counted."""
    slow = tmp_path / 'slow.fpp'
    slow.write_text(
        'ENTRY SUBROUTINE SLOW(IMAGE, RESULT)\nINTEGER*2 IMAGE(,), RESULT(,)\nRESULT = IMAGE\n'
        '10 IF (MAXV(IMAGE) .GT. 100) GOTO 10\nEND\n'
    )
    node = graph.add(EmulatorNode, parameters={'image_program': str(slow), 'max_run_seconds': 4.0})
    received = graph.collect(Image, 'image_out')
    out = graph.publisher(Image, 'image_in')
    graph.wait_matched(node.image_out, out)
    header = Image().header
    out.publish(array_to_image(np.full((8, 8), 200, np.uint8), 'mono8', header))
    graph.spin_until(lambda: node.filtering)
    started = time.monotonic()
    with DapClient('emulator_node', node=graph.tester, executor=graph.executor) as client:
        assert client.run(library='life', generations=1)['GENERATIONS'] == 1
    assert node.filtering and time.monotonic() - started < 3.9, 'the services answer while the image is filtered'
    for level in (10, 20, 30):
        header.stamp.sec = level
        out.publish(array_to_image(np.full((8, 8), level, np.uint8), 'mono8', header))
    graph.spin_until(lambda: received)
    assert 'run time limit of 4 s' in node.health.last_error
    assert received[0].header.stamp.sec == 30 and received[0].data[0] == 30
    assert node.health.passed_over + node.health.lost == 2, 'in the node, or on the way to it'
