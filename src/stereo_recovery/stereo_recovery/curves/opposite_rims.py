"""The other end of a cylinder of which one rim was found: looked for where its outlines end.

A rim seen nearly edge-on, or in short segments, is no arc to begin with. But one end of a cylinder says what the other
must look like, up to where it is, and the outlines say that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msgs_py import StereoRig

from ..detection.conics import sampson
from ..detection.edgels import Edgels
from ..detection.segments import Segments
from .curve import Curve, picture
from .occluding_contours import of_cylinder
from .recovery import CLAIM_COSINE, STEADY, WORST_MISFIT, axle_of, claimed, determined, recover_curve

# Edgels this near to the expected picture, pixels, are tried; so many are needed in either image.
EXPECTED = 2.5
LEAST_EDGELS = 12
# A place nearer than this, in radii, to a known rim's is that rim's.
APART = 0.25
# Least share of the rim that is seen, largest change of its radius, largest share of edgels that other curves have.
LEAST_SHARE = 0.2
SAME_RADIUS = 0.05
OTHERS = 0.3
# The rims of one rounded block are at most so many radii apart.
WIDEST_BLOCK = 8.0
# Two curves whose centres and radii differ by less than this, in radii, in one plane (cosine) are one.
SAME_RIM = 0.04
SAME_PLANE = 0.995


def completed(
    curves: list[Curve], segments: tuple[Segments, Segments], edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float
) -> list[Curve]:
    """The curves, and rims found at the far ends of the outlines of those that bound a cylinder."""
    result = list(curves)
    for curve in curves:
        if curve.tilt > STEADY or curve.radii[0] != curve.radii[1]:
            continue
        seen = of_cylinder(curve, segments, rig)
        if len(seen.sides) < 2:
            continue
        if any(_closes(curve, c) for c in result):
            continue
        ends = seen.places(curve.centre, curve.normal).ravel()
        ends = ends[np.argsort(-np.abs(ends))]
        tried: list[float] = []
        for place in ends:
            known = [
                float((c.centre - curve.centre) @ curve.normal)
                for c in result
                if np.linalg.norm(np.cross(c.centre - curve.centre, curve.normal)) < APART * curve.radii[0]
            ]
            if min(abs(place - other) for other in [*known, *tried, 0.0]) < APART * curve.radii[0]:
                continue
            tried.append(float(place))
            found = _rim_at(curve, float(place), result, edgels, rig, blur)
            if found is not None:
                result.append(found)
                break
    return result


def counterparts(curves: Sequence[Curve], edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float) -> list[Curve]:
    """Circles that the walls of a slot or of a rounded block have in the plane of another rim: too little of them is
    seen to find them, but edges end where they touch them, and what lies on them is no edge."""
    result: list[Curve] = []
    round_ones = [c for c in curves if c.radii[0] == c.radii[1]]
    for curve in round_ones:
        for other in round_ones:
            run = other.centre - curve.centre
            height = float(run @ curve.normal)
            radius = curve.radii[0]
            if (
                abs(curve.normal @ other.normal) < SAME_PLANE
                or abs(height) < APART * radius
                or abs(other.radii[0] / radius - 1.0) > SAME_RADIUS
                or np.linalg.norm(run - height * curve.normal) > WIDEST_BLOCK * radius
            ):
                continue
            centre = curve.centre + height * curve.normal
            if any(np.linalg.norm(c.centre - centre) < APART * radius for c in [*curves, *result]):
                continue
            spread = curve.covariance.copy()
            spread[:3, :3] += other.covariance[:3, :3] + (curve.tilt * height) ** 2 * np.eye(3)
            moved = replace(curve, centre=centre, covariance=spread)
            if centre[2] > 0.0:
                result.append(
                    replace(
                        moved,
                        left=claimed(moved, edgels[0], rig, 0.0, blur)[0],
                        right=claimed(moved, edgels[1], rig, rig.baseline, blur)[0],
                    )
                )
    return result


def _closes(curve: Curve, other: Curve) -> bool:
    """Whether another rim is the other end of a curve's cylinder."""
    run = other.centre - curve.centre
    along = float(run @ curve.normal)
    return bool(
        abs(along) > APART * curve.radii[0]
        and abs(other.radii[0] / curve.radii[0] - 1.0) < SAME_RADIUS
        and np.linalg.norm(run - along * curve.normal) < APART * curve.radii[0]
    )


def distinct(curves: list[Curve]) -> list[Curve]:
    """The curves without those that are another one again, found from another piece of it: the one on more edgels stays
    and takes the other's edgels, so that they are nobody's edges."""
    kept: list[Curve] = []
    for curve in sorted(curves, key=lambda c: -int(c.left.sum() + c.right.sum())):
        for k, other in enumerate(kept):
            near = SAME_RIM * other.radii[0]
            if (
                np.linalg.norm(curve.centre - other.centre) < near
                and np.abs(curve.radii - other.radii).max() < near
                and abs(curve.normal @ other.normal) > SAME_PLANE
            ):
                kept[k] = replace(other, left=other.left | curve.left, right=other.right | curve.right)
                break
        else:
            kept.append(curve)
    return kept


def _rim_at(
    curve: Curve, place: float, others: list[Curve], edgels: tuple[Edgels, Edgels], rig: StereoRig, blur: float
) -> Curve | None:
    expected = replace(curve, centre=curve.centre + place * curve.normal)
    if expected.centre[2] <= 0.0:
        return None
    masks = (
        _near(expected, edgels[0], rig.left.matrix, 0.0, [c.left for c in others]),
        _near(expected, edgels[1], rig.right.matrix, rig.baseline, [c.right for c in others]),
    )
    if min(int(mask.sum()) for mask in masks) < LEAST_EDGELS:
        return None
    found = recover_curve(expected, *edgels, masks, rig, blur, axle_of(curve))
    if found is None or not determined(found) or found.misfit > WORST_MISFIT or found.coverage < LEAST_SHARE:
        return None
    taken = np.any([c.left for c in others], axis=0)
    if abs(found.radii[0] / curve.radii[0] - 1.0) > SAME_RADIUS or taken[found.left].mean() > OTHERS:
        return None
    return found


def _near(curve: Curve, edgels: Edgels, matrix: np.ndarray, eye: float, taken: list[np.ndarray]) -> np.ndarray:
    """(n,) bool: edgels near the expected picture, pointing across it, that are no other curve's."""
    conic = picture(curve, matrix, eye)
    near = (np.abs(sampson(conic, edgels.position)) < EXPECTED) & ~np.any(taken, axis=0)
    h = edgels.position @ conic[:2, :2] + conic[:2, 2]
    across = np.stack([np.cos(edgels.direction), np.sin(edgels.direction)], axis=1)
    return near & (np.abs((h * across).sum(axis=1)) > CLAIM_COSINE * np.hypot(h[:, 0], h[:, 1]))
