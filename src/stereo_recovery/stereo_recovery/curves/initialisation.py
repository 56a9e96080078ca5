"""Where to start the fit of a curve in space: which edgels of the two images show one, and in what plane it may lie.

A plane in space is given by N with N . X = 1 for its points X. It induces a disparity that is affine in the image, so
matched segments tell it, and the ellipse of one image, back-projected onto it, is a start. Of a circle the ellipse
itself tells the plane, but for two answers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import FloatArray, IntArray

from ..detection.conics import Ellipse
from ..detection.segments import Segments
from ..matching.matches import Matches
from . import settings
from .curve import CameraView, Curve, CurveShape, camera_views, cross, perpendicular


@dataclass(frozen=True, eq=False)
class ArcPair:
    """What may show one curve: arcs of the two images, or an arc and whatever it is matched with.

    Attributes
    ----------
    edgels : ((k,) int64, (m,) int64)
        Of either image, by their numbers there.
    ellipses : list of (Ellipse, bool)
        Of the arcs, and whether it is one of the right image.
    samples : (k, 3) float64, pixels
        u, v of the left image, disparity.
    is_pair : bool
        Arcs of both images.
    """

    edgels: tuple[IntArray, IntArray]
    ellipses: list[tuple[Ellipse, bool]]
    samples: FloatArray
    is_pair: bool

    def shares_on(self, curve: Curve) -> tuple[float, float]:
        """Share of the edgels in either image that belong to a curve."""
        return float(curve.left[self.edgels[0]].mean()), float(curve.right[self.edgels[1]].mean())


def arc_pairs(
    matches: Matches, segments: tuple[Segments, Segments], ellipses: tuple[list[Ellipse], list[Ellipse]]
) -> list[ArcPair]:
    """What may show one curve, that with arcs in both images first, by falling number of edgels.

    Parameters
    ----------
    matches : Matches
        Pairs of segments.
    segments : (Segments, Segments)
        Of the two images; their field ``arc`` is the number of the ellipse that a segment is part of.
    ellipses : (list of Ellipse, list of Ellipse)
        The arcs of the images.

    Returns
    -------
    list of ArcPair
        Every arc is in one pair of arcs at most, that with the longest matched segments, and by itself with all that it
        is matched with, where that is at least MATCHED_SHARE of its length.
    """
    left, right = segments
    index = matches.left, matches.right
    arcs = left.arc[index[0]], right.arc[index[1]]
    members = [[np.flatnonzero(side.arc == k) for k in range(len(of))] for side, of in zip(segments, ellipses)]
    middle = 0.5 * (left.start + left.end)
    points = np.stack([left.start, middle, left.end], axis=1)[index[0]]
    samples = np.concatenate([points, matches.disparity[..., None]], axis=2)
    weight: dict[tuple[int, int], float] = {}
    for m in np.flatnonzero((arcs[0] >= 0) & (arcs[1] >= 0)):
        key = (int(arcs[0][m]), int(arcs[1][m]))
        weight[key] = weight.get(key, 0.0) + float(left.length[index[0][m]])
    pairs, used = [], (set[int](), set[int]())
    for a, b in sorted(weight, key=lambda key: -weight[key]):
        if a not in used[0] and b not in used[1]:
            used[0].add(a)
            used[1].add(b)
            of = (arcs[0] == a) & (arcs[1] == b)
            edgels = _edgels_of(left, members[0][a]), _edgels_of(right, members[1][b])
            both = [(ellipses[0][a], False), (ellipses[1][b], True)]
            pairs.append(ArcPair(edgels, both, samples[of].reshape(-1, 3), True))
    pairs.sort(key=lambda pair: -len(pair.edgels[0]))
    for side, is_right in ((0, False), (1, True)):
        for arc, own in enumerate(members[side]):
            of = arcs[side] == arc
            length = segments[side].length
            if length[np.unique(index[side][of])].sum() <= settings.MATCHED_SHARE * length[own].sum():
                continue
            far = _edgels_of(segments[not is_right], np.unique(index[not is_right][of]))
            near = _edgels_of(segments[side], own)
            edgels = (far, near) if is_right else (near, far)
            pairs.append(ArcPair(edgels, [(ellipses[side][arc], is_right)], samples[of].reshape(-1, 3), False))
    return pairs


def _edgels_of(segments: Segments, members: IntArray) -> IntArray:
    """(k,) int64: the edgels of some segments of an image, ascending."""
    runs = [np.arange(first, last) for first, last in segments.bounds[members]]
    return np.unique(np.concatenate(runs)) if runs else np.zeros(0, np.int64)


def plane_of_samples(samples: FloatArray, rig: StereoRig) -> FloatArray:
    """(3,) float64, 1/m: the plane N in which samples lie, by least squares with Cauchy weights.

    samples : (k, 3) pixels: u, v of the left image, disparity
    """
    middle = np.median(samples, axis=0)
    design = np.column_stack([samples[:, :2] - middle[:2], np.ones(len(samples))])
    ridge = np.diag([settings.SLOPE_RIDGE, settings.SLOPE_RIDGE, 0.0]) * len(samples)
    weights = np.ones(len(samples))
    for _ in range(settings.PLANE_ROUNDS):
        weighted = weights[:, None] * design
        slope_u, slope_v, level = np.linalg.solve(weighted.T @ design + ridge, weighted.T @ samples[:, 2])
        off = samples[:, 2] - design @ [slope_u, slope_v, level]
        weights = 1.0 / (1.0 + (off / settings.DISPARITY_SCALE) ** 2)
    offset = level - slope_u * middle[0] - slope_v * middle[1] - (rig.left.cx - rig.right.cx)
    # The disparity is fx baseline / z, and 1 / z = N . ray.
    plane: FloatArray = rig.left.matrix.T @ [slope_u, slope_v, offset] / (rig.left.fx * rig.baseline)
    return plane


def back_projected(ellipse: Ellipse, plane: FloatArray, view: CameraView) -> Curve | None:
    """An image's ellipse on a plane in space.

    Parameters
    ----------
    ellipse : Ellipse
        Of the image of ``view``.
    plane : (3,) float64, 1/m
        N with N . X = 1 for points X of the plane, left optical frame.
    view : CameraView

    Returns
    -------
    Curve or None
        Without covariance; None when it is no ellipse, or not in front of the camera.
    """
    size = np.linalg.norm(plane)
    if not (np.isfinite(size) and size > 0.0):
        return None
    normal = plane / size
    first = perpendicular(normal)
    first = first / np.linalg.norm(first)
    second = cross(normal, first)
    foot = normal / size
    # Pixels of points foot + x first + y second, and the conic of x and y.
    homography = view.matrix @ np.column_stack([first, second, foot - view.centre])
    conic = homography.T @ ellipse.conic @ homography
    block = conic[:2, :2]
    values, vectors = np.linalg.eigh(block)
    if not values[0] > 0.0:
        return None
    middle = -np.linalg.solve(block, conic[:2, 2])
    level = -(conic[2, 2] + conic[:2, 2] @ middle)
    centre = foot + middle[0] * first + middle[1] * second
    if not (level > 0.0 and centre[2] > 0.0):
        return None
    major = vectors[0, 0] * first + vectors[1, 0] * second
    return Curve.unfitted(CurveShape(centre, normal, major, np.sqrt(level / values)))


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
    found = []
    for sign in (1.0, -1.0):
        normal = sign * steep * vectors[:, 2] + flat * vectors[:, 0]
        # Centre of the circle of radius 1.
        centre = (sign * axis * steep * vectors[:, 2] + narrow * flat * vectors[:, 0]) / np.sqrt(-narrow * axis)
        if centre[2] < 0.0:
            centre = -centre
        rays = view.camera.rays(pixels)
        with np.errstate(divide='ignore', invalid='ignore'):
            radius = rig.left.fx * rig.baseline / disparity / ((centre @ normal) / (rays @ normal) * rays[:, 2])
        radius = radius[np.isfinite(radius) & (radius > 0.0)]
        if len(radius):
            size = float(np.median(radius))
            first = perpendicular(normal)
            shape = CurveShape(size * centre + view.centre, normal, first / np.linalg.norm(first), np.full(2, size))
            found.append(Curve.unfitted(shape))
    return found
