"""The array programs of the thesis' chapters, in Fortran-Plus, beside the native results of the packages."""

from __future__ import annotations

import numpy as np
import pytest

import csg_renderer
from csg_renderer.raycast.programs.program import program_of, view_of
from dap_emulator import Dap
from dap_emulator.fortran_plus.library import load_program
from model_matcher import MatchParams, index_model
from model_matcher.closed_form.synthetic.scenes import random_pose
from model_matcher.geometry.constraints import A_MINUS, A_PLUS, B_MINUS, B_PLUS, DIFFERENT, SAME
from model_matcher.interpretation_tree.absolute_pose import validate
from model_matcher.interpretation_tree.tables import all_pairs, build_tables, constraints_used
from model_matcher.interpretation_tree.tree import tree_search
from model_matcher.model.index import data_tolerances, feature_rows
from model_matcher.params import CONSTRAINTS
from msgs_py import FeatureKind, FeatureSet, PinholeCamera, Pose

BITS = (SAME, DIFFERENT, A_PLUS, A_MINUS, B_PLUS, B_MINUS)
# The search as the thesis prints it: ranges of end points, no elimination.
THESIS = MatchParams(ranges='corners', eliminate=False, search='tree', fracdev=1e-3, time_limit_s=60.0)
BIN_KIND = -1


def run(name, entry=None, **arguments):
    return load_program(name).run(Dap.model('510', memory_bits_per_pe=10**6, tracing=False), entry, **arguments)


def model_of(name):
    scene = csg_renderer.load_scene(csg_renderer.scene_path(name))
    return csg_renderer.model_features(scene.placements[0].model)


def seen(model, chosen, seed, noise=5e-5, clutter=0):
    """Some features of a model in the camera frame, some edges reversed, with noise and features of nothing."""
    rng = np.random.default_rng(seed)
    moved = model.transformed(random_pose(rng)).select(np.asarray(chosen))
    start, end = moved.start.copy(), moved.end.copy()
    turn = (moved.kind == 0) & (rng.random(len(start)) < 0.5)
    start[turn], end[turn] = end[turn].copy(), start[turn].copy()
    edges = moved.kind == 0
    start[edges] += rng.normal(0.0, noise, (edges.sum(), 3))
    end[edges] += rng.normal(0.0, noise, (edges.sum(), 3))
    errors = np.full(len(start), 4.0 * noise)
    data = FeatureSet(moved.kind, start, end, moved.radii, errors, errors)
    if clutter:
        extra = start.mean(axis=0) + rng.normal(0.0, 0.02, (clutter, 2, 3))
        data = FeatureSet.concatenate(
            [data, FeatureSet.from_edges(extra[:, 0], extra[:, 1], err_par=4 * noise, err_per=4 * noise)]
        )
    return data


def pairwise(model, data, params, add_bin=False):
    """The program's answer for a model and data, and the native tables."""
    index = index_model(model)
    rows = feature_rows(data)
    pairs = all_pairs(len(data))
    model_rows, model_kind = index.rows, index.kind.astype(np.int32)
    if add_bin:
        model_rows, model_kind = np.vstack([model_rows, model_rows[:1]]), np.append(model_kind, np.int32(BIN_KIND))
    result = run(
        'pairwise',
        model=model_rows,
        mkind=model_kind,
        datum=rows,
        dkind=data.kind.astype(np.int32),
        tolerance=data_tolerances(data, rows, index.size, params),
        use=constraints_used(params),
        signed=params.signs,
        datum1=pairs[:, 0] + 1,
        datum2=pairs[:, 1] + 1,
        pairs=len(pairs),
        items=len(data),
        edges=len(model_kind),
    )
    return result, build_tables(index, data, params)


def code_of(result):
    """The program's signs as the native tables hold them: (P, e, e) uint8."""
    signs = np.moveaxis(result['SIGNS'], (2, 3), (1, 0))  # (P, 6, e, e)
    return sum(signs[:, k].astype(np.uint8) * bit for k, bit in enumerate(BITS))


@pytest.mark.parametrize('name', ['l_shape_v1', 'cylinder_box_v1', 'lamp_v1'])
@pytest.mark.parametrize('signs', [True, False])
def test_pairwise_makes_the_native_tables_of_edges_curves_and_axes(name, signs):
    model = model_of(name)
    rng = np.random.default_rng(3)
    data = seen(model, rng.permutation(len(model))[:7], seed=4, clutter=2)
    result, native = pairwise(model, data, THESIS.replace(signs=signs))
    assert len(set(data.kind.tolist())) == (1 if name == 'l_shape_v1' else 3)
    assert np.array_equal(code_of(result), native.code)
    assert np.array_equal(np.moveaxis(result['MATCH'], 2, 0), native.match)
    assert np.array_equal(result['MATCHSUM'], native.sums) and 0 < native.match.mean() < 0.5


@pytest.mark.parametrize('constraint', CONSTRAINTS)
def test_each_constraint_alone_is_the_native_one(constraint):
    model = model_of('chipped_block_v1')
    data = seen(model, [0, 3, 4, 8, 11], seed=1)
    result, native = pairwise(model, data, THESIS.replace(constraints=(constraint,)))
    assert np.array_equal(code_of(result), native.code)
    assert 0 < native.match.mean() < 1


def with_bin(native):
    """Native tables as PAIRWISE makes them, with a model feature that stands for the bin."""
    count, e, _ = native.code.shape
    match, signs = np.zeros((count, e + 1, e + 1), bool), np.zeros((count, 6, e + 1, e + 1), bool)
    first, second = native.pairs.T
    match[:, :e, :e] = native.match
    match[:, :e, e], match[:, e, :e], match[:, e, e] = native.unary[first], native.unary[second], True
    for k, bit in enumerate(BITS):
        signs[:, k, :e, :e] = native.code & bit != 0
    return {'match': np.moveaxis(match, 0, 2), 'signs': np.moveaxis(signs, (0, 1), (3, 2)), 'sums': native.sums}


def traverse(tables, data, bins, params, noi=200):
    pairs = all_pairs(len(data))
    items = {'items': len(data), 'n': len(pairs)}
    order = run('sorts', 'COMBINED', matchsum=tables['sums'], datum2=pairs[:, 1] + 1, **items)
    return run(
        'tree',
        match=tables['match'],
        signs=tables['signs'],
        datum1=pairs[:, 0] + 1,
        datum2=pairs[:, 1] + 1,
        order=order['ORDER'],
        bins=bins,
        pairs=len(pairs),
        items=len(data),
        signed=params.signs,
        most=params.max_bin,
        noi=noi,
    )


def interpretations(found):
    """The program's interpretations as a set of (model features from 0, -1 the bin; signs)."""
    columns = range(found['COUNT'])
    return {(tuple(found['FOUND'][:, k] - 1), tuple(found['SIGN'][:, k])) for k in columns}


@pytest.mark.parametrize(
    ('most', 'clutter', 'signs'), [(0, 0, True), (0, 0, False), (1, 1, True), (1, 1, False), (3, 2, True)]
)
def test_the_tree_finds_the_native_interpretations_with_signs_and_bin(most, clutter, signs):
    model = model_of('l_shape_v1')
    data = seen(model, [0, 3, 9, 12, 7][: 5 - clutter // 2], seed=6, clutter=clutter)
    params = THESIS.replace(ranges='exact', signs=signs, max_bin=most, min_matched=1)
    native = build_tables(index_model(model), data, params)
    found = traverse(with_bin(native), data, np.arange(len(model) + 1) == len(model), params)
    expected = tree_search(native, params, limit=200)
    assert expected.complete and 0 < len(expected.assignments) < 200
    wanted = {
        (tuple(row), tuple(sign) if signs else (0,) * len(row))
        for row, sign in zip(expected.assignments, expected.signs)
    }
    assert interpretations(found) == wanted
    assert found['INBIN'] == clutter == int((expected.assignments[0] < 0).sum())


def test_pairwise_marks_what_the_bin_agrees_with():
    model = model_of('cylinder_box_v1')
    data = seen(model, [0, 4, 9, 12, 14], seed=8)
    result, native = pairwise(model, data, THESIS, add_bin=True)
    wanted = with_bin(native)
    assert np.array_equal(result['MATCH'], wanted['match']) and np.array_equal(result['SIGNS'], wanted['signs'])
    assert np.array_equal(result['MATCHSUM'], wanted['sums'])


def test_curves_and_axes_go_from_pairwise_through_the_tree():
    model = model_of('cylinder_box_v1')
    kinds = index_model(model).kind
    chosen = np.concatenate([np.flatnonzero(kinds == kind)[:2] for kind in (0, 1, 2)])
    data = seen(model, chosen, seed=2)
    params = THESIS.replace(max_bin=0, min_matched=1)
    tables, native = pairwise(model, data, params)
    lower = {'match': tables['MATCH'], 'signs': tables['SIGNS'], 'sums': tables['MATCHSUM']}
    found = traverse(lower, data, np.zeros(len(model), bool), params)
    expected = tree_search(native, params, limit=200)
    assert {row for row, _ in interpretations(found)} == {tuple(row) for row in expected.assignments}
    assert tuple(chosen) in {row for row, _ in interpretations(found)}


# Chapter 4.

KINDS = {'BLOCK': 0, 'CYLINDER': 1, 'CONE': 2, 'SPHERE': 3}
LETTERS = {-1: 'U', -2: 'I', -3: 'D'}


def cast_tile(scene, camera):
    """One tile through the program, from the flat scene that the engines of csg_renderer work on."""
    program = program_of(scene)
    view = view_of(program, scene.camera_T_scene)
    codes = [list(code) for code in program.children]
    tree = sum(codes, []) + [-1] * (len(codes) - 1)
    return run(
        'raycast',
        kind=[KINDS[leaf.kind] for leaf in program.leaves],
        inverse=np.moveaxis(program.inverse[:, :3], 0, 2),
        leaves=len(program.leaves),
        operators=''.join('0' if op >= 0 else LETTERS[op] for op in tree),
        objects=[max(op, -1) + 1 for op in tree],
        n=len(tree),
        colours=program.colours.T,
        material=program.material[:, :4].T,
        light=program.lights.T,
        lightcolour=program.light_colours.T,
        lights=len(program.lights),
        ambient=program.ambient_light,
        background=program.background,
        camera=view.scene_T_camera[:3],
        centre=[camera.cx, camera.cy],
        focal=[camera.fx, camera.fy],
        close=view.tolerance,
        rows=camera.height,
        columns=camera.width,
    )


def solid_of_all_kinds():
    """A block with a cone drilled in and a ball on it, cut by a cylinder: every primitive and every operator."""
    gloss = csg_renderer.Surface((0.7, 0.5, 0.2), ambient=0.3, diffuse=0.5, specular=0.4, shininess=12.0)
    block = csg_renderer.Solid.block(0.06, 0.05, 0.04).painted(gloss)
    cone = csg_renderer.Solid.primitive('CONE', np.diag([0.014, 0.014, -0.05, 1.0])).transformed(
        Pose(np.eye(3), (0.023, 0.027, 0.045))
    )
    ball = csg_renderer.Solid.sphere(0.02).transformed(Pose(np.eye(3), (0.055, 0.02, 0.01)))
    round_off = csg_renderer.Solid.primitive('CYLINDER', np.diag([0.037, 0.037, 0.2, 1.0])).transformed(
        Pose(np.eye(3), (0.035, 0.025, -0.1))
    )
    return ((block - cone) | ball) & round_off


@pytest.mark.parametrize('name', ['all kinds', 'l_shape_v1', 'cylinder_box_v1', 'lamp_v1'])
def test_a_tile_is_cast_as_the_native_engine_casts_it(name):
    camera = PinholeCamera(32, 32, 44.0, 44.0, 15.5, 15.5)
    if name == 'all kinds':
        turn = Pose(np.array([[0.8, -0.36, 0.48], [0.0, 0.8, 0.6], [-0.6, -0.48, 0.64]]), (-0.03, -0.04, 0.13))
        lights = [csg_renderer.Light((0.1, -0.2, -0.3), (0.9, 0.8, 0.7)), csg_renderer.Light((-0.3, 0.1, -0.1))]
        light, dark = (0.4, 0.5, 0.6), (0.1, 0.0, 0.2)
        scene = csg_renderer.Scene([solid_of_all_kinds()], lights, light, dark, camera_T_scene=turn)
    else:
        scene = csg_renderer.load_scene(csg_renderer.scene_path(name))
    frame = csg_renderer.render(scene, camera)
    result = cast_tile(scene, camera)
    seen = frame.primitive_id >= 0
    assert 0.05 < seen.mean() < 0.95 and len(np.unique(frame.primitive_id)) > 2
    if name == 'all kinds':
        assert np.bincount(frame.primitive_id[seen], minlength=4).min() > 10
    assert np.array_equal(result['OBJECT'] - 1, frame.primitive_id)
    assert np.array_equal(np.where(seen, result['FACE'], -1), frame.face_id)
    assert np.allclose(result['DEPTH'][seen], frame.depth[seen], rtol=1e-6)
    towards = np.where(np.einsum('hwc,hwc->hw', frame.normal, result['NORMAL'])[..., None] < 0, -1.0, 1.0)
    assert np.allclose(result['NORMAL'][seen], (towards * frame.normal)[seen], atol=1e-6)
    grey = np.rint(255.0 * np.clip(result['IMAGE'], 0.0, 1.0))
    assert np.abs(grey - frame.image).max() <= 1


# Sections 5.6 and 5.9.


def validated(model, data, assignments, signs, params):
    index = index_model(model)
    ends = np.stack([data.start, data.end], axis=1)  # (n, 2, 3)
    rows = feature_rows(data)
    curves = data.kind == FeatureKind.CURVE
    ends[curves] = rows[curves, None, :3]
    return run(
        'validate',
        model=index.rows.T,
        datum=rows.T,
        kind=data.kind.astype(np.int32),
        ends=np.moveaxis(ends, 0, 2).swapaxes(0, 1),
        assigned=np.asarray(assignments) + 1,
        sign=np.asarray(signs).astype(np.int32),
        e=len(index),
        n=len(data),
        m=len(assignments),
        sizeof=index.size,
        maxradius=float(index.max_radius),
        fracdev=params.fracdev,
        curvedev=params.curvedev,
    )


@pytest.mark.parametrize('name', ['l_shape_v1', 'cylinder_box_v1', 'lamp_v1'])
def test_64_interpretations_are_validated_as_the_native_ones_are(name):
    model = model_of(name)
    index = index_model(model)
    rng = np.random.default_rng(5)
    kinds = np.unique(index.kind)
    chosen = np.concatenate([rng.permutation(np.flatnonzero(index.kind == kind))[: 9 // len(kinds)] for kind in kinds])
    n = len(chosen)
    data = seen(index.features, chosen, seed=9, noise=1e-4)
    assignments = np.tile(chosen, (64, 1))
    for k in range(1, 64):  # the true one, with one to three features somewhere else of their kind, or in the bin
        for place in rng.permutation(n)[: 1 + k % 3]:
            same_kind = np.flatnonzero(index.kind == data.kind[place])
            assignments[k, place] = rng.choice(same_kind) if rng.random() < 0.7 else -1
    signs = np.where(rng.random(assignments.shape) < 0.5, rng.choice([-1, 1], assignments.shape), 0)
    signs[::4] = 0
    true_directions = index.rows[chosen, 3:6] @ random_pose(np.random.default_rng(9)).rotation.T  # as seen() turns them
    true = np.where(np.einsum('ij,ij->i', true_directions, feature_rows(data)[:, 3:6]) > 0.0, 1, -1)
    signs[:8] = np.where(rng.random((8, n)) < 0.5, true, 0)
    signs[:8, 0] = true[0]
    for k in range(64):  # directions that are parallel in the model only leave the turn open: such signs are not given
        signed = (assignments[k] >= 0) & (signs[k] != 0)
        if signed.sum() > 1 and np.linalg.svd(index.rows[assignments[k][signed], 3:6], compute_uv=False)[1] < 0.1:
            signs[k] = 0
    params = THESIS.replace(fracdev=0.01)
    native = validate(index.features, data, assignments, signs, params.fracdev, params.curvedev, index.size)
    result = validated(index.features, data, assignments, signs, params)
    assert native.valid[0] and not native.valid.all()
    assert np.isnan(native.free_turn).all() and np.isnan(native.free_shift).all()
    poses = np.stack([pose.rotation for pose in native.poses]), np.stack([pose.translation for pose in native.poses])
    # A wrong interpretation may leave its rotation nearly open, which rounding then decides.
    assert np.allclose(result['ROTATION'], poses[0], atol=1e-5) and np.allclose(result['SHIFT'], poses[1], atol=1e-6)
    assert np.median(np.abs(result['ROTATION'] - poses[0]).max(axis=(1, 2))) < 1e-12
    matched = assignments >= 0
    assert np.array_equal(np.where(matched, result['SIGN'], 0), np.where(matched, native.signs, 0))
    assert np.allclose(result['DEVIATION'][matched], native.deviations[matched], atol=1e-6)
    assert np.array_equal(result['PASSED'], native.passed) and np.array_equal(result['VALID'], native.valid)
