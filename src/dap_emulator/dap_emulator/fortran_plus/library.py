"""The programs that come with the package, and program files of one's own."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from pathlib import Path

from . import Program, compile

SUFFIX = '.fpp'


def program_names() -> list[str]:
    """Names of the library's programs."""
    folder = resources.files('dap_emulator').joinpath('programs')
    return sorted(item.name[: -len(SUFFIX)] for item in folder.iterdir() if item.name.endswith(SUFFIX))


def program_source(name: str) -> str:
    """Source text of a library program. Raises ValueError naming what there is."""
    if name not in program_names():
        raise ValueError(f'library: {name!r} is not there, expected one of {", ".join(program_names())}')
    return resources.files('dap_emulator').joinpath('programs').joinpath(name + SUFFIX).read_text(encoding='utf-8')


@lru_cache(maxsize=64)
def compiled(source: str) -> Program:
    """A program, compiled once for each text."""
    return compile(source)


def load_program(name_or_path: str) -> Program:
    """A library program by name, or a file (.fpp, or .f for fixed form). Raises ValueError or OSError."""
    if name_or_path in program_names():
        return compiled(program_source(name_or_path))
    path = Path(name_or_path)
    if not path.is_file():
        raise ValueError(
            f'program: {name_or_path!r} is neither a file nor a library program ({", ".join(program_names())})'
        )
    text = path.read_text(encoding='utf-8')
    return compile(text, 'fixed') if path.suffix.lower() in ('.f', '.for') else compiled(text)


def summary(name: str) -> str:
    """The first comment line of a library program."""
    first = program_source(name).lstrip().splitlines()[0]
    return first.lstrip('! ').strip()
