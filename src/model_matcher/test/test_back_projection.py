"""Data that is compared with what its cell of the grid lists lies on what it would lie on of the whole model."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from model_matcher.geometry.back_projection import assign, fit_one
from model_matcher.geometry.features import DataFeatures, ModelFeatures
from model_matcher.model.index import index_model
from msgs_py import FeatureSet

IDENTITY = np.array([1.0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0])


def best_of_all(k: int, data: DataFeatures, model: ModelFeatures) -> tuple[int, float]:
    """Of all model features that on which data feature k lies best, and how well; -1 where there is none."""
    best, which = 2.0, -1
    for j in range(len(model.rows)):
        fit = fit_one(k, data, j, model, tuple(data.rows[k, :3]), tuple(data.rows[k, 3:6]), 1.0)
        if 0.0 <= fit < best:
            best, which = fit, j
    return which, best


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6))
def test_the_grid_hides_nothing(seed: int):
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-0.1, 0.1, (20, 3))
    index = index_model(FeatureSet.from_edges(starts, starts + rng.uniform(-0.08, 0.08, (20, 3))), 'twenty')
    widest = 0.02
    n = 40
    on = index.rows[rng.integers(0, 20, n)]
    along = on[:, 6] * rng.uniform(-1.2, 1.2, n)
    rows = np.zeros((n, 9))
    rows[:, :3] = on[:, :3] + along[:, None] * on[:, 3:6] + rng.normal(0.0, 0.006, (n, 3))
    turned = on[:, 3:6] + rng.normal(0.0, 0.05, (n, 3))
    rows[:, 3:6] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    rows[:, 6] = rng.uniform(0.001, 0.5, n) * on[:, 6]
    tolerances = np.stack(
        [rng.uniform(0.0005, widest, n), rng.uniform(0.0, 0.01, n), rng.uniform(0.02, 0.4, n)], axis=1
    )
    data = DataFeatures(rows, np.zeros(n, np.uint8), tolerances, 0.0)
    # Past its ends a feature is listed as far as beside it.
    model = index.prepared(float(np.hypot(widest, 0.01)))
    assignment, sign = np.zeros(n, np.int32), np.zeros(n, np.int8)
    assign(IDENTITY, model, data, 1.0, assignment, sign)
    for k in range(n):
        which, best = best_of_all(k, data, model)
        if assignment[k] != which:  # of two that fit as well either is right
            point, direction = tuple(rows[k, :3]), tuple(rows[k, 3:6])
            assert fit_one(k, data, int(assignment[k]), model, point, direction, 1.0) == best
