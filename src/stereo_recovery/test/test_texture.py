"""Texture beside edges, where the answer is known: pictures of one slanted surface, drawn from a formula."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from stereo_recovery.detection.junctions import find_junctions
from stereo_recovery.detection.segments import Segments
from stereo_recovery.edges.texture_matching import seen_by_texture
from stereo_recovery.estimation.texture import AlignedStrips, Texture, texture_factors, texture_rows
from stereo_recovery.estimation.texture_kernels import DENSE
from stereo_recovery.matching.dense import DenseDisparity
from stereo_recovery.matching.matches import Matches
from stereo_recovery.matching.row_error import RowWitnesses, fitted_error
from stereo_recovery.matching.stereo_segments import StereoSegments

SIZE = (320, 240)
# Disparity of the surface: at the origin, along columns, along rows.
PLANE = 30.0, 0.02, 0.04


def pictures(gain: float = 1.0, shift: float = 0.0, lower: float = 0.0, plain: bool = False) -> tuple:
    """The left and the right picture of a surface with a random pattern; the right one's rows lower by some pixels."""
    rng = np.random.default_rng(7)
    pattern = np.asarray(cv2.GaussianBlur(rng.normal(size=(SIZE[1], SIZE[0] + 100)), (0, 0), 2.0), np.float32)
    pattern *= 0.0 if plain else 40.0 / pattern.std()
    v, u = np.mgrid[0 : SIZE[1], 0 : SIZE[0]].astype(np.float32)
    # The left picture's column of what the right one shows at (u, v): u' = u + d(u', v').
    row = v - np.float32(lower)
    left_u = (u + PLANE[0] + PLANE[2] * row) / (1.0 - PLANE[1])
    left = 120.0 + pattern[:, : SIZE[0]]
    right = cv2.remap(pattern, left_u, row, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return left.astype(np.float32), (gain * (120.0 + right) + shift).astype(np.float32)


def seen_along(ends: np.ndarray) -> StereoSegments:
    """One matched edge between two places of the left picture, its match 6 px off."""
    disparity = PLANE[0] + ends @ np.array(PLANE[1:]) + 6.0
    there = ends - np.stack([disparity, np.zeros(2)], axis=1)
    segments = Segments.between(ends[None], 0.05), Segments.between(there[None], 0.05)
    one = np.zeros(1, np.int32)
    three = np.array([[disparity[0], disparity.mean(), disparity[1]]])
    matches = Matches(one, one, three, np.sort(ends[:, 1])[None], np.ones(1))
    return StereoSegments.of(matches, segments)


def strips_of(seen: StereoSegments, texture: Texture) -> AlignedStrips:
    """Of the left segments, in a rig whose rows disagree by a third of a pixel."""
    strips = AlignedStrips(seen.segments[0], texture)
    nobody = RowWitnesses(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    strips.rows = fitted_error(nobody, SIZE, 0.3)
    return strips


@pytest.mark.parametrize(('gain', 'shift', 'lower'), [(1.0, 0.0, 0.0), (0.8, 15.0, 0.0), (1.2, -20.0, 0.3)])
def test_a_level_edge_has_the_disparity_of_the_surface_beside_it(gain, shift, lower):
    greys = pictures(gain, shift, lower)
    ends = np.array([[120.0, 130.0], [260.0, 132.0]])
    seen = seen_along(ends)
    texture = Texture.of(greys, DenseDisparity(*greys, 20.0, 60.0))
    factors = texture_factors(seen, np.array([0]), strips_of(seen, texture))
    assert len(factors) == 4, 'of both sides a place and a slope'
    segment = seen.segments[0]
    along = PLANE[1] * segment.direction[0, 0] + PLANE[2] * segment.direction[0, 1]
    middle = PLANE[0] + segment.centre[0] @ np.array(PLANE[1:])
    x = np.array([middle, along])
    off = factors.value - factors.row @ x
    assert (np.abs(off) < 3.0 * factors.sigma).all()
    assert (np.abs(off[::2]) < 0.5).all(), 'the match is six pixels off'
    assert (factors.sigma[::2] < 1.0).all()


def test_where_the_images_cannot_be_aligned_dense_disparity_tells():
    left, right = pictures()
    seen = seen_along(np.array([[120.0, 130.0], [260.0, 132.0]]))
    dense = DenseDisparity(left, right, 20.0, 60.0)
    # What the right image shows is gone once dense disparity is known.
    texture = Texture.of((left, np.random.default_rng(5).normal(120.0, 40.0, right.shape).astype(np.float32)), dense)
    strips = strips_of(seen, texture)
    assert len(texture_factors(seen, np.array([0]), strips)) == 0
    factors = texture_factors(seen, np.array([0]), strips, DENSE)
    assert len(factors) == 4, 'of both sides a place and a slope'
    segment = seen.segments[0]
    along = PLANE[1] * segment.direction[0, 0] + PLANE[2] * segment.direction[0, 1]
    middle = PLANE[0] + segment.centre[0] @ np.array(PLANE[1:])
    off = factors.value - factors.row @ np.array([middle, along])
    assert (np.abs(off) < 3.0 * factors.sigma).all()
    assert (factors.sigma[::2] < 1.5).all()
    assert len(texture_rows(seen, AlignedStrips(seen.segments[0], texture)).off) == 0, 'it knows nothing of rows'


def test_a_plain_surface_says_nothing():
    greys = pictures(plain=True)
    seen = seen_along(np.array([[120.0, 130.0], [260.0, 132.0]]))
    texture = Texture.of(greys, DenseDisparity(*greys, 20.0, 60.0))
    assert len(texture_factors(seen, np.array([0]), strips_of(seen, texture))) == 0
    assert len(texture_rows(seen, AlignedStrips(seen.segments[0], texture)).off) == 0


def test_without_texture_or_open_edges_nothing_is_said():
    greys = pictures()
    seen = seen_along(np.array([[120.0, 130.0], [260.0, 132.0]]))
    texture = Texture.of(greys, DenseDisparity(*greys, 20.0, 60.0))
    assert len(texture_factors(seen, np.array([0]), None)) == 0
    assert len(texture_factors(seen, np.zeros(0, np.int64), strips_of(seen, texture))) == 0


@pytest.mark.parametrize('lower', [-0.6, 0.0, 0.4])
def test_strips_tell_how_much_lower_the_right_rows_are(lower):
    greys = pictures(lower=lower)
    seen = seen_along(np.array([[150.0, 60.0], [170.0, 190.0]]))
    texture = Texture.of(greys, DenseDisparity(*greys, 20.0, 60.0))
    rows = texture_rows(seen, AlignedStrips(seen.segments[0], texture))
    assert len(rows.off) == 2
    np.testing.assert_allclose(rows.off, lower, atol=0.1)
    assert (np.abs(rows.off - lower) < 3.0 * rows.sigma).all()


def test_an_edge_without_a_match_is_where_its_texture_is():
    greys = pictures()
    # A dark line on the surface, that both pictures show.
    ends = np.array([[140.0, 100.0], [180.0, 180.0]])
    seen = seen_along(np.array([[120.0, 30.0], [260.0, 32.0]]))
    there = ends - np.stack([PLANE[0] + ends @ np.array(PLANE[1:]), np.zeros(2)], axis=1)
    for grey, line in zip(greys, (ends, there)):
        left_of, below = (line[0] + np.array([-40.0, 0.0])), line[1] + np.array([-40.0, 0.0])
        patch = np.array([left_of, line[0], line[1], below])
        mask = np.zeros(grey.shape, np.uint8)
        cv2.fillConvexPoly(mask, np.rint(16.0 * patch).astype(np.int32), 1, shift=4)
        grey[mask > 0] -= 60.0
    free = Segments.between(np.stack([seen.segments[0].start, seen.segments[0].end], axis=1).repeat(2, axis=0), 0.05)
    free.centre[1], free.direction[1] = ends.mean(axis=0), (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    free.extent[1] = np.array([-0.5, 0.5]) * np.hypot(*(ends[1] - ends[0]))
    seen = replace(seen, segments=(free, seen.segments[1]), junctions=(find_junctions(free), seen.junctions[1]))
    texture = Texture.of(greys, DenseDisparity(*greys, 20.0, 60.0))
    grown = seen_by_texture(seen, strips_of(seen, texture))
    assert (len(grown.matches), grown.stand_ins) == (2, 1)
    assert grown.paired.tolist() == [True, False]
    np.testing.assert_allclose(
        grown.matches.disparity[1, 1], PLANE[0] + ends.mean(axis=0) @ np.array(PLANE[1:]), atol=0.5
    )
    plain = texture.levels[0][0], np.full_like(texture.levels[0][1], 120.0)
    blind = replace(texture, levels=(*texture.levels[:-1], plain))
    assert len(seen_by_texture(seen, strips_of(seen, blind)).matches) == 1, (
        'what the right picture does not show is no edge'
    )


def test_strips_that_are_asked_for_again_say_the_same():
    greys = pictures()
    seen = seen_along(np.array([[120.0, 130.0], [260.0, 132.0]]))
    strips = strips_of(seen, Texture.of(greys, DenseDisparity(*greys, 20.0, 60.0)))
    first, again = strips.beside(np.array([0])), strips.beside(np.array([0, 0]))
    assert again[0].tolist() == [0, 1, 0, 1], 'one side after the other'
    for once, twice in zip(first[1:], again[1:]):
        np.testing.assert_array_equal(twice, np.repeat(once, 2, axis=0))


@pytest.mark.parametrize('lower', [0.0, 0.4])
def test_what_is_known_of_the_rows_later_makes_strips_say_what_they_would_have_said_with_it(lower):
    greys = pictures(lower=lower)
    seen = seen_along(np.array([[120.0, 130.0], [260.0, 132.0]]))
    texture = Texture.of(greys, DenseDisparity(*greys, 20.0, 60.0))
    strips = AlignedStrips(seen.segments[0], texture)
    _, before, wide = strips.beside(np.array([0]))
    witness = RowWitnesses(np.array([[150.0, 100.0]] * 9), np.full(9, lower), np.full(9, 0.01))
    strips.rows = fitted_error(witness, SIZE, 0.2)
    _, after, narrow = strips.beside(np.array([0]))
    # One more statement of the row, of which the prior was told already.
    known = strips.rows.at(strips.places(np.array([0, 0]), before))
    more = strips.rows.sigma**-2.0 - 1.0
    told = known * strips.rows.sigma**-2.0
    for k in range(2):
        information = np.linalg.inv(wide[k])
        vector = information @ before[k]
        information[2, 2] += more
        vector[2] += told[k]
        np.testing.assert_allclose(narrow[k], np.linalg.inv(information), rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(after[k], np.linalg.solve(information, vector), atol=1e-9)
    assert (np.abs(after[:, 2] - lower) < 3.0 * np.sqrt(narrow[:, 2, 2])).all()
