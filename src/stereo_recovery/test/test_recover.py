"""recover(): from a stereo pair to edges in space, against the truth of a rendered solid."""

from __future__ import annotations

import numpy as np
import pytest

from msgs_py import FeatureKind, PinholeCamera, Pose, StereoRig
from stereo_recovery import RecoveryParams, recover
from stereo_recovery.detection import view


def rig_for(depth: float, size: int = 512) -> StereoRig:
    return StereoRig.symmetric(PinholeCamera.centred(size, size, 703.0 * size / 512), depth / 5)


def errors(features, truth):
    """For every feature: its true edge (-1: none), angle in degrees and largest distance of its ends from that line."""
    rows = []
    for start, end in zip(features.start, features.end):
        best = (-1, np.inf, np.inf)
        for k, (a, b) in enumerate(truth):
            length = np.linalg.norm(b - a)
            line = (b - a) / length
            angle = np.degrees(np.arccos(min(1.0, abs((end - start) @ line) / np.linalg.norm(end - start))))
            inside = [a + np.clip((x - a) @ line, 0, length) * line for x in (start, end)]
            off = max(np.linalg.norm(x - y) for x, y in zip((start, end), inside))
            if angle < 10 and off < 0.003 and off < best[2]:
                best = (k, angle, off)
        rows.append(best)
    return np.array(rows)


@pytest.mark.parametrize(
    ('name', 'rotation', 'depth'),
    [('L-block', (0.5, -0.7, 0.1), 0.25), ('chipped', (0.5, -0.6, 0.2), 0.20), ('wedge', (-0.6, 0.5, 0.4), 0.30)],
)
def test_edges_of_a_solid_are_found_where_they_are(synthetic, solids, name, rotation, depth):
    rig = rig_for(depth)
    solid = solids[name].at(Pose.from_rotation_vector(rotation, [0.1 * depth, 0, depth]))
    left, right = synthetic.render_pair(solid, rig)
    truth = synthetic.truth_edges(solid, rig)

    result = recover(left, right, rig)

    found = errors(result.features.of_kind(FeatureKind.EDGE), truth)
    assert result.reason == ''
    assert np.mean(found[:, 0] >= 0) >= 0.9
    assert len(set(found[:, 0]) - {-1}) >= 0.8 * len(truth)
    true = found[found[:, 0] >= 0]
    assert np.median(true[:, 1]) < 0.3
    assert np.median(true[:, 2]) < 0.0005


def test_nothing_in_the_picture_is_a_reason_not_an_exception():
    flat = np.full((512, 512), 90, np.uint8)
    result = recover(flat, flat, rig_for(0.25))
    assert len(result.features) == 0
    assert 'no texture' in result.reason


def test_image_of_another_size_is_refused_by_name():
    with pytest.raises(ValueError, match='right: image is 8 x 8'):
        recover(np.zeros((512, 512), np.uint8), np.zeros((8, 8), np.uint8), rig_for(0.25))


@pytest.mark.parametrize('bad', [{'sigma': 0.0}, {'low': -1.0}, {'detector': 'magic'}, {'low': 5.0, 'high': 2.0}])
def test_parameters_out_of_range_are_refused_by_name(bad):
    with pytest.raises(ValueError, match=list(bad)[-1]):
        RecoveryParams(**bad)


def test_of_more_segments_than_can_be_matched_in_time_the_longest_are_taken(synthetic, solids, monkeypatch):
    rig = rig_for(0.25)
    solid = solids['L-block'].at(Pose.from_rotation_vector((0.5, -0.7, 0.1), [0.025, 0, 0.25]))
    left, right = synthetic.render_pair(solid, rig)
    every = recover(left, right, rig).features
    monkeypatch.setattr(view, 'MOST_SEGMENTS', 6)
    some = recover(left, right, rig).features

    assert 0 < len(some) < len(every)
    assert some.lengths.min() > np.median(every.lengths) / 2
