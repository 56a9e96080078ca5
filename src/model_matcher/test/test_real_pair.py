"""The real chessboard: the pose is not a square off."""

import json

import pytest

from model_matcher import MatchResult
from model_matcher.closed_form import real_pair
from model_matcher.closed_form.real_pair import SQUARE_M, run_chessboard


def test_pair_01_has_the_pose_of_the_reference_up_to_half_a_turn(tmp_path):
    run_chessboard(tmp_path)
    found = json.loads((tmp_path / 'result.json').read_text())
    assert found['accepted']
    assert found['rotation_error_deg'] < 1.0
    assert found['translation_error_m'] < 0.2 * SQUARE_M


def test_where_nothing_is_found_the_result_says_why(tmp_path, monkeypatch):
    monkeypatch.setattr(real_pair, 'match', lambda *arguments: MatchResult((), (), {}, 'no pair of data features'))
    assert 'no pose: no pair of data features' in run_chessboard(tmp_path)
    assert json.loads((tmp_path / 'result.json').read_text())['reason'] == 'no pair of data features'


def test_a_picture_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(OSError, match='left01.png: no such file'):
        real_pair._read(tmp_path / 'left01.png')
