"""What nodes, or ``replay``, have found, out of a recording: by the stamp of the images that it was found in."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from msgs_py import FeatureSet, Interpretation
from msgs_py.node_runtime.stamp_sync import stamp_ns

from .bag_reader import COMPRESSED, IMAGES

FEATURES, REPORT = 'features', 'interpretations/report'
# renderer_node's truth has a topic that ends as the features do.
NOT_FOUND = 'ground_truth/features'


@dataclass
class RecordedResult:
    """What is recorded of one moment.

    Attributes
    ----------
    features : FeatureSet
        In the frame of the first camera, metres.
    interpretations : list of Interpretation
        Accepted and rejected ones, best first.
    """

    features: FeatureSet
    interpretations: list[Interpretation]


@dataclass(frozen=True)
class RecordedResults:
    """What is recorded.

    Attributes
    ----------
    by_stamp : dict of int to RecordedResult
        Nanoseconds; empty where nothing is recorded but images.
    with_images : bool
        Whether there are images of a pair, too.
    """

    by_stamp: dict[int, RecordedResult]
    with_images: bool


def recorded_results(path: Path) -> RecordedResults:
    """Read features and reports of a recording.

    Parameters
    ----------
    path : Path
        As for :class:`.bag_reader.StereoBag`.

    Raises
    ------
    OSError, ValueError
        The recording cannot be read; begins with its name.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ValueError(f'{path}: reading bags needs rosbags (pip install rosbags)') from None
    found: dict[int, RecordedResult] = {}
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            topics = {one.topic.removesuffix(COMPRESSED) for one in reader.connections}
            with_images = all(any(topic.endswith(name) for topic in topics) for name in IMAGES)
            wanted = [one for one in reader.connections if _kind(one.topic) is not None]
            # Of no connection at all the reader takes every one.
            for connection, _, data in reader.messages(wanted) if wanted else ():
                _take(found, connection.topic, reader.deserialize(data, connection.msgtype))
    except (AnyReaderError, AssertionError, EOFError) as error:
        raise ValueError(f'{path}: not a bag that can be read: {error}') from None
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None
    return RecordedResults(found, with_images)


def _kind(topic: str) -> str | None:
    """FEATURES or REPORT, if a topic is one of these, in whatever namespace."""
    if topic.endswith(f'/{NOT_FOUND}'):
        return None
    return next((name for name in (FEATURES, REPORT) if topic.endswith(f'/{name}')), None)


def _take(found: dict[int, RecordedResult], topic: str, message: Any) -> None:
    """Add a message to the moment of its stamp. Raises ValueError naming the topic."""
    # The codecs need message classes, which most who import this do without.
    from msgs_py.codecs import CodecError, cloud_to_features, interpretations_from_report

    result = found.setdefault(stamp_ns(message.header), RecordedResult(FeatureSet.empty(), []))
    try:
        if _kind(topic) == FEATURES:
            result.features = cloud_to_features(message)
        else:
            result.interpretations = interpretations_from_report(_report(message))
    except CodecError as error:
        raise ValueError(f'{topic}: {error}') from None


def _report(message: Any) -> Any:
    """A recorded report as the codecs take it: rosbags has numbers for the bytes of ROS."""
    return SimpleNamespace(
        status=[
            SimpleNamespace(level=bytes([one.level]), name=one.name, message=one.message, values=one.values)
            for one in message.status
        ]
    )
