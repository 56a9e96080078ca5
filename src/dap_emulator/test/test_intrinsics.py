"""Every intrinsic against a plain numpy oracle, at the sizes where blocks begin and end."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dap_emulator import Dap
from dap_emulator.fortran_plus import compile
from dap_emulator.fortran_plus.functions import FUNCTIONS
from dap_emulator.machine import intrinsics as f

SIZES = st.sampled_from([1, 31, 32, 33, 65])
SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(max_examples=15, deadline=None)


@st.composite
def arrays(draw, kind='integer', rank=None):
    """A numpy vector or matrix: few distinct integers (ties), reals, or logicals (often all or none)."""
    rank = rank or draw(st.sampled_from([1, 2]))
    shape = tuple(draw(SIZES) for _ in range(rank))
    rng = np.random.default_rng(draw(SEEDS))
    if kind == 'logical':
        return rng.random(shape) < draw(st.sampled_from([0.0, 0.02, 0.5, 1.0]))
    return rng.integers(-9, 10, shape).astype('i4') if kind == 'integer' else rng.normal(0, 3, shape).astype('f4')


def on(dap, values):
    return dap.matrix(values) if values.ndim == 2 else dap.vector(values)


def column_order(values):
    return values.flatten(order='F')


@given(arrays('real'))
@FEW
def test_elementwise_functions(values):
    dap = Dap.model('510')
    x = on(dap, values)
    with np.errstate(all='ignore'):
        for ours, theirs in (
            (f.exp, np.exp),
            (f.log, np.log),
            (f.sin, np.sin),
            (f.cos, np.cos),
            (f.tan, np.tan),
            (f.atan, np.arctan),
            (f.asin, np.arcsin),
            (f.acos, np.arccos),
            (f.sqrt, np.sqrt),
            (f.absolute, np.abs),
        ):
            assert np.allclose(ours(x).values, theirs(values), rtol=1e-6, equal_nan=True), ours.__name__
    assert np.array_equal(f.fix(x).values, np.trunc(values))
    assert np.array_equal(f.float_(f.fix(x)).values, np.trunc(values))
    assert np.array_equal(f.length(x, 8).values, values) and f.length(x, 3).kind.bits == 24
    assert np.allclose(f.atan2(x, 2.0).values, np.arctan2(values, 2))
    assert np.allclose(f.atan2(2.0, x).values, np.arctan2(2, values))


@pytest.mark.parametrize(('function', 'value'), [(f.exp, 1e9), (f.log, -1.0), (f.sqrt, -4.0), (f.acos, 2.0)])
def test_scalars_out_of_the_domain_give_no_exception(function, value):
    assert not math.isfinite(function(value))


@given(arrays(), SEEDS)
@FEW
def test_two_operands(a, seed):
    b = np.random.default_rng(seed).integers(-4, 5, a.shape).astype('i4')
    dap = Dap.model('510')
    x, y = on(dap, a), on(dap, b)
    assert np.array_equal(f.maximum(x, y, 3).values, np.maximum(np.maximum(a, b), 3))
    assert np.array_equal(f.minimum(2, x, y).values, np.minimum(np.minimum(2, a), b))
    assert np.array_equal(f.mod(x, y).values, np.where(b == 0, 0, np.fmod(a, np.where(b == 0, 1, b))))
    assert np.array_equal(f.mod(7, y).values, np.where(b == 0, 0, np.fmod(7, np.where(b == 0, 1, b))))
    assert np.array_equal(f.sign(x, y).values, np.where(b >= 0, abs(a), -abs(a)))
    mask = a > b
    assert np.array_equal(f.merge(x, y, on(dap, mask)).values, np.where(mask, a, b))
    assert np.array_equal(f.merge(x, -1, on(dap, mask)).values, np.where(mask, a, -1))
    assert (f.mod(-7, 3), f.mod(7.5, 2.0), f.sign(-3, 2), f.merge(1, 2, False)) == (-1, 1.5, 3, 2)


@given(arrays(), arrays('logical'))
@FEW
def test_reductions(values, flags):
    dap = Dap.model('510')
    x, l = on(dap, values), on(dap, flags)
    assert (f.all_(l), f.any_(l), f.sum_(l)) == (flags.all(), flags.any(), flags.sum())
    assert (f.maxv(x), f.minv(x), f.sum_(x)) == (values.max(), values.min(), values.sum())
    assert (f.maximum(x), f.minimum(x)) == (values.max(), values.min())
    assert np.array_equal(f.maxp(x).values, values == values.max())
    assert np.array_equal(f.minp(x).values, values == values.min())
    mask = values % 3 == 0
    m = on(dap, mask)
    if mask.any():
        chosen = values[mask]
        assert (f.maxv(x, m), f.minv(x, m), f.sum_(x, m)) == (chosen.max(), chosen.min(), chosen.sum())
        assert np.array_equal(f.minp(x, m).values, mask & (values == chosen.min()))
    else:
        assert (f.maxv(x, m), f.minv(x, m), f.sum_(x, m)) == (-(2**31), 2**31 - 1, 0)
        assert not f.any_(f.maxp(x, m))


@given(arrays('real'))
@FEW
def test_real_sums(values):
    assert np.isclose(f.sum_(on(Dap.model('510'), values)), values.astype(float).sum(), rtol=1e-4, atol=1e-3)


@given(arrays('logical'))
@FEW
def test_first_true_and_its_row_and_column(flags):
    dap = Dap.model('510')
    l = on(dap, flags)
    where = np.flatnonzero(column_order(flags))
    first = where[0] + 1 if len(where) else 0
    assert f.eln(l) == first
    expected = np.zeros(flags.size, bool)
    expected[first - 1 : first] = True
    assert np.array_equal(column_order(f.frst(l).values), expected if first else np.zeros(flags.size, bool))
    if flags.ndim == 2:
        row, column = ((first - 1) % flags.shape[0] + 1, (first - 1) // flags.shape[0] + 1) if first else (0, 0)
        assert (f.rown(l), f.coln(l)) == (row, column)


@given(arrays(rank=2), arrays(rank=1))
@FEW
def test_between_vectors_and_matrices(m, v):
    dap = Dap.model('510')
    x, y = dap.matrix(m), dap.vector(v)
    assert np.array_equal(f.sumr(x).values, m.sum(axis=0)) and np.array_equal(f.sumc(x).values, m.sum(axis=1))
    assert np.array_equal(f.sumr(dap.matrix(m > 0)).values, (m > 0).sum(axis=0))
    assert np.array_equal(f.matr(y, 5).values, np.tile(v, (5, 1)))
    assert np.array_equal(f.matc(y, 5).values, np.tile(v[:, None], (1, 5)))
    assert np.array_equal(f.matr(y).values, np.tile(v, (len(v), 1)))
    assert np.array_equal(f.tran(x).values, m.T) and np.array_equal(f.rev(y).values, v[::-1])
    assert np.array_equal(f.revr(x).values, m[::-1]) and np.array_equal(f.revc(x).values, m[:, ::-1])
    assert np.array_equal(f.vec(dap, x).values, column_order(m))
    assert np.array_equal(f.mat(dap, f.vec(dap, x), *m.shape).values, m)
    assert (f.mat(dap, 2.5, 3, 4).values == 2.5).all() and f.mat(dap, True).shape == (32, 32)
    assert f.vec(dap, 7, 40).values.tolist() == [7] * 40


@given(st.integers(-2, 70), st.integers(-2, 70), SIZES, SIZES)
@FEW
def test_patterns(i, j, rows, columns):
    dap = Dap.model('510')
    row, column = np.mgrid[1 : rows + 1, 1 : columns + 1]
    assert np.array_equal(f.row(dap, i, rows, columns).values, row == i)
    assert np.array_equal(f.col(dap, i, rows, columns).values, column == i)
    assert np.array_equal(f.rows_(dap, i, j, rows, columns).values, (row >= i) & (row <= j))
    assert np.array_equal(f.cols(dap, i, j, rows, columns).values, (column >= i) & (column <= j))
    assert np.array_equal(f.el(dap, i, rows).values, row[:, 0] == i)
    assert np.array_equal(f.els(dap, i, j, rows).values, (row[:, 0] >= i) & (row[:, 0] <= j))
    run = max(1, abs(i))
    assert np.array_equal(f.alt(dap, run, rows).values, (row[:, 0] - 1) // run % 2 == 1)
    assert np.array_equal(f.altr(dap, run, rows, columns).values, (row - 1) // run % 2 == 1)
    assert np.array_equal(f.altc(dap, run, rows, columns).values, (column - 1) // run % 2 == 1)
    assert np.array_equal(f.unit_diagonal(dap, rows, columns).values, row == column)
    assert np.array_equal(f.lower_triangle(dap, rows, columns).values, row >= column)
    assert np.array_equal(f.upper_triangle(dap, rows, columns).values, row <= column)
    assert np.array_equal(f.index_vector(dap, rows).values, row[:, 0])


@given(arrays(rank=2), arrays(rank=1), st.integers(0, 70))
@FEW
def test_shifts(m, v, distance):
    dap = Dap.model('510')

    def planar(values, axis, step):
        out = np.zeros_like(values)
        extent = values.shape[axis]
        for target in range(extent):
            source = target + step * distance
            if 0 <= source < extent:
                np.moveaxis(out, axis, 0)[target] = np.moveaxis(values, axis, 0)[source]
        return out

    for way, values, axis, step in (
        ('N', m, 0, 1),
        ('S', m, 0, -1),
        ('W', m, 1, 1),
        ('E', m, 1, -1),
        ('L', v, 0, 1),
        ('R', v, 0, -1),
    ):
        x = on(dap, values)
        assert np.array_equal(f.SHIFTS[f'SH{way}P'](x, distance).values, planar(values, axis, step)), way
        assert np.array_equal(f.SHIFTS[f'SH{way}C'](x, distance).values, np.roll(values, -step * distance, axis)), way


def test_misuse_names_the_function_and_what_it_expected():
    dap = Dap.model('510')
    m, v, l = dap.matrix(np.ones((2, 2))), dap.vector(np.ones(3)), dap.vector(np.ones(3, bool))
    for action, text in (
        (lambda: f.eln(v), 'ELN: expected LOGICAL'),
        (lambda: f.sumr(v), 'SUMR: expected a matrix'),
        (lambda: f.minp(l), 'MINP: expected numbers'),
        (lambda: f.matr(m), 'MATR: expected a vector'),
        (lambda: f.merge(v, m, l), 'MERGE: shapes'),
        (lambda: f.sum_(3), 'SUM: expected a parallel'),
        (lambda: f.mat(dap, v, 1, 2), 'do not fit'),
        (lambda: f.merge(v, l, l), 'do not mix'),
    ):
        with pytest.raises(ValueError, match=text):
            action()


def test_every_function_of_the_language_is_documented():
    for name, function in FUNCTIONS.items():
        assert function.least <= function.most, name
        assert len(function.doc) > 20, name
    for name in f.__all__:
        documented = getattr(f, name)
        assert name == 'SHIFTS' or len(documented.__doc__) > 20, name


def test_the_language_reaches_every_kind_of_function():
    source = """
ENTRY SUBROUTINE T(M, V, L, R, K)
  REAL M(,), V(), R(20)
  LOGICAL L(,)
  INTEGER K
  R(1) = MAXV(M)
  R(2) = SUM(SUMR(M))
  R(3) = FLOAT(ELN(M .GT. 2.0))
  R(4) = MAX(1.5, 2.5, 0.5)
  R(5) = SQRT(16.0) + ABS(-2.0)
  R(6) = SUM(MATR(V, 2))
  R(7) = FLOAT(ROWN(L)*100 + COLN(L))
  R(8) = SUM(SHNP(M) - M(+,))
  R(9) = SUM(TRAN(TRAN(M)) - M)
  R(10) = FLOAT(SUM(FRST(L) .OR. ROW(1, 3, 4)))
  R(11) = MAX(V) + MIN(V)
  R(12) = FLOAT(SIZE(M)*100 + SIZE(M, 2))
  R(13) = LENGTH(1.1, 3)
  R(14) = SUM(MAT(VEC(M), 3, 4) - M)
  K = FIX(ATAN2(0.0, -1.0)*100.0)
END
"""
    m = np.arange(12, dtype='f4').reshape(3, 4)
    v = np.array([1, 5, 2], dtype='f4')
    flags = np.zeros((3, 4), bool)
    flags[2, 1] = flags[0, 3] = True
    result = compile(source).run(Dap.model('510'), m=m, v=v, l=flags)
    assert result['R'][:12].tolist() == [11, 66, 2, 2.5, 6, 16, 302, 0, 0, 5, 6, 1204]
    assert result['R'][12] == pytest.approx(1.1, abs=1e-4) and result['R'][12] != np.float32(1.1)
    assert result['K'] == 314


def test_arrays_of_scalars_have_the_word_length_of_the_scalars():
    """They were REAL*4 and INTEGER*4 whatever the program had declared, and so were rounded."""
    from dap_emulator.fortran_plus import compile

    source = (
        'ENTRY SUBROUTINE F(A, B, C)\nREAL*8 A(*2,*2), B(*2), C(*2,*2), X\nINTEGER*8 N\n'
        'X = 1.0D0/3.0D0\nN = 5000000000\nA = MERGE(X, -X, MAT(.TRUE., 2, 2))\nB = VEC(X, 2)\n'
        'C = MAT(X, 2, 2) + LENGTH(FLOAT(MAT(N, 2, 2) - N), 8)\nEND'
    )
    result = compile(source).run(Dap.model('510'))
    assert {*result['A'].ravel(), *result['B'], *result['C'].ravel()} == {1 / 3}
