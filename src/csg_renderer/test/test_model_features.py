"""Edges of block solids straight from the tree: closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from csg_renderer import Solid, model_features
from msgs_py import FeatureKind, FeatureSet, Pose

L_SHAPE = Solid.block(-0.06, 0.02, -0.03) | Solid.block(-0.02, 0.06, -0.03)
CHIPPED = Solid.block(-0.09, 0.06, -0.04) & Solid.plane((-1.0, 1.0, -1.0), 0.17)


def cube(x: float, y: float, z: float) -> Solid:
    return Solid.block(1.0, 1.0, 1.0).transformed(Pose(np.eye(3), [x, y, z]))


def segments(features: FeatureSet) -> set[tuple[tuple[float, ...], ...]]:
    """Unordered end points, rounded to a nanometre."""
    return {
        tuple(sorted(tuple(float(x) + 0.0 for x in np.round(p, 9)) for p in pair))
        for pair in zip(features.start, features.end)
    }


def test_a_block_has_its_twelve_edges():
    edges = model_features(Solid.block(1.0, 2.0, 3.0))
    corners = {(x, y, z) for x in (0, 1) for y in (0, 2) for z in (0, 3)}
    wanted = {tuple(sorted((p, q))) for p in corners for q in corners if sum(a != b for a, b in zip(p, q)) == 1}
    assert segments(edges) == wanted


def test_l_shape_has_eighteen_edges_and_no_seam():
    outline = [(0, 0), (-0.06, 0), (-0.06, 0.02), (-0.02, 0.02), (-0.02, 0.06), (0, 0.06)]
    wanted = set()
    for (x0, y0), (x1, y1) in zip(outline, outline[1:] + outline[:1]):
        wanted |= {tuple(sorted(((x0, y0, z), (x1, y1, z)))) for z in (0, -0.03)}
        wanted.add(tuple(sorted(((x0, y0, -0.03), (x0, y0, 0)))))
    assert segments(model_features(L_SHAPE)) == segments(
        FeatureSet.from_edges([a for a, _ in wanted], [b for _, b in wanted])
    )
    assert len(model_features(L_SHAPE)) == 18


def test_chipped_block_has_fifteen_edges():
    edges = model_features(CHIPPED)
    assert len(edges) == 15
    chip = {(-0.07, 0.06, -0.04), (-0.09, 0.04, -0.04), (-0.09, 0.06, -0.02)}
    ends = {tuple(np.round(p, 9) + 0.0) for p in np.concatenate([edges.start, edges.end])}
    assert {tuple(np.round(p, 9)) for p in chip} <= ends


def test_eight_united_cubes_are_one_cube():
    united = Solid.empty()
    for x in range(2):
        for y in range(2):
            for z in range(2):
                united = united | cube(x, y, z)
    edges = model_features(united)
    assert len(edges) == 12
    np.testing.assert_allclose(edges.lengths, 2.0, atol=1e-9)


@pytest.mark.parametrize(
    ('solid', 'count'),
    [
        (cube(0, 0, 0) & cube(1, 0, 0), 0),  # they share a face only: regularised to nothing
        (cube(0, 0, 0) - cube(0, 0, 0), 0),
        (Solid.empty(), 0),
        (cube(0, 0, 0) | cube(1, 1, 0), 23),  # touching along an edge, which both have
        (cube(0, 0, 0) | cube(1, 1, 1), 24),  # touching in a corner
        (cube(0, 0, 0) | cube(1, 0.5, 0), 24),  # a step on both sides
        (cube(0, 0, 0) - Solid.block(0.5, 0.5, 0.5), 21),  # a corner taken out
        (cube(0, 0, 0) & Solid.plane((1, 1, 0), 2.0), 12),  # a half-space that touches an edge changes nothing
        (cube(0, 0, 0) & Solid.plane((1, 1, 0), 2.0 - 1e-4), 15),  # a sliver off that edge
        (cube(0, 0, 0) | Solid.block(1.0, 1.0, 1.0 + 1e-4), 12),  # a sliver on top
    ],
)
def test_counts_of_block_solids(solid, count):
    assert len(model_features(solid)) == count


def test_edges_follow_an_affine_map():
    matrix = np.array([[0.1, 0.03, 0.0, 5.0], [0.0, 0.2, 0.05, -3.0], [0.02, 0.0, -0.1, 1.0], [0, 0, 0, 1.0]])
    plain, mapped = model_features(L_SHAPE), model_features(L_SHAPE.transformed(matrix))
    assert len(mapped) == 18
    through = FeatureSet.from_edges(
        plain.start @ matrix[:3, :3].T + matrix[:3, 3], plain.end @ matrix[:3, :3].T + matrix[:3, 3]
    )
    assert segments(mapped) == segments(through)
    assert (mapped.kind == FeatureKind.EDGE).all()


def test_something_else_than_a_solid_is_refused():
    with pytest.raises(ValueError, match='solid'):
        model_features('box')
