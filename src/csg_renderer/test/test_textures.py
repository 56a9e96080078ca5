"""TEXTURE, METAL, ENVIRONMENT and RADIUS in the language: what they mean, and what is wrong with a file."""

import zlib

import cv2
import numpy as np
import pytest

from csg_renderer import Environment, SceneError, Texture, parse_scene, render_cli
from csg_renderer.language import read_scene
from csg_renderer.scene import textures

PICTURE = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)


@pytest.fixture
def folder(tmp_path):
    cv2.imwrite(str(tmp_path / 'print.png'), PICTURE[..., ::-1])
    cv2.imwrite(str(tmp_path / 'grey.png'), PICTURE[..., 0].astype(np.uint16) * 256)
    cv2.imwrite(str(tmp_path / 'sky.hdr'), np.full((4, 8, 3), 3.0, dtype=np.float32))
    return tmp_path


def leaf(text, folder):
    (found,) = parse_scene(f'DRAW {text};', folder=folder).primitives
    return found


def test_what_a_texture_says_and_where_it_lies(folder):
    box = leaf('(BLOCK (30, 20, 10) TEXTURE "print.png" BOX (30, 20, 10) AT (1, 2, 3))', folder)
    assert np.allclose(box.laid.texture.image, PICTURE / 255.0, atol=1e-7)
    assert (box.laid.texture.mapping, box.laid.texture.size) == ('box', (0.03, 0.02, 0.01))
    # Before it is moved, the block's far corner is at (30, 20, 10) mm of the picture.
    assert np.allclose(box.laid.frame @ [1, 1, 1, 1], [0.03, 0.02, 0.01, 1.0])
    after = leaf('(BLOCK (30, 20, 10) AT (1, 2, 3) TEXTURE "print.png" PLANAR (30, 20))', folder)
    assert np.allclose(after.laid.frame @ [1, 1, 1, 1], [0.031, 0.022, 0.013, 1.0])
    # Twelve more numbers place it, as those of a MATRIX do.
    placed = leaf(
        '(BLOCK (30, 20, 10) AT (1, 2, 3) TEXTURE "print.png" PLANAR (30, 20, 0,1,0, -1,0,0, 0,0,1, 5,0,0))', folder
    )
    assert np.allclose(placed.laid.frame @ [1, 1, 1, 1], [-0.022 + 0.005, 0.031, 0.013, 1.0])
    assert leaf('(BLOCK (3, 2, 1) TEXTURE "print.png" BOX (3, 2) COLOUR (1))', folder).laid is None
    both = leaf('(BLOCK (3, 2, 1) COLOUR (0.5) METAL (0.2) TEXTURE "grey.png" CYLINDRICAL (9))', folder)
    assert both.surface.colour == (0.5, 0.5, 0.5) and both.surface.roughness == 0.2 and both.laid is not None
    assert np.allclose(both.laid.texture.image[..., 2], PICTURE[..., 0] * (256.0 / 65535.0))


@pytest.mark.filterwarnings('ignore::csg_renderer.SceneWarning')
def test_surroundings_and_lights_with_a_size(folder):
    scene = parse_scene(
        'UNITS CM; ENVIRONMENT "sky.hdr" (0.5, 0, 0, 2); LIGHT (1, 2, 3) RADIUS (4) COLOUR (0.5); LIGHT (1, 2, 3);',
        folder=folder,
    )
    assert scene.environment.brightness == 0.5 and scene.environment.up == (0.0, 0.0, 2.0)
    assert np.allclose(scene.environment.image, 3.0, rtol=0.01)
    assert [light.radius for light in scene.lights] == [0.04, 0.0]
    plain = parse_scene('ENVIRONMENT "print.png";', folder=folder).environment
    assert plain.brightness == 1.0 and plain.up == (0.0, -1.0, 0.0)
    # What is in the picture's middle lies ahead, what is on its right to the right.
    assert np.allclose(plain.axes, [[0, 0, 1], [1, 0, 0], [0, -1, 0]])


def test_pictures_are_among_the_files_of_a_scene(folder):
    (folder / 'part.csg').write_text('b = BLOCK (3, 2, 1) TEXTURE "print.png" BOX (3, 2);')
    (folder / 'sub').mkdir()
    (folder / 'scene.csg').write_text('INCLUDE "part.csg"; DRAW b; ENVIRONMENT "grey.png";')
    names = [path.name for path in read_scene(folder / 'scene.csg').files]
    assert names == ['scene.csg', 'part.csg', 'print.png', 'grey.png']


@pytest.mark.parametrize(
    ('text', 'column', 'message'),
    [
        ('DRAW BLOCK (1, 2, 3) TEXTURE "print.png" BOXY (1, 2)', 42, "no mapping 'BOXY', expected PLANAR, BOX, CYL"),
        ('DRAW BLOCK (1, 2, 3) TEXTURE "print.png" box (1, 2)', 42, "no mapping 'box'"),
        ('DRAW BLOCK (1, 2, 3) TEXTURE "print.png" BOX (1)', 22, 'TEXTURE BOX takes 2 numbers'),
        ('DRAW BLOCK (1, 2, 3) TEXTURE "print.png" PLANAR (1, -2)', 22, 'numbers > 0'),
        ('DRAW BLOCK (1, 2, 3) TEXTURE "print.png" PLANAR (1, 0)', 22, 'a size is zero'),
        ('DRAW BLOCK (1, 2, 3) TEXTURE print BOX (1, 2)', 30, 'expected a "file name"'),
        ('DRAW BLOCK (1, 2, 3) TEXTURE "no.png" BOX (1, 2)', 22, "no file 'no.png'"),
        ('DRAW BLOCK (1, 2, 3) TEXTURE "../print.png" BOX (1, 2)', 22, 'outside the folder of the scene'),
        ('DRAW BLOCK (1, 2, 3) TEXTURE "text.png" BOX (1, 2)', 22, 'text.png: not a whole picture'),
        ('DRAW BLOCK (1, 2, 3) TEXTURE "cut.png" BOX (1, 2)', 22, 'cut.png: '),
        ('DRAW BLOCK (1, 2, 3) TEXTURE "bomb.png" BOX (1, 2)', 22, 'bomb.png: '),
        ('DRAW BLOCK (1, 2, 3) TEXTURE "sky.hdr" BOX (1, 2)', 22, 'sky.hdr: expected a picture (.png'),
        ('DRAW BLOCK (1, 2, 3) METAL (1.2)', 22, 'roughness: expected a number in 0..1'),
        ('ENVIRONMENT "text.hdr"', 13, 'text.hdr: not a Radiance picture'),
        ('ENVIRONMENT "bomb.hdr"', 13, 'bomb.hdr: 60000 x 60000 pixels'),
        ('ENVIRONMENT "print.png" (1, 2)', 13, 'ENVIRONMENT takes 1 or 4 numbers'),
        ('ENVIRONMENT "print.png" (-1)', 13, 'brightness: expected a number > 0'),
        ('ENVIRONMENT "print.png" (1, 0, 0, 0)', 13, 'up: expected three numbers'),
        ('LIGHT (1, 2, 3) SIZE (1)', 17, "LIGHT has no 'SIZE', expected COLOUR or RADIUS"),
        ('LIGHT (1, 2, 3) RADIUS (1, 2)', 8, 'RADIUS takes 1 number, got 2'),
        ('LIGHT (1, 2, 3) RADIUS (-1)', 8, 'radius: expected a number >= 0'),
        ('LIGHT (1, 2, 3) RADIUS (1) RADIUS (2)', 28, 'RADIUS stands twice'),
    ],
)
def test_errors_say_where(folder, text, column, message):
    (folder / 'text.png').write_text('no picture')
    (folder / 'text.hdr').write_text('no picture')
    (folder / 'bomb.hdr').write_bytes(b'#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 60000\n')
    (folder / 'cut.png').write_bytes((folder / 'print.png').read_bytes()[:60])
    head = b'IHDR' + (20_000).to_bytes(4, 'big') * 2 + b'\x08\x02\0\0\0'
    chunk = b'\0\0\0\r' + head + zlib.crc32(head).to_bytes(4, 'big')
    (folder / 'bomb.png').write_bytes(b'\x89PNG\r\n\x1a\n' + chunk)
    with pytest.raises(SceneError) as found:
        parse_scene(text + ';', folder=folder)
    assert message in str(found.value) and found.value.column == column


def test_large_pictures_are_refused(folder, monkeypatch):
    monkeypatch.setattr(textures, 'MAX_TEXELS', 20)
    with pytest.raises(ValueError, match=r'print.png: 6 x 4 pixels, at most 20 are read'):
        Texture.load(folder / 'print.png', 'planar', (1.0, 1.0))
    with pytest.raises(ValueError, match=r'sky.hdr: 8 x 4 pixels, at most 20 are read'):
        Environment.load(folder / 'sky.hdr')
    with pytest.raises(ValueError, match=r'image: 6 x 4 pixels, at most 20 are taken'):
        Texture(PICTURE, 'planar', (1.0, 1.0))
    monkeypatch.setattr('csg_renderer.language.includes.MAX_SCENE_TEXELS', 30)
    monkeypatch.setattr(textures, 'MAX_TEXELS', 30)
    text = 'DRAW BLOCK (1, 2, 3) TEXTURE "print.png" BOX (1, 2){};'
    parse_scene(text.format(' TEXTURE "print.png" PLANAR (1, 2)'), folder=folder)
    with pytest.raises(SceneError, match='the pictures of this scene have more than 30 pixels'):
        parse_scene(text.format(' TEXTURE "grey.png" PLANAR (1, 2)'), folder=folder)


def test_no_file_is_an_error_by_name(folder):
    with pytest.raises(FileNotFoundError, match='none.png'):
        Texture.load(folder / 'none.png', 'planar', (1.0, 1.0))


def test_the_command_renders_them(folder, capsys):
    (folder / 'scene.csg').write_text(
        'LIGHT (0, 0, 0) RADIUS (10); DRAW BLOCK (40, 40, 9) TEXTURE "print.png" BOX (40, 40) AT (-20, -20, 100);'
    )
    out = folder / 'out.png'
    arguments = [str(folder / 'scene.csg'), '-o', str(out), '--size', '32', '--samples', '4', '-q']
    assert render_cli.main(arguments) == 0
    assert np.ptp(cv2.imread(str(out))) > 0
    assert render_cli.main([*arguments, '--samples', '0']) == 2
    assert 'samples: expected a whole number in 1..1024' in capsys.readouterr().err
    assert render_cli.main([*arguments, '--engine', 'dap']) == 2
    assert "engine: 'dap' shows no TEXTURE" in capsys.readouterr().err
