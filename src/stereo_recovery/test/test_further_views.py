"""Cameras beyond a pair: what they measure of its edges, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from msgs_py import CameraRig, PinholeCamera, Pose, StereoRig
from stereo_recovery.cameras.pairs import camera_pair
from stereo_recovery.detection.segments import Segments
from stereo_recovery.edges.further_views import joint_lines, view_lines
from stereo_recovery.matching.further_views import FurtherView
from stereo_recovery.matching.matches import Matches
from stereo_recovery.matching.stereo_segments import StereoSegments
from stereo_recovery.matching.turned import turned

CAMERA = PinholeCamera(640, 480, 700.0, 710.0, 310.0, 245.0)
PAIR = StereoRig.symmetric(CAMERA, 0.1)
# Above, turned in all three ways, of another focal length.
THIRD = PinholeCamera(800, 600, 650.0, 655.0, 390.0, 310.0)
ABOVE = Pose.from_rotation_vector([0.15, -0.1, 0.2], [0.03, -0.12, 0.02])
RIG = CameraRig([CAMERA, CAMERA, THIRD], [*CameraRig.from_stereo(PAIR).poses, ABOVE])
SIGMA = 0.05


def lines_in_space(count: int) -> np.ndarray:
    """(count, 2, 3): the first two run along the rows, the rest anywhere."""
    rng = np.random.default_rng(7)
    ends = rng.uniform([-0.15, -0.1, 0.9], [0.15, 0.1, 1.4], (count, 2, 3))
    ends[:2, 1] = ends[:2, 0] + [[0.15, 0.0, 0.0], [-0.12, 0.0, 0.0]]
    return ends


def pictures(space: np.ndarray) -> list[Segments]:
    """Every other segment of the second and third image runs against that of the first."""
    ends = RIG.project(space)
    for pixels in ends[1:]:
        pixels[::2] = pixels[::2, ::-1]
    return [Segments.between(pixels, SIGMA) for pixels in ends]


def in_pair(space: np.ndarray, pair: tuple[Segments, Segments], rig: StereoRig, pose: Pose) -> StereoSegments:
    """The matched segments, with the disparities of the lines (n, 2, 3) in space."""
    points = pose.inverse().apply(space)
    d = rig.disparity(points[..., 2])
    n = np.arange(len(space), dtype=np.int32)
    disparity = np.column_stack([d[:, 0], d.mean(axis=1), d[:, 1]])
    matches = Matches(n, n, disparity, np.zeros((len(n), 2)), np.ones(len(n)))
    return StereoSegments.of(matches, pair)


def third_view(space: np.ndarray, segments: list[Segments]) -> FurtherView:
    pair = camera_pair(RIG, 0, 2)
    own = turned(segments[0], pair.homographies[0])
    other = turned(segments[2], pair.homographies[1]).segments
    seen = in_pair(space, (own.segments, other), pair.rig, pair.first_T_pair)
    return FurtherView(seen, np.arange(len(space)), own, pair.rig, 0.0)


def measured(space: np.ndarray, segments: list[Segments]) -> tuple[StereoSegments, tuple]:
    """The main pair's segments, and the joint lines of two and of three cameras."""
    seen = in_pair(space, (segments[0], segments[1]), PAIR, Pose.identity())
    view = view_lines(third_view(space, segments), PAIR, len(space))
    return seen, (joint_lines(seen, 0.0, ()), joint_lines(seen, 0.0, (view,)))


def test_a_turned_line_has_the_error_of_the_line():
    segments = pictures(lines_in_space(6))[0]
    pair = camera_pair(RIG, 0, 2)
    rng = np.random.default_rng(3)
    found = turned(segments, pair.homographies[0])
    offs = []
    for _ in range(4000):
        offset, slope = rng.normal(0.0, segments.sigma.T)
        ends = []
        for s in segments.extent.T:
            across = np.stack([-segments.direction[:, 1], segments.direction[:, 0]], axis=1)
            end = segments.centre + s[:, None] * segments.direction + (offset + slope * s)[:, None] * across
            image = np.hstack([end, np.ones((len(end), 1))]) @ pair.homographies[0].T
            ends.append(image[:, :2] / image[:, 2:])
        run = ends[1] - ends[0]
        normal = np.stack([-found.segments.direction[:, 1], found.segments.direction[:, 0]], axis=1)
        slopes = (run * normal).sum(axis=1) / (run * found.segments.direction).sum(axis=1)
        away = ends[0] - found.segments.centre
        offs.append([(away * normal).sum(axis=1) - slopes * (away * found.segments.direction).sum(axis=1), slopes])
    spread = np.array(offs)
    assert np.abs(spread.mean(axis=0)).max() < 0.01
    np.testing.assert_allclose(spread.std(axis=0).T, found.segments.sigma, rtol=0.06)
    for k in range(len(segments)):
        assert abs(np.corrcoef(spread[:, 0, k], spread[:, 1, k])[0, 1]) < 0.06


def test_a_third_camera_gives_edges_along_the_rows_their_depth():
    space = lines_in_space(8)
    seen, (two, three) = measured(space, pictures(space))
    truth = PAIR.disparity(space[..., 2])
    ends = np.stack([np.ones((8, 2)), seen.segments[0].extent], axis=-1)
    information = np.stack([two.information, three.information])
    # By two cameras the level ones are not known at all.
    assert np.abs(np.linalg.det(two.information[:2])).max() < 1e-9
    assert (np.linalg.eigvalsh(three.information[:2])[:, 0] > 0.1).all()
    x = np.einsum('nij,nj->ni', np.linalg.inv(three.information), three.vector)
    np.testing.assert_allclose(np.einsum('nei,ni->ne', ends, x), truth, atol=1e-6)
    # Nobody's error grows by what another camera says.
    gain = np.linalg.eigvalsh(information[1] - information[0])
    assert (gain[:, 0] > -1e-6 * np.abs(gain[:, 1])).all()


def test_the_covariance_of_three_cameras_is_that_of_their_errors():
    space = lines_in_space(8)
    segments = pictures(space)
    rng = np.random.default_rng(11)
    ends = np.stack([np.ones((8, 2)), segments[0].extent], axis=-1)
    truth = PAIR.disparity(space[..., 2])
    ends_inverse = np.linalg.inv(ends)
    x_true = np.einsum('nij,nj->ni', ends_inverse, truth)
    normalised, products = [], []
    for _ in range(400):
        noisy = []
        for each in reversed(segments):
            across = np.stack([-each.direction[:, 1], each.direction[:, 0]], axis=1)
            offset, slope = errors = rng.normal(0.0, each.sigma.T)
            direction = each.direction + slope[:, None] * across
            direction /= np.linalg.norm(direction, axis=1, keepdims=True)
            noisy.append(
                Segments(**{**vars(each), 'centre': each.centre + offset[:, None] * across, 'direction': direction})
            )
        errors = errors.T
        _, (_, joint) = measured(space, noisy[::-1])
        covariance = np.linalg.inv(joint.information)
        x = np.einsum('nij,nj->ni', covariance, joint.vector)
        # The unknowns are disparities along the left segment as it is measured, at the same abscissae.
        off = np.einsum('nei,ni->ne', ends, x) - truth
        spread = np.einsum('nei,nij,nfj->nef', ends, covariance, ends)
        # What the left line's own error does to them is known as well.
        products.append(np.einsum('nei,ni->ne', ends, x - x_true)[:, :, None] * errors[:, None])
        foreseen = np.einsum('nei,nij->nej', ends, joint.covariance_with_line(covariance))
        normalised.append(np.einsum('ne,nef,nf->n', off, np.linalg.inv(spread), off))
    # Chi-squared of two degrees of freedom: mean 2, 95 % below 5.99.
    mean = np.mean(normalised, axis=0)
    np.testing.assert_allclose(mean, 2.0, rtol=0.25)
    assert np.mean(normalised) == pytest.approx(2.0, rel=0.08)
    scale = np.sqrt(np.einsum('nee->ne', spread))[:, :, None] * segments[0].sigma[:, None]
    correlation = np.mean(products, axis=0) / scale
    np.testing.assert_allclose(correlation, foreseen / scale, atol=0.2)
    assert np.abs(foreseen / scale).max() > 0.4
    assert np.mean(np.array(normalised) < 5.99) == pytest.approx(0.95, abs=0.02)
