"""Scores of recovered curves and axes against a CurvedView's truth: what was found, how well, and whether the stated
errors are true."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from curve_scenes import CurvedView, Rim
from stereo_scoring import SAME_ANGLE, SAME_PLACE, Score

from msgs_py import FeatureKind, FeatureSet
from stereo_recovery import Recovery

MM = 1e-3
# By how much of a rim is seen: name, least share.
SHARES = (('full', 0.95), ('most', 0.6), ('half', 0.35), ('little', 0.2))
# A recovered curve is a true one's when normal, centre and radii (shares of the true radius) are this near.
SAME_NORMAL, SAME_CENTRE, SAME_RADIUS = np.radians(10.0), 0.15, 0.12
# An axis is a true one's when its direction and its distance (metres) are this near.
SAME_AXIS, SAME_LINE = np.radians(6.0), 3.0 * MM
# A circle this large, pixels of radius, is measured on its own.
LARGE = 15.0
# Median of chi squared with 1, 2 and 3 degrees of freedom.
CHI = {1: 0.455, 2: 1.386, 3: 2.366}


@dataclass
class Calibration:
    """Errors against what was stated: whether each is inside three sigma, and the squared error in sigmas."""

    freedom: int
    inside: list[bool] = field(default_factory=list)
    squared: list[float] = field(default_factory=list)

    def add(self, inside: bool, error: np.ndarray, covariance: np.ndarray) -> None:
        self.inside.append(bool(inside))
        self.squared.append(float(error @ np.linalg.solve(covariance, error)))

    @property
    def width(self) -> float:
        """How many times too wide the stated errors are, in the median; below 1: too narrow."""
        return float(np.sqrt(CHI[self.freedom] / max(float(np.median(self.squared)), 1e-12)))


@dataclass
class Found:
    """Rims of one class of visibility: there, found, normal to the right side, and errors (deg, mm, mm)."""

    there: int = 0
    found: int = 0
    sure: int = 0
    normal: list[float] = field(default_factory=list)
    centre: list[float] = field(default_factory=list)
    radius: list[float] = field(default_factory=list)


@dataclass
class FoundAxes:
    """Axes: there, found, and errors of direction (deg) and of the end points' distance from the true line (mm)."""

    there: int = 0
    found: int = 0
    angle: list[float] = field(default_factory=list)
    across: list[float] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)


@dataclass
class CurveScore:
    """Sums over views."""

    rims: dict[str, Found] = field(default_factory=lambda: {name: Found() for name, _ in SHARES})
    axes: dict[str, FoundAxes] = field(default_factory=lambda: {name: FoundAxes() for name in ('two rims', 'one rim')})
    calibration: dict[str, Calibration] = field(
        default_factory=lambda: {'centre': Calibration(3), 'normal': Calibration(2), 'radius': Calibration(1)}
    )
    axis_inside: list[bool] = field(default_factory=list)
    edges: Score = field(default_factory=Score)
    curves: int = 0
    false_curves: int = 0
    reported_axes: int = 0
    false_axes: int = 0
    lines_on_rims: int = 0
    faint: int = 0
    large: list[float] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    # Of the view added last: true rim and reported curve; reported axis and the ends (2, 3) of the true one.
    pairs: list[tuple[int, int]] = field(default_factory=list)
    axis_pairs: list[tuple[int, np.ndarray]] = field(default_factory=list)

    def add(self, recovery: Recovery, view: CurvedView) -> None:
        features = recovery.features
        before = self.edges.right, self.edges.reported
        edges = features.of_kind(FeatureKind.EDGE)
        self.edges.add(edges, view.edges)
        self._add_faint(edges, view)
        wrong = (self.edges.reported - before[1]) - (self.edges.right - before[0])
        on_rims = _on_rims(edges.start, edges.end, view)
        self.lines_on_rims += on_rims
        if wrong:
            self.remarks.append(f'{view.name}: {wrong} false edges, {on_rims} of them on rims')
        self._add_curves(recovery, view)
        self._add_axes(recovery, view)

    def _add_faint(self, edges: FeatureSet, view: CurvedView) -> None:
        """Edges that are true but hardly stand out, in part or as a whole, are not false, and cover what they cover."""
        samples = (np.arange(200) + 0.5) / 200
        faint, plain = (np.zeros((len(view.edges), 200), bool) for _ in range(2))
        for start, end in zip(edges.start, edges.end):
            stands_out = _is_one_of(start, end, view.edges)
            if not stands_out:
                if not _is_one_of(start, end, view.seen):
                    continue
                self.edges.right += 1
                self.faint += 1
            for m, (a, b) in enumerate(view.edges):
                length = np.linalg.norm(b - a)
                line = (b - a) / length
                places = np.sort([(x - a) @ line for x in (start, end)])
                middle = 0.5 * (start + end) - a
                if (
                    abs((end - start) @ line) > np.cos(SAME_ANGLE) * np.linalg.norm(end - start)
                    and np.linalg.norm(middle - (middle @ line) * line) < SAME_PLACE
                ):
                    (plain if stands_out else faint)[m] |= (samples * length >= places[0]) & (
                        samples * length <= places[1]
                    )
        more = (faint & ~plain).mean(axis=1)
        self.edges.covered += float((np.linalg.norm(view.edges[:, 1] - view.edges[:, 0], axis=1) * more).sum())

    def _add_curves(self, recovery: Recovery, view: CurvedView) -> None:
        curves = recovery.curves
        self.curves += len(curves)
        taken: set[int] = set()
        cost = np.array([[_distance(curve, rim) for curve in curves] for rim in view.rims]).reshape(
            len(view.rims), len(curves)
        )
        # The best pairs first.
        pair = {}
        for k in np.argsort(cost, axis=None):
            i, j = np.unravel_index(k, cost.shape)
            if cost[i, j] < 1.0 and int(i) not in pair and int(j) not in taken:
                pair[int(i)] = int(j)
                taken.add(int(j))
        self.pairs = list(pair.items())
        for j, curve in enumerate(curves):
            if j not in taken:
                self.false_curves += 1
                near = cost[:, j].argmin() if len(view.rims) else -1
                self.remarks.append(
                    f'{view.name}: false curve of radii {np.round(curve.radii / MM, 2)} mm, rms '
                    f'{curve.rms:.3f} px, seen {curve.coverage:.2f}; next rim {near} at '
                    f'{cost[near, j] if near >= 0 else np.inf:.2f}'
                )
        for i, rim in enumerate(view.rims):
            name = next((n for n, least in SHARES if rim.share >= least), None)
            if name is None:
                continue
            into = self.rims[name]
            into.there += 1
            if i not in pair:
                self.remarks.append(
                    f'{view.name}: rim {i} lost: seen {rim.share:.2f}, radius {rim.pixels:.1f} px, '
                    f'squint {np.degrees(rim.squint):.0f} deg'
                )
                continue
            curve = recovery.curves[pair[i]]
            into.found += 1
            turn = float(np.degrees(np.arccos(min(1.0, abs(curve.normal @ rim.normal)))))
            into.sure += bool(curve.normal @ rim.normal > 0.0)
            into.normal.append(turn)
            if name == 'full' and rim.pixels > LARGE:
                self.large.append(turn)
            into.centre.append(float(np.linalg.norm(curve.centre - rim.centre)) / MM)
            into.radius.append(float(np.abs(curve.radii - rim.radii).max()) / MM)
            if curve.normal @ rim.normal < 0.0:
                self.remarks.append(
                    f'{view.name}: rim {i} faces the wrong way: seen {rim.share:.2f}, arc '
                    f'{np.degrees(curve.arc[1]):.0f} deg'
                )
            if turn > 1.0:
                self.remarks.append(
                    f'{view.name}: rim {i} normal off by {turn:.2f} deg: seen {rim.share:.2f}, radius '
                    f'{rim.pixels:.1f} px, squint {np.degrees(rim.squint):.0f} deg'
                )
            self._calibrate(curve, rim)

    def _calibrate(self, curve, rim: Rim) -> None:
        offset = curve.centre - rim.centre
        spread = curve.covariance
        along = abs(offset @ curve.normal) <= 3.0 * np.sqrt(curve.normal @ spread[:3, :3] @ curve.normal)
        flat = np.stack([curve.first, curve.second])
        across = np.linalg.norm(flat @ offset) <= 3.0 * np.sqrt(np.linalg.eigvalsh(flat @ spread[:3, :3] @ flat.T)[-1])
        self.calibration['centre'].add(along and across, offset, spread[:3, :3])
        true = rim.normal * np.sign(rim.normal @ curve.normal)
        # The two tilts move the normal along second and against first.
        tilt = np.array([(curve.normal - true) @ curve.second, -(curve.normal - true) @ curve.first])
        self.calibration['normal'].add(
            np.linalg.norm(tilt) <= 3.0 * np.sqrt(np.linalg.eigvalsh(spread[3:5, 3:5])[-1]), tilt, spread[3:5, 3:5]
        )
        error = np.array([curve.radii[0] - rim.radii[0]])
        self.calibration['radius'].add(abs(error[0]) <= 3.0 * np.sqrt(spread[5, 5]), error, spread[5:, 5:])

    def _add_axes(self, recovery: Recovery, view: CurvedView) -> None:
        axes = recovery.features.of_kind(FeatureKind.AXIS)
        self.reported_axes += len(axes)
        used: set[int] = set()
        self.axis_pairs = []
        for (low, high), rims in zip(view.axes, view.seen_rims):
            true = (high - low) / np.linalg.norm(high - low)
            best = None
            for k in range(len(axes)):
                ends = np.stack([axes.start[k], axes.end[k]])
                angle = np.arccos(min(1.0, abs(axes.directions[k] @ true)))
                off = np.linalg.norm(np.cross(ends - low, true), axis=1)
                # Several may lie on one line: the one between the same ends.
                apart = np.abs(np.sort((ends - low) @ true) - [0.0, np.linalg.norm(high - low)]).sum()
                if angle < SAME_AXIS and off.max() < SAME_LINE and (best is None or apart < best[4]):
                    best = (k, angle, off, ends, apart)
            if rims == 0:
                used |= {best[0]} if best else set()
                continue
            into = self.axes['two rims' if rims == 2 else 'one rim']
            into.there += 1
            if best is None:
                self.remarks.append(f'{view.name}: axis with {rims} rims in view lost')
                continue
            k, angle, off, ends, _ = best
            used.add(k)
            self.axis_pairs.append((k, np.stack([low, high])))
            into.found += 1
            into.angle.append(float(np.degrees(angle)))
            into.across.append(float(off.max()) / MM)
            if np.degrees(angle) > 0.5:
                self.remarks.append(f'{view.name}: axis with {rims} rims off by {np.degrees(angle):.2f} deg')
            inside = bool((off <= axes.err_per[k]).all())
            if rims == 2:
                places = np.sort((ends - low) @ true)
                miss = np.abs(places - [0.0, np.linalg.norm(high - low)])
                into.ends.append(float(miss.max()) / MM)
                # Part of an axis is right as well: where only one rim is seen the other end may be hidden.
                slack = axes.err_par[k]
                inside &= bool(places[0] > -slack and places[1] < np.linalg.norm(high - low) + slack)
            self.axis_inside.append(inside)
            if not inside:
                along = f', {into.ends[-1]:.3f} mm along, stated {axes.err_par[k] / MM:.3f}' if rims == 2 else ''
                self.remarks.append(
                    f'{view.name}: axis with {rims} rims off by {off.max() / MM:.3f} mm across, stated '
                    f'{axes.err_per[k] / MM:.3f}{along}'
                )
        for k in set(range(len(axes))) - used:
            self.false_axes += 1
            self.remarks.append(f'{view.name}: false axis of {1e3 * axes.lengths[k]:.1f} mm')

    @property
    def shown(self) -> tuple[int, int]:
        """Features reported (edges and curves), and how many of them are true."""
        return (self.edges.reported + self.curves, self.edges.right + self.curves - self.false_curves)


def _distance(curve, rim: Rim) -> float:
    """How unlike a recovered curve and a true rim are; below 1 they are one."""
    turn = np.arccos(min(1.0, abs(curve.normal @ rim.normal))) / SAME_NORMAL
    place = np.linalg.norm(curve.centre - rim.centre) / max(SAME_CENTRE * rim.radii[0], 1.0 * MM)
    size = np.abs(curve.radii - rim.radii).max() / max(SAME_RADIUS * rim.radii[0], 0.5 * MM)
    return float(max(turn, place, size))


def _on_rims(start: np.ndarray, end: np.ndarray, view: CurvedView) -> int:
    """How many of the edges are chords of pictures of true rims: no true edge, and both ends and the middle on one."""
    count = 0
    for a, b in zip(start, end):
        for rim in view.rims:
            if len(rim.points) < 5:
                continue
            pixels = view.rig.left.project(rim.points)
            at = view.rig.left.project(np.stack([a, 0.5 * (a + b), b]))
            near = np.linalg.norm(pixels[None] - at[:, None], axis=2).min(axis=1)
            if near.max() < 2.0 and not _is_true(a, b, view.seen):
                count += 1
                break
    return count


def _is_one_of(start: np.ndarray, end: np.ndarray, edges: np.ndarray) -> bool:
    """Whether an edge has the direction of a true one and both its ends near it, as :meth:`Score.add` has it."""
    run = edges[:, 1] - edges[:, 0]
    length = np.linalg.norm(run, axis=1)
    line = run / length[:, None]
    parallel = np.abs(line @ (end - start)) > np.cos(SAME_ANGLE) * np.linalg.norm(end - start)
    off = []
    for x in (start, end):
        away = x - edges[:, 0]
        off.append(np.linalg.norm(away - np.clip((away * line).sum(axis=1), 0.0, length)[:, None] * line, axis=1))
    return bool((parallel & (np.maximum(*off) < SAME_PLACE)).any())


def _is_true(a: np.ndarray, b: np.ndarray, edges: np.ndarray) -> bool:
    for low, high in edges:
        true = (high - low) / np.linalg.norm(high - low)
        off = np.linalg.norm(np.cross(np.stack([a, b]) - low, true), axis=1)
        if off.max() < 3.0 * MM and abs((b - a) @ true) > 0.98 * np.linalg.norm(b - a):
            return True
    return False
