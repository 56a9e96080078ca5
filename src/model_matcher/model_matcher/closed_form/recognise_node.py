"""recovery_node, matcher_node and tracker_node in one process: images in, poses at the rate of the images out.

Each node has a thread of its own, so that the tracker does not wait for a search. Images are taken from the network
once and handed over, as features and reports are (msgs_py.node_runtime.hand_over); from images to poses no executor is
waited for. Parameters are given by node:
``recognise --ros-args -p matcher_node:models:="['part.csg']" -p tracker_node:models:="['part.csg']"``, or in one file.
With ``--record out.mcap`` before these, images and results are recorded; ``replay`` reads such files.
"""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from msgs_py.commands import CommandParser
from msgs_py.node_runtime.hand_over import HandOver
from msgs_py.node_runtime.runtime import GraphNode, run_until_stopped, spin_once
from stereo_recovery.node import RecoveryNode

from ..node import MatcherNode
from ..tracker_node import TrackerNode
from .recordings.mcap_file import McapFile
from .recordings.recorder import Recorder

NODES: dict[str, Callable[..., GraphNode[Any]]] = {
    'recovery_node': RecoveryNode,
    'matcher_node': MatcherNode,
    'tracker_node': TrackerNode,
}


class Recognition:
    """Nodes, each spun by a thread.

    Parameters
    ----------
    context : rclpy.context.Context, optional
        That they belong to; the default one without it.
    names : sequence of str
        Of the nodes.
    record : McapFile, optional
        Where what they take in and give out is recorded; it is closed with them.
    **kwargs
        For each node.
    """

    def __init__(
        self,
        context: Context | None = None,
        names: Sequence[str] = tuple(NODES),
        record: McapFile | None = None,
        **kwargs: Any,
    ) -> None:
        self.hand_over = HandOver(context)
        self.nodes = [NODES[name](context=context, hand_over=self.hand_over, **kwargs) for name in names]
        for node in self.nodes:
            node.inbox.turn = threading.Lock() if node.brief else None
        self._all: list[Node] = list(self.nodes)
        self._recorder = (
            None if record is None else Recorder(record, [*self.nodes, *self.hand_over.receivers], context=context)
        )
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

    @property
    def is_busy_compiling(self) -> bool:
        """Whether a thread of a node compiles, also when it was closed."""
        return any(node.is_busy_compiling for node in self.nodes)

    def run(self) -> None:
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
        self.hand_over.close()
        for one in self.nodes:
            one.inbox.close()
        for node, executor in zip(self._all, self._executors):
            executor.shutdown()
            node.destroy_node()


def recognise_parser() -> argparse.ArgumentParser:
    """The options of the command, before --ros-args."""
    parser = CommandParser(
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
    try:
        record = None if options.record is None else McapFile(options.record)
    except Exception as error:  # a file that cannot be, or what writes it is not installed
        print(f'recognise: cannot start: {error}', file=sys.stderr)
        return 2
    # What was sent before the end is still to be recorded.
    return run_until_stopped(lambda: Recognition(record=record), given[ours:], outlived=True)


if __name__ == '__main__':
    raise SystemExit(main())
