"""recovery_node, matcher_node and tracker_node in one process: images in, poses at the rate of the images out.

Each node has a thread of its own, so that the tracker does not wait for a search. Parameters are given by node:
``recognise --ros-args -p matcher_node:models:="['part.csg']" -p tracker_node:models:="['part.csg']"``.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from msgs_py.node_runtime.runtime import GraphNode, spin_once
from msgs_py.node_runtime.transport import make_room_for_images
from stereo_recovery.node import RecoveryNode

from ..node import MatcherNode
from ..tracker_node import TrackerNode

NODES: tuple[Callable[..., GraphNode[Any]], ...] = (RecoveryNode, MatcherNode, TrackerNode)


class Recognition:
    """The three nodes, each spun by a thread.

    Parameters
    ----------
    context : rclpy.context.Context, optional
        That they belong to; the default one without it.
    **kwargs
        For each node.
    """

    def __init__(self, context: Context | None = None, **kwargs: Any) -> None:
        self.nodes = [make(context=context, **kwargs) for make in NODES]
        self._stop = threading.Event()
        self._executors = [SingleThreadedExecutor(context=context) for _ in self.nodes]
        self._threads = [
            threading.Thread(target=self._spin, args=(node, executor), daemon=True)
            for node, executor in zip(self.nodes, self._executors)
        ]
        for thread in self._threads:
            thread.start()

    def _spin(self, node: GraphNode[Any], executor: SingleThreadedExecutor) -> None:
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
        for node, executor in zip(self.nodes, self._executors):
            executor.shutdown()
            node.destroy_node()


def main(args: list[str] | None = None) -> int:
    """Run the nodes until they are told to stop; the exit status."""
    make_room_for_images()
    try:
        rclpy.init(args=args)
    except Exception as error:  # malformed --ros-args; rclpy has a type for each
        print(f'cannot start: {error}', file=sys.stderr)
        return 2
    together = None
    try:
        together = Recognition()
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
