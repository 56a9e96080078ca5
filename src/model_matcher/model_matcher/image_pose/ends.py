"""Whether edges end where the model's do: a likelihood ratio of how many go on past the ends of the outline's curves.

An edge of the object stops at a corner of it. What is taken for one may be longer: the line of a board's squares that a
block's edge was laid on, the side of a larger object. Past each end that the images confirm, in the direction of the
curve, it is looked for there; where the outline itself passes, nothing is said.
"""

from __future__ import annotations

import math

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int8Array, Int32Array

from .alignment import Placed
from .counts import beta_binomial
from .finding import Pictures, steps_about
from .neighbours import beside_box, curve_boxes, own_step
from .presence import confirmations
from .settings import ENDS_OF_OTHERS, ENDS_OF_OWN, ON_EDGE, PAST_END, REACH


@njit(nogil=True)
def past_ends(
    placed: Placed, spacing: FloatArray, found: Int8Array, is_bent: BoolArray
) -> tuple[Int32Array, FloatArray]:
    """Points past the ends of an outline's straight curves, len(PAST_END) past each, those of an end together.

    Parameters
    ----------
    placed : Placed
        n points.
    spacing : (n,) float64
        Pixels of the outline that each stands for.
    found : (n,) int8
        Which are confirmed, see :func:`.presence.confirmations`. Past an end whose two last points are not, nothing is
        looked for: something may stand before it.
    is_bent : (c,) bool
        See :func:`.presence.bent`.

    Returns
    -------
    end : (m,) int32
        Of each the point of the outline that is the end.
    pixel : (m, 2) float64
    """
    begin, box = curve_boxes(placed)
    most = 2 * len(PAST_END) * len(box)
    end, pixel = np.empty(most, np.int32), np.empty((most, 2))
    m = 0
    for c in range(len(box)):
        first, last = begin[c], begin[c + 1] - 1
        if last == first or is_bent[placed.curve[first]]:
            continue
        for at_last in range(2):
            k, before = (last, last - 1) if at_last else (first, first + 1)
            if found[k] != 1 or found[before] != 1:
                continue
            du, dv = -placed.normal[k, 1], placed.normal[k, 0]
            back_u, back_v = placed.pixel[before, 0] - placed.pixel[k, 0], placed.pixel[before, 1] - placed.pixel[k, 1]
            way = -1.0 if du * back_u + dv * back_v > 0.0 else 1.0
            alone = True
            for j, beyond in enumerate(PAST_END):
                pixel[m + j, 0] = placed.pixel[k, 0] + way * beyond * du
                pixel[m + j, 1] = placed.pixel[k, 1] + way * beyond * dv
                end[m + j] = k
                alone = alone and not _on_outline(placed, spacing, begin, box, placed.eye[k], pixel[m + j])
            m += len(PAST_END) if alone else 0
    return end[:m].copy(), pixel[:m].copy()


@njit(nogil=True)
def _on_outline(
    placed: Placed, spacing: FloatArray, begin: Int32Array, box: FloatArray, eye: int, pixel: FloatArray
) -> bool:
    """Whether an outline passes a pixel (2,) of one view so closely that one step would confirm both."""
    u, v = pixel[0], pixel[1]
    for c in range(len(box)):
        first = begin[c]
        if placed.eye[first] != eye or beside_box(box, c, u, v, 2.0 * ON_EDGE + spacing[first]):
            continue
        for k in range(first, begin[c + 1]):
            if math.hypot(placed.pixel[k, 0] - u, placed.pixel[k, 1] - v) < own_step(spacing[k]):
                return True
    return False


@njit(nogil=True)
def ends_seen(
    pictures: Pictures, placed: Placed, spacing: FloatArray, stretch: FloatArray, found: Int8Array, is_bent: BoolArray
) -> tuple[float, float]:
    """Ends of an outline past which an edge goes on, and all of which that is known; see :func:`gone_on`.

    pictures, stretch : see :func:`.finding.steps_about`; the others : see :func:`past_ends`
    """
    end, pixel = past_ends(placed, spacing, found, is_bent)
    steps = steps_about(pictures, placed.eye[end], pixel, placed.normal[end], stretch[end], REACH + 1)
    gone, known = gone_on(confirmations(steps.offset, steps.number, 0.0), len(pictures.sizes))
    return gone, known


@njit(nogil=True)
def gone_on(confirmed: Int8Array, n_views: int) -> tuple[float, float]:
    """Ends past which an edge goes on, and all that are known of, a view: what one shows of an end the others do, too.

    confirmed : (m,) int8, of the points of :func:`past_ends`; all of an end say that an edge goes on
    """
    each = len(PAST_END)
    gone, known = 0, 0
    for first in range(0, len(confirmed), each):
        of_end = confirmed[first : first + each]
        known += of_end.min() >= 0
        gone += of_end.min() > 0
    return gone / n_views, known / n_views


@njit(nogil=True)
def log_ratio(gone: float, ends: float) -> float:
    """Nats: log-likelihood ratio of edges that go on past so many of their ends, the object's own against others'."""
    ratio: float = beta_binomial(gone, ends, ENDS_OF_OWN) - beta_binomial(gone, ends, ENDS_OF_OTHERS)
    return ratio
