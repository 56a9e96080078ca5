"""The base of every node and its main loop, under the name that users know."""

from .node_runtime.runtime import GraphNode, StereoMessages, run_node, spin_once

__all__ = ['GraphNode', 'StereoMessages', 'run_node', 'spin_once']
