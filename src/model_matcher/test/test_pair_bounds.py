"""Pairs of features at the edge of their tolerances: with a thousandth less they fit, with a thousandth more not."""

import numpy as np
import pytest

from model_matcher.geometry.constraints import (
    A_MINUS,
    A_PLUS,
    B_MINUS,
    B_PLUS,
    DIFFERENT,
    SAME,
    corner_ranges,
    entry,
    pair_ranges,
)
from model_matcher.geometry.pair_bounds import margins_of, model_relations, pair_fits, possible, relation
from model_matcher.interpretation_tree.ordering import curves_before_others
from model_matcher.interpretation_tree.signs import relate, set_sign, unknown_signs, write_signs
from msgs_py.numeric.vectors import perpendicular

NEAR, FAR = 0.999, 1.001


def row(middle, direction, half, radii=(np.nan, np.nan)):
    direction = np.asarray(direction, float)
    return np.array([*middle, *(direction / np.linalg.norm(direction)), half, *radii])


def related(a, b):
    out = np.empty(10)
    relation(a, b, out)
    return out


def fits(data, model, tols):
    """Whether two data rows may lie on two model rows; tols : (2, 3) across, along, cone."""
    data, model = np.array(data), np.array(model)
    margins = margins_of(data, np.array(tols, float))
    return pair_fits(related(*data)[None], 0, margins, 0, 1, model[:, 6].copy(), model_relations(model), 0, 1)


def random_rows(seed):
    rng = np.random.default_rng(seed)
    return [row(rng.uniform(-1, 1, 3), rng.normal(size=3), rng.uniform(0.1, 1.0)) for _ in range(2)]


@pytest.mark.parametrize('seed', range(6))
def test_a_relation_is_what_a_rigid_motion_keeps(seed):
    a, b = random_rows(seed)
    out = related(a, b)
    between = b[:3] - a[:3]
    assert out[0] == pytest.approx(np.arccos(abs(a[3:6] @ b[3:6]))) and out[1] == pytest.approx(np.sin(out[0]))
    assert out[5] == pytest.approx(np.linalg.norm(between))
    assert out[6] == pytest.approx(np.linalg.norm(np.cross(between, a[3:6])))
    assert out[7] == pytest.approx(np.linalg.norm(np.cross(between, b[3:6])))
    assert out[8] == pytest.approx(between @ a[3:6])
    assert out[9] == np.sign(a[3:6] @ b[3:6])
    # The feet are joined by the common normal.
    foot_a, foot_b = a[:3] + out[3] * a[3:6], b[:3] + out[9] * out[4] * b[3:6]
    both = [np.linalg.norm(foot_a - (b[:3] + way * out[4] * b[3:6])) for way in (1.0, -1.0)]
    assert min(both) == pytest.approx(abs(out[2])) and np.linalg.norm(foot_a - foot_b) == pytest.approx(min(both))
    whole = model_relations(np.array([a, b]))
    np.testing.assert_allclose(whole[0, 1], out)
    np.testing.assert_allclose(whole[1, 0], related(b, a))


def test_margins_are_the_half_length_the_tolerances_and_the_cone():
    (found,) = margins_of(np.array([row([0, 0, 0], [1, 0, 0], 0.5)]), np.array([[0.01, 0.02, 0.3]]))
    expected = [0.5, 0.5 * np.cos(0.3), 0.01, 0.02, 0.3, np.sin(0.3), np.cos(0.3), 2.0 * np.sin(0.15)]
    np.testing.assert_allclose(found, expected)


def test_a_feature_by_itself_has_its_kind_its_length_and_its_radii():
    model = np.array([row([0, 0, 0], [1, 0, 0], 1.0), row([0, 0, 0], [0, 0, 1], 0.5, (0.3, 0.2))])
    kinds = np.array([0, 1], np.uint8)

    def may(one, kind, tols=(0.01, 0.02, 0.0), radius_tol=0.05):
        return possible(one[None], np.array([kind], np.uint8), np.array([tols], float), model, kinds, radius_tol)[
            0
        ].tolist()

    for share, expected in ((NEAR, True), (FAR, False)):
        assert may(row([5, 5, 5], [0, 1, 0], share * 1.02), 0) == [expected, False]
        # A tilt by the cone makes it seem longer.
        assert may(row([5, 5, 5], [0, 1, 0], share * 1.02 / np.cos(0.4)), 0, (0.01, 0.02, 0.4)) == [expected, False]
        for more in ((0.06 * share, 0.0), (-0.06 * share, 0.0), (0.0, 0.06 * share), (0.0, -0.06 * share)):
            one = row([0, 0, 0], [0, 1, 0], 0.5, (0.3 + more[0], 0.2 + more[1]))
            assert may(one, 1) == [False, expected]
    assert may(row([0, 0, 0], [1, 0, 0], 0.1), 2) == [False, False]


# Two model edges at right angles, 0.4 apart, feet so far from their middles that none is its own mirror image.
MODEL = [row([-0.2, 0, 0], [1, 0, 0], 0.8), row([0, 0.3, 0.4], [0, 1, 0], 0.6)]
HALVES = 0.5, 0.3
TOLS = [[0.01, 0.02, 0.0], [0.03, 0.05, 0.0]]


def pieces(offset=0.0, along_a=0.0, along_b=0.0, turn=0.0, tols=TOLS):
    """Parts of both edges, the second moved along the normal, each along itself, the second turned about the normal."""
    a = row([-0.2 + along_a, 0, 0], [1, 0, 0], HALVES[0])
    b = row([0, 0.3, 0.4 + offset], [np.sin(turn), np.cos(turn), 0], HALVES[1])
    b[:3] = [0, 0, 0.4 + offset] + (0.3 + along_b) * b[3:6]
    return fits([a, b], MODEL, tols)


def test_parts_of_two_edges_fit_them_and_no_mirror_image_does():
    assert pieces()
    a, b = row([-0.2, 0, 0], [1, 0, 0], 0.5), row([0, -0.3, -0.4], [0, 1, 0], 0.3)
    assert fits([a, b], MODEL, TOLS), 'at right angles both ways to cross are one'
    slanted = [row([0, 0, 0], [1, 0, 0], 0.8), row([0, 0, 0.4], [1, 1, 0], 0.6)]
    data = [row([0, 0, 0], [1, 0, 0], 0.5), row([0, 0, 0.4], [1, 1, 0], 0.3)]
    mirrored = [data[0], row([0, 0, -0.4], [1, 1, 0], 0.3)]
    assert fits(data, slanted, TOLS) and not fits(mirrored, slanted, TOLS)
    assert fits([data[0], row([0, 0, 0.4], [-1, -1, 0], 0.3)], slanted, TOLS), 'an edge has no direction'


@pytest.mark.parametrize('way', [1.0, -1.0])
@pytest.mark.parametrize(('share', 'expected'), [(NEAR, True), (FAR, False)])
def test_the_distance_of_two_lines_may_differ_by_both_tolerances_across(way, share, expected):
    assert pieces(offset=way * share * (0.01 + 0.03)) == expected


@pytest.mark.parametrize('way', [1.0, -1.0])
@pytest.mark.parametrize(('share', 'expected'), [(NEAR, True), (FAR, False)])
def test_a_part_may_be_beside_its_edges_end_by_its_tolerance_along(way, share, expected):
    """And by what both may be off across."""
    room_a, room_b = 0.8 - 0.5 + 0.02 + 0.04, 0.6 - 0.3 + 0.05 + 0.04
    assert pieces(along_a=way * share * room_a) == expected
    assert pieces(along_b=way * share * room_b) == expected


@pytest.mark.parametrize(('share', 'expected'), [(NEAR, True), (FAR, False)])
def test_an_angle_may_differ_by_both_cones(share, expected):
    """At 60 degrees, where the obtuse angle is another."""
    model = [row([0, 0, 0], [1, 0, 0], 2.0), row([0, 0, 0.4], [1, np.sqrt(3.0), 0], 2.0)]
    for way in (1.0, -1.0):
        angle = np.pi / 3 + way * share * (0.04 + 0.05)
        data = [row([0, 0, 0], [1, 0, 0], 0.3), row([0, 0, 0.4], [np.cos(angle), np.sin(angle), 0], 0.3)]
        assert fits(data, model, [[0.01, 0.01, 0.04], [0.01, 0.01, 0.05]]) == expected


@pytest.mark.parametrize(('share', 'expected'), [(NEAR, True), (FAR, False)])
def test_the_distance_of_parallel_lines_may_differ_by_both_tolerances_across(share, expected):
    model = [row([0, 0, 0], [1, 0, 0], 1.0), row([0.1, 0.5, 0], [1, 0, 0], 1.0)]
    for way in (1.0, -1.0):
        data = [row([0, 0, 0], [1, 0, 0], 0.4), row([0.2, 0.5 + way * share * 0.04, 0], [1, 0, 0], 0.4)]
        assert fits(data, model, TOLS) == expected
    # Middles as far apart as the edges have room for, and no farther.
    far = np.hypot(0.1, 0.5) + 2 * (1.0 - 0.4) + 0.07 + 0.04
    for length, fit in ((NEAR * far, True), (FAR * far, False)):
        data = [row([0, 0, 0], [1, 0, 0], 0.4), row([np.sqrt(length**2 - 0.25), 0.5, 0], [1, 0, 0], 0.4)]
        assert fits(data, model, TOLS) == fit


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('cones', [(0.0, 0.0), (0.02, 0.05)])
def test_ranges_of_end_points_are_those_of_the_four_vectors_between_them(seed, cones):
    a, b = random_rows(seed)
    errors = (0.01, 0.03)
    out = np.empty(11)
    corner_ranges(a, b, *errors, *cones, out)
    ends = [
        [one[:3] + way * max(one[6] - error, 0.0) * one[3:6] for way in (1, -1)] for one, error in zip((a, b), errors)
    ]
    vectors = np.array([q - p for p in ends[0] for q in ends[1]])
    normal = np.cross(a[3:6], b[3:6])
    normal /= np.linalg.norm(normal)
    distances = np.linalg.norm(vectors, axis=1)
    angles = [np.arccos(vectors @ axis / distances) for axis in (a[3:6], b[3:6], normal)]
    angle = np.arccos(a[3:6] @ b[3:6])
    expected = [distances.min() + 0.04, distances.max() - 0.04, angle + sum(cones), angle - sum(cones)]
    for values, slack in zip(angles, (*cones, sum(cones))):
        expected += [values.min() + slack, values.max() - slack]
    np.testing.assert_allclose(out, [*expected, 1.0], atol=1e-12)
    corner_ranges(a, row(b[:3], a[3:6] + 1e-9 * perpendicular(a[3:6]), 0.2), *errors, *cones, out)
    assert out[10] == -1.0, 'parallel lines have no normal'


@pytest.mark.parametrize('seed', range(6))
def test_errors_draw_ranges_in(seed):
    a, b = random_rows(seed)
    exact, drawn = np.empty(11), np.empty(11)
    error, cones = 0.004, (0.01, 0.02)
    pair_ranges(a, b, 0.0, 0.0, 0.0, 0.0, exact)
    pair_ranges(a, b, 0.001, 0.003, *cones, drawn)
    np.testing.assert_allclose(drawn[:2], exact[:2] + [error, -error])
    np.testing.assert_allclose(drawn[2:4], exact[2:4] + [0.03, -0.03])
    sine = np.linalg.norm(np.cross(a[3:6], b[3:6]))
    tilt = np.arcsin(2.0 * (np.sin(0.005) + np.sin(0.01)) / sine)
    for at, cone in ((4, 0.01), (6, 0.02), (8, tilt)):
        # By the cone of the direction, and by the turn of a vector whose ends are off: least where it is longest.
        least, most = cone + np.arcsin(error / exact[1]), cone + np.arcsin(min(error / exact[0], 1.0))
        assert least - 1e-9 <= drawn[at] - exact[at] <= most + 1e-9
        assert least - 1e-9 <= exact[at + 1] - drawn[at + 1] <= most + 1e-9


def test_curves_come_first_in_a_list_that_asks_for_them():
    pairs = np.array([[0, 1], [0, 2], [1, 2]])
    listed, places = curves_before_others(pairs, np.array([False, True, True]))
    assert listed.tolist() == [2, 0, 1] and places.tolist() == [[0, 1], [0, 2], [1, 2]]
    assert curves_before_others(pairs, None)[0].tolist() == [0, 1, 2]
    listed, places = curves_before_others(pairs, np.array([False, False, True]))
    assert listed.tolist() == [1, 2, 0] and places.tolist() == [[0, 1], [0, 2], [1, 2]]


@pytest.mark.parametrize('seed', range(40))
def test_signs_that_are_told_are_those_that_every_solution_has(seed):
    """Against all signs of five features, told one after another what they are, or are to each other."""
    rng = np.random.default_rng(seed)
    signs, every = unknown_signs(5), np.array(np.meshgrid(*[[1, -1]] * 5)).reshape(5, -1).T
    for _ in range(8):
        a, b = rng.permutation(5)[:2]
        value = int(rng.choice([1, -1]))
        if rng.random() < 0.3:
            left, agrees = every[every[:, a] == value], set_sign(a, value, signs)
        else:
            left, agrees = every[every[:, b] == value * every[:, a]], relate(a, b, value, signs)
        assert agrees == (len(left) > 0)
        if not agrees:
            break
        every = left
        found = np.empty(5, np.int8)
        write_signs(signs, np.array([0, 0, 0, 0, 0], np.int32), found)
        known = np.where(np.ptp(every, axis=0) == 0, every[0], 0)
        np.testing.assert_array_equal(found, known)
        write_signs(signs, np.array([0, -1, 0, 0, -1], np.int32), found)
        assert found[1] == found[4] == 0


@pytest.mark.parametrize('ways', [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_lines_nearly_at_right_angles_fit_whichever_angle_is_the_acute_one(ways):
    """89 degrees in the model, 91 in the data: the sign of the distance and one foot turn round."""
    model = [MODEL[0], row([0.3 * np.sin(0.02), 0.3 * np.cos(0.02), 0.4], [np.sin(0.02), np.cos(0.02), 0], 0.6)]
    for along, expected in ((0.0, True), (0.9, False)):
        other = np.array([-np.sin(0.02), np.cos(0.02), 0.0])
        a = row([-0.2 - along, 0, 0], [ways[0], 0, 0], HALVES[0])
        b = row([0.3 * other[0], 0.3 * other[1], 0.4], ways[1] * other, HALVES[1])
        assert fits([a, b], model, [[0.01, 0.02, 0.03], [0.03, 0.05, 0.03]]) == expected


class TestEntry:
    """What the constraints say of ranges, one at a time."""

    def only(self, place):
        return np.arange(5) == place

    def ranges(self, **given):
        """Ranges that contain everything, or what is given: distance, angle, first, second, third."""
        out = np.array([0.5, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
        for place, name in enumerate(('distance', 'angle', 'first', 'second', 'third')):
            if name in given:
                out[2 * place : 2 * place + 2] = given[name]
        return out

    def test_a_distance_lies_in_the_models_up_to_rounding(self):
        model = self.ranges(distance=(0.2, 0.8))
        for low, high, agrees in ((0.2, 0.8, True), (0.1999, 0.8, False), (0.2, 0.8001, False), (0.3, 0.4, True)):
            data = self.ranges(distance=(low, high))
            assert bool(entry(data, model, False, 0.0, 0.0, self.only(0))) == agrees
            assert entry(data, model, False, 0.0, 0.0, self.only(1)) != 0, 'only what is asked for counts'

    def test_on_one_edge_a_pair_is_as_long_as_the_edge_and_its_slack(self):
        data, model = self.ranges(distance=(0.0, 0.61)), self.ranges()
        assert entry(data, model, True, 0.6, 0.011, self.only(0)) and not entry(
            data, model, True, 0.6, 0.009, self.only(0)
        )

    def test_an_angle_tells_whether_signs_are_the_same(self):
        for angle, code in ((1.0, SAME), (np.pi - 1.0, DIFFERENT), (0.5, 0)):
            data = self.ranges(angle=(angle + 0.1, angle - 0.1))
            for model_angle in (0.9, 1.0, 1.1):
                found = entry(data, self.ranges(angle=(model_angle, model_angle)), False, 0.0, 0.0, self.only(1))
                assert found & (SAME | DIFFERENT) == code if code else found == 0
        right = entry(self.ranges(angle=(1.58, 1.56)), self.ranges(angle=(1.57, 1.57)), False, 0.0, 0.0, self.only(1))
        assert right & SAME and right & DIFFERENT

    @pytest.mark.parametrize(('place', 'name'), [(2, 'first'), (3, 'second')])
    def test_pieces_of_one_edge_that_are_clear_of_each_other_lie_on_one_line(self, place, name):
        model = self.ranges()
        aside, along = self.ranges(**{name: (1.2, 1.1)}), self.ranges(**{name: (0.01, -0.01)})
        assert not entry(aside, model, True, 1.0, 0.1, self.only(place))
        assert entry(along, model, True, 1.0, 0.1, self.only(place))
        assert entry(self.ranges(**{name: (np.pi + 0.01, 3.1)}), model, True, 1.0, 0.1, self.only(place))
        assert entry(aside, model, True, 1.0, 0.3, self.only(place)), 'nearer than their errors they tell nothing'
        assert entry(aside, model, True, 1.0, 0.1, self.only(4)), 'where it is not asked for it tells nothing'

    @pytest.mark.parametrize(
        ('place', 'name', 'plus', 'minus'), [(2, 'first', A_PLUS, A_MINUS), (3, 'second', B_PLUS, B_MINUS)]
    )
    def test_a_direction_tells_the_sign(self, place, name, plus, minus):
        model = self.ranges(**{name: (0.5, 1.0)})
        for (low, high), code in (
            ((0.5, 1.0), plus),
            ((np.pi - 1.0, np.pi - 0.5), minus),
            ((0.4, 1.0), 0),
            ((0.5, 1.1), 0),
            ((np.pi - 1.1, np.pi - 0.5), 0),
        ):
            found = entry(self.ranges(**{name: (low, high)}), model, False, 0.0, 0.0, self.only(place))
            assert found & (plus | minus) == code if code else found == 0
