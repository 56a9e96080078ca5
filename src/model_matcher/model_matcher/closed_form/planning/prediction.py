"""How exactly a view can tell a pose: the Fisher information of what is visible of a part, as images measure it.

The part is drawn at the pose and its visible creases and occluding contours are sampled, as they are when a pose is
measured (:mod:`model_matcher.image_pose`). A picture of the part at that pose, without blur and noise, says how high
the step of grey is at every sample. Contrast, blur and noise give the information on its place along its normal
(:mod:`.steps`). What a whole line is off besides, in all views and in each, is eliminated with its sigma, as the
measurement does it; so is what calibration leaves the image of a camera off, which no measurement can know. The sum
over all samples, six by six, inverted, is the covariance of the pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import Pose
from msgs_py.numeric.typed import FloatArray, Int32Array

from ...geometry.settings import NOT_ZERO
from ...image_pose.alignment import Placed
from ...image_pose.neighbours import neighbours
from ...image_pose.sight import NO_SIGHT, Sight, look
from ...image_pose.views import Views
from .part import PlannedPart
from .rig import PlannedRig
from .settings import DRAWN_CONTOUR_PX, DRAWN_LINE_PX, DRAWN_VIEW_PX, PIECE_TURN, SAMPLES, WORST
from .steps import Profiles, flanking_levels, place_variances, sensor_blur


@dataclass(frozen=True, eq=False)
class Prediction:
    """What is expected of a pose at one view.

    Attributes
    ----------
    pose : Pose
        left_T_part.
    covariance : (6, 6) float64
        Of a turn about the part's middle and a shift of it, radians and metres, left optical frame. Zero along what
        symmetry leaves free; what is not symmetric and yet not seen has the variance of its whole range.
    position, rotation : (2,) float64
        Metres of the middle and degrees: half, and nineteen of twenty, of all poses are nearer.
    sight : Sight
        The samples.
    contrast : (n,) float64
        Grey levels, of each.
    weight : (n,) float64
        Information of each on its place, one over square pixels; 0 of what cannot be measured.
    """

    pose: Pose
    covariance: FloatArray
    position: FloatArray
    rotation: FloatArray
    sight: Sight
    contrast: FloatArray
    weight: FloatArray

    @property
    def measured(self) -> int:
        """How many samples can be measured."""
        return int((self.weight > 0.0).sum())


def predict(part: PlannedPart, pose: Pose, rig: PlannedRig, pictures: list[FloatArray] | None = None) -> Prediction:
    """What is expected of the pose of a part that is seen whole, alone.

    Parameters
    ----------
    part : PlannedPart
    pose : Pose
        left_T_part.
    rig : PlannedRig
    pictures : list of (h, w) float64, optional
        Of each camera, of point samples; rendered when not given.

    Returns
    -------
    Prediction
    """
    pictures = part.pictures([pose], rig, 0) if pictures is None else pictures
    views = Views.of([np.asarray(np.rint(one).clip(0.0, 255.0), np.uint8) for one in pictures], rig.cameras)
    shape = part.index.shape
    assert shape is not None, 'a part of a plan has an outline'
    sight = look(shape, pose, views)
    if not len(sight):
        return _nothing(pose, part)
    contrast, variance, number = _steps(sight, pictures, rig)
    pieces = _in_pieces(sight.placed)
    weight = np.where(number > 0, 1.0 / (variance + rig.outline_px**2 + DRAWN_VIEW_PX**2), 0.0)
    normal = _information(pieces, weight, rig)
    # Turns about the outline's middle become turns about the part's.
    lever = pose.rotate((part.ball[0] - shape.centre)[None])[0]
    moved = np.eye(6)
    moved[3:, :3] = _cross(lever)
    normal = moved.T @ normal @ moved
    covariance = _inverse(normal, part, pose)
    return Prediction(pose, covariance, *_spread(covariance), sight, contrast, weight)


def _information(placed: Placed, weight: FloatArray, rig: PlannedRig) -> FloatArray:
    """Information (6, 6) on turn and shift, about the outline's middle, of samples with their weights (n,).

    What a line is off in each view, and in all of them, and what the image of every camera but the first is off as a
    whole, are unknowns with their sigmas, and eliminated in this order.
    """
    columns, sigma = [placed.slope[:, :6]], rig.calibration_px
    if sigma > 0.0:
        columns += [_of_camera(placed, eye, rig) for eye in range(1, int(placed.eye.max()) + 1)]
    rows = np.hstack(columns)
    line = np.stack([np.ones(len(weight)), placed.abscissa], axis=1)
    whole = (rows * weight[:, None]).T @ rows
    cross = np.zeros((int(placed.group.max()) + 1, 2, rows.shape[1]))
    own = np.zeros((len(cross), 2, 2))
    np.add.at(cross, placed.group, weight[:, None, None] * line[:, :, None] * rows[:, None])
    np.add.at(own, placed.group, weight[:, None, None] * line[:, :, None] * line[:, None])
    of_curve = placed.curve[np.flatnonzero(np.diff(placed.group, prepend=-1))]
    sums = np.zeros((int(of_curve.max()) + 1, 2, rows.shape[1])), np.zeros((int(of_curve.max()) + 1, 2, 2))
    for drawn in (DRAWN_VIEW_PX, DRAWN_LINE_PX):
        known = np.eye(2) / (rig.outline_px**2 + drawn**2)
        taken = np.linalg.solve(own + known, cross)
        whole -= np.einsum('gik,gil->kl', cross, taken)
        if drawn == DRAWN_VIEW_PX:  # what is left of its views tells of a curve's own line
            np.add.at(sums[0], of_curve, cross - own @ taken)
            np.add.at(sums[1], of_curve, own - own @ np.linalg.solve(own + known, own))
            cross, own = sums
    cameras = whole[6:, 6:] + np.eye(len(whole) - 6) / max(sigma, NOT_ZERO) ** 2
    return np.asarray(whole[:6, :6] - whole[:6, 6:] @ np.linalg.solve(cameras, whole[6:, :6]))


def _of_camera(placed: Placed, eye: int, rig: PlannedRig) -> FloatArray:
    """How far samples move along their normals (n, 4) when the image of a camera is off: right, down, turned, larger.

    The last two by a pixel at its right border.
    """
    camera = rig.cameras.cameras[eye]
    off = (placed.pixel - [camera.cx, camera.cy]) * (2.0 / camera.width)
    u, v = off.T
    across, down = (placed.normal * (placed.eye == eye)[:, None]).T
    return np.stack([across, down, down * u - across * v, across * u + down * v], axis=1)


def _in_pieces(placed: Placed) -> Placed:
    """Samples with curves cut where their normals turn: what a bent one is off is no line all along it."""
    turned = np.arctan2(placed.normal[:, 1], placed.normal[:, 0])
    piece = np.floor(turned / PIECE_TURN).astype(int)
    piece -= piece.min()
    pieces = int(piece.max()) + 1
    begins = np.flatnonzero((np.diff(placed.group, prepend=-1) != 0) | (np.diff(piece, prepend=-1) != 0))
    counts = np.diff([*begins, len(piece)])
    group = np.repeat(np.arange(len(begins)), counts)
    place = np.arange(len(piece)) - begins[group]
    curve = np.unique(placed.curve * pieces + piece, return_inverse=True)[1]
    return placed._replace(
        group=group.astype(np.int32), curve=curve.astype(np.int32), abscissa=(2.0 * place + 1.0) / counts[group] - 1.0
    )


def _steps(sight: Sight, pictures: list[FloatArray], rig: PlannedRig) -> tuple[FloatArray, FloatArray, Int32Array]:
    """Contrast, grey levels, variance of the place, square pixels, and 1 or 0 for what can be measured, (n,) each."""
    placed = sight.placed
    contrast, level = np.zeros(len(sight)), np.zeros(len(sight))
    for eye, picture in enumerate(pictures):
        rows = sight.rows(eye)
        ahead, behind = flanking_levels(picture, placed.pixel[rows], placed.normal[rows])
        contrast[rows], level[rows] = ahead - behind, 0.5 * (ahead + behind)
    beside, flank = neighbours(placed, sight.spacing)
    profiles = Profiles(flank, sight.limb, beside[:, :, 0], sight.stretch)
    variance = place_variances(contrast, profiles, sensor_blur(rig.sensor.psf), rig.sensor.pixel_noise(level), rig.walk)
    good = np.isfinite(variance)
    # A contour that is off as a whole tells no more than one sample would that is off by as much.
    contours = good & (sight.limb != 0.0)
    together = np.bincount(placed.group[contours], minlength=int(placed.group.max()) + 1)[placed.group]
    variance += np.where(contours, together * DRAWN_CONTOUR_PX**2, 0.0)
    return contrast, np.where(good, variance, 1.0), good.astype(np.int32)


def _inverse(normal: FloatArray, part: PlannedPart, pose: Pose) -> FloatArray:
    """The covariance (6, 6) of an information matrix about the part's middle, without what symmetry leaves free."""
    middle, radius = part.ball
    units = np.array([1.0 / radius] * 3 + [1.0] * 3)
    scaled = normal * np.outer(units, units)
    # What nothing tells is known to half a turn, or to the part's own size.
    scaled += np.eye(6) / radius**2
    covariance = np.linalg.inv(scaled)
    if part.axis is not None:
        turn = pose.rotate(part.axis.direction[None])[0]
        arm = pose.rotate((middle - part.axis.point)[None])[0]
        free = np.concatenate([radius * turn, np.cross(turn, arm)])
        free /= np.linalg.norm(free)
        kept = np.linalg.svd(np.eye(6) - np.outer(free, free))[0][:, :5]
        covariance = kept @ np.linalg.inv(kept.T @ scaled @ kept) @ kept.T
    return np.asarray(covariance * np.outer(units, units))


def _spread(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Median and WORST quantile (2,) of the shift, metres, and of the turn, degrees."""
    values, vectors = np.linalg.eigh(covariance)
    drawn = SAMPLES @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    turn, shift = np.linalg.norm(drawn[:, :3], axis=1), np.linalg.norm(drawn[:, 3:], axis=1)
    return np.quantile(shift, (0.5, WORST)), np.degrees(np.quantile(turn, (0.5, WORST)))


def _nothing(pose: Pose, part: PlannedPart) -> Prediction:
    """The prediction where nothing is in view."""
    covariance = _inverse(np.zeros((6, 6)), part, pose)
    return Prediction(pose, covariance, *_spread(covariance), NO_SIGHT, np.zeros(0), np.zeros(0))


def _cross(vector: FloatArray) -> FloatArray:
    """(3, 3) float64: M with M w = vector x w."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
