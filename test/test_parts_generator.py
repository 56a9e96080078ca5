"""The parts of the benchmark of large libraries are what csg_renderer makes of their solids."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent / 'benchmarks'))
from parts_generator import FAMILIES, part, parts

from csg_renderer import model_features
from msgs_py import FeatureKind, FeatureSet


def as_rows(features: FeatureSet) -> list[tuple[float, ...]]:
    """Features in millimetres, sorted, whichever way they run."""
    rows = []
    for kind, start, end, radii in zip(features.kind, 1e3 * features.start, 1e3 * features.end, 1e3 * features.radii):
        if kind == FeatureKind.CURVE:
            rows.append((float(kind), *start, *np.abs(end - start), radii[0]))
        else:
            rows.append((float(kind), *min(start.tolist(), end.tolist()), *max(start.tolist(), end.tolist()), 0.0))
    return sorted(tuple(np.round(row, 3) + 0.0) for row in rows)


@pytest.mark.parametrize('number', range(0, 48, 3))
def test_features_in_closed_form_are_those_of_the_solid(number):
    one = part(number)
    assert one.name.startswith(FAMILIES[number % len(FAMILIES)])
    np.testing.assert_allclose(as_rows(one.feature_set()), as_rows(model_features(one.solid())), atol=2e-3)


def test_a_seed_gives_the_same_parts_and_another_others():
    first, again, other = (dict(parts(8, seed)) for seed in (0, 0, 1))
    assert first == again and all(first[name] != other[name] for name in first)
    assert dict(parts(2, first=6)) == {name: first[name] for name in list(first)[6:]}
