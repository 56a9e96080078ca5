"""The store of measured figures: what is kept, and that pages quote commands that exist."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / 'test' / 'docs'), str(ROOT / 'test' / 'benchmarks')]
import figures  # noqa: E402
import results  # noqa: E402

NAMES = sorted(path.stem for path in results.STORE.glob('*.json'))


def test_figures_are_kept_with_command_day_and_machine(tmp_path, monkeypatch):
    monkeypatch.setattr(results, 'STORE', tmp_path / 'results')
    monkeypatch.setattr(sys, 'argv', [str(ROOT / 'test/benchmarks/bench_x.py'), '--seeds', '1..3', '--record', 'x'])
    results.keep('x', {'any': {'recall': np.float64(0.123456), 'none': float('nan'), 'n': np.int64(3)}}, timed=True)
    found = results.read('x')
    assert found.command == 'python test/benchmarks/bench_x.py --seeds 1..3' and found.timed
    assert found.figures == {'any': {'recall': 0.1235, 'none': None, 'n': 3}} == results.figures_of('x')
    assert len(found.date) == 10 and 'cores of' in found.machine
    assert found.source == f'`{found.command}`, {found.date}, {found.machine}'
    assert results.figures_of('nothing') == {}


@pytest.mark.parametrize('name', NAMES)
def test_what_is_kept_can_be_measured_again(name):
    """The command is a script of the project that has the option; one that runs several keeps each under its name."""
    words = shlex.split(results.read(name).command)
    script = ROOT / words[1]
    texts = [script.read_text()] + ([(script.parent / 'bench_photoreal.py').read_text()] if 'real' in words[1] else [])
    assert words[0] == 'python' and '--record' not in words and any('record' in text for text in texts)
    assert script.name != results.COLLECTOR or name.removeprefix('experiment_') in words
    json.dumps(results.read(name).figures, allow_nan=False)


def test_pages_quote_what_is_kept():
    names = {'views', 'renderer', 'latency', 'pictures', 'limits', 'found', 'effects', 'covariances'}
    assert names | {'chances', 'chances-images', 'numbers'} == set(figures.BLOCKS)
    for name, (page, _) in figures.BLOCKS.items():
        assert figures.written(name) in page.read_text(encoding='utf-8'), f'{name}: run python test/docs/generate.py'
    limits = figures.limits()
    share = results.read('low_visible').figures['low_visible']['wedge']
    assert f'{100 * share["right"] / share["scenes"]:.0f} % (wedge)' in limits, 'the hard corners as they are'


def test_a_paragraph_has_the_width_of_a_page():
    text = figures.paragraph('word ' * 100, '* ')
    assert text.startswith('* word') and '\n  word' in text and max(map(len, text.splitlines())) <= 120
    assert figures.table(['a'], [['x', '1']]) == '| | a |\n| --- | --- |\n| x | 1 |'
