"""The measure of stated errors itself: errors drawn from known covariances have squares of chi squared."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent / 'benchmarks'))
from normalised_errors import NormalisedErrors, add_axis, add_edges

from msgs_py import FeatureSet


def drawn(scale: float, count: int = 1500) -> tuple[FeatureSet, np.ndarray]:
    """Edges off by their covariances times scale, running either way, and the true ends of each."""
    rng = np.random.default_rng(4)
    true = rng.uniform(-0.1, 0.1, (count, 2, 3)) + [[0.0, 0.0, 0.5], [0.15, 0.0, 0.5]]
    mix = rng.normal(0.0, 2e-4, (count, 6, 6))
    off = scale * np.einsum('nij,nj->ni', mix, rng.normal(size=(count, 6))).reshape(count, 2, 3)
    covariance = mix @ mix.swapaxes(1, 2)
    found = FeatureSet.from_edges(true[:, 0] + off[:, 0], true[:, 1] + off[:, 1], covariance=covariance)
    turned = rng.random(count) < 0.5
    return found, np.where(turned[:, None, None], true[:, ::-1], true)


def test_true_covariances_have_a_mean_of_one_and_understated_ones_are_seen():
    for scale in (1.0, 2.0):
        found, lines = drawn(scale)
        errors = NormalisedErrors()
        add_edges(errors, found, lines, np.full(len(found), 1000.0))
        add_axis(errors, found, 0, lines[0])
        rows = {row[0]: row[1:] for row in errors.rows()}
        assert rows['ends of axes'][0] == rows['directions of axes'][0] == 1
        for name in ('ends, across their edge', 'both ends together', 'directions', 'corners'):
            count, mistaken, mean, median, inside = rows[name]
            assert count >= 1500
            assert median == pytest.approx(scale**2, rel=0.1), name
            if scale == 1.0:
                assert mean == pytest.approx(1.0, rel=0.06) and mistaken == 0.0, name
                assert inside == pytest.approx(0.95, abs=0.015), name
            else:
                assert inside < 0.75 and mistaken > 0.01, name
