"""The programs that come with the package, and program files of users."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from pathlib import Path

from msgs_py.files import read_text

from .program import Program, compile
from .settings import PROGRAMS_CACHED

SUFFIX = '.fpp'


def program_names() -> list[str]:
    """Names of the library's programs, sorted.

    Examples
    --------
    >>> 'life' in program_names()
    True
    """
    folder = resources.files('dap_emulator').joinpath('programs')
    return sorted(item.name[: -len(SUFFIX)] for item in folder.iterdir() if item.name.endswith(SUFFIX))


def program_source(name: str) -> str:
    """Source text of a library program. Raises ValueError that lists the names."""
    if name not in program_names():
        raise ValueError(f'library: {name!r} is not there, expected one of {", ".join(program_names())}')
    return resources.files('dap_emulator').joinpath('programs').joinpath(name + SUFFIX).read_text(encoding='utf-8')


@lru_cache(maxsize=PROGRAMS_CACHED)
def compiled(source: str) -> Program:
    """Compile a program, once for each text. Raises FortranError."""
    return compile(source)


def load_program(name_or_path: str) -> Program:
    """Compile a library program or a file.

    Parameters
    ----------
    name_or_path : str
        A name of the library, or a path: .fpp, or .f and .for for fixed form.

    Returns
    -------
    Program

    Raises
    ------
    ValueError
        When it is neither; FortranError, which is one, when it cannot be compiled.
    OSError
        When the file cannot be read.
    """
    if name_or_path in program_names():
        return compiled(program_source(name_or_path))
    path = Path(name_or_path)
    if not path.is_file():
        raise ValueError(
            f'program: {name_or_path!r} is neither a file nor a library program ({", ".join(program_names())})'
        )
    text = read_text(path)
    return compile(text, 'fixed') if path.suffix.lower() in ('.f', '.for') else compiled(text)


def summary(name: str) -> str:
    """The first comment line of a library program."""
    first = program_source(name).lstrip().splitlines()[0]
    return first.lstrip('! ').strip()
