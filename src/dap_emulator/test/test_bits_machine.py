"""A machine that computes on bit-planes beside one that computes in words: INTEGERs equal, REALs within a bit."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dap_emulator import Dap, fortran_plus
from dap_emulator.dap_cli import main
from dap_emulator.fortran_plus.examples import example
from dap_emulator.fortran_plus.library import load_program, program_names
from dap_emulator.machine import counted, intrinsics, moves
from dap_emulator.machine.apal import sobel
from dap_emulator.machine.kinds import LOGICAL, bits, integer, real
from dap_emulator.machine.mapping import Layout

f = intrinsics
FEW = settings(max_examples=15, deadline=None)


def in_both(act, **options):
    """What act returns on each machine, and the machines: words first."""
    machines = [Dap.model('510', arithmetic=arithmetic, **options) for arithmetic in ('words', 'bits')]
    return [act(dap) for dap in machines], machines


def plain(result):
    return result.values.tolist() if hasattr(result, 'values') else result


def assert_equal_results(results):
    for words, planes in zip(*results, strict=True):
        assert plain(words) == plain(planes)
        assert getattr(words, 'kind', None) == getattr(planes, 'kind', None)


def arithmetic(a, b):
    return [a + b, a - b, a * b, a / b, a % b, f.maximum(a, b), f.minimum(a, b)]


def relations(a, b):
    return [a < b, a <= b, a > b, a >= b, a == b, a.compare('ne', b)]


@pytest.mark.parametrize('kind', [integer(1), bits(8), bits(7, signed=True), bits(5)], ids=str)
def test_every_pair_of_short_integers(kind):
    low, high = kind.range
    values = np.arange(low, high + 1)
    a, b = (each.astype(kind.dtype) for each in np.meshgrid(values, values))

    def act(dap):
        x, y = dap.matrix(a, kind), dap.matrix(b, kind)
        return [*arithmetic(x, y), *relations(x, y), -x, abs(x), f.sign(x, y), x**3, x + 1, 1 - x]

    results, (words, planes) = in_both(act)
    assert_equal_results(results)
    assert words.cycles == planes.cycles and words.faults == planes.faults == 2 * values.size


@st.composite
def two_matrices(draw):
    kind = integer(draw(st.integers(2, 8)))
    shape = (draw(st.integers(1, 40)), draw(st.integers(1, 40)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    low, high = kind.range
    small = rng.integers(-9, 10, (2, *shape))
    wide = rng.integers(low, high, (2, *shape), endpoint=True, dtype=np.int64)
    return kind, np.where(rng.random((2, *shape)) < 0.5, small, wide), rng.random(shape) < 0.5


@given(two_matrices())
@FEW
def test_integers_of_every_length_are_the_same_bit_for_bit(given_matrices):
    kind, (a, b), mask = given_matrices

    def act(dap):
        x, y, m = dap.matrix(a, kind), dap.matrix(b, kind), dap.matrix(mask)
        masked, filled = x.copy(), y.copy()
        masked[m] = y
        filled[m] = 5
        filled[0, 0] = 7
        results = [*arithmetic(x, y), *relations(x, y), -x, abs(x), x**2, x + 3, f.merge(x, 1, m), f.sign(x, y)]
        results += [masked, filled, x[0, 0], f.maxv(x), f.minv(x, m), f.maxp(x, m), f.minp(y)]
        results += [f.sum_(x), f.sum_(x, m), f.sum_(m), f.sumr(x), f.sumc(x), f.sumr(m), f.sumc(m)]
        results += [x.T, f.revr(x), f.matr(f.sumr(x), 3), f.vec(dap, x), x.astype(integer(3)), x.astype(integer(8))]
        results += [x.neighbour(1, 0), x.neighbour(-3, 1, cyclic=True), f.eln(m), f.frst(m), f.any_(m), f.all_(m), ~m]
        return results

    results, (words, planes) = in_both(act)
    assert_equal_results(results)
    assert words.cycles == planes.cycles and words.faults == planes.faults and planes.counted_cycles > 0


def last_places(exact, kind):
    """The last bit of the machine's fraction and of the float's, beside a number: the documented difference."""
    power = -(-np.frexp(exact)[1] // 4)
    return np.ldexp(1.0, 4 * power - (kind.bits - 8)) + np.spacing(np.abs(exact.astype(kind.dtype))).astype(float)


@pytest.mark.parametrize('length', [3, 4, 5, 6, 7, 8])
def test_reals_are_within_the_last_bit_of_the_fast_ones(length):
    kind = real(length)
    rng = np.random.default_rng(length)
    # Numbers that both forms hold, so that one operation has the same operands.
    a, b = rng.integers(-(2**15), 2**15, (2, 33, 35)) / 2.0**8

    def act(dap):
        x, y = dap.matrix(a, kind), dap.matrix(b, kind)
        root, positive = f.sqrt(abs(x)), abs(x) + 1.0
        results = [x + y, x - y, x * y, x / y, root, f.maximum(x, y), f.sign(x, y), f.merge(x, 1.5, x > y), x * 0.375]
        return [*results, f.exp(x * 0.125), f.log(positive), f.sin(x), f.atan2(x, y), x.T, x.neighbour(1), x**2, -x]

    results, (words, planes) = in_both(act)
    for fast, slow in zip(*results, strict=True):
        # A float of 24 bits rounds the results of its longer functions itself.
        exact = fast.values.astype(float)
        assert (np.abs(slow.values - exact) <= 2 * last_places(exact, kind)).all()
    assert words.cycles == planes.cycles and planes.faults == 0
    relations_of_both, _ = in_both(lambda dap: relations(dap.matrix(a, kind), dap.matrix(b, kind)))
    assert_equal_results(relations_of_both)


def test_conversions_and_mixed_operands():
    whole, part = np.arange(-60, 60).reshape(10, 12), np.arange(-60, 60).reshape(10, 12) / 16

    def act(dap):
        i, x = dap.matrix(whole, integer(2)), dap.matrix(part, real(4))
        results = [
            f.fix(x),
            f.float_(i),
            (x * 100.0).astype(integer(1)),
            i * 0.5,
            f.sqrt(abs(i)),
            i / 7,
            f.sum_(f.fix(x)),
        ]
        return [*results, abs(i) ** 0.5, f.length(i, 1), f.maximum(i, 3), f.mod(x, 2.0) * 0.0]

    results, (words, planes) = in_both(act)
    for fast, slow in zip(*results, strict=True):
        np.testing.assert_allclose(plain(slow), plain(fast), rtol=4e-7, atol=0)
    assert words.cycles == planes.cycles


def test_truncation_and_the_longest_word_keep_what_a_float_loses():
    chopping = Dap.model('510', arithmetic='bits', rounding='chop')
    third = chopping.vector([1.0], 'REAL*4') / 3.0
    rounding = Dap.model('510', arithmetic='bits').vector([2.0], 'REAL*4') / 3.0
    assert third.cells.tolist() == [0x40555555] and rounding.cells.tolist() == [0x40AAAAAB]
    # 56 bits of fraction: moves within the machine do not lose what a float of 53 would.
    dap = Dap.model('510', arithmetic='bits')
    long = dap.vector([2.0**-56], 'REAL*8') + 0.5
    for moved in (long, f.rev(long), long.copy(), f.mat(dap, long, 1, 1), f.merge(long, 0.0, long > 0.0)):
        assert (moved - 0.5).values.ravel().tolist() == [2.0**-56]


def test_overflow_is_the_largest_number_and_read_as_infinity():
    dap = Dap.model('510', arithmetic='bits')
    x = dap.vector([1e70, 4.0, float('inf')], 'REAL*5')
    squares = x * x
    assert squares.values.tolist() == [float('inf'), 16.0, float('inf')] and dap.faults == 2
    assert (squares > 1e75).values.tolist() == [True, False, True]
    assert (squares - squares).values.tolist() == [0.0, 0.0, 0.0]
    with pytest.raises(ValueError, match=r'REAL\*4 on bit-planes: not-a-number'):
        dap.vector([1.0, float('nan')])
    with pytest.raises(ValueError, match=r'A: REAL\*4 on bit-planes: not-a-number'):
        fortran_plus.compile('REAL A()\nA = A + 1').run(dap, a=[1.0, float('nan')])


def test_planes_of_reals_are_those_of_the_machine():
    dap = Dap.model('510', arithmetic='bits')
    found = dap.vector([1.0, -1.0], 'REAL*4').planes()
    # 1 is 0.1 (hexadecimal) times 16: its fraction's plane 20 and the exponents 64 + 1; the sign is the last plane.
    assert [plane for plane in range(32) if found[plane, 0]] == [20, 24, 30, 31]
    assert found[31].tolist() == [0b10] and dap.vector([True, False]).planes().tolist() == [[1]]


# Cycles.


def test_blocks_repeat_the_instructions_and_masks_do_not_matter():
    dap = Dap.model('510', arithmetic='bits')
    for side, blocks in ((32, 1), (33, 4), (96, 9)):
        a = dap.matrix(np.ones((side, side), 'i2'))
        dap.reset()
        _ = a + a
        assert dap.counted == {'add INTEGER*2': blocks * (3 * 16 + 1)}
        for mask in (np.zeros((side, side), bool), np.ones((side, side), bool)):
            dap.reset()
            a[dap.matrix(mask)] = a
            assert dap.counted_cycles == blocks * (2 * 16 + 1)


def test_neighbours_are_counted_along_their_routes():
    one = Layout((32, 32), 32)
    for distance in (1, 3):  # load, a step for each place, store
        assert moves.neighbour(16, one, distance, 0, cyclic=False) == 16 * (distance + 2)
    assert moves.neighbour(16, one, 31, 0, cyclic=True) == 16 * 3  # round the edge it is one place
    # Sheets of 2 x 2 blocks: the upper two take from themselves and from below, with A; the lower two from themselves.
    assert moves.neighbour(16, Layout((64, 64), 32), 1, 0, cyclic=False) == 2 * (3 * 3 * 16 + 2)
    # Tiles of 2 x 2 elements a PE: one row of the tile is read where it lies, the other from the next PE.
    assert moves.neighbour(16, Layout((64, 64), 32, 'crinkled'), 1, 0, cyclic=False) == 2 * 16 * (2 + 3)
    assert moves.cycles('transpose', 16, one) == 2 * 16 * 32


def test_the_cost_table_is_tested():
    """Within 10 % for adding, subtracting and comparing; what differs is named in docs/dap.md, in these bounds."""
    found = {(row.name, str(row.kind)): row for row in counted.rows()}
    for length in (1, 2, 4, 8):
        n = 8 * length
        row = {
            name: found[name, f'INTEGER*{length}'] for name in ('a + b', 'a - b', 'a < b', 'a == b', 'a * b', 'copy')
        }
        for name in ('a + b', 'a - b', 'a < b', 'copy'):
            assert row[name].ratio == pytest.approx(1.0, abs=0.1)
        assert row['a == b'].counted == 3 * n + 2
        assert row['a * b'].counted == 2 * n + 1 + sum(3 * planes + 2 for planes in range(1, n))
        assert found['neighbour, 1 place', f'INTEGER*{length}'].counted == 3 * n
    for name, low, high in (('a + b', 1.7, 2.0), ('a * b', 1.5, 1.9), ('a / b', 1.3, 1.7), ('SQRT', 1.6, 2.3)):
        for length in (3, 4, 8):
            assert low < found[name, f'REAL*{length}'].ratio < high


def test_statistics_show_both_counts():
    dap = Dap.model('510', arithmetic='bits')
    a = dap.matrix(np.ones((8, 8), 'f4'))
    with dap.measured() as so_far:
        _ = a * a
    inside = so_far()
    assert inside.counted['multiply REAL*4'] == dap.counted_cycles > 0
    assert 'counted on the planes' in str(dap.stats()) and 'counted' not in str(Dap.model('510').stats())
    dap.reset()
    assert dap.counted_cycles == 0


# Programs.


def with_example(name):
    try:
        return bool(example(name))
    except ValueError:
        return False


@pytest.mark.parametrize('name', list(filter(with_example, program_names())))
def test_library_programs_run_on_bit_planes(name):
    given_example = example(name)

    def act(dap):
        return load_program(name).run(dap, given_example.entry, **given_example.arguments)

    results, (words, planes) = in_both(act)
    for key, value in results[0].items():
        fast, slow = np.asarray(value), np.asarray(results[1][key])
        if fast.dtype.kind == 'f':
            np.testing.assert_allclose(slow, fast, rtol=1e-5, atol=1e-5 * max(1.0, np.abs(fast).max()))
        else:
            assert np.array_equal(fast, slow), key
    assert words.cycles == planes.cycles


def test_statements_store_patterns_unchanged():
    source = """
      ENTRY SUBROUTINE T(A, B, D, R, S, M)
      REAL A(,), B(,,2), D(,), R(), S
      LOGICAL M(,)
      CHARACTER C
      B(,,1) = A
      B(,,2) = 0.5
      D = 0.0
      D(M) = A
      B(2,3,2) = S
      B(1,,2) = A(2,)
      R = A(,1)
      C = 'x'
      IF (C .EQ. 'x') S = A(3,1) + SUM(R)
      END
    """
    rng = np.random.default_rng(0)
    a, mask = rng.integers(-99, 99, (32, 32)) / 8.0, rng.random((32, 32)) < 0.5
    program = fortran_plus.compile(source)
    results, (words, planes) = in_both(lambda dap: program.run(dap, a=a, m=mask, s=2.25))
    for key, value in results[0].items():
        assert np.array_equal(np.asarray(value), np.asarray(results[1][key])), key
    assert words.cycles == planes.cycles and planes.counted_cycles > 0


def test_sobel_on_bit_planes_is_quick():
    """The aim is 10 s of this computer's time; it takes a thousandth of that."""
    image = np.random.default_rng(0).integers(0, 256, (32, 32)).astype(np.int16)
    started = time.process_time()
    results, _ = in_both(lambda dap: load_program('sobel').run(dap, image=image)['RESULT'])
    np.testing.assert_allclose(results[1], results[0], rtol=2e-6)
    images, machines = in_both(lambda dap: sobel(dap, image.astype(np.uint8)), level='apal')
    assert plain(images[0]) == plain(images[1]) and machines[1].counted_cycles > 0
    assert time.process_time() - started < 10


def test_the_command_computes_on_bit_planes_and_prints_the_comparison(capsys):
    assert main(['run', 'life', '--example', '--arithmetic', 'bits']) == 0
    assert 'counted on the planes' in capsys.readouterr().out
    assert main(['counted']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2].startswith('| a + b | 24 → 25 (1.04) | 48 → 49 (1.02) |')
    assert main(['run', 'life', '--example', '--rounding', 'chop']) == 2
    assert "rounding: 'chop' is of arithmetic='bits'" in capsys.readouterr().err


def test_what_cannot_be_is_refused_by_name():
    for options, text in (
        ({'arithmetic': 'serial'}, 'arithmetic: expected one of words, bits'),
        ({'arithmetic': 'bits', 'rounding': 'up'}, 'rounding: expected one of nearest, chop'),
    ):
        with pytest.raises(ValueError, match=text):
            Dap.model('510', **options)
    with pytest.raises(ValueError, match='model 610C computes on 8-bit co-processors'):
        Dap.model('610C', arithmetic='bits')
    with pytest.warns(FutureWarning, match="bit_serial=True is now arithmetic='bits'"):
        assert Dap.model('510', bit_serial=True).in_bits
    assert LOGICAL.bits == 1
