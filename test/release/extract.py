"""Takes from a clone of the rosdistro repository what the packages name, into rosdistro/, in the repository's own form.

``rosdep`` and ``bloom`` read the extract as they read the whole (dry_run.py), and need no network.

    git clone --depth 1 https://github.com/ros/rosdistro && python test/release/extract.py rosdistro
"""

from __future__ import annotations

import argparse
import subprocess
from collections.abc import Collection
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml

ROOT = Path(__file__).resolve().parents[2]
EXTRACT = Path(__file__).with_name('rosdistro')
DISTRIBUTION = 'jazzy'
INDEX = f"""%YAML 1.1
---
distributions:
  {DISTRIBUTION}:
    distribution: [{DISTRIBUTION}/distribution.yaml]
    distribution_status: active
    distribution_type: ros2
    python_version: 3
type: index
version: 4
"""
# What bloom asks for beside the packages' own keys: the build type's.
OF_BLOOM = ('ament_python', 'ros_workspace', 'ament_package')


def keys() -> list[str]:
    """Every key that a package.xml names and that is no package of ours."""
    manifests = [ElementTree.parse(path).getroot() for path in sorted((ROOT / 'src').glob('*/package.xml'))]
    ours = {manifest.findtext('name') for manifest in manifests}
    return sorted({str(e.text) for manifest in manifests for e in manifest if e.tag.endswith('depend')} - ours)


def released(distribution: dict[str, Any], wanted: Collection[str]) -> dict[str, Any]:
    """The repositories of a distribution.yaml that hold wanted packages, without the others that they hold."""
    found = {}
    for name, repository in distribution['repositories'].items():
        release = repository.get('release', {})
        packages = [package for package in release.get('packages', [name]) if package in wanted]
        if packages and 'version' in release:
            found[name] = {'release': release | {'packages': packages}}
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('clone', type=Path, help='a clone of ros/rosdistro')
    clone = parser.parse_args().clone

    def git(*arguments: str) -> str:
        return subprocess.run(['git', '-C', clone, *arguments], check=True, capture_output=True, text=True).stdout

    wanted = {*keys(), *OF_BLOOM}
    distribution = yaml.safe_load(git('show', f'HEAD:{DISTRIBUTION}/distribution.yaml'))
    distribution['repositories'] = released(distribution, wanted)
    python = yaml.safe_load(git('show', 'HEAD:rosdep/python.yaml'))
    commit, day = git('log', '-1', '--format=%H %cs').split()
    head = f'# Taken from ros/rosdistro, commit {commit} of {day}; see LICENSE beside this folder.\n'
    for name, content in {
        'index-v4.yaml': INDEX,
        f'{DISTRIBUTION}/distribution.yaml': '%YAML 1.1\n' + head + '---\n' + yaml.safe_dump(distribution),
        'rosdep/python.yaml': head + yaml.safe_dump({key: python[key] for key in sorted(wanted & set(python))}),
        'LICENSE': git('show', 'HEAD:LICENSE'),
    }.items():
        (EXTRACT / name).parent.mkdir(parents=True, exist_ok=True)
        (EXTRACT / name).write_text(content, encoding='utf-8')


if __name__ == '__main__':
    main()
