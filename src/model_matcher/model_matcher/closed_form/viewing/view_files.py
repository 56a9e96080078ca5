"""Moments for the page: of files (a pair, a recording, features), recovered and matched, and of what was tested."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from msgs_py import FeatureSet, StereoRig
from stereo_recovery import recover

from ...image_pose.views import Views
from ...model.index import ModelIndex
from ...pair_match import hints_of, recovered_pair
from ...params import MatchParams
from ...pipeline import survey
from ...viewing.moments import Moment, Placed, placed_objects
from ...viewing.page import NoPlotly, write_page
from ..following.follow import FollowedFrame
from ..following.picture_frames import picture_frames
from ..recordings.bag_reader import StereoBag, is_bag
from ..recordings.result_reader import RecordedResult, RecordedResults, recorded_results
from ..result import CaseResult

VIEW = 'view.html'


def moment_of(
    models: Sequence[ModelIndex], features: FeatureSet, views: Views | None = None, stamp_s: float | None = None
) -> Moment:
    """Features with the models that are found among them.

    Parameters
    ----------
    models : sequence of ModelIndex
    features : FeatureSet
        Frame of the first camera, metres.
    views : Views, optional
        The images that they come from; poses are measured in them.
    stamp_s : float, optional
        Seconds; None of what has no place in time.
    """
    result = survey(models, features, views=views)
    return Moment(stamp_s, views, features, placed_objects(result.interpretations), result.reason or '')


def pair_moment(
    model: str, models: Sequence[ModelIndex], files: Sequence[Path], raw: bool = False, baseline: float | None = None
) -> tuple[Moment, list[str]]:
    """The moment of left image, right image and calibration, and what is wrong with them, which is among its words.

    Raises OSError and ValueError as :func:`~model_matcher.pair_match.recovered_pair` does.
    """
    recovered = recovered_pair(files, raw, baseline)
    found = moment_of(models, recovered.features, recovered.views)
    hints = recovered.doubts()
    if not found.placed:
        hints += hints_of(model, models, recovered.features, MatchParams(), recovered)
    words = '; '.join([found.words, *hints]).strip('; ')
    return Moment(None, found.views, found.features, found.placed, words), hints


def recorded_moments(
    models: Sequence[ModelIndex], path: Path, camera: Path | None = None, rate_hz: float = 30.0, every: int = 1
) -> Iterator[Moment]:
    """The moments of a folder of pairs or of a bag: what is recorded of them, else recovered and matched one by one.

    Parameters
    ----------
    models : sequence of ModelIndex
    path, camera, rate_hz
        As for :func:`~model_matcher.closed_form.following.picture_frames.picture_frames`.
    every : int
        Of so many frames one is taken.

    Raises
    ------
    OSError, ValueError
        Something is missing, or the pictures are of one camera.
    """
    if is_bag(path):
        recorded = recorded_results(path)
        if recorded.by_stamp:
            yield from list(_found_before(path, recorded))[::every]
            return
    first = None
    for number, frame in enumerate(picture_frames(path, camera, rate_hz)):
        if not isinstance(frame.rig, StereoRig):
            raise ValueError(f'{path}: pictures of one camera, expected pairs named left and right')
        first = frame.stamp_s if first is None else first
        if number % every == 0:
            features = recover(frame.images[0], frame.images[1], frame.rig).features
            yield moment_of(models, features, Views.of(frame.images, frame.rig), frame.stamp_s - first)


def _found_before(path: Path, recorded: RecordedResults) -> Iterator[Moment]:
    """The moments of a recording of which it holds what was found, with the images where it holds them, too."""
    left = dict(recorded.by_stamp)
    first = min(left)
    for pair in StereoBag(path, problem=lambda text: None) if recorded.with_images else ():
        result = left.pop(pair.stamp_ns, None)
        if result is not None:
            yield _recorded_moment(pair.stamp_ns - first, result, Views.of(pair.images, pair.rig))
    for stamp, result in left.items():
        yield _recorded_moment(stamp - first, result, None)


def _recorded_moment(nanoseconds: int, result: RecordedResult, views: Views | None) -> Moment:
    accepted = [one for one in result.interpretations if one.accepted]
    why = '' if accepted or not result.interpretations else result.interpretations[0].rejected_reason or ''
    return Moment(1e-9 * nanoseconds, views, result.features, placed_objects(accepted), why)


def followed_moment(name: str, one: FollowedFrame) -> Moment:
    """The moment of a frame in which an object was followed, without features."""
    views = Views.of(one.frame.images, one.frame.rig)
    if one.tracked is None or one.tracked.pose is None:
        return Moment(one.frame.stamp_s, views, words=f'{name}: lost')
    placed = Placed(name, name, one.tracked.pose, one.tracked.covariance)
    return Moment(one.frame.stamp_s, views, placed=(placed,))


def result_moment(result: CaseResult) -> tuple[dict[str, FeatureSet], list[Moment]]:
    """The model and the one moment of a closed-form test."""
    views = Views.of([result.left, result.right], result.rig)
    placed = () if result.found is None else placed_objects([replace(result.found, model=result.model_name)])
    return {result.model_name: result.model}, [Moment(None, views, result.data, placed, result.reason)]


def write_view(folder: Path, title: str, models: Mapping[str, FeatureSet], moments: Sequence[Moment]) -> bool:
    """Write view.html into a folder; whether it could be, which it cannot without plotly."""
    try:
        write_page(folder / VIEW, title, models, moments)
    except NoPlotly:
        return False
    return True
