"""Where to start the fit of a curve in space: which arcs of the two images show one, and in what plane it may lie.

A plane in space induces an affine disparity d = alpha u + beta v + gamma between rectified images (u, v pixels of the
left image). Matched segments, the two image ellipses themselves, or the normal of another curve give it, and the left
ellipse, back-projected onto that plane, is a start.
"""

from __future__ import annotations

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import BoolArray, FloatArray

from ..detection.conics import Ellipse
from ..detection.segments import Segments
from ..detection.settings import LEAST_CHORD, LEAST_DIVISOR
from ..matching.matches import Matches
from . import settings
from .curve import Curve, CurveShape, camera_views, cross, perpendicular
from .observations import EdgelMasks


def paired_arcs(matches: Matches, left: Segments, right: Segments) -> list[tuple[int, int, FloatArray]]:
    """Arcs of the two images that show one curve.

    Parameters
    ----------
    matches : Matches
        Pairs of segments.
    left, right : Segments
        Of the two images; their field ``arc`` is the number of the ellipse that a segment is part of.

    Returns
    -------
    list of (int, int, (k, 3) float64)
        Number of the left and of the right arc, and samples u, v, disparity, pixels. Every arc is in one pair at most:
        that with the longest matched segments.
    """
    a, b = left.arc[matches.left], right.arc[matches.right]
    both = (a >= 0) & (b >= 0)
    weight: dict[tuple[int, int], float] = {}
    for m in np.flatnonzero(both):
        key = (int(a[m]), int(b[m]))
        weight[key] = weight.get(key, 0.0) + float(left.length[matches.left[m]])
    result = []
    used_left, used_right = set(), set()
    for key in sorted(weight, key=lambda k: -weight[k]):
        if key[0] in used_left or key[1] in used_right:
            continue
        used_left.add(key[0])
        used_right.add(key[1])
        samples = []
        for m in np.flatnonzero(both & (a == key[0]) & (b == key[1])):
            i = matches.left[m]
            points = np.stack([left.start[i], 0.5 * (left.start[i] + left.end[i]), left.end[i]])
            samples.append(np.column_stack([points, matches.disparity[m]]))
        result.append((*key, np.concatenate(samples)))
    return result


def matched_to_arc(
    matches: Matches, segments: tuple[Segments, Segments], arc: int, is_right: bool, counts: tuple[int, int]
) -> tuple[EdgelMasks, FloatArray, float]:
    """What an arc of one image is matched with in the other image, be that an arc or straight segments.

    Parameters
    ----------
    matches : Matches
        Pairs of segments.
    segments : (Segments, Segments)
        Of the left and of the right image.
    arc : int
        Number of the arc in its image.
    is_right : bool
        Whether that is the right image.
    counts : (int, int)
        Number of edgels of the images.

    Returns
    -------
    masks : two bool arrays
        Edgels of the arc and of what it is matched with, left and right.
    samples : (k, 3) float64, pixels
        u, v, disparity.
    share : float
        Of the arc's length that is matched.
    """
    left, right = segments
    own, index, other = (right, matches.right, matches.left) if is_right else (left, matches.left, matches.right)
    far = left if is_right else right
    of = np.flatnonzero(own.arc[index] == arc)
    masks = [edgels_of_arc(own, arc, counts[is_right]), np.zeros(counts[not is_right], bool)]
    for first, last in far.bounds[other[of]]:
        masks[1][first:last] = True
    i = matches.left[of]
    points = np.stack([left.start[i], 0.5 * (left.start[i] + left.end[i]), left.end[i]], axis=1)
    samples = np.concatenate([points, matches.disparity[of][..., None]], axis=2).reshape(-1, 3)
    length = float(own.length[own.arc == arc].sum())
    share = float(own.length[np.unique(index[of])].sum()) / max(length, LEAST_CHORD)
    if is_right:
        masks.reverse()
    return (masks[0], masks[1]), samples, share


def edgels_of_arc(segments: Segments, arc: int, count: int) -> BoolArray:
    """The edgels of an image that the segments of an arc consist of.

    Parameters
    ----------
    segments : Segments
        Of the image.
    arc : int
        Number of the arc.
    count : int
        How many edgels the image has.

    Returns
    -------
    (count,) bool
    """
    mask = np.zeros(count, bool)
    for first, last in segments.bounds[segments.arc == arc]:
        mask[first:last] = True
    return mask


def trimmed(mask: BoolArray, share: float) -> BoolArray:
    """A mask over edgels without a share of them at either end.

    Parameters
    ----------
    mask : (n,) bool
    share : float

    Returns
    -------
    (n,) bool

    Examples
    --------
    >>> trimmed(np.array([True, True, False, True, True]), 0.25).tolist()
    [False, True, False, True, False]
    """
    index = np.flatnonzero(mask)
    cut = int(share * len(index))
    result = np.zeros(len(mask), bool)
    result[index[cut : len(index) - cut]] = True
    return result


def plane_disparities(left: Ellipse, right: Ellipse, samples: FloatArray) -> list[FloatArray]:
    """Candidates for the affine disparity that a curve's plane induces.

    Parameters
    ----------
    left, right : Ellipse
        The image conics.
    samples : (k, 3) float64, pixels
        u, v, disparity of matched segments.

    Returns
    -------
    list of (3,) float64
        alpha, beta, gamma of d = alpha u + beta v + gamma: from the ellipses alone, where the centre's row cuts both,
        and from the samples, where there are at least LEAST_SAMPLES.
    """
    found = []
    (a, b, d), (_, c, e), (_, _, f) = left.conic
    (p, q, s), (_, r, t), (_, _, w) = right.conic
    # On row v the chord of the left ellipse has its middle at -(b v + d) / a and half the length sqrt(chord_left) / a.
    v = left.centre[1]
    chord_left = (b * v + d) ** 2 - a * (c * v * v + 2 * e * v + f)
    chord_right = (q * v + s) ** 2 - p * (r * v * v + 2 * t * v + w)
    if chord_left > 0.0 and chord_right > 0.0:
        stretch = np.sqrt(chord_right) / p / (np.sqrt(chord_left) / a)
        found.append(np.array([1.0 - stretch, -(stretch * b / a - q / p), -(stretch * d / a - s / p)]))
        found[-1][1:] *= -1.0
    if len(samples) >= settings.LEAST_SAMPLES:
        found.append(_fitted_disparity(samples))
    return found


def _fitted_disparity(samples: FloatArray) -> FloatArray:
    """(3,) float64: alpha, beta, gamma fitted to samples (k, 3), pixels, with Cauchy weights and ridges."""
    design = np.column_stack([samples[:, :2], np.ones(len(samples))])
    ridge = np.diag([settings.SLOPE_RIDGE, settings.SLOPE_RIDGE, settings.OFFSET_RIDGE]) * len(samples)
    weights = np.ones(len(samples))
    for _ in range(settings.DISPARITY_ROUNDS):
        mean = np.average(samples[:, :2], axis=0, weights=weights)
        centred = design - np.array([*mean, 0.0])
        plane = np.linalg.solve(centred.T @ (weights[:, None] * centred) + ridge, centred.T @ (weights * samples[:, 2]))
        weights = 1.0 / (1.0 + ((samples[:, 2] - centred @ plane) / settings.DISPARITY_SCALE) ** 2)
    return np.array([plane[0], plane[1], plane[2] - plane[:2] @ mean])


def disparity_of_parallel_plane(normal: FloatArray, samples: FloatArray, rig: StereoRig) -> FloatArray | None:
    """The affine disparity of the plane with a given normal through the middle of samples.

    Parameters
    ----------
    normal : (3,) float64
        Left optical frame.
    samples : (k, 3) float64, pixels
        u, v, disparity; the plane has their median disparity at their median position.
    rig : StereoRig
        The cameras.

    Returns
    -------
    (3,) float64 or None
        alpha, beta, gamma; None for a plane that is seen edge-on.
    """
    middle = np.median(samples[:, :2], axis=0)
    disparity = float(np.median(samples[:, 2])) - (rig.left.cx - rig.right.cx)
    left = rig.left
    steep = float(normal @ left.rays(middle))
    if abs(steep) < settings.EDGE_ON_COSINE:
        return None
    slope = disparity / steep * np.array([normal[0] / left.fx, normal[1] / left.fy])
    return np.array([*slope, disparity - slope @ middle + rig.left.cx - rig.right.cx])


def mirrored(curve: Curve) -> Curve:
    """The circle that looks nearly like this one to one camera: its plane mirrored at the plane square to the sight.

    Between the two the cost of a fit has a maximum, so that one is not reached from the other.

    Parameters
    ----------
    curve : Curve
        Left optical frame, metres.

    Returns
    -------
    Curve
        With the same centre and radii.

    Examples
    --------
    A circle that leans to the right of the line of sight becomes one that leans to the left:

    >>> leaning = np.array([0.6, 0.0, 0.8])
    >>> shape = CurveShape(np.array([0.0, 0.0, 1.0]), leaning, np.array([0.0, 1.0, 0.0]), np.full(2, 0.1))
    >>> (mirrored(Curve.unfitted(shape)).normal + 0.0).round(6).tolist()
    [-0.6, 0.0, 0.8]
    """
    sight = curve.centre / np.linalg.norm(curve.centre)
    normal = 2.0 * (curve.normal @ sight) * sight - curve.normal
    first = curve.first - normal * (curve.first @ normal)
    length = np.linalg.norm(first)
    if length < settings.LEAST_PROJECTION:
        first = cross(normal, sight)
        length = np.linalg.norm(first)
    return curve.with_shape(CurveShape(curve.centre, normal, first / max(float(length), LEAST_DIVISOR), curve.radii))


def back_projected(ellipse: Ellipse, disparity_plane: FloatArray, rig: StereoRig) -> Curve | None:
    """The left image's ellipse on a plane in space.

    Parameters
    ----------
    ellipse : Ellipse
        Of the left image.
    disparity_plane : (3,) float64
        alpha, beta, gamma of the disparity that the plane induces.
    rig : StereoRig
        The cameras.

    Returns
    -------
    Curve or None
        Without covariance; None when part of it is not in front of the cameras, or is no ellipse.
    """
    centre, block = ellipse.centre, ellipse.conic[:2, :2]
    level = -np.linalg.det(ellipse.conic) / np.linalg.det(block)
    values, vectors = np.linalg.eigh(block)
    angle = np.linspace(0.0, 2.0 * np.pi, settings.BACK_PROJECTED_POINTS, endpoint=False)
    points = centre + (np.stack([np.cos(angle), np.sin(angle)], axis=1) * np.sqrt(level / values)) @ vectors.T
    disparity = points @ disparity_plane[:2] + disparity_plane[2] - (rig.left.cx - rig.right.cx)
    if not (disparity > settings.LEAST_DISPARITY).all():
        return None
    space = rig.left.rays(points) * (rig.left.fx * rig.baseline / disparity)[:, None]
    middle = space.mean(axis=0)
    _, _, axes = np.linalg.svd(space - middle, full_matrices=False)
    flat = (space - middle) @ axes[:2].T
    scale = np.abs(flat).max()
    x, y = (flat / scale).T
    design = np.column_stack([x * x, x * y, y * y, x, y])
    try:
        a, b, c, d, e = np.linalg.lstsq(design, np.ones(len(x)), rcond=None)[0]
        conic = np.array([[a, b / 2, d / 2], [b / 2, c, e / 2], [d / 2, e / 2, -1.0]])
        if np.linalg.det(conic[:2, :2]) <= 0.0:
            return None
        inside = Ellipse(conic, 0.0)
        values, vectors = np.linalg.eigh(conic[:2, :2])
        radii = inside.radii * scale
        in_plane = inside.centre * scale
    except np.linalg.LinAlgError:
        return None
    if not (np.isfinite(radii).all() and (radii > 0).all()):
        return None
    first = vectors[0, 0] * axes[0] + vectors[1, 0] * axes[1]
    return Curve.unfitted(CurveShape(middle + in_plane @ axes[:2], axes[2], first, radii))


def circles_of_ellipse(ellipse: Ellipse, samples: FloatArray, rig: StereoRig, is_right: bool) -> list[Curve]:
    """The circles in space that look like an ellipse to one camera, where the samples' disparities place them.

    The cone over a circle is cut in circles by two families of parallel planes, which the eigenvectors of the cone
    give. Of ellipses seen nearly edge-on this gives the plane better than disparities do.

    Parameters
    ----------
    ellipse : Ellipse
        Of one image.
    samples : (k, 3) float64, pixels
        u, v of the left image, disparity.
    rig : StereoRig
        The cameras.
    is_right : bool
        Whether the ellipse is of the right image.

    Returns
    -------
    list of Curve
        Two or fewer, without covariance.

    References
    ----------
    Kanatani and Liu, 3D interpretation of conics and orthogonality, CVGIP: Image Understanding 58, 1993.
    """
    view = camera_views(rig)[is_right]
    values, vectors = np.linalg.eigh(view.matrix.T @ ellipse.conic @ view.matrix)
    # The conic is negative inside, so one eigenvalue is negative (the cone's axis) and two are positive, ascending.
    if not (values[0] < 0.0 < values[1]) or len(samples) == 0:
        return []
    axis, wide, narrow = values
    steep, flat = np.sqrt(max(narrow - wide, 0.0) / (narrow - axis)), np.sqrt((wide - axis) / (narrow - axis))
    disparity = samples[:, 2] - (rig.left.cx - rig.right.cx)
    pixels = samples[:, :2] - (np.outer(samples[:, 2], [1.0, 0.0]) if is_right else 0.0)
    in_front = disparity > settings.LEAST_DISPARITY
    rays, disparity = view.camera.rays(pixels[in_front]), disparity[in_front]
    found = []
    for sign in (1.0, -1.0):
        normal = sign * steep * vectors[:, 2] + flat * vectors[:, 0]
        # Centre of the circle of radius 1.
        centre = (sign * axis * steep * vectors[:, 2] + narrow * flat * vectors[:, 0]) / np.sqrt(-narrow * axis)
        if centre[2] < 0.0:
            centre = -centre
        with np.errstate(divide='ignore', invalid='ignore'):
            depth = (centre @ normal) / (rays @ normal) * rays[:, 2]
            radius = rig.left.fx * rig.baseline / disparity / depth
        radius = radius[np.isfinite(radius) & (radius > 0.0)]
        if len(radius) == 0:
            continue
        size = float(np.median(radius))
        first = perpendicular(normal)
        shape = CurveShape(size * centre + view.centre, normal, first / np.linalg.norm(first), np.full(2, size))
        found.append(Curve.unfitted(shape))
    return found
