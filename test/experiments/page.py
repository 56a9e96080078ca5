"""The page of all experiments, their plots, and the short RESULTS.md, from saved results."""

from __future__ import annotations

import html
import math
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use('Agg')
import matplotlib.pyplot as plt

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1150px; margin: 2em auto; padding: 0 1em; color: #222 }
h1 { font-size: 1.6em } h2 { font-size: 1.25em; margin-top: 2.5em; border-top: 1px solid #ccc; padding-top: .6em }
h3 { font-size: 1em; margin-bottom: .2em } img { max-width: 100% }
table { border-collapse: collapse; margin: .3em 0 1em; font-size: .92em } td, th { padding: .15em .7em;
border-bottom: 1px solid #e2e2e2; text-align: right; vertical-align: bottom }
td:first-child, th:first-child { text-align: left } td.ours { background: #eef6ee } th.ours { background: #dfeedd }
.small { color: #666; font-size: .88em } code { background: #f3f3f3; padding: 0 .25em } .missing { color: #a60 }
.failed { color: #c11 } .wide { overflow-x: auto } nav a { margin-right: .9em; white-space: nowrap }
"""
# What RESULTS.md quotes in full; the others with their sentence and the page.
SHORT_ROWS, SHORT_COLUMNS = 20, 13


def write_page(folder: Path, documents: list[dict[str, Any]]) -> None:
    """index.html and the plots beside it."""
    parts = [
        '<h1>Experiments: thesis | ours</h1>',
        '<p>Every figure marked "ours" was computed by the command below its heading; the thesis\' figures carry '
        'their table or figure number.</p>',
        '<nav>' + ' '.join(f'<a href="#{d["name"]}">{_text(d["title"])}</a>' for d in documents) + '</nav>',
    ]
    for number, group in enumerate(('The thesis', 'Beyond the thesis')):
        members = [d for d in documents if bool(d['reference']) == (number == 0)]
        if members:
            parts.append(f'<h1>{group}</h1>')
            parts += [_section(folder, document) for document in members]
    (folder / 'index.html').write_text(
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Experiments</title><style>{STYLE}</style>'
        + '\n'.join(parts)
        + '</html>\n',
        encoding='utf-8',
    )


def _section(folder: Path, document: dict[str, Any]) -> str:
    parts = [
        f'<h2 id="{document["name"]}">{_text(document["title"])} '
        f'<span class="small">{_text(document["reference"])}</span></h2>',
        f'<p class="small"><code>{_text(document["command"])}</code> &middot; {document["seconds"]} s &middot; '
        f'commit {_text(document["commit"])}{" &middot; tiny run" if document["tiny"] else ""}</p>',
    ]
    if document['status'] != 'done':
        kind = 'failed' if document['status'] == 'failed' else 'missing'
        why = document['why'].strip().splitlines()[-1]
        parts.append(f'<p class="{kind}">{_text(document["status"])}: {_text(why)}</p>')
        return '\n'.join(parts)
    parts.append(f'<p><strong>{_text(document["sentence"])}</strong></p>')
    if document.get('view'):
        parts.append(f'<p><a href="{document["name"]}.html">What was seen and found, in space, to turn</a></p>')
    for number, plot in enumerate(document['plots']):
        name = f'{document["name"]}_{number}.png'
        draw(plot, folder / name)
        parts.append(f'<img src="{name}" alt="{_text(plot["title"])}">')
    parts += [
        f'<h3>{_text(table["title"])}</h3><div class="wide">{_table(table)}</div>' for table in document['tables']
    ]
    parts += [f'<p class="small">{_text(note)}</p>' for note in document['notes']]
    return '\n'.join(parts)


def draw(plot: dict[str, Any], path: Path) -> None:
    """One saved plot as a PNG; missing values leave gaps."""
    bars = [line for line in plot['lines'] if line['style'] == 'bar']
    figure, axes = plt.subplots(figsize=(10.0, 3.9), dpi=110)
    for number, line in enumerate(bars):
        width = 0.8 / len(bars)
        values = [math.nan if y is None else y for y in line['y']]
        axes.bar(
            [k + (number - (len(bars) - 1) / 2) * width for k in range(len(values))], values, width, label=line['label']
        )
        axes.set_xticks(range(len(values)), [str(x) for x in line['x']], rotation=35, ha='right', fontsize=8)
    for line in plot['lines']:
        if line['style'] == 'bar':
            continue
        values = [math.nan if y is None else y for y in line['y']]
        style = {
            'o-': {'marker': 'o', 'ms': 4},
            'o--': {'marker': 'o', 'ms': 4, 'ls': '--'},
            '--': {'ls': '--', 'color': '0.4'},
            'o': {'marker': 'o', 'ls': ''},
            '-': {},
        }[line['style']]
        if line['style'] == '--' and line['label'].endswith('limit') and axes.lines:
            style['color'] = axes.lines[-1].get_color()  # the limit of the series before it
        axes.plot(line['x'], values, label=line['label'], **style)
    if plot['log_y']:
        axes.set_yscale('log')
    if plot['log_x']:
        axes.set_xscale('log')
    axes.set(title=plot['title'], xlabel=plot['x_label'], ylabel=plot['y_label'])
    axes.grid(True, axis='y', alpha=0.3)
    if len(plot['lines']) > 1:
        axes.legend(fontsize=8, loc='upper left', bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)


def write_results(path: Path, documents: list[dict[str, Any]]) -> None:
    """The committed summary: one sentence and the tables that are short enough."""
    lines = [
        '# Results of the experiments',
        '',
        'Written by `make experiments` (`python test/experiments/run.py --force` runs everything again) from the '
        'last result of each experiment; plots and all tables are in `out/experiments/index.html`. "thesis" is '
        'what '
        'the thesis prints, "ours" was computed by the command that stands below the heading.',
        '',
    ]
    for document in documents:
        reference = document['reference'] or 'beyond the thesis'
        lines += [f'## {document["title"]} ({reference})', '', f'`{document["command"]}`, {document["seconds"]} s', '']
        if document['status'] != 'done':
            lines += [f'{document["status"]}: {document["why"].strip().splitlines()[-1]}', '']
            continue
        lines += [document['sentence'], '']
        for table in document['tables']:
            if len(table['rows']) > SHORT_ROWS or len(table['columns']) > SHORT_COLUMNS:
                lines += [f'{table["title"]}: on the page.', '']
                continue
            lines += [
                f'{table["title"]}:',
                '',
                '| ' + ' | '.join(table['columns']) + ' |',
                '|' + ' --- |' * len(table['columns']),
            ]
            lines += ['| ' + ' | '.join(cell(value) for value in row) + ' |' for row in table['rows']]
            lines.append('')
        lines += [f'{note}' for note in document['notes']]
        if document['notes']:
            lines.append('')
    path.write_text('\n'.join(lines).rstrip() + '\n', encoding='utf-8')


def _table(table: dict[str, Any]) -> str:
    ours = ['ours' if 'ours' in title else '' for title in table['columns']]
    head = ''.join(f'<th class="{kind}">{_text(title)}</th>' for title, kind in zip(table['columns'], ours))
    rows = ''.join(
        '<tr>' + ''.join(f'<td class="{kind}">{_text(cell(value))}</td>' for value, kind in zip(row, ours)) + '</tr>'
        for row in table['rows']
    )
    return f'<table><tr>{head}</tr>{rows}</table>'


def cell(value: Any) -> str:
    """A cell as text: '-' for what is not known, four digits for a fraction."""
    if value is None:
        return '-'
    if isinstance(value, float):
        if not math.isfinite(value):
            return '-'
        return f'{value:.0f}' if abs(value) >= 1e4 else f'{value:.4g}'
    return str(value)


def _text(value: Any) -> str:
    return html.escape(str(value))
