"""The public names are those that are recorded: nothing goes or changes by accident."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parent / 'docs' / 'api_surface.py'


def test_the_public_names_are_those_recorded():
    result = subprocess.run(
        [sys.executable, str(SCRIPT), '--check'], capture_output=True, text=True, timeout=50, check=False
    )
    assert result.returncode == 0, (
        f'{result.stdout}{result.stderr[-2000:]}\nIf that is meant: python test/docs/api_surface.py, and a line in the '
        'CHANGELOG.rst of the package'
    )
