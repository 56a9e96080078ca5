"""A bag of stereo images played to the libraries, as fast as the machine goes: features and poses into a file."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from std_msgs.msg import Header

from msgs_py import Interpretation
from msgs_py.codecs import (
    features_to_cloud,
    pose_to_stamped,
    pose_with_covariance_stamped,
    poses_to_array,
    report_from_interpretations,
)
from stereo_recovery import RecoveryParams, recover

from ...image_pose.views import Views
from ...model.equal_poses import canonical
from ...model.index import ModelIndex
from ...model.library import safe_name
from ...params import MatchParams
from ...pipeline import survey
from .bag_reader import RecordedPair
from .mcap_file import McapFile

FEATURES, FOUND = '/features', '/interpretations'


@dataclass(frozen=True, eq=False)
class ReplayedPair:
    """What a pair of a bag gave.

    Attributes
    ----------
    pair : RecordedPair
    features : int
        How many.
    found : tuple of Interpretation
        Accepted, best first.
    reason : str
        Why nothing was found, else empty.
    milliseconds : float
        Of recovery and matching.
    """

    pair: RecordedPair
    features: int
    found: tuple[Interpretation, ...]
    reason: str
    milliseconds: float


def replay(
    pairs: Iterable[RecordedPair],
    models: Sequence[ModelIndex],
    out: McapFile | None = None,
    inputs: bool = False,
    recovery: RecoveryParams | None = None,
    matching: MatchParams | None = None,
) -> Iterator[ReplayedPair]:
    """Recover and match each pair, as recovery_node and matcher_node do, and write what these publish.

    Parameters
    ----------
    pairs : iterable of RecordedPair
    models : sequence of ModelIndex
    out : McapFile, optional
        Gets /features, /interpretations and what stands below it, with the stamp and frame of the left image, at the
        place that the pair has in the bag.
    inputs : bool
        Copy the images and camera_info of the pairs as well.
    recovery : RecoveryParams, optional
    matching : MatchParams, optional

    Yields
    ------
    ReplayedPair
        One for each pair.
    """
    by_name = {model.name: model for model in models}
    for pair in pairs:
        start = time.perf_counter()
        recovered = recover(pair.images[0], pair.images[1], pair.rig, recovery)
        result = survey(models, recovered.features, matching, Views.of(pair.images, pair.rig))
        found = tuple(canonical(by_name[one.model], one) for one in result.interpretations)
        spent = 1e3 * (time.perf_counter() - start)
        if out is not None:
            header = _header(pair)
            if inputs:
                for message in pair.messages:
                    out.write_bytes(message.topic, message.kind, message.data, message.log_ns, pair.stamp_ns)
            out.write(FEATURES, features_to_cloud(recovered.features, header), pair.log_ns)
            for topic, answer in _answers(found, result.rejected, header):
                out.write(topic, answer, pair.log_ns)
        reason = '' if found else recovered.reason or result.reason or ''
        yield ReplayedPair(pair, len(recovered.features), found, reason, spent)


def _answers(
    found: Sequence[Interpretation], rejected: Sequence[Interpretation], header: Header
) -> Iterator[tuple[str, Any]]:
    """Topics and messages of what was found, as matcher_node has them."""
    best: dict[str, Interpretation] = {}
    for one in found:
        best.setdefault(one.model, one)
    for name, one in best.items():
        topic = f'{FOUND}/{safe_name(name)}'
        yield topic, pose_to_stamped(one.pose, header)
        yield f'{topic}/with_covariance', pose_with_covariance_stamped(one.pose, one.covariance, header)
    yield f'{FOUND}/report', report_from_interpretations([*found, *rejected], header)
    yield FOUND, poses_to_array([one.pose for one in found], header)


def _header(pair: RecordedPair) -> Header:
    header = Header(frame_id=pair.frame_id)
    header.stamp.sec, header.stamp.nanosec = divmod(pair.stamp_ns, 10**9)
    return header
