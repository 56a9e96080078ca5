"""The pair test and the table entries at their limits: a hair inside passes, a hair outside does not."""

import numpy as np
import pytest

from model_matcher.geometry.constraints import (
    A_MINUS,
    A_PLUS,
    ANY_SIGN,
    B_MINUS,
    B_PLUS,
    DIFFERENT,
    SAME,
    consistent_signs,
    entry,
    ranges_of_pairs,
)
from model_matcher.geometry.pair_bounds import (
    ANGLE,
    FOOT_A,
    FOOT_B,
    FROM_A,
    FROM_B,
    MIDS,
    OFFSET,
    RELATION,
    SHIFT,
    SINE,
    margins_of,
    offset_slack,
    pair_fits,
    possible,
)
from msgs_py import FeatureKind

HAIR = 1e-7
HALVES = np.array([0.3, 0.2])
HALF_A, HALF_B = 0.25, 0.16
# Across, along, cone of the two data features.
TOLERANCES = np.array([[2e-3, 5e-3, 0.0], [3e-3, 7e-3, 0.0]])


def fits(data, model, cone=0.0):
    """The test on relations of which only some columns are given; both features have the cone."""
    rows = np.zeros((2, 9))
    rows[:, 6] = HALF_A, HALF_B
    tolerances = TOLERANCES.copy()
    tolerances[:, 2] = cone
    rels, model_rel = np.zeros((1, RELATION)), np.zeros((2, 2, RELATION))
    for column, value in data.items():
        rels[0, column] = value
    for column, value in model.items():
        model_rel[0, 1, column] = value
    return pair_fits(rels, 0, margins_of(rows, tolerances), 0, 1, HALVES, model_rel, 0, 1)


CROSSING = {ANGLE: 1.2, SINE: np.sin(1.2), OFFSET: 0.05, FOOT_A: 0.04, FOOT_B: 0.03, MIDS: 0.1}
STRAY = 2e-3 + 3e-3
SLIDE = STRAY / np.sin(1.2)
LIMITS = (
    (MIDS, 0.3 - HALF_A + 5e-3 + 0.2 - HALF_B + 7e-3 + STRAY),
    (OFFSET, STRAY),
    (FOOT_A, 0.3 - HALF_A + 5e-3 + SLIDE),
    (FOOT_B, 0.2 - HALF_B + 7e-3 + SLIDE),
)


@pytest.mark.parametrize(('column', 'limit'), LIMITS)
@pytest.mark.parametrize('way', [1.0, -1.0])
@pytest.mark.parametrize('feet', [1.0, -1.0])
def test_crossing_lines_may_differ_by_what_the_tolerances_leave(column, limit, way, feet):
    for beyond, expected in ((-HAIR, True), (HAIR, False)):
        data = dict(CROSSING)
        data[column] += way * (limit + beyond)
        # Of a line without direction both feet may be counted from the other side.
        data[FOOT_A], data[FOOT_B] = feet * data[FOOT_A], feet * data[FOOT_B]
        assert fits(data, CROSSING) is expected


@pytest.mark.parametrize(('column', 'limit'), LIMITS[1:])
@pytest.mark.parametrize('way', [1.0, -1.0])
@pytest.mark.parametrize('feet', [1.0, -1.0])
def test_lines_whose_angle_is_counted_from_the_other_side_have_the_other_offset_and_one_other_foot(
    column, limit, way, feet
):
    crossed = CROSSING | {ANGLE: np.pi - 1.2}
    for beyond, expected in ((-HAIR, True), (HAIR, False)):
        data = dict(crossed)
        data[column] += way * (limit + beyond)
        model = CROSSING | {OFFSET: -CROSSING[OFFSET], FOOT_A: feet * 0.04, FOOT_B: -feet * 0.03}
        assert fits(data, model) is expected
    assert not fits(crossed, CROSSING) and not fits(crossed, model | {FOOT_B: feet * 0.03, FOOT_A: feet * 0.2})


def test_both_feet_are_counted_from_one_side():
    wide = {FOOT_A: 0.2, FOOT_B: 0.15}
    for a, b in ((1, 1), (-1, -1), (1, -1), (-1, 1)):
        turned = {FOOT_A: a * 0.2, FOOT_B: b * 0.15}
        assert fits(CROSSING | wide, CROSSING | turned) is (a == b)


@pytest.mark.parametrize('way', [1.0, -1.0])
def test_the_angle_may_differ_by_both_cones(way):
    for beyond, expected in ((-HAIR, True), (HAIR, False)):
        turned = {ANGLE: 1.2 + way * (0.1 + beyond)}
        assert fits(CROSSING | turned, CROSSING, cone=0.05) is expected
        assert fits(CROSSING | turned, CROSSING | {ANGLE: np.pi - 1.2, OFFSET: -0.05, FOOT_B: -0.03}, 0.05) is expected


def test_a_normal_that_may_point_anywhere_decides_nothing():
    """Tilt is the sum of the two chords over the sine of the angle; from one on feet and offset are not looked at."""
    cone = 0.1
    at = 2.0 * 2.0 * np.sin(0.5 * cone)
    for sine, expected in ((at * (1 - HAIR), True), (at * (1 + HAIR), False)):
        assert fits(CROSSING | {SINE: sine, FOOT_B: 5.0}, CROSSING, cone) is expected


@pytest.mark.parametrize(('way', 'foot'), [(1.0, 0.4), (-1.0, 0.4), (1.0, 0.1)])
def test_offset_and_feet_have_the_room_that_a_tilt_makes(way, foot):
    cone, offset = 0.05, 0.2
    sine, cosine, chord = np.sin(cone), np.cos(cone), 2.0 * np.sin(0.5 * cone)
    tilt = 2.0 * chord / np.sin(1.2)
    # Beyond its end, a tilted line is off by the sine of its tilt.
    strays = STRAY + sine * (max(0.0, foot - HALF_A) + max(0.0, foot - HALF_B))
    room = strays + offset * (1.0 - np.sqrt(1.0 - tilt**2))
    slide = (strays + offset * tilt) / np.sin(1.2)
    data = CROSSING | {OFFSET: offset, FOOT_A: foot, FOOT_B: foot}
    for beyond, expected in ((-HAIR, True), (HAIR, False)):
        assert fits(data, data | {OFFSET: offset + way * (room + beyond)}, cone) is expected
        along = 0.3 - HALF_A * cosine + 5e-3 + (1.0 - cosine) * foot + slide + beyond
        assert fits(data, data | {FOOT_A: foot + way * along}, cone) is expected
        along = 0.2 - HALF_B * cosine + 7e-3 + (1.0 - cosine) * foot + slide + beyond
        assert fits(data, data | {FOOT_B: foot + way * along}, cone) is expected


@pytest.mark.parametrize('cone', [0.0, 0.1])
def test_parallel_lines_may_be_nearer_or_farther_by_their_strays(cone):
    shift, mids, between = 0.3, 0.3, 0.05
    strays_a = STRAY + np.sin(cone) * (shift - HALF_A)
    strays_b = STRAY + np.sin(cone) * (mids - HALF_B)
    model = {FROM_A: between, FROM_B: between, MIDS: mids}
    data = {FROM_A: between, FROM_B: between, SHIFT: shift, MIDS: mids}
    assert fits(data, model, cone)
    hair = 1e-5  # nearly parallel model lines are parallel up to less
    for column, strays in ((FROM_A, strays_a), (FROM_B, strays_b)):
        for beyond, expected in ((-hair, True), (hair, False)):
            assert fits(data | {column: (between + strays + beyond) / np.cos(cone)}, model, cone) is expected
            assert fits(data | {column: between - strays - beyond}, model, cone) is expected


@pytest.mark.parametrize('foot', [0.1, -0.4])
@pytest.mark.parametrize('cone', [0.0, 0.05])
def test_crossing_lines_slacken_by_both_strays_and_the_turn_of_their_normal(cone, foot):
    """Lemma 4; a foot beyond its end strays by the sine of the cone."""
    rel, rows = np.zeros(RELATION), np.zeros((2, 9))
    rel[[SINE, OFFSET, FOOT_A, FOOT_B]] = 0.8, -0.2, foot, -foot
    rows[:, 6] = HALF_A, HALF_B
    tolerances = TOLERANCES.copy()
    tolerances[:, 2] = cone, 2.0 * cone
    margins = margins_of(rows, tolerances)
    beyond = np.maximum([abs(foot) - HALF_A, abs(foot) - HALF_B], 0.0)
    strays = TOLERANCES[:, 0].sum() + beyond @ np.sin([cone, 2.0 * cone])
    tilt = 2.0 * (np.sin(0.5 * cone) + np.sin(cone)) / 0.8
    expected = strays + 0.2 * (1.0 - np.sqrt(1.0 - tilt**2))
    assert offset_slack(rel, margins, 0, 1) == pytest.approx(expected + 1e-9, abs=1e-12)
    # Where the chords of both cones reach the sine, the lines may be parallel.
    for share in (1.0 - HAIR, 1.0 + HAIR):
        rel[SINE] = share * tilt * 0.8
        assert np.isfinite(offset_slack(rel, margins, 0, 1)) == (share > 1.0 or cone == 0.0)


def test_a_feature_may_lie_on_one_of_its_kind_as_long_and_with_its_radii():
    data = np.zeros((1, 9))
    model = np.zeros((1, 9))
    kinds = np.array([FeatureKind.EDGE], np.uint8)
    data[0, 6], tolerances = 0.1, np.array([[1e-3, 2e-3, 0.2]])
    for beyond, expected in ((HAIR, True), (-HAIR, False)):
        model[0, 6] = 0.1 * np.cos(0.2) - 2e-3 + beyond
        assert possible(data, kinds, tolerances, model, kinds, 0.01).item() is expected
    model[0, 6] = 1.0
    curve = np.array([FeatureKind.CURVE], np.uint8)
    assert not possible(data, kinds, tolerances, model, curve, 0.01).item()
    data[0, 7:], model[0, 7:] = (0.05, 0.03), (0.05, 0.03)
    for column in (7, 8):
        for way in (1.0, -1.0):
            for beyond, expected in ((-HAIR, True), (HAIR, False)):
                other = model.copy()
                other[0, column] += way * (0.01 + 1e-3 + beyond)
                assert possible(data, curve, tolerances, other, curve, 0.01).item() is expected
    model[0, 7:] = 9.0
    assert possible(data, kinds, tolerances, model, kinds, 0.01).item(), 'radii are those of curves'


# -- table entries: distance, angle (high first), directions from a and b, along the normal; whether there is one --

DATA = np.array([1.1, 1.4, 0.8, 0.6, 0.5, 0.7, 1.0, 1.2, 0.3, 0.4, 1.0])
MODEL = np.array([1.0, 1.5, 0.7, 0.7, 0.4, 0.8, 0.9, 1.3, 0.2, 0.5, 1.0])
ALL = np.ones(5, bool)


def agrees(changes=None, model=None, one_edge=False, length=1.5, slack=0.05, use=ALL):
    data, of_model = DATA.copy(), MODEL.copy()
    for column, value in (changes or {}).items():
        data[column] = value
    for column, value in (model or {}).items():
        of_model[column] = value
    return entry(data, of_model, one_edge, length, slack, use)


def only(*constraints):
    use = np.zeros(5, bool)
    use[list(constraints)] = True
    return use


def test_room_for_ranges_has_their_columns():
    assert ranges_of_pairs(3, 2).shape == (3, 2, 11)


def test_ranges_well_inside_agree_with_one_pair_of_signs():
    assert agrees() == SAME | A_PLUS | B_PLUS
    assert agrees(use=only()) == ANY_SIGN


@pytest.mark.parametrize('column', [0, 1])
def test_a_distance_lies_in_the_models_range_up_to_rounding(column):
    way = 1 if column else -1
    for beyond, expected in ((0.0, True), (5e-10, True), (HAIR, False)):
        assert bool(agrees({column: MODEL[column] + way * beyond}, use=only(0))) is expected


def test_two_pieces_of_one_edge_are_no_longer_than_it_together():
    for beyond, expected in ((0.0, True), (HAIR, False)):
        assert bool(agrees({1: 1.5 + 0.05 + beyond}, one_edge=True, use=only(0))) is expected


@pytest.mark.parametrize(('angle', 'sign'), [(0.7, SAME), (np.pi - 0.7, DIFFERENT)])
def test_an_angle_tells_whether_both_run_the_same_way(angle, sign):
    assert agrees(model={2: angle}, use=only(1)) & (SAME | DIFFERENT) == sign
    for column, way in ((2, -1), (3, 1)):  # high is let down to the angle, low up to it
        limit = 0.7 if sign == SAME else np.pi - angle
        for beyond, expected in ((0.0, sign), (5e-10, sign), (HAIR, 0)):
            code = agrees({column: limit + way * beyond}, model={2: angle}, use=only(1))
            assert code & (SAME | DIFFERENT) == expected


@pytest.mark.parametrize(('first', 'plus', 'minus', 'which'), [(4, A_PLUS, A_MINUS, 2), (6, B_PLUS, B_MINUS, 3)])
def test_directions_from_one_to_the_other_tell_each_sign(first, plus, minus, which):
    both = plus | minus
    assert agrees(use=only(which)) & both == plus
    turned = {first: np.pi - DATA[first + 1], first + 1: np.pi - DATA[first]}
    assert agrees(turned, use=only(which)) & both == minus
    for column, way in ((first, -1), (first + 1, 1)):
        for beyond, expected in ((5e-10, plus), (HAIR, 0)):
            code = agrees({column: MODEL[column] + way * beyond}, use=only(which))
            assert code & both == expected
            mirrored = {first: np.pi - DATA[first + 1], first + 1: np.pi - DATA[first]}
            mirrored[2 * first + 1 - column] = np.pi - MODEL[column] - way * beyond
            assert agrees(mirrored, use=only(which)) & both == (minus if expected else 0)


@pytest.mark.parametrize('which', [2, 3])
def test_two_clear_pieces_of_one_edge_see_each_other_along_it(which):
    along = {0: 1.0, 4: np.pi, 5: np.pi, 6: np.pi, 7: np.pi}
    assert agrees(along, one_edge=True, use=only(which)) == ANY_SIGN
    other = {0: 1.0, 4: 0.0, 5: 0.0, 6: 0.0, 7: 0.0}
    assert agrees(other, one_edge=True, use=only(which)) == ANY_SIGN
    first = 2 * which
    aside = along | {first: 0.5, first + 1: 1.0}
    assert agrees(aside, one_edge=True, use=only(which)) == 0
    assert agrees(aside | {0: 0.1}, one_edge=True, use=only(which)) == ANY_SIGN, 'they may touch: nothing is certain'
    assert agrees(aside, one_edge=True, use=only(5 - which)) == ANY_SIGN


def test_the_common_normal_tells_whether_both_run_the_same_way():
    signs = SAME | DIFFERENT
    assert agrees(use=only(4)) & signs == SAME
    assert agrees({8: np.pi - 0.4, 9: np.pi - 0.3}, use=only(4)) & signs == DIFFERENT
    assert agrees({8: 0.1}, use=only(4)) == 0
    assert agrees({9: 0.6}, use=only(4)) == 0
    assert agrees({8: np.pi - 0.4, 9: np.pi - 0.1}, use=only(4)) == 0
    assert agrees(model={10: 0.0}, use=only(4)) == 0, 'lines that cross are not parallel'
    assert agrees({10: 0.0}, use=only(4)) == ANY_SIGN, 'without a certain normal nothing is said'
    assert agrees({10: -1.0}, use=only(4)) == 0 and agrees(model={10: -1.0}, use=only(4)) == 0
    assert agrees({10: -1.0}, model={10: -1.0}, use=only(4)) == ANY_SIGN


def test_an_entry_without_a_sign_for_one_of_them_is_none():
    assert agrees({4: 0.0, 5: np.pi}, use=only(2)) == 0
    assert agrees({6: 0.0, 7: np.pi}, use=only(3)) == 0
    assert agrees({2: 0.1, 3: 0.0}, use=only(1)) == 0


@pytest.mark.parametrize(
    ('code', 'consistent'),
    [
        (SAME | A_PLUS | B_PLUS, True),
        (SAME | A_MINUS | B_MINUS, True),
        (SAME | A_PLUS | B_MINUS, False),
        (SAME | A_MINUS | B_PLUS, False),
        (DIFFERENT | A_PLUS | B_MINUS, True),
        (DIFFERENT | A_MINUS | B_PLUS, True),
        (DIFFERENT | A_PLUS | B_PLUS, False),
        (DIFFERENT | A_MINUS | B_MINUS, False),
        (A_PLUS | A_MINUS | B_PLUS | B_MINUS, False),
        (ANY_SIGN, True),
    ],
)
def test_signs_are_consistent_when_one_choice_of_both_satisfies_all(code, consistent):
    assert bool(consistent_signs(code)) is consistent
