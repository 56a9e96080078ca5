"""Of two poses that explain the same data the one that explains more of the model is where the model is."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from csg_renderer import load_scene, model_features, scene_path
from model_matcher import match
from model_matcher.closed_form.comparison import best_pose_error
from model_matcher.verification.acceptance import _ranked, _share_evidence
from model_matcher.verification.refinement import Refined
from model_matcher.verification.settings import CANDIDATES, WORST
from msgs_py import FeatureSet, Pose


def candidates(data: list[list[int]], evidence: list[float], n: int = 10) -> tuple[Refined, np.ndarray]:
    """Poses that explain the data listed, each as many distinct model features."""
    assignments = np.full((len(data), n), -1, np.int32)
    for k, mine in enumerate(data):
        assignments[k, mine] = np.arange(len(mine))
    none = np.zeros(len(data))
    refined = Refined(
        np.zeros((len(data), 12)),
        assignments,
        np.zeros_like(assignments, np.int8),
        np.array([len(mine) + 0.9 for mine in data]),
        none,
        np.array(evidence),
    )
    matched = (assignments >= 0).astype(int)
    return refined, matched @ matched.T


@pytest.mark.parametrize(
    ('data', 'evidence', 'best'),
    [
        ([[0, 1, 2, 3, 4, 5, 6], [0, 1, 2, 3]], [12.0, 14.0], 0),  # more of the same data
        ([[0, 1, 2, 3, 4, 5, 6], [0, 1, 2, 3]], [12.0, 12.1 + 2.0 * WORST], 1),  # so much weaker is another matter
        ([[0, 1, 2, 3, 4, 5, 6], [6, 7, 8, 9]], [12.0, 14.0], 1),  # other data
        ([[0, 1, 2, 3, 4], [0, 1, 2, 3]], [12.0, 14.0], 0),
        ([[0, 1, 2, 3, 4], [0, 1, 2, 3]], [12.0, 12.1 + WORST], 1),  # one feature more weighs less than two
        ([[0, 1, 2, 3], [0, 1, 2, 3]], [12.0, 14.0], 1),
    ],
)
def test_evidence_counts_for_the_pose_that_explains_the_same_data_and_more(data, evidence, best):
    refined, common = candidates(data, evidence)
    _share_evidence(refined, common)
    assert refined.evidence.argmax() == best
    assert refined.evidence.max() == pytest.approx(max(evidence), abs=0.02)


def test_what_explains_nothing_says_nothing_of_others():
    refined, common = candidates([[0, 1, 2, 3], [4, 5, 6], []], [-2.0, -1.0, 0.0])
    _share_evidence(refined, common)
    assert refined.evidence.tolist() == [-2.0, -1.0, 0.0]


def test_of_many_poses_alike_what_has_more_evidence_than_any_comes_first(monkeypatch):
    """They are ordered by what they cover of the model; that they are many says nothing against another one."""
    monkeypatch.setattr('model_matcher.verification.acceptance.covered', lambda problem, motion, assignment: 1.0)
    alike = [[0, 1, 2, 3]] * (CANDIDATES + 4)
    refined, _ = candidates([*alike, [5, 6], [7, 8]], [*np.linspace(1.0, 3.0, len(alike)), 9.0, 2.0])
    assert _ranked(None, refined)[:2] == [len(alike), len(alike) - 1]
    assert _ranked(None, refined)[-1] == len(alike) + 1


@pytest.mark.parametrize('name', ['chipped_block_v1', 'l_shape_v1', 'wedge_v1'])
def test_a_model_like_itself_is_not_found_turned_within_itself(name):
    """Blocks repeat themselves turned by 180 degrees and shifted: such a pose explains half of the same edges."""
    model = model_features(load_scene(scene_path(name)).placements[0].model)
    size = float(np.ptp(np.r_[model.start, model.end], axis=0).max())
    for seed in range(20):
        rng = np.random.default_rng([seed, 17])
        pose = Pose(Rotation.random(random_state=rng).as_matrix(), [0.0, 0.0, 0.25])
        seen = model.transformed(pose).select(rng.random(len(model)) > 0.25)
        cut = rng.uniform(0.0, 0.2, (2, len(seen), 1)) * (seen.end - seen.start)
        middle = pose.apply(np.zeros(3)) + rng.uniform(-size, size, (len(seen), 3))
        half = rng.normal(size=(len(seen), 3)) * 0.2 * size
        data = FeatureSet.from_edges(
            np.r_[seen.start + cut[0], middle - half], np.r_[seen.end - cut[1], middle + half], 1e-4, 1e-4
        )
        found = match(model, data).best
        assert found is not None and best_pose_error(found, pose).rotation_deg < 1.0, seed
