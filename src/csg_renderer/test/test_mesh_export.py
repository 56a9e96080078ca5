"""Meshes of solids. Without manifold3d, which does the cutting, it is its part that a stand-in plays."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from csg_renderer import Solid, Surface, Terrain, parse_scene
from csg_renderer.scene import mesh_export

trimesh = pytest.importorskip('trimesh')
_originals = count(1)


@dataclass
class Manifold:
    """Pieces side by side, and in ``text`` how they were combined; what is taken away or cut is only said."""

    text: str = 'nothing'
    pieces: list = field(default_factory=list)
    original: int = -1

    @staticmethod
    def cube(size):
        return Manifold('cube', [trimesh.creation.box(size).apply_translation(np.divide(size, 2))])

    @staticmethod
    def cylinder(height, low, high, segments):
        profile = [[0, 0], [low, 0], [high, height], [0, height]][not low :]
        return Manifold('cylinder' if low == high else 'cone', [trimesh.creation.revolve(profile, sections=segments)])

    @staticmethod
    def sphere(radius, segments):
        return Manifold('sphere', [trimesh.creation.uv_sphere(radius, (segments, segments))])

    def translate(self, by):
        return Manifold(self.text, [piece.copy().apply_translation(by) for piece in self.pieces])

    def transform(self, rows):
        return Manifold(
            self.text, [piece.copy().apply_transform(np.vstack([rows, [0, 0, 0, 1]])) for piece in self.pieces]
        )

    def as_original(self):
        number = next(_originals)
        for piece in self.pieces:
            piece.metadata['original'] = number
        return Manifold(self.text, self.pieces, number)

    def original_id(self):
        return self.original

    def __add__(self, other):
        return Manifold(f'({self.text} + {other.text})', self.pieces + other.pieces)

    def __sub__(self, other):
        return Manifold(f'({self.text} - {other.text})', self.pieces)

    def __xor__(self, other):
        return Manifold(f'({self.text} ^ {other.text})', self.pieces)

    def to_mesh64(self):
        Manifold.made = self.text
        whole = trimesh.util.concatenate(self.pieces) if self.pieces else trimesh.Trimesh(np.zeros((0, 3)))
        runs = np.cumsum([0] + [3 * len(piece.faces) for piece in self.pieces])
        return SimpleNamespace(
            tri_verts=whole.faces,
            vert_properties=whole.vertices,
            run_index=runs,
            run_original_id=[piece.metadata['original'] for piece in self.pieces],
        )


@pytest.fixture
def stand_in(monkeypatch):
    monkeypatch.setitem(sys.modules, 'manifold3d', SimpleNamespace(Manifold=Manifold))
    return Manifold


@pytest.mark.parametrize(
    ('solid', 'volume'),
    [
        (Solid.block(1, -2, 3), 6.0),
        (Solid.cylinder(1.0, (0, 2, 0)), 2 * np.pi),
        (Solid.cone(1.0, (3, 0, 0)), np.pi),
        (Solid.sphere(2.0), 32 / 3 * np.pi),
    ],
)
def test_a_primitive_is_where_and_as_large_as_the_solid(stand_in, solid, volume):
    vertices, faces, _ = mesh_export.mesh_of(solid, 256)
    assert abs(trimesh.Trimesh(vertices, faces).volume) == pytest.approx(volume, rel=1e-3)
    corners = solid.matrix @ np.array([0.5, 0.5, 0.5, 1.0])
    if solid.kind == 'BLOCK':
        np.testing.assert_allclose(vertices.mean(axis=0), corners[:3], atol=1e-12)


def test_operators_are_asked_for_in_the_order_of_the_tree(stand_in):
    block, ball, plane = Solid.block(1, 1, 1), Solid.sphere(1), Solid.plane((0, 0, 1), 0.0)
    mesh_export.mesh_of((block | ball) - (Solid.cone(1, (0, 0, 1)) & plane))
    assert stand_in.made == '((cube + sphere) - (cone ^ cube))'


def test_an_endless_plane_becomes_a_block_larger_than_everything_else(stand_in):
    vertices, _, _ = mesh_export.mesh_of(Solid.plane((0, 0, 1), 0.5) | Solid.sphere(3.0))
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    assert (low < -30.0).all() and (high[:2] > 30.0).all() and high[2] == pytest.approx(3.0, abs=0.01)


def test_faces_have_the_colours_of_the_primitives_they_come_from(stand_in):
    red, glass = Surface(colour=(1.0, 0.0, 0.0)), Surface(colour=(0.0, 0.0, 1.0), transparency=0.75)
    _, faces, colours = mesh_export.mesh_of(Solid.block(1, 1, 1).painted(red) | Solid.sphere(1).painted(glass), 8)
    assert len(faces) == len(colours) and colours[0].tolist() == [255, 0, 0, 255]
    assert colours[-1].tolist() == [0, 0, 255, 64]


@pytest.mark.parametrize('suffix', mesh_export.FORMATS)
def test_every_format_holds_every_object(stand_in, tmp_path, suffix):
    scene = parse_scene('UNITS M; DRAW BLOCK (1, 2, 3); DRAW BLOCK (1, 1, 1) AT (5, 0, 0);')
    file = tmp_path / 'new' / f'two{suffix}'
    assert mesh_export.export_mesh(scene, file) == 24
    assert abs(trimesh.load(file, force='mesh').volume) == pytest.approx(7.0, rel=1e-5)


def test_a_scene_of_nothing_is_not_written(stand_in, tmp_path):
    with pytest.raises(mesh_export.ExportError, match='nothing to write'):
        mesh_export.export_mesh(parse_scene('DRAW NULL;'), tmp_path / 'none.stl')
    assert not list(tmp_path.iterdir())


def test_a_terrain_is_exported_as_a_sheet_of_triangles_beside_solids():
    heights = np.array([[0.0, 0.0, 1.0], [0.0, 2.0, np.nan]])
    sheet = Terrain(heights, (0.5, 1.0), tints=[[0.0, 0.0, 0.0, 0.0], [2.0, 1.0, 1.0, 1.0]])
    vertices, faces, colours = mesh_export.mesh_of(
        Solid.block(1.0, 1.0, 1.0) | sheet, 8, SimpleNamespace(Manifold=Manifold)
    )
    box, ground = faces[:12], faces[12:]
    assert len(vertices) == 8 + 6 and vertices[box].max() == 1.0
    # One of the two cells is there: two triangles, upward, of heights 0, 0, 0 and 0, 2, 0.
    corners = vertices[ground]
    assert corners[:, :, 2].tolist() == [[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0.0).all()
    assert colours[12:].tolist() == [[0, 0, 0, 255], [85, 85, 85, 255]]
    with pytest.raises(ValueError, match='INTERSECT or DIFFERENCE'):
        mesh_export.mesh_of(Solid.block(1.0, 1.0, 1.0) - sheet, 8, SimpleNamespace(Manifold=Manifold))
