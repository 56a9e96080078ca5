"""The measures themselves, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from model_matcher.closed_form.comparison import best_pose_error, compare_assignment, compare_edges
from msgs_py import FeatureSet, Interpretation, Pose

TRUE = FeatureSet.from_edges([[0, 0, 1], [0, 0, 1]], [[0.1, 0, 1], [0, 0.2, 1]])


def test_two_pieces_cover_most_of_one_edge_and_the_other_is_missed():
    found = FeatureSet.from_edges([[0.01, 0.001, 1], [0.09, 0, 1]], [[0.05, 0.001, 1], [0.05, 0, 1]])
    result = compare_edges(TRUE, found)
    assert list(result.true_index) == [0, 0]
    assert result.covered == pytest.approx([0.8, 0.0]) and result.edges_found == 1
    assert result.recall == pytest.approx(0.08 / 0.3) and result.precision == 1.0
    assert result.across_m[0] == pytest.approx([0.001, 0.001]) and result.direction_deg == pytest.approx([0, 0])


def test_overlaps_are_not_counted_twice():
    found = FeatureSet.from_edges([[0, 0, 1], [0.02, 0, 1]], [[0.06, 0, 1], [0.05, 0, 1]])
    assert compare_edges(TRUE, found).covered[0] == pytest.approx(0.6)


def test_a_far_or_oblique_edge_is_false():
    found = FeatureSet.from_edges([[0, 0.01, 1], [0, 0, 1]], [[0.1, 0.01, 1], [0.1, 0.0, 1.03]])
    result = compare_edges(TRUE, found)
    assert list(result.true_index) == [-1, -1] and result.precision == 0.0
    assert result.summary()['false_edges'] == 2


def test_nothing_found_or_nothing_true():
    assert compare_edges(TRUE, FeatureSet.empty()).recall == 0.0
    assert np.isnan(compare_edges(FeatureSet.empty(), TRUE).recall)


def test_pose_error_takes_the_nearest_symmetric_pose():
    truth = Pose(translation=[0, 0, 1])
    turned = Pose.from_rotation_vector([0, 0, np.pi], [0, 0, 1])
    item = Interpretation('m', [0], [1], turned, symmetric_poses=(truth,))
    assert best_pose_error(item, truth).rotation == 0.0


def test_assignment_is_judged_by_geometry():
    pose = Pose.from_rotation_vector([0.1, 0.2, 0.3], [0, 0, 0.5])
    data = FeatureSet.from_edges(TRUE.start, TRUE.end).transformed(pose)
    data = FeatureSet.from_edges(
        np.r_[data.start[:1], data.end[1:], [[9, 9, 9]]], np.r_[data.end[:1], data.start[1:], [[9, 9, 8]]]
    )
    right = compare_assignment(Interpretation('m', [0, 1, -1], [1, -1, 0], pose), TRUE, data)
    assert (right.matched, right.right, right.signs_right, right.spurious) == (2, 2, 2, 0)
    wrong = compare_assignment(Interpretation('m', [1, 1, 0], [1, 1, 1], pose), TRUE, data)
    assert (wrong.matched, wrong.right, wrong.signs_right, wrong.spurious) == (3, 1, 0, 2)


def test_a_pairing_is_right_within_the_error_that_the_feature_states():
    data = FeatureSet.from_edges([[0.01, 0, 1]], [[0.11, 0, 1]], err_par=0.012)
    item = Interpretation('m', [0], [1], Pose())
    assert compare_assignment(item, TRUE, data).right == 1
    assert compare_assignment(item, TRUE, FeatureSet.from_edges(data.start, data.end, err_par=0.008)).spurious == 1
