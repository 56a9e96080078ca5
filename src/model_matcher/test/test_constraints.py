"""Exact ranges against dense sampling, and the promise that a true pairing is never pruned."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model_matcher import MatchParams, index_model
from model_matcher.closed_form.synthetic.scenes import MODELS, random_pose
from model_matcher.geometry.constraints import pair_ranges
from model_matcher.interpretation_tree.tables import build_tables, data_ranges, model_ranges
from model_matcher.model.index import data_tolerances, feature_rows
from msgs_py import FeatureSet


def row(mid, direction, half):
    direction = np.asarray(direction, float) / np.linalg.norm(direction)
    return np.array([*mid, *direction, half, np.nan, np.nan])


def ranges(a, b):
    out = np.zeros(11)
    pair_ranges(a, b, 0.0, 0.0, 0.0, 0.0, out)
    return out


def sampled(a, b, steps):
    """Smallest and largest of distance and the three angles over a grid of points on both segments."""
    s = np.linspace(-a[6], a[6], steps)
    t = np.linspace(-b[6], b[6], steps)
    p = a[:3] + s[:, None] * a[3:6]
    q = b[:3] + t[:, None] * b[3:6]
    return s, t, q[None] - p[:, None]


def angle(v, u):
    return np.arctan2(np.linalg.norm(np.cross(v, u), axis=-1), v @ u)


def refine(values, function, s, t, sign):
    """Polish the best grid value by ever finer grids about it."""
    at = np.unravel_index(np.argmin(sign * values), values.shape)
    best_s, best_t = s[at[0]], t[at[1]]
    step_s, step_t = s[1] - s[0], t[1] - t[0]
    best = values[at]
    for _ in range(40):
        ss = np.clip(best_s + step_s * np.linspace(-1, 1, 9), s[0], s[-1])
        tt = np.clip(best_t + step_t * np.linspace(-1, 1, 9), t[0], t[-1])
        grid = function(ss, tt)
        at = np.unravel_index(np.argmin(sign * grid), grid.shape)
        best_s, best_t, best = ss[at[0]], tt[at[1]], grid[at]
        step_s, step_t = 0.5 * step_s, 0.5 * step_t
    return best


@pytest.mark.parametrize('seed', range(60))
def test_ranges_agree_with_dense_sampling_to_1e_9(seed):
    rng = np.random.default_rng(seed)
    a = row(rng.uniform(-1, 1, 3), rng.normal(size=3), rng.uniform(0.1, 1.0))
    b = row(rng.uniform(-1, 1, 3), rng.normal(size=3), rng.uniform(0.1, 1.0) * (seed % 7 != 0))
    if seed % 5 == 0:
        b[3:6] = a[3:6]  # parallel
    if seed % 11 == 0:
        b[3:6] = np.cross(a[3:6], rng.normal(size=3))
        b[3:6] /= np.linalg.norm(b[3:6])
    out = ranges(a, b)

    def vectors(s, t):
        return (b[:3] + t[:, None] * b[3:6])[None] - (a[:3] + s[:, None] * a[3:6])[:, None]

    measures = {
        0: lambda s, t: np.linalg.norm(vectors(s, t), axis=-1),
        4: lambda s, t: angle(vectors(s, t), a[3:6]),
        6: lambda s, t: angle(vectors(s, t), b[3:6]),
    }
    normal = np.cross(a[3:6], b[3:6])
    assert bool(out[10]) == (np.linalg.norm(normal) > 1e-6)
    if out[10]:
        measures[8] = lambda s, t: angle(vectors(s, t), normal / np.linalg.norm(normal))
    s, t = np.linspace(-a[6], a[6], 201), np.linspace(-b[6], b[6], 201)
    for at, measure in measures.items():
        grid = measure(s, t)
        assert refine(grid, measure, s, t, 1) == pytest.approx(out[at], abs=1e-9), at
        assert refine(grid, measure, s, t, -1) == pytest.approx(out[at + 1], abs=1e-9), at
    assert out[2] == out[3] == pytest.approx(angle(a[3:6], b[3:6]), abs=1e-12)


@pytest.mark.parametrize(
    ('middle', 'half', 'direction1', 'direction2'),
    [
        ((0.3, 0.0, 0.0), 1.0, (0.0, np.pi), (0.0, np.pi)),  # across each other
        ((0.3, 1.0, 0.0), 1.0, (0.0, np.pi), (0.0, np.pi / 2)),  # an end on the other's middle
        ((-1.0, 1.0, 0.0), 1.0, (np.pi / 2, np.pi), (0.0, np.pi / 2)),  # an end on an end: a corner of a block
    ],
)
def test_directions_between_segments_that_touch(middle, half, direction1, direction2):
    """There is none where they touch; all others are in the range, and in the plane of the two lines."""
    a, b = row([0, 0, 0], [1, 0, 0], 1.0), row(middle, [0, 1, 0], half)
    expected = [*direction1, *direction2, np.pi / 2, np.pi / 2]
    out = ranges(a, b)
    assert out[0] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(out[4:10], expected, atol=1e-12)
    # Anywhere else they touch up to rounding, and the vector that is left has no direction either.
    for seed in range(5):
        pose = random_pose(np.random.default_rng(seed))
        moved = (row(pose.apply(one[:3]), pose.rotation @ one[3:6], one[6]) for one in (a, b))
        np.testing.assert_allclose(ranges(*moved)[4:10], expected, atol=1e-7)
    _, _, between = sampled(a, b, 41)
    between = between[np.linalg.norm(between, axis=-1) > 1e-6]
    for at, axis in ((4, a[3:6]), (6, b[3:6])):
        measured = angle(between, axis)
        assert measured.min() >= out[at] - 1e-9 and measured.max() <= out[at + 1] + 1e-9


def test_two_centres_at_one_place_may_have_any_direction_between_them():
    """Where there is no vector at all, nothing is said of its angles; where there is one, it has one angle."""
    a, b = row([0.1, 0.2, 0.3], [1, 0, 0], 0.0), row([0.1, 0.2, 0.3], [0, 1, 0], 0.0)
    np.testing.assert_allclose(ranges(a, b)[[0, 1, 4, 5, 6, 7]], [0.0, 0.0, 0.0, np.pi, 0.0, np.pi], atol=1e-12)
    b[:3] += [0.3, 0.4, 0.0]
    out = ranges(a, b)
    np.testing.assert_allclose(out[[0, 1]], 0.5)
    np.testing.assert_allclose(out[[4, 5, 6, 7]], np.arccos([0.6, 0.6, 0.8, 0.8]))


def test_two_edges_whose_normal_is_certain_are_on_no_parallel_pair():
    """direction3 alone tells a right angle from two parallel edges."""
    index = index_model(MODELS['l_shape']())
    parallel = np.abs(index.rows[:, 3:6] @ index.rows[:, 3:6].T) > 0.999
    data = index.features.select([0, int(np.flatnonzero(~parallel[0])[0])])
    params = MatchParams(constraints=('direction3',), fracdev=1e-9, overhang=0.0)
    assert not build_tables(index, data, params).match[0][parallel & ~np.eye(len(index), dtype=bool)].any()


def test_direction2_is_direction1_seen_from_the_other_segment():
    rng = np.random.default_rng(1)
    a, b = (row(rng.normal(size=3), rng.normal(size=3), 0.4) for _ in range(2))
    ab, ba = ranges(a, b), ranges(b, a)
    np.testing.assert_allclose(ab[6:8], [np.pi - ba[5], np.pi - ba[4]])


def test_error_cone_is_the_thesis_formula():
    data = FeatureSet.from_edges([[0, 0, 1]] * 2, [[0.1, 0, 1], [0.005, 0, 1]], err_par=0.005, err_per=0.005)
    found = data_tolerances(data, feature_rows(data), 1.0, MatchParams(fracdev=1e-6, max_cone_deg=90.0))
    np.testing.assert_allclose(found[:, 2], [np.arctan(0.01 / 0.09), np.pi / 2])


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(['l_shape', 'chipped_block', 'wedge', 'chair', 'cylinder_box', 'tubes']),
    st.integers(0, 10**6),
    st.floats(0.0, 2e-3),
)
def test_a_true_pairing_is_never_pruned_when_errors_are_inside_their_bounds(name, seed, error):
    """Fragments anywhere on their edges, end points moved by up to err_par along and err_per across."""
    rng = np.random.default_rng(seed)
    model = MODELS[name]()
    index = index_model(model)
    seen = model.transformed(random_pose(rng))
    n = 10
    origin = rng.integers(0, len(model), n)
    cut = np.sort(rng.uniform(0.0, 1.0, (n, 2)), axis=1)
    cut[:, 1] = np.maximum(cut[:, 1], cut[:, 0] + 0.3)
    cut -= np.maximum(cut[:, 1:] - 1.0, 0.0)
    start = seen.start[origin] + cut[:, :1] * seen.vectors[origin]
    end = seen.start[origin] + cut[:, 1:] * seen.vectors[origin]
    curve = model.kind[origin] == 1
    start[curve], end[curve] = seen.start[origin[curve]], seen.end[origin[curve]]
    for points in (start, end):
        along = seen.directions[origin]
        side = np.cross(along, rng.normal(size=(n, 3)))
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        moved = points + error * (rng.uniform(-1, 1, (n, 1)) * along + rng.uniform(-1, 1, (n, 1)) * side)
        points[~curve] = moved[~curve]
    flip = (rng.random(n) < 0.5) & ~curve
    start[flip], end[flip] = end[flip].copy(), start[flip].copy()
    data = FeatureSet(model.kind[origin], start, end, model.radii[origin], np.full(n, error), np.full(n, error))
    sign = np.where(flip, -1, 1)
    for signs in (True, False):
        tables = build_tables(index, data, MatchParams(signs=signs, fracdev=1e-9, overhang=0.0, max_cone_deg=90.0))
        assert tables.unary[np.arange(n), origin].all()
        assert len(tables.pairs) == n * (n - 1) // 2
        for p, (a, b) in enumerate(tables.pairs):
            code = int(tables.code[p, origin[a], origin[b]])
            assert code
            assert code & (1 if sign[a] == sign[b] else 2)
            assert code & (4 if sign[a] > 0 else 8)
            assert code & (16 if sign[b] > 0 else 32)


def test_type_masks_keep_edges_curves_and_axes_apart():
    model = MODELS['cylinder_box']()
    tables = build_tables(index_model(model), model, MatchParams())
    same = model.kind[:, None] == model.kind[None]
    assert not tables.unary[~same].any()
    assert len(tables.pairs) == len(model) * (len(model) - 1) // 2
    for p, (a, b) in enumerate(tables.pairs):
        assert not tables.code[p][~(same[a][:, None] & same[b][None])].any()


def test_fewer_constraints_leave_more_matches_and_each_prunes():
    model = MODELS['l_shape']()
    data = model.transformed(random_pose(np.random.default_rng(0)))
    index = index_model(model)
    every = build_tables(index, data, MatchParams()).sums.sum()
    for name in MatchParams().constraints:
        alone = build_tables(index, data, MatchParams(constraints=(name,))).sums.sum()
        without = tuple(other for other in MatchParams().constraints if other != name)
        assert every <= build_tables(index, data, MatchParams(constraints=without)).sums.sum()
        assert every < alone < 18 * 18 * len(data) * (len(data) - 1) / 2


def test_range_tables_have_the_documented_shapes():
    index = index_model(MODELS['wedge']())
    assert model_ranges(index).shape == (15, 15, 11)
    assert data_ranges(index.features, index.size, MatchParams()).shape == (105, 11)
