"""Branch and bound over pairings, for an interpretation larger than the largest that is known.

What misses its tolerances by little under the known pose is tried with a pose that gives way: the known size K is then
hardly ever short of the largest. Pairings (nodes) that cannot be among K + 1 consistent ones are removed first, by arc
consistency with the exact pair test (arc_consistency.py, geometry.pair_bounds). A set of K + 1 out of K + 1 + s data
features leaves out at most s, so of any s + 1 disjoint groups it holds one whole: the tree branches on which, and group
by group it is refuted that all of its features are in. A group is led by a feature of a narrow cone, and has besides it
those that leave the pose least room and the tree fewest nodes. Each node that is taken removes others by the pair tests
(forward checking), and where those left are of too few data features, less one for each refuted group that is whole,
the branch ends: nearly all do, before there is a pose. A whole group fixes the pose, and what no pose near it explains
is removed (feasibility.py). Subsets of what remains that have no common pose leave out one of their own each, so more
than s disjoint ones end a branch, and otherwise the tree branches on which one is left out. A set larger than what is
known that has a common pose becomes the new bound, until the tree is exhausted or time is up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py import BIN
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array, IntArray

from ..geometry.line_pairs import pair_geometry
from ..geometry.pair_bounds import possible
from ..geometry.pair_pose import pair_frame, pair_pose
from ..geometry.settings import ROUNDING
from ..model.problem import Problem
from ..model.settings import SEARCH_WIDTH
from .arc_consistency import DataRanges, Nodes, forward_check, no_ranges, pair_test, revise_each
from .feasibility import (
    FEASIBLE,
    INFEASIBLE,
    OPEN,
    Sample,
    add_steadiest,
    all_fit,
    can_join,
    common_pose,
    deviations,
    first_variances,
    infeasible_subset,
    narrow_in_parts,
    refute,
    search_rotations,
)
from .settings import AT_ONCE, GROUP, STEEP, WIDE, WIDEST_TURN
from .spares import Groups


def _no_nodes() -> IntArray:
    """No data or model features."""
    return np.zeros(0, np.int64)


class Region(NamedTuple):
    """Poses whose rotation is not farther than a turn (radians) from that of a motion (12,), shifted anyhow."""

    motion: FloatArray
    turn: float


class GivenUp(Exception):
    """The search has no answer; the message is the reason."""


class Larger(Exception):
    """A larger interpretation has been found; the search has to begin again with its size."""


def sample_of(problem: Problem) -> Sample:
    """Data and model of a problem as the kernels of the proof take them."""
    features = problem.features
    return Sample(features.rows, features.kind, features.tolerances, problem.index.rows)


class BranchAndBound:
    """The nodes that arc consistency leaves, and the tree over them.

    Parameters
    ----------
    problem : Problem
        Model, usable data and tolerances.
    most : int
        Size of the largest interpretation known; it is asked whether there is a larger one.
    deadline : Deadline
        When to give up.

    Attributes
    ----------
    most : int
        The largest size known so far.
    assignment, motion : ndarray or None
        The interpretation (n,) int32 that is larger than the first ``most``, if one was found, and a pose (12,) of it.
    nodes : Nodes
        The pairings left.
    branches : int
        How many branches were explored.
    """

    def __init__(self, problem: Problem, most: int, deadline: Deadline) -> None:
        self.most, self.deadline = most, deadline
        self.index, self.radius_tol = problem.index, problem.radius_tol
        self.sample = sample_of(problem)
        self.nodes = Nodes(_no_nodes(), _no_nodes())
        self.disjoint: list[list[int]] = []  # groups of data features
        self.refuted: list[frozenset[int]] = []  # data features that are not all in a larger interpretation
        self.groups_refuted = Groups(np.full(len(self.sample.data), -1), _no_nodes())  # of the disjoint ones
        self.assignment: Int32Array | None = None
        self.motion: FloatArray | None = None
        self.branches = 0
        self.ranges: dict[int, DataRanges] = {}  # of a data feature with the others, as far as asked for

    def check_time(self) -> None:
        """Raise GivenUp when the time is up."""
        if self.deadline.passed:
            raise GivenUp('time limit')

    # -- before the tree ---------------------------------------------------------------------------------------

    def prune(self) -> None:
        """Find the nodes that may be in an interpretation larger than ``most``."""
        data = self.sample.data
        if len(data) <= self.most:
            return
        left = self._possible(np.arange(len(data)))
        self.test = pair_test(self.sample)
        seen = np.full(len(data), -1)
        before, now = -1, left.sum()
        while before != now:
            before = now
            # What is removed early saves tests later: features with few nodes first, of those the long ones.
            order = np.lexsort((-data[:, 6], left.sum(axis=1)))
            for start in range(0, len(order), AT_ONCE):
                self.check_time()
                revise_each(order[start : start + AT_ONCE], self.test, left, self.most, seen)
                if np.count_nonzero(left.any(axis=1)) <= self.most:
                    return
            now = left.sum()
        # Features of few nodes are the first to show that a pose is none.
        order = np.argsort(left.sum(axis=1), kind='stable')
        of, i = np.nonzero(left[order])
        self.nodes = Nodes(order[of], i)

    def _possible(self, some: IntArray) -> BoolArray:
        """(len(some), e) bool: which model features these data features may lie on by themselves."""
        sample = self.sample
        alone: BoolArray = possible(
            sample.data[some],
            sample.kinds[some],
            sample.tolerances[some],
            sample.model,
            self.index.kind,
            self.radius_tol,
        )
        return alone

    def enlarge(self, motion: FloatArray) -> None:
        """Find what else fits when a pose (12,) gives way.

        Each pairing that is nearly within its tolerances is tried in turn, the nearest first.
        """
        sample = self.sample
        centre = motion[:9].reshape(3, 3) @ self.index.middle + motion[9:]
        near = np.flatnonzero(np.linalg.norm(sample.data[:, :3] - centre, axis=1) <= self.index.size)
        if len(near) < self.most:
            return
        e = len(sample.model)
        gaps = deviations(motion, np.repeat(near, e), np.tile(np.arange(e), len(near)), sample)
        gaps = np.where(self._possible(near), gaps.reshape(-1, e), np.inf)
        nearest, least = np.zeros(len(sample.data), np.int64), np.full(len(sample.data), np.inf)
        nearest[near], least[near] = gaps.argmin(axis=1), gaps.min(axis=1)
        order = np.argsort(least, kind='stable')
        chosen = order[: int((least <= 1.0).sum())]
        if len(chosen) < self.most:
            return
        for a_more in order[len(chosen) : int((least <= SEARCH_WIDTH).sum())]:
            more, pose = np.append(chosen, a_more), motion.copy()
            if common_pose(pose, more, nearest[more], sample):
                chosen, motion = more, pose
        self.keep_larger(chosen, nearest[chosen], motion)

    def keep_larger(self, a: IntArray, i: IntArray, motion: FloatArray) -> bool:
        """Note an interpretation that is larger than what is known, if a pose does explain it all."""
        if len(a) <= self.most or not all_fit(motion, a, i, self.sample, self.index.kind, self.radius_tol):
            return False
        self.assignment = np.full(len(self.sample.data), BIN, np.int32)
        self.assignment[a] = i
        self.most, self.motion = len(a), motion
        return True

    # -- the tree ----------------------------------------------------------------------------------------------

    def search(self) -> None:
        """Refute every interpretation larger than ``most``. Raises Larger when there is one, GivenUp at the limit."""
        free = np.arange(len(self.nodes.a))
        features, domains = np.unique(self.nodes.a, return_counts=True)
        spare = len(features) - self.most - 1
        if spare < 0:
            return
        if not self.disjoint:
            cones = self.sample.tolerances[features, 2]
            order = np.lexsort((cones, domains > WIDE))
            self.disjoint = self.groups(features[order], domains[order], spare + 1)
        for number, group in enumerate(self.disjoint[: spare + 1]):
            if frozenset(group) not in self.refuted:
                self.assign(group, _no_nodes(), free, None)
                self.refuted.append(frozenset(group))
                of, sizes = self.groups_refuted
                of[group] = number
                self.groups_refuted = Groups(of, np.append(sizes, len(group)))

    def groups(self, features: IntArray, nodes: IntArray, count: int) -> list[list[int]]:
        """Disjoint groups of the data features: each led by the next of them, with those that fix its pose best.

        nodes : (m,) int64, how many each feature has
        """
        leads, left, nodes = features[:count], features[count:], nodes[count:]
        groups = [[int(a)] for a in leads]
        variances = first_variances(leads, self.index.size, self.sample)
        for size in range(1, GROUP):
            for group, variance in zip(groups, variances):
                if len(left) == 0 or (len(left) < count and size > 1):
                    return groups
                chosen = add_steadiest(variance, group[0], left, nodes, self.sample)
                group.append(int(left[chosen]))
                left, nodes = np.delete(left, chosen), np.delete(nodes, chosen)
        return groups

    def assign(self, group: list[int], forced: IntArray, free: IntArray, region: Region | None) -> None:
        """Explore every way to have the whole group, besides the forced nodes."""
        if not group:
            self.explore(forced, free, region, self.refuted)
            return
        here = self.nodes.a[free]
        chosen = min(group, key=np.bincount(here, minlength=len(self.sample.data)).item)
        mine = here == chosen
        others = [a for a in group if a != chosen]
        for node in free[mine]:
            for more, rest, where in self.joined(node, forced, free[~mine], region):
                self.assign(others, more, rest, where)

    def joined(
        self, node: int, forced: IntArray, free: IntArray, region: Region | None
    ) -> list[tuple[IntArray, IntArray, Region | None]]:
        """One more node beside the forced ones: with it, what is left of the free ones, and each region of poses."""
        self.check_time()
        least = self.most - len(forced)
        a = int(self.nodes.a[node])
        if a not in self.ranges:
            self.ranges[a] = no_ranges(len(self.sample.data))
        rest = forward_check(node, free, forced, least, self.nodes, self.groups_refuted, self.test, self.ranges[a])
        if len(rest) == 0 and least > 0:
            return []
        more = np.append(forced, node)
        return [(more, rest, where) for where in self.regions(more, region)]

    def regions(self, nodes: IntArray, region: Region | None) -> list[Region | None]:
        """Where some nodes may have poses: nowhere, [None] while too few to tell, or regions that hold them all."""
        a, i = self.nodes.a[nodes], self.nodes.i[nodes]
        regions = self.first_regions(a, i) if region is None else [region]
        allowed: list[Region | None] = []
        for motion, turn in regions or []:
            pose = motion.copy()
            smaller = narrow_in_parts(pose, turn, a, i, self.sample)
            if smaller < 0.0 or refute(pose.copy(), smaller, a, i, self.sample, np.empty(len(a))) == INFEASIBLE:
                continue
            if region is None and smaller > WIDEST_TURN:
                return [None]
            allowed.append(Region(pose, smaller))
        return allowed if regions is not None else [None]

    def first_regions(self, a: IntArray, i: IntArray) -> list[Region] | None:
        """Regions of all poses that the two features which fix it best may have; None when all are nearly parallel."""
        data, model = self.sample.data[a], self.sample.model[i]
        cosines = np.maximum(np.abs(data[:, 3:6] @ data[:, 3:6].T), np.abs(model[:, 3:6] @ model[:, 3:6].T))
        sines = np.sqrt(np.maximum(1.0 - cosines**2, 0.0))
        cones = self.sample.tolerances[a, 2]
        worth = np.where(sines >= STEEP, sines / np.maximum(cones[:, None], cones), 0.0)
        p, q = (int(v) for v in np.unravel_index(int(np.argmax(worth)), worth.shape))
        if worth[p, q] <= 0.0:
            return None
        c, s, _, foot_a, foot_b, flip = pair_geometry(data[p], data[q])
        model_c, model_s, _, foot_i, foot_j, model_flip = pair_geometry(model[p], model[q])
        angle, model_angle = np.arctan2(s, c), np.arctan2(model_s, model_c)
        regions = []
        data_pair, model_pair = np.empty(12), np.empty(12)
        pair_frame(data, p, foot_a, q, flip, foot_b, data_pair)
        for other in (1.0, -1.0):
            apart = abs(angle - (model_angle if other > 0.0 else np.pi - model_angle))
            if apart > cones[p] + cones[q] + ROUNDING:
                continue
            # Each line of the model is at most so far from where the pose below lays it (docs/proof.md, lemma 9).
            chords = np.sin(0.5 * np.minimum(cones[[p, q]] + 0.5 * apart + ROUNDING, np.pi))
            turn = 2.0 * np.arcsin(min(np.sqrt((chords**2).sum() / (1.0 - model_c)), 1.0)) + ROUNDING
            pair_frame(model, p, foot_i, q, other * model_flip, other * foot_j, model_pair)
            for way in (1.0, -1.0):
                motion = np.empty(12)
                pair_pose(data_pair, model_pair, way, motion)
                regions.append(Region(motion, turn))
        return regions

    def explore(
        self,
        forced: IntArray,
        free: IntArray,
        region: Region | None,
        refuted: list[frozenset[int]],
        tested: bool = False,
    ) -> None:
        """Refute every interpretation larger than ``most`` that has all ``forced`` nodes and otherwise ``free`` ones.

        region : where the forced nodes may have poses, None when they are too few to tell
        refuted : sets of data features of which one at least is left out
        tested : the free nodes are known to be able to join the forced ones in the region
        """
        self.branches += 1
        self.check_time()
        if region is not None and not tested:
            least = self.most + 1 - len(forced)
            a, i = self.nodes.a, self.nodes.i
            groups = self.groups_refuted
            free = free[can_join(*region, a[forced], i[forced], a[free], i[free], least, groups, self.sample)]
        features, domains = np.unique(self.nodes.a[free], return_counts=True)
        spare = len(forced) + len(features) - self.most - 1
        if spare < 0:
            return
        singles = free[np.isin(self.nodes.a[free], features[domains == 1])]
        sets: list[IntArray] = []
        if region is not None:
            packed, sets = self.infeasible_sets(forced, free, singles, region, refuted, spare)
            if packed > spare:
                return
            refuted = refuted + [frozenset(self.nodes.a[nodes].tolist()) for nodes in sets]
            self.try_nearest(forced, free, region.motion)
            if not sets:
                here = (known - set(self.nodes.a[forced].tolist()) for known in refuted)
                sets = [
                    singles[np.isin(self.nodes.a[singles], list(known))]
                    for known in here
                    if known <= set(self.nodes.a[singles].tolist())
                ]
        if sets:
            self.leave_one_out(min(sets, key=len), forced, free, region, refuted)
        elif len(features) == 0 or (region is not None and len(singles) == len(features)):
            self.decide(forced, singles, free, region, refuted)
        else:
            # The feature of fewest nodes; those of one exclude no more than the one of most.
            chosen = self.nodes.a[free] == features[np.argmin(np.where(domains > 1, domains, domains.max()))]
            for node in free[chosen]:
                for more, rest, where in self.joined(node, forced, free[~chosen], region):
                    self.explore(more, rest, where, refuted)
            self.explore(forced, free[~chosen], region, refuted, tested=True)

    def decide(
        self, forced: IntArray, singles: IntArray, free: IntArray, region: Region | None, refuted: list[frozenset[int]]
    ) -> None:
        """Search the rotations of a region for a pose of nodes that were neither explained nor refuted by one bound."""
        nodes = np.concatenate([forced, singles])
        a, i = self.nodes.a[nodes], self.nodes.i[nodes]
        state = OPEN
        if region is not None:
            motion = region.motion.copy()
            state = search_rotations(motion, region.turn, a, i, self.sample)
            if state == FEASIBLE and self.keep_larger(a, i, motion):
                raise Larger
        if state != INFEASIBLE:
            raise GivenUp('some pairings are too near their tolerances to decide on')
        if len(singles):
            self.leave_one_out(singles, forced, free, region, refuted)

    def infeasible_sets(
        self,
        forced: IntArray,
        free: IntArray,
        singles: IntArray,
        region: Region,
        refuted: list[frozenset[int]],
        spare: int,
    ) -> tuple[int, list[IntArray]]:
        """How many disjoint sets of data features each leave one out, up to spare + 1, and new such sets of nodes.

        The new ones have no common pose with the forced nodes. spare + 1 when the forced nodes have none themselves.
        """
        have = set(self.nodes.a[forced].tolist())
        can = set(self.nodes.a[free].tolist())
        used: set[int] = set()
        packed = 0
        for known in refuted:
            open_ones = known - have
            if not open_ones:
                return spare + 1, []
            if open_ones <= can and not open_ones & used:
                used |= open_ones
                packed += 1
        found: list[IntArray] = []
        while packed <= spare:
            left = singles[~np.isin(self.nodes.a[singles], list(used))]
            nodes = np.concatenate([forced, left])
            a, i = self.nodes.a[nodes], self.nodes.i[nodes]
            weights = np.empty(len(nodes))
            if refute(region.motion.copy(), region.turn, a, i, self.sample, weights) != INFEASIBLE:
                break
            members = nodes[infeasible_subset(*region, a, i, weights, self.sample)]
            members = members[~np.isin(members, forced)]
            if len(members) == 0:
                return spare + 1, []
            found.append(members)
            used |= set(self.nodes.a[members].tolist())
            packed += 1
        return packed, found

    def leave_one_out(
        self, members: IntArray, forced: IntArray, free: IntArray, region: Region | None, refuted: list[frozenset[int]]
    ) -> None:
        """Explore what leaves out each member of an infeasible set in turn, and has those before it."""
        for k, node in enumerate(members):
            rest = free[~np.isin(self.nodes.a[free], self.nodes.a[members[: k + 1]])]
            self.explore(forced, rest, region, refuted, tested=k == 0)
            others = free[self.nodes.a[free] != self.nodes.a[node]]
            with_it = self.joined(node, forced, others, region) if node in free else []
            if not with_it:
                return
            forced, free, region = with_it[0]

    def try_nearest(self, forced: IntArray, free: IntArray, motion: FloatArray) -> None:
        """The forced nodes with the nearest node of every free feature: raises Larger when they have a common pose."""
        gaps = deviations(motion, self.nodes.a[free], self.nodes.i[free], self.sample)
        order = np.lexsort((gaps, self.nodes.a[free]))
        _, first = np.unique(self.nodes.a[free][order], return_index=True)
        nodes = np.concatenate([forced, free[order[first]]])
        a, i = self.nodes.a[nodes], self.nodes.i[nodes]
        pose = motion.copy()
        if common_pose(pose, a, i, self.sample) and self.keep_larger(a, i, pose):
            raise Larger
