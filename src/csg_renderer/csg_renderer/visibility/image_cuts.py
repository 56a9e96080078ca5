"""Where space curves cross each other as a viewpoint at the origin sees them.

Two curves cross in the image where one ray from the viewpoint meets both: a straight piece and the viewpoint span a
plane, a conic and the viewpoint a quadric cone, so every crossing is a root in closed form. No image plane is needed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import BoolArray

from ..brep.conics import evaluate, quadric_angles
from .settings import EDGE_ON, NO_NORM, PAST_END, SHORTEST_PIECE


@dataclass(frozen=True, eq=False)
class Wires:
    """Curves in one frame, metres.

    Parameters
    ----------
    segment : (n, 2, 3) float64
        End points of straight segments.
    conic : (c, 4, 3) float64
        Conics, as in ``brep.conics``.
    low, high : (c,) float64, radians
        The range of each conic.
    """

    segment: np.ndarray
    conic: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of_segments(cls, segment: np.ndarray) -> Wires:
        """Segments (n, 2, 3) alone."""
        return cls(segment.reshape(-1, 2, 3), np.zeros((0, 4, 3)), np.zeros(0), np.zeros(0))

    @classmethod
    def concatenate(cls, parts: Iterable[Wires]) -> Wires:
        """All curves of several sets in one."""
        parts = [*parts, cls.of_segments(np.zeros((0, 2, 3)))]
        return cls(
            *(np.concatenate([getattr(part, name) for part in parts]) for name in ('segment', 'conic', 'low', 'high'))
        )

    def moved(self, matrix: np.ndarray) -> Wires:
        """Under an affine (4, 4) column-form matrix."""
        return Wires(self.segment @ matrix[:3, :3].T + matrix[:3, 3], matrix @ self.conic, self.low, self.high)


def cut_segments(segment: np.ndarray, others: Wires, planes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut segments where other curves cross them in the image, and where they leave it.

    Parameters
    ----------
    segment : (n, 2, 3) float64, metres, viewpoint at the origin
    others : Wires
        The curves that cut; the same frame.
    planes : (p, 3) float64
        Normals n of planes through the viewpoint; the image is where n.x >= 0 for all.

    Returns
    -------
    row : (k,) int
        Which segment each piece is of; pieces are ordered along each segment.
    low, high : (k,) float64
        Its range, as fractions of the segment.
    """
    a, b = segment[:, 0], segment[:, 1]
    value_a, value_b = a @ planes.T, b @ planes.T
    with np.errstate(divide='ignore', invalid='ignore'):
        t = value_a / (value_a - value_b)
        enter = np.where(value_a < 0.0, np.where(value_b > 0.0, t, 2.0), 0.0).max(axis=1, initial=0.0)
        leave = np.where(value_b < 0.0, np.where(value_a > 0.0, t, -1.0), 1.0).min(axis=1, initial=1.0)
        crossing = np.concatenate(
            [_segment_by_segment(a, b, others.segment[:, 0], others.segment[:, 1]), _segment_by_conic(a, b, others)],
            axis=1,
        )
    crossing = np.where((crossing > enter[:, None]) & (crossing < leave[:, None]), crossing, np.nan)
    cuts = np.sort(np.concatenate([enter[:, None], leave[:, None], crossing], axis=1), axis=1)
    cuts[enter >= leave] = np.nan
    row, column = np.nonzero(cuts[:, 1:] - cuts[:, :-1] > SHORTEST_PIECE)
    return row, cuts[row, column], cuts[row, column + 1]


def cut_conics(subject: Wires, others: Wires, planes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As :func:`cut_segments`, for the conics of ``subject``; the ranges are angles in radians."""
    n = len(subject.conic)
    if not n:
        return np.zeros(0, int), np.zeros(0), np.zeros(0)
    with np.errstate(divide='ignore', invalid='ignore'):
        borders = _plane_angles(subject.conic, planes)
        crossing = [
            borders.reshape(n, -1),
            _conic_by_segment(subject.conic, others.segment),
            _conic_by_conic(subject.conic, others),
        ]
        along = np.concatenate(crossing, axis=1) - subject.low[:, None]
    along %= 2.0 * np.pi
    span = (subject.high - subject.low)[:, None]
    along = np.where(along < span, along, np.nan)
    cuts = np.sort(np.concatenate([np.zeros((n, 1)), span, along], axis=1), axis=1) + subject.low[:, None]
    row, column = np.nonzero(cuts[:, 1:] - cuts[:, :-1] > SHORTEST_PIECE)
    low, high = cuts[row, column], cuts[row, column + 1]
    middle = evaluate(subject.conic[row], 0.5 * (low + high))
    keep = (middle @ planes.T >= 0.0).all(axis=1)
    return row[keep], low[keep], high[keep]


def runs(curve: np.ndarray, low: np.ndarray, high: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and last piece (r,) int of each run of wanted pieces that touch; pieces are ordered along each curve."""
    index = np.nonzero(wanted)[0]
    before, after = index[:-1], index[1:]
    apart = (curve[after] != curve[before]) | (low[after] - high[before] > 2.0 * SHORTEST_PIECE)
    edge = np.ones(min(len(index), 1), bool)
    return index[np.concatenate([edge, apart])], index[np.concatenate([apart, edge])]


def _segment_by_segment(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(n, m): where segments a-b are crossed by segments c-d, as fractions of a-b; NaN where they are not."""
    own, other = np.cross(a, b), np.cross(c, d)
    # c-d meets the plane of the viewpoint and a-b at s; a-b meets the plane of the viewpoint and c-d at t.
    c_side, d_side = own @ c.T, own @ d.T
    a_side, b_side = a @ other.T, b @ other.T
    s, t = c_side / (c_side - d_side), a_side / (a_side - b_side)
    met = (s >= -PAST_END) & (s <= 1.0 + PAST_END) & (t >= -PAST_END) & (t <= 1.0 + PAST_END)
    # Both points lie on one ray, not one in front of the viewpoint and one behind it.
    here_c, along_c = a @ c.T, (b - a) @ c.T
    here_d, along_d = a @ d.T, (b - a) @ d.T
    same = (here_c + t * along_c) * (1.0 - s) + (here_d + t * along_d) * s > 0.0
    return np.where(met & same, t, np.nan)


def _segment_by_conic(a: np.ndarray, b: np.ndarray, others: Wires) -> np.ndarray:
    """(n, 2 c): where segments a-b are crossed by conics, as fractions of a-b."""
    n, c = len(a), len(others.conic)
    if not n or not c:
        return np.zeros((n, 0))
    angle = _plane_angles(others.conic, np.cross(a, b))
    angle = np.where(_within(angle, others), angle, np.nan)
    point = evaluate(np.repeat(others.conic, 2 * n, axis=0), angle.ravel()).reshape(c, n, 2, 3)
    direction = (b - a)[None, :, None]
    # The ray to the point meets the segment where (a + t (b - a)) x point vanishes.
    across = np.cross(np.broadcast_to(direction, point.shape), point)
    t = -(np.cross(np.broadcast_to(a[None, :, None], point.shape), point) * across).sum(-1) / (across**2).sum(-1)
    ahead = ((a[None, :, None] + t[..., None] * direction) * point).sum(-1) > 0.0
    return np.where(ahead, t, np.nan).transpose(1, 0, 2).reshape(n, 2 * c)


def _conic_by_segment(conic: np.ndarray, segment: np.ndarray) -> np.ndarray:
    """(c, 2 n): angles at which conics are crossed by segments."""
    c, n = len(conic), len(segment)
    if not n:
        return np.zeros((c, 0))
    start, end = segment[:, 0], segment[:, 1]
    angle = _plane_angles(conic, np.cross(start, end))
    point = evaluate(np.repeat(conic, 2 * n, axis=0), angle.ravel()).reshape(c, n, 2, 3)
    direction = np.broadcast_to((end - start)[None, :, None], point.shape)
    across = np.cross(direction, point)
    t = -(np.cross(np.broadcast_to(start[None, :, None], point.shape), point) * across).sum(-1) / (across**2).sum(-1)
    ahead = ((start[None, :, None] + t[..., None] * direction) * point).sum(-1) > 0.0
    met = (t >= -PAST_END) & (t <= 1.0 + PAST_END) & ahead
    return np.where(met, angle, np.nan).reshape(c, 2 * n)


def _conic_by_conic(conic: np.ndarray, others: Wires) -> np.ndarray:
    """(c, 4 m): angles at which conics are crossed by other conics."""
    c, m = len(conic), len(others.conic)
    if not c or not m:
        return np.zeros((c, 0))
    base = others.conic[:, :3]
    # A conic seen edge-on spans no cone; the ends of its image are cut by the creases that meet there.
    regular = np.abs(np.linalg.det(base)) > EDGE_ON * np.linalg.norm(base, axis=(1, 2)) ** 3
    inverse = np.linalg.inv(np.where(regular[:, None, None], base, np.eye(3)))
    cone = np.swapaxes(inverse, 1, 2) @ np.diag([1.0, 1.0, -1.0]) @ inverse
    form = np.einsum('nia,mij,njb->nmab', conic[:, :3], cone, conic[:, :3])
    angle = quadric_angles(form, np.linalg.norm(form, axis=(2, 3)) + NO_NORM)
    point = evaluate(np.repeat(conic, 4 * m, axis=0), angle.ravel()).reshape(c, m, 4, 3)
    own = np.einsum('mij,nmkj->nmki', inverse, point)
    at = np.arctan2(own[..., 1], own[..., 0])
    met = (own[..., 2] > 0.0) & regular[None, :, None] & _within(at.transpose(1, 0, 2), others).transpose(1, 0, 2)
    return np.where(met, angle, np.nan).reshape(c, 4 * m)


def _plane_angles(conic: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(c, n, 2): angles at which conics meet planes through the viewpoint, or NaN."""
    linear = np.einsum('cij,ni->cnj', conic[:, :3], normal)
    size = np.hypot(linear[..., 0], linear[..., 1])
    cosine = -linear[..., 2] / size
    half = np.arccos(np.where(np.abs(cosine) < 1.0 + PAST_END, np.clip(cosine, -1.0, 1.0), np.nan))
    phase = np.arctan2(linear[..., 1], linear[..., 0])
    return np.stack([phase + half, phase - half], axis=-1)


def _within(angle: np.ndarray, wires: Wires) -> np.ndarray:
    """(c, ...) bool: angles that lie in their conic's range."""
    shape = (-1,) + (1,) * (angle.ndim - 1)
    low, span = wires.low.reshape(shape), (wires.high - wires.low).reshape(shape)
    within: BoolArray = (angle - low + PAST_END) % (2.0 * np.pi) <= span + 2.0 * PAST_END
    return within
