"""Numbers of closed-form testing: what counts as found, how a case is arranged, and how long a node may take."""

from __future__ import annotations

from csg_renderer.language.values import rotation
from msgs_py import Pose

# -- found against true ----------------------------------------------------------------------------------------------

# A found edge belongs to a true one when it is this close to parallel (degrees), and both its ends are this close to it
# (metres): a few times the error of an end point at the distances of the bundled scenes.
SAME_DIRECTION_DEG = 10.0
SAME_PLACE_M = 0.003
# Degrees: a pairing of an interpretation is judged by where the ends lie, within half of SAME_PLACE_M; the direction of
# an edge of a few millimetres says little, and only has to tell it from its neighbours.
PAIRED_DIRECTION_DEG = 30.0
# A true edge counts as found when this part of its length is covered.
FOUND_SHARE = 0.5

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
# Seconds that the executor waits before the awaited condition is tested again.
SPIN_S = 0.05
