"""Many cases: in this process, in several, or on a dask cluster; what they found as CSV, JSON and a page."""

from __future__ import annotations

import csv
import html
import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from csg_renderer.language import find_scene

from ..batches.jobs import Workers, runner
from .case import Case, Limits
from .report import STYLE, write_report
from .result import CaseResult, result_document
from .run_library import be_ready, run_library_case
from .saved import save_case
from .scene_files import scene_files

COLUMNS = (
    'case',
    'passed',
    'rotation_error_deg',
    'translation_error_mm',
    'true_edges',
    'recovered_edges',
    'matched_edges',
    'signs_right',
    'render_ms',
    'recover_ms',
    'match_ms',
    'verdict',
)
TITLES = (
    'case',
    'passed',
    'rotation, deg',
    'translation, mm',
    'edges',
    'recovered',
    'matched',
    'signs right',
    'render, ms',
    'recover, ms',
    'match, ms',
    'verdict',
)
FAILING, CASES = 'failing', 'cases'
# Number, case, limits, folder of the results, through the nodes, a page for every case.
Job = tuple[int, Case, Limits, str, bool, bool]
SUMMARY_TITLES = {
    'cases': 'cases',
    'passed': 'passed',
    'recognised': 'recognised, within the limits or not',
    'rotation_error_deg_p50': 'rotation error, median, deg',
    'rotation_error_deg_p90': 'rotation error, 90 %, deg',
    'translation_error_mm_p50': 'translation error, median, mm',
    'translation_error_mm_p90': 'translation error, 90 %, mm',
    'render_ms_p50': 'rendering, median, ms',
    'recover_ms_p50': 'recovery, median, ms',
    'match_ms_p50': 'matching, median, ms',
}


def run_batch(
    cases: Sequence[Case],
    limits: Limits,
    out: Path,
    workers: int = 1,
    dask: str | None = None,
    nodes: bool = False,
    quiet: bool = False,
    reports: bool = False,
) -> list[dict[str, Any]]:
    """Run the cases; write summary.csv, summary.json and index.html into out, and failing cases into out/failing/.

    Parameters
    ----------
    cases : sequence of Case
        Each with a name of its own.
    limits : Limits
        Largest errors of a pass.
    out : Path
        Folder of the results.
    workers : int
        Processes on this machine.
    dask : str, optional
        Address of a dask scheduler to run the cases on instead; 'local' starts one here.
    nodes : bool
        Run the cases through the real nodes (slower) instead of the libraries.
    quiet : bool
        Show no progress bar.
    reports : bool
        Write a page for every case, not only for failing ones.

    Returns
    -------
    list of dict
        One document a case, in the order of the cases.

    Raises
    ------
    ValueError
        When dask is asked for and not installed.
    """
    out.mkdir(parents=True, exist_ok=True)
    documents: list[dict[str, Any] | None] = [None] * len(cases)
    jobs: list[Job] = [(k, case, limits, str(out.resolve()), nodes, reports) for k, case in enumerate(cases)]
    with tqdm(total=len(cases), desc='cases', unit='', disable=quiet, file=sys.stdout) as bar:
        with runner(Workers(workers, dask), be_ready) as run:
            if dask in (None, 'local'):
                answers = (answer for _, answer in run(run_one, jobs))
            else:  # a cluster shares no folder with this machine
                sent = [(job, files_of(job[1])) for job in jobs]
                answers = (brought_home(asked[0], answer) for asked, answer in run(_far, sent))
            for index, document in answers:
                documents[index] = document
                bar.update()
                bar.set_postfix_str(f'{sum(bool(d and d["passed"]) for d in documents)} passed')
    done = [document for document in documents if document is not None]
    write_summary(out, done, limits)
    return done


def run_through(nodes: bool) -> Callable[[Case, Path, Callable[[str], None]], CaseResult]:
    """The function that runs a case (case, folder, progress): through the nodes, or through the libraries."""
    if not nodes:
        return run_library_case
    # A run through the libraries needs no ROS.
    from .run_graph import run_case

    return lambda case, folder, progress: run_case(case, progress, folder)


def run_one(job: Job) -> tuple[int, dict[str, Any]]:
    """One case, in whatever process; an unusable case is a document with its error as the verdict."""
    index, case, limits, out, nodes, reports = job
    folder = Path(out) / CASES / case.name
    try:
        result = run_through(nodes)(case, folder, lambda stage: None)
    except (OSError, ValueError) as error:
        return index, _refused(case, str(error))
    document = {'case': case.name, **result_document(result, limits)}
    failing = Path(out) / FAILING / case.name
    shutil.rmtree(failing, ignore_errors=True)  # of an earlier run
    if not document['passed']:
        save_case(failing, result, document, limits)
        write_report(failing, result, document)
        document['saved'] = str(failing.relative_to(out))
    if reports:
        folder.mkdir(parents=True, exist_ok=True)
        write_report(folder, result, document)
        document['report'] = f'{CASES}/{case.name}/report.html'
    return index, document


def run_far(job: Job, files: dict[str, bytes]) -> tuple[int, dict[str, Any], str, dict[str, bytes]]:
    """As run_one, on a machine that shares no folder with this one.

    files : contents of the scene and what it includes, by name, the scene first; what is written is returned likewise
    """
    index, case, limits, out, nodes, reports = job
    with tempfile.TemporaryDirectory() as folder:
        for name, data in files.items():
            (Path(folder) / name).parent.mkdir(parents=True, exist_ok=True)
            (Path(folder) / name).write_bytes(data)
        here = Path(folder) / 'out'
        if files:
            case = replace(case, scene=str(Path(folder) / next(iter(files))), label=case.name)
        _, document = run_one((index, case, limits, str(here), nodes, reports))
        written = {str(path.relative_to(here)): path.read_bytes() for path in here.rglob('*') if path.is_file()}
    return index, document, out, written


def files_of(case: Case) -> dict[str, bytes]:
    """The contents of a case's scene and what it includes, the scene's first; nothing for an unusable one."""
    try:
        (_, scene), *included = scene_files(find_scene(case.scene)).items()
        return {scene.name: scene.read_bytes(), **{name: path.read_bytes() for name, path in included}}
    except (OSError, ValueError):
        return {}  # an unusable scene is the case's own result


def brought_home(job: Job, answer: Any) -> tuple[int, dict[str, Any]]:
    """What run_far returned, its files in the folder of the results.

    The machine that answers may be anybody's: the job says where anything is written or removed, the answer only what
    lies below that. An answer that is none is a failed case.
    """
    index, case, _, out, *_ = job
    try:
        _, document, _, written = answer
        document = {**document, 'case': case.name}
        if not isinstance(document.get('passed'), bool):
            raise ValueError("it lacks 'passed'")
        files = {_below(Path(out), case, name): bytes(data) for name, data in written.items()}
        for page in ('saved', 'report'):
            if page in document:
                _below(Path(out), case, document[page])
    except (TypeError, ValueError) as error:
        return index, _refused(case, f'the answer of a worker is none: {error}')
    shutil.rmtree(Path(out) / FAILING / case.name, ignore_errors=True)
    for path, data in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return index, document


def _below(out: Path, case: Case, name: Any) -> Path:
    """A file of a case in the folder of the results. Raises ValueError for a name that leads elsewhere."""
    path = (out.resolve() / str(name)).resolve()
    folders = [(out / kind / case.name).resolve() for kind in (FAILING, CASES)]
    if '\0' in str(name) or not any(path.is_relative_to(folder) for folder in folders):
        raise ValueError(f'{str(name)!r} is not in the folder of the case')
    return path


def _refused(case: Case, why: str) -> dict[str, Any]:
    """The document of a case that gave no result."""
    return {'case': case.name, 'scene': case.scene, 'passed': False, 'verdict': f'error: {why}'}


def _far(asked: tuple[Job, dict[str, bytes]]) -> tuple[int, dict[str, Any], str, dict[str, bytes]]:
    return run_far(*asked)


def write_summary(out: Path, documents: list[dict[str, Any]], limits: Limits) -> None:
    """summary.csv, summary.json and index.html."""
    rows = [_row(document) for document in documents]
    with open(out / 'summary.csv', 'w', newline='', encoding='utf-8') as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    totals = summary(documents)
    (out / 'summary.json').write_text(json.dumps({'summary': totals, 'cases': documents}, indent=1) + '\n')
    head = ''.join(f'<th>{name}</th>' for name in TITLES)
    body = []
    for document, row in zip(documents, rows):
        page = document.get('report') or (f'{document["saved"]}/report.html' if 'saved' in document else None)
        cells = [_text(row[name]) for name in COLUMNS]
        cells[1] = 'yes' if document['passed'] else 'no'
        # The figures stand in their columns; what went wrong does not.
        cells[-1] = '' if document['passed'] else cells[-1].split(':')[0] if row['rotation_error_deg'] else cells[-1]
        if page:
            cells[0] = f'<a href="{_text(page)}">{cells[0]}</a>'
        state = 'good' if document['passed'] else 'bad'
        body.append(f'<tr class="{state}">' + ''.join(f'<td>{cell}</td>' for cell in cells) + '</tr>')
    lines = ''.join(
        f'<tr><td>{title}</td><td>{_text(_short(totals[name]))}</td></tr>' for name, title in SUMMARY_TITLES.items()
    )
    (out / 'index.html').write_text(
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Closed-form sweep</title><style>{STYLE}'
        'body { max-width: 1500px } td { white-space: nowrap } td:last-child { white-space: normal }</style>'
        f'<h1>Closed-form sweep: {totals["passed"]} of {totals["cases"]} passed</h1>'
        f'<p>A pass is a pose within {limits.rotation_deg:g} deg and {1e3 * limits.translation_m:g} mm of the truth '
        f'with every pairing and sign right. Failing cases are kept under {FAILING}/ and run again with <code>--replay '
        f'{FAILING}/NAME</code>.</p>'
        f'<table>{lines}</table><table><tr>{head}</tr>{"".join(body)}</table></html>\n',
        encoding='utf-8',
    )


def summary(documents: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts and medians over the cases."""
    rotation = [d['rotation_error_deg'] for d in documents if d.get('rotation_error_deg') is not None]
    shift = [1e3 * d['translation_error_m'] for d in documents if d.get('translation_error_m') is not None]
    out: dict[str, Any] = {
        'cases': len(documents),
        'passed': sum(d['passed'] for d in documents),
        'recognised': len(rotation),
    }
    for name, values in (('rotation_error_deg', rotation), ('translation_error_mm', shift)):
        for quantile in (50, 90):
            out[f'{name}_p{quantile}'] = float(np.percentile(values, quantile)) if values else None
    for stage in ('render', 'recover', 'match'):
        times = [d['milliseconds'][stage] for d in documents if stage in d.get('milliseconds', {})]
        out[f'{stage}_ms_p50'] = float(np.median(times)) if times else None
    return out


def _row(document: dict[str, Any]) -> dict[str, Any]:
    shift = document.get('translation_error_m')
    times = document.get('milliseconds', {})
    values = {
        **document,
        'translation_error_mm': None if shift is None else 1e3 * shift,
        **{f'{stage}_ms': times.get(stage) for stage in ('render', 'recover', 'match')},
    }
    return {name: _short(values.get(name)) for name in COLUMNS}


def _short(value: Any) -> Any:
    return '' if value is None else f'{value:.4g}' if isinstance(value, float) else value


def _text(value: Any) -> str:
    return html.escape(str(value))
