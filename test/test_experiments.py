"""The experiments and benchmarks run: every one on its smallest setting, and what they write is what they say."""

from __future__ import annotations

import copy
import dataclasses
import importlib.util
import json
import re
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent


def load(folder: str, name: str):
    """A module of test/<folder>, which is a folder of scripts and no package."""
    sys.path.insert(0, str(HERE / folder))
    spec = importlib.util.spec_from_file_location(f'{folder}_{name}', HERE / folder / f'{name}.py')
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


experiments = load('experiments', 'run')
NAMES = [item.name for item in experiments.experiments()]
BY_NAME = {item.name: item for item in experiments.experiments()}


def test_names_are_unique_and_every_table_of_the_thesis_is_covered():
    assert len(set(NAMES)) == len(NAMES)
    references = ' '.join(item.reference for item in BY_NAME.values())
    covered = set(re.findall(r'\d\.\d+', references))
    for table in (
        '4.3',
        '4.4',
        '5.1',
        '5.2',
        '5.3',
        '5.4',
        '5.5',
        '5.6',
        '5.7',
        '5.8',
        '5.9',
        '5.10',
        '5.11',
        '5.12',
        '5.13',
        '5.18',
        '5.19',
        '5.20',
        '5.21',
        '5.23',
        '5.24',
        '5.25',
        '5.28',
        '4.1',
        '6.1',
        '6.2',
        '6.5',
    ):
        assert table in covered, f'no experiment refers to {table}'


def wrong(cell, place):
    """Another value than any that the cell may have; no two cells keep their ratio."""
    if isinstance(cell, str):
        return {'yes': 'no', 'no': 'yes'}.get(cell, 'wrong')
    return cell if cell is None else (7.0 + 13.0 * place) * (cell + 100.0)


@pytest.mark.parametrize('name', NAMES)
def test_an_experiment_runs_and_its_sentence_is_of_its_rows(name):
    """Every table has its rows, and what is said of a table changes when any one of its rows is made wrong."""
    outcomes = []
    item = BY_NAME[name]
    watched = dataclasses.replace(item, run=lambda setting: outcomes.append(item.run(setting)) or outcomes[0])
    document, page = experiments.conduct(watched, tiny=True)
    json.dumps(document, default=experiments.plain)
    assert document['status'] == 'done', document['why']
    assert (page is not None) == (name == 'poses' and importlib.util.find_spec('plotly') is not None)
    (outcome,) = outcomes
    assert document['sentence'].endswith('.') and 'nan' not in document['sentence']
    assert outcome.tables and all(table.body for table in outcome.tables) and outcome.spoken
    for table in outcome.tables:
        assert any('ours' in title for title in table.columns) and len(set(table.columns)) == len(table.columns)
        assert all(len(row) == len(table.columns) for row in table.rows)
    for place in outcome.spoken:
        for number in range(len(outcome.tables[place].body)):
            tables = copy.deepcopy(outcome.tables)
            table = tables[place]
            own = ['ours' in title for title in table.columns]
            row = table.rows[number]
            table.rows[number] = [wrong(cell, k) if own[k] else cell for k, cell in enumerate(row)]
            assert outcome.say(tables) != document['sentence'], f'{table.title}: {row}'


def test_counts_and_times_of_the_thesis_stand_in_one_place():
    """The numbers that are most its own, in no other file than the two that have them."""
    root = HERE.parent
    homes = {'test/experiments/thesis.py', 'src/csg_renderer/csg_renderer/features/thesis_counts.py'}
    for pattern in (r'\b498\b', r'\b32\.8\b', r'\b15\.24\b', r'\(44, 264'):
        found = {
            str(path.relative_to(root))
            for folder in ('src', 'test')
            for path in (root / folder).rglob('*.py')
            if path.name != 'test_experiments.py' and re.search(pattern, path.read_text(encoding='utf-8'))
        }
        assert found and found <= homes, f'{pattern}: {found - homes}'


def test_results_are_kept_until_forced_and_make_a_page(tmp_path, capsys):
    arguments = ['--tiny', '--only', 'complexity', '--out', str(tmp_path)]
    assert experiments.main(arguments) == 0
    written = (tmp_path / 'complexity.json').stat().st_mtime_ns
    assert experiments.main(arguments) == 0
    assert (tmp_path / 'complexity.json').stat().st_mtime_ns == written
    assert experiments.main([*arguments, '--force']) == 0
    assert (tmp_path / 'complexity.json').stat().st_mtime_ns > written
    page = (tmp_path / 'index.html').read_text()
    assert 'Tables 5.1, 5.3, 6.1' in page and 'python test/experiments/run.py --only complexity --force' in page


def test_a_tiny_result_does_not_stand_for_a_full_one(tmp_path):
    path = tmp_path / 'x.json'
    path.write_text(json.dumps({'status': 'done', 'tiny': True}))
    assert experiments.is_done(path, tiny=True) and not experiments.is_done(path, tiny=False)
    path.write_text('{')
    assert not experiments.is_done(path, tiny=True)


def test_stopped_by_hand_the_same_command_goes_on_where_it_was(tmp_path, monkeypatch, capsys):
    conduct, begun = experiments.conduct, []

    def until_the_second(item, tiny):
        begun.append(item.name)
        if len(begun) == 2:
            raise KeyboardInterrupt
        return conduct(item, tiny)

    arguments = ['--tiny', '--only', 'complexity', 'visibility', '--out', str(tmp_path)]
    monkeypatch.setattr(experiments, 'conduct', until_the_second)
    assert experiments.main(arguments) == 130 and 'goes on' in capsys.readouterr().out
    assert (tmp_path / 'complexity.json').exists() and (tmp_path / 'index.html').exists()
    assert experiments.main(arguments) == 0 and begun == ['complexity', 'visibility', 'visibility']


def test_a_missing_capability_is_said_plainly(tmp_path):
    lab = sys.modules['lab']

    def unavailable(setting):
        raise lab.NotAvailable('there is no such scene')

    document, _ = experiments.conduct(lab.Experiment('x', 'X', '', unavailable), tiny=True)
    assert (document['status'], document['why']) == ('not available yet', 'there is no such scene')
    document['title'], document['name'] = 'X', 'x'
    sys.modules['page'].write_page(tmp_path, [document])
    assert 'not available yet: there is no such scene' in (tmp_path / 'index.html').read_text()


def test_an_unknown_experiment_is_refused_by_name(capsys):
    with pytest.raises(SystemExit):
        experiments.main(['--only', 'nothing'])
    assert "no experiment 'nothing'" in capsys.readouterr().err


def test_errors_of_the_printed_poses_are_those_the_text_states():
    thesis = sys.modules['thesis']
    curved = [thesis.VIEWS[name] for name in ('cylinder_box_v1', 'cylinder_box_v2', 'lamp_v1', 'lamp_v2')]
    shifts = [view.translation_error_mm for view in curved]
    assert sum(shifts) / 4 == pytest.approx(thesis.CURVE_MEANS['translation_mm'], abs=0.3)
    assert sum(view.rotation_error_deg for view in curved) / 4 == pytest.approx(0.5, abs=0.1)


benchmarks = load('benchmarks', 'run')


def test_printed_rows_of_a_plain_script_are_understood():
    measure = sys.modules['measure']
    line = 'clutter 50 %   chair   n=40   98.0 % of 50   median   1.75 ms  p95   2.40 ms'
    rows = list(measure.read_rows(f'{line}\nwords\n'))
    assert [(row.what, row.value, row.unit) for row in rows] == [
        ('clutter 50 % chair: success', 98.0, '%'),
        ('clutter 50 % chair', 1.75, 'ms'),
        ('clutter 50 % chair p95', 2.4, 'ms'),
    ]


def test_the_table_shows_ratios_to_peers_and_to_the_last_run():
    measure = sys.modules['measure']
    rows = [measure.Measurement('render', 5.0), measure.Measurement('render', 50.0, by='POV-Ray')]
    text = benchmarks.table(
        'renderer', rows, [measure.Absent('Open3D', 'not installed')], [{'what': 'render', 'by': 'ours', 'value': 10.0}]
    )
    assert '-50 % (better)' in text and 'ours is 10.0 times better' in text and 'not installed' in text


def test_a_slower_machine_is_told_and_its_times_are_not_judged():
    measure = sys.modules['measure']
    rows = [measure.Measurement('render', 20.0), measure.Measurement('recall', 50.0, '%', lower_is_better=False)]
    before = [{'what': 'render', 'by': 'ours', 'value': 10.0}, {'what': 'recall', 'by': 'ours', 'value': 90.0}]
    text = benchmarks.table('renderer', rows, [], before, machine_slower=2.0)
    assert '2.0 times as slow' in text and '+100 %\n' in text and '-44 % (WORSE)' in text
    assert '+100 % (WORSE)' in benchmarks.table('renderer', rows, [], before)
    assert 0.01 < measure.yardstick(3) < 1e4


def test_a_run_is_saved_and_the_next_compares_with_it(tmp_path, capsys):
    arguments = ['--quick', '--only', 'codecs', '--out', str(tmp_path)]
    assert benchmarks.main(arguments) == 0
    document = json.loads(next(tmp_path.glob('*.json')).read_text())
    assert document['machine']['kind'] and document['versions']['numpy'] and document['benchmarks']['codecs']
    assert document['yardstick_ms']['codecs'] > 0.0
    (run,) = benchmarks.earlier_runs(tmp_path, None, quick=True)
    assert run['when'] == document['when'] and not benchmarks.earlier_runs(tmp_path, None, quick=False)
    capsys.readouterr()
    assert benchmarks.main([*arguments, '--against', str(next(tmp_path.glob('*.json')))]) == 0
    assert f'compared with {document["when"]}' in capsys.readouterr().out
