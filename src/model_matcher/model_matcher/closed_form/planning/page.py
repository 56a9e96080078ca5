"""The page of a plan: a sentence, maps to turn, rates, failing views with pictures, other cameras; one file."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from importlib import resources
from string import Template
from typing import Any

import cv2
import numpy as np

from msgs_py import FeatureKind
from msgs_py.numeric.typed import ByteArray

from ...drawing import GREEN, canvas, draw_features
from ...viewing.page import NoPlotly, json_text, plotly_script
from ..report import STYLE
from .plan import Aims, Findings
from .settings import MAP_RADIUS, PICTURES
from .task import TRIAL, shot

STATES = {'yes': 'good', 'no': 'bad', 'open': 'open'}
COLOURS = {'good': '#1a9641', 'outside': '#f28e2b', 'missed': '#d7191c'}


def plan_page(findings: Findings, aims: Aims) -> str:
    """Make the page.

    Parameters
    ----------
    findings : Findings
    aims : Aims

    Returns
    -------
    str
        HTML without a reference to any other file or address. Without plotly it has no maps, and says so.
    """
    try:
        library, missing = f'<script>{plotly_script()}</script>', ''
    except NoPlotly as error:
        library, missing = '', f'<p class="bad">No maps: {_text(error)}</p>'
    tried = '<div class="map" id="tried"></div><div class="map" id="agreement"></div>' if findings.trials else ''
    body = [
        '<h2>From where</h2>' + missing,
        '<p>The part stands in the middle; every dot is a place from which a camera sees it. Its colour is what is '
        'expected of a pose from there, or in the third what became of a picture: green a good pose, orange one '
        'outside the limits, red none. Drag to turn.</p>',
        f'<div class="maps"><div class="map" id="position"></div><div class="map" id="rotation"></div>{tried}</div>',
        '<h2>How often, how exactly</h2>',
        _rates(findings),
        _errors(findings),
        '<h2>Views that fail</h2>',
        _failing(findings),
        '<h2>The worst views</h2>',
        _pictures(findings),
        '<h2>Other cameras</h2>',
        '<p>By prediction, over the same views. Of what the picture cuts off, less of its outline is known.</p>',
        _cameras(findings),
    ]
    return Template(_part('page.html')).substitute(
        title=html.escape(f'Plan: {findings.task.part.name}'),
        style=STYLE + _part('page.css'),
        state=STATES[findings.answer(aims)],
        verdict=_text(findings.verdict(aims)),
        body='\n'.join(body),
        library=library,
        # Nothing inside may end the script element that it stands in.
        data=json_text(_data(findings)).replace('<', '\\u003c'),
        script=_part('page.js').strip(),
    )


def _data(findings: Findings) -> dict[str, Any]:
    """What the maps are drawn from: millimetres and degrees, model frame."""
    part = findings.task.part
    middle, radius = part.ball
    views = []
    for number, one in enumerate(findings.views):
        mm, deg = 1e3 * one['position'][1], one['rotation'][1]
        views.append(
            {
                'at': (1e3 * MAP_RADIUS * radius * np.array(one['direction'])).round(4).tolist(),
                'mm': mm,
                'deg': deg,
                'text': f'view {number}: {mm:.2g} mm, {deg:.2g} deg at {1e3 * one["distance"]:.0f} mm<br>'
                f'{html.escape(one["reason"])}',
            }
        )
    limits = findings.task.limits
    tried, found = [], []
    for one in findings.trials:
        for k, (error, expected) in enumerate(zip(one['errors'], one['expected'])):
            if error is not None:
                found.append([1e3 * expected[0], 1e3 * error[0]])
            if k:  # parts beside the first stand anywhere
                continue
            good = error is not None and error[0] <= limits.translation_m and error[1] <= limits.rotation_deg
            state = 'good' if good else 'missed' if error is None else 'outside'
            tried.append({**views[one['view']], 'colour': COLOURS[state]})
    return {'part': _lines(findings), 'views': views, 'tried': tried, 'found': found}


def _lines(findings: Findings) -> list[list[float | None]]:
    """The part's edges and curves about its middle, mm: x, y and z with gaps between lines."""
    part = findings.task.part
    features = part.index.features
    rows: list[list[float | None]] = []
    for k in np.flatnonzero(features.kind != FeatureKind.AXIS).tolist():
        count = 2 if features.kind[k] == FeatureKind.EDGE else 33
        points = 1e3 * (features.polyline(k, count) - part.ball[0])
        rows += [*points.round(4).tolist(), [None, None, None]]
    return [list(column) for column in zip(*rows)]


def _rates(findings: Findings) -> str:
    task = findings.task
    limits = f'{1e3 * task.limits.translation_m:g} mm and {task.limits.rotation_deg:g} deg'
    rows = [
        ['parts found', findings.recognised],
        [f'parts found within {limits}', findings.within],
        ['pictures without the part in which something is taken for it', findings.false_alarms],
        ['pictures with the part in which something else is taken for it, too', findings.wrong],
    ]
    return _table(['of rendered pictures', 'share, with its 95 % interval'], rows)


def _errors(findings: Findings) -> str:
    rows = [['expected, over all views', *_cells(findings.predicted())]]
    rendered, agreement = findings.rendered(), findings.agreement()
    if rendered is not None:
        rows.append(['of parts found in rendered pictures', *_cells(rendered)])
    said = ''
    if agreement is not None:
        times = ' and '.join(f'{one:.2f}' for one in agreement)
        said = f'<p>Rendered over expected, the median of all parts found, position and rotation: {times}.</p>'
    return _table(['errors', *_COLUMNS], rows) + said


_COLUMNS = ('position, median', '95 %', 'rotation, median', '95 %')


def _cells(errors: Sequence[float]) -> list[str]:
    typical, worst, turned, most = errors
    return [f'{1e3 * typical:.3g} mm', f'{1e3 * worst:.3g} mm', f'{turned:.3g} deg', f'{most:.3g} deg']


def _failing(findings: Findings) -> str:
    failing = findings.failing()
    if not failing:
        return '<p class="good">None, neither by prediction nor in the pictures that were tried.</p>'
    rows = []
    for one in failing:
        view = findings.views[one['view']]
        tried = (
            f'{one["missed"]} missed, {one["outside"]} outside, of {one["trials"]}' if one['trials'] else 'not tried'
        )
        rows.append(
            [
                one['view'],
                ', '.join(f'{x:.2f}' for x in view['direction']),
                f'{1e3 * view["distance"]:.0f} mm',
                tried,
                f'{1e3 * view["position"][1]:.2g} mm, {view["rotation"][1]:.2g} deg',
                one['why'],
                one['report'],
            ]
        )
    head = ['view', 'seen from', 'distance', 'pictures', 'expected, 95 %', 'why', 'what the search says']
    return _table(head, rows, words=True)


def _pictures(findings: Findings) -> str:
    figures = []
    why = {one['view']: one['why'] for one in findings.failing()}
    for number, view in findings.worst(PICTURES):
        taken = shot(findings.task, TRIAL, number)
        picture = canvas(taken.images[0])
        for pose in taken.poses:
            features = findings.task.part.index.features.transformed(pose)
            draw_features(picture, features, findings.task.rig.pair.left, [GREEN] * len(features), 1)
        expected = findings.views[view]
        caption = f'view {view}, {1e3 * expected["distance"]:.0f} mm away: {why.get(view, expected["reason"])}'
        figures.append(f'<figure>{_image(picture, caption)}<figcaption>{_text(caption)}</figcaption></figure>')
    return f'<div class="pictures">{"".join(figures)}</div>'


def _cameras(findings: Findings) -> str:
    return _table(
        ['cameras', *_COLUMNS], [[name, *_cells(errors)] for name, errors in findings.other_cameras().items()]
    )


def _image(picture: ByteArray, caption: str) -> str:
    _, data = cv2.imencode('.jpg', picture)
    coded = base64.b64encode(data.tobytes()).decode()
    return f'<img alt="{_text(caption)}" src="data:image/jpeg;base64,{coded}">'


def _table(head: Sequence[str], rows: Sequence[Sequence[Any]], words: bool = False) -> str:
    """A table; words: its cells are sentences, not numbers."""
    titles = ''.join(f'<th>{_text(cell)}</th>' for cell in head)
    body = ''.join('<tr>' + ''.join(f'<td>{_text(cell)}</td>' for cell in row) + '</tr>' for row in rows)
    kind = ' class="words"' if words else ''
    return f'<table{kind}><tr>{titles}</tr>{body}</table>'


def _text(value: Any) -> str:
    return html.escape(str(value))


def _part(name: str) -> str:
    """A file of this room."""
    return resources.files(__package__).joinpath(name).read_text(encoding='utf-8')
