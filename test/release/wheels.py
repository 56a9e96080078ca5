"""Builds the packages as wheels, each from a copy that holds nothing but its sources.

python test/release/wheels.py out/wheels
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ('msgs_py', 'dap_emulator', 'csg_renderer', 'stereo_recovery', 'model_matcher')
LEFT_OUT = ('build', '*.egg-info', '__pycache__', 'test', 'docs')


# What pip calls for a package without a pyproject.toml.
BACKEND = 'import sys; from setuptools.build_meta import __legacy__; print(__legacy__.build_wheel(sys.argv[1]))'


def build(package: str, folder: Path) -> Path:
    """The wheel of a package, in a folder; needs setuptools and wheel, and no network."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        source = Path(scratch) / package
        shutil.copytree(ROOT / 'src' / package, source, ignore=shutil.ignore_patterns(*LEFT_OUT))
        command = [sys.executable, '-c', BACKEND, str(folder.resolve())]
        done = subprocess.run(command, cwd=source, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f'{package}: {done.stderr[-3000:]}')
    return folder / done.stdout.splitlines()[-1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('folder', type=Path, help='where the wheels are put')
    folder = parser.parse_args().folder
    for package in PACKAGES:
        print(build(package, folder))


if __name__ == '__main__':
    main()
