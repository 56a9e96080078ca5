"""Fixtures: machines, and an emulator_node that spins in a context of its own."""

from __future__ import annotations

import base64
import itertools
import json
import os
import shutil
import subprocess
import sys
import threading
import time

import pytest

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

from dap_emulator import Dap

_domains = itertools.count()


@pytest.fixture
def dap():
    return Dap.model('510')


class Browser:
    """A headless Chromium, driven over its DevTools pipe as a person would: keys, mouse, and what the page shows."""

    def __init__(self, program, folder):
        command, answer = os.pipe(), os.pipe()
        self._write = os.fdopen(command[1], 'wb', buffering=0)
        self._read = os.fdopen(answer[0], 'rb')
        options = ['--headless', '--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage', '--no-first-run']
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

    def open(self, path):
        self.events.clear()
        self.send('Page.navigate', url=path.resolve().as_uri())
        self.wait("document.readyState === 'complete' && document.body.dataset.step !== undefined")

    def evaluate(self, expression):
        found = self.send('Runtime.evaluate', expression=expression, awaitPromise=True, returnByValue=True)
        assert 'exceptionDetails' not in found, found['exceptionDetails']
        return found['result'].get('value')

    def wait(self, expression, timeout=15.0):
        deadline = time.monotonic() + timeout
        while not self.evaluate(expression):
            assert time.monotonic() < deadline, f'never true: {expression}'

    def key(self, name):
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
        left, top, width, height = self.box(selector)
        place = {'x': left + across * width, 'y': top + down * height}
        self.send('Input.dispatchMouseEvent', type='mouseMoved', **place)
        if click:
            for kind in ('mousePressed', 'mouseReleased'):
                self.send('Input.dispatchMouseEvent', type=kind, button='left', clickCount=1, **place)

    def picture(self, path):
        path.write_bytes(base64.b64decode(self.send('Page.captureScreenshot')['data']))

    def close(self):
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


class Emulator:
    """An emulator_node spun by a thread, and clients in the same context."""

    def __init__(self, **parameters):
        import rclpy
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor

        from dap_emulator.node import EmulatorNode

        worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:])
        self.context = Context()
        rclpy.init(context=self.context, domain_id=1 + (50 + worker * 25 + next(_domains)) % 100)
        overrides = [rclpy.Parameter(name, value=value) for name, value in parameters.items()]
        self.node = EmulatorNode(context=self.context, parameter_overrides=overrides)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        self._clients = []

    def _spin(self):
        while not self._stop.is_set() and self.context.ok():
            self.executor.spin_once(timeout_sec=0.05)

    def client(self, name=None, **options):
        from dap_emulator import DapClient

        client = DapClient(client=name, context=self.context, **options)
        self._clients.append(client)
        return client

    def close(self):
        import rclpy

        for client in self._clients:
            client.close()
        self._stop.set()
        self._thread.join(timeout=10)
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def start_emulator():
    """start_emulator(**parameters) -> Emulator"""
    running = []

    def start(**parameters):
        running.append(Emulator(**parameters))
        return running[-1]

    yield start
    for emulator in running:
        emulator.close()
