"""Candidate poses refined: each fitted to the data that lies on the model under it, with the evidence for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.compiled import njit

from ..geometry.back_projection import assign, count_matches
from ..geometry.least_squares import refine
from ..model.problem import Problem
from ..model.regularity import regularity
from ..params import MatchParams
from .evidence import evidence, plane_table
from .false_alarms import needed_evidence
from .settings import DOUBTFUL, KEEP, WIDTHS


@dataclass(eq=False)
class Refined:
    """c refined candidates: motions (c, 12), assignments and signs (c, n) among used features, normals (c, 6, 6),
    figures (c, 8) as :func:`refine_candidates` gives them."""

    motions: np.ndarray
    assignments: np.ndarray
    signs: np.ndarray
    normals: np.ndarray
    figures: np.ndarray


@njit(nogil=True)
def refine_candidates(motions, scores, keep, doubtful, model, data, regular, assignments, signs, normals, figures):
    """Refine candidate poses, in place, and weigh the evidence for each.

    Parameters
    ----------
    motions : (c, 12) float64
        Candidates, best first; refined in place.
    scores : (c,) float64
        Of the search.
    keep : float
        Candidates whose score is at least this share of the best are refined.
    doubtful : float
        Nats: all candidates are refined when the best evidence of those is less.
    model : ModelFeatures
    data : DataFeatures
    regular : Regularity
        Of the model.
    assignments : (c, n) int32
    signs : (c, n) int8
    normals : (c, 6, 6) float64
        Filled, see :func:`.least_squares.refine`.
    figures : (c, 8) float64
        Filled: score, rms (metres), chi, centre x, y, z, data matched, evidence (nats). Score is that of
        :func:`.back_projection.count_matches`; 0 for a candidate that was skipped.

    """
    stamp = np.full(model.rows.shape[0], -1, np.int64)
    inverse = 0.0
    for k in range(len(data.tolerances)):
        inverse += 1.0 / data.tolerances[k, 0]
    number, nats = plane_table(regular.offsets, regular.sorted, len(data.tolerances) / inverse)
    final = WIDTHS[-1]
    best = -np.inf
    figures[:, 0] = 0.0
    for k in range(len(scores)):
        if scores[k] <= 0.0 or (np.floor(scores[k]) < keep * np.floor(scores[0]) and best >= doubtful):
            continue
        matched, rms, chi, cx, cy, cz = refine(motions[k], model, data, WIDTHS, assignments[k], signs[k], normals[k])
        matched = assign(motions[k], model, data, final, assignments[k], signs[k])
        figures[k, 0] = count_matches(motions[k], model, data, final, stamp, k, 0.0)
        figures[k, 1], figures[k, 2] = rms, chi
        figures[k, 3], figures[k, 4], figures[k, 5], figures[k, 6] = cx, cy, cz, matched
        figures[k, 7] = evidence(
            motions[k],
            model.rows,
            model.kind,
            data.rows,
            data.kind,
            data.tolerances,
            assignments[k],
            model.middle,
            model.size,
            regular.order,
            regular.direction,
            regular.normals,
            regular.usual,
            regular.spanned,
            regular.upright,
            number,
            nats,
            regular.faces,
            regular.lies,
        )
        best = max(best, figures[k, 7])


def refine_all(
    problem: Problem, motions: np.ndarray, scores: np.ndarray, params: MatchParams, keep: float = KEEP
) -> Refined:
    """Refine candidate poses (c, 12) with search scores (c,), best first."""
    c, n = len(scores), len(problem.rows)
    refined = Refined(
        motions, np.empty((c, n), np.int32), np.empty((c, n), np.int8), np.empty((c, 6, 6)), np.zeros((c, 8))
    )
    refine_candidates(
        motions,
        scores,
        keep,
        needed_evidence(problem, params) + DOUBTFUL,
        problem.model,
        problem.features,
        regularity(problem.index),
        refined.assignments,
        refined.signs,
        refined.normals,
        refined.figures,
    )
    return refined
