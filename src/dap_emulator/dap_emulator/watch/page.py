"""A recorded run as one page that needs nothing else: source, planes, values, counters and profile."""

from __future__ import annotations

import base64
import html
import json
import math
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from ..fortran_plus import Result
from .recorder import Recorder, StepDone, Watched
from .settings import LARGEST_SHOWN


def page_of(recorder: Recorder, result: Result, title: str) -> str:
    """Make the page.

    Parameters
    ----------
    recorder : Recorder
        The observer of the run.
    result : Result
        What the run returned.
    title : str
        The program's name.

    Returns
    -------
    str
        HTML without a reference to any other file or address. Its pictures need a browser with DecompressionStream
        (2023 or newer).
    """
    data = json.dumps(_data(recorder, result, title), separators=(',', ':'), allow_nan=False)
    return Template(_part('page.html')).substitute(
        title=html.escape(title),
        style=_part('page.css').strip(),
        script=_part('page.js').strip(),
        # Nothing inside may end the script element that it stands in.
        data=data.replace('<', '\\u003c'),
    )


def write_page(path: str | Path, recorder: Recorder, result: Result, title: str) -> None:
    """Write the page of :func:`page_of` to a file.

    Raises
    ------
    ValueError
        When the name does not end in .html.
    OSError
        When it cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in ('.html', '.htm'):
        raise ValueError(f'html: expected a file name ending in .html, got {path.name!r}')
    path.write_text(page_of(recorder, result, title), encoding='utf-8')


def _part(name: str) -> str:
    """A file of this room."""
    return resources.files(__package__).joinpath(name).read_text(encoding='utf-8')


def _data(recorder: Recorder, result: Result, title: str) -> dict[str, Any]:
    """What page.js reads."""
    dap, stats = recorder.dap, result.stats
    return {
        'title': title,
        'model': f'DAP {dap.spec.name}',
        'es': dap.es,
        'largest': LARGEST_SHOWN,
        'clock': dap.clock_s,
        'planes': dap.store.planes,
        'peak': stats.peak_planes,
        'cycles': stats.cycles,
        'seconds': stats.seconds,
        'note': _note(recorder),
        'source': result.source.splitlines(),
        'lines': stats.lines,
        'times': recorder.times,
        'operations': [[name, *entry] for name, entry in stats.operations.items()],
        'profile': [[list(path), cycles] for path, cycles in recorder.profile.items()],
        'printed': result.printed,
        'calls': [{'unit': call.unit, 'arrays': call.arrays, 'scalars': call.scalars} for call in recorder.calls],
        'arrays': [_array(array) for array in recorder.arrays],
        'steps': [_step(step) for step in recorder.steps],
        'blobs': [base64.b64encode(blob).decode() for blob in recorder.blobs],
    }


def _note(recorder: Recorder) -> str:
    """What the page does not show; empty when it shows everything."""
    if recorder.complete:
        return ''
    return (
        f'The first {len(recorder.steps)} of {recorder.statements} steps are recorded; '
        'the lines of the source and the profile count all of them.'
    )


def _array(array: Watched) -> dict[str, Any]:
    finite = math.isfinite(array.low)
    return {
        'kind': array.kind,
        'dtype': array.dtype,
        'parallel': array.parallel,
        'serial': array.serial,
        'low': array.low if finite else 0.0,
        'high': array.high if finite else 1.0,
        'changes': array.changes,
    }


def _step(step: StepDone) -> list[Any]:
    name, blob = step.mask or (None, None)
    return [step.call, step.line, step.depth, step.cycles, step.spent, step.planes, name, blob, int(step.entry)]
