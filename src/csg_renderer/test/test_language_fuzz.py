"""Damaged scene files: each one is a scene that renders, or an error with a place; never a traceback, never a wait.

``CSG_FUZZ=2000 pytest src/csg_renderer/test/test_language_fuzz.py`` tries more of them.
"""

import os
import random
import time
import warnings

import pytest

from csg_renderer import SceneError, load_scene, parse_scene, render, scene_names, scene_path
from csg_renderer.language import format_scene
from msgs_py import PinholeCamera

FILES = int(os.environ.get('CSG_FUZZ', '150'))
PATIENCE = 2.0

TOKENS = [
    'UNION',
    'INTERSECT',
    'DIFFERENCE',
    'BLOCK',
    'CYLINDER',
    'SPHERE',
    'CONE',
    'PLANE',
    'NULL',
    'XROT',
    'SCALE',
    'AT',
    'MATRIX',
    'COLOUR',
    'AMBIENT',
    'REFLECT',
    'TRANSPARENT',
    'METAL',
    'TEXTURE',
    'BOX',
    'PLANAR',
    'CYLINDRICAL',
    'RADIUS',
    'ENVIRONMENT',
    'PAINT',
    'FACES',
    'DRAW',
    'LIGHT',
    'CAMERA',
    'SIZE',
    'FOCAL',
    'STEREO',
    'DISPARITY',
    'UNITS',
    'INCLUDE',
    '"l_shape.csg"',
    '"carton.png"',
    '(',
    ')',
    ',',
    ';',
    '=',
    '+',
    '-',
    '*',
    '/',
    '0',
    '1',
    '-1',
    '1e308',
    '1e-308',
    '0.5',
    '90',
    'x',
    '//',
    '/*',
    '*/',
    '"',
    '#',
    '\n',
    '\x00',
    'é',
    '\t',
    '$',
]


def damaged(text: str, chance: random.Random, others: list[str]) -> str:
    """A few random edits of the kinds that slips of the hand, of the disk and of merge tools make."""
    for _ in range(chance.randint(1, 6)):
        at = chance.randrange(len(text) + 1)
        end = min(len(text), at + chance.choice([1, 1, 2, 5, 20, 100]))
        kind = chance.randrange(7)
        if kind == 0:
            text = text[:at] + text[end:]
        elif kind == 1:
            text = text[:at] + chance.choice(TOKENS) + text[at:]
        elif kind == 2:
            text = text[:at] + chance.choice(TOKENS) + text[end:]
        elif kind == 3:
            text = text[:at] + text[at:end] * chance.choice([2, 3, 50]) + text[end:]
        elif kind == 4:
            other = chance.choice(others)
            cut = chance.randrange(len(other))
            text = text[:at] + other[cut : cut + chance.choice([10, 100, 1000])] + text[at:]
        elif kind == 5:
            numbers = [i for i, c in enumerate(text) if c.isdigit()]
            if numbers:
                at = chance.choice(numbers)
                text = text[:at] + chance.choice(['0', '-', '1e9', '999999', '.', '0.0001']) + text[at + 1 :]
        else:
            text = text[:at]
    return text


@pytest.mark.timeout(60 + FILES)
def test_damaged_files_render_or_say_where_they_are_wrong():
    chance = random.Random(20240607)
    originals = [scene_path(name).read_text() for name in scene_names()]
    # Tiny pictures: the question is whether every scene that reads also renders.
    camera = PinholeCamera.centred(24, 24, 33.0)
    render(load_scene('table'), camera, shadows=True, levels=3)
    sheet = 'DRAW TERRAIN ("hills.png", 9, 9, 3)'
    for text in (sheet, scene_path('carton').read_text(), f'{sheet} TEXTURE "carton.png" BOX (9, 9);'):
        render(parse_scene(text), camera)
    read = 0
    for number in range(FILES):
        text = damaged(chance.choice(originals), chance, originals)
        start = time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            try:
                scene = parse_scene(text, f'damaged{number}.csg')
                render(scene, camera)
                read += 1
                if number % 5 == 0:
                    parse_scene(format_scene(scene))
            except SceneError as error:
                for one in error.errors:
                    lines = text.split('\n')
                    assert 1 <= one.line <= len(lines) and one.column >= 1, (number, str(one))
                    assert one.message and one.file
                assert str(error)
        assert time.perf_counter() - start < PATIENCE, f'file {number} took too long:\n{text}'
    assert read > FILES // 20
