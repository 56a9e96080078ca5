"""What a closed-form test is: the case, the limits of a pass, and the document of its result. Plain values."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .run_graph import CaseResult


@dataclass(frozen=True)
class Limits:
    """What counts as recognised."""

    rotation_deg: float = 0.5
    translation_m: float = 0.001


@dataclass(frozen=True)
class Case:
    """One closed-form test.

    scene : path of a scene file, or the name of one in csg_renderer's models
    width, height, focal : image size and focal length, pixels; None: what the scene says, or 512 x 512 and 703
    baseline : metres; None: what the scene says, or a fifth of the object's distance
    antialias : samples along each side of a pixel; psf, noise : sensor blur (pixels) and noise (grey levels); seed
    pose : left_T_model of the first object, its 4 x 4 matrix row by row, metres; None: where the scene draws it
    clutter : so many further solids stand beside or behind the object
    time_limit_s : of the search; label : name of the case, None: that of the scene
    """

    scene: str
    width: int | None = None
    height: int | None = None
    focal: float | None = None
    baseline: float | None = None
    antialias: int = 4
    psf: float = 0.5
    noise: float = 2.0
    seed: int = 0
    pose: tuple[float, ...] | None = None
    clutter: int = 0
    time_limit_s: float = 2.0
    label: str | None = None

    @property
    def name(self) -> str:
        return self.label or Path(self.scene).stem


def result_document(result: CaseResult, limits: Limits) -> dict[str, Any]:
    """What result.json holds."""
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
