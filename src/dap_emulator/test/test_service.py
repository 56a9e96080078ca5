"""emulator_node over real services: store, run, fetch, list; several clients; refusals; limits; images."""

import threading
import time

import numpy as np
import pytest

from dap_emulator import DapError
from dap_emulator.service.settings import MAX_CALLS

ADD = """
ENTRY SUBROUTINE ADD(A, B, C)
  REAL A(,), B(,), C(,)
  C = A + B
END
"""
ENDLESS = """
ENTRY SUBROUTINE ENDLESS(N)
  INTEGER N
10 N = N + 1
  GOTO 10
END
"""


def test_a_client_stores_arrays_and_a_program_and_fetches_the_result_and_the_cycles(start_emulator):
    client = start_emulator().client()
    rng = np.random.default_rng(1)
    a, b = rng.random((2, 32, 32))
    result = client.run(ADD, a=a, b=b)
    assert np.array_equal(result['C'], (a.astype('f4') + b.astype('f4')).astype(float))
    assert result.cycles == 731 and result.seconds == pytest.approx(73.1e-6)


def test_four_clients_at_once_do_not_meet(start_emulator):
    emulator = start_emulator()
    clients = [emulator.client(f'client{index}') for index in range(4)]
    wrong = []

    def work(index):
        rng = np.random.default_rng(index)
        for turn in range(6):
            size = 3 + index
            a = rng.random((size, size)).astype('f4')
            b = np.full((size, size), 10.0 * index + turn, dtype='f4')
            result = clients[index].run(ADD, a=a, b=b)
            if not np.array_equal(result['C'], (a + b).astype(float)):
                wrong.append((index, turn))

    threads = [threading.Thread(target=work, args=(index,)) for index in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=30)
    assert not wrong and not any(thread.is_alive() for thread in threads)
    assert emulator.node.spaces.runs == 24


def test_malformed_requests_are_refused_with_a_reason_and_the_node_lives(start_emulator):
    client = start_emulator(max_store_bytes=10_000, max_program_bytes=1000).client()
    for values, reason in (
        ({'program': 'C = A +'}, 'line 1, column 8'),
        ({'library': 'nothing'}, 'library'),
        ({'model': '710'}, '510'),
        ({'run_request': 5}, 'no program'),
        ({'run_request': -1}, 'at least 1'),
        ({'a': np.zeros(2000)}, '10000'),
        ({'program': 'X = 1\n' * 500}, '1000'),
        ({'a': []}, 'an element'),
    ):
        with pytest.raises(DapError, match=reason):
            client.store(**values)
    with pytest.raises(DapError, match='A: expected shape|A: expected 2'):
        client.run(ADD, a=np.zeros(7), b=np.zeros((3, 3)))
    client.store(b=np.zeros((3, 3)))
    assert client.run(ADD, a=np.ones((3, 3)))['C'].sum() == 9


def test_a_runaway_program_is_stopped_with_a_reason(start_emulator):
    client = start_emulator(max_run_seconds=0.1).client()
    with pytest.raises(DapError, match='run time limit of 0.1 s'):
        client.run(ENDLESS)


def test_a_running_request_can_be_cancelled_and_watched(start_emulator):
    emulator = start_emulator(max_run_seconds=30.0)
    client, other = emulator.client('one'), emulator.client('one')
    client.store(program=ENDLESS, run_request=7)
    waiting = threading.Thread(target=client.execute)
    waiting.start()
    while other.fetch('result.7.state') != ['running']:
        pass
    other.cancel(7)
    waiting.join(timeout=10)
    assert not waiting.is_alive()
    assert client.fetch('result.7.state', 'result.7.message') == ['stopped', 'cancelled']


def test_any_number_of_calls_beside_an_endless_program_are_answered_or_refused(start_emulator):
    """Those that wait are bounded, and others are answered beside them."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from std_srvs.srv import Trigger

    emulator = start_emulator(max_run_seconds=30.0)
    client = emulator.client('one')
    asker = rclpy.create_node('asker', context=emulator.context)
    executor = SingleThreadedExecutor(context=emulator.context)
    executor.add_node(asker)
    run = asker.create_client(Trigger, 'emulator_node/run')
    assert run.wait_for_service(10.0)
    answers, refused = [], []

    def accounted():
        return emulator.node._calls + sum(one.done() for one in answers) == len(answers)

    def spin_until(holds):
        end = time.monotonic() + 20.0
        while not holds():
            assert time.monotonic() < end
            executor.spin_once(timeout_sec=0.01)

    first = run.call_async(Trigger.Request())  # nothing waits, so it is answered at once, and both ends are known
    spin_until(first.done)
    client.store(program=ENDLESS, run_request=1)
    while not refused:
        answers += [run.call_async(Trigger.Request()) for _ in range(4)]  # a service's queue takes ten
        spin_until(accounted)
        refused = [one for one in answers if one.done()]
    assert len(answers) > MAX_CALLS and all('are waiting already' in one.result().message for one in refused)
    started = time.monotonic()
    assert client.fetch('result.1.state') == ['running']
    assert time.monotonic() - started < 1.0
    client.cancel(1)
    spin_until(lambda: emulator.node._calls == 0)
    last = run.call_async(Trigger.Request())
    spin_until(last.done)
    assert last.result().success
    executor.shutdown()
    asker.destroy_node()


def test_the_library_is_listed_and_runs(start_emulator):
    client = start_emulator().client()
    assert 'life' in client.programs()
    cells = np.zeros((5, 5), dtype=bool)
    cells[2, 1:4] = True
    result = client.run(library='life', cells=cells, generations=1)
    assert np.array_equal(result['CELLS'], cells.T)


def test_images_go_through_a_program_with_stamp_and_frame_kept(start_emulator):
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node
    from sensor_msgs.msg import Image

    from msgs_py.codecs import array_to_image, image_to_array

    emulator = start_emulator(image_program='sobel')
    node = Node('camera', context=emulator.context)
    executor = SingleThreadedExecutor(context=emulator.context)
    executor.add_node(node)
    received = []
    node.create_subscription(Image, 'image_out', received.append, 5)
    out = node.create_publisher(Image, 'image_in', 5)
    picture = np.zeros((40, 48), np.uint8)
    picture[:, 20:] = 30
    header = Image().header
    header.stamp.sec, header.frame_id = 12, 'eye'
    for _ in range(200):
        out.publish(array_to_image(picture, 'mono8', header))
        executor.spin_once(timeout_sec=0.05)
        if received:
            break
    edges, encoding = image_to_array(received[0])
    assert (received[0].header.stamp.sec, received[0].header.frame_id, encoding) == (12, 'eye', 'mono8')
    assert edges[10, 20] == 120 and edges[10, 30] == 0
    values = emulator.node.report_values()
    assert values['image_cycles'] > 0 and values['image_program'] == 'sobel'
    refused = emulator.node.set_parameters([rclpy.Parameter('image_program', value='life')])
    assert not refused[0].successful and 'IMAGE' in refused[0].reason
    executor.shutdown()
    node.destroy_node()


def test_a_client_may_share_the_executor_of_the_emulator():
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

    from dap_emulator import DapClient
    from dap_emulator.node import EmulatorNode

    context = Context()
    rclpy.init(context=context, domain_id=99)
    executor = SingleThreadedExecutor(context=context)
    nodes = [EmulatorNode(context=context), Node('user', context=context)]
    for node in nodes:
        executor.add_node(node)
    with DapClient(node=nodes[1], executor=executor) as client:
        for turn in range(5):
            assert client.run(ADD, a=np.full((4, 4), turn), b=np.ones((4, 4)))['C'].max() == turn + 1
    executor.shutdown()
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown(context=context)


def test_reset_forgets_every_workspace(start_emulator):
    emulator = start_emulator()
    client = emulator.client()
    client.store(a=3)
    assert emulator.node.spaces.clients == 1 and client.fetch('data.a') == [3]
    assert emulator.node.reset() == '1 workspace(s)' and client.fetch('data.a') == [None]
