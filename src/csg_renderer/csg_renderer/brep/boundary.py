"""The boundary of a solid, straight from its CSG tree: its creases, the faces they bound, and its axes.

Tentative curves (``candidates``) are cut at all surfaces (``pieces``), classified by their neighbourhood
(``neighbourhood``) and joined. In the manner of Requicha & Voelcker (Boolean operations in solid modeling, 1985); this
is what thesis 4.12 and 7.4 leave as future work.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from msgs_py import FeatureSet

from ..scene.solid import Solid
from .axes import axes
from .candidates import candidates
from .conics import is_ellipse
from .details import Anatomy, Details, details
from .pieces import Pieces, Runs, conic_pieces, creases, line_pieces
from .settings import CIRCULAR, FAR_DIRECTIONS, FAR_DISTANCE, SAME_NORMAL, WHOLE_TURN
from .space_curves import space_curve_pieces
from .surfaces import SurfaceTable, compile_surfaces


@dataclass(frozen=True, eq=False)
class Boundary:
    """The boundary of a solid, model frame, metres.

    Parameters
    ----------
    anatomy : Anatomy
        The intermediate results, normalised frame.
    edge_start, edge_end : (e, 3) float64
        Maximal straight creases.
    conic : (c, 4, 3) float64
        The conics that carry curved creases; the point at angle t is conic (cos t, sin t, 1), homogeneous.
    curve : (k,) int
        Maximal planar curved creases: row of ``conic`` of each.
    curve_low, curve_high : (k,) float64, radians
        Its range.
    curve_normal : (k, 3) float64
        Unit vector out of the planar face that the curve bounds.
    ellipse : (k,) bool
        The curve is a circle or ellipse, or an arc of one, and so a matching feature.
    axis_start, axis_end : (a, 3) float64
        Axes of cylinders and cones.
    space_curves : tuple of (2 k + 1, 3) float64
        Creases in no plane: points along each, of which every second one ends a chord.
    notices : tuple of str
        What could not be given, in words.
    """

    anatomy: Anatomy
    edge_start: np.ndarray
    edge_end: np.ndarray
    conic: np.ndarray
    curve: np.ndarray
    curve_low: np.ndarray
    curve_high: np.ndarray
    curve_normal: np.ndarray
    ellipse: np.ndarray
    axis_start: np.ndarray
    axis_end: np.ndarray
    space_curves: tuple[np.ndarray, ...]
    notices: tuple[str, ...]

    @property
    def table(self) -> SurfaceTable:
        """The solid's surfaces."""
        return self.anatomy.table

    @cached_property
    def details(self) -> Details:
        """Faces, vertices, dihedral angles, bounding box, area and volume; computed when first used."""
        return details(self.anatomy)

    @cached_property
    def features(self) -> FeatureSet:
        """The matching features: edges, then circles and ellipses, then axes."""
        k = self.ellipse
        return FeatureSet.concatenate(
            [
                FeatureSet.from_edges(self.edge_start, self.edge_end),
                arcs(self.conic[self.curve[k]], self.curve_low[k], self.curve_high[k], self.curve_normal[k]),
                FeatureSet.from_axes(self.axis_start, self.axis_end),
            ]
        )


def evaluate(solid: Solid) -> Boundary:
    """Evaluate the boundary of a solid.

    References
    ----------
    Requicha & Voelcker, Boolean operations in solid modeling, 1985. Thesis 4.12 and 7.4 leave this as future work.
    """
    table = compile_surfaces(solid)
    found = candidates(table)
    straight = line_pieces(table, found.point, found.direction)
    curved = conic_pieces(table, found.conic, found.extra)
    edges, curves = creases(straight), creases(curved, 2.0 * np.pi)
    point, direction = found.point[edges.curve], found.direction[edges.curve]
    axis_start, axis_end = axes(table, curved, is_ellipse(found.conic))
    ellipse = is_ellipse(found.conic)[curves.curve]
    in_space = space_curve_pieces(table, found.space_pairs)
    anatomy = Anatomy(table, found.point, found.direction, found.conic, straight, curved, in_space, edges, curves)
    return Boundary(
        anatomy,
        table.metres(point + edges.low[:, None] * direction),
        table.metres(point + edges.high[:, None] * direction),
        table.metres_T_normalised @ found.conic,
        curves.curve,
        curves.low,
        curves.high,
        _normals(table, found.conic, curved, curves),
        ellipse,
        table.metres(axis_start),
        table.metres(axis_end),
        tuple(table.metres(samples) for samples in in_space.creases),
        _notices(anatomy, ellipse),
    )


def _notices(anatomy: Anatomy, ellipse: np.ndarray) -> tuple[str, ...]:
    """What a boundary lacks, in words for the user; ellipse (k,) bool of its curved creases."""
    out = []
    table = anatomy.table
    if not table.leaves:
        out.append('the solid is empty: NULL')
    elif not any(
        len(pieces.branches.point) for pieces in (anatomy.straight, anatomy.curved, anatomy.space_curves.pieces)
    ):
        out.append('no surfaces meet on the boundary: the solid has no creases, or nothing is left of it')
    shared = sum(
        int((np.bincount(pieces.branches.point, minlength=1) > 2).sum())
        for pieces in (anatomy.straight, anatomy.curved, anatomy.space_curves.pieces)
    )
    if shared:
        out.append(f'more than two faces meet along {shared} piece(s) of crease: parts of the solid only touch there')
    if (~ellipse).any():
        out.append(f'{(~ellipse).sum()} planar crease(s) are arcs of a parabola or hyperbola: no matching features')
    if anatomy.space_curves.creases:
        out.append(f'{len(anatomy.space_curves.creases)} crease(s) lie in no plane: no matching features')
    if not table.bounded and _unbounded(anatomy):
        out.append('the solid is not bounded: creases that run to infinity are left out')
    return tuple(out)


def _unbounded(anatomy: Anatomy) -> bool:
    """There is material far away: at points in all directions, far outside of all primitives."""
    table = anatomy.table
    rng = np.random.default_rng(0)
    far = rng.normal(size=(FAR_DIRECTIONS, 3))
    far *= FAR_DISTANCE / np.linalg.norm(far, axis=1, keepdims=True)
    return bool(table.contains(far).any())


def arcs(conic: np.ndarray, low: np.ndarray, high: np.ndarray, normal: np.ndarray) -> FeatureSet:
    """Ellipses between two angles as features.

    Parameters
    ----------
    conic : (n, 4, 3) float64, metres
        With last row (0, 0, 1).
    low, high : (n,) float64, radians
    normal : (n, 3) float64
        Unit vectors; the feature's normal.

    Returns
    -------
    FeatureSet
        n features of kind CURVE, in the frame of ``conic``.
    """
    diameters = conic[:, :3, :2]
    u, s, vt = np.linalg.svd(diameters, full_matrices=False)
    # A circle has no major axis of its own: the parametrisation's is kept.
    circle = s[:, 0] - s[:, 1] <= CIRCULAR * s[:, 0]
    u[circle] = diameters[circle] / s[circle][:, :1, None]
    vt[circle] = np.eye(2)
    turns_left = np.einsum('ni,ni->n', np.cross(u[:, :, 0], u[:, :, 1]), normal) > 0.0
    rising = turns_left == (np.linalg.det(vt) > 0.0)
    first = np.where(rising, low, high)
    x, y = np.einsum('nij,nj->in', vt, np.stack([np.cos(first), np.sin(first)], axis=1))
    start = np.arctan2(np.where(turns_left, y, -y), x) % (2.0 * np.pi)
    sweep = np.minimum(high - low, 2.0 * np.pi)
    whole = sweep > WHOLE_TURN
    arc = np.stack([np.where(whole, 0.0, start), np.where(whole, 2.0 * np.pi, sweep)], axis=1)
    return FeatureSet.from_curves(conic[:, :3, 2], normal, s, major_axis=u[:, :, 0], arc=arc)


def _normals(table: SurfaceTable, conic: np.ndarray, pieces: Pieces, runs: Runs) -> np.ndarray:
    """(k, 3): normals of creases: out of the planar face where there is one, else to the side of the faces' normals."""
    out = np.zeros((len(runs), 3))
    branches = pieces.branches
    for row, (curve, piece) in enumerate(zip(runs.curve, runs.piece)):
        plane = np.cross(
            conic[curve, :3, 0] - conic[curve, 3, 0] * pieces.middle[piece],
            conic[curve, :3, 1] - conic[curve, 3, 1] * pieces.middle[piece],
        )
        plane /= np.linalg.norm(plane)
        mine = branches.point == piece
        flat = mine & (branches.group < len(table.planes))
        outward = branches.outward[flat]
        if len(outward) and abs(outward[0] @ plane) > 1.0 - SAME_NORMAL:
            out[row] = outward[0]
            continue
        side = branches.outward[mine].sum(axis=0) @ plane
        if abs(side) < SAME_NORMAL:
            side = pieces.middle[piece] @ plane
        out[row] = plane if side >= 0.0 else -plane
    return out
