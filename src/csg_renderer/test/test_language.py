"""The modelling language: what a text means."""

from pathlib import Path

import numpy as np
import pytest

from csg_renderer import SceneError, SceneWarning, Solid, load_models, parse_scene
from csg_renderer.language import read_text
from csg_renderer.scene.solid import Operation

BOX = 'box = BLOCK (10, 20, 30); ball = SPHERE (5); tube = CYLINDER (2, 0, 0, 40);\n'


@pytest.fixture(autouse=True)
def quiet(recwarn):
    """Unused names are no matter here."""


def solid(expression: str, text: str = BOX) -> Solid:
    return parse_scene(f'{text} it = {expression}; DRAW it;').solids[0]


def matrix(expression: str) -> np.ndarray:
    (leaf,) = solid(expression).primitives
    return leaf.matrix


def spelled(tree: Solid) -> str:
    """A tree with each leaf shown by its kind's first letter."""
    if isinstance(tree, Operation):
        sign = {'UNION': '|', 'INTERSECT': '&', 'DIFFERENCE': '-'}[tree.operator]
        return f'({spelled(tree.left)}{sign}{spelled(tree.right)})'
    return tree.kind[0] if tree.primitives else '0'


def test_lengths_are_millimetres_unless_the_file_says_otherwise():
    assert np.array_equal(matrix('BLOCK (35, 20, 30)'), np.diag([0.035, 0.02, 0.03, 1.0]))
    for unit, size in (('MM', 0.002), ('CM', 0.02), ('M', 2.0)):
        assert parse_scene(f'UNITS {unit}; DRAW SPHERE (2);').primitives[0].matrix[0, 0] == size


def test_the_five_primitives_are_those_of_the_python_interface():
    for text, made in (
        ('BLOCK (-1, 2, 3)', Solid.block(-0.001, 0.002, 0.003)),
        ('CYLINDER (8, 0, 0, 25)', Solid.cylinder(0.008, (0, 0, 0.025))),
        ('CONE (8, 3, 0, 25)', Solid.cone(0.008, (0.003, 0, 0.025))),
        ('SPHERE (4)', Solid.sphere(0.004)),
        ('PLANE (0, 2, 0, 10)', Solid.plane((0, 1, 0), 0.005)),
    ):
        found = solid(text)
        assert found.kind == made.kind
        assert np.allclose(found.matrix, made.matrix, atol=1e-15)


def test_transforms_compose_left_to_right_on_row_vectors():
    """YROT(40) XROT(-20) AT(60,-40,350) is the first row of thesis Table 5.9."""
    m = matrix('SPHERE (1000) YROT (40) XROT (-20) AT (60, -40, 350)')
    printed = [[0.7660, -0.2198, -0.6040], [0.0, 0.9397, -0.3420], [0.6428, 0.2620, 0.7198]]
    assert np.allclose(m[:3, :3].T, printed, atol=5e-5)
    assert np.allclose(m[:3, 3], [0.060, -0.040, 0.350])


def test_a_translation_before_a_rotation_is_rotated():
    assert np.allclose(matrix('ball AT (10, 0, 0) ZROT (90)')[:3, 3], [0.0, 0.010, 0.0])


def test_quarter_turns_are_exact():
    assert np.array_equal(matrix('SPHERE (1000) XROT (90)')[:3, :3], [[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    assert np.array_equal(matrix('SPHERE (1000) YROT (-450) YROT (90)')[:3, :3], np.eye(3))


def test_scale_takes_one_factor_or_three_and_matrix_takes_rows():
    assert np.allclose(np.diag(matrix('SPHERE (1) SCALE (2)')), [0.002, 0.002, 0.002, 1.0])
    assert np.allclose(np.diag(matrix('SPHERE (1) SCALE (2, 3, -4)')), [0.002, 0.003, -0.004, 1.0])
    sheared = matrix('SPHERE (1000) MATRIX (1, 0, 0,  0.5, 1, 0,  0, 0, 1,  10, 20, 30)')
    assert np.allclose(sheared[:3] @ [0.0, 1.0, 0.0, 1.0], [0.51, 1.02, 0.03])


def test_suffixes_at_the_end_belong_to_the_whole_expression():
    """Thesis 3.6: the result of ball UNION tube is translated."""
    moved = solid('ball UNION tube AT (100, 20, 50)')
    assert all(np.allclose(leaf.matrix[:3, 3], [0.1, 0.02, 0.05]) for leaf in moved.primitives)


def test_suffixes_in_the_middle_belong_to_their_operand():
    first, second, third = solid('ball AT (1, 0, 0) UNION tube AT (2, 0, 0) UNION ball').primitives
    assert [leaf.matrix[0, 3] for leaf in (first, second, third)] == [0.001, 0.002, 0.0]


def test_parentheses_keep_a_suffix_with_the_last_operand():
    first, second = solid('ball UNION (tube AT (2, 0, 0))').primitives
    assert (first.matrix[0, 3], second.matrix[0, 3]) == (0.0, 0.002)


@pytest.mark.parametrize(
    ('text', 'tree'),
    [
        ('box UNION ball INTERSECT tube', '(B|(S&C))'),
        ('box INTERSECT ball UNION tube', '((B&S)|C)'),
        ('box DIFFERENCE ball UNION tube', '((B-S)|C)'),
        ('box DIFFERENCE (ball UNION tube)', '(B-(S|C))'),
        ('box DIFFERENCE ball INTERSECT tube DIFFERENCE ball', '((B-(S&C))-S)'),
        ('((box)) UNION (ball)', '(B|S)'),
    ],
)
def test_intersect_binds_tighter_and_the_rest_goes_left_to_right(text, tree):
    assert spelled(solid(text)) == tree


@pytest.mark.parametrize(
    ('text', 'tree'),
    [
        ('box UNION NULL', 'B'),
        ('NULL UNION box', 'B'),
        ('box DIFFERENCE NULL', 'B'),
        ('NULL DIFFERENCE box', '0'),
        ('box INTERSECT NULL', '0'),
        ('NULL AT (1, 2, 3) COLOUR (1, 0, 0)', '0'),
        ('NULL PAINT FACES', '0'),
    ],
)
def test_null_is_the_empty_set(text, tree):
    assert spelled(solid(text)) == tree


def test_the_data_file_of_figure_4_12():
    scene = parse_scene("""
        bigtube   = CYLINDER ( 8, 0, 0, 25) XROT (-90) AT (10, 0, 13);
        smalltube = CYLINDER ( 4, 0, 0, 10) YROT (90)  AT (45, 16, 18);
        tallbox   = BLOCK ( 15, 25, 16) AT (30, 0, 10);
        flatbox   = BLOCK ( 50, 5, 26);
        pair1  = bigtube UNION flatbox;
        pair2  = tallbox UNION smalltube;
        object = pair1 UNION pair2;
        DRAW ( object ) AT (0, 0, 100)
        """)
    (placement,) = scene.placements
    assert (placement.name, spelled(placement.model)) == ('object', '((C|B)|(B|C))')
    assert np.allclose(placement.matrix[:3, 3], [0, 0, 0.1])
    big = scene.primitives[0].matrix
    assert np.allclose(big @ [0, 0, 1, 1], [0.010, 0.025, 0.113, 1])  # the tube has turned upright


def test_draw_separates_the_model_from_its_pose():
    scene = parse_scene(BOX + 'DRAW (box AT (1, 0, 0)) ZROT (90) AT (0, 0, 50) COLOUR (1, 0, 0);')
    (placement,) = scene.placements
    assert np.allclose(placement.model.primitives[0].matrix[:3, 3], [0.001, 0, 0])
    assert placement.model.primitives[0].surface.colour == (1.0, 0.0, 0.0)
    assert np.allclose(placement.pose.translation, [0, 0, 0.05])
    assert np.allclose(scene.primitives[0].matrix[:3, 3], [0, 0.001, 0.05])


def test_objects_are_named_after_what_is_drawn(tmp_path):
    file = tmp_path / 'scene.csg'
    file.write_text(BOX + 'DRAW box AT (0, 0, 9); DRAW box; DRAW box UNION ball; DRAW tube AS pipe;')
    names = [placement.name for placement in parse_scene(file.read_text()).placements]
    assert names == ['box', 'box_2', 'object', 'pipe']
    models = load_models(file)
    assert list(models) == ['box', 'object', 'pipe']  # the second box is the same model
    assert np.array_equal(models['box'].matrix, np.diag([0.01, 0.02, 0.03, 1]))


def test_numbers_are_expressions():
    text = 'r = 2 * (3 + 1) - -2;  half = r / 2;  up = half * SIN (30) + ABS (-1) + MAX (0, -3) + PI * 0;\n'
    scene = parse_scene(text + 'DRAW SPHERE (r) AT (half, up, ATAN2 (1, 1));')
    assert scene.primitives[0].matrix[0, 0] == pytest.approx(0.010)
    assert scene.primitives[0].matrix[:3, 3] == pytest.approx([0.005, 0.0035, 0.045])


def test_surface_properties_change_only_themselves():
    (leaf,) = solid(
        'ball COLOUR (0.1, 0.2, 0.3) AMBIENT (0.5) DIFFUSE (0.6) SPECULAR (0.7) SHININESS (9) '
        'REFLECT (0.25) TRANSPARENT (0.75)'
    ).primitives
    s = leaf.surface
    assert (s.colour, s.ambient, s.diffuse, s.specular) == ((0.1, 0.2, 0.3), 0.5, 0.6, 0.7)
    assert (s.shininess, s.reflection, s.transparency) == (9.0, 0.25, 0.75)
    assert solid('ball COLOUR (0.5) COLOR (1, 0, 0)').surface.colour == (1.0, 0.0, 0.0)


def test_paint_faces_gives_every_face_its_own_shade_and_those_that_meet_the_most_different_ones():
    (leaf,) = solid('box COLOUR (1, 0.5, 0.5) PAINT FACES').primitives
    reds = leaf.face_colours[:, 0]
    assert np.allclose(np.sort(reds), np.linspace(0.22, 1.0, 6))
    assert np.allclose(leaf.face_colours[:, 1], 0.5 * reds)
    # Two sides of the block in every direction: those two may be the most alike, for no view shows both.
    pairs = reds.reshape(3, 2)
    assert min(abs(a - b) for i in range(3) for j in range(i) for a in pairs[i] for b in pairs[j]) > 0.15


def test_paint_faces_shows_no_seam_between_coplanar_faces():
    first, second = solid('BLOCK (10, 10, 10) UNION (BLOCK (10, 10, 10) AT (10, 0, 0)) PAINT FACES').primitives
    assert np.array_equal(first.face_colours[2:], second.face_colours[2:])


def test_paint_faces_spends_no_shade_on_faces_that_cut_nothing():
    body, tool = solid(
        'BLOCK (50, 50, 50) DIFFERENCE (BLOCK (90, 90, 90) ZROT (45) AT (60, 0, -20)) COLOUR (1) PAINT FACES'
    ).primitives
    # Six faces of the body and one of the tool are left: seven shades.
    shades = {round(float(shade), 6) for shade in (*body.face_colours[:, 0], tool.face_colours[0, 0])}
    assert np.allclose(sorted(shades), np.linspace(0.22, 1.0, 7))


def test_colours_after_paint_replace_it_and_explicit_colours_are_kept():
    assert solid('ball PAINT FACES COLOUR (1, 0, 0)').face_colours is None
    painted = solid('CONE (1, 0, 0, 2) PAINT FACES (1, 0, 0,  0, 1, 0)')
    assert np.array_equal(painted.face_colours, [[1, 0, 0], [0, 1, 0]])


def test_lights_ambience_and_background():
    scene = parse_scene(
        'LIGHT (1, 2, 3); LIGHT (0, 0, 9) COLOUR (0.5); AMBIENT (0.1); BACKGROUND (0.2, 0.3, 0.4);DRAW SPHERE (1);'
    )
    assert [light.position for light in scene.lights] == [(0.001, 0.002, 0.003), (0.0, 0.0, 0.009)]
    assert [light.colour for light in scene.lights] == [(1.0, 1.0, 1.0), (0.5, 0.5, 0.5)]
    assert (scene.ambient_light, scene.background) == ((0.1, 0.1, 0.1), (0.2, 0.3, 0.4))


def test_a_camera_by_focal_length_or_field_of_view():
    camera = parse_scene('CAMERA SIZE (640, 480) FOCAL (500); DRAW SPHERE (1);').camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (500, 500, 319.5, 239.5)
    wide = parse_scene('CAMERA SIZE (200, 100) FOV (90) CENTRE (10, 20); DRAW SPHERE (1);').camera
    assert wide.fx == pytest.approx(100.0) and (wide.cx, wide.cy) == (10, 20)


def test_a_camera_by_k_and_rt():
    scene = parse_scene(
        'CAMERA SIZE (64, 48) K (50, 0, 31, 0, 51, 23, 0, 0, 1) '
        'RT (0, -1, 0, 10,  1, 0, 0, 20,  0, 0, 1, 30); DRAW SPHERE (1);'
    )
    assert (scene.camera.fx, scene.camera.fy, scene.camera.cx, scene.camera.cy) == (50, 51, 31, 23)
    assert np.allclose(scene.camera_T_scene.apply([1.0, 0.0, 0.0]), [0.01, 1.02, 0.03])


def test_a_camera_that_looks_at_a_point_sees_it_in_the_middle_and_up_is_up():
    scene = parse_scene('CAMERA FOCAL (500) FROM (300, 400, 500) TO (10, 20, 30) UP (0, 1, 0); DRAW SPHERE (1);')
    target = scene.camera_T_scene.apply([0.01, 0.02, 0.03])
    assert np.allclose(target[:2], 0.0) and target[2] == pytest.approx(np.linalg.norm([0.29, 0.38, 0.47]))
    above = scene.camera.project(scene.camera_T_scene.apply([0.01, 0.03, 0.03]))
    assert above[1] < scene.camera.cy and above[0] == pytest.approx(scene.camera.cx)


def test_stereo_is_the_baseline_and_disparity_another_way_to_say_it():
    assert parse_scene('STEREO (65); DRAW SPHERE (1);').baseline == 0.065
    camera = 'CAMERA SIZE (100, 100) FOCAL (500) '
    assert parse_scene(camera + '; DISPARITY (50, 1000); DRAW SPHERE (1);').baseline == pytest.approx(0.1)
    looking = parse_scene('DISPARITY (50);' + camera + 'TO (0, 0, 400); DRAW SPHERE (1);')
    assert looking.baseline == pytest.approx(0.04)


def test_comments_are_nothing():
    scene = parse_scene('// DRAW BLOCK (1,2,3);\n/* ; \n "x */ DRAW # to the end ;\n SPHERE (1) /* (((( */ ;; ;')
    assert [leaf.kind for leaf in scene.primitives] == ['SPHERE']


def test_include_brings_names_and_draws_nothing(tmp_path):
    (tmp_path / 'parts').mkdir()
    (tmp_path / 'parts' / 'part.csg').write_text(
        'UNITS M; INCLUDE "deep.csg"; part = BLOCK (1, 1, 1); DRAW part; LIGHT (1, 1, 1); CAMERA FOCAL (3);'
    )
    (tmp_path / 'parts' / 'deep.csg').write_text('deep = SPHERE (1);')
    scene = parse_scene('INCLUDE "parts/part.csg"; INCLUDE "parts/deep.csg"; DRAW part UNION deep;', folder=tmp_path)
    assert [leaf.matrix[0, 0] for leaf in scene.primitives] == [1.0, 0.001]
    assert scene.lights == () and scene.camera is None


def test_include_finds_the_models_of_the_package():
    scene = parse_scene('INCLUDE "l_shape.csg"; DRAW l_shape AT (0, 0, 150);')
    assert len(scene.primitives) == 2


def test_names_never_used_are_a_warning():
    with pytest.warns(SceneWarning, match=r"my.csg:1:8: 'spare' is never used"):
        parse_scene('a = 1; spare = a; DRAW SPHERE (a);', 'my.csg')
    assert read_text('a = 1; DRAW SPHERE (a);').warnings == ()
    assert read_text('model = SPHERE (1);').warnings == ()  # a library of models draws nothing
    assert read_text('AMBIENT (1);', 'e.csg').warnings == ('e.csg: nothing is drawn',)


def test_windows_line_ends_and_a_byte_order_mark_are_no_matter(tmp_path):
    file = tmp_path / 'dos.csg'
    file.write_bytes('\ufeff'.encode() + b'a = SPHERE (1);\r\nDRAW b;\r\n')
    with pytest.raises(SceneError) as caught:
        load_models(file)
    assert (caught.value.line, caught.value.column, caught.value.source) == (2, 6, 'DRAW b;')


def test_the_example_of_the_documentation_is_a_scene(tmp_path):
    page = Path(__file__).parent.parent / 'docs' / 'language.md'
    (tmp_path / 'parts.csg').write_text('part = SPHERE (1);')
    scene = parse_scene(page.read_text(encoding='utf-8').split('```')[1], folder=tmp_path)
    assert spelled(scene.solids[0]) == '((B|C)-S)'
