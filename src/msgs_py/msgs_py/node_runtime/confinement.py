"""Files that may be named from outside: a node's parameters can be set by anybody on the network. Pure.

What the person who starts a node names is trusted; what a parameter change names later must lie in the folders that
were trusted then.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

PathLike = str | os.PathLike[str]


class TrustedFolders:
    """Folders whose files may be opened on request.

    Parameters
    ----------
    folders : iterable of path
        Trusted as they are.
    starting_points : iterable of path
        Files or folders that the node was started with: a folder is trusted, and the folder that holds a file.
    parameter : str
        The node's parameter that adds folders; errors name it.

    Raises
    ------
    ValueError
        For a path that no file system accepts.
    """

    def __init__(self, folders: Iterable[PathLike], starting_points: Iterable[PathLike], parameter: str) -> None:
        self.parameter = parameter
        found = [_real(folder) for folder in folders]
        for point in starting_points:
            if _is_file_name(point):
                real = _real(point)
                found.append(real if real.is_dir() else real.parent)
        self.folders = tuple(dict.fromkeys(found))

    def check(self, given: PathLike) -> None:
        """Refuse a path that leads out of the folders, also through links or '..'.

        Parameters
        ----------
        given : path
            A bare name that is no file here stands for something that comes with a package, and passes.

        Raises
        ------
        ValueError
            Names the folders, and the parameter that adds one.
        """
        if not _is_file_name(given):
            return
        real = _real(given)
        if not any(real == folder or folder in real.parents for folder in self.folders):
            known = ', '.join(str(folder) for folder in self.folders) or 'none'
            raise ValueError(
                f'{str(given)!r} is outside of the folders this node may read ({known}); '
                f'add its folder to {self.parameter} when the node is started'
            )


def _is_file_name(given: PathLike) -> bool:
    path = Path(given).expanduser()
    return len(path.parts) != 1 or path.is_absolute() or str(given) in ('.', '..') or os.path.lexists(path)


def _real(given: PathLike) -> Path:
    try:
        return Path(os.path.realpath(Path(given).expanduser()))
    except (OSError, ValueError) as error:  # a loop of links, a NUL, a name too long
        raise ValueError(f'{str(given)[:80]!r}: no usable path: {error}') from None
