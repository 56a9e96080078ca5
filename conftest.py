"""What all tests share: profiles of hypothesis, a run in which compiled functions are interpreted, and a browser."""

from __future__ import annotations

import base64
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from types import FrameType

import pytest
from hypothesis import Phase, settings

# make fresh-seeds: looks for what nobody has seen.
# How long a page may take to show something, seconds.
OPENING_S = 60.0

settings.register_profile('many', max_examples=1000, deadline=None)
# make mutants: failures that nobody reads.
settings.register_profile('mutants', database=None, deadline=None, phases=(Phase.explicit, Phase.generate))


def pytest_addoption(parser: pytest.Parser) -> None:
    """The option ``--interpreted``."""
    parser.addoption(
        '--interpreted',
        type=float,
        metavar='SECONDS',
        help='run compiled functions as plain Python; a test that needs more CPU time is ended and skipped',
    )


def pytest_configure(config: pytest.Config) -> None:
    """Tell numba, which no plugin has imported yet, not to compile."""
    config.addinivalue_line('markers', 'compiled: needs machine code, or its speed, and is not run interpreted')
    if config.getoption('--interpreted'):
        os.environ['NUMBA_DISABLE_JIT'] = '1'


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is about machine code."""
    if config.getoption('--interpreted'):
        items[:] = [item for item in items if item.get_closest_marker('compiled') is None]


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """End a test that takes too long interpreted."""
    limit = item.config.getoption('--interpreted')

    def end(_: int, frame: FrameType | None) -> None:
        if _holds_a_lock(frame):
            signal.setitimer(signal.ITIMER_PROF, 0.01)  # in a moment
            return
        # A skip passes through hypothesis, which would look for a smaller example of any other exception.
        pytest.skip(f'takes longer than {limit:g} s interpreted')

    if limit:
        signal.signal(signal.SIGPROF, end)
        signal.setitimer(signal.ITIMER_PROF, limit)
    yield
    if limit:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _holds_a_lock(frame: FrameType | None) -> bool:
    """Whether the code that was interrupted is in the middle of coverage's own, or of an import."""
    for _ in range(5):  # deeper down is the program, started by coverage
        if frame is None:
            return False
        if '/coverage/' in frame.f_code.co_filename or 'importlib' in frame.f_code.co_filename:
            return True
        frame = frame.f_back
    return False


class Browser:
    """A headless Chromium, driven over its DevTools pipe as a person would: keys, mouse, and what the page shows."""

    def __init__(self, program, folder):
        command, answer = os.pipe(), os.pipe()
        self._write = os.fdopen(command[1], 'wb', buffering=0)
        self._read = os.fdopen(answer[0], 'rb')
        options = ['--headless', '--no-sandbox', '--disable-dev-shm-usage', '--no-first-run']
        # Pages in space are drawn by the processor: no graphics card is expected.
        options += ['--use-angle=swiftshader', '--enable-unsafe-swiftshader']
        options += ['--remote-debugging-pipe', '--window-size=1400,1000', f'--user-data-dir={folder}']
        # The browser reads commands from descriptor 3 and answers on 4.
        script = (
            'import fcntl, os, sys; high = [fcntl.fcntl(int(n), fcntl.F_DUPFD, 10) for n in sys.argv[1:3]]; '
            'os.dup2(high[0], 3); os.dup2(high[1], 4); os.execv(sys.argv[3], sys.argv[3:])'
        )
        self._process = subprocess.Popen(
            [sys.executable, '-c', script, str(command[0]), str(answer[1]), program, *options],
            pass_fds=[command[0], answer[1]],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(command[0])
        os.close(answer[1])
        self._numbers = itertools.count(1)
        self.events = []
        target = self.send('Target.createTarget', url='about:blank')['targetId']
        self._session = None
        self._session = self.send('Target.attachToTarget', targetId=target, flatten=True)['sessionId']
        for domain in ('Page', 'Runtime', 'Network', 'Log'):
            self.send(f'{domain}.enable')

    def send(self, method, **parameters):
        """A command of the DevTools protocol, and its answer; events that come meanwhile are kept."""
        number = next(self._numbers)
        message = {'id': number, 'method': method, 'params': parameters}
        if getattr(self, '_session', None):
            message['sessionId'] = self._session
        self._write.write(json.dumps(message).encode() + b'\0')
        while True:
            letters = bytearray()
            while (letter := self._read.read(1)) != b'\0':
                assert letter, 'the browser has gone'
                letters += letter
            answer = json.loads(letters)
            if answer.get('id') == number:
                assert 'error' not in answer, answer
                return answer['result']
            self.events.append(answer)

    def open(self, page):
        """A file, or an address; waits until the page says that it has drawn."""
        self.events.clear()
        self.send('Page.navigate', url=page if isinstance(page, str) else page.resolve().as_uri())
        # Megabytes of script are compiled first, beside whatever else the machine does.
        self.wait("document.readyState === 'complete' && document.body.dataset.step !== undefined", OPENING_S)

    def evaluate(self, expression):
        """The value of an expression in the page."""
        found = self.send('Runtime.evaluate', expression=expression, awaitPromise=True, returnByValue=True)
        assert 'exceptionDetails' not in found, found['exceptionDetails']
        return found['result'].get('value')

    def wait(self, expression, timeout=15.0):
        """Wait until an expression is true in the page."""
        deadline = time.monotonic() + timeout
        while not self.evaluate(expression):
            assert time.monotonic() < deadline, f'never true: {expression}'

    def key(self, name):
        """Press a key."""
        for kind in ('keyDown', 'keyUp'):
            self.send('Input.dispatchKeyEvent', type=kind, key=name, code=name)

    def box(self, selector):
        """Left, top, width and height of an element, scrolled into view."""
        return self.evaluate(
            f'(() => {{ const e = document.querySelector({json.dumps(selector)});'
            ' e.scrollIntoView({block: "nearest"}); const b = e.getBoundingClientRect();'
            ' return [b.left, b.top, b.width, b.height]; })()'
        )

    def mouse(self, selector, across=0.5, down=0.5, click=False):
        """Point at a place of an element, from 0 to 1 across and down it."""
        left, top, width, height = self.box(selector)
        place = {'x': left + across * width, 'y': top + down * height}
        self.send('Input.dispatchMouseEvent', type='mouseMoved', **place)
        if click:
            for kind in ('mousePressed', 'mouseReleased'):
                self.send('Input.dispatchMouseEvent', type=kind, button='left', clickCount=1, **place)

    def drag(self, selector, path):
        """Press at the first of some places of an element, and draw the mouse over the others; see :meth:`mouse`."""
        left, top, width, height = self.box(selector)
        places = [{'x': left + across * width, 'y': top + down * height} for across, down in path]
        held = {'button': 'left', 'buttons': 1, 'clickCount': 1}
        self.send('Input.dispatchMouseEvent', type='mouseMoved', **places[0])
        self.send('Input.dispatchMouseEvent', type='mousePressed', **places[0], **held)
        for place in places[1:]:
            self.send('Input.dispatchMouseEvent', type='mouseMoved', **place, **held)
        self.send('Input.dispatchMouseEvent', type='mouseReleased', **places[-1], **held)

    def errors(self):
        """Exceptions and errors in the console since the page was opened."""
        entries = [one['params'] for one in self.events if one['method'] == 'Log.entryAdded']
        said = [one['params'] for one in self.events if one['method'] == 'Runtime.consoleAPICalled']
        return [
            *(one for one in self.events if one['method'] == 'Runtime.exceptionThrown'),
            *(one for one in entries if one['entry']['level'] == 'error'),
            *(one for one in said if one['type'] in ('error', 'assert')),
        ]

    def asked(self):
        """Addresses that were asked for since the page was opened."""
        return [e['params']['request']['url'] for e in self.events if e['method'] == 'Network.requestWillBeSent']

    def picture(self, path):
        """A screenshot."""
        path.write_bytes(base64.b64decode(self.send('Page.captureScreenshot')['data']))

    def close(self):
        """End the browser."""
        self._write.close()
        try:
            self._process.wait(timeout=5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._read.close()


@pytest.fixture(scope='module')
def browser(tmp_path_factory):
    """A headless Chromium; tests that need one are skipped where none is installed."""
    names = ('chromium', 'chromium-browser', 'google-chrome', 'chrome')
    program = next(filter(None, map(shutil.which, names)), None)
    if program is None:
        pytest.skip(f'no browser: none of {", ".join(names)} is installed')
    browser = Browser(program, tmp_path_factory.mktemp('browser'))
    yield browser
    browser.close()
