"""recovery_node, matcher_node and tracker_node in one process: images in, poses at the rate of the images out.

Each node has a thread of its own, so that the tracker does not wait for a search. Parameters are given by node:
``recognise --ros-args -p matcher_node:models:="['part.csg']" -p tracker_node:models:="['part.csg']"``.
With ``--record out.mcap`` before these, images and results are recorded; ``replay`` reads such files.
"""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from msgs_py.node_runtime.runtime import GraphNode, spin_once
from msgs_py.node_runtime.transport import make_room_for_images
from stereo_recovery.node import RecoveryNode

from ..node import MatcherNode
from ..tracker_node import TrackerNode
from .recordings.mcap_file import McapFile
from .recordings.recorder import Recorder

NODES: tuple[Callable[..., GraphNode[Any]], ...] = (RecoveryNode, MatcherNode, TrackerNode)


class Recognition:
    """The three nodes, each spun by a thread.

    Parameters
    ----------
    context : rclpy.context.Context, optional
        That they belong to; the default one without it.
    record : McapFile, optional
        Where what they take in and give out is recorded; it is closed with them.
    **kwargs
        For each node.
    """

    def __init__(self, context: Context | None = None, record: McapFile | None = None, **kwargs: Any) -> None:
        self.nodes = [make(context=context, **kwargs) for make in NODES]
        self._all: list[Node] = list(self.nodes)
        self._recorder = None if record is None else Recorder(record, self.nodes, context=context)
        if self._recorder is not None:
            self._all.append(self._recorder)
        self._stop = threading.Event()
        self._executors = [SingleThreadedExecutor(context=context) for _ in self._all]
        self._threads = [
            threading.Thread(target=self._spin, args=(node, executor), daemon=True)
            for node, executor in zip(self._all, self._executors)
        ]
        for thread in self._threads:
            thread.start()

    def _spin(self, node: Node, executor: SingleThreadedExecutor) -> None:
        executor.add_node(node)
        try:
            while not self._stop.is_set() and node.context.ok():
                spin_once(node, executor, 0.1)
        except (KeyboardInterrupt, ExternalShutdownException):
            self._stop.set()

    def wait(self) -> None:
        """Until the context is shut down."""
        while not self._stop.wait(0.2) and self.nodes[0].context.ok():
            pass

    def close(self) -> None:
        """Stop the threads, and take the nodes down."""
        self._stop.set()
        for thread in self._threads:
            thread.join(5.0)
        if self._recorder is not None:
            self._recorder.finish(self._executors[-1])
        for node, executor in zip(self._all, self._executors):
            executor.shutdown()
            node.destroy_node()


def recognise_parser() -> argparse.ArgumentParser:
    """The options of the command, before --ros-args."""
    parser = argparse.ArgumentParser(
        prog='recognise',
        description='Find known objects in the images of a stereo camera, and follow them: recovery_node, matcher_node '
        'and tracker_node in one process, until it is told to stop. Exit status 0, or 2 for bad input.',
        epilog='Parameters by node: --ros-args -p matcher_node:models:="[\'part.csg\']" ...',
    )
    parser.add_argument(
        '--record', type=Path, metavar='FILE', help='write images and results into a new file, .mcap, for replay'
    )
    return parser


def main(args: Sequence[str] | None = None) -> int:
    """Run the nodes until they are told to stop; the exit status."""
    given = list(sys.argv[1:] if args is None else args)
    ours = given.index('--ros-args') if '--ros-args' in given else len(given)
    options = recognise_parser().parse_args(given[:ours])
    make_room_for_images()
    try:
        record = None if options.record is None else McapFile(options.record)
        # Signals are ours: what was sent before the end is still to be recorded.
        rclpy.init(args=given[ours:], signal_handler_options=SignalHandlerOptions.NO)
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    except Exception as error:  # a file that cannot be, or malformed --ros-args; rclpy has a type for each
        print(f'recognise: cannot start: {error}', file=sys.stderr)
        return 2
    together = None
    try:
        together = Recognition(record=record)
        together.wait()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        if together is not None:
            together.close()
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
