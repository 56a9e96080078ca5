"""The page on this machine: one HTML document, and what is live as server-sent events (HTML Living Standard, 9.2)."""

from __future__ import annotations

import contextlib
import errno
import threading
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any

from .page import json_text
from .settings import SILENT_S

HOST = '127.0.0.1'
# A page of somewhere else whose name was made to lead here (DNS rebinding) must not read the images.
NAMES = ('localhost', HOST)


class PageServer:
    """Serves a page to browsers of this machine until it is closed.

    Parameters
    ----------
    page : str
        HTML; it may be replaced later.
    port : int
        0 for any that is free.

    Attributes
    ----------
    page : str
    url : str
        What to open.

    Raises
    ------
    ValueError
        The port cannot be had; says why.
    """

    def __init__(self, page: str, port: int) -> None:
        self.page = page
        self._changed = threading.Condition()
        self._number = 0
        self._make: Callable[[], dict[str, Any]] | None = None
        self._closed = False
        try:
            self._http = ThreadingHTTPServer((HOST, port), self._handler())
        except (OSError, OverflowError) as error:
            raise ValueError(_refused(port, error)) from None
        self._http.daemon_threads = True
        self.url = f'http://localhost:{self._http.server_address[1]}/'
        self._thread = threading.Thread(target=self._http.serve_forever, daemon=True)
        self._thread.start()

    def show(self, make: Callable[[], dict[str, Any]]) -> None:
        """Show something to every browser that listens, and to those that come.

        Parameters
        ----------
        make : callable
            Makes what page.js takes; called by the thread of each browser, and not at all where there is none.
        """
        with self._changed:
            self._make = make
            self._number += 1
            self._changed.notify_all()

    def close(self) -> None:
        """Stop serving."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._http.shutdown()
        self._http.server_close()
        self._thread.join()

    def __enter__(self) -> PageServer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        server = self

        class Handler(BaseHTTPRequestHandler):
            """Answers one browser."""

            def do_GET(self) -> None:
                """The page, or its events; a browser that has gone shows itself by a broken pipe."""
                with contextlib.suppress(OSError):
                    self._answer()

            def _answer(self) -> None:
                if self.headers.get('Host', '').rpartition(':')[0] not in NAMES:
                    self.send_error(HTTPStatus.FORBIDDEN)
                elif self.path == '/':
                    page = server.page.encode()
                    self._begin('text/html; charset=utf-8', len(page))
                    self.wfile.write(page)
                elif self.path == '/events':
                    self._begin('text/event-stream')
                    server._send_events(self.wfile.write)
                else:
                    self.send_error(HTTPStatus.NOT_FOUND)

            def _begin(self, kind: str, length: int | None = None) -> None:
                self.send_response(HTTPStatus.OK)
                self.send_header('Content-Type', kind)
                self.send_header('Cache-Control', 'no-store')
                if length is not None:
                    self.send_header('Content-Length', str(length))
                self.end_headers()

            def log_message(self, format: str, *arguments: Any) -> None:
                """Say nothing: the log is the node's."""

        return Handler

    def _send_events(self, write: Callable[[bytes], Any]) -> None:
        """Send what is shown, the newest only, until the browser or the server has gone."""
        sent = 0
        while True:
            with self._changed:
                if self._number == sent and not self._closed:
                    self._changed.wait(SILENT_S)
                if self._closed:
                    return
                make, number = self._make, self._number
            if number == sent or make is None:
                write(b': still here\n\n')
                continue
            sent = number
            write(b'data: ' + json_text(make()).encode() + b'\n\n')


def _refused(port: int, error: Exception) -> str:
    """Why a port cannot be had, and what to do."""
    code = getattr(error, 'errno', None)
    if code == errno.EADDRINUSE:
        return f'port {port}: another program of this machine has it; name another one, or 0 for any that is free'
    if code == errno.EACCES:
        return f'port {port}: not allowed for this user; name one above 1023, or 0 for any that is free'
    return f'port {port}: cannot be used ({error}); name one from 1024 to 65535, or 0 for any that is free'
