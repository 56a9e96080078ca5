"""Numbers of the pose in the images, each with its unit and its reason."""

from __future__ import annotations

from msgs_py.numeric.settings import SRGB_EXPONENT

from ..geometry.settings import RIGHT_ANGLE, UNIFORM_VARIANCE

# Taps of the derivative of a Gaussian of 1 px, with which steps of grey are found along a profile, at 1, 2, 3 px from
# its middle; a step of one grey level gives one (Canny 1986, whose best filter this is close to).
TAPS = (0.6661, 0.2973, 0.0366)
# Steps of a profile that are kept, the strongest. Print and shadows stand beside an edge, rarely more than these.
CANDIDATES = 4
# Rows between those whose noise is looked at: enough pixels in a small image, few in a large one.
NOISE_ROWS = 8
# Pixels between neighbouring points of an outline, and to either side along their normals that steps are looked for:
# beyond, images of half the size are searched first.
SPACING = 4.0
REACH = 8
# Pixels to either side of a step that its fit takes in, at most: the flanks must say what the levels are.
FLANK = 4
# Grey levels for a root of a pixel, sigma of the walk that shade, print and grain make beside a step: what is believed
# while the blur is looked for, and what is tried, from less than the noise of a good camera to strong print; and how
# many of these, at most.
FIRST_WALK = 4.0
WALKS = tuple(0.03125 * 2.0 ** (0.5 * k) for k in range(19))
WALK_TURNS = 6
# Grey levels a pixel, sigma of the slope of shade beside a step: what is believed before a picture shows it, that of a
# rod thirty pixels wide from lit to dark; and the least, of which nothing is seen in a picture of whole levels.
FIRST_SLOPE = 2.0
LEAST_SLOPE = 0.01
# Chance, beforehand, that shade grows beside an edge, curves that this is worth, and turns in which an image's own
# curves tell it.
SHADED, SHADED_WORTH, SHADE_TURNS = 0.1, 5.0, 5
# Share of strong steps, those explained best, that tell the blur: others are no steps as they are drawn.
BLUR_SHARE = 0.75
# Pixels, sigmas that are added to the steps' own while a pose is drawn in: from half the reach to the width of an edge.
DRAWN_IN = (4.0, 2.8, 2.0, 1.4, 1.0, 0.7)
# Square radians: variance of a turn about an axis above which nothing shows it, that of an angle anywhere within a
# quarter turn.
UNSEEN_TURN = RIGHT_ANGLE * RIGHT_ANGLE * UNIFORM_VARIANCE
# Unknowns of an image that is off as a whole, for its camera is not quite where it is said to be: to the right and
# down. (Turned or larger, it is off by much the same all over what one object takes of it.)
OF_IMAGE = 2
# Points without which a pose of six unknowns is not measured.
FEWEST_POINTS = 12
# Pairs of steps of expectation-maximisation to the sigmas of lines at one pose, at most; the share that a last one
# changes.
SIGMA_TURNS = 14
SETTLED = 0.01
# Halvings to the sigma of points: to a thousandth of what it could be. And to the variance of images.
POINT_TURNS = 10
IMAGE_TURNS = 2 * POINT_TURNS
# Lengths of a step of theirs that are taken at once, at most.
LONGEST_JUMP = 16.0
# Rounds of sigmas of the outline's error and pose; steps to the pose in each, and rounds where they begin at the sigmas
# of the frame before.
TO_ERROR = 24
TO_POSE = 2
# Sigmas of the noise, of steps that tell the blur.
STRONG = 8.0
# Pixels, sigma of the blur that is believed first, of that of a sharp picture on square pixels, and of that of strong
# motion; how many times the one before the next is that is tried.
FIRST_BLUR = 0.64
LEAST_BLUR = 0.4
MOST_BLUR = 3.0
BLUR_FACTOR = 1.25
# Gauss-Newton steps of a step's fit, and the longest of them, pixels: from half a pixel away it has all digits.
FIT_TURNS = 5
LONGEST_FIT_STEP = 0.5
# What the last step of a fit takes from the sum of squares, in units of noise, at most: it moves the place by a tenth
# of its sigma, and the next would by about the square of that.
LAST_FIT_GAIN = 0.01
# Points by which blur and walk of an image are told, at most: of so many the median is good to a tenth of the noise.
QUALITY_POINTS = 128
# Pixels that a fitted step may be off what the pose predicts: farther, it was not seen from there.
FARTHEST_STEP = 1.5
# Further steps beside one that its fit takes in: an edge of a thin plate has one, a groove two.
BESIDE = 2
# What is believed of a step before it is looked at, sigma: grey levels of its contrast.
CONTRAST = 100.0
# Pixels to either side without which a step's levels cannot be told.
LEAST_FLANK = 2
# Pixels from the predicted place within which a step confirms a point: the blur of an edge, and what its pose is off.
# Also the sigma of its place, before it is looked at.
ON_EDGE = 1.0
# Pixels, root mean square, that an outline may move from where it was drawn for its steps to be fitted: what noise
# makes of a faint step; and how many times it is drawn at most.
MOST_MOVED, DRAWN_ANEW = 0.05, 4
# Pixels along the normals by which an outline is moved to see what chance does.
CONTROLS = (-8.0, -6.5, -5.0, -3.5, 3.5, 5.0, 6.5, 8.0)
# Confirmations and points believed to have been seen beforehand: after none, after one, where a curve begins.
PRIOR_CHANCES = ((3.0, 15.0), (6.0, 15.0), (4.0, 15.0))
# The same of points in runs, of which there are at least so many: 20 px, which texture alone does not do.
PRIOR_ALIGNED = (1.5, 50.0)
LEAST_RUN = 5
# Chance that a point in sight is confirmed; that the next one is hidden; that a hidden one's next is in sight.
SEEN_STEP = 0.9
STOPS = 0.05
REVEALED = 0.1
# Shares of the straight curves of a pose, and of its others, that lie on edges, in space, of what is not the object:
# poses are thought of from edges. Of absent parts, by test/benchmarks/calibrate_evidence.py.
OTHERS_EDGES = (0.23, 0.06)
# Pixels past an end of a curve at which an edge goes on: beyond what a corner's blur and TAPS reach, and then as far
# apart as points of an outline.
PAST_END = (6.0, 10.0, 14.0)
# Beta distributions of the share of ends past which an edge goes on: of the object's own curves, and of those that lie
# on others' edges. Fitted by test/benchmarks/calibrate_evidence.py, but for two things: parts that stand in line are
# rare in those pictures, so that the first is wider; and where nothing is tiled others' edges end, too, so that the
# second has half of the share. With (0.69, 4.1) one of the record's 600 absent parts in rendered scenes is answered.
ENDS_OF_OWN = (0.15, 6.0)
ENDS_OF_OTHERS = (0.25, 2.5)
# Shares of an outline that may be hidden, equally likely.
HIDDEN = (0.1, 0.3, 0.5, 0.7)
# Directions of the edge of what may stand in front.
SCREEN_DIRECTIONS = 12
# Pixels, the outline's errors that are believed at first: large, so that no curve is left out before they are known.
FIRST_ERROR_PX = 0.5
# Nats beforehand for curves being where they are drawn, against their being off in all views, and as much again against
# their being off in each: of 3 and 0 tried, with this covariances are truest (test/benchmarks/bench_covariances.py).
AS_DRAWN = 1.5
# Exponents of light by grey level that cameras have: none, and about that of sRGB (IEC 61966-2-1).
TONES = (1.0, SRGB_EXPONENT)
# Pixels to either side of the middle of a patch of surface; patches of a view, at most.
PATCH = 3
PATCHES = 80
# Pixels that a corner of a patch may be off its plane: the surface bends, or is another one there.
PATCH_BEND = 0.5
# Beta distributions of the share of patches that lie on the surface: where it is the object's own, and where it is
# another's. Fitted by test/benchmarks/calibrate_evidence.py.
SURFACE_OF_OWN = (0.45, 1.13)
SURFACE_OF_OTHERS = (0.45, 2.02)
# Share of the poses of absent objects whose faces lie on another's: the fit is as good with any up to a tenth.
OTHERS_FACES = 0.05
