"""What the options of the closed_form command ask for: single cases, sweeps, a saved case again, the demonstration."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NoReturn

from tqdm import tqdm

from .batch import run_batch, run_through, summary
from .camera_options import camera_config
from .case import STAGES, Case, Limits
from .poses import pose_from_angles, sweep_cases
from .real_pair import run_chessboard
from .report import write_report
from .result import result_document
from .saved import load_case
from .scene_files import check_scene
from .sequences.motion import Motion
from .sequences.sequence import read_sequence, rendered_sequence, write_found, write_sequence
from .sequences.turning_part import run_turning_part
from .viewing.view_files import result_moment, write_view

DEMO_SCENES = ('l_shape_v1', 'chipped_block_v1')


def run(options: argparse.Namespace, misuse: Callable[[str], NoReturn]) -> int:
    """Do what the options ask for.

    Parameters
    ----------
    options : argparse.Namespace
        Of :func:`~model_matcher.closed_form.cli.closed_form_parser`.
    misuse : callable
        Called with a message when a scene or an option cannot be used; does not return.

    Returns
    -------
    int
        Exit status: 0 enough recognised, 1 too few, 2 bad input.
    """
    scenes = list(options.scenes) or (list(DEMO_SCENES) if options.demo else [])
    out = Path(options.demo or options.out)
    limits = Limits(options.max_rotation_deg, options.max_translation_mm * 1e-3)
    if options.replay:
        return _replay(options, out)
    try:
        cases = _named_apart([case for scene in scenes for case in _cases(scene, options)])
    except (OSError, ValueError) as error:
        misuse(str(error))
    print(f'closed-form testing of {", ".join(scenes)} into {out}/', flush=True)
    if options.path:
        motion = _motion(options)
        shares = [_sequence(case, motion, out / case.name, limits, options) for case in cases]
        return 0 if min(shares) >= options.min_success else 1
    if options.sweep or options.workers > 1 or options.dask:
        return _batch(cases, limits, out, options)
    passed = [_run_one(case, out / case.name, limits, options.quiet) for case in cases]
    if options.demo:
        print(run_chessboard(out / 'chessboard01'))
        print(run_turning_part(out / 'turning_part', options.quiet))
    page = f'{cases[0].name if len(cases) == 1 else "<scene>"}/report.html'
    print(f'{sum(passed)} of {len(passed)} scenes passed; open {out}/{page}')
    return 0 if sum(passed) >= options.min_success * len(passed) else 1


def _cases(scene: str, options: argparse.Namespace) -> list[Case]:
    """The cases of one scene: one, or those of a sweep.

    Raises ValueError, naming the option or what is wrong with the scene, and OSError where there is no such file.
    """
    width, height = options.size or (None, None)
    pose = None if options.pose is None else pose_from_angles(options.pose)
    case = Case(
        scene,
        width,
        height,
        options.focal,
        None if options.baseline is None else options.baseline * 1e-3,
        options.antialias,
        options.psf,
        options.noise,
        options.seed,
        pose,
        options.clutter,
        options.time_limit,
        camera=tuple(options.camera),
    )
    camera_config(case)
    if options.path and options.camera:
        raise ValueError('camera: sequences (--path) have --psf, --noise and --exposure only')
    check_scene(case, changed=bool(options.sweep))
    if not options.sweep:
        return [case]
    return sweep_cases(case, options.sweep, options.count, options.distance and options.distance * 1e-3)


def _motion(options: argparse.Namespace) -> Motion:
    """The motion that the options ask for."""
    return Motion(
        options.path,
        options.frames,
        options.rate,
        options.turn,
        options.shift * 1e-3,
        options.exposure,
        options.occluders,
        options.occlusion,
        options.jump,
    )


def _sequence(case: Case, motion: Motion, folder: Path, limits: Limits, options: argparse.Namespace) -> float:
    """Write the sequence of a case and, with --nodes, what the nodes find in it.

    Returns the share of frames whose pose is within the limits; 1 where nothing was asked to find one.
    """
    sequence = rendered_sequence(case, motion)
    bar = partial(tqdm, unit='', total=len(sequence), disable=options.quiet, file=sys.stdout)
    with bar(desc=f'{case.name:<20}') as shown:
        write_sequence(folder, sequence, case, motion, lambda stage: shown.update())
    print(f'{case.name}: {len(sequence)} frames with their poses in {folder}/')
    if not options.nodes:
        return 1.0
    # Whoever only wants the pictures needs no ROS.
    from .sequences.run_sequence import play_sequence

    with bar(desc=f'{case.name}, nodes') as shown:
        found = play_sequence(case, read_sequence(folder), lambda stage: shown.update())
    write_found(folder, sequence, found)
    errors = [None if pose is None else true.error_to(pose) for true, pose in zip(sequence.poses, found)]
    within = [
        error is not None and error.rotation_deg <= limits.rotation_deg and error.translation <= limits.translation_m
        for error in errors
    ]
    answered = sum(error is not None for error in errors)
    print(f'{case.name}: {answered} frames answered, {sum(within)} of {len(within)} within the limits')
    return sum(within) / len(within)


def _named_apart(cases: list[Case]) -> list[Case]:
    """The cases with names that differ, since each writes a folder of its name: equal names are numbered."""
    counts: dict[str, int] = {}
    found = []
    for case in cases:
        counts[case.name] = counts.get(case.name, 0) + 1
        found.append(case if counts[case.name] == 1 else replace(case, label=f'{case.name}_{counts[case.name]}'))
    return found


def _batch(cases: list[Case], limits: Limits, out: Path, options: argparse.Namespace) -> int:
    """Run many cases and print their summary; the exit status."""
    try:
        documents = run_batch(
            cases, limits, out, options.workers, options.dask, options.nodes, options.quiet, options.reports
        )
    except (OSError, ValueError) as error:
        print(f'closed_form: {error}', file=sys.stderr)
        return 2
    totals = summary(documents)
    print(
        f'{totals["passed"]} of {totals["cases"]} cases passed, {totals["recognised"]} recognised; median errors '
        f'{_figure(totals["rotation_error_deg_p50"])} deg, {_figure(totals["translation_error_mm_p50"])} mm; '
        f'open {out}/index.html'
    )
    return 0 if totals['passed'] >= options.min_success * totals['cases'] else 1


def _replay(options: argparse.Namespace, out: Path) -> int:
    """Run a saved case again; the exit status."""
    try:
        case, limits = load_case(options.replay)
    except (OSError, ValueError) as error:
        print(f'closed_form: {error}', file=sys.stderr)
        return 2
    return 0 if _run_one(case, out / case.name, limits, options.quiet, nodes=options.nodes) else 1


def _figure(value: float | None) -> str:
    return '-' if value is None else f'{value:.3f}'


def _run_one(case: Case, folder: Path, limits: Limits, quiet: bool, nodes: bool = True) -> bool:
    """Run one case with a progress bar and write its report; whether it passed."""
    with tqdm(
        total=len(STAGES) + 1,
        desc=f'{case.name:<20}',
        bar_format='{desc} {bar:20} {n}/{total} {postfix}',
        disable=quiet,
        file=sys.stdout,
    ) as bar:

        def progress(stage: str) -> None:
            bar.set_postfix_str(stage)
            bar.update()

        try:
            result = run_through(nodes)(case, folder, progress)
        except (OSError, ValueError) as error:
            bar.close()
            print(f'{case.name}: {error}', file=sys.stderr)
            return False
        document = result_document(result, limits)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / 'result.json').write_text(json.dumps(document, indent=2) + '\n')
        write_report(folder, result, document, write_view(folder, result.case.name, *result_moment(result)))
        progress('report')
        bar.set_postfix_str(document['verdict'])
    if quiet and not document['passed']:
        print(f'{case.name}: {document["verdict"]}')
    return bool(document['passed'])
