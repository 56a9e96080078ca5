"""The examples in docstrings, in all packages: what they print is what they say."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

SOURCES = Path(__file__).resolve().parent.parent / 'src'
PACKAGES = ('msgs_py', 'dap_emulator', 'csg_renderer', 'stereo_recovery', 'model_matcher')
# Where these are absent the modules that need them are passed over; all others need no ROS.
ROS = (
    'rclpy',
    'sensor_msgs',
    'geometry_msgs',
    'std_msgs',
    'std_srvs',
    'diagnostic_msgs',
    'visualization_msgs',
    'rcl_interfaces',
    'builtin_interfaces',
)
FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL


def modules_with_examples() -> list[str]:
    """Dotted names of the modules whose text has at least one example."""
    found = []
    for package in PACKAGES:
        for path in sorted((SOURCES / package / package).rglob('*.py')):
            if '>>> ' in path.read_text() and not path.name.endswith('.launch.py'):
                parts = path.relative_to(SOURCES / package).with_suffix('').parts
                found.append('.'.join(parts[:-1] if parts[-1] == '__init__' else parts))
    return found


@pytest.mark.parametrize('name', modules_with_examples())
def test_examples_print_what_they_say(name, tmp_path, monkeypatch):
    """Files that an example writes go to a folder of the test's own."""
    try:
        module = importlib.import_module(name)
    except ImportError as error:
        if (error.name or '').split('.')[0] in ROS:
            pytest.skip(f'{name} needs {error.name}')
        raise
    monkeypatch.chdir(tmp_path)
    result = doctest.testmod(module, optionflags=FLAGS)
    assert result.attempted and not result.failed, f'{result.failed} of {result.attempted} examples of {name}'
