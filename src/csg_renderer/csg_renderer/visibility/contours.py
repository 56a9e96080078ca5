"""Occluding contours: where a viewpoint's rays touch the curved surfaces of a solid.

The rays from a point that touch a quadric do so in one plane, the point's polar plane, so a contour is a conic or a
pair of rulings like any other tentative curve (Semple & Kneebone, Algebraic projective geometry). It depends on the
viewpoint and is no crease: a stereo pair sees two different ones.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from msgs_py.numeric.typed import IntArray

from ..brep.conics import Line, section
from ..brep.pieces import Pieces, conic_pieces, line_pieces
from ..brep.surfaces import SurfaceTable
from .image_cuts import Wires
from .settings import NO_POLAR_PLANE


def contours(table: SurfaceTable, viewpoint: np.ndarray) -> Wires:
    """The occluding contours of a solid's boundary; hidden parts are not removed.

    Parameters
    ----------
    table : SurfaceTable
    viewpoint : (3,) float64, metres, model frame

    Returns
    -------
    Wires
        Model frame, metres.
    """
    parts = [
        _on_boundary(table, len(table.planes) + k, conics, lines)
        for k, conics, lines in polar_sections(table, viewpoint)
    ]
    return Wires.concatenate(parts).moved(table.metres_T_normalised)


def polar_sections(table: SurfaceTable, viewpoint: np.ndarray) -> Iterator[tuple[int, list[np.ndarray], list[Line]]]:
    """Where rays from a viewpoint touch the quadrics: the whole curves, of which parts may bound nothing.

    Parameters
    ----------
    table : SurfaceTable
    viewpoint : (3,) float64, metres, model frame

    Yields
    ------
    quadric : int
        Row of ``table.quadrics``.
    conics, lines
        As :func:`.conics.section` has them, normalised frame.
    """
    origin = np.append(table.normalised(viewpoint), 1.0)
    for k, quadric in enumerate(table.quadrics):
        polar = quadric @ origin
        length = np.linalg.norm(polar[:3])
        if length > NO_POLAR_PLANE:
            yield k, *section(table, k, polar / length)


def _on_boundary(
    table: SurfaceTable, group: int, conics: list[np.ndarray], lines: list[tuple[np.ndarray, np.ndarray]]
) -> Wires:
    """The pieces of a quadric's contour where the quadric is the solid's boundary; normalised frame."""
    point = np.array([line[0] for line in lines]).reshape(-1, 3)
    direction = np.array([line[1] for line in lines]).reshape(-1, 3)
    straight = line_pieces(table, point, direction, faces=1)
    rows = _owned(straight, group)
    k = straight.curve[rows]
    segment = np.stack(
        [point[k] + straight.low[rows, None] * direction[k], point[k] + straight.high[rows, None] * direction[k]],
        axis=1,
    )
    conic = np.array(conics).reshape(-1, 4, 3)
    curved = conic_pieces(table, conic, np.zeros((0, 4)), faces=1)
    rows = _owned(curved, group)
    return Wires(segment, conic[curved.curve[rows]], curved.low[rows], curved.high[rows])


def _owned(pieces: Pieces, group: int) -> np.ndarray:
    """(k,) int: pieces where the group is a smooth sheet of the boundary."""
    rows = np.unique(pieces.branches.point[pieces.branches.group == group])
    owned: IntArray = rows[~pieces.branches.crease[rows]]
    return owned
