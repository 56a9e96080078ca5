"""Solids made from Python: what they are made of, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from csg_renderer import Solid, Surface
from csg_renderer.scene.solid import Operation, Primitive
from msgs_py import Pose

BLOCK, BALL = Solid.block(1, 2, 3), Solid.sphere(1)


def test_a_tree_keeps_its_leaves_in_order_when_moved_and_painted():
    tree = (BLOCK | BALL) - Solid.cone(1, (0, 0, 2))
    red = Surface(colour=(1.0, 0.0, 0.0))
    changed = tree.transformed(Pose(np.eye(3), [1, 2, 3])).painted(red)
    assert [leaf.kind for leaf in changed.primitives] == ['BLOCK', 'SPHERE', 'CONE']
    assert all(leaf.surface == red for leaf in changed.primitives)
    np.testing.assert_allclose(changed.primitives[1].matrix[:3, 3], [1, 2, 3])
    assert tree.halfspaces == 6 + 1 + 2


def test_nothing_united_cut_or_moved_is_nothing():
    nothing = Solid.empty()
    assert not (nothing & BALL).primitives and not (nothing - BALL).primitives and (BALL - nothing) is BALL
    assert (nothing | BALL) is BALL and nothing.transformed(np.eye(4)).painted(Surface()) is nothing


def test_solids_say_what_they_are():
    assert repr(BALL).startswith("Solid.primitive('SPHERE', [[1.0") and repr(Solid.empty()) == 'Solid.empty()'
    assert repr(BLOCK | BALL) == '<UNION of 2 primitives>'


@pytest.mark.parametrize(
    ('make', 'named'),
    [
        (lambda: Solid.primitive('BALL'), "kind: expected one of .*, got 'BALL'"),
        (lambda: Solid.primitive('BLOCK', np.eye(3)), 'matrix: expected'),
        (lambda: Solid.primitive('BLOCK', np.full((4, 4), np.nan)), 'matrix: expected'),
        (lambda: Solid.primitive('BLOCK', np.ones((4, 4))), 'matrix: last row'),
        (lambda: Solid.primitive('BLOCK', np.diag([1, 0, 1, 1])), 'matrix: flattens the BLOCK'),
        (lambda: Primitive('SPHERE', np.eye(4), face_colours=np.full((1, 3), 2.0)), 'face_colours: expected'),
        (lambda: Solid.plane((0, 0, 0), 1.0), 'normal: expected'),
        (lambda: Solid.cylinder(1.0, (0, 0)), 'axis: expected three numbers'),
        (lambda: Solid.cylinder(1.0, (0, 0, 0)), 'axis: its length is zero'),
        (lambda: Operation('XOR', BLOCK, BALL), "operator: expected one of .*, got 'XOR'"),
        (lambda: Operation('UNION', BLOCK, 3), 'right: expected a Solid, got int'),  # type: ignore[arg-type]
        (lambda: BLOCK.transformed(np.eye(3)), 'placement: expected'),
        (lambda: Solid.empty().transformed(np.eye(3)), 'placement: expected'),
        (lambda: Surface(shininess=-1.0), 'shininess: expected'),
    ],
)
def test_what_is_no_solid_is_refused_by_the_arguments_name(make, named):
    with pytest.raises(ValueError, match=named):
        make()
