"""Candidate poses refined: each fitted to the data that lies on the model under it, with the evidence for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.compiled import njit

from ..geometry.kernels import assign, count_matches
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
def refine_candidates(
    motions,
    scores,
    keep,
    doubtful,
    model,
    kind_m,
    low,
    cell,
    shape,
    vox_starts,
    vox_items,
    data,
    kind_d,
    tols,
    widths,
    radius_tol,
    middle,
    size,
    order,
    direction,
    normals,
    offsets,
    by_offset,
    usual,
    spanned,
    upright,
    faces,
    lies,
    assignments,
    signs,
    matrices,
    figures,
):
    """Refine every candidate whose score is at least keep x best; all, when the best evidence of these is doubtful.

    doubtful : nats
    middle to lies : of the model, see ModelIndex and Regularity
    figures (c, 8): score, rms (metres), chi, centre x, y, z, data matched, evidence (nats). Score is the number of
    distinct model features plus 0.9 x the mean quality of fit; 0 for a candidate that was skipped.
    """
    stamp = np.full(model.shape[0], -1, np.int64)
    inverse = 0.0
    for k in range(len(tols)):
        inverse += 1.0 / tols[k, 0]
    number, nats = plane_table(offsets, by_offset, len(tols) / inverse)
    final = widths[len(widths) - 1]
    best = -np.inf
    figures[:, 0] = 0.0
    for k in range(len(scores)):
        if scores[k] <= 0.0 or (np.floor(scores[k]) < keep * np.floor(scores[0]) and best >= doubtful):
            continue
        matched, rms, chi, cx, cy, cz = refine(
            motions[k],
            model,
            kind_m,
            low,
            cell,
            shape,
            vox_starts,
            vox_items,
            data,
            kind_d,
            tols,
            widths,
            radius_tol,
            assignments[k],
            signs[k],
            matrices[k],
        )
        matched = assign(
            motions[k],
            model,
            kind_m,
            low,
            cell,
            shape,
            vox_starts,
            vox_items,
            data,
            kind_d,
            tols,
            final,
            radius_tol,
            assignments[k],
            signs[k],
        )
        figures[k, 0] = count_matches(
            motions[k],
            model,
            kind_m,
            low,
            cell,
            shape,
            vox_starts,
            vox_items,
            data,
            kind_d,
            tols,
            final,
            radius_tol,
            stamp,
            k,
            0.0,
        )
        figures[k, 1], figures[k, 2] = rms, chi
        figures[k, 3], figures[k, 4], figures[k, 5], figures[k, 6] = cx, cy, cz, matched
        figures[k, 7] = evidence(
            motions[k],
            model,
            kind_m,
            data,
            kind_d,
            tols,
            assignments[k],
            middle,
            size,
            order,
            direction,
            normals,
            usual,
            spanned,
            upright,
            number,
            nats,
            faces,
            lies,
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
    index = problem.index
    doubtful = needed_evidence(problem, params) + DOUBTFUL
    refine_candidates(
        motions,
        scores,
        keep,
        doubtful,
        *problem.grid,
        *problem.sample,
        np.array(WIDTHS),
        problem.radius_tol,
        index.middle,
        index.size,
        *regularity(index).arrays,
        refined.assignments,
        refined.signs,
        refined.normals,
        refined.figures,
    )
    return refined
