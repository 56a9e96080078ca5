"""What a release to the ROS distribution does with the packages, without a network: ``rosdep``, ``bloom-generate``.

Both read the extract of the distribution beside this file; the project's own packages stand in it as they will once
they are released. The tools are those on the PATH, or are installed with pip, apart from the project's environment.
rosdep resolves every key for Ubuntu 24.04, and says which of the packages this machine lacks (``rosdep check``): no
mistake of ours, and all of them where there is no ROS installation.

    python test/release/dry_run.py out/bloom
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import venv
from collections.abc import Mapping
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
EXTRACT = Path(__file__).with_name('rosdistro')
PACKAGES = ('msgs_py', 'dap_emulator', 'csg_renderer', 'stereo_recovery', 'model_matcher')
DISTRIBUTION, SYSTEM = 'jazzy', ('ubuntu', 'noble')


class Refused(Exception):
    """A tool has refused a package."""


def tools() -> Path:
    """The folder of ``bloom-generate`` and ``rosdep``; they are installed first where they are missing."""
    here = shutil.which('bloom-generate')
    if here and (Path(here).parent / 'rosdep').exists():
        return Path(here).parent
    folder = ROOT / 'out' / 'bloom-tools'
    if not (folder / 'bin' / 'bloom-generate').exists():
        venv.create(folder, with_pip=True)
        pip = [folder / 'bin' / 'python', '-m', 'pip', 'install', '--quiet', '--disable-pip-version-check']
        subprocess.run([*pip, 'bloom', 'rosdep', 'setuptools'], check=True)
    return folder / 'bin'


def distribution_with_ours(folder: Path) -> dict[str, str]:
    """Write the extract with our packages in it; the environment in which the tools read it."""
    shutil.copytree(EXTRACT, folder / 'rosdistro')
    listed = folder / 'rosdistro' / DISTRIBUTION / 'distribution.yaml'
    distribution = yaml.safe_load(listed.read_text(encoding='utf-8'))
    release = {'packages': list(PACKAGES), 'tags': {'release': 'release/{package}/{version}'}, 'version': '0.0.0-1'}
    distribution['repositories']['known_objects'] = {'release': release | {'url': 'https://example.com/release.git'}}
    listed.write_text('%YAML 1.1\n---\n' + yaml.safe_dump(distribution), encoding='utf-8')
    sources = folder / 'sources.list.d'
    sources.mkdir()
    (sources / '20-default.list').write_text(f'yaml {(folder / "rosdistro/rosdep/python.yaml").as_uri()}\n')
    return os.environ | {
        'ROSDISTRO_INDEX_URL': (folder / 'rosdistro' / 'index-v4.yaml').as_uri(),
        'ROSDEP_SOURCE_PATH': str(sources),
        'ROS_HOME': str(folder / 'home'),
        'HOME': str(folder / 'home'),
        'ROS_DISTRO': DISTRIBUTION,
        'ROS_PYTHON_VERSION': '3',
    }


def run(command: list[str | Path], environment: Mapping[str, str], **options: object) -> str:
    """What a tool says; :class:`Refused` with its last lines when it fails."""
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, **options)  # type: ignore[call-overload]
    if done.returncode:
        raise Refused(f'{" ".join(map(str, command))}\n{done.stdout[-2000:]}{done.stderr[-2000:]}')
    return str(done.stdout)


def resolved(bin_folder: Path, environment: Mapping[str, str]) -> dict[str, str]:
    """Of every key that the packages name, the package of Ubuntu that ``rosdep`` gives for it."""
    rosdep, own = bin_folder / 'rosdep', ['--rosdistro', DISTRIBUTION]
    run([rosdep, 'update', *own], environment)
    keys = sorted(set(run([rosdep, 'keys', '--from-paths', 'src', *own], environment, cwd=ROOT).split()))
    answer = run([rosdep, 'resolve', *keys, '--os', ':'.join(SYSTEM), *own], environment)
    return dict(re.findall(r'^#ROSDEP\[(.+)\]\n#apt\n(\S+)$', answer, re.MULTILINE))


def lacking(bin_folder: Path, environment: Mapping[str, str]) -> str:
    """What ``rosdep check`` says of this machine; :class:`Refused` when it does not know a key."""
    options = ['--from-paths', 'src', '--ignore-src', '--os', ':'.join(SYSTEM), '--rosdistro', DISTRIBUTION]
    command = [bin_folder / 'rosdep', 'check', *options]
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    if 'ERROR' in done.stdout + done.stderr or not done.stdout:
        raise Refused(f'rosdep check\n{done.stdout[-2000:]}{done.stderr[-2000:]}')
    return done.stdout


def control(bin_folder: Path, environment: Mapping[str, str], package: str, folder: Path) -> Path:
    """The ``debian/`` that ``bloom-generate rosdebian`` makes of a package, moved to a folder."""
    source = Path(environment['HOME']) / package
    shutil.copytree(ROOT / 'src' / package, source, ignore=shutil.ignore_patterns('build', '*.egg-info', '__pycache__'))
    system = ['--os-name', SYSTEM[0], '--os-version', SYSTEM[1], '--ros-distro', DISTRIBUTION]
    run([bin_folder / 'bloom-generate', 'rosdebian', *system], environment, cwd=source)
    target = folder / package
    shutil.rmtree(target, ignore_errors=True)
    return Path(shutil.move(source / 'debian', target))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('folder', type=Path, help='where the debian/ of each package is put')
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    bin_folder = tools()
    with tempfile.TemporaryDirectory() as scratch:
        environment = distribution_with_ours(Path(scratch))
        try:
            for key, package in resolved(bin_folder, environment).items():
                print(f'{key:24} {package}')
            print(lacking(bin_folder, environment))
            for package in PACKAGES:
                print(f'{package}: {control(bin_folder, environment, package, folder)}')
        except Refused as refusal:
            print(refusal, file=sys.stderr)
            return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
