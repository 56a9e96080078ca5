"""Files of heights, and the word TERRAIN that reads them: what they mean, where they lie, what is wrong with them."""

import json

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from csg_renderer import SceneError, Terrain, features_cli, load_models, load_scene, model_features, parse_scene, render
from csg_renderer.language import format_scene, read_scene
from csg_renderer.scene.height_files import read_heights
from msgs_py import PinholeCamera

HEADER = 'ncols 3\nnrows 2\nxllcorner 500\nyllcorner 800\ncellsize 30\nNODATA_value -9999\n'


@pytest.fixture
def folder(tmp_path):
    np.save(tmp_path / 'ground.npy', np.arange(12.0).reshape(3, 4))
    cv2.imwrite(str(tmp_path / 'ground.png'), (np.arange(12).reshape(3, 4) * 5957).astype(np.uint16))
    (tmp_path / 'ground.asc').write_text(HEADER + '1 2 3\n4 5 -9999\n')
    return tmp_path


def sheet(text, folder):
    (leaf,) = parse_scene(f'DRAW {text};', folder=folder).primitives
    assert isinstance(leaf, Terrain)
    return leaf


def test_sizes_and_heights_of_an_array(folder):
    ground = sheet('TERRAIN ("ground.npy", 60, 50, 2)', folder)
    assert np.array_equal(ground.heights, 0.002 * np.arange(12.0).reshape(3, 4)) and not ground.bilinear
    # Four columns, three rows: cells of 20 mm by 25 mm. The far corner, of the greatest height, is at (60, 50, 22) mm.
    assert ground.spacing == (0.02, 0.025)
    assert np.allclose(ground.matrix @ [3.0, 2.0, 0.022, 1.0], [0.06, 0.05, 0.022, 1.0])


def test_a_picture_is_the_right_way_round_from_above(folder):
    ground = sheet('TERRAIN ("ground.png", 3, 2, 11, BILINEAR)', folder)
    assert ground.bilinear and np.allclose(ground.heights[0], np.arange(8.0, 12.0) * 5957 / 65535 * 0.011)


def test_an_ascii_grid_says_its_size_and_leaves_cells_open(folder):
    ground = sheet('TERRAIN ("ground.asc")', folder)
    assert np.array_equal(ground.heights, [[4, 5, np.nan], [1, 2, 3]], equal_nan=True) and ground.spacing == (
        30.0,
        30.0,
    )
    assert ground.cells.tolist() == [[True, False]]
    assert sheet('TERRAIN ("ground.asc", 60, 30, 1) SCALE (2)', folder).matrix[0, 0] == 0.06
    # What stands in the file need not be tidy: one line, other case, Windows ends.
    (folder / 'loose.asc').write_bytes(b'NCOLS 3\r\nNROWS 2\r\nCELLSIZE 1e0\r\nnan 2\t3 4\r\n\r\n5 6')
    assert np.array_equal(read_heights(folder / 'loose.asc').heights[1], [np.nan, 2.0, 3.0], equal_nan=True)


def test_colours_by_height(folder):
    ground = sheet(
        'TERRAIN ("ground.npy", 3, 2, 1) PAINT HEIGHTS (0, 0, 0, 1,  5, 1, 1, 0) SCALE (3) AMBIENT (0.5)', folder
    )
    assert ground.tints.tolist() == [[0, 0, 0, 1], [0.005, 1, 1, 0]] and ground.surface.ambient == 0.5
    shades = sheet('TERRAIN ("ground.npy", 3, 2, 1) COLOUR (1, 0.5, 0) PAINT HEIGHTS', folder).tints
    assert shades[:, 0].tolist() == [0.0, 0.011] and shades[1, 1:].tolist() == [1, 0.5, 0] and shades[0, 1] < 0.5
    assert sheet('TERRAIN ("ground.npy", 3, 2, 1) PAINT HEIGHTS COLOUR (0.5)', folder).tints is None


def test_a_scene_with_terrains_prints_to_itself(folder):
    scene = parse_scene(
        'ground = TERRAIN ("ground.npy", 33, 17, 0.7, BILINEAR) COLOUR (0.1, 0.2, 0.3) PAINT HEIGHTS XROT (-70);'
        'DRAW ground UNION (BLOCK (1, 2, 3) REFLECT (0.5)) YROT (10) AT (1, 2, 300);'
        'DRAW TERRAIN ("ground.asc") SCALE (0.001) AS map;',
        folder=folder,
    )
    again = parse_scene(format_scene(scene), folder=folder)
    for one, other in zip(scene.primitives, again.primitives, strict=True):
        assert one.kind == other.kind and one.surface == other.surface and np.array_equal(one.matrix, other.matrix)
        if one.kind == 'TERRAIN':
            assert np.array_equal(one.heights, other.heights, equal_nan=True) and one.bilinear == other.bilinear
            assert np.array_equal(one.tints, other.tints) if one.tints is not None else other.tints is None
    with pytest.raises(ValueError, match='comes from no file'):
        format_scene(type(scene)(Terrain(np.zeros((2, 2)))))


def test_a_terrain_of_the_package_is_ground_and_no_model():
    scene = load_scene('hills')
    assert list(load_models('hills')) == ['tower', 'house', 'sea']
    camera = PinholeCamera.centred(32, 32, 700.0)  # one tile of the middle of the picture
    frame = render(scene, camera, engine='dap', levels=1)
    assert np.array_equal(frame.primitive_id, render(scene, camera).primitive_id)
    ground = next(index for index, leaf in enumerate(scene.primitives) if leaf.kind == 'TERRAIN')
    assert (frame.primitive_id == ground).mean() > 0.1


def test_facets_have_features_and_smooth_cells_have_none(folder, capsys):
    peak = np.zeros((3, 3))
    peak[1, 1] = 1.0
    np.save(folder / 'peak.npy', peak)
    (folder / 'scene.csg').write_text(
        'DRAW TERRAIN ("peak.npy", 20, 20, 10) AS peak; DRAW TERRAIN ("peak.npy", 20, 20, 10, BILINEAR) AS dome;'
        'DRAW BLOCK (1, 2, 3) AS box;'
    )
    assert features_cli.main([str(folder / 'scene.csg'), '-q', '-o', str(folder / 'out.json')]) == 0
    said = capsys.readouterr().out
    # Four sides of the rim and six creases to the peak; two corners are cut off, where the ground lies flat.
    assert 'peak: 12 edges, 0 curves, 0 axes' in said and 'box: 12 edges' in said
    assert 'dome: a terrain of bilinear cells, which has no straight edges' in said
    assert set(json.loads((folder / 'out.json').read_text())) == {'box', 'peak'}
    with pytest.raises(ValueError, match='a TERRAIN is a sheet'):
        model_features(parse_scene('DRAW TERRAIN ("peak.npy", 2, 2, 1);', folder=folder).solids[0])


def test_the_file_of_a_terrain_is_watched_like_any_of_the_scene(folder):
    (folder / 'scene.csg').write_text('DRAW TERRAIN ("ground.npy", 1, 1, 1) AT (0, 0, 5);')
    assert [path.name for path in read_scene(folder / 'scene.csg').files] == ['scene.csg', 'ground.npy']


@pytest.mark.parametrize(
    ('text', 'column', 'message'),
    [
        ('DRAW TERRAIN ("ground.npy");', 6, 'TERRAIN takes 3 numbers'),
        ('DRAW TERRAIN ("ground.asc", 1, 2);', 6, 'after an .asc file, or none, got 2'),
        ('DRAW TERRAIN ("none.npy", 1, 1, 1);', 6, "there is no file 'none.npy'"),
        ('DRAW TERRAIN ("../ground.npy", 1, 1, 1);', 6, 'lies outside the folder of the scene'),
        ('DRAW TERRAIN ("scene.txt", 1, 1, 1);', 6, 'expected a file of heights (.npy, .png, .asc)'),
        ('DRAW TERRAIN ("ground.npy", 1, -1, 1);', 6, 'dx and dy of a TERRAIN are numbers > 0'),
        ('DRAW TERRAIN ("ground.npy", 0, 1, 1);', 6, 'dx is zero'),
        ('DRAW TERRAIN (3, 1, 1);', 15, 'expected a "file name"'),
        ('DRAW TERRAIN ("ground.npy", 1, 1, 1, ROUND);', 38, "'ROUND' is not defined"),
        ('DRAW SPHERE (1) DIFFERENCE TERRAIN ("ground.npy", 1, 1, 1);', 6, 'takes no part in DIFFERENCE'),
        ('a = TERRAIN ("ground.npy", 1, 1, 1) UNION SPHERE (1); DRAW a INTERSECT a;', 60, 'no part in INTERSECT'),
        ('DRAW TERRAIN ("ground.npy", 1, 1, 1) PAINT FACES;', 38, 'PAINT HEIGHTS does'),
        ('DRAW SPHERE (1) PAINT HEIGHTS;', 17, 'PAINT HEIGHTS paints a TERRAIN'),
        ('DRAW TERRAIN ("ground.npy", 1, 1, 1) PAINT HEIGHTS (1, 2);', 38, 'takes a height, red, green, blue'),
        ('DRAW TERRAIN ("ground.npy", 1, 1, 1) PAINT HEIGHTS (1, 0, 0, 2);', 38, 'red, green, blue in 0..1'),
        ('DRAW TERRAIN ("ground.npy", 1, 1, 1) PAINT HEIGHTS (1, 0, 0, 0, 1, 1, 1, 1);', 38, 'rising heights'),
        ('DRAW TERRAIN ("broken.npy", 1, 1, 1);', 6, 'broken.npy: not a .npy file'),
        ('DRAW TERRAIN ("head.npy", 1, 1, 1);', 6, 'head.npy: not a .npy file'),
        ('DRAW TERRAIN ("cube.npy", 1, 1, 1);', 6, 'cube.npy: expected a two-dimensional array of numbers'),
        ('DRAW TERRAIN ("eight.png", 1, 1, 1);', 6, 'eight.png: expected a 16-bit grey PNG'),
        ('DRAW TERRAIN ("huge.png", 1, 1, 1);', 6, 'huge.png: 65536 x 65536 heights, at most 20000000'),
        ('DRAW TERRAIN ("empty.asc");', 6, 'empty.asc: line 1: not an ESRI ASCII grid, its header has no ncols'),
        ('DRAW TERRAIN ("word.asc");', 6, "word.asc: line 7, column 3: expected a height, got 'x2'"),
        ('DRAW TERRAIN ("few.asc");', 6, 'few.asc: expected 2 rows of 3 heights, found 5 heights'),
        ('DRAW TERRAIN ("key.asc");', 6, "key.asc: line 1, column 1: unknown word 'columns'"),
        ('DRAW TERRAIN ("holes.npy", 1, 1, 1);', 6, 'holes.npy: heights: no cell has a height at all four corners'),
    ],
)
def test_what_is_wrong_is_said_once_and_where(folder, text, column, message):
    (folder / 'scene.txt').write_text('1 2')
    (folder / 'broken.npy').write_bytes(b'no array')
    (folder / 'head.npy').write_bytes((folder / 'ground.npy').read_bytes().replace(b'}', b'('))
    np.save(folder / 'cube.npy', np.zeros((2, 2, 2)))
    np.save(folder / 'holes.npy', [[1.0, np.nan], [2.0, 3.0]])
    cv2.imwrite(str(folder / 'eight.png'), np.zeros((4, 4), np.uint8))
    # Only the head of a file that would unpack to eight gigabytes.
    (folder / 'huge.png').write_bytes(
        (folder / 'ground.png').read_bytes()[:16] + 2 * (1 << 16).to_bytes(4, 'big') + b'\x10\x00\x00\x00\x00'
    )
    (folder / 'empty.asc').write_text('')
    (folder / 'word.asc').write_text(HEADER + '1 x2 3\n4 5 6\n')
    (folder / 'few.asc').write_text(HEADER + '1 2 3\n4 5\n')
    (folder / 'key.asc').write_text(HEADER.replace('ncols', 'columns') + '1 2 3\n4 5 6\n')
    with pytest.raises(SceneError) as caught:
        parse_scene(text, 'scene.csg', folder)
    assert (caught.value.line, caught.value.column, len(caught.value.errors)) == (1, column, 1)
    assert message in caught.value.message


def test_terrains_written_again_and_again_do_not_fill_the_memory(folder, monkeypatch):
    monkeypatch.setattr('csg_renderer.language.includes.MAX_SCENE_HEIGHTS', 30)
    use = 'DRAW TERRAIN ("ground.npy", 1, 1, 1);'
    assert len(parse_scene(2 * use, folder=folder).primitives) == 2
    with pytest.raises(SceneError, match='more than 30 heights'):
        parse_scene(3 * use, folder=folder)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(suffix=st.sampled_from(['npy', 'png', 'asc']), cut=st.integers(0, 200), flips=st.lists(st.integers(0, 10**6)))
def test_damaged_files_are_read_or_refused_by_name(folder, suffix, cut, flips):
    whole = bytearray((folder / f'ground.{suffix}').read_bytes())
    for flip in flips:
        whole[flip // 256 % len(whole)] = flip % 256
    path = folder / f'damaged.{suffix}'
    path.write_bytes(bytes(whole[: len(whole) - cut % len(whole)]))
    try:
        assert read_heights(path).heights.ndim == 2
    except ValueError as error:
        assert str(error).startswith(str(path)) and len(str(error)) < 400
