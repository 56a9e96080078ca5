"""Left-heavy trees and early outs: the same picture, a shallower stack, less work; and refused where there are none."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from csg_renderer import Light, Scene, Solid, render
from csg_renderer.raycast.engines import ENGINES
from csg_renderer.raycast.programs.program import DIFFERENCE, INTERSECT, REVERSED_DIFFERENCE, UNION, postfix
from csg_renderer.raycast.programs.tree_order import early_outs, left_heavy, stack_depth
from csg_renderer.render_cli import main
from msgs_py import PinholeCamera, Pose

CAMERA = PinholeCamera.centred(64, 48, 60.0)


def plate(holes, right):
    """A plate with a row of holes, taken away one after the other, or as one union that leans to the right."""
    cutters = [
        Solid.cylinder(0.03, (0, 0, 0.2)).transformed(Pose(np.eye(3), [0.2 * k - 0.7, 0, -0.1])) for k in range(holes)
    ]
    solid = Solid.block(1.8, 0.4, 0.1).transformed(Pose(np.eye(3), [-0.9, -0.2, 0]))
    if right:
        union = cutters[-1]
        for cutter in cutters[-2::-1]:
            union = cutter | union
        solid = solid - union
    else:
        for cutter in cutters:
            solid = solid - cutter
    return solid.transformed(Pose.from_rotation_vector([0.3, 0.4, 0.1], [0, 0, 1.6]))


def evaluated(code, inside):
    """What a postfix program makes of membership (n,) in its leaves."""
    stack = []
    for op in code:
        if op >= 0:
            stack.append(inside[op])
            continue
        b, a = stack.pop(), stack.pop()
        stack.append({UNION: a or b, INTERSECT: a and b, DIFFERENCE: a and not b, REVERSED_DIFFERENCE: b and not a}[op])
    return stack[0]


trees = st.recursive(
    st.just(Solid.sphere(1.0)),
    lambda part: st.tuples(part, part, st.integers(0, 2)).map(
        lambda node: (node[0] | node[1], node[0] & node[1], node[0] - node[1])[node[2]]
    ),
    max_leaves=16,
)


@given(trees, st.integers(0, 2**16 - 1))
def test_a_left_heavy_program_means_the_same_and_never_needs_more(tree, bits):
    code = postfix(tree, 0)
    other = left_heavy(code)
    assert sorted(other[other >= 0]) == sorted(code[code >= 0]) and len(other) == len(code)
    inside = [bool(bits >> k & 1) for k in range(16)]
    assert evaluated(other, inside) == evaluated(code, inside)
    # n leaves never need more than 1 + log2(n) places.
    assert stack_depth(other) <= min(stack_depth(code), 1 + np.log2(len(tree.primitives)))
    assert np.array_equal(left_heavy(other), other)


@given(trees, st.integers(0, 2**16 - 1))
def test_an_early_out_ends_where_the_rest_means_the_same(tree, bits):
    code = left_heavy(postfix(tree, 0))
    inside = [bool(bits >> k & 1) for k in range(16)]
    jumps, stack, index = early_outs(code), [], 0
    while index < len(code):
        op = code[index]
        if op >= 0:
            stack.append(inside[op])
        else:
            b, a = stack.pop(), stack.pop()
            stack.append(evaluated([0, 1, op], [a, b]))
        while jumps[index] and not stack[-1]:
            index = jumps[index] - 1
        index += 1
    assert stack == [evaluated(code, inside)]


@pytest.mark.parametrize('right', [False, True])
def test_the_machine_draws_the_same_with_less(right):
    scene = Scene(plate(8, right), [Light((0, -3, -3))])
    plain, early, heavy, both = (
        render(scene, CAMERA, engine='dap', tiling=False, shadows=True, **options)
        for options in ({}, {'early_outs': True}, {'left_heavy': True}, {'early_outs': True, 'left_heavy': True})
    )
    for other in (early, heavy, both):
        for name in ('image', 'primitive_id', 'face_id'):
            assert np.array_equal(getattr(plain, name), getattr(other, name))
    # Of four tiles two show nothing but background.
    assert early.stats.dap_cycles < 0.95 * plain.stats.dap_cycles
    assert early.stats.intersections < plain.stats.intersections and early.stats.nodes < plain.stats.nodes
    assert heavy.stats.dap_planes <= plain.stats.dap_planes
    code = postfix(scene.solids[0], 0)
    assert (stack_depth(code), stack_depth(left_heavy(code))) == ((9, 2) if right else (2, 2))


def test_a_shallow_stack_takes_less_store():
    scene = Scene(plate(30, True), [])
    plain, heavy = (
        render(scene, CAMERA, engine='dap', tiling=False, left_heavy=option).stats.dap_planes
        for option in (False, True)
    )
    assert heavy < 0.6 * plain


@pytest.mark.parametrize('option', ['early_outs', 'left_heavy'])
def test_engines_without_an_option_refuse_it_by_name(option, capsys):
    scene = Scene(plate(2, False), [])
    for engine in set(ENGINES) - {'dap'}:
        with pytest.raises(ValueError, match=f"{option}: the engine '{engine}' has no such option, only 'dap' has"):
            render(scene, CAMERA, engine=engine, **{option: True})
    flag = f'--{option.replace("_", "-")}'
    assert main(['l_shape_v1', flag, '-q', '-o', '/nonexistent/out.png']) == 2
    assert f"render: {option}: the engine 'native' has no such option" in capsys.readouterr().err
