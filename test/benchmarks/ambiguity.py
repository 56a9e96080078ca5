"""Whether what remains visible of an object determines its pose: an exhaustive search for another that does as well.

Every pair of data features is laid on every pair of model features that it fits; each pose found is refined and
compared with the true one, refined alike. A scene is undetermined when fewer of the model's features are in view, or
within the tolerances of the true pose, than an interpretation needs; or when some other pose, which is not the true
one turned by a symmetry of the model, explains at least as many data features and at least as many distinct model
features within the tolerances: then nothing in the counts tells which is right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model_matcher import MatchParams, MatchResult, ModelIndex
from model_matcher.closed_form.synthetic.scenes import SyntheticScene
from model_matcher.model.problem import make_problem
from model_matcher.model.settings import SEARCH_WIDTH
from model_matcher.model.symmetry import symmetries
from model_matcher.verification.refinement import refine_all
from msgs_py import BIN, Pose

ROOM = 256  # poses kept, near duplicates apart
ROTATION_DEG, TRANSLATION = 3.0, 0.03  # within these a pose is the true one; the second of the model's size
ENDLESS = (1e15, 1e15)  # patience


@dataclass(frozen=True)
class Verdict:
    """in_view : distinct model features of which something is in the data; found, data : distinct model features and
    data features that the refined true pose explains; rivals : other poses that explain as many of both."""

    in_view: int
    found: int
    data: int
    rivals: int

    def determined(self, least: int) -> bool:
        """Whether the pose can be told; least : distinct features that an interpretation needs."""
        return min(self.in_view, self.found) >= least and self.rivals == 0


def is_pose(pose: Pose, truth: Pose, index: ModelIndex) -> bool:
    """Whether a pose is the true one, or equal to it by the model's symmetry."""
    for motion in (Pose.identity(), *symmetries(index)):
        error = pose.error_to(truth.compose(motion))
        if error.rotation_deg < ROTATION_DEG and error.translation < TRANSLATION * index.size:
            return True
    return False


def judge(index: ModelIndex, scene: SyntheticScene, params: MatchParams, instance: int = 0) -> Verdict:
    """Search everything for a pose other than that of the instance."""
    from model_matcher.geometry.line_pairs import rank_pairs
    from model_matcher.search.pair_search import Candidates, search_pairs

    problem = make_problem(index, scene.data, params)
    in_view = len(np.unique(scene.assignment[scene.instance == instance]))
    truth = scene.poses[instance]
    if len(problem.rows) == 0:
        return Verdict(in_view, 0, 0, 0)
    pairs, partners = rank_pairs(problem.rows, np.zeros((0, 0), np.int32), index.size, len(problem.rows) - 1)
    motions, scores, state = np.zeros((ROOM, 12)), np.zeros(ROOM), np.zeros(4, np.int64)
    candidates = Candidates(motions, scores)
    search_pairs(
        pairs,
        partners,
        problem.model,
        index.pair_table,
        problem.features,
        SEARCH_WIDTH,
        0,
        len(pairs),
        ENDLESS,
        candidates,
        state,
    )
    motions, scores = motions[scores > 0.0], scores[scores > 0.0]
    start = np.concatenate([truth.rotation.ravel(), truth.translation])
    everything = params.replace(false_alarm_rate=1.0)
    # The true pose goes first, whatever its score: refinement looks at scores only to skip what is far behind.
    refined = refine_all(problem, np.vstack([start, motions]), np.concatenate([[1.0], scores]), everything, keep=0.0)
    distinct = np.floor(refined.scores).astype(int)
    data = (refined.assignments != BIN).sum(axis=1)
    as_good = np.flatnonzero((distinct >= distinct[0]) & (data >= data[0]))
    motions = refined.motions[as_good[as_good > 0]]
    rivals = sum(not is_pose(Pose(motion[:9].reshape(3, 3), motion[9:]), truth, index) for motion in motions)
    return Verdict(in_view, int(distinct[0]), int(data[0]), rivals)


def is_listed(result: MatchResult, truth: Pose, index: ModelIndex) -> bool:
    """Whether the true pose is among all that the result names, accepted or rejected with its reason."""
    return any(
        is_pose(pose, truth, index)
        for one in (*result.interpretations, *result.rejected)
        for pose in (one.pose, *one.symmetric_poses)
    )
