"""What of a model is in view, and what its share is worth: closed forms for boxes."""

import numpy as np
import pytest

from model_matcher import index_model
from model_matcher.closed_form.synthetic.scenes import box, cylinder_box, l_shape
from model_matcher.model.convex_hull import hull_faces
from model_matcher.verification.settings import VIEW
from model_matcher.verification.visibility_evidence import count_in_view, nats_of_view
from msgs_py import FeatureKind, FeatureSet, Pose

SIZE = np.array([0.10, 0.06, 0.04])
AWAY = Pose(np.eye(3), [-0.05, -0.03, 0.5])
BEFORE_A_CORNER = Pose.from_rotation_vector([0.6, -0.5, 0.0], [-0.05, -0.03, 0.5])


def nats(model: FeatureSet, pose: Pose, found: np.ndarray) -> float:
    """Of a model of which these features were found."""
    used = np.zeros(len(model), bool)
    used[found] = True
    motion = np.r_[pose.rotation.ravel(), pose.translation]
    return nats_of_view(count_in_view(motion, used, *hull_faces(index_model(model))))


def ratio(found: int, missed: int, chance: float) -> float:
    return (chance / VIEW.by_chance) ** found * ((1.0 - chance) / (1.0 - VIEW.by_chance)) ** missed


def in_view(size: np.ndarray, pose: Pose) -> np.ndarray:
    index = index_model(box(size))
    planes, lies = hull_faces(index)
    eye = -pose.rotation.T @ pose.translation
    return np.flatnonzero(lies[planes[:, :3] @ eye + planes[:, 3] > 0.0].any(axis=0))


def test_a_box_has_six_faces_of_four_edges_and_every_edge_lies_on_two():
    planes, lies = hull_faces(index_model(box(SIZE)))
    assert planes.shape == (6, 4)
    assert lies.sum(axis=1).tolist() == [4] * 6
    assert lies.sum(axis=0).tolist() == [2] * 12


def test_a_flat_model_is_in_view_from_both_sides():
    plane = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    planes, lies = hull_faces(index_model(FeatureSet.from_edges(plane, np.roll(plane, 1, axis=0))))
    assert sorted(planes[:, 2].tolist()) == pytest.approx([-1.0, 1.0])
    assert lies.all()


def test_a_straight_model_has_no_faces():
    planes, _ = hull_faces(index_model(FeatureSet.from_edges([[0, 0, 0], [2, 0, 0]], [[1, 0, 0], [3, 0, 0.0]])))
    assert len(planes) == 0


def test_rims_bulge_the_hull():
    index = index_model(cylinder_box())
    planes, lies = hull_faces(index)
    assert len(planes) > 6 and not lies[:, index.kind == FeatureKind.AXIS].any()
    # The rim that stands out lies on the hull, the one at its foot on the box does not.
    assert lies[:, index.kind == FeatureKind.CURVE].any(axis=0).tolist() == [False, True]


def test_a_box_shows_four_edges_of_one_face_or_nine_of_three():
    assert len(in_view(SIZE, AWAY)) == 4
    assert len(in_view(SIZE, BEFORE_A_CORNER)) == 9


@pytest.mark.parametrize('pose', [AWAY, BEFORE_A_CORNER])
def test_what_is_found_is_explained_by_a_view_or_by_thinning(pose):
    shown = in_view(SIZE, pose)
    hidden = np.setdiff1d(np.arange(12), shown)
    view, thinned = ratio(len(shown), 0, VIEW.seen), ratio(len(shown), len(hidden), VIEW.thinned)
    assert nats(box(SIZE), pose, shown) == pytest.approx(np.log(0.5 * (view + thinned)))
    view, thinned = ratio(0, len(shown), VIEW.seen), ratio(len(hidden), len(shown), VIEW.thinned)
    view *= (VIEW.hidden / VIEW.by_chance) ** len(hidden)
    assert nats(box(SIZE), pose, hidden) == pytest.approx(np.log(0.5 * (view + thinned)))


def test_each_edge_in_view_speaks_for_a_pose_and_each_missed_one_against_it():
    shown = in_view(SIZE, BEFORE_A_CORNER)
    values = [nats(box(SIZE), BEFORE_A_CORNER, shown[:count]) for count in range(10)]
    assert (np.diff(values) > 0.0).all() and values[2] < 0.0 < values[9]


def test_edges_in_a_notch_are_not_counted():
    index = index_model(l_shape())
    _, lies = hull_faces(index)
    assert 0 < (~lies.any(axis=0)).sum() < len(index)


def test_from_inside_nothing_is_in_view():
    inside = Pose(np.eye(3), [-0.05, -0.03, 0.02])
    hidden = (VIEW.hidden / VIEW.by_chance) ** 12
    assert nats(box(SIZE), inside, np.arange(12)) == pytest.approx(np.log(0.5 * (hidden + ratio(12, 0, VIEW.thinned))))
