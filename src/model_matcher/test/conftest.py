"""Compiling takes a minute, once: done before any test's time limit runs (make test does it in test/prepare.py)."""

from __future__ import annotations

import pytest


def pytest_sessionstart(session: pytest.Session) -> None:
    import numba

    if numba.config.DISABLE_JIT:
        return
    from model_matcher.closed_form.run_library import be_ready

    be_ready()
