"""The machine: word lengths, bit-planes, mappings, arrays and counters."""

import gc
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dap_emulator import CONSTANTS, Dap, Layout, OutOfStore
from dap_emulator.machine import planes
from dap_emulator.machine.kinds import integer, kind_of, parse_kind, real

SIZES = st.sampled_from([1, 31, 32, 33, 65])
FEW = settings(max_examples=30, deadline=None)


# Word lengths.


@given(st.integers(1, 8), st.lists(st.integers(-(2**70), 2**70), min_size=1, max_size=9))
@FEW
def test_integers_wrap_in_their_word(length, numbers):
    kind = integer(length)
    size = 1 << (8 * length)
    expected = [(n + size // 2) % size - size // 2 for n in numbers]
    assert [kind.scalar(n) for n in numbers] == expected


@pytest.mark.parametrize('length', [1, 3, 5, 8])
def test_integer_arithmetic_overflows_as_the_word_does(dap, length):
    kind = integer(length)
    low, high = kind.range
    a = dap.vector(np.array([high, low, high, -7], dtype='i8'), kind)
    b = dap.vector(np.array([1, -1, high, 2], dtype='i8'), kind)
    assert (a + b).values.tolist() == [low, high, kind.scalar(2 * high), -5]
    assert (a * b).values.tolist() == [kind.scalar(x * y) for x, y in ((high, 1), (low, -1), (high, high), (-7, 2))]
    assert (a / b).values.tolist() == [high, kind.scalar(-low), 1, -3]


@given(st.sampled_from([3, 4, 5, 6, 7, 8]), hnp.arrays(np.float64, 8, elements=st.floats(-1e6, 1e6)))
@FEW
def test_reals_keep_their_bits_of_significand(length, values):
    kind = real(length)
    got = kind.convert(values).astype(float)
    error = np.abs(got - values) / np.where(values == 0, 1, np.abs(values))
    assert (error[np.abs(values) > 1e-30] <= 2.0**-kind.mantissa).all()
    assert np.array_equal(kind.convert(got).astype(float), got)


def test_a_scalar_must_fit_the_array_it_meets(dap):
    a = dap.vector(np.ones(3, dtype='i1'))
    with pytest.raises(ValueError, match=r'300 does not fit INTEGER\*1'):
        _ = a + 300
    assert (a + 0.5).kind == real(4)


@pytest.mark.parametrize('text', ['REAL*2', 'REAL*9', 'INTEGER*0', 'INTEGER*9', 'COMPLEX', 'LOGICAL*4'])
def test_word_lengths_that_do_not_exist_are_refused(text):
    with pytest.raises(ValueError, match=re.escape(text)):
        parse_kind(text)


def test_numpy_types_keep_their_values():
    assert [str(kind_of(np.zeros(1, t))) for t in ('?', 'u1', 'i1', 'i4', 'f4', 'f8')] == [
        'LOGICAL',
        'INTEGER*2',
        'INTEGER*1',
        'INTEGER*4',
        'REAL*4',
        'REAL*8',
    ]


def test_division_by_zero_is_zero_and_counted(dap):
    assert (dap.vector([4, 5, 0]) / dap.vector([2, 0, 0])).values.tolist() == [2, 0, 0]
    assert dap.faults == 2


# Bit-planes.


@given(hnp.arrays(np.bool_, st.integers(1, 200)))
@FEW
def test_planes_pack_and_unpack(flags):
    words = planes.pack(flags)
    assert np.array_equal(planes.unpack(words, len(flags)), flags)
    assert planes.count_true(words) == flags.sum() and (words & ~planes.ones(len(flags))).sum() == 0


def test_the_table_agrees_with_the_micro_operations():
    """Two levels checked against each other: a plane's two loads and one store make the 3n of an addition."""
    dap = Dap.model('510', level='apal', costs={'overhead_apal': 0})
    a = dap.matrix(np.ones((32, 32), 'i2'))
    dap.reset()
    _ = a + a
    per_plane = 2 * dap.costs['plane_access'] + dap.costs['plane_access']
    assert dap.cycles == a.kind.bits * per_plane


# Mappings.


@given(st.integers(1, 70), st.integers(1, 70), st.sampled_from(['sheet', 'crinkled', 'combined']))
@FEW
def test_every_element_has_its_own_place(rows, columns, mapping):
    layout = Layout((rows, columns), 32, mapping)
    values = np.arange(1, rows * columns + 1).reshape(rows, columns)
    blocks = layout.to_blocks(values)
    assert blocks.shape == (layout.blocks, 32, 32) and np.count_nonzero(blocks) == values.size
    assert np.array_equal(blocks[layout.places()], values)


def test_crinkled_neighbours_share_a_pe_and_sheet_neighbours_a_block():
    for mapping in ('sheet', 'crinkled'):
        block, row, column = Layout((64, 64), 32, mapping).places()
        same_pe = (row[:, :-1] == row[:, 1:]) & (column[:, :-1] == column[:, 1:])
        same_block = block[:, :-1] == block[:, 1:]
        assert same_pe.mean() > 0.45 if mapping == 'crinkled' else same_block.mean() > 0.95


def test_mappings_do_not_mix_and_can_be_changed(dap):
    a = dap.matrix(np.ones((64, 64), 'f4'), mapping='sheet')
    b = dap.matrix(np.ones((64, 64), 'f4'), mapping='crinkled')
    with pytest.raises(ValueError, match='remapped'):
        _ = a + b
    assert ((a + b.remapped('sheet')).values == 2).all()


# Arrays.


@given(hnp.arrays(np.float32, st.tuples(SIZES, SIZES), elements=st.floats(-100, 100, width=32)))
@FEW
def test_arrays_compute_what_numpy_computes(values):
    dap = Dap.model('510')
    a = dap.matrix(values)
    two = np.float32(2)
    assert np.array_equal((a * 2.0 - a / 4.0).values, values * two - values / np.float32(4))
    assert np.array_equal(((a > 1.0) & ~(a > 5.0) | (a < -2.0)).values, ((values > 1) & ~(values > 5)) | (values < -2))
    assert np.array_equal(a.neighbour(1, 1).values[:, :-1], values[:, 1:])
    assert not a.neighbour(1, 1).values[:, -1].any()
    assert np.array_equal(a.neighbour(-1, 0, cyclic=True).values, np.roll(values, 1, 0))


def test_remainders_powers_and_relations(dap):
    a, b = dap.vector(np.array([7, -7, 3], 'i2')), dap.vector(np.array([3, 3, 2], 'i2'))
    assert (a % b).values.tolist() == [1, -1, 1] and (a % 4).values.tolist() == [3, -3, 3]
    assert (a**2).values.tolist() == [49, 49, 9] and (+a) is a
    np.testing.assert_allclose((a**b).values, [343.0, -343.0, 9.0], rtol=1e-6)
    np.testing.assert_allclose((dap.vector(np.array([4.0, 9.0], 'f4')) ** 0.5).values, [2.0, 3.0], rtol=1e-6)
    flags, others = dap.vector(np.array([True, True, False])), dap.vector(np.array([True, False, False]))
    assert (flags == others).values.tolist() == [True, False, True]
    assert (flags != others).values.tolist() == [False, True, False]
    assert flags.astype('LOGICAL') is flags and np.asarray(a, 'f8').dtype == np.float64


def test_planes_and_places_can_be_looked_at(dap):
    flags, numbers = dap.vector(np.array([True, False, True])), dap.vector(np.array([1, 2, 3], 'i1'))
    assert flags.planes().tolist() == [[0b101]] and numbers.planes()[:2].tolist() == [[0b101], [0b110]]
    blocks = dap.layout(numbers.shape).to_blocks(numbers.values)
    assert blocks.shape == (1, 32, 32) and blocks.sum() == 6
    assert repr(numbers).splitlines()[0] == 'INTEGER*1 vector 3, 1 block(s)'


def test_assignments_convert_numbers_and_respect_the_mask(dap):
    a = dap.vector(np.zeros(3, 'f4'))
    a.assign(dap.vector(np.array([1, 2, 3], 'i2')), dap.vector(np.array([True, False, True])))
    a[1] = 5
    assert a.values.tolist() == [1.0, 5.0, 3.0]
    a[:] = 7.0
    assert a.values.tolist() == [7.0, 7.0, 7.0]


def test_misuse_names_what_is_wrong(dap):
    a, b = dap.matrix(np.ones((2, 2))), dap.matrix(np.ones((3, 3)))
    for action, text in (
        (lambda: a + b, 'shapes'),
        (lambda: bool(a), 'any'),
        (lambda: a & a, 'LOGICAL'),
        (lambda: dap.vector(np.ones((2, 2))), 'vector'),
        (lambda: dap.matrix(np.ones((0, 2))), 'element'),
        (lambda: a + Dap.model('510').matrix(np.ones((2, 2))), 'different machines'),
        (lambda: a.planes(), 'of a LOGICAL or INTEGER'),
        (lambda: a + (a > 0.0), 'expected numbers'),
        (lambda: -(a > 0.0), 'expected numbers'),
        (lambda: a.astype('LOGICAL'), 'MERGE'),
        (lambda: a.assign(True), 'cannot put True'),
        (lambda: a.neighbour(1, 2), 'axis'),
        (lambda: dap.vector(np.ones(3)).T, 'expected a matrix'),
        (lambda: Dap.model('720'), '510'),
        (lambda: Dap.model('510', mapping='odd'), 'sheet'),
        (lambda: Dap.model('510', costs={'speed': 1}), 'speed'),
    ):
        with pytest.raises(ValueError, match=text):
            action()
    with pytest.raises(IndexError, match='outside'):
        _ = a[2, 0]
    with pytest.raises(IndexError, match='2 whole numbers'):
        _ = a[0]


def test_store_is_taken_and_given_back():
    dap = Dap.model('510', memory_bits_per_pe=100)
    a = dap.matrix(np.ones((32, 32), 'f4'))
    assert dap.store.used == 32
    b = a + a
    assert dap.store.used == 64
    with pytest.raises(OutOfStore, match='asks for 128 bit-planes, 36 of 100 are free'):
        dap.matrix(np.ones((64, 64), 'f4'))
    del a, b
    gc.collect()
    assert dap.store.used == 0 and dap.store.peak == 64


# Counters.


def test_every_constant_has_a_source_and_a_confidence():
    for constant in CONSTANTS.values():
        assert constant.source.startswith(('[S]', '[D]', '[R]', '[E]', 'no source')) and constant.confidence
    assert 'computed' in Dap.model('510').costs.table()


def test_statistics_trace_and_reset(dap):
    a = dap.matrix(np.ones((40, 40), 'f4'))
    with dap.at_line(7):
        _ = a + a
    assert dap.stats().operations['add REAL*4'] == (1, 731 * 4)
    assert dap.stats().lines[7] == (1, 731 * 4)
    entry = dap.trace[-1]
    assert (entry.operation, entry.blocks, entry.cycles, entry.line) == ('add', 4, 2924, 7)
    assert 'computed, not simulated' in str(dap.stats()) and 'computed' in dap._repr_html_()
    dap.reset()
    assert dap.cycles == 0 and not dap.trace and not dap.stats().operations


def test_costs_can_be_overridden():
    dap = Dap.model('510', costs={'overhead_fortran': 0, 'copy': 1})
    a = dap.matrix(np.ones((32, 32), 'f4'))
    dap.reset()
    a.copy()
    assert dap.cycles == 32
