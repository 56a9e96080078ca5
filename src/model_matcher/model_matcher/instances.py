"""Which object of the last messages is which of this one: names that stay with an object while it is seen.

An object is the one whose last pose is nearest, in sigmas of both poses and of what it may have moved since; poses
that a symmetry of the model makes equal are one, and where what was seen does not tell which pose an object has, any of
them may be it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from msgs_py import Interpretation
from msgs_py.node_runtime.settings import NANOSECONDS
from msgs_py.numeric.robust import OUTLYING
from msgs_py.numeric.spatial import rotations as spatial_rotations
from msgs_py.numeric.typed import FloatArray

from .model.equal_poses import at_point, equal_motions
from .model.index import ModelIndex
from .model.settings import EXACT, SAME


@dataclass(frozen=True, eq=False)
class _Seen:
    """An object and where it was last: interpretation, and stamp in nanoseconds."""

    name: str
    last: Interpretation
    stamp: int


class Instances:
    """The objects that were seen, by name: the model's and a number that is not given twice.

    Examples
    --------
    >>> from msgs_py import FeatureSet, Pose
    >>> from .model.index import index_model
    >>> rod = index_model(FeatureSet.from_edges([[0, 0, 0]], [[0, 0, 0.1]]), 'rod')
    >>> here, there = (Interpretation('rod', [0], [1], Pose(np.eye(3), [x, 0, 1])) for x in (0.0, 0.2))
    >>> seen = Instances()
    >>> seen.names(0, [here], {'rod': rod}, 0.1), seen.names(10**8, [there, here], {'rod': rod}, 0.1)
    (['rod/1'], ['rod/2', 'rod/1'])
    """

    def __init__(self) -> None:
        self._seen: list[_Seen] = []
        self._count: dict[str, int] = {}
        self._stamp = 0

    def names(
        self, stamp: int, found: Sequence[Interpretation], models: Mapping[str, ModelIndex], speed: float
    ) -> list[str]:
        """The names of what was found in a message.

        An object that is not seen keeps its name until it may have moved as far as it is large. When the clock is set
        back, all are forgotten.

        Parameters
        ----------
        stamp : int
            Nanoseconds.
        found : sequence of Interpretation
        models : mapping of str to ModelIndex
            By name.
        speed : float
            Metres a second: sigma of the speed of any point of an object, in the camera's frame.

        Returns
        -------
        list of str
            One for each.
        """
        if stamp < self._stamp:
            self._seen.clear()
        self._stamp = stamp
        moved = [speed * (stamp - one.stamp) / NANOSECONDS for one in self._seen]
        distances = sorted(
            (min(deviation(models[new.model], a, b, moved[k]) for a, b in product(_at(new), _at(old.last))), i, k)
            for i, new in enumerate(found)
            for k, old in enumerate(self._seen)
            if old.last.model == new.model
        )
        names: dict[int, str] = {}
        for distance, i, k in distances:
            if distance < OUTLYING[6] and i not in names and self._seen[k].name not in names.values():
                names[i] = self._seen[k].name
        for i, new in enumerate(found):
            if i not in names:
                self._count[new.model] = self._count.get(new.model, 0) + 1
                names[i] = f'{new.model}/{self._count[new.model]}'
        taken = set(names.values())
        unseen = [
            old
            for old, way in zip(self._seen, moved)
            if old.name not in taken and old.last.model in models and way < models[old.last.model].size
        ]
        self._seen = [*unseen, *(_Seen(names[i], new, stamp) for i, new in enumerate(found))]
        return [names[i] for i in range(len(found))]

    @property
    def remembered(self) -> list[str]:
        """The names that are not forgotten."""
        return [one.name for one in self._seen]

    def clear(self) -> None:
        """Forget where objects were; numbers go on."""
        self._seen.clear()
        self._stamp = 0


def _at(found: Interpretation) -> list[Interpretation]:
    """An interpretation at each pose that it may have."""
    return [found, *(replace(found, pose=pose, ambiguous_poses=()) for pose in found.ambiguous_poses)]


def deviation(index: ModelIndex, new: Interpretation, old: Interpretation, moved: float) -> float:
    """How far two sightings are apart, whichever of the equal poses each has.

    Parameters
    ----------
    index : ModelIndex
        Of the model of both.
    new, old : Interpretation
        Of one that states no covariance the pose counts as known to what makes two poses the same.
    moved : float
        Metres: sigma of how far any point of it may have moved between them.

    Returns
    -------
    float
        Squared Mahalanobis distance, six degrees of freedom.
    """
    at = new.pose.apply(index.middle)
    free = at_point(_spread(index, new), at - new.pose.translation)
    free += np.diag(np.repeat([moved**2 + (EXACT * index.size) ** 2, (2.0 * moved / index.size) ** 2 + EXACT**2], 3))
    rotations, translations = equal_motions(index, old.pose.rotation, new.pose.rotation)
    turned = old.pose.rotation @ rotations
    arms = old.pose.scale * (translations @ old.pose.rotation.T + turned @ index.middle)
    turns = spatial_rotations().from_matrix(new.pose.rotation @ turned.swapaxes(1, 2)).as_rotvec()
    errors = np.concatenate([at - old.pose.translation - arms, turns], axis=1)
    spreads = free + at_point(_spread(index, old), arms)
    squares = (errors * np.linalg.solve(spreads, errors[:, :, None])[:, :, 0]).sum(axis=1)
    return float(squares.min())


def _spread(index: ModelIndex, found: Interpretation) -> FloatArray:
    """The covariance of a pose; where it is not stated, that of poses that count as the same."""
    if found.covariance is not None:
        return found.covariance
    return np.diag(np.repeat([(SAME * index.size) ** 2, (2.0 * SAME) ** 2], 3))
