"""Programs from anybody on the network cannot take the emulator's machine down: time, memory and depth are bounded."""

from __future__ import annotations

import time

import pytest

from dap_emulator.service.workspaces import Refused, ServiceLimits, Workspaces

SECONDS = 1.0


def entry(*lines: str) -> str:
    return '\n'.join(['ENTRY SUBROUTINE MAIN(N)', '  INTEGER N', *lines, 'END', ''])


HOSTILE = {
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
