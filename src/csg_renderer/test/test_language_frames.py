"""FRAME: named places on what is drawn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from csg_renderer import Placement, Scene, SceneError, Solid, load_known_models, parse_scene
from csg_renderer.language import format_scene, load_placements
from msgs_py import Pose

BLOCK = 'UNITS MM; part = BLOCK (20, 30, 40); '


def frames(text: str) -> list[dict[str, Pose]]:
    return [placement.frames for placement in parse_scene(BLOCK + text).placements]


def test_a_frame_is_on_the_object_drawn_before_it_in_the_frame_of_its_model():
    first, second = frames(
        'DRAW part AT (0, 0, 300); FRAME grip XROT (90) AT (10, 0, 25); FRAME rest; DRAW part AS other; '
        'FRAME grip AT (10, 0, 25) XROT (90);'
    )
    turned = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)
    assert sorted(first) == ['grip', 'rest'] and first['rest'] == Pose.identity()
    np.testing.assert_array_equal(first['grip'].rotation, turned)
    np.testing.assert_array_equal(first['grip'].translation, [0.010, 0.0, 0.025])
    np.testing.assert_array_equal(second['grip'].rotation, turned)
    np.testing.assert_allclose(second['grip'].translation, [0.010, -0.025, 0.0], atol=1e-15)


def test_numbers_may_be_computed_and_an_included_frame_does_not_count(tmp_path):
    (one,) = frames('h = 40; DRAW part; FRAME top AT (0, 0, h / 2);')
    assert one['top'].translation[2] == 0.020
    (tmp_path / 'inner.csg').write_text(BLOCK + 'DRAW part; FRAME top;')
    scene = parse_scene('INCLUDE "inner.csg"; DRAW part;', folder=tmp_path)
    assert scene.placements[0].frames == {}


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('FRAME grip;', 'nothing is drawn yet'),
        ('DRAW part; FRAME grip; FRAME grip AT (1, 2, 3);', "part has another FRAME 'grip' already"),
        ('DRAW part; FRAME grip SCALE (2);', 'SCALE is nothing that a FRAME has'),
        ('DRAW part; FRAME grip COLOUR (1);', 'COLOUR is nothing that a FRAME has'),
        ('DRAW part; FRAME grip MATRIX (-1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0);', 'a FRAME is a rotation'),
        ('DRAW part; FRAME grip MATRIX (2, 0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0);', 'a FRAME is a rotation'),
        ('DRAW part; FRAME AT (1, 2, 3);', 'expected a name'),
        ('DRAW part; FRAM grip AT (1, 2, 3);', 'FRAME'),
    ],
)
def test_what_is_wrong_is_said(text, said):
    with pytest.raises(SceneError) as caught:
        parse_scene(BLOCK + text)
    assert said in str(caught.value)


poses = st.builds(
    lambda turn, shift: Pose.from_rotation_vector(turn, shift),
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    st.tuples(*[st.floats(-2.0, 2.0).filter(lambda x: x == 0.0 or abs(x) > 1e-6)] * 3),
)
named = st.dictionaries(st.from_regex(r'[a-z_][a-z0-9_]{0,8}', fullmatch=True), poses, max_size=4)


@settings(max_examples=60, deadline=None)
@given(named, named)
def test_frames_print_to_themselves_to_the_last_bit(first, second):
    scene = Scene([Placement('a', Solid.block(1, 1, 1), frames=first), Placement('b', Solid.sphere(1), frames=second)])
    back = parse_scene(format_scene(scene))
    assert [one.frames for one in back.placements] == [first, second]


def test_models_bring_their_frames_those_of_a_model_drawn_twice_together(tmp_path):
    path = tmp_path / 'parts.csg'
    path.write_text(
        BLOCK
        + 'DRAW part; FRAME grip AT (1, 0, 0); DRAW part AT (9, 9, 9) AS again; FRAME grip AT (2, 0, 0); FRAME rest;'
    )
    (one,) = load_placements(path)
    assert one.name == 'part' and sorted(one.frames) == ['grip', 'rest']
    assert load_known_models(path)['part'].frames['grip'].translation[0] == 0.001, 'the first counts'
