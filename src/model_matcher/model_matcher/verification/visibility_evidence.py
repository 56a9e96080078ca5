"""How much of a model was found: evidence beyond coincidences.

Where the model is, more of its features are found than a pose explains by chance, and fewer are missed. Which ones,
tells how the data came about; each of two ways is as likely as the other:

    thinned   every feature is found as often as any other
    seen      of an opaque object. An edge or curve on its convex hull is in view when a face of the hull that it lies
              on looks at the eye: nothing of the object itself can hide it. Hidden ones of the hull are hardly ever
              found; what is in view of the others is not known, so they do not count

The chances say little for a single feature, because objects hide each other: what is found is found together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray

from .settings import VIEW


@njit
def _nats(found: int, missed: int, chance: float) -> float:
    """Of a chance against VIEW.by_chance."""
    nats: float = found * np.log(chance / VIEW.by_chance) + missed * np.log((1.0 - chance) / (1.0 - VIEW.by_chance))
    return nats


class InView(NamedTuple):
    """How many features of a model were found, by whether they can be in view.

    Attributes
    ----------
    all, found
        Features of the model, and of these found.
    in_view, seen
        On its hull and in view, and of these found.
    out_of_view, hidden
        On its hull and out of view, and of these found.
    """

    all: int
    found: int
    in_view: int
    seen: int
    out_of_view: int
    hidden: int


@njit
def count_in_view(motion: FloatArray, used: BoolArray, planes: FloatArray, lies: BoolArray) -> InView:
    """Count the features of a model that were found.

    Parameters
    ----------
    motion : (12,) float64
        The pose, in the frame of a camera with its eye in the origin.
    used : (e,) bool
        The model features that were found.
    planes, lies : (h, 4) float64, (h, e) bool
        Of the model, see :func:`.convex_hull.hull_faces`.

    Returns
    -------
    InView

    """
    e = len(used)
    hull, in_view = np.zeros(e, np.bool_), np.zeros(e, np.bool_)
    for h in range(planes.shape[0]):
        # The eye in the model's frame is -R^T t.
        side = planes[h, 3]
        for axis in range(3):
            side -= planes[h, axis] * (
                motion[axis] * motion[9] + motion[3 + axis] * motion[10] + motion[6 + axis] * motion[11]
            )
        for j in range(e):
            hull[j] |= lies[h, j]
            in_view[j] |= lies[h, j] and side > 0.0
    out = hull & ~in_view
    return InView(
        e, int(used.sum()), int(in_view.sum()), int((in_view & used).sum()), int(out.sum()), int((out & used).sum())
    )


@njit
def nats_of_view(counts: InView) -> float:
    """Nats for which features of a model were found, and which were not."""
    of_view = _nats(counts.seen, counts.in_view - counts.seen, VIEW.seen)
    of_view += counts.hidden * np.log(VIEW.hidden / VIEW.by_chance)
    thinned = _nats(counts.found, counts.all - counts.found, VIEW.thinned)
    most = max(thinned, of_view)
    nats: float = most + np.log(0.5 * (np.exp(thinned - most) + np.exp(of_view - most)))
    return nats
