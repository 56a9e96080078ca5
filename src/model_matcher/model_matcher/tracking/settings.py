"""Numbers of tracking, each with its unit and its reason."""

from __future__ import annotations

# Seconds between frames where nobody says: that of most cameras.
PERIOD_S = 1.0 / 30.0
# Metres a second squared: sigma of the acceleration of any point of an object that a hand or a robot moves, 0.2 g.
ACCELERATION = 2.0
# Metres a second: sigma of the speed of any point of an object of which nothing is known yet.
SPEED = 0.25
# Metres: sigma of a pose to start from that comes without covariance, of any point of the object.
START = 0.003
# Frames of which an object's acceleration is learnt, and after which images are measured anew.
REMEMBERED = 10
# Share of the outline that something may cover from one frame to the next; where more is missed all at once, the object
# may as well be elsewhere, and is searched for farther away.
COVERED = 0.1
# Chance a frame of what happens once in a thousand of them: an object is moved as no acceleration does; it vanishes;
# one that had vanished is there again where it was looked for; an outline that was predicted, and not thought of from
# edges, lies on edges of other things.
RARE = 1e-3
# How far a push moves it, metres and radians.
JUMP_M = 0.02
JUMP_RAD = 0.087
# Pixels that the limb of a curved surface may be off where an outline is reused: a fifth of what confirms a point.
SAGITTA_PX = 0.1
# Pixels around the images in which an outline is prepared, so that it need not be made again at once where it enters.
MARGIN_PX = 64
# Pixels: of a side of the picture of an object that is looked for again, at most; it is halved until so.
PATCH_PX = 48
# Points that an object is followed by, in all views together: of more each says what its neighbours do, since what a
# curve is off, a tenth of a pixel and more, they have in common.
MOST_POINTS = 320
# Corners of an object's surface that are followed in a view, at most; pixels between them, and from the curves of the
# outline, nearer to which none is looked for.
CORNERS = 60
CORNER_APART = 5
# Strength of a corner over the variance of the noise, grey levels: the square of three sigma times what OpenCV's Sobel
# filter (sum of squares 12, scaled by 1 / 3060) makes of noise in 9 pixels.
CORNER_OF_NOISE = 9.0 * 9.0 * 12.0 / 3060.0**2
# Pixels of the window that is found again.
FLOW_WINDOW = 15
# Pixels, sigma of a corner that is found again; corners that have to agree.
CORNER_SIGMA = 0.3
FEWEST_CORNERS = 8
# Nats of evidence below which corners are asked, too: of an outline that shows well they say nothing new.
WEAK = 30.0
