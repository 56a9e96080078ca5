"""The synthetic renderer and a few solids, shared by the tests of this package."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest


def _load(name: str):
    spec = importlib.util.spec_from_file_location(f'stereo_recovery_test_{name}', Path(__file__).parent / f'{name}.py')
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope='session')
def synthetic():
    """The module synthetic.py beside this file."""
    return _load('synthetic')


@pytest.fixture(scope='session')
def solids(synthetic):
    """A few solids of 60 to 70 mm, in metres, centred near their origin."""
    return synthetic.solids()
