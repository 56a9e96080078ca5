"""Messages to plain types and back: what each node spends on the wire format."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from measure import Measurement, milliseconds
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from msgs_py import BIN, FeatureSet, Interpretation, PinholeCamera, Pose, StereoRig, codecs


def measurements(quick: bool) -> Iterator[Measurement]:
    budget = 0.2 if quick else 1.0
    rng = np.random.default_rng(0)
    header = Header(frame_id='camera')
    pictures = {
        '512x512 mono8': (rng.integers(0, 256, (512, 512), dtype=np.uint8), 'mono8'),
        '512x512 rgb8': (rng.integers(0, 256, (512, 512, 3), dtype=np.uint8), 'rgb8'),
        '512x512 32FC1': (rng.random((512, 512)).astype(np.float32), '32FC1'),
    }
    for name, (array, encoding) in pictures.items():
        message = codecs.array_to_image(array, encoding, header)
        yield Measurement(
            f'image {name}: array to message',
            milliseconds(lambda a=array, e=encoding: codecs.array_to_image(a, e, header), budget),
        )
        yield Measurement(
            f'image {name}: message to array', milliseconds(lambda m=message: codecs.image_to_array(m), budget)
        )
        wire = serialize_message(message)
        yield Measurement(
            f'image {name}: to the wire and back by rclpy',
            milliseconds(lambda m=message, w=wire: (serialize_message(m), deserialize_message(w, Image)), budget),
            note='what ROS itself costs',
        )
    for count in (30, 1000):
        features = FeatureSet.from_edges(rng.normal(size=(count, 3)), rng.normal(size=(count, 3)), 1e-3, 1e-3)
        cloud = codecs.features_to_cloud(features, header)
        yield Measurement(
            f'{count} features: to PointCloud2',
            milliseconds(lambda f=features: codecs.features_to_cloud(f, header), budget),
        )
        yield Measurement(
            f'{count} features: from PointCloud2', milliseconds(lambda c=cloud: codecs.cloud_to_features(c), budget)
        )
        yield Measurement(
            f'{count} features: to markers',
            milliseconds(lambda f=features: codecs.features_to_markers(f, header), budget),
        )
    found = [
        Interpretation(
            f'model{k}',
            np.where(np.arange(40) % 3, np.arange(40), BIN),
            np.ones(40),
            Pose(),
            residual_rms=1e-4,
            covariance=np.eye(6) * 1e-8,
        )
        for k in range(8)
    ]
    report = codecs.report_from_interpretations(found, header)
    yield Measurement(
        '8 interpretations of 40 features: to a report',
        milliseconds(lambda: codecs.report_from_interpretations(found, header), budget),
    )
    yield Measurement(
        '8 interpretations of 40 features: from a report',
        milliseconds(lambda: codecs.interpretations_from_report(report), budget),
    )
    rig = StereoRig.symmetric(PinholeCamera.centred(512, 512, 703.0), 0.05)
    yield Measurement('camera_info of a rig', milliseconds(lambda: codecs.camera_infos_from_rig(rig, header), budget))
