"""Matching features of a CAD mesh: creases merged to maximal lines, facetted rims fitted back to circles and ellipses.

What model_features gives exactly from a tree is here estimated from triangles, within the error of the facetting: the
vertices of a facetted rim are taken to lie on the curve.
"""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np

from msgs_py import FeatureSet
from msgs_py.numeric.grouping import cluster
from msgs_py.numeric.typed import FloatArray

from ..brep.settings import WHOLE_TURN
from ..mesh.facets import Facets
from ..mesh.files import read_mesh
from ..mesh.settings import COLLINEAR, CREASE_ANGLE, WELD
from .mesh_curves import Chain, FittedConic, chains, even_runs, fit_conic, split, straightened, turns
from .settings import FLAT_FACE, LONG_SEGMENT, MOST_CREASES, NORMAL_DECIMALS, PATCH, SAME_AXIS


class Rim(NamedTuple):
    """A facetted circle or ellipse, or an arc of one.

    Attributes
    ----------
    conic : FittedConic
    points : (k + 1, 3) float64
        Vertices along it, metres; the first is the last of a whole one.
    sides : (c, 2) int
        The triangles at every crease that it is made of, -1 for none.
    """

    conic: FittedConic
    points: np.ndarray
    sides: np.ndarray


class Creases(NamedTuple):
    """The creases of a mesh.

    Attributes
    ----------
    ends : (n, 2, 3) float64
        Of straight ones, metres.
    rims : tuple of Rim
    others : tuple of (k + 1, 3) float64
        Points along those that are neither.
    """

    ends: np.ndarray
    rims: tuple[Rim, ...]
    others: tuple[np.ndarray, ...]


class _Sorted(NamedTuple):
    """Creases as they are found: straight ones with their triangles (2,); see :class:`Creases`."""

    lines: list[tuple[np.ndarray, np.ndarray]]
    rims: list[Rim]
    others: list[np.ndarray]


def features_from_mesh(
    path: str | os.PathLike[str], crease_angle: float = CREASE_ANGLE, scale: float = 1.0
) -> FeatureSet:
    """Edges, planar curves and axes of a mesh file.

    Parameters
    ----------
    path : str or path
        An STL, OBJ, PLY or OFF file.
    crease_angle : float
        Radians. Neighbouring triangles that turn by more meet in a crease; larger than the angle between the facets of
        a round surface.
    scale : float
        Metres per unit of the file, which does not say what its unit is.

    Returns
    -------
    FeatureSet
        Frame of the file, metres, uncertainty zero.

    Raises
    ------
    FileNotFoundError
        There is no such file.
    ValueError
        The file is no mesh, or an argument is out of range; the message names it.
    """
    if not 0.0 < crease_angle < np.pi:
        raise ValueError(f'crease_angle: expected radians between 0 and pi, got {crease_angle}')
    if not 0.0 < scale < np.inf:
        raise ValueError(f'scale: expected metres per unit > 0, got {scale}')
    vertices, triangles = read_mesh(path)
    return mesh_features(vertices * scale, triangles, crease_angle)


def mesh_features(vertices: np.ndarray, triangles: np.ndarray, crease_angle: float = CREASE_ANGLE) -> FeatureSet:
    """The matching features of a triangle mesh.

    Parameters
    ----------
    vertices : (n, 3) float64, metres
    triangles : (m, 3) int
        Rows of ``vertices``, anticlockwise as seen from outside.
    crease_angle : float
        Radians. Neighbouring triangles that turn by more meet in a crease.

    Returns
    -------
    FeatureSet
        Edges, then curves, then axes; frame of the vertices, metres, uncertainty zero.

    Raises
    ------
    ValueError
        It has more creases than an object with edges has.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> tetrahedron = mesh_features(corners, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    >>> len(tetrahedron), tetrahedron.lengths.round(3).tolist()
    (6, [1.0, 1.0, 1.0, 1.414, 1.414, 1.414])
    """
    facets = Facets.of(vertices, triangles, crease_angle)
    return features_of(facets, creases_of(facets))


def creases_of(facets: Facets) -> Creases:
    """The creases of a mesh, merged and fitted.

    Raises
    ------
    ValueError
        It has more than an object with edges has.
    """
    rows = np.nonzero(facets.crease)[0]
    if len(rows) > MOST_CREASES:
        raise ValueError(f'the mesh has {len(rows)} creases, expected at most {MOST_CREASES}: is it a scan?')
    sides = facets.sides[rows]
    found = _Sorted([], [], [])
    for chain in chains(facets.edges[rows], facets.points):
        for part in split(chain, turns(chain) > facets.crease_angle):
            _sort_out(part, sides, facets.curved, found)
    return Creases(_merged(found.lines, facets.normal, facets.size), tuple(found.rims), tuple(found.others))


def features_of(facets: Facets, creases: Creases) -> FeatureSet:
    """The matching features of a mesh with its creases: edges, then curves, then axes."""
    rims = [(rim.conic, rim.sides) for rim in creases.rims]
    axes = _axes(rims, facets.patch, facets.normal, facets.points[facets.triangles], facets.size)
    return FeatureSet.concatenate(
        [
            FeatureSet.from_edges(creases.ends[:, 0], creases.ends[:, 1]),
            _curves(rims, facets.normal),
            FeatureSet.from_axes(axes[:, 0], axes[:, 1]),
        ]
    )


def _sort_out(chain: Chain, sides: np.ndarray, curved: np.ndarray, found: _Sorted) -> None:
    """Add a chain without corners to straight lines, fitted curves, and what is neither.

    sides : (creases, 2) triangles at each crease; curved : (triangles,) bool, part of a round surface.
    """
    smooth, members = straightened(chain)
    lines, rims = found.lines, found.rims
    if len(smooth.segment) == 1:
        lines.append((smooth.points, sides[members[0][0]]))
        return
    round_ = np.array([curved[sides[member]].any() for member in members])
    length = np.linalg.norm(smooth.steps, axis=1)
    flat = ~round_ | (np.roll(~round_, 1) & (smooth.closed | (np.arange(len(round_)) > 0)))
    for run in split(smooth, flat) if flat.any() else [smooth]:
        if not round_[run.segment].any():
            lines.append((run.points, sides[members[run.segment[0]][0]]))
            continue
        parts, fits = [run], [fit_conic(run)]
        if fits[0] is None:
            parts = even_runs(run)
            fits = [fit_conic(part) for part in parts]
        straight = [
            len(part.segment) == 1 and length[part.segment[0]] > LONG_SEGMENT * np.median(length[run.segment])
            for part in parts
        ]
        if not all(fit is not None or line for fit, line in zip(fits, straight)):
            # A curve in no plane, whose pieces would be taken for arcs.
            found.others.append(run.points)
            continue
        for part, fit in zip(parts, fits):
            if fit is None:
                lines.append((part.points, sides[members[part.segment[0]][0]]))
            else:
                every = sides[np.concatenate([members[k] for k in part.segment])]
                rims.append(Rim(fit, part.points, every))


def _merged(lines: list[tuple[np.ndarray, np.ndarray]], normal: np.ndarray, size: float) -> np.ndarray:
    """Straight creases (n, 2, 3), those joined that go straight on through a vertex between the same two planes."""
    ends = np.array([points for points, _ in lines]).reshape(-1, 2, 3)
    planes = [
        sorted(tuple(np.round(normal[side], NORMAL_DECIMALS) + 0.0) if side >= 0 else (0.0, 0.0, 0.0) for side in sides)
        for _, sides in lines
    ]
    vertex = cluster(ends.reshape(-1, 3), WELD * size)[0].reshape(-1, 2)
    alive = np.ones(len(ends), bool)
    for where in np.unique(vertex):
        here = [int(k) for k in np.nonzero((vertex == where).any(axis=1) & alive)[0]]
        for i, k in enumerate(here):
            for j in here[i + 1 :]:
                if not (alive[k] and alive[j]) or planes[k] != planes[j]:
                    continue
                far_k, far_j = (int(vertex[m, 0] == where) for m in (k, j))
                one, two = ends[k, far_k] - ends[k, 1 - far_k], ends[j, far_j] - ends[j, 1 - far_j]
                if np.linalg.norm(np.cross(one, two)) < -COLLINEAR * (one @ two):
                    ends[k, 1 - far_k], vertex[k, 1 - far_k] = ends[j, far_j], vertex[j, far_j]
                    alive[j] = False
    return ends[alive]


def _curves(rims: list[tuple[FittedConic, np.ndarray]], normal: np.ndarray) -> FeatureSet:
    """Fitted conics as features, their normals out of the planar face where there is one."""
    if not rims:
        return FeatureSet.empty()
    out, arcs = [], []
    for conic, sides in rims:
        flat = [
            n
            for side in sides.T
            if (side >= 0).all()
            and (n := normal[side].mean(axis=0)) @ n > FLAT_FACE
            and abs(n @ conic.normal) > FLAT_FACE
        ]
        looks = (flat[0] if flat else normal[sides[sides >= 0]].sum(axis=0)) @ conic.normal
        out.append(conic.normal if looks >= 0.0 else -conic.normal)
        start, sweep = conic.arc
        whole = sweep > WHOLE_TURN
        arcs.append(conic.arc if looks >= 0.0 or whole else [-(start + sweep) % (2.0 * np.pi), sweep])
    return FeatureSet.from_curves(
        [c.centre for c, _ in rims],
        out,
        np.array([c.radii for c, _ in rims]),
        major_axis=np.array([c.major_axis for c, _ in rims]),
        arc=np.array(arcs),
    )


def _axes(
    rims: list[tuple[FittedConic, np.ndarray]], patch: np.ndarray, normal: np.ndarray, corners: np.ndarray, size: float
) -> np.ndarray:
    """(a, 2, 3): axes between the planar ends of each round patch, or from a cone's apex to its base."""
    found: list[list[np.ndarray]] = []
    single: list[tuple[np.ndarray, np.ndarray]] = []
    for k in np.unique(patch[np.concatenate([s[s >= 0] for _, s in rims])]) if rims else []:
        mine = patch == k
        n, p = normal[mine], corners[mine]
        _, squares, axis = np.linalg.svd(n.T @ n)
        spread = np.sqrt(squares)
        if spread[1] < PATCH * spread[0]:
            continue  # a plane
        centres = np.array([c.centre for c, sides in rims if mine[sides[sides >= 0]].any()])
        apex = np.linalg.lstsq(n, (n * p[:, 0]).sum(axis=1), rcond=None)[0]
        direction = axis[2]
        if spread[2] > PATCH * spread[0]:
            if np.abs(((p[:, 0] - apex) * n).sum(axis=1)).max() > PATCH * size:
                # Neither cylinder nor cone: perhaps several that meet at shallow angles.
                single += _rulings(rims, mine, normal)
                continue
            direction = centres.mean(axis=0) - apex
            if np.linalg.norm(p - apex, axis=2).min() < SAME_AXIS * size:
                centres = np.concatenate([centres, [apex]])
        direction = direction / np.linalg.norm(direction)
        # Flat sides can join several cylinders smoothly to one patch: each has its own line of centres.
        line = cluster(centres - np.outer(centres @ direction, direction), SAME_AXIS * size)[0]
        for label in range(line.max() + 1):
            ends = centres[line == label]
            along = ends @ direction
            if np.ptp(along) > SAME_AXIS * size:
                found.append([ends[along.argmin()], ends[along.argmax()]])
            elif spread[2] <= PATCH * spread[0]:
                single.append((ends[0], direction))
    # Two ends of one cylinder that goes through a round body: its axis is between its outer ends.
    for i, (one, direction) in enumerate(single):
        for other, _ in single[:i]:
            gap = other - one
            if (
                np.linalg.norm(np.cross(gap, direction)) < PATCH * np.linalg.norm(gap)
                and np.linalg.norm(gap) > SAME_AXIS * size
            ):
                found.append([one, other])
    pairs = np.array(found).reshape(-1, 2, 3)
    ordered = np.sort(pairs, axis=1).reshape(-1, 6)
    axes: FloatArray = pairs[cluster(ordered, SAME_AXIS * size)[1]]
    return axes


def _rulings(
    rims: list[tuple[FittedConic, np.ndarray]], mine: np.ndarray, normal: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Centre and axis direction of every rim of a patch beside which the patch is a cylinder."""
    out = []
    for conic, sides in rims:
        beside = sides[(sides >= 0) & mine[sides]]
        _, squares, axis = np.linalg.svd(normal[beside].T @ normal[beside])
        if squares[1] > PATCH * squares[0] and squares[2] < PATCH**2 * squares[0]:
            out.append((conic.centre, axis[2]))
    return out
