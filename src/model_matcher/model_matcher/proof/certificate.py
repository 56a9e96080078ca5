"""Certificate that no larger interpretation exists.

What it says, exactly. An interpretation pairs each data feature with one model feature at most, and there is a rigid
motion, its pose, under which every paired data feature lies on its model feature: end points within the tolerances
across and along, direction within its cone, radii within curvedev (kernels.fit_one, width 1). ``proven``: no
interpretation of this data, whatever its pose, pairs more data features than this one. Clutter, occlusion, symmetry
and the seed play no part in that; the tolerances do. An equally large one may exist.

How it is shown. What misses its tolerances by little under the known pose is tried with a pose that gives way: K is
then hardly ever short of the largest. Pairings (nodes) that cannot be among K + 1 consistent ones go first, by the
exact pair test (supports.py, pair_test.py). A set of K + 1 out of K + 1 + s data features leaves out at most s, so of
any s + 1 disjoint groups it holds one whole: the tree branches on which, and group by group it becomes known that one
of its features is left out. Each node that is taken narrows the others by the pair tests, and where those left are of
too few data features, less one for each refuted group that is whole, the branch ends: nearly all do, before there is a
pose. A whole group fixes the pose, and what no pose near it explains is taken away (rigidity.py). Subsets of what
remains that have no common pose are conflicts: each leaves out one of its own, so more than s disjoint ones end a
branch, and otherwise the tree branches on whom one leaves out. A set larger than what is known that has a common pose
becomes the new bound, until the tree is exhausted or time is up.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from msgs_py import BIN, FeatureSet, Interpretation

from ..model.index import ModelIndex, index_model
from ..model.symmetry import symmetric_poses
from ..params import MatchParams, MatchResult
from ..verification.acceptance import Problem, Refined, _interpretation, as_pose, make_problem, pose_covariances

STEEP = 0.3  # sine of two features that may fix a first pose
WIDE = 24  # a data feature with more nodes than this is of no use but as one more
NEAR = 1.6  # tolerances: what misses its own by less may fit under another pose
GROUP = 4  # data features that fix a pose well


@dataclass(frozen=True)
class Proof:
    """What an exhaustive search says.

    proven : no interpretation matches more data than asked about, or than ``assignment`` if there is one
    assignment : (n,) int32, the largest interpretation found beyond what was asked about, or None
    motion : (12,) a pose that explains it, or None
    nodes : branches of the tree, 0 when pruning was enough; pairings : left by the pruning
    reason : None when proven, otherwise why not
    seconds : all of it
    """

    proven: bool
    assignment: np.ndarray | None = None
    motion: np.ndarray | None = None
    nodes: int = 0
    pairings: int = 0
    reason: str | None = None
    seconds: float = 0.0


@cache
def compile_kernels() -> None:
    """Compile, or load from numba's cache, what a proof needs: no time limit is to pay for that."""
    corner = np.eye(3) * [0.2, 0.3, 0.4]
    edges = FeatureSet.from_edges(
        np.concatenate([corner, corner]), np.concatenate([np.roll(corner, 1, axis=0), np.zeros((3, 3))])
    )
    problem = make_problem(index_model(edges), edges, MatchParams())
    tree = _Tree(problem, 3, np.inf)
    tree.prune()
    nodes = np.arange(6)
    motion = np.array([1.0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0.1])
    tested, weights = tree.tested, np.ones(6)
    tested.common_pose(motion.copy(), nodes, nodes, *tree.sample, weights)
    tested.conflict(motion, nodes, nodes, weights, *tree.sample)
    tested.can_join(motion, nodes[:3], nodes[:3], nodes, nodes, 0, *tree.sample)
    tested.deviations(motion, nodes, nodes, *tree.sample)
    tested.all_fit(motion, nodes, nodes, *tree.sample, tree.kind_m, tree.radius_tol)
    tested.fit(motion, nodes.astype(np.int32), np.zeros(6, np.int8), *tree.sample, np.empty((6, 6)), np.empty(5))
    tree.joined(2, nodes[:2], nodes[3:], None)


def certify(problem: Problem, result: MatchResult, params: MatchParams, started: float) -> MatchResult:
    """The result with its best interpretation marked as proven when it is; stats say why it is not.

    A larger interpretation that the proof comes across takes the place of the best one, unless it explains fewer
    distinct model features, by which interpretations are ranked: then nothing is proven.
    started : perf_counter() at the start of the match, which has params.time_limit_s altogether
    """
    best = result.best
    if best is None:
        return result
    left = params.time_limit_s - (time.perf_counter() - started)
    compile_kernels()
    if left <= 0.0:
        result.stats['unproven'] = 'time limit'
        return result
    motion = np.concatenate([best.pose.rotation.ravel(), best.pose.translation])
    proof = prove_problem(problem, best.matched, params, left, motion)
    result.stats.update(proof_branches=proof.nodes, proof_pairings=proof.pairings, proof_seconds=proof.seconds)
    reason = proof.reason
    if proof.assignment is not None and proof.motion is not None:
        larger = _as_interpretation(problem, proof.assignment, proof.motion)
        distinct, known = (len(np.unique(one.assignment[one.assignment != BIN])) for one in (larger, best))
        if distinct >= known:
            best = larger
        else:
            reason = (
                f'another interpretation matches {larger.matched} data features, but only {distinct} distinct '
                f'model features; the best matches {best.matched} and {known}'
            )
    if reason is None:
        best = replace(best, proven=True)
    else:
        result.stats['unproven'] = reason
    return replace(result, interpretations=(best, *result.interpretations[1:]))


def _as_interpretation(problem: Problem, assignment: np.ndarray, motion: np.ndarray) -> Interpretation:
    """A set of pairings as an interpretation, with its least-squares pose."""
    from . import feasibility

    fit: Any = feasibility.fit
    pose, sign = motion.copy(), np.zeros(len(assignment), np.int8)
    normal, figures = np.zeros((6, 6)), np.zeros(5)
    fit(pose, assignment, sign, *problem.sample, problem.index.rows, normal, figures)
    refined = Refined(
        pose[None],
        assignment[None],
        sign[None],
        normal[None],
        np.array([[0.0, figures[0], figures[1], *figures[2:], 0.0, 0.0]]),
    )
    covariance = pose_covariances(problem.index, refined, [0])[0]
    found = as_pose(pose)
    return _interpretation(problem, refined, 0, found, covariance, symmetric_poses(problem.index, found), None)


class _GivenUp(Exception):
    """The proof has no answer; says why."""


class _Larger(Exception):
    """A larger interpretation has been found."""


def prove(
    index: ModelIndex, data: FeatureSet, matched: int, params: MatchParams, seconds: float | None = None
) -> Proof:
    """Whether no interpretation of the data matches more than ``matched`` features (see above).

    data : camera frame; features without length take no part, but are counted in the answer's assignment
    seconds : time limit, params.time_limit_s when not given
    """
    problem = make_problem(index, data, params)
    found = prove_problem(problem, matched, params, seconds)
    if found.assignment is None:
        return found
    assignment = np.full(problem.n_data, BIN, np.int32)
    assignment[problem.keep] = found.assignment
    return replace(found, assignment=assignment)


def prove_problem(
    problem: Problem, matched: int, params: MatchParams, seconds: float | None = None, motion: np.ndarray | None = None
) -> Proof:
    """As :func:`prove`; the assignment is of the problem's usable features. motion : (12,) the pose of what matched."""
    if params.scale != 'known':
        return Proof(False, reason="only data of known scale can be proven, not scale='free'")
    compile_kernels()
    started = time.perf_counter()
    tree = _Tree(problem, matched, started + (params.time_limit_s if seconds is None else seconds))
    reason = None
    try:
        if motion is not None:
            tree.enlarge(motion, problem.index.middle, problem.index.size)
        tree.prune()
        while True:
            try:
                tree.search()
                break
            except _Larger:
                continue
    except _GivenUp as why:
        reason = str(why)
    except RecursionError:
        reason = 'the tree is too deep'
    return Proof(
        reason is None,
        tree.assignment,
        tree.motion,
        tree.branches,
        len(tree.nodes_a),
        reason,
        time.perf_counter() - started,
    )


class _Tree:
    """The nodes that pruning leaves and the tree over them; ``most`` is the largest size known."""

    def __init__(self, problem: Problem, most: int, deadline: float) -> None:
        from ..geometry import pair_bounds
        from . import feasibility, support_pruning

        self.most, self.deadline = most, deadline
        self.tested: Any = feasibility
        self.supports: Any = support_pruning
        self.pairs: Any = pair_bounds
        self.model, self.kind_m, self.radius_tol = problem.index.rows, problem.index.kind, problem.radius_tol
        self.data, self.kind_d, self.tols = problem.sample
        self.nodes_a = self.nodes_i = np.zeros(0, np.int64)
        self.disjoint: list[list[int]] = []  # groups of data features
        self.refuted: list[frozenset[int]] = []  # data features that are not all in a larger interpretation
        self.group_of, self.group_sizes = np.full(len(self.data), -1), np.zeros(0, np.int64)  # of the refuted ones
        self.assignment: np.ndarray | None = None
        self.motion: np.ndarray | None = None
        self.branches = 0
        self.ranges: dict[int, tuple[np.ndarray, np.ndarray]] = {}  # of a data feature's pairs, as far as asked for

    @property
    def sample(self) -> tuple:
        return self.data, self.kind_d, self.tols, self.model

    def check_time(self) -> None:
        if time.perf_counter() > self.deadline:
            raise _GivenUp('time limit')

    # -- pruning -----------------------------------------------------------------------------------------------

    def prune(self) -> None:
        """Find the nodes that may be in an interpretation larger than ``most``."""
        if len(self.data) <= self.most:
            return
        lists, counts = self.supports.listed(
            self.pairs.possible(self.data, self.kind_d, self.tols, self.model, self.kind_m, self.radius_tol)
        )
        relations = self.pairs.model_relations(self.model)
        margins = self.pairs.margins_of(self.data, self.tols)
        self.agreement = self.supports.agreement(self.data, self.tols, self.model, margins, relations)
        halves, _, mids = self.agreement[4:7]
        span, below = self.supports.extremes(halves, relations)
        before = -1
        while before != counts.sum():
            before = counts.sum()
            # What is refused early makes the rest cheaper: long features first, they have few model features to be on.
            for a in np.lexsort((-self.data[:, 6], counts)):
                if counts[a] == 0:
                    continue
                self.check_time()
                others = np.argsort(counts, kind='stable')
                others = others[len(others) - np.count_nonzero(counts) :]
                if len(others) <= self.most:
                    return
                self.supports.thin(
                    a,
                    others[others != a],
                    self.data,
                    margins,
                    lists,
                    counts,
                    halves,
                    relations,
                    mids,
                    span,
                    below,
                    self.most,
                    WIDE,
                )
        order = np.argsort(counts, kind='stable')  # what has few nodes is the first to show that a pose is none
        self.nodes_a = np.repeat(order, counts[order])
        self.nodes_i = np.concatenate([lists[a, : counts[a]] for a in order])

    def enlarge(self, motion: np.ndarray, middle: np.ndarray, size: float) -> None:
        """What else fits when a pose gives way: each pairing that is nearly within its tolerances is tried in turn.

        middle : (3,), size : metres, of the model
        """
        centre = motion[:9].reshape(3, 3) @ middle + motion[9:]
        near = np.flatnonzero(np.linalg.norm(self.data[:, :3] - centre, axis=1) <= size)
        if len(near) < self.most:
            return
        e = len(self.model)
        gaps = self.tested.deviations(motion, np.repeat(near, e), np.tile(np.arange(e), len(near)), *self.sample)
        gaps = np.where(
            self.pairs.possible(
                self.data[near], self.kind_d[near], self.tols[near], self.model, self.kind_m, self.radius_tol
            ),
            gaps.reshape(-1, e),
            np.inf,
        )
        nearest, least = np.zeros(len(self.data), np.int64), np.full(len(self.data), np.inf)
        nearest[near], least[near] = gaps.argmin(axis=1), gaps.min(axis=1)
        order = np.argsort(least, kind='stable')
        chosen = order[: int((least <= 1.0).sum())]
        if len(chosen) < self.most:
            return
        for a_more in order[len(chosen) : int((least <= NEAR).sum())]:
            more, pose = np.append(chosen, a_more), motion.copy()
            if (
                self.tested.common_pose(pose, more, nearest[more], *self.sample, np.empty(len(more)))
                == self.tested.FEASIBLE
            ):
                chosen, motion = more, pose
        self.keep_larger(chosen, nearest[chosen], motion)

    def keep_larger(self, a: np.ndarray, i: np.ndarray, motion: np.ndarray) -> bool:
        """Note an interpretation that is larger than what is known, if a pose does explain it all."""
        if len(a) <= self.most or not self.tested.all_fit(motion, a, i, *self.sample, self.kind_m, self.radius_tol):
            return False
        self.assignment = np.full(len(self.data), BIN, np.int32)
        self.assignment[a] = i
        self.most, self.motion = len(a), motion
        return True

    # -- the tree ----------------------------------------------------------------------------------------------

    def search(self) -> None:
        """Refute every interpretation larger than ``most``. Raises _Larger when there is one, _GivenUp at the limit."""
        free = np.arange(len(self.nodes_a))
        features, domains = np.unique(self.nodes_a, return_counts=True)
        spare = len(features) - self.most - 1
        if spare < 0:
            return
        if not self.disjoint:
            self.disjoint = self.groups(features[np.lexsort((self.tols[features, 2], domains > WIDE))], spare + 1)
        for number, group in enumerate(self.disjoint[: spare + 1]):
            if frozenset(group) not in self.refuted:
                self.assign(group, np.zeros(0, np.int64), free, None)
                self.refuted.append(frozenset(group))
                self.group_of[group] = number
                self.group_sizes = np.append(self.group_sizes, len(group))

    def groups(self, features: np.ndarray, count: int) -> list[list[int]]:
        """Disjoint groups of data features, the firm ones first in each, with two that cross where possible."""
        left = [int(a) for a in features]
        groups = [[left.pop(0)] for _ in range(count)]
        for size in range(1, GROUP):
            for group in groups:
                if not left or len(left) < count and size > 1:
                    return groups
                lead = self.data[group[0], 3:6]
                crossing = (k for k, a in enumerate(left) if np.linalg.norm(np.cross(lead, self.data[a, 3:6])) > STEEP)
                group.append(left.pop(next(crossing, 0) if size == 1 else 0))
        return groups

    def assign(self, group: list[int], forced: np.ndarray, free: np.ndarray, motion: np.ndarray | None) -> None:
        """Explore every way to have the whole group, besides the forced nodes."""
        if not group:
            self.explore(forced, free, motion, self.refuted)
            return
        here = self.nodes_a[free]
        chosen = min(group, key=np.bincount(here, minlength=len(self.data)).item)
        mine = here == chosen
        others = [a for a in group if a != chosen]
        for node in free[mine]:
            for more, rest, pose in self.joined(node, forced, free[~mine], motion):
                self.assign(others, more, rest, pose)

    def joined(
        self, node: int, forced: np.ndarray, free: np.ndarray, motion: np.ndarray | None
    ) -> list[tuple[np.ndarray, np.ndarray, np.ndarray | None]]:
        """One more node beside the forced ones: with it, what is left of the free ones, and each pose they may have."""
        self.check_time()
        least = self.most - len(forced)
        a, n = int(self.nodes_a[node]), len(self.data)
        if a not in self.ranges:
            self.ranges[a] = np.empty((n, 11)), np.zeros(n, bool)
        rest = self.supports.narrowed(
            a,
            self.nodes_i[node],
            free,
            self.nodes_a,
            self.nodes_i,
            least,
            forced,
            self.group_of,
            self.group_sizes,
            *self.agreement,
            *self.ranges[a],
        )
        if len(rest) == 0 and least > 0:
            return []
        more = np.append(forced, node)
        return [(more, rest, pose) for pose in self.poses(more, motion)]

    def poses(self, nodes: np.ndarray, motion: np.ndarray | None) -> list[np.ndarray | None]:
        """What poses some nodes may have: none, [None] while too few to tell, or starts."""
        a, i = self.nodes_a[nodes], self.nodes_i[nodes]
        starts: list[np.ndarray | None] = [motion]
        if motion is None:
            starts = [*self.first_poses(a, i)] or [None]
        allowed: list[np.ndarray | None] = []
        for start in starts:
            pose = None if start is None else start.copy()
            if (
                pose is None
                or self.tested.common_pose(pose, a, i, *self.sample, np.empty(len(a))) != self.tested.INFEASIBLE
            ):
                allowed.append(pose)
        return allowed

    def first_poses(self, a: np.ndarray, i: np.ndarray) -> list[np.ndarray]:
        """Every pose that the two features which fix it best may have; none when all are nearly parallel."""
        from ..geometry import pair_pose
        from ..geometry.kernels import pair_geometry

        frame: Any = pair_pose.pair_frame
        pose_of: Any = pair_pose.pair_pose
        geometry: Any = pair_geometry
        data, model = self.data[a], self.model[i]
        cosines = np.maximum(np.abs(data[:, 3:6] @ data[:, 3:6].T), np.abs(model[:, 3:6] @ model[:, 3:6].T))
        sines = np.sqrt(np.maximum(1.0 - cosines**2, 0.0))
        cones = np.maximum(self.tols[a, 2], 1e-6)
        worth = np.where(sines >= STEEP, sines / np.maximum(cones[:, None], cones), 0.0)
        p, q = (int(v) for v in np.unravel_index(int(np.argmax(worth)), worth.shape))
        if worth[p, q] <= 0.0:
            return []
        c, s, _, foot_a, foot_b, flip = geometry(data[p], data[q])
        model_c, model_s, _, foot_i, foot_j, model_flip = geometry(model[p], model[q])
        angle, model_angle = np.arctan2(s, c), np.arctan2(model_s, model_c)
        poses = []
        data_pair, model_pair = np.empty(12), np.empty(12)
        frame(data, p, foot_a, q, flip, foot_b, data_pair)
        for other in (1.0, -1.0):
            if abs(angle - (model_angle if other > 0.0 else np.pi - model_angle)) > cones[p] + cones[q]:
                continue
            frame(model, p, foot_i, q, other * model_flip, other * foot_j, model_pair)
            for turn in (1.0, -1.0):
                motion = np.empty(12)
                pose_of(data_pair, model_pair, turn, motion)
                poses.append(motion)
        return poses

    def explore(
        self, forced: np.ndarray, free: np.ndarray, motion: np.ndarray | None, refuted: list[frozenset[int]]
    ) -> None:
        """Refute every interpretation larger than ``most`` that has all ``forced`` nodes and otherwise ``free`` ones.

        motion : (12,) a pose of the forced nodes, None when they are too few to have one
        refuted : sets of data features of which one at least is left out
        """
        self.branches += 1
        self.check_time()
        if motion is not None:
            free = free[
                self.tested.can_join(
                    motion,
                    self.nodes_a[forced],
                    self.nodes_i[forced],
                    self.nodes_a[free],
                    self.nodes_i[free],
                    self.most + 1 - len(forced),
                    *self.sample,
                )
            ]
        features, domains = np.unique(self.nodes_a[free], return_counts=True)
        spare = len(forced) + len(features) - self.most - 1
        if spare < 0:
            return
        singles = free[np.isin(self.nodes_a[free], features[domains == 1])]
        sets: list[np.ndarray] = []
        if motion is not None:
            packed, sets = self.conflicts(forced, free, singles, motion, refuted, spare)
            if packed > spare:
                return
            refuted = refuted + [frozenset(self.nodes_a[nodes].tolist()) for nodes in sets]
            self.try_nearest(forced, free, motion)
            if not sets:
                here = (known - set(self.nodes_a[forced].tolist()) for known in refuted)
                sets = [
                    singles[np.isin(self.nodes_a[singles], list(known))]
                    for known in here
                    if known <= set(self.nodes_a[singles].tolist())
                ]
        if sets:
            self.leave_one_out(min(sets, key=len), forced, free, motion, refuted)
        elif len(features) == 0 or (motion is not None and len(singles) == len(features)):
            raise _GivenUp('some pairings are too near their tolerances to decide on')
        else:
            open_to = np.where(domains > 1, domains, domains.max() + (motion is not None))
            chosen = self.nodes_a[free] == features[np.argmin(open_to)]
            for node in free[chosen]:
                for more, rest, pose in self.joined(node, forced, free[~chosen], motion):
                    self.explore(more, rest, pose, refuted)
            self.explore(forced, free[~chosen], motion, refuted)

    def conflicts(
        self,
        forced: np.ndarray,
        free: np.ndarray,
        singles: np.ndarray,
        motion: np.ndarray,
        refuted: list[frozenset[int]],
        spare: int,
    ) -> tuple[int, list[np.ndarray]]:
        """How many disjoint sets of data features each leave one out, up to spare + 1, and new such sets of nodes.

        The new ones have no common pose with the forced nodes. spare + 1 when the forced nodes have none themselves.
        """
        have = set(self.nodes_a[forced].tolist())
        can = set(self.nodes_a[free].tolist())
        used: set[int] = set()
        packed = 0
        for known in refuted:
            open_ones = known - have
            if not open_ones:
                return spare + 1, []
            if open_ones <= can and not open_ones & used:
                used |= open_ones
                packed += 1
        found: list[np.ndarray] = []
        while packed <= spare:
            left = singles[~np.isin(self.nodes_a[singles], list(used))]
            nodes = np.concatenate([forced, left])
            a, i = self.nodes_a[nodes], self.nodes_i[nodes]
            weights = np.empty(len(nodes))
            if self.tested.common_pose(motion.copy(), a, i, *self.sample, weights) != self.tested.INFEASIBLE:
                break
            members = nodes[self.tested.conflict(motion, a, i, weights, *self.sample)]
            members = members[~np.isin(members, forced)]
            if len(members) == 0:
                return spare + 1, []
            found.append(members)
            used |= set(self.nodes_a[members].tolist())
            packed += 1
        return packed, found

    def leave_one_out(
        self,
        members: np.ndarray,
        forced: np.ndarray,
        free: np.ndarray,
        motion: np.ndarray | None,
        refuted: list[frozenset[int]],
    ) -> None:
        """Explore what leaves out each member of a conflict in turn, and has those before it."""
        for k, node in enumerate(members):
            rest = free[~np.isin(self.nodes_a[free], self.nodes_a[members[: k + 1]])]
            self.explore(forced, rest, motion, refuted)
            others = free[self.nodes_a[free] != self.nodes_a[node]]
            with_it = self.joined(node, forced, others, motion) if node in free else []
            if not with_it:
                return
            forced, free, motion = with_it[0]

    def try_nearest(self, forced: np.ndarray, free: np.ndarray, motion: np.ndarray) -> None:
        """The forced nodes with the nearest node of every free feature: raises _Larger when they have a common pose."""
        gaps = self.tested.deviations(motion, self.nodes_a[free], self.nodes_i[free], *self.sample)
        order = np.lexsort((gaps, self.nodes_a[free]))
        _, first = np.unique(self.nodes_a[free][order], return_index=True)
        nodes = np.concatenate([forced, free[order[first]]])
        a, i = self.nodes_a[nodes], self.nodes_i[nodes]
        pose = motion.copy()
        if self.tested.common_pose(
            pose, a, i, *self.sample, np.empty(len(nodes))
        ) == self.tested.FEASIBLE and self.keep_larger(a, i, pose):
            raise _Larger
