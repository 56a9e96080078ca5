"""The array machine as a service: store two arrays and a program, run, fetch the result and the cycles."""

from __future__ import annotations

import numpy as np
import pytest

from dap_emulator import DapClient, DapError
from dap_emulator.node import EmulatorNode

ADD = """
      ENTRY SUBROUTINE ADD(A, B, C)
      INTEGER*4 A(,), B(,), C(,)
      C = A + 2*B
      RETURN
      END
"""


@pytest.fixture
def client(graph):
    graph.add(EmulatorNode)
    with DapClient('emulator_node', node=graph.tester, executor=graph.executor) as client:
        yield client


def test_store_run_fetch(client):
    a = np.arange(1024).reshape(32, 32)
    b = a[::-1]
    result = client.run(ADD, entry='ADD', a=a, b=b, c=np.zeros((32, 32), int))
    assert np.array_equal(result['c'], a + 2 * b)
    assert result.cycles > 0 and result.seconds == pytest.approx(result.cycles * 100e-9)


def test_a_syntax_error_is_named_with_its_line_and_the_service_lives(client):
    with pytest.raises(DapError, match='2'):
        client.run('      ENTRY SUBROUTINE ADD(A)\n      A = = 3\n      END\n', entry='ADD', a=1)
    a = np.ones((32, 32), int)
    assert (client.run(ADD, entry='ADD', a=a, b=a, c=a)['c'] == 3).all()
