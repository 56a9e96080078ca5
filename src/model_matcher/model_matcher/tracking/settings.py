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
# Sigmas of what is predicted, within which it is looked for; of a normal error 3 in 1000 lie outside.
SEARCHED_SIGMAS = 3.0
# Pixels that are searched at least: the width of an edge, and of what an outline that is reused is off.
LEAST_SEARCH = 3.0
# Frames that ACCELERATION counts for when an object's own is learnt, and frames that are remembered.
FIRST_FRAMES = 2.0
REMEMBERED = 10
# Share of the outline that something may cover from one frame to the next; where more is missed all at once, the object
# may as well be elsewhere, and is searched for farther away.
COVERED = 0.1
# Chance a frame that an object is moved as no acceleration does, and how far then, metres and radians: by a push.
JUMPS = 1e-3
JUMP_M = 0.02
JUMP_RAD = 0.087
# Chance a frame that an object vanishes, and that one that had vanished is there again where it was looked for: of a
# thousand frames.
VANISHES = 1e-3
RETURNS = 1e-3
# Log odds (nats) of an object being there, below which it is given up: even odds.
GIVEN_UP = 0.0
# Seconds after which a lost object is not looked for any more where it was last seen: what moves as fast as SPEED has
# left the range of JUMP_M several times over.
SOUGHT_S = 0.5
# Pixels that the limb of a curved surface may be off where an outline is reused: a fifth of what confirms a point.
SAGITTA_PX = 0.1
# Pixels around the images in which an outline is prepared, so that it need not be made again at once where it enters.
MARGIN_PX = 64
# Rounds of the outline's sigmas in a frame: they begin at those of the frame before.
ROUNDS = 2
# Variance of a turn, square radians, above which nothing shows it: that of an angle anywhere within a quarter turn.
UNSEEN_TURN = 0.2
# Pixels: of a side of the picture of an object that is looked for again, at most and at least; it is halved until so.
PATCH_PX = 48
LEAST_PATCH = 6
# Pixels to either side that are searched at once where little is searched for: those in which the images are asked
# whether the outline is there, REACH and one beside, and one that it may have moved.
ASKED = 10
# Points that an object is followed by, in all views together: of more each says what its neighbours do, since what a
# curve is off, a tenth of a pixel and more, they have in common.
MOST_POINTS = 320
# Corners of an object's surface that are followed in a view, at most; their quality as a share of the best one's;
# pixels between them, and pixels from the outline inside of which none is looked for.
CORNERS = 60
CORNER_QUALITY = 0.03
CORNER_APART = 5
OFF_OUTLINE = 5
# Strength of a corner over the variance of the noise, grey levels: SIGNIFICANT squared times what OpenCV's Sobel filter
# (sum of squares 12, scaled by 1 / 3060) makes of noise in 9 pixels.
CORNER_OF_NOISE = 9.0 * 9.0 * 12.0 / 3060.0**2
# Pixels of the window that is found again, and how often the images are halved for it.
FLOW_WINDOW = 15
FLOW_LEVELS = 3
# Pixels, sigma of a corner that is found again; corners that have to agree; steps to the pose.
CORNER_SIGMA = 0.3
FEWEST_CORNERS = 8
FLOW_TURNS = 6
# Median of the distance of a point whose two coordinates have normal errors of sigma 1.
RAYLEIGH_MEDIAN = 1.1774
# Nats of evidence below which corners are asked, too: of an outline that shows well they say nothing new.
WEAK = 30.0
# Shares of the straight curves of an outline, and of its others, that lie on edges, in space, of other things once the
# object has gone: it was predicted, and not thought of from edges.
OTHERS_EDGES = (0.001, 0.001)
# Chance that something came in front between two frames and hides a part all at once: what comes, comes in pieces, and
# an object of which little is seen any more is not followed.
SCREENED = 0.0
