"""What all features of a pair have in common: the columns of a rig that is not quite what it is said to be.

A camera that has moved a little since its calibration shows its rows off, which the pair tells, and its columns off by
about as much, which it does not: all disparities are then too large or too small together, and with them all depths.
"""

from __future__ import annotations

import numpy as np

from msgs_py import FeatureKind, FeatureSet, StereoRig
from msgs_py.numeric.typed import FloatArray


def with_columns_off(features: FeatureSet, sigma: float, rig: StereoRig) -> FeatureSet:
    """Features with what they have in common when all disparities are off by so many pixels, one sigma.

    Parameters
    ----------
    features : FeatureSet
        Left optical frame, metres, with their covariances.
    sigma : float
        Pixels.
    rig : StereoRig
    """
    if not sigma > 0.0 or not len(features):
        return features
    # One over the depth grows by so much, so that a point p moves by -share z p.
    share = sigma / (rig.left.fx * rig.baseline)
    curve = (features.kind == FeatureKind.CURVE)[:, None]
    return features.with_common(
        np.hstack(
            [_moved(features.start, share), np.where(curve, _turned(features, share), _moved(features.end, share))]
        )
    )


def _moved(points: FloatArray, share: float) -> FloatArray:
    """(n, 3) metres by which points move."""
    return np.asarray(-share * points[:, 2:] * points)


def _turned(features: FeatureSet, share: float) -> FloatArray:
    """(n, 3) by which unit normals turn, of planes through the starts: n . p = d becomes (n + share d z) . p = d."""
    normal = features.vectors
    distance = (normal * features.start).sum(axis=1)[:, None]
    return np.asarray(share * distance * (np.array([0.0, 0.0, 1.0]) - normal * normal[:, 2:]))
