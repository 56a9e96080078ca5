"""Closed-form testing (thesis 4.12): render a scene whose answer is known, run the nodes on it, compare every stage.

``ros2 run model_matcher closed_form SCENE...`` or ``python -m model_matcher.closed_form SCENE...``. For each scene all
nodes run in one process on a real executor, over real topics; the result is a folder with ``report.html`` and
``result.json``. The exit status is 0 when every scene was recognised within the limits.

This module is the command; :mod:`closed_form_run` holds the graph and :mod:`closed_form_report` the pages. Both are
imported late, so that the command answers at once.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .closed_form_run import CaseResult

DEMO_SCENES = ('l_shape_v1', 'chipped_block_v1')


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

    @property
    def name(self) -> str:
        return Path(self.scene).stem


def main(args: list[str] | None = None) -> int:
    """The command. Returns the exit status: 0 all recognised, 1 not all, 2 misuse."""
    options = _parser().parse_args(args)
    scenes = list(options.scenes) or (list(DEMO_SCENES) if options.demo else [])
    if not scenes:
        _parser().error('name at least one scene, or use --demo DIR')
    out = Path(options.demo or options.out)
    print(f'closed-form testing of {", ".join(scenes)} into {out}/', flush=True)
    limits = Limits(options.max_rotation_deg, options.max_translation_mm * 1e-3)
    cases = [Case(scene, options.size[0] if options.size else None, options.size[1] if options.size else None,
                  options.focal, None if options.baseline is None else options.baseline * 1e-3,
                  options.antialias, options.psf, options.noise, options.seed) for scene in scenes]
    passed = [_run_one(case, out / case.name, limits, options.quiet) for case in cases]
    if options.demo:
        # No pass or fail: the reference pose of a real picture is itself measured.
        _real_pair(out / 'chessboard01')
    print(f'{sum(passed)} of {len(passed)} scenes passed; open {out}/<scene>/report.html')
    return 0 if all(passed) else 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='closed_form', description='Render, recover, match, and compare with the truth.',
        formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    add = parser.add_argument
    add('scenes', nargs='*', help='scene files, or names of scenes of csg_renderer (l_shape_v1, ...)')
    add('-o', '--out', default='closed_form_out', help='folder for the results')
    add('--demo', metavar='DIR', help='run the demonstration (two scenes, one real pair) into DIR')
    add('--size', type=int, nargs=2, metavar=('WIDTH', 'HEIGHT'), help='image size, pixels')
    add('--focal', type=float, help='focal length, pixels')
    add('--baseline', type=float, metavar='MM', help='distance of the eyes, mm')
    add('--antialias', type=int, default=Case.antialias, help='samples along each side of a pixel')
    add('--psf', type=float, default=Case.psf, help='blur of the sensor, pixels')
    add('--noise', type=float, default=Case.noise, help='noise of the sensor, grey levels')
    add('--seed', type=int, default=Case.seed, help='seed of the noise')
    add('--max-rotation-deg', type=float, default=Limits.rotation_deg, help='limit of a pass')
    add('--max-translation-mm', type=float, default=1e3 * Limits.translation_m, help='limit of a pass')
    add('-q', '--quiet', action='store_true', help='no progress bar')
    return parser


def _run_one(case: Case, folder: Path, limits: Limits, quiet: bool) -> bool:
    from tqdm import tqdm

    from .closed_form_report import write_report
    from .closed_form_run import STAGES, run_case

    with tqdm(total=len(STAGES) + 1, desc=f'{case.name:<20}', bar_format='{desc} {bar:20} {n}/{total} {postfix}',
              disable=quiet, file=sys.stdout) as bar:
        def progress(stage: str) -> None:
            bar.set_postfix_str(stage)
            bar.update()

        try:
            result = run_case(case, progress)
        except (OSError, ValueError) as error:
            bar.close()
            print(f'{case.name}: {error}', file=sys.stderr)
            return False
        document = result_document(result, limits)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / 'result.json').write_text(json.dumps(document, indent=2) + '\n')
        write_report(folder, result, document)
        progress('report')
        bar.set_postfix_str(document['verdict'])
    return bool(document['passed'])


def result_document(result: CaseResult, limits: Limits) -> dict[str, Any]:
    """What result.json holds."""
    recognised = result.pose_error is not None
    within = (result.pose_error is not None and result.pose_error.rotation_deg <= limits.rotation_deg
              and result.pose_error.translation <= limits.translation_m)
    array_machine = result.emulator.get('pixels that differ from the serial answer') == 0
    signs = recognised and result.assignment is not None and (
        result.assignment.signs_right == result.assignment.right == result.assignment.matched)
    if result.pose_error is None:
        verdict = f'not recognised: {result.reason}'
    else:
        verdict = (f'{"recognised" if within and signs else "outside the limits"}: '
                   f'{result.pose_error.rotation_deg:.3f} deg, {1e3 * result.pose_error.translation:.3f} mm, '
                   f'{result.assignment.signs_right if result.assignment else 0} of '
                   f'{result.assignment.matched if result.assignment else 0} signs right')
    return {
        'scene': result.case.name, 'passed': bool(within and signs and array_machine), 'verdict': verdict,
        'model': result.model_name,
        'true_edges': len(result.edges.covered), 'recovered_edges': len(result.edges.true_index),
        'matched_edges': result.assignment.matched if result.assignment else 0,
        'rotation_error_deg': result.pose_error.rotation_deg if result.pose_error else None,
        'translation_error_m': result.pose_error.translation if result.pose_error else None,
        'signs_right': result.assignment.signs_right if result.assignment else 0,
        'limits': {'rotation_deg': limits.rotation_deg, 'translation_m': limits.translation_m},
        'recovery': result.edges.summary(),
        'render': {'surface_residual_m_max': result.surface_residual_m,
                   'node_image_differs_from_library_pixels': result.image_difference},
        'emulator': result.emulator,
        'milliseconds': result.milliseconds,
        'camera': {'width': result.rig.left.width, 'height': result.rig.left.height, 'fx': result.rig.left.fx,
                   'cx': result.rig.left.cx, 'cy': result.rig.left.cy, 'baseline_m': result.rig.baseline},
        'true_pose': result.true_pose.matrix.tolist(),
        'found_pose': result.found.pose.matrix.tolist() if result.found else None,
    }


def _real_pair(folder: Path) -> None:
    from .real_pair import run_chessboard

    print(run_chessboard(folder))


if __name__ == '__main__':
    sys.exit(main())
