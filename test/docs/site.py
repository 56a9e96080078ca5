"""Builds the HTML site of the documentation, with the reference from the docstrings: ``python test/docs/site.py``.

The pages stay where they are in the repository, each beside what it describes, so that they can be read there too. Here
they are copied, links to code are made to lead to the reference, and mkdocs builds the site into out/site/html. A link
that leads nowhere, an anchor that does not exist and a docstring that cannot be read fail the build.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import io
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from dap_emulator import dap_cli

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / 'out' / 'site'
PAGES = OUT / 'pages'
PACKAGES = ('msgs_py', 'dap_emulator', 'csg_renderer', 'stereo_recovery', 'model_matcher')
PICTURES = ('.png', '.jpg', '.svg', '.gif')
STYLE = ROOT / 'test' / 'docs' / 'site.css'
# A README would become the face of the navigation's section that it stands in.
RENAMED = {'test/README.md': 'test/tests.md'}
LINK = re.compile(r'(!?\[[^\]]*\])\(([^)#\s]+)(#[^)\s]*)?\)')
# Array programs that the site shows at work, and where it says so.
PROGRAMS = ('life', 'sobel', 'tree', 'raycast')
WATCH_HEADING = '## Watch it'
# Pages of the repository in the order of the navigation: title and place.
ABOUT = (
    ('Architecture', 'ARCHITECTURE.md'),
    ('Contributing', 'CONTRIBUTING.md'),
    ('Changes', 'CHANGELOG.md'),
    ('Security', 'SECURITY.md'),
    ('Tests', 'test/README.md'),
)
GUIDES = {
    'msgs_py': (),
    'dap_emulator': (('The array machine', 'docs/dap.md'),),
    'csg_renderer': (
        ('The modelling language', 'docs/language.md'),
        ('Gallery', 'docs/scenes.md'),
        ('As a camera sees it', 'docs/camera.md'),
    ),
    'stereo_recovery': (('Your camera', 'docs/your_camera.md'), ('The method', 'docs/method.md')),
    'model_matcher': (
        ('The pose in the images', 'docs/images.md'),
        ('Proven', 'docs/proof.md'),
        ('Will it work in my cell?', 'docs/planning.md'),
        ('BOP and BPC', 'docs/benchmarks.md'),
    ),
}


def pages() -> list[Path]:
    """The pages of the repository."""
    found = [ROOT / 'README.md', ROOT / 'test' / 'experiments' / 'RESULTS.md', *(ROOT / path for _, path in ABOUT)]
    for package in PACKAGES:
        folder = ROOT / 'src' / package
        found += [folder / 'README.md', *(folder / path for _, path in GUIDES[package])]
    return found


def place_in_site(page: Path) -> str:
    """Where a page of the repository stands among the site's pages."""
    place = page.relative_to(ROOT).as_posix()
    return RENAMED.get(place, place)


def copy(page: Path, known: set[Path]) -> None:
    """A page with its pictures; links to what is no page become the names of what they led to."""
    target = PAGES / place_in_site(page)
    target.parent.mkdir(parents=True, exist_ok=True)

    def link(match: re.Match[str]) -> str:
        label, place, anchor = match.groups()
        if '://' in place or place.startswith('mailto:'):
            return match.group(0)
        led_to = (page.parent / place).resolve()
        if led_to.is_dir() and (led_to / 'README.md') in known:
            led_to = led_to / 'README.md'
        if led_to in known:
            return f'{label}({os.path.relpath(PAGES / place_in_site(led_to), target.parent)}{anchor or ""})'
        if led_to.suffix in PICTURES:
            kept = PAGES / led_to.relative_to(ROOT)
            kept.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(led_to, kept)
            return match.group(0)
        if not led_to.exists():
            raise SystemExit(f'{page.relative_to(ROOT)}: a link leads to {place}, which is not there')
        name = label.strip('[]')
        return name if name.startswith('`') else f'{name} (`{led_to.relative_to(ROOT)}`)'

    target.write_text(LINK.sub(link, page.read_text(encoding='utf-8')), encoding='utf-8')


def add_programs_at_work() -> None:
    """Pages of array programs at work, which only the site has, and links to them where watching is described."""
    folder = PAGES / 'src' / 'dap_emulator' / 'docs'
    links = []
    for name in PROGRAMS:
        with contextlib.redirect_stdout(io.StringIO()):
            dap_cli.main(['run', name, '--example', '--html', str(folder / f'{name}.html')])
        links.append(f'[{name}]({name}.html)')
    page = folder / 'dap.md'
    text = page.read_text(encoding='utf-8')
    here = f'{WATCH_HEADING}\n\nHere they are at work: {", ".join(links)}.\n'
    page.write_text(text.replace(f'{WATCH_HEADING}\n', here), encoding='utf-8')


def purpose(folder: Path) -> str:
    """The first line of a package's or room's docstring."""
    words = ast.get_docstring(ast.parse((folder / '__init__.py').read_text(encoding='utf-8')))
    return (words or '').splitlines()[0]


def exported(package: str) -> list[str]:
    """Public names of a package, from its ``__all__``; old names, which only ``__getattr__`` knows, are left out."""
    tree = ast.parse((ROOT / 'src' / package / package / '__init__.py').read_text(encoding='utf-8'))
    imported = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    for node in tree.body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], 'id', '') == '__all__':
            return sorted(imported & set(ast.literal_eval(node.value)))
    return []


def reference(package: str) -> list[dict[str, object]]:
    """Writes the reference pages of a package; returns their part of the navigation."""
    folder = ROOT / 'src' / package / package
    place = PAGES / 'reference' / package
    place.mkdir(parents=True, exist_ok=True)
    lines = [f'# {package}', '', purpose(folder), '']
    for name in exported(package):
        lines += [f'::: {package}.{name}', '']
    (place / 'index.md').write_text('\n'.join(lines), encoding='utf-8')
    entries: list[dict[str, object]] = [{'Public names': f'reference/{package}/index.md'}]
    rooms = sorted(path.parent for path in folder.glob('*/__init__.py'))
    for room in rooms:
        lines = [f'# {package}.{room.name}', '', purpose(room), '']
        for module in sorted(room.rglob('*.py')):
            if module.name.startswith('_') or module.name.endswith('.launch.py'):
                continue
            dotted = '.'.join(module.relative_to(folder.parent).with_suffix('').parts)
            lines += [f'::: {dotted}', '    options:', '      show_root_full_path: true', '']
        (place / f'{room.name}.md').write_text('\n'.join(lines), encoding='utf-8')
        entries.append({room.name: f'reference/{package}/{room.name}.md'})
    return entries


def quoted(value: object, depth: int = 0) -> str:
    """Nested lists of one-entry dictionaries as YAML."""
    text = ''
    for entry in value if isinstance(value, list) else []:
        ((title, content),) = entry.items()
        text += '  ' * depth + f"- '{title}':"
        text += f" '{content}'\n" if isinstance(content, str) else '\n' + quoted(content, depth + 2)
    return text


def main(arguments: list[str] | None = None) -> int:
    """Put the pages together and build; the exit code is that of mkdocs."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('--serve', action='store_true', help='serve on localhost instead of building')
    options = parser.parse_args(arguments)
    shutil.rmtree(OUT, ignore_errors=True)
    known = set(pages())
    for page in known:
        copy(page, known)
    add_programs_at_work()
    packages: list[dict[str, object]] = []
    for package in PACKAGES:
        guides: list[dict[str, object]] = [{'Overview': f'src/{package}/README.md'}]
        guides += [{title: f'src/{package}/{path}'} for title, path in GUIDES[package]]
        packages.append({package: guides})
    navigation: list[dict[str, object]] = [
        {'Home': 'README.md'},
        {'Packages': packages},
        {'Results': 'test/experiments/RESULTS.md'},
        {'Reference': [{package: reference(package)} for package in PACKAGES]},
        {'About': [{title: place_in_site(ROOT / path)} for title, path in ABOUT]},
    ]
    shutil.copyfile(STYLE, PAGES / STYLE.name)
    source = (ROOT / 'mkdocs.yml').read_text(encoding='utf-8')
    config = OUT / 'mkdocs.yml'
    config.write_text(
        source.replace('paths: [src/', 'paths: [../../src/').replace(' src/', ' ../../src/')
        + f'docs_dir: pages\nsite_dir: html\nnav:\n{quoted(navigation, 1)}',
        encoding='utf-8',
    )
    command = [sys.executable, '-m', 'mkdocs', *(['serve'] if options.serve else ['build', '--strict', '--quiet'])]
    code = subprocess.run([*command, '--config-file', str(config)], check=False, cwd=ROOT).returncode
    if code == 0 and not options.serve:
        print(f'open {(OUT / "html" / "index.html").relative_to(ROOT)}')
    return code


if __name__ == '__main__':
    sys.exit(main())
