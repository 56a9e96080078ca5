"""A time limit: what is left out, and that the rest is what it would be."""

from __future__ import annotations

import numpy as np
import pytest

from msgs_py import FeatureKind, PinholeCamera, Pose, StereoRig
from msgs_py.numeric.deadline import Deadline
from stereo_recovery import RecoveryParams, pipeline, recover
from stereo_recovery.recover_cli import profile
from stereo_recovery.stopwatch import Stopwatch

RIG = StereoRig.symmetric(PinholeCamera.centred(320, 320, 440.0), 0.05)


@pytest.fixture(scope='module')
def pair(synthetic, solids):
    return synthetic.render_pair(
        solids['cylinder on box'].at(Pose.from_rotation_vector((2.2, 0.2, 0.4), [0.02, 0, 0.25])), RIG
    )


class LateFrom(Stopwatch):
    """It is late once a stage has ended."""

    def __init__(self, stage: str) -> None:
        super().__init__(1.0, lambda: 9.0 if stage in getattr(self, 'milliseconds', ()) else 0.0)


def limited(pair, monkeypatch, stage: str) -> pipeline.Recovery:
    monkeypatch.setattr(pipeline, 'Stopwatch', lambda limit, deadline=None: LateFrom(stage))
    return recover(*pair, RIG, RecoveryParams(time_limit=1.0))


def test_what_begins_too_late_is_left_out_and_said(pair, monkeypatch):
    every = recover(*pair, RIG)
    assert every.left_out == ()
    after = {stage: limited(pair, monkeypatch, stage) for stage in ('segment', 'match', 'curves', 'lines')}
    assert [what.split(':')[0] for what in after['segment'].left_out] == ['matching', 'curves', 'edges']
    assert [what.split(':')[0] for what in after['match'].left_out] == ['curves', 'edges']
    assert [what.split(':')[0] for what in after['curves'].left_out] == ['edges']
    assert after['lines'].left_out == ()
    assert np.array_equal(after['lines'].features.start, every.features.start)
    # The best so far is most of it.
    count = len(every.features.of_kind(FeatureKind.EDGE))
    for found in after.values():
        assert found.reason == ''
        assert len(found.features.of_kind(FeatureKind.EDGE)) > 0.7 * count


def test_a_limit_that_is_kept_changes_nothing(pair):
    every, limited = recover(*pair, RIG), recover(*pair, RIG, RecoveryParams(time_limit=3600.0))
    assert np.array_equal(every.features.start, limited.features.start)
    assert limited.left_out == ()


@pytest.mark.parametrize('limit', [0.0, -1.0, 1e5, float('nan')])
def test_a_limit_out_of_range_is_refused_by_name(limit):
    with pytest.raises(ValueError, match='time_limit: expected 0.001 to 3600'):
        RecoveryParams(time_limit=limit)


def test_the_profile_has_every_stage_and_what_was_left_out(pair, monkeypatch):
    lines = profile(limited(pair, monkeypatch, 'match'))
    for start in ('segment', 'match', 'curves', 'lines', 'features', 'all', 'left out: curves'):
        assert any(line.startswith(start) for line in lines)


def test_a_deadline_that_is_brought_forward_is_too_late_for_all():
    deadline = Deadline()
    watch = Stopwatch(deadline=deadline)
    late = watch.late_after(0.5, 'curves')
    assert not late() and watch.left_out == []
    deadline.bring_forward(0.0)
    assert late() and watch.left_out == ['curves']
