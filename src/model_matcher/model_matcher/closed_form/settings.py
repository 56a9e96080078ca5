"""Numbers of closed-form testing: what counts as found, how a case is arranged, and how long a node may take."""

from __future__ import annotations

from typing import NamedTuple

from csg_renderer.language.values import rotation
from msgs_py import Pose

# -- found against true ----------------------------------------------------------------------------------------------

# A found edge belongs to a true one when it is this close to parallel (degrees), and both its ends are this close to it
# (metres): a few times the error of an end point at the distances of the bundled scenes.
SAME_DIRECTION_DEG = 10.0
SAME_PLACE_M = 0.003

# -- what a case does not say ----------------------------------------------------------------------------------------

# An object that is not in front of the camera as drawn: its enclosing sphere then spans this part of the image, seen
# from beside and above.
SPAN = 0.7
VIEW = Pose((rotation('X', -30.0) @ rotation('Y', 40.0))[:3, :3])
# Lights of a scene that has none: a key and a fill light, by position in distances of the object and brightness.
LIGHTS = (((-0.6, -1.0, 0.1), 0.7), ((1.0, -0.2, 0.3), 0.35))
# Random poses shift the object by up to this part of its distance.
JITTER = 0.08
# Clutter, from and to: sizes relative to the object's, distances relative to its distance.
CLUTTER_SIZE = (0.2, 0.6)
CLUTTER_DEPTH = (0.9, 1.5)

# -- the nodes -------------------------------------------------------------------------------------------------------

# Seconds that one message or service may take before the case is given up.
TIMEOUT_S = 60.0

# -- sequences -------------------------------------------------------------------------------------------------------


class _Path(NamedTuple):
    """How a part swings.

    Attributes
    ----------
    reach
        The middle goes no farther along an axis than this share of its depth: the part stays in view.
    rock_deg
        Degrees, the largest turn about one axis of a part that tumbles.
    shift_hz, turn_hz
        The slowest swings along and about x, y, z; no two in step, so that no pose comes twice soon.
    """

    reach: float
    rock_deg: float
    shift_hz: tuple[float, float, float]
    turn_hz: tuple[float, float, float]


PATH = _Path(0.06, 40.0, (0.31, 0.23, 0.17), (0.13, 0.19, 0.29))


class _Occluder(NamedTuple):
    """Bars that pass in front of a part.

    Attributes
    ----------
    depth
        Of its middle, in shares of the part's least distance.
    thickness
        In shares of the bar's distance.
    pass_s
        Seconds from well outside the picture on one side to the other.
    first
        How far across the first one is when the sequence starts, in shares of its way: beside the part still.
    """

    depth: float
    thickness: float
    pass_s: float
    first: float


OCCLUDER = _Occluder(0.95, 0.03, 4.0, 0.2)
# Pictures whose mean is a blurred one, at most; else as many as a part moves pixels: a pixel's own width closes gaps as
# wide.
SUBFRAMES = 16
