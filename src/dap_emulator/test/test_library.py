"""The program library against serial references: image operators, the thesis' appendices, Mandelbrot, Life."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from dap_emulator import Dap
from dap_emulator.fortran_plus.examples import example
from dap_emulator.fortran_plus.library import load_program, program_names, summary

SIZES = st.sampled_from([1, 31, 32, 33, 65])
FEW = settings(max_examples=12, deadline=None)
SEEDS = st.integers(0, 2**32 - 1)


def run(name, entry=None, **arguments):
    return load_program(name).run(Dap.model('510'), entry, **arguments)


def picture(seed, rows, columns):
    return np.random.default_rng(seed).integers(0, 256, (rows, columns)).astype(np.int16)


def test_the_library_is_complete_and_says_what_each_program_does():
    wanted = {
        'roberts',
        'sobel',
        'laplacian_of_gaussian',
        'canny',
        'antialias',
        'csg_combine',
        'pairwise',
        'raycast',
        'sorts',
        'tree',
        'validate',
        'mandelbrot',
        'life',
    }
    assert set(program_names()) == wanted
    assert all(len(summary(name)) > 20 for name in wanted)
    with pytest.raises(ValueError, match='sobel'):
        load_program('no such program')


# Images.


@given(SEEDS, SIZES, SIZES)
@FEW
def test_roberts(seed, rows, columns):
    image = picture(seed, rows, columns)
    wide = np.pad(image.astype(float), ((0, 1), (0, 1)))
    expected = np.hypot(wide[:-1, :-1] - wide[1:, 1:], wide[:-1, 1:] - wide[1:, :-1])
    assert np.allclose(run('roberts', image=image)['RESULT'], expected, rtol=1e-6)


@given(SEEDS, SIZES, SIZES)
@FEW
def test_sobel(seed, rows, columns):
    image = picture(seed, rows, columns)
    gy, gx = (ndimage.sobel(image.astype(float), axis=axis, mode='constant') for axis in (0, 1))
    result = run('sobel', image=image)
    assert np.allclose(result['RESULT'], np.hypot(gx, gy), rtol=1e-6)
    assert np.allclose(result['ANGLE'], np.arctan2(gy, gx), atol=1e-6)


def smoothed(image, sigma):
    radius = int(3 * sigma + 0.5)
    weights = np.exp(-(np.arange(-radius, radius + 1) ** 2) / (2 * sigma**2))
    weights /= weights.sum()
    for axis in (0, 1):
        image = ndimage.convolve1d(image, weights, axis=axis, mode='constant')
    return image


def test_laplacian_of_gaussian_finds_the_border_of_a_disc():
    y, x = np.mgrid[:64, :64]
    disc = (200 * (np.hypot(x - 32, y - 31) < 15) + 20).astype(np.int16)
    edges = run('laplacian_of_gaussian', image=disc, sigma=1.5, contrast=2.0)['RESULT']
    inner = edges[4:-4, 4:-4]
    radius = np.hypot(x - 32, y - 31)[4:-4, 4:-4][inner]
    assert inner.sum() > 80 and (np.abs(radius - 14.5) < 1.6).all()
    laplacian = ndimage.convolve(smoothed(disc.astype(float), 1.5), [[0, 1, 0], [1, -4, 1], [0, 1, 0]], mode='constant')
    across = np.pad(laplacian, ((0, 0), (0, 1)))[:, 1:], np.pad(laplacian, ((0, 1), (0, 0)))[1:]
    expected = np.logical_or(*[(laplacian * other < 0) & (np.abs(laplacian - other) > 2.0) for other in across])
    assert (expected != edges).mean() < 0.002


def canny_serial(image, sigma, low, high):
    s = np.pad(smoothed(image.astype(float), sigma), 1)
    gx, gy = (s[1:-1, 2:] - s[1:-1, :-2]) / 2, (s[2:, 1:-1] - s[:-2, 1:-1]) / 2
    m = np.pad(np.hypot(gx, gy), 1)
    peak = np.zeros(image.shape, bool)
    for r, c in np.ndindex(*image.shape):
        here, dx, dy = m[r + 1, c + 1], gx[r, c], gy[r, c]
        if abs(dx) < 0.4142 * abs(dy):
            step = (1, 0)
        elif abs(dy) < 0.4142 * abs(dx):
            step = (0, 1)
        else:
            step = (1, 1) if dx * dy > 0 else (1, -1)
        peak[r, c] = (here >= m[r + 1 + step[0], c + 1 + step[1]]) and (here > m[r + 1 - step[0], c + 1 - step[1]])
    weak, strong = peak & (m[1:-1, 1:-1] > low), peak & (m[1:-1, 1:-1] > high)
    return ndimage.binary_propagation(strong, structure=np.ones((3, 3)), mask=weak)


def test_canny():
    rng = np.random.default_rng(4)
    image = np.zeros((40, 50))
    image[8:30, 10:35] = 120
    image[15:36, 25:44] = 200
    image = (image + rng.normal(0, 4, image.shape)).clip(0, 255).astype(np.int16)
    edges = run('canny', image=image, sigma=1.2, low=8.0, high=20.0)['RESULT']
    expected = canny_serial(image, 1.2, 8.0, 20.0)
    assert expected.sum() > 100 and (edges != expected).sum() <= 2


# Appendix A.


@given(SEEDS, SIZES, st.booleans())
@FEW
def test_anti_alias_weighting(seed, size, smooth):
    rng = np.random.default_rng(seed)
    color = rng.uniform(-50, 400, (size, size, 9)).astype('f4')
    dist = rng.uniform(-1, 2, (size, size, 9)).astype('f4')
    weights = np.array([1, 2, 1, 2, 4, 2, 1, 2, 1]) / 16
    seen = np.where(dist <= 0, 30.0, color)
    expected = np.clip((seen * weights).sum(-1) if smooth else seen[:, :, 4], 0, 255)
    result = run('antialias', color=color, dist=dist, background=30.0, smoothed=smooth)['RESULT']
    assert np.allclose(result, expected, rtol=1e-5, atol=1e-4)


# Appendix B.


@st.composite
def trees(draw, most=5):
    """A tree in reverse Polish order: (operators, objects, number of primitives)."""
    leaves = draw(st.integers(1, most))
    operators, objects, depth, used = '', [], 0, 0
    while used < leaves or depth > 1:
        if used < leaves and (depth < 2 or draw(st.booleans())):
            used, depth = used + 1, depth + 1
            operators, objects = operators + '0', [*objects, used]
        else:
            operators, objects, depth = operators + draw(st.sampled_from('UID')), [*objects, 0], depth - 1
    return operators, objects, leaves


def inside_at(operators, objects, enter, leave, t):
    stack = []
    for operator, thing in zip(operators, objects):
        if operator == '0':
            stack.append(enter[thing - 1] < t < leave[thing - 1])
            continue
        right, left = stack.pop(), stack.pop()
        stack.append({'U': left or right, 'I': left and right, 'D': left and not right}[operator])
    return stack[0]


@given(trees(), SEEDS)
@FEW
def test_csg_combine(tree, seed):
    operators, objects, leaves = tree
    rng = np.random.default_rng(seed)
    shape = (3, 4)
    # All different, so that no two boundaries tie; some rays miss some primitives.
    times = rng.permutation(np.prod(shape) * 2 * leaves).reshape(*shape, 2, leaves).astype('f4') + 1
    enter, leave = times[:, :, 0], times[:, :, 1]
    result = run(
        'csg_combine',
        operators=operators,
        objects=objects,
        n=len(operators),
        leaves=leaves,
        **{'in': enter, 'out': leave},
    )
    for place in np.ndindex(*shape):
        ends = sorted(
            (t, k + 1)
            for k in range(leaves)
            if enter[place][k] < leave[place][k]
            for t in (enter[place][k], leave[place][k])
        )
        expected = next(
            ((t, k) for t, k in ends if inside_at(operators, objects, enter[place], leave[place], t + 0.5)), (1e30, 0)
        )
        assert (result['TVALUE'][place], result['OBJECT'][place]) == (np.float32(expected[0]), expected[1])


# Appendix C.


def feature_row(start, end):
    """Middle, unit direction, half length and two radii, which an edge has none of."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = np.linalg.norm(end - start)
    return [*(start + end) / 2, *(end - start) / length, length / 2, np.nan, np.nan]


def test_pairwise_tables_of_three_edges():
    """Two parallel edges one apart, and one across them: what each constraint tells (test_array_programs.py: more)."""
    edges = [((0, 0, 0), (1, 0, 0)), ((0, 1, 0), (1, 1, 0)), ((0, 0, 0.5), (0, 0, 3))]
    rows = np.array([feature_row(*edge) for edge in edges])
    pairs = all_pairs(3)

    def tables(*names):
        use = [name in names for name in ('distance', 'angle', 'direction1', 'direction2', 'direction3')]
        kinds = np.zeros(3, np.int32)
        result = run(
            'pairwise',
            model=rows,
            mkind=kinds,
            datum=rows,
            dkind=kinds,
            tolerance=np.full((3, 3), 1e-6),
            use=use,
            signed=False,
            datum1=pairs[:, 0],
            datum2=pairs[:, 1],
            pairs=3,
            items=3,
            edges=3,
        )
        assert np.array_equal(result['MATCHSUM'], result['MATCH'].sum(axis=(0, 1)))
        return [{(int(i), int(j)) for i, j in np.argwhere(result['MATCH'][:, :, p]) + 1} for p in range(3)]

    parallel, across = {(1, 2), (2, 1)}, {(1, 3), (2, 3), (3, 1), (3, 2)}
    same = {(1, 1), (2, 2), (3, 3)}
    assert tables('angle') == [parallel | same, across, across]
    # Edges 1 and 2 are 1 to sqrt(2) apart, 1 and 3 are 0.5 to sqrt(10), 2 and 3 sqrt(1.25) to sqrt(11); 3 is 2.5 long.
    assert tables('distance') == [parallel | {(1, 3), (3, 1), (3, 3)}, {(1, 3)}, {(2, 3)}]
    assert tables('distance', 'angle', 'direction1', 'direction2') == [parallel, {(1, 3)}, {(2, 3)}]


def all_pairs(items):
    return np.array([(a, b) for a in range(1, items + 1) for b in range(a + 1, items + 1)])


@given(SEEDS, st.integers(2, 11), st.integers(1, 30))
@FEW
def test_holder_buxton_sort_with_ties(seed, items, most):
    sums = np.random.default_rng(seed).integers(0, most, len(all_pairs(items)))
    order = run('sorts', 'HOLDER_BUXTON', matchsum=sums, n=len(sums))['ORDER']
    assert np.array_equal(order - 1, np.argsort(sums, kind='stable'))


@given(SEEDS, st.integers(2, 11), st.integers(1, 30))
@FEW
def test_combined_sort_with_ties(seed, items, most):
    pairs = all_pairs(items)
    sums = np.random.default_rng(seed).integers(0, most, len(pairs))
    order = run('sorts', 'COMBINED', matchsum=sums, datum2=pairs[:, 1], items=items, n=len(sums))['ORDER'] - 1
    first = int(np.argmin(sums))
    expected = [first]
    for item in range(2, items + 1):
        group = [p for p in range(len(pairs)) if pairs[p, 1] == item and p != first]
        leader = min(group, key=lambda p: sums[p], default=None)
        expected += [leader, *(p for p in group if p != leader)] if group else []
    assert order.tolist() == expected


@given(SEEDS, st.integers(2, 5), st.sampled_from([1, 2, 4, 33]), st.floats(0.1, 0.9))
@FEW
def test_tree_traversal_finds_every_interpretation(seed, items, edges, density):
    rng = np.random.default_rng(seed)
    pairs = all_pairs(items)
    match = rng.random((edges, edges, len(pairs))) < (density if edges < 30 else 0.02)
    order = rng.permutation(len(pairs))
    noi = 40

    def extend(assignment, level):
        if level == len(order):
            return [tuple(assignment)]
        a, b = pairs[order[level]] - 1
        found = []
        # ELN counts down the columns: the second item's edge is the outer loop.
        for j, i in np.argwhere(match[:, :, order[level]].T):
            if assignment[a] in (0, i + 1) and assignment[b] in (0, j + 1):
                after = list(assignment)
                after[a], after[b] = i + 1, j + 1
                found += extend(after, level + 1)
        return found

    expected = extend([0] * items, 0)[:noi]
    result = run(
        'tree',
        match=match,
        datum1=pairs[:, 0],
        datum2=pairs[:, 1],
        order=order + 1,
        bins=np.zeros(edges, bool),
        pairs=len(pairs),
        items=items,
        signed=False,
        most=0,
        noi=noi,
    )
    assert result['COUNT'] == len(expected)
    assert [tuple(column) for column in result['FOUND'].T[: len(expected)]] == expected


# Pictures of nothing but numbers.


def test_mandelbrot():
    result = run('mandelbrot', left=-2.0, top=-1.2, step=0.05, limit=20, count=np.zeros((48, 60), 'i2'))
    c = np.float32(-2.0) + np.float32(0.05) * np.arange(60) + 1j * (-1.2 + 0.05 * np.arange(48))[:, None]
    z, count = np.zeros_like(c), np.zeros(c.shape, int)
    for _ in range(20):
        alive = np.abs(z) <= 2.0
        count += alive
        z = np.where(alive, z * z + c, z)
    assert (result['COUNT'] != count).mean() < 0.01 and len(result.displays) == 20


@given(SEEDS, SIZES, st.integers(0, 4))
@FEW
def test_life(seed, size, generations):
    cells = expected = np.random.default_rng(seed).random((size, size)) < 0.4
    for _ in range(generations):
        rows = expected.astype(int) + np.roll(expected, 1, 0) + np.roll(expected, -1, 0)
        n = rows + np.roll(rows, 1, 1) + np.roll(rows, -1, 1) - expected
        expected = (n == 3) | (expected & (n == 2))
    assert np.array_equal(run('life', cells=cells, generations=generations)['CELLS'], expected)


def test_every_program_has_an_example():
    answers = {name: run(name, example(name).entry, **example(name).arguments) for name in program_names()}
    assert answers['tree']['COUNT'] == 10 and answers['pairwise']['MATCHSUM'].min() > 0
    assert answers['validate']['VALID'].tolist() == [True, False, True]
    seen = answers['raycast']['OBJECT']
    assert np.bincount(seen.ravel(), minlength=4).min() > 20
    assert (answers['raycast']['DEPTH'][seen == 0] == -1).all()
    with pytest.raises(ValueError, match='is not in the library'):
        example('nothing')
