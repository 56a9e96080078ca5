"""The real chessboard: the pose is not a square off."""

import json

from model_matcher.real_pair import SQUARE_M, run_chessboard


def test_pair_01_has_the_pose_of_the_reference_up_to_half_a_turn(tmp_path):
    run_chessboard(tmp_path)
    found = json.loads((tmp_path / 'result.json').read_text())
    assert found['accepted']
    assert found['rotation_error_deg'] < 1.0
    assert found['translation_error_m'] < 0.2 * SQUARE_M
