"""Where to start the fit of a curve in space: which arcs of the two images show one, and in what plane it may lie.

A plane in space is a shear between the images: disparity is linear in the left image's u and v. Matched segments, the
two image ellipses themselves, or a plane like that of another curve give it, and with the left ellipse a start.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.vectors import perpendicular

from ..detection.conics import Ellipse
from ..detection.segments import Segments
from ..matching.matches import Matches
from .curve import Curve, cross


def pairs(matches: Matches, left: Segments, right: Segments) -> list[tuple[int, int, np.ndarray]]:
    """Arcs of the two images that show one curve: (left arc, right arc, samples (k, 3) of u, v, disparity)."""
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


def followed(
    matches: Matches, left: Segments, right: Segments, arc: int, is_right: bool, counts: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """What an arc of one image matches in the other, arc or not.

    counts : edgels of the images. Returns the edgels of the arc and its matches, left and right (bool over all),
    samples (k, 3) of u, v, disparity, and the share of the arc's length that is matched.
    """
    own, index, other = (right, matches.right, matches.left) if is_right else (left, matches.left, matches.right)
    far = left if is_right else right
    of = np.flatnonzero(own.arc[index] == arc)
    masks = [edgels_of(own, arc, counts[is_right]), np.zeros(counts[not is_right], bool)]
    for first, last in far.bounds[other[of]]:
        masks[1][first:last] = True
    i = matches.left[of]
    points = np.stack([left.start[i], 0.5 * (left.start[i] + left.end[i]), left.end[i]], axis=1)
    samples = np.concatenate([points, matches.disparity[of][..., None]], axis=2).reshape(-1, 3)
    length = float(own.length[own.arc == arc].sum())
    share = float(own.length[np.unique(index[of])].sum()) / max(length, 1e-9)
    if is_right:
        masks.reverse()
    return masks[0], masks[1], samples, share


def shears(left: Ellipse, right: Ellipse, samples: np.ndarray) -> list[np.ndarray]:
    """Candidates for d = alpha u + beta v + gamma, each (3,): from the ellipses' chords along the rows, and from the
    matched segments' disparities."""
    found = []
    (a, b, d), (_, c, e), (_, _, f) = left.conic
    (p, q, s), (_, r, t), (_, _, w) = right.conic
    # Half chord squared over the row, at the left ellipse's centre row; both must be real there.
    v = left.centre[1]
    chord_left = (b * v + d) ** 2 - a * (c * v * v + 2 * e * v + f)
    chord_right = (q * v + s) ** 2 - p * (r * v * v + 2 * t * v + w)
    if chord_left > 0.0 and chord_right > 0.0:
        stretch = np.sqrt(chord_right) / p / (np.sqrt(chord_left) / a)
        # Chord middles: -(b v + d) / a and -(q v + s) / p.
        found.append(np.array([1.0 - stretch, -(stretch * b / a - q / p), -(stretch * d / a - s / p)]))
        found[-1][1:] *= -1.0
    if len(samples) >= 3:
        design = np.column_stack([samples[:, :2], np.ones(len(samples))])
        prior = np.diag([1e-1, 1e-1, 1e-8]) * len(samples)
        weights = np.ones(len(samples))
        for _ in range(5):
            mean = np.average(samples[:, :2], axis=0, weights=weights)
            centred = design - np.array([*mean, 0.0])
            plane = np.linalg.solve(
                centred.T @ (weights[:, None] * centred) + prior, centred.T @ (weights * samples[:, 2])
            )
            weights = 1.0 / (1.0 + ((samples[:, 2] - centred @ plane) / 0.5) ** 2)
        found.append(np.array([plane[0], plane[1], plane[2] - plane[:2] @ mean]))
    return found


def parallel(normal: np.ndarray, samples: np.ndarray, rig: StereoRig) -> np.ndarray | None:
    """(3,) shear of a plane with this normal at the samples' middle disparity; None when it is seen edge-on."""
    middle = np.median(samples[:, :2], axis=0)
    disparity = float(np.median(samples[:, 2])) - (rig.left.cx - rig.right.cx)
    left = rig.left
    steep = float(normal @ left.rays(middle))
    if abs(steep) < 0.02:
        return None
    slope = disparity / steep * np.array([normal[0] / left.fx, normal[1] / left.fy])
    return np.array([*slope, disparity - slope @ middle + rig.left.cx - rig.right.cx])


def mirrored(curve: Curve) -> Curve:
    """The circle that looks much like this one to one eye: its plane mirrored at the plane square to the line of sight.

    Two eyes tell them apart, but from an arc not surely, and the way from one to the other leads over a hill.
    """
    sight = curve.centre / np.linalg.norm(curve.centre)
    normal = 2.0 * (curve.normal @ sight) * sight - curve.normal
    first = curve.first - normal * (curve.first @ normal)
    length = np.linalg.norm(first)
    if length < 0.1:
        first = cross(normal, sight)
        length = np.linalg.norm(first)
    return replace(curve, normal=normal, first=first / max(length, 1e-12))


def lift(ellipse: Ellipse, shear: np.ndarray, rig: StereoRig) -> Curve | None:
    """The left ellipse on the plane that the shear stands for; None when it is not in front of the camera."""
    # Points around the ellipse, lifted; their plane ellipse by moments of conjugate directions.
    centre, block = ellipse.centre, ellipse.conic[:2, :2]
    level = -np.linalg.det(ellipse.conic) / np.linalg.det(block)
    values, vectors = np.linalg.eigh(block)
    angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    points = centre + (np.stack([np.cos(angle), np.sin(angle)], axis=1) * np.sqrt(level / values)) @ vectors.T
    disparity = points @ shear[:2] + shear[2] - (rig.left.cx - rig.right.cx)
    if not (disparity > 1e-3).all():
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
        centre2 = inside.centre * scale
    except np.linalg.LinAlgError:
        return None
    if not (np.isfinite(radii).all() and (radii > 0).all()):
        return None
    first = vectors[0, 0] * axes[0] + vectors[1, 0] * axes[1]
    none = np.zeros(0, bool)
    return Curve(middle + centre2 @ axes[:2], axes[2], first, radii, np.zeros((6, 6)), np.inf, none, none)


def circles_of(ellipse: Ellipse, samples: np.ndarray, rig: StereoRig, right: bool) -> list[Curve]:
    """The two circles in space that look like an ellipse to one eye, where the samples' disparities have them.

    The cone over a circle is cut in circles by two families of planes; the cone's eigenvectors tell them (Kanatani and
    Liu 1993). Ellipses seen nearly edge-on tell their plane better in this way than by their disparities.
    samples : (k, 3) u, v of the left image, disparity; right : which image the ellipse is of.
    """
    camera, eye = (rig.right, rig.baseline) if right else (rig.left, 0.0)
    values, vectors = np.linalg.eigh(camera.matrix.T @ ellipse.conic @ camera.matrix)
    # One axis of the cone, two across it: (-, +, +) ascending, the conic being negative inside.
    if not (values[0] < 0.0 < values[1]) or len(samples) == 0:
        return []
    thin, wide, axis = values[2], values[1], values[0]
    steep, flat = np.sqrt(max(thin - wide, 0.0) / (thin - axis)), np.sqrt((wide - axis) / (thin - axis))
    disparity = samples[:, 2] - (rig.left.cx - rig.right.cx)
    pixels = samples[:, :2] - (np.outer(samples[:, 2], [1.0, 0.0]) if right else 0.0)
    pixels, disparity = pixels[disparity > 1e-3], disparity[disparity > 1e-3]
    rays = camera.rays(pixels)
    none = np.zeros(0, bool)
    found = []
    for sign in (1.0, -1.0):
        normal = sign * steep * vectors[:, 2] + flat * vectors[:, 0]
        # Of radius one.
        centre = (sign * axis * steep * vectors[:, 2] + thin * flat * vectors[:, 0]) / np.sqrt(-thin * axis)
        if centre[2] < 0.0:
            centre = -centre
        with np.errstate(divide='ignore', invalid='ignore'):
            depth = (centre @ normal) / (rays @ normal) * rays[:, 2]
            radius = rig.left.fx * rig.baseline / disparity / depth
        radius = radius[np.isfinite(radius) & (radius > 0.0)]
        if len(radius) == 0:
            continue
        size = float(np.median(radius))
        found.append(
            Curve(
                size * centre + [eye, 0.0, 0.0],
                normal,
                -perpendicular(normal),
                np.full(2, size),
                np.zeros((6, 6)),
                np.inf,
                none,
                none,
            )
        )
    return found


def edgels_of(segments: Segments, arc: int, n: int) -> np.ndarray:
    mask = np.zeros(n, bool)
    for first, last in segments.bounds[segments.arc == arc]:
        mask[first:last] = True
    return mask


def inner(mask: np.ndarray, share: float) -> np.ndarray:
    """The mask without this share of its edgels at either end."""
    index = np.flatnonzero(mask)
    cut = int(share * len(index))
    result = np.zeros(len(mask), bool)
    result[index[cut : len(index) - cut]] = True
    return result
