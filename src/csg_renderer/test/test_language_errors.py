"""Errors of the modelling language: where, what, and what to do."""

import pytest

from csg_renderer import SceneError, load_scene, parse_scene, scene_path
from csg_renderer.language.settings import MAX_CHARACTERS, MAX_DEPTH, MAX_ERRORS


def error(text: str, **options) -> SceneError:
    with pytest.raises(SceneError) as caught:
        parse_scene(text, **options)
    return caught.value


@pytest.mark.parametrize(
    ('text', 'line', 'column', 'message', 'hint'),
    [
        ('a = BLOK (1,2,3);', 1, 5, "'BLOK' is no primitive", "did you mean 'BLOCK'?"),
        ('a = block (1,2,3);', 1, 5, 'no primitive', "'BLOCK'"),
        ('\n  DRWA (a);', 2, 8, "unexpected '('", "did you mean 'DRAW'?"),
        ('draw a;', 1, 6, "unexpected 'a'", 'upper case'),
        ('a = SPHERE (1);\nDRAW a UNOIN a;', 2, 8, "unexpected 'UNOIN', expected", "did you mean 'UNION'?"),
        ('DRAW SPHERE (1) union SPHERE (2);', 1, 17, "unexpected 'union'", "upper case: 'UNION'"),
        ('DRAW SPHERE (1) XROTT (3);', 1, 17, "unexpected 'XROTT'", "'XROT'"),
        ('a = SPHERE (1)\nDRAW a;', 2, 1, "unexpected 'DRAW'", "';' missing"),
        ('a = SPHERE (1', 1, 14, "too early, expected ')' or ','", ''),
        ('DRAW SPHERE (1,);', 1, 16, "unexpected ')'", ''),
        ('DRAW SPHERE ($);', 1, 14, "'$' has no meaning", ''),
        ('INCLUDE "x;\nDRAW SPHERE(1);', 1, 9, "'\"' has no meaning", 'close the file name'),
        ('UNION = SPHERE (1);', 1, 1, "unexpected 'UNION'", 'word of the language'),
        ('a = /* SPHERE (1); DRAW a;', 1, 5, 'never closed', ''),
        ('DRAW b;', 1, 6, "'b' is not defined", ''),
        ('ball = SPHERE (1); DRAW bal;', 1, 25, "'bal' is not defined", "did you mean 'ball'?"),
        ('DRAW b;\nb = SPHERE (1);', 1, 6, 'before it is defined', 'top to bottom'),
        ('b = SPHERE (1);\nb = SPHERE (2);', 2, 1, "'b' is defined already", 'scene:1:1'),
        ('PI = 3;', 1, 1, 'built in', ''),
        ('DRAW BLOCK (1, 2);', 1, 6, 'BLOCK takes 3 numbers (sizes dx, dy, dz), got 2', ''),
        ('DRAW BLOCK (1, 0, 3);', 1, 6, 'dy is zero', ''),
        ('DRAW SPHERE (-1);', 1, 6, 'radius is -1', ''),
        ('DRAW CYLINDER (0, 0, 0, 1);', 1, 6, 'radius is zero', ''),
        ('DRAW CONE (1, 0, 0, 0);', 1, 6, 'axis of this CONE has no length', ''),
        ('DRAW PLANE (0, 0, 0, 1);', 1, 6, 'normal', ''),
        ('DRAW SPHERE (1e300);', 1, 6, 'radius', ''),
        ('DRAW SPHERE (1e999);', 1, 14, 'too large', ''),
        ('DRAW SPHERE (1) SCALE (0);', 1, 17, 'SCALE by zero', ''),
        ('DRAW SPHERE (1) SCALE (1, 2);', 1, 17, 'SCALE takes 1 or 3 numbers', ''),
        ('DRAW SPHERE (1) MATRIX (1,0,0, 0,1,0, 1,1,0, 0,0,0);', 1, 17, 'flatten', ''),
        ('DRAW SPHERE (1) COLOUR (2, 0, 0);', 1, 17, 'COLOUR: expected red, green, blue in 0..1', ''),
        ('DRAW SPHERE (1) REFLECT (1.5);', 1, 17, 'reflection: expected a number in 0..1', ''),
        ('DRAW NULL REFLECT (1.5);', 1, 11, 'reflection', ''),
        ('DRAW SPHERE (1) PAINT FACES (1, 0);', 1, 17, 'PAINT FACES takes 3 numbers', ''),
        ('DRAW SPHERE (1) + SPHERE (1);', 1, 6, 'expected a number', 'UNION, INTERSECT and DIFFERENCE'),
        ('DRAW 3;', 1, 6, 'expected a solid', ''),
        ('a = 3 AT (1, 2, 3);', 1, 5, 'expected a solid', ''),
        ('a = 1 / (2 - 2);', 1, 10, 'division by zero', ''),
        ('a = SQRT (-1);', 1, 5, 'SQRT is not defined for -1', ''),
        ('a = SIN (1, 2);', 1, 5, 'SIN takes 1 number, got 2', ''),
        ('a = 1e308 * 10;', 1, 5, 'too large', ''),
        ('LIGHT (1, 2);', 1, 8, 'LIGHT takes 3 numbers', ''),
        ('AMBIENT (0); AMBIENT (1);', 1, 14, 'AMBIENT stands twice', 'line 1'),
        ('UNITS INCH;', 1, 7, "unknown unit 'INCH', expected MM, CM, M", ''),
        ('a = SPHERE (1); UNITS M;', 1, 23, 'before the first length', ''),
        ('CAMERA SIZE (9, 9) FOCL (3);', 1, 20, "CAMERA has no 'FOCL'", "did you mean 'FOCAL'?"),
        ('CAMERA SIZE (9.5, 9) FOCAL (3);', 1, 8, 'whole number of pixels', ''),
        ('CAMERA SIZE (9, 9);', 1, 8, 'needs FOCAL', ''),
        ('CAMERA FOCAL (0);', 1, 8, 'fx', ''),
        ('CAMERA FOCAL (9) FROM (1, 2, 3) TO (1, 2, 3);', 1, 8, 'same point', ''),
        ('CAMERA FOCAL (9) TO (0, 0, 3) UP (0, 0, 1);', 1, 8, 'parallel', ''),
        ('CAMERA FOCAL (9) FOV (9);', 1, 8, 'same thing', ''),
        ('CAMERA FOV (180);', 1, 8, 'FOV is 180, expected degrees in 0.1..179', ''),
        ('CAMERA K (9,1,4, 0,9,4, 0,0,1);', 1, 8, 'no skew', ''),
        ('CAMERA FOCAL (9) UP (0, 1, 0);', 1, 8, 'UP goes with TO', ''),
        ('CAMERA FOCAL (9) FROM (1, 2, 3) UP (0, 1, 0);', 1, 8, 'UP goes with TO', ''),
        ('CAMERA FOCAL (9) TO (0, 0, 3) UP (0, 0, 0);', 1, 8, 'UP has no length', ''),
        ('CAMERA FOCAL (9) RT (1,0,0,0, 0,1,0,0, 0,1,1,0);', 1, 8, 'orthonormal', ''),
        ('STEREO (0);', 1, 9, 'STEREO takes one number > 0', ''),
        ('\nDISPARITY (3);', 2, 1, 'needs a CAMERA', ''),
        ('STEREO (5); CAMERA FOCAL (9);\nDISPARITY (3, 4);', 2, 1, 'both give the baseline', ''),
        ('DRAW SPHERE (1) AS a; DRAW SPHERE (2) AS a;', 1, 42, "drawn as 'a' already", ''),
        ('INCLUDE "nowhere.csg";', 1, 9, "no file 'nowhere.csg'", ''),
        ('INCLUDE "";', 1, 9, 'needs a file name', ''),
        ('INCLUDE "../../../etc/hostname";', 1, 9, 'outside the folder', ''),
        ('INCLUDE "/etc/hostname";', 1, 9, 'outside the folder', ''),
    ],
)
@pytest.mark.filterwarnings('ignore::csg_renderer.SceneWarning')
def test_one_mistake_is_reported_where_it_is(text, line, column, message, hint):
    found = error(text)
    assert (found.line, found.column) == (line, column)
    assert message in found.message
    assert hint in found.hint
    assert len(found.errors) == 1
    assert found.source == text.split('\n')[line - 1]


def test_the_report_shows_file_line_and_caret():
    assert str(error('a = SPHERE (1);\n  DRAW  bb;', file='my.csg')) == (
        "my.csg:2:9: 'bb' is not defined\n      DRAW  bb;\n            ^~"
    )


def test_all_mistakes_are_reported_in_one_pass_in_the_order_of_the_text():
    found = error('a = BLOK (1, 2, 3);\nb = SPHERE (0) UNION a;\nc = (;\nDRAW b UNION c;\nDRAW d;\n')
    assert [(e.line, e.column) for e in found.errors] == [(1, 5), (2, 5), (3, 6), (5, 6)]
    assert str(found).endswith('4 errors')


def test_a_mistake_in_a_definition_is_not_repeated_where_its_name_is_used():
    found = error('a = BLOK (1, 2, 3); b = a; c = b UNION a; DRAW c;')
    assert len(found.errors) == 1


def test_errors_end_after_the_twentieth():
    assert len(error('x;\n' * 500).errors) == MAX_ERRORS


def test_errors_in_an_included_file_name_that_file(tmp_path):
    (tmp_path / 'part.csg').write_text('\npart = SPHERE (0);\n')
    (tmp_path / 'main.csg').write_text('INCLUDE "part.csg";\nDRAW part;\nDRAW whole;')
    with pytest.raises(SceneError) as caught:
        load_scene(tmp_path / 'main.csg')
    assert [(e.file.endswith(name), e.line) for e, name in zip(caught.value.errors, ('main.csg', 'part.csg'))] == [
        (True, 3),
        (True, 2),
    ]


def test_include_cycles_are_reported(tmp_path):
    (tmp_path / 'a.csg').write_text('INCLUDE "b.csg";')
    (tmp_path / 'b.csg').write_text('INCLUDE "a.csg";')
    with pytest.raises(SceneError, match='a.csg -> b.csg -> a.csg'):
        load_scene(tmp_path / 'a.csg')
    (tmp_path / 'me.csg').write_text('INCLUDE "me.csg";')
    with pytest.raises(SceneError, match='include each other'):
        load_scene(tmp_path / 'me.csg')


def test_two_files_must_not_define_one_name(tmp_path):
    (tmp_path / 'a.csg').write_text('x = SPHERE (1);')
    (tmp_path / 'b.csg').write_text('x = SPHERE (2);')
    (tmp_path / 'main.csg').write_text('INCLUDE "a.csg"; INCLUDE "b.csg"; DRAW x;')
    with pytest.raises(SceneError, match="defines 'x', which is defined already"):
        load_scene(tmp_path / 'main.csg')


def test_includes_stay_inside_the_folder_of_the_scene(tmp_path):
    (tmp_path / 'secret.csg').write_text('x = SPHERE (1);')
    inner = tmp_path / 'scenes'
    inner.mkdir()
    (inner / 'link.csg').symlink_to(tmp_path / 'secret.csg')
    for path in ('../secret.csg', 'link.csg', str(tmp_path / 'secret.csg')):
        assert 'outside the folder' in error(f'INCLUDE "{path}";', folder=inner).message


def test_includes_that_cannot_be_read_say_why(tmp_path):
    (tmp_path / 'large.csg').write_bytes(b' ' * (MAX_CHARACTERS + 1))
    (tmp_path / 'loop.csg').symlink_to(tmp_path / 'loop.csg')
    for number in range(MAX_DEPTH + 2):
        (tmp_path / f'{number}.csg').write_text(f'INCLUDE "{number + 1}.csg";')
    for name, why in (('large', 'is larger than'), ('loop', 'no file'), ('x' * 300, 'no file'), ('0', 'files inside')):
        with pytest.raises(SceneError, match=why):
            parse_scene(f'INCLUDE "{name}.csg";', folder=tmp_path)


@pytest.mark.parametrize('data', [b'\xff\xfe\x00', b'\x80abc', b'\0'])
def test_what_is_no_text_is_refused(tmp_path, data):
    (tmp_path / 'x.csg').write_bytes(data)
    with pytest.raises(SceneError):
        load_scene(tmp_path / 'x.csg')


def test_a_scene_that_does_not_exist_is_a_file_error_with_the_nearest_names():
    with pytest.raises(FileNotFoundError, match='l_shape_v1'):
        load_scene('l_shape_v11')
    with pytest.raises(FileNotFoundError, match='no scene file'):
        load_scene('no/such.csg')
    with pytest.raises(FileNotFoundError):
        scene_path('../solid')


@pytest.mark.parametrize(
    'text',
    [
        'a = ' + '(' * 100_000 + '1' + ')' * 100_000 + ';',
        'a = ' + '-' * 90_000 + '1;',
        'a = ' + '1+' * 40_000 + '1; DRAW SPHERE (a);',
        'a0 = SPHERE (1);' + ''.join(f'a{k + 1} = a{k} UNION a{k};' for k in range(60)) + 'DRAW a60;',
        'a = SPHERE (1);' + 'a = a AT (1,1,1);' * 30_000,
        'a = ' + 'SPHERE (1) UNION ' * 5_000 + 'SPHERE (1); DRAW a;',
        'DRAW SPHERE (1)' + ' AT (1,1,1)' * 5_000 + ';',
        'a = ' + 'BLOCK (1, 2, 3) UNION ' * 44 + 'NULL; DRAW a' + ' PAINT FACES' * 1_000 + ';',
        ''.join(f'b{k} = SPHERE ({k + 1}) UNION SPHERE (1) XROT (3); DRAW b{k};' for k in range(2_000)),
        '"' * 50_000,
        '/*' * 50_000,
        ';' * 100_000,
        'a' * 150_000,
        '\n' * 100_000 + 'DRAW',
    ],
)
@pytest.mark.filterwarnings('ignore::csg_renderer.SceneWarning')
def test_monstrous_texts_are_read_or_refused_quickly(text):
    import time

    start = time.process_time()
    try:
        parse_scene(text)
    except SceneError as found:
        assert found.line >= 1
    assert time.process_time() - start < 4.0


@pytest.mark.parametrize('operator', ['UNION', 'DIFFERENCE', 'INTERSECT'])
def test_long_chains_render(operator):
    from csg_renderer import render
    from msgs_py import PinholeCamera

    chain = f' {operator} '.join(['SPHERE (9)'] + ['(SPHERE (9) AT (0, 0, 1))'] * 1_200)
    frame = render(parse_scene(f'DRAW {chain} AT (0, 0, 50);'), PinholeCamera.centred(16, 16, 20.0))
    assert frame.mask.any()
