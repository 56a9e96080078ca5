"""Watching a program: what is recorded, and the page in a real browser."""

import base64
import json
import re
import zlib

import numpy as np
import pytest

from dap_emulator import Dap
from dap_emulator.bit_planes.reals import Format
from dap_emulator.dap_cli import main
from dap_emulator.fortran_plus import compile
from dap_emulator.fortran_plus.examples import example, picture
from dap_emulator.fortran_plus.library import load_program, program_names
from dap_emulator.machine.fields import real_cells
from dap_emulator.watch import Recorder, write_page
from dap_emulator.watch.page import page_of


def recorded(name_or_source, entry=None, **arguments):
    dap = Dap.model('510')
    recorder = Recorder(dap)
    program = load_program(name_or_source) if name_or_source in program_names() else compile(name_or_source)
    return recorder, program.run(dap, entry, observer=recorder, **arguments)


def data_of(page):
    text = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[1]
    return json.loads(text)


def values_at(data, name, step, call=None):
    """Values of an array after a step, decoded from a page's data."""
    call = data['calls'][data['steps'][step][0] if call is None else call]
    array = data['arrays'][call['arrays'][name]]
    _, _, blob = [change for change in array['changes'] if change[0] <= step][-1]
    raw = zlib.decompress(base64.b64decode(data['blobs'][blob]))
    size = int(np.prod(array['parallel']))
    if array['dtype'] == 'bit':
        return np.unpackbits(np.frombuffer(raw, np.uint8), bitorder='little')[:size].reshape(array['parallel']) != 0
    return np.frombuffer(raw, array['dtype']).reshape(array['parallel'])


def steps_of(data, line):
    return [index for index, step in enumerate(data['steps']) if step[1] == line and not step[8]]


def generation(cells):
    rows = cells.astype(int) + np.roll(cells, 1, 0) + np.roll(cells, -1, 0)
    n = rows + np.roll(rows, 1, 1) + np.roll(rows, -1, 1) - cells
    return (n == 3) | (cells & (n == 2))


# What is recorded.


def test_every_statement_is_recorded_with_values_mask_cycles_and_store():
    source = (
        'ENTRY SUBROUTINE F(A, K)\nREAL A(,)\nINTEGER K\nA = 2.0*A\nA(A .GT. 3.0) = 0.0\nA(2,) = 9.0\nK = K + 1\nEND'
    )
    start = np.arange(12, dtype='f4').reshape(3, 4) / 3
    recorder, result = recorded(source, a=start, k=4)
    data = data_of(page_of(recorder, result, 'F'))
    assert [(step[1], bool(step[8])) for step in data['steps']] == [
        (1, True),
        *((line, False) for line in (4, 5, 6, 7)),
    ]
    assert np.array_equal(values_at(data, 'A', 0), start) and np.array_equal(values_at(data, 'A', 1), 2 * start)
    assert np.array_equal(values_at(data, 'A', 2), np.where(2 * start > 3, 0, 2 * start))
    assert np.array_equal(values_at(data, 'A', 4), result['A'])
    masks = [zlib.decompress(base64.b64decode(data['blobs'][step[7]])) for step in data['steps'] if step[6] == 'A']
    flags = [np.unpackbits(np.frombuffer(raw, np.uint8), bitorder='little')[:12].reshape(3, 4) for raw in masks]
    assert np.array_equal(flags[0], 2 * start > 3) and flags[1].tolist() == [[0] * 4, [1] * 4, [0] * 4]
    assert data['steps'][-1][3] == result.cycles == sum(cycles for _, cycles in data['profile'])
    assert sum(step[4] for step in data['steps']) == result.cycles
    assert data['calls'][0]['scalars'] == [[0, 'K', '4'], [4, 'K', '5']]
    assert data['times'] == {str(line): 1 for line in (4, 5, 6, 7)}


def test_watching_changes_nothing():
    for name in ('life', 'sobel', 'sorts', 'csg_combine', 'pairwise', 'tree'):
        entry, arguments = example(name)
        alone = load_program(name).run(Dap.model('510'), entry, **arguments)
        recorder, watched = recorded(name, entry, **arguments)
        assert watched.cycles == alone.cycles and watched.stats.lines == alone.stats.lines
        for key in alone:
            np.testing.assert_array_equal(watched[key], alone[key])
        assert sum(recorder.profile.values()) == alone.cycles


def test_what_is_too_long_is_cut_and_the_page_says_so(monkeypatch):
    monkeypatch.setattr('dap_emulator.watch.recorder.MAX_STEPS', 7)
    recorder, result = recorded('life', cells=np.ones((8, 8), bool), generations=5)
    data = data_of(page_of(recorder, result, 'life'))
    assert len(data['steps']) == 7 and data['note'].startswith('The first 7 of 37 steps are recorded')
    assert data['times']['10'] == 5 and sum(cycles for _, cycles in data['profile']) == result.cycles


def test_calls_have_arrays_of_their_own_and_a_failing_run_can_be_shown_to_where_it_failed():
    source = (
        'ENTRY SUBROUTINE F(A)\nINTEGER A(*4,*4)\nCALL G(A, 2)\nA = 7\nEND\n'
        'SUBROUTINE G(X, N)\nINTEGER X(,), N, L(*4,*4)\nL = X + N\nIF (N .GT. 0) CALL G(L, N - 1)\nX = L\nEND\n'
    )
    recorder, result = recorded(source)
    assert [call.unit for call in recorder.calls] == ['F', 'G', 'G', 'G']
    numbers = [call.arrays for call in recorder.calls]
    assert numbers[1]['X'] == numbers[0]['A'] and numbers[2]['X'] == numbers[1]['L'] != numbers[2]['L']
    assert max(step.depth for step in recorder.steps) == 4 and (result['A'] == 7).all()
    deepest = max(recorder.profile, key=len)
    assert [unit for unit, _ in deepest] == ['F', 'G', 'G', 'G']


def test_the_page_needs_nothing_else_and_nothing_in_it_ends_its_script(tmp_path):
    source = "ENTRY SUBROUTINE F(C)\nCHARACTER C(9)\nC(1) = '<'\nC(2) = '/'\n! </script><script>alert(1)</script>\nEND"
    recorder, result = recorded(source)
    page = page_of(recorder, result, '<b>&')
    assert not re.search(r'(src|href)\s*=|url\(|https?://|@import', page)
    assert page.count('</script>') == 2 and '<title>&lt;b&gt;&amp;</title>' in page
    assert data_of(page)['source'][4] == '! </script><script>alert(1)</script>'
    with pytest.raises(ValueError, match=r'\.html'):
        write_page(tmp_path / 'page.txt', recorder, result, 'F')


def test_words_of_the_command(tmp_path, capsys):
    target = tmp_path / 'life.html'
    assert main(['run', 'life', '--example', '-a', 'generations=2', '--html', str(target)]) == 0
    assert 'GENERATIONS      2' in capsys.readouterr().out and len(data_of(target.read_text())['steps']) == 16
    for word, text in (('list', 'mandelbrot'), ('functions', 'MAXV'), ('costs', 'thesis 3.2.1')):
        assert main([word]) == 0 and text in capsys.readouterr().out
    assert main(['run']) == 2 and main(['life', '--example', '--html', 'x.txt']) == 2
    assert main(['run', str(tmp_path / 'own.fpp'), '--example']) == 2
    assert 'neither a file' in capsys.readouterr().err


def test_what_is_printed_stands_on_the_page_and_huge_numbers_have_no_part_in_the_colours():
    source = "ENTRY SUBROUTINE F(A)\nREAL A(*2,*2)\nPRINT *, 'begun'\nA = 1.0E30\nA(1,) = 3.0\nEND"
    recorder, result = recorded(source)
    data = data_of(page_of(recorder, result, 'F'))
    assert data['printed'] == ['begun'] and data['arrays'][0]['high'] == 3.0 < data['largest'] < 1e30


def test_a_program_that_fails_is_shown_up_to_its_failure(tmp_path, capsys):
    file, target = tmp_path / 'fails.fpp', tmp_path / 'fails.html'
    file.write_text('ENTRY SUBROUTINE F(A)\nREAL A(*4,*4)\nINTEGER I, J\nA = 2.0\nCALL G(A, J)\nEND\n')
    with open(file, 'a') as more:
        more.write('SUBROUTINE G(A, J)\nREAL A(,)\nINTEGER J\nA = 3.0\nJ = 1/J\nEND\n')
    assert main([str(file), '--html', str(target)]) == 1
    assert 'wrote' in capsys.readouterr().out
    data = data_of(target.read_text())
    assert [step[1] for step in data['steps']] == [1, 4, 7, 10, 11, 5]
    assert data['printed'][0].startswith('ended by: line 11, column 1: division of an INTEGER by zero')
    assert (values_at(data, 'A', 4) == 3.0).all() and sum(c for _, c in data['profile']) == data['cycles']


# The page in a browser.


def shown(browser, name, rows, columns):
    """(rows, columns, 3): colours in the middle of every element of an array's picture."""
    found = browser.evaluate(
        f"""(() => {{
          const canvas = document.querySelector('figure[data-name="{name}"] canvas');
          const pixels = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
          const scale = canvas.width / {columns}, found = [];
          for (let r = 0; r < {rows}; r += 1) for (let c = 0; c < {columns}; c += 1) {{
            const at = 4 * (Math.floor((r + 0.5) * scale) * canvas.width + Math.floor((c + 0.5) * scale));
            found.push([pixels.data[at], pixels.data[at + 1], pixels.data[at + 2]]);
          }}
          return found;
        }})()"""
    )
    return np.array(found).reshape(rows, columns, 3)


def go(browser, step):
    """To a step by way of the keyboard: the slider's own keys."""
    browser.evaluate(f"document.getElementById('slider').value = {step}")
    browser.evaluate("document.getElementById('slider').dispatchEvent(new Event('input'))")
    browser.wait(f"document.body.dataset.step === '{step}'")


def point_at(browser, name, row, column, rows, columns):
    browser.mouse(f'figure[data-name="{name}"] canvas', (column + 0.5) / columns, (row + 0.5) / rows)
    return browser.evaluate("document.getElementById('tip').textContent")


def assert_quiet(browser):
    """Nothing was fetched from anywhere, and no error was logged."""
    methods = {event['method'] for event in browser.events}
    assert not methods & {'Runtime.exceptionThrown', 'Log.entryAdded'}, browser.events
    asked = [e['params']['request']['url'] for e in browser.events if e['method'] == 'Network.requestWillBeSent']
    assert all(url.startswith(('file:', 'blob:', 'data:')) for url in asked), asked


def test_life_in_a_browser(browser, tmp_path):
    cells = np.random.default_rng(1).random((24, 40)) < 0.35
    recorder, result = recorded('life', cells=cells, generations=4)
    write_page(tmp_path / 'life.html', recorder, result, 'life')
    data = data_of((tmp_path / 'life.html').read_text())
    browser.open(tmp_path / 'life.html')
    assert np.array_equal(shown(browser, 'CELLS', 24, 40)[..., 0] > 128, cells)
    # One statement on by key, then the masked assignment by a click on its line.
    browser.key('ArrowRight')
    browser.wait("document.body.dataset.step === '1'")
    browser.mouse('#source .row[data-line="11"]', 0.6, 0.5, click=True)
    masked = steps_of(data, 11)[0]
    browser.wait(f"document.body.dataset.step === '{masked}'")
    assert np.array_equal(shown(browser, 'active', 24, 40)[..., 0] > 128, cells)
    caption = browser.evaluate("document.querySelector('figure.mask figcaption').textContent")
    assert caption == f'activity mask of ALIVE{cells.sum()} of 960 active'
    row, column = np.argwhere(~cells)[5]
    assert point_at(browser, 'ALIVE', row, column, 24, 40) == (
        f'ALIVE({row + 1},{column + 1}) = 0\ninactive: keeps its value'
    )
    # Values on the way, and the last generation by a click at the slider's end.
    third = steps_of(data, 14)[2]
    go(browser, third)
    now = generation(generation(cells)).astype(int)
    rows = now + np.roll(now, 1, 0) + np.roll(now, -1, 0)
    n = rows + np.roll(rows, 1, 1) + np.roll(rows, -1, 1) - now
    assert point_at(browser, 'N', 7, 31, 24, 40) == f'N(8,32) = {n[7, 31]}'
    browser.mouse('#slider', 0.999, 0.5, click=True)
    browser.wait(f"document.body.dataset.step === '{len(data['steps']) - 1}'")
    for _ in range(4):
        cells = generation(cells)
    assert np.array_equal(shown(browser, 'CELLS', 24, 40)[..., 0] > 128, cells)
    counters = browser.evaluate("document.getElementById('counters').textContent")
    assert f'cycles so far{result.cycles:,}' in counters
    cycles = browser.evaluate('document.querySelector(\'#source .row[data-line="13"] .cycles\').textContent')
    assert cycles == f'{result.stats.lines[13][1]:,}'
    assert_quiet(browser)


def test_sobel_in_a_browser_with_bit_planes(browser, tmp_path):
    image = picture(40, 48)
    assert main(['sobel', '-a', f'image={_saved(tmp_path, image)}', '--html', str(tmp_path / 'sobel.html')]) == 0
    data = data_of((tmp_path / 'sobel.html').read_text())
    browser.open(tmp_path / 'sobel.html')
    after_gx = steps_of(data, 10)[0]
    go(browser, after_gx)
    line = np.pad(image.astype(int), ((1, 1), (0, 0)))
    line = line[:-2] + 2 * line[1:-1] + line[2:]
    assert point_at(browser, 'LINE', 20, 30, 40, 48) == f'LINE(21,31) = {line[20, 30]}'
    wide = np.pad(line, ((0, 0), (1, 1)))
    assert point_at(browser, 'GX', 20, 30, 40, 48) == f'GX(21,31) = {wide[20, 32] - wide[20, 30]}'
    select = 'document.querySelector(\'figure[data-name="LINE"] select\')'
    browser.evaluate(f'{select}.value = 5')
    browser.evaluate(f'{select}.onchange()')
    browser.wait("document.querySelector('figure[data-name=\"LINE\"] select').value === '5'")
    assert np.array_equal(shown(browser, 'LINE', 40, 48)[..., 0] > 128, line >> 5 & 1)
    assert (
        point_at(browser, 'LINE', 20, 30, 40, 48) == f'LINE(21,31) = .{"TRUE" if line[20, 30] >> 5 & 1 else "FALSE"}.'
    )
    assert_quiet(browser)


def test_a_machine_on_bit_planes_shows_its_own_planes_in_a_browser(browser, tmp_path):
    dap = Dap.model('510', arithmetic='bits')
    recorder = Recorder(dap)
    a = np.array([[1.0, -2.5, 0.0], [0.1, 1e60, float('inf')]])
    result = compile('REAL*5 A(,)\nA = A * 1.0').run(dap, observer=recorder, a=a)
    write_page(tmp_path / 'planes.html', recorder, result, 'planes')
    browser.open(tmp_path / 'planes.html')
    assert [point_at(browser, 'A', 0, column, 2, 3) for column in range(3)] == [
        'A(1,1) = 1',
        'A(1,2) = -2.5',
        'A(1,3) = 0',
    ]
    assert point_at(browser, 'A', 1, 2, 2, 3) == 'A(2,3) = Infinity'
    select = 'document.querySelector(\'figure[data-name="A"] select\')'
    assert browser.evaluate(f'{select}.options.length') == 1 + 40
    patterns = real_cells(a, Format(40)).astype(np.uint64)
    for plane in (
        39,
        38,
        28,
        3,
    ):  # the sign, the highest of the exponent, the last of the first digit, one further down
        browser.evaluate(f'{select}.value = {plane}')
        browser.evaluate(f'{select}.onchange()')
        browser.wait(f"{select}.value === '{plane}'")
        assert np.array_equal(shown(browser, 'A', 2, 3)[..., 0] > 128, patterns >> np.uint64(plane) & np.uint64(1))
    assert_quiet(browser)


def _saved(folder, image):
    np.save(folder / 'image.npy', image)
    return folder / 'image.npy'


def test_the_tree_search_in_a_browser(browser, tmp_path, capsys):
    assert main(['run', 'tree', '--example', '--html', str(tmp_path / 'tree.html')]) == 0
    assert 'COUNT            10' in capsys.readouterr().out
    data = data_of((tmp_path / 'tree.html').read_text())
    browser.open(tmp_path / 'tree.html')
    entered = next(k for k, step in enumerate(data['steps']) if step[8] and step[2] == 4)
    go(browser, entered)
    line = data['steps'][entered][1]
    assert browser.evaluate("document.getElementById('where').textContent").endswith(f'enter TRAVERSE, line {line}')
    assert 'LEVEL = 3' in browser.evaluate("document.getElementById('scalars').textContent")
    assert browser.evaluate('document.querySelectorAll(\'figure[data-name="MATCH"] input[type="range"]\').length') == 1
    tops = browser.evaluate("[...document.querySelectorAll('#flame .box')].map((box) => box.offsetTop)")
    assert len(set(tops)) >= 8, 'the calls of ten levels stand one in the other'
    browser.key('End')
    browser.wait(f"document.body.dataset.step === '{len(data['steps']) - 1}'")
    assert 'COUNT = 10' in browser.evaluate("document.getElementById('scalars').textContent")
    assert_quiet(browser)
