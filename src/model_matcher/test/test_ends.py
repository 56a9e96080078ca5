"""Whether edges end where the model's do."""

import math

import cv2
import numpy as np
import pytest

from csg_renderer import Solid, SolidOutline
from model_matcher.image_pose.alignment import Placed
from model_matcher.image_pose.ends import ends_seen, gone_on, log_ratio, past_ends
from model_matcher.image_pose.measurement import presence
from model_matcher.image_pose.presence import bent
from model_matcher.image_pose.settings import PAST_END
from model_matcher.image_pose.sight import Sight
from model_matcher.image_pose.views import Views
from msgs_py import PinholeCamera, Pose

N_PAST = len(PAST_END)


def lines(*ends, spacing=4.0):
    """A sight of straight lines ((u, v), (u, v)) in one view, points in the middle of their pieces."""
    pixel, normal, curve = [], [], []
    for number, (start, end) in enumerate(np.asarray(ends, float)):
        length = math.dist(start, end)
        along = (end - start) / length
        for at in np.arange(0.5 * spacing, length, spacing):
            pixel.append(start + at * along)
            normal.append([-along[1], along[0]])
            curve.append(number)
    n, curve = len(curve), np.array(curve, np.int32)
    point = np.column_stack([pixel, np.ones(n)])
    eye = np.zeros(n, np.int32)
    placed = Placed(point, eye, np.array(pixel), np.array(normal), curve, curve, np.zeros(n), np.zeros((n, 6)))
    return Sight(placed, np.full(n, spacing), np.full(n, spacing), np.zeros(n), np.zeros(n), curve)


def seen(sight):
    return np.ones(len(sight), np.int8)


def of(sight):
    """Which curves of a sight are bent."""
    return bent(sight.placed.point, sight.placed.curve, sight.limb)


def past(sight, found):
    """Pixels past the ends of a sight."""
    return past_ends(sight.placed, sight.spacing, found, of(sight))[1]


def on_and_all(there, views):
    """Ends of what is shown past which an edge goes on, and all that are known."""
    sight = there.sight
    return ends_seen(views.pictures, sight.placed, sight.spacing, sight.stretch, there.found, of(sight))


@pytest.mark.parametrize('angle', [0.0, 1.0, 2.5, 4.0])
def test_past_both_ends_a_line_is_looked_for_where_it_would_go_on(angle):
    along, start = np.array([np.cos(angle), np.sin(angle)]), np.array([100.0, 80.0])
    pixel = past(sight := lines((start, start + 40.0 * along)), seen(sight))
    of_end = (pixel - start) @ along
    before = 0.5 * 4.0
    expected = [*(before - np.array(PAST_END)), *(40.0 - before + np.array(PAST_END))]
    np.testing.assert_allclose(of_end, expected, atol=1e-9)
    np.testing.assert_allclose((pixel - start) @ [-along[1], along[0]], 0.0, atol=1e-9)


def test_where_the_outline_passes_nothing_is_said():
    """Neither past a corner whose other side goes on in line, nor past one end of a line that another crosses there."""
    corner = lines(((100, 80), (140, 80)), ((140, 80), (140, 120)))
    assert len(past(corner, seen(corner))) == 4 * N_PAST
    in_line = lines(((100, 80), (140, 80)), ((142, 80), (180, 80)))
    assert len(past(in_line, seen(in_line))) == 2 * N_PAST
    crossed = lines(((100, 80), (140, 80)), ((145, 60), (145, 100)))
    assert len(past(crossed, seen(crossed))) == 3 * N_PAST


def test_past_an_end_that_may_be_hidden_nothing_is_looked_for():
    sight = lines(((100, 80), (140, 80)))
    for row in (0, 1):
        found = seen(sight)
        found[row] = 0
        pixel = past(sight, found)
        assert len(pixel) == N_PAST and (pixel[:, 0] > 140.0).all()
    assert len(past(sight, np.zeros(len(sight), np.int8))) == 0


def test_an_end_counts_where_all_points_past_it_are_in_the_picture():
    at_ends = np.array([[1, 1, 1], [1, 0, 1], [1, 1, -1], [0, 0, 0], [1, 1, 1]], np.int8)
    assert gone_on(at_ends.ravel(), 1) == (2.0, 4.0)
    assert gone_on(at_ends.ravel(), 2) == (1.0, 2.0), 'what both views show is one end'
    assert gone_on(np.zeros(0, np.int8), 2) == (0.0, 0.0) and log_ratio(0.0, 0.0) == 0.0


def test_edges_that_go_on_speak_against_a_pose_and_those_that_end_a_little_for_it():
    of = [log_ratio(gone, 6.0) for gone in range(7)]
    assert 0.0 < of[0] < 0.5, 'most of others end as well'
    assert all(after < before for before, after in zip(of, of[1:])) and of[-1] < -3.0


def test_a_plate_laid_on_squares_of_a_board_has_less_evidence_than_one_that_lies_there():
    """The front of a plate is seen from before, in a picture where its edges end and in one where all lines go on."""
    camera = PinholeCamera.centred(320, 240, 400.0)
    shape = SolidOutline(Solid.block(0.2, 0.15, 0.01))
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 1.0]) - shape.centre)
    low, high = (camera.project(pose.apply(np.array(at))) for at in ((0.0, 0.0, 0.0), (0.2, 0.15, 0.0)))
    plate, board = np.full((240, 320), 90, np.uint8), np.full((240, 320), 90, np.uint8)
    box = [round(float(value)) for value in (*low, *high)]
    cv2.rectangle(plate, tuple(box[:2]), (box[2] - 1, box[3] - 1), 170, -1)
    board[:, box[0] : box[2]] += 80
    board[box[1] : box[3]] += 80
    of_plate, of_board = (Views.of((cv2.GaussianBlur(one, (0, 0), 0.7),), camera) for one in (plate, board))
    there, not_there = presence(shape, pose, of_plate), presence(shape, pose, of_board)
    assert there.support > 0.9 and not_there.support > 0.9, 'both have a step at every point'
    gone, ends = on_and_all(not_there, of_board)
    assert gone == ends >= 4.0
    assert on_and_all(there, of_plate)[0] == 0.0
    assert there.log_ratio > not_there.log_ratio + 3.0
