"""What a proof needs, compiled before its time counts."""

from __future__ import annotations

from functools import cache

import numpy as np

from msgs_py import FeatureSet
from msgs_py.numeric.deadline import Deadline

from ..model.index import index_model
from ..model.problem import make_problem
from ..params import MatchParams
from .branch_and_bound import BranchAndBound
from .feasibility import (
    all_fit,
    can_join,
    common_pose,
    deviations,
    infeasible_subset,
    least_squares_pose,
    narrow_in_parts,
    refute,
    search_rotations,
)


@cache
def compile_kernels() -> None:
    """Compile, or load from the cache, what a proof needs, so that it does not count towards a time limit."""
    corner = np.eye(3) * [0.2, 0.3, 0.4]
    edges = FeatureSet.from_edges(
        np.concatenate([corner, corner]), np.concatenate([np.roll(corner, 1, axis=0), np.zeros((3, 3))])
    )
    problem = make_problem(index_model(edges), edges, MatchParams())
    tree = BranchAndBound(problem, 3, Deadline())
    tree.prune()
    nodes = np.arange(6)
    motion = np.array([1.0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0.1])
    sample, weights = tree.sample, np.ones(6)
    common_pose(motion.copy(), nodes, nodes, sample)
    narrow_in_parts(motion.copy(), 0.1, nodes, nodes, sample)
    refute(motion.copy(), 0.1, nodes, nodes, sample, weights)
    search_rotations(motion.copy(), 0.1, nodes, nodes, sample)
    infeasible_subset(motion, 0.1, nodes, nodes, weights, sample)
    can_join(motion, 0.1, nodes[:3], nodes[:3], nodes, nodes, 0, tree.groups_refuted, sample)
    tree.groups(nodes, nodes, 2)
    deviations(motion, nodes, nodes, sample)
    all_fit(motion, nodes, nodes, sample, problem.index.kind, problem.radius_tol)
    least_squares_pose(motion, nodes.astype(np.int32), np.zeros(6, np.int8), sample)
    tree.joined(2, nodes[:2], nodes[3:], None)
