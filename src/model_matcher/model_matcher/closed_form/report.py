"""The page of one closed-form test: pictures of every stage and tables of found against true."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from msgs_py import BIN, FeatureKind, PinholeCamera

from ..drawing import GREEN, GREY, RED, canvas, draw_features, side_by_side
from .result import CaseResult

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1100px; margin: 2em auto; padding: 0 1em; color: #222 }
h1 { font-size: 1.5em } h2 { font-size: 1.15em; margin-top: 2em } img { max-width: 100%; border: 1px solid #ccc }
table { border-collapse: collapse; margin: .7em 0 } td, th { padding: .15em .8em; border-bottom: 1px solid #ddd;
text-align: right } td:first-child, th:first-child { text-align: left } .good { color: #0a7a2f } .bad { color: #c11 }
figcaption { color: #555; font-size: .9em }
"""


def write_report(folder: Path, result: CaseResult, document: dict[str, Any], in_space: bool = False) -> None:
    """Write report.html and its pictures into an existing folder; in_space: view.html stands beside it."""
    camera = result.rig.left
    pictures = {
        'stereo.png': side_by_side(canvas(result.left), canvas(result.right)),
        'recovered.png': _recovered(result, camera),
        'matched.png': _matched(result, camera),
    }
    for name, picture in pictures.items():
        cv2.imwrite(str(folder / name), picture)
    state = 'good' if document['passed'] else 'bad'
    # A case through the libraries has no nodes to compare with, and does not ask the array machine.
    through_nodes = bool(document['emulator'])
    sections = [
        f'<h1>Closed-form test: {_text(document["scene"])}</h1>',
        f'<p class="{state}"><strong>{_text(document["verdict"])}</strong></p>',
        _table(
            ['', 'true', 'found'],
            [
                ['visible edges', document['true_edges'], document['recovered_edges']],
                ['matched edges', '', document['matched_edges']],
                ['rotation error', '0', _number(document['rotation_error_deg'], 'deg')],
                ['translation error', '0', _number(document['translation_error_m'], 'mm', 1e3)],
            ],
        ),
        '<p><a href="view.html">In space, to turn</a></p>' if in_space else '',
        '<h2>The stereo pair</h2>',
        _figure('stereo.png', 'Left and right image' + (', as the renderer published them.' if through_nodes else '.')),
        '<h2>Recovered edges</h2>',
        _figure('recovered.png', 'Green: recovered edges that lie on a true one. Red: others. Grey: the truth.'),
        _recovery_table(document['recovery']),
        '<h2>The matched model</h2>',
        _figure('matched.png', "The model's features at the recovered pose, over the left image."),
        _assignment_table(result),
        '<h2>Poses</h2>',
        _pose_table(document),
        '<h2>Stages</h2>',
        _table(['stage', 'milliseconds'], [[name, f'{value:.1f}'] for name, value in document['milliseconds'].items()]),
        _render_table(document['render'], through_nodes),
    ]
    if through_nodes:
        sections += [
            '<h2>Array machine</h2>',
            _table(['', ''], [[key, value] for key, value in document['emulator'].items()]),
        ]
    page = (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{_text(document["scene"])}</title>'
        f'<style>{STYLE}</style>' + '\n'.join(sections) + '</html>\n'
    )
    (folder / 'report.html').write_text(page, encoding='utf-8')


def _recovered(result: CaseResult, camera: PinholeCamera) -> np.ndarray:
    picture = canvas(result.left, dim=0.6)
    draw_features(picture, result.true_features, camera, [GREY] * len(result.true_features), 1)
    edges = result.data.of_kind(FeatureKind.EDGE)
    colours = [GREEN if index >= 0 else RED for index in result.edges.true_index]
    draw_features(picture, edges, camera, colours)
    others = result.data.select(result.data.kind != FeatureKind.EDGE)
    return draw_features(picture, others, camera)


def _matched(result: CaseResult, camera: PinholeCamera) -> np.ndarray:
    picture = canvas(result.left, dim=0.6)
    if result.found is None:
        return picture
    placed = result.model.transformed(result.found.pose)
    used = np.zeros(len(placed), bool)
    used[result.found.assignment[result.found.assignment != BIN]] = True
    draw_features(picture, placed.select(~used), camera, [GREY] * int((~used).sum()), 1)
    return draw_features(picture, placed.select(used), camera)


def _recovery_table(summary: dict[str, Any]) -> str:
    return _table(
        ['', ''],
        [
            ['visible edges of the object', summary['true_edges']],
            ['of these recovered', summary['true_edges_found']],
            ['recovered length', _number(summary['recall_of_length'], '%', 100.0)],
            ['recovered edges', summary['found_edges']],
            ['of these on no edge of the object', summary['false_edges']],
            ['direction error, median', _number(summary['direction_error_deg_median'], 'deg')],
            ['distance from the true line, median', _number(summary['distance_from_line_m_median'], 'mm', 1e3)],
        ],
    )


def _assignment_table(result: CaseResult) -> str:
    if result.found is None:
        return f'<p class="bad">{_text(result.reason)}</p>'
    lengths = 1e3 * result.data.lengths
    rows = []
    for index, (target, sign) in enumerate(zip(result.found.assignment, result.found.sign)):
        kind = FeatureKind(result.data.kind[index]).name.lower()
        rows.append(
            [
                f'{index} ({kind})',
                f'{lengths[index]:.1f}',
                'bin' if target == BIN else int(target),
                {1: '+', -1: '-', 0: ''}[int(sign)],
            ]
        )
    return _table(['data feature', 'length, mm', 'model feature', 'sign'], rows)


def _pose_table(document: dict[str, Any]) -> str:
    rows = []
    for title, key in (('true', 'true_pose'), ('found', 'found_pose')):
        matrix = document[key]
        if matrix is not None:
            values = np.array(matrix)
            numbers = ', '.join(f'{1e3 * value:.3f}' for value in values[:3, 3])
            rotation = '<br>'.join(' '.join(f'{value:+.6f}' for value in row) for row in values[:3, :3])
            rows.append(f'<tr><td>{title}</td><td>{rotation}</td><td>{numbers}</td></tr>')
    return f'<table><tr><th></th><th>rotation</th><th>translation, mm</th></tr>{"".join(rows)}</table>'


def _render_table(values: dict[str, Any], through_nodes: bool) -> str:
    rows = [
        ['largest distance of a rendered point from its surface', _number(values['surface_residual_m_max'], 'mm', 1e3)]
    ]
    if through_nodes:
        rows.append(['pixels in which node and library differ', values['node_image_differs_from_library_pixels']])
    return _table(['rendering', ''], rows)


def _figure(name: str, caption: str) -> str:
    return f'<figure><a href="{name}"><img src="{name}" alt=""></a><figcaption>{_text(caption)}</figcaption></figure>'


def _table(head: list[str], rows: list[list[Any]]) -> str:
    titles = ''.join(f'<th>{_text(cell)}</th>' for cell in head)
    body = ''.join('<tr>' + ''.join(f'<td>{_text(cell)}</td>' for cell in row) + '</tr>' for row in rows)
    return f'<table><tr>{titles}</tr>{body}</table>'


def _number(value: float | None, unit: str, factor: float = 1.0) -> str:
    return '-' if value is None or not np.isfinite(value) else f'{factor * value:.4g} {unit}'


def _text(value: Any) -> str:
    return html.escape(str(value))
