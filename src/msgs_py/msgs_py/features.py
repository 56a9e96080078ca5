"""Matching features: straight edges, planar curves and axes, as a record of arrays.

The same type carries a model's features (exact, uncertainty zero), the features recovered from a stereo pair,
and the true features of a rendered scene.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ._checks import as_finite, as_shaped
from .files import load_arrays
from .numeric.covariances import as_covariances, known_covariances, pair_variances, semidefinite
from .numeric.typed import AnyArray, BoolArray, ByteArray, FloatArray
from .numeric.vectors import farthest_axis
from .pose import Pose
from .settings import BOUND_SIGMA

# Start and sweep of a whole curve, radians.
FULL_ARC = (0.0, 2.0 * np.pi)
# Arrays of a FeatureSet, in the order of its arguments; a file may lack the last four.
FIELDS = ('kind', 'start', 'end', 'radii', 'err_par', 'err_per', 'major_axis', 'arc', 'covariance', 'common')


class FeatureKind(IntEnum):
    """What a feature is.

    Attributes
    ----------
    EDGE : int
        A straight crease.
    CURVE : int
        A circle or an ellipse, or an arc of one.
    AXIS : int
        The line about which a cylinder or a cone is round.
    """

    EDGE = 0
    CURVE = 1
    AXIS = 2


@dataclass(frozen=True, eq=False)
class FeatureSet:
    """n features; every array has one row a feature.

    Parameters
    ----------
    kind : (n,) uint8
        FeatureKind.
    start, end : (n, 3) float64
        Metres. EDGE: its end points, in no particular order. CURVE: start is the centre and end - start the unit normal
        of its plane (outward where known). AXIS: the centres of the planar ends (cone: apex to base centre).
    radii : (n, 2) float64
        Major and minor radius of a CURVE, metres; NaN otherwise.
    err_par, err_per : (n,) float64
        Uncertainty of the end points along and across, metres, three sigma; 0 for a model. Where there is a covariance
        they follow from it, whatever is given: of an EDGE the quadratic mean of both ends, of an AXIS the larger, of a
        CURVE its centre along the normal and across it; across where it is largest.
    major_axis : (n, 3) float64, optional
        Unit direction of a CURVE's major radius, in its plane; NaN where unknown or no CURVE.
    arc : (n, 2) float64, optional
        Radians: where the visible arc of a CURVE starts, from major_axis about the normal, and how far it runs (2 pi:
        the whole curve); NaN when not a CURVE. From 0 when major_axis is unknown.
    covariance : (n, 6, 6) float64, optional
        Of both ends of an EDGE or AXIS, start's x, y, z and end's, square metres: how each end is off, and how the two
        are off together. Of a CURVE: of its centre and of the unit normal, end - start (which has no unit). NaN
        throughout where it is not known, and of a model.
    common : (n, 6) float64, optional
        How one sigma of an error that all features have in common moves both ends (of a CURVE: its centre and normal),
        as a covariance has them; that of cameras that are not quite where they are said to be. Where there is a
        covariance, it is part of it. 0 where there is none.

    Raises
    ------
    ValueError
        Names the array, when shapes disagree or a needed value is not finite.

    References
    ----------
    Thesis 5.4 (the uncertainties).

    Examples
    --------
    >>> edges = FeatureSet.from_edges(start=[[0, 0, 0.5]], end=[[0.1, 0, 0.5]], err_par=0.001, err_per=0.0005)
    >>> rim = FeatureSet.from_curves(centre=[[0, 0, 0.5]], normal=[[0, 0, -1]], radii=0.02)
    >>> FeatureSet.concatenate([edges, rim])
    FeatureSet(1 EDGE, 1 CURVE, 0 AXIS)
    >>> edges.lengths
    array([0.1])
    """

    kind: ByteArray
    start: FloatArray
    end: FloatArray
    radii: FloatArray
    err_par: FloatArray
    err_per: FloatArray
    major_axis: FloatArray = None  # type: ignore[assignment]
    arc: FloatArray = None  # type: ignore[assignment]
    covariance: FloatArray = None  # type: ignore[assignment]
    common: FloatArray = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        kind = np.array(self.kind)
        if kind.ndim != 1:
            raise ValueError(f'kind: expected shape (n,), got {kind.shape}')
        n = len(kind)
        if n and not np.isin(kind, [int(k) for k in FeatureKind]).all():
            raise ValueError(f'kind: expected 0 (EDGE), 1 (CURVE) or 2 (AXIS), got {np.unique(kind)}')
        kind = kind.astype(np.uint8)
        curve = kind == FeatureKind.CURVE
        arrays: dict[str, AnyArray] = {
            'kind': kind,
            'start': as_finite('start', _rows(self.start, n, 3), (n, 3)),
            'end': as_finite('end', _rows(self.end, n, 3), (n, 3)),
            'radii': as_shaped('radii', _rows(self.radii, n, 2), (n, 2)),
            'err_par': as_finite('err_par', _each(self.err_par, n), (n,)),
            'err_per': as_finite('err_per', _each(self.err_per, n), (n,)),
        }
        if (arrays['err_par'] < 0).any() or (arrays['err_per'] < 0).any():
            raise ValueError('err_par, err_per: expected distances >= 0')
        if curve.any() and not (arrays['radii'][curve] > 0).all():
            raise ValueError('radii: a CURVE needs two finite radii > 0')
        arrays['radii'][~curve] = np.nan
        if self.major_axis is None:
            arrays['major_axis'] = np.full((n, 3), np.nan)
        else:
            arrays['major_axis'] = as_shaped('major_axis', _rows(self.major_axis, n, 3), (n, 3))
        if self.arc is None:
            arrays['arc'] = np.where(curve[:, None], FULL_ARC, np.nan)
        else:
            arrays['arc'] = as_shaped('arc', _rows(self.arc, n, 2), (n, 2))
        if self.covariance is None:
            arrays['covariance'] = np.full((n, 6, 6), np.nan)
        else:
            arrays['covariance'] = as_covariances('covariance', self.covariance, n)
            known = known_covariances(arrays['covariance'])
            bounds = _bounds(*(arrays[name][known] for name in ('kind', 'start', 'end', 'covariance')))
            arrays['err_par'][known], arrays['err_per'][known] = bounds
        if self.common is None:
            arrays['common'] = np.zeros((n, 6))
        else:
            arrays['common'] = as_finite('common', _rows(self.common, n, 6), (n, 6))
        self._hold(arrays)

    def _hold(self, arrays: dict[str, AnyArray]) -> None:
        """Hold arrays that are known to make a set, of every one of FIELDS."""
        for name, array in arrays.items():
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    # -- making ------------------------------------------------------------------------------------------------

    @classmethod
    def empty(cls) -> FeatureSet:
        """No feature at all."""
        return cls.from_edges(np.zeros((0, 3)), np.zeros((0, 3)))

    @classmethod
    def from_edges(
        cls,
        start: ArrayLike,
        end: ArrayLike,
        err_par: ArrayLike = 0.0,
        err_per: ArrayLike = 0.0,
        covariance: ArrayLike | None = None,
    ) -> FeatureSet:
        """Straight edges from their end points.

        Parameters
        ----------
        start, end : (n, 3) array_like of float64
            Metres, any frame.
        err_par, err_per : () or (n,) array_like of float64
            Uncertainty of the end points along and across, metres.
        covariance : (n, 6, 6) array_like of float64, optional
            Of start and end, square metres; err_par and err_per follow from it.
        """
        start = np.asarray(start, dtype=np.float64).reshape(-1, 3)
        n = len(start)
        return cls(
            np.full(n, FeatureKind.EDGE, np.uint8),
            start,
            np.asarray(end),
            np.full((n, 2), np.nan),
            np.asarray(err_par),
            np.asarray(err_per),
            covariance=covariance,  # type: ignore[arg-type]
        )

    @classmethod
    def from_curves(
        cls,
        centre: ArrayLike,
        normal: ArrayLike,
        radii: ArrayLike,
        err_par: ArrayLike = 0.0,
        err_per: ArrayLike = 0.0,
        major_axis: ArrayLike | None = None,
        arc: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
    ) -> FeatureSet:
        """Planar curves from their centres, normals and radii.

        Parameters
        ----------
        centre : (n, 3) array_like of float64
            Metres, any frame.
        normal : (n, 3) array_like of float64
            Normals of their planes, of any length but zero.
        radii : (n, 2), (n,) or () array_like of float64
            Major and minor radius, or the radius of circles, metres.
        err_par, err_per : () or (n,) array_like of float64
            Uncertainty along and across, metres.
        major_axis : (n, 3) array_like of float64, optional
            Unit directions of the major radii.
        arc : (n, 2) array_like of float64, optional
            Start and sweep, radians; the whole curve when it is not given.
        covariance : (n, 6, 6) array_like of float64, optional
            Of the centre (metres) and the unit normal; err_par and err_per follow from it.

        Raises
        ------
        ValueError
            For a normal of length zero, and as the class does.
        """
        centre = np.asarray(centre, dtype=np.float64).reshape(-1, 3)
        normal = np.asarray(normal, dtype=np.float64).reshape(-1, 3)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        if (length == 0.0).any():
            raise ValueError('normal: a curve has a normal of length zero')
        radii = np.asarray(radii, dtype=np.float64)
        if radii.ndim < 2:
            radii = np.repeat(np.broadcast_to(radii, (len(centre),))[:, None], 2, axis=1)
        return cls(
            np.full(len(centre), FeatureKind.CURVE, np.uint8),
            centre,
            centre + normal / length,
            radii,
            err_par,  # type: ignore[arg-type]
            err_per,  # type: ignore[arg-type]
            major_axis,  # type: ignore[arg-type]
            arc,  # type: ignore[arg-type]
            covariance,  # type: ignore[arg-type]
        )

    @classmethod
    def from_axes(
        cls,
        start: ArrayLike,
        end: ArrayLike,
        err_par: ArrayLike = 0.0,
        err_per: ArrayLike = 0.0,
        covariance: ArrayLike | None = None,
    ) -> FeatureSet:
        """Axes from their end points; the parameters are those of :meth:`from_edges`."""
        edges = cls.from_edges(start, end, err_par, err_per, covariance)
        return replace(edges, kind=np.full(len(edges), FeatureKind.AXIS, np.uint8))

    @classmethod
    def concatenate(cls, sets: Iterable[FeatureSet]) -> FeatureSet:
        """All features of several sets, in their order."""
        sets = list(sets)
        if not sets:
            return cls.empty()
        return cls(*(np.concatenate([getattr(s, name) for s in sets]) for name in FIELDS))

    # -- reading -----------------------------------------------------------------------------------------------

    def __reduce__(self) -> tuple[type[FeatureSet], tuple[AnyArray, ...]]:
        """Pickled by its arrays, which are read-only again afterwards: compiled functions take them as another type."""
        return type(self), tuple(getattr(self, one.name) for one in fields(self))

    def __len__(self) -> int:
        return len(self.kind)

    @property
    def vectors(self) -> FloatArray:
        """From start to end, (n, 3) float64, metres."""
        return self.end - self.start

    @property
    def lengths(self) -> FloatArray:
        """Lengths, (n,) float64, metres (1 for a CURVE, whose normal is a unit vector)."""
        lengths: FloatArray = np.linalg.norm(self.vectors, axis=1)
        return lengths

    @property
    def directions(self) -> FloatArray:
        """Unit vectors from start to end, (n, 3) float64; zeros where the length is zero."""
        lengths = self.lengths[:, None]
        unit: FloatArray = np.divide(self.vectors, lengths, out=np.zeros_like(self.start), where=lengths > 0.0)
        return unit

    @property
    def midpoints(self) -> FloatArray:
        """The middle of an EDGE or AXIS, the centre of a CURVE, (n, 3) float64, metres."""
        middle = 0.5 * (self.start + self.end)
        return np.where((self.kind == FeatureKind.CURVE)[:, None], self.start, middle)

    @property
    def has_covariance(self) -> BoolArray:
        """(n,) bool: whose covariance is known."""
        return known_covariances(self.covariance)

    @property
    def start_covariance(self) -> FloatArray:
        """Of start, (n, 3, 3) float64, square metres; NaN where it is not known."""
        return self.covariance[:, :3, :3]

    @property
    def end_covariance(self) -> FloatArray:
        """Of end, (n, 3, 3) float64, square metres; of the unit normal of a CURVE; NaN where it is not known."""
        return self.covariance[:, 3:, 3:]

    @property
    def direction_covariance(self) -> FloatArray:
        """Of the unit vector from start to end, (n, 3, 3) float64, square radians; NaN where it is not known."""
        c = self.covariance
        of_vector = c[:, :3, :3] + c[:, 3:, 3:] - c[:, :3, 3:] - c[:, 3:, :3]
        of_vector = np.where((self.kind == FeatureKind.CURVE)[:, None, None], self.end_covariance, of_vector)
        u = self.directions
        across = np.eye(3) - u[:, :, None] * u[:, None, :]
        with np.errstate(divide='ignore', invalid='ignore'):
            return np.asarray(across @ of_vector @ across / self.lengths[:, None, None] ** 2)

    def of_kind(self, kind: FeatureKind) -> FeatureSet:
        """The features of one kind."""
        return self.select(self.kind == kind)

    def select(self, mask: ArrayLike) -> FeatureSet:
        """Some of the features.

        Parameters
        ----------
        mask : (n,) array_like of bool, or array_like of int
            Which to take, or their indices, in the order wanted.

        Raises
        ------
        ValueError
            For a mask of another shape.
        """
        mask = np.asarray(mask)
        if mask.ndim != 1:
            raise ValueError(f'mask: expected shape (n,), got {mask.shape}')
        if mask.dtype != bool:
            mask = mask.astype(np.intp)
        # Some of what has been looked at need not be looked at again.
        some = object.__new__(FeatureSet)
        some._hold({name: getattr(self, name)[mask] for name in FIELDS})
        return some

    def transformed(self, pose: Pose) -> FeatureSet:
        """The features in another frame: ``camera = model.transformed(camera_T_model)``.

        Parameters
        ----------
        pose : Pose
            target_T_source; radii, uncertainties and covariances follow its scale.
        """
        start, turn = pose.apply(self.start), self._turn_of_ends(pose)
        curve = self.kind == FeatureKind.CURVE
        end = np.where(curve[:, None], start + pose.rotate(self.vectors), pose.apply(self.end))
        return FeatureSet(
            self.kind,
            start,
            end,
            self.radii * pose.scale,
            self.err_par * pose.scale,
            self.err_per * pose.scale,
            pose.rotate(self.major_axis),
            self.arc,
            turn @ self.covariance @ turn.swapaxes(1, 2) if self.has_covariance.any() else None,  # type: ignore[arg-type]
            (turn @ self.common[:, :, None])[:, :, 0],
        )

    def _turn_of_ends(self, pose: Pose) -> FloatArray:
        """(n, 6, 6) that takes errors to the frame that a pose leads to; unit normals keep their length."""
        turn = np.zeros((len(self), 6, 6))
        turn[:, :3, :3] = pose.scale * pose.rotation
        of_end = np.where(self.kind == FeatureKind.CURVE, 1.0, pose.scale)
        turn[:, 3:, 3:] = of_end[:, None, None] * pose.rotation
        return turn

    def with_common(self, common: ArrayLike) -> FeatureSet:
        """The features with an error besides that they have in common, and had none before.

        Parameters
        ----------
        common : (n, 6) array_like of float64
            See the class.
        """
        common = as_finite('common', common, (len(self), 6))
        added = common[:, :, None] * common[:, None, :]
        return replace(self, covariance=self.covariance + added, common=common)

    @cached_property
    def alone(self) -> FeatureSet:
        """The features with what each is off by itself: without what they have in common."""
        if not self.common.any():
            return self
        known = self.has_covariance
        covariance = self.covariance - self.common[:, :, None] * self.common[:, None, :]
        covariance[known] = semidefinite(covariance[known])
        return replace(self, covariance=covariance, common=np.zeros_like(self.common))

    @property
    def moved_in_common(self) -> FeatureSet:
        """The features, one sigma of what they have in common off."""
        curve = (self.kind == FeatureKind.CURVE)[:, None]
        by_start, by_end = self.common[:, :3], self.common[:, 3:]
        return replace(self, start=self.start + by_start, end=self.end + by_end + np.where(curve, by_start, 0.0))

    def polyline(self, index: int, samples: int = 64) -> FloatArray:
        """One feature as points to draw.

        Parameters
        ----------
        index : int
            Which feature.
        samples : int
            Points of a CURVE.

        Returns
        -------
        (m, 3) float64
            Metres; 2 points for an EDGE or AXIS, ``samples`` for a CURVE.
        """
        if self.kind[index] != FeatureKind.CURVE:
            return np.stack([self.start[index], self.end[index]])
        normal = self.directions[index]
        first = self.major_axis[index]
        if not np.isfinite(first).all():
            # Any direction in the plane will do for a circle: the coordinate axis farthest from the normal.
            first = farthest_axis(normal)
        first = first - normal * (first @ normal)
        first /= np.linalg.norm(first)
        angle = self.arc[index, 0] + np.linspace(0.0, 1.0, samples) * self.arc[index, 1]
        major, minor = self.radii[index]
        points: FloatArray = (
            self.start[index]
            + major * np.cos(angle)[:, None] * first
            + minor * np.sin(angle)[:, None] * np.cross(normal, first)
        )
        return points

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, FeatureSet):
            return NotImplemented
        return all(
            np.array_equal(getattr(self, name), getattr(other, name), equal_nan=name != 'kind') for name in FIELDS
        )

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        counts = ', '.join(f'{(self.kind == kind).sum()} {kind.name}' for kind in FeatureKind)
        return f'FeatureSet({counts})'

    # -- files -------------------------------------------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Write a .npz file with one array for each field."""
        fields: dict[str, Any] = {name: getattr(self, name) for name in FIELDS}
        if not self.has_covariance.any():
            del fields['covariance']
        if not self.common.any():
            del fields['common']
        with open(path, 'wb') as file:
            np.savez_compressed(file, **fields)

    @classmethod
    def load(cls, path: str | Path) -> FeatureSet:
        """Read a file written by :meth:`save`.

        Raises
        ------
        FileNotFoundError
        ValueError
            Names the file, when it is no such file.
        """
        try:
            arrays = load_arrays(path)
            missing = [name for name in FIELDS[:6] if name not in arrays]
            if missing:
                raise ValueError(f'no array named {missing[0]!r}')
            return cls(**{name: arrays.get(name) for name in FIELDS})  # type: ignore[arg-type]
        except FileNotFoundError:
            raise
        except Exception as error:  # numpy raises half a dozen types for a damaged archive
            raise ValueError(f'{path}: not a feature file: {error}') from error


def _bounds(
    kind: ByteArray, start: FloatArray, end: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """err_par, err_per (n,), metres, of features whose covariances are known, as the class states them."""
    along, across = pair_variances(start, end, covariance)
    curve, axis = kind == FeatureKind.CURVE, kind == FeatureKind.AXIS
    of_edge = (0.5 * (both[:, 0] + both[:, 1]) for both in (along, across))
    par, per = (
        np.where(curve, both[:, 0], np.where(axis, both.max(axis=1), mean))
        for both, mean in zip((along, across), of_edge)
    )
    return BOUND_SIGMA * np.sqrt(par), BOUND_SIGMA * np.sqrt(per)


def _rows(array: ArrayLike, n: int, columns: int) -> FloatArray:
    """An empty list stands for zero rows of any width."""
    array = np.asarray(array, dtype=np.float64)
    return array.reshape(n, columns) if array.size == 0 and n == 0 else array


def _each(values: ArrayLike, n: int) -> FloatArray:
    """One number stands for n of them."""
    array = np.asarray(values, dtype=np.float64)
    return np.full(n, array) if array.shape in ((), (1,)) else array
