"""plan_rig: from a part and cameras to a verdict, a table of other cameras and a page; stopped, and taken up again."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from model_matcher.closed_form.case import Limits
from model_matcher.closed_form.planning.judging import judged, off_by
from model_matcher.closed_form.planning.part import load_part
from model_matcher.closed_form.planning.plan import NO, OPEN, YES, Aims, Findings
from model_matcher.closed_form.planning.plan_cli import main, plan_parser, task_of
from model_matcher.closed_form.planning.rates import Rate
from msgs_py import Pose

CAMERAS = ['--size', '320', '240', '--focal', '380', '--baseline', '50']
COMMAND = ['wedge', '--distance', '180', '260', *CAMERAS, '--workers', '1', '-q']


@pytest.fixture(scope='module')
def planned(tmp_path_factory):
    """Folder, and arguments that fill it quickly."""
    folder = tmp_path_factory.mktemp('plan')
    few = ['--views', '6', '--trials', '3', '--empty', '1', '--clutter', '1', '-o', str(folder)]
    main([*COMMAND, *few])
    return folder, [*COMMAND, *few]


def test_a_plan_has_a_verdict_rates_maps_and_other_cameras(planned, capsys):
    folder, arguments = planned
    before = (folder / 'results.jsonl').read_text()
    assert main([*arguments, '--json']) in (0, 1)
    record = json.loads(capsys.readouterr().out)
    assert (folder / 'results.jsonl').read_text() == before  # all of it was done already
    assert record['recognised']['count'] == 3 and record['false_alarms']['count'] == 1
    assert re.match(r'(Yes|No|Not decided): wedge is found within 1 mm and 0.5 degrees in ', record['verdict'])
    as_it_is, *others = record['other_cameras'].values()
    assert len(others) >= 10 and 1e-6 < as_it_is[0] < as_it_is[1]
    assert record['other_cameras']['baseline 100 mm'][0] < as_it_is[0] < record['other_cameras']['baseline 25 mm'][0]
    page = (folder / 'index.html').read_text()
    assert record['verdict'].split(' in ')[0] in page and 'http' not in re.sub(r'(?s)<script>.*?</script>', '', page)


def test_a_plan_goes_on_with_more_trials_and_refuses_another_one(planned, capsys):
    folder, arguments = planned
    done = len((folder / 'results.jsonl').read_text().splitlines())
    main([*arguments, '--trials', '4'])
    assert len((folder / 'results.jsonl').read_text().splitlines()) == done + 1
    capsys.readouterr()
    assert main([*arguments, '--noise', '3']) == 2
    assert 'holds results of other arguments (sensor)' in capsys.readouterr().err


def test_its_page_draws_its_maps(planned, browser):
    pytest.importorskip('plotly')
    browser.open((planned[0] / 'index.html').as_uri())
    browser.wait('document.querySelectorAll("#position canvas, #rotation canvas, #tried canvas").length >= 3', 60.0)
    assert browser.evaluate('document.querySelector("#position").data[1].x.length') == 6
    assert browser.evaluate('document.querySelectorAll(".pictures img").length') == 6
    assert browser.errors() == []


@pytest.mark.parametrize(
    ('more', 'problem'),
    [
        (['--distance', '300', '200'], 'distance: expected 0 < nearest'),
        (['--tilt', '50', '20'], 'tilt: expected'),
        (['--up', '0', '0', '0'], 'up: expected a direction'),
        (['--camera-noise', 'nowhere.json'], 'nowhere.json'),
        (['--calibration', 'nowhere.yaml'], 'nowhere.yaml'),
    ],
)
def test_bad_input_is_one_line_that_names_it(more, problem, tmp_path, capsys):
    assert main([*COMMAND, '-o', str(tmp_path), *more]) == 2
    error = capsys.readouterr().err
    assert problem in error and len(error.splitlines()) == 1


def test_what_cannot_be_rendered_is_refused_by_its_name(tmp_path, capsys):
    for name, text in (('part.stl', 'solid'), ('nothing.csg', 'UNITS MM;\n')):
        (tmp_path / name).write_text(text)
        assert main([str(tmp_path / name), *COMMAND[1:], '-o', str(tmp_path)]) == 2
        assert str(tmp_path / name) in capsys.readouterr().err.splitlines()[-1]


def test_cameras_come_from_numbers_or_a_calibration(tmp_path, capsys):
    options = ['wedge', '--distance', '200', '300', '--size', '1280', '1024', '--baseline', '80']
    task = task_of(plan_parser().parse_args([*options, '--lens', '8', '--chip', '6.4']))
    assert task.rig.pair.left.fx == pytest.approx(1600.0) and task.rig.pair.baseline == pytest.approx(0.08)
    assert main(['wedge', '--distance', '200', '300', '--size', '640', '480', '-q']) == 2
    assert '--focal: name the cameras' in capsys.readouterr().err
    file = tmp_path / 'camera.json'
    file.write_text('{"K": [[700, 0, 319.5], [0, 700, 239.5], [0, 0, 1]], "baseline": 0.1}')
    options = ['wedge', '--distance', '200', '300', '--size', '640', '480', '--calibration', str(file)]
    assert task_of(plan_parser().parse_args(options)).rig.pair.baseline == pytest.approx(0.1)


def test_equal_poses_are_no_errors_and_an_answer_is_about_one_part():
    part = load_part('l_shape')
    true = [Pose(translation=[0.0, 0.0, 0.3]), Pose(translation=[0.1, 0.0, 0.3])]
    near = Pose.from_rotation_vector([0.01, 0.0, 0.0], [0.0, 0.0005, 0.3])
    offs, wrong = judged(part, true, [near, Pose(translation=[0.0, 0.2, 0.3]), near])
    assert offs[1] is None and wrong == 2 and offs[0].rotation == pytest.approx(np.degrees(0.01), rel=1e-6)
    turned = true[0].compose(part.motions[-1])
    assert off_by(part, true[0], turned).within(1e-9, 1e-4)


def test_rates_lie_in_their_intervals_and_the_verdict_waits_until_these_are_narrow():
    assert Rate(0, 0).interval == (0.0, 1.0) and Rate(95, 100).interval == pytest.approx((0.888, 0.978), abs=0.001)
    task = task_of(plan_parser().parse_args(COMMAND))
    view = {'position': [1e-5, 3e-5], 'rotation': [0.01, 0.03], 'reason': 'the tilt is known worst', 'curves': 5}
    view |= {'direction': [0.0, 0.0, 1.0], 'distance': 0.2, 'variants': {}}
    hit = {'view': 0, 'errors': [[1e-5, 0.01]], 'expected': [[1e-5, 0.01]], 'wrong': 0, 'reason': ''}
    miss = {**hit, 'errors': [None], 'reason': 'chance explains as much: evidence 1.0 of 6.9'}
    alarm = {'view': 0, 'errors': [], 'expected': [], 'wrong': 1, 'reason': ''}
    found = Findings(task, [view], [hit] * 200, [{**alarm, 'wrong': 0}] * 50)
    assert found.answer(Aims()) == YES and found.failing() == [] and found.agreement() == (1.0, 1.0)
    assert replace(found, trials=[hit] * 5).answer(Aims()) == OPEN
    assert replace(found, empty=[alarm] * 50).answer(Aims()) == NO
    worse = replace(found, trials=[hit, miss] * 40)
    assert worse.answer(Aims()) == NO and worse.failing()[0]['missed'] == 40
    assert 'chance explains as much (5 of its edges' in worse.failing()[0]['why'] and worse.worst(3) == [(1, 0)]
    strict = replace(found, task=replace(task, limits=Limits(0.5, 2e-5)))
    assert strict.failing()[0]['predicted'] and 'the tilt is known worst' in strict.verdict(Aims())
