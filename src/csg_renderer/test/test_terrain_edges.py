"""Edges of facets, against the triangles of the sheet one by one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from csg_renderer import Terrain
from csg_renderer.features.terrain_edges import facet_edges

ANGLE = np.radians(30.0)
grids = arrays(
    np.float64,
    st.tuples(st.integers(2, 5), st.integers(2, 5)),
    elements=st.one_of(st.sampled_from([0.0, 0.5, 1.0, 2.0]), st.just(np.nan)),
)


def pieces(terrain):
    """Ends of every side of a triangle that is an edge: of the rim, or between triangles that turn by more."""
    vertices, triangles = terrain.mesh()
    sides = {}
    for corners in triangles.tolist():
        normal = np.cross(vertices[corners[1]] - vertices[corners[0]], vertices[corners[2]] - vertices[corners[0]])
        for k in range(3):
            key = tuple(sorted((corners[k], corners[k - 1])))
            sides.setdefault(key, []).append(normal / np.linalg.norm(normal))
    return [
        vertices[list(key)]
        for key, normals in sides.items()
        if len(normals) == 1 or np.arccos(np.clip(normals[0] @ normals[1], -1, 1)) > ANGLE
    ]


@settings(deadline=None)
@given(grids)
def test_edges_are_the_sharp_sides_of_triangles_joined_where_they_run_straight(heights):
    there = ~np.isnan(heights)
    if not (there[:-1, :-1] & there[:-1, 1:] & there[1:, :-1] & there[1:, 1:]).any():
        return
    terrain = Terrain(heights, (0.7, 1.1)).transformed([[1, 0.2, 0, 3], [0, 0, -1, 2], [0, 1, 0, 1], [0, 0, 0, 1]])
    expected, found = pieces(terrain), facet_edges(terrain, ANGLE)
    assert found.lengths.sum() == pytest.approx(sum(np.linalg.norm(b - a) for a, b in expected))
    assert len(found) <= len(expected)
    for a, b in expected:
        along, across = found.end - found.start, 0.5 * (a + b) - found.start
        part = (along * across).sum(axis=1) / (along**2).sum(axis=1)
        distance = np.linalg.norm(across - part[:, None] * along, axis=1)
        assert ((distance < 1e-9) & (part > 0) & (part < 1)).any()


def test_smooth_cells_are_refused_by_name():
    with pytest.raises(ValueError, match='bilinear cells have no straight edges'):
        facet_edges(Terrain(np.zeros((2, 2)), interpolation='bilinear'))
