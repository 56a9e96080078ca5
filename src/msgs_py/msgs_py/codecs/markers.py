"""Features as visualization_msgs/MarkerArray: a picture for RViz, not a data channel."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ..features import FeatureKind, FeatureSet

# One hue a kind: edges green, curves blue, axes orange.
DEFAULT_COLOURS = {
    FeatureKind.EDGE: (0.1, 0.8, 0.2),
    FeatureKind.CURVE: (0.2, 0.5, 1.0),
    FeatureKind.AXIS: (1.0, 0.6, 0.1),
}
CURVE_SAMPLES = 48


def features_to_markers(
    features: FeatureSet,
    header: Header | None = None,
    namespace: str = 'features',
    colours: dict[FeatureKind, tuple[float, float, float]] | None = None,
    width: float = 0.001,
    clear: bool = True,
) -> MarkerArray:
    """One LINE_LIST a kind, namespace and id stable from frame to frame.

    colours : (r, g, b) in 0..1 a kind; width : line width, metres; clear : begin with a DELETEALL, so that features
    that are gone disappear from the view.
    """
    colours = DEFAULT_COLOURS if colours is None else colours
    array = MarkerArray()
    if clear:
        array.markers.append(_marker(header, namespace, 0, Marker.DELETEALL))
    for kind in FeatureKind:
        indices = np.flatnonzero(features.kind == kind)
        if not len(indices):
            continue
        marker = _marker(header, f'{namespace}/{kind.name.lower()}', int(kind), Marker.ADD)
        marker.type = Marker.LINE_LIST
        marker.pose.orientation.w = 1.0
        marker.scale.x = float(width)
        r, g, b = colours[kind]
        marker.color = ColorRGBA(r=float(r), g=float(g), b=float(b), a=1.0)
        for index in indices:
            line = features.polyline(int(index), CURVE_SAMPLES)
            points = [Point(x=x, y=y, z=z) for x, y, z in line.tolist()]
            for first, second in zip(points, points[1:]):
                marker.points += [first, second]
        array.markers.append(marker)
    return array


def _marker(header: Header | None, namespace: str, identifier: int, action: int) -> Marker:
    marker = Marker()
    if header is not None:
        marker.header = header
    marker.ns, marker.id, marker.action = namespace, identifier, action
    return marker
