"""The twelve acceptance assertions of the research notes on the machine (section 7), with their tolerances.

Those from sources are strict; those that rest on an estimate say so.
"""

import numpy as np
import pytest
from scipy import ndimage

from dap_emulator import Dap, OutOfStore
from dap_emulator.machine import intrinsics as f
from dap_emulator.machine.apal import sobel
from dap_emulator.machine.kinds import bits

GAMMA_CLOCK = 33.3e-9


def rate(name, operation, kind):
    return Dap.model(name).rate(operation, kind)


def test_1_boolean_peak():
    assert Dap.model('510').boolean_rate == pytest.approx(10.24e9, rel=1e-12)
    assert Dap.model('610').boolean_rate == pytest.approx(40.96e9, rel=1e-12)
    assert Dap.model('510', clock_s=GAMMA_CLOCK).boolean_rate == pytest.approx(30.7e9, rel=0.02)
    assert Dap.model('610', clock_s=GAMMA_CLOCK).boolean_rate == pytest.approx(122.8e9, rel=0.02)


def test_2_store_bandwidth():
    assert Dap.model('510').store_rate == pytest.approx(1.28e9, rel=1e-12)
    assert Dap.model('610').store_rate == pytest.approx(5.12e9, rel=1e-12)
    assert Dap.model('510', clock_s=GAMMA_CLOCK).store_rate == pytest.approx(3.84e9, rel=0.02)
    assert Dap.model('610', clock_s=GAMMA_CLOCK).store_rate == pytest.approx(15.4e9, rel=0.02)


def test_3_highway_bandwidth():
    assert Dap.model('510').highway_rate == pytest.approx(40e6, rel=1e-12)
    assert Dap.model('510', clock_s=GAMMA_CLOCK).highway_rate == pytest.approx(120e6, rel=0.02)


def test_4_real_addition():
    for name, mflops in (('510', 14.0), ('610', 56.0)):
        dap = Dap.model(name)
        a = dap.matrix(np.ones((dap.es, dap.es), dtype='f4'))
        dap.reset()
        _ = a + a
        assert dap.seconds == pytest.approx(73.1e-6, rel=0.05)
        assert rate(name, 'add', 'REAL*4') / 1e6 == pytest.approx(mflops, rel=0.05)


def test_5_co_processors():
    assert rate('610C', 'add', 'REAL*4') == pytest.approx(560e6, rel=0.02)
    assert rate('610C', 'multiply', bits(8)) == pytest.approx(2.4e9, rel=0.02)
    assert rate('610C', 'add', 'REAL*4') / rate('510', 'add', 'REAL*4') == pytest.approx(40, abs=2)
    assert rate('510C', 'add', 'REAL*4') / rate('510', 'add', 'REAL*4') == pytest.approx(10, abs=1)


def test_6_icl_mode():
    add, multiply = (rate('ICL', operation, 'REAL*4') for operation in ('add', 'multiply'))
    assert 2 / (1 / add + 1 / multiply) == pytest.approx(20e6, rel=0.10)


def test_7_sobel_in_three_mappings():
    """The sheet constant is a fit and H an estimate; the combined case alone is a prediction."""
    image = np.random.default_rng(0).integers(0, 256, (512, 512)).astype(np.uint8)
    seconds, results = {}, {}
    for mapping in ('crinkled', 'combined', 'sheet'):
        dap = Dap.model('610', level='apal')
        results[mapping] = sobel(dap, image, mapping).values
        seconds[mapping] = dap.seconds
    assert seconds['sheet'] / seconds['crinkled'] == pytest.approx(3.33, rel=0.15)
    assert seconds['combined'] / seconds['crinkled'] == pytest.approx(2.04, rel=0.15)
    for mapping, thesis in (('crinkled', 2.4e-3), ('combined', 4.9e-3), ('sheet', 8.0e-3)):
        assert seconds[mapping] == pytest.approx(thesis, rel=0.20)
    wide = image.astype(int)
    expected = sum(abs(ndimage.sobel(wide, axis=axis, mode='constant')) for axis in (0, 1))
    assert all(np.array_equal(result, expected) for result in results.values())


def test_8_blocks():
    small, large = Dap.model('510'), Dap.model('610')
    assert [small.layout((n, n)).blocks for n in (32, 33)] == [1, 4]
    assert large.layout((65, 65)).blocks == 4
    for n, blocks in ((32, 1), (33, 4), (96, 9)):
        a = small.matrix(np.ones((n, n), dtype='f4'))
        small.reset()
        _ = a + a
        assert small.cycles == 731 * blocks


def test_9_masks_change_only_what_they_cover_and_never_the_time():
    dap = Dap.model('510')
    costs = set()
    for mask in (np.zeros((32, 32), bool), np.eye(32, dtype=bool), np.ones((32, 32), bool)):
        a, flags = dap.matrix(np.zeros((32, 32), 'f4')), dap.matrix(mask)
        dap.reset()
        a[flags] = 5.0
        costs.add(dap.cycles)
        assert np.array_equal(a.values, np.where(mask, 5.0, 0.0))
    assert len(costs) == 1


def test_10_store():
    dap = Dap.model('510')
    assert dap.memory_bytes == 16 * 2**20 and dap.store.planes == 131_072
    pairs = 512 * 511 // 2
    dap.store.take(pairs * dap.layout((32, 32)).blocks, 'pair tables of a model of 32 edges')
    assert dap.store.free == 256
    other = Dap.model('510')
    planes = pairs * other.layout((33, 33)).blocks
    assert planes == 523_264
    with pytest.raises(OutOfStore, match='523264 bit-planes, 131072 of 131072 are free'):
        other.store.take(planes, 'pair tables of a model of 33 edges')


def test_11_first_minimum_and_first_of_none():
    """The appendices as programs are tested in test_library.py."""
    dap = Dap.model('510')
    values = np.array([5, 2, 9, 2, 2], dtype='i4')
    assert f.eln(f.minp(dap.vector(values))) == int(np.argmin(values)) + 1
    assert f.eln(dap.vector(np.zeros(40, bool))) == 0
    assert f.eln(dap.matrix(np.zeros((33, 5), bool))) == 0
