"""Evidence counts coincidences, not features: closed forms for boxes."""

from dataclasses import replace

import numpy as np
import pytest

from csg_renderer import model_features, parse_scene
from model_matcher import MatchParams, index_model, match
from model_matcher.closed_form.synthetic.scenes import (
    box,
    chipped_block,
    l_shape,
    lattice,
    make_scene,
    prism,
    random_pose,
    tubes,
)
from model_matcher.geometry.features import DataFeatures
from model_matcher.model.convex_hull import hull_faces
from model_matcher.model.index import ModelIndex, feature_rows
from model_matcher.model.problem import make_problem
from model_matcher.model.regularity import regularity
from model_matcher.verification.evidence import (
    coincidences,
    displaced,
    meet,
    neighbours,
    plane_table,
    radius_nats,
    surroundings,
)
from model_matcher.verification.false_alarms import needed_evidence
from model_matcher.verification.settings import ANGLE, NEIGHBOURS, RADII
from msgs_py import FeatureSet

SIZE = np.array([0.10, 0.06, 0.04])
TOLERANCE = 1e-3
IDENTITY = np.r_[np.eye(3).ravel(), np.zeros(3)]


def nats_of(index: ModelIndex, used: np.ndarray) -> float:
    made = regularity(index)
    planes = plane_table(made.offsets, made.sorted, TOLERANCE)
    return coincidences(
        index.prepared(TOLERANCE), used, made, planes, np.zeros(planes.number.shape), np.zeros(len(used))
    )


def of_length(length: float) -> float:
    """Chance, in nats, that a plane of another object falls on one of two at this distance."""
    return -np.log(4.0 * TOLERANCE / (2.0 * length + 2.0 * TOLERANCE))


@pytest.fixture(scope='module')
def block() -> ModelIndex:
    return index_model(box(SIZE))


def lines(index: ModelIndex, axis: int) -> np.ndarray:
    return np.flatnonzero(np.abs(index.rows[:, 3 + axis]) > 0.9)


def test_a_box_has_three_directions_and_two_planes_across_each(block):
    made = regularity(block)
    assert len(set(made.direction.tolist())) == 3
    number, nats = plane_table(made.offsets, made.sorted, TOLERANCE)
    assert number.max(axis=1).tolist() == [1, 1, 1]
    for normal, value in zip(made.normals, nats):
        assert value == pytest.approx(of_length(SIZE @ np.abs(normal)))


def test_planes_nearer_than_the_tolerance_allows_are_one(block):
    made = regularity(block)
    number, _ = plane_table(made.offsets, made.sorted, 0.06)
    assert number.max() == 0


def test_the_three_edges_of_a_corner_are_no_coincidence(block):
    corner = [
        k
        for k in range(12)
        if np.abs(np.minimum(*(np.linalg.norm(p[k]) for p in (block.features.start, block.features.end)))) < 1e-9
    ]
    used = np.zeros(12, bool)
    used[corner] = True
    assert used.sum() == 3
    assert nats_of(block, used) == 0.0


def test_each_dimension_that_agrees_counts_once_however_many_edges_show_it(block):
    corner = np.array(
        [
            np.minimum(np.linalg.norm(block.features.start[k]), np.linalg.norm(block.features.end[k])) < 1e-9
            for k in range(12)
        ]
    )
    for axis in range(3):
        other = (axis + 1) % 3
        used = corner.copy()
        # The edge along another axis at the far end of the corner's edge.
        far = [
            k
            for k in lines(block, other)
            if abs(abs(block.rows[k, axis]) - SIZE[axis]) < 1e-9 and abs(block.rows[k, 3 - axis - other]) < 1e-9
        ]
        used[far] = True
        assert nats_of(block, used) == pytest.approx(of_length(SIZE[axis]))
    assert nats_of(block, np.ones(12, bool)) == pytest.approx(sum(of_length(s) for s in SIZE))


def test_an_oblique_edge_counts_its_angle_and_each_offset_once():
    slanted = index_model(prism([(0, 0), (0.06, 0), (0.06, 0.02), (0.03, 0.05), (0, 0.05)], 0.04))
    front = np.abs(slanted.rows[:, 2]) < 1e-9
    square = front & (np.abs(slanted.rows[:, 3:5]).max(axis=1) > 0.99)
    oblique = front & ~square
    assert square.sum() == 4 and oblique.sum() == 1
    made = regularity(slanted)
    number, nats = plane_table(made.offsets, made.sorted, TOLERANCE)
    across = int(np.argmax(np.abs(made.normals @ np.cross(slanted.rows[oblique][0, 3:6], [0.0, 0.0, 1.0]))))
    gained = nats_of(slanted, square | oblique) - nats_of(slanted, square)
    assert gained == pytest.approx(-np.log(4 * ANGLE) + nats[across])


def test_edges_on_a_diagonal_count_their_offsets_unless_something_else_slants_like_it():
    """Two upright edges of a block at opposite corners lie in one slanted plane, as a chip between them may too."""
    index = index_model(chipped_block())
    upright = np.flatnonzero(np.abs(index.rows[:, 5]) > 0.9)
    diagonal = [k for k in upright if (index.rows[k, :2].min() < 1e-9) and (index.rows[k, :2].max() > 1e-9)]
    level = [k for k in range(len(index)) if abs(index.rows[k, 2]) < 1e-9 and abs(index.rows[k, 5]) < 1e-9]
    slanted = [k for k in level if np.abs(index.rows[k, 3:5]).max() < 0.99]
    along = [
        next(k for k in level if abs(index.rows[k, 3 + axis]) > 0.99 and index.rows[k, 1 - axis] < 1e-9)
        for axis in (0, 1)
    ]
    assert len(diagonal) == 2 and len(slanted) == 1
    one, both = np.zeros(len(index), bool), np.zeros(len(index), bool)
    one[[*along, diagonal[0]]] = both[[*along, *diagonal]] = True
    width = nats_of(index, both) - nats_of(index, one)
    assert width > 2.0
    one[slanted] = both[slanted] = True
    assert nats_of(index, both) - nats_of(index, one) < width


def test_a_model_of_many_directions_owes_nothing_to_its_angles():
    index = index_model(lattice())
    pair = np.zeros(len(index), bool)
    pair[[0, 100]] = True
    assert nats_of(index, pair) < 3.0


def test_the_lines_of_a_flat_grid_count_their_offsets():
    at = np.arange(5) * 0.03
    none, full = np.zeros(5), np.full(5, 0.12)
    start = np.column_stack([np.r_[at, none], np.r_[none, at], np.zeros(10)])
    end = np.column_stack([np.r_[at, full], np.r_[full, at], np.zeros(10)])
    index = index_model(FeatureSet.from_edges(start, end))
    one = -np.log(10.0 * TOLERANCE / (0.24 + 2.0 * TOLERANCE))
    assert nats_of(index, np.ones(10, bool)) == pytest.approx(8.0 * one)


def test_edges_meet_end_to_end_and_slightly_beyond_their_ends_but_not_across_a_gap():
    def rows(start, end):
        return feature_rows(FeatureSet.from_edges(np.array([start], float), np.array([end], float)))[0]

    along = rows((0, 0, 0), (0.1, 0, 0))
    assert meet(along, rows((0.1, 0, 0), (0.1, 0.05, 0)), TOLERANCE)
    assert meet(along, rows((0.105, 0.002, 0), (0.105, 0.05, 0)), TOLERANCE)
    assert not meet(along, rows((0.13, 0, 0), (0.13, 0.05, 0)), TOLERANCE)
    assert not meet(along, rows((0.05, 0, 0), (0.05, 0.05, 0)), TOLERANCE)  # into its middle
    assert not meet(along, rows((0.1, 0, 0.003), (0.1, 0.05, 0.003)), TOLERANCE)
    assert not meet(along, rows((0.1, 0, 0), (0.2, 0.001, 0)), TOLERANCE)


def test_unexplained_edges_at_explained_corners_speak_against_a_pose_up_to_a_limit(block):
    # The model's bottom, and at one of its corners, and later at all, edges of another, taller object.
    own = block.features.select(np.arange(4))
    model = block.prepared(TOLERANCE)
    values = []
    for extra in (0, 1, 4, 30):
        start = np.zeros((extra, 3))
        data = FeatureSet.concatenate([own, FeatureSet.from_edges(start, start + [0.0, 0.0, 0.05])])
        rows = feature_rows(data)
        tols = np.full((len(rows), 3), TOLERANCE)
        assignment = np.r_[np.arange(4), np.full(extra, -1)].astype(np.int32)
        values.append(neighbours(surroundings(IDENTITY, model, DataFeatures(rows, data.kind, tols, 0.0), assignment)))
    assert values[0] == pytest.approx(
        np.log((1.0 - NEIGHBOURS.crowded) * np.exp(NEIGHBOURS.of_chance) + NEIGHBOURS.crowded)
    )
    assert values[0] > values[1] > values[2]
    assert values[3] == pytest.approx(np.log(NEIGHBOURS.crowded), abs=1e-6)


def test_evidence_needed_grows_with_the_data_and_with_the_certainty_asked_for():
    model = index_model(l_shape())
    few, many = (make_problem(model, make_scene(l_shape(), 1, clutter=c).data, MatchParams()) for c in (0.0, 0.8))
    assert needed_evidence(many, MatchParams()) > needed_evidence(few, MatchParams())
    assert needed_evidence(few, MatchParams(false_alarm_rate=1e-6)) > needed_evidence(few, MatchParams())
    assert needed_evidence(few, MatchParams(false_alarm_rate=1.0)) == -np.inf


def test_models_of_curves_and_of_scattered_struts_have_evidence_too():
    for model in (tubes(), lattice()):
        scene = make_scene(model, 3, clutter=0.5)
        assert match(model, scene.data), model
        absent = make_scene(model, 3, clutter=0.5, instances=0)
        assert not match(model, absent.data)


@pytest.mark.parametrize('others', ['polyhedra', 'boxes'])
def test_absent_models_are_rejected_among_regular_objects(others):
    rng = np.random.default_rng(5)
    shapes = None if others == 'polyhedra' else tuple(box(rng.uniform(0.02, 0.1, 3)) for _ in range(30))
    model = index_model(l_shape(), 'l_shape')
    found = [
        bool(match(model, make_scene(l_shape(), seed, clutter=0.8, instances=0, others=shapes).data))
        for seed in range(500, 560)
    ]
    assert not any(found)


# -- solids of revolution, and like parts ----------------------------------------------------------------------------


def rims(height: float = 0.06, radius: float = 0.02, x: float = 0.0) -> FeatureSet:
    """A plain cylinder along z: two rims and an axis."""
    curves = FeatureSet.from_curves([[x, 0, 0], [x, 0, height]], [[0, 0, -1], [0, 0, 1]], [radius, radius])
    return FeatureSet.concatenate([curves, FeatureSet.from_axes([[x, 0, 0]], [[x, 0, height]])])


def test_a_plain_cylinder_counts_its_height_once_and_nothing_for_being_round_about_its_axis():
    index = index_model(rims())
    made = regularity(index)
    assert made.spanned.max() == 2 and len(made.normals) == 3
    assert nats_of(index, np.array([True, False, False])) == 0.0
    assert nats_of(index, np.array([True, True, False])) == pytest.approx(of_length(0.06))
    assert nats_of(index, np.ones(3, bool)) == pytest.approx(of_length(0.06))


def test_a_parallel_cylinder_counts_only_what_does_not_fix_the_turn():
    """The distance of a second axis fixes the turn; a third has two offsets, of which neither is free."""
    model = FeatureSet.concatenate([rims(0.06, 0.02), rims(0.06, 0.005, 0.04), rims(0.06, 0.005, -0.04)])
    index = index_model(model)
    one, two, three = (np.arange(9) < count for count in (3, 6, 9))
    height = nats_of(index, one)
    assert height == pytest.approx(of_length(0.06))
    assert nats_of(index, two) == pytest.approx(height)
    assert nats_of(index, three) > height + 2.0


def test_a_radius_counts_by_how_few_come_near_it():
    assert radius_nats(0.02, 0.002) == pytest.approx(-np.log(np.log(0.022 / 0.018) / np.log(RADII)))
    assert radius_nats(0.02, 0.0002) > radius_nats(0.02, 0.002) > radius_nats(0.02, 0.01) >= 0.0
    assert radius_nats(0.005, 0.006) == 0.0


def test_a_plain_cylinder_is_found_and_one_of_another_size_in_its_place_is_not():
    pose = random_pose(np.random.default_rng(2))
    assert match(rims(), rims().transformed(pose))
    assert not match(rims(), rims(0.066).transformed(pose))
    assert not match(rims(), rims(0.06, 0.0217).transformed(pose))


@pytest.mark.parametrize('elsewhere', ['beside', 'on another face'])
def test_a_bore_that_is_seen_where_the_model_has_none_speaks_against_a_pose(elsewhere):
    size = np.array([0.05, 0.04, 0.03])
    mine = FeatureSet.concatenate([box(size), FeatureSet.from_curves([[0.02, 0.02, 0.0]], [[0, 0, 1]], [0.012])])
    centre, normal = ([0.028, 0.02, 0.0], [0, 0, 1]) if elsewhere == 'beside' else ([0.02, 0.0, -0.015], [0, 1, 0])
    other = FeatureSet.from_curves([centre], [normal], [0.012])
    pose = random_pose(np.random.default_rng(1))
    few = box(size).select(np.arange(7))
    blank, like = (match(mine, data.transformed(pose)) for data in (few, FeatureSet.concatenate([few, other])))
    assert blank.stats['evidence'] > like.stats['evidence'] + 4.0


def test_a_rim_of_the_underside_is_not_in_view_from_above():
    flat = FeatureSet.from_curves([[0, 0, 0]] * 2 + [[0, 0, 0.01]] * 2, [[0, 0, 1]] * 4, [0.05, 0.01, 0.05, 0.03])
    planes, lies = hull_faces(index_model(flat))
    upper, lower = (int(np.argmax(sign * planes[:, 2])) for sign in (1.0, -1.0))
    assert lies[upper].tolist() == [False, False, True, True] and lies[lower].tolist() == [True, True, False, False]
    beside = np.abs(planes[:, 2]) < 0.5
    assert lies[beside].any(axis=0).tolist() == [True, False, True, False]


def test_only_data_of_kinds_that_the_model_has_gives_chance_its_tries():
    pose = random_pose(np.random.default_rng(3))
    data = FeatureSet.concatenate([rims().transformed(pose), box(SIZE).transformed(pose)])
    with_edges, without = (
        make_problem(index_model(rims()), some, MatchParams()) for some in (data, data.select([0, 1, 2]))
    )
    assert needed_evidence(with_edges, MatchParams()) == needed_evidence(without, MatchParams())


@pytest.fixture(scope='module')
def flange() -> ModelIndex:
    """A disc with a hub and two bores."""
    text = """UNITS MM; f = CYLINDER (50, 0, 0, 12) UNION (CYLINDER (26, 0, 0, 36))
    DIFFERENCE (CYLINDER (5, 0, 0, 60) AT (38, 0, -20)) DIFFERENCE (CYLINDER (5, 0, 0, 60) AT (-38, 0, -20)); DRAW f;"""
    return index_model(model_features(parse_scene(text).solids[0]))


def against_flange(flange: ModelIndex, hub_is_seen: bool, radius: float, middle: tuple[float, ...]) -> float:
    """Nats against a flange of which the disc's upper rim is found, and the hub's, for a curve; millimetres."""
    features = flange.features
    heights, radii = features.start[:, 2], np.nan_to_num(features.radii[:, 0])
    seen = ((radii > 0.02) & (heights > 0.03) & hub_is_seen) | ((radii > 0.04) & (heights > 0.01))
    other = features.select(np.flatnonzero(radii > 0.0)[:1])
    centre = 1e-3 * np.array([middle])
    moved = replace(other, start=centre, end=centre + [[0.0, 0.0, 1.0]], radii=np.full((1, 2), 1e-3 * radius))
    problem = make_problem(flange, FeatureSet.concatenate([features.select(seen), moved]), MatchParams())
    used = np.isin(flange.source, np.flatnonzero(seen))
    assignment = np.append(np.flatnonzero(used), -1).astype(np.int32)
    faces = np.asarray(regularity(flange).faces)
    return displaced(IDENTITY, problem.model, problem.features, assignment, used, faces)


@pytest.mark.parametrize(
    ('radius', 'middle', 'is_another'),
    [
        (5.0, (0.0, 38.0, 0.0), True),  # a bore at another place of the disc
        (26.0, (-21.0, -2.0, 12.0), False),  # the hub's shadow on the disc
        (50.0, (12.0, -9.0, 0.0), False),  # the disc's shadow on a table
        (26.0, (17.0, 4.0, 36.0), False),  # the hub's rim, measured wrongly: where it is there is no other
        (38.0, (0.0, 10.0, 12.0), False),  # of a size that the model does not have
    ],
)
def test_a_curve_elsewhere_is_another_object_or_a_shadow(flange, radius, middle, is_another):
    """The bore of the model at (38, 0) is not found, nor are the lower rims; the upper ones of hub and disc are."""
    against = against_flange(flange, True, radius, middle)
    assert (against > 3.0) == is_another
    assert is_another or against == 0.0


@pytest.mark.parametrize(('away', 'is_another'), [(20.0, True), (45.0, False)])
def test_a_curve_that_a_face_does_not_hold_is_no_part_of_it(flange, away, is_another):
    """The rim of what stands beside the disc on the same table; its middle is under the disc, the most of it is not."""
    against = against_flange(flange, False, 26.0, (away, 0.0, 0.0))
    assert (against > 3.0) == is_another
    assert is_another or against == 0.0
