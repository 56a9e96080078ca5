"""Compiled: the curve that arcs show, from every place where its fit may start.

A plane in space is given by N with N . X = 1 for its points X. It induces a disparity that is affine in the image, so
matched segments tell it, and the ellipse of one image, back-projected onto it, is a start. Of a circle the ellipse
itself tells the plane, but for two answers.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.settings import DECISIVE
from msgs_py.numeric.typed import FloatArray, IntArray

from ..detection.settings import CORRELATION_LENGTH
from .curve import CurveShape
from .fit_kernels import Recovered, fit, nothing, recovered, solve
from .observations import Seen
from .settings import DISPARITY_SCALE, ROUNDS, SAME_PLANE_COSINE, SLOPE_RIDGE


@njit
def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """(3,): vector product."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@njit
def _across(normal: FloatArray) -> FloatArray:
    """(3,): a unit vector square to a unit vector (3,)."""
    axis = np.zeros(3)
    axis[np.argmin(np.abs(normal))] = 1.0
    first: FloatArray = _cross(normal, axis)
    first /= np.sqrt((first * first).sum())
    return first


@njit
def _matrix(seen: Seen, side: int) -> FloatArray:
    """(3, 3): calibration of the left or the right camera."""
    fx, fy, cx, cy = seen.cameras[side]
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


@njit
def _nowhere() -> CurveShape:
    """No curve."""
    return CurveShape(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))


@njit
def plane_of_samples(samples: FloatArray, seen: Seen) -> FloatArray:
    """(3,) float64, 1/m: the plane N in which samples lie, by least squares with Cauchy weights.

    samples : (k, 3) pixels: u, v of the left image, disparity
    """
    u, v = np.median(samples[:, 0]), np.median(samples[:, 1])
    weights = np.ones(len(samples))
    told = np.zeros((3, 1))
    row = np.ones(3)
    for _ in range(ROUNDS):
        matrix = np.zeros((3, 3))
        matrix[0, 0] = matrix[1, 1] = SLOPE_RIDGE * len(samples)
        told[:] = 0.0
        for k in range(len(samples)):
            row[0], row[1] = samples[k, 0] - u, samples[k, 1] - v
            for a in range(3):
                told[a, 0] += weights[k] * row[a] * samples[k, 2]
                for b in range(3):
                    matrix[a, b] += weights[k] * row[a] * row[b]
        if not solve(matrix, told):
            return np.zeros(3)
        for k in range(len(samples)):
            level = told[0, 0] * (samples[k, 0] - u) + told[1, 0] * (samples[k, 1] - v) + told[2, 0]
            weights[k] = 1.0 / (1.0 + ((samples[k, 2] - level) / DISPARITY_SCALE) ** 2)
    fx, fy, cx, cy = seen.cameras[0]
    slope_u, slope_v = told[0, 0], told[1, 0]
    offset = told[2, 0] - slope_u * u - slope_v * v - (cx - seen.cameras[1, 2])
    # The disparity is fx baseline / z, and 1 / z = N . ray.
    plane = np.array([fx * slope_u, fy * slope_v, cx * slope_u + cy * slope_v + offset])
    plane /= fx * seen.baseline
    return plane


@njit
def back_projected(conic: FloatArray, plane: FloatArray, seen: Seen, side: int) -> tuple[bool, CurveShape]:
    """An image's ellipse (3, 3) on a plane N (3,), 1/m, in space; side : 0 left, 1 right.

    False when it is no ellipse there, or not in front of the camera.
    """
    size = np.sqrt((plane * plane).sum())
    if not (np.isfinite(size) and size > 0.0):
        return False, _nowhere()
    normal = plane / size
    first = _across(normal)
    second = _cross(normal, first)
    foot = normal / size
    # Pixels of points foot + x first + y second, and the conic of x and y.
    homography = np.empty((3, 3))
    homography[:, 0], homography[:, 1], homography[:, 2] = first, second, foot
    homography[0, 2] -= side * seen.baseline
    homography = _matrix(seen, side) @ homography
    found = homography.T @ np.ascontiguousarray(conic) @ homography
    values, vectors = np.linalg.eigh(found[:2, :2].copy())
    determinant = found[0, 0] * found[1, 1] - found[0, 1] * found[1, 0]
    if not (values[0] > 0.0 and determinant > 0.0):
        return False, _nowhere()
    x = (found[0, 1] * found[1, 2] - found[1, 1] * found[0, 2]) / determinant
    y = (found[1, 0] * found[0, 2] - found[0, 0] * found[1, 2]) / determinant
    level = -(found[2, 2] + found[0, 2] * x + found[1, 2] * y)
    centre = foot + x * first + y * second
    if not (level > 0.0 and centre[2] > 0.0):
        return False, _nowhere()
    return True, CurveShape(centre, normal, vectors[0, 0] * first + vectors[1, 0] * second, np.sqrt(level / values))


@njit
def circles_of_ellipse(conic: FloatArray, samples: FloatArray, seen: Seen, side: int) -> list[CurveShape]:
    """The circles in space that look like an ellipse to one camera, where the samples' disparities place them.

    The cone over a circle is cut in circles by two families of parallel planes, which the eigenvectors of the cone
    give. Of ellipses seen nearly edge-on this gives the plane better than disparities do.

    Parameters
    ----------
    conic : (3, 3) float64
        Of one image.
    samples : (k, 3) float64, pixels
        u, v of the left image, disparity.
    seen : Seen
        With the cameras.
    side : int
        0 for the left image, 1 for the right one.

    Returns
    -------
    list of CurveShape
        Two or fewer.

    References
    ----------
    Kanatani and Liu, 3D interpretation of conics and orthogonality, CVGIP: Image Understanding 58, 1993.
    """
    k = _matrix(seen, side)
    values, vectors = np.linalg.eigh(k.T @ np.ascontiguousarray(conic) @ k)
    axis, wide, narrow = values
    across, along = np.ascontiguousarray(vectors[:, 2]), np.ascontiguousarray(vectors[:, 0])
    found = [_nowhere()]
    found.clear()
    # The conic is negative inside, so one eigenvalue is negative (the cone's axis) and two are positive, ascending.
    if not axis < 0.0 < wide:
        return found
    steep, flat = np.sqrt(max(narrow - wide, 0.0) / (narrow - axis)), np.sqrt((wide - axis) / (narrow - axis))
    infinite = seen.cameras[0, 2] - seen.cameras[1, 2]
    radii = np.empty(len(samples))
    for sign in (1.0, -1.0):
        normal = sign * steep * across + flat * along
        # Centre of the circle of radius 1.
        centre = (sign * axis * steep * across + narrow * flat * along) / np.sqrt(-narrow * axis)
        if centre[2] < 0.0:
            centre = -centre
        through, count = (centre * normal).sum(), 0
        for m in range(len(samples)):
            u, v, d = samples[m, 0] - (samples[m, 2] if side == 1 else 0.0), samples[m, 1], samples[m, 2] - infinite
            ahead = (u - k[0, 2]) / k[0, 0] * normal[0] + (v - k[1, 2]) / k[1, 1] * normal[1] + normal[2]
            # Its depth by disparity over that on the circle of radius 1.
            if d * through != 0.0:
                radius = seen.cameras[0, 0] * seen.baseline / d * ahead / through
                if radius > 0.0 and np.isfinite(radius):
                    radii[count] = radius
                    count += 1
        if count > 0:
            size = np.median(radii[:count])
            place = size * centre
            place[0] += side * seen.baseline
            found.append(CurveShape(place, normal, _across(normal), np.full(2, size)))
    return found


@njit(nogil=True)
def free_curve(conics: FloatArray, sides: IntArray, samples: FloatArray, index: IntArray, seen: Seen) -> Recovered:
    """The curve that arcs show, from the best of the starts and from the best in another plane.

    Two planes may fit one arc alike; what all edgels say for either curve decides between them. What fits it worse by
    odds that settle the matter is not looked at: among all edgels of a picture, chance has some for any curve.

    Parameters
    ----------
    conics : (a, 3, 3) float64
        Of one or two arcs; of two, the disparities tell a plane as well.
    sides : (a,) int
        Of which image each is.
    samples : (k, 3) float64, pixels
        u, v of the left image, disparity.
    index : (m,) int64
        Edgels of the arcs.
    seen : Seen

    Returns
    -------
    Recovered
    """
    starts = circles_of_ellipse(conics[0], samples, seen, sides[0])
    for k in range(1, len(conics)):
        starts += circles_of_ellipse(conics[k], samples, seen, sides[k])
    if len(conics) > 1:
        good, start = back_projected(conics[0], plane_of_samples(samples, seen), seen, sides[0])
        if good:
            starts.append(start)
    rms = np.full(len(starts), np.inf)
    for k in range(len(starts)):
        found = fit(starts[k], True, seen, index, True)
        if found.good:
            starts[k], rms[k] = found.shape, found.rms
    best: Recovered = nothing(_nowhere(), index)
    tried = 0
    for k in np.argsort(rms, kind='mergesort'):
        if rms[k] == np.inf or tried == 2:
            break
        if tried == 0:
            plane, least = starts[k].normal, rms[k]
        elif abs((starts[k].normal * plane).sum()) >= SAME_PLANE_COSINE:
            continue
        elif len(index) / CORRELATION_LENGTH * np.log(rms[k] / least) > DECISIVE:
            break  # so many edgels err on their own
        tried += 1
        other = recovered(starts[k], seen, index)
        if other.evidence > best.evidence:
            best = other
    return best
