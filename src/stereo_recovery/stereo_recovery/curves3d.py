"""Circles and ellipses in space: one curve fitted to the edgels of both images at once (thesis 3.10.1, 6.4).

A plane in space is a shear between the images: disparity is linear in the left image's u and v. Matched pieces, or
the two image ellipses themselves, give it, and with the left ellipse a start. Then one curve in space is moved until
its two pictures lie on the edgels: six numbers for a circle, eight for an ellipse, and their covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from msgs_py import FeatureSet, PinholeCamera, StereoRig

from . import curve_kernels
from .conics import Ellipse, sampson
from .edgels import Edgels
from .lines3d import Lines3D
from .matching import Matches
from .segmentation import CORRELATION_LENGTH, Pieces

# Edgels this near to the curve's picture (pixels), and pointing this nearly across it, belong to it.
CLAIM = 0.7
CLAIM_COSINE = 0.94
# Once the curve is known: within so many of its rms and of an edgel's own sigma, but never asked for less (pixels).
GATE = 3.5
LEAST_CLAIM = 0.12
# Edgels at the end of a run that a corner has displaced.
CORNER_EDGELS = 2
# A circle is an ellipse unless the ellipse lowers the sum of squares by this factor, and its radii differ by this much.
ELLIPSE_GAIN = 1.3
ELLIPSE_RATIO = 0.985
# A curve whose edgels stand off more than this, pixels rms, was never one.
WORST_RMS = 0.45
# The light displaces edgels by so much (pixels, one sigma) that is the same all over one of so many sectors.
COMMON_SHIFT = 0.02
SECTORS = 12


@dataclass(frozen=True, eq=False)
class Curve:
    """A planar curve, left optical frame, metres.

    centre, normal, first : (3,) float64; first is the unit direction of the major radius; radii : (2,) major, minor
    covariance : (6, 6) of centre (x, y, z) and of the normal's two tilts (about first and normal x first), and the
        major radius; rms : pixels; left, right : bool over the edgels of the two images; arc : start and extent,
        radians from first about the normal; coverage : share of the curve that is seen
    """

    centre: np.ndarray
    normal: np.ndarray
    first: np.ndarray
    radii: np.ndarray
    covariance: np.ndarray
    rms: float
    left: np.ndarray
    right: np.ndarray
    arc: tuple[float, float] = (0.0, 2.0 * np.pi)
    coverage: float = 1.0

    @property
    def second(self) -> np.ndarray:
        return np.cross(self.normal, self.first)


def picture(curve: Curve, matrix: np.ndarray, eye: float) -> np.ndarray:
    """(3, 3) float64: the conic that a camera at (eye, 0, 0) with calibration matrix sees, negative inside."""
    return _conic(curve.centre, curve.radii[0] * curve.first, curve.radii[1] * curve.second, matrix, eye)


def _conic(centre: np.ndarray, major: np.ndarray, minor: np.ndarray, matrix: np.ndarray, eye: float) -> np.ndarray:
    plane = matrix @ np.stack([major, minor, centre - [eye, 0.0, 0.0]], axis=1)
    inverse = np.linalg.inv(plane)
    conic = inverse.T @ np.diag([1.0, 1.0, -1.0]) @ inverse
    conic = conic / np.abs(conic).max()
    return -conic if np.trace(conic[:2, :2]) < 0.0 else conic


def pairs(matches: Matches, left: Pieces, right: Pieces) -> list[tuple[int, int, np.ndarray]]:
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


def shears(left: Ellipse, right: Ellipse, samples: np.ndarray) -> list[np.ndarray]:
    """Candidates for d = alpha u + beta v + gamma, each (3,): from the ellipses' chords along the rows, and from the
    matched pieces' disparities."""
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
            plane = np.linalg.solve(centred.T @ (weights[:, None] * centred) + prior,
                                    centred.T @ (weights * samples[:, 2]))
            weights = 1.0 / (1.0 + ((samples[:, 2] - centred @ plane) / 0.5) ** 2)
        found.append(np.array([plane[0], plane[1], plane[2] - plane[:2] @ mean]))
    return found


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


def refine(curve: Curve, left: Edgels, right: Edgels, rig: StereoRig, blur: float, circle: bool,
           rounds: int = 12) -> Curve | None:
    """Move the curve until both pictures lie on the edgels (Levenberg-Marquardt, Cauchy weights).

    left, right : edgels of the curve; blur : variance, px^2, of the smoothing that edgels have gone through: it pulls
    them towards the centre of curvature by blur / (2 R), which is taken off (exact for a blurred disc, to first order).
    Returns it with covariance and rms, or None when the fit does not settle.
    """
    if circle:
        curve = replace(curve, radii=np.full(2, float(np.sqrt(curve.radii.prod()))))
    points = np.concatenate([left.position, right.position])
    shift = np.concatenate([left.shift, right.shift])
    sigma = np.hypot(np.concatenate([left.sigma_position, right.sigma_position]), shift)
    if len(points) < 10:
        return None
    cameras = [np.array([c.fx, c.fy, c.cx, c.cy]) for c in (rig.left, rig.right)]
    r, bend = np.empty(len(points)), np.empty(len(points))
    state = (curve.centre.copy(), curve.normal.copy(), curve.first.copy(), curve.radii.astype(float))

    def equations() -> tuple:
        return curve_kernels.equations(state[0], state[1], state[2], state[3], circle, points, len(left), cameras[0],
                                       cameras[1], float(rig.baseline), float(blur), sigma, r, bend)

    size = 6 if circle else 8
    widest = np.concatenate([np.full(3, curve.radii[0]), np.full(size - 3, 0.5)])
    damping = 1e-3
    try:
        for _ in range(rounds):
            matrix, gradient, cost, weights, _ = equations()
            if not (np.isfinite(cost) and np.isfinite(matrix).all()):
                return None
            gained = 0.0
            for _ in range(6):
                step = np.zeros(8)
                step[:size] = np.clip(-np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), gradient),
                                      -widest, widest)
                trial = curve_kernels.moved(state[0], state[1], state[2], state[3], step, circle)
                curve_kernels.residuals(trial[0], trial[1], trial[2], trial[3], points, len(left), cameras[0],
                                        cameras[1], float(rig.baseline), float(blur), r, bend)
                new_cost = float(weights @ (r * r))
                if np.isfinite(new_cost) and new_cost <= cost:
                    state, gained = trial, cost - new_cost
                    damping = max(damping / 10.0, 1e-9)
                    break
                damping *= 10.0
            if gained < 1e-5 * cost:
                break
        matrix, _, cost, weights, rows = equations()
        together = CORRELATION_LENGTH * max(1.0, cost / max(len(r) - size, 1))
        inverse = np.linalg.inv(matrix)
        # Edgels side by side are moved together by the light: such a displacement does not average out.
        sector = _sectors(*state[:4], points, len(left), rig)
        shared = curve_kernels.common(rows, weights, np.hypot(shift, COMMON_SHIFT), sector, 2 * SECTORS)
        covariance = (inverse * together + inverse @ shared @ inverse)[:6, :6]
    except np.linalg.LinAlgError:
        return None
    centre, normal, first, radii = state
    covariance[5, :] *= radii[0]
    covariance[:, 5] *= radii[0]
    rms = float(np.sqrt(np.mean(np.minimum(r * r, 4.0))))
    if not (np.isfinite(covariance).all() and np.isfinite(rms) and (np.diag(covariance) >= 0.0).all()):
        return None
    if radii[0] < radii[1]:
        first, radii = np.cross(normal, first), radii[::-1].copy()
    return replace(curve, centre=centre, normal=normal, first=first, radii=radii, covariance=covariance, rms=rms)


def _sectors(centre: np.ndarray, normal: np.ndarray, first: np.ndarray, radii: np.ndarray, points: np.ndarray,
             count: int, rig: StereoRig) -> np.ndarray:
    """(n,) int64: which image and which sector of the curve edgels are of; the first ``count`` are the left image's."""
    angle = np.concatenate([_angles(centre, normal, first, radii, p, camera, eye) for p, camera, eye in (
        (points[:count], rig.left, 0.0), (points[count:], rig.right, rig.baseline))])
    sector = np.floor(angle / (2.0 * np.pi) * SECTORS).astype(np.int64) % SECTORS
    sector[count:] += SECTORS
    return sector


def _angles(centre: np.ndarray, normal: np.ndarray, first: np.ndarray, radii: np.ndarray, points: np.ndarray,
            camera: PinholeCamera, eye: float) -> np.ndarray:
    """(n,) radians: where on a curve pixels (n, 2) of an image lie (0 at first, about the normal)."""
    rays = camera.rays(points)
    origin = np.array([eye, 0.0, 0.0])
    offset = origin + rays * ((centre - origin) @ normal / (rays @ normal))[:, None] - centre
    return np.arctan2(offset @ np.cross(normal, first) / radii[1], offset @ first / radii[0])


def claimed(curve: Curve, edgels: Edgels, rig: StereoRig, eye: float, blur: float) -> tuple[np.ndarray, np.ndarray]:
    """Edgels of the image seen from (eye, 0, 0) that are the curve's, (n,) bool, and those of them that measure it.

    The former lie on its picture and point across it. How near the latter have to be depends on how well the curve fits
    and on what each says of itself: a contour that leaves a rim leaves it slowly. Where a run ends, a corner has
    displaced the last few.
    """
    matrix = rig.left.matrix if eye == 0.0 else rig.right.matrix
    conic = picture(curve, matrix, eye)
    index = np.flatnonzero(np.abs(sampson(conic, edgels.position)) < CLAIM)
    h = edgels.position[index] @ conic[:2, :2] + conic[:2, 2]
    across = np.stack([np.cos(edgels.direction[index]), np.sin(edgels.direction[index])], axis=1)
    cosine = np.abs((h * across).sum(axis=1)) / np.maximum(np.hypot(h[:, 0], h[:, 1]), 1e-12)
    near = np.zeros(len(edgels), bool)
    near[index[cosine > CLAIM_COSINE]] = True
    index = np.flatnonzero(_without_ends(near, edgels.position))
    if len(index) == 0:
        return near, near
    points = np.ascontiguousarray(edgels.position[index])
    distance, bend = np.empty(len(index)), np.empty(len(index))
    camera = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]])
    curve_kernels.residuals(curve.centre, curve.normal, curve.first, np.asarray(curve.radii, float), points,
                            len(index) if eye == 0.0 else 0, camera, camera, float(eye), float(blur), distance, bend)
    usual = min(curve.rms, 1.5 * float(np.median(np.abs(distance))))
    own = np.hypot(edgels.sigma_position[index], np.minimum(edgels.shift[index], 0.1))
    measures = np.zeros(len(edgels), bool)
    measures[index[np.abs(distance) < np.clip(GATE * np.hypot(own, usual), LEAST_CLAIM, CLAIM)]] = True
    return near, measures


def _without_ends(near: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Runs of neighbours in string order without their first and last few; short runs go altogether."""
    index = np.flatnonzero(near)
    if len(index) < 2:
        return np.zeros(len(near), bool)
    step = np.hypot(*(position[index[1:]] - position[index[:-1]]).T)
    breaks = (np.diff(index) > 1) | (step > 3.0)
    starts = np.concatenate([[0], np.flatnonzero(breaks) + 1])
    ends = np.concatenate([starts[1:], [len(index)]])
    kept = np.zeros(len(near), bool)
    for a, b in zip(starts, ends):
        # A closed string begins somewhere; there is no corner there.
        closed = b - a > 8 and np.hypot(*(position[index[a]] - position[index[b - 1]])) < 3.0
        cut = 0 if closed else CORNER_EDGELS
        kept[index[a + cut:b - cut]] = True
    return kept


def _seen(curve: Curve, left: Edgels, right: Edgels, rig: StereoRig) -> tuple[tuple[float, float], float]:
    """Arc (start, extent) and share of the curve that edgels of either image cover; short gaps count as seen."""
    bins = 72
    hit = np.zeros(bins, bool)
    for edgels, eye in ((left, 0.0), (right, rig.baseline)):
        camera = rig.left if eye == 0.0 else rig.right
        angle = _angles(curve.centre, curve.normal, curve.first, curve.radii, edgels.position, camera, eye)
        hit[np.floor(angle / (2.0 * np.pi) * bins).astype(int) % bins] = True
    if hit.all():
        return (0.0, 2.0 * np.pi), 1.0
    # The longest stretch without an edgel is what is hidden.
    doubled = np.concatenate([hit, hit])
    best, length, run = 0, 0, 0
    for k, seen in enumerate(doubled):
        run = 0 if seen else run + 1
        if run > length:
            best, length = k, run
    length = min(length, bins)
    if length <= 4:
        return (0.0, 2.0 * np.pi), float(hit.mean())
    start = (best + 1) % bins
    return (2.0 * np.pi * start / bins, 2.0 * np.pi * (bins - length) / bins), float(hit.mean())


def _facing(curve: Curve) -> Curve:
    """The normal's sign: out of the face. A rim that is seen all round bounds a face that looks at us; one of which
    only the near half is seen bounds a face that looks away."""
    towards = -curve.centre
    if curve.normal @ towards < 0.0:
        curve = _turned(curve)
    if curve.arc[1] < 1.25 * np.pi:
        middle = curve.arc[0] + 0.5 * curve.arc[1]
        spot = np.cos(middle) * curve.first + np.sin(middle) * curve.second
        if spot @ (towards - curve.normal * (towards @ curve.normal)) > 0.0:
            curve = _turned(curve)
    return curve


def _turned(curve: Curve) -> Curve:
    """The same curve with the opposite normal; the major axis stays, so angles change sign."""
    start, extent = curve.arc
    flipped = (0.0, extent) if extent >= 2.0 * np.pi else ((-(start + extent)) % (2.0 * np.pi), extent)
    return replace(curve, normal=-curve.normal, arc=flipped)


def recover_curve(start: Curve, left: Edgels, right: Edgels, chosen: tuple[np.ndarray, np.ndarray],
                  rig: StereoRig, blur: float) -> Curve | None:
    """From a rough curve to the final one.

    left, right : all edgels of the images; chosen : bool over them, those that certainly belong to it.
    """
    mine = (left.select(chosen[0]), right.select(chosen[1]))
    curve = refine(start, *mine, rig, blur, circle=True)
    if curve is None or curve.rms > 0.1:
        # Perhaps no circle.
        ellipse = refine(start, *mine, rig, blur, circle=False)
        if ellipse is not None and (curve is None or ellipse.rms * np.sqrt(ELLIPSE_GAIN) < curve.rms):
            curve = ellipse
    if curve is None or curve.rms > WORST_RMS or curve.centre[2] <= 0.0:
        return None
    for _ in range(2):
        (on_left, fit_left), (on_right, fit_right) = (claimed(curve, edgels, rig, eye, blur) for edgels, eye in (
            (left, 0.0), (right, rig.baseline)))
        if min(fit_left.sum(), fit_right.sum()) < 8:
            return None
        mine = (left.select(fit_left), right.select(fit_right))
        again = refine(curve, *mine, rig, blur, circle=bool(curve.radii[0] == curve.radii[1]), rounds=6)
        if again is None:
            return None
        curve = replace(again, left=on_left, right=on_right)
        if curve.radii[0] == curve.radii[1]:
            ellipse = refine(curve, *mine, rig, blur, circle=False, rounds=6)
            if (ellipse is not None and ellipse.rms ** 2 * ELLIPSE_GAIN < curve.rms ** 2
                    and ellipse.radii[1] < ELLIPSE_RATIO * ellipse.radii[0]):
                curve = ellipse
    if curve.rms > WORST_RMS:
        return None
    arc, coverage = _seen(curve, *mine, rig)
    return _facing(replace(curve, arc=arc, coverage=coverage))


def recover_curves(matches: Matches, left: Pieces, right: Pieces, ellipses: tuple[list[Ellipse], list[Ellipse]],
                   edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float) -> list[Curve]:
    """All planar curves of a pair, those on most edgels first; none shares half of its edgels with a better one."""
    found: list[Curve] = []
    masks = [[_edgels_of(pieces, k, len(e)) for k in range(len(conics))]
             for pieces, conics, e in zip((left, right), ellipses, edgels)]
    order = sorted(pairs(matches, left, right), key=lambda p: -masks[0][p[0]].sum())
    for a, b, samples in order:
        if any(c.left[masks[0][a]].mean() > 0.5 and c.right[masks[1][b]].mean() > 0.5 for c in found):
            continue
        best = None
        for shear in shears(ellipses[0][a], ellipses[1][b], samples):
            start = lift(ellipses[0][a], shear, rig)
            if start is None:
                continue
            curve = refine(start, edgels[0].select(masks[0][a]), edgels[1].select(masks[1][b]), rig, blur,
                           circle=True, rounds=8)
            curve = curve or start
            if best is None or curve.rms < best.rms:
                best = curve
            if best.rms < 0.1:
                break
        if best is None:
            continue
        curve = recover_curve(best, *edgels, (masks[0][a], masks[1][b]), rig, blur)
        if curve is not None and curve.coverage > 0.08:
            found.append(curve)
    return found


def _edgels_of(pieces: Pieces, arc: int, n: int) -> np.ndarray:
    mask = np.zeros(n, bool)
    for first, last in pieces.bounds[pieces.arc == arc]:
        mask[first:last] = True
    return mask


def on_curves(lines: Lines3D, pieces: tuple[Pieces, Pieces], curves: list[Curve]) -> np.ndarray:
    """(n,) bool: matched pieces of which most edgels in one of the images belong to a curve."""
    result = np.zeros(len(lines), bool)
    for side, index, of in ((0, lines.left, 'left'), (1, lines.right, 'right')):
        for curve in curves:
            total = np.concatenate([[0], np.cumsum(getattr(curve, of))])
            bounds = pieces[side].bounds[index]
            result |= (total[bounds[:, 1]] - total[bounds[:, 0]]) > 0.5 * (bounds[:, 1] - bounds[:, 0])
    return result


def curve_features(curves: list[Curve]) -> FeatureSet:
    """As features: the errors are three sigma of the centre, along the normal and across it."""
    if not curves:
        return FeatureSet.empty()
    along, across = [], []
    for c in curves:
        spread = c.covariance[:3, :3]
        along.append(3.0 * np.sqrt(c.normal @ spread @ c.normal))
        flat = np.stack([c.first, c.second])
        across.append(3.0 * np.sqrt(np.linalg.eigvalsh(flat @ spread @ flat.T)[-1]))
    return FeatureSet.from_curves([c.centre for c in curves], [c.normal for c in curves], [c.radii for c in curves],
                                  along, across, [c.first for c in curves], [c.arc for c in curves])
