"""An index of models: found as in a library, updated by what has changed, refused when it is damaged, shared out."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from csg_renderer import Solid, model_features
from model_matcher import MatchParams, index_cli, match_cli, recognise
from model_matcher.catalogue.build import indexed_model, write_catalogue
from model_matcher.catalogue.catalogue import Share, open_catalogue, size_classes
from model_matcher.catalogue.folder import checked_answer, read_file, update_catalogue
from model_matcher.catalogue.lookup import Hits, ScenePairs, agreement, by_model, models_hit
from model_matcher.catalogue.merging import merged
from model_matcher.catalogue.pair_table import no_pairs
from model_matcher.catalogue.records import Models, Postings, Scale, on_scale
from model_matcher.closed_form.synthetic.scenes import (
    chair,
    cylinder_box,
    fragment,
    make_scene,
    random_polyhedron,
    tubes,
)
from model_matcher.model.problem import make_problem
from model_matcher.pipeline import survey
from model_matcher.verification.settings import FALSE_ALARMS
from msgs_py import BIN, FeatureSet, Interpretation, Pose

COUNT = 120


@pytest.fixture(scope='module')
def path(tmp_path_factory):
    """An index of random polyhedra, and of a part with curves and one of curves alone."""
    path = tmp_path_factory.mktemp('catalogue') / 'parts.index'
    models = {**{f'm{k}': random_polyhedron(k) for k in range(COUNT)}, 'can': cylinder_box(), 'tubes': tubes()}
    write_catalogue(path, [indexed_model(features, name) for name, features in models.items()])
    return path


@pytest.fixture(scope='module')
def catalogue(path):
    return open_catalogue(path)


@pytest.mark.parametrize('which', [3, 17, 58, 119, COUNT, COUNT + 1])
def test_the_right_model_is_found_at_its_pose_among_clutter(catalogue, which):
    scene = make_scene(catalogue.feature_set(which), which, clutter=0.5)
    best = recognise(catalogue, scene.data)[0]
    assert best.model == catalogue.names[which]
    errors = [pose.error_to(scene.poses[0]) for pose in (best.pose, *best.symmetric_poses)]
    assert min(error.translation for error in errors) < 0.003 and min(error.rotation_deg for error in errors) < 3.0


def test_two_objects_of_a_scene_are_both_found(catalogue):
    scenes = [make_scene(catalogue.feature_set(k), 7 + k) for k in (5, 40)]
    apart = scenes[1].data.transformed(type(scenes[0].poses[0])(np.eye(3), np.array([0.3, 0.0, 0.0])))
    found = recognise(catalogue, FeatureSet.concatenate([scenes[0].data, apart]))
    assert {one.model for one in found} >= {'m5', 'm40'}


def test_the_false_alarm_rate_is_that_of_all_models_together(catalogue):
    scene = make_scene(catalogue.feature_set(17), 3, clutter=0.5)
    params = MatchParams(false_alarm_rate=0.01)
    best = survey(catalogue, scene.data, params).best
    alone = survey([catalogue.model(17)], scene.data, params).best
    assert best.model == alone.model == 'm17'
    # Of all models together chance tries as many poses as of one; each of them may be like what stands there.
    tried = make_problem(catalogue.model(17), scene.data, params).hypotheses
    more = (tried + len(catalogue) * FALSE_ALARMS.alike) / (tried + FALSE_ALARMS.alike)
    assert best.chance == pytest.approx(more * alone.chance)


def test_what_a_scene_picks_is_made_ready_once(catalogue):
    model = catalogue.model(17)
    picked = catalogue.one_of_all(model)
    assert picked.library == len(catalogue) and model.library == 1
    assert catalogue.one_of_all(catalogue.model(17)) is picked


def test_what_is_not_in_the_index_is_not_found(catalogue):
    scene = make_scene(chair(), 1, clutter=0.5)
    result = survey(catalogue, scene.data)
    assert not result and result.reason and result.stats['models'] == COUNT + 2


def test_nothing_to_look_for_and_nothing_to_look_in(catalogue, tmp_path):
    assert 'no features' in survey(catalogue, FeatureSet.empty()).reason or not survey(catalogue, FeatureSet.empty())
    write_catalogue(tmp_path / 'empty.index', [])
    empty = open_catalogue(tmp_path / 'empty.index')
    assert len(empty) == 0
    assert survey(empty, make_scene(chair(), 1).data).reason == 'there are no models'


def test_features_are_kept_to_the_last_digits(catalogue):
    for number, features in ((3, random_polyhedron(3)), (COUNT, cylinder_box())):
        kept = catalogue.feature_set(number)
        np.testing.assert_array_equal(kept.kind, features.kind)
        for name in ('start', 'end', 'radii'):
            np.testing.assert_allclose(getattr(kept, name), getattr(features, name), rtol=0, atol=1e-15)


def test_shares_have_every_model_once_and_one_of_them_finds_it(path):
    shares = [open_catalogue(path, Share(k, 3), check=False) for k in (1, 2, 3)]
    assert [one.first for one in shares[1:]] == [one.last for one in shares[:-1]]
    assert shares[0].first == 0 and shares[-1].last == COUNT + 2
    scene = make_scene(shares[0].feature_set(58), 58, clutter=0.5)
    found = [[one.model for one in recognise(share, scene.data)] for share in shares]
    assert [names[:1] for names in found] == [[], ['m58'], []]


@pytest.mark.parametrize('text', ['0/2', '3/2', 'a/b', '2', '1/0', '/'])
def test_a_share_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match='expected a share such as 2/8'):
        Share.parse(text)
    assert Share.parse('') == Share() == Share.parse('1/1')


def test_errors_are_equal_everywhere_on_the_scale():
    scale = Scale(0.001, 0.012)
    for x in (0.0005, 0.02, 0.3):
        error = np.hypot(scale.floor, scale.share * x)
        assert on_scale(x + error, *scale) - on_scale(x, *scale) == pytest.approx(1.0, abs=0.12)


def test_classes_of_sizes_hold_every_model():
    sizes = np.array([0.01, 0.02, 0.0201, 0.5])
    largest, classes = size_classes(sizes)
    assert (largest[classes] >= sizes).all() and largest[-1] == 0.5
    assert (size_classes(np.full(3, 0.1))[1] == 0).all()


# -- the file --------------------------------------------------------------------------------------------------------


def test_a_damaged_file_is_refused_by_name(path, tmp_path):
    data = path.read_bytes()
    middle = len(data) // 2  # in an array of pairs
    cases = {
        'flipped': (data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :], 'does not have its checksum'),
        'header': (data[:60] + b'?' + data[61:], 'the header does not have its checksum'),
        'short': (data[: len(data) // 2], 'does not fit'),
        'stub': (data[:10], 'cut off'),
        'later': (data[:8] + b'\x09' + data[9:], 'version 9, expected 1: make it again'),
        'other': (b'PK' + data[2:], 'not an index of models'),
    }
    for name, (content, words) in cases.items():
        broken = tmp_path / f'{name}.index'
        broken.write_bytes(content)
        with pytest.raises(ValueError, match=words) as error:
            open_catalogue(broken)
        assert str(error.value).startswith(str(broken)) and '\n' not in str(error.value)
    with pytest.raises(FileNotFoundError):
        open_catalogue(tmp_path / 'none.index')


def test_what_is_damaged_is_passed_over_until_the_checksums_are_compared(path, tmp_path):
    """Models and features that are not there are not looked up, whatever numbers a file has."""
    data = np.fromfile(path, np.uint8)
    damaged = open_catalogue(path).postings
    for name in ('owner', 'members', 'spans'):
        array = getattr(damaged, name).view(np.uint8).reshape(-1)
        at = data.tobytes().find(array.tobytes())
        noise = np.random.default_rng(at).integers(0, 256, (2, len(array)))
        data[at : at + len(array)] = np.where(noise[0] < 50, noise[1], array)
    index = tmp_path / 'parts.index'
    data.tofile(index)
    catalogue = open_catalogue(index, check=False)
    for which in (3, 58, COUNT):
        survey(catalogue, make_scene(catalogue.feature_set(which), which, clutter=0.5).data)
    with pytest.raises(ValueError, match='array pair_owner does not have its checksum') as error:
        catalogue.check()
    assert str(error.value).startswith(str(index))


def test_a_file_is_replaced_whole_or_not_at_all(path, tmp_path, monkeypatch):
    index = tmp_path / 'parts.index'
    shutil.copy(path, index)
    opened = open_catalogue(index)
    write_catalogue(index, [indexed_model(chair(), 'chair')])
    assert len(opened) == COUNT + 2 and opened.feature_set(3) == open_catalogue(path).feature_set(3)
    assert open_catalogue(index).names == ('chair',)
    monkeypatch.setattr('model_matcher.catalogue.build.write_pairs', lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_catalogue(index, [indexed_model(tubes(), 'tubes')])
    assert open_catalogue(index).names == ('chair',) and [one.name for one in tmp_path.iterdir()] == ['parts.index']


# -- folders ---------------------------------------------------------------------------------------------------------


def test_only_what_has_changed_is_read_again(tmp_path):
    folder, index = tmp_path / 'parts', tmp_path / 'parts.index'
    (folder / 'more').mkdir(parents=True)
    random_polyhedron(1).save(folder / 'a.npz')
    random_polyhedron(2).save(folder / 'more' / 'a.npz')
    (folder / 'size.csg').write_text('size = 40;')
    (folder / 'block.csg').write_text('UNITS MM; INCLUDE "size.csg"; block = BLOCK (size, 30, 20); DRAW block;')
    (folder / 'torn.stl').write_text('solid')
    first = update_catalogue(folder, index)
    assert (first.files, first.read, first.kept, first.removed) == (5, 5, 0, 0)
    assert [one.split(':')[0] for one in first.problems] == ['torn.stl']
    catalogue = open_catalogue(index)
    assert catalogue.names == ('a', 'block', 'a_2')
    assert catalogue.feature_set(1).lengths.max() == pytest.approx(0.04)

    again = update_catalogue(folder, index)
    assert (again.read, again.kept, again.models) == (0, 5, 3) and again.problems == first.problems
    (folder / 'size.csg').write_text('size = 50;')  # what it includes has changed, and with it the block
    (folder / 'a.npz').unlink()
    random_polyhedron(3).save(folder / 'b.npz')
    third = update_catalogue(folder, index)
    assert (third.read, third.kept, third.removed) == (3, 2, 1)
    catalogue = open_catalogue(index)
    assert catalogue.names == ('b', 'block', 'a')
    assert catalogue.feature_set(1).lengths.max() == pytest.approx(0.05)
    assert catalogue.feature_set(2).start == pytest.approx(random_polyhedron(2).start, abs=1e-15)
    assert update_catalogue(folder, index, mesh_units='mm').read == 5  # units of meshes are part of what was read


def test_a_scene_file_beside_the_index_gives_outlines_and_frames(tmp_path):
    text = 'UNITS MM; part = BLOCK (40, 30, 20); DRAW part; FRAME grip AT (1, 2, 3);'
    (tmp_path / 'part.csg').write_text(text)
    update_catalogue(tmp_path, tmp_path / 'models.index')
    catalogue = open_catalogue(tmp_path / 'models.index')
    model = catalogue.outlined(catalogue.model(0))
    assert model.shape is not None and model.shape.box[1].tolist() == pytest.approx([0.04, 0.03, 0.02])
    assert model.frames['grip'].translation.tolist() == pytest.approx([0.001, 0.002, 0.003])
    (tmp_path / 'part.csg').write_text(text + ' ')
    catalogue = open_catalogue(tmp_path / 'models.index')
    assert catalogue.outlined(catalogue.model(0)).shape is None  # it is not what was indexed


def test_a_mesh_beside_the_index_gives_its_outline_in_the_units_of_the_index(tmp_path):
    trimesh.creation.box((4.0, 3.0, 2.0)).export(tmp_path / 'part.stl')
    update_catalogue(tmp_path, tmp_path / 'models.index', mesh_units='cm')
    catalogue = open_catalogue(tmp_path / 'models.index')
    model = catalogue.outlined(catalogue.model(0))
    assert model.shape is not None and model.shape.box[1].tolist() == pytest.approx([0.02, 0.015, 0.01])


def test_a_worker_reads_what_this_machine_reads_and_its_answer_is_looked_at(tmp_path):
    model_features(Solid.block(0.04, 0.03, 0.02)).save(tmp_path / 'brick.npz')
    one = read_file(str(tmp_path), 'brick.npz', 'guess')
    assert checked_answer('brick.npz', tuple(one)).models[0].name == 'brick' and not one.problem
    for answer in (
        None,
        7,
        ('other.npz', {}, ()),
        tuple(one._replace(models=(one.models[0]._replace(kind=one.path),))),
    ):
        assert 'the answer of a worker is none' in checked_answer('brick.npz', answer).problem


def test_the_command_says_what_it_did(tmp_path, capsys):
    folder = tmp_path / 'parts'
    folder.mkdir()
    assert index_cli.main([str(folder), '--json']) == 1
    assert json.loads(capsys.readouterr().out)['models'] == 0
    (folder / 'models.index').unlink()
    for k in range(3):
        random_polyhedron(k).save(folder / f'p{k}.npz')
    assert index_cli.main([str(folder), '--json', '-q', '--workers', '2']) == 0
    record = json.loads(capsys.readouterr().out)
    assert (record['models'], record['read'], record['kept']) == (3, 3, 0)
    for arguments, words in (
        ([str(tmp_path / 'none')], 'no such folder'),
        ([str(folder), '-o', str(folder / 'p0.npz')], 'it is not overwritten'),
        ([str(folder), '--workers', '0'], '--workers: expected a number from 1 on'),
    ):
        assert index_cli.main(arguments) == 2
        assert words in capsys.readouterr().err.splitlines()[-1]


def test_match_takes_an_index_for_a_model(path, tmp_path, capsys):
    scene = make_scene(open_catalogue(path).feature_set(17), 17, clutter=0.5)
    scene.data.save(tmp_path / 'data.npz')
    arguments = [str(path), str(tmp_path / 'data.npz'), '--json', '-o', str(tmp_path / 'found.png')]
    assert match_cli.main(arguments) == 0
    assert json.loads(capsys.readouterr().out)['found'][0]['model'] == 'm17' and (tmp_path / 'found.png').exists()
    (tmp_path / 'torn.index').write_bytes(path.read_bytes()[:-99999])
    assert match_cli.main([str(tmp_path / 'torn.index'), *arguments[1:]]) == 2
    assert 'damaged' in capsys.readouterr().err


# -- shares put together ---------------------------------------------------------------------------------------------


def explains(model, data, evidence, reason=None):
    """An interpretation of so many of ten data features."""
    assignment = np.full(10, BIN)
    assignment[data] = np.arange(len(data))
    sign = np.where(assignment == BIN, 0, 1)
    return Interpretation(model, assignment, sign, Pose.identity(), evidence=evidence, rejected_reason=reason)


def test_the_best_explanation_of_each_piece_of_data_wins_whatever_share_it_is_from():
    first = [explains('a', [0, 1, 2, 3], 30.0), explains('b', [6, 7, 8, 9], 20.0)]
    second = [explains('c', [1, 2, 3], 40.0), explains('d', [4, 5, 9, 8], 18.0), explains('e', [4, 5], 5.0, 'too few')]
    accepted, rejected = merged([first, second])
    assert [one.model for one in accepted] == ['c', 'b'] and [one.model for one in rejected] == ['a', 'd', 'e']
    assert rejected[0].rejected_reason == 'competes for the same data with c (evidence 30.0 against 40.0 nats)'
    again = merged([second, first])
    assert [[one.model for one in ones] for ones in again] == [['c', 'b'], ['a', 'd', 'e']]
    assert merged([]) == merged([[], []]) == ((), ())


def test_what_loses_a_little_of_its_data_explains_the_rest():
    accepted, rejected = merged([[explains('a', [0, 1, 2, 3], 30.0)], [explains('b', [3, 4, 5, 6, 7], 20.0)]])
    assert [one.model for one in accepted] == ['a', 'b'] and not rejected
    assert accepted[1].matched == 4 and accepted[1].assignment[3] == BIN and accepted[1].sign[3] == 0


def test_shares_that_saw_different_data_cannot_be_put_together():
    other = Interpretation('b', [0, 1], [1, 1], Pose.identity())
    with pytest.raises(ValueError, match='of different data: a, b'):
        merged([[explains('a', [0, 1], 9.0)], [other]])


# -- votes -----------------------------------------------------------------------------------------------------------


@given(st.lists(st.lists(st.integers(0, 7), max_size=6), min_size=1, max_size=5))
def test_hits_are_sorted_by_model_and_in_it_by_pair(owners):
    """Posting k is a pair of model k; owners : of each data pair, the models that it hits."""
    found = np.array([2 * owner for row in owners for owner in row], np.int64)
    limits = np.concatenate([[0], np.cumsum([len(row) for row in owners])]).astype(np.int64)
    hits = Hits(np.zeros(9, np.int64), np.empty(len(found), np.int64), np.empty(len(found), np.int32))
    by_model(found, limits, np.arange(8, dtype=np.uint32), hits)
    expected = sorted((owner, p) for p, row in enumerate(owners) for owner in row)
    assert list(zip((hits.hits // 2).tolist(), hits.pair.tolist())) == expected
    assert np.diff(hits.starts).tolist() == [sum(row.count(model) for row in owners) for model in range(8)]
    counts = np.zeros(len(owners), np.int64)
    models_hit(hits, counts)
    assert counts.tolist() == [len(set(row)) for row in owners]


def test_pairs_agree_on_what_more_than_one_of_them_says():
    """Data pairs (0, 1) and (0, 2), worth 2 and 3 nats, agree on where 0 lies in the first model, not in the second."""
    pairs = ScenePairs(np.array([[0, 1], [0, 2]], np.int32), np.zeros(2, np.uint8), np.full((2, 1), -1, np.int32))
    members = np.array([[4, 5], [4, 6], [6, 4], [4, 5], [5, 6]], np.uint16)
    postings = Postings(no_pairs(), np.array([0, 0, 0, 1, 1], np.uint32), members, np.zeros((5, 5), np.float32))
    # Of the first model the first pair hits one, the second two, of which the latter the other way round.
    hits = Hits(np.array([0, 3, 5]), np.array([0, 2, 5, 6, 8]), np.array([0, 1, 1, 0, 1], np.int32))
    models = Models(np.array([0, 7, 14]), *(np.zeros(0),) * 5)
    support, nats = np.empty(5, np.float32), np.zeros(2, np.float32)
    agreement(pairs, hits, np.array([2.0, 3.0]), models, postings, 0, 2, support, nats)
    assert nats.tolist() == [2.0, 0.0]  # the larger vote for 0 on 4 is no agreement, the smaller one is
    assert support == pytest.approx([2.0, 2.0 - np.log(2.0), 2.0 - np.log(2.0), 0.0, 0.0])


def test_a_part_of_whose_edges_only_pieces_are_seen_is_found(catalogue):
    rng = np.random.default_rng(4)
    pose = Pose.from_rotation_vector([0.4, -0.8, 0.3], [0.02, 0.0, 0.4])
    for which in (17, 58, 119):
        data, _, _ = fragment(catalogue.feature_set(which).transformed(pose), rng, visible=1.0, break_chance=1.0)
        assert recognise(catalogue, data)[0].model == catalogue.names[which]
