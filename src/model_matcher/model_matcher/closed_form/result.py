"""What one closed-form test found, its comparison with the truth, and the document of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from msgs_py import FeatureSet, Interpretation, Pose, PoseError, StereoRig

from .case import Case, Limits
from .comparison import AssignmentComparison, EdgeComparison, best_pose_error, compare_assignment


@dataclass
class CaseResult:
    """Everything that one test found.

    Attributes
    ----------
    case : Case
        What was tested.
    model_name : str
        Name of the object as the scene file has it.
    rig : StereoRig
        The cameras, metres and pixels.
    true_pose : Pose
        left_T_model as rendered.
    model, true_features, data : FeatureSet
        Features of the model (model frame), those of the object that both cameras see (left optical frame), and the
        recovered ones (left optical frame), metres.
    left, right : (h, w) uint8
        The rendered images.
    edges : EdgeComparison
        Recovered edges against the true ones.
    surface_residual_m : float
        The largest distance of a rendered point from the surface it was rendered from, metres.
    image_difference : int
        Pixels in which the node's left image differs from the library's; 0 when no node took part.
    found : Interpretation, optional
        The best accepted interpretation.
    pose_error : PoseError, optional
        Its error against ``true_pose``.
    assignment : AssignmentComparison, optional
        Its pairings against the true ones.
    reason : str
        Why nothing was accepted; empty when something was.
    emulator : dict
        Rows of the report on the array machine; empty when it was not asked.
    milliseconds : dict
        Time by stage: render, recover, match.
    """

    case: Case
    model_name: str
    rig: StereoRig
    true_pose: Pose
    model: FeatureSet
    true_features: FeatureSet
    data: FeatureSet
    left: np.ndarray
    right: np.ndarray
    edges: EdgeComparison
    surface_residual_m: float
    image_difference: int
    found: Interpretation | None = None
    pose_error: PoseError | None = None
    assignment: AssignmentComparison | None = None
    reason: str = ''
    emulator: dict[str, Any] = field(default_factory=dict)
    milliseconds: dict[str, float] = field(default_factory=dict)


def judge(result: CaseResult, interpretations: Sequence[Interpretation], reason: str | None) -> None:
    """Compare the best accepted interpretation with the truth, or keep the reason why there is none.

    Parameters
    ----------
    result : CaseResult
        Filled in place: found, pose_error and assignment, or reason.
    interpretations : sequence of Interpretation
        Those of the tested model, best first, accepted or not.
    reason : str or None
        What the matcher or the recovery gives as the reason when nothing was accepted.
    """
    accepted = [item for item in interpretations if item.accepted]
    if accepted:
        result.found = accepted[0]
        result.pose_error = best_pose_error(accepted[0], result.true_pose)
        result.assignment = compare_assignment(accepted[0], result.model, result.data)
    else:
        result.reason = reason or 'no interpretation'


def result_document(result: CaseResult, limits: Limits) -> dict[str, Any]:
    """The contents of result.json.

    Parameters
    ----------
    result : CaseResult
        After :func:`judge`.
    limits : Limits
        Largest errors of a pass.

    Returns
    -------
    dict
        Plain values that JSON can hold; ``passed`` is the verdict as a bool, ``verdict`` as a sentence.
    """
    recognised = result.pose_error is not None
    within = (
        result.pose_error is not None
        and result.pose_error.rotation_deg <= limits.rotation_deg
        and result.pose_error.translation <= limits.translation_m
    )
    # A case through the libraries does not ask the array machine.
    array_machine = not result.emulator or result.emulator.get('pixels that differ from the serial answer') == 0
    signs = (
        recognised
        and result.assignment is not None
        and (result.assignment.signs_right == result.assignment.right == result.assignment.matched)
    )
    if result.pose_error is None:
        verdict = f'not recognised: {result.reason}'
    else:
        head = 'recognised' if within and signs else 'a pairing or sign is wrong' if within else 'outside the limits'
        verdict = (
            f'{head}: {result.pose_error.rotation_deg:.3f} deg, {1e3 * result.pose_error.translation:.3f} mm, '
            f'{result.assignment.signs_right if result.assignment else 0} of '
            f'{result.assignment.matched if result.assignment else 0} pairings with their signs right'
        )
    return {
        'scene': result.case.name,
        'passed': bool(within and signs and array_machine),
        'verdict': verdict,
        'model': result.model_name,
        'true_edges': len(result.edges.covered),
        'recovered_edges': len(result.edges.true_index),
        'matched_edges': result.assignment.matched if result.assignment else 0,
        'rotation_error_deg': result.pose_error.rotation_deg if result.pose_error else None,
        'translation_error_m': result.pose_error.translation if result.pose_error else None,
        'signs_right': result.assignment.signs_right if result.assignment else 0,
        'limits': {'rotation_deg': limits.rotation_deg, 'translation_m': limits.translation_m},
        'recovery': result.edges.summary(),
        'render': {
            'surface_residual_m_max': result.surface_residual_m,
            'node_image_differs_from_library_pixels': result.image_difference,
        },
        'emulator': result.emulator,
        'milliseconds': result.milliseconds,
        'camera': {
            'width': result.rig.left.width,
            'height': result.rig.left.height,
            'fx': result.rig.left.fx,
            'cx': result.rig.left.cx,
            'cy': result.rig.left.cy,
            'baseline_m': result.rig.baseline,
        },
        'true_pose': result.true_pose.matrix.tolist(),
        'found_pose': result.found.pose.matrix.tolist() if result.found else None,
    }
