"""Candidate poses refined: each fitted to the data that lies on the model under it, with the evidence for it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py import BIN
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.deadline import Deadline, blocks
from msgs_py.numeric.settings import DECISIVE
from msgs_py.numeric.typed import FloatArray, Int8Array, Int32Array

from ..geometry.back_projection import assign, count_matches
from ..geometry.features import DataFeatures, ModelFeatures
from ..geometry.least_squares import refine
from ..model.problem import Problem
from ..model.regularity import Regularity, regularity
from ..model.settings import SEARCH_WIDTH
from ..params import MatchParams
from .evidence import Planes, evidence, plane_table
from .false_alarms import needed_evidence
from .settings import KEEP


class Refined(NamedTuple):
    """Refined candidate poses and what speaks for each; all 0 for a candidate that was skipped.

    Attributes
    ----------
    motions : (c, 12) float64
        The poses.
    assignments : (c, n) int32
        The model feature of each usable data feature, BIN for none.
    signs : (c, n) int8
        Which way round each data feature lies on its model feature.
    scores : (c,) float64
        Distinct model features and quality of fit, see :func:`.back_projection.count_matches`.
    residuals : (c,) float64
        Metres, root mean square distance of data end points from their model features.
    evidence : (c,) float64
        Nats.
    """

    motions: FloatArray
    assignments: Int32Array
    signs: Int8Array
    scores: FloatArray
    residuals: FloatArray
    evidence: FloatArray


@njit(nogil=True)
def refine_candidates(
    scores: FloatArray,
    keep: float,
    doubtful: float,
    model: ModelFeatures,
    data: DataFeatures,
    regular: Regularity,
    planes: Planes,
    first: int,
    last: int,
    best: float,
    refined: Refined,
) -> float:
    """Refine candidate poses, in place, and weigh the evidence for each.

    Parameters
    ----------
    scores : (c,) float64
        Of the search, best first.
    keep : float
        Candidates whose score is at least this share of the best are refined.
    doubtful : float
        Nats: all candidates are refined when the best evidence of those is less.
    model : ModelFeatures
    data : DataFeatures
    regular : Regularity
        Of the model.
    planes : Planes
        Of the model, under the data's tolerance.
    first, last : int
        The candidates to refine.
    best : float
        Nats, the best evidence of those before.
    refined : Refined
        Its motions are the candidates; filled.

    Returns
    -------
    float
        The best evidence so far.

    """
    stamp = np.full(model.rows.shape[0], -1, np.int64)
    # Tolerances count so many times in successive fits: a pose from two short edges is off by more than the data.
    widths = (SEARCH_WIDTH, np.sqrt(SEARCH_WIDTH), 1.0, 1.0)
    for k in range(first, last):
        if scores[k] <= 0.0 or (np.floor(scores[k]) < keep * np.floor(scores[0]) and best >= doubtful):
            continue
        motion, assignment, sign = refined.motions[k], refined.assignments[k], refined.signs[k]
        rms = refine(motion, model, data, widths, assignment, sign)
        assign(motion, model, data, 1.0, assignment, sign)
        refined.scores[k] = count_matches(motion, model, data, 1.0, stamp, k, 0.0)
        refined.residuals[k] = rms
        refined.evidence[k] = evidence(motion, model, data, assignment, regular, planes)
        best = max(best, refined.evidence[k])
    return best


def refine_all(
    problem: Problem,
    motions: np.ndarray,
    scores: np.ndarray,
    params: MatchParams,
    keep: float = KEEP,
    deadline: Deadline | None = None,
) -> Refined:
    """Refine candidate poses.

    Parameters
    ----------
    problem : Problem
        Model and data.
    motions : (c, 12) float64
        The candidates, best first; refined in place.
    scores : (c,) float64
        Of the search.
    params : MatchParams
        Of the match.
    keep : float
        Candidates whose score is at least this share of the best are refined; all when there is doubt.
    deadline : Deadline, optional
        When it has passed, no candidate is refined but the first.

    Returns
    -------
    Refined
    """
    c, n = len(scores), len(problem.rows)
    refined = Refined(
        motions, np.full((c, n), BIN, np.int32), np.zeros((c, n), np.int8), np.zeros(c), np.zeros(c), np.zeros(c)
    )
    doubtful = needed_evidence(problem, params) + DECISIVE
    model, data, regular = problem.model, problem.features, regularity(problem.index)
    planes = plane_table(regular.offsets, regular.sorted, 1.0 / float(np.mean(1.0 / data.tolerances[:, 0])))
    best = -np.inf
    for first, last in blocks(int((scores > 0.0).sum()), deadline or Deadline()):
        best = refine_candidates(scores, keep, doubtful, model, data, regular, planes, first, last, best, refined)
    return refined


def evidence_at(problem: Problem, motion: FloatArray) -> tuple[float, Int32Array, Int8Array]:
    """What the features say of a pose as it is.

    Parameters
    ----------
    problem : Problem
        Model and data.
    motion : (12,) float64

    Returns
    -------
    evidence : float
        Nats.
    assignment : (n,) int32
        The model feature of each usable data feature, BIN for none.
    sign : (n,) int8
        Which way round each data feature lies on its model feature.
    """
    n = len(problem.rows)
    assignment, sign = np.empty(n, np.int32), np.empty(n, np.int8)
    assign(motion, problem.model, problem.features, 1.0, assignment, sign)
    regular = regularity(problem.index)
    planes = plane_table(regular.offsets, regular.sorted, 1.0 / float(np.mean(1.0 / problem.tolerances[:, 0])))
    return evidence(motion, problem.model, problem.features, assignment, regular, planes), assignment, sign
