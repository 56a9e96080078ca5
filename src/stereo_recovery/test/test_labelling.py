"""Which segments show one edge: closed forms of the candidates, the beliefs and the choice."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereo_recovery.detection.segments import Segments
from stereo_recovery.matching import candidate_kernels, dense_kernels, labelling, labelling_kernels
from stereo_recovery.matching.candidate_kernels import Photometry, SegmentTable
from stereo_recovery.matching.dense import DenseDisparity, windows
from stereo_recovery.matching.labelling import grey_density, learnt_exposure, match

WINDOW, RADIUS, BELIEF = (1.0, 200.0), 100.0, 0.5


def table(*ends):
    ends = np.array(ends, float)
    run = ends[:, 1] - ends[:, 0]
    return SegmentTable(ends[:, 0].copy(), ends[:, 1].copy(), run / np.hypot(*run.T)[:, None])


def segments(*ends):
    t = table(*ends)
    n = len(t.start)
    length, zeros = np.hypot(*(t.end - t.start).T), np.zeros(n)
    return Segments(
        np.zeros((n, 2), int),
        np.arange(n),
        t.start,
        t.direction,
        np.column_stack([zeros, length]),
        zeros,
        zeros,
        zeros + 50.0,
        np.full((n, 2), 1e-3),
        zeros + 20.0,
        np.full(n, -1, np.int32),
    )


def plain(shape=(120, 240), level=80.0):
    return np.full(shape, level, np.float32)


def candidates(left, right, image=None):
    image = plain() if image is None else image
    return candidate_kernels.candidates(left, right, image.shape, -1000.0, 1000.0)


def bars(columns, levels, shape=(100, 240), rows=(20, 80)):
    """A picture whose grey level changes at these columns, and the segments there."""
    image = np.full(shape, 20.0, np.float32)
    for u, level in zip(columns, levels):
        image[rows[0] : rows[1] + 1, int(u) :] = level
    return image, segments(*[((u, float(rows[1])), (u, float(rows[0]))) for u in columns])


@pytest.mark.parametrize(('slope', 'found'), [(0.0, True), (1.4, True), (4.0, True), (8.0, False)])
def test_an_edge_may_recede_steeply_but_hardly_turn_around(slope, found):
    """Upright in the left image; in the right one it leans by this slope: disparity gradients 0, 1.1, 1.8 and 1.94."""
    left = table(((100.0, 10.0), (100.0, 50.0)))
    right = table(((40.0, 10.0), (40.0 + 40.0 * slope, 50.0)))
    node = candidates(left, right).node
    assert bool(len(node)) == found


def test_an_edge_along_a_row_is_not_told_by_rows_however_little_its_direction_is_off_it():
    """Ends of which both are in one row, and a direction that a fit leaves at 1e-29 off."""
    level = table(((100.0, 48.5), (120.0, 48.5)))._replace(direction=np.array([[1.0, 1e-29]]))
    found = candidates(level, level)
    assert len(found.node) and np.isfinite(found.value).all()


def test_disparity_is_told_at_start_middle_end_and_where_the_common_rows_begin_and_end():
    left = table(((100.0, 10.0), (120.0, 50.0)))
    right = table(((60.0, 10.0), (60.0, 30.0)))
    _, value, _, _, chances = candidates(left, right)
    # In row y the left line is at 100 + (y - 10) / 2.
    assert value[0, :3] == pytest.approx([40.0, 50.0, 60.0])
    assert value[0, 3:5] == pytest.approx([10.0, 30.0])
    assert value[0, 6:8] == pytest.approx([40.0, 50.0])
    assert value[0, 8] == pytest.approx(2.0 / np.sqrt(5.0))
    assert chances[0] == pytest.approx(21.0 / 41.0)


@pytest.mark.parametrize('lean', [0.0, 0.25, -1.0])
def test_parts_of_one_edge_that_recedes_are_one_however_wide_the_gap_between_them(lean):
    """An edge whole in the left image and broken in the right one, where it leans by this many px a row."""
    left = table(((100.0, 10.0), (100.0, 90.0)))
    along = [(60.0 + lean * (y - 10.0), y) for y in (10.0, 40.0, 60.0, 90.0)]
    for found in (candidates(left, table(along[:2], along[2:])), candidates(table(along[:2], along[2:]), left)):
        chosen = labelling_kernels.unique(found.node, found.value, np.arange(len(found.node)))
        assert len(found.node) == len(chosen) == 2


def test_a_short_part_of_a_nearly_level_edge_is_matched_by_its_rows():
    """Thirty columns of an edge that gains a row in fifteen, of which the other image shows all."""
    left = table(((150.0, 60.0), (180.0, 62.0)))
    right = table(((60.0, 58.0), (180.0, 66.0)))
    value = candidates(left, right).value
    assert value[-1, :3] == pytest.approx([60.0, 60.0, 60.0])


def test_a_level_pair_has_the_disparities_of_both_ends_and_of_either():
    left = table(((100.0, 40.0), (160.0, 40.0)))
    right = table(((70.0, 40.0), (140.0, 40.0)))
    value = candidates(left, right).value
    assert value[:, [0, 2]].tolist() == [[30.0, 20.0], [30.0, 30.0], [20.0, 20.0]]
    assert value[0, 5] > value[1, 5]


def test_ends_at_one_height_speak_for_a_pair_and_those_of_the_picture_say_nothing():
    left = table(((100.0, 30.0), (100.0, 90.0)))
    image = plain()
    whole = candidates(left, table(((60.0, 30.0), (60.0, 90.0))), image)[1][0, 5]
    part = candidates(left, table(((60.0, 50.0), (60.0, 70.0))), image)[1][0, 5]
    cut = candidates(left, table(((60.0, 2.0), (60.0, 117.0))), image)[1][0, 5]
    assert whole > cut > part


def test_one_side_that_stays_is_enough_and_a_rare_grey_level_says_more():
    """The surface at the right of the edge is the same to both eyes; what is behind differs."""
    left = table(((100.0, 90.0), (100.0, 30.0)))
    right = table(((60.0, 90.0), (60.0, 30.0)))
    ratios = []
    for density in (np.full(256, 1 / 256), np.where(np.arange(256) == 150, 0.5, 0.5 / 255)):
        seen, image = plain(level=30.0), plain(level=100.0)
        seen[:, 101:], image[:, 61:] = 150.0, 150.0
        told = Photometry(candidate_kernels.profiles(seen, left), image, density, 4.0)
        other = Photometry(candidate_kernels.profiles(seen, left), plain(level=100.0), density, 4.0)
        found = candidates(left, right)
        same, wrong = (candidate_kernels.photometric(p, left, found)[0] for p in (told, other))
        ratios.append(same - wrong)
    assert ratios[0] > 1.0
    assert ratios[0] > ratios[1]


@pytest.mark.parametrize(
    ('second', 'both'),
    [
        (((100.0, 60.0), (100.0, 90.0)), True),  # one line, broken
        (((112.0, 60.0), (112.0, 90.0)), False),  # another line
        (((100.0, 50.0), (112.0, 90.0)), True),  # two edges that meet, and that the other eye sees in line
        (((100.0, 30.0), (100.0, 90.0)), False),  # the same part of it
    ],
)
def test_two_segments_match_one_only_if_they_can_be_one_edge(second, both):
    left = table(((100.0, 10.0), (100.0, 50.0)), second)
    right = table(((40.0, 10.0), (40.0, 90.0)))
    node, value, *_ = candidates(left, right)
    chosen = labelling_kernels.unique(node, value, np.arange(len(node)))
    assert list(chosen) == ([0, 1] if both else [0])


def lists(node):
    right_of = np.argsort(node[:, 1], kind='stable')
    return labelling_kernels.CandidateLists(
        np.searchsorted(node[:, 0], np.arange(node[:, 0].max() + 2)),
        right_of,
        np.searchsorted(node[right_of, 1], np.arange(node[:, 1].max() + 2)),
    )


def beliefs(left, node, value, own, met=None):
    """met : ends that are corners, of left and of right segments."""
    if met is None:
        met = tuple(np.full((count, 2), -1, np.int32) for count in (len(left.start), node[:, 1].max() + 1))
    near, its = labelling_kernels.neighbours(left, met[0], RADIUS), lists(node)
    support = labelling_kernels.supporters(node, value, its.first, near, met[1], 60.0)
    against = labelling_kernels.rival_lists(node, value, its)
    return labelling.propagate(np.ascontiguousarray(node[:, 0]), own, near, support, against, RADIUS, 8)[1]


def values(*disparity):
    """Candidates of one disparity each, in rows 10 to 50."""
    d = np.array(disparity)
    n = len(d)
    return np.column_stack([d] * 3 + [np.full(n, 10.0), np.full(n, 50.0), np.zeros(n), d, d, np.ones(n)])


@given(st.lists(st.floats(-20.0, 60.0), min_size=2, max_size=6))
@settings(deadline=None)  # the first example may compile
def test_beliefs_of_rivals_and_of_none_are_probabilities(odds):
    """One left segment, candidates of one part of it, far from each other: what they leave is the belief in none."""
    n = len(odds)
    node = np.array([[0, j] for j in range(n)], np.int32)
    value = values(*(30.0 + 1e4 * np.arange(n)))
    own = np.array(odds)
    belief = beliefs(table(((100.0, 10.0), (100.0, 50.0))), node, value, own)
    weight = np.exp(np.minimum(own, 40.0))
    assert belief == pytest.approx(weight / (1.0 + weight.sum()), abs=1e-6)


def test_beliefs_are_the_same_however_many_threads_ask(monkeypatch):
    """Left edges that follow each other, three candidates each, at disparities that agree and others."""
    starts = np.array([[100.0 + 15.0 * k, 10.0] for k in range(8)])
    left = candidate_kernels.SegmentTable(starts, starts + [0.0, 40.0], np.tile([0.0, 1.0], (8, 1)))
    node = np.array([[i, 3 * i + j] for i in range(8) for j in range(3)], np.int32)
    value = values(*(30.0 + 0.2 * node[:, 0] + 9.0 * (node[:, 1] % 3)))
    own = np.where(node[:, 1] % 3 == node[:, 0] % 2, 0.5, 0.0)
    alone = beliefs(left, node, value, own)
    monkeypatch.setattr(labelling, 'parts_of', lambda count, least: [(0, 5), (5, 17), (17, count)])
    np.testing.assert_array_equal(beliefs(left, node, value, own), alone)
    assert alone.max() > 0.5


def test_the_nearer_of_two_edges_side_by_side_is_believed():
    """One left edge, two right ones a few pixels apart: an eye sees past the object's side."""
    node = np.array([[0, 0], [0, 1]], np.int32)
    value = values(30.0, 33.0)
    belief = beliefs(table(((100.0, 10.0), (100.0, 50.0))), node, value, np.array([5.5, 5.0]))
    assert belief[1] > 0.5 > belief[0]


def test_a_neighbour_of_like_disparity_decides_between_two_candidates():
    left = table(((100.0, 10.0), (100.0, 50.0)), ((120.0, 10.0), (120.0, 50.0)))
    node = np.array([[0, 0], [0, 1], [1, 2]], np.int32)
    value = values(70.0, 30.0, 71.0)
    belief = beliefs(left, node, value, np.array([2.0, 2.0, 6.0]))
    assert belief[0] > 0.8
    assert belief[1] < 0.1


def test_neighbours_speak_against_a_candidate_as_far_as_they_have_disparities_of_their_own():
    """A segment among nine others, all of whose candidates are far from its own in depth."""
    left = table(*[((100.0 + 4.0 * k, 10.0), (100.0 + 4.0 * k, 50.0)) for k in range(10)])
    node = np.stack([np.arange(10), np.arange(10)], axis=1).astype(np.int32)
    value = values(30.0, *[90.0] * 9)
    alone, among_hopeless, among_others = (
        beliefs(SegmentTable(*(each[:n] for each in left)), node[:n], value[:n], np.array([1.0] + [other] * (n - 1)))[0]
        for n, other in ((1, 0.0), (10, -30.0), (10, 6.0))
    )
    assert among_hopeless == pytest.approx(alone, abs=1e-6)
    assert among_others < 0.1 < alone


def test_what_meets_in_both_images_meets_in_space():
    """Two segments with a corner; of two candidates a few pixels apart one has it at the other's depth."""
    left = table(((100.0, 10.0), (100.0, 50.0)), ((100.0, 50.0), (140.0, 80.0)))
    node = np.array([[0, 0], [0, 1], [1, 2]], np.int32)
    value = values(34.0, 30.0, 30.0)
    own = np.array([3.0, 1.0, 6.0])
    none = np.full((3, 2), -1, np.int32)
    met = np.array([[-1, 1], [0, -1]], np.int32), np.array([[-1, -1], [-1, 2], [1, -1]], np.int32)
    apart = beliefs(left, node, value, own, (none[:2], none))
    joined = beliefs(left, node, value, own, met)
    assert joined[1] > apart[1]
    assert joined[1] > joined[0]


def test_the_end_of_a_row_of_like_bars_tells_their_period():
    """Twelve like bars, the last beside a brighter area: each has eleven look-alikes, and all must shift together."""
    columns = 40.0 + 12.0 * np.arange(13)
    levels = [60.0 if k % 2 else 140.0 for k in range(12)] + [220.0]
    left, right = (bars(columns - shift, levels) for shift in (0.0, 17.0))
    found, _ = match((left[0], right[0]), (left[1], right[1]), (1.0, 100.0), RADIUS, BELIEF)
    assert len(found) >= 12
    assert np.allclose(found.disparity, 17.0)


@pytest.mark.parametrize(('levels', 'asked'), [([90.0, 150.0, 40.0, 200.0, 110.0], False), ([140.0, 60.0] * 5, True)])
def test_dense_disparity_is_asked_only_where_something_is_open(monkeypatch, levels, asked):
    columns = 70.0 + (24.0 if len(levels) == 5 else 12.0) * np.arange(len(levels))
    (image, left), (other, right) = (bars(columns - shift, levels) for shift in (0.0, 17.0))
    made = []
    monkeypatch.setattr(labelling, 'DenseDisparity', lambda *given: made.append(given) or DenseDisparity(*given))
    found = match((image, other), (left, right), (1.0, 100.0), RADIUS, BELIEF)
    assert len(found) > 0
    assert bool(made) == asked


def test_what_is_left_over_in_both_images_is_no_match_far_from_all_others():
    """A face with two edges that only one eye sees each: they are not one edge behind the face."""
    left = bars([100.0, 104.0, 130.0, 160.0, 190.0], [90.0, 120.0, 150.0, 180.0, 210.0])
    right = bars([60.0, 86.0, 90.0, 120.0, 150.0], [120.0, 135.0, 150.0, 180.0, 210.0])
    found, _ = match((left[0], right[0]), (left[1], right[1]), WINDOW, RADIUS, BELIEF)
    assert not (found.disparity[:, 1] < 30.0).any()


def test_cameras_that_expose_differently_are_matched_and_their_exposures_learnt():
    columns, levels = 30.0 + 22.0 * np.arange(8), [90.0, 40.0, 120.0, 70.0, 160.0, 60.0, 110.0, 30.0]
    left = bars(columns, levels)
    image, right = bars(columns - 25.0, levels)
    other = 0.8 * image + 25.0
    found, _ = match((left[0], other), (left[1], right), (1.0, 100.0), RADIUS, BELIEF)
    assert len(found) == 8
    assert np.allclose(found.disparity, 25.0)
    profiles = [
        candidate_kernels.profiles(g, table(*np.stack([s.start, s.end], axis=1))) for g, s in (left, (other, right))
    ]
    learnt = learnt_exposure(profiles, np.column_stack([found.left, found.right]))
    assert learnt.gain == pytest.approx(0.8, abs=0.05)
    assert learnt.gain * 90.0 + learnt.shift == pytest.approx(97.0, abs=3.0)


def test_nothing_in_one_image_matches_nothing():
    image, some = bars([50.0], [90.0])
    none = some.select(np.zeros(1, bool))
    assert len(match((image, image), (some, none), WINDOW, RADIUS, BELIEF)[0]) == 0
    assert len(match((image, image), (none, some), WINDOW, RADIUS, BELIEF)[0]) == 0


def test_dense_disparity_speaks_for_the_true_candidate_in_texture_and_not_at_all_on_plain_faces():
    texture = np.random.default_rng(3).uniform(0.0, 255.0, (160, 260)).astype(np.float32)
    texture = np.repeat(np.repeat(texture[::2, ::2], 2, axis=0), 2, axis=1)
    left = segments(((130.0, 120.0), (130.0, 40.0)))
    node = np.array([[0, 0], [0, 1]], np.int32)
    value = np.array([[d, d, d, 40.0, 120.0, 0.0, d, d] for d in (20.0, 45.0)])
    textured = DenseDisparity(texture, np.roll(texture, -20, axis=1), 1.0, 60.0)
    true, wrong = textured.log_ratio(node, value, left)
    assert true > 1.5
    assert wrong < -1.5
    even = plain((160, 260))
    assert DenseDisparity(even, even, 1.0, 60.0).log_ratio(node, value, left) == pytest.approx(0.0)


def test_dense_disparity_says_nothing_between_places_that_look_alike():
    # Smoothness alone has chosen between the periods of a board: 44 px, where 20 px fit as well.
    tile = np.random.default_rng(5).uniform(0.0, 255.0, (160, 24)).astype(np.float32)
    right = windows(np.tile(tile, (1, 11)))
    places = np.stack(np.broadcast_arrays(130, np.arange(40, 46)[:, None]), axis=-1)[None, None].repeat(2, axis=1)
    node = np.array([[0, 0], [0, 1], [0, 2]], np.int32)
    along = np.repeat([[44.0], [20.0], [31.0]], 6, axis=1)
    told = dense_kernels.log_ratios(np.full((160, 264), 44.0, np.float32), right, places.astype(np.int32), node, along)
    assert told == pytest.approx([dense_kernels.AGREES, 0.0, dense_kernels.DIFFERS])


def test_grey_levels_that_never_occur_are_possible():
    density = grey_density(np.full((4, 8), 250.0, np.float32))
    assert density.min() > 0.0
