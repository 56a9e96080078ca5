"""Compiles what the tests need, on two cores, so that no test's time limit pays for it: ``python test/prepare.py``."""

from __future__ import annotations

import sys

from model_matcher.closed_form.compile_all import main

if __name__ == '__main__':
    sys.exit(main())
