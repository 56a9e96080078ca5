"""Runs the steps of the Dockerfile, and its command, on a minimal Debian root: no image builder is needed.

Needs root, debootstrap and unshare, and what the steps take from the network; where something is missing, it says so
and is content. The root knows no more of this machine than its name server, its certificates and its settings of pip.

    python test/stress/container.py
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# What a machine behind a proxy or with a mirror has, and a container on it is given.
OF_THE_MACHINE = ('etc/resolv.conf', 'etc/pip.conf', 'usr/local/share/ca-certificates')
PASSED_ON = re.compile(r'PIP_\w+|\w+_proxy|\w+_PROXY')


def instructions(text: str) -> list[tuple[str, str]]:
    """The instructions of a Dockerfile with their arguments, continued lines joined."""
    joined = re.sub(r'\\\n\s*', '', re.sub(r'^#.*\n', '', text, flags=re.MULTILINE))
    return [(line.split(' ', 1)[0], line.split(' ', 1)[1]) for line in joined.splitlines() if line]


def missing() -> str:
    """Why the steps cannot be run here; empty when they can."""
    if os.geteuid() != 0:
        return 'only root may make a root file system and change to it'
    absent = [tool for tool in ('debootstrap', 'unshare', 'chroot', 'git') if shutil.which(tool) is None]
    return f'{", ".join(absent)} not installed' if absent else ''


class Container:
    """A root file system in which the instructions are carried out."""

    def __init__(self, root: Path) -> None:
        self.root, self.folder = root, '/'
        self.environment = {'PATH': '/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin', 'HOME': '/root'}
        self.environment |= {key: value for key, value in os.environ.items() if PASSED_ON.fullmatch(key)}

    def begin(self, image: str) -> None:
        """Make the root of ``debian:RELEASE-slim``."""
        release = image.split(':')[1].removesuffix('-slim')
        subprocess.run(
            ['debootstrap', '--variant=minbase', release, self.root], check=True, capture_output=True, text=True
        )
        for place in OF_THE_MACHINE:
            here, there = Path('/', place), self.root / place
            if here.is_dir():
                shutil.copytree(here, there, dirs_exist_ok=True)
            elif here.exists():
                shutil.copyfile(here, there)

    def copy(self) -> None:
        """What the clone holds and git knows, into the working folder."""
        listed = ['git', 'ls-files', '--cached', '--others', '--exclude-standard']
        files = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout.splitlines()
        for file in files:
            target = self.root / self.folder.lstrip('/') / file
            if (ROOT / file).is_file():
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(ROOT / file, target)

    def run(self, command: str) -> None:
        """A command in the root, with /proc and /dev/shm of its own, which end with it."""
        inside = f'cd {self.folder} && {command}'
        shared = self.root / 'dev' / 'shm'
        shared.mkdir(parents=True, exist_ok=True)
        mounts = f'mount -t proc proc {self.root}/proc && mount -t tmpfs shm {shared}'
        steps = f'{mounts} && exec chroot {self.root} /bin/sh -ec "$1"'
        alone = ['unshare', '--mount', '--pid', '--fork', 'sh', '-ec', steps, 'sh', inside]
        subprocess.run(alone, env=self.environment, check=True, capture_output=True, text=True)

    def carry_out(self, name: str, argument: str) -> None:
        """One instruction; only those that the Dockerfile has."""
        if name == 'FROM':
            self.begin(argument)
        elif name == 'WORKDIR':
            self.folder = argument
            (self.root / argument.lstrip('/')).mkdir(parents=True, exist_ok=True)
        elif name == 'COPY':
            self.copy()
        elif name == 'ENV':
            key, value = argument.split('=', 1)
            self.environment[key] = value.replace(f'${key}', self.environment.get(key, ''))
        elif name == 'CMD':
            self.run(' '.join(re.findall(r'"([^"]*)"', argument)))
        else:
            assert name == 'RUN', name
            self.run(argument)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args()
    reason = missing()
    if reason:
        print(f'container: left out: {reason}')
        return 0
    with tempfile.TemporaryDirectory(prefix='container-') as scratch:
        container = Container(Path(scratch))
        for name, argument in instructions((ROOT / 'Dockerfile').read_text(encoding='utf-8')):
            begun = time.monotonic()
            try:
                container.carry_out(name, argument)
            except subprocess.CalledProcessError as failure:
                said = f'{failure.stdout or ""}{failure.stderr or ""}'[-5000:]
                print(f'{said}\ncontainer: {name} {argument}: exit status {failure.returncode}', file=sys.stderr)
                return 1
            print(f'container: {name} {argument[:60]}: done in {time.monotonic() - begun:.0f} s', flush=True)
    print('container: every step of the Dockerfile, and its command, done on a minimal Debian')
    return 0


if __name__ == '__main__':
    sys.exit(main())
