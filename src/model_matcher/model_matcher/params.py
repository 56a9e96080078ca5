"""Parameters and result of a match."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from msgs_py import FeatureSet, Interpretation
from msgs_py.renaming import without_effect

if TYPE_CHECKING:
    from .image_pose.measurement import Presence

SEARCHES = ('hypotheses', 'tree', 'subgraph', 'serial')
ENGINES = ('native', 'dap')
ORDERINGS = ('combined', 'holder_buxton', 'consistency', 'consistency_grouped', 'curves_first', 'worst')
CONSTRAINTS = ('distance', 'angle', 'direction1', 'direction2', 'direction3')
SCALES = ('known', 'free')
RANGES = ('exact', 'corners')
REAL_BYTES = (4, 8)


@dataclass(frozen=True)
class MatchParams:
    """How to match.

    Parameters
    ----------
    search : str
        'hypotheses' (pair hypotheses and back-projection, the default), or a search of the thesis: 'tree' (look-up
        tables, sorted), 'subgraph' (the same by quadrants) or 'serial' (Grimson and Lozano-Perez).
    engine : str
        'native', or 'dap': the tree, or its search by quadrants, on the emulated array machine.
    ordering : str
        Of the data pairs in a tree search (thesis 5.7.1).
    constraints : tuple of str
        Any of the five pairwise constraints of a tree search (thesis 5.5).
    signs : bool
        Whether a tree search keeps direction signs consistent (thesis 5.7.2).
    max_cone_deg : float
        Degrees, cap of a direction's error cone (thesis 5.4).
    curve_cone_deg : float
        Degrees, the cone of a curve's normal (thesis 6.5).
    fracdev : float
        A data end point must lie within this times the largest distance between model vertices of its model feature,
        its own stated error taken in as well: the quadratic sum of both (thesis 5.6 takes the larger).
    curvedev : float
        The same for radii, as a fraction of the largest model radius (thesis 6.7).
    err_scale : float
        Stated errors are multiplied by this before use.
    overhang : float
        How far, as a fraction of its length, an edge may run past its model edge's end.
    max_bin : int, optional
        Largest number of data features that a tree search leaves unmatched (thesis 5.10); None: any number.
    quadrant : int
        Side of the quadrants of search='subgraph', model features (thesis 5.8). With engine='dap' the whole machine is
        best: 32.
    max_interpretations : int
        Most interpretations that are returned.
    min_matched : int
        An interpretation with fewer distinct model features is rejected.
    false_alarm_rate : float
        Nominal share of scenes in which an absent model is reported. Measured shares differ by kind of clutter: less
        among random objects, several times more among objects that share dimensions with the model (README). Below
        1e-12 counts as 1e-12; 1 accepts whatever has min_matched features.
    scale : str
        'known' (stereo) or 'free' (structure from motion: directions only, the scale is estimated).
    prove : bool
        Certify that no pose explains more data features within the tolerances, or, where nothing is accepted, as many
        as ``min_matched`` (docs/proof.md states it exactly, and shows why).
    time_limit_s : float
        Seconds, of all models and instances together; then the best so far is returned, unproven.
    seed : int
        Deprecated: accepted, and without effect. Nothing in a match is random.
    eliminate : bool
        Whether a tree search leaves out beforehand what cannot be part of an interpretation of the size looked for (the
        future work of thesis 7.4); without it the search is the thesis' own.
    ranges : str
        Of a tree search's constraints: 'exact', which prunes no true pairing, or 'corners', the thesis' own, from end
        points alone (thesis 5.5).
    real_bytes : int
        Word length of REAL on the array machine, 4 or 8; for engine='dap'.

    Raises
    ------
    ValueError
        Naming the parameter.

    Examples
    --------
    >>> MatchParams(fracdev=0.02).fracdev
    0.02
    >>> MatchParams(search='guess')
    Traceback (most recent call last):
        ...
    ValueError: search: expected one of hypotheses, tree, subgraph, serial; got 'guess'
    """

    search: str = 'hypotheses'
    engine: str = 'native'
    ordering: str = 'combined'
    constraints: tuple[str, ...] = CONSTRAINTS
    signs: bool = True
    max_cone_deg: float = 15.0
    curve_cone_deg: float = 15.0
    fracdev: float = 0.012
    curvedev: float = 0.1
    err_scale: float = 1.0
    overhang: float = 0.04
    max_bin: int | None = None
    quadrant: int = 16
    max_interpretations: int = 8
    min_matched: int = 4
    false_alarm_rate: float = 1e-3
    scale: str = 'known'
    prove: bool = False
    time_limit_s: float = 10.0
    seed: int = 0
    eliminate: bool = True
    ranges: str = 'exact'
    real_bytes: int = 8

    def __post_init__(self) -> None:
        if self.seed:
            warnings.warn(without_effect('MatchParams: argument', 'seed'), FutureWarning, stacklevel=3)
        choices: tuple[Any, ...]
        for name, choices in (
            ('search', SEARCHES),
            ('engine', ENGINES),
            ('ordering', ORDERINGS),
            ('scale', SCALES),
            ('ranges', RANGES),
            ('real_bytes', REAL_BYTES),
        ):
            if getattr(self, name) not in choices:
                raise ValueError(f'{name}: expected one of {", ".join(map(str, choices))}; got {getattr(self, name)!r}')
        constraints = (self.constraints,) if isinstance(self.constraints, str) else tuple(self.constraints)
        for constraint in constraints:
            if constraint not in CONSTRAINTS:
                raise ValueError(f'constraints: expected any of {", ".join(CONSTRAINTS)}; got {constraint!r}')
        object.__setattr__(self, 'constraints', constraints)
        if self.engine == 'dap' and self.search not in ('tree', 'subgraph'):
            raise ValueError(f"engine: 'dap' runs search='tree' and 'subgraph' only, got search={self.search!r}")
        for name, low, high in (
            ('max_cone_deg', 0.0, 90.0),
            ('curve_cone_deg', 0.0, 90.0),
            ('fracdev', 0.0, 1.0),
            ('curvedev', 0.0, 10.0),
            ('err_scale', 0.0, 1e6),
            ('overhang', 0.0, 1.0),
            ('false_alarm_rate', 0.0, 1.0),
            ('time_limit_s', 0.0, np.inf),
        ):
            value = getattr(self, name)
            if not isinstance(value, (int, float, np.number)) or not low <= float(value) <= high:
                raise ValueError(f'{name}: expected a number from {low:g} to {high:g}, got {value!r}')
        for name, low in (('max_interpretations', 1), ('min_matched', 1), ('quadrant', 2)):
            if int(getattr(self, name)) != getattr(self, name) or getattr(self, name) < low:
                raise ValueError(f'{name}: expected a whole number >= {low}, got {getattr(self, name)!r}')
        if self.max_bin is not None and self.max_bin < 0:
            raise ValueError(f'max_bin: expected None or a number >= 0, got {self.max_bin}')

    def replace(self, **changes: Any) -> MatchParams:
        """A copy with some parameters changed.

        Examples
        --------
        >>> MatchParams().replace(prove=True).prove
        True
        """
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        unknown = set(changes) - set(values)
        if unknown:
            raise ValueError(f'{sorted(unknown)[0]}: no such parameter')
        return MatchParams(**{**values, **changes})


@dataclass(frozen=True)
class MatchResult:
    """What a match found; true when something was accepted.

    Attributes
    ----------
    interpretations : tuple of Interpretation
        Accepted ones, best first.
    rejected : tuple of Interpretation
        Further hypotheses, best first, each with its rejected_reason.
    stats : dict
        Counters and seconds of the search, by name.
    reason : str, optional
        None when something was accepted, otherwise why nothing was.
    outlines : tuple of Presence
        What the images show of each accepted interpretation (:mod:`.image_pose.measurement`); empty without images.
    absent : bool
        Nothing was accepted, and with ``prove`` it is certified that no pose explains as many data features as
        ``min_matched`` within the tolerances.
    """

    interpretations: tuple[Interpretation, ...]
    rejected: tuple[Interpretation, ...] = ()
    stats: dict[str, Any] = field(default_factory=dict)
    reason: str | None = None
    outlines: tuple[Presence, ...] = ()
    absent: bool = False

    @property
    def best(self) -> Interpretation | None:
        """The first accepted interpretation, or None."""
        return self.interpretations[0] if self.interpretations else None

    def __bool__(self) -> bool:
        return bool(self.interpretations)


def no_match(data: FeatureSet, reason: str, **stats: Any) -> MatchResult:
    """The result of a match that found nothing, with its reason and statistics."""
    return MatchResult((), (), {'data_features': len(data), **stats}, reason)
