"""Features as visualization_msgs/MarkerArray: a picture for RViz, not a data channel."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ..features import FeatureKind, FeatureSet

# Red, green, blue from 0 to 1 for each kind: edges green, curves blue, axes orange.
DEFAULT_COLOURS = {
    FeatureKind.EDGE: (0.1, 0.8, 0.2),
    FeatureKind.CURVE: (0.2, 0.5, 1.0),
    FeatureKind.AXIS: (1.0, 0.6, 0.1),
}
# Points of a curve: a whole circle is then drawn to 0.2 % of its radius, 1 - cos(pi / 47).
CURVE_SAMPLES = 48


def features_to_markers(
    features: FeatureSet,
    header: Header | None = None,
    namespace: str = 'features',
    colours: dict[FeatureKind, tuple[float, float, float]] | None = None,
    width: float = 0.001,
    clear: bool = True,
) -> MarkerArray:
    """One LINE_LIST for each kind of feature, namespace and id the same from frame to frame.

    Parameters
    ----------
    features : FeatureSet
        Metres, in the header's frame.
    header : std_msgs.msg.Header, optional
    namespace : str
        Begin of the markers' namespaces.
    colours : dict of FeatureKind to (r, g, b), optional
        From 0 to 1.
    width : float
        Width of the lines, metres.
    clear : bool
        Begin with a DELETEALL, so that features that are gone disappear from the view.

    Returns
    -------
    visualization_msgs.msg.MarkerArray
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
    """A marker with its identity and nothing to draw yet."""
    marker = Marker()
    if header is not None:
        marker.header = header
    marker.ns, marker.id, marker.action = namespace, identifier, action
    return marker
