"""What counts as a right pose, what it is worth, and a picture of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from scipy.stats import chi2
from true_pairs import LEAST_CONTRAST
from true_poses import ALIKE, Difference, Instance, Part, PosedPair, difference, nearest_true

from csg_renderer import Solid, visible_features
from model_matcher import MatchResult
from model_matcher.geometry.pose_rows import step_between
from msgs_py import FeatureKind, Interpretation, PinholeCamera, Pose

# A pose farther off than this, from every instance, is wrong: at this much nothing can be gripped by it.
WRONG_DEG, WRONG_M = 3.0, 0.010
# The witness: steps of grey are looked for this far to either side of a projected crease, pixels, in a picture
# smoothed by so much; samples stand a pixel apart, and fewer than so many say nothing.
WITNESS_REACH, WITNESS_SMOOTH, WITNESS_LEAST = 2.5, 0.7, 20
_STEP = 0.25
VERDICTS = ('right', 'twice', 'ambiguous', 'wrong', 'false')
GREEN, RED, MAGENTA, YELLOW = (80, 230, 60), (60, 60, 255), (255, 0, 255), (0, 220, 255)


@dataclass
class Answer:
    """A reported pose.

    verdict : 'right', 'twice' (an instance that a better answer has), 'ambiguous' (another pose that the answer names
    is right, or one that the turn which it leaves open leads to), 'wrong' (the part is there, not so), 'false' (it is
    not there); like : it lies on an instance of a part that is nearly the same.

    stated, bounded : the squared error in units of the stated covariance, with that of the truth, and of the least one,
        over the median of chi squared: 1 in the median where that is true
    witness_px, witness_true_px : see :func:`witness_rms`
    """

    pose: Pose
    verdict: str
    instance: int | None = None
    off: Difference | None = None
    like: bool = False
    stated: float | None = None
    bounded: float | None = None
    witness_px: float | None = None
    witness_true_px: float | None = None


@dataclass
class Search:
    """One part asked for in one pair.

    refused : by instance that has to be found and is not, the rank of the first rejected hypothesis that is right, 0
        the best; None where there is none
    """

    part: Part
    present: bool
    answers: list[Answer]
    milliseconds: float
    cpu_milliseconds: float
    missed: list[int] = field(default_factory=list)
    refused: dict[int, int | None] = field(default_factory=dict)
    why: str | None = None


def score_search(posed: PosedPair, part: Part, result: MatchResult, milliseconds: float, cpu: float) -> Search:
    """Judge what was answered when ``part`` was asked for."""
    numbers = [k for k, one in enumerate(posed.instances) if one.part is part]
    answers = [_judged(posed, part, one, numbers) for one in result.interpretations if one.model == part.name]
    taken: dict[int, Answer] = {}
    for answer in sorted((a for a in answers if a.off is not None), key=lambda a: _size(a.off)):
        assert answer.instance is not None
        if taken.setdefault(answer.instance, answer) is not answer:
            answer.verdict = 'twice'
    missed = [k for k in numbers if posed.instances[k].to_find and k not in taken]
    rejected = [one.pose for one in result.rejected if one.model == part.name]
    refused = {k: _first_right(posed.instances[k], rejected) for k in missed}
    why = result.rejected[0].rejected_reason if result.rejected else result.reason
    return Search(part, bool(numbers), answers, milliseconds, cpu, missed, refused, why)


def _judged(posed: PosedPair, part: Part, found: Interpretation, numbers: list[int]) -> Answer:
    """The nearest instance, or why it is none."""
    pose = found.pose
    offs = {k: difference(posed.instances[k], pose) for k in numbers}
    right = [k for k, off in offs.items() if off.within(WRONG_DEG, WRONG_M)]
    if right:
        nearest = min(right, key=lambda k: _size(offs[k]))
        answer = Answer(pose, 'right', nearest, offs[nearest])
        _weigh(answer, posed, found)
        return answer
    place = pose.apply(part.middle)
    like = any(
        one.part.name == ALIKE.get(part.name) and float(np.linalg.norm(one.place - place)) <= WRONG_M
        for one in posed.instances
    )
    named = list(found.ambiguous_poses)
    if any(
        _first_right(posed.instances[k], named) is not None or _right_but_for_turn(posed.instances[k], found)
        for k in numbers
    ):
        return Answer(pose, 'ambiguous')
    return Answer(pose, 'wrong' if numbers else 'false', like=like)


def _right_but_for_turn(instance: Instance, found: Interpretation) -> bool:
    """Whether an answer says that a turn is left open, and is right at one."""
    turn, covariance, pose = found.free_turn, found.covariance, found.pose
    if turn is None or covariance is None:
        return False
    # The axis passes where the turn, whose variance is by far the largest, moves nothing.
    moved = covariance[:3, 3:] @ turn / (turn @ covariance[3:, 3:] @ turn)
    axis = np.stack([np.cross(turn, moved), turn]) @ pose.rotation
    return difference(replace(instance, axis=axis), pose).within(WRONG_DEG, WRONG_M)


def _weigh(answer: Answer, posed: PosedPair, found: Interpretation) -> None:
    """The error in units of the stated covariance and of the bound, where there are such."""
    assert answer.instance is not None
    instance = posed.instances[answer.instance]
    error = step_between(nearest_true(instance, found.pose), found.pose)
    usual = float(chi2.ppf(0.5, 6 if instance.axis is None else 5))
    if found.covariance is not None:
        answer.stated = float(error @ np.linalg.solve(found.covariance + instance.covariance, error)) / usual
    if posed.bounds:
        answer.bounded = float(error @ posed.bounds[answer.instance].information @ error) / usual


def _size(off: Difference | None) -> float:
    """One number to order differences by: both in units of what is wrong."""
    assert off is not None
    return max(off.degrees / WRONG_DEG, off.metres / WRONG_M)


def _first_right(instance: Instance, poses: list[Pose]) -> int | None:
    for rank, pose in enumerate(poses):
        if difference(instance, pose).within(WRONG_DEG, WRONG_M):
            return rank
    return None


# -- the eye that took no part ---------------------------------------------------------------------------------


def witness_rms(
    image: np.ndarray, camera: PinholeCamera, eye_T_part: Pose, solid: Solid, others: list[tuple[Solid, Pose]]
) -> float | None:
    """Root mean square distance, pixels, from the visible creases of a part to the strongest step beside each place.

    Places without a step of LEAST_CONTRAST within reach are left out; None when too few are left.
    """
    creases = visible_features(solid, eye_T_part, camera, others)
    points, normals = [], []
    for number in np.flatnonzero(creases.kind != FeatureKind.AXIS):
        pixels = _spaced(camera.project(creases.polyline(int(number), 65)))
        if len(pixels) < 3:
            continue
        along = np.gradient(pixels, axis=0)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        points.append(pixels)
        normals.append(np.column_stack([-along[:, 1], along[:, 0]]))
    if not points:
        return None
    off = step_offsets(image, np.concatenate(points), np.concatenate(normals))
    off = off[np.isfinite(off)]
    return float(np.sqrt(np.mean(off**2))) if len(off) >= WITNESS_LEAST else None


def _spaced(pixels: np.ndarray) -> np.ndarray:
    """A polyline in the image as points a pixel apart, its ends left out."""
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(pixels, axis=0), axis=1))])
    places = np.arange(2.0, run[-1] - 2.0)
    return np.column_stack([np.interp(places, run, pixels[:, k]) for k in (0, 1)])


def step_offsets(image: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(n,) float64: where along each normal the strongest step is, pixels; NaN where none is strong enough."""
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), WITNESS_SMOOTH)
    down, across = np.gradient(smooth)
    reach = np.arange(-WITNESS_REACH - 2.0, WITNESS_REACH + 2.0 + _STEP / 2, _STEP)
    at = (points[:, None] + reach[:, None] * normals[:, None]).astype(np.float32)
    profile, right, under = (
        cv2.remap(values, at[..., 0], at[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE).astype(float)
        for values in (smooth, across, down)
    )
    slope = np.abs(right * normals[:, :1] + under * normals[:, 1:])
    inner = np.flatnonzero(np.abs(reach) <= WITNESS_REACH)
    best = inner[np.argmax(slope[:, inner], axis=1)]
    row = np.arange(len(points))
    before, here, after = (slope[row, best + k] for k in (-1, 0, 1))
    bend = before - 2.0 * here + after
    shift = np.where(bend < 0.0, 0.5 * (before - after) / np.where(bend < 0.0, bend, 1.0), 0.0)
    wide = round(2.0 / _STEP)
    low, high = np.maximum(best - wide, 0), np.minimum(best + wide, len(reach) - 1)
    strong = np.abs(profile[row, high] - profile[row, low]) >= LEAST_CONTRAST
    # A step at the very end of the search is the flank of one beyond it.
    inside = (before <= here) & (after <= here)
    return np.where(strong & inside, reach[best] + _STEP * shift, np.nan)


def add_witness(posed: PosedPair, searches: list[Search], eye: tuple[np.ndarray, PinholeCamera, Pose]) -> None:
    """Fill in what the third eye says of every right answer, and of the true pose there."""
    image, camera, left_T_eye = eye
    eye_T_left = left_T_eye.inverse()
    for search in searches:
        for answer in search.answers:
            if answer.verdict != 'right':
                continue
            others = [
                (one.part.solid, eye_T_left.compose(one.pose))
                for k, one in enumerate(posed.instances)
                if k != answer.instance
            ]
            assert answer.instance is not None
            true = posed.instances[answer.instance].pose
            answer.witness_px, answer.witness_true_px = (
                witness_rms(image, camera, eye_T_left.compose(pose), search.part.solid, others)
                for pose in (answer.pose, true)
            )


# -- rows and summaries ----------------------------------------------------------------------------------------


def row_of(posed: PosedPair, searches: list[Search], recovery_ms: float, features: int) -> dict[str, Any]:
    """A pair's row, plain values."""
    return {
        'family': posed.pair.family,
        'pair': posed.pair.name,
        'recovery_ms': recovery_ms,
        'features': features,
        'searches': [_search_row(posed, search) for search in searches],
    }


def _search_row(posed: PosedPair, search: Search) -> dict[str, Any]:
    own = [one for one in posed.instances if one.part is search.part]
    return {
        'part': search.part.name,
        'present': search.present,
        'to_find': sum(one.to_find for one in own),
        'found': sum(
            a.verdict == 'right' and a.instance is not None and posed.instances[a.instance].to_find
            for a in search.answers
        ),
        'refused_best': sum(rank == 0 for rank in search.refused.values()),
        'refused_any': sum(rank is not None for rank in search.refused.values()),
        'ms': search.milliseconds,
        'cpu_ms': search.cpu_milliseconds,
        'why': search.why if search.missed else None,
        'answers': [
            {
                'verdict': a.verdict,
                'like': a.like,
                'share': None if a.instance is None else posed.instances[a.instance].share,
                'deg': None if a.off is None else a.off.degrees,
                'mm': None if a.off is None else 1e3 * a.off.metres,
                'depth_percent': None if a.off is None else 1e2 * a.off.depth_share,
                'stated': a.stated,
                'bounded': a.bounded,
                **_bound_row(posed, a),
                'witness_px': a.witness_px,
                'witness_true_px': a.witness_true_px,
            }
            for a in search.answers
        ],
    }


def _bound_row(posed: PosedPair, answer: Answer) -> dict[str, float]:
    """The errors of a right answer's instance at the bound: root mean squares, as the medians of errors nearly are."""
    if not posed.bounds or answer.instance is None:
        return {}
    bound, one = posed.bounds[answer.instance], posed.instances[answer.instance]
    return {'bound_deg': bound.degrees, 'bound_mm': 1e3 * bound.metres(one.place - one.pose.translation)}


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures of some pairs together; None where there is nothing to take one of."""
    searches = [search for row in rows for search in row['searches']]
    answers = [answer for search in searches for answer in search['answers']]
    right = [answer for answer in answers if answer['verdict'] == 'right']
    result: dict[str, Any] = {'pairs': len(rows), 'searches': len(searches)}
    result |= {key: sum(s[key] for s in searches) for key in ('to_find', 'found', 'refused_best', 'refused_any')}
    result['found_share'] = result['found'] / result['to_find'] if result['to_find'] else None
    result |= {name: sum(a['verdict'] == name for a in answers) for name in VERDICTS}
    result['like'] = sum(a['like'] for a in answers)
    result['absent'] = sum(not s['present'] for s in searches)
    for key, quantiles in (
        ('deg', (0.5, 0.9)),
        ('mm', (0.5, 0.9)),
        ('depth_percent', (0.5,)),
        ('stated', (0.5,)),
        ('bounded', (0.5,)),
        ('bound_deg', (0.5,)),
        ('bound_mm', (0.5,)),
        ('witness_px', (0.5,)),
        ('witness_true_px', (0.5,)),
    ):
        result |= _quantiles(key, [a[key] for a in right if a.get(key) is not None], quantiles)
    result['times_bound'] = None if result['bounded'] is None else float(np.sqrt(result['bounded']))
    result |= _quantiles('ms', [s['ms'] for s in searches], (0.5, 0.99, 1.0))
    result |= _quantiles('cpu_ms', [s['cpu_ms'] for s in searches], (0.5, 0.99, 1.0))
    result |= _quantiles('recovery_ms', [row['recovery_ms'] for row in rows], (0.5,))
    return result


def _quantiles(key: str, values: list[float], quantiles: tuple[float, ...]) -> dict[str, float | None]:
    names = {0.5: key, 0.9: f'{key}_p90', 0.99: f'{key}_p99', 1.0: f'{key}_max'}
    return {names[q]: float(np.quantile(values, q)) if values else None for q in quantiles}


# -- pictures --------------------------------------------------------------------------------------------------


def drawing(posed: PosedPair, searches: list[Search]) -> np.ndarray:
    """Both images, (h, w, 3) uint8: right answers green, wrong and false ones magenta, missed instances red, where they
    are, and what was found twice, or at one of two poses that look alike, yellow."""
    pair = posed.pair
    eyes = []
    for image, camera, shift in ((pair.left, pair.rig.left, 0.0), (pair.right, pair.rig.right, pair.rig.baseline)):
        picture = cv2.cvtColor((0.75 * image).astype(np.uint8), cv2.COLOR_GRAY2BGR)
        factor = max(1, round(900 / image.shape[1]))
        picture = cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_LINEAR)
        for search in searches:
            for number in search.missed:
                _draw(picture, factor, search.part.solid, posed.instances[number].pose, camera, shift, RED)
            for answer in search.answers:
                colour = {'right': GREEN, 'twice': YELLOW, 'ambiguous': YELLOW}.get(answer.verdict, MAGENTA)
                _draw(picture, factor, search.part.solid, answer.pose, camera, shift, colour)
        eyes.append(picture)
    height = max(eye.shape[0] for eye in eyes)
    return np.hstack([cv2.copyMakeBorder(e, 0, height - e.shape[0], 0, 8, cv2.BORDER_CONSTANT) for e in eyes])


def _draw(
    picture: np.ndarray,
    factor: int,
    solid: Solid,
    left_T_part: Pose,
    camera: PinholeCamera,
    shift: float,
    colour: tuple[int, int, int],
) -> None:
    """The creases of a part that one eye sees; shift : metres, of the eye along x."""
    pose = Pose(left_T_part.rotation, left_T_part.translation - [shift, 0.0, 0.0])
    seen = visible_features(solid, pose, camera)
    for number in np.flatnonzero(seen.kind != FeatureKind.AXIS):
        pixels = camera.project(seen.polyline(int(number), 65))
        at = np.round(16 * ((pixels + 0.5) * factor - 0.5)).astype(np.int32)
        cv2.polylines(picture, [at], False, colour, 1, cv2.LINE_AA, 4)
