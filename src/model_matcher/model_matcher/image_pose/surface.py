"""Whether the views show one surface where a pose puts it: print, scratches and grain lie on it in all of them.

A patch of the first image, put on the model's surface, is looked for in another image along its epipolar line, near
where the surface has it (plane sweep; Collins 1996). An edge says that something ends there; the inside of a face says
how far away it is, all over. Patches that the outline crosses are left to it, and so are those in which nothing tells
where along the line they are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from msgs_py import Pose
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import ByteArray, FloatArray, Int32Array, IntArray

from ..geometry.settings import NOT_ZERO, UNIFORM_VARIANCE
from .counts import beta_binomial
from .settings import OTHERS_FACES, PATCH, PATCH_BEND, PATCHES, REACH, SURFACE_OF_OTHERS, SURFACE_OF_OWN
from .sight import Shape, Sight
from .views import Views


class Agreement(NamedTuple):
    """Patches of a face that tell where they are, and those of them that lie on it.

    Attributes
    ----------
    agree, looked : int
        Patches; each counts once for each further view.
    """

    agree: int
    looked: int


def agreement(shape: Shape, pose: Pose, sight: Sight, views: Views) -> tuple[Agreement, ...]:
    """How many patches of each face the other views show where a pose has them.

    Parameters
    ----------
    shape : Shape
    pose : Pose
        first_T_model.
    sight : Sight
        Its outline there.
    views : Views

    Returns
    -------
    tuple of Agreement
        Of the faces that have such patches; of one view, none.
    """
    outline = sight.placed.pixel[sight.rows(0)]
    if len(views) < 2 or len(outline) < 3:
        return ()
    middle, face = _grid(outline, views.images[0])
    plane, bend = _planes(shape, views.poses[0].inverse().compose(pose), views, middle)
    counts = np.zeros((face.max(initial=-1) + 1, 2), np.int64)
    for other in range(1, len(views)):
        noise = math.hypot(float(views.noise[0]), float(views.noise[other]))
        pair = _second_from_first(views.rows[0], views.rows[other])
        _compare(views.images[0], views.images[other], pair, middle, face, plane, bend, noise, counts)
    return tuple(Agreement(*one) for one in counts[counts[:, 1] > 0].tolist())


def log_ratio(found: Sequence[Agreement]) -> float:
    """Log-likelihood ratio of patches that agree: the faces are the object's own, or others'.

    What share of its patches a face shows differs from one to the next: print shows nearly all, polished metal mirrors
    what lies elsewhere. The share has a beta distribution, so that the counts have a beta-binomial one; where another
    surface lies about there, another one. A pose that is thought of from edges in space may lie with a face on that of
    another object, and there is no difference; but seldom with all.

    Parameters
    ----------
    found : sequence of Agreement
        Of each face.

    Returns
    -------
    float
        Nats.

    Examples
    --------
    >>> printed, metal = Agreement(14, 18), Agreement(1, 18)
    >>> log_ratio([printed, printed]) > 1.5 > log_ratio([printed, metal]) > 0.0 > log_ratio([metal]) > -0.5
    True
    >>> log_ratio([])
    0.0
    """
    ratios = (beta_binomial(*face, SURFACE_OF_OWN) - beta_binomial(*face, SURFACE_OF_OTHERS) for face in found)
    return sum((-math.log(OTHERS_FACES + (1.0 - OTHERS_FACES) * math.exp(-ratio)) for ratio in ratios), 0.0)


def _grid(outline: FloatArray, image: ByteArray) -> tuple[FloatArray, Int32Array]:
    """Middles of patches (n, 2), whole pixels, in the box of an outline (m, 2) that does not cross them; faces (n,).

    A face is what the outline divides from the rest.
    """
    edge = PATCH + 1.0
    first = np.ceil(np.maximum(outline.min(axis=0), edge))
    last = np.minimum(outline.max(axis=0), np.array(image.shape[::-1]) - 1.0 - edge)
    if not (last > first).all():
        return np.zeros((0, 2)), np.zeros(0, np.int32)
    step = max(2.0 * PATCH + 1.0, math.sqrt(float(np.prod(last - first)) / PATCHES))
    u, v = (np.floor(np.arange(a + 0.5 * step, b, step)) for a, b in zip(first, last))
    middle = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)[:PATCHES]
    inside = ((outline >= first) & (outline <= last)).all(axis=1)
    column, row = (outline[inside] - first).astype(np.int64).T
    width, height = (last - first).astype(np.int64) + 1
    clear = np.ones((height, width), np.uint8)
    clear[row, column] = 0
    # Points of an outline are SPACING apart: as wide as this they make a line.
    wall = cv2.erode(clear, np.ones((5, 5), np.uint8))
    label = cv2.connectedComponents(wall, connectivity=4)[1]
    room = cv2.erode(clear, np.ones((2 * PATCH + 5, 2 * PATCH + 5), np.uint8))
    column, row = (middle - first).astype(np.int64).T
    kept = room[row, column] > 0
    return middle[kept], label[row, column][kept]


def _planes(shape: Shape, pose: Pose, views: Views, middle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverse depth at the middles of patches, and its slopes in u and v (n, 3); how far from that a corner is (n,).

    pose : camera_T_model. One over metres; not a number where there is no surface.
    """
    corner = middle[:, None] + PATCH * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]])
    place = pose.apply(shape.surface(pose, views.cameras[0], corner.reshape(-1, 2)))
    inverse = 1.0 / place[:, 2].reshape(-1, 4)
    slope = inverse[:, 1:3] - inverse[:, :1]
    bend = np.abs(inverse[:, 3] - inverse[:, 0] + slope.sum(axis=1))
    return np.column_stack([inverse[:, 0], slope / PATCH]), bend


def _second_from_first(first: FloatArray, second: FloatArray) -> FloatArray:
    """A pair of cameras, each as :attr:`.views.Views.rows` has it, (20,): second_R_first and t, intrinsics of both."""
    turn = second[:9].reshape(3, 3) @ first[:9].reshape(3, 3).T
    return np.concatenate([turn.ravel(), second[9:12] - turn @ first[9:12], first[12:], second[12:]])


@njit(nogil=True)
def _compare(
    image: ByteArray,
    other: ByteArray,
    pair: FloatArray,
    middle: FloatArray,
    face: Int32Array,
    plane: FloatArray,
    bend: FloatArray,
    noise: float,
    counts: IntArray,
) -> None:
    """Add to the patches of each face (f, 2) those that agree, and those that could.

    image, other : (h, w) uint8; pair : (20,), see above; middle : (n, 2); face : (n,); plane : (n, 3); bend : (n,);
    noise : grey levels, of the difference of both images
    """
    width = 2 * PATCH + 1
    patch, place = np.empty((width, width)), np.empty((width, width, 2))
    for n in range(len(middle)):
        u, v = int(middle[n, 0]), int(middle[n, 1])
        x, y, z, along = _seen(pair, float(u), float(v), plane[n, 0])
        speed = math.hypot(along[0], along[1])
        if not z > 0.0 or not bend[n] * speed < PATCH_BEND:
            continue
        along = (along[0] / speed, along[1] / speed)
        for i in range(width):
            for j in range(width):
                du, dv = float(j - PATCH), float(i - PATCH)
                depth = plane[n, 0] + plane[n, 1] * du + plane[n, 2] * dv
                place[i, j, 0], place[i, j, 1], z, _ = _seen(pair, u + du, v + dv, depth)
                patch[i, j] = image[v + i - PATCH, u + j - PATCH]
        patch -= patch.mean()
        # Noise leaves no more open than that the nearest pixel is taken.
        if _shift_variance(patch, along, noise) > UNIFORM_VARIANCE:
            continue
        shift = _best_shift(patch, other, place, along)
        if shift <= REACH:
            counts[face[n], 0] += shift == 0
            counts[face[n], 1] += 1


@njit(nogil=True)
def _seen(pair: FloatArray, u: float, v: float, inverse: float) -> tuple[float, float, float, tuple[float, float]]:
    """Where the second camera sees what the first does at (u, v), how deep, and how it moves with inverse depth."""
    x, y = (u - pair[14]) / pair[12], (v - pair[15]) / pair[13]
    px = pair[0] * x + pair[1] * y + pair[2] + pair[9] * inverse
    py = pair[3] * x + pair[4] * y + pair[5] + pair[10] * inverse
    pz = pair[6] * x + pair[7] * y + pair[8] + pair[11] * inverse
    if not pz > 0.0:
        return 0.0, 0.0, 0.0, (0.0, 0.0)
    along = pair[16] * (pair[9] - pair[11] * px / pz) / pz, pair[17] * (pair[10] - pair[11] * py / pz) / pz
    return pair[18] + pair[16] * px / pz, pair[19] + pair[17] * py / pz, pz, along


@njit(nogil=True)
def _shift_variance(patch: FloatArray, along: tuple[float, float], noise: float) -> float:
    """What noise leaves open of the place of a patch along a unit direction, square pixels (Lucas & Kanade 1981)."""
    steep = NOT_ZERO
    for i in range(1, len(patch) - 1):
        for j in range(1, len(patch) - 1):
            du, dv = patch[i, j + 1] - patch[i, j - 1], patch[i + 1, j] - patch[i - 1, j]
            slope = 0.5 * (along[0] * du + along[1] * dv)
            steep += slope * slope
    return noise * noise / steep


@njit(nogil=True)
def _best_shift(patch: FloatArray, other: ByteArray, place: FloatArray, along: tuple[float, float]) -> int:
    """Pixels along a unit direction, either way, at which another image is most like a patch; more than REACH outside.

    patch : (w, w) less its mean; place : (w, w, 2) pixels of the other image that the surface puts it on
    """
    height, breadth = other.shape
    best, best_at, n = -2.0, 0, patch.size
    for shift in range(-REACH, REACH + 1):
        total, squares, product = 0.0, 0.0, 0.0
        for i in range(len(patch)):
            for j in range(len(patch)):
                u, v = place[i, j, 0] + shift * along[0], place[i, j, 1] + shift * along[1]
                if not (u >= 0.0 and v >= 0.0 and u < breadth - 1 and v < height - 1):
                    return REACH + 1
                column, row = int(u), int(v)
                a, b = u - column, v - row
                above = (1.0 - a) * other[row, column] + a * other[row, column + 1]
                below = (1.0 - a) * other[row + 1, column] + a * other[row + 1, column + 1]
                grey = (1.0 - b) * above + b * below
                total += grey
                squares += grey * grey
                product += grey * patch[i, j]
        # The correlation coefficient, but for what all shifts share.
        alike = product / math.sqrt(max(squares - total * total / n, NOT_ZERO))
        if alike > best or shift == -REACH:
            best, best_at = alike, abs(shift)
    return best_at
